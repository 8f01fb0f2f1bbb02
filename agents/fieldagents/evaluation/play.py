"""One participant in one scenario, as jobs that can be done anywhere."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pyarrow  # noqa: F401  # said at once if it is missing: episodes are kept as Parquet

from fieldagents.config import EnvironmentConfig
from fieldagents.evaluation.agents import AgentRuns, is_import_path, make_agent, policies, saved
from fieldagents.evaluation.episodes import play_episodes
from fieldagents.policies.policy import OnnxAgent
from fieldagents.policies.zoo import ZOO
from fieldagents.seeds import TEST_SEEDS
from fieldagents.task import code_of, get_task
from fieldgym import find_task
from fieldmodels.drivers.named import apply_reality
from fieldmodels.engine import Job
from fieldmodels.engine.job import Report
from fieldmodels.files import replacing
from fieldmodels.registry import get_model

EPISODES = "episodes.parquet"
MODULES = ("fieldagents.evaluation.episodes", "fieldagents.policies.policy", "fieldagents.policies.sb3")


@dataclass(frozen=True, eq=False)
class Player:
    """A participant in a scenario; where it is unpickled, its agents are made anew.

    Attributes:
        scenario: Name of the scenario.
        name: What ``make_agent`` takes.
        task: Name of the task.
        environment: The scenario's settings and reality.
        trust_pickle: See ``make_agent``.
        carried: Policies of files, which another machine may not see.
    """

    scenario: str
    name: str
    task: str
    environment: EnvironmentConfig
    trust_pickle: bool = False
    carried: tuple[bytes, ...] = ()

    @cached_property
    def entry(self) -> AgentRuns:
        """The participant."""
        if self.carried:
            runs = tuple(OnnxAgent(policy, name=self.name) for policy in self.carried)
            return AgentRuns(self.name, runs, learned=True)
        return make_agent(self.name, self.task, self.environment.settings, self.trust_pickle)

    def __getstate__(self) -> dict[str, Any]:
        return {key: value for key, value in vars(self).items() if key != "entry"}

    def job(self, run: int, seeds: range, folder: Path) -> Job:
        """The job that plays one of its runs.

        Args:
            run: Which.
            seeds: Of its episodes.
            folder: Where the jobs' folders are.
        """
        parts = [
            self.task,
            written_out(self.task, self.environment),
            self.name,
            run,
            len(seeds),
            self._behind(),
            *([] if seeds.start == TEST_SEEDS.start else [seeds.start]),
        ]
        key = hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:16]
        label = f"{self.scenario}: {self.name}"
        return Job(key, label, play, (self, run, seeds), folder / key, share=float(len(seeds)))

    def _behind(self) -> list[str]:
        """Hashes of the code and of the files that make the participant."""
        own = [self.name.partition(":")[0]] if is_import_path(self.name) else []
        own += [place.partition(":")[0] for one in self.environment.wrappers for place in one]
        files = [path for path in map(Path, saved(self.name)) if path.is_file()]
        if self.name not in get_task(self.task).agents:
            files += sorted((ZOO / self.task / self.name).rglob("*.onnx"))
        data = [*self.carried, *(path.read_bytes() for path in files)]
        return [code_of(self.task, *MODULES, *own), *(hashlib.sha256(one).hexdigest() for one in data)]


def player(scenario: str, name: str, task: str, environment: EnvironmentConfig, trust_pickle: bool) -> Player:
    """A participant that holds what it needs of files: its policies, its reality.

    Raises:
        AgentError: If there is no such agent, or a ``.zip`` is not trusted.
    """
    known = (
        name in get_task(task).agents
        or is_import_path(name)
        or name.endswith((".zip", ".pkl", ".csv", ".parquet"))
    )
    carried = () if known else tuple(path.read_bytes() for path in policies(name))
    if isinstance(environment.reality, str):
        environment = environment.model_copy(update={"reality": _plain(task, environment)})
    made = Player(scenario, name, task, environment, trust_pickle, carried)
    _ = made.entry  # what cannot be made is said before the first episode
    return made


def play(one: Player, run: int, seeds: range, folder: Path, report: Report) -> dict[str, float] | None:
    """Play a run's episodes; returns the time of a decision [ms], None for an estimator.

    Args:
        one: Who plays where.
        run: Which of its runs.
        seeds: Of its episodes.
        folder: Where the table of episodes is left.
        report: Shown the progress.
    """
    agent = one.entry.runs[run]
    played = play_episodes(agent, one.task, one.environment, seeds, report)
    with replacing(folder / EPISODES) as temporary:
        played.table.to_parquet(temporary, index=False)
    if agent.estimator:
        return None
    alone = play_episodes(agent, one.task, one.environment, seeds[:1]).decision_ms if run == 0 else 0.0
    return {"batch": played.decision_ms, "alone": alone}


def written_out(task: str, environment: EnvironmentConfig) -> dict[str, Any]:
    """Settings and reality as plain values; a file may change later."""
    settings = {  # JSON has no infinity
        key: str(value) if value == math.inf else value for key, value in environment.settings.items()
    }
    wrappers = {"wrappers": list(environment.wrappers)} if environment.wrappers else {}
    return {"settings": settings, "reality": _plain(task, environment), **wrappers}


def _plain(task: str, environment: EnvironmentConfig) -> dict[str, Any]:
    if environment.reality is None:
        return {}
    _, truth = apply_reality(get_model(find_task(task).model), environment.reality)
    return truth.plain()
