"""A missing curve as an effect of its machine, which environments, the recorder and re-tuning run."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.result import JUMP, Estimate, MissingCurve
from fieldmodels.drivers.declaration import Declaration
from fieldmodels.drivers.followed import followed, followed_name
from fieldmodels.drivers.named import curve_name, one_more
from fieldmodels.drivers.variables import CHANGE, SEGMENTS
from fieldmodels.effects.curves import SIZE
from fieldmodels.model import Model

KNOTS = 25  # odd, so that a curve of a size has one where the sign changes
POINTS = 32  # of a cycle


def runnable(
    model: Model, curves: Sequence[MissingCurve], horizon: float
) -> tuple[dict[str, dict[str, Estimate]], tuple[str, ...]]:
    """Curves as effects, by name.

    Args:
        model: The model that they are to be added to.
        curves: The curves.
        horizon: Length of the windows that they were fitted on [s].

    Returns:
        Values of every effect that can be run, as ``extended.yaml`` has them, and the curves that
        cannot, each with the reason.
    """
    effects: dict[str, dict[str, Estimate]] = {}
    left = []
    for curve in curves:
        if isinstance(model, Declaration):
            found = _machine_effect(model, curve)
        else:
            found = _signal_effect(model, curve, effects)
        if isinstance(found, str):
            # A force that depends on an acceleration, which follows from it, would make no run settle.
            implicit = isinstance(model, Declaration) and "rate of " in curve.over
            found = found if implicit else _followed_effect(model, curve, horizon) or found
        if isinstance(found, str):
            left.append(f"{curve.direction} ({found})")
        else:
            effects[one_more(found[0], effects)] = dict(found[1])
    return effects, tuple(left)


def _signal_effect(
    model: Model, curve: MissingCurve, taken: Collection[str]
) -> tuple[str, Mapping[str, Estimate]] | str:
    """Around a model that simulates by itself: one curve of a command's or a sensor's own; or why not."""
    commanded = any(p.name == curve.target and p.input == curve.over for p in model.pushes)
    own = commanded or (curve.place == "sensor" and curve.over == curve.target)
    if not own or f"{curve.over}_curve" in taken:
        return "around a model that simulates by itself only a command's or a sensor's own curve can act"
    return f"{curve.over}_curve", _values(curve, curve.over_unit, mirrored=False)


def _machine_effect(machine: Declaration, curve: MissingCurve) -> tuple[str, Mapping[str, Estimate]] | str:
    """A curve as an effect of a machine; or why it cannot run."""
    known = {*(s.name for s in (*machine.states, *machine.inputs)), "time"}
    target = curve.target
    if curve.place == "force":
        pushed = zip(machine.pushes, machine.forces, strict=False)  # a machine without forces has none
        target = next((force.velocity for push, force in pushed if push.name == curve.target), "")
    if not target or curve.place == "odds":
        return "a machine has no place where it could act"
    if curve.place == "parameter" and target not in {p.name for p in machine.parameters}:
        return "a number of an effect cannot follow a variable in a run"
    over, mirrored = curve.over, curve.over.startswith("size of ")
    variables = [_state(machine, v) for v in over.removeprefix("size of ").split(" times ")]
    plain = [v.removeprefix("size of ") for v in variables]
    if unknown := [v for v in plain if v not in known]:
        # An acceleration follows from the forces: one that depends on it would make their equation implicit.
        return f"{' and '.join(unknown)} is neither a state nor an input nor the time"
    if len(plain) == 1:
        return curve_name(curve.place, target, plain[0]), _values(curve, curve.over_unit, mirrored)
    factors = [v if v == p else f"{SIZE}{p}" for v, p in zip(variables, plain, strict=True)]
    return curve_name(curve.place, target, "*".join(factors)), _values(curve, curve.over_unit, False)


def _followed_effect(
    model: Model, curve: MissingCurve, horizon: float
) -> tuple[str, Mapping[str, Estimate]] | None:
    """A curve that is followed along whole runs, as it was fitted; None if it cannot."""
    over = curve.over
    if over.startswith(CHANGE):
        over += f" over {horizon / SEGMENTS:.6g} s"
    name = followed_name(curve.place, curve.target, over)
    at, value, error = _cycle(curve)
    places = {f"at_{k + 1}": Estimate(float(x), 0.0, curve.over_unit) for k, x in enumerate(at)}
    values = {
        f"value_{k + 1}": Estimate(float(v), float(e), curve.unit)
        for k, (v, e) in enumerate(zip(value, error, strict=True))
    } | _period(curve, curve.over_unit)
    given = {key: e.value for key, e in {**places, **values}.items()}
    return (name, {**places, **values}) if followed(model, {name: given}) else None


def _state(machine: Declaration, variable: str) -> str:
    """The state that a rate is, where the machine has one."""
    rates = {f.position: f.velocity for f in machine.forces if f.position}
    name = variable.removeprefix("rate of ")
    return rates.get(name, variable) if variable != name else variable


def _values(curve: MissingCurve, unit: str, mirrored: bool) -> dict[str, Estimate]:
    """Ends and equally spaced values; of a variable's size on both sides of zero."""
    at, value, error = _cycle(curve)
    low, high = float(at[0]), float(at[-1])
    if mirrored:
        low = -high
    knots = np.linspace(low, high, len(at) if curve.period or curve.formula.startswith(JUMP) else KNOTS)
    places: FloatArray = np.abs(knots) if mirrored else knots
    return {
        "low": Estimate(low, 0.0, unit),
        "high": Estimate(high, 0.0, unit),
        **_period(curve, unit),
        **{
            f"value_{k + 1}": Estimate(float(v), float(e), curve.unit)
            for k, (v, e) in enumerate(
                zip(np.interp(places, at, value), np.interp(places, at, error), strict=True)
            )
        },
    }


def _cycle(curve: MissingCurve) -> FloatArray:
    """Variable, value and standard error of a curve, of a wave's first cycle, each of shape (points,)."""
    at, value, error = curve.curve.T
    if not curve.period:
        return np.stack([at, value, error])
    places = at[0] + curve.period * np.linspace(0.0, 1.0, POINTS + 1)
    return np.stack([places, np.interp(places, at, value), np.interp(places, at, error)])


def _period(curve: MissingCurve, unit: str) -> dict[str, Estimate]:
    return {"period": Estimate(curve.period, 0.0, unit)} if curve.period else {}
