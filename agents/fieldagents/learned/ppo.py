"""Proximal policy optimisation (Stable-Baselines3) with validation, checkpoints and exact resume."""

from __future__ import annotations

import csv
import io
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import gymnasium
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.logger import configure
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.utils import safe_mean, set_random_seed
from stable_baselines3.common.vec_env import VecNormalize

from fieldagents.evaluation.episodes import run_episodes
from fieldagents.evaluation.metrics import METRICS
from fieldagents.learned.checkpoint import (
    load_checkpoint,
    random_state,
    restore_random_state,
    save_checkpoint,
    to_arrays,
)
from fieldagents.learned.config import VALIDATION_SEEDS, TrainConfig
from fieldagents.learned.export import to_onnx
from fieldagents.learned.policy import OnnxAgent
from fieldagents.learned.vector import NativeVecEnv, RealRolloutBuffer
from fieldagents.progress import Report
from fieldgym import TASKS
from fieldmodels.files import write_bytes, write_text

ACTIVATIONS = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU}
CHECKPOINTS_KEPT = 3
LOGGED = ("approx_kl", "explained_variance", "std")
CURVE = ("steps", "training_return", *LOGGED, "validation_return")


class DivergedError(ValueError):
    """Training has lost itself in weights that are no numbers."""

    def __init__(self, steps: int) -> None:
        super().__init__(f"training diverged at step {steps}: try a lower ppo.learning_rate")


def run_ppo(config: TrainConfig, folder: Path, report: Report) -> None:
    """Train to the end, from the folder's last checkpoint if it has one.

    Args:
        config: What to train.
        folder: The run's folder.
        report: Shown the progress.
    """
    torch.set_num_threads(1)  # small networks: more threads only wait, and sums keep their order
    set_random_seed(config.seed)
    native = gymnasium.make_vec(
        TASKS[config.task].env_id,
        num_envs=config.num_envs,
        vectorization_mode="vector_entry_point",
        settings=config.environment.settings,
        reality=config.environment.reality,
    )
    run = Run(config, NativeVecEnv(native, seed=config.environment_seed))
    try:
        run.model.set_logger(configure(str(folder / "tensorboard"), ["tensorboard"]))
        checkpoints = sorted((folder / "checkpoints").glob("*.pt"))
        if checkpoints:
            run.restore(load_checkpoint(checkpoints[-1]))
        recorder = Recorder(run, folder, report)
        run.model.learn(
            config.steps - run.model.num_timesteps, callback=recorder, reset_num_timesteps=not checkpoints
        )
    except ValueError as error:
        if "of distribution" not in str(error):  # torch's words for actions that cannot be drawn
            raise
        raise DivergedError(run.model.num_timesteps) from error
    finally:
        run.environment.close()


class Run:
    """The parts of a training run, and their state as a whole.

    Attributes:
        model: The learner.
        environment: The training environments.
        normaliser: Normalises what they give.
        best: Steps and mean return of the best validation so far.
    """

    def __init__(self, config: TrainConfig, environment: NativeVecEnv) -> None:
        ppo = config.ppo
        self.config, self.environment = config, environment
        self.best: tuple[int, float] = (0, -np.inf)
        self.normaliser = VecNormalize(
            environment,
            norm_obs=config.normalise.observation,
            norm_reward=config.normalise.reward,
            clip_obs=config.normalise.clip,
            clip_reward=config.normalise.clip,
            gamma=ppo.gamma,
        )
        self._shuffle = np.random.default_rng(config.seed)
        self.model = PPO(
            "MlpPolicy",
            self.normaliser,
            learning_rate=_schedule(ppo.learning_rate, ppo.learning_rate_decay),
            rollout_buffer_class=RealRolloutBuffer,
            rollout_buffer_kwargs={"environment": environment, "rng": self._shuffle},
            policy_kwargs={
                "net_arch": list(config.network.hidden),
                "activation_fn": ACTIVATIONS[config.network.activation],
                "log_std_init": config.network.log_std_init,
            },
            device="cpu",
            **ppo.model_dump(exclude={"learning_rate", "learning_rate_decay"}),
        )

    @property
    def policy(self) -> ActorCriticPolicy:
        """The policy that is being trained."""
        return self.model.policy

    def state(self) -> dict[str, Any]:
        """All that the next update depends on."""
        model, normaliser = self.model, self.normaliser
        return {
            "steps": model.num_timesteps,
            "epochs": model._n_updates,
            "policy": self.policy.state_dict(),
            "optimiser": self.policy.optimizer.state_dict(),
            "observation": model._last_obs,
            "episode_starts": model._last_episode_starts,
            "episodes": list(model.ep_info_buffer or ()),
            "observation_statistics": _statistics(normaliser.obs_rms) if normaliser.norm_obs else None,
            "return_statistics": _statistics(normaliser.ret_rms),
            "returns": normaliser.returns,
            "environment": self.environment.get_state(),
            "shuffle": self._shuffle.bit_generator.state,
            "random": random_state(),
            "best": self.best,
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from a state that `state` gave, after a round trip through a file."""
        model, normaliser = self.model, self.normaliser
        model.learn(0, reset_num_timesteps=True)  # has the library set up what it sets up only here
        model.num_timesteps = state["steps"]
        model._n_updates = state["epochs"]
        self.policy.load_state_dict(state["policy"])
        self.policy.optimizer.load_state_dict(state["optimiser"])
        model._last_obs = state["observation"].numpy()
        model._last_episode_starts = state["episode_starts"].numpy()
        assert model.ep_info_buffer is not None
        model.ep_info_buffer.extend(state["episodes"])
        if normaliser.norm_obs:
            _restore_statistics(normaliser.obs_rms, state["observation_statistics"])
        _restore_statistics(normaliser.ret_rms, state["return_statistics"])
        normaliser.returns = state["returns"].numpy()
        self.environment.set_state(to_arrays(state["environment"]))
        self._shuffle.bit_generator.state = state["shuffle"]
        self.best = (state["best"][0], state["best"][1])
        restore_random_state(state["random"])  # last, since building the rest draws from these streams


class Recorder(BaseCallback):
    """After each update: the learning curve; now and then a validation, the best policy, a checkpoint."""

    def __init__(self, run: Run, folder: Path, report: Report) -> None:
        super().__init__()
        self._run, self._folder, self._report = run, folder, report
        self._begun = run.model.num_timesteps
        self._clock = time.monotonic()
        self._metric = METRICS[run.config.task][0].name
        self._curve: list[dict[str, Any]] = []
        path = folder / "curve.csv"
        if self._begun and path.is_file():
            rows = csv.DictReader(io.StringIO(path.read_text(encoding="utf-8")))
            self._curve = [row for row in rows if int(row["steps"]) <= self._begun]

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        if self.model.num_timesteps > self._begun:
            self._after_update(last=False)

    def _on_training_end(self) -> None:
        if self.model.num_timesteps > self._begun:
            self._after_update(last=True)
        steps, score = self._run.best
        result = {
            "steps": self.model.num_timesteps,
            "best_steps": steps,
            "validation_return": score,
            "seconds": round(time.monotonic() - self._clock, 1),
        }
        write_text(self._folder / "run.json", json.dumps(result, indent=2) + "\n")
        self.logger.dump(self.model.num_timesteps)

    def _after_update(self, last: bool) -> None:
        config, steps = self._run.config, self.model.num_timesteps
        update = steps // (config.ppo.n_steps * config.num_envs)
        row: dict[str, Any] = {
            "steps": steps,
            "training_return": float(safe_mean([e["r"] for e in self.model.ep_info_buffer or ()])),
        }
        for name in LOGGED:
            row[name] = float(self.logger.name_to_value.get(f"train/{name}", np.nan))
        if last or update % config.validation.every == 0:
            row |= self._validate()
        self._curve.append(row)
        self._write_curve()
        if last or update % config.checkpoint_every == 0:
            self._save_checkpoint()
        best = f"best return {self._run.best[1]:.4g}" if self._run.best[0] else "training"
        self._report(best, min(steps / config.steps, 1.0))

    def _validate(self) -> dict[str, float]:
        """Score the policy as it would be shipped; keep it if it is the best so far."""
        run, config, steps = self._run, self._run.config, self.model.num_timesteps
        note = f"{config.task}, {config.algorithm}, seed {config.seed}, {steps} steps"
        policy = to_onnx(run.policy, run.normaliser, note)
        seeds = VALIDATION_SEEDS[: config.validation.episodes]
        episodes = run_episodes(OnnxAgent(policy), config.task, config.environment, seeds)
        score = float(episodes["return"].mean())
        scores = {
            "validation_return": score,
            f"validation_{self._metric}": float(episodes[self._metric].mean()),
        }
        for name, value in scores.items():
            self.logger.record(f"validation/{name.removeprefix('validation_')}", value)
        if score > run.best[1]:
            run.best = (steps, score)
            write_bytes(self._folder / "policy.onnx", policy)
        return scores

    def _write_curve(self) -> None:
        stream = io.StringIO()
        writer = csv.DictWriter(stream, [*CURVE, f"validation_{self._metric}"], lineterminator="\n")
        writer.writeheader()
        writer.writerows(self._curve)
        write_text(self._folder / "curve.csv", stream.getvalue())

    def _save_checkpoint(self) -> None:
        folder = self._folder / "checkpoints"
        save_checkpoint(self._run.state(), folder / f"{self.model.num_timesteps:012d}.pt")
        for old in sorted(folder.glob("*.pt"))[:-CHECKPOINTS_KEPT]:
            old.unlink()


def _schedule(rate: float, decay: str) -> float | Callable[[float], float]:
    """The learning rate over the remaining part of the training, 1 to 0."""
    return (lambda remaining: rate * remaining) if decay == "linear" else rate


def _statistics(statistics: Any) -> list[Any]:
    running = cast(RunningMeanStd, statistics)
    return [np.asarray(running.mean), np.asarray(running.var), float(running.count)]


def _restore_statistics(statistics: Any, saved: list[Any]) -> None:
    statistics.mean, statistics.var, statistics.count = saved[0].numpy(), saved[1].numpy(), saved[2]
