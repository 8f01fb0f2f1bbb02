"""Names that together imitate a curve: a ship's rudder, limited or not, in wind, simulated here by itself."""

from math import cos, sin

import numpy as np
import pytest

from fieldmodels.diagnosis import Diagnosis, diagnose
from fieldmodels.effects import actuator, force, sensor
from fieldmodels.machine import Force, Machine, number
from fieldmodels.model import Signal
from fieldmodels.recording import Recording

SHOWN, NOISE = ("heading", "rate"), (0.004, 0.008)
STEP, COUNT, SUBSTEPS, SETTLED = 0.02, 2500, 4, 200
LIMIT, GAIN, TIME = 0.35, 1.4, 0.9


class Ship(Machine):
    """Nomoto's model."""

    inputs = (Signal("rudder", "rad"),)
    states = (Signal("heading", "rad"), Signal("rate", "rad/s"))
    outputs = (Signal("heading", "rad", noise=NOISE[0]), Signal("rate", "rad/s", noise=NOISE[1]))
    gain = number("1/s", 1.4, 0.05, 20.0)
    time_constant = number("s", 0.9, 0.05, 20.0)
    forces = (Force("rate", "heading"),)
    effects = actuator("rudder") + force("rate") + sensor("heading") + sensor("rate", prefix="rate_sensor_")

    def derivative(self, state, input, p):
        """Nomoto's equation of first order."""
        return state.rate, (p.gain * input.rudder - state.rate) / p.time_constant


def wind(heading: float) -> float:
    """What wind turns it by, bow and quarter not alike."""
    off = heading - 0.6
    return 0.22 * (sin(off) + 0.8 * sin(2.0 * off) * (cos(off) > 0.0))


def record(seed: int, limited: bool) -> Recording:
    """A record under a course controller whose set-points jump; the first seconds are left out."""
    rng = np.random.default_rng(seed)
    wanted: list[float] = []
    while len(wanted) < COUNT:
        held = int(rng.uniform(2.0, 5.0) / STEP)
        wanted += [float(rng.uniform(-2.2, 2.2))] * held
    heading = rate = rudder = 0.0
    rows, h = [], STEP / SUBSTEPS
    for i in range(COUNT):
        course = 1.2 * (wanted[i] - heading) - 0.6 * rate + 0.15 * sin(5.0 * i * STEP + seed)
        command = min(max(course, -0.6), 0.6)
        rows.append((command, heading, rate))
        for _ in range(SUBSTEPS):
            way = command - rudder
            rudder += min(max(way, -LIMIT * h), LIMIT * h) if limited else way
            rate += h * ((GAIN * rudder - rate) / TIME + wind(heading))
            heading += h * rate
    told, noise = np.array(rows), [size * rng.standard_normal(COUNT) for size in NOISE]
    shown = (told[:, 1:] + np.column_stack(noise))[SETTLED:]
    signals = {"rudder": told[SETTLED:, 0], "heading": shown[:, 0], "rate": shown[:, 1]}
    return Recording(np.arange(COUNT - SETTLED) * STEP, signals)


def found(limited: bool) -> Diagnosis:
    """The diagnosis of two records."""
    return diagnose(Ship(), [record(11, limited)], [record(23, limited)])


@pytest.mark.nightly
@pytest.mark.parametrize(("limited", "named"), [(True, ["actuator_rate_limit"]), (False, [])])
def test_wind_is_a_curve_and_no_set_of_springs(limited: bool, named: list[str]):
    diagnosis = found(limited)
    assert [cause.effect for cause in diagnosis.causes] == named
    assert diagnosis.curves[0].over == "heading"
    assert diagnosis.curves[0].place == "force"


@pytest.mark.nightly
def test_test_data_that_are_too_noisy_to_tell_take_no_name_away():
    """Only the price of names speaks against the three; ten times the noise hides what the curve explains."""
    noise, test = np.random.default_rng(1), record(23, False)
    worse = {
        n: test[n] + 10.0 * s * noise.standard_normal(len(test)) for n, s in zip(SHOWN, NOISE, strict=True)
    }
    noisy = Recording(test.time, {**test.signals, **worse})
    diagnosis = diagnose(Ship(), [record(11, False)], [noisy])
    assert len(diagnosis.causes) == 3
    assert str(diagnosis).count("or an unlisted force that depends on the heading") == 3
