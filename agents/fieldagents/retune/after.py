"""The loop as the end of a diagnosis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fieldagents.config import ConfigError, load_config
from fieldagents.progress import Report
from fieldagents.retune.config import RetuneConfig
from fieldagents.retune.loop import FILES, retune
from fieldagents.retune.report import show
from fieldagents.retune.result import Retuning
from fieldgym import find_task
from fieldmodels.diagnosis.outcome import Diagnosis
from fieldmodels.model import Model
from fieldmodels.registry import get_model

if TYPE_CHECKING:
    from rich.console import Console


def load_loop(path: Path, model: Model) -> RetuneConfig:
    """Load the config of a loop that is to follow the diagnosis of a model.

    Raises:
        ConfigError: With every mistake, or if the loop's task has another model.
    """
    config = load_config(path, RetuneConfig)
    needed = find_task(config.task).model
    if get_model(needed).name != model.name:
        raise ConfigError(
            [f"{path}: task: {config.task} needs --machine {needed}, and --machine names {model.name}"]
        )
    return config


def nothing_to_retune(diagnosis: Diagnosis) -> str | None:
    """Why there is nothing to tune anew with, or None if there is."""
    if diagnosis.verdict == "consistent":
        return "Nothing to re-tune with: nothing significant is missing in the nominal simulation."
    if diagnosis.verdict in ("unknown", "unrelated") and not diagnosis.curve_effects:
        return (
            "Nothing to re-tune with: what is missing has no name, and no curve that the machine can be run "
            "with, so there is no extended simulation to tune an agent in."
        )
    return None


@dataclass(frozen=True)
class Finish:
    """How a diagnosis with a loop ends.

    Attributes:
        retuning: What re-tuning recovers, or None if there is nothing to re-tune with.
        skipped: Why there is not; empty otherwise.
        files: What was written, by name.
    """

    retuning: Retuning | None
    skipped: str
    files: Mapping[str, Path]

    def to_json(self) -> dict[str, Any]:
        """The loop's result, or why there is none, as plain data."""
        return self.retuning.to_json() if self.retuning else {"schema": 1, "skipped": self.skipped}

    def show(self, console: Console) -> None:
        """Print it."""
        if self.retuning:
            show(self.retuning, console)
        else:
            console.print(self.skipped, markup=False)


def finish(diagnosis: Diagnosis, config: RetuneConfig, extended: Path, out: Path, progress: Report) -> Finish:
    """Close the loop after a diagnosis, or say why there is nothing to close it with.

    Args:
        diagnosis: Its result.
        config: Of the loop.
        extended: The ``extended.yaml`` that the diagnosis has written.
        out: Result folder.
        progress: Called with what is being done and the part of the whole that is done.
    """
    if skipped := nothing_to_retune(diagnosis):
        return Finish(None, skipped, {})
    result = retune(config, extended, out, progress)
    return Finish(result, "", {name: out / name for name in FILES})
