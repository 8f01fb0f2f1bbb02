"""A claim of a source, the number of ours that decides it, and the rule by which it is decided."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

from fieldmodels.yaml import load_yaml

Verdict = Literal["reproduced", "refuted", "depends", "undecided", "not computable", "failed"]

VERDICTS: tuple[Verdict, ...] = (
    "reproduced", "refuted", "depends", "undecided", "not computable", "failed",
)  # fmt: skip
"""In the order of presentation."""


ANY = (-math.inf, math.inf)
"""Every number."""


@dataclass(frozen=True)
class Statistic:
    """A number of ours and its interval; ``papers.statistics`` makes them.

    Attributes:
        value: The number.
        low: Lower end of its interval at 95 %; the value itself where nothing is random.
        high: Upper end.
    """

    value: float
    low: float
    high: float

    def __post_init__(self) -> None:
        """Refuse what is no interval around a number.

        Raises:
            ValueError: If a number is not finite, or the value lies outside its interval.
        """
        if not -math.inf < self.low <= self.value <= self.high < math.inf:
            raise ValueError(f"{self.value} [{self.low}, {self.high}] is no number within a finite interval")

    def __str__(self) -> str:
        """Value and interval with four digits."""
        if self.low == self.value == self.high:
            return _digits(self.value)
        return f"{_digits(self.value)} [{_digits(self.low)}, {_digits(self.high)}]"


@dataclass(frozen=True)
class Ours:
    """Where the number of ours comes from.

    Attributes:
        run: Name of the `Reproducible` of the same task that computes it.
        statistic: Its key in the run's ``statistics``.
        options: Options of the run that differ from its defaults.
    """

    run: str
    statistic: str
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Claim:
    """What a source claims, and how it is decided.

    It is reproduced if the interval of our number lies wholly within ``holds``, refuted if it lies wholly
    outside, undecided if it reaches over an end. Of several readings some may be reproduced and others
    refuted: the claim then *depends* on what they differ in.

    Attributes:
        name: Its name within the task, such as ``best-decay``.
        where: What it covers and where that stands: "Fig 2.12", "section 2.5.1".
        says: What is claimed, in one sentence.
        printed: The printed value as the source has it; empty where it prints none.
        holds: Least and greatest value of our number for which the claim holds: see `near`, `times`,
            `at_least`, `at_most`.
        ours: Our number, or one for each reading of an ambiguous text, by the reading's name.
        depends_on: In what the readings differ, to be read after "depends on".
        because: Why nothing can be computed; nothing else is then given but ``name``, ``where``, ``says``.
        expected: The verdict that we have come to; another one is flagged. Without effect beside ``because``.
        remark: Why the verdict is what it is, in a sentence or two, with the source's words if they matter.
        assumes: What the source leaves open and we chose: a condition, a bound, what a word means. Without it
            the claim is decided by what is printed.
    """

    name: str
    where: tuple[str, ...]
    says: str
    printed: str = ""
    holds: tuple[float, float] = ANY
    ours: Ours | Mapping[str, Ours] = field(default_factory=dict)
    depends_on: str = ""
    because: str = ""
    expected: Verdict = "reproduced"
    remark: str = ""
    assumes: str = ""

    @property
    def comment(self) -> str:
        """What is assumed, and why the verdict is what it is."""
        return " ".join(filter(None, (self.remark, self.assumes and f"Assumed: {self.assumes}")))

    @property
    def readings(self) -> Mapping[str, Ours]:
        """Our numbers by reading; the only one of an unambiguous claim has the name ""."""
        return {"": self.ours} if isinstance(self.ours, Ours) else self.ours

    @property
    def condition(self) -> str:
        """What our number must be, in words."""
        low, high = self.holds
        if math.isinf(low):
            return "" if math.isinf(high) else f"at most {_digits(high)}"
        return f"at least {_digits(low)}" if math.isinf(high) else f"{_digits(low)} to {_digits(high)}"


@dataclass(frozen=True)
class Decided:
    """A claim with our numbers and the verdict.

    Attributes:
        claim: What is claimed.
        task: Whose source claims it.
        measured: Our number in each reading; None where it could not be computed.
        errors: What went wrong, by reading.
    """

    claim: Claim
    task: str
    measured: Mapping[str, Statistic | None]
    errors: Mapping[str, str] = field(default_factory=dict)

    @property
    def verdicts(self) -> dict[str, Verdict]:
        """The verdict in each reading."""
        return {name: decide(number, self.claim.holds) for name, number in self.measured.items()}

    @property
    def verdict(self) -> Verdict:
        """The verdict over all readings."""
        if self.claim.because:
            return "not computable"
        found = set(self.verdicts.values())
        if len(found) == 1:
            return found.pop()
        if not found or "failed" in found:
            return "failed"
        return "undecided" if "undecided" in found else "depends"

    @property
    def words(self) -> str:
        """The verdict in words: "depends on the score"."""
        return f"depends on {self.claim.depends_on}" if self.verdict == "depends" else self.verdict

    @property
    def unexpected(self) -> bool:
        """Whether the verdict contradicts the expected one; one that is undecided contradicts nothing.

        Nor does one that rests on some of the readings only.
        """
        if set(self.measured) != set(self.claim.readings):
            return False
        return self.verdict not in (self.claim.expected, "undecided", "not computable")


def decide(number: Statistic | None, holds: tuple[float, float]) -> Verdict:
    """Decide one reading: by where the interval of our number lies.

    Args:
        number: Our number; None if it could not be computed.
        holds: Least and greatest value for which the claim holds.
    """
    if number is None:
        return "failed"
    low, high = holds
    if low <= number.low and number.high <= high:
        return "reproduced"
    return "refuted" if number.high < low or number.low > high else "undecided"


def read_claims(path: Path) -> dict[str, Claim]:
    """The claims of a source, by name, in its order.

    Args:
        path: A file of YAML: names with the attributes of `Claim`, but ``holds`` is a rule with its numbers
            (``{near: [333, 25]}``), ``ours`` a run, a statistic and options (``[figure-2.12, error [mm]]``),
            and ``readings`` has one such list for each reading of an ambiguous text.
    """
    return {name: _claim(name, **given) for name, given in load_yaml(path).items()}


def _claim(
    name: str,
    where: Sequence[str],
    holds: Mapping[str, Sequence[float]] = MappingProxyType({}),
    ours: Sequence[Any] = (),
    readings: Mapping[str, Sequence[Any]] = MappingProxyType({}),
    **given: Any,
) -> Claim:
    ranges = [RULES[rule](*numbers) for rule, numbers in holds.items()]
    numbers = Ours(*ours) if ours else {reading: Ours(*one) for reading, one in readings.items()}
    return Claim(name, tuple(where), holds=ranges[0] if ranges else ANY, ours=numbers, **given)


def near(value: float, tolerance: float) -> tuple[float, float]:
    """Values that differ from a printed one by at most a tolerance."""
    return value - tolerance, value + tolerance


def times(value: float, factor: float) -> tuple[float, float]:
    """Values that differ from a printed positive one by at most a factor."""
    return value / factor, value * factor


def at_least(value: float) -> tuple[float, float]:
    """Values from a printed one upward."""
    return value, math.inf


def at_most(value: float) -> tuple[float, float]:
    """Values up to a printed one."""
    return -math.inf, value


RULES: Mapping[str, Callable[..., tuple[float, float]]] = {
    "near": near, "times": times, "at least": at_least, "at most": at_most,
    "between": lambda low, high: (low, high),
}  # fmt: skip
"""What a file of claims may say of our number."""


def _digits(value: float) -> str:
    return f"{value:.4g}"
