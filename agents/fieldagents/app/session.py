"""What a page works on: logs, their columns, a diagnosis; each action is a call that a script can make."""

from __future__ import annotations

import threading
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.free_run import FreeRun
from fieldmodels.diagnosis.outcome import Diagnosis
from fieldmodels.diagnosis.report import pictures, write_results
from fieldmodels.export import write_model
from fieldmodels.html import Picture
from fieldmodels.model import Model, ModelError
from fieldmodels.recording import Recording, RecordingError
from fieldmodels.recording.bench import TIME, Bench, Channel
from fieldmodels.recording.files import recording_of
from fieldmodels.recording.merging import JoinedTable
from fieldmodels.recording.proposals import Proposal, clock_of, propose
from fieldmodels.recording.sources import read_log
from fieldmodels.recording.tables import Table
from fieldmodels.recording.units import UnitError, factor
from fieldmodels.registry import get_model

IMPORTS = """from pathlib import Path

from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.report import write_results
from fieldmodels.recording.bench import Bench
from fieldmodels.recording.files import recording_of
from fieldmodels.recording.sources import read_log
from fieldmodels.registry import get_model
"""


class CancelledError(Exception):
    """The user has stopped a diagnosis."""


@dataclass
class Log:
    """A log that was opened.

    Attributes:
        name: What the user calls it.
        path: Where it lies.
        table: Its columns.
        values: All of its columns of numbers, once one was looked at.
        clock: The column of its times, None if there is none or each rate has its own.
        times: Seconds from the log's start by each clock that was asked for, None where it is no clock.
        shifts: Seconds by which clocks of further files are moved.
    """

    name: str
    path: Path
    table: Table
    values: dict[str, FloatArray] = field(default_factory=dict)
    clock: Channel | None = None
    times: dict[Channel, FloatArray | None] = field(default_factory=dict)
    shifts: dict[str, float] = field(default_factory=dict)

    def column(self, name: str) -> FloatArray:
        """Values of a column, read once, shape (n,).

        Raises:
            RecordingError: If there is none of this name.
        """
        if name not in self.names():
            raise RecordingError(f"{self.name}: no column of numbers {name!r}")
        return self.values[name]

    def names(self) -> tuple[str, ...]:
        """The columns of numbers."""
        if not self.values:  # of a text all columns cost little more than one
            self.values = self.table.signals()
        return tuple(self.values)


@dataclass
class Job:
    """A diagnosis at work."""

    stage: str = ""
    share: float = 0.0
    error: str = ""
    running: bool = False
    stop: threading.Event = field(default_factory=threading.Event)

    def report(self, stage: str, share: float) -> None:
        """Say what is being done; the place where it can be stopped.

        Raises:
            CancelledError: If it is to stop.
        """
        if self.stop.is_set():
            raise CancelledError
        self.stage, self.share = stage, share


class Session:
    """Logs, a model, and what a diagnosis says of them.

    Attributes:
        folder: Where results are written.
        logs: The logs, in the order in which they were opened; the first is learned from.
        model_name: Name or file of the model, empty if none is chosen.
        specs: Signal to column, as the user has confirmed them.
        diagnosis: The last one, None if there is none.
        drawn: Its pictures by name.
        job: The one at work, or the last one.
    """

    def __init__(self, folder: Path) -> None:
        """Begin with nothing."""
        self.folder = folder
        self.logs: list[Log] = []
        self.model_name = ""
        self.model: Model | None = None
        self.specs: dict[str, str] = {}
        self.rate: float | None = None
        self.aligned = False
        self.diagnosis: Diagnosis | None = None
        self.drawn: dict[str, Picture] = {}
        self.written: dict[str, Path] = {}
        self.job = Job()
        self._worker: threading.Thread | None = None

    def open(self, path: str | Path, name: str = "") -> Log:
        """Open a log; ``a.csv+b.csv`` are files of one run.

        Raises:
            RecordingError: If it cannot be read.
        """
        table = read_log(path)
        clock = clock_of(table)
        log = Log(name or Path(path).name, Path(path), table, clock=clock.channel if clock else None)
        if isinstance(table, JoinedTable):  # drawn as would be proposed
            first = next(iter(table.clocks.values()))
            shifts = {other: table.shift(first, other) for other in table.other_clocks(first)}
            log.shifts.update({other: shift.seconds for other, shift in shifts.items() if shift})
        self.logs.append(log)
        return log

    def log(self, number: int) -> Log:
        """A log by its number.

        Raises:
            RecordingError: If there is none.
        """
        if not 0 <= number < len(self.logs):
            raise RecordingError(f"there is no log {number}; open one first")
        return self.logs[number]

    def propose(self, model: str, rate: float | None = None) -> Proposal:
        """What the first log's columns seem to be.

        Raises:
            ModelError: For an unknown model.
            RecordingError: If there is no log.
        """
        self.model_name, self.model, self.rate = model, get_model(model), rate
        found = propose(self.log(0).table, self.model, rate)
        self.aligned = found.aligned
        return found

    def start(self, specs: Mapping[str, str]) -> None:
        """Diagnose the logs in the background; the second and later ones measure the gain.

        Args:
            specs: Signal to column, as ``Channel.parse`` reads them.

        Raises:
            ModelError: If no model is chosen, or a diagnosis is at work.
            RecordingError: If a log cannot be used so.
        """
        if self.job.running:
            raise ModelError("a diagnosis is at work; stop it first")
        if self.model is None:
            raise ModelError("choose a model first")
        self.specs = dict(specs)
        model, (train, *test) = self.model, self.recordings()
        self.job = Job(running=True)
        self._worker = threading.Thread(target=self._run, args=(self.job, model, train, test), daemon=True)
        self._worker.start()

    def recordings(self) -> list[Recording]:
        """The logs as recordings of the model."""
        self.log(0)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # they stand in the recordings' notes
            read = [
                recording_of(
                    log.table, Bench.of(self.specs, log.table.header, self.rate, self.aligned), self.model
                )
                for log in self.logs
            ]
        return [replace(one, source=log.name) for one, log in zip(read, self.logs, strict=True)]

    def _run(self, job: Job, model: Model, train: Recording, test: Sequence[Recording]) -> None:
        try:
            found = diagnose(model, [train], test, progress=job.report)
            job.report("writing the report", 1.0)
            drawn = pictures(found)
            self.written = write_results(found, self.folder, drawn)
            self.drawn = drawn
            self.diagnosis = found
        except CancelledError:
            job.error = "stopped"
        except ValueError as error:  # of the user's data or model: both kinds are
            job.error = str(error)
        except Exception as error:
            job.error = f"{type(error).__name__}: {error}"
            raise
        finally:
            job.running = False

    def cancel(self) -> None:
        """Stop the diagnosis at its next step."""
        self.job.stop.set()

    def run(self) -> FreeRun:
        """Free runs before and after.

        Raises:
            ModelError: If there is no diagnosis, or its model has no free run.
        """
        found = self.diagnosis.free_run if self.diagnosis else None
        if found is None:
            raise ModelError("there is no diagnosis with a free run yet")
        return found

    def numbers(self) -> dict[str, tuple[float, float, float, str]]:
        """What can be changed: name to value, lower and upper end of a slider, unit."""
        diagnosis = self.diagnosis
        if diagnosis is None:
            return {}
        simulation = diagnosis.simulation
        model, vector, result = simulation.model, simulation.vector, {}
        for i, (name, p) in enumerate(zip(model.names, model.all_parameters, strict=True)):
            if vector[i] != p.nominal or name in diagnosis.parameters:
                span = max(abs(float(vector[i])), p.scale or 0.0)
                low, high = max(p.lower, vector[i] - span), min(p.upper, vector[i] + span)
                result[name] = (float(vector[i]), float(low), float(high), p.unit)
        return result

    def changed(self, values: Mapping[str, float]) -> tuple[FreeRun, dict[str, float]]:
        """The free run with other values, and its fit of each output in percent.

        Raises:
            ModelError: For an unknown name or a value out of bounds.
        """
        run, diagnosis = self.run(), self.diagnosis
        assert diagnosis is not None
        other = diagnosis.simulation.with_values(values)
        signals = other.free_run(run.measured, run.starts["after"]).signals
        outputs = {name: signals[name] for name in run.simulated["after"]}
        result = FreeRun(run.measured, {**run.simulated, "after": outputs}, run.inputs, run.starts)
        return result, {name: result.fit("after", name) for name in result.outputs}

    def export(self) -> Path:
        """The extended simulation as a Python file that needs NumPy alone.

        Raises:
            ModelError: If there is none, or its model is no machine.
        """
        if self.diagnosis is None:
            raise ModelError("there is no diagnosis yet")
        path = self.folder / "model.py"
        write_model(self.diagnosis.simulation.model, self.diagnosis.simulation.vector, path)
        return path

    def script(self, values: Mapping[str, float] | None = None) -> str:
        """All of it as a Python script."""
        lines = [IMPORTS]
        if self.model_name:
            lines.append(f"model = get_model({self.model_name!r})")
        lines.append(f"tables = [read_log(name) for name in {[str(log.path) for log in self.logs]!r}]")
        if self.specs:
            rate = f", rate={self.rate!r}" if self.rate else ""
            rate += ", aligned=True" if self.aligned else ""
            lines += [
                f"columns = {self.specs!r}",
                f"recordings = [recording_of(t, Bench.of(columns, t.header{rate}), model) for t in tables]",
                "diagnosis = diagnose(model, recordings[:1], recordings[1:])",
                "print(diagnosis.summary())",
                f'write_results(diagnosis, Path("{self.folder.as_posix()}"))',
            ]
        if values:
            lines += [
                f"other = diagnosis.simulation.with_values({dict(values)!r})",
                "run = diagnosis.free_run",
                'simulated = other.free_run(run.measured, run.starts["after"])',
            ]
        return "\n".join(lines) + "\n"

    def times(self, log: Log, name: str) -> tuple[FloatArray, str]:
        """Times of a column's values, shape (n,), and the column that holds them.

        Returns:
            Seconds from the log's start; numbers of rows and "" where no clock rises all the way.
        """
        header, own = log.table.header, log.table.clocks.get(name)
        given = Channel(own, log.table.units.get(own, "")) if own else log.clock
        if not own and TIME in self.specs:  # as confirmed
            said = Channel.parse(self.specs[TIME], header)
            given = said if said.column in header else None
        if given is not None and given not in log.times:
            log.times[given] = self._seconds(log, given)
        found = None if given is None else log.times[given]
        if given is None or found is None:
            return np.arange(len(log.column(name)), dtype=np.float64), ""
        return found, given.column

    def _seconds(self, log: Log, clock: Channel) -> FloatArray | None:
        values = log.column(clock.column) + log.shifts.get(clock.column, 0.0)
        if not np.all(np.diff(values) >= 0):  # runs one after the other, each with times of its own
            return None
        clocks = {clock.column, *log.table.clocks.values()}
        first = min(log.column(one)[0] + log.shifts.get(one, 0.0) for one in clocks)
        try:
            return np.asarray((values - first) * factor(clock.unit or "s", "s"), dtype=np.float64)
        except UnitError:
            return None
