"""Exam of the pose-reaching diagnosis: hide each effect, nothing, or a fault outside the library.

    python benchmarks/pose_reaching_exam.py --first 3000 --seeds 5 --clean 50
    FIELDGYM_DATA=... python benchmarks/pose_reaching_exam.py --real

Two minutes at 20 Hz a drive, with measured wheel speeds and with the pose alone. Sizes add about 30 % to the
error of the nominal robot. One line a diagnosis, as it comes. Seeds are apart from the tests'. ``--real``
prints what the causes that are named on the Warthog vehicle change in its error at the end of two seconds.
"""

from __future__ import annotations

import argparse
import math
import time
from collections import Counter
from collections.abc import Callable, Mapping

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.result import Diagnosis
from fieldmodels.machines.pose_reaching.model import PoseReaching
from fieldmodels.machines.pose_reaching.recording import record_drive
from fieldmodels.recording import Recording

DURATION = 120.0
HIDDEN: Mapping[bool, Mapping[str, Mapping[str, float]]] = {
    True: {  # with the wheels' speeds
        "actuator_gain": {"gain": 0.995},
        "turn_gain": {"gain": 0.981},
        "actuator_lag": {"time_constant": 0.0011},
        "actuator_rate_limit": {"rate": 120.0},
        "actuator_delay": {"delay": 0.0011},
        "actuator_saturation": {"limit": 1.17},
        "actuator_dead_zone": {"width": 0.0026},
        "unequal_wheels": {"difference": 0.0051},
        "yaw_slip": {"share": 0.012},
        "sideways_slip": {"coefficient": 0.0098},
        "slope": {"x": 0.0085, "y": 0.0085},
        "sensor_delay": {"delay": 0.0051},
        "heading_bias": {"angle": 0.015},
        "parameter_step": {"time": 50.0, "factor": 0.99},
    },
    False: {  # with the pose alone
        "actuator_gain": {"gain": 0.988},
        "turn_gain": {"gain": 0.988},
        "actuator_lag": {"time_constant": 0.0051},
        "actuator_rate_limit": {"rate": 60.0},
        "actuator_delay": {"delay": 0.0051},
        "actuator_saturation": {"limit": 1.15},
        "actuator_dead_zone": {"width": 0.0033},
        "unequal_wheels": {"difference": 0.0051},
        "yaw_slip": {"share": 0.012},
        "sideways_slip": {"coefficient": 0.0098},
        "slope": {"x": 0.0085, "y": 0.0085},
        "sensor_delay": {"delay": 0.0051},
        "heading_bias": {"angle": 0.015},
        "parameter_step": {"time": 50.0, "factor": 0.985},
    },
}


def rate_limited(commands: FloatArray, step: float) -> FloatArray:
    """A controller that ramps speed and turn rate, not the wheels, by at most 4 m/s^2 and 30 rad/s^2."""
    result = np.empty_like(commands)
    now = np.zeros(2)
    reach = np.array([4.0, 30.0]) * step
    for i, aim in enumerate(commands):
        now = now + np.clip(aim - now, -reach, reach)
        result[i] = now
    return result


def weak_to_the_left(commands: FloatArray, step: float) -> FloatArray:
    """A drive that turns by 5 % less to the left than to the right."""
    del step
    result = commands.copy()
    result[:, 1] *= np.where(result[:, 1] > 0, 0.95, 1.0)
    return result


def understeer(commands: FloatArray, step: float) -> FloatArray:
    """A drive that turns the less, the faster it goes: by 8 % at 1 m/s."""
    del step
    result = commands.copy()
    result[:, 1] /= 1.0 + 0.08 * result[:, 0] ** 2
    return result


def hard_iron(recording: Recording, largest: float) -> Recording:
    """A compass whose error depends on the heading: so much at most [rad]."""
    recording.signals["heading"][:] += largest * np.sin(recording["heading"])
    return recording


OUTSIDE: Mapping[str, Callable[[FloatArray, float], FloatArray]] = {
    "rate limit of the body": rate_limited,
    "weak to the left": weak_to_the_left,
    "understeer": understeer,
}
COMPASS = (0.02, 0.03, 0.05)
"""Errors of a compass, outside the library [rad]: two, three and five times the heading's noise."""


def outcome(found: Diagnosis, truth: str) -> str:
    """What became of a hidden effect."""
    sets = [{c.effect, *c.alternatives} for c in found.causes]
    if sets == [{truth}]:
        return "right alone"
    if len(sets) == 1 and truth in sets[0]:
        return f"in set of {len(sets[0])}"
    if any(truth in s for s in sets):
        return "with more"
    return "wrong" if sets else found.verdict


def real() -> None:
    """The Warthog vehicle: errors at the end of 2 s, with what is named added one by one."""
    from fieldmodels.recording.datasets import open_recording

    model = PoseReaching()
    train, test = (open_recording(f"drive_ugv/warthog_{half}_steps", model) for half in ("even", "odd"))
    found = diagnose(model, [train], [test])
    print(found.summary())
    windows = model.windows(test, 2.0)
    measured = windows.measured(tuple(o.name for o in model.outputs))
    vector = model.vector(dict(test.known))
    print(f"{'':24}{'place [m]':>12}{'heading [deg]':>15}{'wheels [rad/s]':>16}")
    for name in ("", *(c.effect for c in found.causes)):
        if name:
            vector[model.slice_of(name)] = found.vector[model.slice_of(name)]
        error = measured - model.simulate(vector[None], windows)[0]
        place = math.sqrt(np.mean(np.sum(error[:, -1, :2] ** 2, axis=1)))
        heading = math.degrees(math.sqrt(np.mean(error[:, -1, 2] ** 2)))
        wheels = math.sqrt(np.mean(error[:, :, 3:] ** 2))
        print(f"{'+ ' + name if name else 'ideal drive':24}{place:12.3f}{heading:15.1f}{wheels:16.2f}")


def main() -> None:
    parser = argparse.ArgumentParser(description="Exam of the pose-reaching diagnosis.")
    parser.add_argument("--first", type=int, default=3000)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--clean", type=int, default=10)
    parser.add_argument("--real", action="store_true")
    options = parser.parse_args()
    if options.real:
        real()
        return
    model = PoseReaching()
    table: dict[str, Counter[str]] = {}
    seconds = []

    def ask(label: str, truth: str, recording: Recording, outside: bool = False) -> None:
        began = time.perf_counter()
        found = diagnose(model, [recording])
        seconds.append(time.perf_counter() - began)
        result = outcome(found, truth) if truth else found.verdict
        if outside and found.causes:
            result = "named"
        table.setdefault(label, Counter())[result] += 1
        print(f"{label:40}{result:14}{found.summary()}", flush=True)

    for wheels, hidden in HIDDEN.items():
        kind = "wheels" if wheels else "pose"
        for k in range(options.clean):
            for coloured in (0.0, 0.5):
                rng = np.random.default_rng(options.first + k)
                label = f"{kind}: nothing, {'wandering' if coloured else 'white'} noise"
                ask(label, "", record_drive(DURATION, rng, wheels=wheels, coloured=coloured))
        for k in range(options.seeds):
            for effect, values in hidden.items():
                rng = np.random.default_rng(options.first + 1000 + k)
                recording = record_drive(DURATION, rng, {effect: values}, wheels=wheels)
                ask(f"{kind}: {effect}", effect, recording)
            for name, applied in OUTSIDE.items():
                rng = np.random.default_rng(options.first + 2000 + k)
                recording = record_drive(DURATION, rng, wheels=wheels, applied=applied)
                ask(f"{kind}: outside: {name}", "", recording, outside=True)
            for largest in COMPASS:
                rng = np.random.default_rng(options.first + 2000 + k)
                recording = hard_iron(record_drive(DURATION, rng, wheels=wheels), largest)
                ask(f"{kind}: outside: compass, {largest:g} rad", "", recording, outside=True)
    for label, counts in table.items():
        print(f"{label:40}" + ", ".join(f"{n} {result}" for result, n in counts.items()))
    print(f"{len(seconds)} diagnoses, median {np.median(seconds):.2f} s, longest {max(seconds):.2f} s")


if __name__ == "__main__":
    main()
