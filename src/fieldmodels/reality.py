"""A reality: the parameter values that a simulation runs with, named, checked, from a dict or a file.

A value may be a sampler (``fieldmodels.sampling``), which an environment draws anew for each episode.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.model import Model, ModelError
from fieldmodels.names import machine_in
from fieldmodels.sampling import Sampler, is_sampler, read_sampler
from fieldmodels.yaml import load_yaml

SCHEMA = 1
"""Of the files that hold a reality; ``diagnosis.outcome`` and ``fieldgym record`` write it."""


@dataclass(frozen=True)
class Reality:
    """Named values that differ from the nominal simulation.

    Attributes:
        base: Values of base parameters: numbers, or samplers that draw one for each episode.
        effects: Values of the parameters of effects that are on, likewise.
        hold: What inputs do between samples, ``held`` or ``interpolated``; empty for what the model says.
    """

    base: Mapping[str, Any] = field(default_factory=dict)
    effects: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    hold: str = ""

    def __post_init__(self) -> None:
        named = [values for values in self.effects.values() if isinstance(values, Mapping)]
        for name in chain(self.base, self.effects, *named):
            if not isinstance(name, str):  # YAML's keys may be anything
                raise ModelError(
                    f"{name!r} is no name; a reality has names of effects and parameters as keys"
                )

    @property
    def random(self) -> bool:
        """Whether a value is drawn for each episode."""
        return any(isinstance(value, Sampler) for _, _, value in self._entries())

    def vector(self, model: Model) -> FloatArray:
        """The model's parameter vector in this reality.

        Raises:
            ModelError: For unknown names, values out of bounds, or values that are drawn for each episode.
        """
        if self.random:
            drawn = ", ".join(
                _place(effect, name) for effect, name, value in self._entries() if isinstance(value, Sampler)
            )
            raise ModelError(
                f"{drawn}: drawn for each episode of an environment; a fixed value is needed here"
            )
        return self._vector(model, lambda value: value)

    def typical(self, model: Model) -> FloatArray:
        """The parameter vector with every sampler at its typical value.

        Raises:
            ModelError: As ``vector``; also if a sampler can draw what is out of bounds.
        """
        for i, sampler in self.samplers(model).items():
            parameter = model.all_parameters[i]
            sampler.check(repr(model.names[i]), parameter.lower, parameter.upper, parameter.unit)
        return self._vector(model, lambda value: value.typical if isinstance(value, Sampler) else value)

    def extremes(self, model: Model) -> FloatArray:
        """Parameter vectors with every sampler at its smallest and at its largest value, shape (2, n)."""
        ends = np.tile(self.typical(model), (2, 1))
        for i, sampler in self.samplers(model).items():
            parameter = model.all_parameters[i]
            ends[:, i] = sampler.extremes(parameter.lower, parameter.upper)
        return ends

    def samplers(self, model: Model) -> dict[int, Sampler]:
        """The samplers by their place in the parameter vector, in its order."""
        found = {}
        for effect, name, value in self._entries():
            if isinstance(value, Sampler):
                if effect is not None:
                    model.effect(effect)
                found[model.index(_place(effect, name))] = value
        return dict(sorted(found.items()))

    def draw(self, model: Model, rng: np.random.Generator) -> Reality:
        """The same reality with every sampler drawn once."""
        vector = self.typical(model)
        for i, sampler in self.samplers(model).items():
            parameter = model.all_parameters[i]
            vector[i] = sampler.draw(rng, parameter.lower, parameter.upper)
        values = {
            group: {name: float(column[0]) for name, column in columns.items()}
            for group, columns in self.named(model, vector[None]).items()
        }
        return Reality(base=values.pop("parameters", {}), effects=values)

    def named(self, model: Model, vectors: FloatArray) -> dict[str, Any]:
        """What this reality names, with the values of parameter vectors of shape (batch, n).

        The form is that of ``read_reality``: with the numbers of one row it is that row's reality.
        """
        result: dict[str, Any] = {}
        for effect, name, _ in self._entries():
            i = model.index(_place(effect, name))
            result.setdefault("parameters" if effect is None else effect, {})[name] = vectors[:, i]
        return result

    def plain(self) -> dict[str, Any]:
        """What this reality names as YAML has it, which ``read_reality`` reads again."""
        result: dict[str, Any] = {}
        for effect, name, value in self._entries():
            written = value.as_mapping() if isinstance(value, Sampler) else float(value)
            result.setdefault("parameters" if effect is None else effect, {})[name] = written
        return result

    def _entries(self) -> list[tuple[str | None, str, Any]]:
        own: list[tuple[str | None, str, Any]] = [(None, name, value) for name, value in self.base.items()]
        for effect, values in self.effects.items():
            if isinstance(values, Mapping):
                own += [(effect, name, value) for name, value in values.items()]
        return own

    def _vector(self, model: Model, number: Callable[[Any], float]) -> FloatArray:
        base = {name: number(value) for name, value in self.base.items()}
        effects = {
            effect: {name: number(value) for name, value in values.items()}
            if isinstance(values, Mapping)
            else values
            for effect, values in self.effects.items()
        }
        return model.vector(base, effects)


def _place(effect: str | None, name: str) -> str:
    return name if effect is None else f"{effect}.{name}"


def read_reality(source: Reality | Mapping[str, Any] | str | Path | None, model: Model) -> Reality:
    """Read a reality from what a user hands in, and check it against the model.

    Args:
        source: None (nominal); a mapping of effects ``{"gyro_bias": {"rate": 0.004}}``, in which the
            key ``parameters`` may hold base parameters; or the path of an ``extended.yaml`` as
            written by a diagnosis. A sampler may stand in the place of a number (see ``sampling``).
        model: The model whose names and bounds hold.

    Raises:
        ModelError: For unknown names, values out of bounds, samplers that make no sense, or a file of another
            model.
        YamlError: If the file cannot be read.
    """
    reality = parse_reality(source, model)
    reality.typical(model)
    return reality


def parse_reality(source: Reality | Mapping[str, Any] | str | Path | None, model: Model) -> Reality:
    """As ``read_reality``, before names and bounds are checked."""
    if isinstance(source, Reality):
        return source
    if source is None:
        return Reality()
    if isinstance(source, Mapping):
        base = source.get("parameters", {})
        return Reality(
            base=_with_samplers(dict(_mapping(base, "'parameters'")), None),
            effects={k: _with_samplers(v, k) for k, v in source.items() if k != "parameters"},
        )
    return extended_reality(load_yaml(Path(source)), model, source)


def _with_samplers(values: Any, effect: str | None) -> Any:
    """Named values, samplers read; what is no mapping is left to the model's own message."""
    if not isinstance(values, Mapping):
        return values
    return {
        name: read_sampler(value, repr(_place(effect, name)), nested=True) if is_sampler(value) else value
        for name, value in values.items()
    }


def extended_reality(data: Any, model: Model, path: Path | str = "extended.yaml") -> Reality:
    """As ``parse_reality``, of what an ``extended.yaml`` holds; ``path`` for messages.

    Raises:
        ModelError: If the data are none, of another schema or of another model.
    """
    if not isinstance(data, Mapping) or "effects" not in data:
        raise ModelError(f"{path}: not an extended simulation (it needs the keys 'machine' and 'effects')")
    if data.get("schema", SCHEMA) != SCHEMA:
        raise ModelError(
            f"{path}: schema {data['schema']!r}, but this version reads schema {SCHEMA}; use the version of "
            "fieldgym that wrote it, or repeat the diagnosis"
        )
    if machine_in(data) != model.name:
        raise ModelError(f"{path}: made for machine {machine_in(data)!r}, not for {model.name!r}")
    base = _values(data.get("parameters"), f"{path}: 'parameters'")
    effects = {
        name: _values(values, f"{path}: effect {name!r}")
        for name, values in _mapping(data["effects"], f"{path}: 'effects'").items()
    }
    hold = data.get("hold", "")
    if hold not in ("", "held", "interpolated"):
        raise ModelError(f"{path}: 'hold' must be 'held' or 'interpolated', not {hold!r}")
    return Reality(base, effects, hold)


def _values(entries: Any, place: str) -> dict[str, Any]:
    """Each entry is a number, a sampler, or a mapping with its ``value`` beside a standard error."""
    values = {}
    for name, entry in _mapping(entries, place).items():
        if isinstance(entry, Mapping) and "value" not in entry:
            values[name] = read_sampler(entry, f"{place}: {name!r}", nested=True)
        else:
            values[name] = entry["value"] if isinstance(entry, Mapping) else entry
    return values


def _mapping(entries: Any, place: str) -> Mapping[str, Any]:
    if entries is None:
        return {}
    if not isinstance(entries, Mapping):
        raise ModelError(f"{place} must be a mapping of names to values, not {entries!r}")
    return entries
