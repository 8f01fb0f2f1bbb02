"""The kinds: what is wrong with which machines, and how these are recorded."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from types import SimpleNamespace as Numbers
from typing import Any

import numpy as np

from .faults import (
    asymmetry,
    bias,
    bristle,
    crane_dry,
    dead_zone,
    delay,
    drag,
    driven,
    dry,
    gain,
    lag,
    limited,
    named,
    offset,
    play,
    push,
    second_mass,
    shows,
    slipping_spring,
    slow,
    sluggish,
    vary,
)  # fmt: skip
from .plants import NOTHING, PLANTS, Array, Fault, Plant, Size
from .records import (
    BOTH_WAYS,
    ONE_WAY,
    STAIRS,
    Form,
    Rng,
    gaps,
    gentle,
    levels,
    long_steps,
    none,
    one_step,
    spikes,
    stuck_bit,
    timer,
    wandering,
)  # fmt: skip
from .runs import PLAIN, Way

LATER = ("spikes", "stuck_bit", "gaps")
"""Kinds that count from the issue of logs on."""


def given(_: float, aim: Array, __: Array) -> Array:
    """The command is what is aimed at."""
    return aim


def upright(_: float, aim: Array, y: Array) -> Array:
    """An unknown controller of a pendulum that stands."""
    return np.asarray(4.0 * (math.pi + aim - y[:1]) - 0.4 * y[1:2])


def let_go(state: int, least: float, most: float) -> Form:
    """Six files that begin off the place of rest; nothing is commanded."""

    def start(rng: Rng, plant: Plant, p: Numbers) -> Array:
        result = np.array(plant.start)
        result[state] = rng.choice([-1.0, 1.0]) * rng.uniform(least, most)
        return result

    return Form(rows=250, files=6, commands=(none, none), start=start, control=given, about=(0.0,))


def stands(rng: Rng, plant: Plant, p: Numbers) -> Array:
    """A pendulum that stands."""
    return np.array([math.pi, 0.0])


def rims(width: float) -> Fault:
    """Small speeds of a robot's wheels are not carried out."""
    track = PLANTS["pose_reaching"].numbers["track"]

    def make(k: Size):
        def act(t: float, u: Array, x: Array) -> Array:
            half = 0.5 * track * u[1]
            left, right = (
                np.sign(r) * np.maximum(np.abs(r) - k * width, 0.0) for r in (u[0] - half, u[0] + half)
            )
            return np.array([0.5 * (left + right), (right - left) / PLANTS["pose_reaching"].numbers["track"]])

        return act

    return named(Fault(command=(make,)), actuator_dead_zone__width=width)


def turned(share: float) -> Fault:
    """A robot slips where it turns; listed."""
    return named(push(2, lambda k, t, x, u, p: -k * share * u[1]), yaw_slip__share=share)


def drifts(number: str, rate: float) -> Fault:
    """A number that changes steadily; listed."""

    def truth(k: float, p: Numbers) -> float:
        return k * rate * float(getattr(p, number))

    return named(vary(number, lambda k, t, x, u, p: 1.0 + k * rate * t), **{f"{number}_drift__rate": truth})


def beyond(value: Array, width: Size | float) -> Array:
    """What lies beyond a width, on either side."""
    return np.asarray(np.sign(value) * np.maximum(np.abs(value) - width, 0.0))


def let(error: Array, width: Size) -> Array:
    """What a controller that lets small errors be takes from an error."""
    return beyond(error, width) - error


MOTOR_DRY = dry(1, 0.004, "inertia", "coulomb_friction.torque")
CAR_DRY = dry(3, 0.08, "", "coulomb_friction.rate")
CYLINDER_DRY = dry(1, 15.0, "mass", "coulomb_friction.force")
RIG_DRY = dry(1, 0.2, "mass", "coulomb_friction.force")
SERVO_DRY = dry(1, 0.01, "inertia", "coulomb_friction.torque")
PENDULUM_DRY = dry(1, 0.02, "inertia", "coulomb_friction.torque")
VISCOUS = named(
    push(1, lambda k, t, x, u, p: -k * 0.02 * x[1] / p.inertia), viscous_friction__coefficient=0.02
)
LOWER_BIAS = bias(1, 2e-3, "lower_bias__bias")
STEER_BIAS = offset(2e-3, "steer_", 1)
CLIMB_LAG = sluggish(1, 0.05, "climb_lag__time_constant")
SPEED_LAG = sluggish(1, 5e-3, "speed_lag__time_constant")
GRAVITY = named(
    push(1, lambda k, t, x, u, p: k * 0.02 * np.cos(x[0]) / p.inertia + 0.02 * k * np.sin(x[0]) / p.inertia),
    gravity__sine=0.02, gravity__cosine=0.02,
)  # fmt: skip
ON = {
    "motor": MOTOR_DRY, "tanks": LOWER_BIAS, "plate": drifts("loss", 1e-4), "quadrotor": delay(0.02),
    "car": STEER_BIAS, "cylinder": CYLINDER_DRY, "valve": play(0.02), "crane": crane_dry(3.0),
    "servo": SERVO_DRY, "rig": RIG_DRY, "pose_reaching": turned(0.02),
}  # fmt: skip
"""A fault on each machine, and another one."""
OTHERS = {
    "motor": SPEED_LAG, "tanks": delay(3.0), "quadrotor": drag(1, 0.5), "car": CAR_DRY,
    "cylinder": asymmetry(0.05), "valve": sluggish(1, 0.1, "flow_lag__time_constant"),
    "crane": bias(1, 2e-3, "angle_bias__bias"),
    "rig": drag(1, 2.0, "mass"), "pendulum": PENDULUM_DRY, "servo": GRAVITY, "plate": delay(5.0),
    "pose_reaching": delay(0.03),
}  # fmt: skip


def ways(machines: str, form: Form = PLAIN, faults: Mapping[str, Fault] = ON, **more: Any) -> tuple[Way, ...]:
    """The same on several machines."""
    return tuple(Way(one, faults.get(one, NOTHING), form, **more) for one in machines.split())


def nothing(form: Form) -> tuple[Way, ...]:
    """Nothing hidden, on all machines."""
    return tuple(Way(one, form=form) for one in PLANTS)


SHORT = Form(rows=150, files=20, commands=(one_step, none))
SETTLED = Form(commands=(long_steps,))
HAND = Form(by_hand=True, control=given, reach=0.3)
STANDING = Form(start=stands, control=upright, reach=0.4, louder=0.3)
BIG = {
    "tanks": bias(1, 0.02, "lower_bias__bias"), "plate": drifts("loss", 5e-4),
    "car": offset(0.02, "steer_", 1), "pose_reaching": turned(0.2), "valve": play(0.1),
}  # fmt: skip
SLOW = {
    "motor": lag(0.2), "tanks": lag(30.0), "plate": lag(50.0), "valve": lag(3.0), "cylinder": lag(0.15),
}  # fmt: skip
QUIET = Form(louder=0.2)
UNLISTED: Mapping[str, tuple[str, Fault, Form]] = {
    "tank_overflows": (
        "tanks", push(0, lambda k, t, x, u, p: -0.005 * k * np.maximum(x[0] - 0.15, 0.0)), PLAIN,
    ),
    "outlet_clogs": (
        "tanks", vary("upper_outlet", lambda k, t, x, u, p: 1.0 - 0.02 * k * t / (t + 600.0)), PLAIN,
    ),
    "plate_radiates": (
        "plate",
        push(0, lambda k, t, x, u, p: -2e-9 * k * ((x[0] + 273.0) ** 4 - (u[1] + 273.0) ** 4) / p.capacity),
        PLAIN,
    ),
    "heater_weakens_hot": (
        "plate", vary("power", lambda k, t, x, u, p: 1.0 - 1e-3 * k * (x[0] - 22.0)), PLAIN,
    ),
    "winding_warms": (
        "motor", vary("resistance", lambda k, t, x, u, p: 1.0 + 0.02 * k * (1.0 - np.exp(-t / 4.0))), PLAIN,
    ),
    "iron_saturates": (
        "motor", vary("constant", lambda k, t, x, u, p: 1.0 / (1.0 + 0.005 * k * np.abs(x[0]))), PLAIN,
    ),
    "loses_lift_in_descent": (
        "quadrotor", push(1, lambda k, t, x, u, p: -0.3 * k * np.exp(-(((x[1] + 0.8) / 0.3) ** 2))), PLAIN,
    ),
    "height_feels_the_wind": (
        "quadrotor", shows(0, lambda k, log: log.shown[:, 0] + 0.02 * k * log.states[:, 1] ** 2), PLAIN,
    ),
    "understeers": ("car", vary("wheelbase", lambda k, t, x, u, p: 1.0 + 2e-4 * k * x[3] ** 2), QUIET),
    "hills": ("car", push(3, lambda k, t, x, u, p: -0.1 * k * np.sin(x[0] / 20.0)), PLAIN),
    "pulley_off_centre": (
        "crane", driven(lambda k, t, x, u, p: 0.03 * k * u[0] * np.sin(x[0] / 0.4)), PLAIN,
    ),
    "load_in_the_air": (
        "crane", push(3, lambda k, t, x, u, p: -0.1 * k * x[3] * np.abs(x[3])), QUIET,
    ),
    "piston_leaks": ("cylinder", push(2, lambda k, t, x, u, p: -0.5 * k * x[2]), PLAIN),
    "supply_falls": ("cylinder", vary("rise", lambda k, t, x, u, p: 1.0 - 0.01 * k * t), PLAIN),
    "flow_chokes": (
        "valve", push(1, lambda k, t, x, u, p: -0.1 * k * np.maximum(x[1] - 1.5, 0.0) / p.fill), PLAIN,
    ),
    "stem_slows_when_open": ("valve", vary("travel", lambda k, t, x, u, p: 1.0 + 0.2 * k * x[0] ** 3), PLAIN),
    "carpet": ("pose_reaching", push(2, lambda k, t, x, u, p: 0.05 * k * u[0] * np.sin(x[2])), PLAIN),
}  # fmt: skip
"""Faults of which no list of a machine holds a name."""
KINDS: Mapping[str, tuple[Way, ...]] = {
    "twice_the_noise": ways("motor tanks quadrotor car cylinder", ratio=2.0),
    "ten_times_the_noise": ways("crane valve motor servo rig", ratio=10.0, faults={**ON, "motor": SPEED_LAG}),
    "hundred_times_the_noise": ways(
        "tanks plate car pose_reaching valve", ratio=100.0, by_noise=True, faults=BIG
    ),
    "constant_speed_one_way": (
        Way("motor", MOTOR_DRY, Form(commands=(ONE_WAY,))),
        Way("car", CAR_DRY, Form(commands=(ONE_WAY, none), about=(0.0, 0.0), reach=2.0)),
        Way("servo", drag(1, 0.02, "inertia"), Form(1600, commands=(lambda g, n, h, s: ramps(g, n, False),))),
    ),
    "constant_speed_both_ways": (
        Way("motor", MOTOR_DRY, Form(commands=(BOTH_WAYS,))),
        Way("servo", SERVO_DRY, Form(rows=1600, commands=(lambda g, n, h, s: ramps(g, n, True),))),
        Way("car", CAR_DRY, Form(commands=(BOTH_WAYS, none), about=(0.0, 0.0), reach=2.0)),
    ),
    "staircase": (
        Way("motor", dead_zone(0.2), Form(commands=(STAIRS,))),
        Way("tanks", LOWER_BIAS, Form(commands=(STAIRS,))),
        Way("valve", play(0.02), Form(commands=(STAIRS,))),
        Way("plate", bias(0, 0.3, "sensor_bias__bias"), Form(commands=(STAIRS,))),
    ),
    "one_step_a_file": (
        Way("motor", MOTOR_DRY, SHORT), Way("rig", RIG_DRY, SHORT),
        Way("valve", SLOW["valve"], SHORT, by_noise=True),
    ),
    "ring_down": (
        Way("rig", RIG_DRY, let_go(0, 0.05, 0.15), ("mass",)),
        Way("pendulum", PENDULUM_DRY, let_go(0, 0.3, 1.2), ("inertia",)),
        Way("crane", crane_dry(3.0), let_go(2, 0.15, 0.4), ("mass",)),
    ),
    "moved_by_hand": (
        *ways("rig pendulum servo", HAND, {}), Way("quadrotor", form=replace(HAND, about=(0.1,), reach=0.02)),
    ),
    "upright_friction": (Way("pendulum", VISCOUS, STANDING, only=("angle",)),),
    "upright_delay": (Way("pendulum", delay(0.01), STANDING, only=("angle",)),),
    "long_rows": (
        Way("motor", MOTOR_DRY, Form(400, 16)), Way("tanks", LOWER_BIAS, Form(400, 20)),
        Way("valve", play(0.02), Form(400, 8)), Way("plate", drifts("loss", 1e-5), Form(300, 100)),
    ),
    "telemetry": ways(
        "quadrotor crane pendulum",
        Form(rows=3000, every=5),
        {**OTHERS, "crane": ON["crane"], "quadrotor": CLIMB_LAG},
    ),
    "encoder_counts": ways("rig servo crane", Form(counts=8.0)),
    "timer_15_ms": ways("rig crane pendulum", Form(instants=timer), {**OTHERS, **ON}),
    "spikes": ways("motor tanks rig", Form(spoil=spikes)),
    "stuck_bit": ways("motor tanks rig", Form(spoil=stuck_bit), OTHERS),
    "gaps": ways("motor valve crane", Form(cut=gaps)),
    "few_windows": (
        Way("motor", MOTOR_DRY, Form(800)), Way("plate", OTHERS["plate"], Form(1200)),
        Way("car", STEER_BIAS, Form(600)), Way("crane", ON["crane"], Form(900)),
        Way("cylinder", CYLINDER_DRY, Form(900)),
    ),
    "base_a_third": ways("motor tanks plate cylinder valve", faults={}, third=True),
    "base_a_third_and_fault": ways("motor tanks plate cylinder valve", third=True),
    "base_in_part": (
        Way("car", CAR_DRY, Form(commands=(levels, none))),
        Way("quadrotor", delay(0.02), Form(commands=(gentle,))),
        Way("rig", RIG_DRY, Form(commands=(lambda g, n, h, s: creeping(g, n),))),
    ),
    "resonance": (
        Way("rig", second_mass(1, 0.1, 20.0, 0.03)), Way("servo", second_mass(1, 0.1, 45.0, 0.03)),
        Way("motor", second_mass(1, 0.1, 60.0, 0.03)), Way("cylinder", second_mass(1, 0.1, 30.0, 0.03)),
    ),
    "speed_limits": (
        Way("car", push(3, lambda k, t, x, u, p: -0.1 * k * np.maximum(x[3] - 4.0, 0.0))),
        Way("motor", driven(lambda k, t, x, u, p: -0.01 * k * beyond(x[1], 100.0))),
        Way("crane", driven(lambda k, t, x, u, p: -10.0 * k * beyond(x[1], 0.4))),
        Way("servo", slow(10.0)),
    ),
    "dead_band": (
        Way("servo", named(driven(lambda k, t, x, u, p: let(u[0] - x[0], 5e-3 * k)), dead_band__width=5e-3)),
        Way("valve", push(0, lambda k, t, x, u, p: let(u[0] - x[0], 0.01 * k) / p.travel), SETTLED),
        Way("pose_reaching", rims(0.01)),
    ),
    "hysteresis_in_force": (
        Way("rig", bristle(1, 0.3, 0.02, "mass")), Way("servo", bristle(1, 0.01, 0.02, "inertia", "torque")),
        Way("cylinder", slipping_spring(1, 15.0, 0.01, "mass")),
    ),
    "long_lags": ways("motor tanks plate valve cylinder", faults=SLOW, by_noise=True),
    "listed_single": ways("motor tanks quadrotor crane cylinder valve", faults=OTHERS),
    "listed_pair": tuple(
        Way(one, ON[one] + OTHERS[one]) for one in ("motor", "tanks", "quadrotor", "car", "cylinder", "valve")
    ),
    "more_listed": (
        Way("motor", limited(12.0)), Way("pose_reaching", lag(0.05)), Way("cylinder", slow(60.0)),
        Way("quadrotor", drifts("hover", 1e-3)), Way("car", gain(3, 0.01, "speed_gain__gain")),
    ),
    "nothing_white": nothing(Form()),
    "nothing_wandering": nothing(Form(noise=wandering)),
    "nothing_coarse": nothing(Form(counts=3.0)),
    "nothing_loud": nothing(Form(louder=6.0)),
    "nothing_gentle": nothing(Form(commands=(gentle, gentle), louder=0.3)),
    **{kind: (Way(*one),) for kind, one in UNLISTED.items()},
}  # fmt: skip


def ramps(rng: Rng, rows: int, back: bool) -> Array:
    """A set-point that moves at constant speeds, one after the other; back again or always ahead."""
    speeds = rng.permutation([0.1, 0.2, 0.4, 0.6, 0.8, 1.0]) * rng.uniform(0.9, 1.0)
    if back:
        speeds = np.column_stack([speeds, -speeds]).ravel()
    along = np.cumsum(np.repeat(speeds, -(-rows // len(speeds)))[:rows])
    return np.asarray(along * (40.0 if back else 20.0) / rows)


def creeping(rng: Rng, rows: int) -> Array:
    """To and fro along ramps, so slowly that a mass does not count."""
    turns = np.linspace(0.0, rows, 9) + rng.uniform(-0.04, 0.04, 9) * rows
    return np.interp(np.arange(rows), turns, rng.uniform(0.3, 1.0, 9) * (-1.0) ** np.arange(9))
