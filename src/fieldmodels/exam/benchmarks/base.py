"""What a benchmark offers: records of a machine by its own model, and effects by their size."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cached_property
from types import MappingProxyType
from typing import ClassVar, NamedTuple

from fieldmodels.model import EffectValues, Model, Parameter
from fieldmodels.recording import Recording
from fieldmodels.registry import get_model

SECOND = 500_000
"""Added to a seed for the second record."""


class Outside(NamedTuple):
    """A fault that the model's library does not list.

    Attributes:
        name: One of the benchmark's ``outside``.
        size: In the unit in which the benchmark reads it.
    """

    name: str
    size: float


class Benchmark(ABC):
    """A machine with simulated experiments on which the diagnosis is tested.

    Attributes:
        name: Name of the model.
        outside: Faults that the model does not list: name to one plain sentence.
        needs_base: Effects that a refitted base absorbs; in their cases the base is known.
        constants: Parameters of effects that do not grow with an effect's size, by full name.
        coloured_share: Share of the noise's variance that wanders slowly in records with coloured noise.
    """

    name: ClassVar[str]
    outside: ClassVar[Mapping[str, str]]
    needs_base: ClassVar[frozenset[str]] = frozenset()
    constants: ClassVar[Mapping[str, float]] = MappingProxyType({})
    coloured_share: ClassVar[float] = 0.5

    @cached_property
    def model(self) -> Model:
        """The model that is held against the data."""
        return get_model(self.name)

    @abstractmethod
    def record(
        self,
        reality: EffectValues,
        seed: int,
        *,
        noise: bool = True,
        coloured: float = 0.0,
        outside: Outside | None = None,
    ) -> Recording:
        """Record the machine by a simulation that is not the one that a diagnosis runs.

        Args:
            reality: Effects of the model that are on.
            seed: Of excitation and noise; equal seeds excite alike, whatever is hidden.
            noise: False for sensors without noise (what else is random stays).
            coloured: Share of the noise's variance that wanders slowly.
            outside: A fault from outside the library.

        Raises:
            ModelError: If the machine does not stand it.
        """

    def pair(
        self,
        effects: EffectValues,
        seed: int,
        coloured: float = 0.0,
        outside: Outside | None = None,
        without: Iterable[str] = (),
    ) -> list[Recording]:
        """A record to fit and one to measure the gain on.

        Args:
            effects: Effects of the model that are hidden.
            seed: Of the first record.
            coloured: Share of the noise's variance that wanders slowly.
            outside: A fault that the model does not list.
            without: Signals that are not measured.
        """
        left_out = set(without)
        return [
            replace(one, signals={name: v for name, v in one.signals.items() if name not in left_out})
            for one in (
                self.record(effects, k, coloured=coloured, outside=outside) for k in (seed, seed + SECOND)
            )
        ]

    def values(self, effect: str, size: float, sign: int = 1) -> dict[str, float]:
        """Values of an effect's parameters at a multiple of its typical step.

        Args:
            effect: Name of the effect.
            size: Multiple, positive; 0 is neutral.
            sign: -1 for the other direction, where the effect has one (``signed``).
        """
        result = {}
        for parameter in self.model.effect(effect).parameters:
            full = f"{effect}.{parameter.name}"
            start = parameter.starts[0] if parameter.starts else parameter.nominal + parameter.scale
            if full in self.constants:
                value = self.constants[full]
            elif _limits(parameter):
                value = start / size if size > 0 else parameter.nominal
            else:
                value = parameter.nominal + sign * size * (start - parameter.nominal)
            result[parameter.name] = min(max(value, parameter.lower), parameter.upper)
        return result

    def signed(self, effect: str) -> bool:
        """Whether an effect has two directions."""
        return all(
            parameter.lower < parameter.nominal < parameter.upper
            for parameter in self.model.effect(effect).parameters
            if f"{effect}.{parameter.name}" not in self.constants
        )

    def fixed(self, effects: Iterable[str]) -> dict[str, float]:
        """Base parameters that a diagnosis is given, where it could not see an effect without."""
        if not self.needs_base & set(effects):
            return {}
        return {p.name: p.nominal for p in self.model.parameters}


def _limits(parameter: Parameter) -> bool:
    """Whether a parameter is a limit, which does nothing as long as it is large."""
    return parameter.nominal == parameter.upper
