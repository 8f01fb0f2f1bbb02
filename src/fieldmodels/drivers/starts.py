"""States at given samples, from what is measured around them."""

from __future__ import annotations

import numpy as np

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.drivers.declaration import Declaration
from fieldmodels.drivers.windows import episode_edges
from fieldmodels.recording import Recording

REACH = 4  # samples before and after


def parabolas(machine: Declaration, recording: Recording, starts: IntArray) -> FloatArray:
    """Fit a parabola to the nine samples around each start, shape (len(starts), states).

    A measured state is smoothed by it; a velocity that is not measured is the slope of its position's.
    """
    first, last = episode_edges(recording)
    offsets = np.arange(-REACH, REACH + 1)
    rows = starts[:, None] + offsets
    inside = (rows >= first[starts][:, None]) & (rows <= last[starts][:, None])
    rows = np.where(inside, rows, starts[:, None])
    # Least squares with weight zero beyond an episode's ends.
    solver = np.linalg.pinv(inside[:, :, None] * np.vander(offsets, 3, increasing=True))
    positions = {f.velocity: f.position for f in machine.forces}
    measured = {s.name for s in machine.outputs if s.name in recording}
    states = np.zeros((len(starts), len(machine.states)))
    for i, state in enumerate(machine.states):
        position = positions.get(state.name, "")
        if state.name in measured:
            states[:, i] = np.einsum("wk,wk->w", solver[:, 0], recording[state.name][rows])
        elif position in measured:
            slopes = np.einsum("wk,wk->w", solver[:, 1], recording[position][rows])
            states[:, i] = slopes / recording.step
    return states
