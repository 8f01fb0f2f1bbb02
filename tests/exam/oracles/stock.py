"""Oracle of the stock effects around any machine, written from the equations that their modules document.

    command -> gain, bias, curve, asymmetry, play, dead zone, saturation, jump -> limited rate, lag -> delay
    M dv/dt = the machine's own + smooth forces + curves - (F_c + mu |u| + F_s exp(-(v/v_s)^2)) sign(v) - F_h
    true -> curve -> lag -> delay -> g y + b2 y |y| + wave + bias + rate t + play -> clipped -> quantised

Dry friction holds an axis as long as the other forces do not exceed F_c + F_s + mu |u|: an episode is a
sequence of stretches in which every axis moves in one direction or sticks; an event ends each.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import RegularGridInterpolator

from exam.oracles.piecewise import (
    ABSOLUTE,
    RELATIVE,
    Piece,
    current,
    edges_between,
    follow,
    follow_lines,
    jumps,
)
from fieldmodels.arrays import FloatArray, IntArray

Parameters = dict[str, float]
HARDLY = 1e-9
"""A force that moves nothing: so that an axis rests where nothing pushes or holds it."""
TINY = 1e-12
"""A hair later, so that a command counts that begins just now [s]."""


@dataclass(frozen=True)
class Axis:
    """A velocity on which forces act.

    Attributes:
        velocity: Which state it is.
        position: Which state is its integral, if one is.
        inertia: What forces on it are divided by.
        load: Which input loads its friction.
    """

    velocity: int
    position: int | None = None
    inertia: Callable[[Parameters], float] = lambda _p: 1.0
    load: int = 0


@dataclass(frozen=True)
class Plant:
    """A machine without effects.

    Attributes:
        states: Names of its states.
        inputs: Names of its inputs.
        outputs: Names of its outputs.
        rates: Rates of the states for states, inputs and parameters.
        axes: Where forces act.
        shown: True outputs for states and parameters; by default the states of the same names.
        held: Whether inputs are held from sample to sample, instead of going along lines.
    """

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    rates: Callable[[FloatArray, Sequence[float], Parameters], Sequence[float]]
    axes: tuple[Axis, ...] = ()
    shown: Callable[[FloatArray, Parameters], Sequence[float]] | None = None
    held: bool = True


@dataclass(frozen=True)
class Shape:
    """A curve or table: values at knots of its variables, linear between, constant beyond.

    Attributes:
        place: ``actuator``, ``force``, ``sensor`` or ``parameter``.
        signal: What it adds to.
        over: Its variables: states, inputs, ``time``, or a product of two, ``speed*command``.
        knots: Where its values stand, for each variable.
        values: The values, one axis for each variable.
    """

    place: str
    signal: str
    over: tuple[str, ...]
    knots: tuple[FloatArray, ...]
    values: FloatArray

    def at(self, known: Mapping[str, float]) -> float:
        """Its value for the values of all signals."""
        point = [math.prod(known[name.strip()] for name in words.split("*")) for words in self.over]
        if len(point) == 1:
            return float(np.interp(point[0], self.knots[0], self.values))
        inside = [min(max(x, k[0]), k[-1]) for x, k in zip(point, self.knots, strict=True)]
        return float(RegularGridInterpolator(self.knots, self.values)(inside)[0])


Faults = Mapping[tuple[str, str, str], Mapping[str, float]]
"""(place, signal, kind) to values: ``{("actuator", "voltage", "lag"): {"time_constant": 0.1}}``."""


@dataclass
class Episode:
    """A plant with its faults in one episode.

    Attributes:
        plant: The machine.
        base: Its parameters.
        faults: Stock effects that are on.
        shapes: Curves and tables.
        commands: Commands at the samples, shape (n, inputs).
        step: Sampling interval [s].
    """

    plant: Plant
    base: Parameters
    faults: Faults
    shapes: Sequence[Shape]
    commands: FloatArray
    step: float
    pieces: list[list[Piece]] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Follow every command through its actuator."""
        self.pieces = [self.actuator(i) for i in range(len(self.plant.inputs))]

    def value(self, place: str, signal: str, name: str, neutral: float) -> float:
        """A parameter of a stock effect, ``kind.parameter``; neutral if the effect is off."""
        kind, parameter = name.split(".")
        return float(self.faults.get((place, signal, kind), {}).get(parameter, neutral))

    def curved(self, place: str, signal: str, known: Mapping[str, float]) -> float:
        """What curves add to a signal."""
        return sum(s.at(known) for s in self.shapes if (s.place, s.signal) == (place, signal))

    # The actuator.

    def actuator(self, i: int) -> list[Piece]:
        """What an actuator gives in the course of time."""
        name = self.plant.inputs[i]
        jump = self.value("actuator", name, "parameter_step.time", math.inf)
        factor = self.value("actuator", name, "parameter_step.factor", 1.0)
        delay = self.value("actuator", name, "delay.delay", 0.0)
        lag = self.value("actuator", name, "lag.time_constant", 0.0)
        rate = self.value("actuator", name, "rate_limit.rate", math.inf)
        aims, times = self.static(name, self.commands[:, i]), np.arange(len(self.commands)) * self.step
        moments = np.union1d(times, [t for t in [jump] if 0.0 < t < times[-1]])
        strength = np.where(moments >= jump, factor, 1.0)
        if self.plant.held:
            levels = aims[np.searchsorted(times, moments, side="right") - 1] * strength
            return follow(list(zip(moments + delay, levels, strict=True)), float(levels[0]), lag, rate)
        begins = np.interp(moments, times, aims)
        slopes = np.append(np.diff(begins) / np.diff(moments), 0.0)
        lines = [
            (float(t + delay), float(a * k), float(b * k))
            for t, a, b, k in zip(moments, begins, slopes, strength, strict=True)
        ]
        return follow_lines(lines, lag, rate)

    def static(self, name: str, commands: FloatArray) -> FloatArray:
        """What acts on the samples of a command."""
        difference = self.value("actuator", name, "asymmetry.difference", 0.0)
        half = 0.5 * self.value("actuator", name, "play.width", 0.0)
        zone = self.value("actuator", name, "dead_zone.width", 0.0)
        limit = self.value("actuator", name, "saturation.limit", math.inf)
        aims, engaged = np.empty(len(commands)), math.nan
        for i, command in enumerate(commands):
            u = self.value("actuator", name, "gain.gain", 1.0) * command
            u += self.value("actuator", name, "bias.bias", 0.0)
            u += self.curved("actuator", name, {name: u})
            u *= 1.0 + 0.5 * difference * np.sign(u)
            engaged = u if math.isnan(engaged) else float(np.clip(engaged, u - half, u + half))
            aims[i] = np.clip(math.copysign(max(abs(engaged) - zone, 0.0), engaged), -limit, limit)
        return aims

    # The machine.

    def inputs(self, time: float) -> list[float]:
        """What the actuators give at a time."""
        return [current(pieces, time).at(time) for pieces in self.pieces]

    def known(self, time: float, state: FloatArray, given: Sequence[float]) -> dict[str, float]:
        """All signals by name."""
        states = dict(zip(self.plant.states, state, strict=False))
        return {**states, **dict(zip(self.plant.inputs, given, strict=True)), "time": time}

    def parameters(self, time: float, known: Mapping[str, float]) -> Parameters:
        """Base parameters at a time."""
        result = dict(self.base)
        for name in result:
            if time >= self.value("change", name, "step.time", math.inf):
                result[name] += self.value("change", name, "step.change", 0.0)
            result[name] += self.value("change", name, "drift.rate", 0.0) * time
            result[name] += self.curved("parameter", name, known)
        return result

    def free(self, time: float, state: FloatArray, given: Sequence[float]) -> tuple[FloatArray, FloatArray]:
        """Rates of all states without dry friction and bristles; and the inertia of each axis."""
        known = self.known(time, state, given)
        p = self.parameters(time, known)
        rates = np.array(self.plant.rates(state, given, p), dtype=float)
        inertias = np.array([axis.inertia(p) for axis in self.plant.axes])
        for axis, inertia in zip(self.plant.axes, inertias, strict=True):
            name = self.plant.states[axis.velocity]
            x = state[axis.position] if axis.position is not None else 0.0
            push = self.smooth(name, float(x), float(state[axis.velocity]), time)
            rates[axis.velocity] += (push + self.curved("force", name, known)) / inertia
        return rates, inertias

    def smooth(self, name: str, x: float, v: float, t: float) -> float:
        """Smooth stock forces on a velocity."""

        def of(parameter: str, neutral: float = 0.0) -> float:
            return self.value("force", name, parameter, neutral)

        beyond = max(abs(x) - of("elastic_stop.place", 1.0), 0.0) * np.sign(x)
        place, phase = (
            2.0 * math.pi * x / of("cogging.period", 1.0),
            2.0 * math.pi * of("periodic_force.frequency", 1.0) * t,
        )
        return float(
            -of("viscous_friction.coefficient") * v
            - of("asymmetric_damping.coefficient") * math.fabs(v)
            - of("quadratic_drag.coefficient") * v * abs(v)
            - of("linear_stiffness.coefficient") * x
            - of("cubic_stiffness.coefficient") * x**3
            + of("constant_force.force")
            + of("periodic_force.sine") * math.sin(phase)
            + of("periodic_force.cosine") * math.cos(phase)
            + of("cogging.sine") * math.sin(place)
            + of("cogging.cosine") * math.cos(place)
            - of("elastic_stop.stiffness") * beyond
            - of("one_sided_spring.stiffness") * max(x - of("one_sided_spring.place"), 0.0)
        )

    def dry(self, k: int, v: float, given: Sequence[float]) -> float:
        """Size of dry friction on an axis at a speed; at 0 what it holds."""
        axis = self.plant.axes[k]
        name = self.plant.states[axis.velocity]
        size = self.value("force", name, "coulomb_friction.force", 0.0)
        if self.plant.inputs:
            size += self.value("force", name, "load_friction.share", 0.0) * abs(given[axis.load])
        ratio = v / self.value("force", name, "stribeck_friction.velocity", 1.0)
        return size + self.value("force", name, "stribeck_friction.force", 0.0) * math.exp(-(ratio**2))

    def true(self, time: float, state: FloatArray) -> FloatArray:
        """What the sensors sense."""
        known = self.known(time, state, self.inputs(time))
        if self.plant.shown is not None:
            result = np.array(self.plant.shown(state, self.parameters(time, known)), dtype=float)
        else:
            result = np.array([known[name] for name in self.plant.outputs])
        return result + [self.curved("sensor", name, known) for name in self.plant.outputs]

    # The whole.

    def run(self, start: FloatArray, bristles: FloatArray | None = None) -> FloatArray:
        """What the sensors show at the samples, from a true state at the time that is shown first."""
        names, times = self.plant.outputs, np.arange(float(len(self.commands))) * self.step
        delays = [self.value("sensor", name, "delay.delay", 0.0) for name in names]
        wanted = np.unique(np.concatenate([times - delay for delay in delays]))
        bent = np.zeros(len(self.plant.axes)) if bristles is None else bristles
        filters = self.true(float(wanted[0]) + TINY, start)
        path = self.path(wanted, np.concatenate([start, bent, filters]))
        shown = []
        for o, (name, delay) in enumerate(zip(names, delays, strict=True)):
            late = times - delay
            rows = path[np.searchsorted(wanted, late)]
            values = rows[:, len(start) + len(bent) + o]
            if self.value("sensor", name, "lag.time_constant", 0.0) == 0.0:
                values = np.array([self.true(t + TINY, row)[o] for t, row in zip(late, rows, strict=True)])
            shown.append(self.shown(name, values, times, late))
        return np.column_stack(shown)

    def shown(self, name: str, true: FloatArray, times: FloatArray, late: FloatArray) -> FloatArray:
        """What a sensor makes of a true value."""

        def of(parameter: str, neutral: float = 0.0) -> float:
            return self.value("sensor", name, parameter, neutral)

        phase = 2.0 * np.pi * true / of("eccentricity.period", 1.0)
        value = of("gain.gain", 1.0) * true + of("bend.curvature") * true * np.abs(true)
        value += of("eccentricity.sine") * np.sin(phase) + of("eccentricity.cosine") * np.cos(phase)
        value += of("bias.bias") + of("drift.rate") * times
        if gap := of("backlash.gap"):
            forces = np.array([current(self.pieces[0], t + TINY).at(t) for t in late])
            value += 0.5 * gap * np.tanh(forces / (0.02 * np.abs(self.commands[:, 0]).max()))
        value = np.clip(value, -of("clipping.limit", math.inf), of("clipping.limit", math.inf))
        quantum = of("quantisation.step")
        return quantum * np.floor(value / quantum + 0.5) if quantum else value

    def path(self, wanted: FloatArray, now: FloatArray) -> FloatArray:
        """States, bristles and filters at the wanted times."""
        stops = [t for pieces in self.pieces for t in jumps(pieces)]
        stops += [
            v["time"] for (place, _, kind), v in self.faults.items() if (place, kind) == ("change", "step")
        ]
        stops += [k for s in self.shapes if s.over == ("time",) for k in s.knots[0].tolist()]
        result = np.empty((len(wanted), len(now)))
        for begin, end in edges_between(float(wanted[0]), float(wanted[-1]), stops):
            inside = np.flatnonzero((wanted >= begin) & (wanted <= end))
            now = self._between(begin, end, now, wanted[inside], result, inside)
        return result

    def _between(
        self,
        begin: float,
        end: float,
        now: FloatArray,
        wanted: FloatArray,
        result: FloatArray,
        rows: IntArray,
    ) -> FloatArray:
        """The same between two jumps of the inputs; returns the state at the end."""
        middle = 0.5 * (begin + end)
        acting = [current(pieces, middle) for pieces in self.pieces]
        released: dict[int, float] = {}
        time = begin
        while True:
            modes = [released.get(k, self._mode(k, time, now, acting)) for k in range(len(self.plant.axes))]
            for k, mode in enumerate(modes):
                if mode == 0.0:
                    now[self.plant.axes[k].velocity] = 0.0
            solution = solve_ivp(
                self._derivative(modes, acting, middle), (time, end), now, method="DOP853", dense_output=True,
                events=[self._event(k, m, acting) for k, m in enumerate(modes) if m is not None] or None,
                rtol=RELATIVE, atol=ABSOLUTE,
            )  # fmt: skip
            reached, now = float(solution.t[-1]), solution.y[:, -1].copy()
            within = (wanted >= time) & (wanted <= reached)
            if within.any() and solution.sol is not None:
                result[rows[within]] = solution.sol(wanted[within]).T
            if solution.status == 0:
                return now
            having = [k for k, m in enumerate(modes) if m is not None]
            k = next(having[i] for i, found in enumerate(solution.t_events or []) if len(found))
            released = {}
            if modes[k] == 0.0:
                released = {k: math.copysign(1.0, self._push(k, reached, now, acting))}
            else:
                now[self.plant.axes[k].velocity] = 0.0
            time = reached

    def _push(self, k: int, time: float, now: FloatArray, acting: Sequence[Piece]) -> float:
        """Force on an axis without dry friction."""
        rates, inertias = self.free(time, now[: len(self.plant.states)], [piece.at(time) for piece in acting])
        return float(rates[self.plant.axes[k].velocity] * inertias[k] - now[len(self.plant.states) + k])

    def _mode(self, k: int, time: float, now: FloatArray, acting: Sequence[Piece]) -> float | None:
        """Direction in which an axis moves, 0 if it sticks, None if nothing depends on it."""
        name = self.plant.states[self.plant.axes[k].velocity]
        if not any(
            ("force", name, f"{kind}_friction") in self.faults for kind in ("coulomb", "stribeck", "load")
        ):
            return None
        v = float(now[self.plant.axes[k].velocity])
        if v != 0.0:
            return math.copysign(1.0, v)
        push = self._push(k, time, now, acting)
        holding = self.dry(k, 0.0, [piece.at(time) for piece in acting])
        return 0.0 if abs(push) <= holding + HARDLY else math.copysign(1.0, push)

    def _event(
        self, k: int, mode: float | None, acting: Sequence[Piece]
    ) -> Callable[[float, FloatArray], float]:
        """What ends a motion in a direction, or a rest."""
        velocity = self.plant.axes[k].velocity

        def event(time: float, now: FloatArray) -> float:
            if mode:
                return mode * float(now[velocity])
            holding = self.dry(k, 0.0, [piece.at(time) for piece in acting])
            return holding + HARDLY - abs(self._push(k, time, now, acting))

        event.terminal, event.direction = True, -1.0  # type: ignore[attr-defined]
        return event

    def _derivative(
        self, modes: Sequence[float | None], acting: Sequence[Piece], middle: float
    ) -> Callable[[float, FloatArray], FloatArray]:
        """Rates of states, bristles and filters."""
        count = len(self.plant.states)
        lags = [self.value("sensor", name, "lag.time_constant", 0.0) for name in self.plant.outputs]
        fixed = [
            (n, v["time"])
            for (place, n, kind), v in self.faults.items()
            if (place, kind) == ("change", "step")
        ]

        def derivative(time: float, now: FloatArray) -> FloatArray:
            # On an edge the side counts on which the stretch lies.
            for _, jump in fixed:
                if abs(time - jump) < TINY:
                    time = jump + math.copysign(TINY, middle - jump)
            given = [piece.at(time) for piece in acting]
            rates, inertias = self.free(time, now[:count], given)
            result = np.zeros(len(now))
            for k, axis in enumerate(self.plant.axes):
                v, bent = float(now[axis.velocity]), float(now[count + k])
                if modes[k] == 0.0:
                    rates[axis.velocity] = 0.0
                    continue
                rates[axis.velocity] -= ((modes[k] or 0.0) * self.dry(k, v, given) + bent) / inertias[k]
                name = self.plant.states[axis.velocity]
                most = self.value("force", name, "hysteresis.force", 0.0)
                distance = self.value("force", name, "hysteresis.distance", 1.0)
                result[count + k] = (most * v - bent * abs(v)) / distance
            result[:count] = rates
            if any(lags):
                true = self.true(time, now[:count])
                for o, lag in enumerate(lags):
                    if lag:
                        at = count + len(self.plant.axes) + o
                        result[at] = (true[o] - now[at]) / lag
            return result

        return derivative
