"""All windows of a recording, for every set of a machine's numbers; see ``drivers.windows``."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from fieldmodels.arrays import BoolArray, FloatArray, IntArray
from fieldmodels.drivers.kernel.equations import Equations, Numbers, value_of
from fieldmodels.drivers.kernel.events import Events
from fieldmodels.drivers.kernel.facts import NONE, CurveAt, Facts
from fieldmodels.drivers.kernel.intervals import Intervals
from fieldmodels.drivers.kernel.lanes import CALM, PLAIN, WHOLE, Lanes, places_of
from fieldmodels.drivers.kernel.tuples import along, changed, put, take
from fieldmodels.effects import actuators, forces, sensors
from fieldmodels.effects.stock import NO_LIMIT

CORRECTIONS = 2
"""Times that a guessed start behind sensors that are late by different times is corrected."""
CURVED = 20
"""Fixed-point steps by which a sensor's curve is inverted."""
Made = Callable[..., Any]


class Log(NamedTuple):
    """A recording as kernels take it.

    Attributes:
        command: Commands, shape (n, inputs).
        disturbance: Forces on every sample, shape (n, forces), or (0, forces).
        episodes: First sample and end of every episode, shape (episodes, 2).
        pieces: Those of every piece that is needed, shape (pieces, 2).
        measured: Which outputs it has, shape (outputs,).
        slopes: Rates of what sensors show, and the rates of those, shape (2, n, outputs), or (2, 0, outputs).
        path: Position along each force, freed of noise, shape (forces, n), or (forces, 0).
        step: Sampling interval [s].
        interpolated: Whether commands go along lines from sample to sample, instead of being held.
        play: Command over which play is crossed.
    """

    command: FloatArray
    disturbance: FloatArray
    episodes: IntArray
    pieces: IntArray
    measured: BoolArray
    slopes: FloatArray
    path: FloatArray
    step: float
    interpolated: bool
    play: float


class Spans(NamedTuple):
    """Windows of a recording.

    Attributes:
        starts: First samples.
        lengths: Numbers of samples.
        firsts: First samples that act on each of them.
        lasts: Last samples that do.
        states: States at the starts, shape (windows, states).
    """

    starts: IntArray
    lengths: IntArray
    firsts: IntArray
    lasts: IntArray
    states: FloatArray


class Fineness(NamedTuple):
    """What the number of steps in a sampling interval follows from.

    Attributes:
        speeds: Speeds along the forces that are hardly exceeded.
        sizes: How large each state is.
        least: Steps, at least.
    """

    speeds: FloatArray
    sizes: FloatArray
    least: int


class Room(NamedTuple):
    """Memory to work in.

    Attributes:
        targets: What actuators aim at, shape (inputs, n).
        filtered: What they give, of the same shape.
        bent: Forces of bristles along the recording, shape (forces, n).
        edges: Where in an interval a piece begins, as a share of it.
        part: Shares of an interval by which commands are late; ``whole`` intervals before.
        ahead_part: Shares of an interval by which sensors show earlier than the latest; ``ahead`` before.
        lanes: Numbers of the lanes.
        states: States at which they start, shape (lanes, states).
        unbounded: Rows of sensors without bounds and steps, shape (outputs, numbers).
        dynamic: Which actuators have memory.
        jacobian, square: Shape (states, states).
        begins, lows, highs: First sample of each lane's window, and the first and last that act on it.
    """

    targets: FloatArray
    filtered: FloatArray
    bent: FloatArray
    edges: FloatArray
    part: FloatArray
    ahead_part: FloatArray
    lanes: FloatArray
    states: FloatArray
    unbounded: FloatArray
    whole: IntArray
    ahead: IntArray
    dynamic: BoolArray
    jacobian: FloatArray
    square: FloatArray
    begins: IntArray
    lows: IntArray
    highs: IntArray


class Late(NamedTuple):
    """How late sensors are.

    Attributes:
        latest: The latest of them [s].
        filtering: Whether one is slow.
        aligned: Whether none is late, slow, or shows more than a straight line.
        gapped: Whether one sits behind play.
        longest: Intervals that a run must go on beyond its last sample.
        uneven: Whether they are late by different times.
    """

    latest: float
    filtering: bool
    aligned: bool
    gapped: bool
    longest: int
    uneven: bool


class Group(NamedTuple):
    """The windows that are in the lanes.

    Attributes:
        first: The first of them.
        size: How many.
        wanted: Samples that are wanted of the longest.
        sen: Rows of sensors that show them.
    """

    first: int
    size: int
    wanted: int
    sen: FloatArray


class Course(NamedTuple):
    """How one set of numbers is simulated.

    Attributes:
        kind: What acts on the machine, as lanes have it.
        dry: Whether dry friction does.
        late: How late its sensors are.
        limited: Whether an actuator has a limited rate.
        held: Whether inputs stay as they are within an interval.
        changing: Whether parameters change in time.
        alone: Whether each lane goes by itself.
        moving: Whether there is more than the machine's own equations with held inputs.
        substeps: Steps in a sampling interval.
    """

    kind: int
    dry: bool
    late: Late
    limited: bool
    held: bool
    changing: bool
    alone: bool
    moving: bool
    substeps: int


def room_of(m: Facts, samples: int, path: int) -> Room:
    """Memory for one call of ``simulate``.

    Args:
        m: The machine.
        samples: Length of the recording.
        path: Length of the path along which bristles are bent.
    """
    ns, ni, no, nf = len(m.states), max(len(m.inputs), 1), len(m.outputs), len(m.velocity)
    integers = np.int64
    return Room(
        np.zeros((ni, samples)), np.zeros((ni, samples)), np.zeros((nf, path)), np.zeros(ni + no + 2),
        np.zeros(ni), np.zeros(no), np.zeros(places_of(m).size), np.zeros((m.lanes, ns)),
        np.zeros((no, len(sensors.ROW))), np.zeros(ni, integers), np.zeros(no, integers),
        np.zeros(ni, np.bool_), np.zeros((ns, ns)), np.zeros((ns, ns)),
        np.zeros(m.lanes, integers), np.zeros(m.lanes, integers), np.zeros(m.lanes, integers),
    )  # fmt: skip


def simulate_of(m: Facts, equations: Equations, events: Events, intervals: Intervals, lanes: Lanes) -> Made:
    """``(sets, log, spans, fineness, room, out)``: simulate all windows for all sets of numbers.

    ``out`` of shape (sets, windows, samples, outputs) receives what the sensors measure.
    """
    inlined, block, L = m.inlined, m.block, m.lanes
    ns, ni, no, nf = len(m.states), max(len(m.inputs), 1), len(m.outputs), len(m.velocity)
    at = places_of(m)
    STATE, LEVEL, SLOPE, GAP, GIVEN = at.state, at.level, at.slope, at.gap, at.given
    TARGET, RAMP, EXTRA, CLOCK, BRISTLE, SLOW, SENSED, BEHIND = (
        at.target, at.ramp, at.extra, at.clock, at.bristle, at.slow, at.sensed, at.behind
    )  # fmt: skip
    parameters, parameters_at, observed = equations.parameters, equations.parameters_at, equations.observed
    pace, rows, rates = equations.pace, equations.rows, equations.rates
    past_ramps = events.past_ramps
    fitting, friction, changes_on, changed_over, steps_in, sort = intervals
    held, together, past_limits = lanes
    read_s, read_i, read_f = (take(n, L, inlined) for n in (ns, ni, nf))
    write_s, write_i, write_f = (put(n, L, inlined) for n in (ns, ni, nf))
    one_s, one_i = take(ns, 1, inlined), take(ni, 1, inlined)
    change, change_i, ahead_i = changed(ns, inlined), changed(ni, inlined), along(ni, inlined)
    still, nothing, idle = (0.0,) * ns, (0.0,) * nf, (0.0,) * ni
    stepped, commanded = m.stepped, m.commanded
    own, rate, rate_state = m.own, m.rate, m.rate_state
    unseen = tuple(o not in own for o in range(no))
    unbend = _unbent(m)
    bends_rest, bends_parameters = (
        tuple((c.start + c.head, c.stop) for c in curves) or ((0, 0),)
        for curves in (m.at("force", "sensor"), m.at("parameter"))
    )
    own_pace, most = "fastest" in m.functions, forces.FRICTION_STEPS
    clipping, quantisation = sensors.ROW.column("clipping_limit"), sensors.ROW.column("quantisation_step")

    @inlined
    def any_on(values, curves):
        """Whether a value of some curves, which have their places in a row, is not 0."""
        for first, end in values:
            for k in range(first, end):
                if curves[k] != 0.0:
                    return True
        return False

    @inlined
    def within(sample, low, high):
        return min(max(sample, low), high)

    @inlined
    def one_by_one(count, h, size, base, changes, changing, act, sen, q, w):
        """Some steps of every lane by itself: with parameters that change, and slow sensors."""
        for l in range(size):
            s, x, b = read_s(w, STATE + l), read_f(w, EXTRA + l), read_f(w, BRISTLE + l)
            u, aim, slope = read_i(w, GIVEN + l), read_i(w, LEVEL + l), read_i(w, SLOPE + l)
            p = q.own
            for sub in range(count):
                t = w[CLOCK + l] + sub * h
                if changing:
                    p = changed_over(base, changes, t, h, s, u, aim, slope, x, q, act, b)
                now = Numbers(p, q.forces, q.curves)
                s, u, b = past_ramps(t, h, s, u, aim, slope, x, now, act, b)
                aim = ahead_i(aim, h, slope)
                z = observed(t + h, s, u, now)
                for o in range(no):
                    a, lag = o * L + l, sensors.unpack(sen[o]).lag_time_constant
                    if lag > 0.0:
                        w[SLOW + a] = sensors.filtered(w[SLOW + a], w[SENSED + a], z[o], h, lag)
                    w[SENSED + a] = z[o]
            write_s(w, STATE + l, s)
            write_i(w, GIVEN + l, u)
            write_f(w, BRISTLE + l, b)

    @block
    def write(at, output, size, group, starts, lengths, command, step, play_scale, time, q, sen, w, out):
        """What a sensor measures of every lane at a sample, of whose own command it may depend."""
        row = sensors.unpack(sen[output])
        straight, slow = sensors.is_straight(row), row.lag_time_constant > 0.0
        for l in range(size):
            window = group + l
            if at >= lengths[window]:
                continue
            sample = starts[window] + at
            t = time + starts[window] * step
            z = observed(t, read_s(w, STATE + l), one_i(command[sample], 0), q)
            value = w[SLOW + output * L + l] if slow else z[output]
            if straight:
                out[window, at, output] = sensors.straight(value, sample * step, row)
            else:
                play = sensors.play(w[GIVEN + l], play_scale, row)
                out[window, at, output] = sensors.measured(value, sample * step, play, row)

    @block
    def write_aligned(at, size, group, starts, lengths, command, step, q, sen, w, out):
        """As ``write`` for all outputs at once, where every sensor is straight and none is late."""
        for l in range(size):
            window = group + l
            if at < lengths[window]:
                sample = starts[window] + at
                clock = sample * step
                z = observed(clock, read_s(w, STATE + l), one_i(command[sample], 0), q)
                for o in range(no):
                    out[window, at, o] = sensors.straight(z[o], clock, sensors.unpack(sen[o]))

    @inlined
    def aim_of(target, sample, share, low, high, log):
        """What an actuator aims at a share of a step after a sample, and how it changes [1/s]."""
        now = target[within(sample, low, high)]
        if not log.interpolated:
            return now, 0.0
        change = target[within(sample + 1, low, high)] - now
        return now + share * change, change / log.step

    @inlined
    def given_at(start, low, high, log, act, room):
        """What actuators give at the start of a window."""
        u = idle
        for i in range(ni):
            late = 1 if room.part[i] > 0.0 else 0
            source = max(start - room.whole[i] - late, low)
            given = room.targets[i, source]
            if room.dynamic[i]:
                given = room.filtered[i, source]
                if late == 1 and start - room.whole[i] - 1 >= low:
                    aim, slope = aim_of(room.targets[i], source, 0.0, low, high, log)
                    time = (1.0 - room.part[i]) * log.step
                    end = aim + slope * time
                    given = actuators.follow_line(given, aim, end, time, actuators.unpack(act[i]))
            elif log.interpolated:
                share = (1.0 - room.part[i]) * late
                given, _ = aim_of(room.targets[i], start - room.whole[i] - late, share, low, high, log)
            u = change_i(u, i, given)
        return u

    @inlined
    def behind(o, shown, start, sen, log):
        """By how much a slow sensor is behind: T dy/dt = true - y, however the machine moved before."""
        row = sensors.unpack(sen[o])
        return row.lag_time_constant * (log.slopes[0, start, o] - row.drift_rate) / sensors.slope(shown, row)

    @inlined
    def true_start(s, u, start, slow, sen, curves, log):
        """States behind what the sensors show of them."""
        clock = start * log.step
        for i in range(ns):
            if own[i] >= 0 and (rate[i] < 0 or log.measured[own[i]]):
                row = sensors.unpack(sen[own[i]])
                s = change(s, i, sensors.inverted(s[i], clock, sensors.play(u[0], log.play, row), row))
        for i in range(ns):
            if rate[i] >= 0 and (own[i] < 0 or not log.measured[own[i]]):
                row = sensors.unpack(sen[rate[i]])
                speed = s[i] - row.drift_rate
                if slow and row.lag_time_constant > 0.0 and log.measured[rate[i]]:
                    speed += row.lag_time_constant * log.slopes[1, start, rate[i]]
                s = change(s, i, speed / sensors.slope(s[rate_state[i]], row))
        return unbend(clock, s, one_i(log.command[start], 0), sen, curves)

    @block
    def begin(l, start, low, high, late, base, changes, changing, act, sen, q, log, room):
        """Put a window's true start, behind what the sensors show of it, into a lane."""
        w, clock = room.lanes, start * log.step
        slow = start > low  # an episode begins with slow sensors at rest
        u = given_at(start, low, high, log, act, room)
        s = true_start(one_s(room.states[l], 0), u, start, slow, sen, q.curves, log)
        for o in range(no):
            w[BEHIND + o * L + l] = 0.0
        if late.latest > 0.0 or late.filtering:
            d = still
            if not stepped:
                acting = Numbers(q.own, rows(q.forces), q.curves)
                d = rates(clock, s, u, nothing, acting, nothing, still, nothing)
            for i in range(ns):
                if own[i] >= 0 and (rate[i] < 0 or log.measured[own[i]]):
                    row = sensors.unpack(sen[own[i]])
                    back = row.lag_time_constant * d[i] if slow else 0.0
                    if slow and row.lag_time_constant > 0.0 and log.measured[own[i]]:
                        back = behind(own[i], s[i], start, sen, log)
                    w[BEHIND + own[i] * L + l] = back
                    s = change(s, i, s[i] + back - (late.latest - row.delay_delay) * d[i])
        write_s(w, STATE + l, s)
        write_i(w, GIVEN + l, u)
        for k in range(nf):
            bends = forces.unpack(q.forces[k]).hysteresis_force != 0.0
            w[BRISTLE + k * L + l] = room.bent[k, start] if bends else 0.0
            w[EXTRA + k * L + l] = 0.0
        p = q.own
        if changing:
            p = parameters_at(base, changes, clock - late.latest, log.step, q.curves, s, u)
        z = observed(clock - late.latest, s, u, Numbers(p, q.forces, q.curves))
        for o in range(no):
            w[SENSED + o * L + l] = z[o]
            lag = sensors.unpack(sen[o]).lag_time_constant
            if unseen[o] and slow and lag > 0.0 and log.measured[o]:
                w[BEHIND + o * L + l] = behind(o, z[o], start, sen, log)
            w[SLOW + o * L + l] = z[o] - w[BEHIND + o * L + l]

    @inlined
    def acting(q):
        """What acts on the machine, and whether dry friction does."""
        full, dry, costly = any_on(bends_rest, q.curves), False, False
        for k in range(nf):
            row = forces.unpack(q.forces[k])
            full = full or not forces.is_off(row)
            dry = dry or forces.has_dry_friction(row)
            costly = costly or forces.is_periodic(row) or forces.is_cogging(row)
            costly = costly or row.stribeck_friction_force != 0.0 or row.hysteresis_force != 0.0
        return (WHOLE if costly else CALM if full else PLAIN), dry

    @inlined
    def lateness(sen, log, room):
        """How late sensors are; in ``room`` by how much each shows earlier than the latest."""
        latest, filtering, gapped, straight = 0.0, False, False, True
        for o in range(no):
            row = sensors.unpack(sen[o])
            latest = max(latest, row.delay_delay)
            filtering = filtering or row.lag_time_constant > 0.0
            gapped = gapped or row.backlash_gap != 0.0
            straight = straight and sensors.is_straight(row)
        longest, uneven = 0, False
        for o in range(no):
            share = (latest - sensors.unpack(sen[o]).delay_delay) / log.step
            uneven = uneven or (share > 0.0 and log.measured[o])
            room.ahead[o] = math.floor(share)
            room.ahead_part[o] = share - room.ahead[o]
            room.edges[ni + o] = room.ahead_part[o]
            longest = max(longest, room.ahead[o] + (1 if room.ahead_part[o] > 0.0 else 0))
            for k in range(sen.shape[1]):
                room.unbounded[o, k] = sen[o, k]
            room.unbounded[o, clipping], room.unbounded[o, quantisation] = NO_LIMIT, 0.0
        aligned = straight and latest == 0.0 and not filtering
        return Late(latest, filtering, aligned, gapped, longest, uneven)

    @inlined
    def drive(act, curves, latest, log, room):
        """What drives the machine along the recording; whether any actuator has memory, or a limited rate."""
        dynamic, limited = False, False
        for i in range(ni):
            row, curve = actuators.unpack(act[i]), curves[commanded[i][0] : commanded[i][1]]
            if actuators.is_static(row) or actuators.is_curved(curve):
                actuators.actuate(
                    log.command[:, i], log.pieces, log.step, log.interpolated, row, curve, room.targets[i]
                )
            else:
                for piece in range(len(log.pieces)):
                    for sample in range(log.pieces[piece, 0], log.pieces[piece, 1]):
                        room.targets[i, sample] = log.command[sample, i]
            room.dynamic[i] = actuators.has_dynamics(row)
            dynamic = dynamic or room.dynamic[i]
            limited = limited or row.rate_limit_rate < NO_LIMIT
            if room.dynamic[i]:
                actuators.respond(
                    room.targets[i], log.pieces, log.step, log.interpolated, row, room.filtered[i]
                )
            shift = (row.delay_delay + latest) / log.step
            room.whole[i] = math.floor(shift)
            room.part[i] = room.edges[i] = shift - room.whole[i]
        return dynamic, limited

    @inlined
    def fine_steps(q, log, spans, fineness, room):
        """Steps within a sampling interval, by the fastest mode at some windows' starts."""
        mode, rubbing = 0.0, 0.0
        for k in range(4):
            window = k * (len(spans.starts) - 1) // 3
            s, u = one_s(spans.states[window], 0), idle
            for i in range(ni):
                u = change_i(u, i, room.targets[i, spans.starts[window]])
            if k == 0 or not own_pace:
                mode = max(mode, pace(s, u, q.own, fineness.sizes, room.jacobian, room.square))
                rubbing = max(rubbing, friction(s, q.own, q.forces, fineness.speeds))
        steps = fitting(mode, log.step, fineness.least, 256)
        return fitting(mode + rubbing, log.step, steps, most)

    @inlined
    def place_lanes(group, size, spans, room):
        """Put windows into lanes; those without one repeat the last. Returns the samples of the longest."""
        samples = 0
        for l in range(L):
            window = group + min(l, size - 1)
            room.begins[l], room.lows[l] = spans.starts[window], spans.firsts[window]
            room.highs[l] = spans.lasts[window]
            for i in range(ns):
                room.states[l, i] = spans.states[window, i]
            samples = max(samples, spans.lengths[window])
        return samples

    @inlined
    def aim(j, edge, course, act, log, room):
        """What the actuators of every lane aim at in a piece of the j-th interval."""
        w = room.lanes
        for i in range(ni):
            early = 1 if edge < room.part[i] else 0
            back = room.whole[i] + early - j
            target = room.targets[i]
            level, slope, given, gap = LEVEL + i * L, SLOPE + i * L, GIVEN + i * L, GAP + i * L
            for l in range(L):
                w[level + l] = target[within(room.begins[l] - back, room.lows[l], room.highs[l])]
            if not (course.moving or course.alone):
                continue
            if log.interpolated:
                share = edge - room.part[i] + early
                for l in range(L):
                    after = target[within(room.begins[l] - back + 1, room.lows[l], room.highs[l])]
                    change = after - w[level + l]
                    w[level + l] += share * change
                    w[slope + l] = change / log.step
            else:
                for l in range(L):
                    w[slope + l] = 0.0
            if course.limited:
                for l in range(L):
                    w[TARGET + i * L + l], w[RAMP + i * L + l] = w[level + l], w[slope + l]
            if not room.dynamic[i]:
                for l in range(L):
                    w[given + l] = w[level + l]
                for l in range(L):
                    w[gap + l] = 0.0
            if log.interpolated and not course.alone:
                lag = actuators.unpack(act[i]).lag_time_constant
                for l in range(L):
                    w[level + l] -= lag * w[slope + l]
            if room.dynamic[i]:
                for l in range(L):
                    w[gap + l] = w[given + l] - w[level + l]

    @inlined
    def course_of(changes, act, sen, q, log, spans, fineness, room):
        kind, dry = acting(q)
        late = lateness(sen, log, room)
        dynamic, limited = drive(act, q.curves, late.latest, log, room)
        for k in range(nf):
            row = forces.unpack(q.forces[k])
            if row.hysteresis_force != 0.0:
                forces.bend_along(log.path[k], log.episodes, row, room.bent[k])
        room.edges[ni + no], room.edges[ni + no + 1] = 0.0, 1.0
        sort(room.edges)
        changing = any_on(bends_parameters, q.curves) or changes_on(changes)
        held_inputs = not (log.interpolated or dynamic)
        return Course(
            kind, dry, late, limited, held_inputs, changing, changing or late.filtering,
            not held_inputs or kind != PLAIN, fine_steps(q, log, spans, fineness, room),
        )  # fmt: skip

    @inlined
    def show(j, share, group, q, course, log, spans, room, out):
        """Write what the sensors show that sense at a share of the j-th interval; 0 for its start."""
        late, first, size, w = course.late, group.first, group.size, room.lanes
        starts, lengths, command, step = spans.starts, spans.lengths, log.command, log.step
        if late.aligned and share == 0.0:
            write_aligned(j, size, first, starts, lengths, command, step, q, group.sen, w, out)
        for o in range(0 if late.aligned else no):
            at, time = j - room.ahead[o], (j + share) * step - late.latest
            if room.ahead_part[o] == share and 0 <= at < group.wanted:
                write(
                    at, o, size, first, starts, lengths, command, step, log.play, time, q, group.sen, w, out
                )  # fmt: skip

    @inlined
    def correct(group, size, sen, log, spans, room, out):
        """Move guessed starts by what their sensors show wrongly there."""
        for l in range(L):
            window = group + min(l, size - 1)
            for i in range(ns):
                o = own[i]
                if o >= 0 and log.measured[o] and sensors.unpack(sen[o]).lag_time_constant == 0.0:
                    room.states[l, i] += spans.states[window, i] - out[window, 0, o]

    @inlined
    def cross_piece(j, edge, end, size, base, changes, act, sen, q, course, log, room):
        """Take all lanes through a piece of the j-th interval."""
        w = room.lanes
        count = steps_in(end - edge, course.substeps)
        h = (end - edge) * log.step / count
        for l in range(L):
            w[CLOCK + l] = ((room.begins[l] + j) + edge) * log.step - course.late.latest
        if len(log.disturbance) > 0:
            for k in range(nf):
                for l in range(L):
                    sample = min(room.begins[l] + j, room.highs[l])
                    w[EXTRA + k * L + l] = log.disturbance[sample, k]
        aim(j, edge, course, act, log, room)
        if course.alone:
            one_by_one(count, h, size, base, changes, course.changing, act, sen, q, w)
            return
        if course.limited:
            past_limits(course.kind, course.dry, count, h, size, act, q, w)
        elif course.moving:
            together(course.kind, course.dry, count, h, size, course.held, act, q, w)
        else:
            held(count, h, q, w)
        if course.moving:
            for i in range(ni * L):
                w[GIVEN + i] = w[LEVEL + i] + w[GAP + i]

    @inlined
    def play_now(j, size, course, log, room):
        """What an actuator without memory gives at a sample pushes a sensor behind play to one side."""
        if course.late.gapped and not (log.interpolated or room.dynamic[0]):
            back = j - room.whole[0] - (1 if room.part[0] > 0.0 else 0)
            for l in range(size):
                sample = within(room.begins[l] + back, room.lows[l], room.highs[l])
                room.lanes[GIVEN + l] = room.targets[0, sample]

    @inlined
    def run(group, base, changes, act, sen, q, course, log, spans, room, out):
        """Run the windows in the lanes from their starts."""
        late, size = course.late, group.size
        for l in range(L):
            start, low, high = room.begins[l], room.lows[l], room.highs[l]
            begin(l, start, low, high, late, base, changes, course.changing, act, sen, q, log, room)
        for j in range(group.wanted + late.longest):
            play_now(j, size, course, log, room)
            for piece in range(ni + no + 1):
                edge, end = room.edges[piece], room.edges[piece + 1]
                if end <= edge:
                    continue
                show(j, edge, group, q, course, log, spans, room, out)
                if j == group.wanted + late.longest - 1:
                    break
                cross_piece(j, edge, end, size, base, changes, act, sen, q, course, log, room)

    def simulate(sets, log, spans, fineness, room, out):
        for row in range(len(sets.base)):
            base, changes, act, sen = sets.base[row], sets.changes[row], sets.act[row], sets.sen[row]
            q = Numbers(parameters(base), sets.frc[row], sets.curves[row])
            course = course_of(changes, act, sen, q, log, spans, fineness, room)
            for first in range(0, len(spans.starts), L):
                size = min(L, len(spans.starts) - first)
                samples = place_lanes(first, size, spans, room)
                # Where sensors are late by different times, the start is guessed, run to what they show, and
                # corrected.
                for left in range(CORRECTIONS if course.late.uneven else 0, -1, -1):
                    wanted, seen = (samples, sen) if left == 0 else (1, room.unbounded)
                    group = Group(first, size, wanted, seen)
                    run(group, base, changes, act, sen, q, course, log, spans, room, out[row])
                    if left > 0:
                        correct(first, size, sen, log, spans, room, out[row])

    return m.kernel(simulate)


def _unbent(m: Facts) -> Made:
    """``(clock, s, u, sen, curves)``: true states of what sensors with curves show."""
    curves = [c for c in m.at("sensor") if c.state != NONE]
    less, count = _less(curves, m), CURVED if curves else 0

    @m.inlined
    def unbend(clock, shown, u, sen, curves):
        s = shown
        for _ in range(count):
            s = less(clock, shown, s, u, sen, curves)
        return s

    return unbend


def _less(curves: list[CurveAt], m: Facts) -> Made:
    """``(clock, n, s, u, sen, curves)``: states ``n`` less the values of sensors' curves at states ``s``."""
    if not curves:

        @m.inlined
        def same(_clock, n, _s, _u, _sen, _curves):
            return n

        return same
    c, before, change = curves[-1], _less(curves[:-1], m), changed(len(m.states), m.inlined)
    value, output, i = value_of(c, m.inlined), c.index, c.state

    @m.inlined
    def less(clock, n, s, u, sen, curves):
        n = before(clock, n, s, u, sen, curves)
        t = clock - sensors.unpack(sen[output]).delay_delay
        return change(n, i, n[i] - value(t, s, u, curves))

    return less
