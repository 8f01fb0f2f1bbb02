"""How often the diagnosis of flights is right, on seeds of one's own choice.

python benchmarks/uav_route_exam.py --first 3000 --seeds 12 --clean 30
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from fieldmodels.diagnosis import diagnose
from fieldmodels.recording import Recording
from fieldmodels.uav_route.model import UavRoute
from fieldmodels.uav_route.recording import record_flight

MODEL = UavRoute()
DURATION = 4000.0
SMALL = {
    "wind": {"north": 0.3, "east": -0.2},
    "turn_speed_loss": {"share": 0.01},
    "weaker_bank": {"factor": 0.98},
    "sensor_bias": {"north": 20.0, "east": -10.0},
}
MODERATE = {
    "wind": {"north": 1.0, "east": -0.7},
    "turn_speed_loss": {"share": 0.03},
    "weaker_bank": {"factor": 0.95},
    "sensor_bias": {"north": 50.0, "east": -30.0},
}


def with_positions(recording: Recording, change: Callable[..., np.ndarray]) -> Recording:
    """The same log with both coordinates changed."""
    signals = dict(recording.signals)
    for name in ("north", "east"):
        signals[name] = change(recording.time, signals[name])
    return replace(recording, signals=signals)


FOREIGN: dict[str, Callable[..., np.ndarray]] = {
    "position 2 s late": lambda time, values: np.interp(time - 2.0, time, values),
    "position 1 % too far out": lambda _time, values: 1.01 * values,
    "position wanders by 150 m": lambda time, values: values + 150.0 * np.sin(2 * np.pi * time / 700.0),
}


def verdict(recording: Recording) -> str:
    """Verdict and causes in one word."""
    result = diagnose(MODEL, [recording])
    return " ".join([result.verdict, *(cause["effect"] for cause in result.to_json()["causes"])])


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=3000)
    parser.add_argument("--seeds", type=int, default=12)
    parser.add_argument("--clean", type=int, default=30)
    options = parser.parse_args()

    def flight(seed: int, reality: object = None) -> Recording:
        return record_flight(reality, DURATION, rng=np.random.default_rng(seed))

    seeds = range(options.first, options.first + options.seeds)
    clean = Counter(verdict(flight(options.first + 10_000 + i)) for i in range(options.clean))
    print(f"{'nothing':36s}{dict(clean)}", flush=True)
    for size, cases in (("moderate", MODERATE), ("small", SMALL)):
        for effect, values in cases.items():
            found = Counter(verdict(flight(seed, {effect: values})) for seed in seeds)
            print(f"{size + ' ' + effect:36s}{dict(found)}", flush=True)
    for name, change in FOREIGN.items():
        found = Counter(verdict(with_positions(flight(seed), change)) for seed in seeds)
        print(f"{name:36s}{dict(found)}", flush=True)


if __name__ == "__main__":
    main()
