"""The numbers of the walk and of its camera: each is declared here and nowhere else."""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike, NDArray

from fieldmodels.declared import as_rows, neutral, row_type
from fieldmodels.machines.line_following.parameters import Camera, Gait
from fieldmodels.model import Effect, Parameter

NO_LIMIT = 10.0
"""A turn that no motor limits [rad]."""


def base_parameters(gait: Gait, camera: Camera) -> tuple[Parameter, ...]:
    """The numbers that a nominal walk depends on."""
    return (
        Parameter("stride", "m", gait.stride, 0.01, 10.0, 0.02, "chapter 2", refitted=False),
        Parameter("camera_height", "m", camera.height, 0.05, 10.0, 0.02, refitted=False),
    )


EFFECTS = (
    Effect(
        "steering_bias",
        "The robot turns a little in every stride, also when commanded to go straight.",
        "actuator",
        (Parameter("turn", "rad", 0.0, -0.5, 0.5, 0.005),),
        "turn + bias in every stride, whatever gain, limit and slip make of the command",
    ),
    Effect(
        "turn_gain",
        "Every turn is larger or smaller than commanded, in proportion.",
        "actuator",
        (Parameter("factor", "1", 1.0, 0.0, 5.0, 0.05),),
        "turn = factor * what is left of the command after limit and slip, + bias",
    ),
    Effect(
        "actuator_delay",
        "A command waits one or more strides longer before it turns the robot.",
        "actuator",
        (Parameter("strides", "1", 0.0, 0.0, 2.0, 0.1, starts=(0.3, 1.0)),),
        "turn(k) = command(k - strides), before the limit; parts of a stride mix its neighbours",
    ),
    # bounded so that slip is not a whole stride of delay (turn 1, twist 1), and gains nothing
    Effect(
        "foot_slip",
        "The feet slip: a part of each turn and step is lost, and the body's momentum turns it on over the "
        "slipping feet on which it lands.",
        "environment",
        (
            Parameter("turn", "1", 0.0, 0.0, 0.7, 0.05, starts=(0.2,)),
            Parameter("twist", "1", 0.0, 0.0, 0.6, 0.05, starts=(0.1,)),
            Parameter("step", "1", 0.0, 0.0, 0.9, 0.02, starts=(0.05,)),
        ),
        "turn = (1 - turn) * command(k) + twist * command(k - 1); stride * (1 - step)",
    ),
    Effect(
        "camera_yaw",
        "The camera is mounted askew and points to one side.",
        "sensor",
        (Parameter("angle", "rad", 0.0, -0.4, 0.4, 0.01),),
        "viewing direction = heading + angle (to the left)",
    ),
    Effect(
        "camera_pitch",
        "The camera is tilted more or less than calibrated, so that it looks nearer or farther ahead.",
        "sensor",
        (Parameter("angle", "rad", 0.0, -0.3, 0.4, 0.01),),
        "pitch = calibrated pitch + angle",
    ),
    Effect(
        "sensor_gain",
        "The line's place is reported too large or too small, in proportion.",
        "sensor",
        (Parameter("factor", "1", 1.0, 0.1, 5.0, 0.03),),
        "line = factor * true line, before it is rounded",
    ),
    Effect(
        "sensor_quantisation",
        "The line's place is reported in coarse steps (the servo signal's resolution).",
        "sensor",
        (Parameter("step", "m", 0.0, 0.0, 0.5, 0.01, starts=(0.02, 0.05, 0.1), smooth=False),),
        "line = step * round(line / step)",
    ),
    Effect(
        "actuator_saturation",
        "The steering motor gives way: turns above a limit are not carried out.",
        "actuator",
        (Parameter("turn", "rad", NO_LIMIT, 1e-4, NO_LIMIT, 0.01, starts=(0.03, 0.06, 0.1, 0.13)),),
        "|command| <= limit, after its delay, before slip, gain and bias",
    ),
)
"""What may be missing from the nominal walk."""

PLANT = row_type(base_parameters(Gait(), Camera()), EFFECTS)
"""Type of a plant: what walk and camera truly are, as kernels read it."""


def as_plants(vectors: ArrayLike) -> NDArray[Any]:
    """Parameter vectors of ``LineFollowing``, shape (..., numbers), as plants, shape (...)."""
    return as_rows(vectors, PLANT)


def nominal_plant(gait: Gait | None = None, camera: Camera | None = None) -> NDArray[Any]:
    """The plant of a gait and a camera with all effects off, shape ()."""
    return as_plants(neutral(base_parameters(gait or Gait(), camera or Camera()), EFFECTS))
