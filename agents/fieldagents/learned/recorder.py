"""What is written while a run is under way: curve, best policy, checkpoints, result."""

from __future__ import annotations

import csv
import io
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.utils import safe_mean

from fieldagents.evaluation.episodes import run_episodes
from fieldagents.learned.checkpoint import save_checkpoint
from fieldagents.learned.config import VALIDATION_SEEDS
from fieldagents.learned.export import to_onnx
from fieldagents.learned.run import Run
from fieldagents.policies.policy import OnnxAgent
from fieldagents.progress import Report
from fieldagents.task import get_task
from fieldmodels.files import write_bytes, write_text

CHECKPOINTS_KEPT = 3


class Recorder(BaseCallback):
    """After each round: the learning curve; now and then a validation, the best policy, a checkpoint.

    A round is a row of the learning curve: some updates, see ``TrainConfig.round_updates``.
    """

    def __init__(self, run: Run, folder: Path, report: Report) -> None:
        super().__init__()
        self._run, self._folder, self._report = run, folder, report
        self._begun = run.model.num_timesteps
        self._clock = time.monotonic()
        self._metric = get_task(run.config.task).metrics[0].name
        self._columns = ("steps", "training_return", *run.logged, "validation_return")
        self._curve: list[dict[str, Any]] = []
        path = folder / "curve.csv"
        if self._begun and path.is_file():
            rows = csv.DictReader(io.StringIO(path.read_text(encoding="utf-8")))
            self._curve = [row for row in rows if int(row["steps"]) <= self._begun]

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        steps = self.model.num_timesteps
        if steps > self._begun and steps % self._run.config.round_steps == 0:
            self._after_round(last=False)

    def _on_training_end(self) -> None:
        if self.model.num_timesteps > self._begun:
            self._after_round(last=True)
        steps, score = self._run.best
        result = {
            "steps": self.model.num_timesteps,
            "best_steps": steps,
            "validation_return": score,
            "seconds": round(time.monotonic() - self._clock, 1),
        }
        write_text(self._folder / "run.json", json.dumps(result, indent=2) + "\n")

    def _after_round(self, last: bool) -> None:
        config, steps = self._run.config, self.model.num_timesteps
        number = steps // config.round_steps
        latest = float(safe_mean([episode["r"] for episode in self.model.ep_info_buffer or ()]))
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
        best = f"best return {self._run.best[1]:.4g}" if self._run.best[0] else "training"
        self._report(best, min(steps / config.steps, 1.0))

    def _validate(self) -> dict[str, float]:
        """Score the policy as it would be shipped; keep it if it is the best so far."""
        run, config, steps = self._run, self._run.config, self.model.num_timesteps
        note = f"{config.task}, {config.algorithm}, seed {config.seed}, {steps} steps"
        policy = to_onnx(run.policy, run.normaliser, note, config.stack)
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
        writer = csv.DictWriter(stream, [*self._columns, f"validation_{self._metric}"], lineterminator="\n")
        writer.writeheader()
        writer.writerows(self._curve)
        write_text(self._folder / "curve.csv", stream.getvalue())

    def _save_checkpoint(self) -> None:
        folder = self._folder / "checkpoints"
        save_checkpoint(self._run.state(), folder / f"{self.model.num_timesteps:012d}.pt")
        for old in sorted(folder.glob("*.pt"))[:-CHECKPOINTS_KEPT]:
            old.unlink()
