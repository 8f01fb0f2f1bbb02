"""Whether the command explains anything of the response: before that, no simulation explains these data.

A window starts in the state that fits it best, so noise alone is predicted as well by any machine that hardly
moves; a refit finds one (a mass without bound). The question is put to windows that no fit has used: does the
fitted machine predict them better under the command as recorded than under its mean?
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from scipy.stats import ttest_1samp

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.gain import predict
from fieldmodels.diagnosis.held_out import leave_out_steps
from fieldmodels.diagnosis.linearisation import Fit
from fieldmodels.diagnosis.problem import Problem
from fieldmodels.diagnosis.selection import block_p_value
from fieldmodels.drivers.declaration import Declaration
from fieldmodels.recording import Recording, Windows

PARTS = 20
"""Parts of a record in each of which command and response are compared."""
DOUBT, CERTAIN = 0.05, 1e-3
"""p-values below which they go together: in doubt there is a relation, and what is wrong is not known; but
where nothing is found either, chance must be excluded."""
REMEDY = (
    "check that both columns are from the same run and on the same clock, that the actuator was connected, "
    "and that the machine moved by much more than the noise of its sensors"
)


def is_unrelated(
    training: Problem, testing: Problem, fits: Iterable[Fit], level: float, doubt: float = DOUBT
) -> bool:
    """Whether the command explains nothing of the response of a declared machine.

    Each fold of the training windows is predicted by the fit without it, the test windows by the whole one.

    Args:
        training: Windows that were fitted.
        testing: Windows to measure gains on.
        fits: Fits, the simplest first; one whose command explains something suffices.
        level: p-value of a paired test over blocks of windows, below which it does.
        doubt: p-value below which command and response go together, whatever the machine.

    Returns:
        False also where the command never changes: then there is nothing to relate.
    """
    model = training.model
    recordings = [part.windows.recording for part in training.parts]
    if not isinstance(model, Declaration) or all(
        np.ptp(r[s.name]) == 0 for r in recordings for s in model.inputs
    ):
        return False
    if any(_answers(recording, model, doubt) for recording in recordings):
        return False
    return not any(_gain_is_significant(training, testing, fitted, level) for fitted in fits)


def _answers(recording: Recording, model: Declaration, doubt: float) -> bool:
    """Whether a command goes with a measured signal or its rate: a controller's does, whatever the machine.

    The mean product of both is taken in each of ``PARTS`` parts of the record, and tested against zero.
    """
    commands = [s.name for s in model.inputs]
    tests = []
    for name in set(recording.signals) - set(commands):
        signal = np.asarray(recording[name])[:-1]
        rate = np.diff(recording[name])
        for command in commands:
            given = np.asarray(recording[command])[:-1]
            for shape in (signal, rate, np.sign(rate)):
                product = (given - np.nanmean(given)) * (shape - np.nanmean(shape))
                parts = [np.nanmean(part) for part in np.array_split(product, PARTS)]
                if np.ptp(parts) > 0:
                    tests.append(float(ttest_1samp(parts, 0.0).pvalue))
    return bool(tests) and min(tests) * len(tests) < doubt


def _gain_is_significant(training: Problem, testing: Problem, fitted: Fit, level: float) -> bool:
    """Whether the command improves predictions of windows that were not fitted."""
    coordinates = training.coordinates(fitted.free)
    here = coordinates.encode(fitted.parameters[fitted.free])
    trials = [(testing, fitted.parameters)]
    for fold, step in leave_out_steps(fitted, training.folds):
        parameters = fitted.parameters.copy()
        moved = np.clip(here + step, np.minimum(here, coordinates.lower), np.maximum(here, coordinates.upper))
        parameters[fitted.free] = coordinates.decode(moved)
        trials.append((training.select(training.folds == fold), parameters))
    gains = [_gain(problem, parameters) for problem, parameters in trials]
    first, blocks = 0, []
    for problem, _ in trials:
        blocks.append(first + np.unique(problem.blocks, return_inverse=True)[1])
        first = int(blocks[-1].max()) + 1
    return block_p_value(np.concatenate(gains), np.concatenate(blocks)) < level


def _gain(problem: Problem, parameters: FloatArray) -> FloatArray:
    """Half the logarithm of the errors' ratio, under the mean command and the recorded one, (windows,)."""
    still = replace(
        problem, parts=tuple(replace(p, windows=_at_rest(p.windows, problem)) for p in problem.parts)
    )
    with_it, without = (predict(one, parameters).squares for one in (problem, still))
    used = (with_it > 0) & (without > 0)
    ratio = np.log(np.where(used, without, 1.0) / np.where(used, with_it, 1.0))
    return np.asarray(0.5 * ratio.sum(axis=1))


def _at_rest(windows: Windows, problem: Problem) -> Windows:
    """The same windows under the mean of each command."""
    recording = windows.recording
    held = {s.name: np.full(len(recording), recording[s.name].mean()) for s in problem.model.inputs}
    return replace(windows, recording=problem.model.with_commands(recording, held))
