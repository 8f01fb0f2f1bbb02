"""Before a diagnosis: what the data can tell at all, by the linearisation of a small part of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from fieldmodels.diagnosis.candidates import SINGULAR, Candidates
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
from fieldmodels.model import Model
from fieldmodels.recording import Recording

ROWS = 2_000
"""Samples that are looked at."""


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
    clear = [name for name in names if name not in unclear]
    hidden = [name for name in pilot.names() if not pilot.identifiable(base, name)]
    told = [*without_command(model, train, fixed)]
    told += [f"can be told: {', '.join(clear) or 'no base parameter'}"]
    if unclear:
        told.append(f"cannot be told apart: {', '.join(unclear)}; --set one that you know")
    if hidden:
        told.append(f"effects that the base parameters absorb: {', '.join(hidden)}")
    return told
