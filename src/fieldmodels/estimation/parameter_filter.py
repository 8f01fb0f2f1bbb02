"""Filters for unknowns that enter linearly, A x = F, with noise in A itself (errors in variables).

A and F are linear in the measured features y of a sample (``Terms``). So the sum of y y' over the samples,
and the sum of the covariance V of their noise, are sufficient statistics for any weights W of the equations:
they give A'WA, A'WF, and the moments E[dA'WdA], E[dA'WdF] that noise adds to them. The filters differ in how
they use these:

* ``naive``: the Kalman filter as published (section IV of Sujan and Dubowsky; constant unknowns, no
  process noise, R_k the noise of F). It treats A as exact: E[dA'WdA] counts as information and pulls the
  estimate towards zero.
* ``compensated``: subtracts both moments (bias-compensated least squares, Söderström 2007), weights each
  equation by the noise of F - A x at the current estimate, and uses the score's actual covariance.
* ``low_passed``: the same on means of 8 neighbouring samples, for regressor and target.

The compensated filter in a few lines, unknowns scaled to prior mean 0 and prior covariance I:

    W = (covariance of F - A x, expected over a widened current estimate)^-1
    N = sum A'WA                      measured
    M = N - sum E[dA'WdA]             the same without noise, on average
    g = sum A'WF - E[dA'WdF]          a measurement of M x whose noise has covariance N
    information = I + M N^-1 M,   mean = information^-1 M N^-1 g

N is a sum of squares and the information at least the prior's, so nothing becomes singular even if noise
makes M indefinite; and unexcited directions stay nearly as uncertain as in the prior (CAUTION).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from threading import get_ident
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import allocation_free, allocation_free_inlined, compiled, inlined
from fieldmodels.model import ModelError
from fieldmodels.threads import run_rows


class Terms(NamedTuple):
    """A and F of one mode as linear functions of its features.

    [A | F][row, column] = sum of coefficient * y[feature]; the last column is F.

    Attributes:
        row: Equation, int64, shape (terms,).
        column: Unknown, or the number of unknowns for F; int64, shape (terms,).
        feature: Feature that is multiplied, int64, shape (terms,).
        coefficient: Shape (terms,).
    """

    row: NDArray[np.int64]
    column: NDArray[np.int64]
    feature: NDArray[np.int64]
    coefficient: FloatArray


class Pairs(NamedTuple):
    """Every two terms of one equation or two, each with itself and those before it, as places in matrices.

    Unsigned: a place that might be counted from the end would be looked at twice.

    Attributes:
        rows: Of both terms' equations in a matrix (rows, rows), flattened; shape (pairs,).
        columns: Of their unknowns in one of (unknowns + 1, unknowns + 1).
        features: Of their features in the upper triangle of one of (K, K).
        coefficient: Product of theirs, half of it for a term with itself.
    """

    rows: NDArray[np.uint32]
    columns: NDArray[np.uint32]
    features: NDArray[np.uint32]
    coefficient: FloatArray


def pairs_of(terms: Terms) -> Pairs:
    """The pairs of terms, so that a kernel need not look for them again in every mode and pass."""
    a, b = np.tril_indices(len(terms.row))

    def place(
        of: NDArray[np.int64], first: NDArray[np.int64], second: NDArray[np.int64]
    ) -> NDArray[np.uint32]:
        return np.asarray(first * (of.max() + 1) + second, dtype=np.uint32)

    row, column, feature = (np.asarray(part, dtype=np.int64) for part in terms[:3])
    low, high = np.minimum(feature[a], feature[b]), np.maximum(feature[a], feature[b])
    factor = np.asarray(terms.coefficient, dtype=np.float64)
    return Pairs(
        place(row, row[a], row[b]),
        place(column, column[a], column[b]),
        place(feature, low, high),
        factor[a] * factor[b] * np.where(a == b, 0.5, 1.0),
    )


class Method(NamedTuple):
    """How a filter uses the statistics.

    Attributes:
        compensated: False treats A as exact.
        average: Neighbouring samples that are averaged first.
    """

    compensated: bool
    average: int


METHODS: Mapping[str, Method] = {
    "naive": Method(False, 1),
    "compensated": Method(True, 1),
    "low_passed": Method(True, 8),
}
PASSES = 2
"""Number of alternations between weights and estimate in one update (each starts from the last)."""
CAUTION = 16.0
"""Factor of the estimate's covariance in the noise of the equations: twice the unknowns of an equation (8).

M of noise alone is not zero but fluctuates, and M N^-1 M is then the number of unknowns in an equation times
their share in its noise: spurious information, which would shrink the covariance, and with it the noise, and
so reinforce itself. This factor prevents that; where the motion excites, the covariance soon adds nothing to
the noise.
"""

# Information given to an unexcited direction, on top of the prior's 1: keeps N definite.
_FLOOR = 1e-6
# Numbers that a loop takes in one go, several of the processor's vectors.
WIDTH = 16
# Rounding of sums, relative.
_ROUNDING = 1e-12


class Room(NamedTuple):
    """Arrays in which an estimate is worked out: kernels that create none compile faster.

    Flat ones are views of those above them.

    Attributes:
        second: Shape (unknowns + 1, unknowns + 1), as the next two.
        measured: Half of [A | F]' W [A | F], then all of it.
        free: The same without the noise's moments.
        score: Shape (unknowns, unknowns), as the next two.
        information: Of the estimate.
        root: Of a triangular matrix' inverse.
        right: Shape (unknowns, unknowns + 1).
        weights: Of a mode's equations, shape (rows, rows), as the next two.
        factor: Their Cholesky factor.
        row_root: Its inverse.
    """

    second: FloatArray
    measured: FloatArray
    free: FloatArray
    flat_second: FloatArray
    flat_measured: FloatArray
    flat_free: FloatArray
    score: FloatArray
    information: FloatArray
    root: FloatArray
    right: FloatArray
    weights: FloatArray
    flat_weights: FloatArray
    factor: FloatArray
    row_root: FloatArray


def room_for(unknowns: int, rows: int) -> Room:
    """Room for an estimate of so many unknowns from so many equations a mode."""
    n = unknowns + 1
    second, measured, free = np.empty((3, n, n))
    score, information, root = np.empty((3, unknowns, unknowns))
    weights, factor, row_root = np.empty((3, rows, rows))
    return Room(
        second, measured, free, second.reshape(-1), measured.reshape(-1), free.reshape(-1),
        score, information, root, np.empty((unknowns, n)), weights, weights.reshape(-1), factor, row_root,
    )  # fmt: skip


@allocation_free_inlined
def clear(matrix: FloatArray) -> None:
    """Set a matrix to zero."""
    for i in range(matrix.shape[0]):
        for j in range(matrix.shape[1]):
            matrix[i, j] = 0.0


@allocation_free_inlined
def copy_to(out: FloatArray, values: FloatArray) -> None:
    """Write a matrix, or its first columns; assigned to a slice, it takes seconds to compile."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = values[i, j]


@allocation_free_inlined
def all_finite(values: FloatArray) -> bool:
    """Whether a matrix holds no other than finite numbers."""
    odd = 0
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            odd += 0 if abs(values[i, j]) < np.inf else 1
    return odd == 0


@inlined
def accumulate(y: FloatArray, average: int, moments: FloatArray) -> None:
    """Add a chunk of one mode to its sum of y y', in place.

    Means of neighbouring samples are one and the same low-pass of regressor and target, so that A x = F
    still holds, and white noise stays white.

    Args:
        y: Features, shape (samples, K).
        average: Neighbouring samples that are averaged first; divides the samples.
        moments: Shape (K, K); the upper triangle is kept.
    """
    features, blocks = y.shape[1], len(y) // average
    share = 1.0 / average
    rows, width = (blocks + 3) // 4 * 4, (features + WIDTH - 1) // WIDTH * WIDTH
    means = np.zeros((rows, width))
    for block in range(blocks):
        for j in range(average):
            for k in range(features):
                means[block, k] += y[block * average + j, k]
        for k in range(features):
            means[block, k] *= share
    # Whole rows, four samples at a time in the order of one by one: half of it is for nothing, but each sum
    # is loaded and stored once for four products, and a row is as long as some of the processor's vectors.
    sums = np.zeros((features, width))
    for k in range(features):
        for m in range(features):
            sums[k, m] = moments[k, m]
    for i in range(0, rows, 4):
        for k in range(features):
            one, two, three, four = means[i, k], means[i + 1, k], means[i + 2, k], means[i + 3, k]
            for m in range(width):
                total = sums[k, m] + one * means[i, m]
                total = total + two * means[i + 1, m]
                total = total + three * means[i + 2, m]
                sums[k, m] = total + four * means[i + 3, m]
    for k in range(features):
        for m in range(k, features):
            moments[k, m] = sums[k, m]


@allocation_free_inlined
def accumulate_noise(noise: FloatArray, average: int, total: FloatArray) -> None:
    """Add the noise of a chunk, summed over its samples, as it is after averaging; upper triangles."""
    share = 1.0 / (average * average)
    for k in range(len(noise)):
        for m in range(k, len(noise)):
            total[k, m] += noise[k, m] * share


@allocation_free
def estimate(
    pairs: Pairs,
    moments: FloatArray,
    noise: FloatArray,
    samples: float,
    active: NDArray[np.bool_],
    prior_mean: FloatArray,
    prior_deviation: FloatArray,
    compensated: bool,
    passes: int,
    mean: FloatArray,
    covariance: FloatArray,
    room: Room,
) -> None:
    """Estimate the unknowns from the statistic, in place of the last estimate.

    Args:
        pairs: Of the terms of every mode.
        moments: Sum of y y' of each mode, shape (modes, K * K), upper triangles.
        noise: Sum of V of each mode, of that shape.
        samples: Number of samples (after averaging) in both sums, positive.
        active: Which equations of each mode are used, shape (modes, rows).
        prior_mean: Shape (unknowns,).
        prior_deviation: Standard deviations, shape (unknowns,); 0 holds an unknown at its prior mean.
        compensated: False treats A as exact.
        passes: How often weights and estimate are found from each other.
        mean: The last estimate, or the prior's; becomes the new one; shape (unknowns,).
        covariance: The same, shape (unknowns, unknowns).
        room: Overwritten.
    """
    n = len(prior_mean)
    second, measured, free, right = room.second, room.measured, room.free, room.right
    score, information = room.score, room.information
    for _ in range(passes if compensated else 1):
        _second_moment(mean, covariance, compensated, second)
        clear(measured)
        clear(free)
        for mode in range(len(moments)):
            row_noise(pairs, room.flat_second, noise[mode], 1.0 / samples, room.weights, room.flat_weights)
            _invert(room.weights, active[mode], room.factor, room.row_root)
            _contract(
                pairs, room.flat_weights, moments[mode], noise[mode], room.flat_measured, room.flat_free
            )
        add_transposed(measured)
        add_transposed(free)
        if not compensated:
            copy_to(free, measured)
        # Scaled by the prior's deviations, around the prior's mean.
        for i in range(n):
            target = free[i, n]
            for j in range(n):
                target -= free[i, j] * prior_mean[j]
                scale = prior_deviation[i] * prior_deviation[j]
                right[i, j] = free[i, j] * scale
                score[i, j] = measured[i, j] * scale
            right[i, n] = target * prior_deviation[i]
            score[i, i] += _FLOOR + _ROUNDING * score[i, i]
        if compensated:
            _cholesky(score)
            _forward(score, right)
            _gram(right, information)
        else:
            # M = N: then M N^-1 M is N itself, and M N^-1 g is g.
            copy_to(information, right)
        for i in range(n):
            information[i, i] += 1.0
            total = 0.0
            if compensated:
                for k in range(n):
                    total += right[k, i] * right[k, n]
            else:
                total = right[i, n]
            mean[i] = total
        _cholesky(information)
        _inverse(information, score, room.root)
        for i in range(n):
            total = 0.0
            for j in range(n):
                total += score[i, j] * mean[j]
            second[i, n] = total
        for i in range(n):
            mean[i] = prior_mean[i] + prior_deviation[i] * second[i, n]
            for j in range(n):
                covariance[i, j] = score[i, j] * (prior_deviation[i] * prior_deviation[j])


@allocation_free
def row_noise(
    pairs: Pairs, second: FloatArray, noise: FloatArray, share: float, out: FloatArray, total: FloatArray
) -> None:
    """Covariance of the noise of the equations F - A x of one mode, in place of ``out``, (rows, rows).

    Args:
        pairs: Of the mode's terms.
        second: E[z z'] of z = (x, -1), (unknowns + 1, unknowns + 1) flattened.
        noise: Covariance of the features' noise, (K, K) flattened, upper triangle.
        share: Factor of the noise.
        out: Overwritten.
        total: The same flattened.
    """
    clear(out)
    for p in range(len(pairs.rows)):
        moment = noise[pairs.features[p]]
        if moment != 0.0:
            total[pairs.rows[p]] += share * pairs.coefficient[p] * second[pairs.columns[p]] * moment
    add_transposed(out)


@allocation_free_inlined
def add_transposed(matrix: FloatArray) -> None:
    """Make a square matrix the sum of itself and its transpose, in place."""
    for i in range(len(matrix)):
        for j in range(i + 1):
            matrix[i, j] = matrix[j, i] = matrix[i, j] + matrix[j, i]


@allocation_free_inlined
def _second_moment(mean: FloatArray, covariance: FloatArray, uncertain: bool, out: FloatArray) -> None:
    """E[z z'] of z = (x, -1), widened; for the naive filter that of (0, -1), the noise of F alone."""
    n = len(mean)
    clear(out)
    if uncertain:
        for i in range(n):
            for j in range(n):
                out[i, j] = mean[i] * mean[j] + CAUTION * covariance[i, j]
            out[i, n] = -mean[i]
            out[n, i] = -mean[i]
    out[n, n] = 1.0


@allocation_free
def _contract(
    pairs: Pairs,
    weights: FloatArray,
    seen: FloatArray,
    erring: FloatArray,
    total: FloatArray,
    rest: FloatArray,
) -> None:
    """Add half of [A | F]' W [A | F] of one mode, as measured and freed of the noise's moments.

    The other half is its transpose. All matrices are flattened.
    """
    for p in range(len(pairs.rows)):
        weight, i, k = weights[pairs.rows[p]] * pairs.coefficient[p], pairs.columns[p], pairs.features[p]
        total[i] += weight * seen[k]
        rest[i] += weight * (seen[k] - erring[k])


@allocation_free
def _invert(matrix: FloatArray, active: NDArray[np.bool_], factor: FloatArray, root: FloatArray) -> None:
    """Turn the covariance of equations into their weights, in place; equations left out weigh nothing."""
    size = len(matrix)
    trace = 0.0
    for i in range(size):
        trace += matrix[i, i] if active[i] else 0.0
    # An equation without noise (a signal that never moved) stays finite: a millionth of the others'
    # deviation, and never below 1e-9 of a newton.
    floor = 1e-12 * trace + 1e-18
    for i in range(size):
        if not active[i]:
            for k in range(size):
                matrix[i, k] = matrix[k, i] = 0.0
        matrix[i, i] += floor
    copy_to(factor, matrix)
    _cholesky(factor)
    _inverse(factor, matrix, root)
    for i in range(size):
        if not active[i]:
            matrix[i, i] = 0.0


@allocation_free
def _cholesky(matrix: FloatArray) -> None:
    """Lower Cholesky factor in place; the upper triangle is left as it was."""
    size = len(matrix)
    for j in range(size):
        least = _ROUNDING * matrix[j, j]
        for k in range(j):
            matrix[j, j] -= matrix[j, k] * matrix[j, k]
        root = math.sqrt(max(matrix[j, j], least))
        matrix[j, j] = root
        for i in range(j + 1, size):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = total / root


@allocation_free
def _forward(factor: FloatArray, right: FloatArray) -> None:
    """Solve L z = right in place, for each column of ``right``."""
    columns = right.shape[1]
    for i in range(len(factor)):
        for k in range(i):
            value = factor[i, k]
            if value != 0.0:
                for c in range(columns):
                    right[i, c] -= value * right[k, c]
        value = 1.0 / factor[i, i]
        for c in range(columns):
            right[i, c] *= value


@allocation_free
def _gram(z: FloatArray, out: FloatArray) -> None:
    """Z'Z of the leading square of ``z``, in place of ``out``."""
    n = len(z)
    clear(out)
    for k in range(n):
        for i in range(n):
            value = z[k, i]
            if value != 0.0:
                for j in range(n):
                    out[i, j] += value * z[k, j]


@allocation_free
def _inverse(factor: FloatArray, out: FloatArray, root: FloatArray) -> None:
    """(L L')^-1 in place of ``out``, exactly symmetric; L^-1 in place of ``root``."""
    size = len(factor)
    clear(root)
    for i in range(size):
        root[i, i] = 1.0
    _forward(factor, root)
    clear(out)
    for k in range(size):
        for i in range(k + 1):
            value = root[k, i]
            if value != 0.0:
                for j in range(k + 1):
                    out[i, j] += value * root[k, j]


@compiled
def _accumulate_all(
    y: FloatArray, noise: FloatArray, average: int, last: FloatArray, last_noise: FloatArray,
    moments: FloatArray, total: FloatArray, finite: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Sums of each filter from the last ones, which stay as they are; ``finite`` stays where a chunk is."""
    for b in range(len(y)):
        for mode in range(y.shape[1]):
            copy_to(moments[b, mode], last[b, mode])
            copy_to(total[b, mode], last_noise[b, mode])
            accumulate(y[b, mode], average, moments[b, mode])
            accumulate_noise(noise[b, mode], average, total[b, mode])
            if not (all_finite(y[b, mode]) and all_finite(noise[b, mode])):
                finite[b] = False


@allocation_free
def _estimate_all(
    room: Room,
    pairs: Pairs,
    moments: FloatArray,
    noise: FloatArray,
    samples: FloatArray,
    active: NDArray[np.bool_],
    prior_mean: FloatArray,
    prior_deviation: FloatArray,
    compensated: bool,
    passes: int,
    mean: FloatArray,
    covariance: FloatArray,
) -> None:
    for b in range(len(mean)):
        if samples[b] > 0.0:
            estimate(
                pairs,
                moments[b],
                noise[b],
                samples[b],
                active,
                prior_mean[b],
                prior_deviation,
                compensated,
                passes,
                mean[b],
                covariance[b],
                room,
            )


@lru_cache(maxsize=64)
def _own_room(unknowns: int, rows: int, _thread: int) -> Room:
    """A thread's room, made once."""
    return room_for(unknowns, rows)


def _estimated(pairs: Pairs, moments: FloatArray, noise: FloatArray, *others: Any) -> None:
    """``_estimate_all`` of a share of the filters, in its thread's room."""
    flat = (*moments.shape[:2], moments.shape[2] * moments.shape[3])
    mean, active = others[-2], others[1]
    room = _own_room(mean.shape[1], active.shape[1], get_ident())
    _estimate_all(room, pairs, moments.reshape(flat), noise.reshape(flat), *others)


class ParameterFilters:
    """A batch of filters, each given the same samples and read by one or more methods.

    Attributes:
        mean: Estimates by method, each of shape (batch, unknowns).
        covariance: Their covariances by method, each of shape (batch, unknowns, unknowns).
        threads: On which filters are updated, side by side.
    """

    threads = 1

    def __init__(
        self,
        batch: int,
        terms: Terms,
        prior_mean: ArrayLike,
        prior_deviation: ArrayLike,
        *,
        modes: int = 3,
        methods: Sequence[str] = ("compensated",),
        active: ArrayLike | None = None,
        passes: int = PASSES,
    ) -> None:
        """Make filters that know the prior.

        Args:
            batch: Number of filters.
            terms: A and F of a mode.
            prior_mean: Shape (unknowns,).
            prior_deviation: Prior standard deviations, shape (unknowns,); 0 holds an unknown at its mean.
            modes: Runs side by side whose equations are stacked.
            methods: Names out of ``METHODS``.
            active: Which equations of each mode are used, shape (modes, rows) or (modes * rows,); None uses
                all.
            passes: How often weights and estimate are found from each other in one update.

        Raises:
            ModelError: If shapes do not fit, a deviation is negative, or a method is unknown.
        """
        unknown = [name for name in methods if name not in METHODS]
        if unknown or not methods:
            raise ModelError(
                f"methods must be out of {', '.join(METHODS)}, not {', '.join(unknown) or 'none'}"
            )
        if batch < 1 or modes < 1 or passes < 1:
            raise ModelError("batch, modes and passes are each at least 1")
        self._pairs = pairs_of(terms)
        self._prior_mean = np.tile(np.asarray(prior_mean, dtype=np.float64), (batch, 1))
        self._prior_deviation = np.array(prior_deviation, dtype=np.float64)
        unknowns = self._prior_mean.shape[1]
        if self._prior_deviation.shape != (unknowns,) or terms.column.max() != unknowns:
            raise ModelError(f"the terms have {terms.column.max()} unknowns; the prior must have as many")
        if not np.all(self._prior_deviation >= 0.0) or not np.all(np.isfinite(self._prior_mean)):
            raise ModelError("the prior needs finite means and standard deviations of at least zero")
        rows = int(terms.row.max()) + 1
        flags = np.ones((modes, rows), dtype=np.bool_) if active is None else np.array(active, dtype=np.bool_)
        if flags.shape not in ((modes, rows), (modes * rows,)):
            raise ModelError(f"active needs a flag for each of {modes} x {rows} equations, not {flags.shape}")
        self._active = flags.reshape(modes, rows)
        self.methods = tuple(methods)
        self._passes = passes
        self._features = int(terms.feature.max()) + 1
        shape = (batch, modes, self._features, self._features)
        averages = sorted({METHODS[name].average for name in methods})
        self._moments = {average: np.zeros(shape) for average in averages}
        self._noise = {average: np.zeros(shape) for average in averages}
        self._samples = np.zeros(batch)
        self.mean = {name: self._prior_mean.copy() for name in methods}
        self.covariance = {
            name: np.tile(np.diag(self._prior_deviation**2), (batch, 1, 1)) for name in methods
        }

    def __len__(self) -> int:
        """Number of filters."""
        return len(self._samples)

    def restart(self, which: Iterable[int] | None = None, prior_mean: ArrayLike | None = None) -> None:
        """Forget all samples of some filters, or of all.

        Args:
            which: Their numbers; None for all.
            prior_mean: What they take for the prior's mean from now on, shape (unknowns,) or
                (len(which), unknowns); None keeps it.
        """
        index = slice(None) if which is None else np.array(list(which), dtype=np.int64)
        if prior_mean is not None:
            self._prior_mean[index] = prior_mean
        self._samples[index] = 0.0
        for sums in (self._moments, self._noise):
            for average, last in sums.items():  # which may have been given away
                sums[average] = last.copy()
                sums[average][index] = 0.0
        for name in self.methods:
            self.mean[name][index] = self._prior_mean[index]
            self.covariance[name][index] = np.diag(self._prior_deviation**2)

    def update(self, features: ArrayLike, noise: ArrayLike) -> None:
        """Take in a chunk of samples and estimate anew.

        Args:
            features: y, shape (batch, modes, samples, K); samples divisible by each method's average.
            noise: V summed over the chunk's samples, shape (batch, modes, K, K).

        Raises:
            ModelError: If a shape does not fit or a number is not finite; nothing is taken in then.
        """
        y = np.ascontiguousarray(features, dtype=np.float64)
        v = np.ascontiguousarray(noise, dtype=np.float64)
        batch, modes, k = next(iter(self._moments.values())).shape[:3]
        if y.ndim != 4 or (y.shape[0], y.shape[1], y.shape[3]) != (batch, modes, k) or y.shape[2] == 0:
            raise ModelError(f"features must have shape ({batch}, {modes}, samples, {k}), not {y.shape}")
        if v.shape != (batch, modes, k, k):
            raise ModelError(f"noise must have shape ({batch}, {modes}, {k}, {k}), not {v.shape}")
        for average in self._moments:
            if y.shape[2] % average:
                raise ModelError(f"a chunk must hold a multiple of {average} samples, not {y.shape[2]}")
        finite, sums = np.ones(batch, dtype=np.bool_), {}
        for average, last in self._moments.items():
            sums[average] = np.empty_like(last), np.empty_like(last)
            run_rows(
                self.threads, batch, _accumulate_all, y, v, average, last, self._noise[average],
                *sums[average], finite,
            )  # fmt: skip
        if not finite.all():
            raise ModelError("features and noise must be finite")
        for average, own in sums.items():
            self._moments[average], self._noise[average] = own
        self._samples += y.shape[2]
        for name in self.methods:
            method = METHODS[name]
            run_rows(
                self.threads,
                batch,
                _estimated,
                self._pairs,
                self._moments[method.average],
                self._noise[method.average],
                self._samples / method.average,
                self._active,
                self._prior_mean,
                self._prior_deviation,
                method.compensated,
                self._passes,
                self.mean[name],
                self.covariance[name],
                whole=(0, 4, 6),
            )

    def statistic(self, method: str) -> tuple[FloatArray, FloatArray, FloatArray]:
        """What one method reads: moments and noise (batch, modes, K, K), samples (batch,); never changed."""
        average = METHODS[method].average
        return self._moments[average], self._noise[average], self._samples / average

    def state(self) -> dict[str, FloatArray]:
        """An exact snapshot: plain arrays by name."""
        parts = {f"moments_{a}": m for a, m in self._moments.items()}
        parts |= {f"noise_{a}": v for a, v in self._noise.items()}
        parts |= {f"mean_{name}": m for name, m in self.mean.items()}
        parts |= {f"covariance_{name}": c for name, c in self.covariance.items()}
        return {name: part.copy() for name, part in (parts | {"samples": self._samples}).items()}

    def set_state(self, state: Mapping[str, FloatArray]) -> None:
        """Return to a snapshot.

        Raises:
            ModelError: If the snapshot is of other filters.
        """
        own = self.state()
        if own.keys() != state.keys() or any(own[name].shape != state[name].shape for name in own):
            raise ModelError("the snapshot is of filters with other methods, modes, or another batch size")
        for average in self._moments:
            self._moments[average] = state[f"moments_{average}"].copy()
            self._noise[average] = state[f"noise_{average}"].copy()
        for name in self.methods:
            self.mean[name][...] = state[f"mean_{name}"]
            self.covariance[name][...] = state[f"covariance_{name}"]
        self._samples[...] = state["samples"]
