"""Design of the next measurement, which distinguishes two models: T-optimality (Hunter and Reiner, 1965).

Among inputs within the recorded limits, the one for which the alternative, refitted, stays furthest from
the chosen set. Where the inputs cannot be chosen, the report says which parts of the data are informative.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.candidates import Candidate, Candidates
from fieldmodels.diagnosis.fit import fit
from fieldmodels.diagnosis.linearisation import project
from fieldmodels.diagnosis.phrases import a, the
from fieldmodels.diagnosis.planned_inputs import Limits, Shape, limits_of, planned, shapes
from fieldmodels.diagnosis.problem import Problem, build
from fieldmodels.diagnosis.result import NextMeasurement, Verdict
from fieldmodels.diagnosis.selection import Selection
from fieldmodels.recording import Recording, RecordingError, Windows
from fieldmodels.rounding import listed, words

Scores = dict[tuple[str, float], float]
SECONDS, LONGEST = 20.0, 240.0  # durations of a planned measurement: for comparing inputs, at most
WINDOWS = 12  # at the main horizon, at least
ENOUGH = 16.0  # nats that decide: above the 6 that distinguish two sets by 2.5 standard deviations
ITERATIONS = 6  # of the refit of the alternative
HOPELESS = 0.1  # nats from the best input: no practical duration would suffice
TRIES, LEAST_SCALE = (
    6,
    0.02,
)  # attempts to scale the inputs so that the outputs stay in range, and the smallest scale


def models_to_distinguish(selection: Selection, verdict: Verdict) -> tuple[Candidate, Candidate] | None:
    """The two sets that a measurement should distinguish: the chosen one and its closest alternative.

    Returns:
        None unless the verdict is ambiguous: what is named is decided already, and of two sets that both
        leave something unexplained neither is worth a measurement.
    """
    if verdict != "ambiguous" or not selection.alternatives:
        return None
    return selection.chosen, selection.alternatives[0]


def next_measurement(
    candidates: Candidates, selection: Selection, verdict: Verdict, rng: np.random.Generator
) -> NextMeasurement | None:
    """Plan the measurement that best distinguishes two sets of effects.

    Returns:
        None if there are no two sets to distinguish, or no input for which the simulation is finite.
    """
    sets = models_to_distinguish(selection, verdict)
    if sets is None:
        return None
    problem = candidates.problem
    model, recordings = problem.model, [part.windows.recording for part in problem.parts]
    if not model.inputs_are_free:
        return _informative_windows(candidates, *sets)
    limits, step = limits_of(model, recordings), recordings[0].step
    seconds = max(SECONDS, WINDOWS * problem.horizon)
    plan = _Plan(problem, *sets, limits, step, int(rng.integers(2**32)))
    recorded = np.column_stack([recordings[0][signal.name] for signal in model.inputs])
    kinds = shapes(step, recorded, limits)
    tried = {key: plan.commands(shape, seconds) for key, shape in kinds.items()}
    scores = {
        key: score
        for key, values in tried.items()
        if values is not None and (score := plan.separation(values)) is not None
    }
    if not scores:
        return None
    best = max(scores, key=lambda key: scores[key])
    if scores[best] < HOPELESS:
        return plan.undecidable(scores[best])
    needed = float(np.clip(10.0 * math.ceil(0.1 * seconds * ENOUGH / scores[best]), seconds, LONGEST))
    values = plan.commands(kinds[best], needed)
    expected = None if values is None else plan.separation(values)
    if values is None or expected is None:
        return None
    return plan.described(values, best, needed, expected, scores)


def _names(candidate: Candidate) -> str:
    return listed([a(name) for name in candidate.effects])


def _clock(count: int, step: float) -> FloatArray:
    """Sample times [s]."""
    return np.arange(count, dtype=np.float64) * step


@dataclass(frozen=True)
class _Plan:
    """What a planned measurement is designed for.

    Attributes:
        present: The available data.
        chosen: The set that generates the simulated measurement.
        other: The set to distinguish it from.
        limits: Of inputs and outputs.
        step: Sampling interval [s].
        seed: Of the inputs' randomness.
    """

    present: Problem
    chosen: Candidate
    other: Candidate
    limits: Limits
    step: float
    seed: int

    def commands(self, shape: Shape, seconds: float) -> FloatArray | None:
        """Commands of a shape, as large as the limits allow, shape (n, inputs).

        Returns:
            None if only tiny inputs keep the outputs in the measured range.
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
        """Cost [nats] of the other set refitted to data simulated with the chosen one; None if that fails."""
        model = self.present.model
        outputs, compared = self._outputs(values), np.unique(self.present.outputs)
        if not np.isfinite(outputs[:, compared]).all():
            return None
        measured = {model.outputs[j].name: outputs[:, j] for j in compared}
        given = {signal.name: values[:, i] for i, signal in enumerate(model.inputs)}
        record = Recording(time=_clock(len(values), self.step), signals={**measured, **given})
        try:
            problem = build(model, [record], self.present.horizon, self.present)
        except RecordingError:
            return None
        # Errors are as large as they were: sensor noise alone would promise far too much.
        start, free, whitener = self.other.fit.parameters, self.other.fit.free, self.chosen.fit.whitener
        fitted = fit(problem, start, free, whitener, iterations=ITERATIONS)
        return fitted.cost if np.isfinite(fitted.cost) else None

    def room(self, values: FloatArray) -> str:
        """Sentence that gives the ranges of outputs without limits."""
        model, outputs = self.present.model, self._outputs(values)
        spans = [
            f"{words(signal.name)} {outputs[:, j].min():.1f} to {outputs[:, j].max():.1f} {signal.unit}"
            for j, signal in enumerate(model.outputs)
            if signal.name in model.unbounded_outputs and not signal.angle and j in self.present.outputs
        ]
        return f" It needs room: {listed(spans)} from its start." if spans else ""

    def undecidable(self, score: float) -> NextMeasurement:
        """What to change where not even the best input distinguishes the sets."""
        recording = self.present.parts[0].windows.recording
        lacking = [output.name for output in self.present.model.outputs if output.name not in recording]
        remedy = "sample faster"
        if lacking:
            remedy = f"measure {listed([the(name) for name in lacking])}, too, or {remedy}"
        return NextMeasurement(
            why=(
                f"No input distinguishes {_names(self.chosen)} from {_names(self.other)} with these signals "
                f"at this rate: {remedy}."
            ),
            input={"nats": round(score, 2), "measure": lacking},
        )

    def described(
        self, values: FloatArray, best: tuple[str, float], seconds: float, expected: float, scores: Scores
    ) -> NextMeasurement:
        """The plan in words, as data and as commands.

        Args:
            values: Its commands, shape (n, inputs).
            best: Kind of input and shortest time [s].
            seconds: Duration [s].
            expected: Separation [nats].
            scores: Separation [nats] by each input that was compared, over the first seconds.
        """
        inputs, (kind, shortest) = self.present.model.inputs, best
        peaks = [float(peak) for peak in np.abs(values).max(axis=0)]
        up_to = ", ".join(
            f"{words(s.name)} up to {p:.3g} {s.unit}" for s, p in zip(inputs, peaks, strict=True)
        )
        several = len(inputs) > 1
        chance = float(ndtr(math.sqrt(0.5 * expected)))
        return NextMeasurement(
            why=(
                f"A {kind} (shortest time {shortest:g} s, {up_to}, nothing beyond what was recorded) tells "
                f"{_names(self.chosen)} from {_names(self.other)} best. After {seconds:.0f} s of it, the "
                f"right one should be found with a probability of {min(100 * chance, 99.9):.1f} %."
                f"{self.room(values)}"
            ),
            input={
                "signal": [s.name for s in inputs] if several else inputs[0].name,
                "kind": kind,
                "shortest_s": shortest,
                "peak": peaks if several else peaks[0],
                "unit": [s.unit for s in inputs] if several else inputs[0].unit,
                "duration_s": seconds,
                "nats": round(expected, 2),
                "probability": round(chance, 4),
                "rivals": [list(self.chosen.effects), list(self.other.effects)],
                "compared": {f"{k} {s:g} s": round(v, 2) for (k, s), v in scores.items()},
            },
            plan=Recording(
                time=_clock(len(values), self.step),
                signals={signal.name: values[:, i] for i, signal in enumerate(inputs)},
                units={signal.name: signal.unit for signal in inputs},
                source="planned measurement",
            ),
        )

    def _outputs(self, values: FloatArray) -> FloatArray:
        """Noise-free outputs simulated with the chosen set, shape (n, outputs)."""
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


def _informative_windows(
    candidates: Candidates, chosen: Candidate, other: Candidate
) -> NextMeasurement | None:
    """Which windows of the data distinguish two sets, for a machine whose inputs cannot be chosen."""
    problem = candidates.problem
    ours, theirs = candidates.again(chosen), candidates.again(other)
    difference = project(ours.fit, (ours.fit.raw - theirs.fit.raw)[:, :, None])
    nats = 0.5 * np.sum(difference**2, axis=(1, 2))
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
        f"This machine's inputs cannot be chosen freely. These {seconds:.0f} s of data do not tell "
        f"{_names(chosen)} from {_names(other)}; about {more:.0f} s would"
    )
    where: dict[str, object] = {}
    if best is not None and best[0] > 1.2:
        share, name, unit, bound = best
        why += (
            f", or about {more / share:.0f} s in which {the(name)} is large "
            f"(root mean square in a window above {bound:.3g} {unit})"
        )
        where = {"signal": name, "above": bound, "unit": unit, "times": round(share, 2)}
    return NextMeasurement(
        why=why + ".",
        input={
            "nats": round(total, 2),
            "duration_s": round(more, 1),
            "rivals": [list(chosen.effects), list(other.effects)],
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
