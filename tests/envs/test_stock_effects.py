"""Stock effects around the tasks: what acts is what plain NumPy says, and what a model around predicts.

An environment under an actuator's effect moves as the nominal one does under commands that NumPy has
computed; a sensor's effect moves nothing, and shows what NumPy makes of what the nominal one shows.
"""

import itertools

import gymnasium as gym
import numpy as np
import pytest

import fieldgym
from fieldmodels.drivers.named import apply_reality, stepped
from fieldmodels.machines.excitation.model import ExcitationModel
from fieldmodels.machines.excitation.recording import record_experiment
from fieldmodels.machines.excitation.shaker import CHANNELS as SHAKER_CHANNELS
from fieldmodels.machines.excitation.shaker import FINEST, Shakers
from fieldmodels.machines.heel_strike.model import HeelStrikeModel
from fieldmodels.machines.heel_strike.parameters import Noise as GaitNoise
from fieldmodels.machines.heel_strike.recording import record_walk as record_gyro
from fieldmodels.machines.line_following.model import LineFollowing
from fieldmodels.machines.line_following.parameters import Noise
from fieldmodels.machines.line_following.recording import record_walk
from fieldmodels.machines.line_following.tracks import straight
from fieldmodels.machines.line_following.walks import Scene
from fieldmodels.machines.pose_reaching.model import PoseReaching
from fieldmodels.machines.uav_route.model import UavRoute
from fieldmodels.machines.uav_route.recording import record_flight
from fieldmodels.model import ModelError


def lagged(commands, time_constant, step):
    """Mean over each step behind T dF/dt = u - F, at rest at the first command."""
    force, means = commands[0], []
    for u in commands:
        kept = np.exp(-step / time_constant)
        means.append(u + (force - u) * time_constant / step * (1.0 - kept))
        force = u + (force - u) * kept
    return np.array(means)


def play(env_id, actions, reality=None, seed=3, **settings):
    """Observations and infos of an episode's beginning under given actions."""
    env = gym.make(env_id, reality=reality, settings=settings or None).unwrapped
    steps = [env.reset(seed=seed)]
    for action in actions:
        observation, _, ended, cut, info = env.step(np.atleast_1d(action).astype(np.float64))
        steps.append((observation, info))
        if ended or cut:
            break
    return np.array([o for o, _ in steps], dtype=np.float64), [i for _, i in steps]


LINE, UAV = "fieldgym/LineFollowing-v1", "fieldgym/UavRoute-v1"
STRIDE = LineFollowing().gait.stride_time
TURNS = 0.7 * np.diff(np.random.default_rng(1).uniform(-1.0, 1.0, 31))
ENDLESS = {"lost_strides": 1000, "lost_offset": 100.0}


def walked(infos):
    return np.array([(i["privileged.offset"], i["privileged.heading"]) for i in infos])


@pytest.mark.every(
    ("reality", "oracle"),
    [
        ({"steering_gain": {"gain": 0.6}}, lambda u: 0.6 * u),
        (
            {"steering_gain": {"gain": 0.8}, "steering_lag": {"time_constant": 0.9}},
            lambda u: lagged(0.8 * u, 0.9, STRIDE),
        ),
        (
            {"steering_dead_zone": {"width": 0.02}},
            lambda u: np.sign(u) * np.maximum(np.abs(u) - 0.02, 0.0),
        ),
        (
            {"steering_curve": {"low": -0.1, "high": 0.1, "value_1": 0.03, "value_2": -0.02, "value_3": 0.0}},
            lambda u: u + np.interp(u, [-0.1, 0.0, 0.1], [0.03, -0.02, 0.0]),
        ),
    ],
)
def test_a_walk_turns_as_its_steering_gives(reality, oracle):
    seen, infos = play(LINE, TURNS, reality, **ENDLESS)
    same, nominal = play(LINE, oracle(0.15 * np.clip(TURNS, -1, 1)) / 0.15, **ENDLESS)
    assert len(infos) == len(TURNS) + 1
    np.testing.assert_allclose(walked(infos), walked(nominal), atol=1e-9)
    assert np.abs(walked(infos) - walked(play(LINE, TURNS, **ENDLESS)[1])).max() > 0.02
    np.testing.assert_allclose(seen[:, :4], same[:, :4], atol=1e-6)  # what the camera sends
    np.testing.assert_allclose(seen[1:, 4], np.clip(TURNS, -1, 1), atol=1e-6)  # what the robot has sent
    np.testing.assert_allclose([i["command"] for i in infos[1:]], 0.15 * np.clip(TURNS, -1, 1))


def test_a_bent_camera_shows_what_numpy_makes_of_the_line():
    reality = {"line_bend": {"curvature": 0.7}, "line_drift": {"rate": 0.002}}
    gentle = {"track": "straight", "bias": 0.0, "misalignment": 0.0, **ENDLESS}
    seen, infos = play(LINE, TURNS, reality, **gentle)
    plain, nominal = play(LINE, TURNS, **gentle)
    np.testing.assert_array_equal(walked(infos), walked(nominal))
    true = 0.3 * plain[:, 0]
    found = np.array([i.get("lost", 0.0) for i in nominal]) == 0.0
    expected = (true + 0.7 * true * np.abs(true) + 0.002 * STRIDE * np.arange(len(true))) / 0.3
    assert found.sum() > 10
    np.testing.assert_allclose(seen[found, 0], expected[found], atol=1e-5)
    np.testing.assert_array_equal(seen[1:, 1], seen[:-1, 0])  # memory holds what was shown
    assert np.abs(seen[found, 0] - plain[found, 0]).max() > 0.05


def test_strides_that_become_shorter():
    reality = {"stride_step": {"time": 10.0 * STRIDE, "change": -0.3}}
    infos = play(LINE, np.zeros(20), reality, track="straight", yaw=0.0, lateral=0.0, bias=0.0)[1]
    nominal = play(LINE, np.zeros(20), None, track="straight", yaw=0.0, lateral=0.0, bias=0.0)[1]
    ways, own = (np.diff(walked(part)[:, 0]) for part in (infos, nominal))
    np.testing.assert_allclose(ways[:10], own[:10], atol=1e-9)
    np.testing.assert_allclose(ways[10:], own[10:] * (0.7 - 0.3) / 0.7, atol=1e-9)


WALKED = {
    "gain and lag": {"steering_gain": {"gain": 0.7}, "steering_lag": {"time_constant": 0.6}},
    "delay and play": {"steering_delay": {"delay": 0.5}, "steering_play": {"width": 0.01}},
    "bend": {"line_bend": {"curvature": 0.8}, "offset_bend": {"curvature": 0.5}},
    "curve": {
        "steering_curve": {"low": -0.1, "high": 0.1, "value_1": 0.02, "value_2": 0.0, "value_3": -0.03}
    },
    "bent camera": {
        "line_curve": {"low": -0.5, "high": 0.5, "value_1": -0.1, "value_2": 0.0, "value_3": 0.2}
    },
}


@pytest.mark.every("name", WALKED)
def test_the_model_with_the_same_effects_predicts_a_recorded_walk(name):
    """Exactly, without noise; the nominal model errs by much."""
    plain = LineFollowing()
    quiet = Scene(straight(200.0), noise=Noise(0.0, 0.0, 0.0, 0.0))
    recording = record_walk(WALKED[name], 150, scene=quiet, noise=0.0, rng=np.random.default_rng(2))
    model, truth = apply_reality(plain, WALKED[name])
    windows = plain.windows(recording, plain.horizons[1])
    measured = windows.measured(tuple(s.name for s in plain.outputs))
    error = np.nanmax(np.abs(model.simulate(truth.vector(model)[None], windows)[0] - measured))
    assert error < 1e-9
    assert np.nanmax(np.abs(plain.simulate(plain.nominal[None], windows)[0] - measured)) > 3e-3


def test_a_parameter_that_jumps_between_windows_is_predicted():
    plain, reality = LineFollowing(), {"stride_step": {"time": 60 * STRIDE, "change": -0.2}}
    quiet = Scene(straight(200.0), noise=Noise(0.0, 0.0, 0.0, 0.0))
    recording = record_walk(reality, 150, scene=quiet, noise=0.0, rng=np.random.default_rng(2))
    model, truth = apply_reality(plain, reality)
    windows = plain.windows(recording, 3 * STRIDE)
    assert 60 in windows.starts
    predicted = model.simulate(truth.vector(model)[None], windows)[0]
    measured = windows.measured(tuple(s.name for s in plain.outputs))
    np.testing.assert_allclose(predicted[..., 1:], measured[..., 1:], atol=1e-9)
    nominal = plain.simulate(plain.nominal[None], windows)[0]
    assert np.abs(nominal - measured)[windows.starts >= 60].max() > 0.01


@pytest.mark.every(
    ("env_id", "reality", "words"),
    [
        (LINE, {"offset_gain": {"gain": 1.1}}, "the commands steering; the sensors line"),
        (LINE, {"curvature_lag": {"time_constant": 1.0}}, "a robot steers"),
        ("fieldgym/LineFollowingPixels-v1", {"line_gain": {"gain": 1.1}}, "it observes images"),
        (UAV, {"to_north_lag": {"time_constant": 1.0}}, "only what takes no time"),
        (UAV, {"bank_gain": {"gain": 1.1}}, "the sensors north, east"),
        (
            "fieldgym/HeelStrike-v0",
            {"strike_gain": {"gain": 1.1}},
            "estimator's gains.*sensors gyro, strike_angle",
        ),
        ("fieldgym/HeelStrike-v0", {"strike_angle_lag": {"time_constant": 0.1}}, "only what takes no time"),
        ("fieldgym/Excitation-v0", {"pitch_lag": {"time_constant": 0.1}}, "only what takes no time"),
        ("fieldgym/Excitation-v0", {"arm_axis_gain": {"gain": 1.1}}, "the commands arm_angle"),
        (LINE, {"steering_gian": {"gain": 1.1}}, "did you mean 'steering_gain'"),
        (LINE, {"steering_lag": {"time_constant": -1.0}}, "outside"),
    ],
)
def test_what_cannot_act_in_a_task_is_said(env_id, reality, words):
    with pytest.raises(ModelError, match=words):
        gym.make(env_id, reality=reality)


def test_what_cannot_act_in_a_recording_is_said():
    with pytest.raises(ModelError, match="one axis a run"):
        record_experiment(np.random.default_rng(1), {"arm_axis_bias": {"bias": 1.0}})
    with pytest.raises(ModelError, match="its line is as it is"):
        record_walk({"curvature_bias": {"bias": 1.0}}, rng=np.random.default_rng(1))
    with pytest.raises(ModelError, match="scans are events"):
        record_flight({"scan_gap_bias": {"bias": 1.0}}, rng=np.random.default_rng(1))


def test_what_the_tasks_declare_is_in_their_models():
    from fieldmodels.registry import get_model

    for task in fieldgym.TASKS.values():
        model = get_model(task.model)
        assert set(task.channels.commands) <= {s.name for s in model.inputs}
        assert set(task.channels.observed) <= {s.name for s in model.outputs}


POSE = "fieldgym/PoseReaching-v0"
TICK = 0.1
DRIVEN = np.random.default_rng(4).uniform(-0.9, 0.9, (25, 2))
MOVED = np.array([0.5, 4.0]) * (DRIVEN + np.array([1.0, 0.0]))
"""Speeds [m/s] and turn rates [rad/s] that these actions command."""
SLOW = {"starts": "T3", "walls": "slide"}


def driven(infos):
    return np.array([i["privileged.pose"] for i in infos])


def apart(poses, others):
    gap = poses - others
    return np.abs(np.column_stack([gap[:, :2], np.angle(np.exp(1j * gap[:, 2]))])).max()


@pytest.mark.every(
    ("reality", "oracle"),
    [
        (
            {"speed_gain": {"gain": 0.7}, "turn_rate_lag": {"time_constant": 0.25}},
            lambda u: np.column_stack([0.7 * u[:, 0], lagged(u[:, 1], 0.25, TICK)]),
        ),
        (
            {"turn_rate_curve": {"low": -2.0, "high": 2.0, "value_1": 0.3, "value_2": -0.4, "value_3": 0.1}},
            lambda u: np.column_stack(
                [u[:, 0], u[:, 1] + np.interp(u[:, 1], [-2.0, 0.0, 2.0], [0.3, -0.4, 0.1])]
            ),
        ),
    ],
)
def test_a_robot_drives_as_its_drive_gives(reality, oracle):
    """A drive that gives other speeds than commanded is one that is commanded these."""
    infos = play(POSE, DRIVEN, reality, **SLOW)[1]
    nominal = play(POSE, oracle(MOVED) / [0.5, 4.0] - [1.0, 0.0], {"slope": {"x": 1e-15}}, **SLOW)[1]
    assert len(infos) == len(DRIVEN) + 1
    assert apart(driven(infos), driven(nominal)) < 1e-9
    assert apart(driven(infos), driven(play(POSE, DRIVEN, **SLOW)[1])) > 0.05


def test_a_drive_may_give_more_than_can_be_commanded_and_go_backwards():
    """A gain above 1 at full speed, and a bias against a command of nothing."""
    for bias, action, way in (
        ({"speed_gain": {"gain": 1.3}}, 1.0, 1.3),
        ({"speed_bias": {"bias": -0.2}}, -1.0, -0.2),
    ):
        infos = play(POSE, [(action, 0.0)] * 3, bias, seed=8, starts="T1")[1]
        x, y, heading = driven(infos)[0]
        there = np.array([x + 0.3 * way * np.cos(heading), y + 0.3 * way * np.sin(heading)])
        np.testing.assert_allclose(driven(infos)[-1][:2], there, atol=1e-9)
        assert infos[-1]["path_length"] == pytest.approx(0.3 * abs(way))


def test_a_robot_sees_what_its_sensors_show():
    reality = {
        "x_gain": {"gain": 1.1},
        "x_bend": {"curvature": 0.1},
        "y_delay": {"delay": 0.13},
        "heading_curve": {"low": -3.0, "high": 3.0, "value_1": 0.2, "value_2": -0.1, "value_3": 0.2},
    }
    seen, infos = play(POSE, DRIVEN, reality, **SLOW)
    _, nominal = play(POSE, DRIVEN, {"slope": {"x": 1e-15}}, **SLOW)
    assert apart(driven(infos), driven(nominal)) < 1e-12
    x, y, heading = driven(nominal).T
    x, clock = 1.1 * x + 0.1 * x * np.abs(x), TICK * np.arange(len(x))
    y = np.interp(clock - 0.13, clock, y)
    heading = heading + np.interp(heading, [-3.0, 0.0, 3.0], [0.2, -0.1, 0.2])
    ball = np.arctan2(-y, -x) - heading
    expected = np.column_stack(
        [x, y, np.cos(heading), np.sin(heading), np.log(np.hypot(x, y)), np.cos(ball), np.sin(ball)]
    )
    space = gym.make(POSE).observation_space
    np.testing.assert_allclose(seen, np.clip(expected, space.low, space.high), atol=2e-6)
    shown = np.array([i["pose"] for i in infos])
    assert apart(shown, np.column_stack([x, y, heading])) < 1e-9
    assert apart(shown, driven(infos)) > 0.1


def test_a_pose_beyond_the_walls_is_observed_within_the_space():
    env = gym.make(POSE, reality={"x_gain": {"gain": 3.0}}, settings=SLOW).unwrapped
    _, info = env.reset(seed=3)
    assert abs(info["pose"][0]) > 2.5
    for action in DRIVEN[:3]:
        assert env.observation_space.contains(env.step(action)[0])


def test_a_track_that_grows_while_a_robot_drives():
    """Unequal wheels turn a robot by their difference over the track, less and less."""
    reality = {"unequal_wheels": {"difference": 0.1}, "track_step": {"time": 0.55, "change": 0.05}}
    infos = play(POSE, np.tile([0.0, 0.0], (12, 1)), reality, seed=9)[1]
    turned = np.diff(np.unwrap(driven(infos)[:, 2]))
    own = PoseReaching()
    track = own.nominal[own.index("track")]
    share = np.clip((0.1 * np.arange(12) + 0.1 - 0.55) / 0.1, 0.0, 1.0)
    np.testing.assert_allclose(turned, -0.1 * 0.05 / (track + 0.05 * share), atol=1e-9)


LEGS = np.random.default_rng(6).uniform(-0.6, 0.2, (12, 2))
SAFE = {"lock_loss": True, "engage": 1e9, "radars": 2, "capture": 0.01}


def leg(action):
    """Heading from the bearing of the nearest radar [rad] and length [km] of a leg."""
    return np.pi * action[0], 2.5 * 200.0 ** (0.5 * (1.0 + action[1]))


@pytest.mark.every(
    ("reality", "oracle"),
    [
        (
            {"to_north_gain": {"gain": 1.1}, "to_east_bias": {"bias": -3000.0}},
            lambda n, e, t: (1.1 * n, e - 3000.0),
        ),
        (
            {"to_east_curve": {"low": -2e5, "high": 2e5, "value_1": 8e3, "value_2": -5e3, "value_3": 2e3}},
            lambda n, e, t: (n, e + np.interp(e, [-2e5, 0.0, 2e5], [8e3, -5e3, 2e3])),
        ),
        (
            {"to_north_parameter_step": {"time": 300.0, "factor": 0.9}},
            lambda n, e, t: (n * (0.9 if t >= 300.0 else 1.0), e),
        ),
    ],
)
def test_an_aircraft_flies_to_the_waypoint_that_it_is_given(reality, oracle):
    env, twin = (gym.make(UAV, reality=r, settings=SAFE).unwrapped for r in (reality, None))
    (_, info), (_, told) = env.reset(seed=5), twin.reset(seed=5)
    other = gym.make(UAV, settings=SAFE).unwrapped
    other.reset(seed=5)
    for action in LEGS:
        turn, length = leg(action)
        course = told["radial"] + turn
        north, east = 1000.0 * (told["place"] + length * np.array([np.cos(course), np.sin(course)]))
        aim = np.array(oracle(north, east, told["time"])) / 1000.0 - told["place"]
        bearing = (np.arctan2(aim[1], aim[0]) - told["radial"] + np.pi) % (2 * np.pi) - np.pi
        length = np.clip(np.hypot(*aim), 2.5, 500.0)
        towards = np.array([bearing / np.pi, 2.0 * np.log(length / 2.5) / np.log(200.0) - 1.0])
        seen, _, _, _, info = env.step(action)
        same, _, _, _, told = twin.step(towards)
        third = other.step(action)[4]
        np.testing.assert_allclose(info["place"], told["place"], atol=1e-6)
        np.testing.assert_allclose(seen, same, atol=1e-4)
    assert np.abs(info["place"] - third["place"]).max() > 1.0


def test_an_aircraft_believes_the_position_that_its_sensors_show():
    reality = {
        "sensor_bias": {"north": 2000.0, "east": 0.0},  # the model's own comes first
        "north_gain": {"gain": 1.02},
        "east_bend": {"curvature": 2e-7},
        "east_drift": {"rate": 0.5},
    }
    env = gym.make(UAV, reality=reality, settings=SAFE).unwrapped
    _, info = env.reset(seed=5)
    infos = [info]
    for action in LEGS:
        observation, *_, info = env.step(action)
        infos.append(info)
        north, east = 1000.0 * info["privileged.place"]
        shown = 1.02 * (north + 2000.0), east + 2e-7 * east * abs(east) + 0.5 * info["time"]
        np.testing.assert_allclose(info["place"], np.array(shown) / 1000.0, atol=1e-9)
        goal = info["layout.goal"] - info["place"]
        assert observation[2] == pytest.approx(np.log(np.hypot(*goal) / 100.0), abs=1e-4)
    course = infos[-2]["radial"] + leg(LEGS[-1])[0]  # from where it believed to be
    flown_leg = infos[-1]["privileged.place"] - infos[-2]["privileged.place"]
    assert abs(np.angle(np.exp(1j * (np.arctan2(flown_leg[1], flown_leg[0]) - course)))) < 1e-6


def test_an_aircraft_that_becomes_slower_leg_by_leg():
    reality = {"speed_drift": {"rate": -0.05}}
    env, other = (gym.make(UAV, reality=r, settings=SAFE).unwrapped for r in (reality, None))
    info, before = env.reset(seed=5)[1], 0.0
    other.reset(seed=5)
    begun = 0.0
    for action in LEGS:
        info, same = env.step(action)[4], other.step(action)[4]
        way, time = info["path_length"] - before, info["time"] - begun
        speed = 0.25 - 0.05e-3 * begun
        assert way / time == pytest.approx(speed, rel=1e-9)
        begun, before = info["time"], info["path_length"]
        np.testing.assert_allclose(info["path_length"], same["path_length"], rtol=1e-9)


FLOWN = {
    "gain and bias": {"to_north_gain": {"gain": 1.03}, "to_east_bias": {"bias": 4000.0}},
    "lag": {"to_north_lag": {"time_constant": 8.0}},
    "bend": {"east_bend": {"curvature": 1e-7}, "north_drift": {"rate": 1.0}},
    "curve": {"to_east_curve": {"low": -3e5, "high": 3e5, "value_1": -6e3, "value_2": 3e3, "value_3": 5e3}},
}


@pytest.mark.every("name", FLOWN)
def test_the_model_with_the_same_effects_predicts_a_recorded_flight(name):
    """The recorder integrates with complex numbers, in small pieces, sample by sample."""
    plain = UavRoute()
    recording = record_flight(FLOWN[name], 3000.0, noise=0.0, scans=False, rng=np.random.default_rng(2))
    model, truth = apply_reality(plain, FLOWN[name])
    windows = plain.windows(recording, plain.horizons[1])
    measured = windows.measured(tuple(s.name for s in plain.outputs))[..., :2]
    error = np.abs(model.simulate(truth.vector(model)[None], windows)[0][..., :2] - measured).max()
    assert error < 1.0  # [m], of 30 km flown in a window
    assert np.abs(plain.simulate(plain.nominal[None], windows)[0][..., :2] - measured).max() > 100.0


HEEL = "fieldgym/HeelStrike-v0"
GAINS = np.random.default_rng(8).uniform(-1.0, 1.0, (12, 3))


@pytest.mark.every(
    ("stock", "own"),
    [
        (
            {"gyro_curve": {"low": -1.0, "high": 1.0, "value_1": 0.01, "value_2": 0.01}},
            {"gyro_bias": {"rate": 0.01}},
        ),
        (
            {"gyro_curve": {"low": -4.0, "high": 4.0, "value_1": -0.2, "value_2": 0.0, "value_3": 0.2}},
            {"gyro_gain": {"gain": 1.05}},
        ),
        ({"length_step": {"time": 0.0, "change": 0.05}}, {"parameters": {"length": 1.05}}),
    ],
)
def test_a_stock_effect_that_is_one_of_the_walkers_own_does_the_same(stock, own):
    settings = {"gyro": 0.0, "collision": (0.0, 0.0)}  # noise comes before one and after the other
    seen, infos = play(HEEL, GAINS, stock, **settings)
    same, others = play(HEEL, GAINS, own, **settings)
    nominal = play(HEEL, GAINS, **settings)[0]
    np.testing.assert_allclose(seen, same, atol=1e-5)
    errors = np.array([[i["error_mm"], i["error_mm_ranger"], i["error_mm_ekf"]] for i in infos[1:]])
    expected = np.array([[i["error_mm"], i["error_mm_ranger"], i["error_mm_ekf"]] for i in others[1:]])
    np.testing.assert_allclose(errors, expected, atol=1e-6)
    assert np.abs(seen - nominal).max() > 0.1


def test_a_recorded_gyro_bends_and_lags_as_numpy_says():
    """The walk is the same to the bit; what is measured of it, noise included, goes through the sensor."""
    reality = {
        "gyro_bend": {"curvature": 0.1},
        "strike_angle_gain": {"gain": 1.2},
        "strike_angle_bias": {"bias": 0.01},
    }
    walk, plain = (record_gyro(10.0, np.random.default_rng(3), None, r) for r in (reality, None))
    gyro = plain["gyro"]
    np.testing.assert_array_equal(walk["strike"], plain["strike"])
    np.testing.assert_allclose(walk["gyro"], gyro + 0.1 * gyro * np.abs(gyro), atol=1e-12)
    struck = np.cumsum(plain["strike"]) > 0  # before, nothing has been measured
    np.testing.assert_allclose(
        walk["strike_angle"][struck], 1.2 * plain["strike_angle"][struck] + 0.01, atol=1e-12
    )
    late = record_gyro(10.0, np.random.default_rng(3), None, {"gyro_lag": {"time_constant": 0.02}})["gyro"]
    filtered, step, kept = [gyro[0]], 0.002, np.exp(-0.1)
    for before, now in itertools.pairwise(gyro):
        slope = (now - before) / step
        filtered.append(now - 0.02 * slope + (filtered[-1] - before + 0.02 * slope) * kept)
    np.testing.assert_allclose(late, filtered, atol=1e-9)


MEASURED = {
    "bend": ({"gyro_bend": {"curvature": 0.05}}, (1e-3, 1e-4, 1e-4, 2e-4, 2e-4)),
    "curve": (
        {"gyro_curve": {"low": -1.0, "high": 1.0, "value_1": 0.05, "value_2": 0.02, "value_3": -0.04}},
        (1e-3, 1e-4, 1e-4, 2e-4, 2e-4),
    ),
    "strike angle": ({"strike_angle_bias": {"bias": 0.02}}, (2e-3, 1e-4, 1e-4, 1e-4, 1e-4)),
}


@pytest.mark.every("name", MEASURED)
def test_the_model_with_the_same_effects_predicts_a_recorded_gait(name):
    """Also what it derives: the closures of the gyro's integral, and the push-off."""
    reality, errors = MEASURED[name]
    plain = HeelStrikeModel()
    quiet = GaitNoise(gyro=0.0, collision=0.0, process=0.0, floor=0.0)
    recording = record_gyro(30.0, np.random.default_rng(0), quiet, reality)
    model, truth = apply_reality(plain, reality)
    windows = plain.windows(recording, plain.horizons[1])
    measured = windows.measured(tuple(s.name for s in plain.outputs))

    def rms(simulated):
        return np.sqrt(np.nanmean((simulated[0] - measured) ** 2, axis=(0, 1)))

    assert (rms(model.simulate(truth.vector(model)[None], windows)) < errors).all()
    assert rms(plain.simulate(plain.nominal[None], windows)).max() > 0.01


SHAKE = "fieldgym/Excitation-v0"
SHAKEN = np.random.default_rng(2).uniform(-0.8, 0.3, (5, 3))


@pytest.mark.every(
    ("stock", "own"),
    [
        (
            {f"{what}_{axis}_gain": {"gain": 1.1} for what in ("force", "torque") for axis in "xyz"},
            {"force_torque_gain": {"gain": 1.1}},
        ),
        (
            {f"acceleration_{axis}_gain": {"gain": 1.1} for axis in "xyz"},
            {"accelerometer_gain": {"gain": 1.1}},
        ),
        (
            {
                "pitch_bias": {"bias": 0.02},
                "roll_curve": {"low": -1, "high": 1, "value_1": -0.01, "value_2": -0.01},
            },
            {"inclinometer_bias": {"pitch": 0.02, "roll": -0.01}},
        ),
        (
            {"stiffness_z_step": {"time": 0.0, "change": 300.0}, "damping_x_drift": {"rate": 0.0}},
            {"parameters": {"stiffness_z": 1800.0}},
        ),
    ],
)
def test_a_stock_effect_that_is_one_of_the_vehicles_own_does_the_same(stock, own):
    settings = {"preset": "soft", "noise_fraction": 0.02}
    seen, infos = play(SHAKE, SHAKEN, stock, **settings)
    same, others = play(SHAKE, SHAKEN, own, **settings)
    nominal = play(SHAKE, SHAKEN, **settings)[0]
    np.testing.assert_allclose(seen, same, atol=1e-4)
    np.testing.assert_allclose(
        [i["privileged.truth"] for i in infos], [i["privileged.truth"] for i in others]
    )
    assert np.abs(seen - nominal).max() > 1e-2


def test_a_stiffness_that_jumps_between_decisions_is_the_truth_from_then_on():
    reality = {"stiffness_z_step": {"time": 0.8, "change": 300.0}}
    infos = play(SHAKE, SHAKEN, reality, preset="soft")[1]
    place = ExcitationModel().index("stiffness_z")
    truth = [i["privileged.truth"][place] for i in infos]
    assert truth == [1500.0] * 3 + [1800.0] * 3


@pytest.mark.every(
    ("reality", "oracle"),
    [
        ({"arm_angle_gain": {"gain": 0.8}, "arm_angle_bias": {"bias": 0.1}}, lambda t, f: 0.8 * f + 0.1),
        ({"arm_angle_delay": {"delay": 0.03}}, lambda t, f: np.interp(t - 0.03, t, f)),
        ({"arm_angle_lag": {"time_constant": 0.05}}, lambda t, f: slowed(t, f, 0.05)),
    ],
)
def test_an_arm_moves_as_its_drive_gives(reality, oracle):
    """Its angle is what NumPy makes of the commanded one, and its derivatives are that angle's."""
    actions = np.tile([[0.3, 0.2, 0.6], [-0.5, 0.4, 0.4]], (3, 1))
    commanded, moved = (arm_of(r, actions) for r in (None, reality))
    time = 0.005 * np.arange(len(commanded))
    expected = oracle(time, commanded[:, 0])
    assert np.abs(expected - commanded[:, 0]).max() > 0.05
    np.testing.assert_allclose(moved[:, 0], expected, atol=4e-3)  # a command holds for 1.25 ms
    for k, rough in ((1, 0.02), (2, 0.2)):
        slope = np.gradient(moved[:, k - 1], time)
        inner = slice(20, -2)  # an arm that is late begins with a jolt
        np.testing.assert_allclose(moved[inner, k], slope[inner], atol=rough * np.abs(slope).max())


def slowed(time, angle, time_constant):
    """A lag behind an angle, by small steps."""
    fine = np.linspace(time[0], time[-1], 40 * (len(time) - 1) + 1)
    out, value = [], angle[0]
    for u in np.interp(fine, time, angle):
        out.append(value)
        value += (u - value) * (fine[1] - fine[0]) / time_constant
    return np.interp(time, fine, out)


def arm_of(reality, actions):
    """f, f', f'' at the samples of an episode's decisions."""
    model, truth = apply_reality(ExcitationModel(), reality, SHAKER_CHANNELS)
    own = truth.vector(model)[: len(ExcitationModel().names)]
    shakers = Shakers(1, vehicle=own, stock=stepped(model, truth, SHAKER_CHANNELS, 1, FINEST))
    shakers.restart([0], [np.random.default_rng(1)])
    parts = []
    for action in actions:
        low, high = shakers.ranges
        shaken = shakers.advance(low + (high - low) * (action + 1.0) / 2.0, traces=True)
        parts.append(shaken.motion[0] if not parts else shaken.motion[0, 1:])
    return np.concatenate(parts)


@pytest.mark.every(
    ("reality", "share"),
    [
        ({"arm_angle_gain": {"gain": 0.8}, "arm_angle_lag": {"time_constant": 0.05}}, 0.1),
        ({"force_x_bend": {"curvature": 0.05}, "pitch_bend": {"curvature": 5.0}}, 0.01),
        ({"arm_angle_curve": {"low": -4.0, "high": 4.0, "value_1": 0.6, "value_2": -0.6}}, 0.01),
    ],
)
def test_the_model_with_the_same_effects_predicts_a_recorded_experiment(reality, share):
    """The recorder works on a grid eight times finer."""
    plain = ExcitationModel()
    recording = record_experiment(np.random.default_rng(1), reality, duration=4.0, noise=False)
    model, truth = apply_reality(plain, reality)
    windows = plain.windows(recording, plain.horizons[2])
    measured = windows.measured(tuple(s.name for s in plain.outputs))

    def rms(simulated):
        return np.sqrt(np.nanmean((simulated[0] - measured) ** 2, axis=(0, 1)))

    error = rms(model.simulate(truth.vector(model)[None], windows))
    nominal = rms(plain.simulate(plain.nominal[None], windows))
    missed = nominal > 0.02 * nominal.max()
    assert (error[missed] < share * nominal[missed] + 1e-6).all()
