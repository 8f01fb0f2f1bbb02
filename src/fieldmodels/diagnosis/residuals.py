"""Residual diagnostics of the refitted nominal simulation, signal by signal."""

from __future__ import annotations

import numpy as np
from scipy import stats

from fieldmodels.diagnosis.candidates import Candidate
from fieldmodels.diagnosis.curves import Curves
from fieldmodels.diagnosis.held_out import held_out_loss
from fieldmodels.diagnosis.linearisation import Fit, reweighed
from fieldmodels.diagnosis.options import DiagnosisOptions
from fieldmodels.diagnosis.problem import IntArray, Problem
from fieldmodels.diagnosis.result import FailedTest
from fieldmodels.diagnosis.whitening import diagonal_whitener


def failed_tests(
    problem: Problem, base: Candidate, options: DiagnosisOptions, curves: Curves
) -> tuple[FailedTest, ...]:
    """Residual tests that the refitted base fails, smallest p-value first.

    For each signal: whether its residual is white within a window, and whether a force that depends on
    time, on an output or on an input would reduce it on held-out windows. p-values of the best of
    several directions are multiplied by their number (Bonferroni).

    Args:
        problem: The windows.
        base: The base alone.
        options: Thresholds.
        curves: What is tried beside it.
    """
    result = []
    for j in np.unique(problem.outputs):
        signal = problem.model.outputs[j].name
        mask = problem.outputs == j
        # Rows of the other signals are left out of the whitener, so that only this one counts.
        whitener = diagonal_whitener(problem, base.fit.raw)[mask]
        own = reweighed(problem, base.fit, whitener)
        p = whiteness(own, np.arange(len(whitener)), problem.blocks)
        resolved = bool((np.mean(base.fit.raw[:, mask] ** 2, axis=0) > problem.floor[mask] ** 2).any())
        if p < options.level and resolved:  # what a simulation and rounding leave is never white
            result.append(
                FailedTest(signal, "whiteness", p, "neighbouring errors within a window are correlated")
            )
        candidate = Candidate((), own, 0.0, held_out_loss(own, problem.folds))
        judged = curves.reweighed(own).judge(candidate, curves.all)
        for found in judged[:2]:
            p = min(1.0, found.p_value * len(judged))
            if p < options.level:
                result.append(FailedTest(signal, "dependence", p, f"depends on {found.curve.direction}"))
    return tuple(sorted(result, key=lambda m: m.p_value))


def whiteness(fitted: Fit, features: IntArray, blocks: IntArray) -> float:
    """Two-sided p-value that neighbouring residuals of a signal are correlated, by a t-test over blocks.

    The correlation that fitting the initial states causes even in white noise is subtracted.
    """
    if len(features) < 4:
        return 1.0
    residual = fitted.residual[:, features]
    residual = residual / np.maximum(np.sqrt(np.mean(residual**2, axis=0)), 1e-300)
    basis = fitted.basis[:, features]
    kept = np.eye(len(features)) - np.mean(basis @ basis.transpose(0, 2, 1), axis=0)
    size = np.sqrt(np.diag(kept))
    expected = float(np.sum(np.diag(kept, 1) / (size[1:] * size[:-1])))
    excess = np.sum(residual[:, 1:] * residual[:, :-1], axis=1) - expected
    number = np.unique(blocks, return_inverse=True)[1]
    means = np.bincount(number, weights=excess) / np.bincount(number)
    return float(stats.ttest_1samp(means, 0.0).pvalue)
