"""The model that both benches share: an axis with effects, simulated by the compiled kernel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from fieldmodels.model import FloatArray, Model
from fieldmodels.one_axis import kernel
from fieldmodels.one_axis.axis import Axis
from fieldmodels.one_axis.effects import effect_library
from fieldmodels.one_axis.scales import Scales, measure_scales
from fieldmodels.recording import Recording, Windows

FAST = 2.0  # times the usual speed: faster than nearly all of a recording


class OneAxis(Model):
    """An axis with one input and a measured position, optionally also a measured velocity.

    Window states are the position and velocity *as the sensors show them*: the kernel inverts the
    sensors' gain, offset, drift, play and delay, so that a measured state stays a good start whatever
    the sensors do. What hysteresis remembers at a window's start comes from the measured position before
    it. The clock of drifts, periodic forces and jumps is sample number times step. Each
    command is held until the next; before a recording's (or episode's) first sample, the first.

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

    def __init__(self, scales: Scales | None = None) -> None:
        """Declare parameters, effects and outputs for a bench of these scales (default: nominal)."""
        self.scales = scales or self.nominal_scales
        self.effects = effect_library(self.axis, self.scales)
        if scales is not None:
            self.parameters = tuple(
                replace(p, starts=(value,), scale=0.1 * value)
                for p, value in zip(self.parameters, scales.base, strict=True)
            )
            noise = (scales.position_noise, scales.velocity_noise)
            self.outputs = tuple(replace(s, noise=n) for s, n in zip(self.outputs, noise, strict=True))

    def scaled_to(self, recordings: Sequence[Recording]) -> Self:
        """Suit scales, starts and sensor noise to the data; see ``Model.scaled_to``."""
        position, velocity = (signal.name for signal in self.outputs)
        return type(self)(
            measure_scales(
                recordings, self.inputs[0].name, position, velocity, self.axis, self.nominal_scales
            )
        )

    def simulate(self, parameters: FloatArray, windows: Windows) -> FloatArray:
        """Simulate every window; see ``Model.simulate``."""
        recording = windows.recording
        command = np.ascontiguousarray(recording[self.inputs[0].name], dtype=np.float64)
        first, last = _episode_edges(recording)
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
        first, last = _episode_edges(recording)
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


def _episode_edges(recording: Recording) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First and last sample of the episode that each sample belongs to."""
    counts = np.diff(recording.bounds, axis=1)[:, 0]
    return np.repeat(recording.bounds[:, 0], counts), np.repeat(recording.bounds[:, 1] - 1, counts)


def _without_noise(recording: Recording, name: str) -> FloatArray:
    """A signal smoothed by a parabola through nine samples, episode by episode, shape (n,)."""
    parts = [recording[name][a:b] for a, b in recording.bounds]
    smooth = [savgol_filter(part, 9, 2) if len(part) >= 9 else part for part in parts]
    return np.ascontiguousarray(np.concatenate(smooth), dtype=np.float64)
