"""Both fronts of the differential drive, and its task, against the exam's plant."""

import itertools
import random

import gymnasium as gym
import numpy as np
import pytest

import fieldgym  # noqa: F401 - registers the task
from exam.benches import PLACES, get_bench
from exam.plants import drive_faults
from exam.plants.drive import Drive, simulate
from fieldmodels.machines.pose_reaching.parameters import ROBOCUP
from fieldmodels.recording import Recording, Windows
from fieldmodels.registry import get_model

DRIVES = tuple(name for name, kind in PLACES.items() if kind == "drive")
STEP, COUNT, FINER = 0.05, 60, 16
BASE = {"wheel_radius": ROBOCUP.radius, "track": ROBOCUP.track}
FROM = (0.31, -0.23, 1.07)
VALUES = {
    "actuator_gain": {"gain": 1.732},
    "turn_gain": {"gain": 1.911},
    "actuator_lag": {"time_constant": 0.231},
    "actuator_rate_limit": {"rate": 2.13},
    "actuator_delay": {"delay": 0.417},
    "actuator_saturation": {"limit": 0.617},
    "actuator_dead_zone": {"width": 0.313},
    "unequal_wheels": {"difference": 0.61},
    "yaw_slip": {"share": 0.71},
    "sideways_slip": {"coefficient": 0.317},
    "slope": {"x": -0.231, "y": 0.117},
    "sensor_delay": {"delay": 0.379},
    "heading_bias": {"angle": 0.83},
    "parameter_step": {"time": 1.0, "factor": 1.731},
}
SLOW = {"actuator_lag", "actuator_rate_limit"}


def motion_for(rng, count=COUNT):
    """Speed and turn rate in random steps, some backwards, some on the spot, some at rest."""
    held = rng.integers(1, 9, size=count)
    speed = rng.uniform(-0.3, 1.0, size=count) * (rng.uniform(size=count) > 0.2)
    rate = 4.0 * rng.uniform(-1.0, 1.0, size=count) * (rng.uniform(size=count) > 0.15)
    speed[1] = 1.0  # in every drive, whatever was drawn
    return np.repeat(np.column_stack([speed, rate]), held, axis=0)[:count]


def commands_for(machine, motion):
    """The same for either front."""
    if machine == "pose_reaching":
        return motion
    half = 0.5 * BASE["track"] * motion[:, 1]
    return np.column_stack([motion[:, 0] - half, motion[:, 0] + half]) / BASE["wheel_radius"]


def shown(effects, motion, step=STEP, start=FROM):
    """What the plant shows, shape (n, 5); a third column of motion is the speed to the left."""
    plant = Drive(BASE["wheel_radius"], BASE["track"], start=start, steps=8 * FINER)
    if motion.shape[1] > 2:
        plant.across = lambda i: float(motion[i, 2])
    drive_faults.install(plant, effects)
    rows = simulate(plant, lambda i, _shown: (*motion[i, :2].tolist(),), np.zeros((len(motion), 5)), step)
    return rows[:, 2:]


def predicted(machine, effects, motion, seen, begin=0, refine=1):
    """Outputs of the model from what the sensors show at a sample on, shape (n - begin, 5).

    With ``refine`` the model runs on a finer grid of time, with the same commands held.
    """
    model = get_model(machine)
    commands = np.repeat(commands_for(machine, motion), refine, axis=0)
    count, begin = len(commands), begin * refine
    wheels = np.repeat(seen[:, 3:], refine, axis=0)
    signals = {s.name: commands[:, i] for i, s in enumerate(model.inputs)}
    signals |= {"left_wheel": wheels[:, 0], "right_wheel": wheels[:, 1]}
    windows = Windows(
        recording=Recording(time=np.arange(count) * STEP / refine, signals=signals),
        starts=np.array([begin]),
        lengths=np.array([count - begin]),
        states=seen[begin // refine, None, :3],
        observed=np.ones((1, count - begin, 5), dtype=np.bool_),
    )
    fine = model.simulate(model.vector(effects=effects), windows)[0, 0]
    out = fine[::refine].copy()
    if refine > 1:
        # A wheel's speed is the mean since the sample before, so a window's first is known from before it.
        out[0, 3:] = seen[begin // refine, 3:]
        out[1:, 3:] = np.diff(np.cumsum(fine[:, 3:], axis=0)[::refine], axis=0) / refine
    return out


@pytest.fixture
def agree_in_motion(rng, agree):
    """Nearly exact, but for rims that follow slowly, whose way the model cuts into arcs."""

    def check(machine, effects):
        motion = motion_for(rng)
        on, off = (shown(e, motion) for e in (effects, {}))
        slow = SLOW & set(effects)
        for begin in (0, 23):
            got = predicted(machine, effects, motion, on, begin, 8 if slow else 1)
            agree(got, on[begin:], off[begin:], 3e-3 if slow else 1e-6, absolute=1e-7)

    return check


@pytest.mark.every(("machine", "effect"), [(m, e) for m in DRIVES for e in get_bench(m).effects])
def test_an_effect_from_rest_and_from_what_the_sensors_show(machine, effect, agree_in_motion):
    agree_in_motion(machine, {effect: VALUES[effect]})


BEFORE_THE_RIMS = [e for e in VALUES if e.startswith("actuator") or e in ("turn_gain", "parameter_step")]
BEHIND_THE_WHEELS = [e for e in VALUES if e not in BEFORE_THE_RIMS]
QUICK = [e for e in BEFORE_THE_RIMS if e not in SLOW]
PAIRS = [*itertools.combinations(QUICK, 2), ("actuator_lag", "actuator_rate_limit")]
PAIRS += random.Random(7).sample([*itertools.product(BEFORE_THE_RIMS, BEHIND_THE_WHEELS)], 8)


def test_pairs_act_in_the_order_of_the_chain(agree_in_motion):
    """A jump within a sample is exact to a part of one."""
    for pair in PAIRS:
        agree_in_motion("pose_reaching", {effect: VALUES[effect] for effect in pair})


@pytest.mark.every("machine", DRIVES)
def test_everything_at_once(machine, agree_in_motion):
    agree_in_motion(machine, VALUES)


@pytest.mark.every("machine", DRIVES)
def test_an_episode_knows_nothing_of_the_one_before(machine, rng, agree):
    model, motion = get_model(machine), motion_for(rng)
    commands = commands_for(machine, motion)
    columns = [*(s.name for s in model.inputs), "left_wheel", "right_wheel"]
    for effect in ("actuator_delay", "actuator_rate_limit", "sensor_delay", "parameter_step"):
        effects = {effect: VALUES[effect]}
        on, off = (shown(e, motion) for e in (effects, {}))
        both, wheels = np.concatenate([1.0 - commands, commands]), np.concatenate([-on, on])[:, 3:]
        recording = Recording(
            time=np.tile(np.arange(COUNT) * STEP, 2),
            signals=dict(zip(columns, np.column_stack([both, wheels]).T, strict=True)),
            episode=np.repeat([0, 1], COUNT),
        )
        for begin in (0, 2, 23):
            windows = Windows(
                recording=recording,
                starts=np.array([COUNT + begin]),
                lengths=np.array([COUNT - begin]),
                states=on[begin, None, :3],
                observed=np.ones((1, COUNT - begin, 5), dtype=np.bool_),
            )
            got = model.simulate(model.vector(effects=effects), windows)[0, 0]
            agree(got, on[begin:], off[begin:], 3e-3)


@pytest.mark.every("machine", DRIVES)
def test_a_pose_driven_by_measured_wheels(machine, rng, agree):
    """What a diagnosis compares where the wheels are measured: whatever acts before them does nothing."""
    model, motion, weak = get_model(machine), motion_for(rng), {"actuator_gain": {"gain": 0.83}}
    columns = [*(s.name for s in model.inputs), *(s.name for s in model.outputs)]
    before = {e: VALUES[e] for e in BEFORE_THE_RIMS}
    for effect in BEHIND_THE_WHEELS:
        effects = {effect: VALUES[effect]}
        on, off = (shown(e, motion) for e in (effects | weak, weak))
        both = np.column_stack([commands_for(machine, motion), on])
        signals = dict(zip(columns, both.T, strict=True))
        windows = model.windows(Recording(time=np.arange(COUNT) * STEP, signals=signals), 0.5)
        got = model.simulate(model.vector(effects=before | effects), windows)[0]
        assert windows.lengths.sum() == COUNT
        poses = got.reshape(COUNT, -1)[:, :3]
        poses[:, 2] -= 2 * np.pi * np.round((poses[:, 2] - on[:, 2]) / (2 * np.pi))
        agree(poses, on[:, :3], off[:, :3], 1e-6)


@pytest.fixture
def agree_in_the_task(rng, agree):
    """The task's robot goes from instant to instant, 10 ms apart: within one it may be off by 0.05 mm."""

    def check(effects, drive="unicycle"):
        tick, start = 0.1, (-1.3, 0.4, -0.7)
        env = gym.make(
            "fieldgym/PoseReaching-v0", settings={"drive": drive}, reality=effects, disable_env_checker=True
        )
        settings = env.unwrapped.settings
        assert settings.tick == tick
        _, info = env.reset(seed=1, options={"pose": start})
        actions = rng.uniform((-1.0, -1.0), (0.3, 1.0), size=(8, 2)).repeat(3, axis=0).astype(np.float32)
        actions[3:6] = 0.8, -0.9
        if drive == "omnidirectional":  # to and fro, so that no wall is met
            sideways = (
                0.5 * rng.uniform(0.2, 1.0, len(actions)) * np.resize([1, 1, 1, -1, -1, -1], len(actions))
            )
            actions = np.column_stack([actions, sideways]).astype(np.float32)
            actions[:, 0] = 0.7 * np.resize([1, -1], len(actions)) * actions[:, 0]
        poses = [info["pose"]]
        for action in actions:
            _, _, terminated, _, info = env.step(action)
            assert not terminated
            assert info["wall_hits"] == 0
            poses.append(info["pose"])
        motion = np.zeros((len(poses), actions.shape[1]))
        motion[:-1, 0] = 0.5 * settings.max_speed * (1.0 + actions[:, 0])
        motion[:-1, 1] = settings.max_rate * actions[:, 1]
        if drive == "omnidirectional":
            motion[:-1, 0], motion[:-1, 2] = settings.max_speed * actions[:, (0, 2)].T
        on, off = (shown(e, motion, tick, start)[:, :3] for e in (effects, {}))
        got = np.array(poses)
        got[:, 2] = on[:, 2] + np.remainder(got[:, 2] - on[:, 2] + np.pi, 2 * np.pi) - np.pi
        agree(got, on, off, 1e-3, absolute=(5e-5, 5e-5, 1e-9))

    return check


@pytest.mark.every("effect", get_bench("pose_reaching").effects)
def test_an_effect_in_the_task(effect, agree_in_the_task):
    agree_in_the_task({effect: VALUES[effect]})
    agree_in_the_task({effect: VALUES[effect]}, "omnidirectional")


def test_pairs_in_the_task(agree_in_the_task):
    for pair in (
        ("actuator_lag", "actuator_delay"),
        ("actuator_saturation", "parameter_step"),
        ("actuator_dead_zone", "actuator_gain"),
        ("unequal_wheels", "yaw_slip"),
        ("sideways_slip", "slope"),
        ("sensor_delay", "heading_bias"),
        ("actuator_delay", "parameter_step"),
    ):
        agree_in_the_task({effect: VALUES[effect] for effect in pair})


def test_a_nominal_omnidirectional_robot_drives_exactly(rng):
    """The task's arcs are the plant's, with actions beyond the largest speed shortened to it."""
    start = (-1.3, 0.4, -0.7)
    env = gym.make("fieldgym/PoseReaching-v0", settings={"drive": "omnidirectional"})
    _, info = env.reset(seed=1, options={"pose": start})
    actions, poses = rng.uniform(-1.0, 1.0, size=(12, 3)).astype(np.float32), [info["pose"]]
    actions[0] = 1.0, 0.3, -1.0
    for action in actions:
        poses.append(env.step(action)[4]["pose"])
    length = np.maximum(np.hypot(actions[:, 0], actions[:, 2]), 1.0)
    motion = np.zeros((13, 3))
    motion[:-1] = np.column_stack([actions[:, 0] / length, 4.0 * actions[:, 1], actions[:, 2] / length])
    want = shown({}, motion, 0.1, start)[:, :3]
    np.testing.assert_allclose(np.array(poses)[:, :2], want[:, :2], rtol=0, atol=1e-7)
    np.testing.assert_allclose(np.exp(1j * np.array(poses)[:, 2]), np.exp(1j * want[:, 2]), rtol=0, atol=1e-7)
    assert env.unwrapped.step(actions[0])[4]["path_length"] == pytest.approx(
        0.1 * (np.hypot(motion[:-1, 0], motion[:-1, 2]).sum() + 1.0), rel=1e-6
    )
