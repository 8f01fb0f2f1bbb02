"""The walking robot as rigid bodies seen from above (pymunk): feet that slip, a motor that gives way.

Three bodies: the outer legs, the inner legs, and the frame that carries camera and steering motor. The inner
legs turn against the frame, the outer ones do not (section 3.1.1). The legs stand in turn; a turn happens
while the inner legs stand.

Momentum is carried from step to step. On a dry floor the centre of mass moves over the standing feet as that
of an inverted pendulum, x'' = g x / height: it slows towards mid-stance, speeds up after it, and enters the
next step at the speed with which it left the last. So straight walking needs a friction of half a step over
the height, 0.175; a turn needs more, because the feet that land turn the momentum into the new direction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.extras import needed
from fieldmodels.machines.line_following.parameters import Gait
from fieldmodels.model import ModelError
from fieldmodels.settings import Setting

if TYPE_CHECKING:
    import pymunk

GRAVITY = 9.81
FRAME_RADIUS = 0.20
"""Radius of gyration of the frame about the vertical [m] (assumed)."""

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
        frame_mass: Mass that moves with the hip: frame, motors, batteries, the legs' upper halves [kg]
            (assumed, as the others; Ranger weighs 9.9 kg).
        leg_mass: Mass of each pair of legs that moves with the feet [kg].
        height: Height of the centre of mass, the inverted pendulum's length [m].
        width: Half the distance between the feet of the outer pair [m].
        inner_width: Half the distance between the feet of the inner pair, just inside the outer ones [m].
        damping: Friction of the steering joint [N m s/rad].
        rate: Steps of the physics a second [1/s].
        iterations: Iterations of the contact solver a step.
    """

    frame_mass: float = 8.0
    leg_mass: float = 1.0
    height: float = 1.0
    width: float = 0.20
    inner_width: float = 0.15
    friction: Friction = 0.8
    motor: MotorTorque = 10.0
    damping: float = 1.0
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
    def mass(self) -> float:
        """Mass of the whole robot [kg]."""
        return self.frame_mass + 2.0 * self.leg_mass


class Body:
    """One robot, advanced stride by stride; a stride begins as the outer legs touch down.

    Attributes:
        gait: Step length, step time, largest turn.
        hardware: Masses, friction, motor.
        state: Place, angle, velocity and rate of frame, outer and inner legs: all that the next stride
            depends on, shape (18,).
    """

    def __init__(self, gait: Gait | None = None, hardware: Hardware | None = None) -> None:
        self.gait = gait or Gait()
        self.hardware = hardware or Hardware()
        self._paths = self._plan()
        self.place(0.0, 0.0, 0.0)

    def place(self, x: float, y: float, heading: float) -> None:
        """Put the robot, walking and straight, at a pose [m, m, rad]; all feet are on the floor."""
        back, rate = 0.5 * self.gait.step, math.sqrt(GRAVITY / self.hardware.height)
        along = np.array([math.cos(heading), math.sin(heading)])
        # at this speed the inverted pendulum goes from one step into the next; feet on the floor have none
        pendulum = back * rate / math.tanh(0.5 * rate * self.gait.step_time)
        speed = self.hardware.mass / self.hardware.frame_mass * pendulum * along
        # Chipmunk moves its bodies first and solves for their speeds then: the frame is one interval behind
        behind = float(np.linalg.norm(speed)) / self.hardware.rate
        bodies = ((0.0, speed), (behind + back, 0.0 * along), (behind - back, 0.0 * along))
        rows = [[*((x, y) + ahead * along), heading, *velocity, 0.0] for ahead, velocity in bodies]
        self.state = np.ravel(rows)

    def stride(self, turn: float) -> None:
        """Take one stride: a step over the outer legs, then one over the inner legs that turns.

        Args:
            turn: Commanded turn [rad], left positive; not limited here.
        """
        # A space made anew for each stride keeps no hidden memory of the solver: the state is exact.
        self._build()
        outer, inner = self.hardware.width, self.hardware.inner_width
        # the inner legs swing forward and straighten, the body rolls over the outer feet
        self._step(self._outer, outer, self._outer_slide, self._inner_slide, 0.0)
        # the outer legs swing forward with the frame, which turns over the inner feet
        self._step(self._inner, inner, self._inner_slide, self._outer_slide, turn)
        self.state = np.array(
            [
                number
                for body in (self._frame, self._outer, self._inner)
                for number in (*body.position, body.angle, *body.velocity, body.angular_velocity)
            ]
        )

    @property
    def pose(self) -> tuple[float, float, float]:
        """Place [m] and heading [rad] of the frame."""
        return float(self.state[0]), float(self.state[1]), float(self.state[2])

    def _build(self) -> None:
        """Make the bodies and joints of the robot as they are now."""
        pymunk = needed("pymunk")
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
        self._steering = pymunk.GearJoint(self._inner, self._frame, 0.0, 1.0)
        self._steering.error_bias = 0.0
        self._steering.max_force = hardware.motor
        rubbing = pymunk.DampedRotarySpring(self._inner, self._frame, 0.0, 0.0, hardware.damping)
        space.add(straight, self._steering, rubbing)

    def _add(self, mass: float, radius: float, state: FloatArray) -> pymunk.Body:
        body: pymunk.Body = needed("pymunk").Body(mass, mass * radius * radius)
        x, y, body.angle, speed_x, speed_y, body.angular_velocity = (float(v) for v in state)
        body.position, body.velocity = (x, y), (speed_x, speed_y)
        self._space.add(body)
        return body

    def _join(self, legs: pymunk.Body, behind: float) -> pymunk.PivotJoint:
        """Hold the frame at a place in the legs' frame of reference; the legs' motor moves the place."""
        joint: pymunk.PivotJoint = needed("pymunk").PivotJoint(legs, self._frame, (behind, 0.0), (0.0, 0.0))
        joint.error_bias = 0.0
        self._space.add(joint)
        return joint

    def _step(
        self, stance: pymunk.Body, width: float,
        standing: pymunk.PivotJoint, swinging: pymunk.PivotJoint, to_turn: float,
    ) -> None:  # fmt: skip
        """One step: the stance feet hold the floor as far as friction lets them; the steering turns."""
        hinge, feet = needed("pymunk").PivotJoint, []
        for side in (-width, width):
            foot = hinge(self._space.static_body, stance, stance.local_to_world((0.0, side)), (0.0, side))
            foot.max_bias = 0.0  # what has slipped stays where it slipped to
            foot.max_force = self.hardware.friction * self.hardware.mass * GRAVITY / 2.0
            feet.append(foot)
        self._space.add(*feet)
        from_turn = self._frame.angle - self._inner.angle
        for frame, swing, part in self._paths:
            standing.anchor_a, swinging.anchor_a = (frame, 0.0), (frame - swing, 0.0)
            self._steering.phase = from_turn + (to_turn - from_turn) * part
            self._space.step(1.0 / self.hardware.rate)
        self._space.remove(*feet)

    def _plan(self) -> list[tuple[float, float, float]]:
        """A step on a dry floor, moment by moment.

        Returns:
            Place of the frame and of the swinging feet ahead of the standing feet [m], and the part of the
            turn that is done. The feet leave the floor and land without speed; the frame goes where it brings
            the centre of mass to the inverted pendulum's.
        """
        hardware, half, time = self.hardware, 0.5 * self.gait.step, self.gait.step_time
        rate, count = math.sqrt(GRAVITY / hardware.height), round(time * hardware.rate)
        moments = time * np.arange(1, count + 1) / count
        part = 0.5 - 0.5 * np.cos(math.pi * moments / time)
        centre = half * np.sinh(rate * (moments - 0.5 * time)) / math.sinh(0.5 * rate * time)
        swing = 2.0 * half * (2.0 * part - 1.0)
        frame = (hardware.mass * centre - hardware.leg_mass * swing) / hardware.frame_mass
        return list(zip(frame.tolist(), swing.tolist(), part.tolist(), strict=True))
