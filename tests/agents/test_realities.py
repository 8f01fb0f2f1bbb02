"""Loops over drawn realities: what is drawn, what is pooled, and what an unseen fault leaves."""

import json
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from fieldagents.cli import app
from fieldagents.config import ConfigError, load_config
from fieldagents.record import make_recording
from fieldagents.record.config import RecordConfig
from fieldagents.retune import reality
from fieldagents.retune.config import RealitiesConfig, seeds_of
from fieldagents.retune.realities import Closed, Realities, close_loops
from fieldagents.retune.reality import drawn, recorded
from fieldagents.retune.recovery import Recovery, pooled_recovery
from fieldagents.retune.table import tables
from fieldagents.seeds import TEST_SEEDS, TRAINING_SEEDS
from fieldagents.task import Metric
from fieldmodels.diagnosis import diagnose
from fieldmodels.model import StrayedError
from fieldmodels.recording import RecordingError
from fieldmodels.registry import get_model

SHIPPED = sorted((Path(__file__).parents[2] / "configs").glob("*/realities.yaml"))
FAULTS = {
    "camera_yaw": {"angle": {"uniform": [0.08, 0.12]}},
    "turn_gain": {"factor": {"uniform": [0.6, 0.7]}},
    "sensor_gain": {"factor": 1.3},
}
SHORT = {
    "name": "short",
    "task": "line_following",
    "agent": "lqg",
    "options": {"walks": 4},
    "settings": {"strides": 30},
    "hidden": FAULTS,
    "record": {"duration": 360},
    "episodes": 20,
    "realities": 2,
}


def pooled(nominal, retuned, oracle, **how):
    how = {"lower_is_better": True, "rng": np.random.default_rng(0), **how}
    return pooled_recovery(nominal, retuned, oracle, **how)


def test_the_share_is_what_is_recovered_everywhere_over_what_is_lost_everywhere():
    """A reality that costs next to nothing, where re-tuning does harm, counts as little as it costs."""
    oracle = np.random.default_rng(1).normal(5, 1, (3, 30))
    lost, back = np.array([[4.0], [2.0], [0.01]]), np.array([[3.0], [2.0], [-0.49]])
    found = pooled(oracle + lost, oracle + lost - back, oracle)
    assert found.share == pytest.approx(4.51 / 6.01)
    assert found.ci95[0] < found.share < found.ci95[1]
    higher = pooled(-oracle - lost, -oracle - lost + back, -oracle, lower_is_better=False)
    assert higher.share == pytest.approx(found.share)
    assert higher.ci95 == pytest.approx(found.ci95)


def test_nothing_to_recover_where_the_oracle_is_no_better_over_the_realities():
    scores = np.random.default_rng(2).normal(3, 1, (3, 12, 20))
    assert pooled(*scores).outcome == "nothing to recover"
    assert pooled(scores[0], scores[1], scores[0]).outcome == "nothing to recover"
    assert pooled(scores[0], scores[1], scores[0] + 1).share is None
    one_loses = np.zeros((12, 20))
    one_loses[0] = 1.0  # 12 realities, drawn again, are without it in a third of cases
    assert pooled(one_loses, one_loses, np.zeros((12, 20))).outcome == "nothing to recover"


def test_the_sentence_says_shares_in_percent_of_all_runs_and_of_each():
    metric = Metric("error", "mm", "error of the foot", "error_mm")
    means = {"nominal": 4.0, "retuned": 2.5, "oracle": 2.0}
    closed = (Closed({}, "effect", {}, "", means, Recovery("measured", 0.75, (0.7, 0.8)), {}),)
    result = Realities(
        "name", "task", "agent", "title", ("untold", "told", "knowing"), metric, 4, "seeds",
        Recovery("measured", 0.75, (0.7, 0.8)), (0.61, None, 0.89), closed,
    )  # fmt: skip
    assert result.sentence() == (
        "error of the foot of agent over 1 drawn realities: 4 mm untold, 2.5 told, 2 knowing: 75.0 % of the"
        " loss recovered (95 % interval 70.0 to 80.0); single training runs 61.0 to 89.0 %."
    )


@pytest.mark.nightly
def test_the_interval_covers_the_share_over_all_realities_that_could_be_drawn():
    """Losses and shares differ between realities, 24 of them: intervals over episodes alone cover in half."""
    rng = np.random.default_rng(3)
    covered = naive = 0
    for _ in range(60):
        loss = rng.gamma(1.0, 1.0, (24, 1)) + 0.3 * rng.normal(size=(24, 20))
        share = rng.choice([0.5, 1.0], (24, 1), p=[0.4, 0.6])  # 0.8 in the mean, whatever the loss
        oracle = np.zeros((24, 20))
        noise = 0.3 * rng.normal(size=(24, 20))
        retuned = (1 - share) * loss + noise
        low, high = pooled(loss, retuned, oracle, rng=rng).ci95
        covered += low <= 0.8 <= high
        means = (loss - retuned).ravel(), loss.ravel()
        which = rng.integers(480, size=(400, 480))
        shares = means[0][which].mean(axis=1) / means[1][which].mean(axis=1)
        low, high = np.quantile(shares, (0.025, 0.975))
        naive += low <= 0.8 <= high
    assert covered >= 51  # of a true 90 %, one set of sixty in forty is below
    assert naive < 45


def test_realities_are_drawn_from_the_listed_faults():
    config = RealitiesConfig.model_validate(SHORT)
    many = [drawn(config, seed) for seed in range(300)]
    assert many[7] == drawn(config, 7)
    assert 0.4 < np.mean([len(one) == 2 for one in many]) < 0.6
    assert {len(one) for one in many} == {1, 2}
    found = Counter(name for one in many for name in one)
    assert all(0.4 < found[name] / 300 < 0.6 for name in FAULTS)
    yaws = [one["camera_yaw"]["angle"] for one in many if "camera_yaw" in one]
    assert 0.08 <= min(yaws) < 0.085 < 0.115 < max(yaws) <= 0.12
    assert {one["sensor_gain"]["factor"] for one in many if "sensor_gain" in one} == {1.3}


def test_seeds_of_what_is_published_are_test_seeds():
    assert seeds_of("test") == TEST_SEEDS
    assert not set(seeds_of("tuning")) & {*TEST_SEEDS, *TRAINING_SEEDS}
    assert RealitiesConfig.model_validate(SHORT).seeds == "test"


@pytest.mark.nightly
def test_a_command_draws_records_diagnoses_tunes_and_tests(tmp_path):
    path, out = tmp_path / "short.yaml", tmp_path / "out"
    path.write_text(json.dumps(SHORT))
    said = json.loads(run("evaluate", path, "--out", out, "--json"))
    assert said == json.loads((out / "realities.json").read_text())
    episodes = pd.read_parquet(out / "realities.parquet")
    seeds = episodes.groupby("scenario")["seed"].unique()
    assert sorted(np.concatenate(seeds.to_list())) == list(TEST_SEEDS[:40]), "episodes are not shared"
    means = episodes.groupby("agent")["mean_offset"].mean()
    share = (means["nominal"] - means["retuned"]) / (means["nominal"] - means["oracle"])
    for one in said["closed"]:
        assert set(one["named"]) == set(one["hidden"])
    if said["recovered"]["outcome"] == "measured":
        assert said["recovered"]["share"] == pytest.approx(share)
    assert share > 0.8
    assert said["summary"] in (out / "realities.html").read_text()
    assert "line_following" in tables([said])

    kept = {result: result.read_bytes() for result in out.glob("jobs/*/result.json")}
    assert len(kept) == 2
    more = json.loads(run("evaluate", path, "--out", out, "--set", "realities=3", "--json"))
    assert more["closed"][:2] == said["closed"]
    assert all(result.read_bytes() == was for result, was in kept.items())
    assert len(list(out.glob("jobs/*/result.json"))) == 3


@pytest.mark.every("nothing", ["consistent", "unknown", "too short"])
def test_what_the_diagnosis_does_not_name_is_not_won_back(nothing, tmp_path, monkeypatch):
    """The nominal agent stays, to the bit, and the loss counts."""

    def found(*_, **__):
        if nothing == "too short":
            raise RecordingError("too few windows")
        return SimpleNamespace(verdict=nothing, curve_effects={}, extended=lambda: {"effects": FAULTS})

    monkeypatch.setattr(reality, "diagnose", found)
    result = close_loops(RealitiesConfig.model_validate(SHORT), tmp_path)
    assert all(one.skipped.startswith("Nothing to re-tune with") for one in result.closed)
    assert [one.named for one in result.closed] == [{}, {}]
    assert all(one.means["retuned"] == one.means["nominal"] for one in result.closed)
    assert all(one.means["retuned"] > one.means["oracle"] for one in result.closed)
    assert result.recovered.share in (0.0, None)


def test_a_robot_that_strays_is_put_back_until_enough_is_recorded():
    """Its commands come so late that it leaves the line; nobody has a log of what comes after."""
    config = RealitiesConfig.model_validate(SHORT)
    late = {"actuator_delay": {"strides": 2.0}}
    with pytest.raises(StrayedError) as caught:
        make_recording(RecordConfig(name="x", model="line_following", reality=late, duration=360, seed=5))
    log = recorded(config, late, 5)
    lengths = np.diff(log.bounds, axis=1)[:, 0]
    assert 0 < lengths[0] * log.step <= caught.value.lasted < 360
    assert 1 < len(lengths) == len(np.unique(log["offset"][log.bounds[:, 0]])), "each walk has its own noise"
    assert 360 <= len(log) * log.step < 360 + caught.value.lasted
    assert np.abs(log["offset"]).max() < 1.1
    delay = diagnose(get_model("line_following"), [log]).extended()["effects"]["actuator_delay"]["strides"]
    assert abs(delay["value"] - 2.0) < 3 * delay["std"] < 0.3


def run(*arguments):
    result = CliRunner().invoke(app, [str(a) for a in arguments])
    assert result.exit_code == 0, result.output
    return result.stdout


@pytest.mark.every("path", SHIPPED)
def test_shipped_configs_load_and_publish_test_seeds(path):
    config = load_config(path, RealitiesConfig)
    assert config.task == path.parent.name
    assert config.seeds == "test"
    assert config.realities >= 12


def test_mistakes_are_told_at_once_before_any_work(tmp_path):
    path = tmp_path / "realities.yaml"
    wrong = {**SHORT, "record": {"duration": 10, "seed": 3}, "hidden": {"camera_yav": {"angle": 0.1}}}
    path.write_text(json.dumps(wrong))
    with pytest.raises(ConfigError) as caught:
        load_config(path, RealitiesConfig)
    problems = "\n".join(caught.value.problems)
    assert "did you mean 'camera_yaw'?" in problems
    assert "follows from the reality that is drawn" in problems
    for change, said in (
        ({"hidden": None}, "names faults to draw from"),
        ({"record": {"duratoin": 10}}, "did you mean 'duration'"),
        ({"realities": 600}, "600 realities of 20 episodes each need more than the 10000 test seeds"),
    ):
        path.write_text(json.dumps(SHORT | change))
        with pytest.raises(ConfigError, match=said):
            load_config(path, RealitiesConfig)
