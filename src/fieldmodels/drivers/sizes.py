"""Typical sizes of a machine's signals, taken from its own data, from which fits take steps and starts."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.drivers.declaration import Declaration, Force, slopes_at
from fieldmodels.drivers.rates import centred, pace, rate_size, rms, white_noise
from fieldmodels.drivers.windows import without_noise
from fieldmodels.effects.curves import SIZE, Curve
from fieldmodels.effects.stock import Sizes, Stock
from fieldmodels.model import Signal
from fieldmodels.recording import Recording

STEPS = (8, 16, 32)
"""Samples in the shortest, the main and the longest horizon of a machine that states none, at least."""
SHARES = (0.35, 0.7, 1.4)
"""The same as shares of twice the time in which the outputs change by their size."""
FEWEST, ENOUGH = 8, 40
"""Windows that fit into the longest recording, and into all together where the fastest output allows."""
WALKS_OFF = 2.5
"""Times the pace of a velocity that its position must take to change by its size; 1 of a swing."""


def measured_sizes(machine: Declaration, recordings: Sequence[Recording]) -> list[Sizes]:
    """Sizes for each of a machine's stock effects."""
    return [_sizes(machine, e, recordings) for e in machine.stock]


def measured_outputs(machine: Declaration, recordings: Sequence[Recording]) -> tuple[Signal, ...]:
    """The outputs with the white noise that the data have, where they tell."""
    return tuple(
        replace(s, noise=_median(white_noise(r[s.name]) for r in recordings if s.name in r) or s.noise)
        for s in machine.outputs
    )


def measured_states(
    machine: Declaration, recordings: Sequence[Recording], guessed: FloatArray
) -> tuple[Signal, ...]:
    """The states; one of which nothing is known may be as large as an output of the same unit.

    Its start is unknown, however small the declared noise: an unseen angle is where the seen one is.

    Args:
        machine: The machine.
        recordings: The data.
        guessed: Initial states at some samples, shape (samples, states): all 0 where nothing is known.
    """
    seen = {s.name for s in machine.outputs}
    result = []
    for state, values in zip(machine.states, guessed.T, strict=True):
        alike = [s.name for s in machine.outputs if s.unit == state.unit]
        sizes = [rms(r[name][np.isfinite(r[name])]) for name in alike for r in recordings if name in r]
        hidden = state.name not in seen and not values.any()
        result.append(replace(state, noise=max([state.noise, *sizes])) if hidden else state)
    return tuple(result)


def measured_horizons(machine: Declaration, recordings: Sequence[Recording]) -> tuple[float, ...]:
    """The declared horizons, or of a machine that states none, some by the pace of its outputs.

    As long as the slowest one asks for, if the data then hold enough windows; else as the fastest one does.
    """
    if type(machine).horizons:
        return machine.horizons
    step = recordings[0].step
    paces = [2.0 * _pace(machine, recordings, s.name) for s in machine.outputs]
    most = max(max(len(r) for r in recordings) // FEWEST - 1, 1) * step  # a window holds both of its ends
    many = sum(len(r) for r in recordings) / ENOUGH * step
    found = [
        min(max(min(share * max(paces), max(many, share * min(paces))), n * step), most)
        for share, n in zip(SHARES, STEPS, strict=True)
    ]
    return tuple(min(float(f"{h:.2g}"), float(f"{most:.9g}")) for h in found)


def _pace(machine: Declaration, recordings: Sequence[Recording], name: str) -> float:
    """Time [s] in which an output changes by its size; of a position that walks off, its velocity.

    What turns freely goes far, however fast the machine answers.
    """
    own = pace(recordings, name)
    for f in machine.forces:
        rate = _acceleration(recordings, f.velocity, name) if f.position == name else 0.0
        if rate and _turns_freely(machine, name):
            answers = _size_of(recordings, f.velocity, name) / rate
            own = answers if own > WALKS_OFF * answers else own
    return own


def _turns_freely(machine: Declaration, position: str) -> bool:
    """Whether a machine's rates are the same wherever it is."""
    names = [s.name for s in machine.states]
    here, there = (slopes_at(machine, [at if n == position else 0.3 for n in names]) for at in (0.1, 1.3))
    return position in names and bool(here) and here == there


def _sizes(machine: Declaration, e: Stock, recordings: Sequence[Recording]) -> Sizes:
    """Sizes for one stock effect: of the command, the force's velocity, or the output that it acts on."""
    step = recordings[0].step
    duration = max(len(r) * r.step for r in recordings)
    variables = e.over if isinstance(e, Curve) else ()
    result = Sizes(
        measured=True,
        duration=duration,
        step=step,
        frequencies=_peaks(machine, recordings),
        ranges=tuple(_range(machine, v, recordings) for v in variables),
    )
    if e.signal in {p.name for p in machine.parameters}:
        nominal = next(p for p in machine.parameters if p.name == e.signal)
        return replace(result, force=abs(nominal.nominal) or 10 * nominal.scale)
    if e.signal in {s.name for s in machine.inputs}:
        command = np.concatenate([r[e.signal] for r in recordings])
        high = tuple(float(q) for q in np.quantile(np.abs(command), [0.995, 0.97, 0.9, 0.7]))
        change = max(float(np.max(np.abs(np.diff(r[e.signal])), initial=0.0)) / r.step for r in recordings)
        size = rms(command) or 1.0
        low = high if min(high) > 0 else (2 * size, 1.5 * size, size, 0.5 * size)
        return replace(result, force=size, high_forces=low, rate=change or 100.0 * size)
    if _acts_on_a_force(machine, e):
        f = next(f for f in machine.forces if f.velocity == e.signal)
        return replace(
            result,
            force=_inertia(machine, f, recordings) * _acceleration(recordings, e.signal, f.position) or 1.0,
            velocity=_size_of(recordings, e.signal, f.position) or 1.0,
            position=rms(centred(recordings, f.position)) or 1.0,
        )
    size = rms(centred(recordings, e.signal)) or 1.0
    return replace(result, position=size, force=size, velocity=rate_size(recordings, e.signal) or 1.0)


def _inertia(machine: Declaration, f: Force, recordings: Sequence[Recording]) -> float:
    """What a force is divided by, in the middle of the states that are measured by name, the others at 0."""
    if f.inertia in {"", *(p.name for p in machine.parameters)}:
        return machine.inertia_of(f)
    found = [[float(np.median(r[s.name])) for r in recordings if s.name in r] for s in machine.states]
    return machine.inertia_of(f, [_median(one) for one in found])


def _acts_on_a_force(machine: Declaration, e: Stock) -> bool:
    place = e.where if isinstance(e, Curve) else e.place
    return place == "force" and any(f.velocity == e.signal for f in machine.forces)


def _range(machine: Declaration, variable: str, recordings: Sequence[Recording]) -> tuple[float, float]:
    """From where to where a variable of a curve goes, but for a twentieth at either end."""
    if variable == "time":
        return 0.0, max(len(r) * r.step for r in recordings)
    positions = {f.velocity: f.position for f in machine.forces}
    products = []
    for recording in recordings:
        columns = []
        for name in (word.strip() for word in variable.split("*")):
            plain = name.removeprefix(SIZE)
            position = positions.get(plain, "")
            if plain in recording:
                values = recording[plain]
            elif position in recording:
                values = np.gradient(without_noise(recording, position), recording.step)
            else:
                continue
            columns.append(values if plain == name else np.abs(values))
        products.append(np.prod(columns, axis=0) if columns else np.zeros(0))
    values = np.concatenate(products)
    low, high = (float(q) for q in np.quantile(values, [0.05, 0.95])) if len(values) else (-1.0, 1.0)
    return (low, high) if high > low else (low - 1.0, low + 1.0)


def _size_of(recordings: Sequence[Recording], velocity: str, position: str) -> float:
    """Root mean square of a velocity, measured or as the rate of its position."""
    found = [r[velocity] for r in recordings if velocity in r]
    return rms(np.concatenate(found)) if found else rate_size(recordings, position)


def _acceleration(recordings: Sequence[Recording], velocity: str, position: str) -> float:
    """Root mean square of a velocity's rate."""
    return rate_size(recordings, velocity) or rate_size(recordings, position, 2)


def _peaks(machine: Declaration, recordings: Sequence[Recording], count: int = 4) -> tuple[float, ...]:
    """Frequencies [Hz] at which the first output swings most: where a periodic force is sought first."""
    name = machine.outputs[0].name
    longest = max(recordings, key=len)
    values, step = longest[name] - longest[name].mean(), longest.step
    power = np.abs(np.fft.rfft(np.diff(values)))[1:]
    grid = np.fft.rfftfreq(len(values) - 1, step)[1:]
    order = np.argsort(-power)[: 10 * count]
    found: list[float] = []
    for i in order:
        if all(abs(grid[i] - f) > 1.5 * grid[0] for f in found):
            found.append(float(grid[i]))
        if len(found) == count:
            break
    return tuple(found) or (1.0,)


def _median(values: Iterable[float]) -> float:
    found = list(values)
    return float(np.median(found)) if found else 0.0
