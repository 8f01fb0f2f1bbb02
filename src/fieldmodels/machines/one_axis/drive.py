"""The drive of an axis by itself: from the commanded to the measured force, where both are logged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.compiled import compiled
from fieldmodels.drivers.rates import white_noise
from fieldmodels.drivers.windows import Rows
from fieldmodels.effects.actuators import actuate, follow, has_dynamics, respond, unpack
from fieldmodels.machine import Machine
from fieldmodels.model import Model
from fieldmodels.recording import Recording, Windows

READ = 0.01  # share of a step after its command at which the force is read


class Drive(Model):
    """What an axis's actuator gives, measured right after each command.

    Parameters and effects are the axis's, by name and order; what acts behind the force does nothing here,
    and the axis's own parameters are kept. A window's state is the measured force, which nothing starts
    from: what the actuator has stored comes from the commands before.
    """

    def __init__(self, axis: Machine) -> None:
        """Take the names from an axis, whose first input has a measured counterpart."""
        (measured,) = axis.measured_inputs
        self.whole = axis
        self.name = axis.name
        self.inputs = axis.inputs
        self.outputs = (measured,)
        self.states = (measured,)
        self.parameters = tuple(replace(p, refitted=False) for p in axis.parameters)
        self.effects = axis.effects
        self.horizons = axis.horizons

    def scaled_to(self, recordings: Sequence[Recording]) -> Drive:
        """The axis's scales, and the noise of the measured force; see ``Model.scaled_to``."""
        result = Drive(self.whole.scaled_to(recordings))
        (measured,) = self.outputs
        # Jumps that the force has from its commands are no noise.
        errors = [r[measured.name] - r[self.inputs[0].name] for r in recordings]
        noise = float(np.median([white_noise(e) for e in errors]))
        result.outputs = (replace(measured, noise=noise),)
        return result

    def simulate(self, parameters: FloatArray, windows: Windows) -> FloatArray:
        """See ``Model.simulate``; a force does not depend on where a window starts."""
        recording = windows.recording
        command = np.ascontiguousarray(recording[self.inputs[0].name], dtype=np.float64)
        rows = Rows(self.whole).of(np.atleast_2d(parameters), "actuator")[0][:, 0]
        force = np.zeros((len(rows), len(command)))
        give(rows, command, windows.pieces, recording.step, force)
        samples = np.minimum(windows.starts[:, None] + np.arange(windows.samples), len(command) - 1)
        return np.asarray(force[:, samples][..., None])

    def initial_states(self, recording: Recording, starts: IntArray) -> FloatArray:
        """The measured force."""
        return np.asarray(recording[self.outputs[0].name][starts][:, None])


@compiled
def give(q: FloatArray, command: FloatArray, bounds: IntArray, step: float, out: FloatArray) -> None:
    """Force right after every command, for every row of parameters.

    Args:
        q: The input's rows, shape (batch, numbers of actuators.Row).
        command: Commanded force, shape (n,).
        bounds: First sample and end of every episode, or of every piece that is needed, shape (pieces, 2).
        step: Sampling interval [s].
        out: Receives the force, shape (batch, n).
    """
    target, stored = np.empty(len(command)), np.empty(len(command))
    for p in range(len(q)):
        r = unpack(q[p])
        actuate(command, bounds, step, False, r, q[p, :0], target)
        slow = has_dynamics(r)
        if slow:
            respond(target, bounds, step, False, r, stored)
        shift = r.delay_delay / step
        for piece in range(len(bounds)):
            first = bounds[piece, 0]
            for i in range(first, bounds[piece, 1]):
                if not slow:
                    whole = int(np.floor(shift))
                    near, far = max(i - whole, first), max(i - whole - 1, first)
                    out[p, i] = target[near] + (shift - whole) * (target[far] - target[near])
                    continue
                at = max(i - first + READ - shift, 0.0)
                row = first + int(np.floor(at))
                out[p, i] = follow(stored[row], target[row], (at - np.floor(at)) * step, r)
