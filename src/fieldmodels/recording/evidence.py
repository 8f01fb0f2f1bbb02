"""What measured data say about their columns: clocks, units, signs and delays, from the numbers alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.model import Model
from fieldmodels.recording.bench import Channel, decoded
from fieldmodels.recording.data import Recording, RecordingError
from fieldmodels.recording.units import other_units
from fieldmodels.recording.windows import Windows

DEGREES = 20.0
"""An angle that swings over more radians than this (three turns) is taken to be in degrees."""
CLEARLY = 0.02
"""Correlation by which a model must answer better in one unit than in another."""
DAYS = ((20_000.0, 80_000.0), (710_000.0, 770_000.0))
"""Days from 1954 to 2119 as Excel counts them, from 1943 to 2108 as MATLAB does."""
DAILY = 1e-4
"""Step below which such numbers are days, 9 s and less; a clock in s that began so high would show 10 kHz."""
_ROWS = 20_000  # that suffice to tell a unit
_WINDOWS = 400  # windows that suffice to tell a sign
_LONG = 1_000_000  # rows that suffice to tell how numbers are coded
_LEVELS = 5  # of either sign: a switch between two values has none
_LATEST = 10  # steps by which a response is looked for late


@dataclass(frozen=True)
class Response:
    """How the measured response goes with the simulated one of a command.

    Attributes:
        correlation: Of the part that the command makes, -1 to 1; negative for a reversed sign.
        agreeing: Share of the windows in which it is positive.
        windows: How many windows.
        late: Steps by which the command is best moved on.
    """

    correlation: float
    agreeing: float
    windows: int
    late: int = 0

    @property
    def reversed(self) -> bool:
        """Whether the command acts against what the model expects, beyond chance."""
        return self.correlation < -0.15 and (1 - 2 * self.agreeing) * np.sqrt(self.windows) > 3


def is_clock(values: FloatArray) -> bool:
    """Whether a column rises from row to row in steps that are nearly even, as times do."""
    steps = np.diff(values[np.isfinite(values)])
    if len(steps) < 3 or np.median(steps) <= 0:
        return False
    return bool(
        np.mean(steps > 0) > 0.98 and np.mean(np.abs(steps - np.median(steps)) < np.median(steps)) > 0.9
    )


def counts(values: FloatArray) -> bool:
    """Whether a column only numbers the rows: it advances by one step, though it may begin anew at times."""
    steps = np.diff(values[np.isfinite(values)])
    return bool(len(steps) > 2 and np.median(steps) != 0 and np.mean(steps == np.median(steps)) > 0.9)


def coding_of(values: FloatArray) -> tuple[str, str]:
    """How whole numbers without a sign hold signed ones (see ``Channel.coding``), and in words; or nothing.

    Where such a signal passes zero its cells jump by the whole range of the number, and decoded they do not,
    or nothing lies between what is positive and what is negative.
    """
    cells = values[np.isfinite(values)][:_LONG]
    if len(cells) < _WINDOWS // 8 or cells.min() < 0 or np.any(cells != np.round(cells)):
        return "", ""
    best, chosen = 0.25, ("", "")
    for bits in (*range(8, 17), 24, 32):
        said = f"what look like signed numbers in {bits} bits without a sign (-1 is {2**bits - 1})"
        sign = f"what look like numbers with their sign in the bit worth {2 ** (bits - 1)}"
        for coding, size, why in (
            (f"int{bits}", 2.0**bits, said),
            (f"sign{2 ** (bits - 1)}", 2.0 ** (bits - 1), sign),
        ):
            inside = cells.max() < (size if coding.startswith("int") else 2 * size)
            if not inside or np.sum(np.abs(np.diff(cells)) > 0.5 * size) < 2:
                continue
            signed = decoded(cells, Channel("", coding=coding))
            if min(len(np.unique(part)) for part in (signed[signed < 0], signed[signed > 0])) < _LEVELS:
                continue
            rough = float(np.abs(np.diff(signed)).max()) / size
            rough = rough if np.abs(signed).max() > 0.3 * size else 0.4 * rough  # nothing lies between
            if rough < best:
                best, chosen = rough, (coding, why)
    return chosen


def magnitude(recording: Recording, model: Model, command: str, against: bool = False) -> tuple[str, str]:
    """A command or a rate that has lost its sign, and what has one still; empty if none has.

    It is never negative while the other goes both ways, and goes better with the other's size.

    Args:
        recording: Signals in SI units.
        model: Says which they are.
        command: Name of the input.
        against: Whether the response is known to go against the command, which then needs no size.
    """
    rates = [s.name for s in model.outputs if s.unit.endswith("/s") and s.name in recording]
    first = next((s.name for s in model.outputs if s.name in recording), "")
    sides = {name: recording[name] for name in rates} or {first: np.gradient(recording[first])}
    values = recording[command]
    for name, rate in sides.items():
        for one, other, pair in ((command, name, (values, rate)), (name, command, (rate, values))):
            if min(map(np.ptp, pair)) == 0 or not (_one_sided(pair[0]) and _both_sided(pair[1])):
                continue
            sized, signed = (abs(float(np.corrcoef(pair[0], p)[0, 1])) for p in (np.abs(pair[1]), pair[1]))
            if (against and one == command) or (sized > 0.3 and sized > signed + 0.1):
                return one, other
    return "", ""


def without_sign(other: str) -> str:
    """What is said of a magnitude, with the signal that has a sign still."""
    return f"is never negative while {other!r} goes both ways: a magnitude? log it with its sign"


def _one_sided(values: FloatArray) -> bool:
    return bool(values.min() >= -0.02 * values.max() and values.max() > 0)


def _both_sided(values: FloatArray) -> bool:
    low, high = np.quantile(values, [0.05, 0.95])
    return bool(min(-low, high) > 0.1 * max(-low, high))


def clock_unit(values: FloatArray, horizon: float) -> tuple[str, str]:
    """The unit of a clock, and why.

    Args:
        values: The column.
        horizon: Shortest time [s] over which the model predicts.
    """
    start, step = float(values[0]), float(np.median(np.diff(values)))
    for unit, power in (("s", 0), ("ms", 3), ("us", 6), ("ns", 9)):
        if 5e8 < start / 10**power < 5e9:
            return unit, f"counts {unit} since 1970"
    if step < DAILY and any(low < start < high for low, high in DAYS):
        return "d", f"counts days as spreadsheets do: {1 / (86400 * step):.4g} rows a second"
    whole = bool(np.all(values[:1000] == np.round(values[:1000])))
    if step >= 0.5 and 3 * step > horizon:
        for unit, scale in (("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)):
            if 3 * step * scale <= horizon:
                kind = "whole numbers that advance" if whole else "advances"
                return unit, f"{kind} by {step:.4g} a row, so {unit}: {1 / (step * scale):.4g} rows a second"
    return "s", f"advances by {step:.4g} a row, so s: {1 / step if step else np.inf:.4g} rows a second"


def spins(values: FloatArray) -> bool:
    """Whether an axis goes round and round: it travels one way much further than back."""
    travel = float(np.abs(np.diff(values)).sum())
    return bool(travel > 0 and abs(float(values[-1] - values[0])) > 0.5 * travel)


def angle_unit(
    values: FloatArray, rate: FloatArray | None, step: float, rate_unit: str = "rad/s"
) -> tuple[str, str]:
    """The unit of an angle that states none, and why; empty if nothing tells.

    Args:
        values: The column, in order.
        rate: A measured rate of it, None for none.
        step: Sampling interval [s].
        rate_unit: The rate's unit as stated, empty for none.
    """
    if rate is not None and rate_unit:
        ratio = slope(values, rate, step)
        for unit, scale in other_units("rad").items():
            if ratio and abs(abs(ratio) * scale - 1) < 0.1:
                return unit, f"it changes {abs(ratio):.3g} times as fast as its rate in {rate_unit} says"
        if ratio and abs(abs(ratio) - 1) < 0.1:
            return "rad", "it changes as its rate says"
    span = float(np.ptp(values))
    if span > DEGREES and not spins(values):
        return "deg", f"swings over {span:.4g}: as radians {span / (2 * np.pi):.1f} turns and back"
    return "", f"spans {span:.3g}"


def slope(
    values: FloatArray, rate: FloatArray, steps: float | FloatArray, episode: IntArray | None = None
) -> float:
    """Change of a signal over the integral of its measured rate; 0 if they do not go together.

    Args:
        values: The signal, shape (n,).
        rate: Its rate, shape (n,).
        steps: Time from row to row [s], one for all or of shape (n - 1,).
        episode: Number of each row's episode, None for one.
    """
    episode = np.zeros(len(values), dtype=np.int64) if episode is None else episode
    span = max(1, min(50, len(values) // 100))  # so that noise does not mask the change
    inside = episode[span:] == episode[:-span]
    change = (values[span:] - values[:-span])[inside]
    passed = np.where(np.diff(episode) == 0, steps * 0.5 * (rate[1:] + rate[:-1]), 0.0)
    whole = np.concatenate([[0.0], np.cumsum(passed)])
    expected = (whole[span:] - whole[:-span])[inside]
    power, product = float(expected @ expected), float(change @ expected)
    if power == 0 or abs(product) <= 0.8 * np.sqrt(power * float(change @ change)):
        return 0.0
    return product / power


def response(model: Model, recording: Recording, command: str, delays: bool = False) -> Response | None:
    """Compare what a command makes in the nominal simulation with what it made in reality.

    The simulation runs with the command and with its reverse: half their difference is what the command
    makes, and what the data have beyond the half sum is held against it.

    Args:
        model: The model; its numbers need not be right.
        recording: Its signals in SI units.
        command: Name of the input.
        delays: Whether to look for a response that comes late, too.

    Returns:
        None if there are too few windows or the command does nothing.
    """
    known: list[Response] = []
    for sign in (0.0, 1.0, -1.0):  # a model that suits its scales to the data is misled by a reversed sign
        like = model.with_commands(recording, {command: sign * recording[command]})
        try:
            scaled = model.scaled_to([like]) if sign else model
            windows = scaled.windows(recording, scaled.horizons[min(1, len(scaled.horizons) - 1)])
        except (RecordingError, IndexError, np.linalg.LinAlgError):
            continue
        some = np.unique(np.linspace(0, len(windows) - 1, _WINDOWS).astype(np.int64))
        lates = range(_LATEST if delays else 1)
        found = [_response(scaled, recording, windows.select(some), command, late) for late in lates]
        if found[0] is not None:
            best = max((r for r in found if r is not None), key=lambda r: abs(r.correlation))
            known.append(best if abs(best.correlation) > abs(found[0].correlation) + 0.02 else found[0])
    return max(known, key=lambda r: abs(r.correlation), default=None)


def turns(model: Model, recording: Recording, name: str) -> bool:
    """Whether an angle that seems large is one: the model answers better so than if it were in degrees.

    Under gravity a swing of a turn and one of a degree differ in more than their size. Where a model is as
    good at any size, nothing tells.

    Args:
        model: The model; its numbers need not be right.
        recording: Its signals in SI units, as they were read.
        name: The angle, whose rates are in degrees, too, if it is.
    """
    few = recording.excerpt(_ROWS)
    angles = {name, *(o.name for o in model.outputs if o.unit == "rad/s")} & set(few.signals)
    smaller = {**few.signals, **{n: np.radians(few[n]) for n in angles}}
    if model.random_force or not model.inputs:
        return False
    found = []
    for one in (few, replace(few, signals=smaller)):
        answers = [response(model, one, s.name) for s in model.inputs]
        found.append(float(np.mean([abs(a.correlation) if a is not None else 0.0 for a in answers])))
    return found[0] > found[1] + CLEARLY


@np.errstate(over="ignore", invalid="ignore")  # a nominal machine far from this one may run away
def _response(
    model: Model, recording: Recording, windows: Windows, command: str, late: int
) -> Response | None:
    values = np.concatenate([np.full(late, recording[command][0]), recording[command]])[: len(recording)]
    both = [
        model.simulate(
            model.nominal[None],
            replace(windows, recording=model.with_commands(recording, {command: sign * values})),
        )[0]
        for sign in (1.0, -1.0)
    ]
    measured = windows.measured(tuple(s.name for s in model.outputs))
    made = 0.5 * (both[0] - both[1])
    left = measured - 0.5 * (both[0] + both[1])
    seen = np.isfinite(made) & np.isfinite(left)
    scale = np.sqrt((np.where(seen, left, 0.0) ** 2).sum(axis=(0, 1)) / np.maximum(seen.sum(axis=(0, 1)), 1))
    scale = np.where(scale > 0, scale, 1.0)
    made, left = np.where(seen, made, 0.0) / scale, np.where(seen, left, 0.0) / scale
    products = (made * left).sum(axis=(1, 2))
    power = float(np.sqrt((made**2).sum() * (left**2).sum()))
    moved = (made**2).sum(axis=(1, 2)) > 1e-3 * np.median((made**2).sum(axis=(1, 2)))
    if power == 0 or moved.sum() < 5:
        return None
    return Response(
        float(products.sum()) / power, float(np.mean(products[moved] > 0)), int(moved.sum()), late
    )


def rate_of(values: Mapping[str, FloatArray], name: str, step: float) -> tuple[str, float]:
    """The column that is another one's rate by its course, and its factor; empty if there is none."""
    best = ("", 0.0, 0.9)
    change = np.gradient(values[name], step)
    width = max(1, len(change) // 500)
    smooth = np.convolve(change, np.ones(width) / width, "same")
    for other, theirs in values.items():
        if other == name or np.ptp(theirs) == 0 or np.ptp(smooth) == 0:
            continue
        alike = abs(float(np.corrcoef(np.convolve(theirs, np.ones(width) / width, "same"), smooth)[0, 1]))
        if alike > best[2]:
            best = (other, slope(values[name], theirs, step), alike)
    return best[0], best[1]
