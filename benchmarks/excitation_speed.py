"""Speed of the vehicle's physics: compiled against plain NumPy of the same method, in one run.

python benchmarks/excitation_speed.py
"""

from __future__ import annotations

import time

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.machines.excitation.dynamics import ITERATIONS, SUBSTEPS, simulate
from fieldmodels.machines.excitation.model import ExcitationModel
from fieldmodels.machines.excitation.motion import CONSTANT, arm_motion
from fieldmodels.machines.excitation.parameters import PRESETS, SAMPLE, SAMPLES, Arm
from fieldmodels.machines.excitation.recording import record_experiment

ARM = Arm()


def skew(v: FloatArray) -> FloatArray:
    """Matrix of the vector product with v."""
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def plain_numpy(vehicle: FloatArray, motion: FloatArray, mode: int) -> FloatArray:
    """One mode by the implicit trapezoidal rule on 6 x 6 matrices, as one would write it first; (n, 12).

    Leaves out what is of second order in the vehicle's angles; so the kernel does more for its time.
    """
    h = SAMPLE / SUBSTEPS
    m1, joint, m2 = vehicle[0], vehicle[7:10], ARM.mass
    ixx, iyy, izz, ixz, iyz, ixy = vehicle[1:7]
    inertia = np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
    damping, stiffness = vehicle[10:16], vehicle[16:22]
    axis, gravity = np.eye(3)[mode], np.array([0.0, 0.0, -ARM.gravity])
    forward = np.eye(3)[2 if mode == 1 else 1]

    def pose(f: float) -> FloatArray:
        return np.asarray(np.cos(f) * forward + np.sin(f) * np.cross(axis, forward))

    rest = np.cross(joint + ARM.reach * pose(motion[0, 0]), -m2 * gravity)
    x: FloatArray = np.zeros(6)
    v: FloatArray = np.zeros(6)
    a: FloatArray = np.zeros(6)
    implicit = np.diag(0.5 * h * damping + 0.25 * h * h * stiffness)
    out = np.empty((len(motion) - 1, 12))
    for k in range(1, len(motion)):
        f, f1, f2 = motion[k]
        u = pose(f)
        turn = np.cross(axis, u)
        place = joint + ARM.reach * u
        moved = ARM.reach * (turn * f2 - u * f1 * f1)
        tensor = ARM.inertia_across * np.eye(3) + (ARM.inertia_along - ARM.inertia_across) * np.outer(u, u)
        arm = skew(place)
        mass = np.block([[(m1 + m2) * np.eye(3), -m2 * arm], [m2 * arm, inertia + tensor - m2 * arm @ arm]])
        x0, v0 = x + 0.5 * h * v, v + 0.5 * h * a
        new_v = v0 + 0.5 * h * a
        for _ in range(ITERATIONS):
            w = new_v[3:]
            new_x = x0 + 0.5 * h * new_v
            tilt = -np.cross(new_x[3:], gravity)
            pull = np.cross(w, np.cross(w, place)) + 2 * np.cross(w, ARM.reach * turn * f1) + moved
            spin, drive = w + f1 * axis, f2 * axis + f1 * np.cross(w, axis)
            moment = tensor @ drive + np.cross(spin, tensor @ spin)
            force = (m1 + m2) * tilt - m2 * pull
            weight = np.cross(place, m2 * (tilt + gravity - pull)) + rest
            torque = weight - moment - np.cross(w, inertia @ w)
            known = damping * v0 + stiffness * (x0 + 0.5 * h * v0)
            a = np.linalg.solve(mass + implicit, np.concatenate([force, torque]) - known)
            new_v = v0 + 0.5 * h * a
        x, v = x0 + 0.5 * h * new_v, new_v
        out[k - 1, :6], out[k - 1, 6:] = x, v
    return out


def main() -> None:
    """Print times for a decision of 0.4 s in all modes on one core, and the ratio to plain NumPy."""
    vehicle = PRESETS["soft"]
    motion, _ = arm_motion(np.tile(CONSTANT, (25, 1)), 5.0, per_decision=SAMPLES * SUBSTEPS)
    part = motion[: SAMPLES * SUBSTEPS + 1]
    simulate(vehicle, part, ARM.row(), SAMPLE)
    plain, kernel = np.inf, np.inf
    for _ in range(3):
        begin = time.process_time()
        for mode in range(3):
            rough = plain_numpy(vehicle, part, mode)
        plain = min(plain, time.process_time() - begin)
        begin = time.process_time()
        for _ in range(20):
            simulate(vehicle, part, ARM.row(), SAMPLE)
        kernel = min(kernel, (time.process_time() - begin) / 20)
    begin = time.process_time()
    simulate(np.repeat(vehicle[None], 40, axis=0), motion, ARM.row(), SAMPLE)
    batch = (time.process_time() - begin) / 40 / 25
    signals = simulate(vehicle, part, ARM.row(), SAMPLE)[0, 2]
    agreement = (
        np.abs(rough[SUBSTEPS - 1 :: SUBSTEPS, 9:] - signals[:, 12:15]).max() / np.abs(rough[:, 9:]).max()
    )
    model = ExcitationModel()
    recording = record_experiment(np.random.default_rng(0), duration=8.0)
    windows = model.windows(recording, 0.4)
    vectors = np.repeat(model.nominal[None], 20, axis=0)
    model.simulate(vectors, windows)
    begin = time.process_time()
    model.simulate(vectors, windows)
    predicted = (time.process_time() - begin) / 20
    print(f"0.4 s in three modes, {SUBSTEPS} substeps of 1.25 ms; rates agree within {100 * agreement:.1f} %")
    for label, seconds in (("plain NumPy", plain), ("compiled", kernel), ("compiled, batch of 40", batch)):
        print(f"{label:24}{1e3 * seconds:9.3f} ms   {plain / seconds:8.0f} x")
    print(f"diagnosis: 24 s of recording (2400 samples) predicted in {1e3 * predicted:.2f} ms")


if __name__ == "__main__":
    main()
