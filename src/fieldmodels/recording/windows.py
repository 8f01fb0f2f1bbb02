"""Windows of a recording, each predicted from its own initial state."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fieldmodels.arrays import BoolArray, FloatArray, IntArray
from fieldmodels.recording.data import Recording, RecordingError


@dataclass(frozen=True)
class Windows:
    """Windows of one recording, each predicted from its own initial state.

    Attributes:
        recording: The measured data; commands before a window also affect it (delay, lag).
        starts: First sample of each window, shape (windows,).
        lengths: Number of samples of each window, shape (windows,).
        states: Initial states, shape (windows, states).
        observed: Which measured samples are used, shape (windows, samples, outputs); False after a
            window's end and for outputs that the recording lacks.
        disturbance: Additive generalised force on every sample of the recording, shape (n,), in the
            model's ``disturbance_unit``, or (n, columns) for its ``directions``; None for none.
        needed: First sample and end of every piece that a simulation must look at, shape (pieces, 2), one
            after the other: the windows and what led to them; None for whole episodes.
    """

    recording: Recording
    starts: IntArray
    lengths: IntArray
    states: FloatArray
    observed: BoolArray
    disturbance: FloatArray | None = None
    needed: IntArray | None = None

    def __len__(self) -> int:
        """Number of windows."""
        return len(self.starts)

    @property
    def samples(self) -> int:
        """Size of arrays over a window's samples; no window is longer."""
        return int(self.observed.shape[1])

    @property
    def pieces(self) -> IntArray:
        """First sample and end of every piece that simulations look at, shape (pieces, 2)."""
        return self.recording.bounds if self.needed is None else self.needed

    def without_lost(self, outputs: tuple[str, ...]) -> Windows:
        """The same windows, which use no sample that its sensor has lost."""
        lost = {j: self.recording.lost[name] for j, name in enumerate(outputs) if name in self.recording.lost}
        if not lost:
            return self
        rows = np.minimum(self.starts[:, None] + np.arange(self.samples), len(self.recording) - 1)
        observed = self.observed.copy()
        for j, gone in lost.items():
            observed[:, :, j] &= ~gone[rows]
        return replace(self, observed=observed)

    def select(self, which: BoolArray | IntArray) -> Windows:
        """Keep some of the windows."""
        return replace(
            self,
            starts=self.starts[which],
            lengths=self.lengths[which],
            states=self.states[which],
            observed=self.observed[which],
        )

    def with_states(self, states: FloatArray) -> Windows:
        """Start the same windows from other states."""
        # By hand: a fit asks for it before every simulation.
        return Windows(
            self.recording, self.starts, self.lengths, states, self.observed, self.disturbance, self.needed
        )

    def with_errors(self, output: str, errors: FloatArray) -> Windows:
        """The same windows as they would be if a sensor had not shown some errors.

        Args:
            output: The sensor's output.
            errors: What it has shown too much, shape (windows, samples).
        """
        inside = np.arange(self.samples) < self.lengths[:, None]
        shown = self.recording[output].copy()
        shown[(self.starts[:, None] + np.arange(self.samples))[inside]] -= errors[inside]
        signals = {**self.recording.signals, output: shown}
        return replace(self, recording=replace(self.recording, signals=signals))

    def with_disturbance(self, disturbance: FloatArray | None) -> Windows:
        """Add a generalised force along the whole recording."""
        return replace(self, disturbance=disturbance)

    def with_force(self, force: FloatArray) -> Windows:
        """Add a force to that which is added already; the columns that one of them lacks are zero."""
        if self.disturbance is None:
            return self.with_disturbance(force)
        if force.shape == self.disturbance.shape:
            return self.with_disturbance(self.disturbance + force)
        columns = max(one.size for one in (force, self.disturbance)) // len(self.recording)
        return self.with_disturbance(self.pushed(columns) + self.with_disturbance(force).pushed(columns))

    def pushed(self, columns: int) -> FloatArray:
        """The disturbance in every direction, shape (n, columns), or (0, columns) for none."""
        if self.disturbance is None:
            return np.zeros((0, columns))
        given = np.asarray(self.disturbance, dtype=np.float64).reshape(len(self.recording), -1)
        lacking = np.zeros((len(given), columns - given.shape[1]))
        return np.ascontiguousarray(np.concatenate([given, lacking], axis=1))

    def measured(self, outputs: tuple[str, ...]) -> FloatArray:
        """Measured outputs of every window; NaN where not observed, shape (windows, samples, outputs)."""
        rows = self.starts[:, None] + np.arange(self.samples)[None, :]
        rows = np.minimum(rows, len(self.recording) - 1)
        result = np.full((len(self), self.samples, len(outputs)), np.nan)
        for j, name in enumerate(outputs):
            if name in self.recording:
                result[:, :, j] = self.recording[name][rows]
        result[~self.observed] = np.nan
        return result


MIN_SAMPLES = 4
"""Fewest samples in which a window can be predicted."""
GOOD_SAMPLES = 16
"""Samples that a window of the main horizon should have at least."""


def longer_windows(step: float) -> str:
    """What to write in one's own model for windows of enough samples, ``step`` [s] apart."""
    shorter, main = GOOD_SAMPLES / 2 * step, GOOD_SAMPLES * step
    return f"in a model file of your own, `horizons = ({shorter:.2g}, {main:.2g})`"


def uniform_windows(
    recording: Recording,
    horizon: float,
    outputs: Sequence[str],
    initial_states: Callable[[Recording, IntArray], FloatArray],
) -> Windows:
    """Cut every episode into non-overlapping windows of one length.

    Args:
        recording: The measured data.
        horizon: Length of a window [s].
        outputs: Names of the outputs that a window compares.
        initial_states: Estimates the states at given samples, as ``Model.initial_states``.

    Raises:
        RecordingError: If no episode is as long as the horizon.
    """
    length = round(horizon / recording.step) + 1
    starts = np.concatenate([np.arange(a, b - length + 1, length) for a, b in recording.bounds])
    if length < MIN_SAMPLES or len(starts) == 0:
        coarse = f"sample faster, or predict over longer times ({longer_windows(recording.step)})"
        raise RecordingError(
            f"{recording.source}: too short or too coarse for windows of {horizon:g} s "
            f"({len(recording)} samples, {recording.step:g} s apart); "
            + (
                coarse
                if length < MIN_SAMPLES
                else "record longer, or predict over shorter times (`horizons`)"
            )
        )
    starts = starts.astype(np.int64)
    observed = np.zeros((len(starts), length, len(outputs)), dtype=np.bool_)
    for j, output in enumerate(outputs):
        observed[:, :, j] = output in recording
    return Windows(
        recording=recording,
        starts=starts,
        lengths=np.full(len(starts), length, dtype=np.int64),
        states=initial_states(recording, starts),
        observed=observed,
    )
