"""The measurement that would tell rivals apart: T-optimality (Hunter and Reiner, 1965).

Among inputs of equal power, the one for which the rival, refitted, stays furthest from the chosen set.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fieldmodels.diagnosis.candidates import Candidate, Candidates
from fieldmodels.diagnosis.fit import fit
from fieldmodels.diagnosis.problem import Problem, build
from fieldmodels.diagnosis.result import NextMeasurement
from fieldmodels.diagnosis.selection import Selection
from fieldmodels.model import FloatArray
from fieldmodels.recording import Recording, RecordingError, Windows

SECONDS = 20.0
ENOUGH = 8.0  # nats that tell two sets apart
HOPELESS = 0.1  # nats from the best input, of which nobody would record enough
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
    commands = np.column_stack([recording[signal.name] for signal in model.inputs])
    if not selection.rivals or any(len(np.unique(column)) <= 2 for column in commands.T):
        return None
    # A robot that only drives forwards has its commands about a mean.
    forwards = (commands >= 0).all(axis=0)
    mean = np.where(forwards, commands.mean(axis=0), 0.0)
    rms, step = np.sqrt(np.mean((commands - mean) ** 2, axis=0)), recording.step
    time = np.arange(round(SECONDS / step), dtype=np.float64) * step
    rival = selection.rivals[0]
    scores: dict[tuple[str, float], tuple[float, FloatArray]] = {}
    for (kind, switch), shape in _inputs(step).items():
        values = np.column_stack([shape(time, rng) for _ in model.inputs])
        values = mean + values * rms / np.sqrt(np.mean(values**2, axis=0))
        score = _separation(candidates.problem, selection.chosen, rival, time, values)
        if score is not None:
            scores[kind, switch] = score, values
    if not scores:
        return None
    (kind, switch), (score, values) = max(scores.items(), key=lambda item: item[1][0])
    ours, theirs = (" and ".join(s.effects).replace("_", " ") for s in (selection.chosen, rival))
    if score < HOPELESS:
        lacking = [output.name for output in model.outputs if output.name not in recording]
        more = f"measure {' and '.join(lacking)} too, or sample faster" if lacking else "sample faster"
        return NextMeasurement(
            why=f"No input tells {ours} from {theirs} by these signals at this rate: {more}.",
            input={"nats": round(score, 2), "measure": lacking},
        )
    peaks = [float(peak) for peak in np.abs(values).max(axis=0)]
    names = [signal.name for signal in model.inputs]
    up_to = ", ".join(f"{s.name} up to {p:.3g} {s.unit}" for s, p in zip(model.inputs, peaks, strict=True))
    several = len(names) > 1
    return NextMeasurement(
        why=(
            f"A {kind} (shortest {switch:g} s, {up_to}) separates {ours} from {theirs} best: "
            f"{SECONDS:g} s of it promise {score:.1f} nats; about {SECONDS * ENOUGH / score:.0f} s would "
            "decide."
        ),
        input={
            "signal": names if several else names[0],
            "kind": kind,
            "shortest_s": switch,
            "peak": peaks if several else peaks[0],
            "unit": [signal.unit for signal in model.inputs] if several else model.inputs[0].unit,
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
    present: Problem, chosen: Candidate, rival: Candidate, time: FloatArray, values: FloatArray
) -> float | None:
    """Misfit [nats] of the refitted rival on what the chosen set would measure; None if it fails."""
    model = present.model
    given = {signal.name: values[:, i] for i, signal in enumerate(model.inputs)}
    blank = Recording(
        time=time,
        signals=given | {o.name: np.zeros(len(time)) for o in model.outputs},
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
    compared = np.unique(present.outputs)
    if not np.isfinite(outputs[:, compared]).all():
        return None
    measured = {model.outputs[j].name: outputs[:, j] for j in compared}
    planned = Recording(time=time, signals={**measured, **given}, source=blank.source)
    try:
        problem = build(model, [planned], model.horizons[min(1, len(model.horizons) - 1)])
    except RecordingError:
        return None
    samples = problem.parts[0].counts.mean(axis=0)
    noise = np.array([model.outputs[j].noise or problem.output_scale[0] for j in problem.outputs])
    whitener = np.diag(np.sqrt(samples) / np.maximum(noise, 1e-12))
    fitted = fit(problem, rival.fit.parameters, rival.fit.free, whitener, iterations=6)
    return fitted.cost if np.isfinite(fitted.cost) else None
