"""Information in an estimate of a parameter [bits]: the n-bit channel of Sujan and Dubowsky, eqs (9)-(15).

A parameter lies in [low, high], divided into 2^n bins. Before measuring, all bins are equally likely:
H(x) = n bits. An estimate is a Gaussian truncated to the range; the entropy over its bins is H(x|y), and
In = H(x) - H(x|y) is the information gained, 0 to n bits. There are three forms of it:

* ``binned``: eq (15b) as a sum over bins. The reference, and slow.
* ``closed``: entropy of the truncated Gaussian, without bins; near ``binned`` where sigma >= 2 bins.
* ``fast``: one logarithm, of sigma alone; for kernels, rewards and searches.

All three clip a mean outside the range to its edge: the truncated Gaussian of a mean far outside has all
its mass in the outermost bin, which would count as certainty.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from fieldmodels.arrays import FloatArray
from fieldmodels.compiled import compiled, inlined
from fieldmodels.model import ModelError

BITS = 10
"""Precision of the source's sensors [bits] (section VII-A)."""

_TWO_PI_E = 2.0 * math.pi * math.e
# In widths of the range: outside these limits a Gaussian is uniform or a spike to machine precision.
_WIDEST = 1e4
_NARROWEST = 1e-12


def binned(
    mean: ArrayLike,
    sigma: ArrayLike,
    low: ArrayLike,
    high: ArrayLike,
    bits: int = BITS,
    *,
    printed: bool = False,
) -> FloatArray:
    """Information of Gaussian estimates [bits], eqs (11) and (15) as a sum over 2^bits bins.

    Args:
        mean: Estimate of each parameter, any shape that broadcasts with the others.
        sigma: Its standard deviation, not negative; infinity for no knowledge.
        low: Least possible value, the source's min.
        high: Greatest possible value, the source's max.
        bits: Precision n; the source calls both this and the number of bins n.
        printed: True takes (15) as printed, without the minus signs of both entropies and without
            clipping the mean; the sign of the information is then wrong.

    Returns:
        In = H(x) - H(x|y), shape as broadcast.

    Raises:
        ModelError: If a standard deviation is negative or a range is empty.
    """
    from scipy.special import log_ndtr  # slow to import

    m, s, a, b = _checked(mean, sigma, low, high, bits)
    width = b - a
    s = np.clip(s, _NARROWEST * width, _WIDEST * width)
    # Even as printed the mean stays where the logarithms are accurate.
    beyond = (_WIDEST if printed else 0.0) * width
    m = np.clip(m, a - beyond, b + beyond)
    count = 2**bits
    edges = a[..., None] + width[..., None] * (np.arange(count + 1) / count)
    z = (edges - m[..., None]) / s[..., None]
    # Mass of each bin, in logarithms and from the nearer tail: else digits cancel for a mean far outside.
    left, right = z[..., :-1], z[..., 1:]
    flipped = left > 0.0
    near, far = np.where(flipped, -left, right), np.where(flipped, -right, left)
    top = log_ndtr(near)
    with np.errstate(divide="ignore"):
        mass = top + np.log1p(-np.exp(log_ndtr(far) - top))
    q = np.exp(mass - mass.max(axis=-1, keepdims=True))
    q /= q.sum(axis=-1, keepdims=True)
    conditional = -np.sum(q * np.log2(np.where(q > 0.0, q, 1.0)), axis=-1)
    information = bits - conditional
    return np.asarray(-information if printed else information)


def closed(
    mean: ArrayLike, sigma: ArrayLike, low: ArrayLike, high: ArrayLike, bits: int = BITS
) -> FloatArray:
    """Information of Gaussian estimates [bits] by the entropy of the truncated Gaussian.

    Arguments, result and errors as of ``binned``. Below one bin of sigma it falls smoothly short of n
    bits, where the binned sum jumps with the mean's place in its bin.
    """
    m, s, a, b = _checked(mean, sigma, low, high, bits)
    out = np.empty(m.shape)
    _closed_all(m.ravel(), s.ravel(), a.ravel(), b.ravel(), bits, out.reshape(-1))
    return out


def fast(sigma: ArrayLike, low: ArrayLike, high: ArrayLike, bits: int = BITS) -> FloatArray:
    """Information of Gaussian estimates [bits] from sigma alone; see ``fast_bits``.

    Arguments, result and errors as of ``binned``, without the mean.
    """
    m, s, a, b = _checked(0.0, sigma, low, high, bits)
    out = np.empty(m.shape)
    _fast_all(s.ravel(), a.ravel(), b.ravel(), bits, out.reshape(-1))
    return out


@inlined
def fast_bits(sigma: float, width: float, bits: int) -> float:
    """Information of one Gaussian estimate [bits], from sigma and the range's width alone.

    In = 1/4 log2(1 + (R^2 / (D^2 + 2 pi e sigma^2))^2) with range R and bin D = R / 2^n. Between a bin
    and a tenth of the range it is n - 1/2 log2(1 + 2 pi e (sigma/D)^2), the untruncated Gaussian. Above,
    it falls to zero as sigma^-4, like the truncated Gaussian in mid-range (R^4 / 998 sigma^4 there,
    R^4 / 809 sigma^4 here), so that it never turns negative and its slope never vanishes. Strictly
    decreasing in sigma; the mean has no part in it.
    """
    bin_width = math.ldexp(width, -bits)
    ratio = width * width / (bin_width * bin_width + _TWO_PI_E * sigma * sigma)
    # The last factor, 1 but for 16^-n, makes certainty n bits exactly.
    return 0.25 * math.log1p(ratio * ratio * (1.0 - math.ldexp(1.0, -4 * bits))) / math.log(2.0)


@inlined
def closed_bits(mean: float, sigma: float, low: float, high: float, bits: int) -> float:
    """Information of one Gaussian estimate [bits], from the entropy of its truncation to the range."""
    width = high - low
    s = min(max(sigma, _NARROWEST * width), _WIDEST * width)
    m = min(max(mean, low), high)
    alpha = (low - m) / s
    beta = (high - m) / s
    mass = 0.5 * (math.erf(beta / math.sqrt(2.0)) - math.erf(alpha / math.sqrt(2.0)))
    slope = (
        (alpha * math.exp(-0.5 * alpha * alpha) - beta * math.exp(-0.5 * beta * beta))
        / math.sqrt(2.0 * math.pi)
        / (2.0 * mass)
    )
    # Entropy in nats above that of one bin; then the bin's own width softly bounds it from below (and the
    # last factor makes ignorance 0 bits exactly).
    nats = math.log(math.sqrt(_TWO_PI_E) * mass * s / width) + slope + bits * math.log(2.0)
    return bits - 0.5 * math.log1p(math.exp(2.0 * nats) * (1.0 - 4.0**-bits)) / math.log(2.0)


@compiled
def _closed_all(
    mean: FloatArray, sigma: FloatArray, low: FloatArray, high: FloatArray, bits: int, out: FloatArray
) -> None:
    for i in range(len(out)):
        out[i] = closed_bits(mean[i], sigma[i], low[i], high[i], bits)


@compiled
def _fast_all(sigma: FloatArray, low: FloatArray, high: FloatArray, bits: int, out: FloatArray) -> None:
    for i in range(len(out)):
        out[i] = fast_bits(sigma[i], high[i] - low[i], bits)


def _checked(
    mean: ArrayLike, sigma: ArrayLike, low: ArrayLike, high: ArrayLike, bits: int
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Broadcast and check what describes a channel."""
    m, s, a, b = (np.array(v, dtype=np.float64) for v in np.broadcast_arrays(mean, sigma, low, high))
    if not 1 <= bits <= 20:
        raise ModelError(f"a channel has 1 to 20 bits, not {bits}")
    if not np.all(s >= 0.0) or not np.all(np.isfinite(m)):
        raise ModelError("each estimate needs a finite mean and a standard deviation of at least zero")
    if not np.all(b > a) or not np.all(np.isfinite(b - a)):
        raise ModelError("each range needs a finite low below a finite high")
    return m, s, a, b
