"""A driven pendulum: the model for a user's own rotary bench."""

from __future__ import annotations

from types import MappingProxyType

from fieldmodels.arrays import FloatArray
from fieldmodels.machines.one_axis import kernel
from fieldmodels.machines.one_axis.axis import ROTARY
from fieldmodels.machines.one_axis.model import OneAxis
from fieldmodels.machines.one_axis.scales import Scales
from fieldmodels.model import Parameter, Signal

STANDARD_GRAVITY = 9.80665  # m/s^2, CGPM 1901
DFKI = "identified on the DFKI simple pendulum bench"


class Pendulum(OneAxis):
    """Inertia under gravity without friction; a torque in, an angle (and perhaps a velocity) out.

        inertia dv/dt = torque - gravity_moment sin(angle)

    The angle is zero where the pendulum hangs at rest. ``gravity_moment`` is mass times distance of
    the centre of mass from the axis times the acceleration of gravity.
    """

    name = "pendulum"
    inputs = (Signal("torque", "N m"),)
    outputs = (
        Signal("angle", "rad", noise=2e-3, angle=True),
        Signal("velocity", "rad/s", noise=5e-2, optional=True),
    )
    states = (Signal("angle", "rad"), Signal("velocity", "rad/s"))
    parameters = (
        Parameter("inertia", "kg m^2", 0.0626, 1e-9, 1e6, 0.006, source=DFKI),
        Parameter("gravity_moment", "N m", 1.0, 0.0, 1e8, 0.1, source=DFKI),
    )
    horizons = (0.15, 0.3, 0.6)
    disturbance_unit = "N m"
    axis = ROTARY
    nominal_scales = Scales(
        base=(0.0626, 1.0), force=0.5, high_forces=(1.5, 1.2, 0.8, 0.4), rate=150.0, position=0.8,
        velocity=2.0, duration=30.0, step=0.01, position_noise=2e-3, velocity_noise=5e-2, frequencies=(1.0,),
    )  # fmt: skip
    slots = MappingProxyType(
        {
            "inertia": kernel.INERTIA,
            "gravity_moment": kernel.GRAVITY,
            "viscous_friction.coefficient": kernel.DAMPING,
            "coulomb_friction.torque": kernel.COULOMB,
            "stribeck_friction.torque": kernel.STRIBECK,
            "hysteresis.torque": kernel.BRISTLE,
            "constant_force.torque": kernel.CONSTANT,
            "sensor_bias.bias": kernel.BIAS,
            **kernel.SHARED_SLOTS,
        }
    )

    def rows(self, parameters: FloatArray) -> FloatArray:
        """Kernel rows; a payload is a point mass at some distance from the axis."""
        rows = super().rows(parameters)
        mass = parameters[:, self.index("payload.mass")]
        length = parameters[:, self.index("payload.length")]
        rows[:, kernel.INERTIA] += mass * length**2
        rows[:, kernel.GRAVITY] += mass * length * STANDARD_GRAVITY
        return rows
