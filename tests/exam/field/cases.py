"""The cases of the field set: a kind, a machine, a seed and a size each; and their records.

``python -m exam.field.cases`` finds the sizes that ``sizes.json`` lacks.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from zlib import crc32

import numpy as np

from fieldmodels.model import Model
from fieldmodels.recording import Recording

from .kinds import KINDS
from .machines import model_of
from .plants import NOTHING, Array
from .runs import Run, Way

KEPT = Path(__file__).parent / "sizes.json"
"""Size of each case's fault, and a factor on its noise."""
SETS = "develop", "report"
LEAST = 10
"""Cases of a kind, at least."""
APART = 1000
"""Between the first seeds of draws."""
USUAL, LARGE = (0.13, 0.36), (1.2, 8.0)
"""Between which shares each case draws what its fault adds to the error."""


@dataclass(frozen=True)
class FieldCase:
    """One case.

    Attributes:
        kind: Of ``kinds.KINDS``.
        machine: Its name.
        seed: Of the machine, its commands and the noise.
        size: ``usual``, ``large`` or ``none``.
    """

    kind: str
    machine: str
    seed: int
    size: str

    @property
    def key(self) -> str:
        """Name of the case."""
        return f"{self.machine}/{self.kind}/{self.size}/{self.seed}"

    @property
    def set(self) -> str:
        """``develop`` or ``report``, as the kind's name has it."""
        return set_of(self.kind)

    @property
    def way(self) -> Way:
        """How it is made."""
        return next(way for way in KINDS[self.kind] if way.machine == self.machine)

    @property
    def wanted(self) -> float:
        """What its fault shall add to the error, as a share of it."""
        if self.way.ratio:
            return self.way.ratio - 1.0
        low, high = USUAL if self.size == "usual" else LARGE
        share = crc32(self.key.encode()) % 997 / 997.0
        return low * math.pow(high / low, share)


@dataclass(frozen=True)
class Made:
    """What a diagnosis is given, and what is known of it.

    Attributes:
        model: The model.
        fixed: Base parameters that a user knows.
        train: Records to fit.
        test: Records to test on.
        third: Records of the same machine that nobody is shown.
        possible: Error of a perfect model on them, by output.
        nats: Evidence for the fault in the records to fit, for a filter that knows all else.
        truth: Values of listed parameters.
    """

    model: Model
    fixed: Mapping[str, float]
    train: tuple[Recording, ...]
    test: tuple[Recording, ...]
    third: tuple[Recording, ...]
    possible: Mapping[str, float]
    nats: float
    truth: Mapping[str, float]


def set_of(kind: str) -> str:
    """In which set a kind is."""
    return SETS[crc32(kind.encode()) % 2]


def field_cases(which: str, kinds: Iterable[str] = (), fresh: int = 0) -> list[FieldCase]:
    """The cases of a set.

    Args:
        which: ``develop`` or ``report``.
        kinds: Which kinds; by default all of the set.
        fresh: 0 for those whose figures are published; another number draws other machines and noise.
    """
    chosen = [kind for kind in (list(kinds) or KINDS) if set_of(kind) == which]
    return [
        FieldCase(kind, way.machine, APART * fresh + seed, size)
        for kind in chosen
        for way in KINDS[kind]
        for seed in range(math.ceil(LEAST / (len(_sizes(way)) * len(KINDS[kind]))))
        for size in _sizes(way)
    ]


def _sizes(way: Way) -> tuple[str, ...]:
    if way.fault is NOTHING or way.fault == NOTHING:
        return ("none",)
    return ("large",) if way.ratio else ("usual", "large")


def make(case: FieldCase) -> Made:
    """Record a case."""
    way = case.way
    size, louder = _size(case)
    way = replace(way, form=replace(way.form, louder=louder * way.form.louder))
    run = Run(way, case.kind, case.seed)
    p, model = run.numbers, model_of(case.machine)
    files, possible, nats = list[tuple[Recording, ...]](), np.zeros(0), 0.0
    for record, name in enumerate(("train", "test", "third")):
        log, noise = run.log(record, [size])
        made, possible = way.form.recordings(way.plant, log, noise, run.rng(record, 1), name, way.only)
        files.append(tuple(made))
        if record == 0 and case.size != "none":
            led = (way.form.control or way.plant.control) is not None
            nats = run.shown(log) if led else _change(run, log.shown)
    outputs = zip(way.plant.outputs, possible.tolist(), strict=True)
    train, test, third = files
    outputs = zip(way.plant.outputs, possible.tolist(), strict=True)
    return Made(
        model=model,
        fixed={name: float(getattr(p, name)) for name in way.fixed},
        train=train,
        test=test,
        third=third,
        possible={name: error for name, error in outputs if not way.only or name in way.only},
        nats=nats,
        truth={name.replace("__", "."): float(of(size, p)) for name, of in way.fault.truth.items()},
    )


def _change(run: Run, shown: Array) -> float:
    """Half the squared change of all samples by the fault, in noise [nats]."""
    without, _ = run.log(0, [1.0], NOTHING)
    finer = (len(shown) - 1) // len(without.commands)
    change = (shown - without.shown)[:-1:finer] / run.deviations[:, None]
    return 0.5 * float(np.sum(change**2))


def _size(case: FieldCase) -> tuple[float, float]:
    """Size of its fault and factor on its noise, from the file or found now."""
    if case.size == "none":
        return 1.0, 1.0
    kept = json.loads(KEPT.read_text()) if KEPT.exists() else {}
    if case.key in kept:
        return tuple(kept[case.key])
    return Run(case.way, case.kind, case.seed).sized([case.wanted])[0]


def find_sizes(kinds: Iterable[str] = (), again: bool = False) -> None:
    """Find the sizes that the file lacks, those of one machine and seed together, and keep them."""
    kept = json.loads(KEPT.read_text()) if KEPT.exists() else {}
    groups: dict[tuple[str, str, int], list[FieldCase]] = {}
    for case in (case for which in SETS for case in field_cases(which, kinds)):
        if case.size != "none" and (again or case.key not in kept):
            groups.setdefault((case.kind, case.machine, case.seed), []).append(case)
    for (kind, _, seed), cases in groups.items():
        try:
            found = Run(cases[0].way, kind, seed).sized([case.wanted for case in cases])
        except ValueError as error:
            print(error, flush=True)
            continue
        kept |= {c.key: [float(f"{v:.5g}") for v in one] for c, one in zip(cases, found, strict=True)}
        lines = (f"{json.dumps(key)}: {json.dumps(size)}" for key, size in sorted(kept.items()))
        KEPT.write_text("{\n" + ",\n".join(lines) + "\n}\n")


if __name__ == "__main__":
    import sys

    find_sizes(sys.argv[1:])
