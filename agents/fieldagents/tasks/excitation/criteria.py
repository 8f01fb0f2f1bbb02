"""What makes an excitation better than another: costs of what a candidate is expected to lead to.

Equation numbers are those of V. A. Sujan and S. Dubowsky, IEEE/ASME Trans. Mechatronics 8(2), 2003. Each
criterion takes a `Forecast` and returns a cost, lower is better, shape (environments, candidates).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from fieldmodels.information import fast
from fieldmodels.machines.excitation.adjustment import cost, frozen_residuals, printed_residuals
from fieldmodels.machines.excitation.parameters import LOWER, PRIOR_VARIANCE, UPPER
from fieldmodels.machines.excitation.prediction import Outlook, Situation

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Forecast:
    """What is known, and what it will be with each candidate; of the estimated unknowns alone.

    Attributes:
        mean: Estimates, shape (environments, unknowns).
        bits: Information now [bits], of that shape.
        covariance: Expected, in units of the prior's deviations, shape (environments, candidates, unknowns,
            unknowns).
        bits_after: Expected information [bits], shape (environments, candidates, unknowns).
        sigma: Expected standard deviations, of that shape.
        gram: Expected A'A in units of the prior's deviations, of the covariance's shape.
        most: Bits of certainty, In^max of (16).
    """

    mean: Floats
    bits: Floats
    covariance: Floats
    bits_after: Floats
    sigma: Floats
    gram: Floats
    most: int


def forecast(situation: Situation, outlook: Outlook, estimated: NDArray[np.bool_], most: int) -> Forecast:
    """Cut a prediction down to what is estimated, and count its bits.

    Args:
        situation: Before the decision.
        outlook: After each candidate.
        estimated: Which unknowns are estimated, shape (22,).
        most: Precision of the channel in which information is counted [bits].
    """
    use = np.flatnonzero(estimated)
    low, high, deviation = LOWER[use], UPPER[use], np.sqrt(PRIOR_VARIANCE[use])
    covariance = outlook.covariance[..., use[:, None], use]
    sigma = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    now = np.sqrt(situation.covariance[:, use, use])
    return Forecast(
        mean=situation.mean[:, use],
        bits=fast(now, low, high, most),
        covariance=covariance / (deviation[:, None] * deviation),
        bits_after=fast(sigma, low, high, most),
        sigma=sigma,
        gram=outlook.gram[..., use[:, None], use],
        most=most,
    )


def residuals_printed(seen: Forecast) -> Floats:
    """R of (17) with (16) as printed, shape (environments, candidates, unknowns)."""
    return printed_residuals(seen.bits_after, seen.most)


def residuals_frozen(seen: Forecast) -> Floats:
    """R of (17) with the weights of (16) held at the current estimate, shape as above."""
    return frozen_residuals(seen.bits_after, seen.bits[:, None, :], seen.most)


def printed_cost(seen: Forecast) -> Floats:
    """(16) as printed: 1 - x + x^2 in the share x of the bits, least at half of them."""
    return cost(residuals_printed(seen))


def frozen_weight(seen: Forecast) -> Floats:
    """(16) as its text means it: uncertain parameters count more, by their share of bits as it is now."""
    return cost(residuals_frozen(seen))


def sum_of_bits(seen: Forecast) -> Floats:
    """Less the information about all parameters together."""
    return np.asarray(-seen.bits_after.sum(axis=-1))


def a_optimal(seen: Forecast) -> Floats:
    """Mean variance in units of the prior's (A-optimality)."""
    return np.asarray(np.trace(seen.covariance, axis1=-2, axis2=-1))


def d_optimal(seen: Forecast) -> Floats:
    """Volume of the ellipsoid of uncertainty (D-optimality)."""
    return np.asarray(np.linalg.slogdet(seen.covariance)[1])


def condition_number(seen: Forecast) -> Floats:
    """Condition number of the sensed A, columns in units of the prior (section VII-A after its [2])."""
    values = np.linalg.eigvalsh(seen.gram)
    least = np.maximum(values[..., 0], 1e-15 * values[..., -1])
    return np.asarray(0.5 * np.log(values[..., -1] / np.maximum(least, 1e-300)))


def relative_error(seen: Forecast) -> Floats:
    """Expected average error as Table I counts it; an estimate that says nothing counts as all wrong."""
    size = np.abs(seen.mean)[:, None, :]
    return np.asarray((seen.sigma / (size + seen.sigma)).mean(axis=-1))


CRITERIA: Mapping[str, Callable[[Forecast], Floats]] = MappingProxyType(
    {
        "condition_number": condition_number,
        "printed_cost": printed_cost,
        "frozen_weight": frozen_weight,
        "sum_of_bits": sum_of_bits,
        "a_optimal": a_optimal,
        "d_optimal": d_optimal,
        "relative_error": relative_error,
    }
)
"""By the name of the agent that uses it."""
