"""What may be missing from the nominal vehicle, arm and sensors: the effects of ``ExcitationModel``.

The first seven parameters stand in the order of ``dynamics``; the rest act on what goes in and comes out.
Left out, since these data cannot tell it from others: slip of the wheels (beside the soil's compliance, which
lies in series with the same springs), a tilted rest (the force/torque sensor is zeroed there).
"""

from __future__ import annotations

from fieldmodels.model import Effect, Parameter

EFFECTS: tuple[Effect, ...] = (
    Effect(
        "payload",
        "The arm carries a mass at its tip.",
        "force",
        (Parameter("mass", "kg", 0.0, 0.0, 5.0, 0.02),),
        "point mass at twice the reach, there at rest too",
    ),
    Effect(
        "cubic_stiffness",
        "The suspension stiffens with its deflection.",
        "force",
        (
            Parameter("force", "1/m2", 0.0, -50.0, 1000.0, 2.0),
            Parameter("torque", "1/rad2", 0.0, -5.0, 100.0, 0.5),
        ),
        "-k x (1 + c x^2)",
    ),
    Effect(
        "coulomb_friction",
        "The suspension has dry friction.",
        "force",
        (
            Parameter("force", "N", 0.0, 0.0, 50.0, 0.1),
            Parameter("torque", "N m", 0.0, 0.0, 20.0, 0.05),
        ),
        "-force * v / sqrt(v^2 + (2 mm/s)^2), -torque * w / sqrt(w^2 + (10 mrad/s)^2)",
    ),
    Effect(
        "stiffness_drift",
        "The suspension's stiffness changes steadily, as when it warms up.",
        "change",
        (Parameter("rate", "1/s", 0.0, -0.05, 0.05, 0.001),),
        "k (1 + rate * t), of the spring's cubic part and of the soil too",
    ),
    Effect(
        "soil_compliance",
        "The soil under the wheels yields.",
        "environment",
        (Parameter("share", "1", 0.0, 0.0, 2.0, 0.02),),
        "a spring of k / share under each: share b / k dF/dt = resistance - (1 + share) F",
    ),
    Effect(
        "actuator_lag",
        "The arm follows its command with a lag.",
        "actuator",
        (Parameter("time_constant", "s", 0.0, 0.0, 0.2, 0.002),),
        "time_constant * df/dt = command - f, at first as far behind as its steady motion",
    ),
    Effect(
        "accelerometer_bias",
        "The accelerometer shows an acceleration when nothing moves.",
        "sensor",
        tuple(Parameter(axis, "m/s2", 0.0, -2.0, 2.0, 0.01) for axis in ("x", "y", "z")),
        "+(x, y, z) on the accelerometer",
    ),
    Effect(
        "accelerometer_gain",
        "The accelerometer's scale is wrong.",
        "sensor",
        (Parameter("gain", "1", 1.0, 0.3, 3.0, 0.01),),
        "gain * acceleration + bias",
    ),
    Effect(
        "inclinometer_bias",
        "The inclinometer shows a tilt when the vehicle stands level.",
        "sensor",
        (
            Parameter("pitch", "rad", 0.0, -0.3, 0.3, 0.001),
            Parameter("roll", "rad", 0.0, -0.3, 0.3, 0.001),
        ),
        "+(pitch, roll) on the inclinometer",
    ),
    Effect(
        "inclinometer_delay",
        "The inclinometer's readings come late.",
        "sensor",
        (Parameter("delay", "s", 0.0, 0.0, 0.2, 0.002),),
        "tilt(t - delay)",
    ),
    Effect(
        "force_torque_gain",
        "The scale of the force/torque sensor is wrong.",
        "sensor",
        (Parameter("gain", "1", 1.0, 0.3, 3.0, 0.01),),
        "gain * (force, torque)",
    ),
)
