"""Closing the loop: an agent designed in three simulations, all flown in all of them on the same episodes."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from fieldagents.agent import Agent
from fieldagents.config import EnvironmentConfig, RetuneConfig
from fieldagents.evaluation.episodes import play_episodes
from fieldagents.evaluation.evaluate import check_pairs, written_out
from fieldagents.evaluation.metrics import METRICS, Metric
from fieldagents.evaluation.seeds import TEST_SEEDS
from fieldagents.evaluation.summary import Labels, Summary, summarise_scenario
from fieldagents.retune.designers import designers
from fieldagents.retune.won_back import WonBack, won_back
from fieldmodels.files import replacing, write_text

Report = Callable[[str, float], None]

NOMINAL, RETUNED, ORACLE = "nominal", "retuned", "oracle"
"""The agents: designed in the nominal simulation, in the extended one, in the hidden reality itself."""
HIDDEN, EXTENDED = "hidden reality", "extended simulation"
SIMULATION = "nominal simulation"
"""Where they are flown."""
FILES = ("retune.json", "retune.html", "retune.parquet")
RESAMPLING_SEED = 0


@dataclass(frozen=True)
class Retuning:
    """What an agent wins by being designed in the simulation that has learned.

    Attributes:
        name: Name of the loop.
        agent: Name of what is designed.
        title: How it is designed.
        metric: By which the loss is counted.
        hidden: Whether the hidden reality is known, so that agents were flown in it and the oracle exists.
            Else the extended simulation stands for it, which is a forecast and no measurement.
        won_back: Share of the loss won back; None without a hidden reality.
        design_seconds: Agent to the time that its design took [s].
        evaluation: Every agent in every simulation, compared with the nominal agent; the first scenario is
            the one that counts.
    """

    name: str
    agent: str
    title: str
    metric: Metric
    hidden: bool
    won_back: WonBack | None
    design_seconds: Mapping[str, float]
    evaluation: Summary

    def mean(self, agent: str, flown_in: str) -> float | None:
        """An agent's mean score in one of the simulations."""
        rows = {row.agent: row for row in self.evaluation.scenarios[flown_in]}
        return rows[agent].means[self.metric.name]

    @property
    def agents(self) -> tuple[str, ...]:
        """The agents, as they were designed."""
        return tuple(self.design_seconds)

    @property
    def flown_in(self) -> str:
        """Where the agents are held against each other."""
        return next(iter(self.evaluation.scenarios))

    def to_json(self) -> dict[str, Any]:
        """The content of ``retune.json``."""
        return {
            "schema": 1,
            "name": self.name,
            "task": self.evaluation.task,
            "agent": self.agent,
            "title": self.title,
            "metric": asdict(self.metric),
            "summary": self.sentence(),
            "hidden_known": self.hidden,
            "won_back": self.won_back and asdict(self.won_back),
            "means": {
                agent: {where: self.mean(agent, where) for where in self.evaluation.scenarios}
                for agent in self.agents
            },
            "design_seconds": dict(self.design_seconds),
            "evaluation": self.evaluation.to_json(),
        }

    def sentence(self) -> str:
        """What came out, in plain words."""
        scale, unit = (100, " %") if self.metric.binary else (1, f" {self.metric.unit}".removesuffix(" 1"))
        said = {
            agent: "no value"
            if (mean := self.mean(agent, self.flown_in)) is None
            else f"{scale * mean:.4g}{unit}"
            for agent in self.agents
        }
        begin = (
            f"{self.agent} in the {self.flown_in}, {self.metric.title}: {said[NOMINAL]} designed in the "
            f"nominal simulation, {said[RETUNED]} designed in the extended one"
        )
        if self.won_back is None:
            return (
                f"{begin}. No hidden reality is known, so this is the extended simulation's forecast, "
                "not a measurement: fly both on the machine."
            )
        begin += f", {said[ORACLE]} designed in the hidden reality itself (the oracle)"
        if self.won_back.outcome == "nothing to win":
            return f"{begin}. Nothing to win: the oracle is not better than the nominal agent."
        if self.won_back.share is None:
            return f"{begin}. Too few episodes to say more."
        share = f"{100 * self.won_back.share:.1f} % of the loss won back"
        if self.won_back.ci95 is None:
            return f"{begin}: {share}, of too few episodes for an interval."
        low, high = self.won_back.ci95
        return f"{begin}: {share} (95 % interval {100 * low:.1f} to {100 * high:.1f})."


def retune(
    config: RetuneConfig,
    extended: Any,
    out: Path,
    progress: Report = lambda _stage, _part: None,
) -> Retuning:
    """Design the agent in each simulation, fly all, and write ``retune.json``, ``.html`` and ``.parquet``.

    Tuning seeds alone are used for designing, published test seeds alone for flying; all agents meet the
    same noise on the same seed.

    Args:
        config: Task, settings, agent, effort, hidden reality, episodes.
        extended: The extended simulation: a mapping of effects or the path of an ``extended.yaml``.
        out: Result folder; files appear whole or not at all.
        progress: Called with what is being done and the part of the whole that is done.

    Raises:
        ModelError: If the extended simulation does not fit the task's model.
        EvaluationError: If two agents did not meet the same noise on the same seed.
    """
    from fieldagents.retune.report import write_report

    began = time.perf_counter()
    designer = designers(config.task)[config.agent]
    options = designer.options.model_validate(config.options)
    where = {SIMULATION: None, EXTENDED: str(extended) if isinstance(extended, Path) else extended}
    made_in = {NOMINAL: SIMULATION, RETUNED: EXTENDED}
    if config.hidden is not None:
        where = {HIDDEN: config.hidden, **where}
        made_in[ORACLE] = HIDDEN
    order = sorted(where, key=lambda name: (HIDDEN, EXTENDED, SIMULATION).index(name))
    environments = {name: EnvironmentConfig(settings=config.settings, reality=where[name]) for name in order}
    written = {name: written_out(config.task, one) for name, one in environments.items()}
    agents: dict[str, Agent] = {}
    took: dict[str, float] = {}
    for number, (name, place) in enumerate(made_in.items()):
        progress(f"Designing in the {place}", 0.6 * number / len(made_in))
        start = time.perf_counter()
        agents[name] = designer.design(config.settings, where[place], options)
        took[name] = round(time.perf_counter() - start, 1)
    episodes = _fly(config, agents, environments, progress)
    check_pairs(episodes, config.task)
    labels = {
        name: Labels("privileged" if name == ORACLE else agent.kind, _titled(agent, made_in[name]), False)
        for name, agent in agents.items()
    }
    summary = Summary(
        name=config.name,
        task=config.task,
        baseline=NOMINAL,
        episodes=config.episodes,
        first_seed=TEST_SEEDS[0],
        seconds=round(time.perf_counter() - began, 1),
        decision_ms={scenario: {} for scenario in environments},
        environments=written,
        scenarios={
            str(scenario): summarise_scenario(part, config.task, NOMINAL, labels)
            for scenario, part in episodes.groupby("scenario", sort=False)
        },
    )
    metric = next(one for one in METRICS[config.task] if one.name == config.counted)
    result = Retuning(
        name=config.name,
        agent=config.agent,
        title=designer.title,
        metric=metric,
        hidden=config.hidden is not None,
        won_back=_won_back(episodes, metric) if config.hidden is not None else None,
        design_seconds=took,
        evaluation=summary,
    )
    with replacing(out / "retune.parquet") as temporary:
        episodes.to_parquet(temporary, index=False)
    write_text(out / "retune.json", json.dumps(result.to_json(), indent=2, allow_nan=False) + "\n")
    write_report(result, episodes, out / "retune.html")
    return result


def _titled(agent: Agent, place: str) -> str:
    return f"{agent.title}; designed in the {place}"


def _fly(
    config: RetuneConfig,
    agents: Mapping[str, Agent],
    environments: Mapping[str, EnvironmentConfig],
    progress: Report,
) -> pd.DataFrame:
    """Every agent in every simulation on the same test seeds; one row an episode."""
    seeds = TEST_SEEDS[: config.episodes]
    flights = [(place, name) for place in environments for name in agents]
    tables = []
    for number, (place, name) in enumerate(flights):
        progress(f"{name} in the {place}", 0.6 + 0.4 * number / len(flights))
        table = play_episodes(agents[name], config.task, environments[place], seeds).table
        table.insert(0, "scenario", place)
        table.insert(1, "agent", name)
        table.insert(2, "run", 0)
        tables.append(table)
    return pd.concat(tables, ignore_index=True)


def _won_back(episodes: pd.DataFrame, metric: Metric) -> WonBack:
    flown = episodes[episodes["scenario"] == HIDDEN].set_index("agent")[metric.name]
    return won_back(
        *(flown.loc[name].to_numpy(dtype=np.float64) for name in (NOMINAL, RETUNED, ORACLE)),
        lower_is_better=metric.lower_is_better,
        binary=metric.binary,
        rng=np.random.default_rng(RESAMPLING_SEED),
    )
