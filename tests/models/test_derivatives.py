"""Derivatives that the driver carries, against extrapolated central differences of what it simulates."""

import math
from zlib import crc32

import numpy as np
import pytest

from fieldmodels.effects import actuator, change, curve, force, sensor
from fieldmodels.effects.curves import Curve
from fieldmodels.effects.sensors import LIBRARY
from fieldmodels.machine import Force, Machine, number
from fieldmodels.model import Effect, Model, Parameter, Signal
from fieldmodels.recording import Recording, Windows
from fieldmodels.registry import get_model

STEP, COUNT, SAMPLES = 0.01, 90, 40


class Axis(Machine):
    """An axis with all stock effects, curves at all places, an own effect, an inertia that is a method."""

    inputs = (Signal("push", "N"),)
    states = outputs = (Signal("place", "m"), Signal("speed", "m/s"))
    mass = number("kg", 1.3, 0.1, 10.0)
    damping = number("N s/m", 1.1, 0.0, 10.0)
    stiffness = number("N/m", 9.0, 0.0, 100.0)
    forces = (Force("speed", "place", "N", "moved", name="force"),)
    effects = (
        *actuator("push"),
        *force("speed"),
        *sensor("place", tuple(LIBRARY)),
        *change("stiffness"),
        *curve("actuator", "push"),
        *curve("force", "speed"),
        *curve("force", "speed", over=("place", "speed")),
        *curve("sensor", "place"),
        *curve("parameter", "damping", over="speed"),
        Effect("cargo", "Cargo is on it.", "force", (Parameter("mass", "kg", 0.0, 0.0, 9.0, 0.1),)),
    )

    def moved(self, p):
        return p.mass + p.cargo_mass

    def derivative(self, state, input, p):
        left = input.push - p.damping * state.speed - p.stiffness * math.sin(state.place)
        return state.speed, left / (p.mass + p.cargo_mass)


class Cart(Machine):
    """Two commands, three states, declared by what it does in a step; an output that is no state."""

    inputs = (Signal("push", "N"), Signal("turn", "N m"))
    states = (Signal("speed", "m/s"), Signal("angle", "rad"), Signal("rate", "rad/s"))
    outputs = (Signal("speed", "m/s"), Signal("sideways", "m/s^2"))
    drag = number("1/s", 1.7, 0.0, 10.0)
    inertia = number("kg m^2", 0.31, 0.01, 10.0)
    forces = (Force("speed"), Force("rate", "angle", "N m", "inertia", input="turn"))
    effects = (
        *actuator("push"),
        *actuator("turn", prefix="turn_"),
        *force("speed", ("coulomb_friction", "viscous_friction"), prefix="drive_"),
        *force("rate"),
        *sensor("sideways", without=("quantisation",)),
    )
    substeps = 2

    def step(self, state, input, p, dt):
        kept = math.exp(-p.drag * dt)
        rate = state.rate + dt * (input.turn - 0.4 * state.rate - math.sin(state.angle)) / p.inertia
        angle = state.angle + 0.5 * dt * (state.rate + rate)
        return state.speed * kept + (1.0 - kept) / p.drag * input.push, angle, rate

    derivative = None

    def observe(self, state, p):
        return state.speed, state.speed * state.rate


class Unknown(Machine):
    """What dual numbers do not know."""

    inputs = (Signal("push", "N"),)
    states = outputs = (Signal("speed", "m/s"),)
    drag = number("1/s", 1.7, 0.0, 10.0)

    def derivative(self, state, input, p):
        return input.push - math.lgamma(1.0 + (p.drag * state.speed) ** 2)


MACHINES = {"rig": None, "pendulum": None, "propeller_arm": None, "servo": None, "axis": Axis, "cart": Cart}
SIZES = {
    "rig": (8.0, (0.05, 0.3)),
    "pendulum": (0.8, (0.5, 2.0)),
    "propeller_arm": (0.3, (0.5, 2.0)),
    "servo": (0.5, (0.5, 2.0)),
    "axis": (3.0, (0.3, 0.8)),
    "cart": (1.0, (0.5, 0.5, 1.0)),
    "unknown": (1.0, (0.4,)),
}
"""Command, and states, of each machine."""


def model_of(name):
    return MACHINES[name]() if MACHINES[name] else get_model(name)


def windows_of(model, seed):
    """Three windows of random commands, from states of the usual sizes."""
    rng = np.random.default_rng(crc32(seed.encode()))
    size, states = SIZES[model.name]
    signals = {s.name: np.repeat(size * rng.uniform(-1, 1, COUNT), 7)[:COUNT] for s in model.inputs}
    signals |= {s.name: rng.uniform(-1, 1, COUNT) for s in model.outputs}
    return Windows(
        recording=Recording(time=np.arange(COUNT) * STEP, signals=signals),
        starts=np.array([0, 11, 37]),
        lengths=np.array([SAMPLES, SAMPLES - 3, SAMPLES]),
        states=np.column_stack([x * rng.uniform(0.3, 1.0, 3) for x in states]),
        observed=np.ones((3, SAMPLES, len(model.outputs)), dtype=np.bool_),
    )


def extrapolated(outputs, width):
    """Central differences over widths that halve, extrapolated to none; ``outputs`` of a shift."""
    a, b, c = ((outputs(h) - outputs(-h)) / (2.0 * h) for h in (width, 0.5 * width, 0.25 * width))
    first, second = (4.0 * b - a) / 3.0, (4.0 * c - b) / 3.0
    return (16.0 * second - first) / 15.0


def value_of(p, k, curved):
    """A value at which an effect acts, off whole samples and the like."""
    if curved:
        return p.nominal if not p.refitted else 0.3 * math.sin(1.0 + k)
    if p.name in ("time_constant", "delay"):
        return 3.37 * STEP
    if p.name == "time":
        return 0.3137
    return p.starts[len(p.starts) // 2] if p.starts else p.nominal + p.scale


def acting(model, *effects):
    """A vector with some effects acting, and all their parameters with the base ones'."""
    curved = {e.name for e in getattr(model, "stock", ()) if isinstance(e, Curve)}
    values = {
        name: {p.name: value_of(p, k, name in curved) for k, p in enumerate(model.effect(name).parameters)}
        for name in effects
    }
    free = [*range(len(model.parameters))]
    for name in effects:
        part = model.slice_of(name)
        free += range(part.start, part.stop)
    return model.vector(effects=values), free


def assert_agree(exact, outputs, width, what):
    """To 1e-6 of the largest and the differences' rounding, at one of two widths: a bend may lie in one."""
    errors, largest = [], float(np.nanmax(np.abs(outputs(0.0))))
    for h in (width, 0.1 * width):
        differences = extrapolated(outputs, h)
        assert np.array_equal(np.isfinite(exact), np.isfinite(differences)), what
        allowed = 1e-6 * float(np.nanmax(np.abs(differences))) + 1e-14 * largest / h
        errors.append(np.abs(exact - differences) / allowed)
    assert float(np.nanmax(np.minimum(*errors))) < 1.0, what


def check(model, vector, free, windows):
    outputs, by_parameters, by_states = model.simulate_with_derivatives(vector, windows, free)
    np.testing.assert_allclose(outputs, model.simulate(vector[None], windows)[0], rtol=0.0, atol=1e-13)
    for k, i in enumerate(free):
        unit = np.eye(len(vector))[i]

        def moved(h, unit=unit):
            return model.simulate((vector + h * unit)[None], windows)[0]

        assert_agree(by_parameters[..., k], moved, 1e-4 * (abs(vector[i]) or 1.0), model.names[i])
    for j, size in enumerate(SIZES[model.name][1]):
        unit = np.eye(len(model.states))[j]

        def started(h, unit=unit):
            return model.simulate(vector[None], windows.with_states(windows.states + h * unit))[0]

        assert_agree(by_states[..., j], started, 1e-4 * size, model.states[j].name)


CASES = [
    (name, effect.name)
    for name in MACHINES
    for effect in model_of(name).effects
    if not effect.name.endswith("quantisation") and effect.name != "thrust_curve"
]


@pytest.mark.matrix(
    keep=(
        "held-pendulum-coulomb_friction",
        "interpolated-rig-actuator_saturation",
    )
)
@pytest.mark.parametrize(("name", "effect"), CASES)
@pytest.mark.parametrize("hold", ["held", "interpolated"])
def test_every_stock_effect(name, effect, hold):
    model = model_of(name)
    model.hold = hold
    vector, free = acting(model, effect)
    check(model, vector, free, windows_of(model, name + effect))


PAIRS = [
    ("rig", "coulomb_friction", "actuator_lag"),
    ("rig", "hysteresis", "actuator_rate_limit"),
    ("rig", "actuator_rate_limit", "actuator_lag"),
    ("pendulum", "coulomb_friction", "actuator_delay"),
    ("axis", "sensor_delay", "stribeck_friction"),
    ("axis", "stiffness_drift", "coulomb_friction"),
    ("axis", "sensor_lag", "actuator_delay"),
    ("cart", "turn_lag", "drive_coulomb_friction"),
]


@pytest.mark.parametrize("case", PAIRS, ids="+".join)
def test_effects_together(case):
    name, *effects = case
    model = model_of(name)
    vector, free = acting(model, *effects)
    check(model, vector, free, windows_of(model, "".join(case)))


@pytest.mark.parametrize(
    ("effect", "parameter"),
    [
        ("coulomb_friction", "force"), ("hysteresis", "force"), ("cogging", "sine"), ("payload", "mass"),
        ("actuator_lag", "time_constant"), ("actuator_delay", "delay"), ("actuator_gain", "gain"),
        ("actuator_dead_zone", "width"), ("sensor_delay", "delay"), ("backlash", "gap"),
        ("periodic_force", "cosine"),
    ],
)  # fmt: skip
def test_beside_neutral_it_is_that_of_the_side_on_which_the_effect_acts(effect, parameter):
    model = get_model("rig")
    windows = windows_of(model, effect)
    i = model.index(f"{effect}.{parameter}")
    vector = model.nominal
    outputs, columns, _ = model.simulate_with_derivatives(vector, windows, [i])
    np.testing.assert_array_equal(outputs, model.simulate(vector[None], windows)[0])
    small = 1e-5 * model.all_parameters[i].scale
    batch = vector + np.outer([2e-4 * small, small, 2.0 * small], np.eye(len(vector))[i])
    near, one, two = model.simulate(batch, windows)
    forward = (4.0 * (one - near) - (two - near)) / (2.0 * small)
    np.testing.assert_allclose(columns[..., 0], forward, atol=3e-3 * float(np.nanmax(np.abs(forward))))


def test_more_directions_than_go_at_once_are_the_same_ones():
    model = get_model("rig")
    windows = windows_of(model, "many")
    vector, _ = acting(model, "coulomb_friction", "actuator_lag", "sensor_gain", "constant_force")
    several = (
        "coulomb_friction",
        "actuator_lag",
        "sensor_gain",
        "constant_force",
        "quadratic_drag",
        "payload",
    )
    many = [*range(3), *(model.index(name) for name in model.names if name.split(".")[0] in several)]
    _, together, by_states = model.simulate_with_derivatives(vector, windows, many)
    assert together.shape[-1] + by_states.shape[-1] > 8
    for k, i in enumerate(many):
        _, alone, again = model.simulate_with_derivatives(vector, windows, [i])
        np.testing.assert_allclose(alone[..., 0], together[..., k], rtol=1e-6, atol=1e-12)
        np.testing.assert_allclose(again, by_states, rtol=1e-6, atol=1e-9)


@pytest.mark.matrix(
    keep=(
        "rig-sensor_quantisation",
        "propeller_arm-thrust_curve",
    )
)
@pytest.mark.parametrize(
    ("name", "effect"), [("rig", "sensor_quantisation"), ("propeller_arm", "thrust_curve"), ("unknown", "")]
)
def test_differences_take_their_place(name, effect):
    model = Unknown() if name == "unknown" else get_model(name)
    vector, free = acting(model, *([effect] if effect else []))
    windows = windows_of(model, name)
    found = model.simulate_with_derivatives(vector, windows, free)
    differences = Model.simulate_with_derivatives(model, vector, windows, free)
    for a, b in zip(found, differences, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-3 * float(np.nanmax(np.abs(b))))
    np.testing.assert_array_equal(found[1][..., -1], differences[1][..., -1])
