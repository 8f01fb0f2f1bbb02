"""Exam of the heel-strike diagnosis at nominal noise: hide each effect, nothing, or a cogging torque.

    python benchmarks/heel_strike_exam.py --first 100 --seeds 2 --clean 4

Four minutes at 500 Hz a walk. One line a diagnosis, as it comes; the tests' own exam is on quieter walks.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Mapping

import numpy as np

from fieldmodels.diagnosis import diagnose
from fieldmodels.machines.heel_strike.parameters import Noise
from fieldmodels.machines.heel_strike.recording import record_walk
from fieldmodels.reality import Reality
from fieldmodels.registry import get_model

HIDDEN: Mapping[str, Mapping[str, float]] = {
    "viscous_friction": {"rate": 0.15},
    "coulomb_friction": {"acceleration": 0.2},
    "quadratic_drag": {"coefficient": 0.25},
    "constant_force": {"acceleration": 0.1},
    "periodic_force": {"sine": 0.3, "frequency": 1.37},
    "gyro_bias": {"rate": 0.0043},
    "gyro_drift": {"rate": 5e-5},
    "gyro_gain": {"gain": 1.03},
    "gyro_delay": {"delay": 0.006},
    "gyro_quantisation": {"step": 0.02},
    "parameter_step": {"rate": 0.012, "time": 120.0},
}


def main() -> None:
    parser = argparse.ArgumentParser(description="Exam of the heel-strike diagnosis.")
    parser.add_argument("--first", type=int, default=100)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--clean", type=int, default=4)
    options = parser.parse_args()
    model = get_model("heel_strike")
    table: dict[str, Counter[str]] = {}

    def ask(label: str, truth: str, seed: int, kind: str, cogging: tuple[float, float] = (0.0, 1.0)) -> None:
        reality = Reality(effects={truth: HIDDEN[truth]} if truth else {})
        noise = Noise(collision_kind=kind)
        walk = record_walk(240.0, np.random.default_rng(seed), noise, reality, cogging=cogging)
        found = diagnose(model, [walk])
        sets = [{c.effect, *c.alternatives} for c in found.causes]
        if not truth:
            result = found.verdict
        elif found.verdict == "named" and sets == [{truth}]:
            result = "right alone"
        elif len(sets) == 1 and truth in sets[0]:
            result = "in set"
        else:
            result = "wrong" if sets else found.verdict
        table.setdefault(label, Counter())[result] += 1
        print(f"{label:24} seed {seed}: {result:12} {found.summary()} ({found.seconds:.0f} s)", flush=True)

    for kind in ("low_pass", "ar1"):
        for k in range(options.clean):
            ask(f"nothing, {kind}", "", options.first + k, kind)
    for k in range(options.seeds):
        for effect in HIDDEN:
            ask(effect, effect, options.first + 20 + k, "low_pass")
        ask("outside: cogging", "", options.first + 40 + k, "low_pass", (1.0, 25.0))
    for label, counts in table.items():
        print(f"{label:24}" + ", ".join(f"{n} {result}" for result, n in counts.items()))


if __name__ == "__main__":
    main()
