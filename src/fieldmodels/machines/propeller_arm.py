"""An arm on a hinge that a propeller lifts: the model of a quarter of a drone."""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.machines.one_axis import kernel
from fieldmodels.machines.one_axis.axis import Axis
from fieldmodels.machines.one_axis.model import OneAxis
from fieldmodels.machines.one_axis.scales import Scales
from fieldmodels.machines.pendulum import Pendulum
from fieldmodels.model import Effect, Parameter, Signal
from fieldmodels.recording import Windows

BENCH = "identified on the quarter-drone bench"
NOT_SCALED = ("payload",)
"""Effects in kg and m, which have no meaning where moments are in units of the thrust's."""
THRUST_CURVE = Effect(
    name="thrust_curve",
    cause="Thrust grows with a power of the command (with the square, if the command sets a propeller's "
    "speed), not in proportion.",
    where="actuator",
    parameters=(Parameter("exponent", "1", 1.0, 0.2, 5.0, 0.1, starts=(0.6, 1.5, 2.0)),),
    equation="F = |u|^exponent sign(u)",
)


class PropellerArm(OneAxis):
    """An inertia under gravity that a propeller turns about a hinge: motor command in, angle out.

        inertia dv/dt = command - damping v - gravity_moment sin(angle)

    A motion shows only ratios of moments; so all of them are in units of the thrust's moment at full
    command (1, or 100 %). The angle is zero where the arm hangs at rest. Nominally thrust is in proportion
    to the command.
    """

    name = "propeller_arm"
    inputs = (Signal("command", "1"),)
    outputs = Pendulum.outputs
    states = Pendulum.states
    parameters = (
        Parameter("inertia", "s^2", 0.01, 1e-9, 1e6, 1e-3, source=BENCH),
        Parameter("damping", "s", 0.02, 0.0, 1e4, 0.005, source=BENCH),
        Parameter("gravity_moment", "1", 0.4, 0.0, 1e4, 0.04, source=BENCH),
    )
    horizons = (0.5, 1.0, 2.0)
    disturbance_unit = "1"
    axis = Axis(True, True, "torque", "1", "angle", "rad")
    nominal_scales = Scales(
        base=(0.01, 0.02, 0.4), force=0.35, high_forces=(0.5, 0.45, 0.42, 0.4), rate=10.0,
        position=0.4, velocity=1.0,
        duration=100.0, step=0.01, position_noise=2e-4, velocity_noise=5e-2, frequencies=(1.0,),
    )  # fmt: skip
    slots = MappingProxyType(
        {name: slot for name, slot in Pendulum.slots.items() if not name.startswith("viscous_friction")}
        | {"damping": kernel.DAMPING}
    )

    def __init__(self, scales: Scales | None = None, driven_by_measured: bool = False) -> None:
        """Declare parameters and effects for an arm of these scales (default: nominal)."""
        super().__init__(scales, driven_by_measured)
        self.measured_inputs = ()  # thrust on a bench is not measured
        library = tuple(effect for effect in self.effects if effect.name not in NOT_SCALED)
        self.effects = (*library, THRUST_CURVE)

    def simulate(self, parameters: FloatArray, windows: Windows) -> FloatArray:
        """Simulate every window with the thrust that the command gives; see ``Model.simulate``."""
        parameters = np.atleast_2d(parameters)
        exponents = parameters[:, self.index("thrust_curve.exponent")]
        out = np.empty((len(parameters), len(windows), windows.samples, len(self.outputs)))
        recording, name = windows.recording, self.inputs[0].name
        for exponent in np.unique(exponents):
            thrust = np.sign(recording[name]) * np.abs(recording[name]) ** exponent
            driven = replace(recording, signals={**recording.signals, name: thrust})
            rows = exponents == exponent
            out[rows] = super().simulate(parameters[rows], replace(windows, recording=driven))
        return out
