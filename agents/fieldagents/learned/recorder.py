"""What is written while a run is under way: curve, best policy, checkpoints, result."""

from __future__ import annotations

import csv
import io
import json
import math
import pickle
import time
from collections.abc import Callable, Sequence
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.utils import safe_mean

from fieldagents.evaluation.episodes import run_episodes
from fieldagents.learned.checkpoint import CheckpointError, checkpoints, save_checkpoint
from fieldagents.learned.conditioning import as_trained, conditions_in
from fieldagents.learned.config import VALIDATION_SEEDS
from fieldagents.learned.export import to_onnx
from fieldagents.learned.run import Best, Run
from fieldagents.policies.algorithms import LIBRARIES
from fieldagents.policies.policy import OnnxAgent
from fieldagents.progress import Report, stages
from fieldagents.task import get_task
from fieldmodels.files import write_bytes, write_text

CHECKPOINTS_KEPT = 3
LEAST_SCORES = 10
"""Validations before a plateau is looked for."""


class PausedError(Exception):
    """Training has come as far as it was asked to, and has a checkpoint there."""


class Recorder(BaseCallback):
    """After each round: the learning curve; now and then a validation, the best policy, a checkpoint.

    A round is a row of the learning curve: some updates, see ``TrainConfig.round_updates``. With ``until`` it
    pauses after the first round with as many steps; ``stop`` says whether to end after this round.
    """

    def __init__(
        self,
        run: Run,
        folder: Path,
        report: Report,
        resumed: bool,
        until: int | None = None,
        stop: Callable[[], bool] = lambda: False,
    ) -> None:
        super().__init__()
        self._until, self._stop = until, stop
        self._run, self._folder, self._report = run, folder, report
        self._begun = run.model.num_timesteps
        self._clock, self._processor = time.monotonic(), time.process_time()
        self._metric = get_task(run.config.task).metrics[0].name
        self._scored = math.nan
        self._ended = "steps"
        self._columns = ("steps", "training_return", *run.logged, "validation_return")
        self._curve: list[dict[str, Any]] = []
        path = folder / "curve.csv"
        if resumed and path.is_file():
            try:
                rows = csv.DictReader(io.StringIO(path.read_text(encoding="utf-8")))
                self._curve = [row for row in rows if int(row["steps"]) <= self._begun]
            except (KeyError, TypeError, ValueError) as error:
                raise CheckpointError(
                    f"{path}: not the learning curve of this run ({error!r}); delete it to go on without"
                ) from None

    def _on_step(self) -> bool:
        return self._ended == "steps"

    def _on_rollout_start(self) -> None:
        steps = self.model.num_timesteps
        new = steps > self._begun and steps % self._run.config.round_steps == 0
        if new:
            self._after_round(last=False)
        if self._run.config.validation.until_plateau and plateau(self._run.validated):
            self._ended = "plateau"  # the next step says so to the learner
        if new and (self._stop() or (self._until is not None and steps >= self._until)):
            self._save_checkpoint()
            raise KeyboardInterrupt if self._stop() else PausedError
        self._run.let_learn()

    def _on_training_end(self) -> None:
        if self.model.num_timesteps > self._begun and self._ended == "steps":
            self._after_round(last=True)
        best = self._run.best
        assert best is not None
        result = {
            "steps": int(self._curve[-1]["steps"]),
            "ended": self._ended,
            "plateau": plateau(self._run.validated),
            "best_steps": best.steps,
            "validation_return": best.mean_return,
            "seconds": round(time.monotonic() - self._clock, 1),
            "processor_seconds": round(time.process_time() - self._processor, 1),
        }
        write_text(self._folder / "run.json", json.dumps(result, indent=2) + "\n")

    def _after_round(self, last: bool) -> None:
        config, steps = self._run.config, self.model.num_timesteps
        number = steps // config.round_steps
        returns = [episode["r"] for episode in self.model.ep_info_buffer or ()]
        latest = float(safe_mean(returns)) if returns else math.nan
        self.logger.record("rollout/ep_rew_mean", latest)
        row: dict[str, Any] = {"steps": steps, "training_return": latest}
        for name in self._run.logged:
            row[name] = float(self.logger.name_to_value.get(f"train/{name}", np.nan))
        if last or number % config.validation.every == 0:
            row |= self._validate()
        self._curve.append(row)
        self._write_curve()
        if last or number % config.checkpoint_every == 0:
            self._save_checkpoint()
        self.logger.dump(steps)
        self._scored = row.get(f"validation_{self._metric}", self._scored)
        self._report(self._words(latest), self._part)

    def _words(self, latest: float) -> str:
        """Where training stands, as the users of Stable-Baselines3 know it."""
        steps, seconds = self.model.num_timesteps, time.monotonic() - self._clock
        rate = (steps - self._begun) / max(seconds, 1e-9)
        words = [
            f"{steps:,} steps",
            f"{rate:,.0f} a second",
            *([] if math.isnan(latest) else [f"return {latest:.4g}"]),
        ]
        if not math.isnan(self._scored):
            words.append(f"{self._metric} {self._scored:.4g}")
        if rate > 0.0 and steps < self._run.config.steps:
            words.append(f"{timedelta(seconds=round((self._run.config.steps - steps) / rate))} left")
        return "training: " + ", ".join(words)

    @property
    def _part(self) -> float:
        """Of the steps, done so far."""
        steps = self._run.config.steps
        return min(self.model.num_timesteps / steps, 1.0) if steps else 1.0

    def after_imitation(self) -> None:
        """Record the policy that imitates, before it learns by reward."""
        self._after_round(last=True)

    def _validate(self) -> dict[str, float]:
        """Score the policy as it would be shipped; keep it if it is the best so far."""
        run, config, steps = self._run, self._run.config, self.model.num_timesteps
        note = f"{config.task}, {config.algorithm}, seed {config.seed}, {steps} steps"
        policy = to_onnx(run.policy, run.normaliser, note, config.stack, run.featured, conditions_in(config))
        seeds, say = VALIDATION_SEEDS[: config.validation.episodes], stages(self._report, self._part)
        episodes = pd.concat(
            run_episodes(as_trained(OnnxAgent(policy)), config.task, one, seeds, say)
            for one in config.environments
        )
        mean_return = float(episodes["return"].mean())
        scores = {"return": mean_return, self._metric: float(episodes[self._metric].mean())}
        for name, value in scores.items():
            self.logger.record(f"validation/{name}", value)
        rank = [*(_ranks(episodes, config.task) if config.validation.by == "metric" else ()), mean_return]
        run.validated.append((steps, episodes["return"].tolist()))
        if run.best is None or rank > run.best.rank:
            run.best = Best(steps, mean_return, rank)
            write_bytes(self._folder / "policy.onnx", policy)
            self._save_for_sb3()
        return {f"validation_{name}": value for name, value in scores.items()}

    def _save_for_sb3(self) -> None:
        """Keep the best policy as the library saves it, too, where that is all that it takes to act."""
        run, library = self._run, type(self.model).__module__.partition(".")[0]
        more = run.config.stack > 1 or run.featured is not None or conditions_in(run.config)
        if library not in LIBRARIES or more:
            return
        saved = io.BytesIO()
        run.model.save(saved)
        write_bytes(self._folder / "policy.zip", saved.getvalue())
        write_bytes(self._folder / "vecnormalize.pkl", pickle.dumps(run.normaliser))

    def _write_curve(self) -> None:
        stream = io.StringIO()
        writer = csv.DictWriter(stream, [*self._columns, f"validation_{self._metric}"], lineterminator="\n")
        writer.writeheader()
        writer.writerows(self._curve)
        write_text(self._folder / "curve.csv", stream.getvalue())

    def _save_checkpoint(self) -> None:
        folder = self._folder / "checkpoints"
        save_checkpoint(self._run.state(), folder / f"{self.model.num_timesteps:012d}.pt")
        for old in checkpoints(folder)[:-CHECKPOINTS_KEPT]:
            old.unlink()


def plateau(validated: Sequence[tuple[int, Sequence[float]]]) -> bool:
    """Whether training has come to a plateau, see ``ValidationConfig.until_plateau``.

    The last third is compared with the third before it, episode by episode, each the mean over its scores.

    Args:
        validated: Steps of each validation, and the returns of its episodes, the same seeds each time.
    """
    if len(validated) < LEAST_SCORES:
        return False  # too early to tell
    now = validated[-1][0]
    later = [returns for steps, returns in validated if 3 * steps > 2 * now]
    before = [returns for steps, returns in validated if now < 3 * steps <= 2 * now]
    if not before:
        return False
    gained = np.mean(later, axis=0) - np.mean(before, axis=0)
    half = 1.96 * float(gained.std(ddof=1)) / math.sqrt(len(gained)) if len(gained) > 1 else 0.0
    return float(gained.mean()) < half


def _ranks(episodes: pd.DataFrame, task: str) -> list[float]:
    """The task's metrics that depend on the agent, each so that more is better; without a value worst."""
    metrics = [metric for metric in get_task(task).metrics if not metric.common]
    means = [(-1 if metric.lower_is_better else 1) * episodes[metric.name].mean() for metric in metrics]
    return [-math.inf if math.isnan(mean) else float(mean) for mean in means]
