"""Samplers: distributions that stand in the place of a number or a choice, drawn anew for each episode.

In YAML, and wherever a mapping is handed in, a sampler is a mapping of its kind to its numbers::

    reality:
      gyro_bias: {rate: {uniform: [-0.01, 0.01]}}
      gyro_delay: {delay: {log_uniform: [0.001, 0.02]}}
      viscous_friction: {rate: {normal: [0.2, 0.05]}}
      gyro_quantisation: {step: {choice: [0.001, 0.01]}}
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from fieldmodels.model import ModelError
from fieldmodels.names import did_you_mean


class Sampler(ABC):
    """A distribution of a value; each draw uses one uniform number of the generator, nested ones one each."""

    kind: ClassVar[str]

    @abstractmethod
    def draw(self, rng: np.random.Generator, lower: float = -math.inf, upper: float = math.inf) -> Any:
        """Draw a value within the bounds of what it is drawn for."""

    @abstractmethod
    def extremes(self, lower: float, upper: float) -> tuple[float, float]:
        """Smallest and largest value that can be drawn within bounds; not for choices of names."""

    @property
    @abstractmethod
    def typical(self) -> Any:
        """A value in the middle, for what is computed before anything is drawn."""

    @abstractmethod
    def as_mapping(self) -> dict[str, list[Any]]:
        """The sampler as YAML has it; ``read_sampler`` makes it again."""

    def check(self, place: str, lower: float, upper: float, unit: str = "") -> None:
        """Make sure that every value that can be drawn is allowed.

        Raises:
            ModelError: If not; names the place and the bounds.
        """
        for value in self.extremes(lower, upper):
            if not lower <= value <= upper:
                raise ModelError(
                    f"{place}: {self} can draw {value:g}, outside [{lower:g}, {upper:g}]{unit and ' ' + unit}"
                )

    def __str__(self) -> str:
        """As YAML has it: ``uniform: [0, 1]``."""
        ((kind, values),) = self.as_mapping().items()
        return f"{kind}: {values}"


@dataclass(frozen=True)
class Uniform(Sampler):
    """Equally likely anywhere from ``low`` to ``high``; of a whole-number setting, both ends included."""

    kind: ClassVar[str] = "uniform"
    low: float
    high: float

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            ModelError: If they are not finite or not in order.
        """
        _ordered(self.kind, self.low, self.high)

    def draw(self, rng: np.random.Generator, lower: float = -math.inf, upper: float = math.inf) -> float:
        """See ``Sampler.draw``; ends never overshoot."""
        del lower, upper
        return min(self.low + (self.high - self.low) * float(rng.random()), self.high)

    def extremes(self, lower: float, upper: float) -> tuple[float, float]:
        """See ``Sampler.extremes``."""
        del lower, upper
        return self.low, self.high

    @property
    def typical(self) -> float:
        """The mean."""
        return 0.5 * (self.low + self.high)

    def as_mapping(self) -> dict[str, list[Any]]:
        """See ``Sampler.as_mapping``."""
        return {self.kind: [self.low, self.high]}


@dataclass(frozen=True)
class LogUniform(Sampler):
    """A value whose logarithm is equally likely anywhere from that of ``low`` to that of ``high``."""

    kind: ClassVar[str] = "log_uniform"
    low: float
    high: float

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            ModelError: If they are not finite, not in order, or not positive.
        """
        _ordered(self.kind, self.low, self.high)
        if not self.low > 0:
            raise ModelError(f"{self.kind} needs positive ends, not {self.low:g}; uniform takes others")

    def draw(self, rng: np.random.Generator, lower: float = -math.inf, upper: float = math.inf) -> float:
        """See ``Sampler.draw``; ends never overshoot."""
        del lower, upper
        value = self.low * math.exp(math.log(self.high / self.low) * float(rng.random()))
        return min(max(value, self.low), self.high)

    def extremes(self, lower: float, upper: float) -> tuple[float, float]:
        """See ``Sampler.extremes``."""
        del lower, upper
        return self.low, self.high

    @property
    def typical(self) -> float:
        """The geometric mean of the ends."""
        return min(max(math.sqrt(self.low) * math.sqrt(self.high), self.low), self.high)

    def as_mapping(self) -> dict[str, list[Any]]:
        """See ``Sampler.as_mapping``."""
        return {self.kind: [self.low, self.high]}


@dataclass(frozen=True)
class Normal(Sampler):
    """The normal distribution, truncated to the bounds of what it is drawn for: nothing piles up there."""

    kind: ClassVar[str] = "normal"
    mean: float
    std: float

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            ModelError: If they are not finite, or the standard deviation is not positive.
        """
        if not (math.isfinite(self.mean) and math.isfinite(self.std) and self.std > 0):
            raise ModelError(
                f"{self.kind} needs a finite mean and a positive standard deviation, "
                f"not [{self.mean:g}, {self.std:g}]"
            )

    def draw(self, rng: np.random.Generator, lower: float = -math.inf, upper: float = math.inf) -> float:
        """See ``Sampler.draw``: by the inverse of the truncated distribution."""
        from scipy.special import ndtr, ndtri  # slow to import

        first, last = ndtr((lower - self.mean) / self.std), ndtr((upper - self.mean) / self.std)
        share = first + (last - first) * float(rng.random())
        quantile = float(ndtri(min(max(share, 1e-300), 1.0 - 1e-16)))
        return min(max(self.mean + self.std * quantile, lower), upper)

    def extremes(self, lower: float, upper: float) -> tuple[float, float]:
        """See ``Sampler.extremes``: the bounds, or eight standard deviations."""
        return max(self.mean - 8.0 * self.std, lower), min(self.mean + 8.0 * self.std, upper)

    @property
    def typical(self) -> float:
        """The mean."""
        return self.mean

    def as_mapping(self) -> dict[str, list[Any]]:
        """See ``Sampler.as_mapping``."""
        return {self.kind: [self.mean, self.std]}

    def check(self, place: str, lower: float, upper: float, unit: str = "") -> None:
        """See ``Sampler.check``: the mean must lie within the bounds; what lies outside is never drawn.

        Raises:
            ModelError: If it does not.
        """
        if not lower <= self.mean <= upper:
            unit = unit and " " + unit
            raise ModelError(f"{place}: the mean of {self} is outside [{lower:g}, {upper:g}]{unit}")


@dataclass(frozen=True)
class Choice(Sampler):
    """One of some values, numbers or names, each equally likely; a sampler among them draws in its turn."""

    kind: ClassVar[str] = "choice"
    values: tuple[Any, ...]

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ModelError: If there is none, or a number is not finite.
        """
        if not isinstance(self.values, tuple) or not self.values:
            raise ModelError(f"{self.kind} needs at least one value, not {self.values!r}")
        for value in self.values:
            if isinstance(value, float) and not math.isfinite(value):
                raise ModelError(f"{self.kind} needs finite numbers or names, not {value!r}")

    def draw(self, rng: np.random.Generator, lower: float = -math.inf, upper: float = math.inf) -> Any:
        """See ``Sampler.draw``."""
        value = self.values[int(len(self.values) * float(rng.random()))]
        return value.draw(rng, lower, upper) if isinstance(value, Sampler) else value

    def extremes(self, lower: float, upper: float) -> tuple[float, float]:
        """See ``Sampler.extremes``."""
        ends = [v.extremes(lower, upper) if isinstance(v, Sampler) else (v, v) for v in self.values]
        return min(low for low, _ in ends), max(high for _, high in ends)

    @property
    def typical(self) -> Any:
        """The first value."""
        first = self.values[0]
        return first.typical if isinstance(first, Sampler) else first

    def as_mapping(self) -> dict[str, list[Any]]:
        """See ``Sampler.as_mapping``."""
        return {self.kind: [v.as_mapping() if isinstance(v, Sampler) else v for v in self.values]}

    def check(self, place: str, lower: float, upper: float, unit: str = "") -> None:
        """See ``Sampler.check``.

        Raises:
            ModelError: If a value is not a number, or outside the bounds.
        """
        for value in self.values:
            if isinstance(value, Sampler):
                value.check(place, lower, upper, unit)
            elif isinstance(value, bool) or not isinstance(value, int | float):
                raise ModelError(f"{place}: {self} needs numbers here, not {value!r}")
        super().check(place, lower, upper, unit)


@dataclass(frozen=True)
class Each(Sampler):
    """A tuple of numbers, some of which are drawn: each by its own sampler, in order.

    Attributes:
        values: Numbers and samplers.
        bounds: Smallest and largest value of each.
    """

    kind: ClassVar[str] = "each"
    values: tuple[Any, ...]
    bounds: tuple[tuple[float, float], ...]

    def draw(
        self, rng: np.random.Generator, lower: float = -math.inf, upper: float = math.inf
    ) -> tuple[float, ...]:
        """See ``Sampler.draw``; each number has bounds of its own."""
        del lower, upper
        pairs = zip(self.values, self.bounds, strict=True)
        return tuple(float(v.draw(rng, *ends) if isinstance(v, Sampler) else v) for v, ends in pairs)

    def extremes(self, lower: float, upper: float) -> Any:
        """See ``Sampler.extremes``: two tuples."""
        del lower, upper
        pairs = zip(self.values, self.bounds, strict=True)
        return tuple(
            zip(*(v.extremes(*e) if isinstance(v, Sampler) else (v, v) for v, e in pairs), strict=True)
        )

    @property
    def typical(self) -> tuple[float, ...]:
        """Each number's typical value."""
        return tuple(float(v.typical if isinstance(v, Sampler) else v) for v in self.values)

    def as_mapping(self) -> dict[str, list[Any]]:
        """See ``Sampler.as_mapping``; in YAML the list stands by itself."""
        return {self.kind: [v.as_mapping() if isinstance(v, Sampler) else v for v in self.values]}


def _ordered(kind: str, low: float, high: float) -> None:
    if not (math.isfinite(low) and math.isfinite(high)):
        raise ModelError(f"{kind} needs two finite numbers, not [{low:g}, {high:g}]")
    if not low <= high:
        raise ModelError(f"{kind} needs its smaller end first, not [{low:g}, {high:g}]")


_KINDS: dict[str, Callable[..., Sampler]] = {
    "uniform": Uniform,
    "log_uniform": LogUniform,
    "normal": Normal,
}

KINDS = frozenset([*_KINDS, Choice.kind])
"""Names of the samplers."""


def is_sampler(value: Any) -> bool:
    """Whether a value is a sampler, or a mapping that means to be one."""
    return isinstance(value, Sampler | Mapping)


def read_sampler(value: Any, place: str, nested: bool = False) -> Sampler:
    """Read a sampler from an object or a mapping such as ``{"uniform": [0, 1]}``.

    Args:
        value: What stands in the place of a number.
        place: Its name, for messages.
        nested: Whether a mapping among the values of a choice is a sampler, too.

    Raises:
        ModelError: If it is none of the known kinds, or its numbers make no sense.
    """
    if isinstance(value, Sampler):
        return value
    kinds = [*_KINDS, Choice.kind]
    if not isinstance(value, Mapping) or len(value) != 1:
        raise ModelError(f"{place}: a sampler is a mapping of one of {', '.join(kinds)}, not {value!r}")
    ((kind, numbers),) = value.items()
    if kind not in kinds:
        raise ModelError(
            f"{place}: no sampler {kind!r}{did_you_mean(str(kind), kinds)}; there are {', '.join(kinds)}"
        )
    if not isinstance(numbers, list | tuple):
        raise ModelError(f"{place}: {kind} takes a list, not {numbers!r}")
    try:
        if kind == Choice.kind:
            return Choice(
                tuple(read_sampler(n, place) if nested and isinstance(n, Mapping) else n for n in numbers)
            )
        if len(numbers) != 2 or any(isinstance(n, bool) or not isinstance(n, int | float) for n in numbers):
            what = "mean and standard deviation" if kind == Normal.kind else "smallest and largest value"
            raise ModelError(f"{kind} takes two numbers, {what}, not {numbers!r}")
        return _KINDS[kind](*map(float, numbers))
    except ModelError as error:
        raise ModelError(f"{place}: {error}") from None
