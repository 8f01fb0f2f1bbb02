"""Both fronts of the differential drive, and its task, against adaptive integration of what is documented."""

import itertools
import random

import gymnasium as gym
import numpy as np
import pytest

import fieldgym  # noqa: F401 - registers the task
from exam.oracles import find_oracle
from fieldmodels.machines.pose_reaching.parameters import ROBOCUP
from fieldmodels.recording import Recording, Windows
from fieldmodels.registry import get_model

STEP, COUNT = 0.05, 60
BASE = {"wheel_radius": ROBOCUP.radius, "track": ROBOCUP.track}
FROM = {"x": 0.31, "y": -0.23, "heading": 1.07}
DRIVE = {
    "actuator_gain": [{"gain": 0.613}, {"gain": 0.987}, {"gain": 1.732}],
    "turn_gain": [{"gain": 0.587}, {"gain": 1.013}, {"gain": 1.911}],
    "actuator_lag": [{"time_constant": t} for t in (1e-9, 0.0007, 0.0137, 2.37, 0.231)],
    "actuator_rate_limit": [{"rate": r} for r in (431.0, 0.37, 17.9, 2.13)],
    "actuator_delay": [{"delay": d} for d in (0.0013, 0.05, 0.0731, 0.417)],
    "actuator_saturation": [{"limit": v} for v in (0.123, 0.971, 0.617)],
    "actuator_dead_zone": [{"width": w} for w in (0.0021, 0.0437, 0.313)],
    "unequal_wheels": [{"difference": d} for d in (-0.37, -0.0113, 0.0071, 0.61)],
    "yaw_slip": [{"share": s} for s in (-0.43, -0.0127, 0.0173, 0.71)],
    "sideways_slip": [{"coefficient": c} for c in (0.0067, 0.0431, 0.283, 0.317)],
    "slope": [{"x": 0.0171, "y": -0.0093}, {"x": -0.231, "y": 0.117}, {"x": -0.087}, {"y": 0.43}],
    "sensor_delay": [{"delay": d} for d in (0.0017, 0.05, 0.0831, 0.379)],
    "heading_bias": [{"angle": a} for a in (-2.71, -0.0123, 0.0217, 0.83)],
    "parameter_step": [
        {"time": 1.337, "factor": 0.613},
        {"time": 2.0131, "factor": 0.981},
        {"time": 0.0, "factor": 1.23},
        {"time": 1.0, "factor": 1.731},
    ],
}
CASES = {"pose_reaching": DRIVE, "differential_drive": DRIVE}


def commands_for(machine, rng, count=COUNT, scale=(1.0, 4.0)):
    """Commands in random steps, some backwards, some on the spot, some at rest; for either front."""
    held = rng.integers(1, 9, size=count)
    speed = scale[0] * rng.uniform(-0.3, 1.0, size=count) * (rng.uniform(size=count) > 0.2)
    rate = scale[1] * rng.uniform(-1.0, 1.0, size=count) * (rng.uniform(size=count) > 0.15)
    speed[1] = scale[0]  # in every drive, whatever was drawn
    motion = np.repeat(np.column_stack([speed, rate]), held, axis=0)[:count]
    if machine == "pose_reaching":
        return motion
    half = 0.5 * BASE["track"] * motion[:, 1]
    return np.column_stack([motion[:, 0] - half, motion[:, 0] + half]) / BASE["wheel_radius"]


def predicted(machine, effects, commands, shown, begin=0, refine=1):
    """Outputs of the model from what the sensors show at a sample on, shape (n - begin, 5).

    With ``refine`` the model runs on a finer grid of time, with the same commands held.
    """
    model = get_model(machine)
    commands = np.repeat(commands, refine, axis=0)
    count, begin = len(commands), begin * refine
    wheels = np.repeat(shown[:, 3:], refine, axis=0)
    signals = {s.name: commands[:, i] for i, s in enumerate(model.inputs)}
    signals |= {"left_wheel": wheels[:, 0], "right_wheel": wheels[:, 1]}
    windows = Windows(
        recording=Recording(time=np.arange(count) * STEP / refine, signals=signals),
        starts=np.array([begin]),
        lengths=np.array([count - begin]),
        states=shown[begin // refine, None, :3],
        observed=np.ones((1, count - begin, 5), dtype=np.bool_),
    )
    fine = model.simulate(model.vector(effects=effects), windows)[0, 0]
    out = fine[::refine].copy()
    if refine > 1:
        # A wheel's speed is the mean since the sample before, so a window's first is known from before it.
        out[0, 3:] = shown[begin // refine, 3:]
        out[1:, 3:] = np.diff(np.cumsum(fine[:, 3:], axis=0)[::refine], axis=0) / refine
    return out


@pytest.fixture
def agree_in_motion(agree):
    """Exact to rounding, but for rims that follow slowly: there the way is cut into arcs.

    Four between two samples; a grid eight times finer leaves 0.2 % of what a lag far below a sample does.
    """

    def check(machine, effects, commands, begins=(0,), start=FROM):
        oracle = find_oracle(machine)
        on, off = (oracle.simulate(BASE, e, commands, STEP, start) for e in (effects, {}))
        slow = {"actuator_lag", "actuator_rate_limit"} & set(effects)
        for begin in begins:
            got = predicted(machine, effects, commands, on, begin, 8 if slow else 1)
            agree(got, on[begin:], off[begin:], 3e-3 if slow else 1e-8)

    return check


def test_the_model_from_rest_and_from_what_the_sensors_show(machine, effect, values, rng, agree_in_motion):
    agree_in_motion(machine, {effect: values}, commands_for(machine, rng), begins=(0, 23))


@pytest.mark.parametrize("machine", CASES)
@pytest.mark.parametrize("values", [{"delay": 0.0731}, {"delay": 0.21}])
@pytest.mark.parametrize("effect", ["actuator_delay", "sensor_delay"])
def test_a_robot_that_already_drives(machine, effect, values, rng, agree_in_motion):
    start = {**FROM, "left_rim": 0.31, "right_rim": 0.47}
    agree_in_motion(machine, {effect: values}, commands_for(machine, rng), start=start)


BEFORE_THE_RIMS = [e for e in DRIVE if e.startswith("actuator") or e in ("turn_gain", "parameter_step")]
PAIRS = [*itertools.combinations(BEFORE_THE_RIMS, 2)]
PAIRS += random.Random(7).sample([p for p in itertools.combinations(DRIVE, 2) if p not in PAIRS], 12)


@pytest.mark.parametrize("pair", PAIRS, ids="+".join)
def test_pairs_act_in_the_order_of_the_chain(pair, rng, agree_in_motion):
    """Of each effect the last value, which is large; a jump within a sample is exact to a part of one."""
    effects = {effect: DRIVE[effect][-1] for effect in pair}
    agree_in_motion("pose_reaching", effects, commands_for("pose_reaching", rng), begins=(0, 23))


@pytest.mark.parametrize("machine", CASES)
@pytest.mark.parametrize(
    "effect", ["actuator_delay", "actuator_rate_limit", "sensor_delay", "parameter_step"]
)
def test_an_episode_knows_nothing_of_the_one_before(machine, effect, rng, agree):
    model, values = get_model(machine), DRIVE[effect][-1]
    commands, start = commands_for(machine, rng), {**FROM, "left_rim": 0.31, "right_rim": 0.47}
    simulate = find_oracle(machine).simulate
    on, off = (simulate(BASE, e, commands, STEP, start) for e in ({effect: values}, {}))
    both, wheels = np.concatenate([1.0 - commands, commands]), np.concatenate([-on, on])[:, 3:]
    columns = [*(s.name for s in model.inputs), "left_wheel", "right_wheel"]
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
        got = model.simulate(model.vector(effects={effect: values}), windows)[0, 0]
        agree(got, on[begin:], off[begin:], 3e-3)


@pytest.mark.parametrize("machine", CASES)
def test_everything_at_once(machine, rng, agree_in_motion):
    effects = {effect: values[-1] for effect, values in DRIVE.items()}
    agree_in_motion(machine, effects, commands_for(machine, rng), begins=(0, 23))


BEHIND_THE_WHEELS = [e for e in DRIVE if e not in BEFORE_THE_RIMS]


@pytest.mark.parametrize("effect", BEHIND_THE_WHEELS)
@pytest.mark.parametrize("machine", CASES)
def test_a_pose_driven_by_measured_wheels(machine, effect, rng, agree):
    """What a diagnosis compares where the wheels are measured: whatever acts before them does nothing."""
    model, commands, horizon = get_model(machine), commands_for(machine, rng), 0.5
    effects = {effect: DRIVE[effect][-1], "actuator_gain": {"gain": 0.83}}
    simulate = find_oracle(machine).simulate
    on, off = (simulate(BASE, e, commands, STEP, FROM) for e in (effects, {"actuator_gain": {"gain": 0.83}}))
    columns = [*(s.name for s in model.inputs), *(s.name for s in model.outputs)]
    signals = dict(zip(columns, np.column_stack([commands, on]).T, strict=True))
    windows = model.windows(Recording(time=np.arange(COUNT) * STEP, signals=signals), horizon)
    before = {e: DRIVE[e][-1] for e in BEFORE_THE_RIMS}
    got = model.simulate(model.vector(effects={**before, effect: effects[effect]}), windows)[0]
    assert windows.lengths.sum() == COUNT
    shown = got.reshape(COUNT, -1)[:, :3]
    shown[:, 2] -= 2 * np.pi * np.round((shown[:, 2] - on[:, 2]) / (2 * np.pi))
    agree(shown, on[:, :3], off[:, :3], 1e-8)


@pytest.fixture
def agree_in_the_task(rng, agree):
    """The task's robot goes from instant to instant, 10 ms apart: within one it may be off by 0.05 mm."""

    def check(effects, drive="unicycle"):
        tick, start = 0.1, {"x": -1.3, "y": 0.4, "heading": -0.7}
        env = gym.make(
            "fieldgym/PoseReaching-v0", settings={"drive": drive}, reality=effects, disable_env_checker=True
        )
        settings = env.unwrapped.settings
        assert settings.tick == tick
        _, info = env.reset(seed=1, options={"pose": tuple(start.values())})
        actions = rng.uniform((-1.0, -1.0), (0.3, 1.0), size=(8, 2)).repeat(3, axis=0).astype(np.float32)
        actions[3:6] = 0.8, -0.9
        if drive == "omnidirectional":  # to and fro, so that no wall is met
            sideways = (
                0.5 * rng.uniform(0.2, 1.0, len(actions)) * np.resize([1, 1, 1, -1, -1, -1], len(actions))
            )
            actions = np.column_stack([actions, sideways]).astype(np.float32)
            actions[:, 0] = 0.7 * np.resize([1, -1], len(actions)) * actions[:, 0]
        shown = [info["pose"]]
        for action in actions:
            _, _, terminated, _, info = env.step(action)
            assert not terminated
            assert info["wall_hits"] == 0
            shown.append(info["pose"])
        commands = np.zeros((len(shown), actions.shape[1]))
        commands[:-1, 0] = 0.5 * settings.max_speed * (1.0 + actions[:, 0])
        commands[:-1, 1] = settings.max_rate * actions[:, 1]
        if drive == "omnidirectional":
            commands[:-1, 0], commands[:-1, 2] = settings.max_speed * actions[:, (0, 2)].T
        simulate = find_oracle("pose_reaching").simulate
        on, off = (simulate(BASE, e, commands, tick, start)[:, :3] for e in (effects, {}))
        got = np.array(shown)
        got[:, 2] = on[:, 2] + np.remainder(got[:, 2] - on[:, 2] + np.pi, 2 * np.pi) - np.pi
        agree(got, on, off, 1e-3, absolute=(5e-5, 5e-5, 1e-9))

    return check


def test_the_task(effect, values, agree_in_the_task):
    agree_in_the_task({effect: values})


IN_THE_TASK = [
    ("actuator_lag", "actuator_delay"),
    ("actuator_saturation", "parameter_step"),
    ("actuator_dead_zone", "actuator_gain"),
    ("unequal_wheels", "yaw_slip"),
    ("sideways_slip", "slope"),
    ("sensor_delay", "heading_bias"),
    ("actuator_delay", "parameter_step"),
]


@pytest.mark.parametrize("pair", IN_THE_TASK, ids="+".join)
def test_pairs_in_the_task(pair, agree_in_the_task):
    agree_in_the_task({effect: DRIVE[effect][-1] for effect in pair})


@pytest.mark.parametrize("effect", DRIVE)
def test_an_omnidirectional_robot(effect, agree_in_the_task):
    agree_in_the_task({effect: DRIVE[effect][-1]}, "omnidirectional")


def test_a_nominal_omnidirectional_robot_drives_exactly(rng):
    """The task's arcs against adaptive integration, with actions beyond the largest speed shortened to it."""
    start = {"x": -1.3, "y": 0.4, "heading": -0.7}
    env = gym.make("fieldgym/PoseReaching-v0", settings={"drive": "omnidirectional"})
    _, info = env.reset(seed=1, options={"pose": tuple(start.values())})
    actions, shown = rng.uniform(-1.0, 1.0, size=(12, 3)).astype(np.float32), [info["pose"]]
    actions[0] = 1.0, 0.3, -1.0
    for action in actions:
        shown.append(env.step(action)[4]["pose"])
    length = np.maximum(np.hypot(actions[:, 0], actions[:, 2]), 1.0)
    commands = np.vstack(
        [
            np.column_stack([actions[:, 0] / length, 4.0 * actions[:, 1], actions[:, 2] / length]),
            0 * actions[:1],
        ]
    )
    want = find_oracle("pose_reaching").simulate(BASE, {}, commands, 0.1, start)[:, :3]
    np.testing.assert_allclose(np.array(shown)[:, :2], want[:, :2], rtol=0, atol=1e-7)
    np.testing.assert_allclose(np.exp(1j * np.array(shown)[:, 2]), np.exp(1j * want[:, 2]), rtol=0, atol=1e-7)
    assert env.unwrapped.step(actions[0])[4]["path_length"] == pytest.approx(
        0.1 * (np.hypot(commands[:-1, 0], commands[:-1, 2]).sum() + 1.0), rel=1e-6
    )
