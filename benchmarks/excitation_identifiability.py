"""What constant excitation (24) says of each unknown, for both presets: the table of the docs page.

python benchmarks/excitation_identifiability.py
"""

from __future__ import annotations

import numpy as np

from fieldmodels.machines.excitation.dynamics import SUBSTEPS
from fieldmodels.machines.excitation.identifiability import identifiability
from fieldmodels.machines.excitation.motion import CONSTANT, arm_motion
from fieldmodels.machines.excitation.parameters import PRESETS, SAMPLES


def main() -> None:
    """Print rank, what is prior only, and the bounds."""
    motion, _ = arm_motion(np.tile(CONSTANT, (25, 1)), 5.0, per_decision=SAMPLES * SUBSTEPS)
    for name, vehicle in PRESETS.items():
        report = identifiability(vehicle, motion)
        spread = report.singular[0] / report.singular[-1]
        print(f"\n{name}: rank {report.rank} of 22, singular values over a factor of {spread:.0f}")
        print(f"prior only: {', '.join(report.prior_only) or 'none'}\n")
        print("\n".join(report.lines()))


if __name__ == "__main__":
    main()
