"""A machine in ten lines: what is declared is what is simulated, and what cannot be is said."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fieldmodels.diagnosis import diagnose
from fieldmodels.effects import actuator, change, curve, force, friction, sensor
from fieldmodels.machine import Force, Machine, held_inputs, number
from fieldmodels.model import ModelError, Signal
from fieldmodels.recording import Recording, Windows
from fieldmodels.registry import get_model

STEP = 0.02


class Motor(Machine):
    """Speed of a motor: time_constant dw/dt = gain u - w."""

    inputs = (Signal("voltage", "V"),)
    states = outputs = (Signal("speed", "rad/s", noise=0.2),)
    gain = number("rad/s/V", 10.0, 0.0, 1e3)
    time_constant = number("s", 0.1, 0.01, 10.0)
    effects = actuator("voltage") + friction("speed") + sensor("speed") + change("gain")

    def derivative(self, state, input, p):
        return (p.gain * input.voltage - state.speed) / p.time_constant


class Interpolated(Motor):
    """The same, driven by a voltage that was sampled while it moved."""

    hold = "interpolated"


def run(machine, voltage, effects=None, speed=0.0):
    n = len(voltage)
    record = Recording(np.arange(n) * STEP, {"voltage": voltage, "speed": np.zeros(n)})
    whole = Windows(record, np.array([0]), np.array([n]), np.array([[speed]]), np.ones((1, n, 1), dtype=bool))
    return machine.simulate(machine.vector(effects=effects)[None], whole)[0, 0, :, 0]


def test_names_units_and_bounds_are_those_that_were_declared():
    machine = Motor()
    assert machine.name == "motor"
    assert [(p.name, p.unit, p.nominal, p.lower, p.upper) for p in machine.parameters] == [
        ("gain", "rad/s/V", 10.0, 0.0, 1e3),
        ("time_constant", "s", 0.1, 0.01, 10.0),
    ]
    units = {f"{e.name}.{p.name}": p.unit for e in machine.effects for p in e.parameters}
    assert units["coulomb_friction.rate"] == "rad/s^2"
    assert units["viscous_friction.coefficient"] == "rad/s^2 s/rad"
    assert units["actuator_dead_zone.width"] == "V"
    assert units["gain_step.change"] == "rad/s/V"
    assert machine.disturbance_unit == "rad/s^2"


def test_a_curve_runs_from_one_value_of_its_variable_to_another_in_its_unit():
    class Curved(Motor):
        effects = (
            curve("force", "speed")
            + curve("force", "speed", over=("time", "speed*size_of_voltage"), name="table")
            + curve("parameter", "gain", over="voltage")
        )

    units = {f"{e.name}.{p.name}": p.unit for e in Curved().effects for p in e.parameters}
    assert (units["speed_curve.low"], units["speed_curve.high"]) == ("rad/s", "rad/s")
    assert (units["table.low_1"], units["table.high_2"]) == ("s", "rad V/s")
    assert units["gain_over_voltage.low"] == "V"


@pytest.mark.every(
    ("unit", "name"), [("N", "force"), ("N m", "torque"), ("Nm", "torque"), ("W", "rate"), ("", "rate")]
)
def test_a_force_is_named_by_its_unit(unit, name):
    class Pushed(Motor):
        forces = (Force("speed", unit=unit),)

    friction = next(e for e in Pushed().effects if e.name == "coulomb_friction")
    assert [p.name for p in friction.parameters] == [name]
    assert f"a {name} of constant size" in friction.cause


@pytest.mark.nightly
def test_held_and_interpolated_inputs_are_those_of_closed_forms():
    voltage = np.random.default_rng(1).uniform(-3, 3, 40)
    held, interpolated = np.zeros(40), np.zeros(40)
    kept = np.exp(-STEP / 0.1)
    for k in range(39):
        held[k + 1] = 10 * voltage[k] + (held[k] - 10 * voltage[k]) * kept
        slope = (voltage[k + 1] - voltage[k]) / STEP
        behind = 10 * (voltage[k] - 0.1 * slope)
        interpolated[k + 1] = behind + 10 * slope * STEP + (interpolated[k] - behind) * kept
    np.testing.assert_allclose(run(Motor(), voltage), held, atol=2e-5 * np.abs(held).max())
    np.testing.assert_allclose(run(Interpolated(), voltage), interpolated, atol=2e-5 * np.abs(held).max())
    other = held_inputs(Motor(), "interpolated")
    np.testing.assert_array_equal(run(other, voltage), run(Interpolated(), voltage))
    assert np.abs(held - interpolated).max() > 1


def test_a_lag_of_an_interpolated_input():
    time, lag = np.arange(40) * STEP, 0.013
    voltage = np.random.default_rng(2).uniform(-3, 3, 40)

    def rates(t, y):
        return [(10 * y[1] - y[0]) / 0.1, (np.interp(t, time, voltage) - y[1]) / lag]

    options = {"t_eval": time, "max_step": STEP / 20, "rtol": 1e-9, "atol": 1e-9}
    exact = solve_ivp(rates, (0, time[-1]), [0.0, voltage[0]], **options).y[0]
    shown = run(Interpolated(), voltage, {"actuator_lag": {"time_constant": lag}})
    np.testing.assert_allclose(shown, exact, atol=1e-4 * np.abs(exact).max())


def test_a_parameter_that_jumps_and_one_that_drifts():
    time, voltage = np.arange(50) * STEP, np.full(50, 2.0)

    def exact(gain):
        def rates(t, y):
            return (gain(t) * 2.0 - y) / 0.1

        return solve_ivp(rates, (0, time[-1]), [0.0], t_eval=time, max_step=1e-3, rtol=1e-9, atol=1e-9).y[0]

    jump = run(Motor(), voltage, {"gain_step": {"time": 0.413, "change": 3.0}})
    np.testing.assert_allclose(jump, exact(lambda t: 10 + 3.0 * (t >= 0.413)), atol=0.05)
    drift = run(Motor(), voltage, {"gain_drift": {"rate": -2.0}})
    np.testing.assert_allclose(drift, exact(lambda t: 10 - 2.0 * t), atol=1e-3)


def test_what_cannot_be_is_said():
    def declared(**attributes):
        return type("Broken", (Motor,), attributes)

    with pytest.raises(ModelError, match=r"no actuator signal 'voltag' \(did you mean 'voltage'"):
        declared(effects=actuator("voltag"))()
    with pytest.raises(ModelError, match="needs a position"):
        declared(effects=force("speed"))()
    with pytest.raises(ModelError, match="declared twice"):
        declared(effects=sensor("speed", ("bias",)) + sensor("speed", ("bias",)))()
    with pytest.raises(ModelError, match="no stock effect 'gian'"):
        actuator("voltage", ("gian",))
    with pytest.raises(ModelError, match="no state 'angle'"):
        declared(forces=(Force("speed", position="angle"),))()
    with pytest.raises(ModelError, match="give either derivative or step"):
        type("Both", (Motor,), {"step": lambda self, state, input, p, dt: state.speed})()
    with pytest.raises(ModelError, match="a curve's place"):
        curve("gearbox", "speed")
    with pytest.raises(ModelError, match="says itself what its inputs do"):
        held_inputs(get_model("heel_strike"), "held")


class Known(Machine):
    """The motor with numbers that are known: it has effects alone."""

    inputs = (Signal("voltage", "V"),)
    states = outputs = (Signal("speed", "rad/s", noise=0.02),)
    effects = actuator("voltage") + sensor("speed")

    def derivative(self, state, input, p):
        return (10.0 * input.voltage - state.speed) / 0.1


@pytest.mark.nightly
def test_a_machine_whose_numbers_are_known_needs_none():
    voltage = np.repeat(np.random.default_rng(1).uniform(-3, 3, 100), 5)
    shown, kept = np.zeros(len(voltage)), np.exp(-STEP / 0.1)
    for i in range(len(voltage) - 1):
        shown[i + 1] = kept * shown[i] + (1.0 - kept) * 10.0 * 0.9 * voltage[i]
    shown += 0.02 * np.random.default_rng(2).standard_normal(len(shown))
    logs = [
        Recording(STEP * np.arange(250), {"voltage": voltage[part], "speed": shown[part]})
        for part in (slice(0, 250), slice(250, 500))
    ]
    found = diagnose(Known(), logs[:1], logs[1:])
    [cause] = found.causes
    assert {cause.effect, *cause.alternatives} == {
        "actuator_gain",
        "sensor_gain",
    }  # of a linear machine the same
    assert found.parameters == {}
