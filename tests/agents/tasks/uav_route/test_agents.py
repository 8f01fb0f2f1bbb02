"""The planners as agents in the environment: what they plan, how they fly it, and what comes of it."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest

from fieldagents.agent import visible
from fieldagents.config import EnvironmentConfig
from fieldagents.evaluation.episodes import run_episodes
from fieldagents.task import get_task
from fieldagents.tasks.uav_route import agents, printed, programs
from fieldagents.tasks.uav_route.agents import Planner
from fieldagents.tasks.uav_route.legs import leg_plan
from fieldagents.tasks.uav_route.lower_bound import bound_to_capture, layouts_of
from fieldgym.settings import read_settings
from fieldgym.uav_route import UavRouteSettings
from fieldmodels.machines.uav_route.parameters import EXAMPLE, SECOND_UAV, World

NO_LOCK_LOSS = {"lock_loss": False}
SAFE = ("two_legs", "legs", "lattice")


def played(name: str, settings: dict, episodes: int):
    agent = get_task("uav_route").agents[name].make(settings)
    return run_episodes(agent, "uav_route", EnvironmentConfig(settings=settings), range(episodes))


@pytest.fixture(scope="module")
def results():
    return {name: played(name, NO_LOCK_LOSS, 6) for name in ("straight", *SAFE)}


@pytest.mark.nightly
def test_undetected_plans_arrive_undetected(results) -> None:
    for name in SAFE:
        assert (results[name]["success"] == 1).all()
        assert (results[name]["time_over"] == 0).all()


def test_no_undetected_flight_is_shorter_than_the_bound(results) -> None:
    # planned in a circle of 5 km less 50 m, flown to its edge
    assert all((results[name]["length_ratio"] >= 1 - 1e-6).all() for name in SAFE)
    assert results["lattice"]["length_ratio"].mean() < results["two_legs"]["length_ratio"].mean()
    assert results["legs"]["length_ratio"].mean() < results["two_legs"]["length_ratio"].mean()


def test_who_flies_straight_is_hit(results) -> None:
    straight = results["straight"]
    assert straight["damaged"].mean() > 0.5
    assert (straight["success"] + straight["damaged"] == 1).all()


def test_lock_loss_is_used() -> None:
    settings = {"layout": "example"}
    table = played("legs_lock_loss", settings, 1)
    assert table["success"][0] == 1
    assert 0 < table["longest_detection"][0] <= 150
    assert table["length_ratio"][0] < 1


def test_further_radars_out_of_the_way_change_nothing() -> None:
    # random layouts of one seed share their first radar, and the others keep away from a safe route
    one, three = (played("two_legs", NO_LOCK_LOSS | {"radars": n}, 4) for n in (1, 3))
    np.testing.assert_allclose(one["path_length"], three["path_length"])


def test_receding_plans_again_keeps_what_it_has_and_arrives() -> None:
    once, again = (played(name, NO_LOCK_LOSS | {"layout": "example"}, 1) for name in ("legs", "receding"))
    assert again["success"][0] == 1
    assert again["time_over"][0] == 0
    np.testing.assert_allclose(again["path_length"], once["path_length"], atol=agents.WORTH)


def test_radars_out_of_sight_are_flown_into() -> None:
    given = NO_LOCK_LOSS | {"layout": "example"}
    blind = Planner(read_settings(given, UavRouteSettings), agents.legs, sight=1.0)
    table = run_episodes(blind, "uav_route", EnvironmentConfig(settings=given), range(1))
    assert table["damaged"][0] == 1
    assert table["legs"][0] == 1  # straight to the goal


def test_a_plan_is_flown_as_planned() -> None:
    settings = NO_LOCK_LOSS | {"layout": "example"}
    agent = get_task("uav_route").agents["legs"].make(settings)
    envs = gymnasium.make_vec(
        "fieldgym/UavRoute-v1", num_envs=2, vectorization_mode="vector_entry_point", settings=settings
    )
    observation, info = envs.reset(seed=3)
    agent.begin_episodes(np.ones(2, dtype=np.bool_))
    action = agent.act(observation, visible(info, agent.sees, "uav_route"))
    assert action.dtype == np.float32
    assert envs.action_space.contains(action)
    sketch = agent.sketch()
    assert sketch is not None
    plan = sketch["plan"]
    np.testing.assert_allclose(plan[0], plan[1])
    for waypoint in plan[0][:-1]:
        observation, _, terminated, _, info = envs.step(action)
        assert not terminated.any()
        np.testing.assert_allclose(info["place"], np.broadcast_to(waypoint, (2, 2)), atol=1e-3)
        action = agent.act(observation, visible(info, agent.sees, "uav_route"))
    *_, info = envs.step(action)
    assert (info["success"] == 1).all()
    flown = leg_plan(EXAMPLE).length
    assert info["path_length"][0] < flown
    envs.close()


def test_plans_end_where_arrival_is_nearest() -> None:
    bound, bearing = bound_to_capture(EXAMPLE, World(), 5.0)
    goal = np.array(EXAMPLE.goal) + 5.0 * np.array([np.cos(bearing), np.sin(bearing)])
    assert bound < leg_plan(EXAMPLE).lower_bound - 4.0
    assert np.hypot(*goal) > np.hypot(*EXAMPLE.goal)  # farther from the radar


def test_without_a_plan_an_agent_leaves_and_it_is_counted() -> None:
    settings = NO_LOCK_LOSS | {
        "layout": {"start": (380.0, 125.0), "goal": (20.0, 0.0), "radars": ((0.0, 0.0),)},
        "max_legs": 5,
    }
    table = played("legs", settings, 1)
    assert table[["no_plan", "infeasible"]].to_numpy().tolist() == [[1, 1]]
    assert (table["success"][0], table["damaged"][0], table["time_over"][0]) == (0, 0, 0)
    assert table["legs"][0] == 5
    assert np.isnan(table["plan_gap"][0])


def test_a_plan_stopped_by_its_work_limit_is_no_plan_and_not_infeasible(monkeypatch) -> None:
    monkeypatch.setattr(agents, "WORK", 1)
    table = played("printed", {"layout": "example"}, 1)
    assert table[["no_plan", "infeasible", "success"]].to_numpy().tolist() == [[1, 0, 0]]


def test_the_solver_s_gap_and_bound_are_metrics_and_others_have_none(results) -> None:
    assert (results["legs"]["plan_gap"] <= 1e-6).all()
    assert (results["legs"]["plan_bound"] > 0).all()
    assert (results["straight"]["no_plan"] == 0).all()
    assert results["lattice"]["plan_gap"].isna().all()


def test_layouts_are_read_from_info() -> None:
    told = {
        "layout.start": np.array([[1.0, 2.0]]),
        "layout.goal": np.array([[3.0, 4.0]]),
        "layout.radars": np.array([[[5.0, 6.0], [7.0, 8.0]]]),
    }
    (layout,) = layouts_of(told)
    assert (layout.start, layout.goal, layout.radars) == ((1.0, 2.0), (3.0, 4.0), ((5.0, 6.0), (7.0, 8.0)))


def test_a_missing_solver_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail() -> None:
        raise programs.MissingSolverError("needs PuLP: pip install 'fieldgym[planning]'")

    monkeypatch.setattr(programs, "modelling", fail)
    with pytest.raises(programs.MissingSolverError, match=r"fieldgym\[planning\]"):
        played("legs", NO_LOCK_LOSS | {"layout": "example"}, 1)


def test_long_legs_are_divided_and_short_ones_left_out() -> None:
    settings = UavRouteSettings(least_leg=2.5, longest_leg=50.0)
    agent = Planner(settings, lambda layout, world, heading: None)  # type: ignore[arg-type]
    route = agent._flyable(np.array([[0.0, 0.0], [0.0, 120.0], [0.0, 121.0], [30.0, 121.0]]))
    legs = np.hypot(*np.diff(np.concatenate([[[0.0, 0.0]], route]), axis=0).T)
    np.testing.assert_allclose(legs, [40.0, 40.0, 40.0, np.hypot(30.0, 1.0)])


@pytest.mark.nightly
def test_several_aircraft_are_planned_each_and_all_arrive() -> None:
    table = played("legs", NO_LOCK_LOSS | {"aircraft": 2, "radars": 2}, 3)
    assert (table["success"] == 1).all()
    assert (table["time_over"] == 0).all()
    assert (table["length_ratio"] >= 1 - 1e-6).all()
    assert (table["length_ratio"] < 1.25).all()


def test_joint_plans_are_flown_and_cost_what_each_alone_does(monkeypatch) -> None:
    """One program of both aircraft: its proven cost is the sum, and each flies its own part of the plan."""
    form = printed.Form(steps=5, step_time=120.0, sides=8, slack=None, lookup="sets")
    monkeypatch.setattr(agents, "form_for", lambda *_: form)
    settings = {"aircraft": 2, "layout": "example", "engage": 1e9}
    table = played("printed_joint", settings, 1)
    alone = [agents.joint_printed_plans((own,), World(), form)[0] for own in (EXAMPLE, SECOND_UAV)]
    assert table["plan_bound"][0] == sum(plan.search.bound for plan in alone)
    assert table["plan_gap"][0] == 0
    assert table["success"][0] == 1
    assert table["no_plan"][0] == 0
