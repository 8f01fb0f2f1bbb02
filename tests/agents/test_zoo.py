"""The trained policies that come with the package: their cards tell the truth."""

import hashlib

import numpy as np
import pandas as pd
import pytest

from fieldagents.config import EnvironmentConfig
from fieldagents.evaluation.episodes import run_episodes
from fieldagents.learned.conditioning import as_trained
from fieldagents.learned.config import TrainConfig
from fieldagents.policies.policy import OnnxAgent
from fieldagents.policies.zoo import ZooError, get_entry, list_zoo, load
from fieldagents.seeds import TEST_SEEDS
from fieldagents.task import get_task

TRAININGS = [training for entry in list_zoo() for training in entry.trainings]
RUNS = [
    pytest.param(training, run, id=f"{training}/{run['seed']}")
    for training in TRAININGS
    for run in training.card["runs"]
]


def test_the_zoo_is_not_empty():
    assert {"heel_strike/ppo/ar1", "heel_strike/ppo/low_pass"} <= {str(one) for one in TRAININGS}


@pytest.mark.matrix(
    keep=(
        "pose_reaching/sac/T3/3",
        "pose_reaching/sac/T3/4",
        "uav_route/branching/no_lock_loss/4",
        "uav_route/ppo/lock_loss/0",
        "uav_route/ppo/lock_loss/1",
        "uav_route/sac/lock_loss/1",
    )
)
@pytest.mark.parametrize(("training", "run"), RUNS)
def test_a_policy_scores_again_what_its_card_says(training, run):
    data = (training.folder / run["policy"]).read_bytes()
    assert hashlib.sha256(data).hexdigest() == run["sha256"]
    environment = EnvironmentConfig(**training.card["config"]["environment"])
    first, end = training.card["test_seeds"]
    assert first == TEST_SEEDS.start
    result = run_episodes(as_trained(OnnxAgent(data)), training.task, environment, TEST_SEEDS[: end - first])
    for name, score in run["test_scores"].items():
        # other processors round otherwise, which seldom moves a strike by a sample, or, in images of which
        # thousands of pixels are weighed, a few walks: by much less than what chance leaves unknown
        chance = (
            0.2 * float(np.std(result[name])) / np.sqrt(len(result[name])) if "pixels" in str(training) else 0
        )
        expected = pytest.approx(np.nan if score is None else score, rel=1e-3, abs=chance, nan_ok=True)
        assert result[name].mean() == expected, name


@pytest.mark.every("training", TRAININGS)
def test_a_card_holds_the_whole_config_and_the_curve_of_every_run(training):
    card = training.card
    config = TrainConfig(**card["config"], seed=training.seeds[0])
    assert config.task == training.task
    assert len(training.seeds) == len(set(training.seeds)) >= 5  # fewer runs say little about the method
    assert card["versions"]["commit"]
    curve = pd.read_csv(training.folder / "curve.csv")
    assert tuple(curve["seed"].unique()) == training.seeds
    for run in card["runs"]:
        assert run["steps"] >= config.steps
        own = curve[curve["seed"] == run["seed"]].set_index("steps")
        assert own["validation_return"][run["best_steps"]] == run["validation_return"]
        first = get_task(training.task).metrics[0]
        score = own[f"validation_{first.name}"] * (-1 if first.lower_is_better else 1)
        chosen_by = own["validation_return"] if config.validation.by == "return" else score
        assert chosen_by[run["best_steps"]] == chosen_by.max()


@pytest.mark.every("training", [one for one in TRAININGS if one.task == "heel_strike"])
def test_every_run_beats_the_best_fixed_gains_on_the_same_strides(training):
    environment = EnvironmentConfig(**training.card["config"]["environment"])
    fixed = get_task(training.task).agents["gated_tuned"].make(environment.settings)
    seeds = TEST_SEEDS[: len(range(*training.card["test_seeds"]))]
    best_fixed = run_episodes(fixed, training.task, environment, seeds)["error_mm"].mean()
    for run in training.card["runs"]:
        assert run["test_scores"]["error_mm"] < 0.8 * best_fixed


def test_an_entry_has_what_it_asks_for_in_any_scenario():
    """The student of two bands is among agents of one, in scenarios that say nothing of bands."""
    agent = load("line_following", "student_two_bands")
    assert agent.settings == {"bands": 2}
    short = {"track": "s", "strides": 30}
    seeds = TEST_SEEDS[:4]
    silent, told = (
        run_episodes(agent, "line_following", EnvironmentConfig(settings=short | more), seeds)
        for more in ({}, {"bands": 2})
    )
    pd.testing.assert_frame_equal(silent, told)


def test_policies_load_by_name():
    agent = load("heel_strike", "ppo", run=1)
    size = agent.shape[0]
    assert np.all(np.abs(agent.act(np.zeros((3, size), dtype=np.float32), {})) <= 1)
    with pytest.raises(ZooError, match="did you mean 'ppo'"):
        get_entry("heel_strike", "pppo")
    with pytest.raises(ZooError, match="run is 0 to"):
        load("heel_strike", "ppo", run=99)


def test_the_settings_decide_which_training_acts():
    entry = get_entry("heel_strike", "ppo")
    by_kind = {training.folder.name: training.agents() for training in entry.trainings}
    observation = np.full((1, 6), -5, dtype=np.float32)
    for kind, agents in by_kind.items():
        for chosen, agent in zip(entry.agents({"collision_kind": kind, "strides": 7}), agents, strict=True):
            np.testing.assert_array_equal(chosen.act(observation, {}), agent.act(observation, {}))
    assert not np.array_equal(*(agents[0].act(observation, {}) for agents in by_kind.values()))


def test_a_damaged_card_is_named(tmp_path):
    card = tmp_path / "heel_strike" / "ppo" / "ar1" / "card.json"
    card.parent.mkdir(parents=True)
    for text in ("{", "[]", '{"title": "x"}'):
        card.write_text(text)
        with pytest.raises(ZooError, match=r"card\.json: not the card"):
            list_zoo(folder=tmp_path)


def test_a_setting_that_a_training_drew_is_no_difference():
    (training,) = get_entry("line_following_pixels", "student").trainings
    assert training.settings["light"] == {"uniform": [0.4, 1.2]}
    assert training.distance({"track": "oval", "light": 0.5}) == 0
    assert training.distance({"track": "s", "light": 0.5}) == 1
