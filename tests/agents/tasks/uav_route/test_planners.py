"""Planners of UAV routes: what they prove, what the continuous model says of it, and how they fail."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from fieldagents.tasks.uav_route import programs
from fieldagents.tasks.uav_route.lattice import lattice_plan
from fieldagents.tasks.uav_route.legs import leg_plan
from fieldagents.tasks.uav_route.limits import limits_of, probability_seen
from fieldagents.tasks.uav_route.lower_bound import lower_bound
from fieldagents.tasks.uav_route.printed import Form, joint_printed_plans, printed_plan, safe_distances
from fieldagents.tasks.uav_route.straight import straight_plan
from fieldmodels.machines.uav_route.parameters import (
    EXAMPLE,
    INSTANT_KILL,
    SECOND_UAV,
    Aircraft,
    Detection,
    Layout,
    World,
)
from fieldmodels.machines.uav_route.plan_simulation import simulate_plan
from fieldmodels.model import ModelError

SOLVERS = ("highs", "cbc")
THRESHOLDS = (0.5, 0.6, 0.7)
SHORT = Layout((350.0, 40.0), (340.0, 0.0), EXAMPLE.radars)
COARSE = Form(steps=5, sides=12, slack=None)


def world_at(threshold: float) -> World:
    return World(detection=Detection(threshold=threshold))


@pytest.mark.every(("threshold", "side"), [(0.5, 364.2), (0.6, 348.6), (0.7, 332.9)])
def test_the_side_is_seen_within_the_slant_ranges_of_table_4_2(threshold: float, side: float) -> None:
    # signature 0.5, linear in Table 4.2: 364.2, 348.6, 332.9 km of slant range, 10 km below
    assert limits_of(world_at(threshold)).side == pytest.approx(math.sqrt(side**2 - 100.0), abs=0.1)


def test_beyond_its_limit_nothing_is_seen_and_just_within_it_something_is() -> None:
    world = world_at(0.6)
    limits = limits_of(world)
    side, nose = np.radians(np.linspace(0, 180, 361)), np.radians(np.linspace(0, 30, 61))
    for limit, azimuths, banks in (
        (limits.side, side, (0.0,)),
        (limits.banked_side, side, (-world.aircraft.bank, world.aircraft.bank)),
        (limits.nose, nose, (-world.aircraft.bank, 0.0, world.aircraft.bank)),
    ):

        def worst(distance: float, azimuths=azimuths, banks=banks) -> float:
            at = np.full(len(azimuths), distance)
            return max(probability_seen(world, at, azimuths, b).max() for b in banks)

        assert all(worst(limit + more) <= 0.6 for more in (1e-6, 1.0, 30.0, 200.0))
        assert worst(limit - 0.5) > 0.6


@pytest.mark.every(("threshold", "bound"), [(0.5, 139.05), (0.6, 129.72), (0.7, 125.40)])
def test_the_lower_bound_is_tangent_arc_and_spiral(threshold: float, bound: float) -> None:
    found = lower_bound(EXAMPLE, world_at(threshold))
    assert found == pytest.approx(bound, abs=0.01)
    assert found >= math.dist(EXAMPLE.start, EXAMPLE.goal) - 1e-9


def test_the_lower_bound_between_places_outside_is_the_way_around_the_circle() -> None:
    circle = limits_of(World()).side
    around = lower_bound(Layout((500.0, 0.0), (-500.0, 0.0), ((0.0, 0.0),)), World())
    tangent = math.acos(circle / 500.0)
    assert around == pytest.approx(2 * math.sqrt(500.0**2 - circle**2) + circle * (math.pi - 2 * tangent))
    assert lower_bound(Layout((500.0, 0.0), (500.0, 100.0), ((0.0, 0.0),)), World()) == pytest.approx(100.0)


@pytest.mark.every("threshold", THRESHOLDS)
@pytest.mark.every("legs", [2, 3])
def test_whole_legs_are_undetected_and_near_the_lower_bound(threshold: float, legs: int) -> None:
    plan = leg_plan(EXAMPLE, world_at(threshold), legs=legs)
    assert plan.search.status == "optimal"
    assert plan.search.gap <= 1e-6
    assert plan.verification is not None
    assert plan.verification.undetected
    assert -1e-9 <= plan.excess <= 0.015


def test_what_the_program_certifies_holds_without_the_polish() -> None:
    rough, polished = (leg_plan(EXAMPLE, legs=2, polish=p) for p in (False, True))
    assert rough.verification is not None
    assert rough.verification.undetected
    assert polished.length < rough.length
    # the program's own lengths are a polygon's: shorter by at most 1 - cos(pi / 72)
    assert math.cos(math.pi / 72) * rough.length <= rough.search.objective + 1e-6 <= rough.length + 1e-5


def test_solvers_agree_on_whole_legs() -> None:
    highs, cbc = (leg_plan(EXAMPLE, legs=2, solver=s) for s in SOLVERS)
    assert (highs.search.solver, cbc.search.solver) == ("HiGHS", "CBC")
    assert highs.search.objective == pytest.approx(cbc.search.objective, rel=1e-5)
    assert highs.search.counts == cbc.search.counts


def test_a_turn_may_show_nothing() -> None:
    # without a bank a turn is free, so that the route may follow the circle in several legs
    level = World(aircraft=Aircraft(bank=0.0))
    plan = leg_plan(EXAMPLE, level, legs=3)
    assert plan.verification is not None
    assert plan.verification.undetected
    flown_with_bank = simulate_plan(plan.waypoints, EXAMPLE.radars).verification
    assert plan.length <= leg_plan(EXAMPLE, legs=3).length + 1e-6
    assert flown_with_bank.largest_probability >= plan.verification.largest_probability


def test_the_second_aircraft_flies_the_mirror_image() -> None:
    first, second = leg_plan(EXAMPLE), leg_plan(SECOND_UAV)
    assert second.length == pytest.approx(first.length, abs=1e-3)
    np.testing.assert_allclose(second.waypoints * [-1.0, 1.0], first.waypoints, atol=0.2)


def test_two_aircraft_in_one_program_cost_what_each_costs_alone() -> None:
    # nothing couples them, so the source's program for two says no more than two of its programs
    near, far = (Layout((x, y), (np.sign(x) * 340.0, 0.0), EXAMPLE.radars) for x, y in ((350, 8), (-350, 20)))
    form = replace(COARSE, lookup="sets", steps=3)
    alone = [printed_plan(layout, form=form) for layout in (near, far)]
    assert alone[0].search.objective < alone[1].search.objective
    first, second = joint_printed_plans((near, far), form=form)
    assert first.search is second.search
    assert first.search.status == "optimal"
    assert first.search.objective == sum(plan.search.objective for plan in alone)
    assert first.search.counts.integers == sum(plan.search.counts.integers for plan in alone)
    for plan, layout in ((first, near), (second, far)):
        np.testing.assert_allclose(plan.waypoints[[0, -1]], [layout.start, layout.goal], atol=1e-5)


def test_a_guide_limits_the_modes_to_those_about_it() -> None:
    free = leg_plan(EXAMPLE, legs=2)
    guided = leg_plan(EXAMPLE, guide=lattice_plan(EXAMPLE, spacing=10.0, refinements=1).waypoints)
    assert guided.verification is not None
    assert guided.verification.undetected
    assert guided.search.counts.integers < free.search.counts.integers or len(guided.waypoints) > 3
    assert "about the guiding route" in guided.search.reason
    assert guided.length <= 1.005 * free.length


def test_legs_with_lock_loss_are_shorter_and_survive() -> None:
    certain, pardoned = leg_plan(EXAMPLE), leg_plan(EXAMPLE, lock_loss=True)
    assert pardoned.verification is not None
    assert pardoned.verification.survived
    assert 0 < pardoned.verification.longest_detection < 150.0
    assert pardoned.length < 0.96 * certain.length
    # radars that fire at once leave nothing to use
    killed = leg_plan(EXAMPLE, World(lock_loss=INSTANT_KILL), lock_loss=True)
    assert killed.length == pytest.approx(certain.length, rel=1e-6)


@pytest.mark.nightly
def test_a_turn_far_from_the_radar_may_lead_back_to_its_circle() -> None:
    around = leg_plan(Layout((0.0, 600.0), (340.0, 0.0), EXAMPLE.radars), legs=3, directions=36)
    assert around.verification is not None
    assert around.verification.undetected
    assert around.excess < 0.05


def test_the_heading_before_the_first_leg_counts() -> None:
    # flying on is free; having to turn at the side of the radar is not
    free = leg_plan(EXAMPLE, legs=2, polish=2)
    course = free.waypoints[1] - free.waypoints[0]
    on = leg_plan(EXAMPLE, legs=2, polish=2, heading=math.atan2(course[1], course[0]))
    turning = leg_plan(EXAMPLE, legs=2, heading=0.0)
    assert on.verification is not None
    assert on.verification.undetected
    assert on.length == pytest.approx(free.length, rel=1e-3)
    assert not turning.found or (turning.verification is not None and turning.verification.undetected)
    assert turning.search.status == "infeasible" or turning.length > free.length


@pytest.mark.every("threshold", THRESHOLDS)
def test_the_lattice_finds_an_undetected_route_near_the_lower_bound(threshold: float) -> None:
    plan = lattice_plan(EXAMPLE, world_at(threshold))
    assert plan.verification is not None
    assert plan.verification.undetected
    assert -1e-9 <= plan.excess <= 0.015


def test_the_lattice_uses_lock_loss() -> None:
    plan = lattice_plan(EXAMPLE, spacing=10.0, refinements=1, lock_loss=True)
    assert plan.verification is not None
    assert plan.verification.survived
    assert not plan.verification.undetected
    assert plan.length < lattice_plan(EXAMPLE).lower_bound
    # radars that fire at once leave nothing to use
    killed = lattice_plan(EXAMPLE, World(lock_loss=INSTANT_KILL), lock_loss=True)
    assert killed.length == pytest.approx(lattice_plan(EXAMPLE).length)


def test_three_radars() -> None:
    three = Layout(EXAMPLE.start, EXAMPLE.goal, ((0.0, 0.0), (900.0, 300.0), (300.0, -500.0)))
    for plan in (leg_plan(three, legs=2), lattice_plan(three)):
        assert plan.verification is not None
        assert plan.verification.undetected
        assert plan.length >= plan.lower_bound >= lower_bound(EXAMPLE, World()) - 1e-9


def test_printed_plans_are_invalid_though_proven_optimal() -> None:
    plan = printed_plan(EXAMPLE, form=Form(lookup="sets"))
    assert plan.search.status == "optimal"
    assert plan.search.objective == 550.0  # 11 steps
    assert plan.search.counts.continuous == 72  # the source's count
    assert plan.verification is not None
    assert plan.length < plan.lower_bound  # no undetected path is that short
    assert plan.verification.time_over > 30.0
    assert plan.durations is not None
    assert plan.verification.duration == pytest.approx(550.0)


@pytest.mark.every("solver", SOLVERS)
@pytest.mark.every("lock_loss", [None, 3])
def test_pairs_and_sets_are_the_same_program(solver: programs.Solver, lock_loss: int | None) -> None:
    pairs, sets = (
        printed_plan(SHORT, form=replace(COARSE, lookup=x, lock_loss=lock_loss), solver=solver)
        for x in ("pairs", "sets")
    )
    assert pairs.search.status == sets.search.status == "optimal"
    assert pairs.search.objective == sets.search.objective
    assert pairs.search.counts.integers - sets.search.counts.integers == COARSE.steps * COARSE.sides**2


def test_a_printed_path_keeps_to_its_own_tables() -> None:
    form = replace(COARSE, lookup="sets")
    plan = printed_plan(SHORT, form=form)
    assert plan.verification is not None
    table = safe_distances(World(), form.sides)[0]  # elevations below 10 degrees
    index = 2.0 * math.pi * np.arange(1, form.sides + 1) / form.sides
    corners = np.stack([np.sin(index), np.cos(index)])
    for before, place in zip(plan.waypoints[:-1], plan.waypoints[1:], strict=True):
        step = place - before
        assert np.hypot(*step) <= 0.25 * 50.0 + 1e-6  # (4.11)
        heading, sight = np.argmax(step @ corners), np.argmax(place @ corners)
        near = (
            {(heading + a) % form.sides for a in (-1, 0, 1)},
            {(sight + a) % form.sides for a in (-1, 0, 1)},
        )
        safe = min(table[m, n] for m in near[0] for n in near[1])
        assert np.hypot(*place) >= safe * math.cos(math.pi / form.sides) - 1e-3
    np.testing.assert_allclose(plan.waypoints[-1], SHORT.goal, atol=1e-5)


def test_the_printed_slack_allows_a_heading_to_be_wrong() -> None:
    # 1.01 (x sin + y cos) >= |v| holds up to arccos(1 / 1.01) = 8.07 degrees from the corner, whatever M is
    assert math.degrees(math.acos(1 / 1.01)) == pytest.approx(8.07, abs=0.01)
    with pytest.raises(ModelError, match=r"slack of at least 1\.0353"):
        Form(sides=12)
    Form(sides=12, slack=None)


def test_exactly_three_of_four_forces_one_phase() -> None:
    # (4.33) as printed with "=" demands detections even of a route that needs none
    form = Form(steps=6, sides=12, slack=None, lookup="sets", lock_loss=3)
    free, forced = (printed_plan(SHORT, form=replace(form, detections=d)) for d in ("at_most", "exactly"))
    assert free.search.status == forced.search.status == "optimal"
    assert free.search.objective <= forced.search.objective


def test_the_straight_line_is_shortest_and_detected() -> None:
    plan = straight_plan(EXAMPLE)
    assert plan.verification is not None
    assert not plan.verification.undetected
    assert plan.length == pytest.approx(math.dist(EXAMPLE.start, EXAMPLE.goal))
    assert straight_plan(EXAMPLE, world_at(0.7)).excess == pytest.approx(0.0, abs=1e-6)


@pytest.mark.every("solver", SOLVERS)
def test_too_few_steps_are_proven_infeasible(solver: programs.Solver) -> None:
    plan = printed_plan(SHORT, form=replace(COARSE, steps=2), solver=solver)
    assert plan.search.status == "infeasible"
    assert "2 steps (100 s)" in plan.search.reason
    assert not plan.found
    assert plan.waypoints.shape == (0, 2)
    assert math.isnan(plan.length)


def test_a_goal_at_the_radar_is_refused_in_words() -> None:
    plan = leg_plan(Layout((350.0, 125.0), (50.0, 0.0), EXAMPLE.radars))
    assert plan.search.status == "infeasible"
    assert "the goal is 50.0 km from radar 0" in plan.search.reason


def test_a_goal_inside_the_circle_is_reached_nose_on() -> None:
    plan = leg_plan(Layout((400.0, 50.0), (250.0, 0.0), EXAMPLE.radars), legs=2)
    assert plan.verification is not None
    assert plan.verification.undetected


@pytest.mark.every("solver", SOLVERS)
def test_a_work_limit_ends_in_the_same_way_each_time_and_says_so(solver: programs.Solver) -> None:
    form = Form(sides=12, slack=None, lookup="sets")
    first, second = (printed_plan(EXAMPLE, form=form, solver=solver, work=3) for _ in range(2))
    assert first.search.status in ("no plan", "feasible")
    assert "work limit" in first.search.reason
    assert first.found == (first.search.status == "feasible")
    assert str(replace(first.search, seconds=0.0)) == str(replace(second.search, seconds=0.0))
    np.testing.assert_array_equal(first.waypoints, second.waypoints)


def test_a_lattice_without_a_path_says_so() -> None:
    plan = lattice_plan(EXAMPLE, spacing=60.0, detour=1.01)
    assert plan.search.status == "no plan"
    assert "finer spacing" in plan.search.reason


def test_missing_solvers_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    pulp = programs.modelling()
    monkeypatch.setattr(pulp.HiGHS, "available", lambda self: False)
    assert programs.choose_solver("auto").name == "PULP_CBC_CMD"
    with pytest.raises(programs.MissingSolverError, match="no highs"):
        programs.choose_solver("highs")
    monkeypatch.setattr(pulp.PULP_CBC_CMD, "available", lambda self: False)
    with pytest.raises(programs.MissingSolverError, match=r"neither.*fieldgym\[planning\]"):
        leg_plan(EXAMPLE)


def test_missing_pulp_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(programs.importlib, "import_module", fail)
    with pytest.raises(programs.MissingSolverError, match=r"PuLP.*fieldgym\[planning\]"):
        printed_plan(EXAMPLE)


@pytest.mark.every(
    ("call", "match"),
    [
        (lambda: leg_plan(EXAMPLE, legs=0), "at least 1 leg"),
        (lambda: leg_plan(EXAMPLE, solver="cplex"), "highs"),  # type: ignore[arg-type]
        (lambda: leg_plan(EXAMPLE, work=0), "work limit"),
        (lambda: lattice_plan(EXAMPLE, spacing=0.0), "spacing"),
        (lambda: lattice_plan(EXAMPLE, spacing=0.1), "too large"),
        (lambda: Form(steps=3, lock_loss=4), "2 to 3"),
    ],
)
def test_impossible_numbers_are_refused(call, match: str) -> None:
    with pytest.raises(ModelError, match=match):
        call()
