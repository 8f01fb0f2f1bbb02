"""What is simulated elsewhere and fed in without noise, rounded or printed: nothing false may be named.

The benches below are integrated by SciPy's DOP853 to a relative 1e-12, and share no code with the models.
"""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from exam.benches import Conditions, get_bench
from exam.sizes import recordings
from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.candidates import simpler
from fieldmodels.diagnosis.coordinates import Coordinates
from fieldmodels.diagnosis.cutting import main_horizon
from fieldmodels.diagnosis.gain import Prediction, noise_floor
from fieldmodels.diagnosis.inputs import decided
from fieldmodels.diagnosis.problem import build
from fieldmodels.diagnosis.resolution import of_averages, rounding
from fieldmodels.diagnosis.whitening import _from_covariance, diagonal_whitener, whitener_by_output
from fieldmodels.model import Parameter
from fieldmodels.recording import Recording
from fieldmodels.registry import get_model

STEP, DURATION = 0.01, 10.0
SENSORS = {"rig": (2e-4, 5e-3), "pendulum": (2e-3, 5e-2)}
COULOMB = {"rig": 0.3, "pendulum": 0.05}
COLUMNS = {"rig": ("force", "position", "velocity"), "pendulum": ("torque", "angle", "velocity")}
FORMS = [(factor, "") for factor in (0, 1e-6, 1e-5, 1e-3, 1e-2, 0.1, 1)] + [(0, "float32"), (0, "printed")]


def excitation(rng, size):
    """Six sines and a random level four times a second, held from sample to sample."""
    time = np.arange(round(DURATION / STEP) + 1) * STEP
    waves = [np.sin(2 * np.pi * (f * time + rng.uniform())) for f in rng.uniform(0.1, 3.0, 6)]
    levels = np.repeat(rng.uniform(-1, 1, len(time) // 25 + 1), 25)[: len(time)]
    return size * (0.35 * np.sum(waves, axis=0) + 0.6 * levels)


def motion(force, inertia, given, dry):
    """Position and velocity under a held input and dry friction, which also holds at rest."""
    x, v, rows = 0.0, 0.0, []
    for u in given:
        rows.append((x, v))
        t = 0.0
        while t < STEP:
            sign = math.copysign(1.0, v) if v else math.copysign(1.0, force(x, 0.0, u))
            if v == 0.0 and abs(force(x, 0.0, u)) <= dry:
                break

            def rates(_, s, u=u, sign=sign):
                return s[1], (force(s[0], s[1], u) - sign * dry) / inertia

            def stop(time, s, sign=sign, late=t + 1e-12, moving=v != 0.0):
                return s[1] if moving or time > late else sign

            stop.terminal, stop.direction = True, -sign
            found = solve_ivp(
                rates, (t, STEP), (x, v), "DOP853", rtol=1e-12, atol=1e-14, events=stop if dry else None,
                first_step=STEP - t,
            )  # fmt: skip
            (x, v), t = found.y[:, -1], found.t[-1]
            v = 0.0 if found.status == 1 else v
    return np.array(rows)


def recorded(machine, seed, factor, form, dry=0.0):
    """A bench of its own, of which ten seconds were recorded."""
    rng = np.random.default_rng([seed, machine == "rig"])
    if machine == "rig":
        mass, damping, stiffness = np.array([2.0, 4.0, 80.0]) * rng.uniform(0.7, 1.3, 3)
        given = excitation(rng, 4.0)
        shown = motion(lambda x, v, u: u - damping * v - stiffness * x, mass, given, dry)
    else:
        inertia, gravity = np.array([0.0626, 1.0]) * rng.uniform(0.7, 1.3, 2)
        given = excitation(rng, 0.6)
        shown = motion(lambda x, v, u: u - gravity * math.sin(x), inertia, given, dry)
    shown = shown + factor * np.array(SENSORS[machine]) * rng.standard_normal(shown.shape)
    table = np.column_stack([given, shown])
    if form == "float32":
        table = table.astype(np.float32).astype(np.float64)
    if form == "printed":
        table = np.array([[float(f"{value:.6g}") for value in row] for row in table])
    columns = dict(zip(COLUMNS[machine], table.T, strict=True))
    return Recording(np.arange(len(given)) * STEP, columns, source=f"{machine} {seed}")


def said(machine, seed, factor, form, dry=0.0):
    """Names and whether anything else was found."""
    found = diagnose(get_model(machine), [recorded(machine, seed, factor, form, dry)])
    return [cause.effect for cause in found.causes], found.unknown


@pytest.mark.matrix(keep=("pendulum-0-",))
@pytest.mark.parametrize(("machine", "factor", "form"), [("rig", 0, ""), ("rig", 0, "float32"),
                                                         ("pendulum", 0, "")])  # fmt: skip
def test_an_exact_simulation_is_not_doubted(machine, factor, form):
    assert said(machine, 0, factor, form) == ([], None)


@pytest.mark.nightly
def test_an_exact_simulation_with_dry_friction_has_that_and_nothing_else():
    assert said("rig", 100, 0, "", COULOMB["rig"]) == (["coulomb_friction"], None)


@pytest.mark.nightly
@pytest.mark.parametrize(("factor", "seed"), [(0.0, 1015), (1e-4, 1001)])
def test_an_integration_off_by_its_resolution_is_not_doubted(factor, seed):
    """A shaken vehicle by a plant of its own; steps of 2.5 ms passed for soil, alike in all windows."""
    bench = get_bench("excitation")
    train, test = recordings(bench, (), Conditions(factor=factor), seed)
    found = diagnose(bench.model, [train], [test])
    assert ([cause.effect for cause in found.causes], found.unknown) == ([], None)
    # What would have been seen errs by as much as the simulation, too.
    finest = {
        s.name: r * train[s.name].std()
        for s, r in zip(bench.model.outputs, bench.model.resolution, strict=True)
    }
    stated = [max(error / finest[name] for name, error in one.errors.items()) for one in found.seen]
    assert stated
    assert min(stated) > 0.9


def test_dry_friction_is_not_taken_for_a_command_that_moves_between_samples():
    """It leads: a command of half a sample earlier explains up to a third of the errors that it makes."""
    record = recorded("pendulum", 1044, 1e-6, "", COULOMB["pendulum"])
    assert decided(get_model("pendulum"), [record], main_horizon, lambda m: m.nominal, frozenset())[1] == ()


@pytest.mark.nightly
def test_nothing_false_at_any_noise_rounded_or_printed():
    """54 benches in which nothing is hidden, 18 with dry friction."""
    seed, wrong = 1000, []
    for machine in SENSORS:
        for factor, form in FORMS:
            for hidden in (False, False, False, True):
                seed += 1
                expected = (["coulomb_friction"], None) if hidden else ([], None)
                answer = said(machine, seed, factor, form, COULOMB[machine] if hidden else 0.0)
                if answer != expected:
                    wrong.append((machine, seed, factor, form, hidden, answer))
    # A level of a few per cent is the noise's; what is left of an exact simulation has no such excuse.
    assert not [answer for answer in wrong if answer[2] <= 1e-3]
    assert len(wrong) <= 2, wrong


def test_rounding_is_found_from_the_numbers():
    rng = np.random.default_rng(0)
    values = 0.3 * rng.standard_normal(5000)
    assert rounding(values) == 0.0
    assert rounding(np.zeros(10)) == 0.0
    assert rounding(np.round(values, 4)) == pytest.approx(1e-4)
    assert rounding(np.round(values / 0.0017) * 0.0017) == pytest.approx(0.0017, rel=1e-3)
    single = values.astype(np.float32).astype(np.float64)
    error = rounding(single) / np.sqrt(12)
    assert error == pytest.approx(np.std(single - values), rel=0.05)
    printed = np.array([float(f"{value:.5g}") for value in values])
    assert rounding(printed) / np.sqrt(12) == pytest.approx(np.std(printed - values), rel=0.05)


@pytest.mark.parametrize(("pace", "noise"), [(0.0, 0.0), (0.3, 0.0), (2.718, 0.0), (0.0, 3.0), (0.02, 0.0)])
def test_rounding_of_averages_diminishes_with_the_steps_that_a_signal_passes(pace, noise):
    rng = np.random.default_rng(1)
    true = rng.uniform(0, 1, (4000, 1)) + pace * np.arange(50) + noise * rng.standard_normal((4000, 50))
    shown = np.round(true)
    error = np.std(np.mean(shown - true, axis=1))
    passed = np.abs(np.diff(shown, axis=1)).sum(axis=1)[:, None]
    stated = of_averages(np.ones(1), passed, np.full((4000, 1), 50.0))
    assert error < 1.1 * np.sqrt(np.mean(stated**2))  # never finer than it is
    assert np.sqrt(np.mean(stated**2)) < 1 / np.sqrt(12) + 1e-9


def test_no_whitener_weighs_finer_than_the_floor():
    record = recorded("rig", 5, 1, "")
    problem = build(get_model("rig"), [record], 0.5)
    averages = problem.floor
    assert (averages >= problem.resolution * problem.output_scale).all()
    tiny = 1e-3 * averages * np.random.default_rng(2).standard_normal((len(problem), len(averages)))
    for whitener in (
        diagonal_whitener(problem, tiny), whitener_by_output(problem, tiny),
        _from_covariance(tiny, averages, 3, 0.15),
    ):  # fmt: skip
        assert np.abs(tiny @ whitener.T).max() < 0.1
    exact = [part.windows.measured(("position", "velocity")) for part in problem.parts]
    assert noise_floor(problem, Prediction(exact, averages, averages), 0) > 0.5 * averages[0]


def test_a_coarse_sensor_raises_the_floor():
    record = recorded("rig", 5, 0, "")
    coarse = Recording(record.time, {**record.signals, "position": np.round(record["position"], 3)})
    fine, rough = (build(get_model("rig"), [r], 0.5) for r in (record, coarse))
    position, velocity = fine.outputs == 0, fine.outputs == 1
    assert (rough.floor[position] > 1e-4).all()
    assert (rough.floor[position] <= 1e-3 / np.sqrt(12)).all()
    assert rough.floor[velocity] == pytest.approx(fine.floor[velocity])


def test_a_hysteresis_that_is_as_narrow_as_can_be_is_coulomb_friction():
    model = get_model("rig").scaled_to([recorded("rig", 5, 1, "")])
    place = model.slice_of("hysteresis")
    distance = model.effect("hysteresis").parameters[1]
    assert distance.lower == pytest.approx(0.003 * model.scales.position)
    vector = model.nominal.copy()
    vector[place] = 0.3, distance.lower
    assert simpler(model, model.effect("hysteresis"), vector) == "coulomb_friction"
    vector[place] = 0.3, 0.1 * model.scales.position
    assert not simpler(model, model.effect("hysteresis"), vector)
    vector[model.slice_of("stribeck_friction")] = 0.3, model.effect("stribeck_friction").parameters[1].upper
    assert simpler(model, model.effect("stribeck_friction"), vector) == "coulomb_friction"
    assert get_model("rig").effect("hysteresis").parameters[1].lower < 1e-8  # a reality may have any


def test_a_value_at_the_end_of_its_range_is_within_it_to_the_last_bit():
    """As numbers of order one and back: a logarithm's rounding must not make a result that is refused."""
    ranges = [Parameter("x", "m", 0.7 * k, 0.0107 * k, 107.3 * k, 0.3 * k) for k in range(1, 200)]
    coordinates = Coordinates(tuple(ranges), np.arange(len(ranges)))
    lower, upper = (np.array([getattr(p, end) for p in ranges]) for end in ("lower", "upper"))
    assert (coordinates.decode(coordinates.upper) <= upper).all()
    assert (coordinates.decode(coordinates.lower) >= lower).all()
    np.testing.assert_allclose(coordinates.decode(coordinates.upper), upper, rtol=1e-14)
