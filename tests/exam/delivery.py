"""What a diagnosis delivers: its ``extended.yaml``, loaded as a user does and run on another record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from fieldmodels.diagnosis.gain import predict
from fieldmodels.diagnosis.outcome import Diagnosis
from fieldmodels.diagnosis.problem import build
from fieldmodels.diagnosis.use import Simulation
from fieldmodels.diagnosis.whole import WholeRecords
from fieldmodels.drivers.named import apply_reality
from fieldmodels.model import Model
from fieldmodels.recording import Recording
from fieldmodels.yaml import save_yaml

Errors = Mapping[str, float]
"""Root mean square error of each output; infinite where a window runs away."""


@dataclass(frozen=True)
class Delivery:
    """An extended simulation on a record that had no say.

    Attributes:
        before: Errors there of the refitted nominal simulation.
        after: Errors there of the extended one.
        stated: Errors of the nominal one and of the extended one, as they are stated of the second record.
        extended: Whether anything was added to the simulation.
        broken: Why the file does not load or run; empty if it does.
    """

    before: Errors
    after: Errors
    stated: Mapping[str, tuple[float, float]]
    extended: bool
    broken: str = ""

    @property
    def over_stated(self) -> float:
        """The largest ratio of an output's error to the stated one.

        Where the nominal simulation errs more on the third record than on the second, so may this one.
        """
        harder = {name: max(self.before[name] / max(b, 1e-300), 1.0) for name, (b, _) in self.stated.items()}
        return _largest(self.after, {name: e * harder[name] for name, (_, e) in self.stated.items()})

    @property
    def over_before(self) -> float:
        """The largest ratio of an output's error to that of the nominal simulation."""
        return _largest(self.after, self.before)


@dataclass(frozen=True)
class Stated:
    """What somebody who was given two records hands over, and says of it.

    Attributes:
        file: The extended simulation, as ``extended.yaml`` holds it.
        errors: Errors on the second record of the nominal simulation and of this one.
        horizons: Length of the windows of each output [s].
        nominal: The refitted nominal simulation.
        extended: Whether anything was added to it.
    """

    file: Mapping[str, Any]
    errors: Mapping[str, tuple[float, float]]
    horizons: Mapping[str, float]
    nominal: Simulation
    extended: bool

    @classmethod
    def by(cls, found: Diagnosis) -> Stated:
        """By a diagnosis."""
        return cls(
            file=found.extended(),
            errors={name: (gain.rmse_before, gain.rmse_with_curves) for name, gain in found.gain.items()},
            horizons={name: gain.horizon for name, gain in found.gain.items()},
            nominal=Simulation(found.machine, found.evidence.base),
            extended=bool(found.causes or found.curve_effects),
        )


def deliver(model: Model, stated: Stated, third: Sequence[Recording]) -> Delivery:
    """Write ``extended.yaml``, load it around the user's model, and predict the windows of a third record.

    Args:
        model: The model, as the user handed it in.
        stated: What is handed over.
        third: Recordings that had no say in it.
    """
    nominal = _predicted(stated.nominal, third, stated.horizons)
    before = {name: error for name, (error, _) in nominal.items()}
    try:
        with TemporaryDirectory() as folder:
            path = Path(folder) / "extended.yaml"
            save_yaml(stated.file, path)
            around, reality = apply_reality(model, path)
        own = _predicted(Simulation(around, reality.vector(around)), third, stated.horizons)
    except Exception as error:  # whatever a user would run into
        lost = dict.fromkeys(before, np.inf)
        return Delivery(before, lost, stated.errors, stated.extended, f"{type(error).__name__}: {error}")
    after = {name: error if count >= nominal[name][1] else np.inf for name, (error, count) in own.items()}
    return Delivery(before, after, stated.errors, stated.extended)


def _predicted(
    simulation: Simulation, records: Sequence[Recording], horizons: Mapping[str, float]
) -> dict[str, tuple[float, float]]:
    """Error of each output on windows of its own length, and how many samples it was compared with."""
    model, names = simulation.model, [o.name for o in simulation.model.outputs]
    model = WholeRecords(model) if model.whole_records else model
    result = dict[str, tuple[float, float]]()
    for horizon in dict.fromkeys(horizons.values()):
        prediction = predict(build(model, records, horizon), simulation.vector)
        errors, counts = prediction.rmse(), prediction.counts.sum(axis=0)
        rows = zip(names, errors, counts, strict=True)
        result |= {n: (float(e), float(c)) for n, e, c in rows if horizons.get(n) == horizon}
    return result


def _largest(errors: Errors, others: Errors) -> float:
    """The largest ratio of two errors of one output."""
    return max((errors[name] / max(others[name], 1e-300) for name in errors if name in others), default=1.0)
