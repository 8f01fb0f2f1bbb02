"""A base that the data determine only in part condemns no effect."""

import numpy as np
import pytest

from fieldmodels.diagnosis import diagnose
from fieldmodels.effects import sensor
from fieldmodels.machine import Machine, number
from fieldmodels.model import Signal
from fieldmodels.recording import Recording


class Heater(Machine):
    inputs = (Signal("heat", "W"),)
    states = outputs = (Signal("temperature", "°C", noise=0.1),)
    time_constant = number("s", 100.0, 1.0, 1e5)
    gain = number("K/W", 1.0, 0.0, 100.0)
    ambient = number("°C", 20.0, -50.0, 60.0)
    horizons = (60.0, 120.0, 240.0)
    effects = sensor("temperature", ("lag",))

    def derivative(self, state, input, p):
        return ((p.ambient + p.gain * input.heat - state.temperature) / p.time_constant,)


def test_a_heater_that_is_never_switched_off_shows_its_sensors_lag():
    """Gain and ambient temperature cannot be told apart; the sensor's 20 s can."""
    rng, plate, shown, rows = np.random.default_rng(1), 21.0, 21.0, []
    for _ in range(800):
        rows.append(shown + 0.05 * rng.normal())
        plate += (21.0 + 0.7 * 50.0 - plate) / 140.0
        shown += (plate - shown) / 20.0
    log = Recording(np.arange(800.0), {"heat": np.full(800, 50.0), "temperature": np.array(rows)})
    found = diagnose(Heater(), [log], window="record")
    [cause] = found.causes
    assert cause.effect == "sensor_lag"
    assert cause.parameters["time_constant"].value == pytest.approx(20.0, rel=0.1)
