"""What each cause that is named on a real vehicle changes in its error at the end of two seconds.

    FIELDGYM_DATA=... python benchmarks/warthog_errors.py

The Warthog of ``drive_ugv``: causes are named on the even steps and added one by one on the odd ones.
"""

from __future__ import annotations

import math

import numpy as np

from fieldmodels.diagnosis import diagnose
from fieldmodels.machines.pose_reaching.model import PoseReaching
from fieldmodels.recording.datasets import open_recording


def main() -> None:
    model = PoseReaching()
    train, test = (open_recording(f"drive_ugv/warthog_{half}_steps", model) for half in ("even", "odd"))
    found = diagnose(model, [train], [test])
    print(found.summary())
    windows = model.windows(test, 2.0)
    measured = windows.measured(tuple(output.name for output in model.outputs))
    vector = model.vector(dict(test.known))
    print(f"{'':24}{'place [m]':>12}{'heading [deg]':>15}{'wheels [rad/s]':>16}")
    for name in ("", *(cause.effect for cause in found.causes)):
        if name:
            vector[model.slice_of(name)] = found.vector[model.slice_of(name)]
        error = measured - model.simulate(vector[None], windows)[0]
        place = math.sqrt(np.mean(np.sum(error[:, -1, :2] ** 2, axis=1)))
        heading = math.degrees(math.sqrt(np.mean(error[:, -1, 2] ** 2)))
        wheels = math.sqrt(np.mean(error[:, :, 3:] ** 2))
        print(f"{'+ ' + name if name else 'ideal drive':24}{place:12.3f}{heading:15.1f}{wheels:16.2f}")


if __name__ == "__main__":
    main()
