"""Values that vary by chance: errors are larger where a named value matters more, whichever way they point.

A gain, a delay or a friction that changes from moment to moment is on average what it is named for, but the
name alone explains only that average. What is left then grows with how strongly the simulation depends on the
value, while noise of a sensor does not.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import stats

from fieldmodels.diagnosis.candidates import Candidate
from fieldmodels.diagnosis.problem import Problem

CHANCE = "random changes of "
"""Begins the words for a value that varies by chance."""
LEVEL = 1e-3
"""p-value of the rank test below which errors grow with sensitivity; none of 70 steady effects reached it."""
FEWEST = 30
"""Windows that suffice for the test."""


def varying_by_chance(problem: Problem, kept: Candidate) -> Mapping[str, str]:
    """Named effects whose values seem to vary by chance, each with that in words.

    Tested is the rank correlation over windows (Spearman 1904) of squared errors with the squared sensitivity
    to the effect, one-sided. Events are left out, and machines that chance drives anyhow.
    """
    fitted, model = kept.fit, problem.model
    if model.random_force or fitted.observations is not None or len(problem) < FEWEST:
        return {}
    errors = np.sum(fitted.residual**2, axis=1)
    result = {}
    for name in kept.effects:
        place = model.slice_of(name)
        own = (fitted.free >= place.start) & (fitted.free < place.stop) & fitted.active
        sensitivity = np.sum(fitted.jacobian[:, :, own] ** 2, axis=(1, 2))
        if np.ptp(sensitivity) > 0:
            test = stats.spearmanr(sensitivity, errors, alternative="greater")
            if test.pvalue < LEVEL:
                result[name] = f"{CHANCE}{name.replace('_', ' ')}"
    return result
