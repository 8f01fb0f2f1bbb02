"""Stock effects around a model that simulates by itself: what can be put there from outside.

    heel = with_effects(get_model("heel_strike"), sensor("gyro", ("bend", "clipping")))

A `Machine` takes stock effects by declaring them, and integrates them exactly. Any other `Model` has its
simulation in its own hands; around it a command can be changed before it arrives, and a measured value
after it has left:

- every effect of an actuator, on the samples of the command (a lag, a rate limit and a delay by their mean
  over each sampling interval, since a model takes one value for it);
- effects of a sensor on the present value: gain, bias, drift, bend, eccentricity, clipping, quantisation;
- a curve of a command, or of a measured value;
- a step or a drift of a base parameter, by its mean over each window;
- of the forces a constant and a periodic one, where the model takes a disturbance.

``drivers.named`` puts around a model what a reality names.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.drivers.sizes import measured_sizes
from fieldmodels.drivers.stepped import (
    LAYOUTS,
    TAKES_TIME,
    curves_of,
    place_of,
    rows_of,
)
from fieldmodels.effects import actuators, changes, sensors
from fieldmodels.effects.curves import Curve, on_curve
from fieldmodels.effects.stock import Names, Sizes, Stock
from fieldmodels.model import Model, ModelError, Wrapper
from fieldmodels.names import did_you_mean
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


def with_effects(model: Model, *stock: Stock | Sequence[Stock]) -> Model:
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


class Surrounded(Wrapper):
    """A model with stock effects around it; see `with_effects`.

    Attributes:
        stock: What is around it.
        kinds: Kinds of stock effects that it simulates, by their place.
    """

    kinds: ClassVar[Mapping[str, frozenset[str]]] = KINDS

    def __init__(self, inner: Model, stock: Sequence[Stock], sizes: Sequence[Sizes] | None = None) -> None:
        super().__init__(inner)
        self.stock = tuple(stock)
        self.sizes = tuple(sizes or [Sizes()] * len(self.stock))
        self.forces: tuple[()] = ()
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
        if self.corrected:  # an observer compares with what is true
            for name in (self.outputs[j].name for j in bent):
                shown_ones = given.recording[name]
                true = self._true(shown_ones, given.recording.time, name, vector)
                signals = {**given.recording.signals, name: true}
                given = replace(given, recording=replace(given.recording, signals=signals))
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
        return bool((np.array(row) != LAYOUTS[place].neutral).any() or curve_row[3:].any())

    def _true(self, values: FloatArray, times: FloatArray, signal: str, vector: FloatArray) -> FloatArray:
        """The true values behind those that a sensor shows, shape (n,)."""
        row, curve_row = self._numbers("sensor", signal, vector)
        turns = np.zeros_like(values)
        if signal in self.wrapped_outputs:
            turns = 2.0 * np.pi * np.floor((values + np.pi) / (2.0 * np.pi))
        values = values - turns
        true = np.array([sensors.inverted(v, t, 0.0, row) for v, t in zip(values, times, strict=True)])
        if curve_row[3:].any():
            bent = true.copy()
            for _ in range(INVERSIONS):
                true = bent - np.array([on_curve(x, curve_row) for x in true])
        return np.asarray(true + turns)

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
        changed = {}
        for signal in self.inputs:
            if signal.name in recording and self._is_on("actuator", signal.name, vector):
                row, curve_row = self._numbers("actuator", signal.name, vector)
                command = np.ascontiguousarray(recording[signal.name], dtype=np.float64)
                changed[signal.name] = actuators.mean_given(
                    command, windows.pieces, recording.step, row, curve_row
                )
        if not changed:
            return windows
        return replace(windows, recording=self.inner.with_commands(recording, changed))

    def _disturbed(self, windows: Windows, vector: FloatArray) -> Windows:
        """The windows with the constant and the periodic force from outside."""
        forces = [e for e in self.stock if e.place == "force"]
        if not forces:
            return windows
        time = windows.recording.step * np.arange(len(windows.recording))
        every = windows.pushed(len(self.pushes[0].weights)) if windows.disturbance is not None else None
        total = np.zeros(len(time)) if every is None else every[:, 0]
        for e in forces:
            values = vector[self.slice_of(e.name)]
            if e.kind == "constant_force":
                total += values[0]
            else:
                phase = 2.0 * np.pi * values[2] * time
                total += values[0] * np.sin(phase) + values[1] * np.cos(phase)
        return windows.with_disturbance(total if every is None else every)

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
