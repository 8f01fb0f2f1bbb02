"""What the command line does with a config, as functions: a file, a shipped one's name or plain data."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fieldagents.config import config_of
from fieldmodels.model import Model
from fieldmodels.reality import Reality, read_reality
from fieldmodels.registry import get_model

if TYPE_CHECKING:
    from fieldagents.estimator import Diagnosis
    from fieldagents.evaluation.config import EvaluateConfig
    from fieldagents.evaluation.summary import Summary
    from fieldagents.learned.config import TrainConfig
    from fieldagents.retune import Retuning
    from fieldagents.retune.config import RetuneConfig

Source = Mapping[str, Any] | str | Path


def train(
    config: TrainConfig | Source,
    out: str | Path | None = None,
    resume: str | Path | None = None,
    progress: bool = True,
    **keys: Any,
) -> Path:
    """Train an agent: ``fg.train("heel_strike/ppo", steps=200_000)``; see ``learned.training.train``.

    Args:
        config: What to train.
        out: Folder of a new run; by default ``runs/<task>/<name>-<hash>``.
        resume: Folder of an interrupted run, which goes on exactly.
        progress: Show progress on standard error.
        keys: Keys of the config in place of its own.

    Returns:
        The run's folder; `evaluate` takes it as an agent.

    Raises:
        ConfigError: With every mistake in the config.
        MissingExtraError: Without ``pip install 'fieldgym[train]'``.
        TrainingError: If the folder does not fit.
    """
    from fieldagents.learned import config as learned
    from fieldagents.learned.training import train as run

    checked = config_of(config, learned.TrainConfig, keys)
    return run(
        checked, resume=Path(resume) if resume else None, progress=progress, out=Path(out) if out else None
    )


def evaluate(config: EvaluateConfig | Source, out: str | Path | None = None, **keys: Any) -> Summary:
    """Compare agents on the same seeds; see `fieldagents.evaluation.evaluate.evaluate`.

    Args:
        config: What to compare.
        out: Result folder, with ``episodes.parquet``, ``summary.json`` and ``report.html``; by default
            ``results/<name>``.
        keys: Keys of the config in place of its own: ``episodes=20, agents=["ranger", "ppo"]``.

    Raises:
        ConfigError: With every mistake in the config.
        JobsFailedError: If some agents failed; what the others played is kept.
    """
    from fieldagents.evaluation import config as evaluation
    from fieldagents.evaluation.evaluate import evaluate as run

    checked = config_of(config, evaluation.EvaluateConfig, keys)
    return run(checked, Path(out or Path("results") / checked.name))


def retune(
    config: RetuneConfig | Source,
    extended: Diagnosis | Mapping[str, Any] | str | Path,
    out: str | Path | None = None,
    **keys: Any,
) -> Retuning:
    """Tune an agent in the extended simulation, and test it; see `fieldagents.retune.loop.retune`.

    Args:
        config: Task, agent, effort, and the hidden reality if it is known.
        extended: A fitted `Diagnosis`, the path of its ``extended.yaml``, or a mapping of effects.
        out: Result folder, with ``retune.json``, ``.html`` and ``.parquet``; by default ``results/<name>``.
        keys: Keys of the config in place of its own.

    Raises:
        ConfigError: With every mistake in the config.
        ModelError: If the extended simulation is not of the task's machine.
    """
    from fieldagents.estimator import Diagnosis
    from fieldagents.retune import config as retuning
    from fieldagents.retune.loop import retune as run

    checked = config_of(config, retuning.RetuneConfig, keys)
    folder = Path(out or Path("results") / checked.name)
    if isinstance(extended, Diagnosis):
        extended = extended.save(folder / "extended.yaml")
    return run(checked, Path(extended) if isinstance(extended, str) else extended, folder)


def reality(source: Mapping[str, Any] | str | Path | None, machine: Model | str) -> Reality:
    """Parameter values and effects that a simulation runs with, checked against a machine.

    Args:
        source: Effect to its values, ``{"coulomb_friction": {"torque": 0.1}}``, base values under
            ``parameters``; the path of an ``extended.yaml``; or None for the nominal simulation. A sampler
            may stand for a number.
        machine: The machine, or its name.

    Raises:
        ModelError: For unknown names, or values out of bounds.
        YamlError: If the file cannot be read.
    """
    return read_reality(source, get_model(machine))
