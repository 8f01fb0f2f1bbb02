"""A one-axis test rig on a spring: the model for a user's own linear bench."""

from __future__ import annotations

from types import MappingProxyType

from fieldmodels.arrays import FloatArray
from fieldmodels.machines.one_axis import kernel
from fieldmodels.machines.one_axis.axis import LINEAR
from fieldmodels.machines.one_axis.model import OneAxis
from fieldmodels.machines.one_axis.scales import Scales
from fieldmodels.model import Parameter, Signal


class Rig(OneAxis):
    """Mass, viscous damper and spring; a force in, a position (and perhaps a velocity) out.

        mass dv/dt = force - damping v - stiffness x

    Nominal values are an ordinary table-top bench; a diagnosis refits them, whatever the bench.
    """

    name = "rig"
    inputs = (Signal("force", "N"),)
    outputs = (Signal("position", "m", noise=2e-4), Signal("velocity", "m/s", noise=5e-3, optional=True))
    states = (Signal("position", "m"), Signal("velocity", "m/s"))
    parameters = (
        Parameter("mass", "kg", 2.0, 1e-6, 1e6, 0.2),
        Parameter("damping", "N s/m", 4.0, 0.0, 1e8, 0.4),
        Parameter("stiffness", "N/m", 80.0, 0.0, 1e10, 8.0),
    )
    horizons = (0.2, 0.5, 1.0)
    disturbance_unit = "N"
    axis = LINEAR
    nominal_scales = Scales(
        base=(2.0, 4.0, 80.0), force=3.0, high_forces=(8.0, 6.0, 4.0, 2.0), rate=800.0, position=0.05,
        velocity=0.2, duration=30.0, step=0.01, position_noise=2e-4, velocity_noise=5e-3, frequencies=(1.0,),
    )  # fmt: skip
    slots = MappingProxyType(
        {
            "mass": kernel.INERTIA,
            "damping": kernel.DAMPING,
            "stiffness": kernel.STIFFNESS,
            "coulomb_friction.force": kernel.COULOMB,
            "stribeck_friction.force": kernel.STRIBECK,
            "hysteresis.force": kernel.BRISTLE,
            "constant_force.force": kernel.CONSTANT,
            "sensor_bias.bias": kernel.VELOCITY_BIAS,
            **kernel.SHARED_SLOTS,
        }
    )

    def rows(self, parameters: FloatArray) -> FloatArray:
        """Kernel rows; a payload adds to the mass."""
        rows = super().rows(parameters)
        rows[:, kernel.INERTIA] += parameters[:, self.index("payload.mass")]
        return rows
