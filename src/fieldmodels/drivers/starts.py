"""States at given samples, from what is measured around them."""

from __future__ import annotations

import numpy as np

from fieldmodels.arrays import BoolArray, FloatArray, IntArray
from fieldmodels.drivers.declaration import Declaration
from fieldmodels.drivers.rates import pace
from fieldmodels.drivers.told import Measured, told
from fieldmodels.drivers.windows import Once, episode_edges
from fieldmodels.recording import Recording

REACH = 4  # samples before and after, at most
_PACES: Once[dict[str, float]] = Once(lambda _: {})
"""Of a recording's signals, by name: a long one takes a second, and is cut into windows again and again."""
SHARE = 0.5  # of the time in which a signal changes by its size: farther it is no parabola


def started(machine: Declaration, recording: Recording, starts: IntArray) -> tuple[FloatArray, BoolArray]:
    """States at each start, shape (len(starts), states), and which of them the sensors tell, shape (states,).

    A parabola through the samples around it smooths a measured state; a velocity that is not measured is the
    slope of its position's. What is not known so is ``told`` by the machine's equations, as far as they do;
    the others are 0.
    """
    positions = {f.velocity: f.position for f in machine.forces}
    measured = {s.name for s in machine.outputs if s.name in recording}
    states = np.zeros((len(starts), len(machine.states)))
    known = np.zeros(len(machine.states), dtype=np.bool_)
    for i, state in enumerate(machine.states):
        position = positions.get(state.name, "")
        known[i] = state.name in measured or position in measured
        if state.name in measured:
            states[:, i] = _derivative(recording, state.name, starts, 0)
        elif position in measured:
            states[:, i] = _derivative(recording, position, starts, 1) / recording.step
    shown = [k for k, s in enumerate(machine.outputs) if s.name in recording and not s.event]
    if known.all() or not shown or not len(starts):
        return states, known
    return told(machine, states, known, _measured(machine, shown, recording, starts), recording.step)


def _measured(machine: Declaration, outputs: list[int], recording: Recording, starts: IntArray) -> Measured:
    """What the sensors have measured at some samples, and how fast it changes."""
    names = [machine.outputs[k].name for k in outputs]
    values = [_derivative(recording, name, starts, 0) for name in names]
    slopes = [_derivative(recording, name, starts, 1) / recording.step for name in names]
    inputs = machine.commands(recording, episode_edges(recording)[1])[starts]
    return Measured(outputs, np.column_stack(values), np.column_stack(slopes), inputs)


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
