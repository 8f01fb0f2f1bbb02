"""How large a fault must be to add a percentage to the held-out error of the refitted nominal machine."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from exam.benches import FIT, TEST, THIRD, Bench, Conditions, Hidden, Log
from fieldmodels.arrays import FloatArray
from fieldmodels.files import write_bytes
from fieldmodels.recording import Recording

LEAST, MOST = 10.0, 40.0
"""Percentages that a hidden fault adds."""
NEAR, TRIES = 0.15, 12
"""How near the drawn percentage a size must come, in how many tries."""


LEAST_SHOWN = 10.0
"""Evidence for a fault in the record to fit [nats], with less of which nobody can find it there."""
MUCH = 1e6
"""Evidence beyond which it is not counted [nats]."""


@dataclass(frozen=True)
class Found:
    """A size that was found, or the most that was seen.

    Attributes:
        size: The size; None if none adds as much.
        percent: What it adds [%].
    """

    size: float | None
    percent: float


def records(bench: Bench, hidden: Sequence[Hidden], conditions: Conditions, seed: int) -> tuple[Log, Log]:
    """A record to fit and one to measure gains on."""
    return bench.log(hidden, conditions, seed, FIT), bench.log(hidden, conditions, seed, TEST)


def recordings(
    bench: Bench, hidden: Sequence[Hidden], conditions: Conditions, seed: int
) -> tuple[Recording, Recording]:
    """The same two as a diagnosis is given them."""
    train, test = (bench.recording(log, conditions, seed) for log in records(bench, hidden, conditions, seed))
    return train, test


def with_third(
    bench: Bench, hidden: Sequence[Hidden], conditions: Conditions, seed: int, kept: Path
) -> list[Recording]:
    """These and a third one, which no diagnosis is given; kept in a file, and read from it if it is there."""
    if kept.exists():
        with np.load(kept) as data:
            logs = [Log(float(data["step"]), data[f"inputs_{k}"], data[f"outputs_{k}"]) for k in range(3)]
    else:
        logs = [*records(bench, hidden, conditions, seed), bench.log(hidden, conditions, seed, THIRD)]
        columns: dict[str, Any] = {f"inputs_{k}": log.inputs for k, log in enumerate(logs)}
        columns |= {f"outputs_{k}": log.outputs for k, log in enumerate(logs)}
        kept.parent.mkdir(parents=True, exist_ok=True)
        archive = BytesIO()  # one that cannot be written to its end raises other errors than the disk's
        np.savez_compressed(archive, step=logs[0].step, **columns)
        write_bytes(kept, archive.getbuffer())
    return [bench.recording(log, conditions, seed) for log in logs]


def errors(
    bench: Bench,
    hidden: Sequence[Hidden],
    conditions: Conditions,
    seed: int,
    known: bool,
    record: int = TEST,
) -> FloatArray:
    """Error on another record of each output of the refitted nominal machine; infinite if it runs away."""
    train, other = (bench.log(hidden, conditions, seed, which) for which in (FIT, record))
    if not (train.finite and other.finite):
        return np.full(train.outputs.shape[1], np.inf)
    return bench.errors(train, other, conditions, seed, known)


def added(with_fault: FloatArray, without: FloatArray) -> float:
    """What a fault adds to the error of that output to which it adds most [%]."""
    return float(100.0 * (np.nanmax(with_fault / without) - 1.0))


def shown(bench: Bench, hidden: Sequence[Hidden], conditions: Conditions, seed: int) -> list[float]:
    """Evidence for each fault, beside the others, in the record to fit [nats].

    That of a matched filter, which knows everything but whether the fault is there: half the squared change
    of all samples by the fault, in units of the sensors' noise. No diagnosis can have more in white Gaussian
    noise. A limit may be reached on the second record alone.
    """
    noise = np.array([output.noise for output in bench.model.outputs])
    whole = bench.log(hidden, conditions, seed, FIT).outputs
    noise = np.where(noise > 0.0, noise, 1.0 / MUCH)[: whole.shape[1]]  # events have none
    result = []
    for one in hidden:
        rest = bench.log([other for other in hidden if other is not one], conditions, seed, FIT).outputs
        same = rest.shape == whole.shape
        evidence = 0.5 * float(np.nansum(((whole - rest) / noise) ** 2)) if same else MUCH
        result.append(round(min(evidence, MUCH), 3))
    return result


def find_size(bench: Bench, name: str, sign: int, wanted: float, conditions: Conditions, seed: int) -> Found:
    """Find the size at which a fault adds a percentage, on the records that will hide it, noise and all.

    What a fault adds is nearly independent of the noise, so squares add: the next size is guessed by them.

    Args:
        bench: The machine.
        name: A listed effect or a fault that is not listed.
        sign: Its direction.
        wanted: What it shall add [%].
        conditions: Of the records.
        seed: Of the case.
    """
    known = name in bench.needs_base
    without = errors(bench, (), conditions, seed, known)
    below: tuple[float, float] | None = None
    above: tuple[float, float] | None = None
    size, most, target = 1.0, 0.0, _square(wanted)
    for _ in range(TRIES):
        percent = added(errors(bench, [Hidden(name, size, sign)], conditions, seed, known), without)
        if LEAST <= percent <= MOST and abs(percent - wanted) <= NEAR * wanted:
            return Found(size, percent)
        if percent < wanted:
            below, most = (size, _square(percent)), max(most, percent)
        else:
            above = (size, _square(percent))
        if below is not None and above is not None:
            share = math.log(target / below[1]) / math.log(above[1] / below[1])
            size = below[0] * (above[0] / below[0]) ** min(max(share, 0.15), 0.85)
        else:
            size *= min(max(math.sqrt(target / _square(percent)), 0.02), 4.0)
    return Found(None, most)


def _square(percent: float) -> float:
    """Square of the error that adds a percentage to an error of one."""
    return max((1.0 + min(percent, 1e9) / 100.0) ** 2 - 1.0, 1e-3)
