"""Robots in play: starts, ticks, arrival, walls, score, and effects against the model of the diagnosis."""

import math

import numpy as np
import pytest

from fieldmodels.machines.pose_reaching.batch import Robots, Rules
from fieldmodels.machines.pose_reaching.dubins import dubins_path
from fieldmodels.machines.pose_reaching.kernel import NUMBERS, ROBOT
from fieldmodels.machines.pose_reaching.model import PoseReaching
from fieldmodels.machines.pose_reaching.parameters import GOAL, Arrival, Field
from fieldmodels.model import ModelError
from fieldmodels.recording import Recording, Windows

MODEL = PoseReaching()


def make(batch=1, poses=None, seed=0, reality=None, **rules):
    """Robots at given or drawn starts."""
    robots = Robots(batch, Rules(**rules), None if reality is None else MODEL.vector(effects=reality))
    for i in range(batch):
        robots.seed(i, np.random.default_rng(seed + i))
    robots.restart(range(batch), poses)
    return robots


def command(robots, speed, rate):
    """The action that commands this speed and turn rate of every robot."""
    limits = robots.rules.limits
    action = np.broadcast_to(np.stack([2 * np.asarray(speed) / limits.max_speed - 1, np.asarray(rate)
                                       / limits.max_rate], axis=-1), (len(robots), 2))  # fmt: skip
    return np.ascontiguousarray(action, dtype=np.float32)


def number(tick, name):
    return tick.numbers[NUMBERS.index(name)]


def wrapped(angle):
    return (angle + math.pi) % (2 * math.pi) - math.pi


@pytest.mark.every("starts", ["T1", "T2", "T3"])
def test_starts_are_where_the_page_says(starts):
    x, y, heading = make(4000, starts=starts).observe().poses.T
    assert np.abs(x).max() <= 2.5
    assert np.abs(y).max() <= 1.5
    if starts == "T3":
        # Uniform along each axis: the counts of ten cells, to five standard deviations.
        for values, reach in ((x, 2.5), (y, 1.5), (heading, math.pi)):
            counts = np.histogram(values, 10, (-reach, reach))[0]
            assert np.abs(counts - 400).max() < 5 * math.sqrt(400 * 0.9)
        return
    distance, off = np.hypot(x, y), wrapped(heading - np.arctan2(-y, -x))
    assert distance.min() >= 0.6
    assert distance.max() <= 1.6
    assert distance.max() - distance.min() > 0.99
    if starts == "T1":
        assert x.min() >= 0
        np.testing.assert_allclose(off, 0, atol=1e-12)
    else:
        assert 0.4 < (x > 0).mean() < 0.6
        assert np.abs(off).max() <= math.pi / 4
        assert np.ptp(off) > 0.99 * math.pi / 2


def test_starts_depend_on_the_seed_and_the_episode_alone():
    many, one = make(5, seed=3), make(1, seed=5)
    assert np.array_equal(many.observe().poses[2], one.observe().poses[0])
    for _ in range(4):
        many.advance(command(many, 0.7, 1.0))
    many.restart([2])
    one.restart([0])
    assert np.array_equal(many.observe().poses[2], one.observe().poses[0])
    assert not np.array_equal(make(1, seed=5).observe().poses, one.observe().poses)


def test_a_tick_is_an_exact_arc():
    robots = make(poses=(0.5, -0.4, 0.3))
    tick = robots.advance(command(robots, 0.8, 2.0))
    angle, radius = 0.3 + 0.2, 0.8 / 2.0
    x = 0.5 + radius * (math.sin(angle) - math.sin(0.3))
    y = -0.4 - radius * (math.cos(angle) - math.cos(0.3))
    np.testing.assert_allclose(tick.poses[0], (x, y, angle), atol=1e-7)
    np.testing.assert_allclose(number(tick, "path_length"), 0.08, atol=1e-8)


def test_what_is_seen_is_the_pose():
    robots = make(50)
    tick = robots.advance(command(robots, 0.5, -1.0))
    x, y, heading = tick.poses.T
    ball = np.arctan2(-y, -x) - heading
    expected = [x, y, np.cos(heading), np.sin(heading), np.log(np.hypot(x, y)), np.cos(ball), np.sin(ball)]
    np.testing.assert_allclose(tick.observed, np.stack(expected, axis=1), atol=2e-6)
    starts = make(50).observe()
    lengths = [dubins_path(pose, GOAL, 0.3).length for pose in starts.poses]
    np.testing.assert_allclose(number(tick, "dubins_length"), lengths, rtol=1e-12)


@pytest.mark.every("tick", [0.05, 0.1, 0.17])
def test_driving_over_the_ball_the_right_way_is_arrival_whatever_the_tick(tick):
    robots = make(poses=(0.0, -0.503, math.pi / 2), tick=tick)
    ticks = 1
    while not (last := robots.advance(command(robots, 1.0, 0.0))).success[0]:
        ticks += 1
    # Within 5 cm after 0.453 m; instants are at most 10 ms apart.
    time = number(last, "time")[0]
    assert 0.453 < time < 0.463
    assert time == pytest.approx(number(last, "path_length")[0])
    assert ticks == math.ceil(time / tick)


@pytest.mark.every(("angle", "arrives"), [(8, True), (-8, True), (12, False), (-12, False), (170, False)])
def test_the_heading_must_be_right(angle, arrives):
    heading = math.radians(90 + angle)
    start = (-0.3 * math.cos(heading), -0.3 * math.sin(heading), heading)
    robots = make(poses=start)
    ticks = [robots.advance(command(robots, 1.0, 0.0)) for _ in range(6)]
    assert any(t.success[0] for t in ticks) == arrives
    loose = make(poses=start, success="loose")
    ticks = [loose.advance(command(loose, 1.0, 0.0)) for _ in range(6)]
    assert any(t.success[0] for t in ticks) == (abs(angle) < 15)


@pytest.mark.every(("offset", "arrives"), [(0.049, True), (0.051, False)])
def test_the_distance_must_be_right(offset, arrives):
    robots = make(poses=(offset, -0.3, math.pi / 2))
    assert any(robots.advance(command(robots, 1.0, 0.0)).success[0] for _ in range(6)) == arrives


def test_distance_and_heading_must_be_right_at_one_instant():
    """Over the ball with the wrong heading, then the right heading off the ball: no arrival."""
    robots = make(poses=(-0.2, 0.0, 0.0))
    ticks = [robots.advance(command(robots, 1.0, 0.0)) for _ in range(4)]
    ticks += [robots.advance(command(robots, 0.0, 4.0)) for _ in range(4)]
    assert not any(t.success[0] for t in ticks)
    turning = make(poses=(0.02, 0.0, 0.0))
    ticks = [turning.advance(command(turning, 0.0, 4.0)) for _ in range(4)]
    # Within 10 deg of 90 after 80 deg at 4 rad/s.
    assert number(next(t for t in ticks if t.success[0]), "time")[0] == pytest.approx(0.35, abs=0.0101)


def test_walls_stop_or_let_slide():
    into = (2.3, 0.0, math.pi / 4)
    stop, slide = make(poses=into), make(poses=into, walls="slide")
    for _ in range(8):
        held, slid = (r.advance(command(r, 1.0, 0.0)) for r in (stop, slide))
    np.testing.assert_allclose(held.poses[0, :2], (2.5, 0.2), atol=1e-6)
    np.testing.assert_allclose(slid.poses[0, :2], (2.5, 0.8 * math.sqrt(0.5)), atol=1e-6)
    assert number(held, "wall_hits")[0] == number(slid, "wall_hits")[0] == 1
    assert number(held, "path_length")[0] == pytest.approx(0.2 * math.sqrt(2))
    for robots, tick in ((stop, held), (slide, slid)):
        while abs(wrapped(tick.poses[0, 2] - math.pi)) > 0.1:
            tick = robots.advance(command(robots, 0.0, 4.0))
        tick = robots.advance(command(robots, 1.0, 0.0))
        assert tick.poses[0, 0] < 2.45
        assert number(tick, "wall_hits")[0] == 1


def test_nobody_leaves_the_field():
    for walls in ("stop", "slide"):
        robots = make(64, walls=walls)
        draw = np.random.default_rng(0)
        for _ in range(200):
            action = np.stack([draw.uniform(0.5, 1, 64), draw.uniform(-1, 1, 64)], axis=1)
            poses = robots.advance(action.astype(np.float32)).poses
            assert np.abs(poses[:, 0]).max() <= 2.5
            assert np.abs(poses[:, 1]).max() <= 1.5
        assert robots.observe().numbers[NUMBERS.index("wall_hits")].max() > 0


def test_rewards_of_an_episode_add_up():
    score = {"time_cost": 0.5, "success_reward": 7.0, "progress_reward": 2.0, "wall_cost": 3.0}
    robots = make(2, poses=[(2.2, 0.5, 0.0), (0.0, -1.0, math.pi / 2)], **score)
    total = np.zeros(2)
    for _ in range(20):
        tick = robots.advance(command(robots, 1.0, 0.0), restarting=False)
        running = robots.robots["over"] == 0
        total += tick.reward * (running | tick.success)
        if tick.success[1]:
            break
    end = np.hypot(*tick.poses[:, :2].T)
    expected = 2.0 * (np.hypot([2.2, 0.0], [0.5, 1.0]) - end) - 0.5 * number(tick, "time") + [-3.0, 7.0]
    np.testing.assert_allclose(total, expected, atol=1e-9)


def test_time_runs_out_once_and_the_next_tick_restarts():
    robots = make(3, timeout=0.5)
    late = [robots.advance(command(robots, 0.0, 0.0), restarting=True).late.all() for _ in range(11)]
    assert late == [False] * 4 + [True] + [False] * 5 + [True]
    restarted = robots.advance(command(robots, 1.0, 1.0), restarting=True)
    assert (restarted.reward == 0).all()
    assert (number(restarted, "time") == 0).all()
    assert (robots.robots["episode"] == 3).all()


EFFECTS = {
    "actuator_gain": {"gain": 0.9},
    "turn_gain": {"gain": 1.2},
    "actuator_lag": {"time_constant": 0.2},
    "actuator_rate_limit": {"rate": 3.0},
    "actuator_delay": {"delay": 0.13},
    "actuator_saturation": {"limit": 0.4},
    "actuator_dead_zone": {"width": 0.1},
    "unequal_wheels": {"difference": 0.1},
    "yaw_slip": {"share": 0.3},
    "sideways_slip": {"coefficient": 0.3},
    "slope": {"x": 0.05, "y": -0.03},
    "sensor_delay": {"delay": 0.12},
    "heading_bias": {"angle": 0.1},
    "parameter_step": {"time": 1.5, "factor": 0.8},
}


def test_effects_of_no_size_change_nothing():
    """A nominal robot's tick in one arc is the drive with all effects off, from instant to instant."""
    nominal, neutral = make(20), make(20, reality={"actuator_gain": {"gain": 1.0}})
    assert neutral.extended is None
    tiny = make(20, reality={"parameter_step": {"time": 3.0}})  # a jump by nothing
    assert tiny.extended is not None
    draw, compared = np.random.default_rng(0), 0
    for _ in range(100):
        action = draw.uniform(-1, 1, (20, 2)).astype(np.float32)
        a, b, c = (robots.advance(action, restarting=True) for robots in (nominal, neutral, tiny))
        assert np.array_equal(a.poses, b.poses)
        # A wall stops a robot with effects at an instant, one without at its tick's chord.
        free = (number(a, "wall_hits") == 0) & (number(c, "wall_hits") == 0)
        np.testing.assert_allclose(wrapped(a.poses - c.poses)[free], 0, atol=1e-8)
        assert np.array_equal(a.success[free], c.success[free])
        compared += free.sum()
    assert compared > 500


def test_sensor_effects_change_what_is_measured_only():
    reality = {"heading_bias": {"angle": 0.2}, "sensor_delay": {"delay": 0.2}}
    plain, biased = make(5, starts="T2"), make(5, starts="T2", reality=reality)
    history = [plain.observe().poses]
    for _ in range(10):
        a, b = (robots.advance(command(robots, 0.4, 1.0)) for robots in (plain, biased))
        np.testing.assert_allclose(b.true_poses, a.poses, atol=1e-12)
        history.append(a.poses)
    np.testing.assert_allclose(b.poses[:, :2], history[-3][:, :2], atol=1e-9)
    np.testing.assert_allclose(wrapped(b.poses[:, 2] - history[-3][:, 2]), 0.2, atol=1e-9)
    np.testing.assert_allclose(b.observed[:, 2], np.cos(b.poses[:, 2]), atol=1e-6)


def test_each_robot_may_have_a_reality_of_its_own():
    gains = [1.0, 0.5]
    vectors = [MODEL.vector(effects={"actuator_gain": {"gain": g}}) for g in gains]
    robots = Robots(2, Rules(), vectors)
    for i in range(2):
        robots.seed(i, np.random.default_rng(i))
    robots.restart(range(2), (0.5, 0.5, 0.0))
    tick = robots.advance(command(robots, 1.0, 0.0))
    np.testing.assert_allclose(number(tick, "path_length"), [0.1, 0.05], rtol=1e-9)


def test_snapshots_are_exact_and_checked():
    for reality in (None, EFFECTS):
        robots = make(4, reality=reality)
        robots.advance(command(robots, 0.5, 1.0))
        state = robots.state()
        ahead = [robots.advance(command(robots, 0.9, -2.0)).poses for _ in range(5)]
        robots.set_state(state)
        again = [robots.advance(command(robots, 0.9, -2.0)).poses for _ in range(5)]
        assert np.array_equal(ahead, again)
    assert state["robots"].dtype == ROBOT
    with pytest.raises(ModelError, match="other effects"):
        make(4).set_state(state)
    with pytest.raises(ModelError, match="snapshot of 3"):
        make(3).set_state(state)


@pytest.mark.every(
    ("act", "message"),
    [
        (lambda: Robots(0), "at least one"),
        (lambda: Robots(2, reality=np.zeros(3)), "reality must have shape"),
        (lambda: Robots(2).restart([0]), "seed every robot"),
        (lambda: Robots(1).advance(np.zeros((1, 2), np.float32)), "before the first tick"),
        (lambda: make(poses=(3.0, 0.0, 0.0)), "must lie within"),
        (lambda: make(poses=(0.0, math.nan, 0.0)), "x .m., y .m. and heading"),
        (lambda: make(poses="there"), "x .m., y .m. and heading"),
        (lambda: Rules(tick=0.0, walls="ice"), "tick must be at least 0.001, at most 1 s.*; walls must"),
        (lambda: Rules(max_speed=math.inf), "max_speed must be greater than 0, at most 10 m/s"),
        (lambda: make().advance(np.full((1, 2), np.inf, np.float32)), "finite"),
    ],
)
def test_wrong_use_is_named(act, message):
    with pytest.raises(ModelError, match=message):
        act()


def test_limits_scale_the_commands():
    robots = make(poses=(0.5, 0.5, 0.0), max_speed=2.0, max_rate=1.0)
    tick = robots.advance(np.array([[1.0, 1.0]], np.float32))
    assert tick.poses[0, 2] == pytest.approx(0.1)
    assert number(tick, "path_length")[0] == pytest.approx(0.2)
    assert number(tick, "dubins_time")[0] == pytest.approx(number(tick, "dubins_length")[0] / 2)


def test_a_late_command_under_a_rate_limit_moves_the_robot_as_the_model_says():
    """The older of two aims holds for its part of an instant: their mixture would never be reached."""
    names = {"actuator_rate_limit": {"rate": 3.0}, "actuator_delay": {"delay": 0.0137}}
    rules, open_floor = Rules(timeout=60.0), {"field": Field(1e3, 1e3), "arrival": Arrival(1e-9, 1e-9)}
    robots, count = Robots(1, rules, MODEL.vector(effects=names), **open_floor), 60
    robots.seed(0, np.random.default_rng(0))
    robots.restart([0], (0.0, 0.0, 0.0))
    draw = np.random.default_rng(0)
    commands = np.column_stack([draw.uniform(0, 1, count), draw.uniform(-4, 4, count)]).astype(np.float32)
    poses = [robots.observe().poses[0]]
    for speed, rate in commands:
        poses.append(robots.advance(np.array([[2 * speed - 1, rate / 4]], dtype=np.float32)).poses[0])
    signals = dict(zip(("speed", "turn_rate"), commands.T.astype(float), strict=True))
    still = {"left_wheel": np.zeros(count), "right_wheel": np.zeros(count)}
    recording = Recording(time=0.1 * np.arange(count), signals={**signals, **still})
    observed = np.ones((1, count, 5), dtype=bool)
    whole = Windows(recording, np.array([0]), np.array([count]), np.zeros((1, 3)), observed)
    expected = MODEL.simulate(MODEL.vector(effects=names), whole)[0, 0, :, :2]
    assert np.abs(np.array(poses[:-1])[:, :2] - expected).max() < 1e-3
