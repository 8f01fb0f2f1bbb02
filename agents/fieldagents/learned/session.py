"""A training run from its begin, or from its last checkpoint, to its end."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.logger import configure
from stable_baselines3.common.utils import set_random_seed

from fieldagents.learned.begin import begin
from fieldagents.learned.checkpoint import CheckpointError, latest_checkpoint
from fieldagents.learned.conditioning import Conditioning, conditions_in
from fieldagents.learned.config import TrainConfig
from fieldagents.learned.imitation import imitate
from fieldagents.learned.recorder import PausedError, Recorder
from fieldagents.learned.run import Run
from fieldagents.progress import Report
from fieldgym import find_task
from fieldgym.sb3 import NativeVecEnv
from fieldmodels.engine import stop_between


class DivergedError(ValueError):
    """Training has lost itself in weights that are no numbers."""

    def __init__(self, steps: int) -> None:
        super().__init__(f"training diverged at step {steps}: try a lower learner.learning_rate")


def run_training(config: TrainConfig, folder: Path, report: Report, until: int | None = None) -> None:
    """Train to the end, from the folder's last checkpoint if it has one.

    Args:
        config: What to train.
        folder: The run's folder.
        report: Shown the progress.
        until: Pause after the first round with as many steps.

    Raises:
        KeyboardInterrupt: If the process was asked to stop; a checkpoint is kept after the round at hand.
    """
    with stop_between() as stop:
        _run_training(config, folder, report, until, stop)


def _run_training(
    config: TrainConfig, folder: Path, report: Report, until: int | None, stop: Callable[[], bool]
) -> None:
    torch.set_num_threads(1)  # small networks: more threads only wait, and sums keep their order
    set_random_seed(config.seed)
    shares = np.array_split(np.arange(config.num_envs), len(config.environments))
    parts = [
        find_task(config.task).make_vec(
            len(share), autoreset_mode=AutoresetMode.DISABLED, **environment.options
        )
        for environment, share in zip(config.environments, shares, strict=True)
    ]
    if conditions := conditions_in(config):
        parts = [Conditioning(part, conditions) for part in parts]
    run = Run(config, NativeVecEnv(*parts, seed=config.environment_seed, twins=config.twins))
    logger = configure(str(folder / "tensorboard"), ["tensorboard"])
    try:
        run.model.set_logger(logger)
        state = latest_checkpoint(folder / "checkpoints", lambda problem: print(problem, file=sys.stderr))
        if state is not None:
            _restore(run, state, folder)
        if config.begin is not None:
            begin(run, afresh=state is None)
        recorder = Recorder(run, folder, report, state is not None, until, stop)
        if config.imitate is not None and state is None:

            def still_wanted(stage: str, part: float) -> None:
                if stop():
                    raise KeyboardInterrupt
                report(stage, part)

            imitate(run, still_wanted)
            recorder.init_callback(run.model)
            recorder.after_imitation()
        run.learn(config.steps - run.model.num_timesteps, recorder, fresh=state is None)
    except PausedError:
        return
    except ValueError as error:
        if "of distribution" not in str(error):  # torch's words for actions that cannot be drawn
            raise
        raise DivergedError(run.model.num_timesteps) from error
    finally:
        logger.close()  # ends its writer's thread
        run.environment.close()


def _restore(run: Run, state: dict[str, Any], folder: Path) -> None:
    try:
        run.restore(state)
    except (AttributeError, KeyError, IndexError, TypeError, ValueError, RuntimeError) as error:
        raise CheckpointError(
            f"{folder / 'checkpoints'}: not checkpoints of this config: {type(error).__name__}: {error}"
        ) from error
