"""The diagnosis as an estimator: options, ``fit`` on logs, then attributes, predictions and a score."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from fieldagents.logs import Logs
from fieldmodels import diagnosis
from fieldmodels.diagnosis.result import Estimate, MissingCurve, Verdict
from fieldmodels.diagnosis.use import Simulation
from fieldmodels.model import Model
from fieldmodels.reality import Reality, extended_reality
from fieldmodels.recording import Recording
from fieldmodels.registry import get_model

if TYPE_CHECKING:
    import pandas as pd

Log = Recording | str | Path


class NotFittedError(ValueError):
    """Something was asked of a diagnosis before it was fitted."""


class Diagnosis:
    """What a machine's simulation gets wrong, by logs: ``Diagnosis("pendulum").fit("log.csv")``.

    A log is a recording, a path, or the name of a public recording; several logs are given as a list.

    Args:
        machine: The machine, its name, or a Python file with one.
        fixed: Values of parameters that are known and not refitted, by full name, in SI units.
        options: Of ``fieldmodels.diagnosis.diagnose``: ``seed``, ``budget`` [s], ``window``, ``progress``.

    Raises:
        ModelError: For a machine that there is not.
    """

    def __init__(
        self, machine: Model | str, fixed: Mapping[str, float] | None = None, **options: Any
    ) -> None:
        self.machine, self.fixed, self.options = get_model(machine), fixed, options
        self._result: diagnosis.Diagnosis | None = None

    def fit(self, log: Log | Sequence[Log], test: Log | Sequence[Log] = ()) -> Self:
        """Diagnose logs; the gain is measured on test logs, or else on a part that is held out.

        Raises:
            ModelError: For an unknown or impossible fixed value.
            RecordingError: If a log cannot be used, or its columns have to be confirmed (see ``load``).
        """
        train, tests = self._read(log), self._read(test)
        self._result = diagnosis.diagnose(self.machine, train, tests, self.fixed, **self.options)
        return self

    def _read(self, logs: Log | Sequence[Log]) -> list[Recording]:
        several = [logs] if isinstance(logs, Log) else list(logs)
        read = iter(
            Logs(self.machine).read_all([str(one) for one in several if not isinstance(one, Recording)])
        )
        return [one if isinstance(one, Recording) else next(read) for one in several]

    @property
    def result_(self) -> diagnosis.Diagnosis:
        """All that was found, with its evidence: ``plot``, ``simulate``, ``to_dataframe``, ``to_json``, ...

        Raises:
            NotFittedError: Before ``fit``; so do all that follow.
        """
        if self._result is None:
            raise NotFittedError("this diagnosis has seen no log: call fit(log) first")
        return self._result

    @property
    def verdict_(self) -> Verdict:
        """One of "consistent", "named", "ambiguous", "unknown", "unrelated"."""
        return self.result_.verdict

    @property
    def effects_(self) -> dict[str, Mapping[str, Estimate]]:
        """Named effects, each with its parameters: value, standard error, unit."""
        return {cause.effect: cause.parameters for cause in self.result_.causes}

    @property
    def curves_(self) -> tuple[MissingCurve, ...]:
        """Curves that are missing and that no listed effect is, the most important first."""
        return tuple(curve for curve in self.result_.curves if curve.found)

    @property
    def machine_(self) -> Simulation:
        """The extended machine: a model, effects and curves included, and its parameter vector."""
        return self.result_.simulation

    @property
    def reality_(self) -> Reality:
        """The same as environments take it: ``fg.make_env("pendulum", reality=d.reality_)``."""
        return extended_reality(self.result_.extended(), self.result_.machine)

    def predict(self, log: Log, horizon: float = 0.0) -> pd.DataFrame:
        """Predictions of the extended machine over windows, each from the state that fits it best.

        Args:
            log: Measured data.
            horizon: Length of a window [s]; by default that of the diagnosis.

        Returns:
            Columns ``window``, ``t`` [s] and for each output its name and ``<name>_predicted``.

        Raises:
            RecordingError: If there are too few windows.
        """
        (recording,) = self._read(log)
        return self.result_.predict(recording, horizon)

    def score(self, log: Log | Sequence[Log]) -> float:
        """Share of the refitted nominal machine's squared prediction error that the extended one removes.

        The windows and their starts are those of the report and of ``predict``; the mean over the outputs. At
        most 1; 0 if nothing was found; negative if what was found makes predictions of these logs worse.

        Raises:
            RecordingError: If there are too few windows.
        """
        return self.result_.score(self._read(log))

    def summary(self) -> str:
        """The verdict in plain sentences."""
        return self.result_.summary()

    def report(self, path: str | Path) -> Path:
        """Write the report: one page if the path ends in ``.html``, else a folder with all results."""
        from fieldmodels.diagnosis.report import pictures, write_page, write_results

        path = Path(path)
        if path.suffix == ".html":
            write_page(self.result_, path, pictures(self.result_))
        else:
            write_results(self.result_, path)
        return path

    def save(self, path: str | Path) -> Path:
        """Write the extended machine: as ``extended.yaml``, or as a ``.py`` that needs NumPy alone.

        Raises:
            ModelError: If a ``.py`` is asked for and the machine has kernels of its own.
        """
        from fieldmodels.export import write_model
        from fieldmodels.yaml import save_yaml

        path = Path(path)
        if path.suffix == ".py":
            write_model(self.machine_.model, self.machine_.vector, path)
        else:
            save_yaml(self.result_.extended(), path)
        return path

    def __repr__(self) -> str:
        return repr(self._result) if self._result else f"<Diagnosis of {self.machine.name}, not fitted>"

    def _repr_html_(self) -> str:
        return self._result._repr_html_() if self._result else f"<p>{escape(repr(self))}</p>"


def diagnose(
    log: Log | Sequence[Log],
    machine: Model | str,
    test: Log | Sequence[Log] = (),
    fixed: Mapping[str, float] | None = None,
    **options: Any,
) -> Diagnosis:
    """Find from measured logs what a machine's simulation gets wrong: a `Diagnosis`, fitted.

    Args:
        log: A recording, a path, or a public recording's name; or a list of these.
        machine: The machine, its name, or a Python file with one.
        test: Separate logs on which the gain is measured; without them a part of ``log`` is held out.
        fixed: Values of parameters that are known and not refitted, by full name, in SI units.
        options: As of `Diagnosis`.

    Raises:
        ModelError: For a machine that there is not, or an impossible fixed value.
        RecordingError: If a log cannot be used, or its columns have to be confirmed (see ``load``).
    """
    return Diagnosis(machine, fixed, **options).fit(log, test)
