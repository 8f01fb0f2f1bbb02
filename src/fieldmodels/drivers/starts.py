"""States at given samples, from what is measured around them."""

from __future__ import annotations

import numpy as np

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.drivers.declaration import Declaration
from fieldmodels.drivers.rates import pace
from fieldmodels.drivers.windows import Once, episode_edges
from fieldmodels.recording import Recording

REACH = 4  # samples before and after, at most
_PACES: Once[dict[str, float]] = Once(lambda _: {})
"""Of a recording's signals, by name: a long one takes a second, and is cut into windows again and again."""
SHARE = 0.5  # of the time in which a signal changes by its size: farther it is no parabola


def parabolas(machine: Declaration, recording: Recording, starts: IntArray) -> FloatArray:
    """Fit a parabola to the samples around each start, shape (len(starts), states).

    A measured state is smoothed by it; a velocity that is not measured is the slope of its position's.
    """
    positions = {f.velocity: f.position for f in machine.forces}
    measured = {s.name for s in machine.outputs if s.name in recording}
    states = np.zeros((len(starts), len(machine.states)))
    for i, state in enumerate(machine.states):
        position = positions.get(state.name, "")
        if state.name in measured:
            states[:, i] = _derivative(recording, state.name, starts, 0)
        elif position in measured:
            states[:, i] = _derivative(recording, position, starts, 1) / recording.step
    return states


def _derivative(recording: Recording, name: str, starts: IntArray, order: int) -> FloatArray:
    """A signal, or its slope a sample, at some samples, by a parabola through nine or fewer."""
    known = _PACES(recording)
    if name not in known:
        known[name] = pace([recording], name)
    time = known[name] / recording.step
    reach = int(np.clip(round(SHARE * time), 1, REACH)) if np.isfinite(time) and time > 0.0 else REACH
    first, last = episode_edges(recording)
    offsets = np.arange(-reach, reach + 1)
    rows = starts[:, None] + offsets
    inside = (rows >= first[starts][:, None]) & (rows <= last[starts][:, None])
    rows = np.where(inside, rows, starts[:, None])
    # Least squares with weight zero beyond an episode's ends.
    solver = np.linalg.pinv(inside[:, :, None] * np.vander(offsets, 3, increasing=True))
    return np.asarray(np.einsum("wk,wk->w", solver[:, order], recording[name][rows]))
