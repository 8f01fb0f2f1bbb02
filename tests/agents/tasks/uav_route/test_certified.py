"""Routes with a proven gap, and the bound of banked turns that proves it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from fieldagents.tasks.uav_route import banked_bound as module
from fieldagents.tasks.uav_route.banked_bound import banked_bound
from fieldagents.tasks.uav_route.certified import certified_plan
from fieldagents.tasks.uav_route.limits import limits_of, probability_seen
from fieldagents.tasks.uav_route.lower_bound import lower_bound
from fieldmodels.machines.uav_route.layouts import random_layout, safe_route
from fieldmodels.machines.uav_route.parameters import EXAMPLE, Aircraft, Layout, World
from fieldmodels.machines.uav_route.plan_simulation import simulate_plan
from fieldmodels.model import ModelError

LEVEL = World(aircraft=Aircraft(bank=0.0))


def layout(seed: int, radars: int = 1) -> Layout:
    return random_layout(np.random.default_rng(seed), radars)


@pytest.mark.every("seed", [6, 13, 29])
def test_without_a_bank_it_is_tangent_arc_and_spiral(seed: int) -> None:
    # a closed form shares nothing with the relaxation but the limits
    drawn = layout(seed)
    assert banked_bound(drawn, LEVEL) == pytest.approx(lower_bound(drawn, LEVEL), rel=1e-3)


def test_a_turn_at_the_side_of_the_radar_costs_more_than_the_arc() -> None:
    # half a turn about the radar: two tangents meet where a bank is no longer seen
    far = Layout((500.0, 0.0), (-500.0, 0.0), ((0.0, 0.0),))
    circle = limits_of(World()).side + 0.01
    beyond = math.pi / 2 - math.acos(circle / 500.0)
    route = [far.start, (0.0, circle / math.cos(beyond)), far.goal]
    flown = simulate_plan(route, far.radars).verification
    assert flown.undetected
    assert 1.01 * lower_bound(far, World()) < banked_bound(far, World()) <= flown.path_length


@pytest.mark.matrix(
    keep=(
        "0",
        "1",
        "4",
        "5",
        "7",
    )
)
@pytest.mark.parametrize("seed", range(8))
def test_no_undetected_route_is_shorter(seed: int) -> None:
    drawn, rng = layout(seed), np.random.default_rng(seed)
    bound = banked_bound(drawn, World())
    route = safe_route(drawn)
    found = 0
    for _ in range(300):  # the safe route, shaken
        shaken = route + rng.normal(scale=rng.choice([0.3, 3.0, 30.0]), size=route.shape)
        shaken[[0, -1]] = route[[0, -1]]
        flown = simulate_plan(shaken, drawn.radars, step=0.5).verification
        if flown.undetected:
            found += 1
            assert flown.path_length >= bound
            route = (
                shaken
                if flown.path_length < simulate_plan(route, drawn.radars).verification.path_length
                else route
            )
    assert found > 20


def test_a_bank_hides_what_level_flight_shows_and_the_bound_knows_it(monkeypatch) -> None:
    # 35 degrees off the nose, inside the circle: seen level, hidden banked
    at, off = np.array([350.0]), np.array([math.radians(35.0)])
    assert probability_seen(World(), at, off)[0] > 0.5
    assert min(probability_seen(World(), at, off, b)[0] for b in (-math.pi / 4, math.pi / 4)) < 0.5
    drawn = layout(99)
    own = banked_bound(drawn, World())
    legs = module._legs

    def unhidden(*args):
        found = legs(*args)
        found.bank[:] = 0.0
        return found

    monkeypatch.setattr(module, "_legs", unhidden)
    assert banked_bound(drawn, World()) > 1.005 * own


@pytest.mark.matrix(keep=("6-1",))
@pytest.mark.parametrize(("seed", "radars"), [(6, 1), (19, 2), (17, 3)])
def test_the_gap_is_proven_and_small(seed: int, radars: int) -> None:
    drawn = layout(seed, radars)
    plan = certified_plan(drawn)
    assert plan.search.status == "feasible"
    assert 0.0 <= plan.search.gap <= 0.03
    flown = simulate_plan(plan.waypoints, drawn.radars, step=0.02).verification
    assert flown.undetected
    assert flown.path_length == pytest.approx(plan.search.objective)
    assert plan.search.bound == banked_bound(drawn, World())


def test_a_goal_at_the_radar_has_no_plan_and_a_gap_is_not_negative() -> None:
    plan = certified_plan(Layout((350.0, 125.0), (50.0, 0.0), EXAMPLE.radars))
    assert (plan.planner, plan.search.status, plan.found) == ("certified", "infeasible", False)
    with pytest.raises(ModelError, match="gap"):
        certified_plan(EXAMPLE, gap=-0.1)
