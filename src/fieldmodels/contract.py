"""Whether a user's own simulator keeps the contract of ``Model``: asked before anything is fitted to it."""

from __future__ import annotations

import inspect
import math
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TypeVar, get_args

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.guard import ContractError, checked_outputs, checked_states, located
from fieldmodels.model import Effect, Model, Parameter, Signal, Where
from fieldmodels.recording import Recording, Windows

T = TypeVar("T")

SHOWN = 8
"""Windows on which a model is tried."""
NEAR_NEUTRAL = 1e-6
"""Share of the way from an effect's neutral values to its start at which it must still be nearly off."""
JUMP = 0.05
"""Share of an effect's change at its start that it may have so near to neutral."""
INTEGRATION = 1e-5
"""Share of the outputs' size below which a jump is one of integration: steps that end elsewhere."""
STEPS_APART = 10.0
"""Largest difference by steps of other lengths, in typical errors of the longest ones."""
SLOW = 0.5
"""Seconds a simulation of all windows from which on a diagnosis takes long."""


class ModelWarning(UserWarning):
    """A model that can be used, but that looks as if something about it were mistaken."""


def check_declarations(model: Model, place: str = "") -> None:
    """Check what a model declares: names, signals, parameters, effects, horizons.

    Raises:
        ContractError: With everything that is wrong.
    """
    problems = list(_undeclared(model)) or [
        *_doubles("signal", [s.name for s in (*model.inputs, *model.outputs)]),
        *_doubles("state", [s.name for s in model.states]),
        *_doubles("effect", [e.name for e in model.effects]),
        *_doubles("parameter", model.names),
        *_horizons(model.horizons),
        *(p for effect in model.effects for p in _effect(effect)),
    ]
    if not problems and not model.outputs:
        problems = ["outputs: none; a diagnosis compares at least one measured signal"]
    _raise(problems, place or f"model {type(model).__name__}")


def check_simulation(model: Model, recording: Recording, place: str = "") -> None:
    """Simulate once and check what comes back.

    Shapes; finite values; that no vector, window or call depends on another, on measured outputs or on what
    a call has left behind; that commands act; that effects are off at their neutral values and act beyond.

    Args:
        model: A model whose declarations hold.
        recording: Measured data, as they will be diagnosed.
        place: What messages start with, by default the model's class.

    Raises:
        ContractError: With what is wrong; for an error inside of the model, its line.
        RecordingError: If the recording is too short for the model.

    Warns:
        ModelWarning: If an effect does not act on these data, no sensor tells where a state starts, or the
            simulation is slow.
    """
    place = place or f"model {type(model).__name__}"
    cut = _called(model, place, "windows", lambda: model.windows(recording, min(model.horizons)))
    _called(model, place, "initial_states", lambda: checked_states(model, cut.states, recording, cut.starts))
    _warn_of_unseen(model, place, recording)
    began = time.perf_counter()
    _outputs(model, place, model.nominal[None], cut)
    seconds = time.perf_counter() - began
    if seconds > SLOW:  # again, for the first call may have compiled
        began = time.perf_counter()
        _outputs(model, place, model.nominal[None], cut)
        seconds = time.perf_counter() - began
    few = cut.select(np.unique(np.linspace(0, len(cut) - 1, SHOWN).astype(np.int64)))
    _raise(list(_dependences(model, place, few)), place)
    _raise(list(_neutral_values(model, place, few)), place)
    if seconds > SLOW:
        warnings.warn(
            f"{place}: one simulation of all windows takes {seconds:.1f} s, and a diagnosis needs "
            "thousands; vectorise simulate, or compile it with Numba",
            ModelWarning,
            stacklevel=2,
        )


def _warn_of_unseen(model: Model, place: str, recording: Recording) -> None:
    names = model.unseen(recording)
    if names:
        several = len(names) > 1
        warnings.warn(
            f"{place}: no sensor tells where the state{'s' * several} {' and '.join(map(repr, names))} "
            f"start{'s' * (not several)}: every window begins with 0 and fits the rest, which may lead "
            "astray. Declare an output that shows "
            f"{'them' if several else 'it'} (`observe` may compute what it shows), say by the `noise` of its "
            "Signal how far from 0 it may start, or give `initial_states(self, recording, starts)`",
            ModelWarning,
            stacklevel=3,
        )


@contextmanager
def kept(model: Model, recording: Recording, place: str) -> Iterator[None]:
    """Check a simulation before it is used and after: it may fail late.

    Args:
        model: The model.
        recording: What it is used on.
        place: What messages start with.

    Raises:
        ContractError: As `check_simulation`.
    """
    check_simulation(model, recording, place)
    try:
        yield
    except np.linalg.LinAlgError:  # of numbers that are not finite
        check_simulation(model, recording, place)
        raise
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelWarning)  # said before
        check_simulation(model, recording, place)


def at_rest(model: Model, step: float, amplitude: float, rng: np.random.Generator) -> Recording:
    """A recording to try a model on before there are data: random commands, outputs that stay at zero."""
    count = max(round(12 * max(model.horizons) / step), 50)
    commands = {s.name: amplitude * rng.uniform(-1.0, 1.0, count) for s in model.inputs}
    time = np.arange(count, dtype=np.float64) * step
    return Recording(time, commands | {s.name: np.zeros(count) for s in model.outputs})


def _raise(problems: list[str], place: str) -> None:
    if len(problems) == 1:
        raise ContractError(f"{place}: {problems[0]}")
    if problems:
        raise ContractError("\n  - ".join([f"{place}: {len(problems)} mistakes", *problems]))


def _undeclared(model: Model) -> Iterable[str]:
    """Attributes that are missing or hold something else."""
    kinds = {
        "inputs": Signal,
        "outputs": Signal,
        "states": Signal,
        "parameters": Parameter,
        "effects": Effect,
    }
    if not isinstance(getattr(model, "name", None), str) or not model.name.isidentifier():
        yield 'name: missing; give the model a name of letters, digits and "_"'
    for key, kind in kinds.items():
        values = getattr(model, key, None)
        if values is None:
            yield f"{key}: missing; declare a tuple of {kind.__name__}, which may be empty: {key} = ()"
        elif not isinstance(values, tuple) or not all(isinstance(v, kind) for v in values):
            comma = f"; one alone needs a comma: ({kind.__name__}(...),)" if isinstance(values, kind) else ""
            yield f"{key}: must be a tuple of {kind.__name__}, not {type(values).__name__}{comma}"
    horizons = getattr(model, "horizons", None)
    if horizons is None:
        yield "horizons: missing; say over how many seconds to predict, as in horizons = (0.2, 0.5)"


def _doubles(what: str, names: Iterable[str]) -> list[str]:
    counts = Counter(names)
    return [f"{what} {name!r} is declared {n} times" for name, n in counts.items() if n > 1]


def _horizons(horizons: object) -> Iterable[str]:
    if not isinstance(horizons, tuple) or not all(
        isinstance(h, int | float) and math.isfinite(h) and h > 0 for h in horizons
    ):
        yield f"horizons: must be a tuple of seconds, not {horizons!r}; one alone needs a comma: (0.2,)"
    elif not horizons or list(horizons) != sorted(set(horizons)):
        yield f"horizons: must increase, shortest first, not {horizons!r}"


def _effect(effect: Effect) -> Iterable[str]:
    if effect.where not in get_args(Where):
        yield (
            f"effect {effect.name!r}: where must be {' or '.join(get_args(Where))}, not {effect.where!r}; "
            "the order is Effect(name, cause, where, parameters)"
        )
    if not effect.parameters or not all(isinstance(p, Parameter) for p in effect.parameters):
        yield f"effect {effect.name!r}: parameters must be a tuple of Parameter with at least one"
        return
    for p in effect.parameters:
        outside = [value for value in p.starts if not p.lower <= value <= p.upper]
        if outside:
            yield f"effect {effect.name!r}: start {outside[0]:g} of {p.name!r} is outside its bounds"
        if p.lower == p.upper:
            yield f"effect {effect.name!r}: {p.name!r} cannot move: both bounds are {p.lower:g}"


def _called(model: Model, place: str, what: str, call: Callable[[], T]) -> T:
    """What a call into the model returns; an error inside of it becomes one message with its line."""
    try:
        file = Path(inspect.getfile(type(model)))
    except (TypeError, OSError):  # a class that was typed in
        file = Path(place)
    with located(file, what):
        return call()


def _outputs(model: Model, place: str, parameters: FloatArray, windows: Windows) -> FloatArray:
    """Simulate; check shape and that parameters, states and recording are left as they were."""
    held = parameters.copy(), windows.states.copy()
    signals = {name: values.copy() for name, values in windows.recording.signals.items()}
    result = _called(
        model,
        place,
        "simulate",
        lambda: checked_outputs(model, model.simulate(parameters, windows), parameters, windows),
    )
    changed = [
        *(["the parameters"] if not np.array_equal(held[0], parameters) else []),
        *(["windows.states"] if not np.array_equal(held[1], windows.states) else []),
        *(
            f"the recording's {name!r}"
            for name, values in signals.items()
            if not np.array_equal(values, windows.recording[name])
        ),
    ]
    if changed:
        raise ContractError(f"{place}: simulate changes {' and '.join(changed)}; work on a copy")
    return result


def _dependences(model: Model, place: str, windows: Windows) -> Iterable[str]:
    """What a simulation may not depend on, and what it must."""
    recording = windows.recording
    other = model.nominal.copy()
    for i, p in enumerate(model.parameters):
        other[i] = p.nominal + p.scale if p.nominal + p.scale <= p.upper else p.nominal - p.scale
    vectors = np.array([model.nominal, np.clip(other, *_bounds(model))])
    both = _outputs(model, place, vectors, windows)
    seen = windows.observed
    if not np.isfinite(both[0][seen]).any():
        yield (
            "simulate: no value is finite at the nominal parameters; choose nominal values at which it is "
            "stable, or smaller steps of integration"
        )
        return
    if not _same(both, _outputs(model, place, vectors, windows), seen):
        yield (
            "simulate: two equal calls give different outputs; leave out noise, and keep nothing between "
            "calls"
        )
        return
    for row, vector in enumerate(vectors):
        if not _same(both[row : row + 1], _outputs(model, place, vector[None], windows), seen):
            yield (
                "simulate: a vector gives other outputs in a batch than alone; each row of parameters is a "
                "simulation of its own"
            )
            return
    last = windows.select(np.array([len(windows) - 1]))
    alone = _outputs(model, place, vectors, last)
    if not (
        _same(both[:, -1:], alone, last.observed)
        if model.windows_apart
        else _same_but_for_steps(model, both, alone, seen)
    ):
        remedy = (
            "each starts from its own state"
            if model.windows_apart
            else "give the model `pace(self, p)`, its fastest mode [rad/s], by which steps are chosen"
        )
        yield f"simulate: a window gives other outputs among others than alone; {remedy}"
    rng = np.random.default_rng(0)
    shuffled = {s.name: rng.permutation(recording[s.name]) for s in model.outputs if s.name in recording}
    blind = replace(windows, recording=replace(recording, signals={**recording.signals, **shuffled}))
    if not _same(both, _outputs(model, place, vectors, blind), seen):
        yield (
            "simulate: outputs depend on the measured outputs, so it would predict what it has been told; "
            "use windows.states alone"
        )
    idle: list[str] = []
    for signal in model.inputs:
        values = recording[signal.name]
        size = float(np.abs(values).max()) or 1.0
        moved = {signal.name: values + 0.5 * size * rng.standard_normal(len(values))}
        driven = replace(windows, recording=replace(recording, signals={**recording.signals, **moved}))
        if _same(both[:1], _outputs(model, place, vectors[:1], driven), seen):
            idle.append(signal.name)
    if idle and len(idle) < len(model.inputs):
        warnings.warn(
            f"{place}: {' and '.join(map(repr, idle))} change{'s' * (len(idle) == 1)} no output at the "
            "nominal parameters: what is missing may depend on it; does simulate use it, if it should?",
            ModelWarning,
            stacklevel=3,
        )
        return
    for name in idle:
        yield (
            f"simulate: input {name!r} does not change any output at the nominal parameters; is "
            "an effect's neutral value wrong (1 for a gain, a large number for a limit)?"
        )


def _neutral_values(model: Model, place: str, windows: Windows) -> Iterable[str]:
    """Effects that are not off at their neutral values; a warning for those that do nothing."""
    plain = _outputs(model, place, model.nominal[None], windows)
    idle: list[str] = []
    stock = set(model.stock_names)
    size = _distance(plain, np.zeros_like(plain), windows)
    by_steps = 0.0 if model.windows_apart else STEPS_APART * float(np.max(model.resolution))
    for effect in model.effects:
        part = model.slice_of(effect.name)
        starts = np.tile(model.nominal, (max(len(p.starts) for p in effect.parameters) or 1, 1))
        for k, p in enumerate(effect.parameters, start=part.start):
            step = p.nominal + p.scale if p.nominal + p.scale <= p.upper else p.nominal - p.scale
            values = p.starts or (step,)
            starts[:, k] = [values[min(row, len(values) - 1)] for row in range(len(starts))]
        starts = np.clip(starts, *_bounds(model))
        near = model.nominal + NEAR_NEUTRAL * (starts - model.nominal)
        smooth = all(p.smooth for p in effect.parameters)
        there, close = (_outputs(model, place, vectors, windows) for vectors in (starts, near))
        full, tiny = _distance(there, plain, windows), _distance(close, plain, windows)
        if not full > 0.0:
            idle.extend({effect.name} - stock)  # what the user wrote; of stock effects the diagnosis says so
        elif smooth and tiny > max(JUMP * full, max(INTEGRATION, by_steps) * size):
            neutral = ", ".join(f"{p.name} = {p.nominal:g}" for p in effect.parameters)
            yield (
                f"effect {effect.name!r} jumps at its neutral values ({neutral}): a millionth of the way to "
                f"its start it already changes the outputs {100 * tiny / full:.0f} % as much; it must be off "
                "at neutral and grow from there (or declare smooth=False)"
            )
    if idle:
        warnings.warn(
            f"{place}: {' and '.join(idle)} change{'s' if len(idle) == 1 else ''} nothing on these data at "
            "the values tried first; does simulate use it, and are its scale and starts of the right size?",
            ModelWarning,
            stacklevel=3,
        )


def _bounds(model: Model) -> tuple[FloatArray, FloatArray]:
    return np.array([p.lower for p in model.all_parameters]), np.array(
        [p.upper for p in model.all_parameters]
    )


def _same(a: FloatArray, b: FloatArray, seen: np.ndarray) -> bool:
    """Whether two batches agree where they are observed, NaN for NaN."""
    return bool(np.allclose(a[:, seen], b[:, seen], rtol=1e-9, atol=1e-12, equal_nan=True))


def _same_but_for_steps(model: Model, among: FloatArray, alone: FloatArray, seen: np.ndarray) -> bool:
    """Whether the last window alone agrees with itself among others within the error of longest steps."""
    known = seen & np.isfinite(among)
    highest = np.max(among, axis=(1, 2), where=known, initial=-np.inf)
    lowest = np.min(among, axis=(1, 2), where=known, initial=np.inf)
    allowed = STEPS_APART * np.asarray(model.resolution) * (highest - lowest)
    difference = np.abs(among[:, -1] - alone[:, 0])
    same = (difference <= allowed[:, None]) | ~seen[-1] | (np.isnan(among[:, -1]) & np.isnan(alone[:, 0]))
    return bool(same.all())


def _distance(batch: FloatArray, plain: FloatArray, windows: Windows) -> float:
    """Largest root mean square over a batch of what differs from the plain simulation."""
    change = np.where(windows.observed & np.isfinite(plain), batch - plain, 0.0)
    return float(np.sqrt(np.nanmax(np.nanmean(change**2, axis=(1, 2, 3)))))
