"""Write what ``fieldgym demo`` diagnoses where no real recording can be had: a pendulum with friction.

python docs/demo_recording.py

It is a plant of the exam, integrated in plain Python, which shares no code with the model that is diagnosed.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from exam.plants.axis import Axis, simulate
from exam.plants.axis_listed import install
from exam.plants.commands import path
from fieldmodels.files import write_text

FOLDER = Path(__file__).parents[1] / "agents" / "fieldagents" / "recordings"
INERTIA, GRAVITY = 0.0626, 1.0  # kg m^2, N m: of the model
HIDDEN = {"coulomb_friction": {"torque": 0.15}}  # about that of the real pendulum
STEP, COUNT, NOISE = 0.01, 2000, (2e-3, 5e-2)  # s, samples, rad and rad/s


def recorded(seed: int) -> str:
    """A log as text: time [s], torque [N m], angle [rad], velocity [rad/s]."""
    rng = np.random.default_rng(seed)
    time = STEP * np.arange(COUNT)
    wanted = 1.2 * path(time + 0.5 * STEP, rng)
    needed = np.gradient(np.gradient(wanted, time), time)
    torque = (1.2 * (INERTIA * needed + GRAVITY * np.sin(wanted))).tolist()
    pendulum = Axis(INERTIA, gravity=GRAVITY)
    install(pendulum, HIDDEN, max(map(abs, torque)), linear=False)
    noise = np.array(NOISE) * rng.standard_normal((COUNT, 2))
    rows = simulate(pendulum, lambda i, _shown, _speed: torque[i], noise, STEP)
    text = io.StringIO()
    np.savetxt(
        text, np.column_stack([time, rows]), "%.6g", ",", header="t,torque,angle,velocity", comments=""
    )
    return text.getvalue()


if __name__ == "__main__":
    for seed, name in enumerate(("train", "test")):
        write_text(FOLDER / f"pendulum_{name}.csv", recorded(seed))
