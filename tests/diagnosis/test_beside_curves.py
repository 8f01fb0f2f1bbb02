"""Names beside an unlisted curve: a suspension, simulated here by itself, whose damper is harder one way."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis import Diagnosis, diagnose
from fieldmodels.diagnosis.problem import build
from fieldmodels.drivers.curved import Curved, FreeCurve
from fieldmodels.effects import actuator, force, sensor
from fieldmodels.machine import Force, Machine, number
from fieldmodels.model import Signal
from fieldmodels.recording import Recording, Windows

MASS, DAMPER, SPRING, NOISE = 30.0, 220.0, 9000.0, 2e-5
STEP, COUNT, SUBSTEPS = 0.004, 5000, 8


class Suspension(Machine):
    """A mass on a spring and a damper."""

    inputs = (Signal("load", "N"),)
    states = (Signal("travel", "m"), Signal("speed", "m/s"))
    outputs = (Signal("travel", "m", noise=NOISE),)
    mass = number("kg", 25.0, 1.0, 500.0)
    damper = number("N s/m", 300.0, 0.0, 1e4)
    spring = number("N/m", 8000.0, 100.0, 1e6)
    forces = (Force("speed", "travel", unit="N", inertia="mass"),)
    effects = actuator("load") + force("speed") + sensor("travel")
    hold = "held"

    def derivative(self, state, input, p):
        """Newton's law."""
        return state.speed, (input.load - p.damper * state.speed - p.spring * state.travel) / p.mass


def harder_in_rebound(_travel: float, speed: float) -> float:
    """Four times as hard one way."""
    return -3.0 * DAMPER * max(speed, 0.0)


def end_stop(travel: float, _speed: float) -> float:
    """Rubber above twelve millimetres."""
    return -6e4 * max(travel - 0.012, 0.0)


def record(seed: int, *missing: Callable[[float, float], float]) -> Recording:
    """Midpoint rule, with what is missing from the model."""
    rng = np.random.default_rng(seed)
    time = np.arange(COUNT) * STEP
    frequencies, phases = np.exp(rng.uniform(np.log(0.3), np.log(6.0), 8)), rng.uniform(0.0, 6.28, 8)
    load = 60.0 * np.sin(2.0 * np.pi * np.outer(time, frequencies) + phases).sum(axis=1)
    travel, speed, rows, h = 0.0, 0.0, [], STEP / SUBSTEPS

    def rate(x: float, v: float, pushed: float) -> float:
        return (pushed - DAMPER * v - SPRING * x + sum(one(x, v) for one in missing)) / MASS

    for pushed in load.tolist():
        rows.append(travel)
        for _ in range(SUBSTEPS):
            half = speed + 0.5 * h * rate(travel, speed, pushed)
            middle = travel + 0.5 * h * speed
            travel, speed = travel + h * half, speed + h * rate(middle, half, pushed)
    shown = np.array(rows) + NOISE * rng.standard_normal(COUNT)
    return Recording(time, {"load": load, "travel": shown})


def found(*missing: Callable[[float, float], float]) -> Diagnosis:
    """The diagnosis of two records."""
    return diagnose(Suspension(), [record(1, *missing)], [record(2, *missing)])


def curved() -> tuple[Curved, FloatArray, Windows]:
    """A suspension with a curve of its force and one of its sensor, values, and windows."""
    knots = np.array([-0.3, 0.0, 0.3])
    bend = FreeCurve("force", "", "rate of travel", knots, np.array([[1.0], [0.0], [2.0]]))
    shown = FreeCurve("sensor", "travel", "load", 1e3 * knots, np.array([[-1.0], [0.0], [1.0]]))
    model = Suspension()
    inside = Curved(model, [bend, shown])
    return inside, np.concatenate([model.nominal, [30.0, 1e-3]]), model.windows(record(3), 0.2)


def test_what_a_curve_adds_is_given_in_a_force_and_in_a_sensor():
    model, vector, windows = curved()
    given = model.as_given(vector, windows)
    whole, plain = (
        model.simulate(vector[None], windows)[0],
        model.inner.simulate(model.inner.nominal[None], given)[0],
    )
    error = windows.measured(("travel",)) - given.measured(("travel",))
    assert np.abs(error).max() > 1e-4
    np.testing.assert_allclose(plain + error, whole, rtol=0, atol=1e-7)
    without = model.inner.simulate(model.inner.nominal[None], windows)[0]
    assert np.abs(without - plain).max() > 1e-5


def test_a_force_along_a_record_adds_to_what_is_given():
    model, vector, windows = curved()
    problem = build(model.inner, [windows.recording], 0.2)
    push, states = np.full(COUNT, 5.0), problem.states
    given = [replace(p, windows=model.as_given(vector, p.windows)) for p in problem.parts]
    both = [replace(p, windows=p.windows.with_disturbance(p.windows.disturbance + push)) for p in given]
    responded = replace(problem, parts=tuple(given)).response(model.inner.nominal, states, [push])
    simulated = replace(problem, parts=tuple(both)).simulate(model.inner.nominal[None], states)[0]
    np.testing.assert_array_equal(responded, simulated)


@pytest.mark.nightly
def test_an_end_stop_is_named_beside_a_damper_that_nobody_has_listed():
    diagnosis = found(harder_in_rebound, end_stop)
    assert [cause.effect for cause in diagnosis.causes] == ["one_sided_spring"]
    stop = diagnosis.causes[0].parameters
    assert stop["stiffness"].value == pytest.approx(6e4, rel=0.1)
    assert stop["place"].value == pytest.approx(0.012, rel=0.1)
    assert "travel" in diagnosis.curves[0].over
    assert diagnosis.curves[0].place == "force"
    gain = diagnosis.gain["travel"]
    assert gain.rmse_with_curves < 3.0 * NOISE < gain.rmse_before


@pytest.mark.nightly
def test_nothing_is_named_beside_a_curve_that_is_all():
    diagnosis = found(harder_in_rebound)
    assert diagnosis.verdict == "unknown"
    assert not diagnosis.causes
