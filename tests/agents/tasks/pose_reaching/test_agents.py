"""Reference agents of pose reaching: what they do, what they may see, and the order they end in."""

import gymnasium
import numpy as np
import pytest

from fieldagents.agent import Agent, visible
from fieldagents.config import EnvironmentConfig
from fieldagents.evaluation.episodes import run_episodes
from fieldagents.seeds import TEST_SEEDS, TRAINING_SEEDS
from fieldagents.task import get_task
from fieldagents.tasks.pose_reaching.agents import SEED, away_from_walls, poses_of, table_driver
from fieldagents.tasks.pose_reaching.path_memory.practice import own_data, to_action
from fieldgym.pose_reaching import PoseReachingSettings
from fieldmodels.machines.pose_reaching.parameters import Field

TASK = "pose_reaching"
NAMES = tuple(get_task(TASK).agents)
FAULTY = {"yaw_slip": {"share": 0.3}, "actuator_delay": {"delay": 0.1}}


def make(name: str, **settings: object) -> Agent:
    return get_task(TASK).agents[name].make(settings)


def played(agent: Agent, starts: str, episodes: int = 150, reality: object = None):
    environment = EnvironmentConfig(settings={"starts": starts}, reality=reality)
    return run_episodes(agent, TASK, environment, TEST_SEEDS[:episodes])


def envs_of(number: int, **settings: object):
    return gymnasium.make_vec(
        "fieldgym/PoseReaching-v0",
        number,
        vectorization_mode="vector_entry_point",
        vector_kwargs={},
        settings=settings,
    )


@pytest.fixture(scope="module")
def results():
    """Every agent on the same 150 test episodes from anywhere."""
    return {name: played(make(name), "T3") for name in NAMES}


@pytest.mark.nightly
def test_agents_come_in_the_expected_order(results):
    success = {name: table["success"].mean() for name, table in results.items()}
    # What the text says fails, what it must mean works; standing still where nothing is near costs some.
    assert success["path_memory_printed"] < 0.1
    assert success["path_memory"] > 0.97
    assert success["path_memory_stop"] < success["path_memory"]
    assert 0.85 < success["path_memory_dubins"] < 1
    # No teacher is needed: the robot's own random motion does.
    assert min(success["own_data"], success["own_data_practised"]) > 0.97
    assert success["least_time"] > 0.98
    ratio = {name: table["time_ratio"].mean() for name, table in results.items()}
    assert ratio["least_time"] < ratio["path_memory_dubins"] < ratio["path_memory"]
    assert ratio["own_data_practised"] < 0.9 * ratio["own_data"]


def test_nobody_is_faster_than_the_ceiling(results):
    """Paired on the episodes that both finish; 3 % is for the ceiling's own grid."""
    best = results["least_time"].set_index("seed")["time"]
    for name, table in results.items():
        pair = table.set_index("seed")["time"].to_frame("other").assign(best=best).dropna()
        if len(pair) >= 10:
            assert pair["best"].mean() < 1.03 * pair["other"].mean(), name


@pytest.mark.every("starts", ["T1", "T2"])
def test_the_memory_works_where_its_paths_begin(starts):
    assert played(make("path_memory"), starts)["success"].mean() > 0.97
    assert played(make("path_memory_printed"), starts)["success"].mean() < 0.3


@pytest.mark.every("name", NAMES)
def test_actions_lie_in_the_space_and_need_the_observation_only(name):
    agent = make(name)
    assert agent.sees == ("model" if name == "least_time" else "observation")
    envs = envs_of(5)
    observation, _ = envs.reset(seed=0)
    for _ in range(5):
        action = agent.act(observation, visible({}, agent.sees, "pose_reaching"))
        assert envs.action_space.contains(action)
        alone = [agent.act(observation[i : i + 1], {})[0] for i in range(5)]
        np.testing.assert_allclose(alone, action, atol=1e-6)  # rows do not know of each other
        observation = envs.step(action)[0]
    envs.close()


def test_the_pose_is_in_the_observation():
    envs = envs_of(200)
    observation, info = envs.reset(seed=3)
    poses = poses_of(observation)
    np.testing.assert_allclose(poses[:, :2], info["pose"][:, :2], atol=1e-6)
    np.testing.assert_allclose(np.cos(poses[:, 2] - info["pose"][:, 2]), 1, atol=1e-6)
    envs.close()


def test_a_command_becomes_the_action_that_gives_it():
    settings = PoseReachingSettings(max_speed=0.5, max_rate=2.0)
    commands = np.array([[0.5, 2.0], [0.0, -2.0], [0.25, 1.0], [9.0, -99.0]])
    np.testing.assert_allclose(to_action(commands, settings), [[1, 1], [-1, -1], [0, 0.5], [1, -1]])


def test_a_robot_held_by_a_wall_turns_to_the_ball():
    poses = np.array([[2.5, 0.5, 0.3], [2.5, 0.5, 3.0], [0.0, -1.5, -1.6], [1.0, 1.0, 0.0]])
    told = np.ones((4, 2))
    found = away_from_walls(poses, told, 4.0, Field())
    np.testing.assert_array_equal(found, [[0, 4], [1, 1], [0, -4], [1, 1]])


def test_a_sketch_shows_what_the_agent_goes_by():
    """The environment takes it and draws another picture."""
    env = gymnasium.make("fieldgym/PoseReaching-v0", render_mode="rgb_array")
    observation, _ = env.reset(seed=0)
    plain = env.render()
    agent = make("path_memory")
    agent.act(observation[None], {})
    sketch = agent.sketch()
    assert len(sketch["memory"]) == 9
    assert sketch["chosen"].shape == (1, 3)
    env.unwrapped.show(**sketch)
    assert (env.render() != plain).any()
    env.close()
    assert make("graceful").sketch() is None


def test_training_data_are_made_on_training_seeds_and_always_the_same():
    assert SEED in TRAINING_SEEDS
    assert TEST_SEEDS[0] > SEED + 7 * 20 + 20
    settings = PoseReachingSettings()
    first, again = (own_data(settings, seconds=60, rounds=1, seed=SEED) for _ in range(2))
    np.testing.assert_array_equal(first.time, again.time)
    np.testing.assert_array_equal(first.command, again.command)


def test_own_data_learned_in_a_faulty_robot_suit_it():
    """Slip and delay: what was learned in them drives faster in them than what the ideal robot learned."""
    settings = PoseReachingSettings()
    seconds = []
    for reality in (None, FAULTY):
        table = own_data(settings, reality, seconds=600, rounds=0, seed=SEED)
        result = played(table_driver(settings, table), "T3", 300, FAULTY)
        seconds.append(result["time"].fillna(settings.timeout).mean())
    assert seconds[1] < seconds[0]


def test_metrics_hold_for_arrivals_only(results):
    table = results["path_memory_stop"]
    names = [metric.name for metric in get_task(TASK).metrics]
    assert names[0] == "success"
    for name in ("time", "time_ratio", "length_ratio"):
        np.testing.assert_array_equal(table[name].isna(), table["success"] == 0)
    assert (table["length_ratio"].dropna() > 0).all()
    assert (table["dubins_length"] > 0).all()


def test_an_omnidirectional_robot_takes_the_direct_approach():
    """Section 5.3.2: straight to the ball, and the orientation changes independently of the path."""
    settings = {"drive": "omnidirectional", "starts": "T3"}
    environment, seeds = EnvironmentConfig(settings=settings), TEST_SEEDS[:150]
    env = gymnasium.make("fieldgym/PoseReaching-v0", settings=settings)
    starts = np.array([env.reset(seed=seed)[1]["pose"] for seed in seeds])
    distance = np.hypot(starts[:, 0], starts[:, 1])
    turn = np.abs((starts[:, 2] - 0.5 * np.pi + np.pi) % (2 * np.pi) - np.pi)
    # No robot is faster than its largest speed and turn rate; arrival is 5 cm and 10 deg before the goal.
    least = np.maximum(np.maximum(distance - 0.05, 0.0), np.maximum(turn - np.radians(10), 0.0) / 4.0)
    results = {
        name: run_episodes(make(name, **settings), TASK, environment, seeds)
        for name in ("direct", "path_memory_straight", "path_memory")
    }
    assert all(table["success"].mean() == 1 for table in results.values())
    over = {name: table["time"] - least for name, table in results.items()}
    assert over["direct"].min() > -1e-9
    assert over["direct"].max() < 0.1 + 1e-9  # a tick
    assert over["direct"].mean() < over["path_memory_straight"].mean() < 0.1
    assert over["path_memory"].mean() > 1.0  # made to behave as a unicycle, as the source's were


def test_a_unicycle_goes_straight_too_but_turns_before_and_after(results):
    table = results["direct"]
    assert table["success"].mean() == 1
    assert (table["length_ratio"] <= 1.0 + 1e-6).all()
    assert results["path_memory_straight"]["success"].mean() < 0.3  # it cannot turn on the way


@pytest.mark.every("name", ["graceful", "own_data"])
def test_agents_of_a_unicycle_drive_an_omnidirectional_robot_as_one(name):
    settings = {"drive": "omnidirectional"}
    ours, theirs = (
        run_episodes(make(name, **own), TASK, EnvironmentConfig(settings=own), TEST_SEEDS[:20])
        for own in (settings, {})
    )
    np.testing.assert_allclose(ours["time"], theirs["time"], rtol=1e-5)
