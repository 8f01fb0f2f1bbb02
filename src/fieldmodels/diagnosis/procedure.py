"""The diagnosis from end to end: fit, selection, gain, unmodelled dynamics, verdict."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from fieldmodels.diagnosis.averages import resolving
from fieldmodels.diagnosis.beside_curves import names_beside
from fieldmodels.diagnosis.budget import Budget
from fieldmodels.diagnosis.candidates import Candidates
from fieldmodels.diagnosis.causes import (
    beside_the_others,
    causes_of,
    confirmed,
    confirmed_elsewhere,
    path_to,
    quantisation_found,
    told_from_neutral,
    with_alternatives,
)
from fieldmodels.diagnosis.curves import Scored
from fieldmodels.diagnosis.cutting import (
    check_range,
    excerpts,
    in_all,
    known_values,
    long_enough,
    main_horizon,
    split,
    start_vector,
    without_command,
)
from fieldmodels.diagnosis.delivered import Writer
from fieldmodels.diagnosis.effort import metered
from fieldmodels.diagnosis.evidence import collect
from fieldmodels.diagnosis.extension import improving
from fieldmodels.diagnosis.found import Found
from fieldmodels.diagnosis.found_by_evidence import found_by_evidence
from fieldmodels.diagnosis.gain import predict
from fieldmodels.diagnosis.informative import evenly, informative
from fieldmodels.diagnosis.inputs import decided
from fieldmodels.diagnosis.lost import lost_samples
from fieldmodels.diagnosis.next_measurement import next_measurement
from fieldmodels.diagnosis.noise_weighting import weighted_by_noise
from fieldmodels.diagnosis.options import DEFAULT, DiagnosisOptions
from fieldmodels.diagnosis.outcome import Diagnosis
from fieldmodels.diagnosis.power import visible
from fieldmodels.diagnosis.problem import Problem
from fieldmodels.diagnosis.relation import CERTAIN, is_unrelated
from fieldmodels.diagnosis.residuals import failed_tests
from fieldmodels.diagnosis.result import (
    Cause,
    Verdict,
)
from fieldmodels.diagnosis.selection import exchanged, rivals_of, select
from fieldmodels.diagnosis.signs import error, mistaken_columns, refitted_to_some
from fieldmodels.diagnosis.simulated import that_keep_their_promise, without_imitators
from fieldmodels.diagnosis.stages import Progress, held, joined, scaled_progress
from fieldmodels.diagnosis.statements import (
    above_noise,
    bounded,
    gains,
    not_testable,
    poorly_known,
    ranking,
)
from fieldmodels.diagnosis.together import told_together
from fieldmodels.diagnosis.verdict import (
    far_from_noise,
    judge,
    most_likely,
    mostly_explained,
    unjudged,
    verdict_of,
)
from fieldmodels.diagnosis.wander import wander, wandering_zeros
from fieldmodels.diagnosis.whole import LONGER, WholeRecords
from fieldmodels.model import Model, check_instance
from fieldmodels.recording import Recording, RecordingError, check_apart, check_recordings, once

UNTOLD = (
    "command and response were moved against each other until they agree; log both by one clock to test it"
)


def diagnose(
    model: Model,
    train: Sequence[Recording],
    test: Sequence[Recording] = (),
    fixed: Mapping[str, float] | None = None,
    progress: Callable[[str, float], None] | None = None,
    seed: int = 0,
    options: DiagnosisOptions = DEFAULT,
    budget: float | None = None,
    window: Literal["record"] | None = None,
) -> Diagnosis:
    """Find what a simulation gets wrong, name the cause or report it as unknown, and measure the gain.

    Args:
        model: The simulation, with the effects that may be missing from it.
        train: Recordings for fits and selection.
        test: Separate recordings to measure the gain on; without them a part of ``train`` is held out.
        fixed: Values of parameters that are known and not refitted, by full name; they take precedence
            over values that the recordings state.
        progress: Called with the current step and the share done.
        seed: Seed of the resampling for confidence intervals.
        options: Thresholds and prices.
        budget: Time [s] after which the best verdict so far is given, with what was left out for it
            (``Diagnosis.stopped``); without one no result depends on the clock.
        window: "record" to run through each episode from one start, instead of starting each window anew; by
            default as the model says (``Model.whole_records``).

    Returns:
        Verdict, causes with parameters and gains, unmodelled dynamics, and evidence for the report.

    Raises:
        ModelError: For an unknown or impossible fixed value, or a class in place of a model.
        RecordingError: If there are too few data or none, one is given twice, or what is given is no list.
        ValueError: If the budget is no positive time.
    """
    check_instance(model)
    check_recordings(train, "train")
    check_recordings(test, "test")
    check_apart(train, test)
    began = time.perf_counter()
    with metered() as meter:
        result = _diagnosed(model, train, test, fixed or {}, progress, seed, options, Budget(budget), window)
    simulations = meter.windows / max(result.windows[0], 1)
    return replace(result, simulations=simulations, seconds=time.perf_counter() - began)


def _diagnosed(
    model: Model,
    train: Sequence[Recording],
    test: Sequence[Recording],
    known: Mapping[str, float],
    progress: Callable[[str, float], None] | None,
    seed: int,
    options: DiagnosisOptions,
    time_left: Budget,
    window: Literal["record"] | None,
) -> Diagnosis:
    """Diagnose stage by stage; arguments as of ``diagnose``."""
    report = progress or (lambda _what, _share: None)
    if not train:
        raise RecordingError("no recording to diagnose; give at least one")
    check_range(model, [*train, *test])
    train, test, lacking = in_all(model, train, test)
    train, test, short = long_enough(model, train, test)
    train, test, lost = lost_samples(model, train, test)
    silent = without_command(model, [*train, *test], known)
    delays = {e.name: UNTOLD for e in model.effects if e.name.endswith("_delay")}
    delays = delays if any(r.aligned for r in (*train, *test)) else {}
    untold = {f"{name}.{p.name}": p.nominal for name in delays for p in model.effect(name).parameters}
    fixed = {**untold, **known_values(model, [*train, *test]), **known}
    few = excerpts(model, train)
    model, said = decided(model, few, main_horizon, lambda one: start_vector(one, fixed), frozenset(fixed))
    if window == "record" or model.whole_records:
        model = WholeRecords(model)
    stages = model.stages([*train, *test])
    whole = joined(
        model,
        [
            _diagnose_stage(
                stage.model,
                train,
                test,
                {**known_values(stage.model, ()), **held(stage), **fixed},
                scaled_progress(report, number, len(stages)),
                seed,
                options,
                time_left,
            )
            for number, stage in enumerate(stages)
        ],
    )
    notes = once(f"{r.source}: {note}" for r in (*train, *test) for note in r.notes)
    reasons = {**whole.not_testable, **delays}
    if silent:
        idle = {e.name for e in model.effects if e.where == "actuator"}
        reasons = {name: "nothing is commanded" if name in idle else why for name, why in reasons.items()}
    return replace(
        whole,
        not_testable=reasons,
        notes=(*silent, *said, *lacking, *short, *lost, *notes, *whole.notes),
        lost=lost,
        stopped=time_left.words(),
    )


def _diagnose_stage(
    model: Model,
    train: Sequence[Recording],
    test: Sequence[Recording],
    fixed: Mapping[str, float],
    report: Progress,
    seed: int,
    options: DiagnosisOptions,
    budget: Budget,
) -> Diagnosis:
    """Diagnose one stage by itself; arguments as of ``diagnose``."""
    start = start_vector(model, fixed)
    model = model.scaled_to([*train, *test])
    report("cutting the data into windows", 0.0)
    training, testing = weighted_by_noise(*split(model, train, test), start)
    candidates = Candidates(
        problem=training,
        start=start,
        fixed=frozenset(fixed),
        folds=training.folds,
        whitener=np.diag(1 / training.output_scale),
        options=options,
        budget=budget,
    )
    if bins := _finer_averages(candidates, lambda bins: split(model, train, test, bins)[0]):
        training, testing = weighted_by_noise(*split(model, train, test, bins), start)
        candidates = replace(candidates.of(training), whitener=np.diag(1 / training.output_scale))
    rng = np.random.default_rng(seed)
    report("choosing windows", 0.02)
    training, said = informative(candidates)
    if training is not candidates.problem:
        candidates = candidates.of(training)
    testing, measured = evenly(testing, options.rows)
    search = found_by_evidence if options.engine == "evidence" else _found
    found = search(candidates, train, testing, report, rng)
    result = _stated(candidates, testing, found, fixed, rng)
    report("done", 1.0)
    return replace(
        result,
        trained_on=tuple(r.source for r in train),
        tested_on=tuple(r.source for r in test) or tuple(f"held-out part of {r.source}" for r in train),
        notes=tuple(
            note
            for note in (
                said,
                measured and f"the gain is measured on {measured}",
                LONGER if result.undetermined and not isinstance(model, WholeRecords) else "",
            )
            if note
        ),
    )


def _finer_averages(candidates: Candidates, windows: Callable[[int], Problem]) -> int:
    """How many averages a window needs to tell its start, where the base is far off; 0 for the usual number.

    Args:
        candidates: What fits the base to windows with the usual number.
        windows: The same with another number.
    """
    if candidates.problem.model.random_force:
        return 0
    some, fitted = refitted_to_some(candidates, candidates.problem)
    if not error(some, fitted)[1]:
        return 0
    return resolving(some, fitted.parameters, lambda bins: refitted_to_some(candidates, windows(bins)))


def _found(
    candidates: Candidates,
    train: Sequence[Recording],
    testing: Problem,
    report: Progress,
    rng: np.random.Generator,
) -> Found:
    """Search for effects, confirm them on the test data, and let unlisted curves compete."""
    selection = select(candidates, report)
    report("measuring the gain", 0.8)
    base, found = selection.base, selection.chosen
    within = candidates.budget.within
    mistaken = within(
        "mistaken columns",
        lambda: mistaken_columns(candidates.problem.model, train, candidates, found.fit),
        "",
    )
    fits = (base.fit, found.fit) if found.effects else (base.fit,)
    unrelated = not mistaken and is_unrelated(candidates.problem, testing, fits, candidates.options.level)
    exact = candidates.problem.is_exact(base.fit.raw)
    chosen = base if mistaken or unrelated or exact else confirmed(candidates, base, found, testing)
    if chosen is found and not (mistaken or unrelated or exact):
        chosen = confirmed_elsewhere(candidates, found, selection.seldom, testing)
    if chosen is not found:
        same = rivals_of(chosen, selection.seldom, candidates.problem.blocks, candidates.options)
        selection = replace(selection, chosen=chosen, alternatives=same)
    path = path_to(candidates, base, chosen)
    possible = tuple[Cause, ...]()
    if chosen.effects:
        chosen, possible = within(
            "which effects differ from none",
            lambda: told_from_neutral(candidates, path, testing, rng),
            (chosen, possible),
        )
    report("letting unlisted curves compete", 0.85)
    judged = within("unlisted curves", lambda: judge(candidates, selection.base, chosen), None) or unjudged(
        candidates, selection.base, chosen
    )
    judged = within(
        "fewer names", lambda: without_imitators(candidates, selection.base, judged, testing), judged
    )
    path = path_to(candidates, selection.base, judged.kept)
    told = selection
    if judged.kept.effects and set(judged.kept.effects) != set(chosen.effects):
        same = within("alternatives", lambda: exchanged(candidates, judged.kept), ())
        told = replace(selection, chosen=judged.kept, alternatives=same)
    causes = with_alternatives(causes_of(candidates, path, testing, rng), told, judged)
    causes = beside_the_others(causes, candidates, path, testing, rng.spawn(1)[0])
    before = predict(testing, selection.base.fit.parameters)
    after = predict(testing, judged.kept.fit.parameters) if causes else before
    options = candidates.options
    wandering = wander(candidates.problem, judged.kept.fit, options.price).outputs
    steady = predict(testing, (judged.kept if causes else selection.base).fit.parameters, wandering)
    beyond_noise = not testing.model.random_force and far_from_noise(
        testing, steady, bool(causes), options.above
    )
    if causes and beyond_noise and not mostly_explained(testing, before, after):
        extension = within(
            "curves with the names",
            lambda: improving(candidates, judged.kept, judged.curves, testing, after),
            None,
        )
        beyond_noise = extension is None or not mostly_explained(testing, before, extension.predict(testing))
    if causes and beyond_noise and not mostly_explained(testing, before, after):
        # What is missing is larger than what was found: a part of it may be imitated.
        possible, causes, after = (*possible, *causes), (), before
        alone = replace(judged, kept=selection.base, tried=judged.beside_base, curves=())
        judged = within("unlisted curves", lambda: judge(candidates, selection.base, selection.base), alone)
    scored, certain, named = judged.curves, True, None
    if scored and not (causes or mistaken or unrelated or exact):
        named = within(
            "names beside a curve", lambda: names_beside(candidates, judged, testing, rng.spawn(1)[0]), None
        )
        if named is not None:
            judged, causes, after = named.judged, named.causes, named.after
            scored = judged.curves
    if not scored and beyond_noise:
        far = far_from_noise(testing, steady, bool(causes), options.far)
        likely = within(
            "likely curves",
            lambda: most_likely(judged.tried, judged.kept, far, options),
            tuple[Scored, ...](),
        )
        scored, certain = likely, False
    if mistaken or unrelated or exact:
        scored = ()
    scored = within(
        "other curves", lambda: that_keep_their_promise(candidates, judged, scored), tuple(scored)
    )
    if scored and causes and named is None:  # those beside a curve have been told in the same simulation
        kept, causes, neutral = within(
            "names and curves together",
            lambda: told_together(
                candidates, selection.base, judged.kept, causes, scored, testing, rng.spawn(1)[0]
            ),
            (judged.kept, causes, tuple[Cause, ...]()),
        )
        if neutral:
            same = within("alternatives", lambda: exchanged(candidates, kept), ()) if causes else ()
            selection = replace(selection, chosen=kept, alternatives=same)
            judged, possible = replace(judged, kept=kept), (*possible, *neutral)
            after = predict(testing, kept.fit.parameters)
    if not (mistaken or unrelated) and (causes or not scored):
        causes = (*causes, *quantisation_found(train, testing, after))
    if not (causes or scored or mistaken or unrelated):
        unrelated = is_unrelated(candidates.problem, testing, fits, options.level, CERTAIN)
    return Found(mistaken, unrelated, selection, judged, causes, possible, scored, certain, before, after)


def _stated(
    candidates: Candidates,
    testing: Problem,
    found: Found,
    fixed: Mapping[str, float],
    rng: np.random.Generator,
) -> Diagnosis:
    """The result in words and numbers, with the extended simulation."""
    training, kept, selection = candidates.problem, found.judged.kept, found.selection
    model = training.model
    within, lacks = candidates.budget.within, candidates.budget.lacks
    extension = found.extension or within(
        "the fit of curves", lambda: improving(candidates, kept, found.curves, testing, found.after), None
    )
    added = extension.curves if extension else ()
    writer = Writer(candidates, kept, found.causes, testing, fixed)
    made, left = within("curves in the extension", lambda: writer.best(added), None) or writer.best(())
    curves = (
        *(s.shown(found.certain) for s in added),
        *(s.shown(found.certain, confirmed=False) for s in found.curves[len(added) :]),
    )
    verdict: Verdict = (
        "unknown" if found.mistaken else "unrelated" if found.unrelated else verdict_of(found.causes, curves)
    )
    beside = found.curves[-1].candidate if found.curves else kept
    # A curve that is certain leaves no two names to tell apart.
    answered = (
        bool(found.mistaken) or found.unrelated or (verdict == "unknown" and bool(curves) and found.certain)
    )
    no_better = (f"{c.direction} (it predicts the test data no better)" for c in curves if not c.confirmed)
    return Diagnosis(
        model=model.name,
        machine=model.inner if isinstance(model, WholeRecords) else model,
        verdict=verdict,
        causes=made.causes,
        mistaken=found.mistaken,
        misfit=within(
            "tests of the residuals",
            lambda: failed_tests(training, selection.base, candidates.options, found.judged.beside_base),
            (),
        ),
        gain=gains(
            testing,
            (selection.base, kept),
            (found.before, found.after if made.curves else made.prediction, made.prediction),
            (made.testing, made.loaded),
            rng,
        ),
        curves=curves,
        possible=found.possible,
        curve_effects=made.effects,
        not_runnable=(*left, *no_better),
        seen=within("what would have shown", lambda: visible(kept, found.judged.tried), ())
        if verdict == "consistent"
        else (),
        next_measurement=None
        if answered or lacks("the next measurement")
        else next_measurement(candidates, selection, verdict, rng),
        parameters=made.parameters,
        undetermined=poorly_known(model, made.parameters),
        bounded=bounded(model, kept.fit),
        wandering={}
        if found.mistaken or found.unrelated
        else wandering_zeros(training, beside.fit, candidates.options.price),
        above_noise=above_noise(testing, made.prediction),
        vector=made.vector,
        not_testable=not_testable(selection),
        trained_on=(),
        tested_on=(),
        windows=(len(training), len(testing)),
        seconds=0.0,
        evidence=collect(
            training,
            testing,
            selection,
            kept,
            (found.before, made.prediction),
            ranking(selection, training),
            rng,
            brief=lacks("figures of the residuals"),
        ),
    )
