"""The diagnosis from end to end: fit, selection, gain, unmodelled dynamics, verdict."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis import problem as problems
from fieldmodels.diagnosis.candidates import Candidate, Candidates, is_quantisation
from fieldmodels.diagnosis.evidence import collect
from fieldmodels.diagnosis.extension import extend
from fieldmodels.diagnosis.fit import Fit, fit, standard_errors, window_loss
from fieldmodels.diagnosis.gain import NONE, Prediction, by_horizon, noise_floor, predict, share
from fieldmodels.diagnosis.inputs import decided
from fieldmodels.diagnosis.next_measurement import next_measurement
from fieldmodels.diagnosis.noise_weighting import weighted_by_noise
from fieldmodels.diagnosis.options import DEFAULT, DiagnosisOptions
from fieldmodels.diagnosis.outcome import Diagnosis
from fieldmodels.diagnosis.power import visible
from fieldmodels.diagnosis.problem import Problem
from fieldmodels.diagnosis.profile import profiled_error
from fieldmodels.diagnosis.quantisation import coarse_sensor
from fieldmodels.diagnosis.residuals import failed_tests
from fieldmodels.diagnosis.result import (
    Cause,
    Estimate,
    Share,
    SignalGain,
    Verdict,
)
from fieldmodels.diagnosis.runnable import runnable
from fieldmodels.diagnosis.selection import Selection, block_p_value, select
from fieldmodels.diagnosis.signs import mistaken_columns
from fieldmodels.diagnosis.stages import Progress, held, joined, scaled_progress
from fieldmodels.diagnosis.verdict import (
    Judgement,
    far_from_noise,
    judge,
    most_likely,
    mostly_explained,
    verdict_of,
)
from fieldmodels.model import Effect, Model
from fieldmodels.recording import Recording, RecordingError

FEW = 16  # windows; with fewer at the main horizon the shorter one is used
HELD_OUT = 4  # without test data every fourth block is kept for the gain
POORLY_KNOWN = 0.5  # relative standard error above which a base parameter counts as poorly known
NEGLIGIBLE = 0.1  # nats on the test data that do not count
ABOVE = (
    1.5  # times the noise: a larger error is reported; equal parts of white and slowly varying noise give 1.4
)


def diagnose(
    model: Model,
    train: Sequence[Recording],
    test: Sequence[Recording] = (),
    fixed: Mapping[str, float] | None = None,
    progress: Callable[[str, float], None] | None = None,
    seed: int = 0,
    options: DiagnosisOptions = DEFAULT,
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

    Returns:
        Verdict, causes with parameters and gains, unmodelled dynamics, and evidence for the report.

    Raises:
        ModelError: For an unknown or impossible fixed value.
        RecordingError: If there are too few data or none.
    """
    report = progress or (lambda _what, _share: None)
    if not train:
        raise RecordingError("no recording to diagnose; give at least one")
    _check_range(model, [*train, *test])
    train, test, lacking = _in_all(model, train, test)
    fixed = {**_known(model, [*train, *test]), **(fixed or {})}
    model, said = decided(model, train, main_horizon, lambda one: _start(one, fixed), frozenset(fixed))
    stages = model.stages([*train, *test])
    whole = joined(
        model,
        [
            _diagnose_stage(
                stage.model,
                train,
                test,
                {**_known(stage.model, ()), **held(stage), **fixed},
                scaled_progress(report, number, len(stages)),
                seed,
                options,
            )
            for number, stage in enumerate(stages)
        ],
    )
    notes = tuple(f"{r.source}: {note}" for r in (*train, *test) for note in r.notes)
    return replace(whole, notes=(*said, *lacking, *notes))


def _diagnose_stage(
    model: Model,
    train: Sequence[Recording],
    test: Sequence[Recording],
    fixed: Mapping[str, float],
    report: Progress,
    seed: int,
    options: DiagnosisOptions,
) -> Diagnosis:
    """Diagnose one stage by itself; arguments as of ``diagnose``."""
    began = time.perf_counter()
    start = _start(model, fixed)
    model = model.scaled_to([*train, *test])
    report("cutting the data into windows", 0.0)
    training, testing = weighted_by_noise(*_split(model, train, test), start)
    candidates = Candidates(
        problem=training,
        start=start,
        fixed=frozenset(fixed),
        folds=training.folds,
        whitener=np.diag(1 / training.output_scale),
        options=options,
    )
    mistaken = mistaken_columns(model, train, training, start, frozenset(fixed))
    selection = select(candidates, report)
    report("measuring the gain", 0.8)
    rng = np.random.default_rng(seed)
    path = _path(candidates, selection.base, selection.chosen)
    path = path[: 1 if mistaken else _confirmed(path, testing)]
    selection = replace(
        selection,
        chosen=path[-1],
        alternatives=selection.alternatives if path[-1] is selection.chosen else (),
    )
    chosen, possible = _certain(candidates, path, testing, rng)
    report("letting unlisted curves compete", 0.85)
    judged = judge(candidates, selection.base, chosen)
    causes = _causes(candidates, _path(candidates, selection.base, judged.kept), testing, rng)
    causes = _with_alternatives(causes, selection, judged)
    before = predict(testing, selection.base.fit.parameters)
    after = predict(testing, judged.kept.fit.parameters) if causes else before
    beyond_noise = not model.random_force and far_from_noise(testing, after, bool(causes))
    if causes and beyond_noise and not mostly_explained(testing, before, after):
        # What is missing is larger than what was found: a part of it may be imitated.
        possible, causes, after = (*possible, *causes), (), before
        judged = judge(candidates, selection.base, selection.base)
    scored, certain = judged.curves, True
    if not scored and beyond_noise:
        scored, certain = most_likely(judged.tried, judged.kept), False
    unknown = bool(mistaken) or (not causes and bool(scored))
    causes = (*causes, *(() if unknown else _quantisation_found(train, testing, after)))
    if mistaken:
        scored = ()
    extension = extend(training, judged.kept, scored)
    curves = tuple(s.shown(certain) for s in (extension.curves if extension else scored))
    whole = extension.predict(testing) if extension else after
    verdict: Verdict = "unknown" if mistaken else verdict_of(causes, curves)
    final = extension.fit if extension else judged.kept.fit
    fitted = replace(training, model=extension.model) if extension else training
    # A curve that is certain leaves no two names to tell apart.
    answered = bool(mistaken) or (verdict == "unknown" and bool(curves) and certain)
    base = _base_estimates(fitted, final, model, fixed)
    effects, not_runnable = runnable(model, curves)
    report("done", 1.0)
    return Diagnosis(
        model=model.name,
        machine=model,
        verdict=verdict,
        causes=tuple(_refitted(c, model, final) for c in causes),
        mistaken=mistaken,
        misfit=failed_tests(training, selection.base, options),
        gain=_gains(testing, (selection.base, judged.kept), (before, after, whole), rng),
        curves=curves,
        possible=possible,
        curve_effects=effects,
        not_runnable=not_runnable,
        seen=() if model.random_force else visible(judged.kept, judged.tried),
        next_measurement=None if answered else next_measurement(candidates, selection, verdict, rng),
        parameters=base,
        undetermined=_poorly_known(model, base),
        above_noise=_above_noise(testing, after),
        vector=final.parameters[: len(model.names)],
        not_testable=_not_testable(selection),
        trained_on=tuple(r.source for r in train),
        tested_on=tuple(r.source for r in test) or tuple(f"held-out part of {r.source}" for r in train),
        windows=(len(training), len(testing)),
        seconds=time.perf_counter() - began,
        evidence=collect(
            training, testing, selection, judged.kept, (before, whole), _ranking(selection, training), rng
        ),
    )


def _certain(
    candidates: Candidates, path: Sequence[Candidate], testing: Problem, rng: np.random.Generator
) -> tuple[Candidate, tuple[Cause, ...]]:
    """The set without what cannot be told from neutral, one by one, and what that was."""
    chosen, possible = path[-1], []
    while chosen.effects:
        doubtful = [
            c for c in _causes(candidates, path, testing, rng) if not _told_from_neutral(c, candidates)
        ]
        if not doubtful:
            break
        weakest = min(doubtful, key=lambda c: c.nats)
        possible.append(weakest)
        chosen = candidates.without(chosen, weakest.effect)
        path = _path(candidates, path[0], chosen)
    return chosen, tuple(possible)


def _told_from_neutral(cause: Cause, candidates: Candidates) -> bool:
    """Whether any of a cause's values is two standard errors from neutral, and its gain above zero."""
    effect = candidates.problem.model.effect(cause.effect)
    told = any(
        abs(cause.parameters[p.name].value - p.nominal) > 2.0 * cause.parameters[p.name].std
        or not np.isfinite(cause.parameters[p.name].std)
        for p in effect.parameters
        if p.name in cause.parameters
    )
    return told and not cause.gain.ci95[1] < 0.0


def _quantisation_found(train: Sequence[Recording], testing: Problem, after: Prediction) -> tuple[Cause, ...]:
    """Sensor quantisation as a cause, if it makes up enough of the remaining error."""
    model, error = testing.model, after.rmse()
    if model.random_force:  # it hides the sensor's noise in the error
        error = np.array([noise_floor(testing, after, j) for j in range(len(model.outputs))])
    coarse = coarse_sensor(model, train, error)
    return () if coarse is None else (_quantisation(model, *coarse),)


def _poorly_known(model: Model, base: Mapping[str, Estimate]) -> tuple[str, ...]:
    """Positive base parameters whose relative standard error is large or unknown."""
    return tuple(
        p.name
        for p in model.parameters
        if p.lower > 0 and not base[p.name].std <= POORLY_KNOWN * base[p.name].value
    )


def _check_range(model: Model, recordings: Sequence[Recording]) -> None:
    """Reject values that no sensor can measure, such as those of a diverged simulation.

    Raises:
        RecordingError: With the recording and the signal.
    """
    for recording in recordings:
        for signal in (*model.inputs, *model.outputs):
            if signal.name in recording:
                values = recording[signal.name]
                wrong = np.flatnonzero(~np.isnan(values) & ~(np.abs(values) < problems.HUGE**0.25))
                if len(wrong):
                    place = f"{recording.source}: signal {signal.name!r}, sample {wrong[0]}"
                    raise RecordingError(
                        f"{place}: {values[wrong[0]]:g} cannot have been measured; cut such values out"
                    )


def _in_all(
    model: Model, train: Sequence[Recording], test: Sequence[Recording]
) -> tuple[Sequence[Recording], Sequence[Recording], tuple[str, ...]]:
    """Recordings without outputs that some of them lack, which cannot be compared, and a note for each."""
    every = [*train, *test]
    names = [o.name for o in model.outputs if o.optional]
    partial = [n for n in names if any(n in r for r in every) and not all(n in r for r in every)]
    if not partial:
        return train, test, ()

    def without(recordings: Sequence[Recording]) -> list[Recording]:
        return [
            replace(r, signals={name: values for name, values in r.signals.items() if name not in partial})
            for r in recordings
        ]

    notes = tuple(f"{name} is not compared: not every recording has it" for name in partial)
    return without(train), without(test), notes


def _known(model: Model, recordings: Sequence[Recording]) -> dict[str, float]:
    """Base parameters that are not refitted, and values that the recordings state of their machine.

    Raises:
        RecordingError: If two recordings are of different machines.
    """
    known = {p.name: p.nominal for p in model.parameters if not p.refitted}
    names = {p.name for p in model.parameters}
    stated: dict[str, float] = {}
    for recording in recordings:
        for name in names & set(recording.known):
            if stated.setdefault(name, recording.known[name]) != recording.known[name]:
                raise RecordingError(
                    f"{recording.source}: {name} {recording.known[name]:g}, but another recording has "
                    f"{stated[name]:g}; diagnose one machine at a time"
                )
    return {**known, **stated}


def _start(model: Model, fixed: Mapping[str, float]) -> FloatArray:
    """The nominal vector with the fixed values, checked."""
    base = {name: value for name, value in fixed.items() if "." not in name}
    effects: dict[str, dict[str, float]] = {}
    for name, value in fixed.items():
        if "." in name:
            effect, _, parameter = name.partition(".")
            effects.setdefault(effect, {})[parameter] = value
    return model.vector(base, effects)


def _split(model: Model, train: Sequence[Recording], test: Sequence[Recording]) -> tuple[Problem, Problem]:
    horizon = main_horizon(model, train)
    if test:
        coarsest = max(r.step for r in test)
        training = problems.build(model, train, horizon, None, coarsest)
        return training, problems.build(model, test, horizon, training)
    whole = problems.build(model, train, horizon)
    kept = whole.blocks % HELD_OUT != HELD_OUT - 1
    return whole.select(kept), whole.select(~kept)


def main_horizon(model: Model, recordings: Sequence[Recording]) -> float:
    """The model's main horizon, or the shorter one if the recordings hold few windows of it."""
    short, main = model.horizons[0], model.horizons[min(1, len(model.horizons) - 1)]
    try:
        count = sum(len(model.windows(r, main)) for r in recordings)
    except RecordingError:
        count = 0
    return main if count >= FEW else short


def _main_output(problem: Problem) -> int:
    """The first output that is measured."""
    return int(problem.outputs[0])


def _most_improved_outputs(training: Problem, path: Sequence[Candidate]) -> list[int]:
    """The output whose error each cause reduces most on the training data: its gain is stated there."""
    errors = [predict(training, c.fit.parameters).rmse() for c in path]
    return [int(np.nanargmin(after / before)) for before, after in itertools.pairwise(errors)]


def _causes(
    candidates: Candidates, path: Sequence[Candidate], testing: Problem, rng: np.random.Generator
) -> tuple[Cause, ...]:
    """The effects of a path's end with the gain of each over those before it."""
    chosen = path[-1]
    model, problem = candidates.problem.model, candidates.problem
    if not chosen.effects:
        return ()
    outputs = _most_improved_outputs(problem, path)
    predictions = [predict(testing, c.fit.parameters) for c in path]
    errors = standard_errors(problem, chosen.fit)
    causes = []
    for k, name in enumerate(chosen.effects):
        effect = model.effect(name)
        place = model.slice_of(name).start
        values = {}
        for i, p in enumerate(effect.parameters):
            known = np.flatnonzero(chosen.fit.free == place + i)
            std = float(errors[known[0]]) if len(known) else float("nan")
            if not p.smooth:
                std = profiled_error(candidates, chosen, effect, i)
            elif (
                problem.observations is not None and len(p.starts) > 1
            ):  # its derivative may rest on few observations
                std = max(std, profiled_error(candidates, chosen, effect, i))
            values[p.name] = Estimate(float(chosen.fit.parameters[place + i]), std, p.unit)
        gain = path[k].loss - path[k + 1].loss
        causes.append(
            Cause(
                effect=name,
                cause=effect.cause,
                where=effect.where,
                parameters=values,
                signal=model.outputs[outputs[k]].name,
                gain=share(predictions[k], predictions[k + 1], outputs[k], testing.blocks, rng),
                p_value=block_p_value(gain, problem.blocks),
                nats=path[k].total - path[k + 1].total,
                equation=effect.equation,
            )
        )
    return tuple(causes)


def _above_noise(testing: Problem, after: Prediction) -> dict[str, float]:
    """Ratio of each signal's error to its sensor's noise, where it is well above 1.

    Where random forces drive the machine the error proves nothing; an event has no sensor noise.
    """
    if testing.model.random_force:
        return {}
    result = {}
    for j in np.unique(testing.outputs[~testing.events]):
        floor = noise_floor(testing, after, int(j))
        if floor > 0 and after.rmse()[j] > ABOVE * floor:
            result[testing.model.outputs[j].name] = float(after.rmse()[j] / floor)
    return result


def _quantisation(model: Model, effect: Effect, step: float, share: float) -> Cause:
    """Quantisation as a cause; it explains noise, so that predictions gain nothing."""
    parameter = effect.parameters[0]
    return Cause(
        effect=effect.name,
        cause=f"{effect.cause} It makes up {100 * share:.0f} % of the remaining error's variance.",
        where=effect.where,
        parameters={parameter.name: Estimate(step, 0.0, parameter.unit)},
        signal=model.outputs[0].name,
        gain=Share(0.0, (0.0, 0.0)),
        equation=effect.equation,
    )


def _path(candidates: Candidates, base: Candidate, chosen: Candidate) -> list[Candidate]:
    """Fits from the base to a set, each with one more effect."""
    path = [chosen]
    if not chosen.effects:
        return path
    for name in reversed(chosen.effects[1:]):
        path.append(candidates.without(path[-1], name))
    return [base, *reversed(path)]


def _confirmed(path: Sequence[Candidate], testing: Problem) -> int:
    """Number of fits of a path that the test data confirm: each must explain them better than the one before.

    A cause that does not act during the test data is not rejected by them.
    """
    losses = []
    for candidate in path:
        fitted = fit(testing, candidate.fit.parameters, NONE, path[-1].fit.whitener, iterations=6)
        losses.append(float(window_loss(fitted).sum()))
    for k in range(1, len(path)):
        if not losses[k] < losses[k - 1] + NEGLIGIBLE:
            return k
    return len(path)


def _with_alternatives(
    causes: tuple[Cause, ...], selection: Selection, judged: Judgement
) -> tuple[Cause, ...]:
    """Add to each cause the effects, or the unlisted curve, that could replace it."""
    chosen = set(selection.chosen.effects)
    if set(judged.kept.effects) != chosen:
        return causes
    twin = [f"curve of {judged.twin.curve.direction}"] if judged.twin else []
    result = []
    for cause in causes:
        others: list[str] = []
        for other in selection.alternatives:
            removed, added = chosen - set(other.effects), set(other.effects) - chosen
            if cause.effect in removed:
                others += [name for name in other.effects if name in added and name not in others]
        result.append(replace(cause, alternatives=(*others, *twin)))
    return tuple(result)


def _gains(
    testing: Problem,
    fits: tuple[Candidate, Candidate],
    predictions: tuple[Prediction, Prediction, Prediction],
    rng: np.random.Generator,
) -> dict[str, SignalGain]:
    """Gain of every signal, from the base to the named effects, and with the curves."""
    before, after, whole = predictions
    horizons = by_horizon(testing, fits[0].fit.parameters, fits[1].fit.parameters, rng)
    result = {}
    for j in np.unique(testing.outputs):
        signal = testing.model.outputs[j]
        result[signal.name] = SignalGain(
            unit=signal.unit,
            rmse_before=float(before.rmse()[j]),
            rmse_after=float(after.rmse()[j]),
            gain=share(before, after, int(j), testing.blocks, rng),
            horizon=testing.horizon,
            noise_floor=noise_floor(testing, whole, int(j)),
            rmse_with_curves=float(whole.rmse()[j]),
            gain_with_curves=share(before, whole, int(j), testing.blocks, rng),
            horizons=horizons[signal.name],
        )
    return result


def _refitted(cause: Cause, model: Model, final: Fit) -> Cause:
    """A cause with the values of a fit together with the curves; its standard errors are those without."""
    names = {f"{cause.effect}.{name}": name for name in cause.parameters}
    values = {
        name: replace(cause.parameters[name], value=float(final.parameters[model.index(full)]))
        for full, name in names.items()
        if full in model.names and not is_quantisation(model.effect(cause.effect))
    }
    return replace(cause, parameters={**cause.parameters, **values})


def _base_estimates(
    problem: Problem, fitted: Fit, model: Model, fixed: Mapping[str, float]
) -> dict[str, Estimate]:
    errors = standard_errors(problem, fitted)
    result = {}
    for i, p in enumerate(model.parameters):
        known = np.flatnonzero(fitted.free == i)
        std = float(errors[known[0]]) if len(known) else 0.0 if p.name in fixed else float("nan")
        result[p.name] = Estimate(float(fitted.parameters[i]), std, p.unit)
    return result


def _not_testable(selection: Selection) -> dict[str, str]:
    return dict.fromkeys(
        selection.unidentifiable,
        "the refitted base parameters absorb it exactly; fix one of them with --set to test it",
    )


def _ranking(selection: Selection, problem: Problem) -> tuple[tuple[str, float, float, str], ...]:
    rows = []
    model = problem.model
    for c in selection.ranking:
        values = ", ".join(
            f"{p.name} {c.fit.parameters[i]:.4g} {p.unit}"
            for name in c.effects
            for i, p in enumerate(model.effect(name).parameters, start=model.slice_of(name).start)
        )
        gain = selection.before.loss - c.loss
        rows.append(
            (
                " + ".join(c.effects),
                selection.before.total - c.total,
                block_p_value(gain, problem.blocks),
                values,
            )
        )
    return tuple(rows)
