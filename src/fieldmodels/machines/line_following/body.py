"""The walking robot as rigid bodies seen from above (pymunk): feet that slip, a motor that gives way.

Three bodies: the outer legs, the inner legs, and the frame that carries camera and steering motor. The inner
legs turn against the frame, the outer ones do not (section 3.1.1). The legs stand in turn; a turn happens
while the inner legs stand.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import pymunk

from fieldmodels.arrays import FloatArray
from fieldmodels.machines.line_following.parameters import Gait
from fieldmodels.model import ModelError
from fieldmodels.settings import Setting

GRAVITY = 9.81
FRAME_RADIUS = 0.15
"""Radius of gyration of the frame [m] (assumed)."""


Friction = Annotated[
    float, Setting("Coefficient of friction between feet and floor (`pymunk`; assumed).", above=0)
]
MotorTorque = Annotated[
    float, Setting("Largest torque of the steering motor (`pymunk`; assumed).", "N m", above=0)
]


@dataclass(frozen=True)
class Hardware:
    """What the robot's bodies weigh and what its feet and motor can do.

    Attributes:
        frame_mass: Mass of frame, motors and batteries [kg] (assumed, as the others; Ranger weighs 9.9 kg).
        leg_mass: Mass of each pair of legs [kg].
        width: Half the distance between the feet of the outer pair [m].
        inner_width: Half the distance between the feet of the inner pair [m].
        damping: Friction of the steering joint [N m s/rad].
        rate: Steps of the physics a second [1/s].
        iterations: Iterations of the contact solver a step.
    """

    frame_mass: float = 6.0
    leg_mass: float = 2.0
    width: float = 0.20
    inner_width: float = 0.10
    friction: Friction = 0.8
    motor: MotorTorque = 10.0
    damping: float = 0.2
    rate: int = 120
    iterations: int = 20

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            ModelError: If one that must be positive is not.
        """
        for name, value in vars(self).items():
            if not value > 0:
                raise ModelError(f"hardware: {name} must be positive, not {value}")

    @property
    def weight(self) -> float:
        """Weight of the whole robot [N]."""
        return (self.frame_mass + 2.0 * self.leg_mass) * GRAVITY


class Body:
    """One robot, advanced stride by stride; a stride begins as the outer legs touch down.

    Attributes:
        gait: Step length, step time, largest turn.
        hardware: Masses, friction, motor.
        state: Place, angle, velocity and rate of frame, outer and inner legs, and the steering angle that was
            commanded last: all that the next stride depends on, shape (19,).
    """

    def __init__(self, gait: Gait | None = None, hardware: Hardware | None = None) -> None:
        self.gait = gait or Gait()
        self.hardware = hardware or Hardware()
        self.place(0.0, 0.0, 0.0)

    def place(self, x: float, y: float, heading: float) -> None:
        """Put the robot, at rest and straight, at a pose [m, m, rad]."""
        back = 0.5 * self.gait.step
        ahead_x, ahead_y = back * math.cos(heading), back * math.sin(heading)
        resting = [heading, 0.0, 0.0, 0.0]
        self.state = np.array(
            [
                *(x, y, *resting),
                *(x + ahead_x, y + ahead_y, *resting),
                *(x - ahead_x, y - ahead_y, *resting),
                0.0,
            ]
        )

    def stride(self, turn: float) -> None:
        """Take one stride: a step over the outer legs, then one over the inner legs that turns.

        Args:
            turn: Commanded turn [rad], left positive; not limited here.
        """
        # A space made anew for each stride keeps no hidden memory of the solver: the state is exact.
        self._build()
        outer, inner = self.hardware.width, self.hardware.inner_width
        # the inner legs swing forward and straighten, the body rolls over the outer feet
        self._step(self._outer, outer, self._outer_slide, self._inner_slide, float(self.state[-1]), 0.0)
        # the outer legs swing forward with the frame, which turns over the inner feet
        self._step(self._inner, inner, self._inner_slide, self._outer_slide, 0.0, turn)
        numbers = [
            number
            for body in (self._frame, self._outer, self._inner)
            for number in (*body.position, body.angle, *body.velocity, body.angular_velocity)
        ]
        self.state = np.array([*numbers, turn])

    @property
    def pose(self) -> tuple[float, float, float]:
        """Place [m] and heading [rad] of the frame."""
        return float(self.state[0]), float(self.state[1]), float(self.state[2])

    def _build(self) -> None:
        """Make the bodies and joints of the robot as they are now."""
        hardware, back = self.hardware, 0.5 * self.gait.step
        space = self._space = pymunk.Space()
        space.iterations = hardware.iterations
        self._frame = self._add(hardware.frame_mass, FRAME_RADIUS, self.state[0:6])
        self._outer = self._add(hardware.leg_mass, hardware.width, self.state[6:12])
        self._inner = self._add(hardware.leg_mass, hardware.inner_width, self.state[12:18])
        self._outer_slide = self._join(self._outer, -back)
        self._inner_slide = self._join(self._inner, back)
        straight = pymunk.GearJoint(self._outer, self._frame, 0.0, 1.0)
        straight.error_bias = 0.0
        self._steering = pymunk.GearJoint(self._inner, self._frame, float(self.state[-1]), 1.0)
        self._steering.error_bias = 0.0
        self._steering.max_force = hardware.motor
        rubbing = pymunk.DampedRotarySpring(self._inner, self._frame, 0.0, 0.0, hardware.damping)
        space.add(straight, self._steering, rubbing)

    def _add(self, mass: float, radius: float, state: FloatArray) -> pymunk.Body:
        body = pymunk.Body(mass, mass * radius * radius)
        x, y, body.angle, speed_x, speed_y, body.angular_velocity = (float(v) for v in state)
        body.position, body.velocity = (x, y), (speed_x, speed_y)
        self._space.add(body)
        return body

    def _join(self, legs: pymunk.Body, behind: float) -> pymunk.PivotJoint:
        """Hold the frame at a place in the legs' frame of reference; the legs' motor moves the place."""
        joint = pymunk.PivotJoint(legs, self._frame, (behind, 0.0), (0.0, 0.0))
        joint.error_bias = 0.0
        self._space.add(joint)
        return joint

    def _step(
        self, stance: pymunk.Body, width: float,
        standing: pymunk.PivotJoint, swinging: pymunk.PivotJoint, from_turn: float, to_turn: float,
    ) -> None:  # fmt: skip
        """One step: the stance feet hold the floor as far as friction lets them."""
        feet = []
        for side in (-width, width):
            foot = pymunk.PivotJoint(
                self._space.static_body, stance, stance.local_to_world((0.0, side)), (0.0, side)
            )
            foot.max_bias = 0.0  # what has slipped stays where it slipped to
            foot.max_force = self.hardware.friction * self.hardware.weight / 2.0
            feet.append(foot)
        stance.velocity, stance.angular_velocity = (0.0, 0.0), 0.0  # the foot lands at rest
        self._space.add(*feet)
        count = round(self.gait.step_time * self.hardware.rate)
        half = 0.5 * self.gait.step
        for k in range(1, count + 1):
            part = 0.5 - 0.5 * math.cos(math.pi * k / count)
            standing.anchor_a = (-half + 2.0 * half * part, 0.0)
            swinging.anchor_a = (half - 2.0 * half * part, 0.0)
            self._steering.phase = from_turn + (to_turn - from_turn) * part
            self._space.step(1.0 / self.hardware.rate)
        self._space.remove(*feet)
