"""Stock effects around models that simulate by themselves."""

import numpy as np
import pytest

from fieldmodels.drivers.around import with_effects
from fieldmodels.effects import actuator, change, curve, force, sensor
from fieldmodels.machine import Machine, number
from fieldmodels.machines.heel_strike.parameters import Leg
from fieldmodels.machines.heel_strike.recording import record_walk
from fieldmodels.model import Model, ModelError, Signal
from fieldmodels.recording import Recording, Windows
from fieldmodels.registry import get_model

STEP = 0.02


class Declared(Machine):
    """A motor that declares its stock effects."""

    name = "motor"
    inputs = (Signal("voltage", "V"),)
    states = outputs = (Signal("speed", "rad/s", noise=0.2),)
    gain = number("rad/s/V", 10.0, 0.0, 1e3)
    time_constant = number("s", 0.4, 0.01, 10.0)
    effects = (
        actuator("voltage")
        + sensor("speed")
        + change("gain")
        + curve("actuator", "voltage", knots=5)
        + curve("sensor", "speed", knots=4)
    )

    def derivative(self, state, input, p):
        return (p.gain * input.voltage - state.speed) / p.time_constant


class Plain(Model):
    """The same motor with a simulation of its own and no effect."""

    name = "motor"
    inputs, states, outputs = Declared.inputs, Declared.states, Declared.outputs
    parameters = Declared().parameters
    effects = ()
    horizons = (0.2, 0.4)

    def simulate(self, parameters, windows):
        gain, time_constant = np.atleast_2d(parameters).T[:, :, None]
        speed = np.tile(windows.states[:, 0], (len(gain), 1))
        result = np.full((*speed.shape, windows.samples, 1), np.nan)
        for k in range(windows.samples):
            result[:, :, k, 0] = speed
            row = np.minimum(windows.starts + k, len(windows.recording) - 1)
            target = gain * windows.recording["voltage"][row]
            speed = target + (speed - target) * np.exp(-STEP / time_constant)
        return result

    def initial_states(self, recording, starts):
        return recording["speed"][starts][:, None]


AROUND = with_effects(
    Plain(),
    actuator("voltage"),
    sensor("speed", without=("lag", "delay")),
    change("gain"),
    curve("actuator", "voltage", knots=5),
    curve("sensor", "speed", knots=4),
)
VALUES = {
    "actuator_gain": {"gain": 0.7},
    "actuator_bias": {"bias": 0.4},
    "actuator_asymmetry": {"difference": 0.3},
    "actuator_play": {"width": 1.1},
    "actuator_lag": {"time_constant": 0.031},
    "actuator_rate_limit": {"rate": 40.0},
    "actuator_delay": {"delay": 0.051},
    "actuator_saturation": {"limit": 1.3},
    "actuator_dead_zone": {"width": 0.6},
    "actuator_parameter_step": {"time": 0.8, "factor": 0.5},
    "sensor_bias": {"bias": 2.0},
    "sensor_drift": {"rate": 1.5},
    "sensor_gain": {"gain": 1.2},
    "sensor_bend": {"curvature": 0.01},
    "sensor_eccentricity": {"sine": 0.7, "cosine": -0.4, "period": 9.0},
    "sensor_clipping": {"limit": 8.0},
    "sensor_quantisation": {"step": 0.7},
    "voltage_curve": {
        "low": -2.0,
        "high": 2.0,
        "value_1": 0.9,
        "value_2": -0.3,
        "value_4": 0.2,
        "value_5": -0.6,
    },
    "speed_curve": {"low": -20.0, "high": 20.0, "value_1": 3.0, "value_2": -2.0, "value_4": 1.5},
    "gain_step": {"time": 0.8, "change": 3.0},
    "gain_drift": {"rate": -2.0},
}


def windows_of(starts, samples, states):
    rng = np.random.default_rng(4)
    voltage = np.repeat(rng.uniform(-3, 3, 20), 5)
    record = Recording(np.arange(100) * STEP, {"voltage": voltage, "speed": np.zeros(100)})
    observed = np.ones((len(starts), samples, 1), dtype=bool)
    return Windows(record, np.array(starts), np.full(len(starts), samples), np.array(states), observed)


@pytest.mark.matrix(
    keep=(
        "actuator_lag",
        "actuator_rate_limit",
        "actuator_delay",
        "sensor_drift",
        "gain_drift",
        "voltage_curve",
    )
)
@pytest.mark.parametrize("effect", [e.name for e in AROUND.effects])
def test_around_a_model_an_effect_does_what_it_does_in_a_machine(effect):
    """A change of a parameter is its mean over a window: short windows, and what is left is its square."""
    values = {effect: VALUES[effect]}
    moving = effect.startswith("gain_")
    samples = 5 if moving else 40
    windows = windows_of(range(0, 60, samples), samples, [[1.0]] * len(range(0, 60, samples)))
    machine = Declared()
    exact = machine.simulate(machine.vector(effects=values)[None], windows)
    off = machine.simulate(machine.nominal[None], windows)
    got = AROUND.simulate(AROUND.vector(effects=values)[None], windows)
    size = np.abs(exact - off).max()
    assert size > 0.1
    # Within a sampling interval a command that changes is taken by its mean.
    coarse = 0.02 if "delay" in effect or "lag" in effect or "rate" in effect else 2e-4
    np.testing.assert_allclose(
        got, exact, atol=(0.3 if effect == "gain_step" else 0.03 if moving else coarse) * size
    )


def test_with_everything_off_it_is_the_model_to_the_bit():
    windows = windows_of([0, 50], 40, [[1.0], [-2.0]])
    inner = Plain()
    assert AROUND.names[:2] == inner.names
    np.testing.assert_array_equal(
        AROUND.simulate(AROUND.nominal[None], windows), inner.simulate(inner.nominal[None], windows)
    )


def test_rows_of_different_effects_go_together():
    windows = windows_of([0, 50], 40, [[1.0], [-2.0]])
    rows = np.array([AROUND.vector(effects={e: v}) for e, v in list(VALUES.items())[:6]] + [AROUND.nominal])
    together = AROUND.simulate(rows, windows)
    for row, out in zip(rows, together, strict=True):
        np.testing.assert_array_equal(out, AROUND.simulate(row[None], windows)[0])


def test_around_the_machine_of_a_task():
    inner = get_model("heel_strike")
    model = with_effects(
        inner, sensor("gyro", ("clipping",)), force("disturbance", ("constant_force",), prefix="outer_")
    )
    recording = record_walk(20.0, np.random.default_rng(3), leg=Leg(step=0.01))
    windows = inner.windows(recording, inner.horizons[0]).select(np.arange(3))
    nominal = model.simulate(model.nominal[None], windows)
    np.testing.assert_array_equal(nominal, inner.simulate(inner.nominal[None], windows))
    limit = 0.8 * float(np.nanmax(np.abs(nominal[..., 0])))
    clipped = model.simulate(model.vector(effects={"sensor_clipping": {"limit": limit}})[None], windows)
    np.testing.assert_allclose(clipped[..., 0], np.clip(nominal[..., 0], -limit, limit), equal_nan=True)
    pushed = model.simulate(
        model.vector(effects={"outer_constant_force": {"disturbance": 0.3}})[None], windows
    )
    own = inner.simulate(inner.vector(effects={"constant_force": {"acceleration": 0.3}})[None], windows)
    assert np.nanmax(np.abs(own - nominal)[..., 1]) > 1e-4
    np.testing.assert_allclose(pushed[..., 1], own[..., 1], atol=1e-9, equal_nan=True)


def test_what_cannot_be_is_said():
    with pytest.raises(ModelError, match="needs a look inside"):
        with_effects(Plain(), sensor("speed", ("lag",)))
    with pytest.raises(ModelError, match="needs a look inside"):
        with_effects(Plain(), curve("sensor", "speed", "voltage"))
    with pytest.raises(ModelError, match="no actuator signal 'current'"):
        with_effects(Plain(), actuator("current"))
    with pytest.raises(ModelError, match="already"):
        with_effects(get_model("heel_strike"), sensor("gyro", ("bias",), prefix="gyro_"))
