"""Stock effects by name: what a reality names is put around the model that it is about.

An effect is named by its signal: ``steering_gain``, ``gyro_bend``, ``length_step``, ``steering_curve``.
"""

from __future__ import annotations

import warnings
from collections.abc import Collection, Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.contract import ModelWarning
from fieldmodels.drivers.around import KINDS, Surrounded
from fieldmodels.drivers.declaration import Declaration
from fieldmodels.drivers.followed import Followed, followed, plain
from fieldmodels.drivers.stepped import TAKES_TIME, Channels, Stepped, make_signals, show_all
from fieldmodels.effects import actuators, changes, sensors
from fieldmodels.effects.curves import SIZE, Curve, curve
from fieldmodels.effects.stock import Stock
from fieldmodels.model import Model, ModelError
from fieldmodels.model_files import is_model_file
from fieldmodels.names import did_you_mean, machine_in
from fieldmodels.reality import Reality, parse_reality, read_reality
from fieldmodels.recording import Windows
from fieldmodels.registry import get_model, model_names
from fieldmodels.yaml import load_yaml


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
    if not names:
        return model
    if isinstance(model, Declaration):
        machine = with_curves(model, {name: effects[name] for name in names})
        own = {e.name for e in machine.effects}
        curves = followed(machine, {name: effects[name] for name in names if name not in own})
        return Followed(machine, curves) if curves else machine
    curves = followed(model, {name: effects[name] for name in names})
    if curves:
        return Followed(with_named(model, {n: v for n, v in effects.items() if n not in curves}), curves)
    known = stock_of(model)
    chosen: list[Stock] = []
    for name in names:
        if name not in known:
            raise ModelError(
                f"model {model.name!r} has no effect {name!r}{did_you_mean(name, [*own, *known])}"
            )
        e = known[name]
        if isinstance(e, Curve):
            chosen += curve(e.where, e.signal, knots=_knots(effects[name]))
        else:
            chosen.append(e)
    return Flown(model, chosen)


def _knots(values: Any) -> int:
    """Number of knots of a curve's values in a reality."""
    names = values if isinstance(values, Mapping) else {}
    return max([2, *(int(n[6:]) for n in names if n[:6] == "value_" and n[6:].isdecimal())])


def curve_name(place: str, signal: str, over: str) -> str:
    """What a curve that is added to a machine is called in a reality: ``force_on_velocity_over_position``."""
    return f"{place}_on_{signal}_over_{over}"


def one_more(name: str, taken: Collection[str]) -> str:
    """What a curve is called beside others of its place and variable, to which it adds: ``<name>#2``."""
    count = sum(plain(other) == name for other in taken)
    return f"{name}#{count + 1}" if count else name


def with_curves(machine: Declaration, effects: Mapping[str, Any]) -> Declaration:
    """A machine with further curves in its equations, which a reality names.

    Args:
        machine: A machine.
        effects: Values of curves, by ``curve_name``: ends and equally spaced values. A name that is none of a
            curve of this machine is left to the machine's own check.
    """
    variables = [*(s.name for s in (*machine.states, *machine.inputs)), "time"]
    variables += [f"{a}*{size}{b}" for a in variables for b in variables if a != b for size in ("", SIZE)]
    targets = {
        "force": [f.velocity for f in machine.forces],
        "sensor": [s.name for s in machine.outputs],
        "parameter": [p.name for p in machine.parameters],
    }
    known = {
        curve_name(place, signal, over): (place, signal, over)
        for place, signals in targets.items()
        for signal in signals
        for over in variables
    }
    chosen: list[Stock] = []
    for name, values in effects.items():
        if plain(name) in known:
            place, signal, over = known[plain(name)]
            chosen += curve(place, signal, over, knots=_knots(values), name=name)
    return machine.with_effects(chosen) if chosen else machine


def apply_reality(
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
    if isinstance(model, Declaration) and reality.hold not in ("", model.hold):
        model = model.held_as("interpolated" if reality.hold == "interpolated" else "held")
    around = with_named(model.sized(reality.base), reality.effects)
    if where is not None:
        around, reality = without_followed(around, reality)
    if where is not None and isinstance(around, Surrounded):
        where.check(model.name, around.stock)
    return around, read_reality(reality, around)


def without_followed(model: Model, reality: Reality) -> tuple[Model, Reality]:
    """A model that can be stepped, without curves that need the whole run; a warning says which.

    Args:
        model: As ``with_named`` gives it.
        reality: Its reality.
    """
    if not isinstance(model, Followed):
        return model, reality
    names = ", ".join(model.named)
    warnings.warn(
        f"model {model.name!r} is stepped without {names}: recordings and free runs have it",
        ModelWarning,
        stacklevel=3,
    )
    kept = {name: values for name, values in reality.effects.items() if name not in model.named}
    return model.inner, replace(reality, effects=kept)


def model_named_in(path: str | Path) -> str:
    """The machine that an ``extended.yaml`` or a ``bench.yaml`` is about.

    Raises:
        ModelError: If the file names none, or a Python file, which only its user may run.
    """
    data = load_yaml(Path(path))
    name = machine_in(data) if isinstance(data, Mapping) else None
    if not isinstance(name, str) or not name:
        raise ModelError(f"{path}: names no machine; is it the extended.yaml of a diagnosis?")
    if is_model_file(name):
        raise ModelError(f"{path}: names the Python file {name}, which is run only if you name it yourself")
    return name


def extended_model(path: str | Path, model: str = "") -> tuple[Model, FloatArray]:
    """What an ``extended.yaml`` holds: a model with its effects, and its parameter vector.

    Args:
        path: The file.
        model: Name or file of the model; by default the file names it.

    Raises:
        ModelError: As ``apply_reality``; also if the file names no model, or one of the user's own.
    """
    name = model or model_named_in(path)
    if not (model or name in model_names()):
        raise ModelError(f"{path}: is of your own {name!r}; give its file, too: --machine FILE.py")
    around, reality = apply_reality(get_model(name), path)
    return around, reality.vector(around)


def stepped(around: Model, reality: Reality, where: Channels, batch: int, step: float) -> Stepped | None:
    """What steps the stock effects around a batch of machines; None if there are none.

    Args:
        around: A model as ``apply_reality`` gives it.
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
