"""Decision time of the path memory against the number of remembered states, for its four forms, in one run.

python benchmarks/path_memory_speed.py
"""

from __future__ import annotations

import time

import numpy as np

from fieldagents.tasks.pose_reaching.path_memory.lookup import FORMS
from fieldagents.tasks.pose_reaching.path_memory.matrices import DISTANCE, EXAMPLE_ANGLE

GRIDS = (DISTANCE, EXAMPLE_ANGLE, EXAMPLE_ANGLE)
"""d, theta and psi: the three matrices of section 5.2.3, 16 + 20 + 20 columns."""
STATES = (126, 10_000, 1_000_000)
DECISIONS = 300


def seconds_a_decision(lookup, measured: np.ndarray, batch: int) -> float:
    """Median processor time of a decision [s]; so many at once."""
    lookup.winners(measured[:batch])
    took, spent = [], 0.0
    for first in range(0, len(measured) - batch + 1, batch):
        begin = time.process_time()
        lookup.winners(measured[first : first + batch])
        took.append((time.process_time() - begin) / batch)
        spent += took[-1] * batch
        if spent > 3.0:
            break
    return float(np.median(took))


def main() -> None:
    """Print microseconds a decision, ratios to the printed form, and that the winners are the same."""
    rng = np.random.default_rng(0)
    print("processor time of one decision, alone [us]; in brackets: of 300 at once; ratio to dense")
    first: dict[str, float] = {}
    for states in STATES:
        columns = np.stack([rng.integers(0, grid.count, states) for grid in GRIDS], axis=1)
        spans = [(grid.low, grid.low + grid.step * (grid.count - 1)) for grid in GRIDS]
        measured = np.stack([rng.uniform(*span, DECISIONS) for span in spans], axis=1)
        lookups = {name: form(columns, GRIDS) for name, form in FORMS.items()}
        matrix_mib = sum(matrix.nbytes for matrix in lookups["dense"].matrices) / 2**20
        winners = {name: lookup.winners(measured[:30]) for name, lookup in lookups.items()}
        same = all((found == winners["dense"]).all() for found in winners.values())
        print(f"{states} states, dense matrices {matrix_mib:.1f} MiB; same winner in all forms: {same}")
        dense = 0.0
        for name, lookup in lookups.items():
            alone = seconds_a_decision(lookup, measured, 1)
            together = seconds_a_decision(lookup, measured, DECISIONS if name == "table" else 30)
            dense = dense or alone
            first.setdefault(name, alone)
            print(
                f"  {name:7s} {1e6 * alone:10.1f} [{1e6 * together:10.2f}]   {dense / alone:8.1f} x faster"
                f" than dense, {alone / first[name]:8.1f} x its own time at {STATES[0]}"
            )


if __name__ == "__main__":
    main()
