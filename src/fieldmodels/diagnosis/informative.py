"""Informative windows: of a long record those are fitted that tell most; what was left out is said.

Nothing that is measured takes part in the choice, only how much each window's simulation moves with the
parameters and the listed effects, so that no test is biased by it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.diagnosis.candidates import Candidate, Candidates
from fieldmodels.diagnosis.fit import fit
from fieldmodels.diagnosis.linearisation import project
from fieldmodels.diagnosis.problem import Problem

FEWEST = 24  # blocks, which tests of significance need
EVEN = 0.5  # share of the blocks that are spread over the record: what nobody has listed may act at any time
LED = 4.0  # horizons of commands before a block, for what lags and delays
STARTS = 3  # of an effect's many starts, whose information counts
AT_ONCE = 2_000_000  # simulated samples, which bounds memory
LOOKED_AT = 300_000  # samples of a long record among which the windows that tell most are looked for


def evenly(problem: Problem, rows: int, fewest: int = FEWEST) -> tuple[Problem, str]:
    """Blocks spread evenly over the data, with so many samples; and what to say if any are left out."""
    numbers = np.unique(problem.blocks)
    count = _count(problem, rows, fewest)
    if count >= len(numbers):
        return problem, ""
    kept = _kept(problem, numbers[_spread(len(numbers), count)])
    return kept, f"{len(kept)} of {len(problem)} windows, spread evenly"


def informative(candidates: Candidates) -> tuple[Problem, str]:
    """The windows that tell most, with so many samples as are allowed; and what to say if any are left out.

    Half of the blocks are spread evenly. The others are added one by one, each where the sum of the
    logarithms of the information on every parameter grows most, beside what the base parameters absorb.

    Args:
        candidates: The whole problem, with the start of a fit.
    """
    rows = candidates.options.rows
    problem = evenly(candidates.problem, max(rows, LOOKED_AT))[0]
    numbers = np.unique(problem.blocks)
    count = _count(problem, rows)
    if count >= len(numbers):
        return problem, ""
    some = evenly(problem, rows)[0]
    pilot = candidates.of(some)
    base = pilot.base()
    shares = _shares(problem, base, pilot.free(()), _directions(pilot, base))
    chosen = _grown(shares, _spread(len(numbers), round(EVEN * count)), count)
    kept = _kept(problem, numbers[chosen])
    held = 100.0 * shares[chosen].sum(axis=0)
    said = (
        f"{len(kept)} of {len(candidates.problem)} training windows are fitted: half of them are spread "
        "evenly over the record, the others say most about the parameters and the listed effects. They hold "
        f"{held.min():.0f} to {held.max():.0f} % of what all windows say about each "
        f"(median {np.median(held):.0f} %)"
    )
    if len(problem) < len(candidates.problem):
        said += f"; {len(problem)} windows were looked at, spread evenly"
    return kept, said


def _count(problem: Problem, rows: int, fewest: int = FEWEST) -> int:
    """Number of blocks with so many samples."""
    samples = sum(int(part.windows.lengths.sum()) for part in problem.parts)
    return max(int(rows * len(np.unique(problem.blocks)) / samples), fewest)


def _spread(total: int, count: int) -> IntArray:
    return np.unique(((np.arange(count) + 0.5) * total / count).astype(np.int64))


def _directions(candidates: Candidates, base: Candidate) -> FloatArray:
    """Parameter vectors with an effect switched on, a few for each, shape (vectors, parameters)."""
    found = []
    for name in candidates.names():
        starts = candidates.start_vectors(base, candidates.problem.model.effect(name))
        some = np.unique(np.linspace(0, len(starts) - 1, STARTS).astype(np.int64))
        found.append(starts[some].reshape(-1, starts.shape[2]))
    return np.concatenate(found) if found else np.zeros((0, len(base.fit.parameters)))


def _shares(problem: Problem, base: Candidate, free: IntArray, directions: FloatArray) -> FloatArray:
    """Share of every block in the information on each base parameter and direction, shape (blocks, columns).

    Of each what the other base parameters absorb is taken away, by one regression over all windows.
    """
    number = np.unique(problem.blocks, return_inverse=True)[1]
    size = len(free) + len(directions)
    grams = np.zeros((number.max() + 1, size, size))
    samples = sum(part.slots.shape[0] * part.slots.shape[1] for part in problem.parts)
    chunks = 1 + samples * len(directions) // AT_ONCE
    for chunk in np.array_split(np.arange(len(problem)), chunks):
        inside = np.isin(np.arange(len(problem)), chunk)
        some = problem.select(inside)
        settled = fit(some, base.fit.parameters, free[:0], base.fit.whitener, iterations=3)
        here = fit(some, base.fit.parameters, free, base.fit.whitener, settled.states, 0)
        change = some.simulate(directions, here.states) - (some.features - here.raw)
        columns = np.concatenate([here.jacobian, project(here, np.moveaxis(change, 0, 2))], axis=2)
        np.add.at(grams, number[inside], np.einsum("wfi,wfj->wij", columns, columns, optimize=True))
    whole = grams.sum(axis=0)
    found = np.empty((len(grams), size))
    for k in range(size):
        others = np.array([i for i in range(len(free)) if i != k], dtype=np.int64)
        absorbed = np.linalg.pinv(whole[np.ix_(others, others)], hermitian=True) @ whole[others, k]
        column = np.zeros(size)
        column[k], column[others] = 1.0, -absorbed
        found[:, k] = np.maximum(np.einsum("i,bij,j->b", column, grams, column, optimize=True), 0.0)
    totals = found.sum(axis=0)
    told = totals > 1e-9 * np.diag(whole).max()
    return np.asarray(found[:, told] / totals[told])


def _grown(shares: FloatArray, first: IntArray, count: int) -> IntArray:
    """Blocks from the first ones to so many, each where the sum of logarithms grows most; in order."""
    chosen = np.zeros(len(shares), dtype=np.bool_)
    chosen[first] = True
    held = shares[chosen].sum(axis=0)
    tiny = 1e-6 / len(shares)
    for _ in range(count - len(first)):
        gains = np.log(held + shares + tiny).sum(axis=1)
        gains[chosen] = -np.inf
        best = int(np.argmax(gains))
        chosen[best] = True
        held = held + shares[best]
    return np.flatnonzero(chosen)


def _kept(problem: Problem, numbers: IntArray) -> Problem:
    """Some blocks of a problem, numbered anew; simulations look at these and what led to them alone."""
    chosen = problem.select(np.isin(problem.blocks, numbers))
    parts = []
    for part in chosen.parts:
        windows = part.windows
        recording = windows.recording
        lead = round(LED * problem.horizon / recording.step)
        bounds = recording.bounds
        episode = bounds[np.searchsorted(bounds[:, 0], windows.starts, side="right") - 1]
        begins = np.maximum(windows.starts - lead, episode[:, 0])
        ends = np.minimum(windows.starts + windows.lengths + 1, episode[:, 1])
        apart = np.r_[True, begins[1:] > ends[:-1]]
        needed = np.column_stack([begins[apart], ends[np.r_[apart[1:], True]]])
        blocks = np.unique(part.blocks, return_inverse=True)[1]
        parts.append(replace(part, windows=replace(windows, needed=needed), blocks=blocks))
    return replace(chosen, parts=tuple(parts))
