"""How a machine is recorded: what it is commanded, from where it starts, and what a log does to it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import SimpleNamespace as Numbers

import numpy as np
from numpy.typing import NDArray

from fieldmodels.recording import Recording

from .plants import Array, Control, Log, Plant

Rng = np.random.Generator
Rows = NDArray[np.int64]
Commands = Callable[[Rng, int, tuple[int, int], float], Array]
"""(source of chance, rows, for how many a command is held, share of files before) to -1..1, (rows,)."""


def levels(rng: Rng, rows: int, hold: tuple[int, int], _: float) -> Array:
    """Levels by chance, every other one reached along a ramp."""
    result, i, last = np.empty(rows), 0, 0.0
    while i < rows:
        count, level = int(rng.integers(*hold)), rng.uniform(-1.0, 1.0)
        along = np.linspace(last, level, count) if rng.random() < 0.4 else np.full(count, level)
        result[i : i + count] = along[: rows - i]
        i, last = i + count, level
    return result


def plateaus(values: Sequence[float]) -> Commands:
    """A few levels, each as long as the others."""
    return lambda rng, rows, hold, share: (
        np.repeat(values, -(-rows // len(values)))[:rows] * rng.uniform(0.9, 1.0)
    )


ONE_WAY = plateaus((0.35, 0.5, 0.65, 0.8, 0.95, 0.75, 0.55, 0.4))
BOTH_WAYS = plateaus((0.3, -0.3, 0.5, -0.5, 0.7, -0.7, 0.9, -0.9))
STAIRS = plateaus((0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 0.7, 0.3, 0.0, -0.3, -0.6, -0.9, -0.5, -0.2))


def none(rng: Rng, rows: int, hold: tuple[int, int], share: float) -> Array:
    """Nothing is commanded."""
    return np.zeros(rows)


def one_step(rng: Rng, rows: int, hold: tuple[int, int], share: float) -> Array:
    """At rest, then one step, the higher the later the file."""
    return np.where(np.arange(rows) < rows // 5, 0.0, 0.15 + 0.8 * share + rng.uniform(-0.02, 0.02))


def gentle(rng: Rng, rows: int, hold: tuple[int, int], share: float) -> Array:
    """Hardly anything."""
    return 0.15 * levels(rng, rows, hold, share)


def long_steps(rng: Rng, rows: int, hold: tuple[int, int], share: float) -> Array:
    """At rest, then steps, each held for as long as any."""
    heights = rng.uniform(-1.0, 1.0, rows // hold[1] + 1)
    heights[0] = 0.0
    return np.repeat(heights, hold[1])[:rows]


def slow_wave(rng: Rng, rows: int) -> Array:
    """What nobody commands, such as a room's temperature."""
    time = np.arange(rows)
    waves = [np.sin(time / rows * rate + rng.uniform(0.0, 6.0)) for rate in (9.0, 17.0, 26.0)]
    return np.asarray(np.mean(waves, axis=0))


def white(rng: Rng, shape: tuple[int, ...]) -> Array:
    """Noise of a deviation of one."""
    return rng.standard_normal(shape)


def wandering(rng: Rng, shape: tuple[int, ...]) -> Array:
    """Half of its variance keeps 0.9 of itself from row to row."""
    slow = rng.standard_normal(shape)
    for i in range(1, shape[0]):
        slow[i] = 0.9 * slow[i - 1] + np.sqrt(1.0 - 0.81) * slow[i]
    return np.asarray(np.sqrt(0.5) * (slow + rng.standard_normal(shape)))


@dataclass(frozen=True)
class Form:
    """The form of a record.

    Attributes:
        rows: How many; 0 for the usual number.
        stretch: By what its step is longer than usual.
        files: How many files one record is.
        commands: What it is commanded, one a channel.
        start: From where each file starts: (source of chance, machine, its numbers) to states (s,).
        control: What leads it; None for the usual one.
        reach: Of commands, as a share of the usual.
        about: About what they vary; None for the usual.
        noise: Of the sensors, of a deviation of one.
        louder: A factor on it.
        counts: To how many deviations of the noise sensors round; 0 for not.
        every: Which rows are logged: every so many.
        instants: When the sensors are read, by times and step [s].
        spoil: What a log does to what is shown, shape (rows, o).
        cut: Which rows are left of so many.
        by_hand: Whether it is moved by hand, whatever is commanded.
    """

    rows: int = 0
    stretch: int = 1
    files: int = 1
    commands: tuple[Commands, ...] = (levels, levels)
    start: Callable[[Rng, Plant, Numbers], Array] | None = None
    control: Control | None = None
    reach: float = 1.0
    about: tuple[float, ...] | None = None
    noise: Callable[[Rng, tuple[int, ...]], Array] = white
    louder: float = 1.0
    counts: float = 0.0
    every: int = 1
    instants: Callable[[Array, float], Array] | None = None
    spoil: Callable[[Rng, Array], Array] | None = None
    cut: Callable[[Rng, int], Rows] | None = None
    by_hand: bool = False

    def aims(self, plant: Plant, rng: Rng) -> Array:
        """What is commanded, or aimed at, in every file, shape (rows, i, files)."""
        rows, hold = self.rows or plant.samples, plant.hold
        hold = (max(hold[0] // self.stretch, 1), max(hold[1] // self.stretch, 3))
        about = self.about or plant.centre
        result = np.empty((rows, len(plant.inputs), self.files))
        for f in range(self.files):
            for i, name in enumerate(plant.inputs):
                ambient = name == "ambient"
                unit = slow_wave(rng, rows) if ambient else self.commands[i](rng, rows, hold, f / self.files)
                result[:, i, f] = about[i] + plant.reach[i] * (1.0 if ambient else self.reach) * unit
        return result

    def deviations(self, plant: Plant) -> Array:
        """Of what sensors show from what is there, shape (o,)."""
        noise = self.louder * np.array(plant.noise)
        return np.asarray(noise * np.sqrt(1.0 + self.counts**2 / 12.0))

    def recordings(
        self, plant: Plant, log: Log, noise: Array, rng: Rng, name: str, only: Sequence[str] = ()
    ) -> tuple[list[Recording], Array]:
        """What a user has, file by file, and what a perfect model errs by.

        Args:
            plant: The machine.
            log: What happened.
            noise: Of the sensors, shape (rows, o, files).
            rng: Of what the log does.
            name: Of the record.
            only: The outputs that are logged; by default all.
        """
        rows = np.arange(0, len(noise), self.every)
        finer = (len(log.time) - 1) // len(noise)
        step = log.time[finer] - log.time[0]
        nominal = rows * step
        read = nominal if self.instants is None else np.minimum(self.instants(nominal, step), log.time[-1])
        files, errors = list[Recording](), list[Array]()
        for f in range(log.shown.shape[2]):
            true = log.shown[rows * finer, :, f]
            if self.instants is None:
                shown = true + noise[rows, :, f]
            else:
                there = [np.interp(read, log.time, log.shown[:, o, f]) for o in range(true.shape[1])]
                shown = np.column_stack(there) + noise[rows, :, f]
            if self.counts:
                quanta = self.counts * self.louder * np.array(plant.noise)
                shown = quanta * np.round(shown / quanta)
            if self.spoil:
                shown = self.spoil(rng, shown)
            kept = self.cut(rng, len(rows)) if self.cut else np.arange(len(rows))
            signals = {s: log.commands[rows, i, f] for i, s in enumerate(plant.inputs)}
            signals |= {s: shown[:, o] for o, s in enumerate(plant.outputs) if not only or s in only}
            files.append(
                Recording(
                    time=nominal[kept],
                    signals={s: values[kept] for s, values in signals.items()},
                    episode=np.cumsum(np.diff(kept, prepend=kept[0]) > 1),
                    source=f"{name} {f + 1}" if self.files > 1 else name,
                )
            )
            errors.append((shown - true)[kept])
        return files, np.sqrt(np.mean(np.concatenate(errors) ** 2, axis=0))


def by_hand(plant: Plant, log: Log, rng: Rng) -> None:
    """Replace what happened by a smooth motion of somebody's hand."""
    time = log.time - log.time[0]
    for o, state in enumerate(plant.shown):
        if state in plant.ways and plant.ways[state] in plant.shown:  # a velocity that belongs to a position
            log.shown[:, o] = np.gradient(log.shown[:, plant.shown.index(plant.ways[state])], time, axis=0)
            continue
        for f in range(log.shown.shape[2]):
            turns = rng.uniform(0.5, 4.0, 6)  # in 480 rows
            phases = [
                2.0 * np.pi * turn * time / (480.0 * plant.step) + rng.uniform(0.0, 6.3) for turn in turns
            ]
            waves = [np.sin(phase) / turn for phase, turn in zip(phases, turns, strict=True)]
            log.shown[:, o, f] = plant.size[state] * sum(waves) / 1.5


def spikes(rng: Rng, shown: Array) -> Array:
    """One row in a hundred shows anything."""
    hit = rng.random(shown.shape) < 0.01
    return np.where(hit, shown + shown.std(axis=0) * 3.0 * rng.standard_normal(shown.shape), shown)


def stuck_bit(rng: Rng, shown: Array) -> Array:
    """The first sensor's converter never clears one of its bits."""
    quantum = 0.2 * shown[:, 0].std()
    counts = np.floor((shown[:, 0] - shown[:, 0].min()) / quantum * 16.0).astype(int)
    return np.column_stack([(counts | 16) / 16.0 * quantum + shown[:, 0].min(), shown[:, 1:]])


def gaps(rng: Rng, rows: int) -> Rows:
    """Rows that are left where the logger has stopped four times."""
    kept = np.ones(rows, dtype=bool)
    for begin in rng.integers(rows // 10, rows * 9 // 10, 4):
        kept[begin : begin + int(rng.integers(5, rows // 15))] = False
    return np.flatnonzero(kept)


def timer(times: Array, step: float) -> Array:
    """A timer that ticks three times in four rows: sensors are read at the tick after."""
    tick = 0.75 * step
    return np.asarray(tick * np.ceil(times / tick - 1e-9))
