"""Speed of the UAV-route environment beside its own kernel and Gymnasium's CartPole, within one run.

python benchmarks/uav_route_env_speed.py

Both environments are stepped with actions drawn beforehand, episodes restart as they end, and all that a
step returns is made (observation, reward, flags, info). Rounds alternate between all rows, and each round's
processor time is taken; printed are the fastest round of each and its ratio to CartPole's native vector form
with as many environments.
"""

from __future__ import annotations

import math

import numpy as np
from steppers import ACTIONS, Stepper, native, scalar, steps_a_second

from fieldmodels.machines.uav_route.batch import Flights, Rules

OURS, THEIRS = "fieldgym/UavRoute-v1", "CartPole-v1"


def kernel(count: int) -> Stepper:
    """A leg of the bare kernel, with the lengths that the environment's actions mean."""
    rules, rng = Rules(longest_leg=500.0), np.random.default_rng(0)
    flights = Flights(count, rules)
    for i in range(count):
        flights.seed(i, np.random.default_rng(i))
    flights.restart(range(count))
    spread = rules.longest_leg / rules.least_leg
    actions = [
        np.column_stack(
            [rng.uniform(-math.pi, math.pi, count), rules.least_leg * spread ** rng.uniform(0, 1, count)]
        )
        for _ in range(ACTIONS)
    ]
    return lambda k: flights.advance(actions[k % ACTIONS], restarting=True)


def main() -> None:
    """Print the table."""
    print(f"{'':44s}{'steps/s':>12s}{'of CartPole':>13s}")
    for count in (64, 1024):
        rates = steps_a_second(
            {
                f"kernel alone, {count}": (kernel(count), count),
                f"native vector, {count}": (native(OURS, count), count),
                f"native vector, no lock is lost, {count}": (
                    native(OURS, count, settings={"lock_loss": False}),
                    count,
                ),
                f"native vector, drawn scans, {count}": (
                    native(OURS, count, settings={"detection": "stochastic"}),
                    count,
                ),
                f"native vector, 4 radars, {count}": (native(OURS, count, settings={"radars": 4}), count),
                f"CartPole, native vector, {count}": (native(THEIRS, count), count),
            }
        )
        base = list(rates.values())[-1]
        for name, value in rates.items():
            print(f"{name:44s}{value:12,.0f}{value / base:13.2f}")
    rates = steps_a_second({"one environment": (scalar(OURS), 1), "CartPole, one": (scalar(THEIRS), 1)})
    base = list(rates.values())[-1]
    for name, value in rates.items():
        print(f"{name:44s}{value:12,.0f}{value / base:13.2f}")


if __name__ == "__main__":
    main()
