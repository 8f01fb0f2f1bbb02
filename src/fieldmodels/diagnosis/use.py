"""What one does with a diagnosis: run its extended simulation, predict other data with it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.gain import predict
from fieldmodels.diagnosis.problem import build
from fieldmodels.diagnosis.result import Estimate
from fieldmodels.drivers.declaration import Declaration
from fieldmodels.drivers.named import apply_reality
from fieldmodels.model import Model, ModelError
from fieldmodels.reality import SCHEMA, extended_reality
from fieldmodels.recording import Recording, Windows

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Simulation:
    """A model with the parameter vector that a diagnosis has found.

    Attributes:
        model: The model, curves among its effects.
        vector: Its whole parameter vector.
    """

    model: Model
    vector: FloatArray

    def with_values(self, values: Mapping[str, float]) -> Simulation:
        """The same with other values.

        Args:
            values: By full name: ``mass``, ``coulomb_friction.force``.

        Raises:
            ModelError: For an unknown name, or a value out of bounds.
        """
        vector = self.vector.copy()
        for name, value in values.items():
            i = self.model.index(name)
            p = self.model.all_parameters[i]
            if not p.lower <= value <= p.upper:
                raise ModelError(f"{name} = {value:g} is outside of {p.lower:g} to {p.upper:g} {p.unit}")
            vector[i] = value
        return replace(self, vector=vector)

    def free_run(self, recording: Recording, states: FloatArray | None = None) -> Recording:
        """Outputs from each episode's first state and the recorded commands alone.

        Args:
            recording: Commands, and what the first state is measured from.
            states: First states, shape (episodes, states); by default as they are measured.

        Returns:
            The recording with simulated outputs in the place of the measured ones.
        """
        bounds = recording.bounds
        lengths = (bounds[:, 1] - bounds[:, 0]).astype(np.int64)
        starts = bounds[:, 0].astype(np.int64)
        names = [o.name for o in self.model.outputs]
        inside = np.arange(lengths.max())[None, :] < lengths[:, None]
        windows = Windows(
            recording=recording,
            starts=starts,
            lengths=lengths,
            states=self.model.initial_states(recording, starts) if states is None else states,
            observed=np.repeat(inside[:, :, None], len(names), axis=2),
        )
        run = self.model.simulate(self.vector[None], windows)[0]
        joined = np.concatenate([one[:n] for one, n in zip(run, lengths, strict=True)])
        simulated = {name: joined[:, j] for j, name in enumerate(names)}
        return replace(
            recording, signals={**recording.signals, **simulated}, source=f"free run of {recording.source}"
        )

    def squares(self, recordings: Sequence[Recording], horizon: float) -> dict[str, float]:
        """Sum of squared prediction errors over windows by output that was measured, in its unit squared.

        Args:
            recordings: The measured data.
            horizon: Length of a window [s].

        Raises:
            RecordingError: If there are too few windows.
        """
        problem = build(self.model, recordings, horizon)
        squares = predict(problem, self.vector).squares.sum(axis=0)
        return {self.model.outputs[j].name: float(squares[j]) for j in np.unique(problem.outputs)}

    def windows(self, recording: Recording, horizon: float) -> pd.DataFrame:
        """Predictions over windows, each from the state that fits it best.

        Args:
            recording: The measured data.
            horizon: Length of a window [s].

        Returns:
            Columns ``window``, ``t`` and for each output its name and ``<name>_predicted``.

        Raises:
            RecordingError: If there are too few windows.
        """
        problem = build(self.model, [recording], horizon)
        part, [run] = problem.parts[0], predict(problem, self.vector).simulated
        rows = part.windows.starts[:, None] + np.arange(part.windows.samples)
        measured = part.windows.measured(tuple(o.name for o in self.model.outputs))
        table = {
            "window": np.repeat(np.arange(len(rows)), rows.shape[1]),
            "t": recording.time[np.minimum(rows, len(recording) - 1)].ravel(),
        }
        for j, output in enumerate(self.model.outputs):
            if output.name in recording:
                table[output.name] = measured[:, :, j].ravel()
                table[f"{output.name}_predicted"] = run[:, :, j].ravel()
        import pandas as pd

        return pd.DataFrame(table)


def written(
    model: Model, parameters: Mapping[str, Estimate], effects: Mapping[str, Mapping[str, Estimate]]
) -> dict[str, Any]:
    """An extended simulation as data, to the last digit: what of ``extended.yaml`` runs.

    Args:
        model: The model.
        parameters: Base parameters.
        effects: Its effects, and curves, by name.
    """

    def exactly(values: Mapping[str, Estimate]) -> dict[str, Any]:
        return {name: {**e.to_json(), "value": float(e.value)} for name, e in values.items()}

    return {
        "schema": SCHEMA,
        "machine": model.name,
        **({"hold": model.hold} if isinstance(model, Declaration) else {}),
        "parameters": exactly(parameters),
        "effects": {name: exactly(values) for name, values in effects.items()},
    }


def loaded(model: Model, data: Mapping[str, Any]) -> Simulation:
    """The simulation that an ``extended.yaml`` holds, as everything that takes the file loads it.

    Args:
        model: The model that it extends.
        data: See ``written``.
    """
    around, reality = apply_reality(model, extended_reality(data, model))
    return Simulation(around, reality.vector(around))


def table(groups: Mapping[str, tuple[str, Mapping[str, Estimate]]]) -> pd.DataFrame:
    """A row for each number: what it belongs to, value, standard error, unit.

    Args:
        groups: Effect to its kind and its numbers.
    """
    import pandas as pd

    return pd.DataFrame([
        {"kind": kind, "effect": effect, "parameter": name, "value": e.value, "std": e.std, "unit": e.unit}
        for effect, (kind, values) in groups.items()
        for name, e in values.items()
    ])  # fmt: skip
