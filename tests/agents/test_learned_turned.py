"""Where observations are turned, so is what a policy is told: the map may be turned as one likes."""

import numpy as np
import onnxruntime
import pandas as pd
import pytest

pytest.importorskip("stable_baselines3")

from fieldagents.config import EnvironmentConfig
from fieldagents.evaluation.episodes import run_episodes
from fieldagents.learned.conditioning import Conditioning, Diagnosed, conditions_in
from fieldagents.learned.config import VALIDATION_SEEDS, TrainConfig
from fieldagents.learned.training import train
from fieldagents.policies.conditioned import simulated
from fieldagents.policies.policy import OnnxAgent
from fieldgym import find_task
from fieldgym.info import part

TASK = "uav_route"
VECTORS = ("radar_position", "wind", "sensor_bias")
REALITY = {
    "weaker_bank": {"factor": {"uniform": [0.6, 1.0]}},
    **{
        effect: {side: {"choice": [0.0, {"uniform": [-far, far]}]} for side in ("north", "east")}
        for effect, far in zip(VECTORS, (4e4, 15.0, 3e3), strict=True)
    },
}
SETTINGS = {"radars": 2, "max_legs": 8, "lock_loss": False}
CONFIG = {
    "name": "turned",
    "task": TASK,
    "steps": 256,
    "num_envs": 8,
    "told": True,
    "environment": {"settings": SETTINGS, "reality": REALITY},
    "learner": {"n_steps": 16, "batch_size": 64, "n_epochs": 2},
    "network": {"hidden": [8]},
    "validation": {"every": 1, "episodes": 4},
}
FOUND = {
    "radar_position": {"north": {"value": 2e4, "std": 3e3}, "east": {"value": -1e4, "std": 9e3}},
    "wind": {"north": {"value": -9.0, "std": 0.5}, "east": {"value": 4.0, "std": 0.5}},
    "weaker_bank": {"factor": {"value": 0.8, "std": 0.02}},
}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return train(TrainConfig(**CONFIG), progress=False, out=tmp_path_factory.mktemp("turned") / "run")


def ahead(info):
    """The bearing of the nearest radar as a complex number of length 1, north real, from the map alone."""
    towards = (info["layout.radars"] - info["place"][:, None]) @ [1, 1j]
    nearest = np.take_along_axis(towards, np.abs(towards).argmin(axis=1)[:, None], axis=1)[:, 0]
    return nearest / np.abs(nearest)


def turned_by_hand(told, numbers, bearing):
    """What is told of each effect's north and east, ahead and to the right by complex numbers."""
    names = [(one.effect, one.name) for one in told]
    result = numbers.astype(complex).reshape(len(numbers), -1, 2)
    for effect in VECTORS:
        north, east = (names.index((effect, side)) for side in ("north", "east"))
        away = (numbers.reshape(result.shape)[:, [north, east], 0] @ [1, 1j]) * bearing.conj()
        errors = numbers.reshape(result.shape)[:, [north, east], 1].astype(float)
        spread = np.array([np.diag(own**2) for own in errors])
        turn = np.array([[[z.real, z.imag], [-z.imag, z.real]] for z in bearing])
        covariance = turn @ spread @ turn.transpose(0, 2, 1)
        for place, share in ((north, away.real), (east, away.imag)):
            result[:, place, 0] = share
        for place, k in ((north, 0), (east, 1)):
            result[:, place, 1] = np.sqrt(covariance[:, k, k])
    return result.real.reshape(numbers.shape)


def test_training_tells_vectors_ahead_and_to_the_right_of_the_radar_at_every_step():
    told = conditions_in(TrainConfig(**CONFIG))
    env = Conditioning(find_task(TASK).make_vec(6, settings=SETTINGS, reality=REALITY), told)
    observation, info = env.reset(seed=3)
    rng, courses = np.random.default_rng(0), []
    for _ in range(12):  # beyond the end of the first episodes
        numbers = simulated(told, part(info, "privileged.reality"))
        expected = turned_by_hand(told, numbers, ahead(info))
        np.testing.assert_allclose(observation[:, -2 * len(told) :], expected, atol=1e-5)
        assert np.abs(expected - numbers).max() > 0.1
        courses.append(info["radial"])
        observation, *_, info = env.step(rng.uniform(-0.3, 0.3, (6, 2)).astype(np.float32))
    assert np.ptp(courses, axis=0).min() > 0.1  # a turn of one step is none of the next
    env.close()


def test_a_policys_file_is_given_the_same_turned_by_the_info_of_its_right(run):
    policy = OnnxAgent(run / "policy.onnx")
    policy.condition(FOUND)
    alone = onnxruntime.InferenceSession(run / "policy.onnx")
    envs = find_task(TASK).make_vec(5, settings=SETTINGS, reality={"wind": {"north": 9.0}})
    observation, info = envs.reset(seed=1)
    for _ in range(3):
        action = policy.act(observation, {"radial": info["radial"]})
        numbers = np.repeat(policy.diagnosis[None], 5, axis=0)
        diagnosis = turned_by_hand(policy.conditions, numbers, ahead(info)).astype(np.float32)
        (expected,) = alone.run(None, {"observation": observation, "diagnosis": diagnosis})
        np.testing.assert_allclose(action, expected, atol=1e-5)
        (unturned,) = alone.run(None, {"observation": observation, "diagnosis": numbers})
        assert np.abs(action - unturned).max() > 1e-3
        observation, *_, info = envs.step(action)
    envs.close()
    with pytest.raises(ValueError, match="turned by info\\['radial'\\], one angle for each of 5 rows"):
        policy.act(observation, {})


def test_validation_tells_the_policys_file_what_training_told(run):
    place = TrainConfig(**CONFIG).environment
    seen = run_episodes(Diagnosed(OnnxAgent(run / "policy.onnx")), TASK, place, VALIDATION_SEEDS[:4])
    assert seen["return"].mean() in pd.read_csv(run / "curve.csv")["validation_return"].to_list()


@pytest.mark.every("angle", [0.7, -2.0])
def test_on_a_turned_map_with_turned_faults_a_told_policy_flies_the_same_way(run, angle):
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])

    def flown(by):
        places = {"start": [350, 125], "goal": [300, -40], "radars": [[0, 0], [30, 380]]}
        layout = {name: (np.array(own) @ by.T).tolist() for name, own in places.items()}
        faults = {"radar_position": np.array([2e4, -1e4]), "wind": np.array([-9.0, 4.0])}
        found = {
            effect: {
                side: {"value": value, "std": 0.01}
                for side, value in zip(("north", "east"), by @ own, strict=True)
            }
            for effect, own in faults.items()
        }
        hidden = {effect: {side: one["value"] for side, one in own.items()} for effect, own in found.items()}
        policy = OnnxAgent(run / "policy.onnx")
        policy.condition(found)
        place = EnvironmentConfig(settings={**SETTINGS, "layout": layout}, reality=hidden)
        return run_episodes(policy, TASK, place, range(1)).iloc[0]

    one, other = flown(np.eye(2)), flown(turn)
    assert one["legs"] == other["legs"] > 1
    for name in ("return", "largest_probability", "time_over"):
        assert one[name] == pytest.approx(other[name], rel=1e-4)


@pytest.mark.every(
    "wind",
    [
        {"north": REALITY["wind"]["north"]},
        {"north": 3.0, "east": REALITY["wind"]["east"]},
        {"north": {"uniform": [-10.0, 10.0]}, "east": REALITY["wind"]["east"]},
    ],
)
def test_of_a_vector_both_numbers_are_drawn_alike(wind):
    with pytest.raises(ValueError, match="of wind, draw both north and east"):
        TrainConfig(**{**CONFIG, "environment": {"reality": {"wind": wind}}})


def test_several_aircraft_have_no_angle_in_common(tmp_path):
    place = {"settings": {"aircraft": 2}, "reality": {"wind": REALITY["wind"]}}
    config = TrainConfig(**{**CONFIG, "environment": place})
    with pytest.raises(ValueError, match="of a single aircraft"):
        train(config, progress=False, out=tmp_path / "run")
