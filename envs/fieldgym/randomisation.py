"""Domain randomisation: parameters and settings that are drawn at each reset, for each row of a batch."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldgym.settings import draw_setting, extreme_settings
from fieldmodels.model import Model
from fieldmodels.reality import Reality
from fieldmodels.sampling import Sampler
from fieldmodels.settings import declared

Floats = NDArray[np.float64]


class EpisodeParameters:
    """What is drawn for each row of a batch, and what has been.

    Attributes:
        random: Whether anything is drawn.
        vectors: Parameter vector of each row, shape (batch, n).
        settings: Settings of each row.
    """

    def __init__(
        self,
        batch: int,
        model: Model,
        reality: Reality,
        settings: Any,
        samplers: Mapping[str, Sampler],
        model_of: Callable[[Any], Model] | None = None,
    ) -> None:
        """Draw nothing yet.

        Args:
            batch: Number of rows.
            model: The model of the typical settings.
            reality: What holds in the simulation; its samplers draw parameters.
            settings: The typical settings.
            samplers: What draws settings, by name.
            model_of: The model of some settings, if its nominal parameters depend on those that may be drawn.
        """
        self._model, self._reality, self._model_of = model, reality, model_of
        self._parameters = reality.samplers(model)
        self._samplers = dict(samplers)
        self._typical = settings
        self._declared = declared(type(settings))
        self.random = bool(self._parameters or self._samplers)
        self.vectors: Floats = np.tile(reality.typical(model), (batch, 1))
        self.settings = [settings] * batch
        self._columns: dict[str, NDArray[Any]] = {}
        self.info: dict[str, Any] = {}

    @property
    def parameters_random(self) -> bool:
        """Whether parameters differ between rows: are drawn, or follow settings that are."""
        return bool(self._parameters) or (self.settings_random and self._model_of is not None)

    @property
    def settings_random(self) -> bool:
        """Whether settings are drawn."""
        return bool(self._samplers)

    def extremes(self) -> list[Any]:
        """Settings as extreme as any that will be drawn: all at one end, or one choice at a time."""
        values = {name: extreme_settings(self._declared[name], s) for name, s in self._samplers.items()}
        ends = [{name: of[k] for name, of in values.items()} for k in (0, -1)]
        ends += [{name: value} for name, of in values.items() for value in of[1:-1]]
        return [dataclasses.replace(self._typical, **own) for own in ends]

    def draw(self, rows: Sequence[int], generators: Sequence[np.random.Generator]) -> None:
        """Draw for some rows, each from its generator: parameters in their order, then settings by name."""
        self.vectors = self.vectors.copy()  # infos hold the former ones
        for i, rng in zip(rows, generators, strict=True):
            for k, sampler in self._parameters.items():
                parameter = self._model.all_parameters[k]
                self.vectors[i, k] = sampler.draw(rng, parameter.lower, parameter.upper)
            if self._samplers:
                drawn = {n: draw_setting(self._declared[n], s, rng) for n, s in self._samplers.items()}
                self._set_settings(i, drawn)
        self._tell()

    def _set_settings(self, i: int, values: Mapping[str, Any]) -> None:
        """Give a row settings, and the parameters that these make nominal."""
        own = self.settings[i] = dataclasses.replace(self._typical, **values)
        for name, column in self._columns.items():
            column[i] = getattr(own, name)
        if self._model_of is not None:
            vector = self._reality.typical(self._model_of(own))
            drawn = list(self._parameters)
            vector[drawn] = self.vectors[i, drawn]
            self.vectors[i] = vector

    def _tell(self) -> None:
        """Make the entries of ``info`` that tell what has been drawn."""
        named = self._reality.named(self._model, self.vectors) if self._parameters else {}
        self.info = {
            f"privileged.reality.{effect}.{name}": column
            for effect, columns in named.items()
            for name, column in columns.items()
        }
        for name in self._samplers:
            self.info[f"privileged.settings.{name}"] = self.column(name).copy()

    def column(self, name: str) -> NDArray[Any]:
        """A setting's value in each row, or a property's of the settings, shape (batch, ...); read only.

        Names are objects, so that each may be compared with one.
        """
        if name not in self._columns:
            values = [getattr(settings, name) for settings in self.settings]
            self._columns[name] = np.array(values, dtype=object if isinstance(values[0], str) else None)
        return self._columns[name]

    def state(self) -> dict[str, Any]:
        """What has been drawn; empty if nothing is random."""
        state: dict[str, Any] = {}
        if self._parameters:
            state["drawn_parameters"] = self.vectors[:, list(self._parameters)]
        for name in self._samplers:
            codes = self._declared[name].choices
            values = [getattr(settings, name) for settings in self.settings]
            state[f"drawn_{name}"] = np.array([codes.index(v) for v in values] if codes else values)
        return state

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Return to what had been drawn."""
        self.vectors = self.vectors.copy()
        if self._parameters:
            self.vectors[:, list(self._parameters)] = state["drawn_parameters"]
        if self._samplers:
            values = {name: self._read(name, state[f"drawn_{name}"]) for name in self._samplers}
            for i in range(len(self.settings)):
                self._set_settings(i, {name: column[i] for name, column in values.items()})
        self._tell()

    def _read(self, name: str, column: Any) -> list[Any]:
        """A setting's values in each row, as ``state`` has them."""
        one, values = self._declared[name], np.asarray(column).tolist()
        if one.choices:
            return [one.choices[value] for value in values]
        return list(map(tuple, values)) if one.items else values
