"""Steps of windows side by side, in lanes.

All numbers of the lanes lie in one flat array, a row of L lanes for each: the i-th state of lane l is
``w[STATE + i * L + l]``. Loops over lanes have no condition inside, but around, so that they become vector
instructions.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from fieldmodels.drivers.kernel.equations import Equations, Numbers
from fieldmodels.drivers.kernel.events import Events
from fieldmodels.drivers.kernel.facts import Facts
from fieldmodels.drivers.kernel.tuples import along, put, take
from fieldmodels.effects import actuators, forces

Made = Callable[..., Any]
PLAIN, CALM, WHOLE = 0, 1, 2
"""What acts on a machine: its own equations alone, also what costs little, everything."""


class Places(NamedTuple):
    """Where the numbers of lanes begin in their array.

    Attributes:
        state: States.
        next: States at the end of a step.
        level, slope, gap: Of what actuators give: ``level + slope tau + gap exp(-tau/lag)``.
        given: What they give.
        first, middle, last: What they give at a step's start, middle and end.
        target, ramp: What those with a limited rate go towards, and how fast that changes.
        extra: Forces that something else exerts.
        h: Length of the step.
        left: What is left of a step that is cut.
        clock: Time.
        bristle: Forces of bristles; ``bristle_next`` at the end of the step.
        slow: What slow sensors show; ``sensed`` what they sense.
        behind: By how much slow sensors are behind.
        rates: Of three stages of a step.
        between: States within a step.
        force, friction, sign: On each velocity: smooth force, friction and its direction.
        size: Of the array.
    """

    state: int
    next: int
    level: int
    slope: int
    gap: int
    given: int
    first: int
    middle: int
    last: int
    target: int
    ramp: int
    extra: int
    h: int
    left: int
    clock: int
    bristle: int
    bristle_next: int
    slow: int
    sensed: int
    behind: int
    rates: int
    between: int
    force: int
    friction: int
    sign: int
    size: int


def places_of(m: Facts) -> Places:
    """Lay the lanes of a machine out."""
    ns, ni, no, nf = len(m.states), max(len(m.inputs), 1), len(m.outputs), len(m.velocity)
    counts = [ns, ns, *[ni] * 9, nf, 1, 1, 1, nf, nf, no, no, no, 3 * ns, ns, nf, nf, nf]
    return Places(*(m.lanes * sum(counts[:k]) for k in range(len(counts) + 1)))


class Lanes(NamedTuple):
    """Functions of a machine's lanes; ``kind`` and ``dry`` say what acts on it.

    Attributes:
        held: ``(count, h, q, w)``: steps with inputs that are held, by the machine's own equations alone.
        together: ``(kind, dry, count, h, size, held, act, q, w)``: steps of all lanes.
        past_limits: ``(kind, dry, count, h, size, act, q, w)``: steps cut where a rate limit lets go.
    """

    held: Made
    together: Made
    past_limits: Made


def lanes_of(m: Facts, equations: Equations, events: Events) -> Lanes:
    """Compose a machine's steps in lanes."""
    inlined, block, L = m.inlined, m.block, m.lanes
    ns, ni, nf = len(m.states), max(len(m.inputs), 1), len(m.velocity)
    (
        STATE, NEXT, LEVEL, SLOPE, GAP, GIVEN, FIRST, MIDDLE, LAST, TARGET, RAMP, EXTRA, H, LEFT, CLOCK,
        BRISTLE, BRISTLE_NEXT, _, _, _, RATES, BETWEEN, FORCE, FRICTION, SIGN, _,
    ) = places_of(m)  # fmt: skip
    velocity, nothing, stepped, coupled = m.velocity, (0.0,) * nf, m.stepped, m.coupled
    alone_at_rest = stepped or coupled
    rows, inertias, load, place = equations.rows, equations.inertias, equations.load, equations.place
    pushed, resisted = equations.pushed, equations.resisted
    plain, calm, whole, start, advance = (
        equations.plain, equations.calm, equations.whole, events.start, events.advance
    )  # fmt: skip
    read_s, read_i, read_f = take(ns, L, inlined), take(ni, L, inlined), take(nf, L, inlined)
    write_s, write_f = put(ns, L, inlined), put(nf, L, inlined)
    go, go_i, go_f = along(ns, inlined), along(ni, inlined), along(nf, inlined)
    lags, bent = events.lags, events.bent

    def fused(step: Made, bends: bool) -> Made:
        @block
        def step_lanes(_dry, packed, w):
            """One step of every lane in its direction, into its next states, all stages at once."""
            q = Numbers(packed.own, rows(packed.forces), packed.curves)
            for l in range(L):
                s, x, sign = read_s(w, STATE + l), read_f(w, EXTRA + l), read_f(w, SIGN + l)
                f, g, k = read_i(w, FIRST + l), read_i(w, MIDDLE + l), read_i(w, LAST + l)
                b = read_f(w, BRISTLE + l) if bends else nothing
                n, way = step(w[CLOCK + l], w[H + l], s, f, g, k, x, q, sign, b)
                write_s(w, NEXT + l, n)
                if bends:
                    write_f(w, BRISTLE_NEXT + l, bent(b, way, sign, q.forces))

        return step_lanes

    @inlined
    def smooth(at, share, q, w):
        """Smooth forces on every lane, at states and a share of the step; those with a sine by themselves."""
        for k in range(nf):
            row, force = q.forces[k], FORCE + k * L
            for l in range(L):
                s = read_s(w, at + l)
                w[force + l] = forces.without_waves(place(s, k), s[velocity[k]], row)
            if forces.is_periodic(row):
                for l in range(L):
                    w[force + l] += forces.periodic(w[CLOCK + l] + share * w[H + l], row)
            if forces.is_cogging(row):
                for l in range(L):
                    w[force + l] += forces.cogging(place(read_s(w, at + l), k), row)

    @inlined
    def direct(q, w):
        """Directions of motion; what stands still starts, or not, by what acts on it."""
        standing = 0
        for k in range(nf):
            v, sign = STATE + velocity[k] * L, SIGN + k * L
            if forces.has_dry_friction(q.forces[k]):
                for l in range(L):
                    standing += 1 if w[v + l] == 0.0 else 0
                    w[sign + l] = math.copysign(1.0, w[v + l])
            else:
                for l in range(L):
                    w[sign + l] = 0.0
        if standing == 0 or alone_at_rest:
            return
        smooth(STATE, 0.0, q, w)
        for l in range(L):
            s, u = read_s(w, STATE + l), go_i(read_i(w, LEVEL + l), 1.0, read_i(w, GAP + l))
            f = go_f(read_f(w, EXTRA + l), 1.0, read_f(w, FORCE + l))
            d, inertia = pushed(w[CLOCK + l], s, u, f, q), inertias(s, q.own)
            for k in range(nf):
                push = d[velocity[k]] * inertia[k] - w[BRISTLE + k * L + l]
                to, sign = start(push, forces.holding(load(u, k), q.forces[k])), w[SIGN + k * L + l]
                w[SIGN + k * L + l] = to if s[velocity[k]] == 0.0 and sign != 0.0 else sign

    @inlined
    def rub(at, share, given, before, lead, q, w):
        """Friction on every lane, whose speed a stage before follows from the rates ``before`` that."""
        for k in range(nf):
            row, v, friction = q.forces[k], velocity[k], FRICTION + k * L
            for l in range(L):
                w[friction + l] = forces.steady(w[SIGN + k * L + l], load(read_i(w, given + l), k), row)
            if row.stribeck_friction_force != 0.0:
                for l in range(L):
                    w[friction + l] += forces.stribeck(w[at + v * L + l], w[SIGN + k * L + l], row)
            if row.hysteresis_force != 0.0:
                for l in range(L):
                    h = w[H + l]
                    moved = share * h * (w[STATE + v * L + l] + lead * h * w[before + v * L + l])
                    w[friction + l] += forces.bend(w[BRISTLE + k * L + l], moved, row)

    @inlined
    def stage(at, into, share, given, before, lead, dry, q, w):
        """Rates of every lane at the states ``at`` and a share of the step."""
        smooth(at, share, q, w)
        for l in range(L):
            f = go_f(read_f(w, EXTRA + l), 1.0, read_f(w, FORCE + l))
            t = w[CLOCK + l] + share * w[H + l]
            write_s(w, into + l, pushed(t, read_s(w, at + l), read_i(w, given + l), f, q))
        if dry:
            rub(at, share, given, before, lead, q, w)
            for l in range(L):
                s, d = read_s(w, at + l), read_s(w, into + l)
                d = resisted(d, s, q.own, read_f(w, SIGN + l), read_f(w, FRICTION + l))
                write_s(w, into + l, d)

    @inlined
    def approach(share, rates, w):
        for l in range(L):
            s = go(read_s(w, STATE + l), share * w[H + l], read_s(w, rates + l))
            write_s(w, BETWEEN + l, s)

    RATES_2, RATES_3 = RATES + ns * L, RATES + 2 * ns * L

    @block
    def staged(dry, packed, w):
        """As a step of everything, stage by stage.

        All lanes take each force in a stage together: chains of an exponential or a sine are long, and a
        processor looks only so far ahead for others beside them.
        """
        q = Numbers(packed.own, rows(packed.forces), packed.curves)
        stage(STATE, RATES, 0.0, FIRST, STATE, 0.0, dry, q, w)
        approach(0.5, RATES, w)
        stage(BETWEEN, RATES_2, 0.5, MIDDLE, STATE, 0.0, dry, q, w)
        approach(0.5, RATES_2, w)
        stage(BETWEEN, RATES_3, 0.5, MIDDLE, RATES, 0.5, dry, q, w)
        approach(1.0, RATES_3, w)
        stage(BETWEEN, NEXT, 1.0, LAST, RATES_2, 0.5, dry, q, w)
        for l in range(L):
            slope = go(read_s(w, RATES_2 + l), 1.0, read_s(w, RATES_3 + l))
            slope = go(go(read_s(w, RATES + l), 2.0, slope), 1.0, read_s(w, NEXT + l))
            write_s(w, NEXT + l, go(read_s(w, STATE + l), w[H + l] / 6.0, slope))
        for k in range(nf):
            row, v = q.forces[k], velocity[k] * L
            for l in range(L):
                w[BRISTLE_NEXT + k * L + l] = w[BRISTLE + k * L + l]
            if row.hysteresis_force != 0.0:
                for l in range(L):
                    h, speed, b = w[H + l], w[STATE + v + l], w[BRISTLE + k * L + l]
                    middle = (speed + 0.5 * h * w[RATES + v + l]) + (speed + 0.5 * h * w[RATES_2 + v + l])
                    way = h / 6.0 * (speed + 2.0 * middle + w[BETWEEN + v + l])
                    bristle = forces.bend(b, way, row)
                    w[BRISTLE_NEXT + k * L + l] = b if w[SIGN + k * L + l] == 2.0 else bristle

    plain_lanes, calm_lanes = fused(plain, False), fused(calm, False)
    whole_lanes = fused(whole, True) if stepped else staged

    @inlined
    def turns(q, l, w):
        """Whether a lane reverses, or must be looked at by itself as it stands still."""
        for k in range(nf):
            if forces.has_dry_friction(forces.unpack(q.forces[k])):
                v = w[STATE + velocity[k] * L + l]
                if v * w[NEXT + velocity[k] * L + l] < 0.0 or (alone_at_rest and v == 0.0):
                    return True
        return False

    @inlined
    def cut_turning(size, act, q, w):
        """Lanes that turn take their step again by themselves, cut where they turn."""
        turning = 0
        for k in range(nf):
            v, n = STATE + velocity[k] * L, NEXT + velocity[k] * L
            if alone_at_rest:
                for l in range(L):
                    turning += 0 if w[v + l] * w[n + l] > 0.0 else 1
            else:
                for l in range(L):
                    turning += 1 if w[v + l] * w[n + l] < 0.0 else 0
        if turning == 0:
            return
        lag = lags(act)
        for l in range(size):
            if turns(q, l, w):
                s, n, x = read_s(w, STATE + l), read_s(w, NEXT + l), read_f(w, EXTRA + l)
                o, e, z = read_i(w, LEVEL + l), read_i(w, SLOPE + l), read_i(w, GAP + l)
                b = read_f(w, BRISTLE + l)
                n, b = advance(not alone_at_rest, n, w[CLOCK + l], w[H + l], s, o, e, z, lag, x, q, b)
                write_s(w, NEXT + l, n)
                write_f(w, BRISTLE_NEXT + l, b)

    @block
    def step_lanes(kind, dry, size, act, q, w):
        """One step of every lane, into its next states; those that turn on the way by themselves."""
        if dry:
            direct(Numbers(q.own, rows(q.forces), q.curves), w)
        if kind == PLAIN:
            plain_lanes(dry, q, w)
        elif kind == CALM:
            calm_lanes(dry, q, w)
        else:
            whole_lanes(dry, q, w)
        if dry:
            cut_turning(size, act, q, w)

    @inlined
    def without_direction(dry, w):
        if not dry:
            for k in range(nf * L):
                w[SIGN + k] = 0.0

    @block
    def held(count, h, packed, w):
        q = Numbers(packed.own, rows(packed.forces), packed.curves)
        for _ in range(count):
            for l in range(L):
                s, u, x = read_s(w, STATE + l), read_i(w, LEVEL + l), read_f(w, EXTRA + l)
                n, _way = plain(w[CLOCK + l], h, s, u, u, u, x, q, nothing, nothing)
                write_s(w, STATE + l, n)

    @block
    def together(kind, dry, count, h, size, held, act, q, w):
        without_direction(dry, w)
        # A loop that copies one row of lanes moves vectors; one that copies several, number by number.
        for l in range(L):
            w[H + l] = h
        for i in range(ni * L):
            w[FIRST + i] = w[LEVEL + i]
        for i in range(ni * L):
            w[MIDDLE + i] = w[LEVEL + i]
        for i in range(ni * L):
            w[LAST + i] = w[LEVEL + i]
        for _ in range(count):
            if not held:
                for i in range(ni):
                    lag, first, middle, last, kept = (
                        actuators.unpack(act[i]).lag_time_constant,
                        1.0,
                        1.0,
                        1.0,
                        1.0,
                    )
                    if lag > 0.0:
                        first, middle, last = actuators.lag_shape(h / lag)
                    for l in range(i * L, i * L + L):
                        o, e, z = w[LEVEL + l], w[SLOPE + l] * h, w[GAP + l]
                        w[FIRST + l] = o + z * first
                        w[MIDDLE + l] = o + 0.5 * e + z * middle
                        w[LAST + l] = o + e + z * last
            step_lanes(kind, dry, size, act, q, w)
            for l in range(L):
                w[CLOCK + l] += h
            for i in range(ns * L):
                w[STATE + i] = w[NEXT + i]
            if dry and kind == WHOLE:
                for k in range(nf * L):
                    w[BRISTLE + k] = w[BRISTLE_NEXT + k]
            if not held:
                for i in range(ni):
                    lag = actuators.unpack(act[i]).lag_time_constant
                    kept = math.exp(-h / lag) if lag > 0.0 else 1.0
                    for l in range(i * L, i * L + L):
                        w[LEVEL + l] += w[SLOPE + l] * h
                        w[GAP + l] *= kept

    @inlined
    def lay_ramps(l, h, whole, act, w):
        """How far a lane goes with its actuators' rates as they are, and what they give on the way."""
        span = w[LEFT + l] if w[LEFT + l] > 0.0 else h
        for i in range(ni):
            a = i * L + l
            row = actuators.unpack(act[i])
            w[FIRST + a], lasts = actuators.phase(w[GIVEN + a], w[TARGET + a], w[RAMP + a], row)
            if 0.0 < lasts < span and not whole:
                span = lasts
        w[H + l] = span
        for i in range(ni):
            a, row = i * L + l, actuators.unpack(act[i])
            ramp, o, e, z = w[FIRST + a], w[TARGET + a], w[RAMP + a], 0.0
            first, middle, last = 1.0, 1.0, 1.0
            if ramp != 0.0:
                o, e = w[GIVEN + a], ramp
            elif row.lag_time_constant > 0.0:
                o -= row.lag_time_constant * e
                z = w[GIVEN + a] - o
                if z != 0.0:
                    first, middle, last = actuators.lag_shape(span / row.lag_time_constant)
            w[LEVEL + a], w[SLOPE + a], w[GAP + a] = o, e, z
            w[FIRST + a] = o + z * first
            w[MIDDLE + a] = o + 0.5 * span * e + z * middle
            w[LAST + a] = o + span * e + z * last

    @inlined
    def follow_ramps(l, act, w):
        """What a lane's actuators give, and aim at, after a part of a step; what is left of the step."""
        span, left = w[H + l], w[LEFT + l]
        if left > 0.0:
            for i in range(ni):
                a = i * L + l
                given = w[LEVEL + a] + w[SLOPE + a] * span
                if w[GAP + a] != 0.0:
                    given += w[GAP + a] * math.exp(-span / actuators.unpack(act[i]).lag_time_constant)
                w[GIVEN + a] = given
                w[TARGET + a] += w[RAMP + a] * span
            w[LEFT + l] = left - span if span < left else 0.0
            w[CLOCK + l] += span
        return w[LEFT + l]

    parts = ni * (actuators.PHASES - 1) + 1

    @block
    def past_limits(kind, dry, count, h, size, act, q, w):
        without_direction(dry, w)
        for _ in range(count):
            for l in range(L):
                w[LEFT + l] = h
            for part in range(parts):
                for l in range(L):
                    lay_ramps(l, h, part == parts - 1, act, w)
                step_lanes(kind, dry, size, act, q, w)
                for i in range(ns):
                    for l in range(L):
                        on = w[LEFT + l] > 0.0
                        w[STATE + i * L + l] = w[NEXT + i * L + l] if on else w[STATE + i * L + l]
                if dry and kind == WHOLE:
                    for k in range(nf):
                        for l in range(L):
                            on = w[LEFT + l] > 0.0
                            now, then = w[BRISTLE + k * L + l], w[BRISTLE_NEXT + k * L + l]
                            w[BRISTLE + k * L + l] = then if on else now
                left = 0.0
                for l in range(L):
                    left = max(left, follow_ramps(l, act, w))
                if left == 0.0:
                    break
        for i in range(ni * L):
            w[LEVEL + i], w[GAP + i] = w[GIVEN + i], 0.0

    return Lanes(held, together, past_limits)
