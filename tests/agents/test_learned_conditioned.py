"""Policies that are told a diagnosis: it scatters as it says, and nothing else reaches them."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

pytest.importorskip("stable_baselines3")

from fieldagents.agent import Agent, visible
from fieldagents.config import EnvironmentConfig
from fieldagents.evaluation.episodes import run_episodes
from fieldagents.learned.conditioning import Conditioning, Diagnosed, conditions_in
from fieldagents.learned.config import VALIDATION_SEEDS, TrainConfig
from fieldagents.learned.session import run_training
from fieldagents.learned.training import prepare, train
from fieldagents.policies.conditioned import LEAST, NAMED, Condition, known, said, simulated
from fieldagents.policies.policy import OnnxAgent
from fieldagents.retune import reality
from fieldagents.retune.config import RealitiesConfig
from fieldagents.retune.realities import close_loops
from fieldagents.retune.trained import Conditioning as Options
from fieldagents.retune.trained import condition, tuner_of, wrong_conditioning
from fieldgym import find_task
from fieldmodels.yaml import save_yaml

REALITY = {
    "turn_gain": {"gain": {"choice": [1.0, {"uniform": [0.5, 1.5]}]}},
    "heading_bias": {"angle": {"uniform": [-0.25, 0.25]}},
}
CONFIG = {
    "name": "told",
    "task": "pose_reaching",
    "steps": 256,
    "num_envs": 4,
    "twins": 2,
    "checkpoint_every": 1,
    "conditioned": True,
    "environment": {"settings": {"timeout": 1.0}, "reality": REALITY},
    "learner": {"n_steps": 16, "batch_size": 64, "n_epochs": 2},
    "network": {"hidden": [8]},
    "validation": {"every": 2, "episodes": 4},
}
TOLD = (Condition("turn_gain", "gain", 1.0, 0.5), Condition("heading_bias", "angle", 0.0, 0.25))
WIND = (Condition("wind", "north", 0.0, 15.0), Condition("wind", "east", 0.0, 15.0))
NOTHING = [0, 1, 0, 1]


def quiet(_stage, _part):
    pass


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return train(TrainConfig(**CONFIG), progress=False, out=tmp_path_factory.mktemp("told") / "run")


def test_a_policy_is_told_of_what_the_reality_draws_in_units_of_half_its_range():
    assert conditions_in(TrainConfig(**CONFIG)) == TOLD
    assert conditions_in(TrainConfig(**{**CONFIG, "conditioned": False})) == ()
    found = {
        "turn_gain": {"gain": {"value": 0.8, "std": 0.04}},
        "gyro_bias": {"rate": {"value": 1, "std": 1}},
    }
    np.testing.assert_allclose(said(TOLD, found), [-0.4, 0.08, 0, 1], rtol=1e-6)
    found = {"heading_bias": {"angle": {"value": 0.05, "std": None}}}  # unidentifiable
    np.testing.assert_allclose(said(TOLD, found), [0, 1, 0.2, 1], rtol=1e-6)
    np.testing.assert_allclose(known(TOLD, {"turn_gain": {"gain": 1.2}}), [0.4, 0, 0, 0], rtol=1e-6)
    assert said(TOLD, {}).tolist() == NOTHING


def test_of_a_limit_that_is_nominally_out_of_reach_the_farthest_that_was_drawn_is_none():
    limit = {"actuator_saturation": {"limit": {"choice": [1.5, {"uniform": [0.3, 1.0]}]}}}
    (one,) = told = conditions_in(TrainConfig(**{**CONFIG, "environment": {"reality": limit}}))
    assert (one.neutral, one.spread) == (1.5, pytest.approx(0.6))
    assert known(told, {}).tolist() == [0, 0]
    found = {"actuator_saturation": {"limit": {"value": 0.6, "std": 0.03}}}
    np.testing.assert_allclose(said(told, found), [-1.5, 0.05], rtol=1e-6)


def test_simulated_estimates_scatter_about_the_truth_as_they_say():
    rng = np.random.default_rng(0)
    truth = {"turn_gain": {"gain": rng.uniform(0.5, 1.5, 40_000)}}
    truth["heading_bias"] = {"angle": rng.uniform(-0.25, 0.25, 40_000)}
    told = simulated(TOLD, truth).astype(float).reshape(-1, 2, 2)
    for k, one in enumerate(TOLD):
        estimate, error = told[:, k].T
        whole = (told[:, :, 1] < 1).all(axis=1) & (error > 0.01)
        true = (truth[one.effect][one.name] - one.neutral) / one.spread
        away = (estimate - true)[whole] / error[whole]
        assert abs(away.mean()) < 0.03
        assert away.std() == pytest.approx(1, abs=0.03)
        assert abs(np.corrcoef(error[whole], true[whole])[0, 1]) < 0.03
        assert LEAST < error.min() < 0.01
        unsaid = error == 1
        assert (estimate[unsaid] == 0).all()
        assert np.abs(true[unsaid]).mean() < np.abs(true[~unsaid]).mean()
    logs = np.log(told[(told[:, :, 1] < 1).all(axis=1)][:, :, 1])
    assert np.corrcoef(logs.T)[0, 1] > 0.5  # of one record


def test_what_does_not_stand_out_is_not_named_in_half_of_them_and_an_effect_is_named_whole():
    truth = {"wind": {"north": np.random.default_rng(1).uniform(-15, 15, 20_000), "east": np.zeros(20_000)}}
    told = simulated(WIND, truth).reshape(-1, 2, 2)
    away, error = np.moveaxis(told, -1, 0)
    unsaid = (error == 1).all(axis=1)
    assert (unsaid == (error == 1).any(axis=1)).all()
    doubtful = (np.abs(away) < NAMED * error).all(axis=1) & ~unsaid
    assert unsaid.sum() == pytest.approx(doubtful.sum(), rel=0.1)
    calm = simulated(WIND, {"wind": {"north": np.zeros(8), "east": np.zeros(8)}})
    assert len(np.unique(calm, axis=0)) == 1  # it follows from the truth alone


class Watching(Agent):
    """Keeps what it is given, as a policy would be."""

    name, sees, conditions = "watching", "diagnosis", TOLD

    def __init__(self):
        self.seen, self.infos, self.diagnosis = [], [], None

    def act(self, observation, info):
        self.seen.append((observation, self.diagnosis))
        self.infos.append(info)
        return np.zeros((len(observation), 2), dtype=np.float32)


def environments(rows):
    settings = {"timeout": 0.5}
    return Conditioning(find_task("pose_reaching").make_vec(rows, settings=settings, reality=REALITY), TOLD)


def test_training_and_validation_tell_the_same_and_a_batch_what_single_rows_are_told():
    env = environments(4)
    observation, _ = env.reset(seed=7)
    assert env.single_observation_space.shape == (11,)
    assert env.observation_space.contains(observation)
    assert len(np.unique(observation[:, 7:], axis=0)) == 4
    stepped, *_ = env.step(np.zeros((4, 2), dtype=np.float32))
    np.testing.assert_array_equal(stepped[:, 7:], observation[:, 7:])
    for row in range(4):
        alone, _ = environments(1).reset(seed=7 + row)
        np.testing.assert_array_equal(alone[0], observation[row])
    watching = Watching()
    place = EnvironmentConfig(settings={"timeout": 0.5}, reality=REALITY)
    run_episodes(Diagnosed(watching), "pose_reaching", place, range(7, 11))
    assert len(watching.seen) > 2
    for seen, told in watching.seen:
        assert seen.shape == (4, 7)
        np.testing.assert_array_equal(told, observation[:, 7:])  # for a whole episode


def test_the_right_to_a_diagnosis_is_no_right_to_anything_of_info_but_the_angle_that_turns_it():
    watching = Watching()
    place = EnvironmentConfig(settings={"timeout": 0.3}, reality={"heading_bias": {"angle": 0.1}})
    run_episodes(watching, "pose_reaching", place, range(2))
    assert watching.infos
    assert all(len(info) == 0 for info in watching.infos)
    for task in ("pose_reaching", "uav_route", "line_following", "heel_strike", "excitation"):
        hidden = dict.fromkeys((*find_task(task).model_reads, "privileged.offset", "offset"), 1)
        assert visible(hidden, "diagnosis", task) == ({"radial": 1} if task == "uav_route" else {})


def test_a_policy_takes_the_tasks_observation_and_acts_by_what_it_is_told(run):
    policy = OnnxAgent(run / "policy.onnx")
    assert (policy.shape, policy.conditions, policy.sees) == ((7,), TOLD, "diagnosis")
    assert policy.diagnosis.tolist() == NOTHING
    observation = np.random.default_rng(0).normal(size=(3, 7)).astype(np.float32)
    untold = policy.act(observation, {})
    policy.condition({"heading_bias": {"angle": {"value": 0.2, "std": 0.01}}})
    told = policy.act(observation, {})
    assert np.abs(told - untold).max() > 1e-4
    alone = np.concatenate([policy.act(observation[k : k + 1], {}) for k in range(3)])
    np.testing.assert_allclose(alone, told, atol=1e-6)
    policy.condition({})
    np.testing.assert_array_equal(policy.act(observation, {}), untold)
    blind = train(TrainConfig(**{**CONFIG, "conditioned": False}), progress=False, out=run.parent / "blind")
    assert OnnxAgent(blind / "policy.onnx").sees == "observation"


MEMORIES = (
    {"stack": 3},
    {"stack": 3, "features": "torch.nn:Identity"},  # and of its own actions
    {"algorithm": "recurrent_ppo", "policy": "MlpLstmPolicy"},
)


@pytest.mark.every("memory", MEMORIES)
def test_policies_with_a_memory_are_told_too(memory, tmp_path):
    made = train(TrainConfig(**{**CONFIG, **memory}), progress=False, out=tmp_path / "run")
    policy = OnnxAgent(made / "policy.onnx")
    assert (policy.shape, policy.conditions) == ((7,), TOLD)
    seen = run_episodes(
        Diagnosed(policy), "pose_reaching", TrainConfig(**CONFIG).environment, VALIDATION_SEEDS[:4]
    )
    curve = pd.read_csv(made / "curve.csv")
    assert seen["return"].mean() in curve["validation_return"].to_list()


def test_a_run_that_was_paused_ends_as_one_that_was_not(run, tmp_path):
    config = TrainConfig(**CONFIG)
    prepare(config, tmp_path)
    for until in (128, None):
        run_training(config, tmp_path, quiet, until=until)
    for name in ("curve.csv", "policy.onnx"):
        assert (tmp_path / name).read_bytes() == (run / name).read_bytes()


@pytest.mark.every(
    ("wrong", "message"),
    [
        ({"environment": {"reality": {"turn_gain": {"gain": 0.8}}}}, "is drawn by a sampler"),
        ({"environment": {}}, "is drawn by a sampler"),
        ({"also": [{"settings": {"timeout": 2.0}}]}, "without also"),
    ],
)
def test_there_must_be_something_to_tell(wrong, message):
    with pytest.raises(ValueError, match=message):
        TrainConfig(**{**CONFIG, **wrong})


def test_images_leave_no_place_for_what_is_told(tmp_path):
    reality = {"camera_yaw": {"angle": {"uniform": [-0.1, 0.1]}}}
    config = TrainConfig(**{**CONFIG, "task": "line_following_pixels", "environment": {"reality": reality}})
    with pytest.raises(ValueError, match="beside observations of one dimension"):
        train(config, progress=False, out=tmp_path / "run")


def test_a_policy_is_told_of_a_reality_what_its_role_knows(run, tmp_path):
    tuner = tuner_of("pose_reaching", str(run))
    assert tuner.conditioned
    extended = tmp_path / "extended.yaml"
    found = {"turn_gain": {"gain": {"value": 1.2, "std": 0.02, "unit": "1"}}}
    save_yaml({"schema": 1, "model": "pose_reaching", "parameters": {}, "effects": found}, extended)

    def told(reality, **options):
        return tuner.tune({}, reality, Options(**options)).diagnosis.tolist()

    assert told(None) == [0, 0, 0, 0]
    assert told({"heading_bias": {"angle": 0.125}}) == [0, 0, 0.5, 0]
    assert told(str(extended)) == pytest.approx([0.4, 0.04, 0, 1])
    assert told(str(extended), conditioned=False) == NOTHING
    assert condition("pose_reaching", str(run), {}, None, Options(nominal="sac", run=2)).name == "sac"
    assert wrong_conditioning("pose_reaching", tuner, {"nominal": "sac"}) == ""
    assert "did you mean 'sac'" in wrong_conditioning("pose_reaching", tuner, {"nominal": "sax"})
    assert "has 1 training runs, numbered from 0" in wrong_conditioning("pose_reaching", tuner, {"run": 1})
    with pytest.raises(ValueError, match="train it, and name its run's folder"):
        tuner_of("line_following", "line_following/conditioned")


def test_where_a_diagnosis_names_nothing_the_policy_acts_untold(run, tmp_path, monkeypatch):
    def nothing(*_, **__):
        return SimpleNamespace(verdict="consistent", curve_effects={}, extended=lambda: {"effects": {}})

    monkeypatch.setattr(reality, "diagnose", nothing)
    config = {
        "name": "drawn",
        "task": "pose_reaching",
        "agent": str(run),
        "settings": {"timeout": 1.0},
        "hidden": {"turn_gain": {"gain": {"uniform": [0.6, 1.4]}}},
        "record": {"duration": 5, "step": 0.05},
        "metric": "success",
        "realities": 2,
        "episodes": 20,
        "seeds": "tuning",
    }
    result = close_loops(RealitiesConfig.model_validate(config), tmp_path)
    assert "if given the diagnosis of each" in result.sentence()
    assert len(result.of_runs) == 1
    episodes = pd.read_parquet(tmp_path / "realities.parquet").set_index("agent")["return"]
    untold = OnnxAgent(run / "policy.onnx")
    for number in range(2):
        hidden = reality.drawn(RealitiesConfig.model_validate(config), 5000 + number)
        own = range(5000 + 20 * number, 5020 + 20 * number)
        place = EnvironmentConfig(settings={"timeout": 1.0}, reality=hidden)
        again = run_episodes(untold, "pose_reaching", place, own)["return"].to_numpy()
        mine = episodes.loc["retuned"].to_numpy()[20 * number : 20 * number + 20]
        np.testing.assert_array_equal(mine, again)
    assert (episodes.loc["retuned"].to_numpy() != episodes.loc["nominal"].to_numpy()).any()
