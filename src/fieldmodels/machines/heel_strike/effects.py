"""What may be missing from the nominal leg: the effects of ``HeelStrikeModel``, in the kernels' order.

Left out, since data cannot tell them from these: a slope (a constant force at the small angles of a
walk), an off-centre mass (the same), a gravity error (the length).
"""

from __future__ import annotations

from fieldmodels.model import Effect, Parameter

ACCELERATION = "rad/s2"


def leg_effects(duration: float = 300.0, frequencies: tuple[float, ...] = (1.0,)) -> tuple[Effect, ...]:
    """All effects.

    Args:
        duration: Length of the longest recording [s]; times and frequencies are resolved by it.
        frequencies: Where a periodic force may be sought [Hz].
    """
    return (
        Effect(
            "viscous_friction",
            "The hinge is damped in proportion to its speed.",
            "force",
            (Parameter("rate", "1/s", 0.0, -0.5, 2.0, 0.05),),
            "-rate * omega",
        ),
        Effect(
            "coulomb_friction",
            "The hinge has dry friction.",
            "force",
            (Parameter("acceleration", ACCELERATION, 0.0, 0.0, 2.0, 0.05),),
            "-acceleration * omega / sqrt(omega^2 + (0.01 rad/s)^2)",
        ),
        Effect(
            "quadratic_drag",
            "The air resists with the square of the speed.",
            "force",
            (Parameter("coefficient", "1/rad", 0.0, 0.0, 2.0, 0.05),),
            "-coefficient * omega * |omega|",
        ),
        Effect(
            "constant_force",
            "A steady torque acts on the leg: a slope, an off-centre mass, or a steady wind.",
            "force",
            (Parameter("acceleration", ACCELERATION, 0.0, -2.0, 2.0, 0.05),),
            "+acceleration",
        ),
        Effect(
            "periodic_force",
            "A periodic torque acts on the leg, for example from an unbalanced motor.",
            "force",
            (
                Parameter("sine", ACCELERATION, 0.0, -5.0, 5.0, 0.1),
                Parameter("cosine", ACCELERATION, 0.0, -5.0, 5.0, 0.1),
                Parameter("frequency", "Hz", 1.0, 0.05, 20.0, 0.05 / duration, starts=frequencies),
            ),
            "sine * sin(2 pi * frequency * t) + cosine * cos(2 pi * frequency * t)",
        ),
        Effect(
            "gyro_bias",
            "The gyro shows a rate when nothing turns.",
            "sensor",
            (Parameter("rate", "rad/s", 0.0, -0.5, 0.5, 0.002),),
            "+rate on the gyro",
        ),
        Effect(
            "gyro_drift",
            "The gyro's bias grows steadily from zero at t = 0.",
            "sensor",
            (Parameter("rate", ACCELERATION, 0.0, -0.01, 0.01, 0.004 / duration),),
            "+rate * t on the gyro",
        ),
        Effect(
            "gyro_gain",
            "The gyro's scale is wrong.",
            "sensor",
            (Parameter("gain", "1", 1.0, 0.5, 2.0, 0.01),),
            "gain * omega + bias on the gyro, before noise and rounding",
        ),
        Effect(
            "gyro_delay",
            "The gyro's readings come late.",
            "sensor",
            (Parameter("delay", "s", 0.0, 0.0, 0.02, 0.002),),
            "omega(t - delay) on the gyro, linear between its samples",
        ),
        Effect(
            "gyro_quantisation",
            "The gyro shows multiples of a coarse step.",
            "sensor",
            (Parameter("step", "rad/s", 0.0, 0.0, 0.5, 0.01, smooth=False),),
            "step * round(gyro / step), after noise and the other faults",
        ),
        Effect(
            "parameter_step",
            "The gyro's bias jumps during the record.",
            "change",
            (
                Parameter("rate", "rad/s", 0.0, -0.5, 0.5, 0.004),
                Parameter("time", "s", 0.0, 0.0, 1e6, max(duration / 20, 1e-3), smooth=False),
            ),
            "+rate on the gyro from time on",
        ),
    )
