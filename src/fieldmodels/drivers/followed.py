"""Curves that a machine's own equations cannot hold, followed along a whole run.

A curve may depend on what remembers a signal, on a rate, or on a sum of commands, or act in a direction of
motion of a model that simulates by itself. Such a model is run again and again with what the curves add on
the run before, until nothing changes (waveform relaxation, Lelarasmee et al. 1982): what a curve adds at a
sample follows from what was before, so each run is right for longer.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.drivers.curved import Curved, FreeCurve
from fieldmodels.drivers.variables import (
    CHANGE,
    MEMORY,
    PLAY,
    SHARE,
    direction_of,
)
from fieldmodels.model import Effect, Model, ModelError, Parameter, Where
from fieldmodels.recording import Windows

PLACES = ("force", "sensor", "odds")
LARGE = 1e12
RUNS = 2000
"""Most runs until nothing changes: a run settles at least a sample."""


class Followed(Curved):
    """A model with named curves that are followed along whole runs.

    Attributes:
        named: The curves by the names of their effects, whose values are their parameters.
    """

    repetitions = RUNS

    def __init__(self, inner: Model, named: Mapping[str, FreeCurve]) -> None:
        super().__init__(inner, tuple(named.values()))
        self.named = dict(named)
        self.effects = (*inner.effects, *(_effect(name, curve) for name, curve in named.items()))
        fixed = np.ones(len(inner.names), dtype=np.bool_)
        kept = [np.append(np.repeat([False, True], len(c.knots)), False) for c in named.values()]
        self._fitted = np.concatenate([fixed, *kept])

    def simulate_all(self, parameters: FloatArray, windows: Windows) -> FloatArray:
        """See ``Model.simulate_all``.

        Raises:
            ModelError: If what a curve adds does not settle.
        """
        return super().simulate_all(np.atleast_2d(parameters)[:, self._fitted], windows)


def _effect(name: str, curve: FreeCurve) -> Effect:
    """A curve's places on its variable, which are known, and its values there."""
    places = [
        Parameter(f"at_{k + 1}", curve.over, float(x), float(x), float(x), 1.0, refitted=False)
        for k, x in enumerate(curve.knots)
    ]
    values = [Parameter(f"value_{k + 1}", "1", 0.0, -LARGE, LARGE, 1.0) for k in range(len(curve.knots))]
    where: Where = "force" if curve.place == "force" else "sensor"
    words = direction_of(curve.place, curve.target, curve.over)
    period = Parameter("period", curve.over, curve.period, curve.period, curve.period, 1.0, refitted=False)
    return Effect(name, f"A curve of {words}.", where, (*places, *values, period))


def followed_name(place: str, target: str, over: str) -> str:
    """What a curve is called in a reality: ``force_on_turn rate_over_play of turn_rate of 0.3``."""
    return f"{place}_on_{target}_over_{over}" if target else f"{place}_over_{over}"


def plain(name: str) -> str:
    """A curve's name without its number among those of one place and variable (``<name>#2``)."""
    return name.partition("#")[0]


def followed(model: Model, effects: Mapping[str, Any]) -> dict[str, FreeCurve]:
    """The curves among a reality's effects that can be followed around a model, by name.

    Args:
        model: The model.
        effects: Values by effect: ``at_1`` and so on, and ``value_1`` and so on.

    Raises:
        ModelError: If such a curve has no places, or they do not rise.
    """
    targets = {
        "force": [t for p in (*model.pushes, *model.staged) for t in (p.name, SHARE + p.name)]
        if model.disturbance_unit
        else [],
        "sensor": [s.name for s in model.outputs if not s.event],
        "odds": [s.name for s in model.outputs if s.event],
    }
    places = [(place, target) for place in PLACES for target in targets[place]]
    found = {}
    for name, values in effects.items():
        for place, target in places:
            head = followed_name(place, target, "")
            over = plain(name).removeprefix(head)
            if over != plain(name) and _is_variable(model, over):
                knots, period = _knots(name, values)
                found[name] = FreeCurve(place, target, over, knots, np.eye(len(knots)), period=period)
    return found


def _is_variable(model: Model, over: str) -> bool:
    """Whether a model has a variable; see ``variables.variable``."""
    if " times " in over:
        return all(_is_variable(model, part) for part in over.split(" times ", 1))
    commands = {s.name for s in model.inputs} | {one.name for one in model.sums} | {"time"}
    outputs = {s.name for s in (*model.outputs, *model.unmeasured)}
    for prefix, last in ((MEMORY, " over "), (PLAY, " of "), (CHANGE, " over ")):
        if over.startswith(prefix):
            inside, _, size = over.removeprefix(prefix).rpartition(last)
            return bool(size) and _is_variable(model, inside)
    if over.startswith("rate of "):
        return over.removeprefix("rate of ") in outputs
    return over.removeprefix("size of ") in commands | outputs


def _knots(name: str, values: Any) -> tuple[FloatArray, float]:
    """Places of a curve, and its period."""
    given, period = values if isinstance(values, Mapping) else {}, 0.0
    try:
        knots = np.array([float(given[f"at_{k + 1}"]) for k in range(len(given) // 2)])
        period = float(given.get("period", 0.0))
    except (KeyError, TypeError, ValueError):
        knots = np.zeros(0)
    if len(knots) < 2 or not (np.diff(knots) > 0).all():
        raise ModelError(
            f"{name!r}: a curve takes places at_1, at_2, ... that rise, and a value_1, ... at each"
        )
    return knots, period
