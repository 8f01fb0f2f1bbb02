"""Whether inputs are held between samples or move along a line: data decide, unless the user has said it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy import stats

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.diagnosis.candidates import Candidate, Candidates
from fieldmodels.diagnosis.informative import evenly
from fieldmodels.diagnosis.problem import build
from fieldmodels.drivers.declaration import Hold
from fieldmodels.machine import Machine, held_inputs
from fieldmodels.model import Model
from fieldmodels.recording import Recording

MARGIN = 10.0
"""Nats by which the other way must predict better."""
SHARE = 0.5
"""Of the variance of the errors that it must remove: dry friction on a pendulum imitates up to 0.28."""
LEVEL = 0.01
"""Level of the test over blocks of windows."""
ENOUGH = 10_000
"""Samples of windows that suffice for the decision."""
FEWEST = 12
"""Blocks of windows, however many samples each has."""
WORDS: dict[Hold, str] = {
    "held": "are held from sample to sample",
    "interpolated": "vary linearly between samples",
}


def decided(
    model: Model,
    recordings: Sequence[Recording],
    horizon: Callable[[Model, Sequence[Recording]], float],
    start: Callable[[Model], FloatArray],
    fixed: frozenset[str],
) -> tuple[Model, tuple[str, ...]]:
    """The model with inputs as they fit better, by a clear margin, and what to say of it.

    Args:
        model: The model; one that says itself what its inputs do, or of which the user has, stays as it is.
        recordings: The measured data.
        horizon: Length of its windows for these data [s].
        start: Its parameter vector with the fixed values.
        fixed: Names of parameters that are not fitted.
    """
    if not isinstance(model, Machine) or model.hold_said or not model.inputs:
        return model, ()
    if model.measured_inputs and all(s.name in r for s in model.measured_inputs for r in recordings):
        return model, ()  # what was given is known better than its command
    other: Hold = "interpolated" if model.hold == "held" else "held"
    found = []
    for hold in (model.hold, other):
        one = held_inputs(model, hold).scaled_to(recordings)
        problem, _ = evenly(build(one, recordings, horizon(one, recordings)), ENOUGH, FEWEST)
        candidates = Candidates(
            problem=problem, start=start(one), fixed=fixed, folds=problem.blocks % 4,
            whitener=np.diag(1 / problem.output_scale),
        )  # fmt: skip
        found.append((candidates, candidates.base()))
    (usual, base), (_, rival) = found
    rival = _weighed_alike(found[1][0], rival, usual)
    gain = base.loss - rival.loss
    total = float(gain.sum())
    variances = [float(np.mean((c.fit.raw @ usual.whitener.T) ** 2)) for c in (base, rival)]
    clear = total > MARGIN and variances[1] < (1.0 - SHARE) * variances[0]
    if not clear or _p_value(gain, usual.problem.blocks) > LEVEL:
        return model, ()
    said = (
        f"inputs that {WORDS[other]} explain these data better than inputs that {WORDS[model.hold]} (by "
        f"{total:.0f} nats) and are used; --hold decides it otherwise"
    )
    return held_inputs(model, other), (said,)


def _p_value(gain: FloatArray, blocks: IntArray) -> float:
    """One-sided p-value of a gain of every window, by a t-test over blocks."""
    number = np.unique(blocks, return_inverse=True)[1]
    return float(stats.ttest_1samp(np.bincount(number, weights=gain), 0.0, alternative="greater").pvalue)


def _weighed_alike(candidates: Candidates, rival: Candidate, usual: Candidates) -> Candidate:
    """The rival judged by the usual base's weights, without which losses do not compare."""
    candidates.whitener = usual.whitener
    return candidates.again(rival)
