"""Forces on masses that are coupled by the machine's own place, against SciPy with the full mass matrix."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fieldmodels.drivers.batch import BatchDriver
from fieldmodels.effects import curve, force
from fieldmodels.machine import Force, Machine, number
from fieldmodels.model import ModelError, Signal
from fieldmodels.recording import Recording

TROLLEY, LOAD, CABLE, GRAVITY, STEP, COUNT = 6.0, 4.0, 0.8, 9.81, 0.01, 300


class Crane(Machine):
    """A load swings far (a radian) below a trolley that is hardly heavier."""

    inputs = (Signal("push", "N"),)
    states = (Signal("place", "m"), Signal("speed", "m/s"), Signal("angle", "rad"), Signal("rate", "rad/s"))
    outputs = (Signal("place", "m"), Signal("angle", "rad"))
    mass = number("kg", TROLLEY, 1.0, 100.0)
    forces = (Force("speed", "place", unit="N", inertia="pushed", also={"rate": "swing"}),)
    effects = force("speed") + curve("force", "speed")

    def pushed(self, state, p):
        return p.mass + LOAD * np.sin(state.angle) ** 2

    def swing(self, state, p):
        return -np.cos(state.angle) / (CABLE * (p.mass + LOAD * np.sin(state.angle) ** 2))

    def derivative(self, state, input, p):
        s, c = np.sin(state.angle), np.cos(state.angle)
        pulled = LOAD * s * (CABLE * state.rate**2 + GRAVITY * c)
        speeding = (input.push + pulled) / (p.mass + LOAD * s * s)
        return state.speed, speeding, state.rate, -(speeding * c + GRAVITY * s) / CABLE


class Braked(Crane):
    """Friction in the hook as well, which holds both at times."""

    forces = (
        *Crane.forces,
        Force("rate", "angle", unit="N m", inertia="turned", also={"speed": "recoil"}),
    )
    effects = force("speed", ("coulomb_friction",)) + force("rate", ("coulomb_friction",), prefix="hook_")

    def turned(self, state, p):
        return LOAD * CABLE**2 * (p.mass + LOAD * np.sin(state.angle) ** 2) / (p.mass + LOAD)

    def recoil(self, state, p):
        return -np.cos(state.angle) / (CABLE * (p.mass + LOAD * np.sin(state.angle) ** 2))


class Stepped(Crane):
    derivative = None
    substeps = 8

    def step(self, state, input, p, dt):
        s, c = np.sin(state.angle), np.cos(state.angle)
        pulled = LOAD * s * (CABLE * state.rate**2 + GRAVITY * c)
        speeding = (input.push + pulled) / (p.mass + LOAD * s * s)
        speed = state.speed + dt * speeding
        rate = state.rate - dt * (speeding * c + GRAVITY * s) / CABLE
        return state.place + dt * speed, speed, state.angle + dt * rate, rate


TIME = STEP * np.arange(COUNT)
PUSH = 15.0 * np.sin(3.0 * TIME) + 5.0
START = (0.1, 0.4, 1.0, -1.5)


def simulated(machine, start, effects, push=PUSH):
    recording = Recording(TIME, {"push": push, "place": np.zeros(COUNT), "angle": np.zeros(COUNT)})
    windows = machine.windows(recording, STEP * (COUNT - 1))
    windows = replace(windows, states=np.tile(start, (len(windows), 1)))
    return machine.simulate(machine.vector(effects=effects)[None], windows)[0, 0]


def reference(start, extra, push=PUSH):
    """SciPy's solution of M(angle) a = forces, with what acts on the trolley and in the hook beside."""

    def rates(t, y, command):
        x, v, a, w = y
        cross = LOAD * CABLE * np.cos(a)
        masses = np.array([[TROLLEY + LOAD, cross], [cross, LOAD * CABLE**2]])
        own = np.array([command + LOAD * CABLE * np.sin(a) * w**2, -LOAD * GRAVITY * CABLE * np.sin(a)])
        accelerations = np.linalg.solve(masses, own + np.array(extra(x, v, a, w)))
        return [v, accelerations[0], w, accelerations[1]]

    y, out = np.array(start, dtype=float), []
    for t, command in zip(TIME, push, strict=True):
        out.append(y[[0, 2]])
        y = solve_ivp(
            rates, (t, t + STEP), y, "LSODA", args=(command,), rtol=1e-9, atol=1e-11, max_step=STEP / 4
        ).y[:, -1]
    return np.array(out)


@pytest.mark.every(
    ("effects", "extra"),
    [
        ({}, lambda x, v, a, w: (0.0, 0.0)),
        ({"constant_force": {"force": 9.0}}, lambda x, v, a, w: (9.0, 0.0)),
        ({"cubic_stiffness": {"coefficient": 30.0}}, lambda x, v, a, w: (-30.0 * x**3, 0.0)),
        ({"quadratic_drag": {"coefficient": 5.0}}, lambda x, v, a, w: (-5.0 * v * abs(v), 0.0)),
        (
            {"speed_curve": {"low": -9, "high": 9} | {f"value_{i + 1}": 36 * i / 7 - 18 for i in range(8)}},
            lambda x, v, a, w: (2.0 * v, 0.0),
        ),
        ({"coulomb_friction": {"force": 6.0}}, lambda x, v, a, w: (-6.0 * np.tanh(v / 1e-4), 0.0)),
        (
            {"coulomb_friction": {"force": 4.0}, "quadratic_drag": {"coefficient": 3.0}},
            lambda x, v, a, w: (-4.0 * np.tanh(v / 1e-4) - 3.0 * v * abs(v), 0.0),
        ),
    ],
)  # fmt: skip
def test_the_load_swings_as_scipy_says(effects, extra):
    np.testing.assert_allclose(simulated(Crane(), START, effects), reference(START, extra), atol=3e-3)


def pendulum(angle):
    """A load that hangs from what stands still."""
    found = solve_ivp(
        lambda t, y: [y[1], -GRAVITY / CABLE * np.sin(y[0])], (0.0, TIME[-1]), [angle, 0.0], t_eval=TIME,
        rtol=1e-10, atol=1e-12,
    )  # fmt: skip
    return found.y[0]


@pytest.mark.matrix(
    keep=(
        "Crane-coulomb_friction",
        "Crane-stribeck_friction",
    )
)
@pytest.mark.parametrize(
    ("machine", "effect"),
    [(Crane, "coulomb_friction"), (Crane, "stribeck_friction"), (Braked, "coulomb_friction")],
)
def test_below_a_trolley_that_friction_holds_the_load_swings_as_a_pendulum(machine, effect):
    values = {"force": 400.0} | ({"velocity": 0.1} if effect == "stribeck_friction" else {})
    found = simulated(machine(), (0.2, 0.0, 1.0, 0.0), {effect: values})
    np.testing.assert_allclose(found[:, 0], 0.2, atol=1e-9)
    np.testing.assert_allclose(found[:, 1], pendulum(1.0), atol=2e-4)


def test_frictions_of_both_oppose_both():
    effects = {"coulomb_friction": {"force": 4.0}, "hook_coulomb_friction": {"torque": 1.0}}
    extra = lambda x, v, a, w: (-4.0 * np.tanh(v / 1e-4), -np.tanh(w / 1e-4))  # noqa: E731
    np.testing.assert_allclose(simulated(Braked(), START, effects), reference(START, extra), atol=3e-3)


@pytest.mark.matrix(keep=("{'coulomb_friction': {'force': 6.0}}",))
@pytest.mark.parametrize(
    "effects", [{"constant_force": {"force": 9.0}}, {"coulomb_friction": {"force": 6.0}}], ids=str
)
def test_a_step_of_ones_own_is_pushed_at_both_ends(effects):
    expected = simulated(Crane(), START, effects)
    np.testing.assert_allclose(simulated(Stepped(), START, effects), expected, atol=0.05)


@pytest.mark.nightly
def test_an_environment_swings_alike():
    machine = Crane()
    effects = {"coulomb_friction": {"force": 6.0}, "constant_force": {"force": 3.0}}
    batch = BatchDriver(machine, machine.vector(effects=effects)[None], STEP, 20.0)
    batch.begin([0], np.array([START]))
    found = []
    for command in PUSH:
        found.append(batch.states[0, [0, 2]].copy())
        batch.advance(np.array([[command]]))
    np.testing.assert_allclose(found, simulated(machine, START, effects), atol=1e-4)


def test_arguments_that_no_inertia_takes_are_said():
    class Wrong(Crane):
        def pushed(self, state, input, p):
            return p.mass

    with pytest.raises(ModelError, match=r"Wrong\.pushed, line .*handed \(self, p\) or \(self, state, p\)"):
        simulated(Wrong(), START, {})
