"""Windows begin where a slow sensor's machine really was, not where one in steady motion would have been."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis import diagnose
from fieldmodels.effects import sensor
from fieldmodels.machine import Force, Machine, number
from fieldmodels.model import Signal
from fieldmodels.recording import Recording, Windows

SENSOR = ("gain", "drift", "lag", "delay")


class Fan(Machine):
    """Its speed follows the voltage in 0.4 s."""

    inputs = (Signal("voltage", "V"),)
    states = outputs = (Signal("speed", "rad/s", noise=0.1),)
    gain = number("rad/s/V", 8.0, 0.0, 1e3)
    time_constant = number("s", 0.4, refitted=False)
    horizons = 0.5, 1.0
    effects = sensor("speed", SENSOR)

    def derivative(self, state: Any, input: Any, p: Any) -> Any:
        """Rate of the speed."""
        return ((p.gain * input.voltage - state.speed) / p.time_constant,)


class Oven(Machine):
    """A fan in other coordinates: what is measured is no state."""

    inputs = (Signal("voltage", "V"),)
    states = (Signal("heat", "J", noise=0.2),)
    outputs = (Signal("temperature", "K", noise=0.1),)
    gain = number("K/V", 8.0, 0.0, 1e3)
    capacity = number("J/K", 2.0, refitted=False)
    horizons = 0.5, 1.0
    effects = sensor("temperature", SENSOR)

    def derivative(self, state: Any, input: Any, p: Any) -> Any:
        """Rate of the heat."""
        return ((p.capacity * p.gain * input.voltage - state.heat) / 0.4,)

    def observe(self, state: Any, p: Any) -> Any:
        """The temperature."""
        return (state.heat / p.capacity,)


class Cart(Machine):
    """A mass on a spring; its velocity has no sensor."""

    inputs = (Signal("force", "N"),)
    states = (Signal("position", "m", noise=0.01), Signal("velocity", "m/s", noise=0.05))
    outputs = (Signal("position", "m", noise=0.01),)
    mass = number("kg", 1.2, refitted=False)
    damping = number("N s/m", 1.5, refitted=False)
    stiffness = number("N/m", 4.0, 0.0, 100.0)
    forces = (Force("velocity", "position", unit="N", inertia="mass"),)
    horizons = 0.5, 1.0
    effects = sensor("position", SENSOR)

    def derivative(self, state: Any, input: Any, p: Any) -> Any:
        """Rates of position and velocity."""
        pull = input.force - p.damping * state.velocity - p.stiffness * state.position
        return state.velocity, pull / p.mass


STEP, ROWS = 0.02, 1200
FAN, CART = [[-1 / 0.4]], [[0, 1], [-5 / 1.2, -1.5 / 1.2]]
MACHINES: dict[type[Machine], tuple[list[list[float]], list[float], float]] = {
    Fan: (FAN, [10 / 0.4], 1.0),
    Oven: (FAN, [2 * 10 / 0.4], 0.5),
    Cart: (CART, [0, 3 / 1.2], 1.0),
}
"""Rates of the states by themselves and by a command of 1, and what the sensor senses of the first state."""
TRUE: dict[type[Machine], Mapping[str, float]] = {
    Fan: {"gain": 10},
    Oven: {"gain": 10},
    Cart: {"stiffness": 5},
}


def record(
    machine: type[Machine],
    lag: float,
    noise: float,
    seed: int,
    gain: float = 1.0,
    drift: float = 0.0,
    late: int = 0,
) -> tuple[Recording, FloatArray]:
    """24 s behind a slow sensor by the matrix exponential, and the true states, shape (rows, states).

    Args:
        machine: Which.
        lag: Time constant of its sensor [s].
        noise: Of the sensor, over the spread of what it shows.
        seed: Of command and noise.
        gain: Of the sensor.
        drift: Of the sensor, over that spread, in a second.
        late: Samples by which it shows it late.
    """
    rng = np.random.default_rng([seed, 23])
    rates, push, sensed = MACHINES[machine]
    n = len(rates)
    whole = np.zeros((n + 2, n + 2))
    whole[:n, :n], whole[:n, n + 1] = rates, push
    whole[n, 0], whole[n, n] = sensed / lag, -1 / lag
    ahead = expm(whole * STEP)
    time = STEP * np.arange(ROWS)
    command = rng.uniform(-1, 1, 40)[(time / 0.7).astype(int)] + 0.3 * np.sin(2.2 * time)
    state, path = np.zeros(n + 2), []
    for u in command:
        state[-1] = u
        path.append(state)
        state = ahead @ state
    states = np.array(path)
    shown = gain * states[np.maximum(np.arange(ROWS) - late, 0), n]
    spread = shown.std()
    shown += spread * (drift * time + noise * rng.standard_normal(ROWS))
    given = machine.inputs[0].name, machine.outputs[0].name
    size = 3.0 if machine is Cart else 1.0
    signals = dict(zip(given, (size * command, shown), strict=True))
    return Recording(time, signals, source=f"record {seed}"), states[:, :n]


@pytest.mark.matrix(
    keep=(
        "Fan-0.5",
        "Oven-0.5",
        "Cart-0.5",
    )
)
@pytest.mark.parametrize("lag", [0.1, 0.5, 1.5])
@pytest.mark.parametrize("machine", [Fan, Oven, Cart])
def test_the_lag_is_found_however_it_compares_to_a_window(machine: type[Machine], lag: float):
    """If windows of 1 s start in steady motion, the lag is a third of the true one, or is not found.

    The bound is three of the stated standard errors, which one value in a hundred exceeds if they are right.
    """
    (train, _), (test, _) = (record(machine, lag, 0.02, seed) for seed in (31, 32))
    found = diagnose(machine(), [train], [test])
    assert [c.effect for c in found.causes] == ["sensor_lag"], found.summary()
    value = found.causes[0].parameters["time_constant"]
    assert abs(value.value - lag) < 3 * value.std
    assert value.std < 0.12 * lag


@pytest.mark.parametrize("late", [0, 3])
@pytest.mark.parametrize("lag", [0.1, 0.5, 1.5])
@pytest.mark.parametrize("machine", [Fan, Oven, Cart])
def test_windows_are_predicted_from_what_is_measured(machine: type[Machine], lag: float, late: int):
    """With the true numbers every window goes on as it was recorded, by a sensor with a gain and a drift."""
    drift = 0.05
    recording, states = record(machine, lag, 0.0, 33, 1.3, drift, late)
    output = machine.outputs[0].name
    spread = recording[output].std()
    drift *= record(machine, lag, 0.0, 33, 1.3)[0][output].std()
    model = machine()
    hidden = {
        "sensor_lag": {"time_constant": lag}, "sensor_gain": {"gain": 1.3}, "sensor_drift": {"rate": drift},
        "sensor_delay": {"delay": late * STEP},
    }  # fmt: skip
    windows = model.windows(recording, 1.0)
    if machine is Oven:  # no sensor shows its state by name: the true one
        windows = windows.with_states(states[np.maximum(windows.starts - late, 0)])
    shown = model.simulate(model.vector(TRUE[machine], hidden)[None], windows)[0, 1:, :, 0]
    error = shown - inside(windows, recording[output])[1:]
    assert np.abs(error).max() < 0.02 * spread


def inside(windows: Windows, values: FloatArray) -> FloatArray:
    """A signal in every window, shape (windows, samples)."""
    return np.asarray(values[windows.starts[:, None] + np.arange(windows.samples)])
