"""The pose-reaching task: what its docs page states, and that the shortest path arrives."""

import math

import gymnasium as gym
import numpy as np
import pytest

import fieldgym
from fieldgym.pose_reaching import PoseReachingSettings
from fieldmodels.machines.pose_reaching.dubins import dubins_path
from fieldmodels.machines.pose_reaching.parameters import GOAL
from fieldmodels.model import ModelError

ID = "fieldgym/PoseReaching-v0"
FAULTS = {"actuator_lag": {"time_constant": 0.1}, "sensor_delay": {"delay": 0.1}, "slope": {"x": 0.02}}


def along_the_shortest_path(starts, tick=0.1, ticks=100):
    """Actions that turn as the shortest path does, averaged over each tick, shape (ticks, n, 2)."""
    actions = np.zeros((ticks, len(starts), 2), np.float32)
    for i, start in enumerate(starts):
        path = dubins_path(start, GOAL, 0.3)
        heading = path.at(np.arange(ticks + 1) * tick)[:, 2]
        actions[:, i, 0] = np.where(np.arange(ticks) * tick < path.length + 0.05, 1.0, -1.0)
        actions[:, i, 1] = np.diff(heading) / tick / 4.0
    return actions


def play(actions, seed=0, reality=None, mode="vector_entry_point", **settings):
    """Steps of these actions on drawn starts, and the first observation and info."""
    env = gym.make_vec(
        ID, num_envs=actions.shape[1], vectorization_mode=mode, settings=settings, reality=reality
    )
    first = env.reset(seed=seed)
    return first, [env.step(a) for a in actions]


def test_actions_are_speed_and_turn_rate():
    env = gym.make(ID)
    for action, speed, rate in (((-1, 0), 0, 0), ((0, 0.5), 0.5, 2), ((1, -1), 1, -4), ((7, -3), 1, -4)):
        env.reset(seed=0, options={"pose": (1.0, 0.5, 0.0)})
        info = env.step(np.array(action, np.float32))[4]
        assert info["path_length"] == pytest.approx(0.1 * speed)
        assert info["pose"][2] == pytest.approx(0.1 * rate)


def test_observation_holds_the_pose():
    (observation, info), steps = play(np.random.default_rng(0).uniform(-1, 1, (20, 30, 2)).astype(np.float32))
    for seen, told in ((observation, info), *((s[0], s[4]) for s in steps)):
        np.testing.assert_allclose(seen[:, :2], told["pose"][:, :2], atol=1e-6)
        np.testing.assert_allclose(np.exp(1j * told["pose"][:, 2]), seen[:, 2] + 1j * seen[:, 3], atol=1e-6)
        to_ball = np.arctan2(-seen[:, 1], -seen[:, 0])
        np.testing.assert_allclose(
            np.exp(1j * (to_ball - told["pose"][:, 2])), seen[:, 5] + 1j * seen[:, 6], atol=1e-4
        )


@pytest.mark.every("tick", [0.05, 0.1])
def test_the_shortest_path_arrives_in_its_time(tick):
    """Where no wall is in its way; 100 starts of T1, whose paths mostly stay in the field."""
    env = gym.make_vec(ID, num_envs=100, settings={"starts": "T1", "tick": tick})
    _, info = env.reset(seed=0)
    arrived = np.zeros(100, dtype=bool)
    ratios = np.full(100, np.nan)
    for action in along_the_shortest_path(info["pose"], tick):
        _, _, terminated, _, info = env.step(action)
        new = terminated & ~arrived
        ratios[new] = (info["time"] / info["dubins_time"])[new]
        arrived |= terminated
    assert arrived.mean() > 0.95
    # Arrival is up to 5 cm before the end of the path.
    assert np.nanmax(ratios) < 1.03
    assert np.nanmedian(ratios) < 1.0


def test_rewards_are_progress_time_and_arrival():
    env = gym.make(ID, settings={"time_cost": 0.5, "success_reward": 3.0, "progress_reward": 2.0})
    env.reset(options={"pose": (0.0, -0.5, math.pi / 2)})
    total, over = 0.0, False
    while not over:
        _, reward, over, _, info = env.step(np.array([1, 0], np.float32))
        total += reward
    assert info["success"] == 1
    driven = info["path_length"]
    assert total == pytest.approx(2.0 * driven - 0.5 * info["time"] + 3.0, abs=1e-9)


def test_wall_costs_each_time_it_is_met():
    env = gym.make(ID, settings={"wall_cost": 2.0, "time_cost": 0.0, "progress_reward": 0.0})
    env.reset(options={"pose": (2.3, 0.0, 0.0)})
    rewards = [env.step(np.array([1, 0], np.float32))[1] for _ in range(6)]
    assert rewards == [0, 0, -2, 0, 0, 0] or rewards == [0, -2, 0, 0, 0, 0]


def test_time_runs_out():
    env = gym.make(ID, settings={"timeout": 2.0, "tick": 0.05})
    env.reset(seed=0)
    ends = [env.step(np.array([-1, 0], np.float32))[2:4] for _ in range(40)]
    assert ends[-1] == (False, True)
    assert not any(truncated for _, truncated in ends[:-1])


def test_native_vector_equals_scalar_environments_through_arrivals_and_effects():
    """To the bit, also where rows arrive at different times, run out of time, and begin anew."""
    for reality in (None, FAULTS):
        kwargs = {"num_envs": 8, "settings": {"starts": "T1", "timeout": 4.0}, "reality": reality}
        native = gym.make_vec(ID, vectorization_mode="vector_entry_point", **kwargs)
        scalar = gym.make_vec(ID, vectorization_mode="sync", **kwargs)
        (_, info), _ = native.reset(seed=2), scalar.reset(seed=2)
        actions = along_the_shortest_path(info["pose"], ticks=60)
        arrived, late = np.zeros(8, dtype=int), np.zeros(8, dtype=int)
        for action in actions:
            ours, theirs = native.step(action), scalar.step(action)
            for a, b in zip(ours, theirs, strict=True):
                np.testing.assert_equal(a, b)
            arrived += ours[2]
            late += ours[3]
        assert late.sum() > 0
        assert reality or arrived.sum() > 0


def test_starts_may_be_given():
    poses = np.array([(1.0, -0.5, 3.0), (0.2, 1.5, -9.0)])
    env = gym.make_vec(ID, num_envs=2)
    _, info = env.reset(seed=0, options={"pose": poses})
    np.testing.assert_allclose(info["pose"][:, :2], poses[:, :2])
    np.testing.assert_allclose(np.exp(1j * info["pose"][:, 2]), np.exp(1j * poses[:, 2]))
    _, info = env.reset(options={"pose": poses[0]})
    np.testing.assert_allclose(info["pose"], [poses[0]] * 2)
    with pytest.raises(ModelError, match="must lie within"):
        env.reset(options={"pose": (0, 2, 0)})
    with pytest.raises(ModelError, match="finite numbers"):
        env.reset(options={"pose": (0, math.nan, 0)})
    with pytest.raises(ValueError, match="option 'pose' only"):
        env.reset(options={"place": (0, 2, 0)})


def test_episodes_of_a_seed_go_on_without_one():
    """A second reset draws the next start; a vector environment restarts its rows there too."""
    env = gym.make(ID)
    first, _ = env.reset(seed=4)
    second, _ = env.reset()
    assert not np.array_equal(first, second)
    again, _ = env.reset(seed=4)
    assert np.array_equal(first, again)
    assert np.array_equal(second, env.reset()[0])
    unseeded = [gym.make(ID).reset()[0] for _ in range(2)]
    assert not np.array_equal(*unseeded)


def test_rows_take_seeds_of_their_own():
    env = gym.make_vec(ID, num_envs=2)
    observation, _ = env.reset(seed=[9, 4])
    assert np.array_equal(observation[1], gym.make(ID).reset(seed=4)[0])
    with pytest.raises(ValueError, match="as many seeds"):
        env.reset(seed=[1, 2, 3])


def test_a_biased_sensor_is_distinguished_from_the_true_pose():
    env = gym.make(ID, reality={"heading_bias": {"angle": 0.3}})
    _, info = env.reset(options={"pose": (1.0, 0.5, 1.0)})
    assert info["pose"] == pytest.approx([1.0, 0.5, 1.3])
    assert info["privileged.pose"] == pytest.approx([1.0, 0.5, 1.0])


def test_reality_may_be_a_file(tmp_path):
    path = tmp_path / "extended.yaml"
    path.write_text(
        "schema: 1\nmodel: pose_reaching\nparameters: {}\n"
        "effects: {yaw_slip: {share: {value: 0.5, std: 0.01, unit: '1'}}}\n"
    )
    for reality in (path, {"yaw_slip": {"share": 0.5}}):
        env = gym.make(ID, reality=reality)
        env.reset(options={"pose": (1.0, 0.5, 0.0)})
        assert env.step(np.array([0, 1], np.float32))[4]["pose"][2] == pytest.approx(0.2)


def test_state_with_effects_continues_to_the_bit_and_fits_its_reality_only():
    env = gym.make_vec(ID, num_envs=3, reality=FAULTS)
    env.reset(seed=1)
    actions = np.random.default_rng(0).uniform(-1, 1, (30, 3, 2)).astype(np.float32)
    for action in actions[:7]:
        env.step(action)
    state = env.unwrapped.get_state()
    first = [env.step(a)[0] for a in actions]
    fresh = gym.make_vec(ID, num_envs=3, reality=FAULTS)
    fresh.unwrapped.set_state(state)
    assert np.array_equal(first, [fresh.step(a)[0] for a in actions])
    with pytest.raises(ValueError, match="other effects"):
        gym.make_vec(ID, num_envs=3).unwrapped.set_state(state)
    with pytest.raises(ValueError, match="a snapshot of 3 robots is needed"):
        fresh.unwrapped.set_state({**state, "robots": [0.0, 0.0, 0.0]})


@pytest.mark.every(
    ("settings", "message"),
    [
        ({"starts": "T4"}, "'T1', 'T2' or 'T3'"),
        ({"success": "easy"}, "'strict' or 'loose'"),
        ({"tick": 0}, "tick"),
        ({"timeout": -1}, "timeout"),
        ({"walls": "bounce"}, "'stop' or 'slide'"),
        ({"max_speed": float("nan")}, "max_speed"),
        ("T1", "a mapping or None"),
    ],
)
def test_wrong_settings_are_refused(settings, message):
    with pytest.raises(fieldgym.SettingsError, match=message):
        gym.make(ID, settings=settings)


def test_an_action_that_is_no_number_is_refused():
    env = gym.make(ID).unwrapped
    env.reset(seed=0)
    with pytest.raises(gym.error.InvalidAction, match="finite numbers"):
        env.step("left")


def test_settings_object_and_mapping_mean_the_same():
    a = gym.make(ID, settings=PoseReachingSettings(starts="T1")).unwrapped
    b = gym.make(ID, settings={"starts": "T1"}).unwrapped
    assert a.settings == b.settings
    with pytest.raises(AttributeError):
        a.settings.starts = "T2"


def test_unknown_effect_is_named():
    with pytest.raises(ModelError, match="did you mean 'yaw_slip'"):
        gym.make(ID, reality={"yaw_slips": {"share": 0.1}})


def test_films_run_in_real_time():
    assert gym.make(ID).unwrapped.metadata["render_fps"] == 10
    assert gym.make(ID, settings={"tick": 0.05}).unwrapped.metadata["render_fps"] == 20


def test_memory_and_choice_are_drawn_until_they_are_taken_away():
    env = gym.make(ID, render_mode="rgb_array").unwrapped
    env.reset(seed=0, options={"pose": (1.5, 0.8, 2.0)})
    plain = env.render()
    paths = [[(2.0, 0.0), (1.0, 0.1), (0.0, 0.0)], [(1.0, -1.0, 0.3), (0.0, 0.0, 1.6)]]
    env.show(memory=paths)
    remembered = env.render()
    env.show(memory=paths, chosen=(1.0, 0.1))
    chosen = env.render()
    assert (plain != remembered).any()
    assert (remembered != chosen).any()
    env.show()
    assert np.array_equal(env.render(), plain)
    for wrong in ({"memory": [[1.0, 2.0]]}, {"chosen": 3.0}):
        with pytest.raises(ValueError, match="shape"):
            env.show(**wrong)


def test_each_row_draws_its_own_choice():
    env = gym.make_vec(ID, num_envs=2, render_mode="rgb_array").unwrapped
    env.reset(seed=0, options={"pose": (1.5, 0.8, 2.0)})
    a, b = env.render()
    assert np.array_equal(a, b)
    env.show(chosen=[(1.0, 0.0), (0.5, 0.0)])
    a, b = env.render()
    assert (a != b).any()
    with pytest.raises(ValueError, match=r"\(2, 2 or more\)"):
        env.show(chosen=np.zeros((3, 2)))


def test_arrival_is_drawn():
    env = gym.make(ID, render_mode="rgb_array").unwrapped
    env.reset(options={"pose": (0.0, -0.3, math.pi / 2)})
    over = False
    while not over:
        before = env.render()
        over = env.step(np.array([1, 0], np.float32))[2]
    badge = (slice(492, 518), slice(800, 936))
    assert (before[badge] != env.render()[badge]).any()


OMNIDIRECTIONAL = {"drive": "omnidirectional"}


@pytest.mark.every(
    ("action", "ahead", "left"),
    [
        ((1, 0, 0), 1, 0),
        ((-0.5, 0, 0), -0.5, 0),
        ((0, 0, 1), 0, 1),
        ((0.3, 0, -0.4), 0.3, -0.4),
        ((7, 0, 1), 0.5**0.5, 0.5**0.5),
    ],
)
def test_an_omnidirectional_robot_drives_any_way(action, ahead, left):
    env = gym.make(ID, settings=OMNIDIRECTIONAL)
    env.reset(seed=0, options={"pose": (1.0, 0.5, 0.5 * math.pi)})
    info = env.step(np.array(action, np.float32))[4]
    np.testing.assert_allclose(info["pose"], (1.0 - 0.1 * left, 0.5 + 0.1 * ahead, 0.5 * math.pi), atol=1e-8)
    assert info["path_length"] == pytest.approx(0.1 * math.hypot(ahead, left))


@pytest.mark.every("reality", [None, FAULTS])
def test_omnidirectional_robots_side_by_side_are_single_ones(reality):
    actions = np.random.default_rng(4).uniform(-1, 1, (40, 6, 3)).astype(np.float32)
    chosen = {**OMNIDIRECTIONAL, "starts": "T1", "timeout": 2.0}
    ours, theirs = (play(actions, 3, reality, mode, **chosen) for mode in ("vector_entry_point", "sync"))
    np.testing.assert_equal(ours, theirs)


def test_an_omnidirectional_robot_arrives_at_the_instant_it_passes():
    """Sideways over the ball, turning: at one instant near it and heading up, within a tick."""
    env = gym.make(ID, settings={**OMNIDIRECTIONAL, "tick": 1.0})
    env.reset(seed=0, options={"pose": (-0.5, 0.0, 0.5 * math.pi)})
    _, _, arrived, _, info = env.step(np.array([0, 0, -1], np.float32))
    assert arrived
    assert info["time"] == pytest.approx(0.45, abs=0.011)
    assert info["path_length"] == pytest.approx(info["time"])
