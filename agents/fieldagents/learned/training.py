"""`fieldgym train`: from a config to a run folder, begun anew or resumed exactly."""

from __future__ import annotations

import json
import platform
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from fieldagents.config import load_config
from fieldagents.learned.config import TrainConfig
from fieldagents.policies.algorithms import require_extra
from fieldagents.progress import progress as showing_progress
from fieldgym import find_task
from fieldmodels.drivers.named import apply_reality
from fieldmodels.files import claimed, write_text
from fieldmodels.registry import get_model
from fieldmodels.yaml import save_yaml

VERSIONED = ("fieldgym", "numpy", "numba", "gymnasium", "torch", "stable-baselines3", "sb3-contrib", "onnx")


class TrainingError(ValueError):
    """A training run that cannot begin or go on."""


def train(
    config: TrainConfig, *, resume: Path | None = None, progress: bool = True, out: Path | None = None
) -> Path:
    """Train an agent; a finished run is not trained again.

    The folder holds ``config.yaml``, ``versions.json``, ``tensorboard/``, ``curve.csv`` (one row a
    round), ``checkpoints/``, ``policy.onnx`` (the best by validation), the same as Stable-Baselines3 saves it
    (``policy.zip``, ``vecnormalize.pkl``) and, when finished, ``run.json``.

    Args:
        config: What to train.
        resume: Folder of an interrupted run of the same config: it goes on from its last checkpoint, and
            every file but the TensorBoard log, what Stable-Baselines3 pickles and ``run.json``'s seconds
            comes out as if it had never been interrupted, bit for bit (same versions, same processor type).
        progress: Show progress on standard error.
        out: The folder of a new run; ``runs/<task>/<name>-<hash>`` unless given.

    Returns:
        The run's folder.

    Raises:
        MissingExtraError: Without the packages of the ``train`` extra.
        TrainingError: If the folder does not fit.
    """
    require_extra()
    config = self_contained(config)
    if resume is not None and out is not None:
        raise TrainingError("a resumed run stays in its folder: give either --resume or --out")
    folder = run_folder(config, resume, out)
    if resume is not None and not (resume / "config.yaml").is_file():
        raise TrainingError(f"{resume}: not a run's folder (it has no config.yaml)")
    with claimed(folder):
        begun = (folder / "config.yaml").is_file()
        if not prepare(config, folder):
            print(f"{folder}: this config is trained already", file=sys.stderr)
            return folder
        if begun and resume is None:
            raise TrainingError(
                f"{folder}: an unfinished run of this config; go on with --resume {folder}, or delete it"
            )

        from fieldagents.learned.session import run_training

        try:
            with showing_progress(quiet=not progress) as report:
                run_training(config, folder, report)
        except KeyboardInterrupt:
            raise KeyboardInterrupt(f"go on with --resume {folder}") from None
    return folder


def run_folder(config: TrainConfig, resume: Path | None, out: Path | None) -> Path:
    """Where a run of a self-contained config is kept."""
    return resume or out or Path("runs") / find_task(config.task).name / f"{config.name}-{config.hash}"


def prepare(config: TrainConfig, folder: Path) -> bool:
    """Begin a run's folder, or make sure that it is of this very config.

    Returns:
        Whether training is left.

    Raises:
        TrainingError: If it is another config's.
    """
    if (folder / "config.yaml").is_file():
        _check_same(config, folder)
        return not (folder / "run.json").is_file()
    write_text(folder / "versions.json", json.dumps(versions(), indent=2) + "\n")
    save_yaml(config.model_dump(mode="json"), folder / "config.yaml")  # last: now it is a run
    return True


def self_contained(config: TrainConfig) -> TrainConfig:
    """The config with the content of an ``extended.yaml`` in place of its path, which may change."""
    environment = config.environment
    if not isinstance(environment.reality, str):
        return config
    _, reality = apply_reality(get_model(find_task(config.task).model), environment.reality)
    plain = environment.model_copy(update={"reality": reality.plain()})
    return config.model_copy(update={"environment": plain})


def versions() -> dict[str, Any]:
    """The versions that a run depends on, and the commit if this is a checkout."""
    found: dict[str, Any] = {"python": platform.python_version(), "machine": platform.machine()}
    for package in VERSIONED:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = None
    return {**found, "commit": _commit()}


def _commit() -> str | None:
    """The checkout's commit; marked if the packages' files differ from it."""

    def git(*arguments: str) -> str:
        command = ["git", "-C", str(Path(__file__).parent), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    try:
        top = git("rev-parse", "--show-toplevel")
        changed = git("status", "--porcelain", "--", *(f"{top}/{room}" for room in ("src", "envs", "agents")))
        return git("rev-parse", "HEAD") + (" with changes" if changed else "")
    except (OSError, subprocess.CalledProcessError):
        return None


def _versions_of(path: Path) -> dict[str, Any]:
    try:
        then = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        then = error
    if not isinstance(then, dict):
        raise TrainingError(f"{path}: damaged ({then}); delete it to go on without knowing the versions")
    return then


def _check_same(config: TrainConfig, folder: Path) -> None:
    """Raise unless the folder's run has this very config; warn of other versions."""
    if load_config(folder / "config.yaml", TrainConfig) != config:
        raise TrainingError(
            f"{folder}: its config.yaml differs from this config; resume with the run's own:"
            f" fieldgym train {folder / 'config.yaml'} --resume {folder}"
        )
    path = folder / "versions.json"
    then = _versions_of(path) if path.is_file() else {}
    now = versions()
    changed = [name for name in ("python", *VERSIONED) if then.get(name) != now[name]]
    if changed:
        print(
            f"{folder}: begun with other versions of {', '.join(changed)};"
            " the run will not be equal to an uninterrupted one to the last bit",
            file=sys.stderr,
        )
