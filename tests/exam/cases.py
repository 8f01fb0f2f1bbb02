"""The cases of the exam: what is hidden in which machine, under what conditions, and with which seed."""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, Literal
from zlib import crc32

import numpy as np

from exam.benches import FIRST, Bench, Conditions, Set, bench_names, get_bench
from exam.logs import STATEMENTS
from fieldmodels.model import ModelError
from fieldmodels.names import did_you_mean

Kind = Literal["nothing", "single", "pair", "triple", "unlisted", "mixed", "growing", "log"]
PERCENTS = (13.0, 36.0)
"""Between which percentages each case draws what a fault adds."""
LENGTHS = (10.0, 20.0, 40.0, 80.0)
"""How much of a record is given, in cases of growing length [s]."""
SEEDS, PAIRS, TRIPLES, MIXED, GROWING = 2, 30, 16, 30, 6
"""Seeds of each null, effect and fault; pairs, triples, effects beside an unlisted fault, and growing records
of each machine."""
SHARES: Mapping[str, float] = MappingProxyType({
    "nothing": 0.3, "single": 0.3, "triple": 0.15, "unlisted": 0.09, "pair": 0.05, "growing": 0.05,
    "mixed": 0.04, "log": 0.02,
})  # fmt: skip
"""Of a sample: rates of a percent, of nulls and of wrong singles, need hundreds of cases."""


APART = 1_000_000
"""Between the first seeds of draws of a set."""


@dataclass(frozen=True)
class Draw:
    """Cases of a set, drawn once.

    Attributes:
        set: The set, which says what may be hidden.
        first: The first of its seeds.
    """

    set: Set
    first: int


@dataclass(frozen=True)
class Case:
    """One case of the exam.

    Attributes:
        set: ``develop`` or ``report``.
        machine: Name of the model.
        kind: What sort of case it is.
        hidden: Listed effects, or the fault that is not listed, or one of each; the name of a real log.
        seed: Of the machine, its excitation, the noise and what the case draws.
        conditions: Of the records.
    """

    set: Set
    machine: str
    kind: Kind
    hidden: tuple[str, ...]
    seed: int
    conditions: Conditions

    def to_json(self) -> dict[str, Any]:
        """As plain data."""
        return {
            "set": self.set,
            "machine": self.machine,
            "kind": self.kind,
            "hidden": list(self.hidden),
            "seed": self.seed,
            "conditions": self.conditions.to_json(),
        }

    @property
    def key(self) -> str:
        """Name of the case, with a hash of all that it is."""
        digest = hashlib.sha256(json.dumps(self.to_json(), sort_keys=True).encode()).hexdigest()[:8]
        return f"{self.machine}/{self.kind}/{'+'.join(self.hidden) or '-'}/{self.seed}/{digest}"

    def drawn(self) -> list[tuple[str, float, int]]:
        """Each hidden fault with the percentage that it shall add and the sign of its direction."""
        rng = np.random.default_rng([self.seed, crc32("+".join(self.hidden).encode()), 9])
        return [(name, float(rng.uniform(*PERCENTS)), int(rng.choice([-1, 1]))) for name in self.hidden]


def cases_of(
    which: Set,
    machines: Iterable[str],
    kinds: Iterable[str] = (),
    count: int | None = None,
    fresh: int = 0,
) -> list[Case]:
    """The cases of a set.

    Args:
        which: ``develop`` or ``report``.
        machines: Names of the machines.
        kinds: Which kinds; all by default.
        count: How many at most: a sample with the shares of every kind in ``SHARES``, equally of every
            machine, as far as there are any.
        fresh: 0 for the cases whose rates are published; another number draws others that hide the same, and
            the numbers after it more, as far as ``count`` asks for them.

    Raises:
        ModelError: For a set or a kind that there is none of, or a machine that is not examined.
    """
    if which not in FIRST:
        raise ModelError(f"no set {which!r}{did_you_mean(which, FIRST)}")
    chosen = list(kinds) or list(KINDS)
    for kind in chosen:
        if kind not in KINDS:
            raise ModelError(f"no kind of cases {kind!r}{did_you_mean(kind, KINDS)}")
    names = list(dict.fromkeys(machines))
    of_kind = {kind: _of_draw(which, kind, names, fresh) for kind in chosen}
    numbers = {kind: len(cases) for kind, cases in of_kind.items()}
    if count is None:
        return [case for cases in of_kind.values() for case in cases]
    if not fresh:
        numbers = _quotas(numbers, count)
    else:
        numbers = _quotas({kind: count if n and kind != "log" else n for kind, n in numbers.items()}, count)
        for kind, cases in of_kind.items():
            for more in itertools.count(fresh + 1):
                if len(cases) >= numbers[kind]:
                    break
                cases += _of_draw(which, kind, names, more)
    return [case for kind, cases in of_kind.items() for case in cases[: numbers[kind]]]


def _of_draw(which: Set, kind: str, machines: Sequence[str], number: int) -> list[Case]:
    """Cases of a kind in a draw, of every machine in turn."""
    draw = Draw(which, FIRST[which] + APART * number)
    return _in_turns([_grouped(_made(kind, name, draw)) for name in machines])


def examined() -> tuple[str, ...]:
    """Names of the machines that have a bench or a real log."""
    return tuple(dict.fromkeys([*bench_names(), *(s.machine for s in STATEMENTS.values())]))


def _made(kind: str, machine: str, draw: Draw) -> Iterator[Case]:
    """Cases of a kind on a machine; one without a bench has real logs alone."""
    if machine in bench_names() or machine not in examined():
        return KINDS[kind](get_bench(machine), draw)
    return _logs(machine, draw) if kind == "log" else iter(())


def _in_turns(lists: Sequence[Sequence[list[Case]]]) -> list[Case]:
    """Groups of several machines, one of each in turn."""
    return [case for row in itertools.zip_longest(*lists) for group in row if group for case in group]


def _quotas(there: Mapping[str, int], count: int) -> dict[str, int]:
    """How many cases of each kind make a sample; what a kind does not have goes to the others."""
    quotas = dict.fromkeys(there, 0)
    for _ in range(min(count, sum(there.values()))):
        left = [kind for kind in there if quotas[kind] < there[kind]]
        # The one that is furthest behind its share.
        quotas[min(left, key=lambda kind: (quotas[kind] + 0.5) / SHARES[kind])] += 1
    return quotas


def _grouped(cases: Iterator[Case]) -> list[list[Case]]:
    """Cases that belong together (beginnings of one record), in an order whose first ones are a sample."""
    groups: dict[str, list[Case]] = {}
    for case in cases:
        same = replace(case, conditions=replace(case.conditions, cut=0.0))
        groups.setdefault(same.key, []).append(case)
    return [groups[key] for key in sorted(groups, key=lambda key: crc32(key.encode()))]


def _rng(bench: Bench, draw: Draw, kind: str) -> np.random.Generator:
    return np.random.default_rng([draw.first, crc32(f"{bench.name}/{kind}".encode())])


def _nothing(bench: Bench, draw: Draw) -> Iterator[Case]:
    number = itertools.count(draw.first)
    for _ in range(SEEDS):
        for conditions in bench.nothing():
            yield Case(draw.set, bench.name, "nothing", (), next(number), conditions)


def _sets(
    bench: Bench, draw: Draw, kind: Kind, sets: Sequence[tuple[str, ...]], first: int
) -> Iterator[Case]:
    """Cases that hide these effects."""
    rng = _rng(bench, draw, kind)
    for number, names in enumerate(sets):
        yield Case(draw.set, bench.name, kind, names, draw.first + first + number, bench.usual(rng, names))


def _singles(bench: Bench, draw: Draw) -> Iterator[Case]:
    return _sets(bench, draw, "single", [(name,) for name in bench.effects] * SEEDS, 1_000)


def _drawn(bench: Bench, draw: Draw, kind: Kind, size: int, count: int) -> list[tuple[str, ...]]:
    """Sets of effects that can be told apart, drawn without replacement."""
    possible = [
        names
        for names in itertools.combinations([e for e in bench.effects if e not in bench.needs_base], size)
        if not any(frozenset(pair) in bench.alike for pair in itertools.combinations(names, 2))
    ]
    order = _rng(bench, draw, f"{kind} drawn").permutation(len(possible))
    return [possible[i] for i in order[:count]]


def _pairs(bench: Bench, draw: Draw) -> Iterator[Case]:
    return _sets(bench, draw, "pair", _drawn(bench, draw, "pair", 2, PAIRS), 2_000)


def _triples(bench: Bench, draw: Draw) -> Iterator[Case]:
    return _sets(bench, draw, "triple", _drawn(bench, draw, "triple", 3, TRIPLES), 3_000)


def _unlisted(bench: Bench, draw: Draw) -> Iterator[Case]:
    rng, number = _rng(bench, draw, "unlisted"), itertools.count(draw.first + 4_000)
    for _ in range(SEEDS):
        for name in bench.unlisted[draw.set]:
            conditions = bench.usual(rng, (name,))
            yield Case(draw.set, bench.name, "unlisted", (name,), next(number), conditions)


def _mixed(bench: Bench, draw: Draw) -> Iterator[Case]:
    """A listed effect beside a fault that is not listed, as drawn."""
    rng = _rng(bench, draw, "mixed drawn")
    effects = [name for name in bench.effects if name not in bench.needs_base]
    unlisted = list(bench.unlisted[draw.set])
    sets = [(str(rng.choice(effects)), str(rng.choice(unlisted))) for _ in range(MIXED)]
    return _sets(bench, draw, "mixed", sets, 7_000)


def _growing(bench: Bench, draw: Draw) -> Iterator[Case]:
    """Longer and longer beginnings of one record; half of them with a fault that is not listed."""
    rng = _rng(bench, draw, "growing")
    steady = [name for name in bench.steady if name in bench.effects]
    unlisted = [name for name, fault in bench.unlisted[draw.set].items() if not fault.random]
    half = GROWING // 2
    chosen = [*rng.choice(steady, half, replace=False), *rng.choice(unlisted, half, replace=False)]
    for number, name in enumerate(chosen):
        for cut in LENGTHS:
            conditions = Conditions(duration=LENGTHS[-1] * bench.usual_length, cut=cut * bench.usual_length)
            yield Case(draw.set, bench.name, "growing", (str(name),), draw.first + 5_000 + number, conditions)


def _logs(machine: str, draw: Draw) -> Iterator[Case]:
    """Statements on real logs; the same in both sets, as there is nothing to draw."""
    for number, (name, statement) in enumerate(STATEMENTS.items()):
        if statement.machine == machine:
            yield Case(draw.set, machine, "log", (name,), draw.first + 6_000 + number, Conditions())


KINDS: dict[str, Callable[[Bench, Draw], Iterator[Case]]] = {
    "nothing": _nothing,
    "single": _singles,
    "pair": _pairs,
    "triple": _triples,
    "unlisted": _unlisted,
    "mixed": _mixed,
    "growing": _growing,
    "log": lambda bench, draw: _logs(bench.name, draw),
}
