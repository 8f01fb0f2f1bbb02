"""Before a diagnosis: what the data can tell at all, by the linearisation of a small part of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fieldmodels.diagnosis.candidates import SINGULAR, Candidate, Candidates
from fieldmodels.diagnosis.cutting import (
    check_range,
    excerpts,
    in_all,
    known_values,
    split,
    start_vector,
    without_command,
)
from fieldmodels.diagnosis.informative import evenly
from fieldmodels.diagnosis.linearisation import stacked
from fieldmodels.diagnosis.problem import Problem
from fieldmodels.diagnosis.procedure import diagnose
from fieldmodels.drivers.declaration import Declaration
from fieldmodels.model import Model
from fieldmodels.recording import Recording, RecordingError
from fieldmodels.registry import get_model
from fieldmodels.rounding import listed, with_error, words

ROWS = 2_000
"""Samples that are looked at."""
TOLD = 2.0
"""Rows apart, below which no time constant is told: it shows in the first row after a change alone."""
MOVED = 1e-3
"""Of its spread, by which a state is moved to see how long a machine remembers it."""


def identifiable(model: Model, train: Sequence[Recording], fixed: Mapping[str, float]) -> list[str]:
    """What the recordings can tell of a model, in sentences.

    Args:
        model: The simulation.
        train: Recordings of a diagnosis.
        fixed: Values of parameters that are known.

    Raises:
        RecordingError: If there are too few data, or none that a sensor can have measured.
    """
    check_range(model, train)
    train, _, _ = in_all(model, train, ())
    held = {**known_values(model, train), **fixed}
    few = excerpts(model, train)
    stage = model.stages(few)[0].model.scaled_to(few)
    problem = evenly(split(stage, few, ())[0], ROWS)[0]
    pilot = Candidates(
        problem, start_vector(stage, held), frozenset(held), problem.folds, np.diag(1 / problem.output_scale)
    )
    base = pilot.base(iterations=5)
    columns = stacked(base.fit.jacobian)
    columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    _, sizes, turned = np.linalg.svd(columns, full_matrices=False)
    mixed = np.abs(turned[sizes < SINGULAR]).max(axis=0, initial=0.0) > 0.1
    names = [stage.names[i] for i in base.fit.free]
    unclear = [name for name, one in zip(names, mixed, strict=True) if one]
    times = {p.name for p in stage.parameters if p.unit == "s"}
    clear = [name for name in names if name not in unclear]
    hidden = [name for name in pilot.names() if not pilot.identifiable(base, name)]
    told = [*without_command(model, train, fixed)]
    told += (coarse := _coarse(problem, base))
    told += _as_map(model, train) if coarse and len(model.inputs) == 1 else []
    clear = [name for name in clear if not (coarse and name in times)]
    told += [f"can be told: {', '.join(clear) or 'no base parameter'}"]
    if unclear:
        told.append(f"cannot be told apart: {', '.join(unclear)}; --set one that you know")
    if hidden:
        told.append(f"effects that the base parameters absorb: {', '.join(hidden)}")
    return told


def _coarse(problem: Problem, base: Candidate) -> list[str]:
    """Of a machine that has forgotten its start by the next rows: how far apart these are."""
    step, memory = problem.parts[0].windows.recording.step, _memory(problem, base)
    if not 0.0 < memory < TOLD * step:
        return []
    longest = problem.parts[0].windows.samples * step
    return [
        f"rows are {step:.3g} s apart: no time constant below about {TOLD * step:.2g} s can be told, nor one "
        f"much above the windows' {longest:.3g} s; for a machine that settles from row to row, --machine map "
        "tells its dead zone, limits and curve instead"
    ]


def _as_map(model: Model, train: Sequence[Recording]) -> list[str]:
    """What a static map of the first output says of it, in numbers; nothing if it says nothing."""
    pairs = {"command": model.inputs[0].name, "response": model.outputs[0].name}
    mapped = [
        replace(
            one,
            signals={new: one[name] for new, name in pairs.items()},
            units={new: one.units[name] for new, name in pairs.items() if name in one.units},
            lost={},
        )
        for one in train
    ]
    try:
        causes = diagnose(get_model("map"), mapped).causes
    except RecordingError:
        return []
    parts = []
    for cause in causes:
        sizes = [(n, e) for n, e in cause.parameters.items() if np.isfinite(e.std) and "value_" not in n]
        told = ", ".join(f"{name} {with_error(e.value, e.std, e.unit)}" for name, e in sizes)
        parts.append(f"{words(cause.effect)} ({told})" if told else words(cause.effect))
    return [f"as a static map of {pairs['response']!r}: {listed(parts)}"] if parts else []


def _memory(problem: Problem, base: Candidate) -> float:
    """Time [s] in which a machine forgets a third of how an output began: the longest; 0 if there is none."""
    model = problem.model
    if not isinstance(model, Declaration) or model.ahead:
        return 0.0
    names, windows = [s.name for s in model.states], problem.parts[0].windows
    found = []
    for j in np.unique(problem.outputs).tolist():
        if model.outputs[j].name not in names:
            return 0.0
        i = names.index(model.outputs[j].name)
        moved = windows.states.copy()
        moved[:, i] += MOVED * problem.state_scale[i]
        both = [
            model.simulate(base.fit.parameters[None], windows.with_states(s)) for s in (windows.states, moved)
        ]
        first, second = np.nanmedian(np.abs(both[1] - both[0])[0, :, :2, j], axis=0)
        found.append(-windows.recording.step / np.log(second / first) if 0.0 < second < first else np.inf)
    return float(max(found))
