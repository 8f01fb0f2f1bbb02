"""The measurement that would tell rivals apart: T-optimality (Hunter and Reiner, 1965).

Among inputs of equal power, the one for which the rival, refitted, stays furthest from the chosen set.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fieldmodels.diagnosis.candidates import Candidate, Candidates
from fieldmodels.diagnosis.fit import fit
from fieldmodels.diagnosis.problem import build
from fieldmodels.diagnosis.result import NextMeasurement
from fieldmodels.diagnosis.selection import Selection
from fieldmodels.model import FloatArray, Model
from fieldmodels.recording import Recording, RecordingError, Windows

SECONDS = 20.0
ENOUGH = 8.0  # nats that tell two sets apart
Input = Callable[[FloatArray, np.random.Generator], FloatArray]


def next_measurement(
    candidates: Candidates, selection: Selection, rng: np.random.Generator
) -> NextMeasurement | None:
    """Choose the input that best separates the chosen set from its closest rival.

    Returns:
        None if the model has no input that could be chosen.
    """
    model = candidates.problem.model
    recording = candidates.problem.parts[0].windows.recording
    if len(model.inputs) != 1 or not selection.rivals or len(np.unique(recording[model.inputs[0].name])) <= 2:
        return None
    command = recording[model.inputs[0].name]
    rms, step = float(np.sqrt(np.mean(command**2))), recording.step
    time = np.arange(round(SECONDS / step), dtype=np.float64) * step
    rival = selection.rivals[0]
    scores: dict[tuple[str, float], tuple[float, FloatArray]] = {}
    for (kind, switch), shape in _inputs(step).items():
        values = shape(time, rng)
        values = values * rms / float(np.sqrt(np.mean(values**2)))
        score = _separation(model, selection.chosen, rival, time, values)
        if score is not None:
            scores[kind, switch] = score, values
    if not scores:
        return None
    (kind, switch), (score, values) = max(scores.items(), key=lambda item: item[1][0])
    ours, theirs = (" and ".join(s.effects).replace("_", " ") for s in (selection.chosen, rival))
    peak = float(np.abs(values).max())
    return NextMeasurement(
        why=(
            f"A {kind} (shortest {switch:g} s, {model.inputs[0].name} up to {peak:.3g} "
            f"{model.inputs[0].unit}) separates {ours} from {theirs} best: {SECONDS:g} s of it promise "
            f"{score:.1f} nats; about {SECONDS * ENOUGH / max(score, 1e-3):.0f} s would decide."
        ),
        input={
            "signal": model.inputs[0].name,
            "kind": kind,
            "shortest_s": switch,
            "peak": peak,
            "unit": model.inputs[0].unit,
            "duration_s": SECONDS,
            "nats": round(score, 2),
            "compared": {f"{k} {s:g} s": round(v[0], 2) for (k, s), v in scores.items()},
        },
    )


def _inputs(step: float) -> dict[tuple[str, float], Input]:
    """Candidate inputs by kind and shortest time."""

    def binary(switch: float) -> Input:
        count = max(round(switch / step), 1)
        return lambda t, rng: np.repeat(rng.choice([-1.0, 1.0], len(t) // count + 1), count)[: len(t)]

    def levels(switch: float) -> Input:
        count = max(round(switch / step), 1)
        return lambda t, rng: np.repeat(rng.uniform(-1, 1, len(t) // count + 1), count)[: len(t)]

    def sines(shortest: float) -> Input:
        frequencies = np.geomspace(0.1, 1 / shortest, 10)
        return lambda t, rng: np.asarray(
            np.sin(2 * np.pi * np.outer(t, frequencies) + rng.uniform(0, 2 * np.pi, 10)).sum(axis=1)
        )

    fast, medium = max(0.05, 2 * step), max(0.2, 4 * step)
    return {
        ("pseudo-random binary input", fast): binary(fast),
        ("pseudo-random binary input", medium): binary(medium),
        ("sequence of random steps", 0.5): levels(0.5),
        ("multisine", 0.2): sines(0.2),
        ("multisine", 1.0): sines(1.0),
    }


def _separation(
    model: Model, chosen: Candidate, rival: Candidate, time: FloatArray, values: FloatArray
) -> float | None:
    """Misfit [nats] of the refitted rival on what the chosen set would measure; None if it fails."""
    blank = Recording(
        time=time,
        signals={model.inputs[0].name: values} | {o.name: np.zeros(len(time)) for o in model.outputs},
        source="planned measurement",
    )
    whole = Windows(
        recording=blank,
        starts=np.zeros(1, dtype=np.int64),
        lengths=np.array([len(time)]),
        states=np.median(chosen.fit.states, axis=0)[None],
        observed=np.ones((1, len(time), len(model.outputs)), dtype=np.bool_),
    )
    outputs = model.simulate(chosen.fit.parameters[None], whole)[0, 0]
    if not np.isfinite(outputs).all():
        return None
    measured = {o.name: outputs[:, j] for j, o in enumerate(model.outputs)}
    planned = Recording(time=time, signals={**measured, model.inputs[0].name: values}, source=blank.source)
    try:
        problem = build(model, [planned], model.horizons[min(1, len(model.horizons) - 1)])
    except RecordingError:
        return None
    samples = problem.parts[0].counts.mean(axis=0)
    noise = np.array([model.outputs[j].noise or problem.output_scale[0] for j in problem.outputs])
    whitener = np.diag(np.sqrt(samples) / np.maximum(noise, 1e-12))
    fitted = fit(problem, rival.fit.parameters, rival.fit.free, whitener, iterations=6)
    return fitted.cost if np.isfinite(fitted.cost) else None
