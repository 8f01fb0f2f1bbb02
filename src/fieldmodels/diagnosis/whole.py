"""Whole records: one start a record, for processes whose memory is longer than any window.

A window's start is free, so a slow process shows in it little else than its start. Here a record runs through
from one start; it is still compared window by window, so that what judges windows judges these.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.model import Model, Stage, Wrapper
from fieldmodels.recording import Recording, Windows

LONGER = (
    "the windows hardly determine some parameters; if the process has a longer memory than a window, "
    "--window record fits each record as a whole, from one start"
)
"""What to say where windows have no power."""


class WholeRecords(Wrapper):
    """A model whose windows are pieces of one run through each episode."""

    def __init__(self, inner: Model) -> None:
        super().__init__(inner)
        self.whole_records = False  # they are the windows

    def windows(self, recording: Recording, horizon: float) -> Windows:
        """The model's own windows, each with its episode's start."""
        windows = self.inner.windows(recording, horizon)
        episode = _episodes(windows)
        starts, which = np.unique(recording.bounds[episode, 0], return_inverse=True)
        return windows.with_states(self.inner.initial_states(recording, starts)[which])

    def simulate(self, parameters: FloatArray, windows: Windows) -> FloatArray:
        """Run through each episode from its start, and cut out the windows; see ``Model.simulate``."""
        episodes, first, which = np.unique(_episodes(windows), return_index=True, return_inverse=True)
        begins = windows.recording.bounds[episodes, 0]
        ends = np.zeros(len(episodes), dtype=np.int64)
        np.maximum.at(ends, which, windows.starts + windows.lengths)
        longest = int((ends - begins).max())
        runs = replace(
            windows,
            starts=begins,
            lengths=ends - begins,
            states=windows.states[first],
            observed=np.ones((len(begins), longest, len(self.outputs)), dtype=np.bool_),
            needed=None,
        )
        out = self.inner.simulate(parameters, runs)
        samples = np.arange(windows.samples)
        rows = (windows.starts - begins[which])[:, None] + samples
        cut = out[:, which[:, None], np.minimum(rows, longest - 1)]
        cut[:, samples >= windows.lengths[:, None]] = np.nan
        return np.asarray(cut)

    def runs(self, windows: Windows) -> IntArray:
        """Each episode is a run; see ``Model.runs``."""
        return _episodes(windows)

    def scaled_to(self, recordings: Sequence[Recording]) -> WholeRecords:
        """The model's own, over whole records."""
        return WholeRecords(self.inner.scaled_to(recordings))

    def stages(self, recordings: Sequence[Recording]) -> tuple[Stage, ...]:
        """The model's own stages, each over whole records."""
        return tuple(replace(s, model=WholeRecords(s.model)) for s in self.inner.stages(recordings))


def _episodes(windows: Windows) -> IntArray:
    """Number of the episode of each window."""
    begins = windows.recording.bounds[:, 0]
    return np.asarray(np.searchsorted(begins, windows.starts, side="right") - 1)
