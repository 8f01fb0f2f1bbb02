"""The heel-strike task: what its docs page states, and that good gains pay."""

import gymnasium as gym
import numpy as np
import pytest

import fieldgym
from fieldgym.heel_strike import GAIN_LOW, RANGER_TUNED, TOLERANCE_MM, HeelStrikeSettings
from fieldgym.info import part
from fieldmodels.model import ModelError

ID = "fieldgym/HeelStrike-v0"


def action(early, late, reset):
    """The action that chooses these gains."""
    return (1 - 2 * np.log([early, late, reset]) / np.log(GAIN_LOW)).astype(np.float32)


def walk(gains, strides=200, batch=32, seed=0, reality=None, **settings):
    """Infos of constant gains, each entry of shape (strides, batch, ...), and rewards."""
    env = gym.make_vec(ID, num_envs=batch, settings={"strides": strides, **settings}, reality=reality)
    observation, _ = env.reset(seed=seed)
    actions = np.tile(action(*gains), (batch, 1))
    steps = [env.step(actions) for _ in range(strides)]
    infos = {key: np.array([s[4][key] for s in steps]) for key in steps[0][4]}
    privileged = part(infos, "privileged")
    observations = np.array([observation, *(s[0] for s in steps)])
    return infos, privileged, np.array([s[1] for s in steps]), observations, steps[-1]


RANGER = (1.0, 1.0, 0.1)


def test_actions_are_gains_on_a_logarithmic_scale():
    env = gym.make(ID)
    env.reset(seed=0)
    for value, expected in ((-1, [0.001, 0.001, 0.01]), (0, [0.001**0.5, 0.001**0.5, 0.1]), (1, [1, 1, 1])):
        info = env.step(np.full(3, value, dtype=np.float32))[4]
        np.testing.assert_allclose(info["gains"], [*expected, 1000 / 3], rtol=1e-12)


def test_actions_outside_the_box_are_clipped():
    inside, outside = gym.make(ID).unwrapped, gym.make(ID).unwrapped
    inside.reset(seed=1)
    outside.reset(seed=1)
    a = inside.step(np.array([1, -1, 1], np.float32))
    b = outside.step(np.array([7, -3, 1.5], np.float32))
    assert a[1] == b[1]


def test_reward_is_the_loss_in_units_of_the_scale():
    infos, _, rewards, *_ = walk(RANGER, strides=50)
    scale = RANGER_TUNED["ar1"][1]
    np.testing.assert_allclose(rewards, -np.minimum(infos["error_mm"] / scale, 10), rtol=1e-12)
    infos, _, rewards, *_ = walk(RANGER, strides=50, reward_scale=2.0, reward_limit=0.5)
    np.testing.assert_allclose(rewards, -np.minimum(infos["error_mm"] / 2.0, 0.5), rtol=1e-12)
    assert rewards.min() == -0.5


@pytest.mark.every("kind", ["ar1", "low_pass"])
def test_scale_is_the_tuned_ranger_estimators_error(kind):
    infos, *_ = walk(RANGER, collision_kind=kind)
    best, scale = RANGER_TUNED[kind]
    assert infos["error_mm_ranger_tuned"].mean() == pytest.approx(scale, rel=0.1)
    for other in (0.5 * best, min(1.0, 1.6 * best)):
        worse, *_ = walk(RANGER, collision_kind=kind, tuned_reset=other)
        assert worse["error_mm_ranger_tuned"].mean() > infos["error_mm_ranger_tuned"].mean()


def test_sensor_alone_with_a_tenth_of_reset_is_rangers_estimator():
    """Eq (2.14) with S_MS = 1, S_HR = 0.1 against eq (2.2), (2.3): they differ by their filters only."""
    infos, *_ = walk(RANGER)
    difference = np.abs(infos["error_mm"] - infos["error_mm_ranger"])
    assert difference.max() < 0.1
    assert infos["error_mm"].mean() == pytest.approx(infos["error_mm_ranger"].mean(), rel=1e-3)


def test_actions_change_neither_truth_nor_observations():
    a, hidden_a, _, observations_a, _ = walk(RANGER, strides=60)
    b, hidden_b, _, observations_b, _ = walk((0.01, 0.5, 0.7), strides=60)
    assert np.array_equal(observations_a, observations_b)
    for key in ("duration", "error_mm_ranger", "error_mm_ekf"):
        assert np.array_equal(a[key], b[key])
    for key in ("levels", "floor_mm"):
        assert np.array_equal(hidden_a[key], hidden_b[key])


@pytest.mark.every(
    ("kind", "good", "bad"),
    [
        # Errors of `ar1` are the collision's: a model that bridges it beats Ranger with its best reset.
        ("ar1", (0.005, 0.5, 0.7), (1.0, 1.0, 0.8)),
        # Errors of `low_pass` are mostly the floor's: what counts is how much of it the reset lets in.
        ("low_pass", (1.0, 1.0, 0.2), (1.0, 1.0, 1.0)),
    ],
)
def test_known_good_gains_beat_bad_ones(kind, good, bad):
    better, worse = (walk(gains, collision_kind=kind, seed=100)[0]["error_mm"] for gains in (good, bad))
    assert (better.mean(axis=0) < worse.mean(axis=0)).mean() > 0.9
    assert better.mean() < 0.85 * worse.mean()


def test_cost_counts_errors_beyond_rangers_accuracy():
    infos, *_ = walk(RANGER, strides=30)
    assert np.array_equal(infos["cost"], (infos["error_mm"] > TOLERANCE_MM).astype(float))
    assert 0 < infos["cost"].mean() < 1


def test_levels_dwell_as_long_as_set():
    _, hidden, *_ = walk(RANGER, dwell=5.0)
    switches = (hidden["levels"] != hidden["previous_levels"]).mean()
    # 19200 coin throws of probability 0.2: five standard deviations.
    assert switches == pytest.approx(0.2, abs=5 * (0.2 * 0.8 / 19200) ** 0.5)
    assert np.array_equal(hidden["levels"][:-1], hidden["previous_levels"][1:])


def test_infinite_dwell_keeps_the_noise_constant():
    _, hidden, *_ = walk(RANGER, dwell=float("inf"))
    assert np.array_equal(hidden["levels"], hidden["previous_levels"])


def test_observation_tells_the_levels():
    """Each smoothed feature is higher, in the mean, while its own noise is high."""
    _, hidden, _, observations, _ = walk(RANGER, dwell=float("inf"))
    for feature, level in ((1, 1), (3, 0), (5, 2)):
        high = hidden["previous_levels"][-50:, :, level] == 1
        values = observations[-50:, :, feature]
        assert values[high].mean() > values[~high].mean() + 0.8


def test_added_floor_enters_the_score_alone():
    plain, hidden, *_ = walk(RANGER, strides=40)
    added, *_ = walk(RANGER, strides=40, score="angle_and_floor")
    np.testing.assert_allclose(added["error_mm"], np.abs(hidden["signed_error_mm"] + hidden["floor_mm"]))
    np.testing.assert_allclose(plain["error_mm"], np.abs(hidden["signed_error_mm"]))


def test_one_sided_floor_is_never_low():
    _, hidden, *_ = walk(RANGER, strides=40, floor_one_sided=True)
    assert hidden["floor_mm"].min() >= 0
    _, hidden, *_ = walk(RANGER, strides=40)
    assert hidden["floor_mm"].min() < 0
    assert np.abs(hidden["floor_mm"]).max() <= 4.0


def test_episode_is_cut_after_its_strides():
    *_, last = walk(RANGER, strides=7)
    assert last[3].all()
    assert not last[2].any()


def test_bank_is_scored_when_asked_for():
    infos, *_ = walk(RANGER, strides=100, batch=8, bank=True)
    assert infos["error_mm_imm"].mean() < infos["error_mm_ekf"].mean()
    assert "error_mm_imm" not in walk(RANGER, strides=2, batch=1)[0]


def test_reality_reaches_the_truth():
    """A gyro bias b turns into an error of b times a stride's time at each strike, divided by S_HR."""
    quiet = {"process": (0, 0), "floor": (0, 0), "collision": (0, 0), "gyro": 0.0}
    infos, hidden, *_ = walk((1, 1, 1), strides=10, batch=1, reality={"gyro_bias": {"rate": 0.01}}, **quiet)
    np.testing.assert_allclose(hidden["signed_error_mm"][1:], 0.01 * 350 * infos["duration"][1:], rtol=2e-3)


def test_reality_may_be_a_file(tmp_path):
    path = tmp_path / "extended.yaml"
    path.write_text(
        "schema: 1\nmodel: heel_strike\nparameters: {}\n"
        "effects: {gyro_bias: {rate: {value: 0.01, std: 0.001, unit: rad/s}}}\n"
    )
    from_file = walk(RANGER, strides=5, reality=path)[0]["error_mm"]
    assert np.array_equal(
        from_file, walk(RANGER, strides=5, reality={"gyro_bias": {"rate": 0.01}})[0]["error_mm"]
    )
    assert not np.array_equal(from_file, walk(RANGER, strides=5)[0]["error_mm"])


def test_unknown_effect_is_named():
    with pytest.raises(ModelError, match="did you mean 'gyro_bias'"):
        gym.make(ID, reality={"gyro_bais": {"rate": 0.01}})


@pytest.mark.every(
    ("settings", "message"),
    [
        ({"collision_kind": "white"}, "'ar1' or 'low_pass'"),
        ({"strides": 0}, "strides.*greater than or equal to 1"),
        ({"process": (0.1,)}, "process"),
        ({"floor": (-0.001, 0.1)}, "floor.0"),
        ({"dwell": float("nan")}, "dwell"),
        ("ar1", "a mapping or None"),
    ],
)
def test_wrong_settings_are_refused(settings, message):
    with pytest.raises(fieldgym.SettingsError, match=message):
        gym.make(ID, settings=settings)


def test_settings_object_and_mapping_mean_the_same():
    a = gym.make(ID, settings=HeelStrikeSettings(collision_kind="low_pass")).unwrapped
    b = gym.make(ID, settings={"collision_kind": "low_pass"}).unwrapped
    assert a.settings == b.settings
    with pytest.raises(AttributeError):
        a.settings.strides = 3


def test_vector_takes_a_seed_for_each_environment():
    env = gym.make_vec(ID, num_envs=2)
    single = gym.make(ID)
    single.reset(seed=4)
    step = single.step(np.zeros(3, np.float32))
    env.reset(seed=[9, 4])
    assert env.step(np.zeros((2, 3), np.float32))[1][1] == step[1]
    with pytest.raises(ValueError, match="as many seeds"):
        env.reset(seed=[1, 2, 3])


def test_stride_is_drawn_in_slices():
    env = gym.make(ID, render_mode="rgb_array").unwrapped
    env.reset(seed=0)
    assert list(env.step_frames(10)) == []
    env.step(np.zeros(3, np.float32))
    frames = list(env.step_frames(5))
    assert len(frames) in (5, 6)
    assert np.array_equal(frames[-1], env.render())
    assert not np.array_equal(frames[0], frames[-1])


def test_leg_that_never_strikes_ends_the_episode():
    """And rows that end at different times restart as Gymnasium's own vector environment restarts them."""
    reality = {"coulomb_friction": {"acceleration": 1.5}}
    native, scalar = (
        gym.make_vec(ID, num_envs=3, reality=reality, vectorization_mode=m) for m in (None, "sync")
    )
    native.reset(seed=0)
    scalar.reset(seed=0)
    zero = np.zeros((3, 3), np.float32)
    ended = []
    for _ in range(60):
        ours, theirs = native.step(zero), scalar.step(zero)
        for a, b in zip(ours, theirs, strict=True):
            np.testing.assert_equal(a, b)
        ended.append(ours[2])
        assert not ours[3].any()
    assert np.any(ended)
    assert any(0 < rows.sum() < 3 for rows in ended)
