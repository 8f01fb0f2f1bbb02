"""Where windows start if no sensor shows a state by its name: what the equations tell, against the truth."""

import math

import numpy as np
import pytest

from fieldmodels.contract import ModelWarning, check_simulation
from fieldmodels.effects import force
from fieldmodels.machine import Force, Machine, number
from fieldmodels.model import Signal
from fieldmodels.recording import Recording

pytestmark = pytest.mark.filterwarnings("error")
STEP = 0.01
TIME = STEP * np.arange(800)
AT = np.arange(0, len(TIME), 9)
INSIDE = AT[1:-1]
"""Away from the ends, where a slope is that of a curve at its end."""


def recorded(**signals):
    return Recording(TIME, {name: np.broadcast_to(values, TIME.shape) for name, values in signals.items()})


class Crane(Machine):
    """In the coordinates of the hall, of which a sensor shows the angle between trolley and load."""

    inputs = (Signal("force", "N"),)
    states = (
        Signal("trolley", "m"),
        Signal("speed", "m/s"),
        Signal("load", "m"),
        Signal("load_speed", "m/s"),
    )
    outputs = (Signal("trolley", "m"), Signal("angle", "rad"))
    mass = number("kg", 10.0, 1.0, 100.0)
    cable = number("m", 0.8, 0.1, 5.0)
    forces = (Force("speed", "trolley", unit="N", inertia="mass"),)
    effects = force("speed", ("coulomb_friction",))

    def derivative(self, state, input, p):
        pull = 40.0 * math.tan(math.asin((state.load - state.trolley) / p.cable))
        return state.speed, (input.force + pull) / p.mass, state.load_speed, -pull / 4.0

    def observe(self, state, p):
        return state.trolley, math.asin((state.load - state.trolley) / p.cable)


@pytest.mark.every("middle", [0.0, 3.0])
def test_a_load_starts_where_the_angle_shows_it(middle):
    """3 m from where its states are 0, a load at 0 would hang at no angle at all."""
    trolley, angle = middle + 0.5 * np.sin(TIME), 0.3 * np.cos(2.0 * TIME + 1.0)
    data = recorded(force=0.0, trolley=trolley, angle=angle)
    found = Crane().initial_states(data, INSIDE)
    load = trolley + 0.8 * np.sin(angle)
    rate = 0.5 * np.cos(TIME) - 0.8 * np.cos(angle) * 0.6 * np.sin(2.0 * TIME + 1.0)
    np.testing.assert_allclose(found[:, 2], load[INSIDE], atol=1e-5)
    np.testing.assert_allclose(found[:, 3], rate[INSIDE], atol=2e-3)
    assert not Crane().unseen(data)


def test_an_angle_no_load_can_hang_at_takes_the_nearest():
    """A sensor that shows nonsense at times (a quarter of a turn and more) spoils no other start."""
    angle = 0.3 * np.cos(2.0 * TIME)
    broken = np.where((TIME > 3.0) & (TIME < 3.5), 2.0, angle)
    found = Crane().initial_states(recorded(force=0.0, trolley=1.0, angle=broken), INSIDE)
    good = (TIME[INSIDE] < 2.9) | (TIME[INSIDE] > 3.6)
    np.testing.assert_allclose(found[good, 2], 1.0 + 0.8 * np.sin(angle[INSIDE][good]), atol=1e-5)
    assert np.isfinite(found).all()


class Cart(Machine):
    """A robot that has mass: no sensor shows its speed, but its place changes by it along the heading."""

    inputs = (Signal("push", "N"), Signal("twist", "N m"))
    states = (
        Signal("x", "m"), Signal("y", "m"), Signal("heading", "rad"), Signal("speed", "m/s"),
        Signal("turn", "rad/s"),
    )  # fmt: skip
    outputs = (Signal("x", "m"), Signal("y", "m"), Signal("heading", "rad"))
    mass = number("kg", 3.0, 1.0, 100.0)

    def derivative(self, state, input, p):
        ahead, aside = math.cos(state.heading), math.sin(state.heading)
        return state.speed * ahead, state.speed * aside, state.turn, input.push / p.mass, input.twist


class SteppedCart(Cart):
    derivative = None

    def step(self, state, input, p, dt):
        x = state.x + dt * state.speed * math.cos(state.heading)
        y = state.y + dt * state.speed * math.sin(state.heading)
        turned = state.heading + dt * state.turn
        return x, y, turned, state.speed + dt * input.push / p.mass, state.turn + dt * input.twist


@pytest.mark.every("machine", [Cart, SteppedCart])
def test_a_robot_starts_as_fast_as_its_place_changes(machine):
    """On a circle of radius 2 m, backwards."""
    around = 0.4 * TIME
    data = recorded(
        push=0.0, twist=0.0, x=2 * np.cos(around), y=2 * np.sin(around), heading=around - np.pi / 2
    )
    found = machine().initial_states(data, INSIDE)
    np.testing.assert_allclose(found[:, 3], -0.8, atol=2e-3)
    np.testing.assert_allclose(found[:, 4], 0.4, atol=1e-3)


class Oven(Machine):
    """A sensor shows volts by the air's temperature; how fast they change shows the wall's, but no room's."""

    inputs = (Signal("heat", "W"),)
    states = (Signal("air", "K"), Signal("wall", "K"), Signal("room", "K"))
    outputs = (Signal("volts", "V"),)
    capacity = number("J/K", 900.0, 1.0, 1e6)

    def derivative(self, state, input, p):
        through = 14.0 * (state.air - state.wall)
        return (input.heat - through) / p.capacity, (through - 2.0 * (state.wall - state.room)) / 5e3, 0.0

    def observe(self, state, p):
        return 0.01 * state.air - 2.0


def test_a_wall_is_told_by_how_fast_the_air_cools():
    """Its room, which only the wall feels, is not: that is said."""
    air, heat = 300.0 + 5.0 * np.sin(0.5 * TIME), 200.0
    data = recorded(heat=heat, volts=0.01 * air - 2.0)
    oven = Oven()
    found = oven.initial_states(data, INSIDE)
    wall = air - (heat - 900.0 * 2.5 * np.cos(0.5 * TIME)) / 14.0
    np.testing.assert_allclose(found[:, 0], air[INSIDE], atol=1e-4)
    np.testing.assert_allclose(found[:, 1], wall[INSIDE], atol=0.05)
    assert not found[:, 2].any()
    assert oven.unseen(data) == ("room",)
    with pytest.warns(ModelWarning, match="no sensor tells where the state 'room' starts: .*initial_states"):
        check_simulation(oven, data)


class Twice(Oven):
    """A second sensor of the air, which is not always there."""

    outputs = (*Oven.outputs, Signal("ohms", "Ohm"))

    def observe(self, state, p):
        return 0.01 * state.air - 2.0, 100.0 + 0.4 * (state.air - 273.0)


def test_where_one_sensor_has_a_gap_the_other_tells():
    air = 300.0 + 5.0 * np.sin(0.5 * TIME)
    ohms = np.where((TIME > 3.0) & (TIME < 4.0), np.nan, 100.0 + 0.4 * (air - 273.0))
    found = Twice().initial_states(recorded(heat=200.0, volts=0.01 * air - 2.0, ohms=ohms), INSIDE)
    np.testing.assert_allclose(found[:, 0], air[INSIDE], atol=1e-4)


class Doubted(Oven):
    """Who says how far from 0 a state may start knows that no sensor tells."""

    states = (*Oven.states[:2], Signal("room", "K", noise=300.0))


class Guessed(Oven):
    def initial_states(self, recording, starts):
        states = super().initial_states(recording, starts)
        states[:, 2] = 290.0
        return states


@pytest.mark.every("machine", [Guessed, Doubted])
def test_a_start_of_ones_own_is_no_unseen_one(machine):
    assert not machine().unseen(recorded(heat=0.0, volts=1.0))


def test_what_shows_nothing_tells_nothing():
    class Blind(Oven):
        def observe(self, state, p):
            return math.sqrt(-1.0 - state.air**2)

    data = recorded(heat=0.0, volts=1.0)
    assert not Blind().initial_states(data, AT).any()
    assert Blind().unseen(data) == ("air", "wall", "room")


class Fan(Machine):
    """A motor whose temperature is logged, and used by no equation."""

    inputs = (Signal("current", "A"), Signal("temperature", "K"))
    states = outputs = (Signal("speed", "rad/s", noise=0.1),)
    drag = number("1/s", 0.4, 0.01, 10.0)
    gain = number("rad/s/A/s", 10.0, 0.1, 100.0)

    def derivative(self, state, input, p):
        return p.gain * input.current - p.drag * state.speed


@pytest.mark.nightly
def test_an_input_that_what_is_missing_may_depend_on_is_warned_of_and_allowed():
    rng = np.random.default_rng(1)
    current = np.repeat(rng.uniform(0.0, 5.0, 80), 10)
    data = recorded(current=current, temperature=293.0 + TIME, speed=10.0 + rng.standard_normal(len(TIME)))
    with pytest.warns(ModelWarning, match="'temperature' changes no output .* what is missing may depend on"):
        check_simulation(Fan(), data)
