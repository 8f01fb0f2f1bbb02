"""Typical sizes of a machine's signals, taken from its own data, from which fits take steps and starts."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.drivers.declaration import Declaration
from fieldmodels.drivers.windows import without_noise
from fieldmodels.effects.curves import Curve
from fieldmodels.effects.stock import Sizes, Stock
from fieldmodels.model import Signal
from fieldmodels.recording import Recording

STEPS = (8, 16, 32)
"""Samples in the shortest, the main and the longest horizon of a machine that states none, at least."""
SHARES = (0.25, 0.5, 1.0)
"""The same as shares of the time in which the outputs change by their size."""


def measured_sizes(machine: Declaration, recordings: Sequence[Recording]) -> list[Sizes]:
    """Sizes for each of a machine's stock effects."""
    return [_sizes(machine, e, recordings) for e in machine.stock]


def measured_outputs(machine: Declaration, recordings: Sequence[Recording]) -> tuple[Signal, ...]:
    """The outputs with the white noise that the data have, where they tell."""
    return tuple(
        replace(s, noise=_median(white_noise(r[s.name]) for r in recordings if s.name in r) or s.noise)
        for s in machine.outputs
    )


def measured_horizons(machine: Declaration, recordings: Sequence[Recording]) -> tuple[float, ...]:
    """The declared horizons, or of a machine that states none, some by the pace of its outputs."""
    if type(machine).horizons:
        return machine.horizons
    step = recordings[0].step
    paces = [_rms(_centred(recordings, s.name)) / (_rms(_slopes(recordings, s.name)) or 1.0)
             for s in machine.outputs if any(s.name in r for r in recordings)]  # fmt: skip
    pace = max([p for p in paces if p > 0.0 and math.isfinite(p)], default=0.0)
    longest = max(len(r) for r in recordings) * step
    found = [
        min(max(share * 2 * pace, n * step), longest / 8) for share, n in zip(SHARES, STEPS, strict=True)
    ]
    return tuple(float(f"{h:.2g}") for h in found)


def _sizes(machine: Declaration, e: Stock, recordings: Sequence[Recording]) -> Sizes:
    """Sizes for one stock effect: of the command, the force's velocity, or the output that it acts on."""
    step = recordings[0].step
    duration = max(len(r) * r.step for r in recordings)
    variables = e.over if isinstance(e, Curve) else ()
    result = Sizes(
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
        size = _rms(command) or 1.0
        low = high if min(high) > 0 else (2 * size, 1.5 * size, size, 0.5 * size)
        return replace(result, force=size, high_forces=low, rate=change or 100.0 * size)
    if _acts_on_a_force(machine, e):
        f = next(f for f in machine.forces if f.velocity == e.signal)
        return replace(
            result,
            force=machine.inertia_of(f) * _acceleration(recordings, e.signal, f.position) or 1.0,
            velocity=_size_of(recordings, e.signal, f.position) or 1.0,
            position=_rms(_centred(recordings, f.position)) or 1.0,
        )
    size = _rms(_centred(recordings, e.signal)) or 1.0
    return replace(result, position=size, force=size, velocity=_rms(_slopes(recordings, e.signal)) or 1.0)


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
            position = positions.get(name, "")
            if name in recording:
                columns.append(recording[name])
            elif position in recording:
                columns.append(np.gradient(without_noise(recording, position), recording.step))
        products.append(np.prod(columns, axis=0) if columns else np.zeros(0))
    values = np.concatenate(products)
    low, high = (float(q) for q in np.quantile(values, [0.05, 0.95])) if len(values) else (-1.0, 1.0)
    return (low, high) if high > low else (low - 1.0, low + 1.0)


def _size_of(recordings: Sequence[Recording], velocity: str, position: str) -> float:
    measured = _values(recordings, velocity)
    return _rms(measured) if len(measured) else _rms(_slopes(recordings, position))


def _acceleration(recordings: Sequence[Recording], velocity: str, position: str) -> float:
    """Root mean square of a velocity's rate."""
    slopes = _slopes(recordings, velocity)
    if len(slopes):
        return _rms(slopes)
    rates = [np.gradient(_slope(r, position), r.step) for r in recordings if position in r]
    return _rms(np.concatenate(rates)) if rates else 0.0


def _values(recordings: Sequence[Recording], name: str) -> FloatArray:
    found = [r[name] for r in recordings if name in r]
    return np.concatenate(found) if found else np.zeros(0)


def _centred(recordings: Sequence[Recording], name: str) -> FloatArray:
    found = [r[name] - r[name].mean() for r in recordings if name in r]
    return np.concatenate(found) if found else np.zeros(0)


def _slopes(recordings: Sequence[Recording], name: str) -> FloatArray:
    found = [_slope(r, name) for r in recordings if name in r]
    return np.concatenate(found) if found else np.zeros(0)


def _slope(recording: Recording, name: str) -> FloatArray:
    """Slopes of a signal over about a fiftieth of the recording, at most 20 samples."""
    span = max(1, min(20, len(recording) // 50))
    inside = recording.episode[span:] == recording.episode[:-span]
    slopes = (recording[name][span:] - recording[name][:-span]) / (span * recording.step)
    return np.asarray(slopes[inside])


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


def white_noise(values: FloatArray) -> float:
    """Standard deviation of white noise on a smooth signal, from its fourth differences.

    A fourth difference of white noise has the variance 70 sigma^2; of a smooth signal it is small. Signals
    that only change by jumps of a coarse sensor give their root mean square instead of the median, which
    would be zero.
    """
    differences = np.diff(values, 4)
    if len(differences) == 0:
        return 0.0
    robust = 1.4826 * float(np.median(np.abs(differences)))
    return (robust or float(np.sqrt(np.mean(differences**2)))) / math.sqrt(70.0)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def _median(values: Iterable[float]) -> float:
    found = list(values)
    return float(np.median(found)) if found else 0.0
