"""Steps of one machine that are cut: where friction turns or stops a motion, where a rate limit lets go."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from fieldmodels.drivers.kernel.equations import Equations, Numbers
from fieldmodels.drivers.kernel.facts import Facts
from fieldmodels.drivers.kernel.tuples import along, changed
from fieldmodels.effects import actuators, forces

REFINEMENTS = 2
"""Times that the moment of a reversal is refined after a first straight line."""
Made = Callable[..., Any]


class Events(NamedTuple):
    """Functions of a machine.

    Attributes:
        advance: ``(known, n, t, h, s, o, e, z, lag, x, q, b)``: states and bristles a time ``h`` later, while
            actuators give ``o + e tau + z exp(-tau/lag)``.
        past_ramps: ``(t, h, s, u, aim, slope, x, q, act, b)``: states, inputs and bristles, while actuators
            follow ``aim + slope tau``.
        start: ``(push, most)``: the direction in which something starts that stands still.
        lags: ``(act)``: time constants of the actuators.
        bent: ``(b, way, sign, forces)``: bristles after a motion, by rows of forces as named tuples.
    """

    advance: Made
    past_ramps: Made
    start: Made
    lags: Made
    bent: Made


def events_of(m: Facts, equations: Equations) -> Events:
    """Compose a machine's cut steps."""
    inlined, nf, ni = m.inlined, len(m.velocity), max(len(m.inputs), 1)
    velocity, nothing = m.velocity, (0.0,) * nf
    rows, inertias, load = equations.rows, equations.inertias, equations.load
    change, change_f = changed(len(m.states), inlined), changed(nf, inlined)
    change_i, go_i = changed(ni, inlined), along(ni, inlined)
    still, idle = (0.0,) * len(m.states), (0.0,) * ni
    whole, drive = equations.whole, equations.driven

    @m.block
    def step(t, h, s, f, g, k, x, q, sign, b):
        return whole(t, h, s, f, g, k, x, Numbers(q.own, rows(q.forces), q.curves), sign, b)

    @m.block
    def driven(t, h, s, u, x, q, sign, b):
        return drive(t, h, s, u, x, Numbers(q.own, rows(q.forces), q.curves), sign, b)

    @inlined
    def start(push, most):
        return 2.0 if abs(push) <= most else math.copysign(1.0, push)

    @inlined
    def directions(t, h, s, u, x, q, b):
        """Directions in which dry friction acts on each force's velocity."""
        sign = nothing
        for k in range(nf):
            v = s[velocity[k]]
            if v != 0.0 and forces.has_dry_friction(forces.unpack(q.forces[k])):
                sign = change_f(sign, k, math.copysign(1.0, v))
        for k in range(nf):
            row = forces.unpack(q.forces[k])
            if s[velocity[k]] == 0.0 and forces.has_dry_friction(row):
                d = driven(t, h, s, u, x, q, sign, b)
                push = d[velocity[k]] * inertias(s, q.own)[k] - b[k]
                sign = change_f(sign, k, start(push, forces.holding(load(u, k), row)))
        return sign

    @inlined
    def given(h, o, e, z, lag):
        """What actuators give at the start, middle and end of a step."""
        f, g, k = o, go_i(o, 0.5 * h, e), go_i(o, h, e)
        for i in range(ni):
            if z[i] != 0.0:
                first, middle, last = actuators.lag_shape(h / lag[i])
                f = change_i(f, i, f[i] + z[i] * first)
                g = change_i(g, i, g[i] + z[i] * middle)
                k = change_i(k, i, k[i] + z[i] * last)
        return f, g, k

    @inlined
    def slides(sign, v):
        return abs(sign) == 1.0 and v != 0.0

    @inlined
    def bent(b, way, sign, of_forces):
        for k in range(nf):
            row = of_forces[k]
            if row.hysteresis_force != 0.0 and sign[k] != 2.0:
                b = change_f(b, k, forces.bend(b[k], way[velocity[k]], row))
        return b

    @inlined
    def stopped(s, n, sign):
        """States at a reversal, with the velocity that reverses at rest."""
        nearest = math.inf
        for k in range(nf):
            v = velocity[k]
            if slides(sign[k], s[v]):
                nearest = min(nearest, abs(n[v]) / abs(s[v]))
        for k in range(nf):
            v = velocity[k]
            if slides(sign[k], s[v]) and abs(n[v]) / abs(s[v]) <= nearest:
                n = change(n, v, 0.0)
        return n

    @inlined
    def to_reversal(share, t, h, s, n, o, e, z, lag, x, q, sign, b):
        """The part of a step until the first velocity reverses, near a ``share`` of it."""
        way = still
        before, after, low, high, cut = 0.0, 1.0, s, n, h * share
        for refine in range(REFINEMENTS + 1):
            f, g, k = given(cut, o, e, z, lag)
            n, way = step(t, cut, s, f, g, k, x, q, sign, b)
            if refine == REFINEMENTS:
                break
            # The reversal lies where a line through this and the nearer end crosses zero.
            over = False
            for i in range(nf):
                v = velocity[i]
                over = over or (slides(sign[i], s[v]) and n[v] * sign[i] < 0.0)
            share = 2.0
            for i in range(nf):
                v = velocity[i]
                if slides(sign[i], s[v]):
                    if over and n[v] * sign[i] < 0.0:
                        share = min(share, before + (cut / h - before) * low[v] / (low[v] - n[v]))
                    if not over and high[v] * sign[i] < 0.0:
                        share = min(share, cut / h + (after - cut / h) * n[v] / (n[v] - high[v]))
            if share > 1.0:
                break
            if over:
                after, high = cut / h, n
            else:
                before, low = cut / h, n
            cut = h * share
        return cut, n, way

    @m.block
    def advance(known, n, t, h, s, o, e, z, lag, x, q, b):
        """A step; dry friction opposes motion or holds, and cuts it where a velocity reverses.

        ``n`` is where the whole step ends if that is ``known``, as it is of one in which a velocity reverses.
        """
        way = still
        for cuts in range(nf + 1):
            f, g, k = given(h, o, e, z, lag)
            sign = directions(t, h, s, go_i(o, 1.0, z), x, q, b)
            if cuts > 0 or not known:
                n, way = step(t, h, s, f, g, k, x, q, sign, b)
            share = 2.0
            for i in range(nf):
                v = velocity[i]
                if slides(sign[i], s[v]) and n[v] * sign[i] < 0.0:
                    share = min(share, s[v] / (s[v] - n[v]))
            if share > 1.0:
                return n, bent(b, way, sign, rows(q.forces))
            cut, n, way = to_reversal(share, t, h, s, n, o, e, z, lag, x, q, sign, b)
            b = bent(b, way, sign, rows(q.forces))
            s = stopped(s, n, sign)
            o = go_i(o, cut, e)
            for i in range(ni):
                if z[i] != 0.0:
                    z = change_i(z, i, z[i] * math.exp(-cut / lag[i]))
            t += cut
            h -= cut
            if h <= 0.0:
                break
        return s, b

    @inlined
    def lags(act):
        lag = idle
        for i in range(ni):
            lag = change_i(lag, i, actuators.unpack(act[i]).lag_time_constant)
        return lag

    cuts_of_ramps = ni * (actuators.PHASES - 1)

    @m.block
    def past_ramps(t, h, s, u, aim, slope, x, q, act, b):
        lag = lags(act)
        for left in range(1 + cuts_of_ramps):
            cut, o, e, z = h, aim, slope, idle
            for i in range(ni):
                _, lasts = actuators.phase(u[i], aim[i], slope[i], actuators.unpack(act[i]))
                if left < cuts_of_ramps and 0.0 < lasts < cut:
                    cut = lasts
            for i in range(ni):
                ramp, _ = actuators.phase(u[i], aim[i], slope[i], actuators.unpack(act[i]))
                if ramp != 0.0:
                    o, e = change_i(o, i, u[i]), change_i(e, i, ramp)
                elif lag[i] > 0.0:
                    o = change_i(o, i, o[i] - lag[i] * slope[i])
                    z = change_i(z, i, u[i] - o[i])
            s, b = advance(False, s, t, cut, s, o, e, z, lag, x, q, b)
            end = go_i(aim, cut, slope)
            for i in range(ni):
                row = actuators.unpack(act[i])
                u = change_i(u, i, actuators.follow_line(u[i], aim[i], end[i], cut, row))
            aim = end
            t += cut
            h -= cut
            if h <= 0.0:
                break
        return s, u, b

    return Events(advance, past_ramps, start, lags, bent)
