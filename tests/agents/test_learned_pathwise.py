"""Learning by the gradient of the return: it is the environment's own, and beats the best fixed gains."""

import numpy as np
import pytest

pytest.importorskip("sb3_contrib")

from fieldagents.config import EnvironmentConfig
from fieldagents.evaluation.agents import make_agent
from fieldagents.evaluation.episodes import run_episodes
from fieldagents.learned.conditioning import Conditioning
from fieldagents.learned.config import TrainConfig
from fieldagents.learned.training import train
from fieldagents.policies.conditioned import simulated
from fieldagents.policies.policy import OnnxAgent
from fieldagents.seeds import TUNING_SEEDS
from fieldagents.tasks.heel_strike.recorded import RecordedWalks
from fieldgym import find_task
from fieldgym.info import part
from fieldmodels.reality import Reality, read_reality
from fieldmodels.registry import get_model

STRIDES = 12
SETTINGS = [
    {"strides": STRIDES},
    {"strides": STRIDES, "collision_kind": "low_pass", "score": "angle_and_floor", "reward_limit": 8.0},
]
RECORDED = "fieldagents.tasks.heel_strike.recorded:RecordedWalks"


def played(env, seed, actions):
    """Observations and return of one episode for each row of actions, all of one seed."""
    seen, _ = env.reset(seed=[seed] * len(actions))
    observations, returns = [seen], np.zeros(len(actions))
    for step in range(actions.shape[1]):
        seen, reward, *_ = env.step(actions[:, step])
        observations.append(seen)
        returns += reward
    return np.array(observations[:-1]).swapaxes(0, 1), returns


@pytest.mark.every("settings", SETTINGS)
def test_recorded_walks_give_the_environments_observations_returns_and_their_slopes(settings):
    """Against the environment itself, each action moved a little both ways."""
    size = STRIDES * 3
    env = find_task("heel_strike").make_vec(2 * size + 1, settings=settings)
    recorded = RecordedWalks(env.unwrapped.settings, Reality(), range(50, 53))
    actions = np.random.default_rng(0).uniform(-0.6, 0.9, (3, STRIDES, 3)).astype(np.float32)
    order = np.array([2, 0])  # episodes are chosen by their number
    returns, slopes = recorded.play(order, actions[order])
    for place, number in enumerate(order):
        near = np.tile(actions[number], (2 * size + 1, 1, 1)).reshape(-1, size)
        step = 2e-3
        near[np.arange(size), np.arange(size)] += np.float32(step)
        near[size + np.arange(size), np.arange(size)] -= np.float32(step)
        seen, value = played(env, 50 + int(number), near.reshape(-1, STRIDES, 3))
        np.testing.assert_array_equal(recorded.observations[number], seen[-1])
        assert returns[place] == pytest.approx(value[-1], abs=1e-6)
        expected = (value[:size] - value[size : 2 * size]) / (2 * step)
        close = np.isclose(slopes[place].ravel(), expected, rtol=2e-2, atol=2e-3 * np.abs(expected).max())
        # an error that changes its sign, or reaches the limit, between the two has no slope there
        assert close.mean() > 0.9
        assert np.abs(expected).max() > 0.05


FAULTS = {
    "gyro_bias": {"rate": {"choice": [0, {"uniform": [-0.01, 0.01]}]}},
    "viscous_friction": {"rate": {"uniform": [0, 0.2]}},
}


def test_walks_of_a_random_reality_are_those_of_its_environments():
    env = find_task("heel_strike").make_vec(4, settings={"strides": STRIDES}, reality=FAULTS)
    reality = read_reality(FAULTS, get_model("heel_strike"))
    recorded = RecordedWalks(env.unwrapped.settings, reality, range(50, 54))
    actions = np.random.default_rng(0).uniform(-0.6, 0.9, (4, STRIDES, 3)).astype(np.float32)
    seen, info = env.reset(seed=[50, 51, 52, 53])
    for effect, values in recorded.drawn.items():
        for name, drawn in values.items():
            np.testing.assert_array_equal(drawn, part(info, "privileged.reality")[effect][name])
    total = np.zeros(4)
    for step in range(STRIDES):
        np.testing.assert_array_equal(recorded.observations[:, step], seen)
        seen, reward, *_ = env.step(actions[:, step])
        total += reward
    which = np.array([3, 1])
    returns, _ = recorded.play(which, actions[which])
    np.testing.assert_allclose(returns, total[which], atol=1e-6)


def test_its_policies_are_told_what_their_validation_tells(tmp_path):
    settings = {"strides": 20}
    config = tiny(
        conditioned=True, environment={"settings": settings, "reality": FAULTS}, validation={"episodes": 4}
    )
    run = train(config.model_copy(update={"steps": 320}), progress=False, out=tmp_path / "run")
    policy = OnnxAgent(run / "policy.onnx")
    assert [one.effect for one in policy.conditions] == ["viscous_friction", "gyro_bias"]
    native = Conditioning(
        find_task("heel_strike").make_vec(3, settings=settings, reality=FAULTS), policy.conditions
    )
    reality = read_reality(FAULTS, get_model("heel_strike"))
    recorded = RecordedWalks(native.unwrapped.settings, reality, range(7, 10))
    observation, _ = native.reset(seed=[7, 8, 9])
    np.testing.assert_array_equal(simulated(policy.conditions, recorded.drawn), observation[:, 6:])


def tiny(**more):
    return TrainConfig(
        **{
            "name": "pathwise",
            "task": "heel_strike",
            "algorithm": "fieldagents.learned.pathwise:Pathwise",
            "policy": "MlpLstmPolicy",
            "steps": 40 * 8 * 20,
            "num_envs": 8,
            "checkpoint_every": 15,
            "environment": {"settings": {"strides": 20}},
            "learner": {
                "recorded": RECORDED,
                "episodes": 32,
                "n_steps": 20,
                "batch_size": 160,
                "learning_rate": 1e-2,
            },
            "network": {"hidden": [16], "more": {"lstm_hidden_size": 16, "enable_critic_lstm": False}},
            "validation": {"every": 20, "episodes": 10},
            **more,
        }
    )


def test_few_walks_teach_more_than_the_best_fixed_gains(tmp_path):
    run = train(tiny(), progress=False, out=tmp_path / "run")
    environment = EnvironmentConfig(settings={"strides": 20})
    (fixed,) = make_agent("fixed_tuned", "heel_strike", {}).runs
    learned, plain = (
        run_episodes(agent, "heel_strike", environment, TUNING_SEEDS[:60])["error_mm"].mean()
        for agent in (OnnxAgent(run / "policy.onnx"), fixed)
    )
    assert learned < 0.9 * plain


def test_a_resumed_run_is_that_of_an_uninterrupted_one(tmp_path):
    from fieldagents.learned.session import run_training
    from fieldagents.learned.training import prepare

    whole = train(tiny(), progress=False, out=tmp_path / "whole")
    prepare(tiny(), tmp_path / "parts")
    run_training(tiny(), tmp_path / "parts", lambda *_: None, until=13 * 160)
    assert not (tmp_path / "parts" / "run.json").exists()
    parts = train(tiny(), progress=False, resume=tmp_path / "parts")
    for name in ("policy.onnx", "curve.csv"):
        assert (whole / name).read_bytes() == (parts / name).read_bytes(), name


def test_episodes_of_another_length_or_of_several_kinds_are_refused(tmp_path):
    learner = {"recorded": RECORDED, "episodes": 8, "n_steps": 10, "batch_size": 80}
    with pytest.raises(ValueError, match="n_steps is 10, an episode has 20"):
        train(tiny(learner=learner), progress=False, out=tmp_path / "length")
    also = ({"settings": {"collision_kind": "low_pass"}},)
    with pytest.raises(ValueError, match="one kind of environment"):
        train(tiny(also=also), progress=False, out=tmp_path / "also")
