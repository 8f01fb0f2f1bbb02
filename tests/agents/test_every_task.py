"""What holds for every task on this floor: its metrics can be measured, its agents are described."""

import gymnasium
import numpy as np
import pytest

import fieldgym
from fieldagents.agent import Agent
from fieldagents.config import EnvironmentConfig
from fieldagents.evaluation.entrants import agent_names, describe_agents
from fieldagents.evaluation.episodes import run_episodes
from fieldagents.evaluation.metrics import METRICS
from fieldagents.evaluation.seeds import TEST_SEEDS
from fieldagents.reference import TABLES, references

every_task = pytest.mark.parametrize("task", METRICS)


class Constant(Agent):
    """Takes the same action in every step."""

    name = "constant"

    def __init__(self, action):
        self._action = np.asarray(action, dtype=np.float32)

    def act(self, observation, info):
        return np.repeat(self._action[None], len(observation), axis=0)


def test_tables_and_metrics_are_those_of_tasks():
    assert set(TABLES) <= set(METRICS) <= set(fieldgym.TASKS)


@every_task
def test_metrics_are_measured_and_what_is_common_does_not_depend_on_the_actions(task):
    space = gymnasium.make(fieldgym.TASKS[task].env_id).action_space
    low, high = space.low, space.high
    tables = [
        run_episodes(Constant(action), task, EnvironmentConfig(), TEST_SEEDS[:4])
        for action in (low + 0.9 * (high - low), (low + high) / 2)
    ]
    for metric in METRICS[task]:
        for table in tables:
            values = table[metric.name]
            assert metric.may_miss or values.notna().all()
            assert len(metric.title.splitlines()) == 1
        if metric.common:
            assert tables[0][metric.name].equals(tables[1][metric.name])
            assert tables[0][metric.name].nunique() > 1  # else it would prove nothing
    assert not tables[0]["return"].equals(tables[1]["return"])


@every_task
def test_names_are_unique_and_titles_are_lines(task):
    names = agent_names(task)
    assert len(names) == len(set(names))
    for one in describe_agents(task):
        assert one["title"]
        assert len(one["title"].splitlines()) == 1
        assert not one["title"].endswith(".")
    assert all(
        reference.sees in ("observation", "model", "privileged") for reference in references(task).values()
    )
