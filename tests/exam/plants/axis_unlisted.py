"""Faults of a bench that no model lists: one set to develop a diagnosis on, another one to report on."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from exam.plants.axis import Axis, Force, Memory
from exam.plants.faults import Fault

Rng = np.random.Generator


@dataclass(frozen=True)
class Scale:
    """Typical sizes on a bench, by which faults are measured.

    Attributes:
        x: Deflection.
        v: Speed.
        f: Force.
        u: Largest command.
        duration: Of a record [s].
        step: Sampling interval [s].
    """

    x: float
    v: float
    f: float
    u: float
    duration: float
    step: float


AxisFault = Fault[Axis, Scale]
X, U = "position|angle", "force|torque|command|set point"
"""What position and command are called on the machines."""
OF_PLACE, OF_SPEED, OF_COMMAND = (f"force over {X}",), ("force over velocity",), (f"force over {U}",)
OF_PLACE_AND_SPEED = (f"force over {X}*velocity",)
OF_PAST_COMMANDS, OF_PAST_MOTION = (f"force over past of {U}",), (f"force over past of {X}|velocity",)
BENT = (f"sensor {X} over {X}",)
LATE = (f"sensor {X} over velocity", f"sensor {X} over past of {X}")
"""What a late sensor shows is behind by the way since."""
ZERO = ("force over time", f"sensor {X} over time", "parameter offset over time")
"""On what holds an axis, a slow force is a zero that moves."""


def _push(axis: Axis, force: Force) -> None:
    axis.forces.append(force)


# Forces.


def _force_step(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    size, begin = 0.1 * k * s.f, 0.37 * s.duration
    _push(axis, lambda t, _x, _v, _f: size if t >= begin else 0.0)


def _one_sided_spring(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    size = 0.2 * k * s.f / s.x
    _push(axis, lambda _t, x, _v, _f: -size * max(x, 0.0))


def _place_damping(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    size = 0.2 * k * s.f / (s.v * s.x**2)
    _push(axis, lambda _t, x, v, _f: -size * v * x * x)


def _gusts(axis: Axis, k: float, s: Scale, rng: Rng) -> None:
    count, decay = round(s.duration / s.step) + 2, math.exp(-s.step / 0.3)
    wind = lfilter([math.sqrt(1.0 - decay**2)], [1.0, -decay], rng.standard_normal(count))
    sizes = (0.1 * k * s.f * wind).tolist()
    _push(axis, lambda t, _x, _v, _f: sizes[int(t / s.step + 1e-6)])


def _gear_ripple(axis: Axis, k: float, s: Scale, rng: Rng) -> None:
    turns, (p, q, r) = 2.0 * math.pi / (1.3 * s.x), rng.uniform(0.0, 2.0 * math.pi, 3)
    size = 0.1 * k * s.f

    def ripple(_t: float, x: float, _v: float, _f: float) -> float:
        a = turns * x
        return size * (math.sin(a + p) + math.sin(2.0 * a + q) + 0.7 * math.sin(3.0 * a + r))

    _push(axis, ripple)


def _friction_fades(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    size, slow = 0.2 * k * s.f, 0.25 * s.duration
    axis.dry.append(lambda t, _x, _v, _f: size * math.exp(-t / slow))


def _stick_zone(axis: Axis, k: float, s: Scale, rng: Rng) -> None:
    size, place, width = 0.3 * k * s.f, rng.uniform(-0.6, 0.6) * s.x, 0.25 * s.x
    axis.dry.append(lambda _t, x, _v, _f: size * math.exp(-(((x - place) / width) ** 2)))


def _one_way_damping(axis: Axis, k: float, s: Scale, rng: Rng) -> None:
    size, way = 0.2 * k * s.f / s.v, rng.choice([-1.0, 1.0])
    _push(axis, lambda _t, _x, v, _f: -size * v if way * v > 0.0 else 0.0)


def _inertia_of_place(axis: Axis, k: float, s: Scale, rng: Rng) -> None:
    share = min(0.1 * k, 0.9) * rng.choice([-1.0, 1.0]) / s.x
    axis.inertia_factor = lambda x: 1.0 + 0.95 * math.tanh(share * x)


class SecondMass(Memory):
    """A mass on a spring that the axis carries."""

    def __init__(self, mass: float, pulsation: float) -> None:
        self.mass, self.pulsation = mass, pulsation
        self.z = self.speed = 0.0

    def force(self, x: float, v: float) -> float:
        """See ``Memory``."""
        w = self.pulsation
        return self.mass * (w * w * (self.z - x) + 0.1 * w * (self.speed - v))

    def advance(self, h: float, x: float, v: float) -> None:
        """See ``Memory``."""
        self.speed -= h * self.force(x, v) / self.mass
        self.z += h * self.speed


def _second_mass(axis: Axis, k: float, _s: Scale, _rng: Rng) -> None:
    axis.memories.append(SecondMass(0.05 * k * axis.inertia, 2.0 * math.pi * 3.1))


def _magnet(axis: Axis, k: float, s: Scale, rng: Rng) -> None:
    size, place = 0.2 * k * s.f, rng.uniform(-1.0, 1.0) * s.x
    _push(axis, lambda _t, x, _v, _f: size / (1.0 + (3.0 * (x - place) / s.x) ** 2))


# Actuators.


def _input_play(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    half, engaged = 0.05 * k * s.u, [math.nan]

    def play(u: float, _t: float) -> float:
        last = u if math.isnan(engaged[0]) else engaged[0]
        engaged[0] = min(max(last, u - half), u + half)
        return engaged[0]

    axis.maps.append(play)


def _place_gain(axis: Axis, k: float, s: Scale, rng: Rng) -> None:
    share = min(0.1 * k, 2.0) * rng.choice([-1.0, 1.0]) / s.x
    _push(axis, lambda _t, x, _v, f: f * 0.95 * math.tanh(share * x))


def _progressive_actuator(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    axis.maps.append(lambda u, _t: u * (1.0 + 0.1 * k * (u / s.u) ** 2))


def _sagging_supply(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    power, share = [0.0], s.step / 0.8

    def sag(u: float, _t: float) -> float:
        power[0] += share * ((u / s.u) ** 2 - power[0])
        return u / (1.0 + 0.5 * k * power[0])

    axis.maps.append(sag)


def _ringing_actuator(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    axis.ring = min(1.0 / (0.4 * k * s.step), 3.0 * axis.finer / s.step)


def _reversal_dead_time(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    lasts, since, sign = 0.5 * k * s.step, [-math.inf], [0.0]

    def pause(u: float, t: float) -> float:
        if u * sign[0] < 0.0:
            since[0] = t
        sign[0] = u
        # A share of the last sample stands for a pause that ends within it.
        return u * min(max((t + s.step - since[0] - lasts) / s.step, 0.0), 1.0)

    axis.maps.append(pause)


def _lost_commands(axis: Axis, k: float, s: Scale, rng: Rng) -> None:
    count = round(s.duration / s.step) + 2
    lost, last = (rng.uniform(size=count) < min(0.1 * k, 0.95)).tolist(), [0.0]

    def lose(u: float, t: float) -> float:
        if t == 0.0 or not lost[round(t / s.step)]:
            last[0] = u
        return last[0]

    axis.maps.append(lose)


def _one_sided_saturation(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    limit = 1.5 * s.u / (1.0 + 0.1 * k)
    axis.maps.append(lambda u, _t: min(u, limit))


# Sensors and clocks.


def _sensor_hysteresis(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    half, pointer = 0.02 * k * s.x, [0.0]

    def drag(y: float, _t: float, _x: float, _v: float, _f: float) -> float:
        pointer[0] = min(max(pointer[0], y - half), y + half)
        return pointer[0]

    axis.position.append(drag)


def _velocity_sensor_lag(axis: Axis, k: float, _s: Scale, _rng: Rng) -> None:
    share, filtered = 1.0 - math.exp(-1.0 / (0.3 * k)), [0.0]

    def follow(y: float, _t: float, _x: float, _v: float, _f: float) -> float:
        filtered[0] += share * (y - filtered[0])
        return filtered[0]

    axis.velocity.append(follow)


def _cubic_sensor(axis: Axis, k: float, s: Scale, rng: Rng) -> None:
    size = 0.02 * k * rng.choice([-1.0, 1.0]) / s.x**2
    axis.position.append(lambda y, _t, _x, _v, _f: y + size * y**3)


def _eccentric_gear(axis: Axis, k: float, s: Scale, rng: Rng) -> None:
    size, phase = 0.02 * k * s.x, rng.uniform(0.0, 2.0 * math.pi)
    axis.position.append(lambda y, _t, x, _v, _f: y + size * math.sin(4.0 * x / s.x + phase))


def _force_crosstalk(axis: Axis, k: float, s: Scale, rng: Rng) -> None:
    size = 0.01 * k * s.x / s.f * rng.choice([-1.0, 1.0])
    axis.position.append(lambda y, _t, _x, _v, f: y + size * f)


def _hum(axis: Axis, k: float, s: Scale, rng: Rng) -> None:
    # Of a frequency far above half the sampling rate, which shows as a slow wave.
    turns, phase = 2.0 * math.pi * (3.0 + rng.uniform(0.01, 0.04)) / s.step, rng.uniform(0.0, 2.0 * math.pi)
    axis.position.append(lambda y, t, _x, _v, _f: y + 0.01 * k * s.x * math.sin(turns * t + phase))


def _clipped_sensor(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    axis.clip = (-math.inf, 5.0 * s.x / (1.0 + 0.3 * k))


def _held_samples(axis: Axis, k: float, s: Scale, rng: Rng) -> None:
    fresh = (rng.uniform(size=round(s.duration / s.step) + 2) >= min(0.05 * k, 0.95)).tolist()
    axis.holds = lambda i: fresh[i]


def _flickering_gain(axis: Axis, k: float, s: Scale, rng: Rng) -> None:
    lost = (0.01 * k * np.abs(rng.standard_normal(round(s.duration / s.step) + 2))).tolist()
    axis.position.append(lambda y, t, _x, _v, _f: y * (1.0 - lost[round(t / s.step)]))


def _slow_clock(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    rate = k * s.step / s.duration
    axis.late = lambda t: rate * t


DEVELOP: Mapping[str, AxisFault] = {
    "force_step": Fault("From some time on a constant force acts.", _force_step, shows=ZERO),
    "one_sided_spring": Fault(
        "A spring acts on one side.", _one_sided_spring, ("one_sided_spring", "elastic_stop"), shows=OF_PLACE
    ),
    "place_damping": Fault(
        "Damping grows with the square of the deflection.",
        _place_damping,
        shows=OF_PLACE_AND_SPEED,
    ),
    "gusts": Fault("Gusts of wind push.", _gusts, random=True),
    "gear_ripple": Fault("A gear's ripple has strong harmonics.", _gear_ripple, ("cogging",), shows=OF_PLACE),
    "friction_fades": Fault(
        "Dry friction fades while the axis warms up.",
        _friction_fades,
        ("coulomb_friction",),
        shows=("force over velocity*time", "force over velocity"),
    ),
    "stick_zone": Fault("The axis sticks at one place.", _stick_zone, shows=OF_PLACE_AND_SPEED),
    "one_way_damping": Fault("It is damped more in one direction.", _one_way_damping, shows=OF_SPEED),
    "inertia_of_place": Fault(
        "The inertia depends on the place.",
        _inertia_of_place,
        shows=(f"parameter mass|inertia over {X}", f"force over {X}*rate of velocity|{U}"),
    ),
    "second_mass": Fault("The axis carries a mass on a spring.", _second_mass, shows=OF_PAST_MOTION),
    "magnet": Fault("A magnet pulls at one place.", _magnet, shows=OF_PLACE),
    "input_play": Fault(
        "The actuator has play before it acts.", _input_play, ("play",), shows=OF_PAST_COMMANDS
    ),
    "place_gain": Fault(
        "The actuator's gain depends on the place.", _place_gain, shows=(f"force over {X}*{U}",)
    ),
    "progressive_actuator": Fault(
        "The actuator gives more than in proportion.", _progressive_actuator, shows=OF_COMMAND
    ),
    "sagging_supply": Fault("The supply sags after large commands.", _sagging_supply, shows=OF_PAST_COMMANDS),
    "ringing_actuator": Fault(
        "The actuator overshoots.",
        _ringing_actuator,
        ("actuator_lag", "actuator_delay"),
        shows=OF_PAST_COMMANDS,
    ),
    "reversal_dead_time": Fault(
        "The actuator pauses at each change of direction.", _reversal_dead_time, shows=OF_PAST_COMMANDS
    ),
    "lost_commands": Fault(
        "Commands are lost; the last one holds.", _lost_commands, random=True, shows=OF_PAST_COMMANDS
    ),
    "one_sided_saturation": Fault(
        "The actuator saturates on one side.", _one_sided_saturation, ("saturation",), shows=OF_COMMAND
    ),
    "sensor_hysteresis": Fault(
        "The position sensor has play.", _sensor_hysteresis, ("backlash",), shows=LATE
    ),
    "velocity_sensor_lag": Fault(
        "The velocity sensor lags.",
        _velocity_sensor_lag,
        ("velocity_lag",),
        needs=("velocity",),
        shows=("sensor velocity over past of velocity", "sensor velocity over rate of velocity"),
    ),
    "cubic_sensor": Fault("The position sensor is bent by a cubic.", _cubic_sensor, ("bend",), shows=BENT),
    "eccentric_gear": Fault(
        "The position sensor's gear is eccentric.", _eccentric_gear, ("eccentricity",), shows=BENT
    ),
    "force_crosstalk": Fault(
        "The position sensor picks up the actuator.", _force_crosstalk, shows=(f"sensor {X} over {U}",)
    ),
    "hum": Fault(
        "The mains hum in the position sensor, aliased.",
        _hum,
        needs=("velocity",),
        shows=(f"sensor {X} over time",),
    ),
    "clipped_sensor": Fault(
        "The position sensor ends before the axis.", _clipped_sensor, ("clipping",), shows=BENT
    ),
    "held_samples": Fault(
        "Positions are lost; the last one is shown.", _held_samples, random=True, shows=LATE
    ),
    "slow_clock": Fault(
        "The position sensor's clock runs slow.", _slow_clock, shows=(*LATE, f"sensor {X} over velocity*time")
    ),
    "flickering_gain": Fault(
        "The position sensor's gain flickers.", _flickering_gain, random=True, shows=BENT
    ),
}
"""To develop a diagnosis on."""


# The other set: forces.


def _fading_force(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    size, slow = 0.2 * k * s.f, s.duration / 5.0
    _push(axis, lambda t, _x, _v, _f: size * math.exp(-t / slow))


def _hard_stop(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    place, stiffness = 5.0 * s.x / (1.0 + 0.3 * k), 20.0 * s.f / s.x
    _push(axis, lambda _t, x, _v, _f: -stiffness * max(x - place, 0.0))


def _damping_drift(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    size = 0.2 * k * s.f / (s.v * s.duration)
    _push(axis, lambda t, _x, v, _f: -size * t * v)


def _force_bursts(axis: Axis, k: float, s: Scale, rng: Rng) -> None:
    count = round(s.duration / s.step) + 2
    sizes, places = np.zeros(count), rng.integers(0, count, max(round(s.duration / 2.0), 1))
    for place in places:
        sizes[place : place + round(0.2 / s.step)] = rng.normal() * 0.2 * k * s.f
    pushes = sizes.tolist()
    _push(axis, lambda t, _x, _v, _f: pushes[int(t / s.step + 1e-6)])


def _detent(axis: Axis, k: float, s: Scale, rng: Rng) -> None:
    size, place, width = 0.3 * k * s.f, rng.uniform(-0.6, 0.6) * s.x, 0.3 * s.x

    def pull(_t: float, x: float, _v: float, _f: float) -> float:
        a = (x - place) / width
        return -size * a * math.exp(-a * a)

    _push(axis, pull)


def _saturating_friction(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    size, speed = 0.2 * k * s.f, 0.3 * s.v
    _push(axis, lambda _t, _x, v, _f: -size * v / (abs(v) + speed))


def _load_friction(axis: Axis, k: float, _s: Scale, _rng: Rng) -> None:
    axis.dry.append(lambda _t, _x, _v, f: min(0.05 * k, 0.9) * abs(f))


def _cubic_drag(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    size = 0.1 * k * s.f / s.v**3
    _push(axis, lambda _t, _x, v, _f: -size * v**3)


def _swept_force(axis: Axis, k: float, s: Scale, rng: Rng) -> None:
    size, phase = 0.1 * k * s.f, rng.uniform(0.0, 2.0 * math.pi)
    low, rise = 2.0 * math.pi * 0.4, 2.0 * math.pi * 0.5 * 2.0 / s.duration
    _push(axis, lambda t, _x, _v, _f: size * math.sin(low * t + rise * t * t + phase))


class Creep(Memory):
    """A spring in series with a damper."""

    def __init__(self, stiffness: float, slow: float) -> None:
        self.stiffness, self.slow, self.pull = stiffness, slow, 0.0

    def force(self, x: float, v: float) -> float:
        """See ``Memory``."""
        del x, v
        return -self.pull

    def advance(self, h: float, x: float, v: float) -> None:
        """See ``Memory``."""
        del x
        self.pull = self.pull * math.exp(-h / self.slow) + self.stiffness * v * h


def _creep(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    axis.memories.append(Creep(0.1 * k * s.f / s.x, 0.15))


def _slack_cable(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    size = 0.2 * k * s.f / s.x**2
    _push(axis, lambda _t, x, _v, _f: -size * max(x + 0.3 * s.x, 0.0) ** 2)


def _stiffness_step(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    size, begin = 0.1 * k * s.f / s.x, 0.55 * s.duration
    _push(axis, lambda t, x, _v, _f: -size * x if t >= begin else 0.0)


# Actuators.


def _sticky_valve(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    band, last = 0.05 * k * s.u, [math.nan]

    def stick(u: float, _t: float) -> float:
        if not abs(u - last[0]) <= band:
            last[0] = u
        return last[0]

    axis.maps.append(stick)


def _speed_gain(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    _push(axis, lambda _t, _x, v, f: f * (1.0 / (1.0 + 0.1 * k * abs(v) / s.v) - 1.0))


def _soft_saturation(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    knee = s.u / (0.3 * k)
    axis.maps.append(lambda u, _t: knee * math.tanh(u / knee))


def _fading_gain(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    axis.maps.append(lambda u, t: u * math.exp(-0.1 * k * t / s.duration))


def _slow_fall(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    axis.lag, axis.fall = 0.0, 0.5 * k * s.step


def _coarse_command(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    quantum = 0.05 * k * s.u
    axis.maps.append(lambda u, _t: quantum * math.floor(u / quantum + 0.5))


def _one_sided_dead_zone(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    width = 0.03 * k * s.u
    axis.maps.append(lambda u, _t: max(u - width, 0.0) if u > 0.0 else u)


# Sensors and clocks.


def _off_axle_marker(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    size = 0.02 * k / s.x
    axis.position.append(lambda y, _t, _x, _v, _f: y + size * y * y)


def _velocity_dead_band(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    band = 0.05 * k * s.v
    axis.velocity.append(lambda y, _t, _x, _v, _f: 0.0 if abs(y) < band else y)


def _one_sided_scale(axis: Axis, k: float, _s: Scale, _rng: Rng) -> None:
    axis.position.append(lambda y, _t, _x, _v, _f: y * (1.0 + 0.02 * k) if y > 0.0 else y)


def _dead_spot(axis: Axis, k: float, s: Scale, rng: Rng) -> None:
    place, half = rng.uniform(-0.5, 0.5) * s.x, 0.05 * k * s.x
    axis.position.append(lambda y, _t, x, _v, _f: y + (place - x if abs(x - place) < half else 0.0))


def _place_in_velocity(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    size = 0.02 * k * s.v / s.x
    axis.velocity.append(lambda y, _t, x, _v, _f: y + size * x)


def _offset_jump(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    begin = 0.41 * s.duration
    axis.position.append(lambda y, t, _x, _v, _f: y + 0.03 * k * s.x if t >= begin else y)


def _flexing_mount(axis: Axis, k: float, s: Scale, _rng: Rng) -> None:
    size = 0.01 * k * s.x / s.f

    def flex(y: float, _t: float, x: float, v: float, f: float) -> float:
        return y + size * (f - axis.damping * v - axis.stiffness * x - axis.gravity * math.sin(x))

    axis.position.append(flex)


def _time_jitter(axis: Axis, k: float, s: Scale, rng: Rng) -> None:
    late = (0.3 * k * s.step * np.abs(rng.standard_normal(round(s.duration / s.step) + 2))).tolist()
    axis.late = lambda t: late[round(t / s.step)]


def _moving_average(axis: Axis, k: float, _s: Scale, _rng: Rng) -> None:
    length = 1.0 + 0.3 * k
    past: deque[float] = deque(maxlen=math.ceil(length))

    def mean(y: float, _t: float, _x: float, _v: float, _f: float) -> float:
        past.append(y)
        whole, rest = list(past)[::-1], length
        total = 0.0
        for value in whole:
            total += min(rest, 1.0) * value
            rest -= 1.0
        return (total + max(rest, 0.0) * whole[-1]) / length

    axis.position.append(mean)


REPORT: Mapping[str, AxisFault] = {
    "fading_force": Fault("A constant force fades.", _fading_force, shows=ZERO),
    "hard_stop": Fault(
        "The axis hits a stop.", _hard_stop, ("elastic_stop", "one_sided_spring"), shows=OF_PLACE
    ),
    "damping_drift": Fault(
        "Damping grows with time.",
        _damping_drift,
        ("damping_drift",),
        shows=("force over velocity*time", "parameter damping over time"),
    ),
    "force_bursts": Fault("Short pushes at random times.", _force_bursts, random=True),
    "detent": Fault("A detent pulls at one place.", _detent, shows=OF_PLACE),
    "saturating_friction": Fault(
        "Friction grows with speed and saturates.",
        _saturating_friction,
        ("coulomb_friction",),
        shows=OF_SPEED,
    ),
    "load_friction": Fault(
        "Dry friction grows with the force.",
        _load_friction,
        ("load_friction",),
        shows=(f"force over {U}*velocity",),
    ),
    "cubic_drag": Fault("Drag grows with the cube of the speed.", _cubic_drag, shows=OF_SPEED),
    "swept_force": Fault("A periodic force becomes faster.", _swept_force, shows=("force over time",)),
    "creep": Fault("A spring and a damper in series pull.", _creep, shows=OF_PAST_MOTION),
    "slack_cable": Fault("A cable pulls on one side, slack on the other.", _slack_cable, shows=OF_PLACE),
    "stiffness_step": Fault(
        "A spring changes at some time.",
        _stiffness_step,
        ("stiffness_step",),
        shows=(f"force over {X}*time", "parameter stiffness|gravity moment over time"),
    ),
    "sticky_valve": Fault(
        "The actuator ignores small changes.", _sticky_valve, ("play",), shows=OF_PAST_COMMANDS
    ),
    "speed_gain": Fault("The actuator is weaker at speed.", _speed_gain, shows=(f"force over {U}*velocity",)),
    "soft_saturation": Fault(
        "The actuator saturates softly.", _soft_saturation, ("saturation",), shows=OF_COMMAND
    ),
    "fading_gain": Fault("The actuator fades.", _fading_gain, shows=(f"force over {U}*time",)),
    "slow_fall": Fault(
        "The actuator falls slowly and rises at once.", _slow_fall, ("actuator_lag",), shows=OF_PAST_COMMANDS
    ),
    "coarse_command": Fault("The actuator knows few levels.", _coarse_command, shows=OF_COMMAND),
    "one_sided_dead_zone": Fault(
        "The actuator has a dead zone on one side.", _one_sided_dead_zone, ("dead_zone",), shows=OF_COMMAND
    ),
    "off_axle_marker": Fault(
        "The position sensor is bent by a square.", _off_axle_marker, ("bend",), shows=BENT
    ),
    "velocity_dead_band": Fault(
        "The velocity sensor does not see slow motion.",
        _velocity_dead_band,
        needs=("velocity",),
        shows=("sensor velocity over velocity",),
    ),
    "one_sided_scale": Fault("The position sensor shows more on one side.", _one_sided_scale, shows=BENT),
    "dead_spot": Fault("The position sensor has a dead spot.", _dead_spot, shows=BENT),
    "place_in_velocity": Fault(
        "The velocity sensor picks up the position.",
        _place_in_velocity,
        needs=("velocity",),
        shows=(f"sensor velocity over {X}",),
    ),
    "offset_jump": Fault("The position sensor's offset jumps.", _offset_jump, shows=ZERO),
    "flexing_mount": Fault(
        "The position sensor's mount flexes.",
        _flexing_mount,
        shows=(f"sensor {X} over rate of velocity|{U}",),
    ),
    "time_jitter": Fault("Positions are late by random times.", _time_jitter, random=True, shows=LATE),
    "moving_average": Fault(
        "The position sensor shows moving averages.",
        _moving_average,
        ("sensor_delay", "position_lag"),
        shows=LATE,
    ),
}
"""To report on: no kind of the other set."""
