"""The heel-strike model of a diagnosis (first form: its parameters and effects)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fieldmodels.heel_strike.parameters import Leg
from fieldmodels.model import Effect, FloatArray, Model, Parameter, Signal
from fieldmodels.recording import Recording, Windows


def _effects(leg: Leg) -> tuple[Effect, ...]:
    def p(
        name: str, unit: str, nominal: float, lower: float, upper: float, scale: float, smooth: bool = True
    ) -> Parameter:
        return Parameter(name, unit, nominal, lower, upper, scale, smooth=smooth)

    return (
        Effect(
            "viscous_friction",
            "The hinge is damped in proportion to its speed.",
            "force",
            (p("rate", "1/s", 0.0, -0.5, 2.0, 0.05),),
            "-rate * omega",
        ),
        Effect(
            "coulomb_friction",
            "The hinge has dry friction.",
            "force",
            (p("acceleration", "rad/s2", 0.0, 0.0, 2.0, 0.05),),
            "-acceleration * sign(omega)",
        ),
        Effect(
            "quadratic_drag",
            "Air or water resists with the square of the speed.",
            "force",
            (p("coefficient", "1/rad", 0.0, 0.0, 2.0, 0.05),),
            "-coefficient * omega * |omega|",
        ),
        Effect(
            "constant_force",
            "A constant torque acts on the leg: a slope, an off-centre mass, or a steady wind.",
            "force",
            (p("acceleration", "rad/s2", 0.0, -2.0, 2.0, 0.05),),
            "+acceleration",
        ),
        Effect(
            "periodic_force",
            "A periodic torque acts on the leg, for example from an unbalanced motor.",
            "force",
            (
                p("amplitude", "rad/s2", 0.0, 0.0, 5.0, 0.1),
                p("frequency", "Hz", 1.0, 0.05, 20.0, 0.1),
                p("phase", "rad", 0.0, -2 * np.pi, 2 * np.pi, 0.5),
            ),
            "+amplitude * sin(2 pi frequency t + phase)",
        ),
        Effect(
            "gyro_bias",
            "The gyro reads a constant rate when nothing turns.",
            "sensor",
            (p("rate", "rad/s", 0.0, -0.5, 0.5, 0.002),),
            "+rate on the gyro",
        ),
        Effect(
            "gyro_drift",
            "The gyro's bias grows steadily.",
            "sensor",
            (p("rate", "rad/s2", 0.0, -0.01, 0.01, 2e-5),),
            "+rate * t on the gyro",
        ),
        Effect(
            "gyro_gain",
            "The gyro's scale is wrong.",
            "sensor",
            (p("gain", "1", 1.0, 0.5, 2.0, 0.01),),
            "gain * omega on the gyro",
        ),
        Effect(
            "gyro_delay",
            "The gyro's reading comes late.",
            "sensor",
            (p("delay", "s", 0.0, 0.0, 0.02, 0.001),),
            "omega(t - delay) on the gyro",
        ),
        Effect(
            "gyro_quantisation",
            "The gyro's reading is rounded to a coarse step.",
            "sensor",
            (p("step", "rad/s", 0.0, 0.0, 0.5, 0.01, smooth=False),),
            "round(gyro / step) * step",
        ),
        Effect(
            "parameter_step",
            "The gyro's bias jumps during the record.",
            "change",
            (
                p("rate", "rad/s", 0.0, -0.5, 0.5, 0.002),
                p("time", "s", 0.0, 0.0, 1e6, 10.0, smooth=False),
            ),
            "+rate on the gyro from time on",
        ),
    )


class HeelStrikeModel(Model):
    """The leg between heel strikes, watched by its gyro and by the geometry at each strike."""

    name = "heel_strike"
    inputs = (Signal("strike", "1"),)
    outputs = (Signal("gyro", "rad/s", noise=0.0041), Signal("strike_angle", "rad", noise=0.005, angle=True))
    states = (Signal("theta", "rad", noise=0.01, angle=True), Signal("omega", "rad/s", noise=0.02))
    horizons = (0.5, 1.0, 2.0)
    disturbance_unit = "rad/s2"

    def __init__(self, leg: Leg | None = None) -> None:
        """Take the nominal leg (its length is the base parameter)."""
        self.leg = leg or Leg()
        self.parameters = (Parameter("length", "m", self.leg.length, 0.2, 5.0, 0.02, source="section 2.4.1"),)
        self.effects = _effects(self.leg)

    def simulate(self, parameters: FloatArray, windows: Windows) -> FloatArray:
        """See ``Model.simulate``."""
        raise NotImplementedError

    def initial_states(self, recording: Recording, starts: NDArray[np.int64]) -> FloatArray:
        """See ``Model.initial_states``."""
        raise NotImplementedError
