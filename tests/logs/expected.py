"""What a log of the field must lead to: the truth behind it, what must be said, what its owner adds."""

from __future__ import annotations

import warnings
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from bench import Run
from foreign import Log

from fieldmodels.recording import Recording
from fieldmodels.recording.bench import Bench
from fieldmodels.recording.files import recording_of
from fieldmodels.recording.proposals import propose
from fieldmodels.recording.sources import read_log
from fieldmodels.recording.tables import Table
from fieldmodels.registry import get_model


@dataclass(frozen=True)
class Expected(Log):
    """A log, the truth behind it, and all that must be told about it.

    ``run.model`` is the machine that its owner has: a stock one, or the Python file beside the log.
    ``options`` holds what the owner says and no reader can know: ``columns`` as on the command line, by
    native names, ``rate`` [Hz], or ``input`` "none".

    Attributes:
        columns: Of each signal, and of ``t`` where there is one, ``name:unit``: the native name
            (``message.field``; a reader may separate them otherwise) and, after the last colon, the unit
            that the file states, nothing where it states none.
        parts: The runs one after the other where the file holds several (rollouts, episodes, segments).
        rows: Kind of fault -> where it stands: lines of the file from 1, of a stretch its first and last.
        said: Regular expressions, each of which what is said must match.
        refused: The same, of the refusal; then ``run`` and ``columns`` are those of ``remedy``.
        remedy: What a person has who followed the refusal's advice, as the command line takes it.
    """

    columns: dict[str, str] = field(default_factory=dict)
    parts: tuple[Run, ...] = ()
    rows: dict[str, tuple[int, ...]] = field(default_factory=dict)
    said: tuple[str, ...] = ()
    refused: tuple[str, ...] = ()
    remedy: str = ""


_MAKERS: dict[str, Callable[[Path], Expected]] = {}


def log(make: Callable[[Path], Expected]) -> Callable[[Path], Expected]:
    """Register the maker of a log, which writes into a folder of its own and says in its docstring what."""
    _MAKERS[make.__name__] = make
    return make


def makers() -> dict[str, Callable[[Path], Expected]]:
    """All makers by the names of their logs."""
    import formats  # noqa: F401  # they register themselves
    import kinds  # noqa: F401

    return _MAKERS


def entry(source: str | Path, run: Run, columns: str, **more: Any) -> Expected:
    """A log whose maker's docstring says what it is; columns as ``signal=name:unit; ...``."""
    pairs = dict(one.split("=", 1) for one in columns.split("; "))
    return Expected("", str(source), run, columns=pairs, **more)


def names(which: str) -> list[str]:
    """The logs of a set, ``develop`` or ``report``: drawn by a hash of their names, not by hand."""
    return [name for name in makers() if zlib.crc32(name.encode()) % 2 == (which == "report")]


def made(name: str, folder: Path) -> Expected:
    """Write one log.

    Raises:
        ImportError: If the library that writes its format is missing.
    """
    (folder / name).mkdir(parents=True, exist_ok=True)
    about = (makers()[name].__doc__ or "").partition("\n")[0].rstrip(".")
    return replace(makers()[name](folder / name), about=about)


MACHINE = '''"""A first-order machine of the user's own."""

from fieldmodels.effects import actuator, sensor
from fieldmodels.machine import Machine, number
from fieldmodels.model import Signal


class Mine(Machine):
    inputs = (Signal("command", "{command}"),)
    states = outputs = (Signal("response", "{response}", noise={noise}),)
    gain = number("{gain}", 1.0, 1e-6, 1e6)
    time_constant = number("s", 0.05, 1e-3, 100.0)
    effects = actuator("command") + sensor("response")

    def derivative(self, state, input, p):
        return (p.gain * input.command - state.response) / p.time_constant
'''


def machine(folder: Path, command: str, response: str, gain: str, noise: float = 0.02) -> str:
    """Write a machine of the user's own; its path, as a model's name."""
    path = folder / "machine.py"
    path.write_text(MACHINE.format(command=command, response=response, gain=gain, noise=noise))
    return str(path)


def read(told: Expected) -> tuple[Table, Recording]:
    """The log as its owner has it read: as proposed, with what only the owner knows."""
    table, model = read_log(told.source), get_model(told.run.model)
    said = Bench.of(told.options.get("columns", {}), table.header)
    proposal = propose(table, model, told.options.get("rate"), said.columns)
    assert not proposal.missing, (proposal.missing, table.header)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return table, recording_of(table, proposal.bench(), model)


def errors(told: Expected, recording: Recording) -> dict[str, float]:
    """Of each signal of each run the error in shares of its spread, of which one row in twenty may be off.

    The truth is that of the nearest row: a command steps there, and a line between two rows would cut it.
    """
    found = {}
    for k, (run, (a, b)) in enumerate(zip(told.parts or (told.run,), recording.bounds, strict=True)):
        for name, values in run.signals.items():
            time = recording.time[a:b] - recording.time[a] + told.late
            nearest = np.rint(np.interp(time, run.time, np.arange(len(values)))).astype(int)
            truth, seen = values[nearest], recording[name][a:b]
            seen = seen * (np.ptp(truth) / np.ptp(seen) if name in told.scaled else 1.0)
            found[f"{name} {k}"] = float(np.quantile(np.abs(seen - truth), 0.95) / np.std(truth))
    return found
