"""The line-following model: commanded turns in, the line's place in the camera out, stride by stride."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.machines.line_following.declaration import EFFECTS, as_plants, base_parameters
from fieldmodels.machines.line_following.observer import observer_gain
from fieldmodels.machines.line_following.parameters import Camera, Gait
from fieldmodels.machines.line_following.sensor import make_optics
from fieldmodels.machines.line_following.simulation import OFFSET, Log, simulate
from fieldmodels.model import ForceDirection, Model, Signal
from fieldmodels.recording import Recording, Windows

IntArray = NDArray[np.int64]

UNTRACKED = 0.3
"""Standard deviation of a start that is inferred from the line's places [m, rad]."""
FITTED = 4
"""Strides from which a window's start is taken where the robot's place is not measured."""


class LineFollowing(Model):
    """The walk of chapter 3 relative to its line, one sample a stride.

    Recordings hold, at each touchdown of the outer legs, the commanded turn ``steering`` [rad] of the stride
    that begins, the ``curvature`` [1/m] of the line where the robot is (left positive; 0 on a straight), and
    the ``line``'s place in the camera [m]. Where the robot's place is tracked from outside, also its
    ``offset`` from the line [m] and its ``heading`` against it [rad], both left positive: a camera alone
    cannot distinguish its own yaw from the robot's place.
    """

    name = "line_following"
    inputs_are_free = False
    inputs = (Signal("steering", "rad", angle=True), Signal("curvature", "1/m"))
    outputs = (
        Signal("line", "m", noise=0.02),
        Signal("offset", "m", noise=0.005, optional=True),
        Signal("heading", "rad", noise=0.01, optional=True, angle=True),
    )
    states: tuple[Signal, ...] = (
        Signal("offset", "m", noise=0.01),
        Signal("heading", "rad", noise=0.01, angle=True),
    )
    effects = EFFECTS
    disturbance_unit = "rad"
    directions = (
        ForceDirection("turn", "rad", (1.0, 0.0, 0.0), "steering"),
        ForceDirection("length of a stride", "m", (0.0, 1.0, 0.0)),
        ForceDirection("sideways way of a stride", "m", (0.0, 0.0, 1.0)),
    )
    random_force = True

    def __init__(
        self,
        gait: Gait | None = None,
        camera: Camera | None = None,
        tracked: bool = True,
        gain: FloatArray | None = None,
    ) -> None:
        """Declare the parameters for a robot with this gait and camera.

        Args:
            gait: The gait.
            camera: The camera.
            tracked: Whether recordings hold offset and heading; if not, windows start from less certain
                states.
            gain: Of an observer, shape (2, 3), that predicts each stride from all before; without one a
                window is predicted from where it starts, as measured there.
        """
        if not tracked:
            self.states = tuple(replace(state, noise=UNTRACKED) for state in self.states)
        self.gait, self.camera, self.tracked = gait or Gait(), camera or Camera(), tracked
        self.parameters = base_parameters(self.gait, self.camera)
        self.horizons = tuple(self.gait.stride_time * strides for strides in (3, 7, 15))
        self._optics = make_optics(self.camera)
        self.corrected = gain is not None
        self._gain = np.zeros((0, 3)) if gain is None else gain

    def scaled_to(self, recordings: Sequence[Recording]) -> Self:
        """The same model for data in which the robot's place is measured or not; see ``Model.scaled_to``."""
        outputs = [signal.name for signal in self.outputs]
        tracked = all(name in one for one in recordings for name in outputs[OFFSET:])
        gain = observer_gain(recordings, outputs) if tracked else None
        return type(self)(self.gait, self.camera, tracked, gain)

    def running_free(self) -> Self:
        """The same model without an observer; see ``Model.running_free``."""
        return type(self)(self.gait, self.camera, self.tracked)

    def simulate(self, parameters: FloatArray, windows: Windows) -> FloatArray:
        """See ``Model.simulate``."""
        recording = windows.recording
        plants = as_plants(np.atleast_2d(parameters))
        counts = np.diff(recording.bounds, axis=1)[:, 0]
        out = np.full((len(plants), len(windows), windows.samples, len(self.outputs)), np.nan)
        log = Log(
            steering=np.ascontiguousarray(recording["steering"], dtype=np.float64),
            curvature=np.ascontiguousarray(recording["curvature"], dtype=np.float64),
            first=np.repeat(recording.bounds[:, 0], counts),
            last=np.repeat(recording.bounds[:, 1] - 1, counts),
            force=windows.pushed(3),
            shown=np.column_stack([recording[s.name] for s in self.outputs])
            if len(self._gain)
            else np.zeros((0, 3)),
        )
        simulate(
            plants,
            log,
            windows.starts,
            windows.lengths,
            np.ascontiguousarray(windows.states),
            self._optics,
            self.gait.limit,
            self._gain,
            out,
        )
        return out

    def initial_states(self, recording: Recording, starts: IntArray) -> FloatArray:
        """Offset and heading as measured, or those with which the nominal walk fits the first places."""
        if "offset" in recording and "heading" in recording:
            return np.column_stack([recording["offset"][starts], recording["heading"][starts]])
        lengths = np.full(len(starts), FITTED, dtype=np.int64)
        ends = recording.bounds[np.searchsorted(recording.bounds[:, 0], starts, side="right") - 1, 1]
        lengths = np.minimum(lengths, ends - starts)
        observed = np.arange(FITTED)[None, :, None] < lengths[:, None, None]
        observed = np.repeat(observed, len(self.outputs), axis=2)
        zero = Windows(recording, starts, lengths, np.zeros((len(starts), 2)), observed)
        base = self.simulate(self.nominal, zero)[0, :, :, 0]
        small = 1e-3
        slopes = [
            (self.simulate(self.nominal, zero.with_states(zero.states + small * axis))[0, :, :, 0] - base)
            / small
            for axis in np.eye(2)
        ]
        line, found = recording["line"], np.zeros((len(starts), 2))
        for w, count in enumerate(lengths):
            sensitivities = np.column_stack([slope[w, :count] for slope in slopes])
            found[w] = np.linalg.lstsq(
                sensitivities, line[starts[w] : starts[w] + count] - base[w, :count], rcond=None
            )[0]
        return found
