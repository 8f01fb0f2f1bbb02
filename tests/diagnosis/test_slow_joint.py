"""A joint that is led slowly and shows a filtered velocity, simulated here by itself."""

import numpy as np
import pytest

from fieldmodels.diagnosis import diagnose
from fieldmodels.effects import actuator, force, sensor
from fieldmodels.machine import Force, Machine, number
from fieldmodels.model import Signal
from fieldmodels.recording import Recording
from fieldmodels.registry import get_model

STEP, SUBSTEPS, LAG = 0.01, 10, 0.2
INERTIA, DAMPING, FRICTION, GRAVITY, TILT = 4.0, 2.7, 0.4, 1.2, 0.4
FREQUENCIES = 2.0 * np.pi * np.array([0.04, 0.055, 0.09])


def record(seed: int, seconds: float = 40.0) -> Recording:
    """A joint under gravity, with friction that is unlike along the way, under a controller."""
    rng = np.random.default_rng(seed)
    sizes, phases = rng.uniform(0.1, 0.25, 3), rng.uniform(0.0, 2.0 * np.pi, 3)

    def path(t: float) -> tuple[float, float]:
        angles = FREQUENCIES * t + phases
        return float(sizes @ np.sin(angles)), float((sizes * FREQUENCIES) @ np.cos(angles))

    count, h = round(seconds / STEP), STEP / SUBSTEPS
    x, v = path(0.0)
    filtered, rows = v, np.empty((count, 3))
    for i in range(count):
        wanted, speed = path(i * STEP)
        torque = 60.0 * (wanted - x) + 20.0 * (speed - v)
        rows[i] = torque, x, filtered
        for _ in range(SUBSTEPS):
            friction = FRICTION * (1.0 + 0.3 * np.sin(9.0 * x)) * np.tanh(v / 0.004)
            v += h * (torque - DAMPING * v - friction - GRAVITY * np.sin(x + TILT)) / INERTIA
            x += h * v
            filtered += h * (v - filtered) / LAG
    rows += np.array([1e-2, 2e-5, 2e-4]) * rng.standard_normal(rows.shape)
    signals = dict(zip(("force", "position", "velocity"), rows.T, strict=True))
    return Recording(np.arange(count) * STEP, signals)


class Joint(Machine):
    """Inertia and damping, and no spring: gravity's pull is nothing that it has."""

    inputs = (Signal("force", "N m"),)
    states = (Signal("position", "rad"), Signal("velocity", "rad/s"))
    outputs = (Signal("position", "rad", noise=1e-4), Signal("velocity", "rad/s", noise=1e-3))
    inertia = number("kg m2", 5.0, 0.1, 100.0)
    damping = number("N m s", 2.0, 0.0, 100.0)
    forces = (Force("velocity", "position"),)
    effects = (
        *actuator("force"),
        *force("velocity"),
        *force("velocity", ("linear_stiffness",)),
        *sensor("position"),
        *sensor("velocity", ("gain", "bias", "delay", "lag"), prefix="velocity_"),
    )

    def derivative(self, state, input, p):
        """Newton's equation."""
        return state.velocity, (input.force - p.damping * state.velocity) / p.inertia


@pytest.mark.matrix(keep=("1",))
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_slow_record_has_windows_enough_to_name_a_velocity_that_is_filtered(seed: int):
    """With windows as long as the joint is slow there were 16 to 23, and two of three were unknown."""
    diagnosis = diagnose(get_model("rig"), [record(seed)], [record(seed + 50)])
    causes = {cause.effect: cause for cause in diagnosis.causes}
    assert "velocity_lag" in causes
    assert not causes["velocity_lag"].alternatives
    told = causes["velocity_lag"].parameters["time_constant"]
    assert told.value == pytest.approx(LAG, abs=min(3.0 * told.std, 0.02))


@pytest.mark.nightly
def test_gravity_on_what_has_no_spring_is_a_linear_stiffness_and_no_stop():
    diagnosis = diagnose(Joint(), [record(2)], [record(52)])
    causes = {cause.effect: cause for cause in diagnosis.causes}
    assert causes.keys() == {"linear_stiffness", "velocity_lag"}
    pull = causes["linear_stiffness"].parameters["coefficient"]
    # Of the rate of the velocity, as the joint has no force of its own; the slope at the middle of the way.
    assert pull.value == pytest.approx(GRAVITY * np.cos(TILT) / INERTIA, abs=2.0 * pull.std)
