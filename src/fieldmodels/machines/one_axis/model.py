"""The model that both benches share: an axis with effects, simulated by the compiled kernel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from fieldmodels.arrays import FloatArray
from fieldmodels.machines.one_axis import kernel
from fieldmodels.machines.one_axis.axis import Axis
from fieldmodels.machines.one_axis.effects import effect_library
from fieldmodels.machines.one_axis.scales import Scales, horizons_for, measure_scales
from fieldmodels.model import Model, Signal, Stage
from fieldmodels.recording import Recording, Windows

DRIVE = ("actuator", "change")
"""Where effects act between the command and the force."""
LATEST = 50  # steps by which a measured force is looked for behind its command
FAST = 2.0  # times the usual speed: faster than nearly all of a recording


class OneAxis(Model):
    """An axis with one input and a measured position, optionally also a measured velocity.

    Window states are the position and velocity *as the sensors show them*: the kernel inverts the
    sensors' gain, offset, drift, play and delay, so that a measured state stays a good start whatever
    the sensors do. What hysteresis remembers at a window's start comes from the measured position before
    it. The clock of drifts, periodic forces and jumps is sample number times step. Each
    command is held until the next; before a recording's (or episode's) first sample, the first.

    A recording may have both the command and the force that was measured (``force_measured``). Then each
    stage is predicted from what was measured before it: the force from the command, the motion from the
    measured force. So a fault of the drive does not hide one of the axis, nor the other way round.

    Attributes:
        slots: Kernel slot of each base parameter and each effect's parameter, by full name; payload
            has none, it adds to the base.
        axis: Linear (spring) or rotary (gravity).
        nominal_scales: Scales of the nominal bench.
        scales: Scales of this bench.
        substeps: Least number of integration steps within a sampling interval.
    """

    slots: ClassVar[Mapping[str, int]]
    axis: ClassVar[Axis]
    nominal_scales: ClassVar[Scales]
    substeps: int = 1

    def __init__(self, scales: Scales | None = None, driven_by_measured: bool = False) -> None:
        """Declare parameters, effects and outputs for a bench.

        Args:
            scales: Scales of the bench; by default the nominal ones.
            driven_by_measured: True to predict the motion from the measured force.
        """
        self.scales = scales or self.nominal_scales
        self.command = self.inputs[0].name
        self.measured_inputs = (measured_counterpart(self.inputs[0]),)
        self.driven_by_measured = driven_by_measured
        if driven_by_measured:
            self.inputs = self.measured_inputs
            self.inputs_are_free = False
        self.effects = effect_library(self.axis, self.scales)
        if scales is not None:
            self.parameters = tuple(
                replace(p, starts=(value,), scale=0.1 * value)
                for p, value in zip(self.parameters, scales.base, strict=True)
            )
            self.horizons = horizons_for(self.horizons, scales, self.nominal_scales)
            noise = (scales.position_noise, scales.velocity_noise)
            self.outputs = tuple(replace(s, noise=n) for s, n in zip(self.outputs, noise, strict=True))

    def scaled_to(self, recordings: Sequence[Recording]) -> Self:
        """Suit scales, starts and sensor noise to the data; see ``Model.scaled_to``."""
        position, velocity = (signal.name for signal in self.outputs)
        return type(self)(
            measure_scales(
                recordings, self.inputs[0].name, position, velocity, self.axis, self.nominal_scales
            ),
            self.driven_by_measured,
        )

    def stages(self, recordings: Sequence[Recording]) -> tuple[Stage, ...]:
        """Measured force to motion and command to measured force, where it is measured; else the whole."""
        from fieldmodels.machines.one_axis.drive import Drive

        names = [self.command, *(s.name for s in self.measured_inputs)]
        if self.driven_by_measured or len(names) < 2 or not all(n in r for r in recordings for n in names):
            return super().stages(recordings)
        drive = tuple(e.name for e in self.effects if e.where in DRIVE)
        motion = tuple(e.name for e in self.effects if e.where not in DRIVE)
        return Stage(type(self)(self.scales, True), motion), Stage(Drive(self), drive)

    def simulate(self, parameters: FloatArray, windows: Windows) -> FloatArray:
        """Simulate every window; see ``Model.simulate``."""
        recording = windows.recording
        first, last = episode_edges(recording)
        command = self.applied(recording, last)
        parameters = np.atleast_2d(parameters)
        rows = self.rows(parameters)
        bent = bool(rows[:, kernel.BRISTLE].any())
        out = np.full((len(parameters), len(windows), windows.samples, 2), np.nan)
        kernel.simulate(
            rows,
            command,
            np.zeros(0) if windows.disturbance is None else np.ascontiguousarray(windows.disturbance),
            first,
            last,
            recording.step,
            0.02 * float(np.max(np.abs(command), initial=0.0)) or 1.0,
            self.outputs[1].name in recording,
            windows.starts,
            windows.lengths,
            np.ascontiguousarray(windows.states),
            _without_noise(recording, self.outputs[0].name) if bent else np.zeros(0),
            FAST * self.scales.velocity,
            self.substeps,
            out,
        )
        return out

    def applied(self, recording: Recording, last: NDArray[np.int64]) -> FloatArray:
        """What is held over each step: the command, or what was measured of it, shape (n,)."""
        held = recording[self.inputs[0].name]
        if self.driven_by_measured and self.command in recording:  # a planned one has the force alone
            held = between(recording[self.command], held, last)
        return np.ascontiguousarray(held, dtype=np.float64)

    def rows(self, parameters: FloatArray) -> FloatArray:
        """Kernel rows of parameter vectors, shape (batch, kernel.SLOTS)."""
        rows = np.tile(kernel.neutral(), (len(parameters), 1))
        for name, slot in self.slots.items():
            rows[:, slot] = parameters[:, self.index(name)]
        return rows

    def initial_states(self, recording: Recording, starts: NDArray[np.int64]) -> FloatArray:
        """Fit a parabola to the nine samples around each start; see ``Model.initial_states``.

        A measured velocity is smoothed in the same way; otherwise it is the parabola's slope.
        """
        first, last = episode_edges(recording)
        offsets = np.arange(-4, 5)
        rows = starts[:, None] + offsets
        inside = (rows >= first[starts][:, None]) & (rows <= last[starts][:, None])
        rows = np.where(inside, rows, starts[:, None])
        # Least squares with weight zero beyond an episode's ends.
        powers = inside[:, :, None] * np.vander(offsets, 3, increasing=True)
        solver = np.linalg.pinv(powers)
        position, velocity = (signal.name for signal in self.outputs)
        parabola = np.einsum("wik,wk->wi", solver, recording[position][rows])
        states = np.column_stack([parabola[:, 0], parabola[:, 1] / recording.step])
        if velocity in recording:
            states[:, 1] = np.einsum("wk,wk->w", solver[:, 0], recording[velocity][rows])
        return states


def episode_edges(recording: Recording) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First and last sample of the episode that each sample belongs to."""
    counts = np.diff(recording.bounds, axis=1)[:, 0]
    return np.repeat(recording.bounds[:, 0], counts), np.repeat(recording.bounds[:, 1] - 1, counts)


def _without_noise(recording: Recording, name: str) -> FloatArray:
    """A signal smoothed by a parabola through nine samples, episode by episode, shape (n,)."""
    parts = [recording[name][a:b] for a, b in recording.bounds]
    smooth = [savgol_filter(part, 9, 2) if len(part) >= 9 else part for part in parts]
    return np.ascontiguousarray(np.concatenate(smooth), dtype=np.float64)


def between(command: FloatArray, measured: FloatArray, last: NDArray[np.int64]) -> FloatArray:
    """Mean over each step of a force that is measured at its start, right after the command.

    What jumps as the command does, at once or some steps late, holds over the step; what follows slowly is
    halfway to the next sample. How much jumps, the samples tell: the share of the command's jumps that the
    force shows in one row, in that row of the next ``LATEST`` in which it shows most.

    Args:
        command: Commanded force, shape (n,).
        measured: Measured force, shape (n,).
        last: Last sample of each sample's episode, shape (n,).

    Returns:
        Force to hold over each step, shape (n,).
    """
    rows = np.arange(len(command))
    after = np.minimum(rows + 1, last)
    told, seen = command[after] - command, measured[after] - measured
    jumps, shown = np.diff(told), np.diff(seen)  # small where both move smoothly
    power = float(jumps @ jumps)
    if power == 0.0:
        return measured
    count = len(jumps)
    shares = [float(jumps[: count - k] @ shown[k:]) / power for k in range(min(LATEST, count))]
    late = int(np.argmax(shares))
    share = min(max(shares[late], 0.0), 1.0)
    return np.asarray(measured + 0.5 * (seen - share * np.r_[np.zeros(late), told[: len(told) - late]]))


def measured_counterpart(signal: Signal) -> Signal:
    """The measured counterpart of a command: ``force_measured`` beside ``force``."""
    return replace(signal, name=f"{signal.name}_measured", optional=True)
