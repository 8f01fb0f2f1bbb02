"""How a sampling interval is divided into steps, and what parameters are in each."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from fieldmodels.drivers.kernel.equations import Equations, Numbers
from fieldmodels.drivers.kernel.events import Events
from fieldmodels.drivers.kernel.facts import Facts
from fieldmodels.drivers.kernel.tuples import along
from fieldmodels.effects import changes, forces

Made = Callable[..., Any]


class Intervals(NamedTuple):
    """What windows and episodes do alike with a sampling interval.

    Attributes:
        fitting: ``(mode, step, least, most)``: steps within an interval.
        friction: ``(s, p, frc, speeds)``: how fast friction changes a motion [1/s].
        changing: ``(rows)``: whether a parameter changes in time by itself.
        changed: ``(base, changes, t, h, s, u, aim, slope, x, q, act, b)``: parameters by name over a step in
            which they change.
        steps_in: ``(length, substeps)``: steps in a piece of an interval.
        sort: ``(values)``: sort a few numbers in place.
    """

    fitting: Made
    friction: Made
    changing: Made
    changed: Made
    steps_in: Made
    sort: Made


def intervals_of(m: Facts, equations: Equations, events: Events) -> Intervals:
    """Compose what says how fine a machine's steps are, and at which parameters."""
    nf, ns, ni, np_ = len(m.velocity), len(m.states), max(len(m.inputs), 1), len(m.parameters)
    inertias, parameters_at, past_ramps = equations.inertias, equations.parameters_at, events.past_ramps
    factors = [factor for c in m.at("parameter") for variable in c.over for factor in variable]
    by_state = any(kind != "time" for kind, _, _ in factors)
    go, go_i, still, idle = along(ns, m.inlined), along(ni, m.inlined), (0.0,) * ns, (0.0,) * ni

    @m.inlined
    def fitting(mode, step, least, most):
        """A power of two times the least that resolves the fastest mode."""
        count = least
        while mode * step > 0.2 * count and count < most:
            count *= 2
        return count

    @m.inlined
    def friction(s, p, frc, speeds):
        inertia, fastest = inertias(s, p), 0.0
        for k in range(nf):
            fastest += forces.slope_of_friction(inertia[k], speeds[k], forces.unpack(frc[k]))
        return fastest

    @m.inlined
    def changing(rows):
        found = False
        for k in range(np_):
            row = changes.unpack(rows[k])
            found = found or row.step_change != 0.0 or row.drift_rate != 0.0
        return found

    @m.inlined
    def changed(base, rows, t, h, s, u, aim, slope, x, q, act, b):
        p = parameters_at(base, rows, t, h, q.curves, s, u)
        if by_state:  # a curve of states has its value in the middle of the step
            q = Numbers(p, q.forces, q.curves)
            n, v, _ = past_ramps(t, h, s, u, aim, slope, x, q, act, b)
            middle = go(go(still, 0.5, s), 0.5, n)
            p = parameters_at(base, rows, t, h, q.curves, middle, go_i(go_i(idle, 0.5, u), 0.5, v))
        return p

    @m.inlined
    def steps_in(length, substeps):
        # In proportion to its length, which a delay may make short.
        return max(math.ceil(length * substeps - 1e-9), 1)

    @m.inlined
    def sort(values):
        for i in range(1, len(values)):
            value, k = values[i], i
            while k > 0 and values[k - 1] > value:
                values[k] = values[k - 1]
                k -= 1
            values[k] = value

    return Intervals(fitting, friction, changing, changed, steps_in, sort)
