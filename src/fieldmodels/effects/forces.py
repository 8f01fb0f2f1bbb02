"""Stock effects in an equation of motion: forces on one of a machine's velocities.

    F = -c v - a |v| - d v |v| - k x - k_3 x^3 + F_0 + A_s sin(2 pi f t) + A_c cos(2 pi f t)
        + B_s sin(2 pi x/p) + B_c cos(2 pi x/p) - k_e max(|x| - x_e, 0) sign(x) - k_o max(x - x_o, 0)
        - (F_c + mu |u| + F_s exp(-(v/v_s)^2)) sign(v) - F_h,          dF_h/dx = (F_m - F_h sign(v))/delta

Friction that falls with speed is Stribeck's curve in its Gaussian form (Armstrong-Helouvry, Dupont and
Canudas de Wit 1994, Automatica 30(7)); hysteresis is Dahl's bristle (A solid friction model, The Aerospace
Corporation, 1968), whose force depends on the path alone and is carried on along it exactly.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.compiled import allocation_free
from fieldmodels.compiled import allocation_free_inlined as inlined
from fieldmodels.effects.stock import (
    LARGE,
    WIDTHS,
    Declare,
    Layout,
    Names,
    Sizes,
    Stock,
    choose,
    effect,
    positive,
    signed,
    span,
)
from fieldmodels.elementary import cosine, exponential, sine
from fieldmodels.model import Effect, Parameter


class Row(NamedTuple):
    """Numbers of the stock forces on a velocity; the defaults switch them off."""

    viscous_friction_coefficient: float = 0.0
    coulomb_friction_force: float = 0.0
    stribeck_friction_force: float = 0.0
    stribeck_friction_velocity: float = 1.0
    load_friction_share: float = 0.0
    hysteresis_force: float = 0.0
    hysteresis_distance: float = 1.0
    cogging_sine: float = 0.0
    cogging_cosine: float = 0.0
    cogging_period: float = 1.0
    asymmetric_damping_coefficient: float = 0.0
    quadratic_drag_coefficient: float = 0.0
    linear_stiffness_coefficient: float = 0.0
    cubic_stiffness_coefficient: float = 0.0
    elastic_stop_stiffness: float = 0.0
    elastic_stop_place: float = 1.0
    one_sided_spring_stiffness: float = 0.0
    one_sided_spring_place: float = 0.0
    constant_force_force: float = 0.0
    periodic_force_sine: float = 0.0
    periodic_force_cosine: float = 0.0
    periodic_force_frequency: float = 1.0


ROW = Layout(Row)
unpack = ROW.unpack

COULOMB = "coulomb_friction"
TEETH = 48
"""Most periods in a turn of a shaft from which a force along many turns is sought."""
FRICTION_STEPS = 32
"""Integration steps within a sampling interval, at most, that dry friction and cogging ask for."""


@inlined
def has_dry_friction(r: Row) -> bool:
    """Whether a force depends on the direction of motion."""
    return bool(
        r.coulomb_friction_force != 0.0
        or r.stribeck_friction_force != 0.0
        or r.hysteresis_force != 0.0
        or r.load_friction_share != 0.0
    )


@inlined
def is_coulomb(r: Row) -> bool:
    """Whether Coulomb friction is on, and nothing else."""
    return bool(
        r.coulomb_friction_force != 0.0
        and r.stribeck_friction_force == 0.0
        and r.load_friction_share == 0.0
        and r.hysteresis_force == 0.0
        and has_no_smooth(r)
    )


@inlined
def is_off(r: Row) -> bool:
    """Whether no force is on."""
    return bool(not has_dry_friction(r) and has_no_smooth(r))


@inlined
def has_no_smooth(r: Row) -> bool:
    """Whether all forces but dry friction and hysteresis are off."""
    return bool(
        r.viscous_friction_coefficient == 0.0
        and r.cogging_sine == 0.0
        and r.cogging_cosine == 0.0
        and r.asymmetric_damping_coefficient == 0.0
        and r.quadratic_drag_coefficient == 0.0
        and r.linear_stiffness_coefficient == 0.0
        and r.cubic_stiffness_coefficient == 0.0
        and r.elastic_stop_stiffness == 0.0
        and r.one_sided_spring_stiffness == 0.0
        and r.constant_force_force == 0.0
        and r.periodic_force_sine == 0.0
        and r.periodic_force_cosine == 0.0
    )


@inlined
def smooth(x: float, v: float, t: float, r: Row) -> float:
    """All forces but dry friction and hysteresis."""
    total = without_waves(x, v, r)
    if is_periodic(r):
        total += periodic(t, r)
    if is_cogging(r):
        total += cogging(x, r)
    return float(total)


@inlined
def without_waves(x: float, v: float, r: Row) -> float:
    """The same but those that swing in time or along the way."""
    # Without a condition, so that loops over it become vector instructions: what is off is zero.
    total = r.constant_force_force - r.viscous_friction_coefficient * v
    total -= (r.asymmetric_damping_coefficient + r.quadratic_drag_coefficient * v) * abs(v)
    total -= (r.linear_stiffness_coefficient + r.cubic_stiffness_coefficient * x * x) * x
    total -= r.elastic_stop_stiffness * math.copysign(max(abs(x) - r.elastic_stop_place, 0.0), x)
    total -= r.one_sided_spring_stiffness * max(x - r.one_sided_spring_place, 0.0)
    return float(total)


@inlined
def is_periodic(r: Row) -> bool:
    """Whether a force swings in time."""
    return bool(r.periodic_force_sine != 0.0 or r.periodic_force_cosine != 0.0)


@inlined
def periodic(t: float, r: Row) -> float:
    """The force that swings in time."""
    phase = 2.0 * math.pi * r.periodic_force_frequency * t
    return float(r.periodic_force_sine * sine(phase) + r.periodic_force_cosine * cosine(phase))


@inlined
def is_cogging(r: Row) -> bool:
    """Whether a force repeats along the way."""
    return bool(r.cogging_sine != 0.0 or r.cogging_cosine != 0.0)


@inlined
def cogging(x: float, r: Row) -> float:
    """The force that repeats along the way."""
    phase = 2.0 * math.pi * x / r.cogging_period
    return float(r.cogging_sine * sine(phase) + r.cogging_cosine * cosine(phase))


@inlined
def holding(load: float, r: Row) -> float:
    """What dry friction holds at rest."""
    return float(r.coulomb_friction_force + r.stribeck_friction_force + r.load_friction_share * abs(load))


@inlined
def bend(bristle: float, moved: float, r: Row) -> float:
    """Dahl's bristle after a motion in one direction: it approaches its largest force along the path."""
    level = math.copysign(r.hysteresis_force, moved)
    return float(level + (bristle - level) * exponential(-abs(moved) / r.hysteresis_distance))


@inlined
def resistance(moved: float, v: float, sign: float, bristle: float, load: float, r: Row) -> float:
    """Dry friction and hysteresis while the axis moves in direction ``sign``, ``moved`` from its start."""
    total = steady(sign, load, r)
    if r.stribeck_friction_force != 0.0:
        total += stribeck(v, sign, r)
    if r.hysteresis_force != 0.0:
        total += bend(bristle, moved, r)
    return float(total)


@inlined
def steady(sign: float, load: float, r: Row) -> float:
    """Dry friction that depends on nothing but the direction and what the drive transmits."""
    return float(sign * (r.coulomb_friction_force + r.load_friction_share * abs(load)))


@inlined
def stribeck(v: float, sign: float, r: Row) -> float:
    """Dry friction that falls with speed."""
    ratio = v / r.stribeck_friction_velocity
    return float(sign * r.stribeck_friction_force * exponential(-ratio * ratio))


@allocation_free
def bend_along(path: FloatArray, bounds: IntArray, r: Row, out: FloatArray) -> None:
    """The bristle's force along a measured path, unbent at the start of every episode.

    Args:
        path: Measured position, freed of noise, shape (n,).
        bounds: First sample and end of every episode, shape (episodes, 2).
        r: The force's row.
        out: Receives the bristle's force, shape (n,).
    """
    for piece in range(len(bounds)):
        out[bounds[piece, 0]] = 0.0
        for i in range(bounds[piece, 0] + 1, bounds[piece, 1]):
            out[i] = bend(out[i - 1], path[i] - path[i - 1], r)


@inlined
def slope_of_friction(inertia: float, speed: float, r: Row) -> float:
    """How fast [1/s] friction, bristle and cogging change a motion of a high speed, for its step's length."""
    fastest = 0.0
    if r.stribeck_friction_force != 0.0:
        fastest += r.stribeck_friction_force / (r.stribeck_friction_velocity * inertia)
    if r.hysteresis_force != 0.0:
        fastest += math.sqrt(r.hysteresis_force / (r.hysteresis_distance * inertia))
    if r.cogging_sine != 0.0 or r.cogging_cosine != 0.0:
        fastest += 0.4 * 2.0 * math.pi * speed / r.cogging_period  # half a radian a step is fine enough
    if r.linear_stiffness_coefficient != 0.0:
        fastest += math.sqrt(abs(r.linear_stiffness_coefficient) / inertia)
    if r.elastic_stop_stiffness != 0.0:
        fastest += math.sqrt(abs(r.elastic_stop_stiffness) / inertia)
    if r.one_sided_spring_stiffness != 0.0:
        fastest += math.sqrt(abs(r.one_sided_spring_stiffness) / inertia)
    return fastest


def _viscous(n: Names, s: Sizes) -> Effect:
    return effect(
        "viscous_friction", "force", "Friction grows in proportion to the speed; the simulation has none.",
        "-c v",
        positive("coefficient", _per(n.force_unit, n.velocity_unit), 0.1 * s.force / s.velocity),
    )  # fmt: skip


def _coulomb(n: Names, s: Sizes) -> Effect:
    return effect(
        "coulomb_friction", "force",
        f"Dry friction: a {n.force} of constant size opposes motion and holds the axis at rest.",
        "-F_c sign(v)",
        positive(n.force, n.force_unit, 0.1 * s.force),
    )  # fmt: skip


def _stribeck(n: Names, s: Sizes) -> Effect:
    return effect(
        "stribeck_friction", "force",
        f"Dry friction falls with speed: to break away takes more {n.force} than to keep sliding.",
        "-F_s exp(-(v/v_s)^2) sign(v), beside Coulomb friction",
        positive(n.force, n.force_unit, 0.1 * s.force),
        span("velocity", n.velocity_unit, s.velocity, 0.03, 0.1, 0.3, sizes=s, reduces_to=("", COULOMB)),
    )  # fmt: skip


def _load(n: Names, _: Sizes) -> Effect:
    return effect(
        "load_friction", "force",
        f"Dry friction grows with the {n.force} that the drive transmits, as in a worm gear.",
        "-mu |u| sign(v)",
        Parameter("share", "1", 0.0, 0.0, 10.0, 0.05, starts=(0.1,)),
    )  # fmt: skip


def _hysteresis(n: Names, s: Sizes) -> Effect:
    return effect(
        "hysteresis", "force",
        "The axis bends before it slips (cable, seal, belt, gear): "
        f"the {n.force} depends on the way it came.",
        "dF_h/dx = (F_m - F_h sign(v)) / distance",
        positive(n.force, n.force_unit, 0.1 * s.force),
        span("distance", n.position_unit, s.position, 0.03, 0.1, 0.3, 1.0, sizes=s, reduces_to=(COULOMB, "")),
    )  # fmt: skip


def _cogging(n: Names, s: Sizes) -> Effect:
    return effect(
        "cogging", "force",
        f"A {n.force} that repeats along the way: magnets, teeth or an eccentric pulley.",
        "B_s sin(2 pi x/p) + B_c cos(2 pi x/p)",
        signed("sine", n.force_unit, 0.1 * s.force),
        signed("cosine", n.force_unit, 0.1 * s.force),
        span("period", n.position_unit, 4.0 * s.position, *_shares_of_the_way(n, s), sizes=s,
             reduces_to=("", "constant_force")),
    )  # fmt: skip


def _shares_of_the_way(n: Names, s: Sizes) -> list[float]:
    """Periods to start from, over the way's length: shares of it, and those of a shaft that turns often."""
    shares = 1.0 / np.arange(1.0, 100.1, 0.5)
    if not s.measured or n.position_unit != "rad":
        return list(shares)
    turns = math.tau / np.arange(1.0, TEETH + 1.0) / (4.0 * s.position)
    return [*shares, *turns[(turns < shares[-1]) & (turns > WIDTHS[0])]]


def _asymmetric(n: Names, s: Sizes) -> Effect:
    return effect(
        "asymmetric_damping", "force",
        "Damping is stronger in one direction than in the other (shock absorber, ball screw, cable).",
        "-a |v|, beside the same damping both ways",
        signed("coefficient", _per(n.force_unit, n.velocity_unit), 0.1 * s.force / s.velocity),
    )  # fmt: skip


def _drag(n: Names, s: Sizes) -> Effect:
    return effect(
        "quadratic_drag", "force", "Drag grows with the square of the speed, as of air or a fluid.",
        "-d v |v|",
        positive("coefficient", _per(n.force_unit, n.velocity_unit, 2), 0.1 * s.force / s.velocity**2),
    )  # fmt: skip


def _linear(n: Names, s: Sizes) -> Effect:
    return effect(
        "linear_stiffness", "force",
        "A spring, or gravity on an unbalanced axis, pulls it back, or pushes it away.", "-k x",
        signed("coefficient", f"{n.force_unit}/{n.position_unit}", 0.1 * s.force / s.position),
    )  # fmt: skip


def _cubic(n: Names, s: Sizes) -> Effect:
    return effect(
        "cubic_stiffness", "force",
        "A spring that gets stiffer (or softer) with deflection acts on the axis.", "-k_3 x^3",
        signed("coefficient", f"{n.force_unit}/{n.position_unit}^3", 0.1 * s.force / s.position**3),
    )  # fmt: skip


def _stop(n: Names, s: Sizes) -> Effect:
    return effect(
        "elastic_stop", "force", "The axis runs against elastic stops on both sides.",
        "-k max(|x| - place, 0) sign(x)",
        positive("stiffness", f"{n.force_unit}/{n.position_unit}", s.force / s.position),
        span("place", n.position_unit, s.position, 1.0, 1.5, 2.0, sizes=s),
    )  # fmt: skip


def _one_sided(n: Names, s: Sizes) -> Effect:
    return effect(
        "one_sided_spring", "force", "A spring or rope acts on one side only.", "-k max(x - place, 0)",
        signed("stiffness", f"{n.force_unit}/{n.position_unit}", 0.3 * s.force / s.position),
        Parameter("place", n.position_unit, 0.0, -LARGE, LARGE, 0.2 * s.position, starts=(0.0, s.position)),
    )  # fmt: skip


def _constant(n: Names, s: Sizes) -> Effect:
    return effect(
        "constant_force", "force",
        f"A constant {n.force} acts on the axis, or the actuator gives a constant {n.force} too much: "
        "a tilted or unbalanced bench, a preload, or a bias of the drive.",
        "+F_0",
        signed(n.force, n.force_unit, 0.1 * s.force),
    )  # fmt: skip


def _periodic(n: Names, s: Sizes) -> Effect:
    return effect(
        "periodic_force", "force", "Something shakes the machine at one frequency.",
        "A_s sin(2 pi f t) + A_c cos(2 pi f t)",
        signed("sine", n.force_unit, 0.1 * s.force),
        signed("cosine", n.force_unit, 0.1 * s.force),
        Parameter(
            "frequency", "Hz", 1.0, min(0.01, 0.1 / s.duration) if s.measured else 0.01, 1e3,
            0.05 / s.duration, starts=s.frequencies,
        ),
    )  # fmt: skip


def _per(force: str, velocity: str, power: int = 1) -> str:
    """Unit of a force by a velocity: ``N s/m``."""
    if velocity.endswith("/s"):
        metre, seconds = velocity[:-2], "s" if power == 1 else f"s^{power}"
        return f"{force} {seconds}/{metre}" + ("" if power == 1 else f"^{power}")
    return f"{force}/({velocity})" + ("" if power == 1 else f"^{power}")


LIBRARY: dict[str, Declare] = {
    "viscous_friction": _viscous,
    "coulomb_friction": _coulomb,
    "stribeck_friction": _stribeck,
    "load_friction": _load,
    "hysteresis": _hysteresis,
    "cogging": _cogging,
    "asymmetric_damping": _asymmetric,
    "quadratic_drag": _drag,
    "linear_stiffness": _linear,
    "cubic_stiffness": _cubic,
    "elastic_stop": _stop,
    "one_sided_spring": _one_sided,
    "constant_force": _constant,
    "periodic_force": _periodic,
}
FRICTION = ("viscous_friction", "coulomb_friction", "stribeck_friction", "load_friction", "quadratic_drag")
ON_REQUEST = ("asymmetric_damping", "linear_stiffness")
"""Kinds for machines that are known to be so: beside all others they imitate what is not listed."""
PLACED = ("hysteresis", "cogging", "linear_stiffness", "cubic_stiffness", "elastic_stop", "one_sided_spring")
"""Kinds that need to know where the axis is."""


def force(
    velocity: str, only: Sequence[str] = (), without: Sequence[str] = (), prefix: str = ""
) -> tuple[Stock, ...]:
    """Stock effects of a force on a velocity: all of them, or some kinds.

    Args:
        velocity: Name of the state on whose rate they act; ``Machine.forces`` may say more of it.
        only: The kinds that are wanted; by default all that a machine can have but those of ``ON_REQUEST``.
        without: Kinds that are not.
        prefix: Beginning of their names, to be chosen where a machine has several such states.

    Raises:
        ModelError: For a kind that there is none of.
    """
    kinds = only or [kind for kind in LIBRARY if kind not in ON_REQUEST]
    return choose(LIBRARY, "force", velocity, kinds, without, prefix)


def friction(
    velocity: str, only: Sequence[str] = (), without: Sequence[str] = (), prefix: str = ""
) -> tuple[Stock, ...]:
    """The kinds of friction and drag on a velocity, and a constant force, or some of them; see ``force``."""
    return force(velocity, only or (*FRICTION, "constant_force"), without, prefix)
