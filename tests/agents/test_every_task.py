"""What holds for every task on this floor: its metrics can be measured, its agents are described."""

import subprocess
import sys

import gymnasium
import numpy as np
import pytest

import fieldgym
from fieldagents import tasks
from fieldagents.agent import Agent
from fieldagents.config import EnvironmentConfig
from fieldagents.evaluation.agents import agent_names, describe_agents, make_agent
from fieldagents.evaluation.episodes import run_episodes
from fieldagents.seeds import TEST_SEEDS
from fieldagents.task import TaskError, get_task, task_names

every_task = pytest.mark.every("task", task_names())


class Constant(Agent):
    """Takes the same action in every step."""

    name = "constant"

    def __init__(self, action):
        self._action = np.asarray(action, dtype=np.float32)

    def act(self, observation, info):
        return np.repeat(self._action[None], len(observation), axis=0)


def test_every_environment_is_a_task_with_metrics_and_every_task_an_environment():
    assert task_names() == tuple(fieldgym.TASKS)
    assert all(get_task(name).metrics for name in task_names())


@every_task
def test_the_agent_of_the_picture_is_one_of_the_tasks(task):
    picture = get_task(task).picture
    assert picture is None or picture in agent_names(task)


@every_task
def test_metrics_are_measured_and_what_is_common_does_not_depend_on_the_actions(task):
    space = gymnasium.make(fieldgym.TASKS[task].env_id).action_space
    low, high = space.low, space.high
    tables = [
        run_episodes(Constant(action), task, EnvironmentConfig(), TEST_SEEDS[:4])
        for action in (low + 0.9 * (high - low), (low + high) / 2)
    ]
    for metric in get_task(task).metrics:
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
        reference.sees in ("observation", "model", "privileged")
        for reference in get_task(task).agents.values()
    )


TOY = """
from fieldagents.task import Metric, TaskDefinition

TASK = TaskDefinition("{name}", (Metric("reached", "1", "reached", "reached", over="last", binary=True),))
"""
TOY_AGENTS = """
from fieldagents.task import ReferenceAgent

AGENTS = (ReferenceAgent("idle", "does nothing", lambda settings: None),)
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder that the package of the tasks also looks into."""
    monkeypatch.setattr(tasks, "__path__", [*tasks.__path__, str(tmp_path)])
    yield tmp_path
    get_task.cache_clear()
    for name in [name for name in sys.modules if name.startswith("fieldagents.tasks.toy")]:
        del sys.modules[name]


def test_a_task_is_one_folder(folder):
    (folder / "toy").mkdir()
    for name, text in {"__init__": "", "task": TOY.format(name="toy"), "agents": TOY_AGENTS}.items():
        (folder / "toy" / f"{name}.py").write_text(text)
    assert "toy" in task_names()
    toy = get_task("toy")
    assert list(toy.agents) == ["idle"]
    assert (toy.tuners, toy.recorder) == ({}, None)


def test_a_task_that_is_not_named_as_its_folder_is_refused(folder):
    (folder / "toys").mkdir()
    (folder / "toys" / "__init__.py").touch()
    (folder / "toys" / "task.py").write_text(TOY.format(name="toy"))
    with pytest.raises(TaskError, match="TASK is named 'toy', its folder 'toys'"):
        get_task("toys")


def test_a_misspelt_task_is_guessed():
    with pytest.raises(TaskError, match="did you mean 'heel_strike'"):
        get_task("heelstrike")


def test_names_are_listed_without_the_tasks_own_code():
    code = (
        "import sys; from fieldagents.task import all_tasks; list(all_tasks());"
        "print([m for m in sys.modules if m in ('numba', 'torch', 'matplotlib', 'pandas')])"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert told.strip() == "[]"


FURTHER = {"uav_route": [{"aircraft": 2}]}
"""Settings with entries of ``info`` of their own."""


class Spy(Constant):
    """Acts like `Constant` and remembers every entry of an ``info`` that it was handed."""

    def __init__(self, action, sees):
        super().__init__(action)
        self.sees, self.read = sees, set()

    def act(self, observation, info):
        self.read |= {key.split(".")[0] for key in info if not key.startswith("_")}
        return super().act(observation, info)


@every_task
def test_an_agent_is_handed_the_entries_of_its_right_and_no_others(task):
    read = {"observation": set(), "diagnosis": set(), "model": set(), "privileged": set()}
    for settings in ({}, *FURTHER.get(task, ())):
        space = gymnasium.make(fieldgym.TASKS[task].env_id, settings=settings).action_space
        for sees, found in read.items():
            spy = Spy((space.low + space.high) / 2, sees)
            run_episodes(spy, task, EnvironmentConfig(settings=settings), TEST_SEEDS[:2])
            found |= spy.read
    assert read["observation"] == set()
    assert read["diagnosis"] == {fieldgym.TASKS[task].turned_by} - {""}
    assert read["model"] == set(fieldgym.TASKS[task].model_reads)  # none of them is misspelt
    assert "privileged" in read["privileged"]
    assert read["model"] < read["privileged"]
    assert not any("error" in key or key == "privileged" for key in read["model"])


REFERENCES = {
    "excitation": ("frozen_weight", 40),
    "heel_strike": ("fixed_tuned", 200),
    "line_following": ("tuned", 200),
    "line_following_pixels": ("memory", 100),
    "pose_reaching": ("path_memory", 500),
    "uav_route": ("two_legs", 200),
}


@every_task
def test_a_task_is_solved_where_its_reference_agent_stands(task):
    name, episodes = REFERENCES[task]
    (agent,) = make_agent(name, task, {}).runs
    played = run_episodes(agent, task, EnvironmentConfig(), TEST_SEEDS[:episodes])
    threshold = gymnasium.spec(fieldgym.TASKS[task].env_id).reward_threshold
    assert threshold == round(float(played["return"].mean()), 1)
