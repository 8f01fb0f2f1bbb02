"""Oracle of a differential drive that is commanded by speed and turn rate.

Written from the table and the chain in docs/pose_reaching.md; an omnidirectional robot has a third
rim, across the other two::

    command -> rims: gains, dead zone, saturation, jump -> delay -> lag at a limited rate
            -> unequal wheels, slip, slope -> pose -> late, turned sensor
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from exam.oracles import Values, filled
from exam.oracles.piecewise import Derivative, Piece, current, follow, integrate, jumps
from fieldmodels.arrays import FloatArray

NEUTRAL: Values = {
    "actuator_gain": {"gain": 1.0},
    "turn_gain": {"gain": 1.0},
    "actuator_lag": {"time_constant": 0.0},
    "actuator_rate_limit": {"rate": math.inf},
    "actuator_delay": {"delay": 0.0},
    "actuator_saturation": {"limit": math.inf},
    "actuator_dead_zone": {"width": 0.0},
    "unequal_wheels": {"difference": 0.0},
    "yaw_slip": {"share": 0.0},
    "sideways_slip": {"coefficient": 0.0},
    "slope": {"x": 0.0, "y": 0.0},
    "sensor_delay": {"delay": 0.0},
    "heading_bias": {"angle": 0.0},
    "parameter_step": {"time": 0.0, "factor": 1.0},
}


AT_REST = {"x": 0.0, "y": 0.0, "heading": 0.0, "left_rim": 0.0, "right_rim": 0.0}


def simulate(
    base: Mapping[str, float],
    effects: Values,
    commands: FloatArray,
    step: float,
    start: Mapping[str, float] | None = None,
) -> FloatArray:
    """Drive one episode; see ``Simulate``. A third column of commands is the speed to the left [m/s].

    ``start`` may hold the speeds at which the rims ran before, ``left_rim`` and ``right_rim`` [m/s], and the
    pose ``x``, ``y`` [m], ``heading`` [rad] that the robot had when it ran past what the sensor shows first:
    a delay of the sensor before the first sample.
    """
    given, begun = filled(effects, NEUTRAL), {**AT_REST, **(start or {})}
    times = np.arange(len(commands)) * step
    left = course(commands, -1.0, begun["left_rim"], base["track"], step, given)
    right = course(commands, 1.0, begun["right_rim"], base["track"], step, given)
    across = [Piece(-math.inf, 0.0)]
    if commands.shape[1] > 2:
        sideways = np.column_stack([commands[:, 2], np.zeros(len(commands))])
        across = course(sideways, 0.0, 0.0, base["track"], step, given)

    def within(time: float) -> Derivative:
        return motion(current(left, time), current(right, time), current(across, time), base["track"], given)

    shown_times = times - given["sensor_delay"]["delay"]
    wanted = np.union1d(times, shown_times)
    state = [begun["x"], begun["y"], begun["heading"], 0.0, 0.0]
    path = integrate(within, jumps([*left, *right, *across]), state, wanted)
    shown = path[np.searchsorted(wanted, shown_times), :3] + [0.0, 0.0, given["heading_bias"]["angle"]]
    travel = path[np.searchsorted(wanted, times), 3:]
    means = np.concatenate([[[begun["left_rim"], begun["right_rim"]]], np.diff(travel, axis=0) / step])
    return np.concatenate([shown, means / base["wheel_radius"]], axis=1)


def course(
    commands: FloatArray,
    side: float,
    before: float,
    track: float,
    step: float,
    given: Mapping[str, Mapping[str, float]],
) -> list[Piece]:
    """Speed of one rim [m/s] in the course of time.

    Args:
        commands: Speed [m/s] and turn rate [rad/s], held from sample to sample, shape (n, 2 or more).
        side: -1 for the left rim, 1 for the right one.
        before: Its speed before the first command acts [m/s].
        track: Distance of the wheels [m].
        step: Sampling interval [s].
        given: Values of every effect.
    """
    delay, jump = given["actuator_delay"]["delay"], given["parameter_step"]
    begins = np.arange(len(commands)) * step
    moments = np.union1d(begins, [t for t in [jump["time"]] if 0.0 < t < begins[-1]])
    aims = []
    for moment in moments:
        speed, rate = commands[np.searchsorted(begins, moment, side="right") - 1][:2]
        turning = given["turn_gain"]["gain"] * track * rate
        aim = given["actuator_gain"]["gain"] * (speed + side * 0.5 * turning)
        aim = math.copysign(max(abs(aim) - given["actuator_dead_zone"]["width"], 0.0), aim)
        aim = math.copysign(min(abs(aim), given["actuator_saturation"]["limit"]), aim)
        if moment >= jump["time"]:
            aim *= jump["factor"]
        aims.append((moment + delay, aim))
    lag, rate = given["actuator_lag"]["time_constant"], given["actuator_rate_limit"]["rate"]
    return follow(aims, before, lag, rate)


def motion(
    left: Piece, right: Piece, across: Piece, track: float, given: Mapping[str, Mapping[str, float]]
) -> Derivative:
    """Derivative of x, y, heading, and of both rims' travel, while the rims' speeds are these."""
    unequal, share = given["unequal_wheels"]["difference"], given["yaw_slip"]["share"]
    outwards, slope = given["sideways_slip"]["coefficient"], given["slope"]

    def derivative(time: float, state: FloatArray) -> tuple[float, ...]:
        left_rim, right_rim = left.at(time), right.at(time)
        left_way, right_way = left_rim * (1.0 + 0.5 * unequal), right_rim * (1.0 - 0.5 * unequal)
        speed = 0.5 * (left_way + right_way)
        rate = (1.0 - share) * (right_way - left_way) / track
        lateral = across.at(time)
        driven = math.hypot(speed, lateral)
        ahead, sideways = speed + outwards * rate * lateral, lateral - outwards * rate * speed
        cosine, sine = math.cos(state[2]), math.sin(state[2])
        return (
            ahead * cosine - sideways * sine + slope["x"] * driven,
            ahead * sine + sideways * cosine + slope["y"] * driven,
            rate,
            left_rim,
            right_rim,
        )

    return derivative
