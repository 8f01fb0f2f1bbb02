"""Machines side by side, each with numbers of its own, an interval at a time; see ``drivers.batch``."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.drivers.kernel.equations import Equations, Numbers
from fieldmodels.drivers.kernel.events import Events
from fieldmodels.drivers.kernel.facts import Facts
from fieldmodels.drivers.kernel.intervals import Intervals
from fieldmodels.drivers.kernel.tuples import put, take
from fieldmodels.effects import actuators, forces, sensors

Made = Callable[..., Any]


class Sets(NamedTuple):
    """Sets of a machine's numbers, in rows.

    Attributes:
        base: Base parameters and own effects', shape (sets, parameters).
        act: Of actuators, shape (sets, inputs, numbers).
        frc: Of forces, shape (sets, forces, numbers).
        sen: Of sensors, shape (sets, outputs, numbers).
        changes: Of what changes in time, shape (sets, parameters, numbers).
        curves: Of curves, shape (sets, numbers).
    """

    base: FloatArray
    act: FloatArray
    frc: FloatArray
    sen: FloatArray
    changes: FloatArray
    curves: FloatArray


class Memory(NamedTuple):
    """What the next interval of each machine depends on; the first axis of all is (machines,).

    Attributes:
        ticks: Intervals since each episode began.
        states: True states, (machines, states).
        aims: What actuators aimed at in the latest intervals, a ring, (machines, inputs, slots).
        engaged: What their play transmitted, (machines, inputs).
        given: What they give, likewise.
        bristles: Forces of bent bristles, (machines, forces).
        filtered: What slow sensors show, (machines, outputs).
        before: What they sensed at the end of the latest step, likewise.
        sensed: What late ones sense now, likewise.
        kept: What they have sensed in the latest intervals, a ring, (machines, outputs, slots).
    """

    ticks: IntArray
    states: FloatArray
    aims: FloatArray
    engaged: FloatArray
    given: FloatArray
    bristles: FloatArray
    filtered: FloatArray
    before: FloatArray
    sensed: FloatArray
    kept: FloatArray


class Desk(NamedTuple):
    """Memory to work in.

    Attributes:
        edges: Where in an interval a piece begins, as a share of it.
        lateness: Intervals by which sensors are late; ``at`` the share of one after which they sense.
        whole: Whole intervals by which actuators are late; ``part`` the share of one beside.
        aim: What actuators aim at in a piece.
        jacobian, square: Shape (states, states).
    """

    edges: FloatArray
    lateness: FloatArray
    at: FloatArray
    whole: IntArray
    part: FloatArray
    aim: FloatArray
    jacobian: FloatArray
    square: FloatArray


class Episodes(NamedTuple):
    """Kernels of a machine's episodes.

    Attributes:
        begin: ``(sets, memory, rows)``: begin some machines' episodes in their states.
        advance: ``(sets, memory, commands, step, substeps, desk)``: take every machine one interval on.
        measure: ``(sen, ticks, given, sensed, step, play_scale, out)``: what its sensors measure now, without
            noise.
        steps: ``(sets, states, step, speeds, sizes, least, desk, out)``: steps within an interval for each.
    """

    begin: Made
    advance: Made
    measure: Made
    steps: Made


def desk_of(m: Facts) -> Desk:
    """Memory for the kernels of a machine's episodes, for one caller."""
    ns, ni, no = len(m.states), max(len(m.inputs), 1), len(m.outputs)
    return Desk(
        np.empty(ni + no + 2), np.empty(no), np.empty(no), np.empty(ni, np.int64), np.empty(ni), np.empty(ni),
        np.empty((ns, ns)), np.empty((ns, ns)),
    )  # fmt: skip


def episodes_of(m: Facts, equations: Equations, events: Events, intervals: Intervals) -> Episodes:
    """Compose the kernels of a machine's episodes."""
    inlined = m.inlined
    ns, ni, no, nf = len(m.states), max(len(m.inputs), 1), len(m.outputs), len(m.velocity)
    parameters, observed, past_ramps = equations.parameters, equations.observed, events.past_ramps
    parameters_at, pace = equations.parameters_at, equations.pace
    fitting, friction, changes_on, changed, steps_in, sort = intervals
    read_s, read_i, read_f = take(ns, 1, inlined), take(ni, 1, inlined), take(nf, 1, inlined)
    write_s, write_i, write_f = put(ns, 1, inlined), put(ni, 1, inlined), put(nf, 1, inlined)
    write_o, idle, nothing = put(no, 1, inlined), (0.0,) * ni, (0.0,) * nf
    commanded, curved = m.commanded, bool(m.at("parameter"))
    most = forces.FRICTION_STEPS

    @inlined
    def past(ring, back, tick):
        """What a ring kept some intervals before the present one."""
        return ring[(tick - back) % len(ring)]

    @inlined
    def aim_at(commands, act, curves, tick, step, aims, engaged, given):
        """What the actuators of a machine aim at for its commands."""
        for i in range(ni):
            row, curve = actuators.unpack(act[i]), curves[commanded[i][0] : commanded[i][1]]
            if tick == 0:
                engaged[i] = actuators.asked(commands[i], row, curve)
            after = min(max((tick + 1) - row.parameter_step_time / step, 0.0), 1.0)
            aim, engaged[i] = actuators.target(commands[i], engaged[i], after, row, curve)
            if tick == 0:  # before the first command there was the first
                aims[i] = aim
                given[i] = aim
            aims[i, tick % aims.shape[1]] = aim

    @inlined
    def sense(now, h, sen, filtered, before):
        """What slow sensors show a time ``h`` later, of what they sense now."""
        for o in range(no):
            lag = sensors.unpack(sen[o]).lag_time_constant
            filtered[o] = sensors.filtered(filtered[o], before[o], now[o], h, lag) if lag > 0.0 else now[o]
            before[o] = now[o]

    @m.kernel
    def advance(sets, memory, commands, step, substeps, desk):
        edges, late, at, whole, part = desk.edges, desk.lateness, desk.at, desk.whole, desk.part
        for e in range(len(sets.base)):
            act, sen, changes, base = sets.act[e], sets.sen[e], sets.changes[e], sets.base[e]
            filtered, before, given = memory.filtered[e], memory.before[e], memory.given[e]
            tick = memory.ticks[e]
            clock = tick * step
            aim_at(commands[e], act, sets.curves[e], tick, step, memory.aims[e], memory.engaged[e], given)
            for i in range(ni):
                shift = actuators.unpack(act[i]).delay_delay / step
                whole[i] = math.floor(shift)
                part[i] = edges[i] = shift - whole[i]
            for o in range(no):
                late[o] = sensors.unpack(sen[o]).delay_delay / step
                at[o] = edges[ni + o] = math.ceil(late[o]) - late[o]  # where in an interval it senses
                if tick == 0:
                    filtered[o] = before[o]
                    memory.kept[e, o] = before[o]
            edges[-2], edges[-1] = 0.0, 1.0
            sort(edges)
            s, u, b = read_s(memory.states[e], 0), read_i(given, 0), read_f(memory.bristles[e], 0)
            changing = curved or changes_on(changes)
            p = parameters(base)
            if changing:
                p = parameters_at(base, changes, clock, step, sets.curves[e], s, u)
            for piece in range(ni + no + 1):
                length = edges[piece + 1] - edges[piece]
                if length <= 0.0:
                    continue
                for i in range(ni):
                    early = 1 if edges[piece] < part[i] else 0
                    desk.aim[i] = past(memory.aims[e, i], whole[i] + early, tick)
                    given[i] = u[i] if actuators.has_dynamics(actuators.unpack(act[i])) else desk.aim[i]
                aim, u = read_i(desk.aim, 0), read_i(given, 0)
                count = steps_in(length, substeps[e])
                h = length * step / count
                for sub in range(count):
                    t = clock + edges[piece] * step + sub * h
                    q = Numbers(p, sets.frc[e], sets.curves[e])
                    if changing:
                        p = changed(base, changes, t, h, s, u, aim, idle, nothing, q, act, b)
                        q = Numbers(p, sets.frc[e], sets.curves[e])
                    s, u, b = past_ramps(t, h, s, u, aim, idle, nothing, q, act, b)
                    sense(observed(t + h, s, u, q), h, sen, filtered, before)
                write_i(given, 0, u)
                for o in range(no):
                    if at[o] > 0.0 and edges[piece + 1] == at[o]:
                        memory.kept[e, o, tick % memory.kept.shape[2]] = filtered[o]
            write_s(memory.states[e], 0, s)
            write_f(memory.bristles[e], 0, b)
            for o in range(no):
                if at[o] == 0.0:
                    memory.kept[e, o, tick % memory.kept.shape[2]] = filtered[o]
                back = math.ceil(late[o]) - (1 if at[o] > 0.0 else 0)
                memory.sensed[e, o] = past(memory.kept[e, o], back, tick)
            memory.ticks[e] = tick + 1

    @m.kernel
    def measure(sen, ticks, given, sensed, step, play_scale, out):
        for e in range(len(out)):
            for o in range(no):
                row = sensors.unpack(sen[e, o])
                play = sensors.play(given[e, 0], play_scale, row)
                out[e, o] = sensors.measured(sensed[e, o], ticks[e] * step, play, row)

    @m.kernel
    def begin(sets, memory, rows):
        for e in rows:
            memory.ticks[e] = 0
            memory.bristles[e] = 0.0
            q = Numbers(parameters(sets.base[e]), sets.frc[e], sets.curves[e])
            z = observed(0.0, read_s(memory.states[e], 0), idle, q)
            write_o(memory.before[e], 0, z)
            write_o(memory.sensed[e], 0, z)

    @m.kernel
    def steps(sets, states, step, speeds, sizes, least, desk, out):
        for e in range(len(out)):
            p, s = parameters(sets.base[e]), read_s(states[e], 0)
            mode = pace(s, idle, p, sizes, desk.jacobian, desk.square)
            count = fitting(mode, step, least, 256)
            out[e] = fitting(mode + friction(s, p, sets.frc[e], speeds), step, count, most)

    return Episodes(begin, advance, measure, steps)
