"""Domain randomisation: what is drawn acts, is told, is restored, and is what a fixed reality of it is."""

import pickle

import gymnasium as gym
import numpy as np
import pytest

import fieldgym
from fieldgym.info import part
from fieldmodels.model import ModelError
from fieldmodels.sampling import Choice, Uniform

RANDOM = {
    "fieldgym/Excitation-v0": {
        "payload": {"mass": {"uniform": [0.0, 0.3]}},
        "accelerometer_gain": {"gain": {"choice": [1.0, 1.05]}},
    },
    "fieldgym/HeelStrike-v0": {
        "gyro_bias": {"rate": {"normal": [0.0, 0.05]}},
        "gyro_delay": {"delay": {"choice": [0.0, 0.013]}},
        "parameters": {"length": {"uniform": [0.9, 1.1]}},
    },
    "fieldgym/LineFollowing-v1": {
        "steering_bias": {"turn": {"uniform": [-0.05, 0.05]}},
        "parameters": {"camera_height": {"uniform": [0.8, 1.2]}, "stride": {"choice": [0.6, 0.7, 0.8]}},
    },
    "fieldgym/PoseReaching-v0": {
        "actuator_lag": {"time_constant": {"choice": [0.0, 0.05, 0.2]}},
        "heading_bias": {"angle": {"choice": [0.0, 0.1]}},
    },
    "fieldgym/UavRoute-v1": {
        "wind": {"north": {"uniform": [-40.0, 40.0]}, "east": {"uniform": [-40.0, 40.0]}},
        "sensor_bias": {"north": {"choice": [0.0, 3000.0]}},
    },
}
RANDOM["fieldgym/LineFollowingPixels-v1"] = RANDOM["fieldgym/LineFollowing-v1"]
STOCK = {
    "fieldgym/LineFollowing-v1": {
        "steering_lag": {"time_constant": {"uniform": [0.0, 1.0]}},
        "steering_delay": {"delay": {"choice": [0.0, 0.7, 1.9]}},
        "steering_play": {"width": {"uniform": [0.0, 0.05]}},
        "line_lag": {"time_constant": {"uniform": [0.0, 0.5]}},
        "line_bend": {"curvature": {"uniform": [-0.5, 0.5]}},
        "stride_drift": {"rate": {"uniform": [-0.002, 0.002]}},
    },
    "fieldgym/LineFollowingPixels-v1": {
        "steering_curve": {
            "low": -0.15,
            "high": 0.15,
            "value_1": {"uniform": [-0.05, 0.05]},
            "value_2": 0.0,
            "value_3": {"uniform": [-0.05, 0.05]},
        },
        "camera_height_step": {"time": 3.0, "change": {"uniform": [-0.3, 0.3]}},
    },
    "fieldgym/PoseReaching-v0": {
        "speed_gain": {"gain": {"uniform": [0.5, 1.5]}},
        "turn_rate_rate_limit": {"rate": {"uniform": [5.0, 20.0]}},
        "turn_rate_lag": {"time_constant": {"choice": [0.0, 0.2]}},
        "x_delay": {"delay": {"choice": [0.0, 0.17]}},
        "heading_lag": {"time_constant": {"uniform": [0.0, 0.2]}},
        "y_quantisation": {"step": {"uniform": [0.0, 0.05]}},
        "track_drift": {"rate": {"uniform": [0.0, 0.005]}},
    },
    "fieldgym/UavRoute-v1": {
        "to_north_play": {"width": {"uniform": [0.0, 20e3]}},
        "to_east_gain": {"gain": {"uniform": [0.9, 1.1]}},
        "north_bend": {"curvature": {"uniform": [0.0, 1e-7]}},
        "east_quantisation": {"step": {"uniform": [0.0, 5e3]}},
        "speed_drift": {"rate": {"uniform": [-0.02, 0.02]}},
    },
    "fieldgym/HeelStrike-v0": {
        "gyro_bend": {"curvature": {"uniform": [-0.2, 0.2]}},
        "gyro_lag": {"time_constant": {"choice": [0.0, 0.004, 0.02]}},
        "strike_angle_bias": {"bias": {"uniform": [0.0, 0.02]}},
        "length_drift": {"rate": {"uniform": [-0.01, 0.01]}},
    },
    "fieldgym/Excitation-v0": {
        "arm_angle_gain": {"gain": {"uniform": [0.8, 1.2]}},
        "arm_angle_lag": {"time_constant": {"choice": [0.0, 0.03]}},
        "arm_angle_delay": {"delay": {"choice": [0.0, 0.011]}},
        "pitch_bend": {"curvature": {"uniform": [0.0, 2.0]}},
        "force_x_lag": {"time_constant": {"uniform": [0.0, 0.02]}},
        "stiffness_z_drift": {"rate": {"uniform": [-20.0, 20.0]}},
    },
}
"""The same of stock effects around a task, with all that they remember."""
IDS = sorted(task.env_id for task in fieldgym.TASKS.values())
CASES = [(name, RANDOM[name]) for name in IDS] + [(name, STOCK[name]) for name in STOCK]
every_environment = pytest.mark.every(("env_id", "reality"), CASES)


def plain(reality, i=None):
    """A reality out of an info, of one row of a batch or of a scalar environment."""
    return {
        effect: {
            name: float(value if i is None else value[i])
            for name, value in values.items()
            if not name.startswith("_")
        }
        for effect, values in reality.items()
        if not effect.startswith("_")
    }


def equal(a, b):
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(equal(a[k], b[k]) for k in a)
    return np.array_equal(a, b, equal_nan=np.asarray(a).dtype.kind == "f")


def without_drawn(info):
    return {
        k: v for k, v in info.items() if not k.startswith(("privileged.reality.", "privileged.settings."))
    }


@every_environment
def test_a_fixed_reality_of_what_was_drawn_is_the_same_to_the_bit(env_id, reality):
    """And so it acts: the six realities differ, and so do their episodes."""
    env = gym.make(env_id, reality=reality).unwrapped
    seen = []
    for seed in range(6):
        observation, info = env.reset(seed=seed)
        told = plain(part(info, "privileged.reality"))
        twin = gym.make(env_id, reality=told).unwrapped
        expected, other = twin.reset(seed=seed)
        assert np.array_equal(observation, expected)
        assert equal(without_drawn(info), other)
        env.action_space.seed(seed)
        for _ in range(12):
            action = env.action_space.sample()
            ours, theirs = env.step(action), twin.step(action)
            assert env.observation_space.contains(ours[0])
            assert equal(dict(enumerate(ours[:4])), dict(enumerate(theirs[:4])))
            assert plain(part(ours[4], "privileged.reality")) == told
            assert equal(without_drawn(ours[4]), theirs[4])
            if ours[2] or ours[3]:
                break
        seen.append(told)
    assert all(a != b for k, a in enumerate(seen) for b in seen[:k]) or len({str(s) for s in seen}) >= 3


@every_environment
def test_what_is_drawn_acts(env_id, reality):
    """Equal seeds and actions, each reality in turn: episodes of different realities differ."""
    env = gym.make_vec(env_id, num_envs=6, reality=reality)
    _, info = env.reset(seed=0)
    drawn = [plain(part(info, "privileged.reality"), i) for i in range(6)]
    ends = {}
    for told in drawn:
        twin = gym.make(env_id, reality=told).unwrapped
        twin.reset(seed=0)
        twin.action_space.seed(0)
        trace = b""
        for _ in range(6):
            step = twin.step(twin.action_space.sample())
            trace += step[0].tobytes() + np.float64(step[1]).tobytes()
            if step[2] or step[3]:
                break
        ends[str(told)] = trace
    assert len(ends) >= 3
    assert len(set(ends.values())) == len(ends)


@every_environment
def test_rows_are_scalar_environments_also_after_restarts(env_id, reality):
    native = gym.make_vec(env_id, num_envs=3, vectorization_mode="vector_entry_point", reality=reality)
    scalar = gym.make_vec(env_id, num_envs=3, vectorization_mode="sync", reality=reality)
    assert equal(dict(enumerate(native.reset(seed=4))), dict(enumerate(scalar.reset(seed=4))))
    native.action_space.seed(1)
    restarts = 0
    for _ in range(170):
        actions = native.action_space.sample()
        ours, theirs = native.step(actions), scalar.step(actions)
        for a, b in zip(ours, theirs, strict=True):
            assert equal(a, b) if isinstance(a, dict) else np.array_equal(a, b)
        restarts += (ours[2] | ours[3]).sum()
        if restarts > 6:
            break
    assert restarts or "HeelStrike" in env_id


@every_environment
def test_snapshots_restore_what_was_drawn_and_what_will_be(env_id, reality):
    env = gym.make_vec(env_id, num_envs=2, reality=reality)
    env.reset(seed=4)
    env.action_space.seed(1)
    actions = [env.action_space.sample() for _ in range(8)]
    for action in actions[:3]:
        env.step(action)
    state, travelling = env.get_state(), pickle.dumps(env)
    first = [env.step(a) for a in actions] + [env.reset()]
    for other in (env, gym.make_vec(env_id, num_envs=2, reality=reality), pickle.loads(travelling)):
        if other is env or not other._ready:  # the one that has travelled stands where it stood
            other.set_state(state)
        again = [other.step(a) for a in actions] + [other.reset()]
        for a, b in zip(first, again, strict=True):
            assert equal(dict(enumerate(a)), dict(enumerate(b)))
    fixed = gym.make_vec(env_id, num_envs=2)
    fixed.reset(seed=0)
    with pytest.raises(ValueError, match="get_state"):
        env.set_state(fixed.get_state())


SETTINGS = {
    "fieldgym/LineFollowing-v1": {
        "limit": {"choice": [0.1, 0.2]},
        "latency_strides": {"choice": [0, 1]},
        "offset": {"uniform": [0.0, 0.4]},
    },
    "fieldgym/LineFollowingPixels-v1": {"light": {"uniform": [0.5, 1.0]}, "tape": {"choice": ["gaffer"]}},
    "fieldgym/PoseReaching-v0": {"max_speed": {"uniform": [0.5, 1.5]}, "max_rate": {"choice": [2.0, 4.0]}},
    "fieldgym/UavRoute-v1": {"speed": {"uniform": [0.15, 0.4]}, "engage": {"choice": [10.0, 1e6]}},
    "fieldgym/HeelStrike-v0": {
        "process": [0.05, {"uniform": [0.2, 0.9]}],
        "push_off": {"uniform": [0.4, 0.9]},
    },
    "fieldgym/Excitation-v0": {
        "preset": {"choice": ["table1", "soft"]},
        "limits": {"choice": ["paper", "wide"]},
        "noise_fraction": {"uniform": [0.05, 0.2]},
    },
}


@pytest.mark.every("env_id", STOCK)
def test_drawn_settings_and_drawn_effects_around_them_are_each_row_s_own(env_id):
    envs = gym.make_vec(env_id, num_envs=3, reality=STOCK[env_id], settings=SETTINGS[env_id])
    observation, info = envs.reset(seed=4)
    truth, told = part(info, "privileged.reality"), part(info, "privileged.settings")
    envs.action_space.seed(1)
    actions = [envs.action_space.sample() for _ in range(6)]
    steps = [envs.step(action) for action in actions[:3]]
    state = envs.get_state()
    steps += [envs.step(action) for action in actions[3:]]
    for i in range(3):
        own = {
            name: told[name][i].tolist() if told[name].ndim > 1 else told[name][i]
            for name in told
            if name[0] != "_"
        }
        twin = gym.make(env_id, reality=plain(truth, i), settings=own).unwrapped
        assert np.array_equal(twin.reset(seed=4 + i)[0], observation[i])
        for action, step in zip(actions, steps, strict=True):
            one = twin.step(action[i])
            assert all(np.array_equal(one[k], step[k][i]) for k in range(4))
            if one[2] or one[3]:
                break
    fresh = gym.make_vec(env_id, num_envs=3, reality=STOCK[env_id], settings=SETTINGS[env_id])
    fresh.set_state(state)
    again = [fresh.step(action) for action in actions[3:]] + [fresh.reset()]
    for a, b in zip([*steps[3:], envs.reset()], again, strict=True):
        assert equal(dict(enumerate(a)), dict(enumerate(b)))


def test_every_row_and_every_episode_draws_its_own():
    env = gym.make_vec(
        "fieldgym/PoseReaching-v0",
        num_envs=64,
        settings={"timeout": 0.3},
        reality={"yaw_slip": {"share": Uniform(0.0, 0.5)}},
    )
    _, info = env.reset(seed=0)
    draws = [info["privileged.reality.yaw_slip.share"]]
    for _ in range(7):
        info = env.step(np.zeros((64, 2), np.float32))[4]
        draws.append(info["privileged.reality.yaw_slip.share"])
    assert len(np.unique(draws)) == 128  # one for each of two episodes; equal within each
    assert np.array_equal(draws[0], draws[3])
    assert not np.array_equal(draws[3], draws[4])


def test_a_drawn_slip_turns_each_robot_by_what_its_info_says():
    env = gym.make_vec(
        "fieldgym/PoseReaching-v0", num_envs=5, reality={"yaw_slip": {"share": {"uniform": [0.0, 0.5]}}}
    )
    _, info = env.reset(seed=0, options={"pose": (1.0, 0.5, 0.0)})
    share = info["privileged.reality.yaw_slip.share"]
    _, _, _, _, info = env.step(np.tile(np.array([0.0, 0.5], np.float32), (5, 1)))
    np.testing.assert_allclose(info["pose"][:, 2], 0.1 * 2.0 * (1.0 - share), rtol=1e-9)
    assert np.ptp(share) > 0.1


def test_settings_are_drawn_too():
    settings = {
        "starts": {"choice": ["T1", "T2"]},
        "max_speed": {"uniform": [0.5, 1.5]},
        "success": {"choice": ["strict", "loose"]},
        "timeout": {"log_uniform": [0.3, 3.0]},
        "wall_cost": Choice((0.0, 5.0)),
    }
    env = gym.make_vec("fieldgym/PoseReaching-v0", num_envs=16, settings=settings)
    observation, info = env.reset(seed=3)
    told = part(info, "privileged.settings")
    assert set(told["starts"]) == {"T1", "T2"}
    for i in range(16):
        own = {name: told[name][i] for name in settings}
        twin = gym.make("fieldgym/PoseReaching-v0", settings=own).unwrapped
        expected, _ = twin.reset(seed=3 + i)
        assert np.array_equal(observation[i], expected)
    env.action_space.seed(0)
    chosen = [{name: told[name][i] for name in settings} for i in range(16)]
    twins = [gym.make("fieldgym/PoseReaching-v0", settings=own).unwrapped for own in chosen]
    for i, twin in enumerate(twins):
        twin.reset(seed=3 + i)
    over = np.zeros(16, dtype=bool)
    for _ in range(12):
        actions = env.action_space.sample()
        step = env.step(actions)
        for i, twin in enumerate(twins):
            if not over[i]:
                one = twin.step(actions[i])
                assert [step[k][i] for k in (1, 2, 3)] == list(one[1:4])
                assert np.array_equal(step[0][i], one[0])
        over |= step[2] | step[3]
    assert 0 < over.sum() < 16
    state = env.get_state()
    after = env.step(actions)
    fresh = gym.make_vec("fieldgym/PoseReaching-v0", num_envs=16, settings=settings)
    fresh.set_state(state)
    assert equal(dict(enumerate(after)), dict(enumerate(fresh.step(actions))))


def test_drawn_capture_and_number_of_legs_end_each_flight():
    settings = {"capture": {"uniform": [5.0, 80.0]}, "max_legs": {"uniform": [2, 6]}}
    env = gym.make_vec("fieldgym/UavRoute-v1", num_envs=24, settings=settings)
    _, info = env.reset(seed=3)
    told = part(info, "privileged.settings")
    assert set(told["max_legs"]) == {2, 3, 4, 5, 6}
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(6)]
    steps = [env.step(action) for action in actions]
    for i in range(24):
        own = {name: told[name][i].item() for name in settings}
        twin = gym.make("fieldgym/UavRoute-v1", settings=own).unwrapped
        twin.reset(seed=3 + i)
        for action, step in zip(actions, steps, strict=True):
            one = twin.step(action[i])
            assert [step[k][i] for k in (1, 2, 3)] == list(one[1:4])
            assert np.array_equal(step[0][i], one[0])
            if one[2]:
                break
        else:
            pytest.fail("no episode is longer than these legs")


@pytest.mark.every(
    ("settings", "words"),
    [
        ({"max_speed": {"uniform": [0, 1]}}, "max_speed: uniform.*can draw 0"),
        ({"max_speed": {"uniform": [2, 1]}}, "max_speed: uniform needs its smaller end first"),
        ({"max_speed": {"uniformly": [1, 2]}}, "max_speed: no sampler 'uniformly'; |max_speed.*did you mean"),
        (
            {"tick": {"uniform": [0.1, 0.2]}},
            "tick: one value holds for all.*may be starts, success",
        ),
        ({"starts": {"choice": ["T1", "T9"]}}, "starts: a choice out of 'T1', 'T2', 'T3'"),
        ({"starts": {"uniform": [0, 1]}}, "starts: a choice out of"),
        (
            {"max_speed": {"uniform": [2, 1]}, "nonsense": 1},
            "max_speed: uniform(.|\n)*nonsense: unknown",
        ),
    ],
)
def test_settings_that_cannot_be_drawn_are_named(settings, words):
    with pytest.raises(fieldgym.SettingsError, match=words):
        gym.make("fieldgym/PoseReaching-v0", settings=settings)


def test_a_wind_that_could_not_be_flown_in_is_refused_before_anything_runs():
    with pytest.raises(ModelError, match="wind is as fast"):
        gym.make(
            "fieldgym/UavRoute-v1",
            reality={"wind": {"north": {"uniform": [0, 70]}}},
            settings={"speed": 0.05},
        )


def test_a_fixed_value_beside_a_random_one_draws_nothing():
    both = {"yaw_slip": {"share": {"uniform": [0.0, 0.5]}}, "heading_bias": {"angle": 0.1}}
    one = {"yaw_slip": {"share": {"uniform": [0.0, 0.5]}}}
    told = []
    for reality in (both, one):
        env = gym.make("fieldgym/PoseReaching-v0", reality=reality).unwrapped
        infos = env.reset(seed=1)[1], env.reset()[1]
        told.append([part(info, "privileged.reality")["yaw_slip"] for info in infos])
    assert told[0] == told[1]
