"""What `fieldgym record` reads."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, ValidationInfo, field_validator

from fieldagents.config import (
    Config,
    Name,
    Problems,
    RealityConfig,
    checked,
    wrong_reality,
    wrong_settings,
)
from fieldagents.seeds import LARGEST_SEED
from fieldagents.task import recorder_of
from fieldgym import TASKS
from fieldmodels.model_files import is_model_file
from fieldmodels.registry import get_model


class ExcitationConfig(Config):
    """How the input of a model is driven.

    Attributes:
        kind: ``mixed``, ``multisine``, ``prbs``, ``steps``, ``chirp``; or ``swing``, a smooth path.
        amplitude: Peak of the command, in the input's unit; of a swing, of the path.
    """

    kind: Literal["mixed", "multisine", "prbs", "steps", "chirp", "swing"] = "mixed"
    amplitude: float = Field(default=1.0, gt=0)


class WalkConfig(Config):
    """How a walker's noise behaves.

    Attributes:
        collision_kind: Kind of the collision noise.
        regimes: Whether the noise levels switch as in the environment; else they stay nominal.
    """

    collision_kind: Literal["low_pass", "ar1"] = "low_pass"
    regimes: bool = False


DRIVEN = ("excitation", "input", "step", "episodes", "noise")
"""Keys of a recording of a model with a commanded input."""


def _wrong_settings(settings: dict[str, Any] | None, model: str) -> Problems:
    recorder = recorder_of(model)
    if settings is None or recorder is None or "settings" not in recorder.keys:
        return ()
    return wrong_settings(settings, next(task.name for task in TASKS.values() if task.model == model))


class RecordConfig(Config):
    """What `fieldgym record` reads: a machine in a (hidden) reality, measured for a while.

    Attributes:
        name: Name of the result folder.
        machine: Its name; a user's own is named on the command line (``--set machine=my_bench.py``).
        reality: Effects that are on (key ``parameters``: other base values), or an ``extended.yaml``.
        excitation: How the input is driven, for a model with a commanded input; tasks' robots move at random.
        input: CSV or Parquet file of commands that are played instead, as `fieldgym diagnose` plans them: `t`
            and a column an input, at `step`, for `duration` at least.
        walk: The noise of a walk, for ``heel_strike``, which nobody drives.
        settings: Line, plant and noise of a walk, for ``line_following``: settings of its environment.
        duration: Length of an episode [s].
        step: Sampling interval [s], for a model with a commanded input; a walker has its own.
        episodes: Number of episodes, for a model with a commanded input; of ``excitation``, in each mode.
        noise: Factor on the sensors' noise; 0 for none (a walker's noise is part of its walk).
        seed: Seed of all randomness.
        format: File format.
    """

    was: ClassVar[Mapping[str, str]] = {"model": "machine"}
    name: Name
    machine: str
    reality: Annotated[RealityConfig, checked(wrong_reality, "machine")] = None
    excitation: ExcitationConfig | None = None
    input: Path | None = None
    walk: WalkConfig | None = None
    settings: Annotated[dict[str, Any] | None, checked(_wrong_settings, "machine")] = None
    duration: float = Field(gt=0, le=36_000)
    step: float | None = Field(default=None, gt=0, le=1)
    episodes: int = Field(default=1, ge=1, le=1000)
    noise: float = Field(default=1.0, ge=0, le=1000)
    seed: int = Field(default=0, ge=0, le=LARGEST_SEED)
    format: Literal["csv", "parquet"] = "csv"

    @field_validator("machine")
    @classmethod
    def _machine_exists(cls, name: str, info: ValidationInfo) -> str:
        if is_model_file(name) and not {f"machine={name}", f"model={name}"} & {*(info.context or ())}:
            raise ValueError(f"a Python file is run only if the command line names it: --set machine={name}")
        get_model(name)
        return name

    @field_validator("excitation", "input", "walk", "settings", "step", "episodes", "noise")
    @classmethod
    def _key_fits_the_model(cls, value: Any, info: ValidationInfo) -> Any:
        model = info.data.get("machine")
        if model is None:
            return value
        recorder = recorder_of(model)
        if info.field_name not in (recorder.keys if recorder else DRIVEN):
            raise ValueError(f"machine {model!r} does not take this key; leave it out")
        return value
