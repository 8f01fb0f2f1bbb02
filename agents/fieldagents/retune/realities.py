"""The loop closed in many drawn realities, and what that recovers of the loss in all of them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from fieldagents.evaluation.evaluate import check_pairs
from fieldagents.progress import Report
from fieldagents.retune import reality
from fieldagents.retune.config import RealitiesConfig
from fieldagents.retune.loop import RESAMPLING_SEED
from fieldagents.retune.recovery import Recovery, pooled_recovery, recovery
from fieldagents.retune.result import NOMINAL, ORACLE, RETUNED
from fieldagents.retune.trained import Conditioning, code_behind, tuner_of
from fieldagents.task import Metric, get_task
from fieldmodels import html
from fieldmodels.arrays import FloatArray
from fieldmodels.engine import HERE, Engine, Job, run_all
from fieldmodels.files import replacing, write_text

if TYPE_CHECKING:
    from rich.console import Console

TUNED = (
    "if tuned in the nominal simulation",
    "if tuned by the diagnosis of each",
    "if tuned in the reality itself (the oracle)",
)
CONDITIONED = {
    given: ("by the nominal agent", f"if given {what}", "if given the truth (the oracle)")
    for given, what in ((True, "the diagnosis of each"), (False, "nothing"))
}
"""What the three agents are, in words."""
FILES = ("realities.json", "realities.parquet", "realities.html")


@dataclass(frozen=True)
class Closed:
    """The loop in one reality.

    Attributes:
        hidden: The faults that were drawn.
        verdict: Of the diagnosis.
        named: The effects that it named, with their values.
        skipped: Why there was nothing to tune with, so that the nominal agent stays; empty otherwise.
        means: Agent to its mean score.
        recovered: Share of this reality's loss, with an interval over its episodes.
        seconds: Processor time of the diagnosis and of each agent's tuning [s].
    """

    hidden: Mapping[str, Mapping[str, float]]
    verdict: str
    named: Mapping[str, Mapping[str, float]]
    skipped: str
    means: Mapping[str, float]
    recovered: Recovery
    seconds: Mapping[str, float]


@dataclass(frozen=True)
class Realities:
    """What a diagnosis wins back over drawn realities.

    Attributes:
        name: Name of the config.
        task: Name of the task.
        agent: Name of what is tuned.
        title: How it is tuned.
        roles: What nominal agent, re-tuned agent and oracle are, in words.
        metric: By which the loss is counted.
        episodes: Of every agent in each reality.
        seeds: Where the seeds are from.
        recovered: What is recovered in all realities over what is lost in all.
        of_runs: What each training run of a policy recovers; all other scores are means over the runs.
        closed: Each reality.
    """

    name: str
    task: str
    agent: str
    title: str
    roles: tuple[str, str, str]
    metric: Metric
    episodes: int
    seeds: str
    recovered: Recovery
    of_runs: tuple[float | None, ...]
    closed: tuple[Closed, ...]

    def mean(self, agent: str) -> float:
        """An agent's mean score over the realities."""
        return float(np.mean([one.means[agent] for one in self.closed]))

    def to_json(self) -> dict[str, Any]:
        """The content of ``realities.json``."""
        return {"schema": 1, **asdict(self), "summary": self.sentence()}

    def sentence(self) -> str:
        """What came out, in plain words."""
        scale, unit = (100, "%") if self.metric.binary else (1, self.metric.unit)
        said = {name: f"{scale * self.mean(name):.4g}" for name in (NOMINAL, RETUNED, ORACLE)}
        how = self.roles
        begin = (
            f"{self.metric.title} of {self.agent} over {len(self.closed)} drawn realities: "
            f"{said[NOMINAL]} {unit} {how[0]}, {said[RETUNED]} {how[1]}, {said[ORACLE]} {how[2]}"
        )
        if self.recovered.share is None or self.recovered.ci95 is None:
            return f"{begin}. Nothing to recover: the oracle is not better than the nominal agent."
        low, high = (100 * end for end in self.recovered.ci95)
        share = f"{100 * self.recovered.share:.1f} % of the loss recovered"
        runs = [100 * one for one in self.of_runs if one is not None]
        single = f"; single training runs {min(runs):.1f} to {max(runs):.1f} %" if len(runs) > 1 else ""
        return f"{begin}: {share} (95 % interval {low:.1f} to {high:.1f}){single}."


def close_loops(
    config: RealitiesConfig,
    out: Path,
    progress: Report = lambda _stage, _part: None,
    engine: Engine = HERE,
) -> Realities:
    """Close the loop in each drawn reality and write ``realities.json``, ``.parquet`` and ``.html``.

    Each reality is a job; ``jobs/`` keeps those that are done, also for a config that asks for more of them.

    Args:
        config: Task, agent, faults to draw, recording, effort.
        out: Result folder; files appear whole or not at all.
        progress: Called with what is being done and the part of the whole that is done.
        engine: Who does the jobs.

    Raises:
        JobsFailedError: If some jobs failed; the others are kept.
        EvaluationError: If two agents did not meet the same noise on the same seed.
    """
    done = run_all(
        [_job(config, number, out / "jobs") for number in range(config.realities)], engine, progress
    )
    tables = []
    for number, one in enumerate(done):
        assert one.job.folder is not None
        tables.append(pd.read_parquet(one.job.folder / reality.EPISODES).assign(scenario=f"reality {number}"))
    episodes = pd.concat(tables, ignore_index=True)
    check_pairs(episodes, config.task)
    task = get_task(config.task)
    metric = next(one for one in task.metrics if one.name == config.counted)
    scores = {
        str(name): own[metric.name].to_numpy(dtype=np.float64).reshape(config.realities, -1, config.episodes)
        for name, own in episodes.groupby("agent")
    }
    roles = NOMINAL, RETUNED, ORACLE
    of_runs = [_share(*(scores[name][:, run] for name in roles)) for run in range(scores[RETUNED].shape[1])]
    scores = {name: own.mean(axis=1) for name, own in scores.items()}
    how = {"lower_is_better": metric.lower_is_better}

    def closed(number: int, told: dict[str, Any]) -> Closed:
        own = [scores[name][number] for name in roles]
        rng = np.random.default_rng(RESAMPLING_SEED)
        means = {name: float(scores[name][number].mean()) for name in scores}
        return Closed(**told, means=means, recovered=recovery(*own, **how, binary=metric.binary, rng=rng))

    tuner = tuner_of(config.task, config.agent)
    result = Realities(
        name=config.name,
        task=config.task,
        agent=config.agent,
        title=tuner.title,
        roles=CONDITIONED[Conditioning(**config.options).conditioned] if tuner.conditioned else TUNED,
        metric=metric,
        episodes=config.episodes,
        seeds=config.seeds,
        recovered=pooled_recovery(
            *(scores[name] for name in roles),
            **how,
            rng=np.random.default_rng(RESAMPLING_SEED),
        ),
        of_runs=tuple(of_runs),
        closed=tuple(closed(number, one.result) for number, one in enumerate(done)),
    )
    with replacing(out / "realities.parquet") as temporary:
        episodes.to_parquet(temporary, index=False)
    write_text(out / "realities.json", json.dumps(result.to_json(), indent=1, allow_nan=False) + "\n")
    body = f'<p class="lead">{html.text(result.sentence())}</p>' + html.table(HEADER, rows(result), NOTE)
    write_text(out / "realities.html", html.page(f"Drawn realities: {config.name}", body))
    return result


def _share(nominal: FloatArray, retuned: FloatArray, oracle: FloatArray) -> float | None:
    """What one training run recovers in all realities over what is lost in all."""
    loss = (nominal - oracle).mean()
    return float((nominal - retuned).mean() / loss) if loss else None


def _job(config: RealitiesConfig, number: int, folder: Path) -> Job:
    """The loop in one reality; how many others there are changes nothing."""
    own = config.model_dump(mode="json", exclude={"name", "realities", "metric"})
    parts = [own, number, *code_behind(config.task, config.agent, config.options, reality.__name__)]
    key = hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:16]
    return Job(key, f"reality {number}", reality.close, (config, number), folder / key)


HEADER = ("reality", "diagnosis", NOMINAL, "re-tuned", ORACLE, "recovered")
NOTE = (
    "Mean scores in each reality. Recovered: the share of this reality's loss; none where the oracle is not "
    "better than the nominal agent."
)


def rows(result: Realities) -> list[list[str]]:
    """The realities for people."""
    scale = 100.0 if result.metric.binary else 1.0
    return [
        [
            effects(one.hidden),
            one.verdict if one.skipped else effects(one.named),
            *(f"{scale * one.means[name]:.4g}" for name in (NOMINAL, RETUNED, ORACLE)),
            "–" if one.recovered.share is None else f"{100 * one.recovered.share:.0f} %",
        ]
        for one in result.closed
    ]


def effects(values: Mapping[str, Mapping[str, float]]) -> str:
    """Effects and their parameters in a line."""
    return "; ".join(
        f"{name} {', '.join(f'{key} {value:.3g}' for key, value in own.items())}"
        for name, own in values.items()
    )


def show(result: Realities, console: Console) -> None:
    """Print what came out."""
    from rich.table import Table

    table = Table(*HEADER)
    for row in rows(result):
        table.add_row(*row)
    console.print(table)
    console.print(result.sentence(), markup=False)
