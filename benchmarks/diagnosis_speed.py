"""Processor time of a diagnosis of six records of a rig, one thread, in turns of a plain Python loop.

    python benchmarks/diagnosis_speed.py                     # the small ones
    python benchmarks/diagnosis_speed.py --all --json results/diagnosis_speed.json

The yardstick, a million additions, is timed beside each diagnosis, so that the ratio says the same on a fast
machine and on one that is busy. ``simulations`` is what the diagnosis counts itself.
"""

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.options import DiagnosisOptions
from fieldmodels.recording import Recording
from fieldmodels.registry import get_model
from fieldmodels.synthesis import synthesise

COULOMB, DELAY = {"coulomb_friction": {"force": 0.3}}, {"actuator_delay": {"delay": 0.03}}
RECORDS: dict[str, tuple[dict[str, dict[str, float]], int, float]] = {
    "nothing, 3e3 rows at 100 Hz": ({}, 3_000, 0.01),
    "friction and delay, 3e3 rows at 100 Hz": (COULOMB | DELAY, 3_000, 0.01),
    "friction and delay, 1e4 rows at 100 Hz": (COULOMB | DELAY, 10_000, 0.01),
    "friction and delay, 1e4 rows at 1 kHz": (COULOMB | DELAY, 10_000, 0.001),
    "friction, 1e5 rows at 100 Hz": (COULOMB, 100_000, 0.01),
    "friction, 1e6 rows at 1 kHz": (COULOMB, 1_000_000, 0.001),
}
SMALL = 4
REPEATS = 9


def record(hidden: dict[str, dict[str, float]], rows: int, step: float, seed: int = 1) -> Recording:
    """A bench of so many samples."""
    return synthesise(
        get_model("rig"), hidden, "mixed", duration=rows * step, step=step, amplitude=8.0,
        rng=np.random.default_rng(seed),
    )  # fmt: skip


def yardstick() -> float:
    """Processor time of a million additions [s]."""
    times = []
    for _ in range(REPEATS):
        began, total = time.process_time(), 0.0
        for i in range(1_000_000):
            total += i
        times.append(time.process_time() - began)
    return float(np.median(times))


def main() -> None:
    """Print a line for each record; write them all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--all", action="store_true", help="the long records, too")
    parser.add_argument("--json", type=Path, help="file to write")
    arguments = parser.parse_args()
    diagnose(
        get_model("rig"), [record(COULOMB, 1_500, 0.01)], options=DiagnosisOptions(threads=1)
    )  # compiles
    found: dict[str, dict[str, Any]] = {}
    for name in list(RECORDS)[: None if arguments.all else SMALL]:
        data, unit = record(*RECORDS[name]), yardstick()
        began = time.process_time()
        result = diagnose(get_model("rig"), [data], options=DiagnosisOptions(threads=1))
        spent = time.process_time() - began
        found[name] = {
            "seconds": round(spent, 3),
            "million_additions": round(spent / unit, 1),
            "simulations": round(result.simulations),
            "windows": result.windows[0],
            "named": [c.effect for c in result.causes],
        }
        print(f"{name:40s} {json.dumps(found[name])}", flush=True)
    if arguments.json:
        arguments.json.parent.mkdir(parents=True, exist_ok=True)
        arguments.json.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
