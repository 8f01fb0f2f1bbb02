"""The pose-reaching model: a differential drive, given its motion or its wheels' speeds, watched by its pose.

If a recording has measured wheel speeds, each stage is predicted from what was measured before it: the
wheels from the command, the pose from the measured wheels. So a fault of the drive shows in the wheels, slip
shows in the pose, and neither hides the other. Without them the pose is predicted from the command.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import replace
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.declared import as_rows
from fieldmodels.machines.pose_reaching.declaration import (
    AFTER_THE_WHEELS,
    ROW,
    Scales,
    base_parameters,
    drive_effects,
)
from fieldmodels.machines.pose_reaching.parameters import ROBOCUP, Wheels
from fieldmodels.machines.pose_reaching.simulation import Log, simulate
from fieldmodels.model import ForceDirection, Model, Signal, Stage
from fieldmodels.recording import Recording, RecordingError, Windows

IntArray = NDArray[np.int64]

POSE, WHEELS = ("x", "y", "heading"), ("left_wheel", "right_wheel")
MOVING = 3.0
"""Times their noise: wheels that turn by less explain no motion (a gain would be too small by a ninth)."""
OF_THE_DRIVE = " of the drive"
"""After the name of a direction in which the wheels are moved, and the body by them."""
DRIVEN_BY_WHEELS = "driven by measured wheels"
"""Signal that ``windows`` adds where the pose is to be predicted from the measured wheels."""


def _moving(speed: FloatArray, noise: float) -> bool:
    """Whether a measured speed shows much more than its noise: that stated, or the white noise in it."""
    known = speed[np.isfinite(speed)]
    white = float(np.std(np.diff(known, 2))) / np.sqrt(6.0)
    return bool(np.sqrt(np.mean(known**2)) > MOVING * max(noise, white))


class PoseReaching(Model):
    """The unicycle of section 5.1.4 as a differential drive, commanded by speed and turn rate.

    Recordings hold ``speed`` [m/s] and ``turn_rate`` [rad/s] as commanded, held from sample to sample;
    the pose ``x`` [m], ``y`` [m], ``heading`` [rad] (wrapped or not); and perhaps both wheels' speeds
    ``left_wheel``, ``right_wheel`` [rad/s], each the mean since the sample before, as encoders count. A
    recording needs the pose, the wheels, or both. The wheels' radius and track are known, not refitted.

    Before a recording's (or episode's) first sample the wheels ran as first measured, or as first
    commanded. A window's state is the pose as measured.
    """

    name = "pose_reaching"
    inputs = (Signal("speed", "m/s"), Signal("turn_rate", "rad/s"))
    outputs = (
        Signal("x", "m", noise=0.003, optional=True),
        Signal("y", "m", noise=0.003, optional=True),
        Signal("heading", "rad", noise=0.01, optional=True, angle=True),
        Signal("left_wheel", "rad/s", noise=0.1, optional=True, averaged=True),
        Signal("right_wheel", "rad/s", noise=0.1, optional=True, averaged=True),
    )
    states = (
        Signal("x", "m", noise=0.01),
        Signal("y", "m", noise=0.01),
        Signal("heading", "rad", noise=0.01, angle=True),
    )
    horizons = (0.5, 2.0, 4.0)
    disturbance_unit = "rad/s"
    unbounded_outputs = POSE
    wrapped_outputs = ("heading",)
    wheel_front: ClassVar[bool] = False

    def __init__(
        self,
        wheels: Wheels = ROBOCUP,
        scales: Scales | None = None,
        compared: tuple[str, ...] = POSE + WHEELS,
    ) -> None:
        """Declare parameters and effects for a robot with these wheels, at these scales.

        Args:
            wheels: The robot's nominal wheels.
            scales: Typical sizes of its record.
            compared: Outputs that windows compare with measured ones.
        """
        self.parameters = base_parameters(wheels)
        self.effects = drive_effects(scales or Scales())
        self.wheels = wheels
        self.compared = compared
        self.noisy_inputs = compared == POSE  # it is driven by the measured wheels
        self._measured_as(wheels.radius, wheels.track)

    def scaled_to(self, recordings: Sequence[Recording]) -> Self:
        """The same model with speeds and times that suit the data; see ``Model.scaled_to``."""
        track = next((r.known["track"] for r in recordings if "track" in r.known), self.wheels.track)
        radius = next(
            (r.known["wheel_radius"] for r in recordings if "wheel_radius" in r.known), self.wheels.radius
        )
        commands = np.concatenate([self._commands(r) for r in recordings])
        if self.wheel_front:
            sides = radius * commands
        else:
            half = 0.5 * track * commands[:, 1]
            sides = np.column_stack([commands[:, 0] - half, commands[:, 0] + half])
        speeds = np.quantile(np.abs(sides), [0.995, 0.97, 0.9, 0.7])
        rate = float(np.max(np.abs(np.diff(sides, axis=0)), initial=0.0)) / recordings[0].step
        nominal = Scales()
        scaled = type(self)(
            self.wheels,
            Scales(
                speeds=tuple(speeds.tolist()) if (speeds > 0).all() else nominal.speeds,
                rate=rate or nominal.rate,
                duration=max(float(np.ptp(r.time)) for r in recordings),
                step=recordings[0].step,
            ),
            self.compared,
        )
        scaled._measured_as(radius, track)
        return scaled

    def sized(self, base: Mapping[str, object]) -> Self:
        """The robot with directions and sums of the wheels that a reality states; see ``Model.sized``."""
        result = copy(self)
        stated = base.get("wheel_radius"), base.get("track")
        nominal = self.wheels.radius, self.wheels.track
        result._measured_as(
            *(s if isinstance(s, int | float) else n for s, n in zip(stated, nominal, strict=True))
        )
        return result

    def _measured_as(self, radius: float, track: float) -> None:
        """Declare the directions of motion, and how fast a robot goes that way by itself."""
        rates = ("left rim", "right rim")
        if self.wheel_front:
            speeds = (0.5 * radius, 0.5 * radius), (-radius / track, radius / track)
            self.sums = (
                ForceDirection("speed", "m/s", speeds[0]), ForceDirection("turn rate", "rad/s", speeds[1]),
            )  # fmt: skip
            names = "speed", "turn rate", *(signal.name for signal in self.inputs)
        else:
            self.sums = tuple(
                ForceDirection(n, "m/s", (1.0, sign * 0.5 * track))
                for n, sign in zip(rates, (-1.0, 1.0), strict=True)
            )
            names = *(signal.name for signal in self.inputs), *rates
        on_the_ground = (
            ForceDirection("turn rate", "rad/s", (1.0, 0.0, 0.0, 0.0, 0.0), names[1]),
            ForceDirection("forward speed", "m/s", (0.0, 1.0, 0.0, 0.0, 0.0), names[0]),
            ForceDirection("sideways speed", "m/s", (0.0, 0.0, 1.0, 0.0, 0.0)),
            ForceDirection("ground's speed along x", "m/s", (0.0, 0.0, 0.0, 1.0, 0.0)),
            ForceDirection("ground's speed along y", "m/s", (0.0, 0.0, 0.0, 0.0, 1.0)),
            ForceDirection("left wheel", "m/s", (-1.0 / track, 0.5, 0.0, 0.0, 0.0), names[2]),
            ForceDirection("right wheel", "m/s", (1.0 / track, 0.5, 0.0, 0.0, 0.0), names[3]),
        )
        self.directions = tuple(replace(c, weights=(*c.weights, 0.0, 0.0)) for c in on_the_ground)
        of_the_drive = [
            replace(c, name=c.name + OF_THE_DRIVE) for c in on_the_ground if not any(c.weights[2:])
        ]
        if self.compared == WHEELS:
            self.directions = tuple(replace(c, weights=(*c.weights, 0.0, 0.0)) for c in of_the_drive)
        self.staged = tuple(replace(c, weights=(0.0,) * 5 + c.weights[:2]) for c in of_the_drive)

    def stages(self, recordings: Sequence[Recording]) -> tuple[Stage, ...]:
        """Wheels to pose, and command to wheels, where both are measured; else the whole."""
        names = tuple(effect.name for effect in self.effects)
        before = tuple(name for name in names if name not in AFTER_THE_WHEELS)
        pose, wheels = (all(n in r for r in recordings for n in group) for group in (POSE, WHEELS))
        motion, drive = (type(self)(self.wheels, compared=group) for group in (POSE, WHEELS))
        if wheels and not pose:
            return (Stage(drive, before),)
        if not wheels or self.compared != POSE + WHEELS:
            return (Stage(self, names),)
        left, right = (np.concatenate([r[name] for r in recordings]) for name in WHEELS)
        noise = self.outputs[len(POSE)].noise
        # What reduces the wheels' noise, such as a slip, would be taken for a cause.
        if not _moving(left, noise) and not _moving(right, noise):
            return (Stage(drive, before),)
        turning = _moving(right - left, noise * np.sqrt(2.0))
        after = tuple(name for name in AFTER_THE_WHEELS if turning or name != "yaw_slip")
        return Stage(motion, after), Stage(drive, before)

    def simulate(self, parameters: FloatArray, windows: Windows) -> FloatArray:
        """See ``Model.simulate``; headings are continuous within a window."""
        recording = windows.recording
        rows = as_rows(np.atleast_2d(parameters), ROW)
        counts = np.diff(recording.bounds, axis=1)[:, 0]
        has_wheels = all(name in recording for name in WHEELS)
        pushed = windows.pushed(7)
        body, drive = pushed[:, :5], pushed[:, 5:]
        if self.compared == WHEELS:  # what is sought in this stage comes first
            drive = pushed[:, :2]
        elif DRIVEN_BY_WHEELS not in recording:
            body = np.column_stack([body[:, :2] + drive, body[:, 2:]])
        out = np.full((len(rows), len(windows), windows.samples, len(self.outputs)), np.nan)
        log = Log(
            commands=self._commands(recording),
            wheel_front=self.wheel_front,
            wheels=np.column_stack([recording[n] for n in WHEELS]) if has_wheels else np.zeros((0, 2)),
            first=np.repeat(recording.bounds[:, 0], counts),
            last=np.repeat(recording.bounds[:, 1] - 1, counts),
            time=np.ascontiguousarray(recording.time),
            step=recording.step,
            disturbance=np.ascontiguousarray(body),
            drive=np.ascontiguousarray(drive),
        )
        simulate(
            rows,
            log,
            windows.starts,
            windows.lengths,
            np.ascontiguousarray(windows.states),
            DRIVEN_BY_WHEELS in recording,
            POSE[0] in self.compared,
            WHEELS[0] in self.compared,
            out,
        )
        return out

    def initial_states(self, recording: Recording, starts: IntArray) -> FloatArray:
        """The pose as measured; zero where none is measured."""
        if POSE[0] not in recording:
            return np.zeros((len(starts), 3))
        return np.column_stack([recording[name][starts] for name in POSE])

    def windows(self, recording: Recording, horizon: float) -> Windows:
        """Cut every episode into windows of one length: a horizon of 2 s is 40 samples at 20 Hz.

        Headings are made continuous within each window.

        Raises:
            RecordingError: If neither pose nor wheels are complete, or no episode is long enough.
        """
        for names in (POSE, WHEELS):
            have = [name for name in names if name in recording]
            if 0 < len(have) < len(names):
                missing = ", ".join(name for name in names if name not in have)
                raise RecordingError(
                    f"{recording.source}: has {', '.join(have)} but not {missing}; declare or drop the others"
                )
        if POSE[0] not in recording and WHEELS[0] not in recording:
            raise RecordingError(
                f"{recording.source}: no output to compare with; the pose ({', '.join(POSE)}) or the wheels' "
                f"speeds ({', '.join(WHEELS)}) are needed"
            )
        length = round(horizon / recording.step)
        starts = np.concatenate([np.arange(a, b - length + 1, length) for a, b in recording.bounds])
        if length < 4 or len(starts) == 0:
            raise RecordingError(
                f"{recording.source}: too short or too coarse for windows of {horizon:g} s "
                f"({len(recording)} samples, {recording.step:g} s apart); record longer or sample faster"
            )
        starts = starts.astype(np.int64)
        signals = dict(recording.signals)
        if POSE[2] in recording:
            rows = starts[:, None] + np.arange(length)
            heading = signals[POSE[2]].copy()
            heading[rows] = np.unwrap(heading[rows], axis=1)
            signals[POSE[2]] = heading
            if WHEELS[0] in recording:
                signals[DRIVEN_BY_WHEELS] = np.ones(len(recording))
        ready = replace(recording, signals=signals)
        observed = np.zeros((len(starts), length, len(self.outputs)), dtype=np.bool_)
        for j, output in enumerate(self.outputs):
            observed[:, :, j] = output.name in recording and output.name in self.compared
        return Windows(
            recording=ready,
            starts=starts,
            lengths=np.full(len(starts), length, dtype=np.int64),
            states=self.initial_states(ready, starts),
            observed=observed,
        )

    def _commands(self, recording: Recording) -> FloatArray:
        """Both commands, shape (n, 2)."""
        return np.column_stack([recording[signal.name] for signal in self.inputs]).astype(np.float64)
