"""Domain randomisation: parameters and settings that are drawn at each reset, for each row of a batch."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldgym.settings import bounds
from fieldmodels.model import Model
from fieldmodels.reality import Reality
from fieldmodels.sampling import Sampler, Uniform
from fieldmodels.settings import declared

Floats = NDArray[np.float64]


class Drawn:
    """What is drawn for each row of a batch, and what has been.

    Attributes:
        random: Whether anything is drawn.
        vectors: Parameter vector of each row, shape (batch, n).
        settings: Settings of each row.
    """

    def __init__(
        self, batch: int, model: Model, reality: Reality, settings: Any, samplers: Mapping[str, Sampler]
    ) -> None:
        self._model, self._reality = model, reality
        self._parameters = reality.samplers(model)
        self._samplers = dict(samplers)
        self._declared = declared(type(settings))
        self.random = bool(self._parameters or self._samplers)
        self.vectors: Floats = np.tile(reality.typical(model), (batch, 1))
        self.settings = [settings] * batch
        self.info: dict[str, Any] = {}

    @property
    def parameters_random(self) -> bool:
        """Whether parameters are drawn."""
        return bool(self._parameters)

    @property
    def settings_random(self) -> bool:
        """Whether settings are drawn."""
        return bool(self._samplers)

    def draw(self, rows: Sequence[int], generators: Sequence[np.random.Generator]) -> None:
        """Draw for some rows, each from its generator: parameters in their order, then settings by name."""
        self.vectors = self.vectors.copy()  # infos hold the former ones
        for i, rng in zip(rows, generators, strict=True):
            for k, sampler in self._parameters.items():
                parameter = self._model.all_parameters[k]
                self.vectors[i, k] = sampler.draw(rng, parameter.lower, parameter.upper)
            if self._samplers:
                values = {name: self._setting(name, sampler, rng) for name, sampler in self._samplers.items()}
                self.settings[i] = dataclasses.replace(self.settings[i], **values)
        self._tell()

    def _setting(self, name: str, sampler: Sampler, rng: np.random.Generator) -> Any:
        one = self._declared[name]
        if one.choices or one.type is bool:
            return sampler.draw(rng)
        if one.type is int and isinstance(sampler, Uniform):
            return int(sampler.low + math.floor((sampler.high - sampler.low + 1.0) * float(rng.random())))
        return one.type(sampler.draw(rng, *bounds(one)))

    def _tell(self) -> None:
        """Make the entries of ``info["privileged"]``."""
        self.info = {}
        if self._parameters:
            self.info["reality"] = self._reality.named(self._model, self.vectors)
        if self._samplers:
            self.info["settings"] = {name: self._column(name) for name in self._samplers}

    def _column(self, name: str) -> NDArray[Any]:
        values = [getattr(settings, name) for settings in self.settings]
        if isinstance(values[0], str):
            column = np.empty(len(values), dtype=object)
            column[:] = values
            return column
        return np.array(values)

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
        if self._parameters:
            self.vectors = self.vectors.copy()
            self.vectors[:, list(self._parameters)] = state["drawn_parameters"]
        for name in self._samplers:
            codes = self._declared[name].choices
            for i, value in enumerate(np.asarray(state[f"drawn_{name}"]).tolist()):
                own = {name: codes[value] if codes else value}
                self.settings[i] = dataclasses.replace(self.settings[i], **own)
        self._tell()
