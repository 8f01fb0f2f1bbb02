"""Closing the loop: an agent tuned in three simulations, all tested in all of them on the same episodes."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from fieldagents.agent import Agent
from fieldagents.config import EnvironmentConfig
from fieldagents.evaluation.episodes import play_episodes
from fieldagents.evaluation.evaluate import check_pairs
from fieldagents.evaluation.play import written_out
from fieldagents.evaluation.summary import Labels, Summary, summarise
from fieldagents.progress import Report, stages
from fieldagents.retune.config import RetuneConfig
from fieldagents.retune.recovery import Recovery, recovery
from fieldagents.retune.report import write_report
from fieldagents.retune.result import EXTENDED, HIDDEN, NOMINAL, ORACLE, RETUNED, SIMULATION, Retuning
from fieldagents.retune.trained import tuner_of
from fieldagents.seeds import TEST_SEEDS
from fieldagents.task import Metric, get_task
from fieldmodels.files import replacing, write_text

FILES = ("retune.json", "retune.html", "retune.parquet")
RESAMPLING_SEED = 0


def retune(
    config: RetuneConfig,
    extended: Any,
    out: Path,
    progress: Report = lambda _stage, _part: None,
) -> Retuning:
    """Tune the agent in each simulation, test all, and write ``retune.json``, ``.html`` and ``.parquet``.

    Tuning seeds alone are used for tuning, published test seeds alone for testing; all agents meet the
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
    began = time.perf_counter()
    tuner = tuner_of(config.task, config.agent)
    options = tuner.options.model_validate(config.options)
    extension = str(extended) if isinstance(extended, Path) else extended
    where = {HIDDEN: config.hidden, EXTENDED: extension, SIMULATION: None}
    made_in = {NOMINAL: SIMULATION, RETUNED: EXTENDED, ORACLE: HIDDEN}
    if config.hidden is None:
        del where[HIDDEN], made_in[ORACLE]
    environments = {
        name: EnvironmentConfig(settings=config.settings, reality=reality) for name, reality in where.items()
    }
    agents: dict[str, Agent] = {}
    took: dict[str, float] = {}
    for number, (name, place) in enumerate(made_in.items()):
        progress(f"Tuning in the {place}", 0.6 * number / len(made_in))
        start = time.perf_counter()
        agents[name] = tuner.tune(config.settings, where[place], options)
        agents[name].name = config.agent
        took[name] = round(time.perf_counter() - start, 1)
    episodes = _test(config, agents, environments, progress)
    check_pairs(episodes, config.task)
    labels = {
        name: Labels(
            "privileged" if name == ORACLE else agent.kind,
            f"{tuner.title}; tuned in the {made_in[name]}",
            False,
        )
        for name, agent in agents.items()
    }
    scenarios, pairs = summarise(episodes, config.task, NOMINAL, labels)
    summary = Summary(
        name=config.name,
        task=config.task,
        baseline=NOMINAL,
        episodes=config.episodes,
        first_seed=TEST_SEEDS[0],
        seconds=round(time.perf_counter() - began, 1),
        decision_ms={scenario: {} for scenario in environments},
        environments={name: written_out(config.task, one) for name, one in environments.items()},
        scenarios=scenarios,
        pairs=pairs,
    )
    metric = next(one for one in get_task(config.task).metrics if one.name == config.counted)
    recovered = None if config.hidden is None else _recovered(episodes, metric)
    result = Retuning(config.name, config.agent, tuner.title, metric, recovered, took, summary)
    with replacing(out / "retune.parquet") as temporary:
        episodes.to_parquet(temporary, index=False)
    write_text(out / "retune.json", json.dumps(result.to_json(), indent=2, allow_nan=False) + "\n")
    write_report(result, episodes, out / "retune.html")
    return result


def _test(
    config: RetuneConfig,
    agents: Mapping[str, Agent],
    environments: Mapping[str, EnvironmentConfig],
    progress: Report,
) -> pd.DataFrame:
    """Every agent in every simulation on the same test seeds; one row an episode."""
    seeds = TEST_SEEDS[: config.episodes]
    runs = [(place, name) for place in environments for name in agents]
    tables = []
    for number, (place, name) in enumerate(runs):
        part = 0.6 + 0.4 * number / len(runs)
        progress(f"{name} in the {place}", part)
        say = stages(progress, part)
        table = play_episodes(agents[name], config.task, environments[place], seeds, say).table
        tables.append(table.assign(scenario=place, agent=name, run=0))
    whole = pd.concat(tables, ignore_index=True)
    return whole[["scenario", "agent", "run", *whole.columns.drop(["scenario", "agent", "run"])]]


def _recovered(episodes: pd.DataFrame, metric: Metric) -> Recovery:
    scores = episodes[episodes["scenario"] == HIDDEN].set_index("agent")[metric.name]
    return recovery(
        *(scores.loc[name].to_numpy(dtype=np.float64) for name in (NOMINAL, RETUNED, ORACLE)),
        lower_is_better=metric.lower_is_better,
        binary=metric.binary,
        rng=np.random.default_rng(RESAMPLING_SEED),
    )
