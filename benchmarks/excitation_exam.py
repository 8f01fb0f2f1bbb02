"""Exam of the excitation diagnosis: hide each effect, nothing, or what the library does not list.

    python benchmarks/excitation_exam.py --first 1000 --seeds 2 --clean 8

One run of 8 s a mode, 100 Hz, random sinusoids within the wide limits. Sizes are a third to
a half of those in the tests. One line a diagnosis, as it comes. ``--body`` refits all 22
unknowns instead of the suspension alone; ``--vehicle table1`` takes Table I's suspension.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable, Mapping

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis import diagnose
from fieldmodels.machines.excitation.model import ExcitationModel
from fieldmodels.machines.excitation.recording import record_experiment
from fieldmodels.reality import Reality

HIDDEN: Mapping[str, Mapping[str, float]] = {
    "payload": {"mass": 0.01},
    "cubic_stiffness": {"force": 20.0, "torque": 0.7},
    "coulomb_friction": {"force": 0.04, "torque": 0.015},
    "stiffness_drift": {"rate": 0.002},
    "soil_compliance": {"share": 0.05},
    "actuator_lag": {"time_constant": 0.001},
    "accelerometer_bias": {"x": 0.004, "y": -0.002},
    "accelerometer_gain": {"gain": 1.005},
    "inclinometer_bias": {"pitch": 0.0005, "roll": -0.0003},
    "inclinometer_delay": {"delay": 0.0015},
    "force_torque_gain": {"gain": 1.004},
}


def toothed(commands: FloatArray, _step: float) -> FloatArray:
    """An arm whose gear errs with its angle, 10 mrad eight times a radian: not in the library."""
    return commands + np.column_stack([0.01 * np.sin(8.0 * commands[:, 0]), 0.0 * commands[:, 1]])


def main() -> None:
    """Examine and print a table."""
    parser = argparse.ArgumentParser(description="Exam of the excitation diagnosis.")
    parser.add_argument("--first", type=int, default=1000)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--clean", type=int, default=8)
    parser.add_argument("--outside", type=int, default=2)
    parser.add_argument("--body", action="store_true")
    parser.add_argument("--vehicle", default="soft")
    options = parser.parse_args()
    model = ExcitationModel(options.vehicle, refit_body=options.body)
    table: dict[str, Counter[str]] = {}

    def ask(
        label: str,
        truth: str,
        seed: int,
        coloured: float = 0.0,
        applied: Callable[[FloatArray, float], FloatArray] | None = None,
    ) -> None:
        reality = Reality(effects={truth: HIDDEN[truth]} if truth else {})
        rng = np.random.default_rng(seed)
        run = record_experiment(rng, reality, duration=8.0, coloured=coloured, model=model, applied=applied)
        found = diagnose(model, [run])
        sets = [{c.effect, *c.alternatives} for c in found.causes]
        result: str = found.verdict
        if truth and found.verdict == "named" and sets == [{truth}]:
            result = "right alone"
        elif truth and len(sets) == 1 and truth in sets[0]:
            result = "in set"
        elif truth and sets:
            result = "wrong"
        table.setdefault(label, Counter())[result] += 1
        print(f"{label:24} seed {seed}: {result:12} {found.summary()} ({found.seconds:.0f} s)", flush=True)

    for k in range(options.clean):
        wandering = k % 2 == 1
        ask("nothing, coloured noise" if wandering else "nothing", "", options.first + k, 0.3 * wandering)
    for k in range(options.seeds):
        for effect in HIDDEN:
            ask(effect, effect, options.first + 100 + k)
    for k in range(options.outside):
        ask("outside: gear error", "", options.first + 200 + k, applied=toothed)
    for label, counts in table.items():
        print(f"{label:24}" + ", ".join(f"{n} {result}" for result, n in counts.items()))


if __name__ == "__main__":
    main()
