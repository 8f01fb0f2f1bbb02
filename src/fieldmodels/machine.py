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
from copy import copy
from functools import cached_property
from typing import Any, Self

import numpy as np

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.drivers.declaration import Declaration, Force, Hold, number
from fieldmodels.drivers.sizes import measured_horizons, measured_outputs, measured_sizes
from fieldmodels.drivers.starts import parabolas
from fieldmodels.drivers.windows import WindowDriver
from fieldmodels.model import Model, ModelError
from fieldmodels.recording import Recording, Windows

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

    They are compiled by Numba, and are handed named tuples; ``self`` is None in them. What Numba cannot
    compile is run as it is, with a warning, about a thousand times slower.
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
        state is a velocity without a sensor of its own. A state that nothing measures starts at 0; a machine
        that knows better overrides this.
        """
        return parabolas(self, recording, starts)

    def scaled_to(self, recordings: Sequence[Recording]) -> Self:
        """Suit scales, starts, horizons and sensor noise to the data; see ``Model.scaled_to``."""
        result = type(self)(measured_sizes(self, recordings))
        result.outputs = measured_outputs(self, recordings)
        result.horizons = measured_horizons(self, recordings)
        result.hold = self.hold
        return result


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
    result = copy(model)
    result.hold, result.hold_said = hold, True
    result.__dict__.pop("driver", None)  # it runs the machine that it was made for
    return result
