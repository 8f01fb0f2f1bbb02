"""Search of hyper-parameters by Optuna, batch by batch, so that its result depends on no clock."""

from __future__ import annotations

import json
import warnings
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fieldagents.learned.config import TrainConfig
from fieldagents.progress import Report
from fieldagents.sweep.config import TuneConfig, changed
from fieldagents.sweep.jobs import label, score_job, train_job
from fieldagents.task import get_task
from fieldmodels.engine import HERE, Done, Engine, Job, JobsFailedError, run_jobs
from fieldmodels.extras import needed
from fieldmodels.files import write_text
from fieldmodels.sampling import Choice, LogUniform
from fieldmodels.yaml import save_yaml

DIVERGED = "DivergedError"  # of the session, which is not imported here for torch's sake


@dataclass(frozen=True)
class Trial:
    """Values that were tried.

    Attributes:
        study: Of which search.
        values: The values; empty for the config as it is.
        scores: The task's first metric after each rung; None without a value.
        steps: Environment steps that it took.
        pruned: Whether it was not trained to the end.
    """

    study: str
    values: dict[str, Any]
    scores: tuple[float | None, ...]
    steps: int
    pruned: bool


@dataclass
class _Open:
    """A trial under way; without Optuna's trial, the config as it is."""

    values: dict[str, Any]
    trial: Any = None
    scores: tuple[float | None, ...] = ()
    steps: int = 0


def tune(
    config: TuneConfig, out: Path, progress: Report = lambda _stage, _part: None, engine: Engine = HERE
) -> dict[str, list[Trial]]:
    """Search; writes ``tune.json`` and, for each study that varies a config, the best one: ``<study>.yaml``.

    The same command goes on with an interrupted search: what was trained is not trained again.

    Args:
        config: What to search, and how long.
        out: Result folder.
        progress: Called with what is being done and the part of its budget that a study has used.
        engine: Who does the trials.

    Returns:
        Study to its trials, in the order in which they were drawn.

    Raises:
        MissingExtraError: Without Optuna.
        JobsFailedError: If some trials failed; the others are kept.
    """
    optuna = needed("optuna")
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    found = {}
    for name, study in config.studies.items():
        search = _Search(name, config, out, engine, progress)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
            found[name] = search.run(optuna)
        if study.train is not None:
            best = search.best_of(found[name])
            save_yaml(search.trained(best.values, 0).model_dump(mode="json"), out / f"{name}.yaml")
    metric = get_task(config.task).metrics[0]
    plain = {
        "schema": 1,
        "metric": asdict(metric),
        "budget": config.budget,
        "studies": {name: [asdict(trial) for trial in trials] for name, trials in found.items()},
    }
    write_text(out / "tune.json", json.dumps(plain, indent=1, allow_nan=False) + "\n")
    return found


class _Search:
    """One study."""

    def __init__(self, name: str, config: TuneConfig, out: Path, engine: Engine, progress: Report) -> None:
        self._name, self._config, self._engine, self._report = name, config, engine, progress
        self._study = study = config.studies[name]
        self._folder = out / "jobs" / name
        self._lower = get_task(config.task).metrics[0].lower_is_better
        self._rungs = (*config.rungs, 1.0) if study.train is not None and config.pruner != "none" else (1.0,)
        self._used = 0

    def run(self, optuna: Any) -> list[Trial]:
        """Draw and do batches until the next trial could exceed the budget."""
        config = self._config
        done: list[Trial] = []
        study = optuna.create_study(
            direction="minimize" if self._lower else "maximize",
            sampler=optuna.samplers.TPESampler(seed=config.seed, constant_liar=True)
            if config.sampler == "tpe"
            else optuna.samplers.RandomSampler(seed=config.seed),
            pruner={
                "halving": optuna.pruners.SuccessiveHalvingPruner(min_resource=1, reduction_factor=2),
                "median": optuna.pruners.MedianPruner(n_startup_trials=config.batch),
                "none": optuna.pruners.NopPruner(),
            }[config.pruner],
        )
        batch = [_Open({})] if self._study.train is not None else []  # the config as it is, to compare with
        while True:
            room = (config.budget - self._used) // self._most(done) - len(batch)
            batch += [self._drawn(study.ask()) for _ in range(min(config.batch - len(batch), room))]
            if not batch:
                return done
            done += self._carried_out(batch, study, optuna)
            batch = []

    def best_of(self, trials: list[Trial]) -> Trial:
        """The best that was trained to the end."""
        whole = [trial for trial in trials if not trial.pruned]
        return min(whole, key=lambda trial: self._loss(trial.scores[-1]))

    def trained(self, values: dict[str, Any], seed: int) -> TrainConfig:
        """The config of a trial's run."""
        study, config = self._study, self._config
        assert study.train is not None
        whole = changed(study.train, study.change | values | {"seed": seed})
        validation = whole.validation.model_copy(update={"episodes": config.episodes})
        return whole.model_copy(
            update={"environment": config.environment, "validation": validation, "name": self._name}
        )

    def _drawn(self, trial: Any) -> _Open:
        values: dict[str, Any] = {}
        for key, sampler in self._study.space.items():
            if isinstance(sampler, Choice):
                places = list(range(len(sampler.values)))  # Optuna takes no lists for choices
                values[key] = sampler.values[trial.suggest_categorical(key, places)]
            else:
                log = isinstance(sampler, LogUniform)
                low, high = sampler.as_mapping()[sampler.kind]
                values[key] = trial.suggest_float(key, low, high, log=log)
        return _Open(values, trial)

    def _carried_out(self, batch: list[_Open], study: Any, optuna: Any) -> list[Trial]:
        """Do a batch, rung by rung, with what the pruner leaves of it."""
        alive = list(batch)
        for number, rung in enumerate(self._rungs, 1):
            jobs = {job: one for one in alive for job in self._jobs(one, rung)}
            results: dict[int, list[Any]] = {}
            for done in sorted(self._done(list(jobs)), key=lambda done: list(jobs).index(done.job)):
                results.setdefault(id(jobs[done.job]), []).append(done.result)
            for one in alive:
                parts = results[id(one)]
                steps = sum(part["steps"] for part in parts)
                self._used, one.steps = self._used + steps - one.steps, steps
                scores = [part["score"] for part in parts]
                mean = float(np.mean(scores)) if np.isfinite([*map(self._loss, scores)]).all() else None
                one.scores += (mean,)
                if one.trial is not None:
                    one.trial.report(self._told(mean), number)
            if rung < 1.0:
                pruned = [one for one in alive if one.trial is not None and one.trial.should_prune()]
                for one in pruned:
                    study.tell(one.trial, state=optuna.trial.TrialState.PRUNED)
                alive = [one for one in alive if one not in pruned]
        for one in alive:
            if one.trial is not None:
                study.tell(one.trial, self._told(one.scores[-1]))
        return [Trial(self._name, one.values, one.scores, one.steps, one not in alive) for one in batch]

    def _done(self, jobs: list[Job]) -> list[Done]:
        """The jobs' results; a training run that lost itself has no score and has used up its steps.

        Raises:
            JobsFailedError: If one failed in another way.
        """
        done = list(run_jobs(jobs, self._engine, self._shown))
        lost = {"steps": self.trained({}, 0).steps, "score": None} if self._study.train else None
        done = [replace(d, error="", result=lost) if d.error.startswith(DIVERGED) else d for d in done]
        if any(one.error for one in done):
            raise JobsFailedError(done)
        return done

    def _jobs(self, one: _Open, rung: float) -> list[Job]:
        if self._study.agent is not None:
            config = self._config
            place = (config.task, config.environment, config.episodes, self._folder)
            return [score_job(self._study.agent, one.values, *place)]
        configs = [self.trained(one.values, seed) for seed in range(self._study.seeds)]
        name = label(one.values) or "as it is"
        return [train_job(c, name, self._folder, round(rung * c.steps)) for c in configs]

    def _most(self, done: list[Trial]) -> int:
        """The steps that a trial can take; of an agent, known after the first, which is done alone."""
        if self._study.train is None:
            return max((one.steps for one in done), default=self._config.budget)
        return self._study.seeds * self.trained({}, 0).steps

    def _loss(self, score: float | None) -> float:
        return np.inf if score is None else score if self._lower else -score

    def _told(self, score: float | None) -> float:
        """What Optuna is told; it takes no infinity for a number to learn from."""
        worst = 1e12 if self._lower else -1e12
        return worst if score is None else score

    def _shown(self, stage: str, part: float) -> None:
        del part
        self._report(f"{self._name}: {stage}", min(1.0, self._used / self._config.budget))
