"""Speed of UAV flights: legs of random length under one and four radars, as ratios within one run.

python benchmarks/uav_route_speed.py
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np

from fieldmodels.machines.uav_route.batch import Flights, Rules
from fieldmodels.machines.uav_route.layouts import safe_route
from fieldmodels.machines.uav_route.parameters import EXAMPLE, Detection, World
from fieldmodels.machines.uav_route.plan_simulation import simulate_plan

BATCH = 1024
SECONDS = 2.0


def rate(step: Callable[[], object], per_call: int) -> float:
    """Steps a second of processor time; the first call (which may compile) is not timed."""
    step()
    calls, start = 0, time.process_time()
    while time.process_time() - start < SECONDS:
        step()
        calls += 1
    return calls * per_call / (time.process_time() - start)


def legs(batch: int, rules: Rules) -> Callable[[], object]:
    """One call flies a random leg of every flight; episodes that are over begin anew."""
    flights, rng = Flights(batch, rules), np.random.default_rng(0)
    for i in range(batch):
        flights.seed(i, np.random.default_rng(i))
    flights.restart(range(batch))
    low, high = (-math.pi, rules.least_leg), (math.pi, rules.longest_leg)
    actions = [rng.uniform(low, high, (batch, 2)) for _ in range(50)]
    turn = iter(range(1 << 62))
    return lambda: flights.advance(actions[next(turn) % 50], restarting=True)


def main() -> None:
    """Print a table; ratios are to its last row."""
    drawn = World(detection=Detection(detection="stochastic"))
    route = safe_route(EXAMPLE)
    rates = {
        f"one radar, {BATCH} flights": rate(legs(BATCH, Rules(longest_leg=50.0)), BATCH),
        f"four radars, {BATCH} flights": rate(legs(BATCH, Rules(radars=4, longest_leg=50.0)), BATCH),
        f"one radar, drawn scans, {BATCH} flights": rate(legs(BATCH, Rules(drawn, longest_leg=50.0)), BATCH),
        "one radar, legs of 10 km at most": rate(legs(BATCH, Rules(longest_leg=10.0)), BATCH),
        "two legs of 79 km simulated every 0.1 s": rate(lambda: simulate_plan(route, EXAMPLE.radars), 2),
        "one radar, one flight": rate(legs(1, Rules(longest_leg=50.0)), 1),
    }
    base = list(rates.values())[-1]
    print(f"{'legs':52s}{'a second':>14s}{'ratio':>10s}")
    for name, value in rates.items():
        print(f"{name:52s}{value:14,.0f}{value / base:10.2f}")


if __name__ == "__main__":
    main()
