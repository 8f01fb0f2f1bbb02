"""Whitening matrices: what errors are divided by, from the residuals of a fit."""

from __future__ import annotations

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.linearisation import Fit
from fieldmodels.diagnosis.problem import Problem


def diagonal_whitener(problem: Problem, raw: FloatArray) -> FloatArray:
    """Whitener that divides each average by its residual's root mean square, no less than its floor."""
    spread = np.maximum(np.sqrt(np.mean(raw**2, axis=0)), problem.floor)
    return np.asarray(np.diag(1.0 / np.where(problem.events, 1.0, spread)))


def whitener_by_output(problem: Problem, raw: FloatArray) -> FloatArray:
    """Whitener that divides each signal's features by their common root mean square."""
    known = np.where(np.isfinite(raw), raw, 0.0)
    size = np.empty(len(problem.outputs))
    for j in np.unique(problem.outputs):
        own = problem.outputs == j
        size[own] = np.sqrt(np.mean(known[:, own] ** 2))
    size = np.where(problem.events, 1.0, np.maximum(size, problem.floor))
    return np.asarray(np.diag(1 / size))


def covariance_whitener(problem: Problem, fitted: Fit, shrink: float = 0.15) -> FloatArray:
    """Whitener from the residual covariance of a fit, shrunk to its diagonal, eigenvalues floored.

    Few windows for many features need more shrinkage than the usual 15 %. Events are left unchanged.
    """
    if problem.alike:
        return _of_samples(problem, fitted.raw)
    if problem.events.any():
        result = np.eye(len(problem.outputs))
        if not problem.events.all():
            averages = ~problem.events
            result[np.ix_(averages, averages)] = _from_covariance(
                fitted.raw[:, averages], problem.floor[averages], len(fitted.free), shrink
            )
        return result
    return _from_covariance(fitted.raw, problem.floor, len(fitted.free), shrink)


def _from_covariance(raw: FloatArray, floor: FloatArray, free: int, shrink: float) -> FloatArray:
    windows, features = raw.shape
    scale = np.sqrt(np.mean(raw**2, axis=0) + floor**2)
    correlation = (raw / scale).T @ (raw / scale) / max(windows - free, 1) + np.diag((floor / scale) ** 2)
    shrink = max(shrink, features / (features + windows))
    correlation = (1 - shrink) * correlation + shrink * np.diag(np.diag(correlation))
    values, vectors = np.linalg.eigh(correlation)
    values = np.maximum(values, 0.05 * np.median(values))
    return np.asarray((vectors / np.sqrt(values)).T / scale)


def _of_samples(problem: Problem, raw: FloatArray) -> FloatArray:
    """Whitener by the covariance of outputs at the same sample, which is that of every sample."""
    outputs, number = np.unique(problem.outputs, return_inverse=True)
    samples = np.stack([raw[:, number == j].ravel() for j in range(len(outputs))])
    floor = [np.mean(problem.floor[number == j] ** 2) for j in range(len(outputs))]
    own = np.linalg.inv(np.linalg.cholesky(samples @ samples.T / samples.shape[1] + np.diag(floor)))
    place = np.sum(np.tril(number[:, None] == number[None, :], -1), axis=1)
    return np.where(place[:, None] == place[None, :], own[number[:, None], number[None, :]], 0.0)
