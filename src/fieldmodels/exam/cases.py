"""The cases of the exam: what is hidden, how large, and with which seed."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Literal
from zlib import crc32

import numpy as np

from fieldmodels.exam.benchmarks import Benchmark, get_benchmark
from fieldmodels.model import ModelError
from fieldmodels.names import did_you_mean

Kind = Literal["single", "pair", "nothing", "outside"]
KINDS: tuple[Kind, ...] = ("single", "pair", "nothing", "outside")
PERCENTS = {"moderate": (10.0, 40.0), "hard": (3.0, 10.0)}
"""What an effect adds to the held-out error of the refitted nominal model [%]; each case draws one."""
DEVELOPMENT = 1_000
"""First of the seeds on which rules and thresholds of the diagnosis were chosen (1000 to 9999)."""
REPORTED = 50_000
"""First of the seeds that are reported (from 50000): nothing was chosen on them."""
PAIRS, NOTHING, OUTSIDE = 10, 15, 1.5
"""Cases for each seed of the single effects: pairs a model; records without a fault a model, with white noise
and as many with coloured; seeds a fault from outside."""


@dataclass(frozen=True)
class Case:
    """One case of the exam.

    Attributes:
        model: Name of the model.
        kind: ``single``, ``pair``, ``nothing`` or ``outside``.
        size: ``moderate`` or ``hard``; of ``nothing`` the noise, ``white`` or ``coloured``.
        hidden: Names of the hidden effects, or of the fault from outside.
        seed: Of the excitation, the noise, the percentages and the signs.
        without: Outputs of the model that are not measured.
    """

    model: str
    kind: Kind
    size: str
    hidden: tuple[str, ...]
    seed: int
    without: tuple[str, ...] = ()

    @property
    def key(self) -> str:
        """Unique name of the case."""
        return "/".join([self._drawn_by, *(f"without {name}" for name in self.without)])

    @property
    def _drawn_by(self) -> str:
        """What the draws depend on: a case with fewer sensors hides the same."""
        return f"{self.model}/{self.kind}/{self.size}/{'+'.join(self.hidden) or '-'}/{self.seed}"

    def rng(self) -> np.random.Generator:
        """Source of what the case draws beside its records."""
        return np.random.default_rng([self.seed, crc32(self._drawn_by.encode())])

    def drawn(self) -> list[tuple[str, float, int]]:
        """Each hidden fault with the percentage that it shall add and the sign of its direction."""
        if self.kind == "nothing":
            return []
        rng, limits = self.rng(), PERCENTS[self.size]
        return [(name, float(rng.uniform(*limits)), int(rng.choice([-1, 1]))) for name in self.hidden]

    def to_json(self) -> dict[str, Any]:
        """As plain data."""
        return {
            "key": self.key,
            "model": self.model,
            "kind": self.kind,
            "size": self.size,
            "hidden": list(self.hidden),
            "seed": self.seed,
            "without": list(self.without),
        }


def cases_of(
    models: Iterable[str], kinds: Iterable[str], seeds: int, first: int, without: Iterable[str] = ()
) -> list[Case]:
    """The cases of some models.

    Args:
        models: Names of the models.
        kinds: Which kinds.
        seeds: Seeds of each single effect and size; the other kinds follow in proportion.
        first: First seed.
        without: Outputs that are not measured; each model leaves out those that it has.

    Raises:
        ModelError: For a model that has no benchmark, a kind that there is none of, or an output that none of
            the models can do without.
    """
    chosen = list(kinds)
    for kind in chosen:
        if kind not in _OF_KIND:
            raise ModelError(f"no cases of kind {kind!r}{did_you_mean(kind, _OF_KIND)}")
    benchmarks = [get_benchmark(name) for name in dict.fromkeys(models)]
    missing = tuple(dict.fromkeys(without))
    known = {output.name for one in benchmarks for output in one.model.outputs}
    for name in missing:
        if name not in known:
            raise ModelError(f"no output {name!r} to leave out{did_you_mean(name, sorted(known))}")
    cases = []
    for benchmark in benchmarks:
        own = tuple(name for name in missing if name in {output.name for output in benchmark.model.outputs})
        cases += [replace(case, without=own) for case in all_cases(benchmark, chosen, seeds, first)]
    return cases


def all_cases(benchmark: Benchmark, kinds: Iterable[str], seeds: int, first: int) -> list[Case]:
    """The cases of one model.

    Args:
        benchmark: The model's benchmark.
        kinds: Which kinds.
        seeds: Seeds of each single effect and size; the other kinds follow in proportion.
        first: First seed.
    """
    return [case for kind in kinds for case in _OF_KIND[kind](benchmark, seeds, first)]


def _singles(benchmark: Benchmark, seeds: int, first: int) -> Iterator[Case]:
    for size in PERCENTS:
        for effect in benchmark.model.effects:
            for k in range(seeds):
                yield Case(benchmark.name, "single", size, (effect.name,), first + k)


def _pairs(benchmark: Benchmark, seeds: int, first: int) -> Iterator[Case]:
    """Pairs drawn without replacement, then anew with the next seed."""
    names = [effect.name for effect in benchmark.model.effects]
    possible = [
        pair
        for pair in itertools.combinations(names, 2)
        if frozenset(pair) not in benchmark.indistinguishable
    ]
    order: list[int] = []
    for number in range(PAIRS * seeds):
        if not order:
            again = number // len(possible)
            order = list(np.random.default_rng([first, again]).permutation(len(possible)))
        yield Case(
            benchmark.name, "pair", "moderate", possible[order.pop()], first + 100 + number // len(possible)
        )


def _nothing(benchmark: Benchmark, seeds: int, first: int) -> Iterator[Case]:
    for noise in ("white", "coloured"):
        for k in range(NOTHING * seeds):
            yield Case(benchmark.name, "nothing", noise, (), first + 200 + k)


def _outside(benchmark: Benchmark, seeds: int, first: int) -> Iterator[Case]:
    for fault in benchmark.outside:
        for k in range(math.ceil(OUTSIDE * seeds)):
            yield Case(benchmark.name, "outside", "moderate", (fault,), first + 700 + k)


_OF_KIND: dict[str, Callable[[Benchmark, int, int], Iterator[Case]]] = {
    "single": _singles,
    "pair": _pairs,
    "nothing": _nothing,
    "outside": _outside,
}
