"""Stock effects around machines that are stepped: what `with_effects` does to a recording, a step at a time.

An environment hands over what it commands and gets what the actuators make of it; it hands over what is true
and gets what the sensors show; and it asks what the parameters are by now. Lags, delays, rate limits and play
belong to a row of the batch, begin anew with its episode, and are part of its snapshot. Before an episode's
first command there was the first for ever, and so it is with a sensor's first value.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.compiled import compiled, inlined
from fieldmodels.effects import actuators, changes, sensors
from fieldmodels.effects.curves import Curve, on_curve
from fieldmodels.effects.stock import Layout, Stock
from fieldmodels.model import ModelError

LAYOUTS: Mapping[str, Layout] = {
    "actuator": actuators.ROW,
    "sensor": sensors.ROW,
    "change": changes.ROW,
}
Rows = Sequence[int] | IntArray
TAKES_TIME = {
    "actuator": frozenset({"lag", "rate_limit", "delay"}),
    "sensor": frozenset({"lag", "delay"}),
}
"""Kinds that act from sample to sample."""


@dataclass(frozen=True)
class Channels:
    """Where stock effects can act on a task: its signals by their names in the task's model.

    Attributes:
        commands: Inputs that it commands, in the order of the columns that it hands over.
        observed: Outputs that it measures, likewise.
        without: Why it commands nothing, or why an input of the model is no command.
        prompt: Those of them on which only what takes no time can act, since they do not come sample by
            sample (a leg's waypoint, a heel strike), or their integrals and derivatives come with them.
    """

    commands: tuple[str, ...] = ()
    observed: tuple[str, ...] = ()
    without: str = ""
    prompt: tuple[str, ...] = ()

    def check(self, name: str, stock: Sequence[Stock]) -> None:
        """Make sure that stock effects can act here.

        Args:
            name: Of the task.
            stock: What is around its model.

        Raises:
            ModelError: If one acts on a signal that the task does not have, or takes time on one
                where nothing can that does.
        """
        for e in stock:
            place = place_of(e)
            known = {"actuator": self.commands, "sensor": self.observed}.get(place)
            if known is not None and e.signal not in known:
                why = f"; {self.without}" if self.without else ""
                raise ModelError(f"{name}: {e.name!r} cannot act here{why}. There are {self}")
            if e.signal in self.prompt and e.kind in TAKES_TIME.get(place, ()):
                raise ModelError(
                    f"{name}: {e.name!r} takes time; on {e.signal} only what takes no time can act here"
                )

    def __str__(self) -> str:
        """Say what there is."""
        told = [
            f"{title} {', '.join(dict.fromkeys(names))}"
            for title, names in (("the commands", self.commands), ("the sensors", self.observed))
            if names
        ]
        return "; ".join([*told, "and steps and drifts of the model's parameters"])


def place_of(e: Stock) -> str:
    """Where a stock effect acts: ``actuator``, ``sensor``, ``change``, ``force`` or ``parameter``."""
    return e.where if isinstance(e, Curve) else e.place


def rows_of(model: Any, place: str, signal: str, vectors: FloatArray) -> FloatArray:
    """Numbers of a signal's stock effects, in the order of the place's layout.

    Args:
        model: A model with ``stock`` around it.
        place: ``actuator``, ``sensor`` or ``change``.
        signal: The signal, or the parameter that changes.
        vectors: Parameter vectors, shape (batch, n).

    Returns:
        Shape (batch, numbers of the layout); neutral where there is no effect.
    """
    layout = LAYOUTS[place]
    rows = np.tile(layout.neutral, (len(vectors), 1))
    for e in model.stock:
        if e.place == place and e.signal == signal:
            rows[:, layout.slots(e.kind)] = vectors[:, model.slice_of(e.name)]
    return rows


def curves_of(model: Any, place: str, signal: str, vectors: FloatArray) -> FloatArray:
    """A signal's curve for parameter vectors, shape (batch, numbers of the curve); (batch, 0) without one."""
    for e in model.stock:
        if isinstance(e, Curve) and e.where == place and e.signal == signal:
            return np.ascontiguousarray(vectors[:, model.slice_of(e.name)])
    return np.zeros((len(vectors), 0))


class Signals(NamedTuple):
    """Stock effects of a batch's signals at one place, and what they remember.

    Attributes:
        rows: Their numbers, shape (batch, signals, numbers of the layout).
        curves: Curves, shape (batch, signals, longest).
        lengths: Numbers of each signal's curve, shape (signals,).
        on: Where any is on, shape (batch, signals).
        wraps: Which signals are measured within a turn, shape (signals,).
        counts: Samples since each row began, shape (batch, signals).
        held: What play transmitted; of a sensor, the true value before; shape (batch, signals).
        slow: What a lagging actuator gives, or what a lagging sensor shows, of that shape.
        late: The latest values that a delay needs, shape (batch, signals, slots).
    """

    rows: FloatArray
    curves: FloatArray
    lengths: IntArray
    on: NDArray[np.bool_]
    wraps: NDArray[np.bool_]
    counts: IntArray
    held: FloatArray
    slow: FloatArray
    late: FloatArray


MEMORY = ("counts", "held", "slow", "late")


def make_signals(
    model: Any, place: str, signals: Sequence[Any], vectors: FloatArray, longest: FloatArray, step: float
) -> Signals:
    """Signals of a batch, at rest.

    Args:
        model: A model with stock around it.
        place: ``actuator`` or ``sensor``.
        signals: The model's signals that act here.
        vectors: Parameter vectors, shape (batch, n).
        longest: Vectors that hold the longest delays that will ever be, shape (k, n).
        step: Sampling interval [s]; 0 where nothing takes time.
    """
    batch, count = len(vectors), len(signals)
    curves = [curves_of(model, place, s.name, vectors) for s in signals]
    column = LAYOUTS[place].column("delay_delay")
    delays = [rows_of(model, place, s.name, longest)[:, column].max() for s in signals]
    slots = math.ceil(max(delays, default=0.0) / step) + 2 if step > 0.0 else 2
    made = Signals(
        rows=np.zeros((batch, count, len(LAYOUTS[place]))),
        curves=np.zeros((batch, count, max((c.shape[1] for c in curves), default=0))),
        lengths=np.array([c.shape[1] for c in curves], dtype=np.int64),
        on=np.zeros((batch, count), dtype=np.bool_),
        wraps=np.array([s.name in model.wrapped_outputs for s in signals], dtype=np.bool_),
        counts=np.zeros((batch, count), dtype=np.int64),
        held=np.zeros((batch, count)),
        slow=np.zeros((batch, count)),
        late=np.zeros((batch, count, slots)),
    )
    fill(made, model, place, signals, list(range(batch)), vectors)
    return made


def fill(
    made: Signals, model: Any, place: str, signals: Sequence[Any], rows: Rows, vectors: FloatArray
) -> None:
    """Put other parameter vectors, shape (len(rows), n), into some rows."""
    for k, s in enumerate(signals):
        numbers, curve = rows_of(model, place, s.name, vectors), curves_of(model, place, s.name, vectors)
        made.rows[rows, k] = numbers
        made.curves[rows, k, : curve.shape[1]] = curve
        acting = (numbers != LAYOUTS[place].neutral).any(axis=1) | (curve[:, 2:] != 0.0).any(axis=1)
        made.on[rows, k] = acting


@inlined
def give(s: Signals, b: int, k: int, command: float, time: float, step: float) -> float:
    """Mean of what an actuator of row ``b`` gives over the step that begins, for its command.

    Args:
        s: The batch's actuators.
        b: The row.
        k: Which of its commands.
        command: The command.
        time: When the step begins [s].
        step: Its length [s]; 0 for a command that holds for as long as a leg takes.
    """
    if not s.on[b, k]:
        return command
    r, curve = actuators.unpack(s.rows[b, k]), s.curves[b, k, : s.lengths[k]]
    n = s.counts[b, k]
    if n == 0:
        s.held[b, k] = actuators.asked(command, r, curve)
    after = 1.0 if time >= r.parameter_step_time else 0.0
    if step > 0.0:
        after = min(max((time + step - r.parameter_step_time) / step, 0.0), 1.0)
    aim, s.held[b, k] = actuators.target(command, s.held[b, k], after, r, curve)
    if n == 0:
        s.slow[b, k] = aim
    mean, s.slow[b, k] = actuators.mean_over(s.slow[b, k], aim, step, r)
    return remembered(s, b, k, mean, r.delay_delay, step)


@inlined
def remembered(s: Signals, b: int, k: int, value: float, delay: float, step: float) -> float:
    """Keep a value, and give what there was a delay ago, linear between samples."""
    n, late = s.counts[b, k], s.late[b, k]
    if n == 0:
        late[:] = value
    late[n % len(late)] = value
    s.counts[b, k] = n + 1
    if delay == 0.0:
        return value
    shift = delay / step
    whole = math.floor(shift)
    newer, older = late[(n - whole) % len(late)], late[(n - whole - 1) % len(late)]
    return float(newer + (shift - whole) * (older - newer))


@inlined
def within_turn(angle: float) -> float:
    """An angle in [-pi, pi) [rad]."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


@inlined
def show(s: Signals, b: int, k: int, value: float, time: float, step: float) -> float:
    """What a sensor of row ``b`` shows of a true value, a sample after the last one.

    Args:
        s: The batch's sensors.
        b: The row.
        k: Which of its sensors.
        value: What is true; the first since the row began is what it has been for ever.
        time: On the episode's clock [s].
        step: Time since the sample before [s].
    """
    if not s.on[b, k]:
        return value
    r, n = sensors.unpack(s.rows[b, k]), s.counts[b, k]
    before = s.held[b, k]
    if s.wraps[k] and n > 0:
        value = before + within_turn(value - before)
    s.held[b, k] = value
    if s.lengths[k] > 0:
        curve = s.curves[b, k, : s.lengths[k]]
        value += on_curve(within_turn(value) if s.wraps[k] else value, curve)
        before += on_curve(within_turn(before) if s.wraps[k] else before, curve)
    if n > 0 and r.lag_time_constant > 0.0:
        s.slow[b, k] = sensors.filtered(s.slow[b, k], before, value, step, r.lag_time_constant)
    else:
        s.slow[b, k] = value
    late = remembered(s, b, k, s.slow[b, k], r.delay_delay, step)
    if s.wraps[k]:
        return within_turn(sensors.measured(within_turn(late), time, 0.0, r))
    return sensors.measured(late, time, 0.0, r)


@inlined
def slope_shown(s: Signals, b: int, k: int, value: float) -> float:
    """How what a sensor without delay shows grows with the true value; quantisation apart."""
    if not s.on[b, k]:
        return 1.0
    r = sensors.unpack(s.rows[b, k])
    steep = 1.0
    if s.lengths[k] > 0:
        curve = s.curves[b, k, : s.lengths[k]]
        near = 1e-6 * (curve[1] - curve[0])
        steep += (on_curve(value + near, curve) - on_curve(value - near, curve)) / (2.0 * near)
        value += on_curve(value, curve)
    if abs(sensors.measured(value, 0.0, 0.0, r)) >= r.clipping_limit:
        return 0.0
    return float(steep * sensors.slope(value, r))


@compiled
def give_all(s: Signals, commands: FloatArray, times: FloatArray, step: float, out: FloatArray) -> None:
    """What every row's actuators give for its commands, shape (batch, commands)."""
    for b in range(len(commands)):
        for k in range(commands.shape[1]):
            out[b, k] = give(s, b, k, commands[b, k], times[b], step)


@compiled
def show_all(
    s: Signals, rows: IntArray, values: FloatArray, times: FloatArray, step: float, out: FloatArray
) -> None:
    """What the sensors of some rows show of true values, shape (len(rows), sensors); NaN: none is sensed."""
    for i in range(len(rows)):
        for k in range(values.shape[1]):
            out[i, k] = values[i, k]
            if not math.isnan(values[i, k]):
                out[i, k] = show(s, rows[i], k, values[i, k], times[rows[i]], step)


@compiled
def change_all(
    rows: FloatArray, places: IntArray, times: FloatArray, h: float, bounds: FloatArray, vectors: FloatArray
) -> None:
    """Change parameters to their mean over a time ``h`` [s] from now on, in place, within their bounds."""
    for b in range(len(vectors)):
        for i in range(len(places)):
            r, k = changes.unpack(rows[b, i]), places[i]
            if h > 0.0:
                value = changes.changed(vectors[b, k], times[b], h, r)
            else:
                jumped = r.step_change if times[b] >= r.step_time else 0.0
                value = vectors[b, k] + jumped + r.drift_rate * times[b]
            vectors[b, k] = min(max(value, bounds[i, 0]), bounds[i, 1])


class Stepped:
    """Stock effects around a batch of machines that go a step at a time.

    Attributes:
        model: The model with the stock effects around it.
        channels: Which of its signals the task commands and measures.
        own: How many numbers of a parameter vector are the model's own.
        step: Sampling interval [s]; 0 where nothing takes time.
        clock: Time since each row's episode began [s], shape (batch,).
        current: The model's own vectors as they are by now, shape (batch, own).
        actuators: Those of the commands.
        sensors: Those of the measured outputs.
        kept: What the machines remember beside them, for snapshots.
    """

    def __init__(
        self, model: Any, channels: Channels, vectors: FloatArray, longest: FloatArray, step: float
    ) -> None:
        """Put stock effects around a batch.

        Args:
            model: A model with ``stock`` around it.
            channels: Which of its signals the task commands and measures.
            vectors: Parameter vectors, shape (batch, n).
            longest: Vectors as extreme as ``set_parameters`` will give, shape (k, n).
            step: Sampling interval [s]; 0 where nothing takes time.
        """
        self.model, self.channels = model, channels
        self.step = float(step)
        self.own = len(model.inner.names)
        inputs, outputs = ({s.name: s for s in part} for part in (model.inputs, model.outputs))
        self._commands = [inputs[name] for name in channels.commands]
        self._observed = [outputs[name] for name in channels.observed]
        self._moving = [
            k for k, p in enumerate(model.parameters) if any(_changes(e, p.name) for e in model.stock)
        ]
        moving = [model.parameters[k] for k in self._moving]
        self._bounds = np.array([[p.lower, p.upper] for p in moving]).reshape(-1, 2)
        self._vectors = np.array(vectors, dtype=np.float64)
        ends = np.concatenate([self._vectors, longest])
        self.actuators = make_signals(model, "actuator", self._commands, self._vectors, ends, self.step)
        self.sensors = make_signals(model, "sensor", self._observed, self._vectors, ends, self.step)
        self.current = self._vectors[:, : self.own].copy()
        self.kept: dict[str, NDArray[Any]] = {}
        self._ticks = np.zeros(len(vectors), dtype=np.int64)
        self.clock: FloatArray = np.zeros(len(vectors))

    @property
    def acts(self) -> bool:
        """Whether any actuator's effect is around."""
        return any(place_of(e) == "actuator" for e in self.model.stock)

    @property
    def senses(self) -> bool:
        """Whether any sensor's effect is around."""
        return any(place_of(e) == "sensor" for e in self.model.stock)

    @property
    def moves(self) -> bool:
        """Whether a parameter changes over time."""
        return bool(self._moving)

    def set_parameters(self, rows: Rows, vectors: FloatArray) -> None:
        """Give some rows, before their next episode, other parameter vectors, shape (len(rows), n)."""
        self._vectors[rows] = vectors
        self.current[rows] = vectors[:, : self.own]
        fill(self.actuators, self.model, "actuator", self._commands, rows, vectors)
        fill(self.sensors, self.model, "sensor", self._observed, rows, vectors)

    def unchanged(self, rows: Rows) -> FloatArray:
        """The own vectors of some rows before time acts on them, shape (len(rows), own)."""
        return self._vectors[rows][:, : self.own]

    def begin(self, rows: Rows) -> None:
        """Let the episodes of some rows begin: nothing has happened yet."""
        self._ticks[rows] = 0
        self.clock[rows] = 0.0
        for part in (self.actuators, self.sensors):
            part.counts[rows] = 0

    def tick(self) -> None:
        """Let every row's clock go on by a step."""
        self._ticks += 1
        self.clock[:] = self._ticks * self.step

    def given(self, commands: FloatArray) -> FloatArray:
        """Mean of what the actuators give over the step that begins, shape (batch, commands)."""
        out: FloatArray = np.empty(commands.shape)
        give_all(self.actuators, np.ascontiguousarray(commands), self.clock, self.step, out)
        return out

    def shown(self, values: FloatArray, rows: Rows | None = None) -> FloatArray:
        """What the sensors show of true values, a sample after the last one.

        Args:
            values: Shape (batch, sensors), or (len(rows), sensors).
            rows: The rows whose sensors sense; all if None.
        """
        which = np.arange(len(self.clock)) if rows is None else np.asarray(rows, dtype=np.int64)
        out: FloatArray = np.empty(values.shape)
        show_all(self.sensors, which, np.ascontiguousarray(values), self.clock, self.step, out)
        return out

    def change(self, rows: Rows, duration: float) -> FloatArray:
        """Let time act on the parameters of some rows: ``current`` is their mean over the time that comes.

        Args:
            rows: Which.
            duration: How long they hold [s]; 0 for what they are by now.

        Returns:
            Their own vectors, shape (len(rows), own).
        """
        vectors = self._vectors[rows]
        own = vectors[:, : self.own].copy()
        if self._moving:
            names = [self.model.parameters[k].name for k in self._moving]
            numbers = np.stack([rows_of(self.model, "change", name, vectors) for name in names], axis=1)
            places = np.array(self._moving, dtype=np.int64)
            change_all(numbers, places, self.clock[rows], duration, self._bounds, own)
        self.current[rows] = own
        return own

    def _parts(self) -> Iterator[tuple[str, NDArray[Any]]]:
        yield "stock_ticks", self._ticks
        yield "stock_clock", self.clock
        yield "stock_parameters", self.current
        for title, part in (("actuators", self.actuators), ("sensors", self.sensors)):
            for name in MEMORY:
                yield f"stock_{title}_{name}", getattr(part, name)
        for name, array in self.kept.items():
            yield f"stock_{name}", array

    def state(self) -> dict[str, Any]:
        """Everything that the next steps depend on, as copies."""
        return {name: part.copy() for name, part in self._parts()}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Return to what ``state`` gave.

        Raises:
            ValueError: If it is of another batch or of effects with other delays.
        """
        for name, part in self._parts():
            if np.shape(state[name]) != part.shape:
                raise ValueError(f"{name}: a snapshot of other effects, or of another number of rows")
            part[...] = state[name]


def _changes(e: Stock, parameter: str) -> bool:
    return e.place == "change" and e.signal == parameter
