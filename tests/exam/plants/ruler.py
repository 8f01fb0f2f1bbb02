"""How well a machine without faults can be fitted: by this the exam measures how large a fault is.

The nominal machine's parameters are fitted to the windows of one record, every window from the state that
fits best, and its error is measured on the windows of another record. It is a fit of the exam's own, so a
fault's size does not depend on the diagnosis that is examined.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fieldmodels.arrays import FloatArray

STEPS = 8
"""Steps of a fit."""
NUDGE = 1e-4
"""Of parameters, in their logarithm, and of states, in their scale, for differences."""

Predict = Callable[[FloatArray, FloatArray, FloatArray, FloatArray], FloatArray]
"""(parameters (b, p), states (b, w, s), inputs (w, n, i), first times (w,)) to outputs (b, w, n, o)."""


@dataclass(frozen=True)
class Windows:
    """Windows of one record.

    Attributes:
        inputs: Shape (w, n, i).
        outputs: As measured; NaN for none, shape (w, n, o).
        states: Where each may begin, shape (w, s).
        times: When each begins [s], shape (w,).
    """

    inputs: FloatArray
    outputs: FloatArray
    states: FloatArray
    times: FloatArray


@dataclass(frozen=True)
class Ruler:
    """A nominal machine to be fitted.

    Attributes:
        predict: Simulates windows.
        noise: Standard deviation of each output, by which errors are weighed, shape (o,).
        scale: Of the states, shape (s,).
        tied: How far a state is likely from where the window begins, in its scale, shape (s,); infinite for
            free ones.
    """

    predict: Predict
    noise: FloatArray
    scale: FloatArray
    tied: FloatArray

    def errors(self, train: Windows, test: Windows, base: FloatArray, refit: bool = True) -> FloatArray:
        """Root mean square error of each output on the test windows, refitted on the training windows.

        Args:
            train: Windows to fit parameters to.
            test: Windows to measure the error on; states are fitted there, too.
            base: Where parameters begin, all positive, shape (p,).
            refit: Whether they are fitted at all.
        """
        fitted, _, _ = self._fit(train, base, refit)
        _, _, residual = self._fit(test, fitted, False)
        with np.errstate(invalid="ignore"):
            squares = np.where(np.isnan(test.outputs), np.nan, (residual * self.noise) ** 2)
        measured = ~np.isnan(test.outputs).all(axis=(0, 1))
        result = np.full(len(self.noise), np.nan)
        result[measured] = np.sqrt(np.nanmean(squares[:, :, measured], axis=(0, 1)))
        return result

    def _fit(
        self, windows: Windows, base: FloatArray, refit: bool
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Parameters, states and whitened errors (w, n, o) that fit best."""
        log, states, damping = np.log(base), windows.states.copy(), 1e-6
        cost, residual = self._cost(windows, log, states)
        for _ in range(STEPS):
            by_parameters, by_states = self._slopes(windows, log, states, refit)
            q, r = np.linalg.qr(by_states)
            free = self._padded(residual, windows, states)
            projected = free - np.einsum("wij,wkj,wk->wi", q, q, free, optimize=True)
            step = np.zeros(len(log))
            if refit:
                columns = by_parameters - q @ (q.transpose(0, 2, 1) @ by_parameters)
                flat = columns.reshape(-1, len(log))
                normal = flat.T @ flat
                normal += damping * np.diag(np.diag(normal) + 1e-9 * np.trace(normal) + 1e-30)
                step = np.linalg.lstsq(normal, flat.T @ projected.ravel(), rcond=1e-12)[0]
                step = np.clip(step, -1.0, 1.0)
            rest = np.einsum("wij,wi->wj", q, free - by_parameters @ step)
            change = np.linalg.solve(r, rest[:, :, None])[:, :, 0]
            next_log, next_states = log + step, states + change * self.scale
            next_cost, next_residual = self._cost(windows, next_log, next_states)
            if next_cost < cost:
                gained = cost - next_cost
                log, states, cost, residual = next_log, next_states, next_cost, next_residual
                damping *= 0.1
                if gained < 1e-4 * cost / max(residual[..., 0].size, 1) or gained < 1e-9 * cost:
                    break
            else:
                damping = max(1e3 * damping, 1e-3)
        return np.exp(log), states, residual

    def _cost(self, windows: Windows, log: FloatArray, states: FloatArray) -> tuple[float, FloatArray]:
        predicted = self.predict(np.exp(log)[None], states[None], windows.inputs, windows.times)[0]
        residual = np.nan_to_num((windows.outputs - predicted) / self.noise, posinf=np.inf, neginf=np.inf)
        residual = np.where(np.isnan(windows.outputs), 0.0, residual)
        total = float(np.sum(self._padded(residual, windows, states) ** 2))
        return (total if np.isfinite(total) else np.inf), residual

    def _padded(self, residual: FloatArray, windows: Windows, states: FloatArray) -> FloatArray:
        """Errors with those of the states below, shape (w, n * o + s)."""
        off = (windows.states - states) / (self.scale * self.tied)
        return np.concatenate([residual.reshape(len(residual), -1), off], axis=1)

    def _slopes(
        self, windows: Windows, log: FloatArray, states: FloatArray, refit: bool
    ) -> tuple[FloatArray, FloatArray]:
        """Change of whitened predictions by parameters (w, rows, p) and by states (w, rows, s)."""
        p, s = len(log) if refit else 0, states.shape[1]
        logs = np.repeat(log[None], 1 + p + s, axis=0)
        starts = np.repeat(states[None], 1 + p + s, axis=0)
        logs[1 + np.arange(p), np.arange(p)] += NUDGE
        for j in range(s):
            starts[1 + p + j, :, j] += NUDGE * self.scale[j]
        out = self.predict(np.exp(logs), starts, windows.inputs, windows.times)
        slopes = (out[1:] - out[0]) / (NUDGE * self.noise)
        slopes = np.where(np.isnan(windows.outputs), 0.0, slopes).reshape(p + s, len(states), -1)
        slopes = slopes.transpose(1, 2, 0)
        below = np.zeros((len(states), s, p + s))
        below[:, :, p:] = np.diag(1.0 / self.tied)
        whole = np.concatenate([slopes, below], axis=1)
        by_parameters = whole[:, :, :p] if refit else np.zeros((*whole.shape[:2], len(log)))
        return by_parameters, whole[:, :, p:]
