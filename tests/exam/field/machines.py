"""Eight machines, declared as a user would by the documented route: nothing is said of horizons."""

from __future__ import annotations

import math

from fieldmodels.effects import actuator, change, force, friction, sensor
from fieldmodels.machine import Force, Machine, number
from fieldmodels.model import Model, Signal
from fieldmodels.registry import get_model

GRAVITY = 9.81


class Motor(Machine):
    """A motor whose current is measured."""

    inputs = (Signal("voltage", "V"),)
    states = outputs = (Signal("current", "A", noise=0.02), Signal("speed", "rad/s", noise=0.3))
    resistance = number("ohm", 1.0, 0.01, 100.0)
    inductance = number("H", 0.02, 1e-4, 1.0)
    constant = number("N m/A", 0.05, 1e-3, 1.0)
    inertia = number("kg m^2", 2e-4, 1e-6, 1e-1)
    drag = number("N m s/rad", 2e-4, 0.0, 1.0)
    forces = (Force("speed", unit="N m", inertia="inertia"),)
    effects = (
        *actuator("voltage", without=("gain",)),
        *friction("speed", without=("viscous_friction",)),
        *sensor("current", ("bias", "gain", "lag"), prefix="current_"),
        *sensor("speed", ("bias", "gain", "lag", "delay"), prefix="speed_"),
    )

    def derivative(self, state, input, p):
        current = (input.voltage - p.resistance * state.current - p.constant * state.speed) / p.inductance
        return current, (p.constant * state.current - p.drag * state.speed) / p.inertia


class Tanks(Machine):
    """An upper tank that a pump fills runs out into a lower one."""

    inputs = (Signal("pump", "1"),)
    states = outputs = (Signal("upper", "m", noise=1e-3), Signal("lower", "m", noise=1e-3))
    area = number("m^2", 0.02, refitted=False)
    flow = number("m^3/s", 3e-4, 1e-6, 1e-1)
    upper_outlet = number("m^2", 1.2e-4, 1e-6, 1e-2)
    lower_outlet = number("m^2", 1.5e-4, 1e-6, 1e-2)
    forces = (Force("upper"), Force("lower"))
    effects = (
        *actuator("pump", without=("gain", "play")),
        *sensor("upper", ("bias", "gain", "drift", "lag"), prefix="upper_"),
        *sensor("lower", ("bias", "gain", "drift", "lag"), prefix="lower_"),
        *change("lower_outlet"),
    )

    def derivative(self, state, input, p):
        upper = p.upper_outlet * math.sqrt(2.0 * GRAVITY * max(state.upper, 0.0))
        lower = p.lower_outlet * math.sqrt(2.0 * GRAVITY * max(state.lower, 0.0))
        return (p.flow * input.pump - upper) / p.area, (upper - lower) / p.area


class Plate(Machine):
    """A heated plate in a room whose temperature is measured."""

    inputs = (Signal("heater", "1"), Signal("ambient", "°C"))
    states = outputs = (Signal("plate", "°C", noise=0.1),)
    power = number("W", 40.0, refitted=False)
    capacity = number("J/K", 60.0, 1.0, 1e5)
    loss = number("W/K", 0.5, 1e-3, 100.0)
    forces = (Force("plate", unit="W", inertia="capacity"),)
    effects = (
        *actuator("heater"),
        *sensor("plate", ("bias", "drift", "gain", "lag", "delay")),
        *change("loss"),
    )

    def derivative(self, state, input, p):
        return (p.power * input.heater - p.loss * (state.plate - input.ambient)) / p.capacity


class Quadrotor(Machine):
    """Height of a quadrotor above where it took off."""

    inputs = (Signal("thrust", "1"),)
    states = outputs = (Signal("height", "m", noise=0.02), Signal("climb", "m/s", noise=0.05))
    hover = number("1", 0.45, 0.01, 1.0)
    drag = number("1/s", 0.3, 0.0, 100.0)
    forces = (Force("climb", "height"),)
    effects = (
        *actuator("thrust", without=("gain", "bias", "play")),
        *friction("climb", ("quadratic_drag", "constant_force")),
        *sensor("height", ("gain", "drift", "lag", "delay"), prefix="height_"),
        *sensor("climb", ("bias", "gain", "lag"), prefix="climb_"),
        *change("hover"),
    )

    def derivative(self, state, input, p):
        return state.climb, 9.81 * (input.thrust / p.hover - 1.0) - p.drag * state.climb


class Car(Machine):
    """A car on a plane, driven by throttle and steering."""

    inputs = (Signal("throttle", "1"), Signal("steer", "rad"))
    states = outputs = (
        Signal("x", "m", noise=0.05), Signal("y", "m", noise=0.05),
        Signal("heading", "rad", noise=0.01), Signal("speed", "m/s", noise=0.05),
    )  # fmt: skip
    push = number("m/s^2", 3.0, 0.01, 100.0)
    drag = number("1/s", 0.25, 0.0, 100.0)
    wheelbase = number("m", 2.6, 0.1, 20.0)
    forces = (Force("speed"), Force("heading"))
    effects = (
        *actuator("throttle", without=("gain", "play"), prefix="throttle_"),
        *actuator("steer", without=("gain",), prefix="steer_"),
        *friction("speed", ("coulomb_friction", "quadratic_drag", "constant_force")),
        *sensor("heading", ("bias", "drift", "delay"), prefix="heading_"),
        *sensor("speed", ("bias", "gain", "lag"), prefix="speed_"),
    )

    def derivative(self, state, input, p):
        v = state.speed
        turn = v / p.wheelbase * math.tan(input.steer)
        return (
            v * math.cos(state.heading),
            v * math.sin(state.heading),
            turn,
            p.push * input.throttle - p.drag * v,
        )


class Crane(Machine):
    """A trolley from which a load hangs."""

    inputs = (Signal("force", "N"),)
    states = (
        Signal("trolley", "m"), Signal("speed", "m/s"), Signal("angle", "rad"), Signal("rate", "rad/s"),
    )  # fmt: skip
    outputs = (Signal("trolley", "m", noise=1e-3), Signal("angle", "rad", noise=2e-3))
    mass = number("kg", 20.0, 0.1, 1e4)
    load = number("kg", 10.0, 0.1, 1e4)
    cable = number("m", 2.0, 0.1, 100.0)
    damping = number("N s/m", 15.0, 0.0, 1e4)
    forces = (Force("speed", "trolley", unit="N", inertia="moved", also={"rate": "swung"}),)
    effects = (
        *actuator("force", without=("gain",)),
        *force("speed", without=("viscous_friction", "load_friction")),
        *sensor("trolley", ("gain", "delay"), prefix="trolley_"),
        *sensor("angle", ("bias", "gain", "delay"), prefix="angle_"),
    )

    def moved(self, state, p):
        return p.mass + p.load * math.sin(state.angle) ** 2

    def swung(self, state, p):
        return -math.cos(state.angle) / (p.cable * (p.mass + p.load * math.sin(state.angle) ** 2))

    def derivative(self, state, input, p):
        s, c = math.sin(state.angle), math.cos(state.angle)
        pulled = p.load * s * (p.cable * state.rate**2 + 9.81 * c)
        trolley = (input.force - p.damping * state.speed + pulled) / (p.mass + p.load * s * s)
        return state.speed, trolley, state.rate, -(trolley * c + 9.81 * s) / p.cable


class Cylinder(Machine):
    """A pneumatic cylinder against a spring, with a valve that lets air in or out."""

    inputs = (Signal("valve", "1"),)
    states = (Signal("position", "m"), Signal("speed", "m/s"), Signal("pressure", "bar"))
    outputs = (Signal("position", "m", noise=2e-4), Signal("pressure", "bar", noise=0.02))
    area = number("m^2", 1e-3, refitted=False)
    mass = number("kg", 8.0, 0.1, 1e3)
    damping = number("N s/m", 120.0, 0.0, 1e5)
    spring = number("N/m", 2000.0, 0.0, 1e6)
    rise = number("bar/s", 40.0, 0.1, 1e4)
    squeeze = number("bar/m", 60.0, 0.1, 1e4)
    forces = (Force("speed", "position", unit="N", inertia="mass"), Force("pressure"))
    effects = (
        *actuator("valve", without=("gain", "play")),
        *force("speed", without=("viscous_friction", "load_friction", "elastic_stop")),
        *sensor("position", ("gain", "delay"), prefix="position_"),
        *sensor("pressure", ("bias", "gain", "lag"), prefix="pressure_"),
    )

    def derivative(self, state, input, p):
        left = 1.0 - math.copysign(1.0, input.valve) * state.pressure / 6.0
        push = 1e5 * p.area * state.pressure - p.damping * state.speed - p.spring * state.position
        return state.speed, push / p.mass, p.rise * input.valve * left - p.squeeze * state.speed


class Valve(Machine):
    """A control valve of equal percentage with its positioner, and the flow through it."""

    inputs = (Signal("signal", "1"),)
    states = outputs = (Signal("stem", "1", noise=2e-3), Signal("flow", "l/s", noise=0.01))
    travel = number("s", 0.8, 0.01, 100.0)
    largest = number("l/s", 4.0, 0.01, 1e3)
    fill = number("s", 0.3, 0.01, 100.0)
    forces = (Force("stem"), Force("flow"))
    effects = (
        *actuator("signal", without=("gain",)),
        *sensor("stem", ("bias", "gain", "lag"), prefix="stem_"),
        *sensor("flow", ("bias", "gain", "lag", "delay"), prefix="flow_"),
        *change("largest"),
    )

    def derivative(self, state, input, p):
        through = p.largest * math.exp(3.4 * (state.stem - 1.0))
        return (input.signal - state.stem) / p.travel, (through - state.flow) / p.fill


DECLARED = {
    one.__name__.lower(): one for one in (Motor, Tanks, Plate, Quadrotor, Car, Crane, Cylinder, Valve)
}


def model_of(machine: str) -> Model:
    """What a user hands to a diagnosis."""
    return DECLARED[machine]() if machine in DECLARED else get_model(machine)
