"""The field set: its plants are the declared machines, its cases are told apart, and each has an answer."""

from __future__ import annotations

import json
import math
from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from exam.field.answers import ANSWERS, right
from exam.field.cases import KEPT, LEAST, SETS, FieldCase, field_cases, make
from exam.field.faults import dead_zone, drag, lag, offset, play, push, vary
from exam.field.kinds import KINDS, RIG_DRY
from exam.field.machines import model_of
from exam.field.plants import NOTHING, PLANTS, Fault, Numbers, numbers_of, simulate
from exam.field.records import Form, timer
from exam.field.runs import Run, Way
from fieldmodels.recording import Recording, Windows

CASES = [case for which in SETS for case in field_cases(which)]


@pytest.mark.every("machine", PLANTS)
def test_a_plant_without_fault_is_the_machine_that_is_declared(machine: str):
    plant, model, rng = PLANTS[machine], model_of(machine), np.random.default_rng(7)
    p, rows, finer = numbers_of(plant, rng), 200, plant.finer
    aims = Form(rows=rows).aims(plant, rng)
    start = np.array(plant.start)[:, None]
    quiet = np.zeros((rows, len(plant.outputs), 1))
    log = simulate(plant, p, aims, NOTHING, np.ones(1), start, quiet, control=plant.control)
    signals = {name: log.commands[:, i, 0] for i, name in enumerate(plant.inputs)}
    signals |= {name: log.shown[:-1:finer, o, 0] for o, name in enumerate(plant.outputs)}
    record = Recording(np.arange(rows) * plant.step, signals)
    first = np.array([[plant.start[plant.states.index(s.name)] for s in model.states]])
    observed = np.ones((1, rows, len(model.outputs)), dtype=np.bool_)
    vector = model.nominal.copy()
    for name in plant.numbers:
        vector[model.names.index(name)] = getattr(p, name)
    windows = Windows(record, np.array([0]), np.array([rows]), first, observed)
    simulated = model.simulate(vector[None], windows)[0, 0]
    for o, output in enumerate(model.outputs):
        if output.name in signals:
            shown = signals[output.name]
            np.testing.assert_allclose(simulated[:, o], shown, atol=2e-5 * np.ptp(shown), err_msg=output.name)


def test_there_are_enough_cases_of_each_kind_and_half_of_them_are_of_the_usual_size():
    of_kind = defaultdict(list)
    for case in CASES:
        of_kind[case.kind].append(case.size)
    assert len({case.key for case in CASES}) == len(CASES)
    assert len({machine for machine in PLANTS if any(c.machine == machine for c in CASES)}) == 12
    for kind, sizes in of_kind.items():
        assert len(sizes) >= LEAST, kind
        assert "usual" not in sizes or sizes.count("usual") == sizes.count("large"), kind
    assert sum(case.size == "none" for case in CASES if case.kind.startswith("nothing")) >= 40


def test_a_kind_is_in_one_set_and_the_sets_are_about_as_large():
    kinds = [{case.kind for case in field_cases(which)} for which in SETS]
    assert not kinds[0] & kinds[1]
    assert kinds[0] | kinds[1] == set(KINDS)
    assert 0.4 < len(field_cases("develop")) / len(CASES) < 0.6
    assert all(any(kind.startswith("nothing") for kind in one) for one in kinds)


def test_fresh_cases_are_other_cases_of_the_same_kinds():
    again = [case for which in SETS for case in field_cases(which, fresh=3)]
    assert Counter(c.kind for c in again) == Counter(c.kind for c in CASES)
    assert not {c.key for c in again} & {c.key for c in CASES}


def test_sizes_are_those_of_the_cases():
    kept = json.loads(KEPT.read_text())
    assert set(kept) == {case.key for case in CASES if case.size != "none"}
    assert all(size > 0.0 and louder > 0.0 for size, louder in kept.values())
    for case in CASES:
        if case.size == "usual":
            large = kept[FieldCase(case.kind, case.machine, case.seed, "large").key]
            assert kept[case.key][0] / kept[case.key][1] < large[0] / large[1]


def test_every_case_has_an_answer_and_few_are_left_unexplained_or_refused():
    said = {case: right(case) for case in CASES}
    for case, one in said.items():
        hides = case.size != "none" or one.refusal
        assert bool(one.names or one.curves or one.unexplained or one.refusal) or not hides, case.key
    assert sum(one.unexplained or bool(one.refusal) for one in said.values()) <= 0.15 * len(said)
    assert set(ANSWERS) == set(KINDS)


def test_what_is_hidden_and_listed_is_the_first_answer():
    for case in CASES:
        hidden = {name.split("__")[0] for name in case.way.fault.truth}
        names = right(case).names
        listed = {effect.name for effect in model_of(case.machine).effects}
        assert set().union(*names) <= listed, case.key
        if hidden and hidden <= listed:
            assert names[0] == hidden, case.key


def test_a_curve_that_is_right_is_one_of_a_state_a_number_or_a_signal_that_there_is():
    for case in CASES:
        plant, model = case.way.plant, model_of(case.machine)
        speeds = [push.name.removeprefix("rate of ").removeprefix("force on ") for push in model.pushes]
        places = {
            "force": {*plant.states, *speeds}, "parameter": {p.name for p in model.parameters},
            "sensor": set(plant.outputs), "actuator": set(plant.inputs),
        }  # fmt: skip
        for curve in right(case).curves:
            where, variable = curve.split(" over ")
            place, target = where.split(" ", 1)
            assert target in places[place], curve
            for factor in variable.removeprefix("memory of ").split("*"):
                assert factor.removeprefix("rate of ") in {*plant.states, *plant.inputs, "time"}, curve


MADE = FieldCase("ring_down", "rig", 0, "usual"), FieldCase("one_step_a_file", "rig", 0, "large")


@pytest.mark.every("case", MADE)
def test_a_case_is_the_same_again_and_its_records_are_three(case: FieldCase):
    one, again = make(case), make(case)
    for a, b in zip((*one.train, *one.third), (*again.train, *again.third), strict=True):
        assert all(np.array_equal(a[name], b[name]) for name in a.signals)
    assert (one.possible, one.nats, one.truth) == (again.possible, again.nats, again.truth)
    first = case.way.plant.outputs[0]
    assert not np.array_equal(one.train[0][first], one.third[0][first])
    assert len(one.train) == len(one.third) == case.way.form.files
    assert all(len(record) == case.way.form.rows for record in one.train)
    assert one.nats > 10.0
    for name, error in one.possible.items():
        expected = case.way.plant.noise[case.way.plant.outputs.index(name)]
        assert error == pytest.approx(expected, rel=0.1)
    assert 0.0 < one.truth["coulomb_friction.force"] < 4.0


def test_what_a_fault_adds_is_what_the_case_asks_for():
    case = FieldCase("listed_single", "quadrotor", 0, "usual")
    size = json.loads(KEPT.read_text())[case.key][0]
    run = Run(case.way, case.kind, case.seed)
    left = float(np.max(run.left(run.log(2, [size])[0])))
    assert math.sqrt(1.0 + left**2) - 1.0 == pytest.approx(case.wanted, rel=0.1)
    assert np.max(run.left(run.log(2, [1.0], NOTHING)[0])) < 1e-3


def test_a_refit_absorbs_another_mass_and_no_friction():
    run = Run(Way("rig", vary("mass", lambda k, t, x, u, p: 1.0 + 0.1 * k)), "another_mass", 0)
    log, _ = run.log(2, [1.0])
    assert run.shown(log) > 1e4
    assert np.max(run.left(log)) < 0.01
    assert np.max(run.left(run.log(2, [1.0], RIG_DRY)[0])) > 0.5


def test_a_timer_reads_at_the_first_tick_after_a_row():
    times = np.arange(40) * 0.02
    read = timer(times, 0.02)
    np.testing.assert_allclose(read / 0.015, np.round(read / 0.015))
    assert (read - times >= -1e-12).all()
    assert (read - times < 0.015).all()
    assert len(np.unique(np.round(read - times, 6))) == 3


def test_friction_takes_from_a_ring_down_what_it_does_on_its_way():
    """What is lost by Coulomb friction is its force times the way; nothing else takes any."""
    plant = PLANTS["rig"]
    p = numbers_of(plant, np.random.default_rng(1))
    p.damping = 0.0
    aims, start = np.zeros((200, 1, 1)), np.array([[0.12], [0.0]])
    log = simulate(plant, p, aims, RIG_DRY, np.array([6.0]), start, np.zeros((200, 2, 1)), finer=40)
    x, v = log.states[:, 0, 0], log.states[:, 1, 0]
    energy = 0.5 * p.mass * v**2 + 0.5 * p.stiffness * x**2
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(x)))])
    np.testing.assert_allclose(energy[0] - energy, 1.2 * way, atol=2e-3 * energy[0])
    assert abs(v[-1]) < 1e-6
    assert abs(p.stiffness * x[-1]) <= 1.2 * 1.001


def test_a_plant_settles_where_algebra_says():
    plant = PLANTS["tanks"]
    p = numbers_of(plant, np.random.default_rng(2))
    aims = np.full((900, 1, 1), 0.7)
    log = simulate(plant, p, aims, NOTHING, np.ones(1), np.array([[0.1], [0.1]]), np.zeros((900, 2, 1)))
    for level, outlet in zip(log.states[-1, :, 0], (p.upper_outlet, p.lower_outlet), strict=True):
        assert level == pytest.approx((p.flow * 0.7 / outlet) ** 2 / (2.0 * 9.81), rel=1e-4)


def test_a_plant_agrees_with_an_adaptive_integrator():
    """A cylinder with drag and a lag, driven by one step."""
    plant, size = PLANTS["cylinder"], 2.0
    p = numbers_of(plant, np.random.default_rng(3))
    fault = drag(1, 60.0, "mass") + lag(0.02)
    aims = np.full((120, 1, 1), 0.5)
    aims[0] = 0.0
    log = simulate(plant, p, aims, fault, np.array([size]), np.zeros((3, 1)), np.zeros((120, 2, 1)))

    def rates(t, x):
        u = 0.5 * -math.expm1(-(t - 0.005) / 0.04) if t > 0.005 else 0.0
        push = 100.0 * x[2] - p.damping * x[1] - p.spring * x[0] - size * 60.0 * x[1] * abs(x[1])
        return x[1], push / p.mass, p.rise * u * (1.0 - x[2] / 6.0) - p.squeeze * x[1]

    true = solve_ivp(
        rates, (0.0, log.time[-1]), np.zeros(3), t_eval=log.time, rtol=1e-9, atol=1e-11, max_step=1e-3
    )
    for state in range(3):
        np.testing.assert_allclose(log.states[:, state, 0], true.y[state], atol=1e-3 * np.ptp(true.y[state]))


def evidence(case: FieldCase, other: Fault, off: Mapping[int, float]) -> float:
    """Half the squared difference of all samples to fit of a case's fault and another one [nats].

    Args:
        case: The case.
        other: The other fault.
        off: By how much it starts from elsewhere, at a size of one: a start is fitted.
    """
    size, louder = json.loads(KEPT.read_text())[case.key]
    start = np.array(case.way.plant.start)
    for state, by in off.items():
        start[state] += by * size
    form = replace(case.way.form, start=lambda rng, plant, p: start)
    one, _ = Run(case.way, case.kind, case.seed).log(0, [size])
    two, _ = Run(replace(case.way, form=form), case.kind, case.seed).log(0, [size], other)
    rows = slice(None, -1, (len(one.time) - 1) // len(one.commands))
    noise = louder * case.way.form.deviations(case.way.plant)[:, None]
    return 0.5 * float(np.sum(((one.shown - two.shown)[rows] / noise) ** 2))


def numbers(case: FieldCase) -> Numbers:
    return Run(case.way, case.kind, case.seed).numbers


def leaking(k, t, x, u, p):
    """What a level's sensor with a bias makes of the outflow."""
    outlet = p.lower_outlet * math.sqrt(2.0 * 9.81) / p.area
    return outlet * (np.sqrt(x[1]) - np.sqrt(np.maximum(x[1] - 2e-3 * k, 0.0)))


def equivalents() -> list[tuple[FieldCase, Fault, dict[int, float]]]:
    """Cases, and faults that the file of answers holds to be the same in them."""
    car, motor = (FieldCase("constant_speed_one_way", name, 0, "usual") for name in ("car", "motor"))
    plate, tanks = (FieldCase("staircase", name, 0, "usual") for name in ("plate", "tanks"))
    force, p = 0.08, numbers(car)  # of CAR_DRY
    return [
        (car, push(3, lambda k, t, x, u, p: -force * k), {}),
        (car, offset(-force / p.push, "throttle_"), {}),
        (car, dead_zone(force / p.push, "throttle_"), {}),
        (motor, push(1, lambda k, t, x, u, p: -0.004 * k / p.inertia), {}),
        (plate, offset(0.3 * numbers(plate).loss / numbers(plate).power), {0: 0.3}),
        (tanks, push(1, leaking), {1: 2e-3}),
        (FieldCase("dead_band", "valve", 0, "usual"), play(0.02), {}),
    ]


@pytest.mark.every(("case", "other", "off"), equivalents())
def test_an_equivalent_is_one_within_two_nats(case: FieldCase, other: Fault, off: dict[int, float]):
    assert evidence(case, other, off) < 2.0
