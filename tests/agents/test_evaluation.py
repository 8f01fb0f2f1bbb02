"""An evaluation is repeatable, paired, honest about what it cannot say, and complete on disk."""

import json
import re
from pathlib import Path
from types import SimpleNamespace

import gymnasium
import numpy as np
import pandas as pd
import pytest

from fieldagents.agent import Agent
from fieldagents.config import EnvironmentConfig, load_config
from fieldagents.evaluation import play as plays
from fieldagents.evaluation.config import EvaluateConfig
from fieldagents.evaluation.episodes import run_episodes
from fieldagents.evaluation.evaluate import EvaluationError, check_pairs, evaluate
from fieldagents.evaluation.report import report_section
from fieldagents.evaluation.suite import Member, SuiteConfig, evaluate_suite, lines_of
from fieldagents.evaluation.summary import Labels, summarise_scenario
from fieldagents.seeds import TEST_SEEDS
from fieldagents.task import get_task
from fieldgym import TASKS
from fieldmodels.engine import Engine

TASK = "heel_strike"
SHORT = EnvironmentConfig(settings={"strides": 12})


def config(episodes: int = 20, **values: object) -> EvaluateConfig:
    return EvaluateConfig.model_validate(
        {
            "name": "test",
            "task": TASK,
            "environments": {
                "ar1": {"settings": {"strides": 12}},
                "biased": {"settings": {"strides": 12}, "reality": {"gyro_bias": {"rate": 0.02}}},
            },
            "agents": ["ranger", "fixed_tuned", "adaptive", "imm"],
            "baseline": "fixed_tuned",
            "episodes": episodes,
            **values,
        }
    )


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    out = tmp_path_factory.mktemp("evaluation")
    return evaluate(config(), out), out


def test_an_evaluation_writes_its_three_files(result):
    summary, out = result
    names = ["episodes.parquet", "figures", "jobs", "report.html", "summary.json"]
    assert sorted(path.name for path in out.iterdir()) == names
    stored = json.loads((out / "summary.json").read_text(), parse_constant=pytest.fail)
    assert stored == json.loads(json.dumps(summary.to_json()))
    episodes = pd.read_parquet(out / "episodes.parquet")
    assert len(episodes) == 2 * 4 * 20
    assert list(episodes.groupby(["scenario", "agent"])["seed"].nunique().unique()) == [20]
    assert episodes["seed"].between(TEST_SEEDS.start, TEST_SEEDS.start + 19).all()


def test_equal_evaluations_give_equal_episodes_to_the_bit(result, tmp_path):
    _, out = result
    evaluate(config(), tmp_path)
    assert (tmp_path / "episodes.parquet").read_bytes() == (out / "episodes.parquet").read_bytes()


def test_another_first_seed_moves_the_episodes_and_takes_none_that_were_kept(tmp_path):
    start = TEST_SEEDS.start + 15
    for first in (TEST_SEEDS.start, start):  # into one folder
        summary = evaluate(config(agents=["fixed_tuned"], first_seed=first), tmp_path)
        episodes = pd.read_parquet(tmp_path / "episodes.parquet").query("scenario == 'ar1'")
        assert summary.first_seed == first
        assert episodes["seed"].tolist() == list(range(first, first + 20))
        if first == TEST_SEEDS.start:
            before = episodes
    both = before.merge(episodes, on="seed")
    assert len(both) == 5
    assert (both["error_mm_x"] == both["error_mm_y"]).all()
    assert before["error_mm"].mean() != episodes["error_mm"].mean()


def test_an_evaluation_does_not_begin_with_a_seed_of_tuning_or_training():
    with pytest.raises(ValueError, match="first_seed"):
        config(first_seed=TEST_SEEDS.start - 1)


@pytest.mark.nightly
def test_a_second_evaluation_plays_only_what_is_missing_and_processes_give_the_same(tmp_path, monkeypatch):
    played = []
    play = plays.play_episodes
    monkeypatch.setattr(
        plays, "play_episodes", lambda agent, *rest: played.append(agent.name) or play(agent, *rest)
    )
    first = evaluate(config(agents=["fixed_tuned", "ppo"]), tmp_path / "a")
    assert sorted(set(played)) == ["fixed_tuned", "ppo"]
    played.clear()
    again = evaluate(config(agents=["fixed_tuned", "ranger", "ppo"]), tmp_path / "a")
    assert set(played) == {"ranger"}
    played.clear()
    evaluate(config(episodes=21, agents=["fixed_tuned", "ppo"]), tmp_path / "a")
    assert set(played) == {"fixed_tuned", "ppo"}
    assert again.decision_ms["ar1"]["ppo"] == first.decision_ms["ar1"]["ppo"]  # as it was measured then
    there = evaluate(
        config(agents=["fixed_tuned", "ranger", "ppo"]), tmp_path / "b", engine=Engine(workers=2)
    )
    assert there.scenarios == again.scenarios


def test_the_order_of_the_agents_does_not_matter(result, tmp_path):
    summary, _ = result
    other = evaluate(config(agents=["imm", "adaptive", "fixed_tuned", "ranger"]), tmp_path)
    assert other.scenarios == summary.scenarios


def test_reality_reaches_the_environment(result):
    """A gyro bias hurts an estimator that integrates the gyro more than one that corrects it."""
    summary, _ = result
    error = {
        (scenario, row.agent): row.means["error_mm"]
        for scenario, rows in summary.scenarios.items()
        for row in rows
    }
    assert error["biased", "ranger"] > 1.5 * error["ar1", "ranger"]


def test_means_are_those_of_the_episodes(result):
    summary, out = result
    episodes = pd.read_parquet(out / "episodes.parquet")
    for scenario, rows in summary.scenarios.items():
        for row in rows:
            own = episodes[(episodes["scenario"] == scenario) & (episodes["agent"] == row.agent)]
            assert row.means["error_mm"] == pytest.approx(own["error_mm"].mean())
            if row.kind.startswith("estimator"):
                assert row.episode_return is None
            else:
                assert row.episode_return == pytest.approx(own["return"].mean())


def test_best_agent_comes_first_and_the_baseline_has_no_difference(result):
    summary, _ = result
    for rows in summary.scenarios.values():
        means = [row.means["error_mm"] for row in rows]
        assert means == sorted(means)
        (baseline,) = [row for row in rows if row.agent == "fixed_tuned"]
        assert baseline.against_baseline is None


def test_report_stands_alone_and_names_all_agents(result):
    summary, out = result
    page = (out / "report.html").read_text()
    assert not re.search(r"""(src|href)=["']?(https?:)?//""", page)
    for rows in summary.scenarios.values():
        for row in rows:
            assert f">{row.agent}<" in page
    assert "Settings: strides = 12. Reality: gyro_bias rate = 0.02." in page
    assert report_section(summary).startswith('<p class="lead">')


def test_an_infinite_setting_is_written_down(tmp_path):
    where = {"steady": {"settings": {"strides": 3, "dwell": float("inf")}}}
    evaluate(config(2, environments=where, agents=["fixed_tuned"]), tmp_path)
    stored = json.loads((tmp_path / "summary.json").read_text(), parse_constant=pytest.fail)
    assert stored["environments"]["steady"]["settings"] == {"strides": 3, "dwell": "inf"}


def test_few_episodes_are_said_to_be_insufficient(tmp_path):
    summary = evaluate(config(episodes=4, agents=["ranger", "fixed_tuned"]), tmp_path)
    for rows in summary.scenarios.values():
        for row in rows:
            assert row.ci95 is None
            if row.against_baseline is not None:
                assert row.against_baseline.verdict == "insufficient"


class Recorder(Agent):
    """Keeps what it is shown."""

    name = "recorder"

    def __init__(self) -> None:
        self.shown: list[tuple[np.ndarray, dict]] = []

    def act(self, observation, info):
        self.shown.append((observation.copy(), dict(info)))
        return np.full((len(observation), 3), 0.25, dtype=np.float32)


def test_an_agent_is_not_shown_what_it_may_not_see():
    agent = Recorder()
    run_episodes(agent, TASK, SHORT, TEST_SEEDS[:2])
    assert len(agent.shown) == 12
    assert not any(key.strip("_").startswith("privileged") for _, info in agent.shown for key in info)


def test_episodes_are_those_of_the_scalar_environment():
    table = run_episodes(Recorder(), TASK, SHORT, TEST_SEEDS[:3])
    env = gymnasium.make("fieldgym/HeelStrike-v0", settings=SHORT.settings)
    for row in table.itertuples():
        env.reset(seed=row.seed)
        total, errors, over = 0.0, [], False
        while not over:
            _, reward, terminated, truncated, info = env.step(np.full(3, 0.25, dtype=np.float32))
            total, over = total + float(reward), terminated or truncated
            errors.append(info["error_mm"])
        assert row.steps == len(errors) == 12
        assert row.error_mm == pytest.approx(np.mean(errors), rel=1e-12)
        assert table.loc[table["seed"] == row.seed, "return"].item() == pytest.approx(total, rel=1e-12)
    env.close()


def test_a_return_ends_with_its_episode():
    """Who has arrived gains nothing, and takes no steps, while the others go on."""
    agent, seeds = get_task("pose_reaching").agents["graceful"].make({"starts": "T3"}), TEST_SEEDS[:6]
    table = run_episodes(agent, "pose_reaching", EnvironmentConfig(settings={"starts": "T3"}), seeds)
    assert table["steps"].nunique() > 1
    env = gymnasium.make("fieldgym/PoseReaching-v0", settings={"starts": "T3"})
    for row in table.itertuples():
        seen, _ = env.reset(seed=row.seed)
        total, steps, over = 0.0, 0, False
        while not over:
            seen, reward, terminated, truncated, _ = env.step(agent.act(seen[None], {})[0])
            total, steps, over = total + float(reward), steps + 1, terminated or truncated
        assert row.steps == steps
        assert table.loc[table["seed"] == row.seed, "return"].item() == pytest.approx(total, rel=1e-9)
    env.close()


def test_agents_that_met_other_noise_are_not_compared():
    frame = pd.DataFrame({"scenario": "s", "seed": [1, 1], "agent": ["a", "b"], "ranger_mm": [1.0, 1.0]})
    check_pairs(frame, TASK)
    frame.loc[1, "ranger_mm"] = 1.1
    with pytest.raises(EvaluationError, match="s, seed 1"):
        check_pairs(frame, TASK)


def trained(runs: int, gain: float, episodes: int = 40) -> tuple:
    """Rows of a baseline and of a trained agent with several runs that is better by ``gain``."""
    rng = np.random.default_rng(0)
    base = rng.gamma(4, 1, episodes)
    rows = [pd.DataFrame({"agent": "base", "run": 0, "seed": range(episodes), "error_mm": base})]
    for run in range(runs):
        scores = base - gain + rng.normal(0, 0.2) + rng.normal(0, 0.1, episodes)
        rows.append(pd.DataFrame({"agent": "ppo", "run": run, "seed": range(episodes), "error_mm": scores}))
    frame = pd.concat(rows).assign(ranger_mm=1.0, **{"return": 0.0})
    labels = {"base": Labels("observation", "", False), "ppo": Labels("observation", "", True)}
    return {row.agent: row for row in summarise_scenario(frame, TASK, "base", labels)}["ppo"]


def test_training_runs_are_the_unit_of_replication():
    few, many = trained(3, 1.0), trained(8, 1.0)
    assert few.runs == 3
    assert few.against_baseline.verdict == "better"  # these three policies
    assert few.of_training.verdict == "insufficient"  # the algorithm
    assert many.of_training.verdict == "better"
    assert many.of_training.n == 8
    assert trained(8, 1.0, episodes=5).of_training.verdict == "insufficient"


def test_a_spread_between_runs_widens_what_is_said_of_the_algorithm():
    row = trained(6, 0.05)
    episodes, runs = row.against_baseline, row.of_training
    assert runs.ci95[1] - runs.ci95[0] > episodes.ci95[1] - episodes.ci95[0]


def test_a_suite_is_one_table_with_the_gap_to_the_ceiling(tmp_path):
    """The gap is recomputed here from the means of the evaluation's own table of episodes."""
    member = config(agents=["fixed_tuned", "adaptive", "oracle_gains", "ppo"], episodes=20)
    (tmp_path / "one.yaml").write_text(json.dumps(member.model_dump(mode="json")))
    bound = {"reference": "adaptive", "ceiling": 1.0}
    asked = {"name": "all", "suite": {str(tmp_path / "one.yaml"): {}}}
    lines = evaluate_suite(SuiteConfig.model_validate(asked), tmp_path / "out")
    assert [line.scenario for line in lines] == ["ar1"] * 4 + ["biased"] * 4
    table = pd.read_parquet(tmp_path / "out" / "test" / "episodes.parquet")
    means = table.groupby(["scenario", "agent"])["error_mm"].mean()
    for line in lines:
        start, end = (means[line.scenario, name] for name in ("fixed_tuned", "oracle_gains"))
        assert line.gap_closed == pytest.approx((means[line.scenario, line.agent] - start) / (end - start))
        if line.gap_ci95 is not None:
            assert line.gap_ci95[0] <= line.gap_closed <= line.gap_ci95[1]
    gaps = [line.gap_closed for line in lines if line.scenario == "ar1"]
    assert gaps == sorted(gaps, reverse=True)
    assert json.loads((tmp_path / "out" / "suite.json").read_text())["lines"][0]["agent"] == lines[0].agent
    other = SuiteConfig.model_validate(asked | {"suite": {str(tmp_path / "one.yaml"): bound}})
    for line in evaluate_suite(other, tmp_path / "out"):
        start = means[line.scenario, "adaptive"]
        assert line.gap_closed == pytest.approx((means[line.scenario, line.agent] - start) / (1.0 - start))


def test_the_few_that_arrive_close_no_gap():
    """One flight in twenty that arrives, on the easiest layout, says nothing about the others."""
    ratios = {"two_legs": [1.2] * 20, "legs": [1.03] * 19 + [np.nan], "straight": [1.0] + [np.nan] * 19}
    rest = dict.fromkeys([metric.name for metric in get_task("uav_route").metrics], 1.0)
    frames = [
        pd.DataFrame(
            {"agent": name, "run": 0, "seed": range(20), "return": 0.0, **rest, "length_ratio": values}
        )
        for name, values in ratios.items()
    ]
    labels = {name: Labels("model", "", False) for name in ratios}
    rows = summarise_scenario(pd.concat(frames), "uav_route", "two_legs", labels)
    summary = SimpleNamespace(task="uav_route", baseline="two_legs", scenarios={"one": rows})
    lines = lines_of(summary, Member(metric="length_ratio", ceiling=1.0))
    gaps = {line.agent: line.gap_closed for line in lines}
    assert list(gaps) == ["legs", "two_legs", "straight"]
    assert gaps["straight"] is None
    assert gaps["legs"] == pytest.approx(0.85)


def test_the_shipped_suite_names_every_task_and_what_exists():
    suite = load_config(Path("benchmark"), SuiteConfig)
    assert {one.task for one in suite.members().values()} == set(TASKS)
    wrong = {"name": "x", "suite": {"heel_strike/benchmark": {"metric": "eror_mm", "ceiling": "oracle"}}}
    with pytest.raises(ValueError, match=r"(?s)did you mean 'error_mm'.*no 'oracle'"):
        SuiteConfig.model_validate(wrong)
