"""Reversed signs and swapped columns: tried as hypotheses where the simulation is far from the data.

No effect is worth a name before the columns are right: a reversed command looks like an infinite mass.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from fieldmodels.diagnosis.candidates import Candidates
from fieldmodels.diagnosis.fit import fit
from fieldmodels.diagnosis.gain import noise_floor, predict
from fieldmodels.diagnosis.informative import evenly
from fieldmodels.diagnosis.linearisation import Fit
from fieldmodels.diagnosis.problem import Problem, build
from fieldmodels.drivers.curved import Curved, FreeCurve
from fieldmodels.model import Model
from fieldmodels.recording import Recording, RecordingError
from fieldmodels.rounding import listed

FAR = 3.0  # times the sensor's noise: a base that is nearer is not doubted
ENOUGH = 6_000  # samples of windows that suffice for the decision
FEWEST = 8  # blocks of windows, however many samples each has: right columns err by half or less
ALIKE = 1.02  # times the best hypothesis: one that is as good is said, too
STEPS = 20  # of the fit with the sensors' zeros
BETTER = 0.5  # of the error that right columns leave; wrong ones leave a tenth or less on every bench


def mistaken_columns(model: Model, train: Sequence[Recording], candidates: Candidates, found: Fit) -> str:
    """What is wrong with the columns, with the remedy; empty if nothing seems to be.

    Args:
        model: The model, scaled to the recordings.
        train: The recordings.
        candidates: Their windows, and what is fitted to them.
        found: The best that a search has found; right columns are not doubted where that is near the data.
    """
    if model.random_force:
        return ""
    if not error(evenly(candidates.problem, ENOUGH, FEWEST)[0], found)[1]:
        return ""
    refitted = refitted_to_some(candidates, candidates.problem)
    if not error(*refitted)[1]:
        return ""
    present, far = error(*_with_zeros(*refitted))
    if not far:
        return ""
    if said := _dead(model, train):
        return said
    errors: dict[str, float] = {}
    for changes, said in _hypotheses(model, train):
        changed = [_changed(r, changes) for r in train]
        try:
            problem = build(model.scaled_to(changed), changed, candidates.problem.horizon, candidates.problem)
        except RecordingError:
            continue
        errors[said], _ = error(*_with_zeros(*refitted_to_some(candidates, problem)))
    best = min(errors.values(), default=present)
    if not best < BETTER * present:
        return ""
    # A reversed sensor and a reversed command are often the same.
    return ", or ".join(said for said, one in errors.items() if one < ALIKE * best)


def _dead(model: Model, train: Sequence[Recording]) -> str:
    """What to do if a sensor never changes in some recordings and does in others; empty if none does."""
    for name in (s.name for s in model.outputs if not s.event):
        still = [r.source for r in train if name in r and len(np.unique(r[name])) == 1]
        if 0 < len(still) < len(train):
            return f"{name} never changes in {listed(still)} (leave out what was recorded with a dead sensor)"
    return ""


def _hypotheses(
    model: Model, train: Sequence[Recording]
) -> Iterator[tuple[Mapping[str, tuple[str, float]], str]]:
    """What to read in a column's place: another column, or the same with another sign; and its words."""
    names = [s.name for s in (*model.inputs, *model.outputs) if all(s.name in r for r in train)]
    events = {s.name for s in model.outputs if s.event}
    for name in names:
        if name not in events:
            said = f"the sign of {name} seems to be reversed (declare it as {name}=-{name})"
            yield {name: (name, -1.0)}, said
    for group in (model.inputs, model.outputs):
        for a, b in itertools.combinations(group, 2):
            if a.unit == b.unit and {a.name, b.name} <= set(names) - events:
                said = (
                    f"{a.name} and {b.name} seem to be swapped (declare {a.name}={b.name} and "
                    f"{b.name}={a.name})"
                )
                yield {a.name: (b.name, 1.0), b.name: (a.name, 1.0)}, said


def _changed(recording: Recording, changes: Mapping[str, tuple[str, float]]) -> Recording:
    signals = {name: sign * recording[source] for name, (source, sign) in changes.items()}
    return replace(recording, signals={**recording.signals, **signals})


def refitted_to_some(candidates: Candidates, problem: Problem) -> tuple[Problem, Fit]:
    """Windows enough for the decision, and the base refitted to them; see ``mistaken_columns``."""
    some, _ = evenly(problem, ENOUGH, FEWEST)
    if some is not candidates.problem:
        candidates = replace(candidates.of(some), whitener=np.diag(1 / some.output_scale))
    return some, candidates.base().fit


def _with_zeros(problem: Problem, fitted: Fit) -> tuple[Problem, Fit]:
    """The same with the sensors' zeros fitted, too: a reversed sensor may have one."""
    shown = {problem.model.outputs[j].name for j in np.unique(problem.outputs[~problem.events])}
    zeros = [FreeCurve("sensor", name, "time", np.array([0.0, 1.0]), np.ones((2, 1))) for name in shown]
    problem = replace(problem, model=Curved(problem.model, zeros))
    count = len(fitted.parameters)
    first = np.concatenate([fitted.parameters, np.zeros(len(zeros))])
    free = np.concatenate([fitted.free, np.arange(count, len(first))])
    return problem, fit(problem, first, free, fitted.whitener, fitted.states, STEPS)


def error(problem: Problem, fitted: Fit) -> tuple[float, bool]:
    """Error of a fit by the spread of the signals, and whether it is far from the noise."""
    prediction = predict(problem, fitted.parameters)
    rmse, logs, far = prediction.rmse(), [], False
    for j in np.unique(problem.outputs[~problem.events]):
        floor = noise_floor(problem, prediction, int(j))
        if floor > 0:  # of an output that is seldom observed the noise is unknown
            scale = np.sqrt(np.mean(problem.output_scale[problem.outputs == j] ** 2))
            logs.append(np.log(max(rmse[j], floor) / scale))
            far = far or bool(rmse[j] > FAR * floor)
    return (float(np.exp(np.mean(logs))), far) if logs else (0.0, False)
