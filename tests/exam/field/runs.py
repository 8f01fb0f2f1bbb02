"""Runs of a case: its three records, and how much of its fault no refit of the nominal machine absorbs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace as Numbers
from zlib import crc32

import numpy as np

from .plants import NOTHING, PLANTS, Array, Fault, Log, Plant, numbers_of, simulate
from .records import Form, Rows, by_hand

NUDGE = 1e-4
"""Of numbers and states, in their size, for slopes."""
STEPS = 4
"""Of a refit."""
LARGE, MOST = math.sqrt(2.2**2 - 1.0), 0.6
"""Least that a large fault leaves, in noise; share of the most that one can leave."""
SIZES = 4.0 ** np.arange(-5, 5)
"""At which a fault is tried."""
PLAIN = Form()
"""The usual form of a record."""


@dataclass(frozen=True)
class Way:
    """How the cases of a kind are made on one machine.

    Attributes:
        machine: Its name.
        fault: What is wrong with it, at a size of one.
        form: Of its records.
        fixed: Numbers that a user would know.
        only: Outputs that are logged; by default all.
        by_noise: Whether the fault has a size of one, and the noise is such that it adds what it shall.
        ratio: How many times the noise the error shall be; 0 for the usual and the large size.
        third: Whether its numbers are a third of those that are declared.
    """

    machine: str
    fault: Fault = NOTHING
    form: Form = PLAIN
    fixed: tuple[str, ...] = ()
    only: tuple[str, ...] = ()
    by_noise: bool = False
    ratio: float = 0.0
    third: bool = False

    @property
    def plant(self) -> Plant:
        """The machine."""
        return PLANTS[self.machine]


@dataclass(frozen=True)
class Run:
    """One way with a seed.

    Attributes:
        way: The way.
        kind: Its name.
        seed: The seed.
    """

    way: Way
    kind: str
    seed: int

    def rng(self, *what: int) -> np.random.Generator:
        """A source of chance for something."""
        return np.random.default_rng([crc32(f"{self.kind}/{self.way.machine}".encode()), self.seed, *what])

    @property
    def numbers(self) -> Numbers:
        """Of the machine."""
        return numbers_of(self.way.plant, self.rng(9), 1.0 / 3.0 if self.way.third else 1.0)

    @cached_property
    def deviations(self) -> Array:
        """Of what sensors show from what is there, shape (o,): their noise, and when they are read."""
        form = self.way.form
        if form.instants is None:
            return form.deviations(self.way.plant)
        log, noise = self.log(2, [1.0], NOTHING)
        return form.recordings(self.way.plant, log, noise, self.rng(2, 1), "")[1]

    def log(self, record: int, size: Sequence[float], fault: Fault | None = None) -> tuple[Log, Array]:
        """A record at some sizes of the fault, and the noise of its sensors.

        Args:
            record: 0, 1 or 2: to fit, to test, and the third.
            size: Sizes, one after the other.
            fault: Another fault than the way's.

        Returns:
            The log, whose lanes are the files at the first size, then those at the next; noise of the shape
            (rows, o, files).
        """
        plant, form, p = self.way.plant, self.way.form, self.numbers
        rng = self.rng(record)
        aims = form.aims(plant, rng)
        noise = form.noise(rng, (len(aims), len(plant.outputs), form.files))
        noise = noise * (form.louder * np.array(plant.noise))[:, None]
        starts = [
            form.start(rng, plant, p) if form.start else np.array(plant.start) for _ in range(form.files)
        ]
        many = len(size)
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            log = simulate(
                plant, p, np.tile(aims, (1, 1, many)), self.way.fault if fault is None else fault,
                np.repeat(np.array(size, dtype=float), form.files), np.tile(np.array(starts).T, (1, many)),
                np.tile(noise, (1, 1, many)), step=plant.step * form.stretch,
                finer=min(plant.finer * form.stretch, 60), control=form.control or plant.control,
            )  # fmt: skip
            if form.by_hand:
                by_hand(plant, log, rng)
        return log, noise

    def left(self, log: Log) -> Array:
        """What the refitted nominal machine leaves of a log without noise, by output, in usual noise.

        Numbers are refitted to all windows, and where each begins; by Gauss and Newton's steps.
        """
        return self._errors(log, True)

    def shown(self, log: Log) -> float:
        """Half the squared error of the true machine without the fault on windows that begin in truth."""
        rows, _ = self._windows(log)
        return 0.5 * float(np.sum(self._errors(log, False) ** 2) * rows.size * log.shown.shape[2])

    def _windows(self, log: Log) -> tuple[Rows, int]:
        """Rows of every window, shape (windows, samples), and the fine steps in a row."""
        length = len(log.commands)
        samples = min(max(self.way.plant.window // self.way.form.stretch, 10), length // 2)
        return np.arange(length // samples * samples).reshape(-1, samples), (len(log.time) - 1) // length

    def _errors(self, log: Log, refit: bool) -> Array:
        plant = self.way.plant
        rows, finer = self._windows(log)
        lanes = log.shown.shape[2]
        commands = log.commands[rows].transpose(1, 2, 0, 3).reshape(rows.shape[1], len(plant.inputs), -1)
        target = log.shown[rows * finer].transpose(1, 2, 0, 3).reshape(rows.shape[1], len(plant.outputs), -1)
        x = log.states[rows[:, 0] * finer].transpose(1, 0, 2).reshape(len(plant.states), -1)
        noise = self.deviations
        names = [n for n in plant.numbers if n not in plant.known and n not in self.way.fixed]
        values = np.array([getattr(self.numbers, name) for name in names])
        width, sizes = len(rows) * lanes, np.array(plant.size)[:, None]
        used = [o for o, name in enumerate(plant.outputs) if not self.way.only or name in self.way.only]

        def errors(values: Array, x: Array, slopes: bool) -> Array:
            """Errors in noise, shape (1 + numbers + states or 1, windows, rows * o)."""
            copies = 1 + (len(names) + len(x)) * slopes
            many = {name: np.repeat(v, copies * width) for name, v in zip(names, values, strict=True)}
            states = np.tile(x, (1, copies))
            if slopes:
                for i, name in enumerate(names):
                    many[name][(1 + i) * width : (2 + i) * width] += NUDGE * abs(values[i])
                for j in range(len(x)):
                    begin = (1 + len(names) + j) * width
                    states[j, begin : begin + width] += NUDGE * plant.size[j]
            p = Numbers(**{**vars(self.numbers), **many})
            out = simulate(
                plant, p, np.tile(commands, (1, 1, copies)), NOTHING, np.ones(copies * width), states,
                np.zeros(target.shape), step=log.time[finer] - log.time[0], finer=min(finer, plant.finer),
            ).shown[: -1 : min(finer, plant.finer)]  # fmt: skip
            off = ((np.tile(target, (1, 1, copies)) - out) / noise[:, None])[:, used]
            return np.asarray(off.reshape(-1, copies, width).transpose(1, 2, 0))

        with np.errstate(over="ignore", invalid="ignore"):
            best = errors(values, x, False)[0]
            if not refit or not np.isfinite(best).all():
                return self._by_output(best, used)
            for _ in range(STEPS):
                every = errors(values, x, True)
                if not np.isfinite(every).all():
                    break
                slope = ((every[0] - every[1:]) / NUDGE).transpose(1, 2, 0)
                by_values, by_states = slope[..., : len(names)], slope[..., len(names) :]
                q, r = np.linalg.qr(by_states)
                rest = every[0] - np.einsum("wij,wkj,wk->wi", q, q, every[0])
                columns = by_values - q @ (q.transpose(0, 2, 1) @ by_values)
                step = np.linalg.lstsq(columns.reshape(rest.size, len(names)), rest.ravel(), rcond=1e-9)[0]
                step = np.clip(step, -0.5, 0.5)
                moved = np.einsum("wij,wi->wj", q, every[0] - by_values @ step)
                moved = np.einsum("wij,wj->wi", np.linalg.pinv(r, rcond=1e-10), moved)
                values = values + step * np.abs(values)
                x = x + moved.T * sizes
                now = errors(values, x, False)[0]
                if np.isfinite(now).all() and np.sum(now**2) < np.sum(best**2):
                    gained, best = np.sum(best**2) - np.sum(now**2), now
                    if gained < 1e-3 * np.sum(best**2):
                        break
        return self._by_output(best, used)

    def _by_output(self, errors: Array, used: list[int]) -> Array:
        """Root mean square of each output that is logged."""
        return np.asarray(np.sqrt(np.mean(errors.reshape(len(errors), -1, len(used)) ** 2, axis=(0, 1))))

    def sized(self, wanted: Sequence[float]) -> list[tuple[float, float]]:
        """Size of the fault, and a factor on the noise, at which it adds these shares of the error.

        Args:
            wanted: What is added to the error of that output to which most is: 0.2 for a fifth.

        Raises:
            ValueError: If no size adds as much.
        """
        aims = [math.sqrt((1.0 + share) ** 2 - 1.0) for share in wanted]
        if self.way.by_noise:
            most = float(np.max(self.left(self.log(2, [1.0])[0])))
            return [(1.0, most / aim) for aim in aims]
        log, _ = self.log(2, list(SIZES))
        files = self.way.form.files
        added = np.array([
            self._largest(_lanes(log, slice(i * files, (i + 1) * files))) for i in range(len(SIZES))
        ])  # fmt: skip
        return [(self._size(added, aim), 1.0) for aim in aims]

    def _largest(self, log: Log) -> float:
        sound = np.isfinite(log.shown).all() and np.isfinite(log.commands).all()
        left = float(np.max(self.left(log))) if sound else math.inf
        return left if math.isfinite(left) else 1e9

    def _size(self, added: Array, aim: float) -> float:
        added = np.where(added < 1e9, added, 0.0)
        aim = min(aim, max(MOST * float(added.max()), LARGE))  # a fault that is too large ends all motion
        above = np.flatnonzero(added >= aim)
        if not len(above) or above[0] == 0:
            raise ValueError(
                f"{self.kind}/{self.way.machine}/{self.seed}: {aim:.3g} is not in {added.round(3)}"
            )
        i = above[0]
        low, high = np.log(np.maximum(added[i - 1 : i + 1], 1e-9))
        share = (math.log(aim) - low) / (high - low)
        return float(SIZES[i - 1] * (SIZES[i] / SIZES[i - 1]) ** share)


def _lanes(log: Log, lanes: slice) -> Log:
    """Some lanes of a log."""
    return Log(
        log.time,
        log.states[..., lanes],
        log.drive[..., lanes],
        log.shown[..., lanes],
        log.commands[..., lanes],
    )
