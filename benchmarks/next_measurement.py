"""What planned measurements are expected to yield, and what they do: a lag against a delay on the rig.

    python benchmarks/next_measurement.py --first 3100 --cases 4

Each case is diagnosed from 24 s at 100 Hz (and 12 s to measure gains on), then again with what the first
diagnosis planned beside it.
"""

from __future__ import annotations

import argparse

import numpy as np

from fieldmodels.diagnosis import Diagnosis, diagnose
from fieldmodels.recording import Recording
from fieldmodels.registry import get_model
from fieldmodels.synthesis import synthesise

HIDDEN = {
    "actuator_lag": {"time_constant": 0.004},
    "actuator_delay": {"delay": 0.004},
}


def verdict(found: Diagnosis, truth: str) -> str:
    """What became of the hidden effect."""
    sets = [{cause.effect, *cause.alternatives} for cause in found.causes]
    if sets == [{truth}]:
        return "right alone"
    if len(sets) == 1 and truth in sets[0]:
        return f"in a set of {len(sets[0])}"
    return "wrong" if sets else found.verdict


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--first", type=int, default=3100)
    parser.add_argument("--cases", type=int, default=4)
    options = parser.parse_args()
    rig = get_model("rig")

    def record(reality: dict[str, dict[str, float]], seed: list[int], duration: float) -> Recording:
        rng = np.random.default_rng(seed)
        return synthesise(rig, reality, "mixed", duration=duration, amplitude=8.0, rng=rng)

    for seed in range(options.first, options.first + options.cases):
        for truth, values in HIDDEN.items():
            reality = {truth: values}
            train, test = record(reality, [seed, 0], 24.0), record(reality, [seed, 1], 12.0)
            first = diagnose(rig, [train], [test])
            line = f"{seed} {truth}: {verdict(first, truth)}"
            planned = first.next_measurement
            if planned is not None and planned.plan is not None:
                force = {"force": planned.plan["force"]}
                again = synthesise(rig, reality, force, rng=np.random.default_rng([seed, 2]))
                second = diagnose(rig, [train, again], [test])
                effects = {row[0]: row[1] for row in second.evidence.ranking}
                (other,) = set(HIDDEN) - {truth}
                lead = effects[truth] - effects.get(other, np.nan)
                line += (
                    f"; {planned.input['kind']} of {planned.input['shortest_s']:g} s for "
                    f"{planned.input['duration_s']:.0f} s promises {planned.input['nats']:.1f} nats: "
                    f"{verdict(second, truth)}, {lead:.1f} nats ahead"
                )
            print(line, flush=True)


if __name__ == "__main__":
    main()
