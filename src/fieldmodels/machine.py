"""A machine, declared once: its numbers, its signals, how it moves, and the stock effects around it.

    class Motor(Machine):
        inputs = (Signal("voltage", "V"),)
        states = outputs = (Signal("speed", "rad/s", noise=0.2),)
        gain = number("rad/s/V", 10.0, 0.0, 1e3)
        time_constant = number("s", 0.1, 0.01, 10.0)
        effects = actuator("voltage") + friction("speed") + sensor("speed")

        def derivative(self, state, input, p):
            return (p.gain * input.voltage - state.speed) / p.time_constant

A driver runs it: ``drivers.windows`` for a diagnosis, ``drivers.batch`` for an environment.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, Self

import numpy as np

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.drivers.declaration import Declaration, Force, Hold, number
from fieldmodels.drivers.sizes import measured_horizons, measured_outputs, measured_sizes, measured_states
from fieldmodels.drivers.starts import started
from fieldmodels.drivers.windows import WindowDriver
from fieldmodels.model import Model, ModelError
from fieldmodels.recording import Recording, Windows

LOOKED = 9  # samples of a recording at which states are guessed, to see which are known

__all__ = ["Force", "Machine", "held_inputs", "number"]


class Machine(Declaration):
    """A machine in as few lines as it takes to say what it is.

    Declare ``inputs``, ``states`` and ``outputs``; each base parameter as a ``number``; ``effects``: stock
    effects around it, and own ``Effect``s, whose parameters reach the methods below as
    ``p.<effect>_<parameter>``. Give

    - ``derivative(self, state, input, p)``: rates of the states, in their order (one number for one state);
      or ``step(self, state, input, p, dt)``: the states a time ``dt`` later;
    - ``observe(self, state, p)``: the true outputs, in their order; by default the states of the same names;
    - ``pace(self, p)``: the fastest mode [rad/s], by which steps are chosen; by default from the derivative.

    They are compiled by Numba, with functions beside the class that they call, and are handed named tuples;
    ``self`` is None in them. A mistake in one is a ModelError before anything runs. What Numba cannot compile
    is run as it is, with a warning, about a thousand times slower.
    """

    @cached_property
    def driver(self) -> Any:
        """What runs the machine over windows of recordings."""
        return WindowDriver(self)

    def simulate(self, parameters: FloatArray, windows: Windows) -> FloatArray:
        """Simulate every window; see ``Model.simulate``."""
        result: FloatArray = self.driver(np.atleast_2d(parameters), windows)
        return result

    def initial_states(self, recording: Recording, starts: IntArray) -> FloatArray:
        """States as the sensors measure them; see ``Model.initial_states``.

        A parabola through nine samples gives a state that is measured, and the rate of one that is, where the
        state is a velocity without a sensor of its own. Other states are solved for, at the nominal numbers:
        so that ``observe`` gives what was measured, and its rate what that changes by. A state that nothing
        tells starts at 0; a machine that knows better overrides this.
        """
        return started(self, recording, starts)[0]

    def unseen(self, recording: Recording) -> tuple[str, ...]:
        """States of which neither a sensor nor a declared ``noise`` says where they start."""
        looked = _some(recording)
        found = started(self, recording, looked)[1] | self.initial_states(recording, looked).any(axis=0)
        declared = zip(type(self).states, found, strict=True)
        return tuple(s.name for s, told in declared if not (told or s.noise))

    def scaled_to(self, recordings: Sequence[Recording]) -> Self:
        """Suit scales, starts, horizons and sensor noise to the data; see ``Model.scaled_to``."""
        result = type(self)(measured_sizes(self, recordings))
        result.outputs = measured_outputs(self, recordings)
        looked = [self.initial_states(r, _some(r)) for r in recordings]
        result.states = measured_states(self, recordings, np.concatenate(looked))
        result.horizons = measured_horizons(self, recordings)
        result.hold = self.hold
        return result


def _some(recording: Recording) -> IntArray:
    """Samples of a recording at which states are guessed."""
    return np.linspace(0, len(recording) - 1, LOOKED).astype(np.int64)


def held_inputs(model: Model, hold: Hold) -> Model:
    """The same machine with inputs that behave otherwise between samples.

    Args:
        model: A machine.
        hold: What they do.

    Raises:
        ModelError: If the model is no `Machine`: then its own simulation says what its inputs do.
    """
    if not isinstance(model, Machine):
        raise ModelError(f"model {model.name!r} says itself what its inputs do between samples; leave it out")
    result = model.held_as(hold)
    result.hold_said = True
    return result
