"""The driver of batches: machines that run side by side, an interval at a time, for an environment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.drivers.declaration import Declaration
from fieldmodels.drivers.kernel.compose import kernels_of
from fieldmodels.drivers.kernel.episodes import Memory, desk_of
from fieldmodels.drivers.windows import FAST, Rows
from fieldmodels.effects import actuators, sensors

DELAYS = {
    "actuator": actuators.ROW.column("delay_delay"),
    "sensor": sensors.ROW.column("delay_delay"),
}


class BatchDriver:
    """Machines of one kind, each with parameters of its own, stepped together.

    A command is held over its interval. Before an episode's first command there was the first for ever, as in
    the windows of a recording; what a late sensor shows at first is the state at the beginning.
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
        kernels = kernels_of(machine)
        self._kernels, self._desk = kernels.episodes, desk_of(kernels.facts)
        self._rows = Rows(machine)
        self._parameters = np.array(parameters, dtype=np.float64)
        batch, inputs, outputs = len(parameters), max(len(machine.inputs), 1), len(machine.outputs)
        self._memory = Memory(
            ticks=np.zeros(batch, dtype=np.int64),
            states=np.zeros((batch, len(machine.states))),
            aims=np.zeros((batch, inputs, 2)),
            engaged=np.zeros((batch, inputs)),
            given=np.zeros((batch, inputs)),
            bristles=np.zeros((batch, len(machine.forces))),
            filtered=np.zeros((batch, outputs)),
            before=np.zeros((batch, outputs)),
            sensed=np.zeros((batch, outputs)),
            kept=np.zeros((batch, outputs, 2)),
        )
        self._refill()

    @property
    def states(self) -> FloatArray:
        """True states, shape (batch, states)."""
        return self._memory.states

    @property
    def before(self) -> FloatArray:
        """What the sensors sensed last, before lags and delays, shape (batch, outputs)."""
        return self._memory.before

    @property
    def ticks(self) -> IntArray:
        """Intervals since each episode began, shape (batch,)."""
        return self._memory.ticks

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
        self._kernels.begin(self._sets, self._memory, chosen)

    def advance(self, commands: FloatArray) -> None:
        """Run all machines for an interval.

        Args:
            commands: Shape (batch, inputs).
        """
        given = commands if self.machine.inputs else np.zeros_like(self._memory.given)
        held = np.ascontiguousarray(given, dtype=np.float64)
        self._kernels.advance(self._sets, self._memory, held, self.step, self._substeps, self._desk)

    def measured(self) -> FloatArray:
        """What the sensors measure now, without noise, shape (batch, outputs)."""
        out = np.empty((self.batch, len(self.machine.outputs)))
        kept = self._memory
        self._kernels.measure(
            self._sets.sen, kept.ticks, kept.given, kept.sensed, self.step, self.play_scale, out
        )
        return out

    def state(self) -> dict[str, Any]:
        """Everything that the next steps depend on, as copies."""
        kept = {name: values.copy() for name, values in self._memory._asdict().items()}
        return kept | {"parameters": self._parameters.copy()}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Return to what ``state`` gave."""
        self._parameters = np.array(state["parameters"], dtype=np.float64)
        self._refill()
        self._memory = Memory(**{name: np.array(state[name]) for name in Memory._fields})

    def _refill(self) -> None:
        """Rows of the parameters as the compiled driver takes them, and rings for their longest delays."""
        machine = self.machine
        self._sets = self._rows.sets(self._parameters)
        self._memory = self._memory._replace(
            aims=self._grown(self._memory.aims, self._sets.act, "actuator"),
            kept=self._grown(self._memory.kept, self._sets.sen, "sensor"),
        )
        self._substeps: IntArray = np.empty(self.batch, dtype=np.int64)
        speeds = np.array([FAST * speed for speed in machine.speeds()])
        self._kernels.steps(
            self._sets, self.states, self.step, speeds, np.ones(len(machine.states)), machine.substeps,
            self._desk, self._substeps,
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
