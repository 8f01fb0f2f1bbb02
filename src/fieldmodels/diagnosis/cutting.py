"""What a diagnosis is fitted to and measured on: recordings checked, and cut into windows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis import problem as problems
from fieldmodels.diagnosis.problem import Problem
from fieldmodels.model import Model
from fieldmodels.recording import Recording, RecordingError
from fieldmodels.rounding import words

FEW = 16  # windows; with fewer at the main horizon the shorter one is used
EXCERPT = 120_000  # rows of all recordings in which a first look is taken
HELD_OUT = 4  # without test data every fourth block is kept for the gain


TINY = problems.HUGE**-0.25
"""A smaller change is none, in any unit."""


def check_range(model: Model, recordings: Sequence[Recording]) -> None:
    """Reject values that no sensor can measure, such as those of a diverged simulation, and dead sensors.

    Raises:
        RecordingError: With the recording and the signal.
    """
    for recording in recordings:
        for signal in (*model.inputs, *model.outputs):
            if signal.name in recording:
                values = recording[signal.name]
                wrong = np.flatnonzero(~np.isnan(values) & ~(np.abs(values) < problems.HUGE**0.25))
                if len(wrong):
                    place = f"{recording.source}: signal {signal.name!r}, sample {wrong[0]}"
                    raise RecordingError(
                        f"{place}: {values[wrong[0]]:g} cannot have been measured; cut such values out"
                    )
    _check_motion(model, recordings)
    for recording in recordings:
        for signal in (*model.inputs, *model.outputs):
            if signal.name in recording:
                largest = float(np.nanmax(np.abs(recording[signal.name]), initial=0.0))
                if 0.0 < largest < TINY:
                    raise RecordingError(
                        f"{recording.source}: signal {signal.name!r} is {largest:g} at most, which cannot "
                        "have been measured; what is its unit?"
                    )


def _check_motion(model: Model, recordings: Sequence[Recording]) -> None:
    """Refuse outputs of which none ever changes: they say nothing about any simulation."""
    shown = [s.name for s in model.outputs if any(s.name in r for r in recordings)]
    if any(s.event for s in model.outputs if s.name in shown):
        return
    values = [r[name] for name in shown for r in recordings if name in r]
    spans = [np.nanmax(v, initial=-np.inf) - np.nanmin(v, initial=np.inf) for v in values]
    if shown and not any(span > TINY for span in spans):
        raise RecordingError(
            f"{recordings[0].source}: {' and '.join(shown)} never change{'s' if len(shown) == 1 else ''}, "
            "whatever is commanded; is the sensor connected, and does the machine move?"
        )


def in_all(
    model: Model, train: Sequence[Recording], test: Sequence[Recording]
) -> tuple[Sequence[Recording], Sequence[Recording], tuple[str, ...]]:
    """Recordings without outputs that some of them lack, which cannot be compared, and a note for each."""
    every = [*train, *test]
    names = [o.name for o in model.outputs if o.optional]
    partial = [n for n in names if any(n in r for r in every) and not all(n in r for r in every)]
    if not partial:
        return train, test, ()

    def without(recordings: Sequence[Recording]) -> list[Recording]:
        return [
            replace(r, signals={name: values for name, values in r.signals.items() if name not in partial})
            for r in recordings
        ]

    notes = tuple(f"{name} is not compared: not every recording has it" for name in partial)
    return without(train), without(test), notes


def long_enough(
    model: Model, train: Sequence[Recording], test: Sequence[Recording]
) -> tuple[Sequence[Recording], Sequence[Recording], tuple[str, ...]]:
    """Recordings without those, among others, that are too short for a window, and a note for each."""
    if len(train) < 2 and len(test) < 2:
        return train, test, ()
    scaled = model.scaled_to([*train, *test])
    horizon = main_horizon(scaled, train)

    def longer(recordings: Sequence[Recording]) -> Sequence[Recording]:
        return [r for r in recordings if _windows(scaled, r, horizon)] or recordings

    kept = longer(train), longer(test)
    short = [r for r in (*train, *test) if not any(r is one for one in (*kept[0], *kept[1]))]
    return *kept, tuple(f"{r.source} is left out: shorter than a window of {horizon:g} s" for r in short)


def _windows(model: Model, recording: Recording, horizon: float) -> int:
    """How many windows a recording holds."""
    try:
        return len(model.windows(recording, horizon))
    except RecordingError:
        return 0


def commanded(model: Model, recordings: Sequence[Recording]) -> bool:
    """Whether any input is anything but zero."""
    names = [s.name for s in (*model.inputs, *model.measured_inputs)]
    return any(np.any(r[name] != 0.0) for r in recordings for name in names if name in r)


def without_command(
    model: Model, recordings: Sequence[Recording], given: Mapping[str, float]
) -> tuple[str, ...]:
    """What is said where no input is anything but zero.

    Args:
        model: The model.
        recordings: The measured data.
        given: Values that the user has fixed.
    """
    if not model.inputs or commanded(model, recordings):
        return ()
    said = f"nothing is commanded: {' and '.join(s.name for s in model.inputs)} = 0 throughout"
    for p in model.parameters:
        if p.name == model.scale_parameter and p.name not in given:
            said += (
                f"; all else is in proportion to the {words(p.name)}, taken as {p.nominal:g} {p.unit}: state "
                f"yours by --set {p.name}=VALUE"
            )
    return (said,)


def known_values(model: Model, recordings: Sequence[Recording]) -> dict[str, float]:
    """Base parameters that are not refitted, and values that the recordings state of their machine.

    Without a command the one is not refitted, either, to which all others are then in proportion.

    Raises:
        RecordingError: If two recordings are of different machines.
    """
    known = {p.name: p.nominal for p in model.parameters if not p.refitted}
    if recordings and model.inputs and not commanded(model, recordings):
        known |= {p.name: p.nominal for p in model.parameters if p.name == model.scale_parameter}
    names = {p.name for p in model.parameters}
    stated: dict[str, float] = {}
    for recording in recordings:
        for name in names & set(recording.known):
            if stated.setdefault(name, recording.known[name]) != recording.known[name]:
                raise RecordingError(
                    f"{recording.source}: {name} {recording.known[name]:g}, but another recording has "
                    f"{stated[name]:g}; diagnose one machine at a time"
                )
    return {**known, **stated}


def start_vector(model: Model, fixed: Mapping[str, float]) -> FloatArray:
    """The nominal vector with the fixed values, checked."""
    base = {name: value for name, value in fixed.items() if "." not in name}
    effects: dict[str, dict[str, float]] = {}
    for name, value in fixed.items():
        if "." in name:
            effect, _, parameter = name.partition(".")
            effects.setdefault(effect, {})[parameter] = value
    return model.vector(base, effects)


def split(
    model: Model, train: Sequence[Recording], test: Sequence[Recording], bins: int = 0
) -> tuple[Problem, Problem]:
    """Windows for fits and selection, and windows to measure the gain on; ``bins`` as of ``build``."""
    horizon = main_horizon(model, train)
    if test:
        coarsest = max(r.step for r in test)
        training = problems.build(model, train, horizon, None, coarsest, bins)
        return training, problems.build(model, test, horizon, training)
    whole = problems.build(model, train, horizon, None, 0.0, bins)
    kept = whole.blocks % HELD_OUT != HELD_OUT - 1
    return whole.select(kept), whole.select(~kept)


def excerpts(model: Model, recordings: Sequence[Recording]) -> list[Recording]:
    """Parts of long recordings for a first look, if the model's windows fit into them; else all they are."""
    few = [one.excerpt(EXCERPT // len(recordings)) for one in recordings]
    if sum(map(len, few)) == sum(map(len, recordings)):
        return few
    scaled = model.scaled_to(few)
    found = sum(_windows(scaled, one, main_horizon(scaled, few)) for one in few)
    return few if found >= FEW * len(few) else list(recordings)


def main_horizon(model: Model, recordings: Sequence[Recording]) -> float:
    """The model's main horizon, or the shorter one if the recordings hold few windows of it."""
    short, main = model.horizons[0], model.horizons[min(1, len(model.horizons) - 1)]
    return main if sum(_windows(model, r, main) for r in recordings) >= FEW else short
