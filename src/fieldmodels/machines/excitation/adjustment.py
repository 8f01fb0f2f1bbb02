"""Choosing the next excitation: the cost of eq (16) and the optimiser of eqs (17)-(23).

As printed, each term of (16) is 1 - x + x^2 in the share x = In / In^max of what can be known. Its minimum
is at x = 1/2, and x = 0 costs as much as x = 1: beyond half of the bits it punishes information. The text
wants "parameters with a higher uncertainty [to] receive a higher weight", and so does the first line of
(16), 1 - (1 - x) x, if the weight 1 - x is taken at the current estimate and held while the excitation is
chosen. Both are here.

Errata of the optimiser. (20) multiplies a gradient by a scalar where it means the outer product of
gradients (its second line, J'J + S, is right). (21) and (23) lack transposes, and (23) divides by a matrix:
meant is the solution of J'J d' = -G. That is the Gauss-Newton step, which the text calls steepest descent.
J'J is singular wherever a command has no influence (an amplitude of zero leaves the frequency without any),
so the default adds Levenberg and Marquardt's damping, which the text names too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from fieldmodels.arrays import FloatArray
from fieldmodels.information import BITS
from fieldmodels.model import ModelError

StepKind = Literal["levenberg_marquardt", "gauss_newton", "steepest_descent"]

_REACHES = 0.5 ** np.arange(8)
"""Lengths alpha of eq (23) that are tried along a step."""


def shares(information: ArrayLike, maximum: float | None = BITS) -> FloatArray:
    """In / In^max of each parameter.

    Args:
        information: In_i [bits], shape (..., unknowns).
        maximum: In^max [bits]: that of the channel (section VII-A: "In^max = 10 bits"); None takes "the
            current maximum associated with any of the parameter estimates", as the text under (16) says.

    Raises:
        ModelError: If the maximum is not positive.
    """
    bits = np.asarray(information, dtype=np.float64)
    if maximum is None:
        return np.asarray(bits / np.maximum(bits.max(axis=-1, keepdims=True), 1e-12))
    if not maximum > 0.0:
        raise ModelError(f"the greatest information must be positive, not {maximum} bits")
    return np.asarray(bits / maximum)


def printed_residuals(information: ArrayLike, maximum: float | None = BITS) -> FloatArray:
    """r_i of eq (16) as printed: r_i^2 = 1 - x + x^2; arguments and shape as of ``shares``."""
    x = shares(information, maximum)
    return np.sqrt(1.0 - x + x * x)


def frozen_residuals(information: ArrayLike, current: ArrayLike, maximum: float | None = BITS) -> FloatArray:
    """r_i of eq (16) with its weights frozen: r_i^2 = 1 - (1 - x_now) x.

    Args:
        information: In_i that an excitation is expected to give [bits], shape (..., unknowns).
        current: In_i of the current estimate [bits], shape (unknowns,): gives the weights.
        maximum: As of ``shares``; None takes it from ``current``.

    Returns:
        Shape (..., unknowns); what lies beyond In^max (nothing does, but for rounding) counts as In^max.
    """
    now = np.asarray(current, dtype=np.float64)
    greatest = max(float(now.max()), 1e-12) if maximum is None else maximum
    weights = 1.0 - np.clip(shares(now, greatest), 0.0, 1.0)
    return np.sqrt(np.maximum(1.0 - weights * shares(information, greatest), 0.0))


def cost(residuals: ArrayLike) -> FloatArray:
    """V = 1/2 R'R, eq (18), over the last axis."""
    r = np.asarray(residuals, dtype=np.float64)
    return np.asarray(0.5 * np.sum(r * r, axis=-1))


@dataclass(frozen=True)
class Adjustment:
    """An adjusted command.

    Attributes:
        command: The best command met, shape (commands,).
        cost: Its V, eq (18).
        evaluations: Candidates whose residuals were asked for.
    """

    command: FloatArray
    cost: float
    evaluations: int


def adjust(
    residuals: Callable[[FloatArray], FloatArray],
    start: ArrayLike,
    lower: ArrayLike,
    upper: ArrayLike,
    *,
    kind: StepKind = "levenberg_marquardt",
    iterations: int = 3,
    difference: float = 1e-3,
) -> Adjustment:
    """Adjust a command by eqs (17)-(23), in units of its range and within it.

    Each iteration asks for the Jacobian by differences and then for all lengths along the step, each as
    one batch; the best command met so far is kept, so that the cost never rises.

    Args:
        residuals: R(d), eq (17), of a batch of commands: (n, commands) to (n, unknowns).
        start: Command d to begin with, shape (commands,).
        lower: Least command, shape (commands,).
        upper: Greatest command, shape (commands,).
        kind: ``gauss_newton``: eq (23) as it is meant. ``levenberg_marquardt``: with damping.
            ``steepest_descent``: against the gradient (19), what the text says that (23) is.
        iterations: Steps of eq (22).
        difference: Step of the differences, as a share of the range.

    Raises:
        ModelError: If the kind is unknown, the box is empty, or the residuals are not finite.
    """
    if kind not in get_args(StepKind):
        raise ModelError(f"a step is one of {', '.join(get_args(StepKind))}, not {kind!r}")
    low, high = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
    if low.ndim != 1 or low.shape != high.shape or not np.all(high > low):
        raise ModelError("a command needs a least below a greatest value for each of its parts")
    span = high - low
    best = np.clip((np.asarray(start, dtype=np.float64) - low) / span, 0.0, 1.0)
    size = len(best)

    def ask(unit: FloatArray) -> FloatArray:
        found = np.asarray(residuals(low + span * unit), dtype=np.float64)
        if found.ndim != 2 or len(found) != len(unit) or not np.isfinite(found).all():
            raise ModelError(f"residuals must be finite, one row for each of {len(unit)} commands")
        return found

    evaluations, value, damping = 0, np.inf, 1e-3
    for _ in range(iterations):
        # At the upper edge the difference is taken inwards.
        nudge = np.where(best + difference > 1.0, -difference, difference)
        around = ask(np.vstack([best, best + np.diag(nudge)]))
        value = float(cost(around[0]))
        jacobian = ((around[1:] - around[0]) / nudge[:, None]).T
        gradient = jacobian.T @ around[0]
        step = _step(kind, jacobian, gradient, damping)
        tried = np.clip(best + _REACHES[:, None] * step, 0.0, 1.0)
        costs = cost(ask(tried))
        evaluations += 1 + size + len(tried)
        winner = int(np.argmin(costs))
        if costs[winner] >= value:
            damping *= 10.0
            continue
        best, value = tried[winner], float(costs[winner])
        damping = max(damping * (0.1 if winner == 0 else 2.0), 1e-9)
    if iterations == 0:
        value, evaluations = float(cost(ask(best[None]))[0]), 1
    return Adjustment(low + span * best, value, evaluations)


def _step(kind: StepKind, jacobian: FloatArray, gradient: FloatArray, damping: float) -> FloatArray:
    """Step of eq (23), in units of the range."""
    if kind == "steepest_descent":
        length = float(np.linalg.norm(gradient))
        return -gradient / length if length > 0.0 else gradient
    normal = jacobian.T @ jacobian
    if kind == "levenberg_marquardt":
        normal += damping * max(float(np.trace(normal)) / len(normal), 1e-12) * np.eye(len(normal))
        return np.asarray(np.linalg.solve(normal, -gradient))
    # Where J'J is singular this is the shortest of the solutions.
    return np.asarray(np.linalg.lstsq(normal, -gradient, rcond=1e-12)[0])
