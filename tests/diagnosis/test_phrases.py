"""Curves in sentences."""

import pytest

from fieldmodels.diagnosis.phrases import depends_on

READ = {
    ("force", "", "velocity", "ends"): "the velocity (only near the ends of its range)",
    ("parameter", "damping", "size of rate of velocity", ""): (
        "the size of the rate of change of the velocity and acts on the damping"
    ),
    ("force", "share of turn_rate", "way of turn_rate", "repeats every 2.53 rad"): (
        "the integral of the turn rate over time (repeats every 2.53 rad) "
        "and acts on the turn rate, in proportion to it"
    ),
    ("sensor", "position", "play of position of 0.0066", ""): (
        "the position behind a play of 0.0066 and acts on the position sensor"
    ),
    ("odds", "alarm", "speed times memory of size of speed over 0.5 s", ""): (
        "the speed times the recent mean of the size of the speed (over 0.5 s) "
        "and acts on the log-odds of the alarm"
    ),
    ("sensor", "wheel_speed", "change of command over 0.2 s", "sign"): (
        "the change of the command over 0.2 s (by its sign alone) and acts on the wheel speed sensor"
    ),
}


@pytest.mark.parametrize("curve", READ)
def test_a_curve_reads_as_a_sentence(curve):
    assert depends_on(*curve) == READ[curve]
