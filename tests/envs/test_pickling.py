"""Every environment travels: pickled in the middle of an episode, it goes on identically elsewhere."""

from __future__ import annotations

import copy
import pickle
import subprocess
import sys

import cloudpickle
import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import fieldgym
from fieldgym import BENCH
from fieldgym.bench import as_env
from fieldmodels.registry import get_model

OWN = """
from fieldmodels.effects import actuator, friction, sensor
from fieldmodels.machine import Machine, number
from fieldmodels.model import Signal


class Motor(Machine):
    inputs = (Signal("voltage", "V"),)
    states = outputs = (Signal("speed", "rad/s", noise=0.2),)
    gain = number("rad/s/V", 10.0, 0.0, 1e3)
    time_constant = number("s", 0.1, 0.01, 10.0)
    effects = actuator("voltage") + friction("speed") + sensor("speed")

    def derivative(self, state, input, p):
        return (p.gain * input.voltage - state.speed) / p.time_constant
"""
DRAWN = {"actuator_gain": {"gain": {"uniform": [0.5, 1.5]}}}
IDS = [task.env_id for task in fieldgym.TASKS.values()]


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    path = tmp_path_factory.mktemp("own") / "motor.py"
    path.write_text(OWN)
    return str(path)


def made(env_id, own, vector):
    options = {"machine": own, "reality": DRAWN} if env_id == BENCH else {}
    if vector:
        return gym.make_vec(env_id, num_envs=3, autoreset_mode=vector, **options)
    return gym.make(env_id, **options)


def goes_on(env, steps):
    """What follows, its own actions included; a scalar environment begins anew where an episode ends."""
    seen = []
    for _ in range(steps):
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
        seen.append((observation, reward, terminated, truncated, info))
        if np.all(terminated | truncated) and not isinstance(env, gym.vector.VectorEnv):
            seen.append(env.reset())
    return seen


ELSEWHERE = """
import pickle, sys
env = pickle.load(sys.stdin.buffer)
pickle.dump([env.step(env.action_space.sample()) for _ in range(40)], sys.stdout.buffer)
"""


def same(a, b):
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, (list, tuple)):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, np.ndarray) and a.dtype == object:
        return same(a.tolist(), b.tolist())
    return np.array_equal(a, b, equal_nan=isinstance(a, float) or np.asarray(a).dtype.kind == "f")


@pytest.mark.every("vector", [None, AutoresetMode.SAME_STEP])
@pytest.mark.every("env_id", [*IDS, BENCH])
def test_it_goes_on_identically(env_id, vector, own):
    env = made(env_id, own, vector)
    env.action_space.seed(4)
    env.reset(seed=7)
    goes_on(env, 3)
    copies = [pickle.loads(pickle.dumps(env)), cloudpickle.loads(cloudpickle.dumps(env)), copy.deepcopy(env)]
    expected = goes_on(env, 6)
    for other in copies:
        assert other.unwrapped is not env.unwrapped
        assert same(goes_on(other, 6), expected)
        assert other.spec == env.spec


def test_in_another_process_with_a_machine_of_a_file(own):
    """A started process knows nothing of the file but what the pickle says."""
    env = as_env(get_model(own), {"duration": 0.5})
    env.reset(seed=1)
    goes_on(env, 3)
    run = subprocess.run(
        [sys.executable, "-c", ELSEWHERE], input=pickle.dumps(env), capture_output=True, check=True
    )
    assert same(pickle.loads(run.stdout), goes_on(env, 40))


def test_before_the_first_reset_and_in_pictures():
    env = gym.make("fieldgym/PoseReaching-v0", render_mode="rgb_array")
    env.reset(seed=2)
    twin = pickle.loads(pickle.dumps(env))
    assert twin.render().shape == (540, 960, 3)
    fresh = pickle.loads(pickle.dumps(gym.make("fieldgym/UavRoute-v1")))
    with pytest.raises(gym.error.ResetNeeded):
        fresh.step(fresh.action_space.sample())
    fresh.reset(seed=2)


@pytest.mark.every("name", ["rig", "pendulum", "propeller_arm", "servo"])
def test_a_machine_that_has_run_pickles(name):
    machine = get_model(name)
    machine.driver  # noqa: B018 - compiled, and no part of the pickle
    assert pickle.loads(pickle.dumps(machine)).names == machine.names
