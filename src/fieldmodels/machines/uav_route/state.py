"""What a flight remembers between legs, and the rules as the kernels take them."""

from __future__ import annotations

import numpy as np

from fieldmodels.machines.uav_route.parameters import RADARS

LOSE, ENGAGE, LAUNCH = 0, 1, 2
"""A radar's timers."""

FLYING, ARRIVED, DAMAGED, LATE = 0, 1, 2, 3

FLIGHT = np.dtype(
    [
        ("key", np.uint64),  # the flight's random stream
        ("episode", np.int64),  # episodes begun under this key
        ("over", np.int64),  # FLYING, ARRIVED, DAMAGED or LATE
        ("legs", np.int64),  # flown in this episode
        ("scans", np.int64),  # that the radars have drawn
        ("place", np.float64, (2,)),  # north, east [km]
        ("course", np.float64, (2,)),  # its cosine and sine
        ("start", np.float64, (2,)),
        ("goal", np.float64, (2,)),
        ("radars", np.float64, (RADARS, 2)),
        ("timers", np.float64, (RADARS, 3)),  # lock loss, engage, launch [s]
        ("probability", np.float64, (RADARS,)),  # of detection, in the last scan
        ("detected", np.int64, (RADARS,)),  # the last scan's result
        ("unbroken", np.float64, (RADARS,)),  # time since the present detection began [s]
        ("way", np.float64),  # left to the goal, as progress is measured [km]
        ("time", np.float64),  # [s]
        ("path", np.float64),  # [km]
        ("time_over", np.float64),  # in which a radar detected [s]
        ("longest", np.float64),  # detection without a break [s]
        ("largest", np.float64),  # probability of detection
        ("losses", np.int64),  # of locks
    ]
)
"""What a flight remembers between legs."""

NUMBERS = (
    "success",
    "damaged",
    "time",
    "path_length",
    "remaining",
    "time_over",
    "longest_detection",
    "largest_probability",
    "lock_losses",
    "legs",
)
BOUND = 100.0
"""Of an observation: 10,000 km from the goal."""
OWN = (
    "goal_ahead",
    "goal_right",
    "goal_log_distance",
    "goal_cos",
    "goal_sin",
    "course_cos",
    "course_sin",
    "legs_left",
)
EACH = (
    "margin_5",
    "margin_50",
    "margin_500",
    "bearing_cos",
    "bearing_sin",
    "lose_timer",
    "engage_timer",
    "launch_timer",
    "detected",
)
KNOWN = (
    "measured_north",
    "measured_east",
    "course",
    "radial",
    "north",
    "east",
    "start_north",
    "start_east",
    "goal_north",
    "goal_east",
)
OF_RADAR = ("north", "east", "lose_timer", "engage_timer", "launch_timer", "detected")
