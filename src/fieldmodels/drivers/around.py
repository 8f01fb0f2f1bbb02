"""Stock effects around a model that simulates by itself: what can be put there from outside.

    heel = surrounded(get_model("heel_strike"), sensor("gyro", ("bend", "clipping")))

A `Machine` takes stock effects by declaring them, and integrates them exactly. Any other `Model` has its
simulation in its own hands; around it a command can be changed before it arrives, and a measured value
after it has left:

- every effect of an actuator, on the samples of the command (a lag, a rate limit and a delay by their mean
  over each sampling interval, since a model takes one value for it);
- effects of a sensor on the present value: gain, bias, drift, bend, eccentricity, clipping, quantisation;
- a curve of a command, or of a measured value;
- a step or a drift of a base parameter, by its mean over each window;
- of the forces a constant and a periodic one, where the model takes a disturbance.

A reality names them by their signal, ``steering_gain``, ``gyro_bend``, ``length_step``, ``steering_curve``,
and `flown` puts around a model what a reality names. Episodes that are simulated from their beginning may
also have sensors that are slow or late.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.drivers.declaration import Declaration
from fieldmodels.drivers.sizes import measured_sizes
from fieldmodels.drivers.stepped import (
    LAYOUTS,
    TAKES_TIME,
    Channels,
    Stepped,
    curves_of,
    make_signals,
    place_of,
    rows_of,
    show_all,
)
from fieldmodels.drivers.windows import episode_edges
from fieldmodels.effects import actuators, changes, sensors
from fieldmodels.effects.curves import Curve, curve, on_curve
from fieldmodels.effects.stock import Names, Sizes, Stock
from fieldmodels.model import Model, ModelError, Stage
from fieldmodels.names import did_you_mean
from fieldmodels.reality import Reality, parse_reality, read_reality
from fieldmodels.recording import Recording, Windows

KINDS = {
    "actuator": frozenset(actuators.LIBRARY),
    "sensor": frozenset(sensors.LIBRARY) - TAKES_TIME["sensor"] - {"backlash"},
    "change": frozenset(changes.LIBRARY),
    "force": frozenset({"constant_force", "periodic_force"}),
}
"""Kinds of stock effects that need no look inside."""
DISTURBANCE = "disturbance"
"""The signal of a force from outside."""
INVERSIONS = 20
"""Fixed-point steps by which a sensor's curve is inverted."""


def surrounded(model: Model, *stock: Stock | Sequence[Stock]) -> Model:
    """Put stock effects around a model.

    Args:
        model: Any model.
        stock: Stock effects: ``actuator("voltage")``, ``sensor("speed", ("gain",))``, ``change("length")``,
            ``curve("actuator", "voltage")``; ``force("disturbance", ("constant_force",))`` if the model takes
            a disturbance.

    Raises:
        ModelError: For a signal or parameter that the model does not have, a name that it has already, or a
            kind that cannot be put around it.
    """
    flat = [e for group in stock for e in ([group] if isinstance(group, Stock) else group)]
    return Surrounded(model, flat)


class Surrounded(Model):
    """A model with stock effects around it; see `surrounded`.

    Attributes:
        inner: The model.
        stock: What is around it.
        kinds: Kinds of stock effects that it simulates, by their place.
    """

    kinds: ClassVar[Mapping[str, frozenset[str]]] = KINDS

    def __init__(self, inner: Model, stock: Sequence[Stock], sizes: Sequence[Sizes] | None = None) -> None:
        self.inner, self.stock = inner, tuple(stock)
        self.sizes = tuple(sizes or [Sizes()] * len(self.stock))
        self.forces: tuple[()] = ()
        for name in (
            "name", "inputs", "outputs", "states", "parameters", "horizons", "disturbance_unit",
            "random_force", "inputs_are_free", "unbounded_outputs", "wrapped_outputs", "measured_states",
            "measured_inputs",
        ):  # fmt: skip
            setattr(self, name, getattr(inner, name))
        self._signals = {
            "actuator": [s.name for s in inner.inputs],
            "sensor": [s.name for s in inner.outputs],
            "change": [p.name for p in inner.parameters],
            "force": [DISTURBANCE] if inner.disturbance_unit else [],
        }
        self._check()
        own = [
            replace(e.declare(self._names(e), s), name=e.name)
            for e, s in zip(self.stock, self.sizes, strict=True)
        ]
        self.effects = (*inner.effects, *own)

    def _check(self) -> None:
        """Whether the model has all that is named."""
        taken = [e.name for e in self.inner.effects]
        for e in self.stock:
            where = f"around model {self.name!r}: {e.name!r}"
            place = place_of(e)
            known = self._signals.get(place, [])
            if isinstance(e, Curve):
                inside = place not in ("actuator", "sensor") or e.over != (e.signal,)
            else:
                inside = e.kind not in self.kinds.get(place, ())
            if inside:
                raise ModelError(f"{where}: needs a look inside; declare the model as a Machine for it")
            if e.signal not in known:
                raise ModelError(f"{where}: no {place} signal {e.signal!r}{did_you_mean(e.signal, known)}")
            if e.name in taken:
                raise ModelError(f"{where}: there is an effect of this name already; give one a prefix=")
            taken.append(e.name)

    def _names(self, e: Stock) -> Names:
        if e.place == "force":
            return Names(e.signal, self.disturbance_unit)
        if e.place == "change":
            return Names(e.signal, next(p.unit for p in self.parameters if p.name == e.signal))
        unit = next(s.unit for s in (*self.inputs, *self.outputs) if s.name == e.signal)
        return Names(e.signal, unit, e.signal, unit, f"{unit}/s")

    def scaled_to(self, recordings: Sequence[Recording]) -> Surrounded:
        """The model with scales that suit these data, and the stock effects, too."""
        inner = self.inner.scaled_to(recordings)
        machine: Any = self  # has all that sizes are measured of
        return type(self)(inner, self.stock, measured_sizes(machine, recordings))

    def windows(self, recording: Recording, horizon: float) -> Windows:
        """The model's own windows."""
        return self.inner.windows(recording, horizon)

    def between(self, commands: FloatArray, refine: int) -> FloatArray:
        """The model's own; see ``Model.between``."""
        return self.inner.between(commands, refine)

    def stages(self, recordings: Sequence[Recording]) -> tuple[Stage, ...]:
        """The whole: what is around acts on all of it."""
        return super().stages(recordings)

    def initial_states(self, recording: Recording, starts: IntArray) -> FloatArray:
        """The model's own, as the sensors measure them."""
        return self.inner.initial_states(recording, starts)

    def simulate(self, parameters: FloatArray, windows: Windows) -> FloatArray:
        """Simulate every window; see ``Model.simulate``."""
        vectors = np.atleast_2d(np.asarray(parameters, dtype=np.float64))
        own, around = vectors[:, : len(self.inner.names)], vectors[:, len(self.inner.names) :]
        _, first, which = np.unique(around, axis=0, return_index=True, return_inverse=True)
        out = np.empty((len(vectors), len(windows), windows.samples, len(self.outputs)))
        for k, one in enumerate(first):
            rows = which.ravel() == k
            out[rows] = self._simulate(own[rows], vectors[one], windows)
        return out

    def _simulate(self, own: FloatArray, vector: FloatArray, windows: Windows) -> FloatArray:
        """Vectors of the model, between one set of stock effects."""
        given = self._disturbed(self._commanded(windows, vector), vector)
        bent = [j for j, s in enumerate(self.outputs) if self._is_on("sensor", s.name, vector)]
        measured = dict(self.inner.measured_states)
        states = given.states.copy()
        clock = np.asarray(windows.starts * windows.recording.step, dtype=np.float64)
        for j in bent:
            name = self.outputs[j].name
            for i, state in enumerate(self.states):
                if measured.get(state.name, state.name) == name:
                    states[:, i] = self._true(np.asarray(states[:, i]), clock, name, vector)
        out = self._changed(own, vector, given.with_states(states))
        if not bent:
            return out
        shown = out.copy()
        for j in bent:
            shown[..., j] = self._shown(np.ascontiguousarray(out[..., j]), j, windows, vector)
        return self.inner.derived(out, shown, windows)

    def _numbers(self, place: str, signal: str, vector: FloatArray) -> tuple[Any, FloatArray]:
        """A signal's stock effects as a named tuple, and the row of its curve, empty if there is none."""
        row = LAYOUTS[place].kind(*rows_of(self, place, signal, vector[None])[0])
        return row, curves_of(self, place, signal, vector[None])[0]

    def _is_on(self, place: str, signal: str, vector: FloatArray) -> bool:
        """Whether any stock effect of a signal, or its curve, is on."""
        row, curve_row = self._numbers(place, signal, vector)
        return bool((np.array(row) != LAYOUTS[place].neutral).any() or curve_row[2:].any())

    def _true(self, values: FloatArray, times: FloatArray, signal: str, vector: FloatArray) -> FloatArray:
        """The true values behind those that a sensor shows, shape (n,)."""
        row, curve_row = self._numbers("sensor", signal, vector)
        if signal in self.wrapped_outputs:
            values = (values + np.pi) % (2.0 * np.pi) - np.pi
        true = np.array([sensors.inverted(v, t, 0.0, row) for v, t in zip(values, times, strict=True)])
        if curve_row[2:].any():
            bent = true.copy()
            for _ in range(INVERSIONS):
                true = bent - np.array([on_curve(x, curve_row) for x in true])
        return true

    def _shown(self, values: FloatArray, j: int, windows: Windows, vector: FloatArray) -> FloatArray:
        """What the sensor of output ``j`` shows of true values, shape (batch, windows, samples)."""
        row, curve_row = self._numbers("sensor", self.outputs[j].name, vector)
        begin = windows.starts * windows.recording.step
        times = begin[:, None] + np.arange(windows.samples) * windows.recording.step
        if self.outputs[j].name not in self.wrapped_outputs:
            return sensors.measure(values, times, row, curve_row)
        within = (values + np.pi) % (2.0 * np.pi) - np.pi
        return np.asarray(values + sensors.measure(within, times, row, curve_row) - within)

    def _commanded(self, windows: Windows, vector: FloatArray) -> Windows:
        """The windows of a recording whose commands have passed the actuators."""
        recording = windows.recording
        first, _ = episode_edges(recording)
        changed = {}
        for signal in self.inputs:
            if signal.name in recording and self._is_on("actuator", signal.name, vector):
                row, curve_row = self._numbers("actuator", signal.name, vector)
                command = np.ascontiguousarray(recording[signal.name], dtype=np.float64)
                changed[signal.name] = actuators.mean_given(command, first, recording.step, row, curve_row)
        if not changed:
            return windows
        return replace(windows, recording=self.inner.with_commands(recording, changed))

    def _disturbed(self, windows: Windows, vector: FloatArray) -> Windows:
        """The windows with the constant and the periodic force from outside."""
        forces = [e for e in self.stock if e.place == "force"]
        if not forces:
            return windows
        time = windows.recording.step * np.arange(len(windows.recording))
        total = np.zeros(len(time)) if windows.disturbance is None else windows.disturbance.copy()
        for e in forces:
            values = vector[self.slice_of(e.name)]
            if e.kind == "constant_force":
                total += values[0]
            else:
                phase = 2.0 * np.pi * values[2] * time
                total += values[0] * np.sin(phase) + values[1] * np.cos(phase)
        return windows.with_disturbance(total)

    def _changed(self, own: FloatArray, vector: FloatArray, windows: Windows) -> FloatArray:
        """The model's simulation, window by window where a parameter changes."""
        moving = {
            i: self._numbers("change", p.name, vector)[0]
            for i, p in enumerate(self.parameters)
            if self._is_on("change", p.name, vector)
        }
        if not moving:
            return self.inner.simulate(own, windows)
        parts = []
        for w in range(len(windows)):
            now = own.copy()
            begin = float(windows.starts[w]) * windows.recording.step
            length = float(windows.lengths[w]) * windows.recording.step
            for i, r in moving.items():
                now[:, i] = [changes.changed(value, begin, length, r) for value in own[:, i]]
            parts.append(self.inner.simulate(now, windows.select(np.array([w]))))
        return np.concatenate(parts, axis=1)


class Flown(Surrounded):
    """Stock effects around a model as environments and recorders run it: episodes from their beginning.

    Beside what `Surrounded` simulates, sensors may be slow or late: their past is known where an episode
    begins.
    """

    kinds: ClassVar[Mapping[str, frozenset[str]]] = {
        **KINDS,
        "sensor": KINDS["sensor"] | TAKES_TIME["sensor"],
    }

    def _shown(self, values: FloatArray, j: int, windows: Windows, vector: FloatArray) -> FloatArray:
        """See ``Surrounded``; a slow or late sensor needs the whole episode."""
        row, _ = self._numbers("sensor", self.outputs[j].name, vector)
        if row.lag_time_constant == 0.0 and row.delay_delay == 0.0:
            return super()._shown(values, j, windows, vector)
        if not np.isin(windows.starts, windows.recording.bounds[:, 0]).all():
            raise ModelError(
                f"model {self.name!r}: a slow or late sensor is simulated from an episode's beginning only"
            )
        step = windows.recording.step
        batch, count, samples = values.shape
        vectors = np.tile(vector, (batch * count, 1))
        sensor_of = make_signals(self, "sensor", [self.outputs[j]], vectors, vector[None], step)
        true = np.ascontiguousarray(values.reshape(batch * count, samples, 1))
        shown = np.empty_like(true)
        rows, begin = np.arange(batch * count), np.tile(windows.starts * step, batch)
        for k in range(samples):
            out = np.empty((batch * count, 1))
            show_all(sensor_of, rows, np.ascontiguousarray(true[:, k]), begin + k * step, step, out)
            shown[:, k] = out
        if self.outputs[j].name in self.wrapped_outputs:  # go on where the true one does
            shown = true + (shown - true + np.pi) % (2.0 * np.pi) - np.pi
        return shown.reshape(values.shape)


@lru_cache(maxsize=64)
def _stock_of(
    inputs: tuple[str, ...], outputs: tuple[str, ...], parameters: tuple[str, ...]
) -> dict[str, Stock]:
    """Stock effects by the names that their signals give them."""
    found: dict[str, Stock] = {}
    groups = [actuators.actuator(name, prefix=f"{name}_") for name in inputs]
    groups += [sensors.sensor(name, prefix=f"{name}_") for name in outputs]
    groups += [changes.change(name) for name in parameters]
    groups += [curve("actuator", name) for name in inputs]
    groups += [curve("sensor", name) for name in outputs]
    for group in groups:
        for e in group:
            found.setdefault(e.name, e)
    return found


def stock_of(model: Model) -> dict[str, Stock]:
    """Every stock effect that can be flown around a model, by name.

    An effect is named by its signal: ``steering_gain``, ``gyro_bend``, ``length_step``, ``steering_curve``.
    One whose name the model itself has is the model's own.

    Args:
        model: Any model.
    """
    found = _stock_of(
        tuple(s.name for s in model.inputs),
        tuple(s.name for s in model.outputs if not s.event),
        tuple(p.name for p in model.parameters),
    )
    own = {e.name for e in model.effects}
    return {name: e for name, e in found.items() if name not in own}


def with_named(model: Model, effects: Mapping[str, Any]) -> Model:
    """A model with those stock effects around it that a reality names; itself if it names none.

    Args:
        model: A model; a ``Machine`` declares its stock effects itself.
        effects: The reality's values by effect. A curve has as many knots as it has values.

    Raises:
        ModelError: For a name that neither the model nor its stock effects have.
    """
    own = {e.name for e in model.effects}
    names = [name for name in effects if name not in own]
    if not names or isinstance(model, Declaration):
        return model
    known = stock_of(model)
    chosen: list[Stock] = []
    for name in names:
        if name not in known:
            raise ModelError(
                f"model {model.name!r} has no effect {name!r}{did_you_mean(name, [*own, *known])}"
            )
        e = known[name]
        if isinstance(e, Curve):
            values = effects[name] if isinstance(effects[name], Mapping) else {}
            knots = max((int(n[6:]) for n in values if n[:6] == "value_" and n[6:].isdecimal()), default=2)
            chosen += curve(e.where, e.signal, knots=max(knots, 2))
        else:
            chosen.append(e)
    return Flown(model, chosen)


def flown(
    model: Model, source: Reality | Mapping[str, Any] | str | Path | None, where: Channels | None = None
) -> tuple[Model, Reality]:
    """Read a reality that may name stock effects, and put these around the model.

    Args:
        model: The model whose names and bounds hold.
        source: See ``read_reality``.
        where: Which signals a task commands and measures; None for all.

    Returns:
        The model, with stock effects around it if the reality names some, and the reality.

    Raises:
        ModelError: As ``read_reality``; also for a stock effect of a signal that the task does not have.
    """
    reality = parse_reality(source, model)
    around = with_named(model, reality.effects)
    if where is not None and isinstance(around, Surrounded):
        where.check(model.name, around.stock)
    return around, read_reality(reality, around)


def stepped(around: Model, reality: Reality, where: Channels, batch: int, step: float) -> Stepped | None:
    """What steps the stock effects around a batch of machines; None if there are none.

    Args:
        around: A model as ``flown`` gives it.
        reality: Its reality; samplers stand at their typical values until ``set_parameters`` says what they
            have drawn.
        where: Which signals the task commands and measures.
        batch: Number of machines.
        step: Sampling interval [s].
    """
    if not isinstance(around, Surrounded):
        return None
    vectors = np.tile(reality.typical(around), (batch, 1))
    return Stepped(around, where, vectors, reality.extremes(around), step)
