"""A machine's equations with the stock effects, and one step of them.

States ``s``, inputs ``u``, forces ``x`` that something else exerts and all that follows are tuples of
numbers; ``q`` is one set of the machine's `Numbers`. ``sign`` is the direction in which dry friction acts,
one for each force: 1 or -1 by its velocity, 2 where friction holds it, 0 without dry friction. ``b`` are the
forces of bent bristles.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from fieldmodels.drivers.kernel.facts import NONE, CurveAt, Factor, Facts
from fieldmodels.drivers.kernel.tuples import along, changed, floats, joined, take
from fieldmodels.effects import changes, forces
from fieldmodels.effects.curves import on_curve, on_table
from fieldmodels.elementary import only

Made = Callable[..., Any]


class Numbers(NamedTuple):
    """One set of a machine's numbers.

    Attributes:
        own: Base parameters and own effects', by name.
        forces: Rows of the stock forces: an array, or unpacked, a named tuple each.
        curves: Row of the curves.
    """

    own: Any
    forces: Any
    curves: Any


class Equations(NamedTuple):
    """Functions of a machine.

    Attributes:
        rows: ``(forces)``: rows of the stock forces as named tuples, whose numbers stay in registers.
        parameters: ``(base)``: base parameters by name.
        parameters_at: ``(base, changes, t, h, curves, s, u)``: their means over a step.
        observed: ``(t, s, u, q)``: what the sensors sense.
        pace: ``(s, u, p, sizes, work, square)``: how fast the machine moves by itself [rad/s].
        inertias: ``(s, p)``: what each force is divided by.
        rates: ``(t, s, u, x, q, sign, moved, b)``: of the states, with everything.
        pushed: ``(t, s, u, f, q)``: rates by forces ``f`` and curves.
        resisted: ``(d, s, p, sign, r)``: rates ``d`` less what friction ``r`` takes, and what it holds.
        driven: ``(t, h, s, u, x, q, sign, b)``: rates without what would hold a velocity that is 0.
        plain: ``(t, h, s, f, g, k, x, q, sign, b)``: states after a step by the machine's own equations, with
            inputs f, g, k at its start, middle and end; and the states' integrals over it.
        calm: The same with what costs little: no waves, and friction that depends on the direction alone.
        whole: The same with everything.
        load: ``(u, k)``: the input that loads a force's friction.
        place: ``(s, k)``: a force's position.
    """

    rows: Made
    parameters: Made
    parameters_at: Made
    observed: Made
    pace: Made
    inertias: Made
    rates: Made
    pushed: Made
    resisted: Made
    driven: Made
    plain: Made
    calm: Made
    whole: Made
    load: Made
    place: Made


def equations_of(m: Facts) -> Equations:
    """Compose a machine's equations."""
    inlined, ns, nf = m.inlined, len(m.states), len(m.velocity)
    velocity, coupled, stepped = m.velocity, m.coupled and not m.stepped, m.stepped
    go, change, change_f = along(ns, inlined), changed(ns, inlined), changed(nf, inlined)
    still, nothing = (0.0,) * ns, (0.0,) * nf
    own, advanced = _own(m)
    inertias = joined([_factor(what, m) for what in m.inertia], inlined)
    spread, load, place = _spread(m), _numbered(m.load, inlined), _numbered(m.position, inlined)
    rows = joined([_row(k, inlined) for k in range(nf)], inlined)
    curves = m.at("force")
    bent = added([c for c in curves if c.index == NONE], ns, "state", inlined)
    bent_f = added([c for c in curves if c.index != NONE], nf, "index", inlined)

    @inlined
    def accelerated(d, s, p, f):
        """Rates with forces."""
        inertia = inertias(s, p)
        for k in range(nf):
            d = change(d, velocity[k], d[velocity[k]] + f[k] * (1.0 / inertia[k]))
            d = spread(d, k, f[k], s, p)
        return d

    @inlined
    def pushed(t, s, u, f, q):
        f = bent_f(t, s, u, q.curves, f)
        return bent(t, s, u, q.curves, accelerated(own(s, u, q.own), s, q.own, f))

    @inlined
    def resisted(d, s, p, sign, r):
        inertia = inertias(s, p)
        for k in range(nf):
            v = velocity[k]
            # What holds a velocity acts on the others, too.
            reaction = d[v] * inertia[k] if sign[k] == 2.0 else r[k]
            left = 0.0 if sign[k] == 2.0 else d[v] - r[k] * (1.0 / inertia[k])
            d = change(spread(d, k, -reaction, s, p), v, left)
        if coupled:
            for k in range(nf):
                d = change(d, velocity[k], 0.0 if sign[k] == 2.0 else d[velocity[k]])
        return d

    def rates_by(push: Made, rub: Made) -> tuple[Made, Made, Made]:
        """Forces, friction, rates by ``push(x, v, t, row)`` and ``rub(moved, v, sign, b, load, row)``."""

        @inlined
        def forces_at(t, s, x, q):
            for k in range(nf):
                x = change_f(x, k, x[k] + push(place(s, k), s[velocity[k]], t, q.forces[k]))
            return x

        @inlined
        def friction_at(s, u, q, sign, moved, b):
            r = nothing
            for k in range(nf):
                v = velocity[k]
                force = rub(moved[v], s[v], sign[k], b[k], load(u, k), q.forces[k])
                r = change_f(r, k, force if sign[k] != 0.0 else 0.0)
            return r

        @inlined
        def rates(t, s, u, x, q, sign, moved, b):
            d = pushed(t, s, u, forces_at(t, s, x, q), q)
            return resisted(d, s, q.own, sign, friction_at(s, u, q, sign, moved, b))

        return forces_at, friction_at, rates

    def step_by(rates: Made) -> Made:
        @inlined
        def step(t, h, s, f, g, k, x, q, sign, b):
            """One classical Runge-Kutta step."""
            half = 0.5 * h
            a = rates(t, s, f, x, q, sign, still, b)
            s_1 = go(s, half, a)
            b_1 = rates(t + half, s_1, g, x, q, sign, go(still, half, s), b)
            s_2 = go(s, half, b_1)
            c = rates(t + half, s_2, g, x, q, sign, go(still, half, s_1), b)
            s_3 = go(s, h, c)
            d = rates(t + h, s_3, k, x, q, sign, go(still, h, s_2), b)
            slope = go(go(a, 2.0, go(b_1, 1.0, c)), 1.0, d)
            speed = go(go(s, 2.0, go(s_1, 1.0, s_2)), 1.0, s_3)
            return go(s, h / 6.0, slope), go(still, h / 6.0, speed)

        return step

    def stepped_by(forces_at: Made, friction_at: Made) -> Made:
        @inlined
        def step(t, h, s, f, g, k, x, q, sign, b):
            """The machine's own step, with half of the forces' impulse before and after."""
            n = kicked(t, 0.5 * h, s, f, forces_at(t, s, x, q), q)
            n = advanced(n, g, q.own, h)
            n = kicked(t + h, 0.5 * h, n, k, forces_at(t + h, n, x, q), q)
            r = friction_at(s, g, q, sign, go(still, 0.5 * h, s), b)
            n = resisted(n, s, q.own, sign, scaled(r, h))
            return n, go(go(still, 0.5 * h, s), 0.5 * h, n)

        return step

    go_f = along(nf, inlined)

    @inlined
    def scaled(r, h):
        return go_f(nothing, h, r)

    @inlined
    def kicked(t, h, s, u, f, q):
        return accelerated(s, s, q.own, scaled(bent_f(t, s, u, q.curves, f), h))

    @inlined
    def plain_rates(_t, s, u, x, q, _sign, _moved, _b):
        return accelerated(own(s, u, q.own), s, q.own, x)

    @inlined
    def plain_step(_t, h, s, _f, g, _k, x, q, _sign, _b):
        n = accelerated(s, s, q.own, scaled(x, 0.5 * h))
        n = advanced(n, g, q.own, h)
        return accelerated(n, n, q.own, scaled(x, 0.5 * h)), still

    calm_forces, calm_friction, calm_rates = rates_by(_calm_push(inlined), _calm_rub(inlined))
    whole_forces, whole_friction, rates = rates_by(forces.smooth, forces.resistance)
    if stepped:
        plain, calm, whole = (
            plain_step, stepped_by(calm_forces, calm_friction), stepped_by(whole_forces, whole_friction)
        )  # fmt: skip

        @inlined
        def driven(t, h, s, u, x, q, _sign, b):
            n, _ = whole(t, h, s, u, u, u, x, q, nothing, b)
            return go(still, 1.0 / h, n)

    else:
        plain, calm, whole = step_by(plain_rates), step_by(calm_rates), step_by(rates)

        @inlined
        def driven(t, _h, s, u, x, q, sign, b):
            return rates(t, s, u, x, q, sign if coupled else nothing, still, b)

    parameters, parameters_at = _parameters(m)
    return Equations(
        rows, parameters, parameters_at, _observed(m), _pace(m, own), inertias, rates, pushed, resisted,
        driven, plain, calm, whole, load, place,
    )  # fmt: skip


def _row(k: int, inlined: Made) -> Made:
    unpack = forces.unpack

    @inlined
    def row(rows):
        return unpack(rows[k])

    return row


def _calm_push(inlined: Made) -> Made:
    @inlined
    def push(x, v, _t, r):
        return forces.without_waves(x, v, r)

    return push


def _calm_rub(inlined: Made) -> Made:
    @inlined
    def rub(_moved, _v, sign, _b, load, r):
        return forces.steady(sign, load, r)

    return rub


def _own(m: Facts) -> tuple[Made, Made]:
    """``(s, u, p)`` to the rates by the machine itself, and ``(s, u, p, h)`` to its states a time later."""
    inlined, ns, state = m.inlined, len(m.states), m.named("state")
    convert, given = floats(ns, inlined), _given(m)
    own = m.functions["advance" if m.stepped else "derivative"]
    single = ns == 1

    @inlined
    def rates(s, u, p):
        d = own(None, state(*s), given(u), p)
        return convert((only(d),) if single else d)

    @inlined
    def later(s, u, p, h):
        n = own(None, state(*s), given(u), p, h)
        return convert((only(n),) if single else n)

    return rates, later


def _given(m: Facts) -> Made:
    """``(u)`` to what the machine's functions take for inputs."""
    if not m.inputs:

        @m.inlined
        def nothing(_u):
            return None

        return nothing
    kind = m.named("input")

    @m.inlined
    def given(u):
        return kind(*u)

    return given


def _factor(what: int | str, m: Facts) -> Made:
    """``(s, p)`` to an inertia, or a rate by a unit of force."""
    inlined, state = m.inlined, m.named("state")
    if what == NONE:

        @inlined
        def one(_s, _p):
            return 1.0

        return one
    if isinstance(what, int):

        @inlined
        def number(_s, p):
            return p[what]

        return number
    own = m.functions[f"inertia_{what}"]
    if what in m.by_state:

        @inlined
        def by_state(s, p):
            return float(own(None, state(*s), p))

        return by_state

    @inlined
    def by_numbers(_s, p):
        return float(own(None, p))

    return by_numbers


def _spread(m: Facts) -> Made:
    """``(d, k, f, s, p)``: rates with what a force ``f`` on the k-th velocity does to the others."""
    if not m.couplings:

        @m.inlined
        def alone(d, _k, _f, _s, _p):
            return d

        return alone
    change, count = changed(len(m.states), m.inlined), len(m.couplings)
    shares = joined([_factor(what, m) for _, _, what in m.couplings], m.inlined)
    force, other = tuple(k for k, _, _ in m.couplings), tuple(i for _, i, _ in m.couplings)

    @m.inlined
    def spread(d, k, f, s, p):
        share = shares(s, p)
        for c in range(count):
            if force[c] == k:
                d = change(d, other[c], d[other[c]] + f * share[c])
        return d

    return spread


def _numbered(numbers: tuple[int, ...], inlined: Made) -> Made:
    """``(t, k)`` to the number of a tuple that the k-th force reads, 0 where it reads none."""

    @inlined
    def read(t, k):
        return t[numbers[k]] if numbers[k] >= 0 else 0.0

    return read


def _factor_of(factor: Factor, inlined: Made) -> Made:
    """``(t, s, u)`` to a factor of a curve's variable."""
    kind, i, sized = factor
    of_state = kind == "state"
    if kind == "time":

        @inlined
        def time(t, _s, _u):
            return abs(t) if sized else t

        return time

    @inlined
    def value(_t, s, u):
        x = s[i] if of_state else u[i]
        return abs(x) if sized else x

    return value


def _variable(factors: Sequence[Factor], inlined: Made) -> Made:
    """``(t, s, u)`` to a curve's variable, a product."""
    first = _factor_of(factors[0], inlined)
    if len(factors) == 1:
        return first
    rest = _variable(factors[1:], inlined)

    @inlined
    def product(t, s, u):
        return first(t, s, u) * rest(t, s, u)

    return product


def value_of(c: CurveAt, inlined: Made) -> Made:
    """``(t, s, u, curves)`` to a curve's value."""
    start, stop = c.start, c.stop
    variables = [_variable(factors, inlined) for factors in c.over]
    x, y = variables[0], variables[-1]
    if len(variables) == 1:

        @inlined
        def curve(t, s, u, curves):
            return on_curve(x(t, s, u), curves[start:stop])

        return curve

    @inlined
    def table(t, s, u, curves):
        return on_table(x(t, s, u), y(t, s, u), curves[start:stop])

    return table


def added(curves: Sequence[CurveAt], n: int, to: str, inlined: Made) -> Made:
    """``(t, s, u, curves, f)``: n numbers ``f`` with the curves' values, each added to its ``to``-th one."""
    if not curves:

        @inlined
        def same(_t, _s, _u, _curves, f):
            return f

        return same
    value, i, change = value_of(curves[-1], inlined), getattr(curves[-1], to), changed(n, inlined)
    before = added(curves[:-1], n, to, inlined)

    @inlined
    def more(t, s, u, curves, f):
        f = before(t, s, u, curves, f)
        return change(f, i, f[i] + value(t, s, u, curves))

    return more


def _parameters(m: Facts) -> tuple[Made, Made]:
    inlined, kind, n = m.inlined, m.named("p"), len(m.parameters)
    read, change = take(n, 1, inlined), changed(n, inlined)
    bent = added(m.at("parameter"), n, "index", inlined)

    @inlined
    def parameters(base):
        return kind(*read(base, 0))

    @inlined
    def parameters_at(base, rows, t, h, curves, s, u):
        p = read(base, 0)
        for k in range(n):
            p = change(p, k, changes.changed(p[k], t, h, changes.unpack(rows[k])))
        return kind(*bent(t + 0.5 * h, s, u, curves, p))

    return parameters, parameters_at


def _observed(m: Facts) -> Made:
    inlined, no, state, shown = m.inlined, len(m.outputs), m.named("state"), m.shown
    convert, bent = floats(no, inlined), added(m.at("sensor"), no, "index", inlined)
    if "observe" in m.functions:
        own, single = m.functions["observe"], no == 1

        @inlined
        def sensed(s, p):
            z = own(None, state(*s), p)
            return convert((only(z),) if single else z)

    else:
        change, dark = changed(no, inlined), (0.0,) * no

        @inlined
        def sensed(s, _p):
            z = dark
            for o in range(no):
                z = change(z, o, s[shown[o]])
            return z

    @inlined
    def observed(t, s, u, q):
        return bent(t, s, u, q.curves, sensed(s, q.own))

    return observed


def _pace(m: Facts, rates: Made) -> Made:
    ns, change = len(m.states), changed(len(m.states), m.inlined)
    if "fastest" in m.functions:
        own = m.functions["fastest"]

        @m.block
        def own_pace(_s, _u, p, _sizes, _work, _square):
            return float(own(None, p))

        return own_pace
    if m.stepped:

        @m.block
        def no_pace(_s, _u, _p, _sizes, _work, _square):
            return 0.0

        return no_pace

    @m.block
    def pace(s, u, p, sizes, work, square):
        d = rates(s, u, p)
        for j in range(ns):
            small = 1e-4 * sizes[j]
            e = rates(change(s, j, s[j] + small), u, p)
            for i in range(ns):
                work[i, j] = (e[i] - d[i]) / small * sizes[j] / sizes[i]
        # The norm of the eighth power bounds the spectral radius closely, however far off normal a matrix is.
        size = 1.0
        root = 1.0
        for _ in range(4):
            norm = 0.0
            for i in range(ns):
                for j in range(ns):
                    norm = max(norm, abs(work[i, j]))
            if norm == 0.0 or not math.isfinite(norm):
                return 0.0
            size *= norm**root
            for i in range(ns):
                for j in range(ns):
                    square[i, j] = 0.0
                    for k in range(ns):
                        square[i, j] += work[i, k] / norm * work[k, j] / norm
            for i in range(ns):
                for j in range(ns):
                    work[i, j] = square[i, j]
            root *= 0.5
        return size * ns ** (1.0 / 8.0)

    return pace
