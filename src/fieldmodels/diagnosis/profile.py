"""Standard error of a parameter without derivative, from its profile likelihood."""

from __future__ import annotations

import numpy as np

from fieldmodels.diagnosis.candidates import Candidate, Candidates, spacing
from fieldmodels.diagnosis.fit import costs
from fieldmodels.diagnosis.linearisation import project
from fieldmodels.diagnosis.selection import dispersion
from fieldmodels.model import Effect

OFFSETS = np.geomspace(1 / 256, 2.0, 19)  # tried on both sides, in steps of the search's first grid
RISE, WIDE = 1.92, 1.96  # nats that the cost rises at a 95 % interval's end, and its half width in deviations


def profiled_error(candidates: Candidates, candidate: Candidate, effect: Effect, k: int) -> float:
    """Standard error of the k-th parameter of an effect that a candidate holds, in its unit.

    At each value around the fitted one the other parameters and the states are re-optimised, to first
    order. The interval extends to the furthest value whose cost is less than 1.92 nats above the minimum (chi
    squared, one degree of freedom), so that several minima inside count as one. Errors correlated within
    blocks of windows widen it by their dispersion.
    """
    problem, fitted = candidates.problem, candidate.fit
    place = problem.model.slice_of(effect.name).start
    parameter, best = effect.parameters[k], fitted.parameters[place + k]
    offsets = spacing(problem, effect, k) * np.concatenate([-OFFSETS[::-1], [0.0], OFFSETS])
    values = np.clip(best + offsets, parameter.lower, parameter.upper)
    batch = np.repeat(fitted.parameters[None], len(values), axis=0)
    batch[:, place + k] = values
    if (
        problem.observations is not None
    ):  # likelihoods of events change too much for a first-order approximation
        cost = costs(problem, batch, fitted.states, fitted.whitener)
    else:
        raw = problem.features - problem.simulate(batch, fitted.states)
        flat, _ = candidates.beside(fitted, project(fitted, np.moveaxis(raw, 0, 2)))
        cost = 0.5 * np.sum(flat**2, axis=0)
    own = np.isin(fitted.free, np.arange(place, place + len(effect.parameters))) & fitted.active
    limit = cost.min() + RISE * dispersion(fitted, own, problem.blocks)
    inside = np.flatnonzero(cost < limit)
    # The first value outside is the end of the interval, or the end of the grid.
    low, high = max(inside[0] - 1, 0), min(inside[-1] + 1, len(values) - 1)
    return float(max(best - values[low], values[high] - best) / WIDE)
