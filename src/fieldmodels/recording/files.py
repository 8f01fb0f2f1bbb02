"""Recordings out of logs of any format, with checks before any work starts; and their writing."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fieldmodels.arrays import BoolArray, FloatArray, IntArray
from fieldmodels.model import Model, Signal, check_instance
from fieldmodels.names import did_you_mean
from fieldmodels.recording import Recording, RecordingError, RecordingWarning
from fieldmodels.recording.bench import (
    EPISODE,
    EPOCH,
    NO_COMMAND,
    OTHER_CLOCK,
    TIME,
    Bench,
    Channel,
    decoded,
)
from fieldmodels.recording.checks import (
    LEAST_COUNTED,
    check_episodes,
    check_length,
    check_time,
    clock_faults,
    is_even,
    suspicions,
)
from fieldmodels.recording.evidence import coding_of
from fieldmodels.recording.lost import Sensor, filled, held_over, lost_in, rows_read_once
from fieldmodels.recording.merging import JoinedTable, held_or_between, paced
from fieldmodels.recording.reading import read_table
from fieldmodels.recording.resampling import evened
from fieldmodels.recording.tables import EMPTY, REMEDY, Problem, Table, write_table
from fieldmodels.recording.units import UnitError, factor, si_unit
from fieldmodels.recording.words import short
from fieldmodels.rounding import listed as in_words

LEAST_SCALED = 50
"""Number of rows above which the sampling rate of a recording indicates a slow bench."""
SPARSE = 0.2
"""Share of empty cells from which a column is taken to have a rate of its own."""
_USUAL = {TIME: ("time", "timestamp", "seconds"), EPISODE: ("run", "trial", "episode_index")}


@dataclass(frozen=True)
class _Column:
    """A column to read: the signal, the channel, the factor to its SI unit, that unit.

    For the time column, the declared unit, empty if there is none.
    """

    signal: str
    channel: Channel
    factor: float
    unit: str

    @property
    def name(self) -> str:
        return self.channel.column

    @property
    def scale(self) -> float:
        """SI units in a cell's unit."""
        return self.channel.gain * self.factor

    def si(self, values: FloatArray) -> FloatArray:
        """Values in the SI unit, in place."""
        if self.channel.gain != 1:
            values *= self.channel.gain
        if self.channel.offset:
            values += self.channel.offset
        if self.factor != 1:
            values *= self.factor
        return values


def load_recording(
    path: str | Path,
    model: Model | None = None,
    columns: Mapping[str, str] | None = None,
    horizon: float | None = None,
    rate: float | None = None,
    commanded: bool = True,
) -> Recording:
    """Load and check a recording from a log of any format, keeping only the required columns in memory.

    The file has a column ``t`` [s], optionally ``episode`` (an integer), and a column for each signal in the
    model's unit, or in that which the file states. Values are float64.

    Args:
        path: The log; see ``fieldmodels.recording.reading.read_table``.
        model: Only its inputs and outputs are read; None reads every column of numbers.
        columns: Signal name (also ``t`` and ``episode``) to the file's column name, with a gain, an offset
            and a unit if need be, as ``Channel.parse`` reads them: ``{"torque": "-2.5*tau:N cm"}``.
        horizon: Prediction horizon [s] that must fit; None takes the model's shortest.
        rate: Rows a second, for a file without times.
        commanded: False for a log without a command: all inputs of the model are zero throughout.

    Raises:
        ModelError: For a class in place of a model.
        RecordingError: If the file cannot be used; gives file, column and row, and what to do. Several
            problems are reported together.

    Warns:
        RecordingWarning: If a column seems to be in another unit than declared; or if the rows are
            uneven, and were resampled to an even grid (see ``fieldmodels.recording.resampling``).
    """
    check_instance(model)
    table = read_table(path)
    none = {s.name: NO_COMMAND for s in model.inputs} if model is not None and not commanded else {}
    bench = Bench.of({**none, **(columns or {})}, table.header, rate)
    return recording_of(table, bench, model, horizon)


def recording_of(
    table: Table, bench: Bench, model: Model | None = None, horizon: float | None = None
) -> Recording:
    """Take a bench's signals out of a log, in SI units and on one clock, and check them.

    Where columns have several rates, all are put on the times of the model's first output: commands held,
    measured signals along lines.

    Args:
        table: The log.
        bench: Which column holds which signal; a signal that it leaves out is looked up by its name.
        model: As in ``load_recording``, which also says what is raised and warned of.
        horizon: As in ``load_recording``.
    """
    wanted = _columns(table, model, bench)
    if not any(c.name for c in wanted):
        raise table.fail([Problem("no column is read from it")])
    values = table.read(list(dict.fromkeys(c.name for c in wanted if c.name)))
    rows = len(next(iter(values.values())))
    if rows < 2:
        raise table.fail(
            [Problem(f"{'one data row' if rows else 'no data rows'}; record at least a few hundred")]
        )
    optional = {s.name for s in (*model.outputs, *model.measured_inputs) if s.optional} if model else set()
    still = [c for c in wanted if c.signal in optional - {*bench.columns} and not _moves(values[c.name])]
    wanted = [c for c in wanted if c not in still]
    values = {c.name: values[c.name] for c in wanted if c.name}
    clocks = {c.name: table.clocks.get(c.name, "") for c in wanted if c.name}
    sparse = {n for n, v in values.items() if len(v) and SPARSE < np.isnan(v).mean() < 1}
    held = {s.name for s in model.inputs} if model else set()
    problems = [
        Problem(f"{EMPTY}; {REMEDY}", c.name, int(bad[0]), tuple(bad.tolist()))
        for c in wanted
        if c.name and c.name not in sparse
        if len(bad := np.flatnonzero(_unusable(values[c.name], c.signal, held, model)))
    ]
    if problems:
        raise table.fail(problems)
    single = {len(v) for v in values.values()} == {rows} and not sparse and len(set(clocks.values())) == 1
    clock = next(c for c in wanted if c.signal == TIME)
    if isinstance(table, JoinedTable) and clock.channel.unit not in ("", "s"):
        what = f"times of several files are read in seconds, not {clock.channel.unit}; declare no unit"
        raise table.fail([Problem(what, clock.name)])
    used = {c.signal: values[c.name] if single else values[c.name].copy() for c in wanted if c.name}
    kept: IntArray | None = None
    notes = [
        f"column {c.name!r} never changes: it tells nothing, and is not read as {c.signal!r}" for c in still
    ]
    if single:
        kept = np.arange(rows)
        if clock.name and len(kept := rows_read_once([*used.values()], used[TIME], used.get(EPISODE))) < rows:
            again = np.setdiff1d(np.arange(rows), kept)
            used = {signal: column[kept] for signal, column in used.items()}
            notes.append(f"repeats of earlier rows are left out: {table.place(again.tolist(), clock.name)}")
        rows = len(kept)
    runs = used.get(EPISODE) if single else None
    signed = {
        c.signal: f"column {c.name!r} holds {why}; declare it as '{c.signal}={c.name}%{coding}'"
        for c in wanted
        if c.signal not in (TIME, EPISODE) and not c.channel.period and not c.channel.coding and c.name
        for coding, why in [coding_of(used[c.signal])]
        if coding
    }
    for c in wanted:  # before values are interpolated
        if c.name:
            used[c.signal] = decoded(used[c.signal], c.channel, runs)
    if bench.rate is not None and not clock.name:
        used[TIME] = np.arange(rows) / bench.rate
    lost: dict[str, BoolArray] = {}
    if model is not None:
        lost, said = _without_lost(table, wanted, used, model, kept, signed.keys(), sparse)
        notes += said
    if kept is None and not (bench.rate is not None and not clock.name):
        used, lost = _on_one_clock(table, wanted, used, model, bench, lost)
    signals = {c.signal: c.si(used[c.signal]) for c in wanted if c.name}
    time = signals.pop(TIME, used[TIME])
    if silent := [c.signal for c in wanted if not c.name and c.signal != TIME]:
        signals |= {name: np.zeros(len(time)) for name in silent}
        are = "is" if len(silent) == 1 else "are"
        notes.append(f"no command: {in_words(list(map(repr, silent)))} {are} zero throughout")
    episodes = signals.pop(EPISODE, None)
    if episodes is not None and (problems := check_episodes(episodes)):
        raise table.fail(_in_file(problems, clock.name, kept))
    recording = Recording(
        time=time - time[0] if time[0] > EPOCH else time,
        signals=signals,
        units={c.signal: c.unit for c in wanted if c.signal in signals and c.unit},
        episode=np.zeros(len(time), dtype=np.int64) if episodes is None else episodes.astype(np.int64),
        source=str(table.path),
        aligned=bench.aligned,
        notes=(*_of_clocks(table, clock.name, bench), *notes, *signed.values()),
        lost=lost,
    )
    stated = {c.signal for c in wanted if c.channel.unit or c.name in table.units}
    columns = {c.signal: c.name for c in wanted if c.name}
    return _checked(table, recording, model, horizon, clock, stated, kept, columns)


def save_recording(recording: Recording, path: str | Path) -> None:
    """Save a recording so that ``load_recording`` gives equal values: ``t``, ``episode`` if any, signals.

    Parquet keeps the units (in the columns' metadata), CSV does not. The file is written atomically.

    Raises:
        RecordingError: If the extension is neither .csv nor .parquet, a value is not finite, or a signal
            has a name that a header cannot carry.
    """
    columns: dict[str, np.ndarray] = {TIME: np.ascontiguousarray(recording.time, dtype=np.float64)}
    if np.any(recording.episode != 0):
        columns[EPISODE] = recording.episode
    for name, values in recording.signals.items():
        if name in (TIME, EPISODE) or not name or name != name.strip() or set(name) & set('"\r\n'):
            raise RecordingError(f"{path}: a signal cannot be named {name!r}")
        columns[name] = np.ascontiguousarray(values, dtype=np.float64)
    for name, values in columns.items():
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            raise RecordingError(
                f"{path}: signal {name!r}, sample {bad[0]}: {values[bad[0]]} cannot be saved"
            )
    write_table(Path(path), columns, {TIME: "s", **recording.units})


def _of_clocks(table: Table, clock: str, bench: Bench) -> tuple[str, ...]:
    """How the clocks of several files were put together."""
    if not isinstance(table, JoinedTable):
        return ()
    moved, notes = _moved(bench), []
    for other in table.other_clocks(clock):
        file, first = table.file_of(other), table.file_of(clock)
        if other in moved:
            told = "; no delay can be told from such a shift, and none is named" if bench.aligned else ""
            gain = moved[other].gain
            drift = f", and is {paced(gain)}" if gain != 1.0 else ""
            notes.append(
                f"{file}: its clock was moved by {moved[other].offset:+.6g} s to that of {first}{drift}{told}"
            )
        else:
            notes.append(f"{file} and {first} are taken to have one clock: stamps are used as they are")
    return tuple(notes)


def _moved(bench: Bench) -> dict[str, Channel]:
    """Clocks of further files that are moved to that of the first."""
    return {c.column: c for signal, c in bench.columns.items() if OTHER_CLOCK.fullmatch(signal)}


def _sensors(model: Model | None) -> dict[str, Signal]:
    """The signals whose samples may be lost, by name."""
    return {s.name: s for s in (*model.outputs, *model.measured_inputs) if not s.event} if model else {}


def _moves(values: FloatArray) -> bool:
    """Whether a column has more than one value; also one that is none."""
    return not len(values) or bool(np.nanmin(values) != np.nanmax(values))


def _unusable(values: FloatArray, signal: str, held: Set[str], model: Model | None) -> BoolArray:
    """Cells for which nothing stands in, shape (n,): a sensor loses them, a command stays as it was."""
    if np.isnan(values).all() or signal not in {*held, *_sensors(model)}:
        return ~np.isfinite(values)
    return np.isinf(values) if signal in held else np.zeros(len(values), dtype=np.bool_)


def _without_lost(
    table: Table,
    wanted: Sequence[_Column],
    used: dict[str, FloatArray],
    model: Model,
    kept: IntArray | None,
    coded: Set[str],
    sparse: Set[str],
) -> tuple[dict[str, BoolArray], list[str]]:
    """Put other values in the place of what sensors have lost, and the last command where a cell is empty.

    Args:
        table: The log.
        wanted: Its columns.
        used: Their cells by signal, which are replaced.
        model: Says which are sensors, and which commands.
        kept: The file's row of each of theirs, if all are on the same ones; None if not.
        coded: Signals whose cells may be signed numbers without a sign, which jump where they pass zero.
        sparse: Columns with a rate of their own, whose empty cells are no lost samples.

    Returns:
        Which samples each sensor has lost, by signal, and what to say of it.
    """
    columns = {c.signal: c for c in wanted if c.name}
    lost: dict[str, BoolArray] = {}
    said: dict[str, list[str]] = {}

    def place(name: str, rows: IntArray) -> str:
        own = rows if kept is None else kept[rows]
        return table.place(own.tolist(), columns[name].name)

    commands = [s.name for s in model.inputs if s.name in columns and kept is not None]
    for name in commands:
        if len(empty := np.flatnonzero(np.isnan(used[name]))):
            said[name] = [f"empty in {place(name, empty)}, where the command before is held"]
            used[name] = held_over(used[name])
    states = {s.unit for s in model.states}
    whole = used if kept is not None else {}
    sensors = {
        name: Sensor(
            used[name],
            whole.get(TIME, np.arange(len(used[name]), dtype=np.float64)),
            whole.get(EPISODE, np.zeros(len(used[name]))),
            s.unit in states and name not in coded,
            2 * np.pi / abs(columns[name].scale) if s.angle or name in model.wrapped_outputs else 0.0,
        )
        for name, s in _sensors(model).items()
        if name in columns
    }
    for name, found in lost_in(sensors, [used[c] for c in commands], kept is not None).items():
        own = np.isfinite(used[name]) | (columns[name].name not in sparse)
        if not (kinds := {kind: rows for kind, rows in found.items() if own[rows].all()}):
            continue
        lost[name] = np.zeros(len(used[name]), dtype=np.bool_)
        for rows in kinds.values():
            lost[name][rows] = True
        said[name] = [f"{kind} in {place(name, rows)}" for kind, rows in kinds.items()]
        one = sensors[name]
        one = replace(one, values=one.values[own], time=one.time[own], episode=one.episode[own])
        used[name][own] = filled(one, lost[name][own])
    what = "; ".join(f"column {columns[name].name!r}: {in_words(parts)}" for name, parts in said.items())
    return lost, [f"samples were lost, and are counted nowhere: {what}"] if lost else [what] if what else []


def _on_one_clock(
    table: Table,
    wanted: Sequence[_Column],
    used: Mapping[str, FloatArray],
    model: Model | None,
    bench: Bench,
    lost: Mapping[str, BoolArray],
) -> tuple[dict[str, FloatArray], dict[str, BoolArray]]:
    """All signals at the times of the first output, in the unit of its clock, and which samples are lost."""
    moved = _moved(bench)
    clock = next(c for c in wanted if c.signal == TIME)
    common = used[TIME]
    times: dict[str, FloatArray] = {}
    gone: dict[str, FloatArray] = {}
    wanted = [c for c in wanted if c.name]
    for c in wanted:
        own = table.clocks.get(c.name, clock.name)
        time = common if own == clock.name else table[own]
        if own in moved:
            time = moved[own].gain * time + moved[own].offset
        there = np.isfinite(used[c.signal]) & np.isfinite(time)
        times[c.signal] = time[there]
        if c.signal in lost:
            gone[c.signal] = lost[c.signal][there].astype(np.float64)
        if not there.all():
            used = {**used, c.signal: used[c.signal][there]}
    outputs = [s.name for s in model.outputs if s.name in used] if model else [n for n in used if n != TIME]
    master = times[max(outputs, key=lambda n: len(times[n]))]
    ranges = [t for t in times.values() if len(t)]
    slack = 1e-2 * float(np.median(np.diff(master))) if len(master) > 1 else 0.0
    first, last = max(t[0] for t in ranges) - slack, min(t[-1] for t in ranges) + slack
    master = master[(master >= first) & (master <= last)]
    if len(master) < 2:
        remedy = "; declare how far apart the clocks are, as 't2=CLOCK-3.2:s'" * isinstance(
            table, JoinedTable
        )
        raise table.fail([Problem(f"its columns have no times in common{remedy}", clock.name)])
    held = {s.name for s in model.inputs} if model and getattr(model, "hold", "held") == "held" else set()
    return {
        c.signal: master.copy()
        if c.signal == TIME
        else held_or_between(master, times[c.signal], used[c.signal], c.signal in {EPISODE, *held})
        for c in wanted
    }, {name: held_or_between(master, times[name], flags, False) > 0.0 for name, flags in gone.items()}


def _columns(table: Table, model: Model | None, bench: Bench) -> list[_Column]:
    """Decide which columns to read, with every problem of the header reported at once."""
    header, problems = table.header, []
    mapping = {s: c for s, c in bench.columns.items() if not OTHER_CLOCK.fullmatch(s)}
    others = table.other_clocks("") if isinstance(table, JoinedTable) else ()
    problems += [
        Problem(f"is the clock of no further file; these are {in_words(list(others)) or 'none'}", name)
        for name in _moved(bench)
        if name not in others
    ]
    required, optional = ([] if bench.rate else [TIME]), [EPISODE]
    if model is not None:
        required += [s.name for s in (*model.inputs, *model.outputs) if not s.optional]
        optional += [s.name for s in (*model.outputs, *model.measured_inputs) if s.optional]
        optional += [TIME] if bench.rate else []
        for signal in mapping:
            if signal not in required + optional:
                hint = did_you_mean(signal, required + optional)
                problems.append(Problem(f"model {model.name!r} has no signal {signal!r}{hint}"))
    else:
        taken = {c.column for c in mapping.values()} | set(table.clocks.values())
        required += [n for n in mapping if n not in (TIME, EPISODE)]
        required += [n for n in dict.fromkeys(table.numbers()) if n not in {TIME, EPISODE, *taken, *mapping}]
    problems += [
        Problem("appears more than once in the header; rename one of them", name)
        for name in dict.fromkeys(header)
        if header.count(name) > 1 and (model is None or name in required)
    ]
    found: list[_Column] = []
    for signal in required + optional:
        if signal == TIME and bench.rate and TIME not in mapping:
            continue
        channel = mapping.get(signal) or Channel(named(signal, table))
        if not channel.column and model is not None and signal in {s.name for s in model.inputs}:
            found.append(_Column(signal, channel, 1.0, channel.unit))
            continue
        if channel.column not in header:
            if signal in required or signal in mapping:
                problems.append(_missing(signal, channel.column, table, model))
            continue
        if channel.column in [c.name for c in found]:
            problems.append(Problem("is declared for two signals", channel.column))
            continue
        try:
            found.append(_convert(table, model, signal, channel))
        except UnitError as error:
            said = str(error).replace("SIGNAL", signal).replace("COLUMN", channel.column)
            problems.append(Problem(said, channel.column))
    if problems:
        raise table.fail(problems)
    return found if not bench.rate or TIME in mapping else [_Column(TIME, Channel(""), 1.0, "s"), *found]


def named(signal: str, table: Table) -> str:
    """The column that has a signal's name, but for case, a unit behind it, and a clock's usual names."""
    if signal in table.header:
        return signal
    for wanted in (signal, *_USUAL.get(signal, ())):
        alike = [n for n in table.header if short(n) == wanted]
        if len(alike) == 1:
            return alike[0]
    return signal


def _convert(table: Table, model: Model | None, signal: str, channel: Channel) -> _Column:
    """Find the factor from the unit that the user or the file states to the one that the model wants."""
    stated = channel.unit or table.units.get(channel.column, "")
    if signal == EPISODE:
        return _Column(signal, channel, 1.0, "")
    if signal == TIME:
        return _Column(signal, channel, factor(stated, "s") if stated else 1.0, stated)
    if model is not None:
        wanted = next(s.unit for s in model.signals if s.name == signal) or stated
    elif channel.unit:
        wanted = si_unit(channel.unit)[0]
    else:
        wanted = stated
    return _Column(signal, channel, factor(stated, wanted) if stated else 1.0, wanted)


def _missing(signal: str, name: str, table: Table, model: Model | None) -> Problem:
    role = "seconds" if signal == TIME else ""
    if model is not None and signal != TIME:
        role = next((s.unit for s in model.signals if s.name == signal), "")
    need = f" [{role}]" if role else ""
    close = did_you_mean(name, table.header).partition(" (known:")[0]
    rate = ", or give the rows a second by --rate" if signal == TIME else ""
    return Problem(f"column {name!r}{need} is missing{close}; the header has {', '.join(table.header)}; "
                   f"add it, or declare another one as '{signal}=NAME:UNIT'{rate}")  # fmt: skip


def _lying(table: Table, recording: Recording, clock: str, kept: IntArray) -> tuple[str, ...]:
    """Where a clock goes back, stands still or jumps, by the file's rows."""
    return tuple(
        f"column {clock!r}: the clock {what} at {table.place(kept[rows].tolist(), clock)}"
        for what, rows in clock_faults(recording)
    )


def _in_file(problems: Sequence[Problem], clock: str, kept: IntArray | None) -> list[Problem]:
    """Problems of a recording's rows by those of its file, and of no column by that of its clock."""
    return [
        replace(p, column=p.column or clock, row=p.row if p.row is None or kept is None else int(kept[p.row]))
        for p in problems
    ]


def _checked(
    table: Table,
    recording: Recording,
    model: Model | None,
    horizon: float | None,
    clock: _Column,
    stated: Set[str],
    kept: IntArray | None,
    columns: Mapping[str, str],
) -> Recording:
    """The recording on an even grid, with its suspicious columns warned of; ``kept`` are the file's rows.

    Raises:
        RecordingError: If its time cannot be used, or it is too short or too coarse.
    """
    problems = _in_file(check_time(recording), clock.name, kept)
    if not problems:
        if not is_even(recording):
            lying = () if kept is None or not clock.name else _lying(table, recording, clock.name, kept)
            recording = evened(replace(recording, notes=(*recording.notes, *lying)), model)
        if horizon is None and model is not None and model.horizons:
            # A slow bench is predicted over longer times; but a clock in ms looks like a very slow one.
            horizon = min(model.horizons)
            timeless = getattr(model, "ahead", False)
            sure = (
                timeless
                or clock.unit
                or (recording.step < LEAST_COUNTED and check_length(recording, horizon))
            )
            if sure and len(recording) >= LEAST_SCALED:
                horizon = min(model.scaled_to([recording]).horizons)
        if horizon is not None:
            problems = [Problem(p.message, clock.name) for p in check_length(recording, horizon)]
    if problems:
        raise table.fail(problems)
    notes = [*recording.notes, *suspicions(recording, model, stated, columns)]
    for note in notes:
        warnings.warn(f"{recording.source}: {note}", RecordingWarning, stacklevel=3)
    return replace(recording, notes=tuple(notes))
