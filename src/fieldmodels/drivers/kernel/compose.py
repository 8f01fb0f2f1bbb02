"""The compiled kernels of a machine, composed once for all machines that are alike."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from fieldmodels.drivers.declaration import Declaration
from fieldmodels.drivers.kernel.episodes import Episodes, episodes_of
from fieldmodels.drivers.kernel.equations import Equations, equations_of
from fieldmodels.drivers.kernel.events import Events, events_of
from fieldmodels.drivers.kernel.facts import Facts, facts_of
from fieldmodels.drivers.kernel.intervals import Intervals, intervals_of
from fieldmodels.drivers.kernel.lanes import lanes_of
from fieldmodels.drivers.kernel.windows import simulate_of

LANES = 16
"""Windows that go side by side: a few vectors of the processor, whose arithmetic overlaps."""
_composed: dict[str, Kernels] = {}
"""By title; a diagnosis puts the same curves on a machine many times."""


@dataclass(frozen=True)
class Kernels:
    """What runs a machine, compiled when it is first called.

    Attributes:
        facts: What they are composed from.
    """

    facts: Facts

    @cached_property
    def simulate(self) -> Callable[..., Any]:
        """Runs the windows of a recording; see ``simulate_of``."""
        lanes = lanes_of(self.facts, self._equations, self._events)
        return simulate_of(self.facts, self._equations, self._events, self._intervals, lanes)

    @cached_property
    def episodes(self) -> Episodes:
        """Run machines side by side, an interval at a time."""
        return episodes_of(self.facts, self._equations, self._events, self._intervals)

    @cached_property
    def _equations(self) -> Equations:
        return equations_of(self.facts)

    @cached_property
    def _events(self) -> Events:
        return events_of(self.facts, self._equations)

    @cached_property
    def _intervals(self) -> Intervals:
        return intervals_of(self.facts, self._equations, self._events)


def kernels_of(machine: Declaration, lanes: int = LANES) -> Kernels:
    """The kernels of a machine; what Numba cannot compile runs as it is, with a warning.

    Args:
        machine: The machine.
        lanes: How many windows go side by side.

    Raises:
        ModelError: For a mistake in one of the machine's own methods.
    """
    facts = facts_of(machine, lanes)
    if not facts.compiles:
        return Kernels(facts)
    return _composed.setdefault(facts.title, Kernels(facts))
