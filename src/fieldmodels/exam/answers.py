"""What a diagnosis answers, as the exam needs it: the only place of the exam that knows its result."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.outcome import Diagnosis
from fieldmodels.diagnosis.phrases import CHANCE
from fieldmodels.model import Model
from fieldmodels.recording import Recording

CURVE = "a curve"
"""Stands for a cause that is a curve which no list contains."""


@dataclass(frozen=True)
class Answer:
    """What a diagnosis says of two records.

    Attributes:
        verdict: In its own word.
        named: Each cause with what it says cannot be told from it; curves are called ``CURVE``.
        missing: Whether it says that something is missing beyond what it names, or that samples are.
        values: Fitted values and standard errors of the named effects' parameters.
        errors: Error of each output before and after, curves included, on the second record.
        by_horizon: The same on windows of several lengths [s]: length, before, after.
        curve: Whether it shows a curve for which the data certainly call, those of the second record, too.
        wandering: Sensors whose zeros wander, it says.
        seen: Of each output, the largest error that a curve may add of which it says it would just be seen.
        unseen: Of each output, the most that anything may add to its error, it says.
        windows: Of each output, how long the windows are on which its error is measured [s].
        seconds: Processor time of one thread.
        summary: In its own words.
    """

    verdict: str
    named: tuple[tuple[str, ...], ...]
    missing: bool
    values: Mapping[str, Mapping[str, tuple[float, float]]]
    errors: Mapping[str, tuple[float, float]]
    seconds: float
    summary: str
    by_horizon: Mapping[str, tuple[tuple[float, float, float], ...]] = field(default_factory=dict)
    curve: bool = False
    wandering: tuple[str, ...] = ()
    seen: Mapping[str, float] = field(default_factory=dict)
    unseen: Mapping[str, float] = field(default_factory=dict)
    windows: Mapping[str, float] = field(default_factory=dict)


def ask(
    model: Model, train: Sequence[Recording], test: Sequence[Recording], fixed: Mapping[str, float]
) -> Answer:
    """Diagnose, and read the result."""
    began = time.process_time()  # of one thread: other work on the machine does not count
    found = diagnose(model, train, test, fixed=fixed)
    return read(model, found, time.process_time() - began)


def read(model: Model, found: Diagnosis, seconds: float) -> Answer:
    """Read the result of a diagnosis."""
    listed = {effect.name for effect in model.effects}

    def name(effect: str) -> str:
        return CURVE if effect not in listed and ("curve" in effect or effect.startswith(CHANCE)) else effect

    return Answer(
        verdict=found.verdict,
        named=tuple(tuple(name(e) for e in (cause.effect, *cause.alternatives)) for cause in found.causes),
        missing=found.unknown is not None or bool(found.lost),
        values={
            cause.effect: {p: (e.value, e.std) for p, e in cause.parameters.items()} for cause in found.causes
        },
        errors={output: (gain.rmse_before, gain.rmse_with_curves) for output, gain in found.gain.items()},
        seconds=seconds,
        summary=found.summary(),
        by_horizon={
            output: tuple((row.horizon, row.rmse_before, row.rmse_after) for row in gain.horizons)
            for output, gain in found.gain.items()
        },
        curve=found.unknown is not None and found.unknown.found,
        wandering=tuple(found.wandering),
        seen={
            output: max(one.errors[output] for one in found.seen if output in one.errors)
            for output in found.gain
            if any(output in one.errors for one in found.seen)
        },
        unseen=dict(found.unseen),
        windows={output: gain.horizon for output, gain in found.gain.items()},
    )
