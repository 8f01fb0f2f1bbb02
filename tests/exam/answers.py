"""What a diagnosis answers, as the exam needs it: the only place of the exam that knows its result."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from exam.delivery import Delivery, Stated, deliver
from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.options import DEFAULT, DiagnosisOptions
from fieldmodels.diagnosis.outcome import Diagnosis
from fieldmodels.diagnosis.phrases import CHANCE
from fieldmodels.diagnosis.phrases import CURVE as CURVE_OF
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
        curves: Place, target and variable of each curve that it states as missing, alone or as what a name
            may be.
        stated: Probability, it says, that all is missing that it states; None if it states nothing.
        delivery: What its extended simulation does on a third record; None without one.
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
    curves: tuple[tuple[str, str, str], ...] = ()
    stated: float | None = None
    delivery: Delivery | None = None


def ask(
    model: Model,
    train: Sequence[Recording],
    test: Sequence[Recording],
    fixed: Mapping[str, float],
    third: Sequence[Recording] = (),
    options: DiagnosisOptions = DEFAULT,
) -> Answer:
    """Diagnose, read the result, and run what is delivered on a third record."""
    began = time.process_time()  # of one thread: other work on the machine does not count
    found = diagnose(model, train, test, fixed=fixed, options=options)
    answer = read(model, found, time.process_time() - began)
    return replace(answer, delivery=deliver(model, Stated.by(found), third)) if third else answer


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
        curves=(
            *(one for c in found.curves if c.found for one in ((c.place, c.target, c.over), *c.alternatives)),
            *(_curve_of(e) for c in found.causes for e in c.alternatives if e.startswith(CURVE_OF)),
        ),
        stated=_stated(found),
    )


def _curve_of(words: str) -> tuple[str, str, str]:
    """Place, target and variable of a curve in words; see ``variables.direction_of``."""
    over, _, where = words.removeprefix(CURVE_OF).partition(", in ")
    for place, begins in (("sensor", "the sensor of "), ("odds", "the log-odds of "), ("force", "the ")):
        if where.startswith(begins):
            return place, where.removeprefix(begins), over
    return ("parameter", where.replace(" ", "_"), over) if where else ("force", "", over)


def _stated(found: Diagnosis) -> float | None:
    """Probability that none of the causes and curves is there by chance alone; unknown ones count as one."""
    chances = [c.chance for c in found.causes] + [c.p_value for c in found.curves if c.found]
    return math.prod(1.0 - c for c in chances if math.isfinite(c)) if chances else None
