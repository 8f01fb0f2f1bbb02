"""Processor time of a diagnosis against the length of the record: rig with Coulomb friction, 100 Hz.

    python benchmarks/diagnosis_speed.py 3000 10000 100000

Ratios are to the first length; beyond the samples that are fitted (``DiagnosisOptions.rows``) they flatten.
"""

import sys
import time

import numpy as np

from fieldmodels.diagnosis import diagnose
from fieldmodels.recording import Recording
from fieldmodels.registry import get_model
from fieldmodels.synthesis import synthesise

STEP, FORCE = 0.01, 0.3


def record(rows: int) -> Recording:
    """A bench of so many samples."""
    hidden = {"coulomb_friction": {"force": FORCE}}
    return synthesise(
        get_model("rig"), hidden, "mixed", duration=rows * STEP, step=STEP, amplitude=8.0,
        rng=np.random.default_rng(1),
    )  # fmt: skip


def main(lengths: list[int]) -> None:
    """Print a line for each length."""
    diagnose(get_model("rig"), [record(1500)])  # compiles
    first = (0, 0.0)
    for rows in lengths:
        data, began = record(rows), time.process_time()
        found = diagnose(get_model("rig"), [data])
        spent = time.process_time() - began
        first = first if first[0] else (rows, spent)
        power = np.log(spent / first[1]) / np.log(rows / first[0]) if rows != first[0] else float("nan")
        names = " + ".join(c.effect for c in found.causes)
        print(
            f"{rows:8d} rows {spent:7.2f} s, {spent / first[1]:5.1f} times the first, exponent {power:.2f}; "
            f"{found.windows[0]} windows fitted; {names}"
        )


if __name__ == "__main__":
    main([int(a) for a in sys.argv[1:]] or [3000, 10_000, 100_000])
