"""Which column is what: proposed by names and by the data themselves, each with its evidence."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Set
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from fieldmodels.arrays import FloatArray
from fieldmodels.model import Model, Signal
from fieldmodels.names import did_you_mean
from fieldmodels.recording.bench import EPISODE, OTHER_CLOCK, TIME, Bench, Channel, decoded, option
from fieldmodels.recording.clipping import wraps
from fieldmodels.recording.data import Recording, RecordingError
from fieldmodels.recording.evidence import (
    angle_unit,
    clock_unit,
    coding_of,
    counts,
    is_clock,
    magnitude,
    rate_of,
    response,
    slope,
    turns,
    without_sign,
)
from fieldmodels.recording.merging import JoinedTable, held_or_between
from fieldmodels.recording.tables import Table
from fieldmodels.recording.units import (
    UnitError,
    converts,
    factor,
    is_unit,
    is_unscaled,
    known_units,
    zero_of,
)
from fieldmodels.recording.words import is_time, meanings, other_quantity, suits

DECLARED = "as declared"
SURE = 0.9
"""Confidence from which a proposal is used without asking."""
COUNTS = tuple(2.0**bits for bits in (8, 10, 12, 13, 14, 16, 17, 18, 20, 24, 32))
PERIODS = (360.0, 2 * np.pi, *COUNTS)
"""Ranges at which angles and counters wrap around."""
ROWS = 20_000
"""Rows of a log that are looked at."""
LESS = 0.8
"""Of its motion in the first quarter of a record, to which a motion must have died away in the last one."""
FASTEST = 5000.0
"""Rows a second above which a clock without a unit rather counts something else."""
_NAMED, _NAMED_OPTIONAL = 0.3, 0.6  # least that a name must suit a signal
_TIE = 0.02  # names suit as well as each other
_MOST_TRIED = 5  # columns without a telling name that are tried in each other's places


@dataclass(frozen=True)
class ColumnProposal:
    """What one column is, and why.

    Attributes:
        role: The model's signal, ``t`` or ``episode``.
        column: Name in the file.
        unit: Of ``gain * cell + offset``.
        gain: A scale or a sign; negative where the sign seems reversed.
        offset: Added then, in ``unit``.
        period: Of cells that wrap around, as of ``Channel``.
        coding: Of cells without a sign, as of ``Channel``.
        confidence: 0 to 1; from ``SURE`` on it needs no confirmation.
        evidence: Why, in plain words.
    """

    role: str
    column: str
    unit: str
    gain: float = 1.0
    offset: float = 0.0
    period: float = 0.0
    confidence: float = 1.0
    evidence: tuple[str, ...] = ()
    coding: str = ""

    @property
    def channel(self) -> Channel:
        """The same for a bench file."""
        return Channel(self.column, self.unit, self.gain, self.offset, self.period, self.coding)

    def doubted(self, most: float, why: str, gain: float | None = None) -> ColumnProposal:
        """The same with less confidence, for one more reason."""
        gain = self.gain if gain is None else gain
        return replace(self, gain=gain, confidence=min(self.confidence, most), evidence=(*self.evidence, why))


@dataclass(frozen=True)
class Proposal:
    """Which column of a log holds which signal of a model.

    Attributes:
        model: The model's name.
        columns: One for each signal that was found, in the model's order, the clock first.
        missing: Signals that the model needs and no column seems to hold; ``t`` if there is no clock, so
            that a rate must be given.
        unused: Columns of numbers that are left over and do not only number the rows.
        constant: Those of them that never change, and so tell nothing.
        rate: Rows a second, as it was given, or as a file without a clock says above its table.
        aligned: Whether clocks are moved by command and response alone, so that no delay can be told.
    """

    model: str
    columns: tuple[ColumnProposal, ...]
    missing: tuple[str, ...] = ()
    unused: tuple[str, ...] = ()
    constant: tuple[str, ...] = ()
    rate: float | None = None
    aligned: bool = False

    @property
    def sure(self) -> bool:
        """Whether nothing is missing and nothing needs confirmation."""
        return not self.missing and all(c.confidence >= SURE for c in self.columns)

    def bench(self, corrections: Mapping[str, Channel] | None = None) -> Bench:
        """What is proposed as a bench, with the user's corrections (signal to channel) in its place."""
        columns = {c.role: c.channel for c in self.columns} | dict(corrections or {})
        return Bench(columns, self.rate, self.model, self.aligned)


def propose(
    table: Table,
    model: Model,
    rate: float | None = None,
    known: Mapping[str, Channel] | None = None,
    align: bool = False,
) -> Proposal:
    """Propose which column holds which signal of a model, in which unit and with which sign.

    Names are read in several languages, units as the file states them. What the file does not say is taken
    from its first ``ROWS`` rows: the clock by its even steps, command and response by what the nominal model
    makes of them, units by magnitude and by rates, signs by command against response and signal against rate.

    Args:
        table: The log.
        model: The model.
        rate: Rows a second, if no column holds times.
        known: Signal to column where the user has declared it: taken as it is.
        align: Whether to move the clocks of several files until signals agree, though nothing shows that they
            are two: no delay can be told then.

    Returns:
        The proposal; to be confirmed or corrected unless it is ``sure``.
    """
    values = {n: v for n, v in table.signals(ROWS).items() if np.isfinite(v).any()}
    silent = {role for role, channel in (known or {}).items() if not channel.column}
    stated = {
        role: _declared(table, model, role, channel)
        for role, channel in (known or {}).items()
        if role not in silent
    }
    values |= table.read(
        [c.column for c in stated.values() if c.column not in values], ROWS
    )  # or says why not
    declared = {stated[r].column: stated.pop(r) for r in list(stated) if OTHER_CLOCK.fullmatch(r)}
    clock = stated.pop(TIME, None) or (
        None if rate else _clock(table, min(model.horizons, default=0.2), values)
    )
    rate = rate or (table.rate or None if clock is None and not table.clocks else None)
    taken = {clock and clock.column, *table.clocks.values(), *(c.column for c in stated.values())}
    rest = {n: v for n, v in values.items() if n not in taken}
    constant = {name for name, column in rest.items() if _never_changes(table, name, column)}
    found = _by_names(table, model, rest, stated, silent, constant) | stated
    if clock is None and table.clocks and found:
        master = next(
            (found[s.name].column for s in model.outputs if s.name in found), next(iter(table.clocks))
        )
        name = table.clocks[master]
        clock = _in_its_unit(table, name, values[name], min(model.horizons, default=0.2), True)
        clock = replace(clock, evidence=(f"the clock of {master!r}", *clock.evidence))
    moved, aligned = _other_clocks(table, clock, declared, align)
    for one in moved:
        values[one.column] = one.gain * values[one.column] + one.offset
    view = _View(table, model, values, clock, rate)
    found = found if silent else _by_data(view, found, rest)
    found = {role: _with_coding(view, one) for role, one in found.items()}
    found = {role: _with_unit(view, one, found) for role, one in found.items()}
    found = _with_signs(view, _turning(view, found))
    found |= {role: ColumnProposal(role, "", "", evidence=(DECLARED,)) for role in silent}
    found |= _no_command(model, found, rest, constant)
    roles = [s.name for s in model.signals]
    columns = sorted(found.values(), key=lambda c: roles.index(c.role) if c.role in roles else -1)
    needed = [s.name for s in (*model.inputs, *model.outputs) if not s.optional]
    unused = tuple(n for n in rest if n not in {c.column for c in columns} and not counts(rest[n]))
    return Proposal(
        model=model.name,
        columns=(*([clock] if clock else []), *moved, *columns),
        missing=(*([TIME] if clock is None and not rate else []), *[n for n in needed if n not in found]),
        unused=unused,
        constant=tuple(n for n in unused if n in constant),
        rate=rate,
        aligned=aligned,
    )


def _other_clocks(
    table: Table, clock: ColumnProposal | None, declared: Mapping[str, ColumnProposal], align: bool
) -> tuple[list[ColumnProposal], bool]:
    """Clocks of further files that are to be moved, and whether no delay can be told then."""
    moved, aligned = [], False
    if isinstance(table, JoinedTable) and clock is not None:
        for number, other in enumerate(table.other_clocks(clock.column), 2):
            if other in declared:
                moved.append(replace(declared[other], role=f"t{number}"))
            elif shift := table.shift(clock.column, other, align):
                sure = 1.0 if align and not shift.told else 0.7
                one = ColumnProposal(f"t{number}", other, "s", shift.gain, shift.seconds, confidence=sure)
                moved.append(replace(one, evidence=(shift.why,)))
                aligned = aligned or not shift.told
    return moved, aligned


def _no_command(
    model: Model, found: Mapping[str, ColumnProposal], rest: Mapping[str, FloatArray], constant: Set[str]
) -> dict[str, ColumnProposal]:
    """Inputs as none, where no column moves that could be a command, and what moves dies away."""
    inputs = [s.name for s in model.inputs if not s.optional]
    needed = {s.name for s in model.outputs if not s.optional}
    left = set(rest) - {c.column for c in found.values()}
    moving = any(n not in constant and not counts(rest[n]) for n in left)
    held = any(np.nanmax(np.abs(rest[n])) > 0.0 for n in left & constant)
    if set(inputs) & set(found) or not needed <= set(found) or moving or held:
        return {}
    if not all(_dies_away(rest[found[name].column]) for name in needed):
        return {}
    why = "no column looks like a command, and the motion dies away"
    return {name: ColumnProposal(name, "", "", confidence=0.7, evidence=(why,)) for name in inputs}


def _dies_away(values: FloatArray) -> bool:
    """Whether a signal moves less and less, as what is let go does."""
    parts = [p.mean() for p in np.array_split(np.abs(np.diff(values[np.isfinite(values)])), 4)]
    return bool(np.all(np.diff(parts) < 0.0) and parts[-1] < LESS * parts[0])


def _never_changes(table: Table, name: str, first: FloatArray) -> bool:
    """Whether a column has one value in all rows; a machine may stand still in the first ones.

    Args:
        table: The log.
        name: The column.
        first: Its first rows.
    """

    def changes(values: FloatArray) -> bool:
        return bool(np.ptp(values[np.isfinite(values)]) > 0)

    return not changes(first) and (len(first) < ROWS or not changes(table[name]))


@dataclass(frozen=True)
class _View:
    """A log's first rows, and how they become a recording."""

    table: Table
    model: Model
    values: Mapping[str, FloatArray]
    clock: ColumnProposal | None
    rate: float | None
    signals: dict[str, Signal] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.signals.update({s.name: s for s in self.model.signals})

    @property
    def step(self) -> float:
        if self.rate or self.clock is None:
            return 1 / (self.rate or 1.0)
        return float(np.median(np.diff(self.values[self.clock.column]))) * factor(self.clock.unit or "s", "s")

    def column(self, name: str) -> FloatArray:
        """A column on the common clock, without gaps."""
        values = self.values[name]
        rows = np.arange(len(values))
        good = np.isfinite(values)
        own = self.table.clocks.get(name, "")
        if self.clock is not None and own and own != self.clock.column:
            time, source = self.values[self.clock.column], self.values[own]
            held = meanings(name) & {"command"} != set()
            return held_or_between(time, source[good], values[good], held)
        return np.asarray(values if good.all() else np.interp(rows, rows[good], values[good]))

    def recording(self, found: Mapping[str, ColumnProposal]) -> Recording:
        """The proposal as a recording on an even clock."""
        signals = {}
        for role, one in found.items():
            if role != EPISODE:
                values = self.column(one.column)
                values = one.gain * decoded(values, one.channel) + one.offset
                signals[role] = values * factor(one.unit, self.signals[role].unit or one.unit)
        count = min(map(len, signals.values()))
        signals = {role: values[:count] for role, values in signals.items()}
        return Recording(np.asarray(np.arange(count) * self.step, dtype=np.float64), signals)


def _clock(table: Table, horizon: float, values: Mapping[str, FloatArray]) -> ColumnProposal | None:
    """The column with the times, if the file has one clock."""
    if table.clocks:
        return None
    scored = []
    for name, column in values.items():
        named = is_time(name, table.units.get(name, ""))
        if is_clock(column):
            counts = bool(np.array_equal(column, column[0] + np.arange(len(column))))
            scored.append((named + 0.5 * (not counts) + (name == TIME), name, named))
    if not scored:
        return None
    score, name, named = max(scored, key=lambda s: s[0])
    if score < 0.5:
        return None
    return _in_its_unit(table, name, values[name], horizon, named)


def _in_its_unit(table: Table, name: str, values: FloatArray, horizon: float, named: bool) -> ColumnProposal:
    """A clock in the unit that the file states, else in the one that its numbers suggest."""
    unit, why, sure = table.units.get(name, ""), "its name, and the file states its unit", 1.0
    if not unit or not converts(unit, "s"):
        said = f"the header says ({unit}), which is no unit of time; " if unit else ""
        unit, why = clock_unit(values, horizon)
        step = float(np.median(np.diff(values)))
        rate = 1.0 / (step * factor(unit, "s")) if step > 0.0 and unit != "d" else 0.0
        if rate > FASTEST and table.rate:
            why = f"advances by {step:.4g} a row, and the file says {table.rate:g} rows a second"
            return ColumnProposal(
                TIME, name, "s", 1.0 / (table.rate * step), confidence=0.85, evidence=(said + why,)
            )
        why, sure = said + why, 0.8 if said or unit == "d" or rate > FASTEST else 0.95 if named else 0.9
    return ColumnProposal(TIME, name, unit, confidence=sure, evidence=(why,))


def _declared(table: Table, model: Model, role: str, channel: Channel) -> ColumnProposal:
    """What the user has said of a column, which is sure."""
    if channel.column not in table.header:
        raise RecordingError(
            f"{table.path}: has no column {channel.column!r}{did_you_mean(channel.column, table.header)}"
        )
    stated = channel.unit or table.units.get(channel.column, "")
    unit = stated or next((s.unit for s in model.signals if s.name == role), "s" if role == TIME else "")
    return ColumnProposal(
        role,
        channel.column,
        unit,
        channel.gain,
        channel.offset,
        channel.period,
        1.0,
        (DECLARED,) if stated or not unit else (DECLARED, f"no unit is stated; {unit} is assumed"),
        channel.coding,
    )


def clock_of(table: Table) -> ColumnProposal | None:
    """The column that holds a file's times, None if there is none or each rate has its own."""
    values = table.signals(ROWS)
    return _clock(table, 0.2, {n: v for n, v in values.items() if np.isfinite(v).any()})


def _by_names(
    table: Table,
    model: Model,
    values: Mapping[str, FloatArray],
    stated: Mapping[str, ColumnProposal],
    silent: Set[str],
    constant: Set[str],
) -> dict[str, ColumnProposal]:
    """Signals that are not stated yet to columns, by the sum of how well names and units suit.

    A constant column is no command and no optional signal, whatever its name. Of what suits as well as
    another a response is what shares more of its command's name: its joint, its axis, its index.
    """
    names = list(values)
    found: dict[str, ColumnProposal] = {}
    for name in names:
        whole = np.array_equal(values[name], np.round(values[name]))
        if (
            EPISODE not in {*stated, *silent}
            and "episode" in meanings(name)
            and whole
            and len(np.unique(values[name])) < 0.2 * len(values[name])
        ):
            found[EPISODE] = ColumnProposal(EPISODE, name, "", confidence=0.95, evidence=("its name",))
            names.remove(name)
            break
    signals = [s for s in model.signals if s.name not in {*stated, *silent}]
    if not names or not signals:
        return found
    scores = np.array([[suits(n, table.units.get(n, ""), s, model) for n in names] for s in signals])
    still = np.outer([s in model.inputs or s.optional for s in signals], [n in constant for n in names])
    scores[still] = 0.0
    scores[(scores < 1.0) & [counts(values[n]) for n in names]] = 0.0
    weight = np.array([[1.0 if not s.optional else 0.6] for s in signals])
    commands = {s.name for s in model.inputs}
    told = [one.column for role, one in stated.items() if role in commands] + [
        names[j]
        for i, j in zip(*linear_sum_assignment(-(weight * scores)), strict=True)
        if signals[i].name in commands and scores[i, j] >= _NAMED
    ]
    shared = np.array([[max((_shared(n, c) for c in told if c != n), default=0.0) for n in names]])
    shared = np.where([[s.name in commands] for s in signals], 0.0, _TIE * shared * (scores > 0.0))
    for i, j in zip(*linear_sum_assignment(-(weight * scores + shared)), strict=True):
        signal, score = signals[i], float(scores[i, j])
        if score < (_NAMED_OPTIONAL if signal.optional else _NAMED):
            continue
        why = f"its name{' and unit' if names[j] in table.units else ''}"
        one = ColumnProposal(signal.name, names[j], "", confidence=max(score, 0.0), evidence=(why,))
        others = [n for k, n in enumerate(names) if k != j and scores[i, k] >= score - _TIE]
        free = [n for n in others if n not in {c.column for c in found.values()}]
        if free and score < 1.0:
            one = one.doubted(0.6, f"{' and '.join(map(repr, free[:2]))} would suit as well")
        found[signal.name] = one
    return found


def _shared(one: str, other: str) -> float:
    """Share of the words and numbers of two names that both have."""
    ours, theirs = (set(re.findall(r"[^\W_]+", name.lower())) for name in (one, other))
    return len(ours & theirs) / max(len(ours | theirs), 1)


def _by_data(
    view: _View, found: dict[str, ColumnProposal], rest: Mapping[str, FloatArray]
) -> dict[str, ColumnProposal]:
    """Needed signals that no name suits: the columns in whose places the nominal model answers best."""
    model = view.model
    lacking = [s for s in (*model.inputs, *model.outputs) if not s.optional and s.name not in found]
    free = [
        n
        for n in rest
        if n not in {c.column for c in found.values()}
        and np.ptp(rest[n][np.isfinite(rest[n])]) > 0
        and not counts(rest[n])
    ]
    if not lacking or len(lacking) > len(free) or (view.clock is None and not view.rate):
        return found
    best, chosen = 0.0, dict(found)
    for places in itertools.permutations(free[:_MOST_TRIED], len(lacking)):
        if any(other_quantity(s, view.table.units.get(n, "")) for s, n in zip(lacking, places, strict=True)):
            continue
        tried = dict(found)
        for signal, name in zip(lacking, places, strict=True):
            why = "no name tells; the model's response goes best with the measured one so"
            tried[signal.name] = ColumnProposal(signal.name, name, "", confidence=0.5, evidence=(why,))
        united = {role: _with_unit(view, one, tried) for role, one in tried.items()}
        score = _answers(view, united)
        if score > best:
            best, chosen = score, tried
    for signal in model.outputs:  # rates of what was found
        if signal.optional and signal.name not in chosen and signal.unit.endswith("/s"):
            base = next((s for s in model.outputs if f"{s.unit}/s" == signal.unit and s.name in chosen), None)
            left = {n: view.column(n) for n in free if n not in {c.column for c in chosen.values()}}
            if base is not None and left:
                own = chosen[base.name].column
                name, _ = rate_of({own: view.column(own), **left}, own, view.step)
                if name:
                    why = f"goes as the rate of {own!r}"
                    chosen[signal.name] = ColumnProposal(
                        signal.name, name, "", confidence=0.7, evidence=(why,)
                    )
    return chosen


def _answers(view: _View, found: Mapping[str, ColumnProposal]) -> float:
    """How well the nominal model's response goes with the measured one, whatever its sign."""
    try:
        recording = view.recording(found)
        inputs = [response(view.model, recording, s.name) for s in view.model.inputs]
    except (UnitError, RecordingError, ValueError):
        return 0.0
    if any(r is None for r in inputs):
        return 0.0
    rough = [_roughness(recording[s.name]) for s in view.model.inputs]
    smooth = [_roughness(recording[s.name]) for s in view.model.outputs if s.name in recording]
    fits = float(np.mean([abs(r.correlation) for r in inputs if r is not None]))
    return fits * (1.0 if min(rough) > max(smooth) else 0.5)  # what moves is smoother than what moves it


def _roughness(values: FloatArray) -> float:
    spread = float(values.std())
    return float(np.diff(values, 2).std()) / spread if spread > 0 else 0.0


def _with_coding(view: _View, one: ColumnProposal) -> ColumnProposal:
    """The column as signed numbers, or unwrapped, where its cells look so."""
    if one.role == EPISODE or DECLARED in one.evidence:
        return one
    values, signal, stated = (
        view.column(one.column),
        view.signals[one.role],
        view.table.units.get(one.column, ""),
    )
    coding, why = coding_of(values)
    if coding:
        return replace(one, coding=coding).doubted(0.85, f"holds {why}")
    if signal not in view.model.outputs or signal.name in view.model.wrapped_outputs:
        return one
    wrap = wraps(Recording(np.arange(float(len(values))), {one.role: values}), one.role)
    period = next((p for p in PERIODS if wrap and abs(wrap[0] / p - 1) < 0.02), 0.0)
    if not period:
        return one
    one = replace(one, period=period).doubted(
        0.85, f"jumps by about {period:g}, as what wraps around there does"
    )
    if signal.unit == "rad" and period in COUNTS and (not stated or is_unscaled(stated)):
        why = f"a turn is taken to have {period:g} counts"
        return replace(one, unit="rad", gain=one.gain * 2 * np.pi / period).doubted(0.7, why)
    return replace(one, unit="deg") if period == 360.0 and signal.unit == "rad" and not stated else one


def _with_unit(view: _View, one: ColumnProposal, found: Mapping[str, ColumnProposal]) -> ColumnProposal:
    """The unit that the file states, else the one that the numbers suggest."""
    if one.role == EPISODE or one.unit:
        return one
    signal, stated = view.signals[one.role], view.table.units.get(one.column, "")
    if not signal.unit:
        return replace(one, unit=stated)
    if stated:
        try:
            factor(stated, signal.unit)
            return replace(one, unit=stated, evidence=(*one.evidence, f"the file states {stated}"))
        except UnitError:
            if known := zero_of(stated, signal.unit):
                gain, offset = known
                one = replace(one, unit=signal.unit, gain=gain * one.gain, offset=offset)
                why = f"the file states {stated}, hence the offset, which a temperature difference has not"
                return one.doubted(0.85, why)
            one = one.doubted(0.6, _not_read(stated, one, signal))
        if is_unit(stated) or is_unscaled(stated):  # of another quantity, as a current for a torque
            return replace(one, unit=signal.unit).doubted(0.6, f"1 {stated} is taken as 1 {signal.unit}")
    unit, exact = signal.unit, one.confidence == 1.0
    if signal.unit == "rad":
        rate_signal = next((s for s in view.model.outputs if s.unit == "rad/s" and s.name in found), None)
        rate, rate_unit = None, ""
        if rate_signal is not None and rate_signal.name != one.role:
            rate_column = found[rate_signal.name].column
            rate_unit = view.table.units.get(rate_column, "")
            rate_unit = rate_unit if converts(rate_unit, "rad/s") else ""
            rate = view.column(rate_column) * (factor(rate_unit, "rad/s") if rate_unit else 1.0)
        unit, why = angle_unit(view.column(one.column), rate, view.step, rate_unit)
        if unit == "deg":
            return replace(one, unit=unit).doubted(0.85, why)
        unit = unit or "rad"
    sure = SURE if exact or signal.unit == "1" else 0.8
    why = f"{unit} is assumed" if stated else f"no unit is stated; {unit} is assumed"
    return replace(one, unit=unit).doubted(sure, why)


def _not_read(stated: str, one: ColumnProposal, signal: Signal) -> str:
    """Why a stated unit is not taken for a signal, and how to say what it is."""
    spec = f"{signal.name}=GAIN*{one.column}:{signal.unit}"
    worth = f"{option(spec)} tells, with how many {signal.unit} one is in place of GAIN"
    if is_unit(stated) or is_unscaled(stated):
        size = f"has no size; {worth}" if is_unscaled(stated) else f"is no unit of {signal.name!r}"
        return f"the file states {stated}, which {size}"
    close = did_you_mean(stated, known_units()).partition(" (known")[0]
    return f"the header says ({stated}), which is no unit that is known{close}; {worth}"


def _turning(view: _View, found: dict[str, ColumnProposal]) -> dict[str, ColumnProposal]:
    """In radians again what was taken for degrees by its size alone, where the model answers better so."""
    for role, one in found.items():
        guessed = one.unit == "deg" and one.column not in view.table.units and DECLARED not in one.evidence
        if not guessed:
            continue
        tried = {**found, role: replace(one, unit="rad", evidence=one.evidence[:-1])}
        with suppress(RecordingError, ValueError, UnitError, KeyError):
            if turns(view.model, view.recording(tried), role):
                why = "the model answers better in radians, over several turns, than in degrees"
                found = {**found, role: tried[role].doubted(0.85, why)}
    return found


def _with_signs(view: _View, found: dict[str, ColumnProposal]) -> dict[str, ColumnProposal]:
    """Reverse what goes against the model: a rate against its signal, a command against the response."""
    model = view.model
    needed = {s.name for s in (*model.inputs, *model.outputs) if not s.optional}
    if not needed <= set(found) or (view.clock is None and not view.rate) or model.random_force:
        return found
    try:
        for signal, rate in itertools.product(model.outputs, model.outputs):
            if rate.unit == f"{signal.unit}/s" and {signal.name, rate.name} <= set(found):
                found = _consistent(view, found, signal.name, rate.name)
        for command in model.inputs:
            recording = view.recording(found)
            answer = response(model, recording, command.name, delays=True)
            lost, other = magnitude(recording, model, command.name, answer is not None and answer.reversed)
            if lost:
                found[lost] = found[lost].doubted(0.6, f"{found[lost].column!r} {without_sign(other)}")
                continue
            if answer is None:
                continue
            one = found[command.name]
            share = 100 * max(answer.agreeing, 1 - answer.agreeing)
            if answer.reversed:
                why = f"the response goes against it in {share:.0f} % of {answer.windows} windows"
                why += ": its sign, or that of the response, seems reversed"
                found[command.name] = _reversed(one, why)
            elif answer.correlation > 0.15:
                late = f", about {1e3 * answer.late * view.step:.3g} ms late" if answer.late else ""
                why = f"the response goes with it in {share:.0f} % of {answer.windows} windows{late}"
                found[command.name] = replace(one, evidence=(*one.evidence, why))
    except (RecordingError, ValueError, UnitError):
        return found
    return found


def _reversed(one: ColumnProposal, why: str) -> ColumnProposal:
    """The other sign; what the user has declared is kept, but said."""
    if DECLARED in one.evidence:
        return replace(one, evidence=(*one.evidence, why))
    return one.doubted(0.7, why, -one.gain)


def _consistent(
    view: _View, found: dict[str, ColumnProposal], name: str, rate: str
) -> dict[str, ColumnProposal]:
    """Reverse the signal or its rate, whichever goes against the command, if they go against each other."""
    recording = view.recording(found)
    ratio = slope(recording[name], recording[rate], view.step)
    if ratio >= 0:
        return found
    scores = {}
    for wrong in (name, rate):
        one = found[wrong]
        why = (
            f"{name!r} falls where {rate!r} says that it rises: one sign is reversed, this one by the command"
        )
        tried = {**found, wrong: _reversed(one, why)}
        answers = [response(view.model, view.recording(tried), s.name) for s in view.model.inputs]
        scores[wrong] = sum(a.correlation for a in answers if a is not None), tried
    return max(scores.values(), key=lambda s: s[0])[1]
