"""The measurement that would tell rivals apart: T-optimality (Hunter and Reiner, 1965).

Among inputs inside the limits that the recordings have shown, the one for which the rival, refitted, stays
furthest from the chosen set. Where nobody chooses a machine's inputs, it is said which of its moments count.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.candidates import Candidate, Candidates
from fieldmodels.diagnosis.fit import fit, project
from fieldmodels.diagnosis.planned_inputs import Limits, Shape, limits_of, planned, shapes
from fieldmodels.diagnosis.problem import Problem, build
from fieldmodels.diagnosis.result import NextMeasurement, Verdict
from fieldmodels.diagnosis.selection import MIN_GAIN, Selection
from fieldmodels.recording import Recording, RecordingError, Windows

SECONDS, LONGEST = 20.0, 240.0  # of a planned measurement: compared over the first, at most the second
WINDOWS = 12  # at the main horizon, at least
ENOUGH = 16.0  # nats that decide: beyond the 6 that tell two sets apart by 2.5 standard deviations
WEAK = 15.0  # nats: a single effect that leads its next rival by less is named, but weakly
HOPELESS = 0.1  # nats from the best input, of which nobody would record enough
TRIES, LEAST_SCALE = 6, 0.02  # to find the share of the inputs' range that keeps the outputs in theirs


def rivals_of(selection: Selection, verdict: Verdict) -> tuple[Candidate, Candidate] | None:
    """The two sets that a measurement should tell apart; None if there is no such question.

    Of an ambiguous verdict the chosen set and its closest rival; of a single effect that is named weakly, it
    and the next; where nothing is named though single effects would gain, the best two of them.
    """
    chosen = selection.chosen
    if verdict == "ambiguous":
        return (chosen, selection.rivals[0]) if selection.rivals else None
    others = [c for c in selection.ranking if set(c.effects) != set(chosen.effects)]
    if verdict == "named" and len(chosen.effects) == 1 and others:
        return (chosen, others[0]) if others[0].total - chosen.total < WEAK else None
    gaining = [c for c in selection.ranking if selection.before.total - c.total > MIN_GAIN]
    if verdict == "unknown" and len(gaining) > 1:
        return gaining[0], gaining[1]
    return None


def next_measurement(
    candidates: Candidates, selection: Selection, verdict: Verdict, rng: np.random.Generator
) -> NextMeasurement | None:
    """Plan what best separates two rivals.

    Returns:
        None if there are no rivals.
    """
    rivals = rivals_of(selection, verdict)
    if rivals is None:
        return None
    problem = candidates.problem
    model, recordings = problem.model, [part.windows.recording for part in problem.parts]
    commands = [np.column_stack([r[signal.name] for signal in model.inputs]) for r in recordings]
    if not model.inputs_are_free:
        return _moments(candidates, *rivals)
    ours, theirs = _names(rivals[0]), _names(rivals[1])
    limits, step = limits_of(model, recordings), recordings[0].step
    seconds = max(SECONDS, WINDOWS * problem.horizon)
    plan = _Plan(problem, *rivals, limits, step, int(rng.integers(2**32)))
    kinds = shapes(step, commands[0], limits)
    tried = {key: plan.commands(shape, seconds) for key, shape in kinds.items()}
    scores = {
        key: score
        for key, values in tried.items()
        if values is not None and (score := plan.separation(values)) is not None
    }
    if not scores:
        return None
    best = max(scores, key=lambda key: scores[key])
    score = scores[best]
    if score < HOPELESS:
        lacking = [output.name for output in model.outputs if output.name not in recordings[0]]
        more = f"measure {' and '.join(lacking)} too, or sample faster" if lacking else "sample faster"
        return NextMeasurement(
            why=f"No input tells {ours} from {theirs} by these signals at this rate: {more}.",
            input={"nats": round(score, 2), "measure": lacking},
        )
    needed = float(np.clip(10.0 * math.ceil(0.1 * seconds * ENOUGH / score), seconds, LONGEST))
    values = plan.commands(kinds[best], needed)
    promised = None if values is None else plan.separation(values)
    if values is None or promised is None:
        return None
    names = [signal.name for signal in model.inputs]
    peaks = [float(peak) for peak in np.abs(values).max(axis=0)]
    up_to = ", ".join(f"{s.name} up to {p:.3g} {s.unit}" for s, p in zip(model.inputs, peaks, strict=True))
    several = len(names) > 1
    chance = float(ndtr(math.sqrt(0.5 * promised)))
    kind, shortest = best
    return NextMeasurement(
        why=(
            f"A {kind} (shortest {shortest:g} s, {up_to}: nothing beyond what was recorded) separates {ours} "
            f"from {theirs} best. {needed:.0f} s of it promise {promised:.1f} nats: the better one "
            f"then leads with a probability of {100 * chance:.1f} %.{plan.room(values)}"
        ),
        input={
            "signal": names if several else names[0],
            "kind": kind,
            "shortest_s": shortest,
            "peak": peaks if several else peaks[0],
            "unit": [signal.unit for signal in model.inputs] if several else model.inputs[0].unit,
            "duration_s": needed,
            "nats": round(promised, 2),
            "probability": round(chance, 4),
            "rivals": [list(rivals[0].effects), list(rivals[1].effects)],
            "compared": {f"{k} {s:g} s": round(v, 2) for (k, s), v in scores.items()},
        },
        plan=Recording(
            time=_clock(len(values), step),
            signals={name: values[:, i] for i, name in enumerate(names)},
            units={signal.name: signal.unit for signal in model.inputs},
            source="planned measurement",
        ),
    )


def _names(candidate: Candidate) -> str:
    return " and ".join(candidate.effects).replace("_", " ")


def _clock(count: int, step: float) -> FloatArray:
    """Sample times [s]."""
    return np.arange(count, dtype=np.float64) * step


@dataclass(frozen=True)
class _Plan:
    """What a planned measurement is judged by.

    Attributes:
        present: The data at hand.
        chosen: The set that is taken for true.
        rival: The one that it is to be told from.
        limits: Of the machine.
        step: Sampling interval [s].
        seed: Of the inputs' randomness.
    """

    present: Problem
    chosen: Candidate
    rival: Candidate
    limits: Limits
    step: float
    seed: int

    def commands(self, shape: Shape, seconds: float) -> FloatArray | None:
        """Commands of a shape, as large as the machine's limits let them be, shape (n, inputs).

        Returns:
            None if hardly any would keep the outputs in the range that was measured.
        """
        compared = np.unique(self.present.outputs)
        time, scale = _clock(round(seconds / self.step), self.step), 1.0
        for _ in range(TRIES):
            values = planned(self.limits, shape, time, scale, np.random.default_rng(self.seed))
            excess = self.limits.excess(self._outputs(values)[:, compared], compared)
            if excess <= 1.0:
                return values
            scale *= max(0.95 / excess, 0.1)
            if scale < LEAST_SCALE:
                break
        return None

    def separation(self, values: FloatArray) -> float | None:
        """Misfit [nats] of the refitted rival on what the chosen set would measure; None if it fails."""
        model = self.present.model
        outputs, compared = self._outputs(values), np.unique(self.present.outputs)
        if not np.isfinite(outputs[:, compared]).all():
            return None
        measured = {model.outputs[j].name: outputs[:, j] for j in compared}
        given = {signal.name: values[:, i] for i, signal in enumerate(model.inputs)}
        record = Recording(time=_clock(len(values), self.step), signals={**measured, **given})
        try:
            problem = build(model, [record], model.horizons[min(1, len(model.horizons) - 1)])
        except RecordingError:
            return None
        samples = problem.parts[0].counts.mean(axis=0)
        noise = np.array([model.outputs[j].noise or problem.output_scale[0] for j in problem.outputs])
        whitener = np.diag(np.sqrt(samples) / np.maximum(noise, 1e-12))
        fitted = fit(problem, self.rival.fit.parameters, self.rival.fit.free, whitener, iterations=6)
        return fitted.cost if np.isfinite(fitted.cost) else None

    def room(self, values: FloatArray) -> str:
        """How far the outputs go that nothing bounds, in plain words."""
        model, outputs = self.present.model, self._outputs(values)
        spans = [
            f"{signal.name} {outputs[:, j].min():.1f} to {outputs[:, j].max():.1f} {signal.unit}"
            for j, signal in enumerate(model.outputs)
            if signal.name in model.unbounded_outputs and not signal.angle and j in self.present.outputs
        ]
        return f" It needs room: {', '.join(spans)}, from its start." if spans else ""

    def _outputs(self, values: FloatArray) -> FloatArray:
        """What the chosen set would show without noise, shape (n, outputs)."""
        model, n = self.present.model, len(values)
        signals = {signal.name: values[:, i] for i, signal in enumerate(model.inputs)}
        whole = Windows(
            recording=Recording(
                time=_clock(n, self.step),
                signals=signals | {o.name: np.zeros(n) for o in model.outputs},
                source="planned measurement",
            ),
            starts=np.zeros(1, dtype=np.int64),
            lengths=np.array([n]),
            states=np.median(self.chosen.fit.states, axis=0)[None],
            observed=np.ones((1, n, len(model.outputs)), dtype=np.bool_),
        )
        return np.asarray(model.simulate(self.chosen.fit.parameters[None], whole)[0, 0])


def _moments(candidates: Candidates, chosen: Candidate, rival: Candidate) -> NextMeasurement | None:
    """Which windows of the data at hand tell two sets apart, for a machine whose inputs nobody chooses."""
    problem = candidates.problem
    ours, theirs = candidates.again(chosen), candidates.again(rival)
    apart = project(ours.fit, (ours.fit.raw - theirs.fit.raw)[:, :, None])
    nats = 0.5 * np.sum(apart**2, axis=(1, 2))
    total = float(nats.sum())
    if not np.isfinite(total) or total <= 0.0:
        return None
    best: tuple[float, str, str, float] | None = None
    for signal in (*problem.model.inputs, *problem.model.outputs):
        if not all(signal.name in part.windows.recording for part in problem.parts):
            continue
        sizes = np.concatenate([_sizes(part.windows, signal.name) for part in problem.parts])
        bound = float(np.quantile(sizes, 0.75))
        high = sizes > bound
        if 0.05 < high.mean() < 0.5:
            share = float(nats[high].sum() / high.sum() / (total / len(nats)))
            if best is None or share > best[0]:
                best = share, signal.name, signal.unit, bound
    seconds = sum(float(part.windows.lengths.sum() * part.windows.recording.step) for part in problem.parts)
    more = max(ENOUGH / total * seconds, problem.horizon)
    why = (
        f"Nobody chooses this machine's inputs freely. The {seconds:.0f} s at hand separate {_names(chosen)} "
        f"from {_names(rival)} by {total:.1f} nats; about {more:.0f} s would decide"
    )
    where: dict[str, object] = {}
    if best is not None and best[0] > 1.2:
        share, name, unit, bound = best
        why += (
            f", and {more / share:.0f} s where {name.replace('_', ' ')} is large "
            f"(root mean square of a window above {bound:.3g} {unit})"
        )
        where = {"signal": name, "above": bound, "unit": unit, "times": round(share, 2)}
    return NextMeasurement(
        why=why + ".",
        input={
            "nats": round(total, 2),
            "duration_s": round(more, 1),
            "rivals": [list(chosen.effects), list(rival.effects)],
            **where,
        },
    )


def _sizes(windows: Windows, name: str) -> FloatArray:
    """Root mean square of a signal over each window, shape (windows,)."""
    values = windows.recording[name]
    rows = np.minimum(windows.starts[:, None] + np.arange(windows.samples), len(values) - 1)
    inside = np.arange(windows.samples) < windows.lengths[:, None]
    picked = np.where(inside & np.isfinite(values[rows]), values[rows], 0.0)
    return np.asarray(np.sqrt(np.sum(picked**2, axis=1) / np.maximum(inside.sum(axis=1), 1)))
