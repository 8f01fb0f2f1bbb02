"""Reference agents of heel strike: what they choose, what they may see, and the order they end in."""

import gymnasium
import numpy as np
import pytest

import fieldgym  # noqa: F401  (registers the tasks)
from fieldagents.agent import Agent, visible
from fieldagents.config import EnvironmentConfig
from fieldagents.evaluation.episodes import run_episodes
from fieldagents.seeds import TEST_SEEDS, TUNING_SEEDS
from fieldagents.task import get_task
from fieldagents.tasks.heel_strike.agents import OracleGains, oracle_row, to_action, tuned
from fieldagents.tasks.heel_strike.search import WALKS, _ranger_error, recorded, tune
from fieldgym.heel_strike import HeelStrikeSettings

TASK = "heel_strike"
KINDS = ("ar1", "low_pass")
NAMES = tuple(name for name in get_task(TASK).agents if not name.endswith("_filterpy"))


def make(name: str, kind: str) -> Agent:
    return get_task(TASK).agents[name].make({"collision_kind": kind})


def environment(kind: str, **settings: object) -> EnvironmentConfig:
    return EnvironmentConfig(settings={"collision_kind": kind, **settings})


def mean_error(name: str, kind: str, seeds: range) -> float:
    return float(run_episodes(make(name, kind), TASK, environment(kind), seeds)["error_mm"].mean())


@pytest.fixture(scope="module", params=KINDS)
def errors(request):
    """Mean |error| of every agent on 24 test episodes, the same for all."""
    kind = request.param
    return kind, {name: mean_error(name, kind, TEST_SEEDS[:24]) for name in NAMES}


@pytest.mark.matrix(keep=("low_pass",))
def test_classical_estimators_come_in_the_expected_order(errors):
    kind, error = errors
    # Told the levels beats told the typical level; knowing the regime beats inferring it from the
    # observation, which beats the best constants, which beat the published constants.
    assert error["imm"] < error["ekf"] < error["fixed_tuned"]
    assert error["imm"] < error["oracle_gains"] < error["regime_filter"] < error["adaptive"]
    assert error["adaptive"] < 0.85 * error["fixed_tuned"]
    assert error["fixed_tuned"] < error["ranger"]
    assert error["ranger_tuned"] < error["ranger"]
    assert error["fixed_tuned"] <= error["paper_grid"] * 1.01
    if kind == "ar1":
        assert error["gated_tuned"] < 0.8 * error["fixed_tuned"]


@pytest.mark.matrix(keep=("ekf",))
@pytest.mark.parametrize("name", ["ekf", "imm"])
def test_filterpys_filters_score_as_the_compiled_ones(name):
    ours, theirs = (
        run_episodes(make(one, "ar1"), TASK, environment("ar1", strides=3), TEST_SEEDS[:2])["error_mm"]
        for one in (name, f"{name}_filterpy")
    )
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-8)
    assert ours.min() > 1e-3


def test_full_sensor_weight_is_rangers_estimator(errors):
    """With S_MS = 1 and S_FD = 2 / (3 step), (2.14) integrates the gyro as (2.2) does, to 0.2 %."""
    _, error = errors
    assert error["sensor_only"] == pytest.approx(error["ranger"], rel=2e-3)


@pytest.mark.matrix(
    keep=(
        "fixed_tuned-low_pass",
        "gated_tuned-ar1",
        "adaptive-ar1",
        "regime_filter-ar1",
        "oracle_gains-low_pass",
        "ranger_tuned-low_pass",
    )
)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "name", ["fixed_tuned", "gated_tuned", "adaptive", "regime_filter", "oracle_gains", "ranger_tuned"]
)
def test_stored_scores_are_those_of_the_environment(kind, name):
    """What the tuning scored on recorded walks is what the environment's steps give on the same seeds."""
    found = mean_error(name, kind, TUNING_SEEDS[:WALKS])
    assert found == pytest.approx(tuned()[kind][name]["tuned_mm"], rel=2e-3)


@pytest.mark.every("kind", KINDS)
def test_tuning_did_not_fit_its_own_walks_only(kind):
    for name, values in tuned()[kind].items():
        assert values["checked_mm"] < 1.12 * values["tuned_mm"], name


def test_the_papers_grid_finds_its_filter_decay():
    """S_FD = 333 wins the grid, as section 2.6.1 states."""
    assert [tuned()[kind]["paper_grid"]["decay"] for kind in KINDS] == [333.0, 333.0]


@pytest.mark.every("kind", KINDS)
@pytest.mark.every("name", NAMES)
def test_actions_lie_in_the_space(kind, name):
    agent = make(name, kind)
    envs = gymnasium.make_vec(
        "fieldgym/HeelStrike-v0",
        3,
        vectorization_mode="vector_entry_point",
        settings={"collision_kind": kind},
    )
    observation, info = envs.reset(seed=0)
    for _ in range(5):
        action = agent.act(observation, visible(info, agent.sees, "heel_strike"))
        assert envs.action_space.contains(action)
        observation, _, _, _, info = envs.step(action)
    envs.close()


def test_gains_survive_the_way_through_an_action():
    gains = np.array([[0.02, 0.5, 0.1], [0.001, 1.0, 0.01]])
    envs = gymnasium.make_vec("fieldgym/HeelStrike-v0", 2, vectorization_mode="vector_entry_point")
    envs.reset(seed=0)
    info = envs.step(to_action(gains))[4]
    np.testing.assert_allclose(info["gains"][:, :3], gains, rtol=1e-6)
    envs.close()


def test_gains_out_of_range_are_taken_to_its_ends():
    np.testing.assert_array_equal(to_action((0.0, 5.0, 1e-9)), [-1, 1, -1])


def test_oracle_needs_what_others_must_not_see():
    oracle = OracleGains(np.full((16, 3), 0.5))
    info = {"privileged.levels": np.ones(1), "_privileged.levels": np.ones(1), "error_mm": np.ones(1)}
    assert not visible(info, "observation", "heel_strike")
    assert not visible(info, "model", "heel_strike")
    with pytest.raises(KeyError):
        oracle.act(np.zeros((1, 6)), visible(info, "observation", "heel_strike"))


def test_oracle_rows_are_all_different():
    bits = np.array(np.meshgrid(*[[0, 1]] * 4)).reshape(4, -1)
    levels = np.stack([bits[0], np.zeros(16, int), bits[1]], axis=1)
    previous = np.stack([np.zeros(16, int), bits[3], bits[2]], axis=1)
    assert sorted(oracle_row(levels, previous)) == list(range(16))


@pytest.mark.every(("kind", "least"), [("ar1", (0.98, 0.8, 0.95)), ("low_pass", (0.98, 0.8, 0.75))])
def test_regime_filter_finds_the_hidden_levels(kind, least):
    """On test seeds it names process, floor and collision level right in most strides."""
    agent = make("regime_filter", kind)
    envs = gymnasium.make_vec(
        "fieldgym/HeelStrike-v0",
        24,
        vectorization_mode="vector_entry_point",
        settings={"collision_kind": kind},
    )
    observation, _ = envs.reset(seed=TEST_SEEDS[0])
    right = []
    agent.begin_episodes(np.ones(24, dtype=bool))
    np.testing.assert_allclose(agent.regimes(observation), 1 / 8)
    for _ in range(200):
        observation, _, _, _, info = envs.step(np.zeros((24, 3), dtype=np.float32))
        believed = agent.regimes(observation)
        np.testing.assert_allclose(believed.sum(axis=1), 1.0)
        high = [believed[:, [r for r in range(8) if r & bit]].sum(axis=1) > 0.5 for bit in (4, 2, 1)]
        right.append(np.stack(high, axis=1) == info["privileged.previous_levels"])
    assert (np.mean(right, axis=(0, 1)) > least).all()
    envs.close()


def test_an_agents_memory_is_one_row_an_environment():
    """A filter that acts on two walks at once thinks of each what it thinks of it alone."""
    rng = np.random.default_rng(0)
    walks = rng.normal(-8, 3, (10, 2, 6))
    both = make("regime_filter", "ar1")
    together = [both.act(observation, {}) for observation in walks]
    for i in range(2):
        alone = make("regime_filter", "ar1")
        for observation, action in zip(walks, together, strict=True):
            np.testing.assert_allclose(alone.act(observation[i : i + 1], {})[0], action[i], rtol=1e-6)
    both.begin_episodes(np.array([True, False]))
    after = both.act(walks[0], {})
    np.testing.assert_array_equal(after[0], together[0][0])
    assert (after[1] != together[0][1]).any()


def test_rangers_reset_is_scored_without_running_it_again():
    """The linear recursion behind the tuning of Ranger's reset gives the published one back."""
    walks = recorded(HeelStrikeSettings(strides=50), TUNING_SEEDS[:3])
    assert _ranger_error(walks, 0.1) == pytest.approx(np.abs(walks.estimator_mm[:, 1]).mean(), rel=1e-9)


@pytest.mark.nightly
@pytest.mark.parametrize("kind", KINDS)
def test_tuning_gives_the_stored_values_again(kind):
    found = tune(HeelStrikeSettings(collision_kind=kind))
    for name, values in tuned()[kind].items():
        assert found[name]["tuned_mm"] == pytest.approx(values["tuned_mm"], rel=0.01), name
