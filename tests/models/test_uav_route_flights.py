"""Simulated plans and flights leg by leg: geometry, verification, equality to the bit, random layouts."""

import math
from dataclasses import replace

import numpy as np
import pytest

from fieldmodels.machines.uav_route.batch import Flights, Rules, observed_names
from fieldmodels.machines.uav_route.declaration import nominal_plant
from fieldmodels.machines.uav_route.detection import probability_of_detection
from fieldmodels.machines.uav_route.layouts import random_layout, safe_route
from fieldmodels.machines.uav_route.model import UavRoute
from fieldmodels.machines.uav_route.parameters import (
    EXAMPLE,
    INSTANT_KILL,
    PRINTED,
    Aircraft,
    Detection,
    Layout,
    LockLoss,
    Reading,
    World,
)
from fieldmodels.machines.uav_route.plan_simulation import simulate_plan
from fieldmodels.machines.uav_route.state import NUMBERS
from fieldmodels.model import ModelError

ORIGIN = [(0.0, 0.0)]


def make(batch, rules=None, plant=None, seed=0):
    flights = Flights(batch, rules, plant)
    for i in range(batch):
        flights.seed(i, np.random.default_rng([seed, i]))
    flights.restart(range(batch))
    return flights


def random_actions(rng, batch):
    return np.column_stack([rng.uniform(-math.pi, math.pi, batch), rng.uniform(0, 60, batch)])


def plant_with(effect, parameter, value):
    plant = nominal_plant(0.25)
    plant[effect][parameter] = value
    return plant


def number(leg, name):
    return leg.numbers[NUMBERS.index(name)]


# simulated plans


def test_passing_a_radar_side_on_is_detected_along_a_chord_of_its_circle():
    verification = simulate_plan([(300, -600), (300, 600)], ORIGIN).verification
    chord = 2 * math.sqrt(364.2**2 - 10**2 - 300**2)
    assert verification.time_over == pytest.approx(chord / 0.25, abs=0.2)
    assert verification.longest_detection == pytest.approx(verification.time_over)
    assert verification.path_length == 1200
    assert verification.duration == pytest.approx(4800)
    assert verification.damaged_at == pytest.approx((1200 - chord) / 2 / 0.25 + 200, abs=0.2)
    assert not verification.undetected
    assert not verification.survived


def test_flying_at_a_radar_nose_first_is_safe_but_for_the_last_kilometres():
    assert simulate_plan([(600, 0), (60, 0)], ORIGIN).verification.undetected
    assert not simulate_plan([(600, 0), (20, 0)], ORIGIN).verification.undetected


def test_safe_route_of_the_example_is_safe_and_the_straight_line_is_not():
    safe = simulate_plan(safe_route(EXAMPLE), EXAMPLE.radars).verification
    assert safe.undetected
    assert safe.largest_probability < 0.5
    straight = simulate_plan([EXAMPLE.start, EXAMPLE.goal], EXAMPLE.radars).verification
    assert straight.path_length == pytest.approx(math.hypot(10, 125))
    assert straight.largest_probability == pytest.approx(0.654, abs=0.001)
    assert not straight.undetected


def test_bank_is_held_for_the_turn_time_and_only_then():
    flown = simulate_plan([(600, 0), (620, 0), (620, 60)], ORIGIN, step=0.5)
    turning = flown.interval[flown.bank > 0].sum()
    assert turning == pytest.approx(math.pi / 2 * 0.25 / 9.80665e-3, rel=1e-9)
    assert (flown.bank[flown.time < 80] == 0).all()
    assert flown.bank.max() == pytest.approx(math.pi / 4)  # eastwards from north: to the right
    level = simulate_plan([(600, 0), (620, 0), (620, 60)], ORIGIN, World(aircraft=Aircraft(bank=0.0)))
    assert not level.bank.any()


def test_verification_hardly_depends_on_its_step():
    plan = [(350, 125), (365, 60), (340, 0)]
    coarse, fine = (simulate_plan(plan, ORIGIN, step=step).verification for step in (1.0, 0.02))
    assert coarse.time_over == pytest.approx(fine.time_over, abs=3.0)
    assert coarse.largest_probability == pytest.approx(fine.largest_probability, abs=1e-3)


def test_durations_set_the_speed_and_hovering_keeps_the_heading():
    plan = [(300, 0), (300, 25), (300, 25), (300, 50)]
    flown = simulate_plan(plan, ORIGIN, durations=[50, 50, 100])
    assert flown.verification.duration == 200
    assert flown.verification.path_length == 50
    hovering = (flown.time > 50) & (flown.time < 100)
    np.testing.assert_allclose(flown.position[hovering], np.broadcast_to([300, 25], (hovering.sum(), 2)))
    np.testing.assert_allclose(flown.heading, math.pi / 2)


def test_initial_heading_makes_the_first_leg_a_turn():
    plan = [(400, 0), (400, 60)]
    assert not simulate_plan(plan, ORIGIN).bank.any()
    assert simulate_plan(plan, ORIGIN, heading=0.0).bank.any()


def test_without_radars_nothing_is_seen():
    verification = simulate_plan([(0, 0), (10, 0)], []).verification
    assert verification.undetected
    assert verification.largest_probability == 0.0


def test_bank_in_left_handed_axes_tilts_the_wrong_way():
    """Turning away from a radar abeam shows the belly: 46.5 deg, not 43.5 deg, or the other way round."""
    turn = [(360, -30), (371.7, 0), (371.7, 30)]
    peak = {}
    for axes in ("right_handed", "left_handed"):
        flown = simulate_plan(turn, ORIGIN, World(reading=Reading(axes=axes)))
        i = np.flatnonzero(flown.bank)[0]
        peak[axes] = math.degrees(abs(flown.elevation[i, 0]))
    assert peak["right_handed"] != pytest.approx(peak["left_handed"], abs=2.0)
    assert sum(peak.values()) == pytest.approx(90, abs=0.2)


def test_printed_heading_certifies_what_is_detected():
    """A side-on leg inside the circle passes if the aircraft shows its next heading, at the radar."""
    plan = [(350, 125), (345, 0), (330, 0)]
    assert simulate_plan(plan, ORIGIN).verification.time_over > 400
    for reading in (Reading(heading="next_leg"), PRINTED):
        assert simulate_plan(plan, ORIGIN, World(reading=reading)).verification.time_over < 60


@pytest.mark.every(
    ("arguments", "words"),
    [
        (([(0, 0)], ORIGIN), "start and a goal"),
        (([(0, 0), (1, math.nan)], ORIGIN), "finite"),
        (([(0, 0), (1, 1)], [(0, 0, 0)]), "radars"),
        (("nowhere", ORIGIN), "waypoints"),
    ],
)
def test_impossible_plans_are_refused(arguments, words):
    with pytest.raises(ModelError, match=words):
        simulate_plan(*arguments)
    with pytest.raises(ModelError, match="durations"):
        simulate_plan([(0, 0), (1, 1)], ORIGIN, durations=[1, 2])
    with pytest.raises(ModelError, match="no time"):
        simulate_plan([(0, 0), (1, 1)], ORIGIN, durations=[0])


# flights


@pytest.mark.every("radars", [1, 4])
def test_flights_agree_with_the_plan_simulated(radars):
    """The same legs, once in a batch of flights, once as a plan: time, detection, timers, hit."""
    world = World(lock_loss=LockLoss(30.0, 60.0, 40.0))
    rules = Rules(world=world, radars=radars, step=0.2)
    for seed in range(6):
        flights, rng, plan = make(1, rules, seed=seed), np.random.default_rng(seed), []
        plan.append(flights.flights["place"][0].copy())
        for _ in range(12):
            leg = flights.advance(random_actions(rng, 1))
            plan.append(flights.flights["place"][0].copy())
            if leg.over[0]:
                break
        verification = simulate_plan(plan, flights.layout(0).radars, world, step=0.05).verification
        assert number(leg, "time")[0] == pytest.approx(verification.duration)
        assert number(leg, "path_length")[0] == pytest.approx(verification.path_length)
        assert number(leg, "time_over")[0] == pytest.approx(verification.time_over, abs=1.5)
        assert number(leg, "longest_detection")[0] == pytest.approx(verification.longest_detection, abs=1.0)
        if leg.over[0] == 2:
            assert verification.damaged_at == pytest.approx(verification.duration, abs=1.5)
        else:
            assert verification.survived


@pytest.mark.every("detection", ["deterministic", "stochastic"])
def test_a_batch_equals_flights_one_by_one_to_the_bit(detection):
    rules = Rules(World(detection=Detection(detection=detection)), radars=2)
    together = make(5, rules)
    alone = [Flights(1, rules) for _ in range(5)]
    for i, one in enumerate(alone):
        one.seed(0, np.random.default_rng([0, i]))
        one.restart([0])
    rng = np.random.default_rng(1)
    for _ in range(25):
        actions = random_actions(rng, 5)
        leg = together.advance(actions, restarting=True)
        for i, one in enumerate(alone):
            single = one.advance(actions[i : i + 1], restarting=True)
            assert single.reward[0] == leg.reward[i]
            assert (single.observed[0] == leg.observed[i]).all()
            assert (single.numbers[:, 0] == leg.numbers[:, i]).all()
    assert leg.observed.shape == (5, len(observed_names(2)))


@pytest.mark.every("engaged", ["accumulated", "unbroken", "elapsed"])
@pytest.mark.every("lock_loss", [{}, {"engage": 20.0}, {"lose": 5.0, "target": 0.0}, None])
@pytest.mark.every("threshold", [0.01, 0.1, 0.5])
def test_a_flight_past_radars_equals_one_scanned_step_by_step_to_the_bit(engaged, lock_loss, threshold):
    """A wind that moves nothing, not even the last bit, makes the kernel ask each radar at each step."""
    loss = INSTANT_KILL if lock_loss is None else LockLoss(engaged=engaged, **lock_loss)
    rules = Rules(World(detection=Detection(threshold=threshold), lock_loss=loss), radars=3)
    breath = nominal_plant(0.25)
    breath["wind"]["north"] = 1e-300
    quick, stepped = make(30, rules), make(30, rules, breath)
    rng, over = np.random.default_rng(5), np.zeros(30)
    for k in range(30):
        legs = random_actions(rng, 30) * [1.0, 8.0 if k % 2 else 100.0]  # some of more steps than fit at once
        one, other = (flights.advance(legs, restarting=True) for flights in (quick, stepped))
        assert (one.observed == other.observed).all()
        assert (one.numbers == other.numbers).all()
        over = np.maximum(over, number(one, "time_over"))
    assert quick.state().tobytes() == stepped.state().tobytes()
    assert (over > 0.0).any()


def test_state_returns_exactly():
    flights, rng = (
        make(4, Rules(World(detection=Detection(detection="stochastic")))),
        np.random.default_rng(2),
    )
    for _ in range(3):
        flights.advance(random_actions(rng, 4), restarting=True)
    state, actions = flights.state(), random_actions(rng, 4)
    first = flights.advance(actions)
    flights.set_state(state)
    again = flights.advance(actions)
    assert (first.observed == again.observed).all()
    assert (first.numbers == again.numbers).all()
    with pytest.raises(ModelError, match="snapshot"):
        flights.set_state(state[:2])


def test_observation_does_not_depend_on_where_north_is():
    """All is seen in the frame of the nearest radar's bearing: a turned map looks the same."""
    angle = 1.1
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    turned = replace(EXAMPLE, start=tuple(turn @ EXAMPLE.start), goal=tuple(turn @ EXAMPLE.goal))
    one, other = (make(1, Rules(layout=layout)) for layout in (EXAMPLE, turned))
    rng = np.random.default_rng(3)
    for _ in range(5):
        actions = random_actions(rng, 1)
        np.testing.assert_allclose(one.advance(actions).observed, other.advance(actions).observed, atol=1e-5)


def test_safe_route_arrives_and_scores():
    rewards = {"progress": "straight", "progress_reward": 0.01, "length_cost": 0.01, "arrival_reward": 1.0}
    flights = make(1, Rules(layout=EXAMPLE, longest_leg=500.0, **rewards))
    route, total = safe_route(EXAMPLE), 0.0
    for waypoint in route[1:]:
        leg = flights.fly_to([waypoint])
        total += leg.reward[0]
    assert leg.over[0] == 1
    assert number(leg, "remaining")[0] == pytest.approx(5.0)
    path = number(leg, "path_length")[0]
    assert path + 5.0 == pytest.approx(np.hypot(*np.diff(route, axis=0).T).sum())
    assert total == pytest.approx(1.0 - 0.01 * path + 0.01 * (math.hypot(10, 125) - 5.0))


def test_a_flight_that_is_over_stays_until_it_restarts():
    flights = make(1, Rules(layout=EXAMPLE, max_legs=2))
    for _ in range(2):
        leg = flights.advance([[math.pi / 2, 5.0]])
    assert leg.over[0] == 3
    # Late, after a leg of 5 km that brings the goal nearer by no more than its length.
    assert leg.reward[0] <= -1.0 - 0.02 * 5.0 + 0.04 * 5.0
    still = flights.advance([[0.0, 50.0]])
    assert still.reward[0] == 0.0
    assert (still.places == leg.places).all()
    fresh = flights.advance([[0.0, 50.0]], restarting=True)
    assert fresh.over[0] == 0
    assert (fresh.places[0] == EXAMPLE.start).all()


def test_instant_kill_ends_a_detected_flight():
    world = World(lock_loss=INSTANT_KILL)
    flights = make(1, Rules(world, layout=EXAMPLE, longest_leg=200.0))
    leg = flights.fly_to([EXAMPLE.goal])
    assert leg.over[0] == 2
    assert number(leg, "damaged")[0] == 1
    assert number(leg, "time_over")[0] <= 5.0


def test_drawn_scans_detect_as_often_as_they_should():
    """A lone scan of 4000 flights: the share of detections within 5 standard errors, in both readings."""
    layout = replace(EXAMPLE, start=(355.0, 0.0), goal=(355.0, 300.0))
    for draw in ("below", "above"):
        world = World(
            detection=Detection(detection="stochastic", scan_interval=1e4), reading=Reading(draw=draw)
        )
        flights = make(4000, Rules(world, layout=layout))
        flights.fly_to(np.broadcast_to([355.0, 20.0], (4000, 2)))
        chance = flights.flights["probability"][0, 0]
        share = flights.flights["detected"][:, 0].mean()
        assert 0.5 < chance < 0.6
        expected = chance if draw == "below" else 1 - chance
        assert share == pytest.approx(expected, abs=5 * math.sqrt(0.25 / 4000))


def test_luck_does_not_depend_on_how_the_way_is_cut_into_legs():
    """Numbers are drawn by time: one line, flown in two legs or in five, meets the same detections."""
    world = World(detection=Detection(detection="stochastic"), lock_loss=LockLoss(1e9, 1e9, 1e9))
    layout = replace(EXAMPLE, start=(350.0, 0.0), goal=(350.0, 300.0))
    seen = []
    for stops in ((10.0, 50.0), (7.0, 13.0, 22.5, 41.0, 50.0)):
        flights = make(20, Rules(world, layout=layout))
        for east in stops:
            flights.fly_to(np.broadcast_to([350.0, east], (20, 2)))
        seen.append(flights.flights[["time_over", "unbroken", "scans"]])
    for name in ("time_over", "unbroken", "scans"):
        np.testing.assert_allclose(seen[0][name], seen[1][name], atol=1e-6)
    assert len(np.unique(np.round(seen[0]["time_over"], 3))) > 5


def test_episodes_are_told_by_seed_and_number_alone():
    one, other = make(2, seed=5), make(2, seed=5)
    one.advance(random_actions(np.random.default_rng(0), 2))
    one.restart([0, 1])
    other.restart([0, 1])
    assert one.layout(0) == other.layout(0)
    assert one.layout(0) != one.layout(1)


# layouts


@pytest.mark.every("radars", [1, 2, 3, 4])
def test_each_drawn_layout_has_a_safe_route(radars):
    for seed in range(60):
        layout = random_layout(np.random.default_rng(seed), radars)
        assert len(layout.radars) == radars
        verification = simulate_plan(safe_route(layout), layout.radars, step=1.0).verification
        assert verification.undetected
        start, goal = math.hypot(*layout.start), math.hypot(*layout.goal)
        assert 367 < start < 470
        assert 251 < goal < 363


def test_layouts_follow_the_threshold_and_the_interpolation():
    for detection in (Detection(threshold=0.7), Detection(interpolation="log")):
        layout = random_layout(np.random.default_rng(1), 3, detection)
        world = World(detection=detection)
        assert simulate_plan(
            safe_route(layout, detection), layout.radars, world, step=1.0
        ).verification.undetected


def test_no_safe_route_through_a_radar():
    with pytest.raises(ModelError, match="too near or behind"):
        safe_route(replace(EXAMPLE, goal=(-340.0, 0.0)))


# realities


def test_wind_and_losses_change_times_not_the_way():
    model = UavRoute()
    still = make(1, Rules(layout=EXAMPLE))
    reality = model.vector(effects={"wind": {"north": 20.0, "east": 10.0}, "turn_speed_loss": {"share": 0.2}})
    windy = make(1, Rules(layout=EXAMPLE), model.plant(reality))
    for actions in ([[1.5, 20.0]], [[-1.5, 20.0]]):
        calm, blown = still.advance(actions), windy.advance(actions)
    np.testing.assert_allclose(calm.places, blown.places)
    assert number(blown, "time")[0] != pytest.approx(number(calm, "time")[0], rel=0.01)


def test_biased_position_shifts_what_is_seen():
    plant = UavRoute().plant(UavRoute().vector(effects={"sensor_bias": {"north": 3000.0, "east": 0.0}}))
    seen = make(1, Rules(layout=EXAMPLE), plant).observe()
    np.testing.assert_allclose(seen.places, [[353.0, 125.0]])


@pytest.mark.every(
    ("effect", "values", "shown", "slant"),
    [
        ("signature_scale", {"factor": 1.6}, 0.8, 400.0),
        ("radar_range_scale", {"factor": 0.95}, 0.5, 400.0 / 0.95),
        ("radar_position", {"north": 20e3, "east": 0.0}, 0.5, 380.0),
    ],
)
def test_what_a_radar_truly_sees_changes_detection_but_not_what_is_shown(effect, values, shown, slant):
    """Level and side-on, 400 km from where the radar is believed to be: the tables with the effect."""
    rules = Rules(layout=Layout((400.0, 0.0), (0.0, 300.0), ((0.0, 0.0),)))
    plant = UavRoute().plant(UavRoute().vector(effects={effect: values}))
    nominal, real = make(1, rules).fly_to([[400.0, 2.5]]), make(1, rules, plant).fly_to([[400.0, 2.5]])
    expected = probability_of_detection(shown, math.hypot(slant, 10.0 * slant / 400.0))
    assert number(real, "largest_probability")[0] == pytest.approx(float(expected), abs=2e-3)
    assert number(nominal, "largest_probability")[0] != pytest.approx(float(expected), abs=0.02)
    margins = [i for i, name in enumerate(observed_names(1)) if "margin" in name or "bearing" in name]
    np.testing.assert_array_equal(real.observed[:, margins], nominal.observed[:, margins])


def test_a_wider_nose_cone_hides_what_would_be_seen_beside_it():
    """34 degrees off the radar's bearing: in the cone once it is 1.2 times as wide (36 degrees)."""
    rules = Rules(layout=Layout((300.0, 0.0), (0.0, 300.0), ((0.0, 0.0),)))
    plant = UavRoute().plant(UavRoute().vector(effects={"nose_cone_width": {"factor": 1.2}}))
    towards = [[300.0 - 3 * math.cos(math.radians(34)), 3 * math.sin(math.radians(34))]]
    assert number(make(1, rules).fly_to(towards), "largest_probability")[0] > 0.9
    assert number(make(1, rules, plant).fly_to(towards), "largest_probability")[0] == 0.01


def test_a_longer_scan_interval_makes_fewer_scans():
    rules = Rules(World(detection=Detection(detection="stochastic")), layout=EXAMPLE, longest_leg=50.0)
    plant = UavRoute().plant(UavRoute().vector(effects={"scan_interval": {"factor": 2.0}}))
    flights = [make(1, rules), make(1, rules, plant)]
    for one in flights:
        one.fly_to([[600.0, 400.0]])
    assert [int(one.flights[0]["scans"]) for one in flights] == [40, 20]  # 50 km at 0.25 km/s


@pytest.mark.every(
    ("make_it", "words"),
    [
        (lambda: Flights(0), "at least one"),
        (lambda: Flights(2, plant=np.ones(17)), "UavRoute.plant"),
        (lambda: Flights(2, plant=nominal_plant(0.25).reshape(1)), "shape"),
        (lambda: Flights(2, plant=plant_with("wind", "north", 0.3)), "wind"),
        (lambda: Flights(2, plant=plant_with("scan_interval", "factor", 0.0)), "factors"),
        (lambda: Flights(1).observe(), "seed and restart"),
        (lambda: Flights(1).restart([0]), "seed"),
        (lambda: make(1).advance([0.0, 1.0]), "shape"),
        (lambda: make(1).advance([[math.nan, 1.0]]), "finite"),
        (lambda: Rules(radars=5), "radars must be at least 1, at most 4"),
        (lambda: Rules(least_leg=600.0), "legs"),
        (lambda: Rules(max_legs=0), "max_legs"),
        (lambda: Rules(layout=replace(EXAMPLE, goal=EXAMPLE.start)), "capture radius"),
        (lambda: Rules(World(reading=PRINTED)), "next leg"),
        (lambda: random_layout(np.random.default_rng(0), 0), "1 to 4"),
    ],
)
def test_impossible_flights_are_refused(make_it, words):
    with pytest.raises(ModelError, match=words):
        make_it()
