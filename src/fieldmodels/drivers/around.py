"""Stock effects around a model that simulates by itself: what can be put there from outside.

    heel = surrounded(get_model("heel_strike"), sensor("gyro", ("bend", "clipping")))

A `Machine` takes stock effects by declaring them, and integrates them exactly. Any other `Model` has its
simulation in its own hands; around it a command can be changed before it arrives, and a measured value
after it has left:

- every effect of an actuator, on the samples of the command (a lag, a rate limit and a delay by their mean
  over each sampling interval, since a model takes one value for it);
- effects of a sensor on the present value: gain, bias, drift, bend, eccentricity, clipping, quantisation;
- a step or a drift of a base parameter, by its mean over each window;
- of the forces a constant and a periodic one, where the model takes a disturbance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.drivers.sizes import measured_sizes
from fieldmodels.drivers.windows import episode_edges
from fieldmodels.effects import actuators, changes, sensors
from fieldmodels.effects.curves import Curve
from fieldmodels.effects.stock import Layout, Names, Sizes, Stock
from fieldmodels.model import Model, ModelError, Stage
from fieldmodels.names import did_you_mean
from fieldmodels.recording import Recording, Windows

KINDS = {
    "actuator": frozenset(actuators.LIBRARY),
    "sensor": frozenset(sensors.LIBRARY) - {"lag", "delay", "backlash"},
    "change": frozenset(changes.LIBRARY),
    "force": frozenset({"constant_force", "periodic_force"}),
}
"""Kinds of stock effects that need no look inside."""
DISTURBANCE = "disturbance"
"""The signal of a force from outside."""


def surrounded(model: Model, *stock: Stock | Sequence[Stock]) -> Model:
    """Put stock effects around a model.

    Args:
        model: Any model.
        stock: Stock effects: ``actuator("voltage")``, ``sensor("speed", ("gain",))``, ``change("length")``;
            ``force("disturbance", ("constant_force",))`` if the model takes a disturbance.

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
    """

    def __init__(self, inner: Model, stock: Sequence[Stock], sizes: Sequence[Sizes] | None = None) -> None:
        self.inner, self.stock = inner, tuple(stock)
        self.sizes = tuple(sizes or [Sizes()] * len(self.stock))
        self.forces: tuple[()] = ()
        for name in (
            "name", "inputs", "outputs", "states", "parameters", "horizons", "disturbance_unit",
            "random_force", "inputs_are_free", "unbounded_outputs", "measured_inputs",
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
            known = self._signals.get(e.place, [])
            if isinstance(e, Curve) or e.kind not in KINDS.get(e.place, ()):
                raise ModelError(f"{where}: needs a look inside; declare the model as a Machine for it")
            if e.signal not in known:
                raise ModelError(f"{where}: no {e.place} signal {e.signal!r}{did_you_mean(e.signal, known)}")
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
        return Surrounded(inner, self.stock, measured_sizes(machine, recordings))

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
        sensed = {j: r for j, s in enumerate(self.outputs) if (r := self._row("sensor", s.name, vector))}
        states = given.states.copy()
        clock = windows.starts * windows.recording.step
        for j, r in sensed.items():
            for i, state in enumerate(self.states):
                if state.name == self.outputs[j].name:
                    states[:, i] = [
                        sensors.inverted(v, t, 0.0, r) for v, t in zip(states[:, i], clock, strict=True)
                    ]
        out = self._changed(own, vector, given.with_states(states))
        times = clock[:, None] + np.arange(windows.samples) * windows.recording.step
        for j, r in sensed.items():
            out[..., j] = sensors.measure(np.ascontiguousarray(out[..., j]), times, r)
        return out

    def _row(self, place: str, signal: str, vector: FloatArray) -> Any:
        """A signal's stock effects as a named tuple; None if all are off."""
        layout: Layout = {"actuator": actuators, "sensor": sensors, "change": changes}[place].ROW
        values = layout.neutral.copy()
        for e in self.stock:
            if e.place == place and e.signal == signal:
                values[layout.slots(e.kind)] = vector[self.slice_of(e.name)]
        return None if np.array_equal(values, layout.neutral) else layout.kind(*values)

    def _commanded(self, windows: Windows, vector: FloatArray) -> Windows:
        """The windows of a recording whose commands have passed the actuators."""
        recording = windows.recording
        first, _ = episode_edges(recording)
        changed = {}
        for signal in self.inputs:
            r = self._row("actuator", signal.name, vector)
            if r is not None and signal.name in recording:
                command = np.ascontiguousarray(recording[signal.name], dtype=np.float64)
                changed[signal.name] = actuators.mean_given(command, first, recording.step, r)
        if not changed:
            return windows
        return replace(windows, recording=replace(recording, signals={**recording.signals, **changed}))

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
            i: r
            for i, p in enumerate(self.parameters)
            if (r := self._row("change", p.name, vector)) is not None
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
