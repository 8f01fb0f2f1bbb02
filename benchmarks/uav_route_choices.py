"""What the UAV route's open choices and the source's errata are worth, in numbers.

python benchmarks/uav_route_choices.py
"""

from __future__ import annotations

import math

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.machines.uav_route.aircraft import turn_into
from fieldmodels.machines.uav_route.batch import Flights, Rules
from fieldmodels.machines.uav_route.layouts import safe_route
from fieldmodels.machines.uav_route.parameters import (
    EXAMPLE,
    PRINTED,
    Detection,
    LockLoss,
    Reading,
    World,
    kernel_world,
)
from fieldmodels.machines.uav_route.plan_simulation import simulate_plan

PLANS = {
    "straight line": np.array([EXAMPLE.start, EXAMPLE.goal]),
    "bent at (365, 60)": np.array([EXAMPLE.start, (365.0, 60.0), EXAMPLE.goal]),
    "side-on, then at the radar": np.array([EXAMPLE.start, (345.0, 0.0), EXAMPLE.goal]),
    "safe route": safe_route(EXAMPLE),
}
READINGS = {
    "right": World(),
    "heading of the next leg": World(reading=Reading(heading="next_leg")),
    "two-quadrant arctangent": World(reading=Reading(arctangent="two_quadrant")),
    "left-handed axes": World(reading=Reading(axes="left_handed")),
    "unbroken engagement (4.33)": World(lock_loss=LockLoss(engaged="unbroken")),
    "elapsed engagement (text)": World(lock_loss=LockLoss(engaged="elapsed")),
    "all as printed": World(reading=PRINTED),
}
LOCKS = {"50 / 150 / 50": LockLoss(), "20 / 60 / 20": LockLoss(20, 60, 20), "10 / 150 / 50": LockLoss(10)}
LOOKS = (1.0, 5.0, 10.0, 25.0, 50.0)
FLIGHTS = 2000


def readings() -> None:
    """Verifications of some plans in each reading, the example's threshold, samples of 1 s."""
    print(f"{'plan':28s}{'reading':28s}{'length':>8s}{'over':>8s}{'largest':>9s}{'hit at':>8s}")
    for name, plan in PLANS.items():
        for reading, value in READINGS.items():
            one = simulate_plan(plan, EXAMPLE.radars, value, step=1.0).verification
            print(
                f"{name:28s}{reading:28s}{one.path_length:8.2f}{one.time_over:8.1f}"
                f"{one.largest_probability:9.3f}{one.damaged_at:8.1f}"
            )


def turns() -> None:
    """How often the printed side of a turn is right, and the printed clamp is not a number."""
    rng, right = np.random.default_rng(0), kernel_world(World())
    side = kernel_world(World(reading=Reading(side="absolute")))
    clamp = kernel_world(World(reading=Reading(clamp="upper")))
    agree, lost = [], []
    for north, east, at_north, at_east, to_north, to_east in rng.normal(size=(20_000, 6)):
        new = (to_north - at_north, to_east - at_east, to_north, to_east)
        agree.append(turn_into(north, east, *new, side) * turn_into(north, east, *new, right) > 0)
        lost.append(math.isnan(turn_into(north, east, -13.7 * north, -13.7 * east, 0.0, 0.0, clamp)))
    print(f"\nprinted side of a turn is right: {np.mean(agree):.1%}")
    print(f"printed clamp loses an exact reversal: {np.mean(lost):.1%}")


def survival(plan: FloatArray, look: float, lock_loss: LockLoss) -> float:
    """Share of flights along a plan that arrive if scans are drawn."""
    world = World(detection=Detection(detection="stochastic", scan_interval=look), lock_loss=lock_loss)
    flights = Flights(FLIGHTS, Rules(world, layout=EXAMPLE, longest_leg=500.0))
    for i in range(FLIGHTS):
        flights.seed(i, np.random.default_rng([1, i]))
    flights.restart(range(FLIGHTS))
    for waypoint in plan[1:]:
        leg = flights.fly_to(np.broadcast_to(waypoint, (FLIGHTS, 2)))
    return float((leg.over == 1).mean())


def main() -> None:
    """Print the tables."""
    readings()
    turns()
    print(f"\nshare of arrivals with drawn scans every ... s{'':14s}" + "".join(f"{x:8g}" for x in LOOKS))
    for name in ("straight line", "safe route"):
        for lock, times in LOCKS.items():
            shares = "".join(f"{survival(PLANS[name], look, times):8.3f}" for look in LOOKS)
            print(f"{name:28s}{'timers ' + lock + ' s':32s}{shares}")


if __name__ == "__main__":
    main()
