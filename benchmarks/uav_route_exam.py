"""How often the diagnosis of flights is right, on seeds of one's own choice.

python benchmarks/uav_route_exam.py --first 3000 --seeds 12 --clean 30
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from fieldmodels.diagnosis import diagnose
from fieldmodels.machines.uav_route.model import UavRoute
from fieldmodels.machines.uav_route.recording import record_flight
from fieldmodels.recording import Recording

MODEL = UavRoute()
DURATION, EPISODES = 2000.0, 4
SMALL = {
    "wind": {"north": 0.3, "east": -0.2},
    "turn_speed_loss": {"share": 0.01},
    "weaker_bank": {"factor": 0.98},
    "sensor_bias": {"north": 20.0, "east": -10.0},
    "signature_scale": {"factor": 1.3},
    "nose_cone_width": {"factor": 1.1},
    "radar_range_scale": {"factor": 0.95},
    "radar_position": {"north": 8e3, "east": -6e3},
    "look_interval": {"factor": 1.01},
}
MODERATE = {
    "wind": {"north": 1.0, "east": -0.7},
    "turn_speed_loss": {"share": 0.03},
    "weaker_bank": {"factor": 0.95},
    "sensor_bias": {"north": 50.0, "east": -30.0},
    "signature_scale": {"factor": 1.8},
    "nose_cone_width": {"factor": 1.3},
    "radar_range_scale": {"factor": 0.88},
    "radar_position": {"north": 20e3, "east": -15e3},
    "look_interval": {"factor": 1.05},
}


def with_positions(recording: Recording, change: Callable[..., np.ndarray]) -> Recording:
    """The same log with both coordinates changed, flight by flight."""
    signals = dict(recording.signals)
    for name in ("north", "east"):
        flights = [change(recording.time[a:b], signals[name][a:b]) for a, b in recording.bounds]
        signals[name] = np.concatenate(flights)
    return replace(recording, signals=signals)


FADING: dict[str, Callable[[complex, float], float]] = {
    "radar tires within each flight": lambda _place, time: 1 - 0.3 * math.tanh((time - 1000) / 300),
    "hills hide a sector": lambda place, _time: 0.7 if place.imag > 0 else 1.0,
}


FOREIGN: dict[str, Callable[..., np.ndarray]] = {
    "position 2 s late": lambda time, values: np.interp(time - 2.0, time, values),
    "position 1 % too far out": lambda _time, values: 1.01 * values,
    "position wanders by 150 m": lambda time, values: values + 150.0 * np.sin(2 * np.pi * time / 700.0),
}


def verdict(recording: Recording) -> str:
    """Verdict and causes in one word, each with what could stand in its place."""
    result = diagnose(MODEL, [recording])
    return " ".join([result.verdict, *("/".join([c.effect, *c.alternatives]) for c in result.causes)])


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=3000)
    parser.add_argument("--seeds", type=int, default=12)
    parser.add_argument("--clean", type=int, default=30)
    options = parser.parse_args()

    def flight(seed: int, reality: object = None, **options: Any) -> Recording:
        rng = np.random.default_rng(seed)
        return record_flight(reality, DURATION, episodes=EPISODES, rng=rng, **options)

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
    for name, faded in FADING.items():
        found = Counter(verdict(flight(seed, faded=faded)) for seed in seeds)
        print(f"{name:36s}{dict(found)}", flush=True)


if __name__ == "__main__":
    main()
