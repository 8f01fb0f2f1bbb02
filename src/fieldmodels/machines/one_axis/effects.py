"""What may be missing from the nominal axis: the effect library of both benches.

Left out, because these data cannot tell them from what is there: a bias of the actuator (the same
equation as a constant force, whose cause names both), wind (a constant or periodic force), slip and
slope (a bench has neither), and for the rig a bias of the position sensor (a constant force on the
spring), viscous friction (its damping), and dry friction that differs by direction (Coulomb friction
with a constant force, sliding and at rest: ``F_+`` and ``F_-`` are ``F_c`` +- ``F_0``).
"""

from __future__ import annotations

import numpy as np

from fieldmodels.machines.one_axis.axis import Axis
from fieldmodels.machines.one_axis.kernel import NO_LIMIT
from fieldmodels.machines.one_axis.scales import Scales
from fieldmodels.model import Effect, Parameter, Where

LARGE = 1e12
"""A bound that no bench reaches, in any unit of the library."""


def effect_library(axis: Axis, s: Scales) -> tuple[Effect, ...]:
    """All effects of a bench, with steps and starts that suit its scales."""
    return force_effects(axis, s) + actuator_effects(axis, s) + sensor_effects(axis, s) + change_effects(s)


def force_effects(axis: Axis, s: Scales) -> tuple[Effect, ...]:
    """Effects in the equation of motion."""
    f, newton, metre = axis.force_name, axis.force_unit, axis.position_unit
    coefficient = f"{newton} s/{metre}", f"{newton} s^2/{metre}^2", f"{newton}/{metre}^3"
    viscous = _effect(
        "viscous_friction",
        "force",
        "Friction grows in proportion to the speed; the simulation has none.",
        "-c v",
        _positive("coefficient", coefficient[0], 0.1 * s.force / s.velocity),
    )
    payload_parameters = [_positive("mass", "kg", 0.1 * s.base[0])]
    if axis.rotary:
        payload_parameters.append(Parameter("length", "m", 0.5, 1e-3, 1e2, 0.05, starts=(0.5,)))
    return (
        *(() if axis.damped else (viscous,)),
        _effect(
            "coulomb_friction", "force",
            f"Dry friction: a {f} of constant size opposes motion and holds the axis at rest.",
            "-F_c sign(v)",
            _positive(f, newton, 0.1 * s.force),
        ),
        _effect(
            "stribeck_friction", "force",
            f"Dry friction falls with speed: to break away takes more {f} than to keep sliding.",
            "-F_s exp(-(v/v_s)^2) sign(v), beside Coulomb friction",
            _positive(f, newton, 0.1 * s.force),
            _span("velocity", f"{metre}/s", s.velocity, 0.03, 0.1, 0.3),
        ),
        _effect(
            "hysteresis", "force",
            f"The axis bends before it slips (cable, seal, belt, gear): the {f} depends on the way it came.",
            "dF_h/dx = (F_m - F_h sign(v)) / distance",
            _positive(f, newton, 0.1 * s.force),
            _span("distance", metre, s.position, 0.03, 0.1, 0.3, 1.0),
        ),
        _effect(
            "cogging", "force", f"A {f} that repeats along the way: magnets, teeth or an eccentric pulley.",
            "B_s sin(2 pi x/p) + B_c cos(2 pi x/p)",
            _signed("sine", newton, 0.1 * s.force),
            _signed("cosine", newton, 0.1 * s.force),
            _span("period", metre, 4.0 * s.position, *(1.0 / np.arange(1.0, 15.1, 0.5))),
        ),
        _effect(
            "quadratic_drag", "force",
            "Drag grows with the square of the speed, as of air or a fluid.", "-d v |v|",
            _positive("coefficient", coefficient[1], 0.1 * s.force / s.velocity**2),
        ),
        _effect(
            "cubic_stiffness", "force",
            "A spring that gets stiffer (or softer) with deflection acts on the axis.", "-k_3 x^3",
            _signed("coefficient", coefficient[2], 0.1 * s.force / s.position**3),
        ),
        _effect(
            "backlash", "force",
            "Play between motor and load: the sensor sits on the motor, which rests on one flank or the "
            f"other as the {f} pushes.",
            "x shown = x + gap/2 sign(F), smoothed over 2 % of the largest command",
            _positive("gap", metre, 0.05 * s.position),
        ),
        _effect(
            "payload", "force", "The axis carries an additional load.",
            "M + m l^2, G + m g l" if axis.rotary else "M + m",
            *payload_parameters,
        ),
        _effect(
            "constant_force", "force",
            f"A constant {f} acts on the axis, or the actuator gives a constant {f} too much: "
            "a tilted or unbalanced bench, a preload, or a bias of the drive.",
            "+F_0",
            _signed(f, newton, 0.1 * s.force),
        ),
        _effect(
            "periodic_force", "force", f"A {f} that swings at one frequency shakes the axis.",
            "A_s sin(2 pi f t) + A_c cos(2 pi f t)",
            _signed("sine", newton, 0.1 * s.force),
            _signed("cosine", newton, 0.1 * s.force),
            Parameter("frequency", "Hz", 1.0, 0.01, 1e3, 0.05 / s.duration, starts=s.frequencies),
        ),
    )  # fmt: skip


def actuator_effects(axis: Axis, s: Scales) -> tuple[Effect, ...]:
    """Effects between the command and the force."""
    f, newton = axis.force_name, axis.force_unit
    late = tuple(s.step * k for k in (0.5, 3.0, 10.0))
    return (
        _effect(
            "actuator_gain", "actuator", f"The actuator gives more or less {f} than commanded.", "F = g u",
            Parameter("gain", "1", 1.0, 0.05, 20.0, 0.05, starts=(0.8, 1.25)),
        ),
        _effect(
            "actuator_asymmetry", "actuator",
            "The actuator is stronger in one direction than in the other.",
            "F = (1 + d/2) u for u > 0, (1 - d/2) u for u < 0",
            Parameter("difference", "1", 0.0, -1.8, 1.8, 0.05, starts=(0.1,)),
        ),
        _effect(
            "actuator_lag", "actuator",
            f"The {f} follows the command with a first-order lag (motor winding, valve).",
            "T dF/dt = u - F",
            Parameter("time_constant", "s", 0.0, 0.0, 10.0, s.step, starts=late),
        ),
        _effect(
            "actuator_rate_limit", "actuator", f"The {f} cannot change faster than at a certain rate.",
            "|dF/dt| <= rate",
            Parameter(
                "rate", f"{newton}/s", NO_LIMIT, 1e-9, NO_LIMIT, 0.05 * s.rate,
                starts=tuple(s.rate / k for k in (0.5, 1.5, 4.0, 10.0, 25.0)),
            ),
        ),
        _effect(
            "actuator_delay", "actuator", "The command acts late (bus, computing time).", "F(t) = u(t - T)",
            Parameter("delay", "s", 0.0, 0.0, 2.0, s.step, starts=late),
        ),
        _effect(
            "actuator_saturation", "actuator", f"The actuator cannot give more than a certain {f}.",
            "|F| <= limit",
            Parameter(
                "limit", newton, NO_LIMIT, 1e-9, NO_LIMIT, 0.05 * s.high_forces[0],
                starts=s.high_forces,
            ),
        ),
        _effect(
            "actuator_dead_zone", "actuator", "Small commands have no effect.",
            "F = 0 for |u| < width, else u - width sign(u)",
            Parameter(
                "width", newton, 0.0, 0.0, LARGE, 0.02 * s.high_forces[0],
                starts=tuple(s.high_forces[0] * k for k in (0.02, 0.1, 0.3)),
            ),
        ),
    )  # fmt: skip


def sensor_effects(axis: Axis, s: Scales) -> tuple[Effect, ...]:
    """Effects between the motion and what the sensors show."""
    x, metre = axis.position_name, axis.position_unit
    if axis.rotary:
        bias = _effect(
            "sensor_bias",
            "sensor",
            "The angle sensor's zero is not where the axis hangs at rest.",
            "angle shown = angle + bias",
            _signed("bias", "rad", 0.05 * s.position),
        )
    else:
        bias = _effect(
            "sensor_bias",
            "sensor",
            "The velocity sensor shows a constant too much.",
            "velocity shown = velocity + bias",
            _signed("bias", "m/s", 0.05 * s.velocity),
        )
    late = tuple(s.step * k for k in (0.5, 3.0, 10.0))
    return (
        bias,
        _effect(
            "sensor_drift", "sensor", f"The {x} sensor drifts steadily.", f"{x} shown = {x} + rate t",
            _signed("rate", f"{metre}/s", 0.1 * s.position / s.duration),
        ),
        _effect(
            "sensor_gain", "sensor", f"The {x} sensor shows too much or too little in proportion.",
            f"{x} shown = gain {x}",
            Parameter("gain", "1", 1.0, 0.05, 20.0, 0.05, starts=(0.9, 1.1)),
        ),
        _effect(
            "sensor_delay", "sensor", f"The {x} is shown late (filter, bus); the velocity is not.",
            f"{x} shown (t) = {x}(t - T)",
            Parameter("delay", "s", 0.0, 0.0, 2.0, s.step, starts=late),
        ),
        _effect(
            "sensor_quantisation", "sensor", f"The {x} sensor shows multiples of a coarse step.",
            "shown = step round(shown / step)",
            Parameter(
                "step", metre, 0.0, 0.0, LARGE, 0.01 * s.position,
                starts=tuple(s.position * k for k in (0.01, 0.03, 0.1)), smooth=False,
            ),
        ),
    )  # fmt: skip


def change_effects(s: Scales) -> tuple[Effect, ...]:
    """Effects of one moment."""
    return (
        _effect(
            "parameter_step", "change",
            "The actuator's strength jumps during the record (a voltage drops, a coupling slips).",
            "F = factor u from time on",
            Parameter(
                "time", "s", 0.0, 0.0, 1e5, 0.02 * s.duration,
                starts=tuple(float(t) for t in np.linspace(0.1, 0.9, 17) * s.duration), smooth=False,
            ),
            Parameter("factor", "1", 1.0, 0.05, 20.0, 0.05, starts=(0.9,)),
        ),
    )  # fmt: skip


def _effect(name: str, where: Where, cause: str, equation: str, *parameters: Parameter) -> Effect:
    return Effect(name=name, cause=cause, where=where, parameters=parameters, equation=equation)


def _positive(name: str, unit: str, size: float) -> Parameter:
    return Parameter(name, unit, 0.0, 0.0, LARGE, 0.5 * size, starts=(size,))


def _signed(name: str, unit: str, size: float) -> Parameter:
    return Parameter(name, unit, 0.0, -LARGE, LARGE, 0.5 * size, starts=(size,))


def _span(name: str, unit: str, size: float, *shares: float) -> Parameter:
    """A width that shapes an effect but does not switch it: sought from several shares of a size."""
    starts = tuple(float(size * share) for share in shares)
    return Parameter(name, unit, 1.0, 1e-9, LARGE, 0.5 * starts[0], starts=starts)
