"""A force on one of two masses that are coupled moves the other, too, also where friction holds the first."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fieldmodels.effects import curve, force
from fieldmodels.machine import Force, Machine, number
from fieldmodels.model import ModelError, Signal
from fieldmodels.recording import Recording

HEAVY, CROSS, LIGHT, SPRING, STEP, COUNT = 3.0, 0.8, 0.5, 6.0, 0.01, 300
MASSES = np.array([[HEAVY, CROSS], [CROSS, LIGHT]])
"""HEAVY v' + CROSS w' = force + friction, CROSS v' + LIGHT w' = -SPRING a."""


class Trolley(Machine):
    inputs = (Signal("force", "N"),)
    states = (Signal("place", "m"), Signal("speed", "m/s"), Signal("angle", "rad"), Signal("rate", "rad/s"))
    outputs = (Signal("place", "m"), Signal("angle", "rad"))
    light = number("kg m^2", LIGHT, 0.1, 1.0)
    forces = (Force("speed", "place", unit="N", inertia="lone", also={"rate": "swing"}),)
    effects = force("speed") + curve("force", "speed")

    def lone(self, p):
        return HEAVY - CROSS**2 / p.light

    def swing(self, p):
        return -CROSS / (HEAVY * p.light - CROSS**2)

    def derivative(self, state, input, p):
        determinant = HEAVY * p.light - CROSS**2
        pull = -SPRING * state.angle
        return (
            state.speed,
            (p.light * input.force - CROSS * pull) / determinant,
            state.rate,
            (HEAVY * pull - CROSS * input.force) / determinant,
        )


class Braked(Trolley):
    """Friction in the joint as well, which holds both at times."""

    forces = (
        *Trolley.forces,
        Force("rate", "angle", unit="N m", inertia="joint", also={"speed": "recoil"}),
    )
    effects = force("speed", ("coulomb_friction",)) + force("rate", ("coulomb_friction",), prefix="joint_")

    def joint(self, p):
        return p.light - CROSS**2 / HEAVY

    def recoil(self, p):
        return -CROSS / (HEAVY * p.light - CROSS**2)


TIME = STEP * np.arange(COUNT)
FORCE = 4.0 * np.sin(3.0 * TIME) + 1.5


def simulated(machine, start, effects, force=FORCE):
    recording = Recording(TIME, {"force": force, "place": np.zeros(COUNT), "angle": np.zeros(COUNT)})
    windows = machine.windows(recording, STEP * (COUNT - 1))
    windows = replace(windows, states=np.tile(start, (len(windows), 1)))
    return machine.simulate(machine.vector(effects=effects)[None], windows)[0, 0]


def reference(start, extra, force=FORCE):
    """SciPy's solution, with what acts on the trolley and in the joint beside the command."""

    def rates(t, y, command):
        acting = np.array([command, -SPRING * y[2]]) + np.array(extra(t, *y))
        accelerations = np.linalg.solve(MASSES, acting)
        return [y[1], accelerations[0], y[3], accelerations[1]]

    y, out = np.array(start, dtype=float), []
    for t, command in zip(TIME, force, strict=True):
        out.append(y[[0, 2]])
        y = solve_ivp(
            rates, (t, t + STEP), y, "LSODA", args=(command,), rtol=1e-9, atol=1e-11, max_step=STEP / 4
        ).y[:, -1]
    return np.array(out)


START = (0.1, 0.4, 0.3, -0.5)


@pytest.mark.every(
    ("effects", "extra"),
    [
        ({"constant_force": {"force": 2.0}}, lambda t, x, v, a, w: (2.0, 0.0)),
        ({"cubic_stiffness": {"coefficient": 3.0}}, lambda t, x, v, a, w: (-3.0 * x**3, 0.0)),
        ({"quadratic_drag": {"coefficient": 3.0}}, lambda t, x, v, a, w: (-3.0 * v * abs(v), 0.0)),
        (
            {"speed_curve": {"low": -5.0, "high": 5.0} | {f"value_{i + 1}": 6 * i / 7 - 3 for i in range(8)}},
            lambda t, x, v, a, w: (0.6 * v, 0.0),
        ),
        ({"coulomb_friction": {"force": 2.5}}, lambda t, x, v, a, w: (-2.5 * np.tanh(v / 1e-4), 0.0)),
        (
            {"coulomb_friction": {"force": 1.0}, "quadratic_drag": {"coefficient": 1.0}},
            lambda t, x, v, a, w: (-np.tanh(v / 1e-4) - v * abs(v), 0.0),
        ),
    ],
)  # fmt: skip
def test_both_masses_move_as_scipy_says(effects, extra):
    np.testing.assert_allclose(simulated(Trolley(), START, effects), reference(START, extra), atol=1e-3)


@pytest.mark.every("effect", ["coulomb_friction", "stribeck_friction"])
def test_what_friction_holds_swings_the_other_about_it(effect):
    """The trolley stands: the angle swings by its own inertia alone, whatever the force."""
    values = {"force": 40.0} | ({"velocity": 0.1} if effect == "stribeck_friction" else {})
    found = simulated(Trolley(), (0.2, 0.0, 0.3, 0.0), {effect: values})
    np.testing.assert_allclose(found[:, 0], 0.2, atol=1e-9)
    np.testing.assert_allclose(found[:, 1], 0.3 * np.cos(np.sqrt(SPRING / LIGHT) * TIME), atol=1e-5)


@pytest.mark.nightly
def test_frictions_of_both_oppose_both():
    effects = {"coulomb_friction": {"force": 1.0}, "joint_coulomb_friction": {"torque": 0.4}}
    found = simulated(Braked(), START, effects)
    expected = reference(START, lambda t, x, v, a, w: (-np.tanh(v / 1e-4), -0.4 * np.tanh(w / 1e-4)))
    np.testing.assert_allclose(found, expected, atol=1e-3)


def test_what_stands_stays_where_the_other_slides():
    """The joint's friction pushes against the trolley, which its own friction holds."""
    effects = {"coulomb_friction": {"force": 60.0}, "joint_coulomb_friction": {"torque": 0.4}}
    found = simulated(Braked(), (0.2, 0.0, 0.3, 0.0), effects)
    np.testing.assert_allclose(found[:, 0], 0.2, atol=1e-9)
    assert np.ptp(found[:, 1]) > 0.3


@pytest.mark.nightly
def test_a_step_of_ones_own_is_pushed_at_both_ends():
    class Stepped(Trolley):
        derivative = None
        substeps = 8

        def step(self, state, input, p, dt):
            determinant = HEAVY * p.light - CROSS**2
            pull = -SPRING * state.angle
            speed = state.speed + dt * (p.light * input.force - CROSS * pull) / determinant
            rate = state.rate + dt * (HEAVY * pull - CROSS * input.force) / determinant
            return state.place + dt * speed, speed, state.angle + dt * rate, rate

    for effects in ({"constant_force": {"force": 2.0}}, {"coulomb_friction": {"force": 1.0}}):
        expected = simulated(Trolley(), START, effects)
        np.testing.assert_allclose(simulated(Stepped(), START, effects), expected, atol=0.05)
    held = simulated(Stepped(), (0.2, 0.0, 0.3, 0.0), {"coulomb_friction": {"force": 60.0}})
    np.testing.assert_allclose(held[:, 1], 0.3 * np.cos(np.sqrt(SPRING / LIGHT) * TIME), atol=0.01)


@pytest.mark.every(
    ("also", "says"),
    [
        ({"ratio": "swing"}, "no other state 'ratio' .did you mean 'rate'"),
        ({"speed": "swing"}, "no other state 'speed'"),
        ({"rate": "swign"}, "no number or method 'swign' for an effect of a force"),
    ],
)
def test_what_it_cannot_move_is_said(also, says):
    class Wrong(Trolley):
        forces = (Force("speed", "place", unit="N", inertia="lone", also=also),)

    with pytest.raises(ModelError, match=says):
        Wrong().vector()
