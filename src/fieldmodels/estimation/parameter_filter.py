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
# Filters that are worked out side by side where there are as many.
BESIDE = 8
# Rounding of sums, relative.
_ROUNDING = 1e-12


def room_for(unknowns: int, rows: int, features: int, modes: int, beside: int) -> np.dtype[Any]:
    """Room for the estimates of some filters, each number of which is a row of as many columns.

    Flat fields lie over those before them. Of an array in a record the compiler knows the shape.

    Args:
        unknowns: Number of unknowns.
        rows: Of equations in a mode.
        features: Of features in a mode.
        modes: Of modes.
        beside: Of filters side by side.
    """
    n, k = unknowns, features
    fields: list[tuple[tuple[str, ...], tuple[int, ...]]] = [
        (("moments",), (modes, k * k)),
        (("noise",), (modes, k * k)),
        (("share",), ()),  # one over the samples
        (("prior",), (n,)),
        (("mean",), (n,)),
        (("covariance",), (n, n)),
        (("second", "flat_second"), (n + 1, n + 1)),  # E[z z'] of z = (x, -1)
        (("measured", "flat_measured"), (n + 1, n + 1)),  # half of [A | F]' W [A | F], then all of it
        (("free", "flat_free"), (n + 1, n + 1)),  # the same without the noise's moments
        (("score",), (n, n)),
        (("information",), (n, n)),
        (("root",), (n, n)),  # of a triangular matrix' inverse
        (("right",), (n, n + 1)),
        (("weights", "flat_weights"), (rows, rows)),  # of a mode's equations
        (("factor",), (rows, rows)),  # their Cholesky factor
        (("row_root",), (rows, rows)),  # its inverse
    ]
    names, formats, offsets, end = [], [], [], 0
    for same, shape in fields:
        size = math.prod(shape) * beside
        for name, own in zip(same, (shape, (math.prod(shape),)), strict=False):
            names.append(name)
            formats.append((np.float64, (*own, beside)))
            offsets.append(8 * end)
        end += size
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": 8 * end})


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
    samples: FloatArray,
    active: NDArray[np.bool_],
    prior_mean: FloatArray,
    prior_deviation: FloatArray,
    compensated: bool,
    passes: int,
    mean: FloatArray,
    covariance: FloatArray,
    room: Any,
) -> None:
    """Estimate the unknowns of filters from their statistics, in place of the last estimates.

    Args:
        pairs: Of the terms of every mode.
        moments: Sums of y y' of each mode, shape (filters, modes, K * K), upper triangles; as many filters as
            there is room for, or fewer.
        noise: Sums of V of each mode, of that shape.
        samples: Number of samples (after averaging) in both sums, shape (filters,); without any, an estimate
            stays.
        active: Which equations of each mode are used, shape (modes, rows).
        prior_mean: Shape (filters, unknowns).
        prior_deviation: Standard deviations, shape (unknowns,); 0 holds an unknown at its prior mean.
        compensated: False treats A as exact.
        passes: How often weights and estimate are found from each other.
        mean: The last estimates, or the prior's; become the new ones; shape (filters, unknowns).
        covariance: The same, shape (filters, unknowns, unknowns).
        room: Of a dtype of ``room_for``; overwritten.
    """
    n, lanes = len(prior_deviation), room.share.shape[0]
    _put_in(moments, noise, samples, prior_mean, mean, covariance, room)
    score, information, right = room.score, room.information, room.right
    for _ in range(passes if compensated else 1):
        _second_moment(room.mean, room.covariance, compensated, room.second)
        clear(room.flat_measured)
        clear(room.flat_free)
        for mode in range(len(active)):
            row_noise(pairs, room.flat_second, room.noise[mode], room.share, room.weights, room.flat_weights)
            _invert(room.weights, active[mode], room.factor, room.row_root)
            _contract(
                pairs, room.flat_weights, room.moments[mode], room.noise[mode], room.flat_measured,
                room.flat_free,
            )  # fmt: skip
        add_transposed(room.measured)
        add_transposed(room.free)
        if not compensated:
            copy_to(room.flat_free, room.flat_measured)
        # Scaled by the prior's deviations, around the prior's mean.
        for i in range(n):
            for m in range(lanes):
                right[i, n, m] = room.free[i, n, m]
            for j in range(n):
                scale = prior_deviation[i] * prior_deviation[j]
                for m in range(lanes):
                    right[i, n, m] -= room.free[i, j, m] * room.prior[j, m]
                    right[i, j, m] = room.free[i, j, m] * scale
                    score[i, j, m] = room.measured[i, j, m] * scale
            for m in range(lanes):
                right[i, n, m] *= prior_deviation[i]
                score[i, i, m] += _FLOOR + _ROUNDING * score[i, i, m]
        # Where A is exact M = N: then M N^-1 M is N itself, and M N^-1 g is g.
        if compensated:
            _cholesky(score)
            _forward(score, right)
            _gram(right, information)
        for i in range(n):
            if compensated:
                for m in range(lanes):
                    room.mean[i, m] = 0.0
                for k in range(n):
                    for m in range(lanes):
                        room.mean[i, m] += right[k, i, m] * right[k, n, m]
            else:
                for m in range(lanes):
                    room.mean[i, m] = right[i, n, m]
                    for j in range(n):
                        information[i, j, m] = right[i, j, m]
            for m in range(lanes):
                information[i, i, m] += 1.0
        _cholesky(information)
        _inverse(information, score, room.root)
        for i in range(n):
            for m in range(lanes):
                room.second[i, n, m] = 0.0
            for j in range(n):
                for m in range(lanes):
                    room.second[i, n, m] += score[i, j, m] * room.mean[j, m]
        for i in range(n):
            for m in range(lanes):
                room.mean[i, m] = room.prior[i, m] + prior_deviation[i] * room.second[i, n, m]
            for j in range(n):
                for m in range(lanes):
                    deviations = prior_deviation[i] * prior_deviation[j]
                    room.covariance[i, j, m] = score[i, j, m] * deviations
    for b in range(len(mean)):
        if samples[b] > 0.0:
            for i in range(n):
                mean[b, i] = room.mean[i, b]
                for j in range(n):
                    covariance[b, i, j] = room.covariance[i, j, b]


@allocation_free
def _put_in(
    moments: FloatArray, noise: FloatArray, samples: FloatArray, prior_mean: FloatArray, mean: FloatArray,
    covariance: FloatArray, room: Any,
) -> None:  # fmt: skip
    """Let filters be columns; those that are left over repeat the last filter."""
    for m in range(room.share.shape[0]):
        b = m if m < len(mean) else len(mean) - 1
        room.share[m] = 1.0 / samples[b]
        for mode in range(moments.shape[1]):
            for k in range(moments.shape[2]):
                room.moments[mode, k, m], room.noise[mode, k, m] = moments[b, mode, k], noise[b, mode, k]
        for i in range(mean.shape[1]):
            room.prior[i, m], room.mean[i, m] = prior_mean[b, i], mean[b, i]
            for j in range(mean.shape[1]):
                room.covariance[i, j, m] = covariance[b, i, j]


@allocation_free
def row_noise(
    pairs: Pairs,
    second: FloatArray,
    noise: FloatArray,
    share: FloatArray,
    out: FloatArray,
    total: FloatArray,
) -> None:
    """Covariance of the noise of the equations F - A x of one mode, in place of ``out``.

    Args:
        pairs: Of the mode's terms.
        second: E[z z'] of z = (x, -1), (unknowns + 1, unknowns + 1) flattened, shape (..., beside).
        noise: Covariance of the features' noise, (K, K) flattened, upper triangle, shape (..., beside).
        share: Factor of the noise, shape (beside,).
        out: Overwritten, shape (rows, rows, beside).
        total: The same flattened.
    """
    clear(total)
    for p in range(len(pairs.rows)):
        factor, r, i, k = pairs.coefficient[p], pairs.rows[p], pairs.columns[p], pairs.features[p]
        noisy = False
        for m in range(total.shape[1]):
            noisy |= noise[k, m] != 0.0
        if noisy:  # most features' noises are independent
            for m in range(total.shape[1]):
                total[r, m] += share[m] * factor * second[i, m] * noise[k, m]
    add_transposed(out)


@allocation_free_inlined
def add_transposed(matrix: FloatArray) -> None:
    """Make a square matrix the sum of itself and its transpose, in place; shape (n, n, beside)."""
    for i in range(len(matrix)):
        for j in range(i + 1):
            for m in range(matrix.shape[2]):
                matrix[i, j, m] = matrix[j, i, m] = matrix[i, j, m] + matrix[j, i, m]


@allocation_free_inlined
def _second_moment(mean: FloatArray, covariance: FloatArray, uncertain: bool, out: FloatArray) -> None:
    """E[z z'] of z = (x, -1), widened; for the naive filter that of (0, -1), the noise of F alone."""
    n = len(mean)
    for m in range(mean.shape[1]):
        for i in range(n):
            for j in range(n):
                moment = mean[i, m] * mean[j, m] + CAUTION * covariance[i, j, m]
                out[i, j, m] = moment if uncertain else 0.0
            out[i, n, m] = out[n, i, m] = -mean[i, m] if uncertain else 0.0
        out[n, n, m] = 1.0


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

    The other half is its transpose. All matrices are flattened, shape (..., beside).
    """
    for p in range(len(pairs.rows)):
        factor, r, i, k = pairs.coefficient[p], pairs.rows[p], pairs.columns[p], pairs.features[p]
        for m in range(total.shape[1]):
            weight = weights[r, m] * factor
            total[i, m] += weight * seen[k, m]
            rest[i, m] += weight * (seen[k, m] - erring[k, m])


@allocation_free
def _invert(matrix: FloatArray, active: NDArray[np.bool_], factor: FloatArray, root: FloatArray) -> None:
    """Turn covariances of equations into their weights, in place; equations left out weigh nothing."""
    size = len(matrix)
    for m in range(matrix.shape[2]):
        trace = 0.0
        for i in range(size):
            trace += matrix[i, i, m] if active[i] else 0.0
        # An equation without noise (a signal that never moved) stays finite: a millionth of the others'
        # deviation, and never below 1e-9 of a newton.
        floor = 1e-12 * trace + 1e-18
        for i in range(size):
            if not active[i]:
                for k in range(size):
                    matrix[i, k, m] = matrix[k, i, m] = 0.0
            matrix[i, i, m] += floor
            for k in range(size):
                factor[i, k, m] = matrix[i, k, m]
    _cholesky(factor)
    _inverse(factor, matrix, root)
    for i in range(size):
        if not active[i]:
            for m in range(matrix.shape[2]):
                matrix[i, i, m] = 0.0


@allocation_free
def _cholesky(matrix: FloatArray) -> None:
    """Lower Cholesky factors in place, shape (n, n, beside); the upper triangle is left as it was."""
    size, lanes = len(matrix), matrix.shape[2]
    for j in range(size):
        for m in range(lanes):
            total = matrix[j, j, m]
            least = _ROUNDING * total
            for k in range(j):
                total -= matrix[j, k, m] * matrix[j, k, m]
            matrix[j, j, m] = math.sqrt(max(total, least))
        for i in range(j + 1, size):
            for k in range(j):
                for m in range(lanes):
                    matrix[i, j, m] -= matrix[i, k, m] * matrix[j, k, m]
            for m in range(lanes):
                matrix[i, j, m] /= matrix[j, j, m]


@allocation_free
def _forward(factor: FloatArray, right: FloatArray) -> None:
    """Solve L z = right in place, for each column of ``right``."""
    columns, lanes = right.shape[1], right.shape[2]
    for i in range(len(factor)):
        for c in range(columns):
            for k in range(i):
                for m in range(lanes):
                    right[i, c, m] -= factor[i, k, m] * right[k, c, m]
            for m in range(lanes):
                right[i, c, m] *= 1.0 / factor[i, i, m]


@allocation_free
def _gram(z: FloatArray, out: FloatArray) -> None:
    """The lower triangle of Z'Z of the leading squares of ``z``, in place of that of ``out``."""
    n, lanes = len(z), z.shape[2]
    for i in range(n):
        for j in range(i + 1):
            for m in range(lanes):
                out[i, j, m] = 0.0
            for k in range(n):
                for m in range(lanes):
                    out[i, j, m] += z[k, i, m] * z[k, j, m]


@allocation_free
def _inverse(factor: FloatArray, out: FloatArray, root: FloatArray) -> None:
    """(L L')^-1 in place of ``out``, exactly symmetric; L^-1 in place of the lower triangle of ``root``."""
    size, lanes = len(factor), factor.shape[2]
    for i in range(size):
        for c in range(i + 1):
            for m in range(lanes):
                root[i, c, m] = 1.0 if i == c else 0.0
            for k in range(c, i):
                for m in range(lanes):
                    root[i, c, m] -= factor[i, k, m] * root[k, c, m]
            for m in range(lanes):
                root[i, c, m] *= 1.0 / factor[i, i, m]
    for i in range(size):
        for j in range(i + 1):
            for m in range(lanes):
                out[i, j, m] = 0.0
            for k in range(i, size):
                for m in range(lanes):
                    out[i, j, m] += root[k, i, m] * root[k, j, m]
            for m in range(lanes):
                out[j, i, m] = out[i, j, m]


class Sums(NamedTuple):
    """Sums of a batch of filters before and after a chunk of samples.

    Attributes:
        average: Neighbouring samples that are averaged first.
        last: Sums of y y' so far, shape (batch, modes, K, K), which stay as they are.
        last_noise: Sums of V, of that shape.
        moments: Receives the new ones.
        noise: The same.
        finite: Stays True where all of a filter's chunk is finite, shape (batch,).
    """

    average: int
    last: FloatArray
    last_noise: FloatArray
    moments: FloatArray
    noise: FloatArray
    finite: NDArray[np.bool_]


@inlined
def add_chunk(sums: Sums, b: int, y: FloatArray, noise: FloatArray) -> None:
    """Add a chunk to filter ``b``'s sums.

    Args:
        sums: The sums.
        b: Its number.
        y: Features, shape (modes, samples, K).
        noise: V summed over the samples, shape (modes, K, K).
    """
    for mode in range(len(y)):
        copy_to(sums.moments[b, mode], sums.last[b, mode])
        copy_to(sums.noise[b, mode], sums.last_noise[b, mode])
        accumulate(y[mode], sums.average, sums.moments[b, mode])
        accumulate_noise(noise[mode], sums.average, sums.noise[b, mode])
        if not (all_finite(y[mode]) and all_finite(noise[mode])):
            sums.finite[b] = False


@compiled
def _add_chunks(sums: Sums, y: FloatArray, noise: FloatArray) -> None:
    for b in range(len(y)):
        add_chunk(sums, b, y[b], noise[b])


@allocation_free
def _estimate_all(
    room: Any,
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
    """``estimate`` of any number of filters."""
    beside = room[0].share.shape[0]
    for b in range(0, len(mean), beside):
        e = b + beside if b + beside < len(mean) else len(mean)
        estimate(
            pairs, moments[b:e], noise[b:e], samples[b:e], active, prior_mean[b:e], prior_deviation,
            compensated, passes, mean[b:e], covariance[b:e], room[0],
        )  # fmt: skip


@lru_cache(maxsize=64)
def _own_room(unknowns: int, rows: int, features: int, modes: int, beside: int, _thread: int) -> NDArray[Any]:
    """A thread's room, made once; nothing in it is read before it is written, but idle columns."""
    return np.zeros(1, room_for(unknowns, rows, features, modes, beside))


def _estimated(pairs: Pairs, moments: FloatArray, noise: FloatArray, *others: Any) -> None:
    """``_estimate_all`` of a share of the filters, in its thread's room."""
    batch, modes, features = moments.shape[:3]
    flat = (batch, modes, features * features)
    mean, active = others[-2], others[1]
    beside = BESIDE if batch > 1 else 1
    room = _own_room(mean.shape[1], active.shape[1], features, modes, beside, get_ident())
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
        sums = self.begin()
        for own in sums:
            run_rows(self.threads, batch, _add_chunks, own, y, v)
        self.finish(sums, y.shape[2])

    def begin(self) -> tuple[Sums, ...]:
        """Sums, one for each average in use, to which the caller adds a chunk of every filter."""
        return tuple(
            Sums(
                average, last, self._noise[average], np.empty_like(last), np.empty_like(last),
                np.ones(len(self), dtype=np.bool_),
            )
            for average, last in self._moments.items()
        )  # fmt: skip

    def finish(self, sums: Sequence[Sums], samples: int) -> None:
        """Take in the chunk, of so many samples, that was added to the sums, and estimate anew.

        Raises:
            ModelError: If a number is not finite; nothing is taken in then.
        """
        if not all(one.finite.all() for one in sums):
            raise ModelError("features and noise must be finite")
        for one in sums:
            self._moments[one.average], self._noise[one.average] = one.moments, one.noise
        self._samples += samples
        for name in self.methods:
            method = METHODS[name]
            run_rows(
                self.threads,
                len(self),
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
