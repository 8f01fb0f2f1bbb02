"""The driver of batches: machines that run side by side, an interval at a time, for an environment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.drivers.declaration import Declaration
from fieldmodels.drivers.generate import driver_module
from fieldmodels.drivers.windows import FAST, Rows
from fieldmodels.effects import actuators, sensors

TEMPLATE = "batch.py.j2"
KEPT = ("ticks", "states", "aims", "engaged", "given", "bristles", "filtered", "before", "sensed", "kept")
"""Arrays that the next steps depend on."""
DELAYS = {
    "actuator": actuators.ROW.column("delay_delay"),
    "sensor": sensors.ROW.column("delay_delay"),
}


class BatchDriver:
    """Machines of one kind, each with parameters of its own, stepped together.

    A command is held over its interval. Before an episode's first command there was the first for ever, as in
    the windows of a recording; what a late sensor shows at first is the state at the beginning.

    Attributes:
        states: True states, shape (batch, states).
        ticks: Intervals since each episode began, shape (batch,).
    """

    def __init__(
        self, machine: Declaration, parameters: FloatArray, step: float, command_size: float
    ) -> None:
        """Set up a batch at zero states.

        Args:
            machine: The machine.
            parameters: Its parameter vectors, shape (batch, len(machine.names)).
            step: Length of an interval [s].
            command_size: A large command, over 2 % of which backlash is crossed.
        """
        self.machine, self.step = machine, float(step)
        self.play_scale = 0.02 * command_size
        self._module = driver_module(machine, TEMPLATE)
        self._rows = Rows(machine)
        batch = len(parameters)
        self._parameters = np.array(parameters, dtype=np.float64)
        self.states = np.zeros((batch, len(machine.states)))
        self.ticks = np.zeros(batch, dtype=np.int64)
        inputs, outputs = max(len(machine.inputs), 1), len(machine.outputs)
        self.engaged, self.given = np.zeros((batch, inputs)), np.zeros((batch, inputs))
        self.bristles = np.zeros((batch, len(machine.forces)))
        self.filtered, self.before = np.zeros((batch, outputs)), np.zeros((batch, outputs))
        self.sensed = np.zeros((batch, outputs))
        self.aims, self.kept = np.zeros((batch, inputs, 2)), np.zeros((batch, outputs, 2))
        self._refill()

    @property
    def batch(self) -> int:
        """How many machines there are."""
        return len(self.states)

    def set_parameters(self, rows: Sequence[int], parameters: FloatArray) -> None:
        """Give some machines other parameter vectors, shape (len(rows), n), before their next episode."""
        self._parameters[rows] = parameters
        self._refill()

    def begin(self, rows: Sequence[int], states: FloatArray) -> None:
        """Begin new episodes of some machines.

        Args:
            rows: Which.
            states: Their true states, shape (len(rows), states).
        """
        chosen = np.asarray(rows, dtype=np.int64)
        self.states[chosen] = states
        self._module.begin_all(
            self._base, self._curves, self.states, chosen, self.ticks, self.bristles, self.before, self.sensed
        )

    def advance(self, commands: FloatArray) -> None:
        """Run all machines for an interval.

        Args:
            commands: Shape (batch, inputs).
        """
        self._module.advance_all(
            self._base, self._act, self._frc, self._sen, self._changes, self._curves,
            np.ascontiguousarray(commands, dtype=np.float64), self.step, False, self._substeps, self.ticks,
            self.states, self.aims, self.engaged, self.given, self.bristles, self.filtered, self.before,
            self.sensed, self.kept,
        )  # fmt: skip

    def measured(self) -> FloatArray:
        """What the sensors measure now, without noise, shape (batch, outputs)."""
        out = np.empty((self.batch, len(self.machine.outputs)))
        self._module.measure_all(
            self._sen, self.step, self.play_scale, self.ticks, self.sensed, self.given, out
        )
        return out

    def state(self) -> dict[str, Any]:
        """Everything that the next steps depend on, as copies."""
        return {name: getattr(self, name).copy() for name in KEPT} | {"parameters": self._parameters.copy()}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Return to what ``state`` gave."""
        self._parameters = np.array(state["parameters"], dtype=np.float64)
        self._refill()
        for name in KEPT:
            setattr(self, name, np.array(state[name]))

    def _refill(self) -> None:
        """Rows of the parameters as the compiled driver takes them, and rings for their longest delays."""
        machine, q = self.machine, self._parameters
        self._base = np.ascontiguousarray(q[:, self._rows.base])
        self._act, self._frc, self._sen, self._changes = self._rows.of(
            q, "actuator", "force", "sensor", "change"
        )
        self._curves = np.ascontiguousarray(q[:, self._rows.curves])
        self.aims = self._grown(self.aims, self._act, "actuator")
        self.kept = self._grown(self.kept, self._sen, "sensor")
        self._substeps: IntArray = np.empty(self.batch, dtype=np.int64)
        self._module.steps_for(
            self._base, self._frc, self._curves, self.states, self.step,
            np.array([FAST * speed for speed in machine.speeds()]), np.ones(len(machine.states)),
            machine.substeps, self._substeps,
        )  # fmt: skip

    def _grown(self, ring: FloatArray, rows: FloatArray, place: str) -> FloatArray:
        """A ring with room for the longest delay; entries keep their interval's place as long as it fits."""
        longest = float(rows[:, :, DELAYS[place]].max(initial=0.0))
        slots = int(np.ceil(longest / self.step)) + 2
        if slots <= ring.shape[2]:
            return ring
        grown = np.zeros((*ring.shape[:2], slots))
        back = np.arange(ring.shape[2])
        for e, tick in enumerate(self.ticks):
            grown[e][:, (tick - 1 - back) % slots] = ring[e][:, (tick - 1 - back) % ring.shape[2]]
        return grown
