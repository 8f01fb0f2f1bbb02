"""Unmodelled dynamics: which variable a missing force depends on, and how, from a dictionary of forces.

Candidate forces are lookup tables and products of the signals along the fitted trajectories. The response to
a unit force on each of a few segments of the windows is simulated once; the response to every column of the
dictionary is a combination of these. Each group of columns is scored on held-out windows jointly with the
free parameters. Unmodelled dynamics of an event act on its log-odds.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.candidates import Candidate
from fieldmodels.diagnosis.fit import Fit, held_out_loss, project, stacked
from fieldmodels.diagnosis.problem import Problem
from fieldmodels.diagnosis.response import SEGMENTS, averaged, odds_responses, responses, segments
from fieldmodels.diagnosis.result import UnmodelledDynamics
from fieldmodels.diagnosis.selection import MIN_GAIN, MIN_SHARE, block_p_value

KNOTS = 8  # of a table
MULTIPLIED = 7  # signals whose products are tried
MAX_P = 0.005  # of the best of some twenty groups
RARE_P, RARE_GAIN = 0.02, 40.0  # of a shape that acts in few windows only, but strongly there
BEATEN_GAIN, BEATEN_SHARE = 3.0, 0.025  # by which a dictionary group must beat a named effect [nats, share]
BEATEN_P = 0.1  # of the paired test that it does
LEAST_SINE = 0.1  # of the angle between a shape's response and the span of the free parameters' sensitivities


@dataclass(frozen=True)
class Group:
    """Columns of the dictionary that form one shape.

    Attributes:
        direction: The variable that the force depends on.
        unit: Unit of that variable.
        values: Force columns on the segments of every window, shape (windows, segments, columns).
        knots: Values of the variable at which the curve is given, shape (points,).
        curves: Each column's value there, shape (points, columns).
        event: Index of the event output whose log-odds it shifts; None for a force.
    """

    direction: str
    unit: str
    values: FloatArray
    knots: FloatArray
    curves: FloatArray
    event: int | None = None


@dataclass(frozen=True)
class Found:
    """A group scored jointly with a fit.

    Attributes:
        group: The group.
        gain: Improvement of every window's held-out loss [nats].
        p_value: One-sided, over blocks of windows.
        coefficients: One per column, in the unit of the disturbance.
    """

    group: Group
    gain: FloatArray
    p_value: float
    coefficients: FloatArray

    @property
    def total(self) -> float:
        """Improvement of all windows [nats]."""
        return float(self.gain.sum())


class Dictionary:
    """Candidate force shapes along the trajectories of a fit, and the response of the features to them."""

    def __init__(self, problem: Problem, fitted: Fit) -> None:
        self.problem = problem
        self.segment = [segments(part.windows.lengths, part.slots.shape[1]) for part in problem.parts]
        self.response = responses(problem, fitted)
        signals = self._signals(fitted)
        events = [int(j) for j in np.unique(problem.outputs) if problem.model.outputs[j].event]
        names = [problem.model.outputs[j].name for j in events]
        self.groups = list(_groups({name: s for name, s in signals.items() if name not in names}))
        self.odds = {j: odds_responses(problem, fitted, j) for j in events}
        for j in events:
            self.groups += [replace(group, event=j) for group in _groups(signals)]

    def judge(self, candidate: Candidate, folds: NDArray[np.int64]) -> list[Found]:
        """Score every group jointly with a fit of the same problem, most probable first."""
        fitted = candidate.fit
        result = []
        for group in self.groups:
            response = self.response if group.event is None else self.odds[group.event]
            columns = project(fitted, response @ group.values)
            combination = _identifiable_shapes(columns, fitted)
            if combination.shape[1] == 0:
                continue
            columns = columns @ combination
            wide = replace(
                fitted,
                jacobian=np.concatenate([fitted.jacobian, columns], axis=2),
                active=np.concatenate([fitted.active, np.ones(columns.shape[2], dtype=np.bool_)]),
            )
            gain = candidate.loss - held_out_loss(wide, folds)
            coefficients = combination @ _solve(wide)[len(fitted.free) :]
            result.append(Found(group, gain, block_p_value(gain, self.problem.blocks), coefficients))
        return sorted(result, key=lambda f: -f.total)

    def significant(self, candidate: Candidate, folds: NDArray[np.int64]) -> Found | None:
        """The best group, if it improves a fit significantly."""
        least = max(MIN_GAIN, MIN_SHARE * float(candidate.loss.sum()))
        for found in self.judge(candidate, folds):
            rare = found.total > RARE_GAIN and found.p_value < RARE_P
            if found.total > least and (found.p_value < MAX_P or rare):
                return found
        return None

    def most_likely(self, candidate: Candidate, folds: NDArray[np.int64]) -> UnmodelledDynamics | None:
        """Shape of the best group, significant or not, for an error that is known to be above the noise."""
        best = self.judge(candidate, folds)[:1]
        return self.shape(best[0], candidate) if best else None

    def shape(self, found: Found, candidate: Candidate) -> UnmodelledDynamics:
        """The curve of a scored group."""
        model, event = self.problem.model, found.group.event
        unit = model.disturbance_unit or "1"
        direction = found.group.direction
        if event is not None:
            unit, direction = "1", f"{direction}, in the log-odds of {model.outputs[event].name}"
        curve = np.column_stack([found.group.knots, found.group.curves @ found.coefficients])
        percent = 100 * found.total / float(candidate.loss.sum())
        return UnmodelledDynamics(
            direction,
            unit,
            found.group.unit,
            curve,
            found.p_value,
            float(np.clip(percent, 0, 100)),
        )

    def _signals(self, fitted: Fit) -> Mapping[str, tuple[str, FloatArray]]:
        """Candidate variables averaged over the segments: outputs, their rates, inputs, and time."""
        model = self.problem.model
        first = 0
        collected: dict[str, tuple[str, list[FloatArray]]] = {}
        recorded = [part.windows.recording for part in self.problem.parts]
        moving = {  # a flag or a setting is no candidate
            s.name for s in model.inputs if max(len(np.unique(r[s.name])) for r in recorded) > 3
        }
        for part, segment in zip(self.problem.parts, self.segment, strict=True):
            windows = part.windows
            # A fitted initial state absorbs the random force of its window, which would then appear as a
            # force that depends on the state; the measured one does not.
            states = windows.states if model.random_force else fitted.states[first : first + len(windows)]
            first += len(windows)
            outputs = model.simulate(fitted.parameters[None], windows.with_states(states))[0]
            recording = windows.recording
            rows = np.minimum(windows.starts[:, None] + np.arange(segment.shape[1]), len(recording) - 1)
            signals = {"time": ("s", recording.time[rows])}
            units = {signal.unit for signal in model.outputs}
            for j, signal in enumerate(model.outputs):
                if np.isfinite(outputs[:, :, j])[segment >= 0].mean() < 0.9 or (
                    model.random_force and signal.optional
                ):
                    continue
                signals[signal.name] = (signal.unit, outputs[:, :, j])
                # Random forces drive the rates, so that the rates do not reveal what the forces depend on.
                if f"{signal.unit}/s" not in units and not (model.random_force or signal.event):
                    rate = np.gradient(outputs[:, :, j], recording.step, axis=1)
                    signals[f"rate of {signal.name}"] = (f"{signal.unit}/s", rate)
            for signal in model.inputs:
                values = recording[signal.name]
                if signal.name in moving:
                    signals[signal.name] = (signal.unit, values[rows])
                    lag = max(1, segment.shape[1] // SEGMENTS)
                    before = values[np.maximum(rows - lag, 0)]
                    signals[f"change of {signal.name}"] = (signal.unit, values[rows] - before)
            for name, (unit, values) in signals.items():
                collected.setdefault(name, (unit, []))[1].append(averaged(values, segment))
        joined = {name: (unit, np.concatenate(values)) for name, (unit, values) in collected.items()}
        return {name: (unit, values) for name, (unit, values) in joined.items() if np.ptp(values) > 0}


def _groups(signals: Mapping[str, tuple[str, FloatArray]]) -> Iterable[Group]:
    """Lookup tables of every signal, and products of pairs."""
    for name, (unit, values) in signals.items():
        if name.startswith("change of"):
            yield _line(name, unit, values)
            continue
        knots = np.unique(np.quantile(values, np.linspace(0.01, 0.99, KNOTS)))
        if len(knots) >= 4:
            yield Group(name, unit, _hats(values, knots), knots, np.eye(len(knots)))
    moving = [n for n in signals if n != "time" and not n.startswith(("change of", "rate of"))]
    # A machine with many sensors would have hundreds of products: then only those of its first signals.
    for first, second in itertools.combinations(moving[:MULTIPLIED], 2):
        a, b = signals[first][1], signals[second][1]
        unit = f"{signals[first][0]} {signals[second][0]}"
        yield _line(f"{first} times {second}", unit, a * b)
        yield _line(f"{first} times size of {second}", unit, a * np.abs(b))
        yield _line(f"{second} times size of {first}", unit, np.abs(a) * b)


def _line(direction: str, unit: str, values: FloatArray) -> Group:
    """A force proportional to one quantity."""
    low, high = np.quantile(values, [0.01, 0.99])
    knots = np.linspace(low, high, 9)
    return Group(direction, unit, values[:, :, None], knots, knots[:, None])


def _hats(values: FloatArray, knots: FloatArray) -> FloatArray:
    """Piecewise-linear hat functions at the knots, constant beyond the outer ones; shape (..., knots)."""
    eye = np.eye(len(knots))
    return np.stack([np.interp(values, knots, eye[k]) for k in range(len(knots))], axis=-1)


def _identifiable_shapes(columns: FloatArray, fitted: Fit) -> FloatArray:
    """Combinations of columns that the free parameters cannot reproduce, shape (columns, combinations).

    A shape that is nearly collinear with a free parameter (a force proportional to the angle, with the
    stiffness free) would get a huge coefficient, whose small remaining component fits the noise.
    """
    scale = np.sqrt(np.sum(columns**2, axis=(0, 1))) + 1e-30
    left, size, right = np.linalg.svd(stacked(columns) / scale, full_matrices=False)
    sound = size > 1e-6 * max(float(size[0]), 1e-30)
    basis, _ = np.linalg.qr(stacked(fitted.jacobian[:, :, fitted.active]))
    _, sines, turn = np.linalg.svd(left[:, sound] - basis @ (basis.T @ left[:, sound]), full_matrices=False)
    own = turn[sines > LEAST_SINE].T
    return np.asarray((right[sound].T / size[sound]) @ own / scale[:, None])


def _solve(wide: Fit) -> FloatArray:
    """Gauss-Newton step of all active columns, zero for the others."""
    active = wide.active
    columns = wide.jacobian[:, :, active]
    flat = stacked(columns)
    step = np.zeros(len(active))
    step[active] = np.linalg.pinv(flat.T @ flat, hermitian=True, rcond=1e-8) @ (
        flat.T @ wide.residual.reshape(-1)
    )
    return step
