"""Exam of the line-following diagnosis: hide each effect, nothing, or a fault outside the library.

    python benchmarks/line_following_exam.py --first 3000 --seeds 5 --clean 25

Walks of 1000 strides (20 minutes) by eq (3.1) with random turns added, on a straight and on the oval, with an
overhead tracker and with the camera alone. Each effect in three sizes; pairs of effects; the rigid bodies
with slippery feet and with a weak motor, which the kinematic model has to name. One line a diagnosis, as it
comes. Seeds are apart from the tests'.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.result import Diagnosis
from fieldmodels.machines.line_following import recording as walked
from fieldmodels.machines.line_following.body import Hardware
from fieldmodels.machines.line_following.model import LineFollowing
from fieldmodels.machines.line_following.parameters import Noise
from fieldmodels.machines.line_following.recording import GENTLE, LAW, record_walk
from fieldmodels.machines.line_following.tracks import Track, oval, straight
from fieldmodels.machines.line_following.walks import Scene, Walks
from fieldmodels.model import ModelError
from fieldmodels.recording import Recording

STRIDES = 1000
QUIET = Noise(bias=0.0)
SIZES: Mapping[str, tuple[Mapping[str, float], ...]] = {
    "steering_bias": ({"turn": 0.003}, {"turn": -0.008}, {"turn": 0.02}),
    "turn_gain": ({"factor": 0.93}, {"factor": 0.8}, {"factor": 1.2}),
    "actuator_delay": ({"strides": 0.1}, {"strides": 0.3}, {"strides": 1.0}),
    "foot_slip": (
        {"turn": 0.1, "twist": 0.07, "step": 0.02},
        {"turn": 0.2, "twist": 0.15, "step": 0.05},
        {"turn": 0.4, "twist": 0.3, "step": 0.1},
    ),
    "camera_yaw": ({"angle": 0.01}, {"angle": -0.03}, {"angle": 0.08}),
    "camera_pitch": ({"angle": 0.04}, {"angle": -0.08}, {"angle": 0.12}),
    "sensor_gain": ({"factor": 1.06}, {"factor": 0.85}, {"factor": 1.3}),
    "sensor_quantisation": ({"step": 0.05}, {"step": 0.08}, {"step": 0.12}),
    "actuator_saturation": ({"turn": 0.12}, {"turn": 0.08}, {"turn": 0.05}),
}
PAIRS: tuple[Mapping[str, Mapping[str, float]], ...] = (
    {"steering_bias": {"turn": 0.012}, "camera_yaw": {"angle": 0.05}},
    {"turn_gain": {"factor": 0.8}, "sensor_gain": {"factor": 1.25}},
    {"steering_bias": {"turn": 0.012}, "actuator_saturation": {"turn": 0.06}},
    {"turn_gain": {"factor": 0.85}, "camera_pitch": {"angle": 0.1}},
    {"steering_bias": {"turn": 0.012}, "sensor_quantisation": {"step": 0.1}},
    {"foot_slip": {"turn": 0.3, "twist": 0.2, "step": 0.06}, "camera_yaw": {"angle": 0.05}},
)
BODIES: Mapping[str, tuple[Hardware, str]] = {
    "friction 0.25": (Hardware(friction=0.25), "foot_slip"),
    "friction 0.15": (Hardware(friction=0.15), "foot_slip"),
    "motor of 0.2 N m": (Hardware(motor=0.2), "actuator_saturation"),
    "motor of 0.15 N m": (Hardware(motor=0.15), "actuator_saturation"),
}


class Faulty(Walks):
    """A robot whose fault is in no list: of its motor, of its feet, of its sensor.

    Attributes:
        fault: What it does to a commanded turn, given the turn before [rad].
        drift: Sideways slip for each turn [m/rad].
        bent: Cubic part of the sensor [1/m^2].
        smeared: Share of the last reading in each.
    """

    fault: Callable[[float, float], float] = staticmethod(lambda turn, _: turn)
    drift = bent = smeared = 0.0

    def advance(self, commands: Any) -> None:
        """See ``Walks.advance``; what was commanded is what is remembered."""
        one = self.walks[0]
        asked = float(np.asarray(commands)[0])
        done = self.fault(asked, float(one["turned"]))
        lines = one["lines"][0].copy()
        one["x"] -= self.drift * done * np.sin(one["heading"])
        one["y"] += self.drift * done * np.cos(one["heading"])
        super().advance(np.array([done]))
        one["commands"][0] = asked
        place = float(one["lines"][0, 0])
        place = self.smeared * float(lines[0]) + (1.0 - self.smeared) * (place + self.bent * place**3)
        one["lines"][0, 0] = place


OUTSIDE: Mapping[str, tuple[Mapping[str, Any], tuple[float, float, float]]] = {
    "turns less to the left, by 20 %": (
        {"fault": staticmethod(lambda turn, _: turn * (0.8 if turn > 0 else 1.0))}, LAW,
    ),
    "dead zone of 0.05 rad": (
        {"fault": staticmethod(lambda turn, _: turn if abs(turn) > 0.05 else 0.0)}, GENTLE,
    ),
    "rate limit of 0.1 rad a stride": (
        {"fault": staticmethod(lambda turn, last: float(np.clip(turn, last - 0.1, last + 0.1)))}, GENTLE,
    ),
    "sideways drift of 0.4 m/rad of turn": ({"drift": 0.4}, LAW),
    "sensor bent by 20 x^3": ({"bent": 20.0}, GENTLE),
    "sensor smeared over strides": ({"smeared": 0.4}, LAW),
}  # fmt: skip


def outcome(found: Diagnosis, truth: set[str]) -> str:
    """What became of one or two hidden effects."""
    sets = [{c.effect, *c.alternatives} for c in found.causes]
    hit = sum(any(name in one for one in sets) for name in truth)
    if hit == len(truth) == len(sets):
        return "right" if all(len(one) == 1 for one in sets) else "in a set"
    if not sets:
        return str(found.verdict)
    if hit == len(truth):
        return "with more"
    return "in part" if hit and hit == len(sets) else "wrong"


def faulty_walk(
    changes: Mapping[str, Any], law: tuple[float, float, float], rng: np.random.Generator
) -> Recording:
    """A walk by a robot with a fault outside the library."""
    made = walked.Walks
    walked.Walks = type("Faulty", (Faulty,), dict(changes))  # type: ignore[misc]
    try:
        return record_walk(None, STRIDES, law=law, rng=rng)
    finally:
        walked.Walks = made  # type: ignore[misc]


def main() -> None:
    parser = argparse.ArgumentParser(description="Exam of the line-following diagnosis.")
    parser.add_argument("--first", type=int, default=3000)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--clean", type=int, default=10)
    options = parser.parse_args()
    model = LineFollowing()
    table: dict[str, Counter[str]] = {}
    seconds: list[float] = []

    def ask(
        label: str, truth: set[str] | None, record: Callable[..., Recording], *what: Any, **how: Any
    ) -> None:
        try:
            recording = record(*what, **how)
        except ModelError as error:
            table.setdefault(label, Counter())["left the line"] += 1
            print(f"{label:52}{error}", flush=True)
            return
        began = time.perf_counter()
        found = diagnose(model, [recording])
        seconds.append(time.perf_counter() - began)
        named = "named" if found.causes else str(found.verdict)
        result = outcome(found, truth) if truth else named
        table.setdefault(label, Counter())[result] += 1
        print(f"{label:52}{result:14}{found.summary()}", flush=True)

    def scene(track: Track, **changes: Any) -> Scene:
        return Scene(track, noise=QUIET, **changes)

    lines = {"straight": straight(STRIDES * 0.7 + 10.0), "oval": oval()}
    for name, track in lines.items():
        for tracked in (True, False):
            told = "tracker and camera" if tracked else "camera alone"
            for k in range(options.clean):
                rng = np.random.default_rng(options.first + k)
                ask(
                    f"nothing, {told}, {name}", None,
                    record_walk, None, STRIDES, scene=scene(track), tracked=tracked, rng=rng,
                )  # fmt: skip
            for effect, sizes in SIZES.items():
                for size, values in enumerate(sizes):
                    slow = effect == "actuator_delay" and values["strides"] >= 1.0
                    if slow and name == "oval":
                        continue  # the gentle law does not keep to a curve
                    for k in range(options.seeds):
                        rng = np.random.default_rng(options.first + 1000 + 10 * k + size)
                        ask(
                            f"{effect} {('small', 'middle', 'large')[size]}, {told}", {effect},
                            record_walk, {effect: values}, STRIDES, scene=scene(track),
                            law=GENTLE if slow else LAW, tracked=tracked, rng=rng,
                        )  # fmt: skip
    for k in range(options.seeds):
        for pair in PAIRS:
            rng = np.random.default_rng(options.first + 2000 + k)
            ask("two: " + " + ".join(pair), set(pair), record_walk, pair, STRIDES, rng=rng)
        for label, (hardware, effect) in BODIES.items():
            rng = np.random.default_rng(options.first + 3000 + k)
            rigid = scene(lines["straight"], plant="pymunk", hardware=hardware)
            ask(f"rigid bodies: {label}", {effect}, record_walk, None, STRIDES, scene=rigid, rng=rng)
        for label, (changes, law) in OUTSIDE.items():
            rng = np.random.default_rng(options.first + 4000 + k)
            ask(f"outside: {label}", None, faulty_walk, changes, law, rng)
    for label, counts in table.items():
        print(f"{label:60}" + ", ".join(f"{n} {result}" for result, n in counts.items()))
    print(f"{len(seconds)} diagnoses, median {np.median(seconds):.2f} s, longest {max(seconds):.2f} s")


if __name__ == "__main__":
    main()
