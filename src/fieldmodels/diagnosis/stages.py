"""Joins the diagnoses of a machine's stages into one."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.outcome import Diagnosis
from fieldmodels.diagnosis.result import Evidence, Verdict
from fieldmodels.model import Model, Stage

Progress = Callable[[str, float], None]


def held(stage: Stage) -> dict[str, float]:
    """Neutral values of the parameters of all effects that do not act in a stage."""
    return {
        f"{effect.name}.{p.name}": p.nominal
        for effect in stage.model.effects
        if effect.name not in stage.effects
        for p in effect.parameters
    }


def scaled_progress(report: Progress, number: int, count: int) -> Progress:
    """Report the progress of one of several stages as progress of the whole."""
    return lambda what, share: report(what, (number + share) / count)


def joined(model: Model, parts: Sequence[Diagnosis]) -> Diagnosis:
    """Join the stages' diagnoses: all causes, all gains, and the most informative verdict."""
    if len(parts) == 1:
        return parts[0]
    first = parts[0]
    found = [part.verdict for part in parts]
    order: tuple[Verdict, ...] = ("unrelated", "ambiguous", "named", "unknown", "consistent")
    return Diagnosis(
        model=model.name,
        machine=model,
        verdict=next(verdict for verdict in order if verdict in found),
        causes=tuple(cause for part in parts for cause in part.causes),
        mistaken=next((part.mistaken for part in parts if part.mistaken), ""),
        misfit=tuple(sorted((m for part in parts for m in part.misfit), key=lambda m: m.p_value)),
        gain={name: gain for part in parts for name, gain in part.gain.items()},
        curves=tuple(curve for part in parts for curve in part.curves),
        possible=tuple(cause for part in parts for cause in part.possible),
        seen=tuple(v for part in parts for v in part.seen),
        curve_effects={name: e for part in parts for name, e in part.curve_effects.items()},
        not_runnable=tuple(name for part in parts for name in part.not_runnable),
        next_measurement=next((part.next_measurement for part in parts if part.next_measurement), None),
        parameters=first.parameters,
        undetermined=first.undetermined,
        bounded=tuple(dict.fromkeys(words for part in parts for words in part.bounded)),
        vector=_vector(model, [part.vector for part in parts]),
        wandering={name: size for part in parts for name, size in part.wandering.items()},
        above_noise={name: times for part in parts for name, times in part.above_noise.items()},
        not_testable={name: why for part in parts for name, why in part.not_testable.items()},
        trained_on=first.trained_on,
        tested_on=first.tested_on,
        windows=first.windows,
        seconds=0.0,
        notes=tuple(dict.fromkeys(note for part in parts for note in part.notes)),
        evidence=Evidence(
            traces={name: rows for part in parts for name, rows in part.evidence.traces.items()},
            residuals={name: rows for part in parts for name, rows in part.evidence.residuals.items()},
            calibration={name: own for part in parts for name, own in part.evidence.calibration.items()},
            correlations=tuple(c for part in parts for c in part.evidence.correlations),
            ranking=tuple(row for part in parts for row in part.evidence.ranking),
            base=_vector(model, [part.evidence.base for part in parts]),
            stretch=first.evidence.stretch,
        ),
    )


def _vector(model: Model, vectors: Sequence[FloatArray]) -> FloatArray:
    """Nominal vector with the values that any stage has changed."""
    result = model.nominal.copy()
    for vector in vectors:
        moved = vector != model.nominal
        result[moved] = vector[moved]
    return np.asarray(result)
