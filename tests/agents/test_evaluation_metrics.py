"""Episodes' numbers from steps; metrics that an episode may lack; shares; decision times."""

import json

import numpy as np
import pandas as pd
import pytest
from rich.console import Console

from fieldagents.agent import Agent
from fieldagents.config import EnvironmentConfig
from fieldagents.evaluation import episodes
from fieldagents.evaluation.episodes import MetricError, Tally, play_episodes
from fieldagents.evaluation.report import report_section, show
from fieldagents.evaluation.summary import DecisionTime, Labels, Summary, summarise
from fieldagents.seeds import TEST_SEEDS
from fieldagents.task import Metric, TaskDefinition

RUNNING = np.array([[True, True], [True, False], [True, False]])
STEPS = np.array([3, 1])


def tallied(metric: Metric, **entries: list[list[float]]) -> list[float]:
    """A metric's numbers of two episodes: the first of three steps, the second of one."""
    tally = Tally(metric, metric.key, 2)
    for step, running in enumerate(RUNNING):
        tally.add({key: np.array(values[step]) for key, values in entries.items()}, running)
    return tally.result(STEPS).tolist()


@pytest.mark.every(("over", "expected"), [("mean", [3.0, 5.0]), ("sum", [9.0, 5.0]), ("last", [6.0, 5.0])])
def test_an_episode_is_made_of_its_own_steps(over, expected):
    assert tallied(Metric("x", "m", "", "x", over=over), x=[[1, 5], [2, 99], [6, 99]]) == expected


def test_a_metric_of_the_successful_is_missing_in_the_others():
    time_if = Metric("time", "s", "", "time", over="last", given="success", per="shortest")
    entries = {
        "time": [[1, 4], [2, 9], [3, 9]],
        "shortest": [[2, 2]] * 3,
        "success": [[0, 0], [0, 1], [1, 1]],
    }
    np.testing.assert_equal(tallied(time_if, **entries), [1.5, np.nan])


def test_values_that_a_metric_does_not_allow_are_refused():
    nothing = [[np.nan, 1]] * 3
    with pytest.raises(MetricError, match="'x' of info is not a number"):
        tallied(Metric("x", "m", "", "x"), x=nothing)
    assert np.isnan(tallied(Metric("x", "m", "", "x", optional=True), x=nothing)[0])
    with pytest.raises(MetricError, match="must be 0 or 1"):
        tallied(Metric("x", "1", "", "x", over="last", binary=True), x=[[0.5, 1]] * 3)


class Clock:
    """A clock that others set forward."""

    now = 0.0

    def perf_counter(self):
        return self.now


class Slow(Agent):
    """Takes 4 ms for every call."""

    name = "slow"

    def __init__(self, clock):
        self.clock = clock

    def act(self, observation, info):
        self.clock.now += 0.004
        return np.zeros((len(observation), 3), dtype=np.float32)


def test_decision_time_is_of_the_agent_alone_and_of_one_environment(monkeypatch):
    clock = Clock()

    def slowly(function):
        def call(*arguments):
            clock.now += 1.0
            return function(*arguments)

        return call

    monkeypatch.setattr(episodes, "time", clock)
    for others in ("checked_actions", "visible"):
        monkeypatch.setattr(episodes, others, slowly(getattr(episodes, others)))
    environment = EnvironmentConfig(settings={"strides": 5})
    played = play_episodes(Slow(clock), "heel_strike", environment, TEST_SEEDS[:4])
    assert clock.now > 10.0
    assert played.decision_ms == pytest.approx(1.0)


TOY = (
    Metric("success", "1", "success", "success", over="last", lower_is_better=False, binary=True),
    Metric("time", "s", "time of the successes", "time", over="last", given="success"),
    Metric("bits", "bit", "information", "bits", over="sum", lower_is_better=False),
)


@pytest.fixture
def toy(monkeypatch):
    """Two agents on 60 episodes: the second succeeds less often, but sooner where it does."""
    task = TaskDefinition("toy", TOY)
    for room in ("summary", "report"):
        monkeypatch.setattr(f"fieldagents.evaluation.{room}.get_task", {"toy": task}.__getitem__)
    rng = np.random.default_rng(0)
    hard = rng.random(60)
    frames = []
    for name, reach, pace in (("sure", 0.95, 2.0), ("quick", 0.6, 1.0), ("hopeless", 0.0, 1.0)):
        success = (hard < reach).astype(float)
        taken = np.where(success > 0, pace * (1 + hard) + rng.normal(0, 0.05, 60), np.nan)
        frames.append(
            pd.DataFrame(
                {"agent": name, "run": 0, "seed": range(60), "return": success, "success": success,
                 "time": taken, "bits": rng.normal(-5, 20, 60)}
            )
        )  # fmt: skip
    episodes = pd.concat(frames).assign(scenario="field")
    labels = {name: Labels("observation", "", False) for name in ("sure", "quick", "hopeless")}
    rows, pairs = summarise(episodes, "toy", "sure", labels)
    conditions = {"field": {"settings": {}, "reality": {}}}
    took = {"field": {"sure": DecisionTime(0.02, 0.5), "quick": DecisionTime(1.5, 2.0), "hopeless": None}}
    return Summary("toy", "toy", "sure", 60, TEST_SEEDS[0], 1.0, took, conditions, rows, pairs), episodes


def test_every_metric_has_its_own_verdict_over_its_own_pairs(toy):
    summary, _ = toy
    sure, quick, hopeless = summary.scenarios["field"]
    assert [row.agent for row in (sure, quick, hopeless)] == ["sure", "quick", "hopeless"]  # more is better
    assert quick.against_baseline.verdict == "worse"
    time = quick.scores["time"]
    assert time.against_baseline.verdict == "better"
    assert time.against_baseline.n == round(60 * time.share) < 60
    assert quick.scores["bits"].against_baseline.n == 60
    assert hopeless.scores["time"].mean is None
    assert hopeless.scores["time"].against_baseline.verdict == "insufficient"
    assert hopeless.first.ci95[1] > 0.04  # sixty failures do not prove a rate of zero


def test_a_summary_with_missing_values_is_strict_json(toy):
    stored = json.loads(json.dumps(toy[0].to_json(), allow_nan=False))
    rows = {row["agent"]: row for row in stored["scenarios"]["field"]}
    assert rows["hopeless"]["means"]["time"] is None
    assert rows["quick"]["scores"]["time"]["against_baseline"]["verdict"] == "better"
    assert rows["quick"]["against_baseline"] == rows["quick"]["scores"]["success"]["against_baseline"]
    assert stored["decision_ms"]["field"] == {
        "sure": {"batch": 0.02, "alone": 0.5},
        "quick": {"batch": 1.5, "alone": 2.0},
        "hopeless": None,
    }
    assert [metric["name"] for metric in stored["metrics"]] == ["success", "time", "bits"]


def test_report_and_terminal_show_all_metrics(toy):
    summary, episodes = toy
    page = report_section(summary, episodes)
    assert page.count("<figure>") == 3
    console = Console(width=160, record=True)
    show(summary, console)
    shown = console.export_text()
    for text in (page, shown):
        for metric in TOY:
            assert metric.name in text
        assert "nan" not in text
    share = summary.scenarios["field"][1].scores["time"].share
    assert f"in {100 * share:.0f} %, better" in shown
