"""What the experiment is made of: vehicle, arm, limits of the arm's motion, noise of the sensors.

Source of this package: V. A. Sujan and S. Dubowsky, "An optimal information method for mobile manipulator
dynamic parameter identification", IEEE/ASME Trans. Mechatronics 8(2), 2003. Equation and table numbers in
this package are that paper's.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Annotated, Literal

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.information import BITS
from fieldmodels.model import ModelError, Parameter
from fieldmodels.names import did_you_mean
from fieldmodels.settings import Setting, check_declared, code

MODES = 3
"""Runs of the experiment: the arm turns about x, y, z in turn (section III)."""
EQUATIONS = 6
"""Equations (4) of one mode: three of force, three of moment."""
ROWS = MODES * EQUATIONS
"""Equations of one sample of all three modes."""
SAMPLE = 0.005
"""Sampling interval [s] (section VII-A)."""
SAMPLES = 80
"""Samples a decision of 0.4 s (section VII-A)."""
DURATION = 10.0
"""Length of a run [s] (section VII-A)."""

_AXES = ("x", "y", "z")
_TURNS = ("pitch", "roll", "yaw")  # about x, y, z; y points forward, z up


def _range(prefix: str, unit: str, kinds: tuple[str, ...], values: tuple[float, ...], lower: float,
           upper: float) -> tuple[Parameter, ...]:  # fmt: skip
    return tuple(
        Parameter(f"{prefix}_{kind}", unit, value, lower, upper, (upper - lower) / math.sqrt(12.0), "Table I")
        for kind, value in zip(kinds, values, strict=True)
    )


VEHICLE: tuple[Parameter, ...] = (
    Parameter("mass", "kg", 3.0, 0.0, 10.0, 10.0 / math.sqrt(12.0), "Table I"),
    *_range("inertia", "kg m2", _AXES, (0.15, 0.10, 0.20), 0.0, 0.5),
    *_range("inertia", "kg m2", ("xz", "yz", "xy"), (0.0, 0.03, 0.0), -0.2, 0.2),
    *_range("cg", "m", _AXES, (0.01, 0.3, 0.1), -1.0, 1.0),
    *_range("damping", "kg/s", _AXES, (100.0, 100.0, 300.0), 0.0, 1000.0),
    *_range("damping", "kg m2/s", _TURNS, (200.0, 300.0, 400.0), 0.0, 1000.0),
    *_range("stiffness", "kg/s2", _AXES, (1000.0, 1000.0, 500.0), 0.0, 5000.0),
    *_range("stiffness", "kg m2/s2", _TURNS, (2000.0, 2500.0, 3000.0), 0.0, 5000.0),
)
"""The 22 unknowns in Table I's order with its true values; bounds are the prior's range (assumed).

``inertia_xy`` is an element of the tensor (not its negative); ``cg`` points from the centre of gravity to
the arm's base joint (r2). The rotational units are kg m2/s and kg m2/s2; Table I prints kg/s and kg/s2.
"""

NAMES = tuple(p.name for p in VEHICLE)
UNKNOWNS = len(VEHICLE)
MASS, INERTIA, CG, DAMPING, STIFFNESS = (
    NAMES.index(name) for name in ("mass", "inertia_x", "cg_x", "damping_x", "stiffness_x")
)
"""Where the groups begin; inertia in the order x, y, z, xz, yz, xy."""

TABLE1: FloatArray = np.array([p.nominal for p in VEHICLE])
SOFT: FloatArray = np.concatenate(
    [TABLE1[:DAMPING], [20.0, 20.0, 30.0, 2.0, 2.0, 3.0], [1000.0, 1000.0, 1500.0, 60.0, 50.0, 80.0]]
)
"""The same body on a suspension so soft that its inertia shows (assumed)."""
PRESETS: Mapping[str, FloatArray] = MappingProxyType({"table1": TABLE1, "soft": SOFT})
for _vector in PRESETS.values():
    _vector.setflags(write=False)

LOWER: FloatArray = np.array([p.lower for p in VEHICLE])
UPPER: FloatArray = np.array([p.upper for p in VEHICLE])
PRIOR_MEAN: FloatArray = 0.5 * (LOWER + UPPER)
"""Before any measurement: the middle of the range (the source: "design values", or zero)."""
PRIOR_VARIANCE: FloatArray = (UPPER - LOWER) ** 2 / 12.0
"""Variance of the uniform distribution over the range (section IV: "the range of the sensors")."""


def preset(name: str) -> FloatArray:
    """The 22 true values of a preset, ``table1`` or ``soft``; a fresh copy.

    Raises:
        ModelError: If there is no such preset.
    """
    if name not in PRESETS:
        raise ModelError(f"no vehicle {name!r}{did_you_mean(name, PRESETS)}")
    return PRESETS[name].copy()


@dataclass(frozen=True)
class Arm:
    """The rigid arm: a uniform rod on the vehicle's joint.

    Attributes:
        mass: Mass m2 [kg] (section VII-A).
        reach: Joint to centre of mass [m]; half of the length that gives m2 L^2/12 = 0.02 (assumed).
        inertia_across: Inertia about any axis across the rod, at its centre of mass [kg m2] (VII-A).
        inertia_along: Inertia about the rod's own axis [kg m2] (VII-A).
        gravity: Acceleration of free fall [m/s2].
    """

    mass: float = 1.0
    reach: float = 0.245
    inertia_across: float = 0.02
    inertia_along: float = 0.001
    gravity: float = 9.81

    def __post_init__(self) -> None:
        """Check that the numbers make sense.

        Raises:
            ModelError: If one is not positive.
        """
        for name in ("mass", "reach", "inertia_across", "inertia_along", "gravity"):
            if not getattr(self, name) > 0:
                raise ModelError(f"arm: {name} must be positive, not {getattr(self, name)}")

    def row(self) -> FloatArray:
        """The numbers in the order of the attributes, as kernels take them, shape (5,)."""
        return np.array([self.mass, self.reach, self.inertia_across, self.inertia_along, self.gravity])


@dataclass(frozen=True)
class Limits:
    """What the arm may do; the source names no numbers ("bandwidth constraints").

    Attributes:
        amplitude: Largest amplitude a [rad].
        frequency: Smallest and largest frequency w [rad/s].
        offset: Smallest and largest offset a0 [rad].
        acceleration: Largest |f''| [rad/s2], also while one command blends into the next.
    """

    amplitude: float = math.pi / 2
    frequency: tuple[float, float] = (0.5, 12.0)
    offset: tuple[float, float] = (-math.pi / 2, math.pi / 2)
    acceleration: float = 25.0


LIMITS: Mapping[str, Limits] = MappingProxyType(
    {"paper": Limits(frequency=(0.5, 3.0), acceleration=5.0), "wide": Limits()}
)


NoiseKind = Annotated[
    Literal["full_scale", "running_max"],
    Setting(
        "Each sensor's noise is a share of its maximum under the constant excitation (24) (`full_scale`) "
        "or in this run so far (`running_max`)."
    ),
]
NoiseFraction = Annotated[float, Setting('That share (the source: "up to 10 %").', least=0, most=1)]


@dataclass(frozen=True)
class SensorNoise:
    """White noise on every measured signal, uniform up to a share of the maximum sensed value (VII-A).

    Attributes:
        per_mode: True takes each mode's own maximum; False, one sensor's, which is the same in all modes.
    """

    kind: NoiseKind = "full_scale"
    fraction: NoiseFraction = 0.1
    per_mode: bool = False

    def __post_init__(self) -> None:
        """Check the numbers; see ``check_declared``."""
        check_declared(self)


@dataclass(frozen=True)
class Rules:
    """What is shaken, how it is sensed, and who estimates."""

    preset: Annotated[
        Literal["table1", "soft"],
        Setting("The vehicle: `table1` of Table I, `soft` the same body on a softer suspension."),
    ] = "table1"
    truth_spread: Annotated[
        float,
        Setting(
            "Each episode's vehicle has the preset's mass, lever arms, damping and stiffness times "
            "factors from [1 - spread, 1 + spread].",
            least=0,
            most=0.5,
        ),
    ] = 0.0
    limits: Annotated[
        Literal["paper", "wide"],
        Setting("Limits of the arm: `paper` 3 rad/s and 5 rad/s2; `wide` 12 rad/s and 25 rad/s2."),
    ] = "wide"
    noise: NoiseKind = SensorNoise.kind
    noise_fraction: NoiseFraction = SensorNoise.fraction
    estimator: Annotated[
        Literal["compensated", "low_passed", "naive"],
        Setting(
            "Filter that is scored: `compensated`, `low_passed` (on means of 8 samples) or `naive`, as "
            "published.",
            fixed="one kind of filter runs for all rows",
        ),
    ] = "compensated"
    variant: Annotated[
        Literal["full", "table2"],
        Setting(
            "`full`: 22 unknowns; `table2`: five, of pitch, without accelerometer.",
            fixed="it shapes the filters' equations",
        ),
    ] = "full"
    bits: Annotated[
        int,
        Setting("Precision n of the metric.", "bits", least=1, most=20),
    ] = BITS

    def __post_init__(self) -> None:
        """Check the numbers; see ``check_declared``."""
        check_declared(self)

    @property
    def sensor_noise(self) -> SensorNoise:
        """The sensors' noise."""
        return SensorNoise(self.noise, self.noise_fraction)


RUNNING = code(Rules, "noise", "running_max")
