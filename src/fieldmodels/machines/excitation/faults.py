"""Faults of arm and sensors in a running experiment: the effects of ``ExcitationModel`` beyond the vehicle's.

Integrals of the accelerometer are zeroed at rest: its bias reaches dr'' alone, its gain dr' and dr too. What
the inclinometer shows late or biased, its derivatives show late.
"""

from __future__ import annotations

import math

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import inlined
from fieldmodels.machines.excitation.parameters import SAMPLE
from fieldmodels.machines.excitation.regression import (
    ACCELERATION,
    ANGLE,
    FORCE,
    POSITION,
    SIGNALS,
    gravity_change,
)
from fieldmodels.machines.excitation.simulation import (
    ACCELEROMETER_BIAS,
    ACCELEROMETER_GAIN,
    FORCE_TORQUE_GAIN,
    INCLINOMETER_BIAS,
    INCLINOMETER_DELAY,
    lag_motion,
)

TURNS = 9
"""Signals that come from the inclinometer: dtheta, w, w'."""
HISTORY = 41
"""Samples that a delayed inclinometer needs, the latest last: 0.2 s and one."""


@inlined
def lag_on(
    commanded: FloatArray, step: float, time_constant: float, last: FloatArray, arm: FloatArray
) -> None:
    """Motion of an arm that lags behind its command, on from where it was.

    Args:
        commanded: f, f', f'', shape (n, 3).
        step: Time between its rows [s].
        time_constant: Lag [s].
        last: The arm's motion at the beginning, shape (3,); receives that at the end.
        arm: Receives the arm's motion, shape (n, 3).
    """
    lag_motion(commanded, step, time_constant, arm)
    kept = math.exp(-step / time_constant)
    for k in range(3):
        # The lag is linear: what it began with dies down beside what follows.
        rest = last[k] - arm[0, k]
        for i in range(len(arm)):
            arm[i, k] += rest
            rest *= kept
        last[k] = arm[-1, k]


@inlined
def spoil(parameters: FloatArray, gravity: float, history: FloatArray, signals: FloatArray) -> None:
    """Turn true signals of a decision into those of faulty sensors, before noise, in place.

    Args:
        parameters: Vector of ``ExcitationModel``, shape (38,).
        gravity: Acceleration of free fall [m/s2].
        history: Latest true dtheta, w, w' before the decision, shape (41, 9); receives those at its end.
        signals: Shape (samples, 24), at least 41 samples.
    """
    late = parameters[INCLINOMETER_DELAY] / SAMPLE
    gain = parameters[ACCELEROMETER_GAIN]
    count = len(signals)
    before = history.copy()
    history[:, :] = signals[count - HISTORY :, ANGLE : ANGLE + TURNS]
    # From the end, so that earlier samples are still true when they are read.
    for n in range(count - 1, -1, -1):
        s = signals[n]
        tx, ty, tz = gravity_change(s[ANGLE], s[ANGLE + 1], s[ANGLE + 2], gravity)
        if late > 0.0:
            whole = math.floor(n - late)
            share = n - late - whole
            for k in range(TURNS):
                early = before[HISTORY + whole, k] if whole < 0 else signals[whole, ANGLE + k]
                next_one = whole + 1
                then = before[HISTORY + next_one, k] if next_one < 0 else signals[next_one, ANGLE + k]
                s[ANGLE + k] = early + share * (then - early)
        s[ANGLE] += parameters[INCLINOMETER_BIAS]
        s[ANGLE + 1] += parameters[INCLINOMETER_BIAS + 1]
        # The accelerometer shows dr'' less gravity's change; the robot adds that of the tilt it sees.
        sx, sy, sz = gravity_change(s[ANGLE], s[ANGLE + 1], s[ANGLE + 2], gravity)
        s[ACCELERATION] = gain * (s[ACCELERATION] - tx) + parameters[ACCELEROMETER_BIAS] + sx
        s[ACCELERATION + 1] = gain * (s[ACCELERATION + 1] - ty) + parameters[ACCELEROMETER_BIAS + 1] + sy
        s[ACCELERATION + 2] = gain * (s[ACCELERATION + 2] - tz) + parameters[ACCELEROMETER_BIAS + 2] + sz
        for k in range(POSITION, ACCELERATION):
            s[k] *= gain
        for k in range(FORCE, SIGNALS):
            s[k] *= parameters[FORCE_TORQUE_GAIN]
