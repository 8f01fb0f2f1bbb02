import math

import gymnasium as gym
import numpy as np
import pytest

from fieldagents.task import get_task
from fieldgym.info import part
from fieldgym.settings import SettingsError
from fieldmodels.machines.line_following.firmware import line_position
from fieldmodels.machines.line_following.parameters import Camera
from fieldmodels.model import ModelError

CENTROID, PIXELS = "fieldgym/LineFollowing-v1", "fieldgym/LineFollowingPixels-v1"
QUIET = {"sensor": 0.0, "yaw": 0.0, "lateral": 0.0, "bias": 0.0}


def vector(env_id=CENTROID, num_envs=8, **settings):
    return gym.make_vec(env_id, num_envs=num_envs, vectorization_mode="vector_entry_point", settings=settings)


def law(observation, gains=(-0.3, 0.8, 0.2)):
    """Equation (3.1) on what is observed, as an action."""
    a, b, c = gains
    return (a * 0.3 * observation[:, 1:2] + b * 0.3 * observation[:, :1]) / 0.15 + c * observation[:, 4:5]


def drive(envs, act, seed=5):
    """Infos of a whole episode, and its return."""
    observation, _ = envs.reset(seed=seed)
    infos, total, going = [], np.zeros(envs.num_envs), np.ones(envs.num_envs, dtype=bool)
    while going.any():
        observation, reward, terminated, truncated, info = envs.step(act(observation))
        total += np.where(going, reward, 0)
        going &= ~(terminated | truncated)
        infos.append(info)
    return infos, total


@pytest.mark.every("track", ["straight", "s", "oval"])
@pytest.mark.every("plant", ["kinematic", "pymunk"])
def test_the_law_keeps_the_robot_on_the_line(track, plant):
    infos, total = drive(vector(track=track, plant=plant, num_envs=4), law)
    assert (infos[-1]["mean_offset"] < 0.2).all()
    assert not infos[-1]["failed"].any()
    assert (total > -100).all()


def test_walking_straight_on_loses_the_line_and_pays_for_what_is_missing():
    envs = vector(track="oval", num_envs=16)
    _, total = drive(envs, lambda observation: np.zeros((len(observation), 1), dtype=np.float32))
    assert (total >= -100).all()
    assert (total < -70).all()  # most of 100 strides at the largest loss of 1


def test_an_episode_fails_after_as_many_lost_strides_as_set():
    envs = vector(num_envs=1, track="straight", lost_strides=3, lost_offset=100.0, **QUIET)
    envs.reset(seed=1)
    lost, failed = [], False
    while not failed:
        *_, terminated, _, info = envs.step(np.array([[1.0]], dtype=np.float32))
        lost.append(info["lost"][0])
        failed = bool(terminated[0])
    assert lost[-3:] == [1, 1, 1]
    assert lost[-4] == 0


def test_reward_is_what_the_page_says():
    envs = vector(num_envs=1, track="straight", **QUIET)
    envs.reset(seed=1)
    _, reward, _, _, info = envs.step(np.array([[0.5]], dtype=np.float32))
    change = 0.5 * 0.15
    assert np.isclose(info["effort"][0], change)
    assert np.isclose(reward[0], 1 - abs(info["privileged.offset"][0]) / 0.1 - 0.1 * change / 0.1)


def test_image_and_centroid_are_of_the_same_walk():
    """Equal seeds and actions give the same truth; the firmware finds in the image what geometry computes."""
    computed, drawn = (gym.make(name, settings={"track": "oval"}) for name in (CENTROID, PIXELS))
    (numbers, first), (image, second) = computed.reset(seed=3), drawn.reset(seed=3)
    for _ in range(12):
        place, found = line_position(image[..., 0], Camera(), 90.0)
        assert found
        assert abs(place - 0.3 * numbers[0]) < 6e-3
        assert part(first, "privileged") == part(second, "privileged")
        action = law(numbers[None])[0]
        numbers, *_, first = computed.step(action)
        image, *_, second = drawn.step(action)


def test_second_band_sees_the_curve_before_it_comes():
    envs = vector(num_envs=1, bands=2, track="s", offset=0.0, misalignment=0.0, **QUIET)
    observation, _ = envs.reset(seed=1)
    far = []
    for _ in range(9):
        far.append((float(observation[0, 0]), float(observation[0, 9])))
        observation, *_ = envs.step(np.zeros((1, 1), dtype=np.float32))
    near, ahead = np.array(far).T
    assert np.argmax(ahead > 0.05) < np.argmax(near > 0.05)


def test_colour_images_hold_three_components_and_no_more_memory():
    """The walk is that of the grey environment; an image a row is all that is kept."""
    grey, colour = (vector(PIXELS, num_envs=2, colour=colour) for colour in (False, True))
    assert colour.single_observation_space.shape == (120, 160, 3)
    agent = get_task("line_following").agents["tuned"].make({"colour": True})
    seen = [envs.reset(seed=4)[0] for envs in (grey, colour)]
    images = colour.unwrapped._task.walks.images
    assert images.nbytes == 2 * 120 * 160 * 3
    for _ in range(30):
        action = agent.act(seen[1], {})
        steps = [envs.step(action) for envs in (grey, colour)]
        seen = [step[0] for step in steps]
        np.testing.assert_array_equal(steps[0][4]["offset"], steps[1][4]["offset"])
        np.testing.assert_allclose(seen[1].mean(axis=3), seen[0][..., 0], atol=40)
        assert seen[1] in colour.observation_space
    assert colour.unwrapped._task.walks.images is images
    frame = gym.make(PIXELS, settings={"colour": True, "floor": "track_red"}, render_mode="rgb_array")
    frame.reset(seed=1)
    view = frame.render()[70:250, 530:600].astype(float).mean(axis=(0, 1))  # of what the camera sees
    assert view[0] > 1.4 * view[1] > 1.4 * view[2]
    assert not steps[1][4]["lost"].any()
    assert (steps[1][4]["offset"] < 0.15).all()


def test_dark_corner_hides_the_line_only_there():
    lit = vector(PIXELS, num_envs=2, track="straight", dark_corner=(12.0, 0.0, 2.0, 0.05))
    lit.reset(seed=2)
    lost = []
    for _ in range(20):
        *_, info = lit.step(np.zeros((2, 1), dtype=np.float32))
        lost.append(info["lost"][0])
    assert sum(lost[:8]) == 0
    assert sum(lost) >= 2


def test_slip_and_weak_motor_act_in_the_rigid_bodies_only():
    reached = {}
    for name, change in {"dry": {}, "wet": {"friction": 0.1}, "weak": {"motor": 0.1}}.items():
        envs = vector(num_envs=1, track="straight", plant="pymunk", **QUIET, **change)
        _, begun = envs.reset(seed=1)
        *_, info = envs.step(np.array([[1.0]], dtype=np.float32))
        reached[name] = (info["privileged.heading"] - begun["privileged.heading"])[0]
    assert reached["dry"] == pytest.approx(0.15, abs=1e-3)
    assert reached["wet"] < 0.9 * reached["dry"]
    assert reached["weak"] < 0.5 * reached["dry"]


def test_overshoot_is_measured_from_the_far_side():
    envs = vector(num_envs=32, track="straight", offset=0.3, sided=True, misalignment=0.0, **QUIET)
    infos, _ = drive(envs, law)
    tuned = infos[-1]["overshoot"]
    infos, _ = drive(envs, lambda observation: law(observation, (0.0, 0.9, 0.0)))
    proportional = infos[-1]["overshoot"]
    assert (tuned < proportional).all()
    assert (proportional > 0.03).all()


def test_reality_bends_the_walk_but_not_the_observation_of_commands():
    true, biased = (
        gym.make(CENTROID, settings={"track": "straight", **QUIET}, reality=reality)
        for reality in (None, {"steering_bias": {"turn": 0.05}})
    )
    for env in (true, biased):
        env.reset(seed=4)
    *_, first = true.step(np.zeros(1, dtype=np.float32))
    *_, second = biased.step(np.zeros(1, dtype=np.float32))
    assert np.isclose(second["privileged.heading"] - first["privileged.heading"], 0.05)
    assert second["command"] == 0.0


def test_bad_settings_are_refused():
    with pytest.raises(SettingsError, match="did you mean 'track'"):
        gym.make(CENTROID, settings={"trak": "oval"})
    with pytest.raises(ModelError, match="no track 'circle'"):
        gym.make(CENTROID, settings={"track": "circle"})


@pytest.mark.every("key", ["walks", "tallies"])
def test_a_broken_snapshot_is_refused_and_changes_nothing(key):
    env = gym.make(CENTROID).unwrapped
    env.reset(seed=1)
    env.step(np.ones(1, dtype=np.float32))
    kept = env.get_state()
    with pytest.raises(ValueError, match="get_state makes one"):
        env.set_state({**kept, "elapsed": np.zeros(1, dtype=np.int64), key: kept[key][:, :0]})
    assert np.array_equal(env.get_state()["walks"], kept["walks"])
    assert env.get_state()["elapsed"] == kept["elapsed"]


@pytest.mark.every("name", ["reward_limit", "effort_weight", "lost_offset", "friction", "motor"])
@pytest.mark.every("value", [math.inf, math.nan])
def test_settings_whose_rewards_would_not_be_numbers_are_refused(name, value):
    """An infinite ``reward_limit`` or ``effort_weight`` times nothing was no number."""
    with pytest.raises(SettingsError, match=f"{name}: Input should be (less|greater) than .*given: {value}"):
        gym.make("fieldgym/LineFollowing-v1", settings={name: value})
