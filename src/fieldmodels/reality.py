"""A reality: the parameter values that a simulation runs with, named, checked, from a dict or a file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fieldmodels.arrays import FloatArray
from fieldmodels.model import EffectValues, Model, ModelError
from fieldmodels.yaml import load_yaml


@dataclass(frozen=True)
class Reality:
    """Named values that differ from the nominal simulation.

    Attributes:
        base: Values of base parameters.
        effects: Values of the parameters of effects that are on.
    """

    base: Mapping[str, float] = field(default_factory=dict)
    effects: EffectValues = field(default_factory=dict)

    def vector(self, model: Model) -> FloatArray:
        """The model's parameter vector in this reality.

        Raises:
            ModelError: For unknown names or values out of bounds.
        """
        return model.vector(self.base, self.effects)


def read_reality(source: Reality | Mapping[str, Any] | str | Path | None, model: Model) -> Reality:
    """Read a reality from what a user hands in, and check it against the model.

    Args:
        source: None (nominal); a mapping of effects ``{"gyro_bias": {"rate": 0.004}}``, in which the
            key ``parameters`` may hold base parameters; or the path of an ``extended.yaml`` as
            written by a diagnosis.
        model: The model whose names and bounds hold.

    Raises:
        ModelError: For unknown names, values out of bounds, or a file of another model.
        YamlError: If the file cannot be read.
    """
    if isinstance(source, Reality):
        reality = source
    elif source is None:
        reality = Reality()
    elif isinstance(source, Mapping):
        base = source.get("parameters", {})
        reality = Reality(base=dict(base), effects={k: v for k, v in source.items() if k != "parameters"})
    else:
        reality = _from_file(Path(source), model)
    reality.vector(model)
    return reality


def _from_file(path: Path, model: Model) -> Reality:
    data = load_yaml(path)
    if not isinstance(data, Mapping) or "effects" not in data:
        raise ModelError(f"{path}: not an extended model (it needs the keys 'model' and 'effects')")
    if data.get("model") != model.name:
        raise ModelError(f"{path}: made for model {data.get('model')!r}, not for {model.name!r}")
    base = _values(data.get("parameters"), f"{path}: 'parameters'")
    effects = {
        name: _values(values, f"{path}: effect {name!r}")
        for name, values in _mapping(data["effects"], f"{path}: 'effects'").items()
    }
    return Reality(base=base, effects=effects)


def _values(entries: Any, place: str) -> dict[str, Any]:
    """Each entry is a number, or a mapping that holds it as ``value`` beside its standard error."""
    return {
        name: entry.get("value") if isinstance(entry, Mapping) else entry
        for name, entry in _mapping(entries, place).items()
    }


def _mapping(entries: Any, place: str) -> Mapping[str, Any]:
    if entries is None:
        return {}
    if not isinstance(entries, Mapping):
        raise ModelError(f"{place} must be a mapping of names to values, not {entries!r}")
    return entries
