"""The walker's leg and its gyro, with anything wrong with them.

    theta' = omega,  omega' = torque - g/length sin(theta) + forces
    theta beyond zero -> strike; just after this sample  w+ = w - 0.5 (w - sgn w)
    omega -> gyro, read before the push-off; theta at a strike -> geometry's angle, held

Written from docs/heel_strike.md and the effects' equations, integrated by Runge and Kutta's
fourth-order step.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.signal import lfilter

from exam.plants.faults import Fault
from fieldmodels.arrays import FloatArray

Rng = np.random.Generator
Values = Mapping[str, float]
Force = Callable[[float, float, float], float]
"""(time, angle, rate) to an angular acceleration."""
Sensor = Callable[[float, float], float]
"""(reading so far, time) to a reading; called once a sample, in order."""
GRAVITY, SPEED, PUSH_OFF = 9.81, 1.0, 0.5
FADE = 0.01
"""Rate at which dry friction fades [rad/s]."""
NOISE = (0.0041, 0.0016)
"""Standard deviations of the gyro [rad/s] and of the geometry's angle [rad]."""
TORQUE, HOLD = 0.15, 0.25
"""Largest random torque per inertia [rad/s2], and how long it is held [s]."""


@dataclass
class Leg:
    """A leg with what is wrong with it.

    Attributes:
        length: Of the pendulum [m].
        forces: Further angular accelerations.
        delay: Of the gyro [s].
        gyro: What becomes of its reading.
        geometry: What becomes of the angle at a strike.
        quantum: To what the gyro is rounded, noise included [rad/s].
        clip: What it can show at most, noise included [rad/s].
        steps: Steps in a sample.
    """

    length: float
    forces: list[Force] = field(default_factory=list)
    delay: float = 0.0
    gyro: list[Sensor] = field(default_factory=list)
    geometry: list[Sensor] = field(default_factory=list)
    quantum: float = 0.0
    clip: float = math.inf
    steps: int = 2


def simulate(leg: Leg, torques: FloatArray, noise: FloatArray, step: float) -> FloatArray:
    """Walk from the lowest point at the usual rate, just after a strike.

    Args:
        leg: The leg, fresh: what remembers is used up.
        torques: Random torque per inertia from each sample to the next [rad/s2], shape (n,).
        noise: Of the gyro and of the geometry, shape (n, 2).
        step: Sampling interval [s].

    Returns:
        Strike (1 at the first sample after one), gyro and angle at the latest strike, of samples one to n,
        shape (n, 3); not finite once the leg falls.
    """
    result = np.full((len(torques), 3), np.nan)
    theta, omega, shown = 0.0, SPEED, 0.0
    rates = [SPEED]
    late = leg.delay / step
    h = step / leg.steps
    for k, (torque, errors) in enumerate(zip(torques.tolist(), noise.tolist(), strict=True)):
        before = theta
        for s in range(leg.steps):
            theta, omega = _step(leg, k * step + s * h, h, theta, omega, torque)
        now = (k + 1) * step
        rates.append(omega)
        place = max(len(rates) - 1 - late, 0.0)
        low = int(place)
        reading = rates[low] + (place - low) * (rates[min(low + 1, len(rates) - 1)] - rates[low])
        for sensor in leg.gyro:
            reading = sensor(reading, now)
        reading = min(max(reading + errors[0], -leg.clip), leg.clip)
        if leg.quantum:
            reading = leg.quantum * round(reading / leg.quantum)
        strike = before * theta < 0.0 or (theta == 0.0 and before != 0.0)
        if strike:
            shown = theta
            for sensor in leg.geometry:
                shown = sensor(shown, now)
            shown += errors[1]
            omega += PUSH_OFF * (math.copysign(SPEED, omega) - omega)
        if not abs(theta) < 2.0:
            break
        result[k] = float(strike), reading, shown
    return result


def _step(leg: Leg, now: float, h: float, theta: float, omega: float, torque: float) -> tuple[float, float]:
    stiffness, forces = GRAVITY / leg.length, leg.forces

    def acceleration(t: float, x: float, v: float) -> float:
        total = torque - stiffness * math.sin(x)
        for force in forces:
            total += force(t, x, v)
        return total

    half = 0.5 * h
    a1 = acceleration(now, theta, omega)
    v2 = omega + half * a1
    a2 = acceleration(now + half, theta + half * omega, v2)
    v3 = omega + half * a2
    a3 = acceleration(now + half, theta + half * v2, v3)
    v4 = omega + h * a3
    a4 = acceleration(now + h, theta + h * v3, v4)
    return (
        theta + h / 6.0 * (omega + 2.0 * (v2 + v3) + v4),
        omega + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4),
    )


def install(leg: Leg, effects: Mapping[str, Values]) -> None:
    """Let listed effects act on a leg, in the documented order."""
    for name in ORDER:
        if name in effects:
            LISTED[name](leg, effects[name])


def _viscous(leg: Leg, values: Values) -> None:
    leg.forces.append(lambda _t, _x, v: -values["rate"] * v)


def _coulomb(leg: Leg, values: Values) -> None:
    leg.forces.append(lambda _t, _x, v: -values["acceleration"] * v / math.hypot(v, FADE))


def _drag(leg: Leg, values: Values) -> None:
    leg.forces.append(lambda _t, _x, v: -values["coefficient"] * v * abs(v))


def _constant(leg: Leg, values: Values) -> None:
    leg.forces.append(lambda _t, _x, _v: values["acceleration"])


def _periodic(leg: Leg, values: Values) -> None:
    turns = 2.0 * math.pi * values["frequency"]
    leg.forces.append(
        lambda t, _x, _v: values["sine"] * math.sin(turns * t) + values["cosine"] * math.cos(turns * t)
    )


def _gain(leg: Leg, values: Values) -> None:
    leg.gyro.append(lambda y, _t: values["gain"] * y)


def _bias(leg: Leg, values: Values) -> None:
    leg.gyro.append(lambda y, _t: y + values["rate"])


def _drift(leg: Leg, values: Values) -> None:
    leg.gyro.append(lambda y, t: y + values["rate"] * t)


def _jump(leg: Leg, values: Values) -> None:
    leg.gyro.append(lambda y, t: y + (values["rate"] if t >= values["time"] else 0.0))


def _delay(leg: Leg, values: Values) -> None:
    leg.delay = values["delay"]


def _rounding(leg: Leg, values: Values) -> None:
    leg.quantum = values["step"]


LISTED: Mapping[str, Callable[[Leg, Values], None]] = {
    "viscous_friction": _viscous,
    "coulomb_friction": _coulomb,
    "quadratic_drag": _drag,
    "constant_force": _constant,
    "periodic_force": _periodic,
    "gyro_delay": _delay,
    "gyro_gain": _gain,
    "gyro_bias": _bias,
    "gyro_drift": _drift,
    "parameter_step": _jump,
    "gyro_quantisation": _rounding,
}
ORDER = tuple(LISTED)
LegFault = Fault[Leg, float]
"""The scale of a walk is its duration [s]."""
OVER_TIME, OF_RATE, OF_ANGLE = ("force over time",), ("force over gyro",), ("force over strike angle",)
GYRO_OVER_TIME, BENT_GYRO = ("sensor gyro over time",), ("sensor gyro over gyro",)


def _gear_ripple(leg: Leg, k: float, _s: float, rng: Rng) -> None:
    phase = rng.uniform(0.0, 2.0 * math.pi)
    leg.forces.append(lambda _t, x, _v: 0.05 * k * (math.sin(25.0 * x + phase) + math.sin(50.0 * x)))


def _gusts(leg: Leg, k: float, s: float, rng: Rng) -> None:
    drawn = rng.standard_normal(int(s / 0.05) + 2)
    pushes = (0.02 * k * lfilter([0.6], [1.0, -0.8], drawn)).tolist()
    leg.forces.append(lambda t, _x, _v: pushes[int(t / 0.05)])


def _place_damping(leg: Leg, k: float, _s: float, _rng: Rng) -> None:
    leg.forces.append(lambda _t, x, v: -0.5 * k * v * x * x)


def _one_way_damping(leg: Leg, k: float, _s: float, _rng: Rng) -> None:
    leg.forces.append(lambda _t, _x, v: -0.05 * k * v if v > 0.0 else 0.0)


def _cubic_sensor(leg: Leg, k: float, _s: float, _rng: Rng) -> None:
    leg.gyro.append(lambda y, _t: y + 0.005 * k * y**3)


def _clipped_sensor(leg: Leg, k: float, _s: float, _rng: Rng) -> None:
    leg.clip = 1.5 / (1.0 + 0.1 * k)


def _hum(leg: Leg, k: float, _s: float, rng: Rng) -> None:
    # Aliased by a sampling rate of 100 Hz.
    turns, phase = 2.0 * math.pi * (100.0 + rng.uniform(0.3, 1.5)), rng.uniform(0.0, 2.0 * math.pi)
    leg.gyro.append(lambda y, t: y + 0.002 * k * math.sin(turns * t + phase))


def _gyro_square(leg: Leg, k: float, _s: float, _rng: Rng) -> None:
    leg.gyro.append(lambda y, _t: y + 0.005 * k * y * y)


def _fading_gyro(leg: Leg, k: float, s: float, _rng: Rng) -> None:
    leg.gyro.append(lambda y, t: y * (1.0 - 0.01 * k * t / s))


def _force_step(leg: Leg, k: float, s: float, rng: Rng) -> None:
    when = rng.uniform(0.3, 0.7) * s
    leg.forces.append(lambda t, _x, _v: 0.01 * k if t > when else 0.0)


def _geometry_scale(leg: Leg, k: float, _s: float, _rng: Rng) -> None:
    leg.geometry.append(lambda angle, _t: angle * (1.0 + 0.01 * k))


def _knee_stop(leg: Leg, k: float, _s: float, _rng: Rng) -> None:
    leg.forces.append(lambda _t, x, _v: -k * max(x - 0.25, 0.0))


def _worn_bearing(leg: Leg, k: float, s: float, _rng: Rng) -> None:
    leg.forces.append(lambda t, _x, v: -0.05 * k * v * t / s)


def _gyro_dead_band(leg: Leg, k: float, _s: float, _rng: Rng) -> None:
    band = 0.01 * k
    leg.gyro.append(lambda y, _t: math.copysign(max(abs(y) - band, 0.0), y))


DEVELOP: Mapping[str, LegFault] = {
    "gyro_square": Fault("The gyro is bent by a square.", _gyro_square, ("bend",), shows=BENT_GYRO),
    "fading_gyro": Fault(
        "The gyro shows less and less.", _fading_gyro, shows=("sensor gyro over gyro*time",)
    ),
    "force_step": Fault("From some time on a constant force acts.", _force_step, shows=OVER_TIME),
    "geometry_scale": Fault(
        "The geometry's angle is too large.",
        _geometry_scale,
        ("strike_angle_gain",),
        shows=("sensor strike angle over strike angle",),
    ),
    "knee_stop": Fault("A stop resists beyond an angle.", _knee_stop, shows=OF_ANGLE),
    "worn_bearing": Fault("Damping grows while it walks.", _worn_bearing, shows=("force over gyro*time",)),
    "gyro_dead_band": Fault("The gyro does not show slow turns.", _gyro_dead_band, shows=BENT_GYRO),
    "gear_ripple": Fault("A gear's ripple has strong harmonics.", _gear_ripple, ("cogging",), shows=OF_ANGLE),
    "gusts": Fault("Gusts of wind push.", _gusts, random=True),
    "place_damping": Fault(
        "Damping grows with the square of the angle.", _place_damping, shows=("force over gyro*strike angle",)
    ),
    "one_way_damping": Fault("It is damped more in one direction.", _one_way_damping, shows=OF_RATE),
    "cubic_sensor": Fault("The gyro is bent by a cubic.", _cubic_sensor, ("bend",), shows=BENT_GYRO),
    "clipped_sensor": Fault(
        "The gyro cannot show fast turns.", _clipped_sensor, ("clipping",), shows=BENT_GYRO
    ),
    "hum": Fault("The mains hum in the gyro, aliased.", _hum, shows=GYRO_OVER_TIME),
}
"""To develop a diagnosis on."""


def _gyro_swing(leg: Leg, k: float, s: float, _rng: Rng) -> None:
    leg.gyro.append(lambda y, t: y + 0.001 * k * math.sin(6.0 * math.pi * t / s))


def _detent(leg: Leg, k: float, _s: float, rng: Rng) -> None:
    place = rng.uniform(-0.15, 0.15)

    def pull(_t: float, x: float, _v: float) -> float:
        a = (x - place) / 0.08
        return -0.1 * k * a * math.exp(-a * a)

    leg.forces.append(pull)


def _cubic_drag(leg: Leg, k: float, _s: float, _rng: Rng) -> None:
    leg.forces.append(lambda _t, _x, v: -0.05 * k * v**3)


def _swept_force(leg: Leg, k: float, s: float, rng: Rng) -> None:
    phase, rise = rng.uniform(0.0, 2.0 * math.pi), 2.0 * math.pi * 1.0 / s
    leg.forces.append(lambda t, _x, _v: 0.05 * k * math.sin((2.0 + rise * t) * t + phase))


def _one_sided_scale(leg: Leg, k: float, _s: float, _rng: Rng) -> None:
    leg.gyro.append(lambda y, _t: y * (1.0 + 0.005 * k) if y > 0.0 else y)


def _moving_average(leg: Leg, k: float, _s: float, _rng: Rng) -> None:
    past: deque[float] = deque(maxlen=6)
    share = 1.0 - math.exp(-0.2 * k)

    def mean(y: float, _t: float) -> float:
        past.append(y)
        return (1.0 - share) * y + share * sum(past) / len(past)

    leg.gyro.append(mean)


def _one_sided_floor(leg: Leg, k: float, _s: float, _rng: Rng) -> None:
    leg.geometry.append(lambda angle, _t: angle + 0.001 * k)


REPORT: Mapping[str, LegFault] = {
    "gyro_swing": Fault("The gyro's bias swings slowly.", _gyro_swing, shows=GYRO_OVER_TIME),
    "detent": Fault("A detent pulls at one angle.", _detent, shows=OF_ANGLE),
    "cubic_drag": Fault("Drag grows with the cube of the rate.", _cubic_drag, shows=OF_RATE),
    "swept_force": Fault("A periodic torque becomes faster.", _swept_force, shows=OVER_TIME),
    "one_sided_scale": Fault("The gyro shows more in one direction.", _one_sided_scale, shows=BENT_GYRO),
    "moving_average": Fault(
        "The gyro shows moving averages.",
        _moving_average,
        ("gyro_delay", "gyro_lag"),
        shows=("sensor gyro over past of gyro", "sensor gyro over rate of gyro"),
    ),
    "one_sided_floor": Fault(
        "The geometry's angle has a bias.", _one_sided_floor, ("bias",), shows=("sensor strike angle",)
    ),
}
"""To report on: no kind of the other set."""
