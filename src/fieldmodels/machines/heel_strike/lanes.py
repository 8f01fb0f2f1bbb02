"""The swing from one strike to the next, of several walkers side by side, equal to the bit to one by itself.

Loops over lanes hold no call and no branch, so that the compiler makes vector instructions of them. What a
lane needs now and then (draws, a large angle's sine, another walker) it gets between them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import allocation_free, allocation_free_inlined
from fieldmodels.elementary import NEAR, sine_and_cosine, sine_and_cosine_near
from fieldmodels.machines.heel_strike import kalman
from fieldmodels.machines.heel_strike.estimators import observer_step, ranger_step
from fieldmodels.machines.heel_strike.leg import leg_step
from fieldmodels.machines.heel_strike.walker import BANK, COLLISION, GYRO, PROCESS
from fieldmodels.streams import draw_gaussians, symmetric

BESIDE, FEW = 8, 4
"""Walkers that go side by side, and how many make it worth while."""
AHEAD = 64
"""Samples for which a lane draws the gyro's white noise ahead."""
NONE = -1
"""Number of the walker in a lane that is left over: it swings on, and nobody looks."""
WHOLE = (
    "walker", "sample", "taken",  # its number, samples since the start, samples of this swing
    "limit", "envelope", "due",  # samples: of a swing at most, of the collision's time, until the next torque
    "struck", "over", "cromer",  # 1 if the leg has struck, if the swing is over, if (2.14) integrates
)  # fmt: skip
NUMBERS = (
    "theta", "omega", "torque", "stiffness",  # truth [rad, rad/s, rad/s2, 1/s2]
    "white", "noise", "fade", "error", "gyro",  # noises, the second's envelope, their sum, the reading
    "agent_theta", "agent_omega", "early", "late", "decay",  # the agent's estimator, its gains
    "ranger_gyro", "swung",  # the latest reading, Ranger's change of the angle since the strike
    "torque_square", "collision_square",  # sums of the reference filter's squares
    "sine", "cosine", "agent_sine", "filter_sine", "filter_cosine",  # of the angles at the sample's beginning
    "step", "believed",  # sampling interval [s], stiffness of the nominal leg [1/s2]
    "collision", "correlation", "drive", "gyro_noise",  # sizes of the noises
    "gyro_variance", "torque_memory", "torque_drive", "collision_drive",  # what the reference filter is given
)  # fmt: skip


def room_for(batch: int) -> np.dtype[Any]:
    """Room for the swings of so many walkers: of each quantity one number a lane.

    Of an array in a record the compiler knows the shape, which the loops over lanes need.
    """
    lanes = BESIDE if batch >= FEW else 1
    return np.dtype([
        *((name, np.int64, (lanes,)) for name in WHOLE),
        *((name, np.float64, (lanes,)) for name in NUMBERS),
        ("key", np.uint64, (lanes,)),  # of the collision noise
        ("ahead", np.float64, (lanes, AHEAD)),
        ("flat", np.float64, (AHEAD,)),
        ("outer", np.int64, (AHEAD,)),
        ("ekf", np.float64, (kalman.ROW, lanes)),
    ])  # fmt: skip


@allocation_free_inlined
def enter(s: Any, m: int, b: int, w: Any, gains: FloatArray, length: float, c: Any) -> None:
    """Let walker ``b`` begin its swing in a lane, with the gains of its agent, on a leg of a length [m]."""
    s.walker[m], s.sample[m], s.taken[m] = b, w.sample, 0
    s.limit[m], s.envelope[m], s.cromer[m] = c.limit, c.envelope, c.cromer
    s.theta[m], s.omega[m], s.torque[m] = w.theta, w.omega, w.torque
    s.noise[m] = c.first * symmetric(w.keys[COLLISION], -1 - w.stride)
    s.agent_theta[m], s.agent_omega[m], s.ranger_gyro[m] = w.agent_theta, w.agent_omega, w.ranger_gyro
    s.swung[m], s.torque_square[m], s.collision_square[m] = 0.0, 0.0, 0.0
    s.early[m], s.late[m], s.decay[m] = gains[0], gains[1], gains[3]
    s.step[m], s.stiffness[m], s.believed[m] = c.step, c.gravity / length, c.stiffness
    s.collision[m], s.correlation[m], s.drive[m] = c.collision[w.collision_level], c.correlation, c.drive
    s.gyro_noise[m], s.gyro_variance[m] = c.gyro, c.gyro_variance
    s.torque_memory[m], s.torque_drive[m], s.collision_drive[m] = (
        c.torque_memory, c.levels[BANK, 0], c.levels[BANK, 1],
    )  # fmt: skip
    s.key[m] = w.keys[COLLISION]
    for r in range(kalman.ROW):
        s.ekf[r, m] = w.ekf[r]
    s.due[m] = -w.sample % c.hold
    draw_ahead(s, m, w, c)


@allocation_free_inlined
def draw_ahead(s: Any, m: int, w: Any, c: Any) -> None:
    """Draw a lane's torque where the last one has been held for its time, and the gyro's noises ahead."""
    if s.taken[m] % AHEAD == 0:
        draw_gaussians(w.keys[GYRO], s.sample[m] + 1, s.ahead[m], s.flat, s.outer)
    if s.due[m] == 0:
        s.torque[m] = c.process[w.process_level] * symmetric(w.keys[PROCESS], s.sample[m] // c.hold)
        s.due[m] = c.hold


@allocation_free_inlined
def leave(s: Any, m: int, w: Any) -> None:
    """Give a walker the state that its swing has led to."""
    w.theta, w.omega, w.torque, w.sample = s.theta[m], s.omega[m], s.torque[m], s.sample[m]
    w.agent_theta, w.agent_omega, w.ranger_gyro = s.agent_theta[m], s.agent_omega[m], s.ranger_gyro[m]
    for r in range(kalman.ROW):
        w.ekf[r] = s.ekf[r, m]
    s.walker[m], s.limit[m] = NONE, np.iinfo(np.int64).max


@allocation_free_inlined
def prepare(s: Any) -> None:
    """Give all lanes the noises of the next sample, and the sines at its beginning."""
    lanes, far = len(s.theta), 0
    for m in range(lanes):
        s.white[m] = s.ahead[m, s.taken[m] % AHEAD]
    for m in range(lanes):
        s.sample[m] += 1
        s.noise[m] = s.correlation[m] * s.noise[m] + s.drive[m] * symmetric(s.key[m], s.sample[m])
        middle = kalman.middle(s.ekf[:, m], s.step[m])
        s.sine[m], s.cosine[m] = sine_and_cosine_near(s.theta[m])
        s.agent_sine[m], _ = sine_and_cosine_near(s.agent_theta[m])
        s.filter_sine[m], s.filter_cosine[m] = sine_and_cosine_near(middle)
        far += 1 if max(abs(s.theta[m]), abs(s.agent_theta[m]), abs(middle)) > NEAR else 0
    if far > 0:
        for m in range(lanes):
            s.sine[m], s.cosine[m] = sine_and_cosine(s.theta[m])
            s.agent_sine[m], _ = sine_and_cosine(s.agent_theta[m])
            s.filter_sine[m], s.filter_cosine[m] = sine_and_cosine(kalman.middle(s.ekf[:, m], s.step[m]))


@allocation_free_inlined
def move(s: Any, first: int, end: int, plant: Any, extended: bool) -> None:
    """Move the legs of some lanes by a sample, and read a gyro without effects."""
    for m in range(first, end):
        before, time = s.theta[m], (s.sample[m] - 1) * s.step[m]
        s.theta[m], s.omega[m] = leg_step(
            before, s.omega[m], s.torque[m], (s.sine[m], s.cosine[m]), time, s.step[m], s.stiffness[m], plant,
            extended,
        )  # fmt: skip
        s.struck[m] = ((before < 0.0) & (s.theta[m] >= 0.0)) | ((before > 0.0) & (s.theta[m] <= 0.0))
        s.taken[m] += 1
        s.fade[m] = max(0.0, 1.0 - s.taken[m] / s.envelope[m])
        s.error[m] = s.fade[m] * s.collision[m] * s.noise[m] + s.gyro_noise[m] * s.white[m]
        s.gyro[m] = s.omega[m] + s.error[m]


@allocation_free_inlined
def follow(s: Any) -> int:
    """Let the estimators of all lanes follow the gyro; returns how many lanes need something now."""
    waiting = 0
    for m in range(len(s.theta)):
        gyro, step, first, later = s.gyro[m], s.step[m], s.early[m], s.late[m]
        early = s.taken[m] <= s.envelope[m]
        s.agent_theta[m], s.agent_omega[m] = observer_step(
            s.agent_theta[m], s.agent_sine[m], s.agent_omega[m], gyro, step, s.believed[m],
            first if early else later, s.decay[m], s.cromer[m],
        )  # fmt: skip
        s.swung[m] = ranger_step(s.swung[m], s.ranger_gyro[m], gyro, step)
        s.ranger_gyro[m] = gyro
        f = s.ekf[:, m]
        kalman.predict(
            f, (s.filter_sine[m], s.filter_cosine[m]), step, s.believed[m], s.torque_memory[m],
            s.torque_drive[m], s.correlation[m], s.collision_drive[m],
        )  # fmt: skip
        kalman.update_gyro(f, gyro, s.fade[m], s.gyro_variance[m])
        s.collision_square[m] += f[3] * f[3] if early else 0.0
        s.torque_square[m] += 0.0 if early else f[2] * f[2]
        s.due[m] -= 1
        s.over[m] = s.struck[m] | (s.taken[m] >= s.limit[m])
        waiting += s.over[m] | (s.due[m] == 0) | (s.taken[m] % AHEAD == 0)
    return waiting


@allocation_free
def swing(s: Any, plants: NDArray[Any]) -> None:
    """Let all lanes, none of which has an effect, swing until one of them needs something."""
    waiting = 0
    while waiting == 0:
        prepare(s)
        move(s, 0, len(s.theta), plants[0], False)
        waiting = follow(s)
