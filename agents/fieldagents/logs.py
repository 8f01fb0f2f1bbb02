"""The logs that a user names, as recordings: columns declared, kept in a bench file, or proposed."""

from __future__ import annotations

import itertools
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from fieldagents.config import ConfigError
from fieldmodels.model import Model
from fieldmodels.names import did_you_mean
from fieldmodels.recording import Recording, RecordingError, RecordingWarning, once
from fieldmodels.recording.bench import (
    EPISODE,
    NAME,
    NO_COMMAND,
    OTHER_CLOCK,
    TIME,
    Bench,
    Channel,
    beside,
    option,
)
from fieldmodels.recording.datasets import is_public, open_recording
from fieldmodels.recording.evidence import clock_unit
from fieldmodels.recording.files import load_recording, named, recording_of
from fieldmodels.recording.merging import JoinedTable
from fieldmodels.recording.proposals import ROWS, SURE, Proposal, propose
from fieldmodels.recording.sources import read_log
from fieldmodels.recording.tables import SHOWN, Table
from fieldmodels.recording.units import is_unit, is_unscaled
from fieldmodels.recording.words import suits
from fieldmodels.registry import get_model
from fieldmodels.rounding import listed as in_words

Ask = Callable[[str], bool]


@dataclass
class Logs:
    """How to read the logs of one command.

    Attributes:
        model: The model that they are read for.
        columns: File (empty for all) to signal to column, as ``declared`` reads them.
        bench: A bench file for all logs, None to look beside each.
        rate: Rows a second, for logs without a column of times.
        accept: Whether to take what is proposed without asking.
        align: Whether to move the clocks of several files until signals agree, so that no delay can be told.
        ask: Puts a question to the user; None where nobody can answer.
        agreed: Benches that earlier logs have settled.
        commanded: Whether there is a command; else all inputs are zero.
    """

    model: Model
    columns: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    bench: Path | None = None
    rate: float | None = None
    accept: bool = False
    align: bool = False
    ask: Ask | None = None
    agreed: list[Bench] = field(default_factory=list)
    commanded: bool = True

    def read_all(self, sources: Sequence[str]) -> list[Recording]:
        """Read several logs, each as ``read`` does; what is true of many is said once."""
        caught: list[warnings.WarningMessage] = []
        try:
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always", RecordingWarning)
                return [self.read(source) for source in sources]
        finally:
            for text in once(str(w.message) for w in caught):
                warnings.warn(text, RecordingWarning, stacklevel=2)

    def read(self, source: str) -> Recording:
        """Read one log, or several files of one run (``a.csv+b.csv``) on one clock.

        Raises:
            RecordingError: If it cannot be used, or what its columns are needs to be confirmed.
        """
        none = {} if self.commanded else {s.name: NO_COMMAND for s in self.model.inputs}
        specs = {**none, **self.columns.get("", {}), **self._own(source)}
        if is_public(source):
            return open_recording(source, self.model, specs)
        table = read_log(source)
        declared = Bench.of(specs, table.header, self.rate)
        known = self._known(table, declared)
        if known is None:
            known = self._proposed(table, declared)
        recording = recording_of(table, known, self.model)
        for note in table.notes:
            warnings.warn(f"{source}: {note}", RecordingWarning, stacklevel=2)
        return replace(recording, source=source, notes=(*table.notes, *recording.notes))

    def _own(self, source: str) -> Mapping[str, str]:
        names = (source, Path(source).name)
        return {k: v for file, columns in self.columns.items() if file in names for k, v in columns.items()}

    def _known(self, table: Table, declared: Bench) -> Bench | None:
        """The bench that a file, an earlier log, or names and declarations alone tell; None if none does."""
        if self.bench is not None:
            bench = Bench.load(self.bench)
            if bench.model not in ("", self.model.name):
                raise RecordingError(f"{self.bench}: is for machine {bench.model!r}, not {self.model.name!r}")
            return _over(bench, declared)
        found = beside(table.path, self.model.name)
        for bench in [*self.agreed, *([Bench.load(found)] if found else [])]:
            timed = (TIME in bench.columns or bench.rate or self.rate) and bench.aligned >= self.align
            if bench.fits(table) and timed:
                return _over(bench, declared)
        needed = [s.name for s in (*self.model.inputs, *self.model.outputs) if not s.optional]
        needed += [] if self.rate else [TIME]
        rest = {
            s.name: s for s in self.model.signals if s.optional and named(s.name, table) not in table.header
        }
        alike = [
            n for s in rest.values() for n, u in table.units.items() if suits(n, u, s, self.model) >= SURE
        ]
        plain = len(alike) != 1 and all(
            n in declared.columns or _plainly(named(n, table), table) for n in needed
        )
        plain = (
            plain and not isinstance(table, JoinedTable) and (TIME in declared.columns or self._counts(table))
        )
        return declared if plain else None

    def _counts(self, table: Table) -> bool:
        """Whether a file's clock counts seconds, or says what it counts, or there is none."""
        clock = None if self.rate else named(TIME, table)
        if clock not in table.numbers() or table.units.get(clock):
            return True
        return clock_unit(table.read([clock], ROWS)[clock], min(self.model.horizons, default=0.2))[0] == "s"

    def _proposed(self, table: Table, declared: Bench) -> Bench:
        """What is proposed, with what was declared in its place, once it is sure or confirmed."""
        proposal = propose(table, self.model, self.rate, declared.columns, self.align)
        if proposal.missing:
            raise RecordingError(
                f"{table.path}: {_needs(proposal)}; its columns are {', '.join(table.header)}: "
                + _remedy(proposal, self.model)
                + "".join(f"\n  {note}" for note in table.notes)
            )
        bench, said = proposal.bench(), f"{table.path}: its columns are read as\n{listed(proposal)}"
        if proposal.sure:
            warnings.warn(said, RecordingWarning, stacklevel=3)
        elif self.accept or (self.ask is not None and self.ask(f"{said}\nIs this right?")):
            place = table.path.with_name(NAME)
            place = place if not place.exists() else table.path.with_name(f"{table.path.stem}.{NAME}")
            bench.save(place)
            warnings.warn(f"{said}\n  kept in {place}", RecordingWarning, stacklevel=3)
        else:
            one = min(proposal.columns, key=lambda c: c.confidence)
            raise RecordingError(
                f"{said}\nwhich is not sure: take it by --accept (in Python accept=True), or correct it by "
                f"{option(f'{one.role}={one.channel}')}, with what is right in place of this"
            )
        self.agreed.append(bench)
        return bench


def load(
    source: str | Path,
    machine: Model | str | None = None,
    columns: Mapping[str, str] | None = None,
    rate: float | None = None,
    accept: bool = False,
    commanded: bool = True,
) -> Recording:
    """Load a log of any format, as `fieldgym diagnose` reads it.

    Args:
        source: A path, files of one run as ``a.csv+b.csv``, or the name of a public recording.
        machine: The machine, or its name, whose inputs and outputs are read; None reads every column of
            numbers by its name.
        columns: Signal to column, ``{"torque": "-2.5*tau:N cm"}``, where names and units do not tell.
        rate: Rows a second [Hz], for a log without a column of times.
        accept: Whether to take columns as proposed where that is not sure, and keep them in a ``bench.yaml``.
        commanded: False for a log without a command: all inputs are zero.

    Returns:
        Signals as float64 in SI units on one even clock.

    Raises:
        DatasetError: If a public recording is unknown, damaged or out of reach.
        RecordingError: If the log cannot be used, or its columns have to be confirmed; says what is proposed.
    """
    if machine is None:
        public = is_public(source)
        return (
            open_recording(source, None, columns)
            if public
            else load_recording(source, None, columns, rate=rate)
        )
    logs = Logs(get_model(machine), {"": columns or {}}, None, rate, accept, commanded=commanded)
    return logs.read(str(source))


def declared(model: Model, texts: Sequence[str]) -> dict[str, dict[str, str]]:
    """Read ``[file:]signal=[gain*]column[+offset][:unit]`` texts, by file (empty for all).

    Raises:
        ConfigError: With every text that names no signal of the model.
    """
    signals = [TIME, EPISODE, *(signal.name for signal in model.signals)]
    result: dict[str, dict[str, str]] = {}
    problems: list[str] = []
    for text in texts:
        left, _, column = text.partition("=")
        file, _, name = left.rpartition(":")
        if not column:
            problems.append(f"--column {text}: write --column signal=column or --column signal=column:unit")
        elif name not in signals and not OTHER_CLOCK.fullmatch(name):
            problems.append(
                f"--column {text}: {model.name} has no signal {name!r}{did_you_mean(name, signals)}"
            )
        else:
            result.setdefault(file, {})[name] = column
    if problems:
        raise ConfigError(problems)
    return result


def listed(proposal: Proposal) -> str:
    """A proposal for a reader: a line a column, with how sure it is and why."""
    lines, still = [f"  {c.role} = {c.channel}" for c in proposal.columns], _constant(proposal)
    wide = max(map(len, lines))
    rows = [
        f"{line:<{wide}}  {100 * c.confidence:3.0f} %  {'; '.join(c.evidence)}"
        for line, c in zip(lines, proposal.columns, strict=True)
    ]
    rate = f"  {proposal.rate:g} rows a second" if proposal.rate else ""
    return "\n".join(filter(None, [*rows, rate, still and f"  {still}"]))


def asked(question: str) -> bool:
    """Put a question to the user at the terminal."""
    print(question, end=" [y/N] ", file=sys.stderr, flush=True)
    return sys.stdin.readline().strip().lower() in ("y", "yes", "j", "ja", "o", "oui", "s", "si", "sì")


def _plainly(column: str, table: Table) -> bool:
    """Whether a file has a column, and what the header says of its unit, if anything, is one."""
    unit = table.units.get(column, "")
    return column in table.header and (not unit or is_unit(unit) or is_unscaled(unit))


def _over(bench: Bench, declared: Bench) -> Bench:
    columns: dict[str, Channel] = {**bench.columns, **declared.columns}
    return replace(bench, columns=columns, rate=declared.rate or bench.rate)


def _needs(proposal: Proposal) -> str:
    names = ["a clock (t)" if name == TIME else name for name in proposal.missing]
    still = _constant(proposal)
    return f"no column seems to hold {' or '.join(names)}{f' ({still})' if still else ''}"


def _remedy(proposal: Proposal, model: Model) -> str:
    """What says which columns are missing: options as they can be typed, in which names and units stand."""
    units = {s.name: s.unit for s in model.signals}
    free = itertools.cycle([n for n in proposal.unused if n not in proposal.constant] or ["NAME"])
    options = [option(f"{n}={next(free)}:{units[n]}") for n in proposal.missing if n != TIME]
    options += ["--column t=NAME:UNIT or --rate HZ"] * (TIME in proposal.missing)
    none = ", or --input none if nothing was commanded"
    return f"say it by {' '.join(options)}, with the right names and units" + none * any(
        s.name in proposal.missing for s in model.inputs
    )


def _constant(proposal: Proposal) -> str:
    """Which columns never change, in words; empty for none."""
    names = [repr(name) for name in proposal.constant]
    rest = [f"{len(names) - SHOWN} more"] * (len(names) > SHOWN)
    never = "never changes: it tells nothing" if len(names) == 1 else "never change: they tell nothing"
    return f"{in_words(names[:SHOWN] + rest)} {never}, and no command" if names else ""
