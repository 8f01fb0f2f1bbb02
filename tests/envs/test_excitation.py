"""The excitation task: what its docs page states."""

import os
import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest

import fieldgym
from fieldgym.excitation import ExcitationSettings
from fieldgym.info import part
from fieldmodels.machines.excitation.motion import CONSTANT, STEADY_SHARE
from fieldmodels.machines.excitation.parameters import LIMITS, PRESETS, TABLE1
from fieldmodels.model import ModelError

ID = "fieldgym/Excitation-v0"


def action(command, limits="wide"):
    """The action that asks for a command."""
    bounds = LIMITS[limits]
    low, high = np.transpose([(0.0, bounds.amplitude), bounds.frequency, bounds.offset])
    return (2 * (np.asarray(command) - low) / (high - low) - 1).astype(np.float32)


def episode(actions, batch=8, seed=0, reality=None, **settings):
    """Rewards, and infos from reset to end, of one action for all steps or a function of the step."""
    env = gym.make_vec(ID, num_envs=batch, settings=settings, reality=reality)
    observation, info = env.reset(seed=seed)
    infos, rewards, observations = [info], [], [observation]
    for k in range(env.settings.decisions):
        chosen = actions(k) if callable(actions) else actions
        observation, reward, _, truncated, info = env.step(
            np.tile(np.asarray(chosen, np.float32), (batch, 1))
        )
        infos.append(info)
        rewards.append(reward)
        observations.append(observation)
    assert truncated.all()
    return np.array(rewards), infos, np.array(observations)


CONSTANT_ACTION = action(CONSTANT)


def anything(k, seed=0):
    """Random actions, the same for every row."""
    return np.random.default_rng([seed, k]).uniform(-1, 1, 3)


def test_rewards_sum_to_the_information_gained():
    rewards, infos, _ = episode(anything)
    np.testing.assert_allclose(rewards.sum(axis=0), infos[-1]["bits"] - infos[0]["bits"], rtol=1e-12)
    np.testing.assert_allclose(infos[-1]["information"].sum(axis=1), infos[-1]["bits"], rtol=1e-12)
    assert (rewards.sum(axis=0) > 100).all()


def test_weights_weigh_the_bits_of_their_groups():
    rewards, infos, _ = episode(anything, weights=(2.0, 1.0, 0.0, 0.5, 3.0))
    weights = [2.0] + 6 * [1.0] + 3 * [0.0] + 6 * [0.5] + 6 * [3.0]
    gained = (infos[-1]["information"] - infos[0]["information"]) @ weights
    np.testing.assert_allclose(rewards.sum(axis=0), gained, rtol=1e-12)


@pytest.mark.every("preset", ["table1", "soft"])
def test_relative_error_is_rewarded_by_its_halvings(preset):
    weights = (1.0, 2.0, 0.5, 1.0, 0.0)
    rewards, infos, _ = episode(
        anything, reward="relative_error", weights=weights, preset=preset, truth_spread=0.2
    )
    expected = []
    for info in (infos[0], infos[-1]):
        total = count = 0.0
        for i, nominal in enumerate(PRESETS[preset]):
            weight = weights[0 if i < 1 else 1 if i < 7 else 2 if i < 10 else 3 if i < 16 else 4]
            if nominal:
                total += weight * info["estimate.covariance"][:, i, i] ** 0.5 / abs(nominal)
                count += weight
        expected.append(total / count)
    np.testing.assert_allclose(rewards.sum(axis=0), np.log2(expected[0] / expected[1]), rtol=1e-12)


def test_scalar_and_vector_rewards_are_equal_to_the_bit():
    chosen = {"reward": "relative_error", "weights": (1.0, 0.3, 2.0, 1.0, 1.0), "decisions": 3}
    vector, _, _ = episode(anything, batch=2, seed=5, **chosen)
    for row, seed in enumerate((5, 6)):
        env = gym.make(ID, settings=chosen)
        env.reset(seed=seed)
        scalar = [env.step(anything(k).astype(np.float32))[1] for k in range(3)]
        assert np.array_equal(scalar, vector[:, row])


def test_weights_that_leave_nothing_are_refused():
    with pytest.raises(fieldgym.SettingsError, match="let one be positive"):
        gym.make(ID, settings={"weights": (1.0, 0.0, 0.0, 0.0, 0.0), "variant": "table2"})


def test_constant_action_keeps_equation_24():
    _, infos, _ = episode(CONSTANT_ACTION, batch=1)
    for k, info in enumerate(infos):
        # The action is a float32.
        np.testing.assert_allclose(info["arm.command"][0], CONSTANT, rtol=1e-6)
        assert np.exp(1j * info["arm.phase"][0]) == pytest.approx(np.exp(1j * np.pi / 2 * 0.4 * k), abs=1e-5)


@pytest.mark.every("limits", LIMITS)
def test_actions_are_commands_within_the_limits(limits):
    bounds = LIMITS[limits]
    for value in (-1.0, 0.0, 1.0):
        _, infos, _ = episode(np.full(3, value), batch=1, limits=limits, decisions=40)
        a, w, a0 = infos[-1]["arm.command"][0]
        share = (value + 1) / 2
        assert w == pytest.approx(bounds.frequency[0] + share * (bounds.frequency[1] - bounds.frequency[0]))
        assert a0 == pytest.approx(bounds.offset[0] + share * (bounds.offset[1] - bounds.offset[0]))
        assert a == pytest.approx(min(share * bounds.amplitude, STEADY_SHARE * bounds.acceleration / w**2))


def test_actions_outside_the_box_are_clipped():
    inside, outside = gym.make(ID).unwrapped, gym.make(ID).unwrapped
    inside.reset(seed=1)
    outside.reset(seed=1)
    a, b = inside.step(np.array([1, -1, 1], np.float32)), outside.step(np.array([7, -3, 1.5], np.float32))
    assert a[1] == b[1]
    assert np.array_equal(a[0], b[0])


def test_observation_is_what_the_filter_and_the_arm_say():
    _, infos, observations = episode(anything, batch=3)
    prior = part(infos[0], "estimate")
    deviation = np.sqrt(np.diagonal(prior["covariance"], axis1=1, axis2=2))
    for info, seen in zip(infos, observations, strict=True):
        means = (info["estimate.mean"] - prior["mean"]) / deviation
        own = np.sqrt(np.diagonal(info["estimate.covariance"], axis1=1, axis2=2))
        np.testing.assert_allclose(seen[:, :22], np.clip(means, -5, 5), atol=1e-6)
        np.testing.assert_allclose(seen[:, 22:44], np.log(own / deviation), atol=1e-5)
        command = np.array([action(c) for c in info["arm.command"]])
        np.testing.assert_allclose(seen[:, 44:47], command, atol=1e-6)
        phase = info["arm.phase"]
        np.testing.assert_allclose(seen[:, 47:49], np.column_stack([np.cos(phase), np.sin(phase)]), atol=1e-6)
    np.testing.assert_allclose(observations[:, 0, 49], 1 - np.arange(26) / 25, atol=1e-6)


def test_truth_is_never_observed():
    """Vehicles that differ give the same first observation; what differs later came through the sensors."""
    env = gym.make_vec(ID, num_envs=4, settings={"truth_spread": 0.3})
    observation, info = env.reset(seed=0)
    assert len(np.unique(info["privileged.truth"][:, 0])) == 4
    assert (observation == observation[0]).all()
    told = {key for key in info if not key.startswith(("_", "privileged."))}
    for key in told - {"error_percent", "error_normalised", "error_percent_naive", "error_normalised_naive"}:
        if info[key].dtype != np.bool_:
            assert (info[key] == info[key][:1]).all(), key


def test_equal_seeds_give_every_agent_the_same_vehicle():
    _, one, _ = episode(anything, truth_spread=0.3, seed=4)
    _, other, _ = episode(CONSTANT_ACTION, truth_spread=0.3, seed=4)
    assert np.array_equal(one[-1]["privileged.truth"], other[-1]["privileged.truth"])
    assert np.array_equal(one[0]["privileged.truth"], one[-1]["privileged.truth"])


def test_errors_are_those_of_the_estimate():
    _, infos, _ = episode(anything)
    last = infos[-1]
    error, truth = last["privileged.error"], last["privileged.truth"]
    np.testing.assert_array_equal(error, last["estimate.mean"] - truth)
    nonzero = TABLE1 != 0
    expected = 100 * np.abs(error[:, nonzero] / TABLE1[nonzero]).mean(axis=1)
    np.testing.assert_allclose(last["error_percent"], expected, rtol=1e-12)
    assert nonzero.sum() == 20


def test_time_to_20_is_since_when_the_error_stays_below():
    _, infos, _ = episode(CONSTANT_ACTION, batch=16)
    errors = np.array([info["error_percent"] for info in infos[1:]])
    times = np.array([info["time_to_20"] for info in infos[1:]])
    reached = np.array([info["reached_20"] for info in infos[1:]])
    np.testing.assert_array_equal(reached, errors < 20)
    assert 0 < reached[-1].sum() < 16
    for step, row in np.ndindex(25, 16):
        above = np.flatnonzero(errors[: step + 1, row] >= 20)
        since = step if not reached[step, row] else above[-1] + 1 if len(above) else 0
        assert times[step, row] == pytest.approx(0.4 * (since + 1))


def test_without_noise_everything_is_found_exactly():
    """A x = F holds to rounding, so that 0.4 s of motion give 22 unknowns to all digits that matter."""
    _, infos, _ = episode(anything, noise_fraction=0.0, decisions=2)
    for key in ("error_percent", "error_percent_naive"):
        assert infos[-1][key].max() < 1e-6
    np.testing.assert_allclose(infos[-1]["information"], 10.0, atol=1e-6)


def test_motion_that_excites_tells_more_than_the_source_s_constant_one():
    """16 seeds; wide limits and full-scale noise: a third of the error at most, 30 bits more at least."""
    _, constant, _ = episode(CONSTANT_ACTION, batch=16)
    _, lively, _ = episode(anything, batch=16)
    assert lively[-1]["error_percent"].mean() < constant[-1]["error_percent"].mean() / 3
    assert (lively[-1]["bits"] > constant[-1]["bits"] + 30).all()


def test_running_maximum_leaves_little_to_win():
    """There noise grows with the signals: shaking harder does not help."""
    _, constant, _ = episode(CONSTANT_ACTION, batch=16, noise="running_max")
    _, lively, _ = episode(anything, batch=16, noise="running_max")
    gain = lively[-1]["bits"].mean() - constant[-1]["bits"].mean()
    assert abs(gain) < 25


def test_naive_filter_runs_beside_and_can_be_put_first():
    _, beside, _ = episode(CONSTANT_ACTION)
    _, first, _ = episode(CONSTANT_ACTION, estimator="naive")
    for key in ("bits", "error_percent", "error_normalised"):
        np.testing.assert_array_equal(beside[-1][f"{key}_naive"], first[-1][key])
        np.testing.assert_array_equal(first[-1][f"{key}_naive"], first[-1][key])
    assert (beside[-1]["error_percent"] < beside[-1]["error_percent_naive"]).all()


def test_soft_suspension_shows_the_inertia():
    _, stiff, _ = episode(anything)
    _, soft, _ = episode(anything, preset="soft")
    assert (
        soft[-1]["information"][:, 1:7].sum(axis=1) > 2 * stiff[-1]["information"][:, 1:7].sum(axis=1)
    ).all()
    assert np.array_equal(soft[-1]["privileged.truth"][0], PRESETS["soft"])


def test_table_2_counts_five_unknowns():
    _, infos, _ = episode(anything, variant="table2")
    assert np.array_equal(np.flatnonzero(infos[-1]["information"][0]), [1, 8, 9, 13, 19])
    assert (infos[-1]["bits"] > infos[0]["bits"] + 5).all()


@pytest.mark.every("estimator", ["compensated", "low_passed"])
def test_two_sigma_cover_what_they_should(estimator):
    """Of 64 x 22 errors 95.4 % lie within 2 sigma; errors of one episode go together: 0.90 to 0.98."""
    _, infos, _ = episode(anything, batch=64, estimator=estimator)
    sigma = np.sqrt(np.diagonal(infos[-1]["estimate.covariance"], axis1=1, axis2=2))
    inside = np.abs(infos[-1]["privileged.error"]) < 2 * sigma
    assert 0.90 < inside.mean() < 0.98


def test_reality_reaches_the_vehicle():
    heavier = {"parameters": {"mass": 5.0}}
    _, infos, _ = episode(anything, reality=heavier)
    assert (infos[-1]["privileged.truth"][:, 0] == 5.0).all()
    assert np.abs(infos[-1]["estimate.mean"][:, 0] - 5.0).max() < 0.5


def test_an_extended_model_does_not_silently_change_the_vehicle(tmp_path):
    """A diagnosis holds the soft vehicle against the data: its file is of no other one."""
    path = tmp_path / "extended.yaml"
    path.write_text(
        "schema: 1\nmodel: excitation\nparameters: {damping_x: {value: 9.0}}\n"
        "effects: {payload: {mass: {value: 0.2}}}\n"
    )
    with pytest.raises(ModelError, match="set preset: soft"):
        gym.make("fieldgym/Excitation-v0", reality=path)
    gym.make("fieldgym/Excitation-v0", reality=path, settings={"preset": "soft"}).reset(seed=0)


def test_unknown_effect_is_named():
    with pytest.raises(ModelError, match="did you mean"):
        gym.make(ID, reality={"payloda": {"mass": 0.1}})


@pytest.mark.every(
    ("settings", "message"),
    [
        ({"preset": "hard"}, "'table1' or 'soft'"),
        ({"decisions": 0}, "decisions.*greater than or equal to 1"),
        ({"truth_spread": 0.9}, "truth_spread"),
        ({"noise_fraction": -0.1}, "noise_fraction"),
        ({"estimator": "perfect"}, "estimator"),
        ({"bits": 40}, "bits"),
        ("wide", "a mapping or None"),
    ],
)
def test_wrong_settings_are_refused(settings, message):
    with pytest.raises(fieldgym.SettingsError, match=message):
        gym.make(ID, settings=settings)


def test_settings_object_and_mapping_mean_the_same():
    a = gym.make(ID, settings=ExcitationSettings(limits="paper")).unwrapped
    assert a.settings == gym.make(ID, settings={"limits": "paper"}).unwrapped.settings
    with pytest.raises(AttributeError):
        a.settings.decisions = 3


def test_decision_is_drawn_in_slices():
    env = gym.make(ID, render_mode="rgb_array").unwrapped
    env.reset(seed=0)
    env.step(np.zeros(3, np.float32))
    frames = list(env.step_frames(10))
    assert len(frames) == 4
    assert np.array_equal(frames[-1], env.render())
    assert not np.array_equal(frames[0], frames[-1])


def test_pictures_go_on_from_a_restored_state():
    env = gym.make(ID, render_mode="rgb_array").unwrapped
    env.reset(seed=0)
    for _ in range(3):
        env.step(np.zeros(3, np.float32))
    state = env.get_state()
    env.set_state(state)
    blank = env.render()
    env.step(np.zeros(3, np.float32))
    assert (env.render() != blank).any()


FIRST_STEP = """
import gymnasium as gym, fieldgym
from numba.core import event
with event.install_recorder("numba:compile") as record:
    env = gym.make("fieldgym/Excitation-v0")
    env.reset(seed=0)
    env.step(env.action_space.sample())
print(sum(one.is_start for _, one in record.buffer))
"""


@pytest.mark.nightly
def test_a_first_step_compiles_at_most_so_many_functions(tmp_path):
    """Each takes 12 ms and more, and one that creates an array compiles another six for it."""
    places = dict.fromkeys(("NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "HOME", "TMPDIR"), str(tmp_path))
    found = subprocess.run(
        [sys.executable, "-c", FIRST_STEP],
        env=os.environ | places,
        check=True,
        capture_output=True,
        text=True,
    )
    assert 50 < int(found.stdout) <= 100
