"""Several evaluations in one table: who closes how much of the gap to the ceiling."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import pandas as pd
from pydantic import Field

from fieldagents.config import Config, ConfigError, Name, Problems, checked, load_config
from fieldagents.evaluation.comparison import Interval
from fieldagents.evaluation.config import EvaluateConfig
from fieldagents.evaluation.evaluate import evaluate
from fieldagents.evaluation.summary import Row, Summary
from fieldagents.progress import Report
from fieldagents.task import get_task
from fieldmodels import html
from fieldmodels.engine import HERE, Engine, JobsFailedError
from fieldmodels.files import write_text
from fieldmodels.names import did_you_mean

if TYPE_CHECKING:
    from rich.console import Console

ENOUGH = 0.9
"""Part of its episodes that must have a value where an agent's gap is given: few arrive in the easy ones."""


class Member(Config):
    """How an evaluation enters the table.

    Attributes:
        metric: Metric of the gap; by default the task's first.
        reference: Agent at 0 % of the gap; by default the evaluation's baseline.
        ceiling: Agent at 100 %, or a bound that is proven; by default the best privileged agent.
    """

    metric: str = ""
    reference: str = ""
    ceiling: str | float = ""


def _wrong_members(suite: dict[str, Member]) -> Problems:
    for name, member in suite.items():
        try:
            config = load_config(Path(name), EvaluateConfig)
        except ConfigError as error:
            yield from (((name,), one) for one in error.problems)
            continue
        metrics = [metric.name for metric in get_task(config.task).metrics]
        asked = [("metric", member.metric, metrics), ("reference", member.reference, config.agents)]
        if isinstance(member.ceiling, str):
            asked.append(("ceiling", member.ceiling, config.agents))
        for key, value, known in asked:
            if value and value not in known:
                yield (name, key), f"there is no {value!r}{did_you_mean(value, known)}"


class SuiteConfig(Config):
    """Several evaluations.

    Attributes:
        name: Name of the result folder.
        suite: Configs of evaluations, files or names of shipped ones, and how they enter the table.
        episodes: Of every agent, in place of what the evaluations say.
    """

    name: Name
    suite: Annotated[dict[str, Member], Field(min_length=1), checked(_wrong_members)]
    episodes: int | None = Field(default=None, ge=2, le=10_000)

    def members(self) -> dict[str, EvaluateConfig]:
        """Each evaluation's config."""
        changes = [] if self.episodes is None else [f"episodes={self.episodes}"]
        return {name: load_config(Path(name), EvaluateConfig, changes) for name in self.suite}


@dataclass(frozen=True)
class Line:
    """An agent in a scenario of the suite.

    Attributes:
        task: Name of the task.
        scenario: Name of the scenario.
        agent: Its name.
        sees: What it sees.
        runs: Number of its training runs.
        gap_closed: Part of the way from the reference to the ceiling; None where there is no such way, or
            too few episodes have a value.
        gap_ci95: Its interval where the reference is the baseline: that of the paired difference.
        metric: Name of the metric.
        mean: Mean of the metric over the episodes that have a value.
        ci95: Interval of the mean.
        share: Part of the episodes that have a value.
        verdict: Against the baseline, by the task's first metric; None for the baseline.
    """

    task: str
    scenario: str
    agent: str
    sees: str
    runs: int
    gap_closed: float | None
    gap_ci95: Interval | None
    metric: str
    mean: float | None
    ci95: Interval | None
    share: float
    verdict: str | None


def evaluate_suite(
    config: SuiteConfig, out: Path, progress: Report = lambda _stage, _part: None, engine: Engine = HERE
) -> list[Line]:
    """Run what is missing of all evaluations; writes ``suite.json``, ``suite.csv`` and ``report.html``.

    Each evaluation has a folder of its own below ``out``.

    Args:
        config: Which.
        out: Result folder.
        progress: Called with what is being done and the part of the whole that is done.
        engine: Who does the jobs.

    Raises:
        JobsFailedError: If some jobs failed, after all evaluations; what the others played is kept.
    """
    lines: list[Line] = []
    failed: list[JobsFailedError] = []
    members = config.members()
    for number, (name, member) in enumerate(members.items()):

        def within(stage: str, part: float, number: int = number, of: str = member.name) -> None:
            progress(f"{of}: {stage}", (number + part) / len(members))

        try:
            summary = evaluate(member, out / member.name, within, engine)
        except JobsFailedError as error:
            failed.append(error)
            continue
        lines += lines_of(summary, config.suite[name])
    if failed:
        raise JobsFailedError([done for error in failed for done in error.done])
    plain = {"schema": 1, "name": config.name, "lines": [asdict(line) for line in lines]}
    write_text(out / "suite.json", json.dumps(plain, indent=1, allow_nan=False) + "\n")
    write_text(out / "suite.csv", pd.DataFrame(map(asdict, lines)).to_csv(index=False, lineterminator="\n"))
    body = html.table(HEADER, [cells(line) for line in lines], NOTE)
    write_text(out / "report.html", html.page(f"fieldgym: {config.name}", body))
    return lines


def lines_of(summary: Summary, member: Member) -> list[Line]:
    """An evaluation's lines, by scenario and gap closed."""
    metric = member.metric or get_task(summary.task).metrics[0].name
    lines = []
    for scenario, rows in summary.scenarios.items():
        means = {row.agent: row.scores[metric].mean for row in rows}
        start = means[member.reference or summary.baseline]
        end = _ceiling(rows, metric, member, summary.task)
        way = None if start is None or end is None or start == end else end - start
        of_scenario = []
        for row in rows:
            score, gap, interval = row.scores[metric], None, None
            if way is not None and start is not None and score.mean is not None and score.share >= ENOUGH:
                gap = (score.mean - start) / way
            paired = score.against_baseline
            if gap is not None and way and paired is not None and paired.ci95 and not member.reference:
                low, high = sorted(limit / way for limit in paired.ci95)
                interval = (low, high)
            verdict = row.against_baseline.verdict if row.against_baseline else None
            of_scenario.append(
                Line(
                    *(summary.task, scenario, row.agent, row.kind, row.runs, gap, interval, metric),
                    *(score.mean, score.ci95, score.share, verdict),
                )
            )
        lines += sorted(
            of_scenario, key=lambda line: -(line.gap_closed if line.gap_closed is not None else -1e9)
        )
    return lines


def _ceiling(rows: tuple[Row, ...], metric: str, member: Member, task: str) -> float | None:
    if isinstance(member.ceiling, float):
        return member.ceiling
    agents = [
        row
        for row in rows
        if row.agent == member.ceiling or (not member.ceiling and row.kind == "privileged")
    ]
    known = [mean for row in agents if (mean := row.scores[metric].mean) is not None]
    lower = next(one for one in get_task(task).metrics if one.name == metric).lower_is_better
    return (min if lower else max)(known) if known else None


HEADER = (
    "task", "scenario", "agent", "gap closed", "metric", "mean", "episodes with one", "against the baseline",
    "sees",
)  # fmt: skip
NOTE = "Gap closed: 0 % is the reference agent, 100 % the ceiling: the best privileged agent, or a bound."


def show(lines: Sequence[Line], console: Console) -> None:
    """Print the table."""
    from rich.table import Table

    table = Table(*HEADER)
    for line in lines:
        table.add_row(*cells(line))
    console.print(table)


def cells(line: Line) -> list[str]:
    """A line for people."""
    gap = "–" if line.gap_closed is None else f"{round(100 * line.gap_closed)} %"
    if line.gap_ci95 is not None:
        gap += f" ({100 * line.gap_ci95[0]:.0f} to {100 * line.gap_ci95[1]:.0f})"
    mean = "–" if line.mean is None else f"{line.mean:.4g}"
    if line.ci95 is not None:
        mean += f" ({line.ci95[0]:.4g} to {line.ci95[1]:.4g})"
    return [
        *(line.task, line.scenario, line.agent, gap, line.metric, mean, f"{100 * line.share:.0f} %"),
        *(line.verdict or "baseline", line.sees),
    ]
