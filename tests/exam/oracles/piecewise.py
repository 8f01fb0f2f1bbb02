"""Pieces of time between jumps: adaptive integration from edge to edge, and a lag at a limited rate."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import compress, pairwise

import numpy as np
from scipy.integrate import solve_ivp

from fieldmodels.arrays import FloatArray

RELATIVE, ABSOLUTE = 1e-10, 1e-13
"""Tolerances of the integrator (DOP853): about 1e-9 of what is integrated over an episode."""
HAIR = 1e-12
"""Jumps closer together than this are one [s]."""
LAYERS = (1.0, 6.0, 40.0)
"""Time constants after a jump at which integration stops, so that no short transient is stepped over."""

Derivative = Callable[[float, FloatArray], Sequence[float]]


@dataclass(frozen=True)
class Piece:
    """A stretch of time in which a quantity is ``level + slope t + excess exp(-t / lag)``, t since ``begin``.

    Attributes:
        begin: When it begins [s].
        level: Constant part.
        slope: Its rate [1/s].
        excess: What decays.
        lag: How fast [s]; not used without an excess.
    """

    begin: float
    level: float
    slope: float = 0.0
    excess: float = 0.0
    lag: float = 0.0

    def at(self, time: float) -> float:
        """Value at a time [s]."""
        value = self.level
        if self.slope:
            value += self.slope * (time - self.begin)
        if self.excess:
            value += self.excess * math.exp(-(time - self.begin) / self.lag)
        return value


def follow(
    aims: Sequence[tuple[float, float]], before: float, lag: float = 0.0, rate: float = math.inf
) -> list[Piece]:
    """What follows a piecewise constant aim: ``lag dy/dt = aim - y``, but ``|dy/dt| <= rate``.

    Args:
        aims: When each aim begins [s] and what it is, in order of time.
        before: Value until the first of these times.
        lag: Time constant [s]; 0 for none.
        rate: Largest rate; infinite for none.

    Returns:
        Pieces in order of time, the first from minus infinity.
    """
    pieces = [Piece(-math.inf, before)]
    changes = [value != last for (_, value), last in zip(aims, [before, *(a for _, a in aims)], strict=False)]
    aims = list(compress(aims, changes))
    ends = [begin for begin, _ in aims[1:]] + [math.inf]
    for (begin, aim), end in zip(aims, ends, strict=True):
        excess = pieces[-1].at(begin) - aim
        # While the excess is beyond rate * lag, the lag alone would be faster than the rate allows.
        ramp = max((abs(excess) - rate * lag) / rate, 0.0) if math.isfinite(rate) else 0.0
        if ramp > 0.0:
            pieces.append(Piece(begin, aim + excess, slope=-math.copysign(rate, excess)))
            excess = math.copysign(rate * lag, excess)
        if begin + ramp < end:
            pieces.append(Piece(begin + ramp, aim, excess=excess if lag > 0.0 else 0.0, lag=lag))
    return pieces


def jumps(pieces: Iterable[Piece]) -> list[float]:
    """Times at which an integrator has to stop: where pieces begin, and within their transients [s]."""
    times = []
    for piece in pieces:
        times.append(piece.begin)
        if piece.excess:
            times += [piece.begin + layer * piece.lag for layer in LAYERS]
    return times


def edges_between(first: float, last: float, stops: Iterable[float]) -> list[tuple[float, float]]:
    """Begin and end [s] of every stretch between two times that no jump interrupts."""
    edges = np.unique([first, *(t for t in stops if first + HAIR < t < last - HAIR), last])
    return list(pairwise(edges[np.r_[True, np.diff(edges) > HAIR]].tolist()))


def current(pieces: Sequence[Piece], time: float) -> Piece:
    """The piece at a time [s]."""
    index = int(np.searchsorted([piece.begin for piece in pieces], time, side="right")) - 1
    return pieces[index]


def integrate(
    within: Callable[[float], Derivative], stops: Iterable[float], state: Sequence[float], wanted: FloatArray
) -> FloatArray:
    """Integrate an ordinary differential equation whose right side jumps at known times.

    Args:
        within: Gives the derivative f(t, state) that holds around a time [s] between two stops.
        stops: Times of the jumps [s]; those outside of the wanted times do not matter.
        state: State at the first wanted time.
        wanted: Times at which the state is wanted [s], rising, shape (n,).

    Returns:
        States, shape (n, len(state)).
    """
    result = np.empty((len(wanted), len(state)))
    now = np.asarray(state, dtype=float)
    for begin, end in edges_between(float(wanted[0]), float(wanted[-1]), stops):
        inside = np.flatnonzero((wanted >= begin) & (wanted <= end))
        solution = solve_ivp(
            within(0.5 * (begin + end)), (begin, end), now, method="DOP853",
            t_eval=np.union1d(wanted[inside], [end]), rtol=RELATIVE, atol=ABSOLUTE,
        )  # fmt: skip
        result[inside] = solution.y[:, : len(inside)].T
        now = solution.y[:, -1]
    return result


def follow_lines(lines: Sequence[tuple[float, float, float]], lag: float, rate: float) -> list[Piece]:
    """As ``follow``, of an aim that goes along lines.

    Args:
        lines: When each line begins [s], its level there and its slope, in order of time; the first level
            holds before.
        lag: Time constant [s]; 0 for none.
        rate: Largest rate; infinite for none.
    """
    pieces = [Piece(-math.inf, lines[0][1])]
    value, reach = lines[0][1], math.inf if math.isinf(rate) else rate * lag
    for (begin, level, slope), end in zip(lines, [*(t for t, _, _ in lines[1:]), math.inf], strict=True):
        time, ramping = begin, abs(level - value) > reach * (1.0 + 1e-9)
        while True:
            gap = level + slope * (time - begin) - value
            sign = math.copysign(1.0, gap) if abs(gap) > HAIR else math.copysign(1.0, slope)
            ramping = ramping or (abs(gap) >= reach * (1.0 - 1e-9) - HAIR and sign * slope > rate)
            lasts = math.inf
            if ramping:
                closing = rate - sign * slope
                lasts = (abs(gap) - reach) / closing if closing > 0.0 else math.inf
                pieces.append(Piece(time, value, slope=sign * rate))
            elif lag > 0.0:
                trailing, sign = slope * lag, math.copysign(1.0, slope)
                pieces.append(Piece(time, value + gap - trailing, slope, trailing - gap, lag))
                if abs(slope) > rate:
                    lasts = lag * math.log((trailing - gap) / (trailing - sign * reach))
            else:
                pieces.append(Piece(time, value + gap, slope))
            stop = min(time + lasts, end)
            if not math.isfinite(stop):
                break
            value = pieces[-1].at(stop)
            if stop >= end:
                break
            time, ramping = stop, not ramping
    return pieces
