"""Reading and writing of recordings as CSV and Parquet files, with checks before any work starts."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fieldmodels.model import Model
from fieldmodels.names import did_you_mean
from fieldmodels.recording import Recording, RecordingError, RecordingWarning
from fieldmodels.recording.checks import check_episodes, check_length, check_time, is_even, suspicions
from fieldmodels.recording.resampling import evened
from fieldmodels.recording.tables import Problem, Table, open_table, write_table
from fieldmodels.recording.units import UnitError, canonical, factor, known_units, si_unit

TIME, EPISODE = "t", "episode"
LEAST_SCALED = 50
"""Number of rows above which the sampling rate of a recording indicates a slow bench."""
_USUAL = {TIME: ("time", "time_s", "timestamp", "seconds", "zeit", "tempo"), EPISODE: ("run", "trial")}


@dataclass(frozen=True)
class _Column:
    """A column to read: the signal's name, its name in the file, the factor to its SI unit, that unit.

    For the time column, the declared unit, empty if there is none.
    """

    signal: str
    name: str
    factor: float
    unit: str


def load_recording(
    path: str | Path,
    model: Model | None = None,
    columns: Mapping[str, str] | None = None,
    horizon: float | None = None,
) -> Recording:
    """Load and check a recording from CSV or Parquet, keeping only the required columns in memory.

    The file has a header, a column ``t`` [s], optionally ``episode`` (an integer), and a column for each
    signal in the model's unit. Values are float64. A unit in a Parquet column's metadata is converted.

    Args:
        path: A file named .csv or .parquet.
        model: Only its inputs and outputs are read; None reads every column.
        columns: Signal name (also ``t`` and ``episode``) to the file's column name, with the column's unit
            behind a colon if it is not the model's: ``{"t": "time", "angle": "position:deg"}``.
        horizon: Prediction horizon [s] that must fit; None takes the model's shortest.

    Raises:
        RecordingError: If the file cannot be used; gives file, column and row, and what to do. Several
            problems are reported together.

    Warns:
        RecordingWarning: If a column seems to be in another unit than declared; or if the rows are
            uneven, and were resampled to an even grid (see ``fieldmodels.recording.resampling``).
    """
    table = open_table(Path(path))
    wanted = _columns(table, model, columns or {})
    values = table.read([c.name for c in wanted])
    rows = len(values[wanted[0].name])
    if rows < 2:
        raise table.fail(
            [Problem(f"{'one data row' if rows else 'no data rows'}; record at least a few hundred")]
        )
    problems = [
        Problem("a missing value; leave the row out and start a new episode", name, int(bad[0]))
        for name, column in values.items()
        if len(bad := np.flatnonzero(~np.isfinite(column)))
    ]
    if problems:
        raise table.fail(problems)
    signals = {}
    for column in wanted:
        signals[column.signal] = values[column.name]
        if column.factor != 1:
            signals[column.signal] *= column.factor
    time = signals.pop(TIME)
    episodes = signals.pop(EPISODE, None)
    if episodes is not None and (problems := check_episodes(episodes)):
        raise table.fail(problems)
    recording = Recording(
        time=time,
        signals=signals,
        units={c.signal: c.unit for c in wanted if c.signal in signals and c.unit},
        episode=np.zeros(rows, dtype=np.int64) if episodes is None else episodes.astype(np.int64),
        source=str(path),
    )
    return _checked(table, recording, model, horizon, next(c for c in wanted if c.signal == TIME))


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


def _columns(table: Table, model: Model | None, mapping: Mapping[str, str]) -> list[_Column]:
    """Decide which columns to read, with every problem of the header reported at once."""
    header = table.header
    problems = [
        Problem("appears more than once in the header; rename one of them", name)
        for name in dict.fromkeys(header)
        if header.count(name) > 1
    ]
    required, optional = [TIME], [EPISODE]
    if model is not None:
        required += [s.name for s in (*model.inputs, *model.outputs) if not s.optional]
        optional += [s.name for s in (*model.outputs, *model.measured_inputs) if s.optional]
        for signal in mapping:
            if signal not in required + optional:
                hint = did_you_mean(signal, required + optional)
                problems.append(Problem(f"model {model.name!r} has no signal {signal!r}{hint}"))
    else:
        taken = {_split(spec, header)[0] for spec in mapping.values()}
        required += [name for name in mapping if name not in (TIME, EPISODE)]
        required += [
            h
            for h in dict.fromkeys(header)
            if h not in (TIME, EPISODE) and h not in taken and h not in mapping
        ]
    found: list[_Column] = []
    for signal in required + optional:
        name, unit = _split(mapping.get(signal, signal), header)
        if name not in header:
            if signal in required or signal in mapping:
                problems.append(_missing(signal, name, header, model))
            continue
        if name in [c.name for c in found]:
            problems.append(Problem("is declared for two signals", name))
            continue
        try:
            found.append(_convert(table, model, signal, name, unit))
        except UnitError as error:
            problems.append(Problem(str(error), name))
    if problems:
        raise table.fail(problems)
    return found


def _convert(table: Table, model: Model | None, signal: str, name: str, unit: str) -> _Column:
    """Find the factor from the unit that the user or the file states to the one that the model wants."""
    stated = unit or (table.unit(name) or "")
    if signal == EPISODE:
        return _Column(signal, name, 1.0, "")
    if signal == TIME:
        return _Column(signal, name, factor(stated, "s") if stated else 1.0, stated)
    if model is not None:
        wanted = next(s.unit for s in model.signals if s.name == signal)
    elif unit:
        wanted = si_unit(unit)[0]
    else:
        wanted = stated
    return _Column(signal, name, factor(stated, wanted) if stated else 1.0, wanted)


def _split(spec: str, header: Sequence[str]) -> tuple[str, str]:
    """Split ``name:unit``; a column that is really named so is left whole."""
    name, colon, unit = spec.rpartition(":")
    return (name, unit) if colon and spec not in header else (spec, "")


def _missing(signal: str, name: str, header: Sequence[str], model: Model | None) -> Problem:
    bare = {h.split("[")[0].split("(")[0].strip().lower(): h for h in header}
    guess = next((bare[n] for n in (name.lower(), *_USUAL.get(signal, ())) if n in bare), "")
    unit = guess.partition("[" if "[" in guess else "(")[2].strip(" ])")
    suffix = f":{unit}" if unit and canonical(unit) in known_units() else ""
    if guess:
        return Problem(f"column {name!r} is missing; if it is {guess!r}, declare '{signal}={guess}{suffix}'")
    role = "seconds" if signal == TIME else ""
    if model is not None and signal != TIME:
        role = next((s.unit for s in model.signals if s.name == signal), "")
    need = f" [{role}]" if role else ""
    close = did_you_mean(name, header).partition(" (known:")[0]
    return Problem(f"column {name!r}{need} is missing{close}; the header has {', '.join(header)}; "
                   f"add it, or declare another one as '{signal}=NAME:UNIT'")  # fmt: skip


def _checked(
    table: Table, recording: Recording, model: Model | None, horizon: float | None, clock: _Column
) -> Recording:
    """The recording on an even grid, with its suspicious columns warned of.

    Raises:
        RecordingError: If its time cannot be used, or it is too short or too coarse.
    """
    problems = [Problem(p.message, p.column or clock.name, p.row) for p in check_time(recording)]
    if not problems:
        notes = []
        if not is_even(recording):
            even = evened(recording, model)
            recording, notes = even.recording, [even.note]
        if horizon is None and model is not None and model.horizons:
            # A slow bench is predicted over longer times; but a clock in ms looks like one.
            slow = clock.unit and len(recording) >= LEAST_SCALED
            horizon = min((model.scaled_to([recording]) if slow else model).horizons)
        if horizon is not None:
            problems = [Problem(p.message, clock.name) for p in check_length(recording, horizon)]
    if problems:
        raise table.fail(problems)
    notes += suspicions(recording, model)
    for note in notes:
        warnings.warn(f"{recording.source}: {note}", RecordingWarning, stacklevel=3)
    return replace(recording, notes=tuple(notes))
