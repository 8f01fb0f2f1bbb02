"""A free run: measured data beside simulations that know their start and the commands, and nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis.gain import predict
from fieldmodels.diagnosis.problem import build
from fieldmodels.diagnosis.use import Simulation
from fieldmodels.diagnosis.whole import WholeRecords
from fieldmodels.recording import Recording, RecordingError

LONGEST = 20  # horizons that are run through
RUNS = ("before", "after")


@dataclass(frozen=True)
class FreeRun:
    """Measured signals, and two simulations of them from one start each.

    Attributes:
        measured: The stretch of data.
        simulated: "before" and "after" to output to values, shape (n,); NaN where a simulation has diverged.
        inputs: Names of the commands in ``measured``.
        starts: "before" and "after" to the first state, shape (1, states); None for the measured one.
    """

    measured: Recording
    simulated: Mapping[str, Mapping[str, FloatArray]]
    inputs: tuple[str, ...]
    starts: Mapping[str, FloatArray | None]

    def __repr__(self) -> str:
        """How well each output is simulated, before and after, in a line."""
        fits = (f"{o} {self.fit('before', o):.0f} → {self.fit('after', o):.0f} %" for o in self.outputs)
        return f"<Free run of {self.measured.source}, {len(self.measured):,} rows: fit of {', '.join(fits)}>"

    @property
    def outputs(self) -> tuple[str, ...]:
        """Outputs that were measured."""
        return tuple(name for name in self.simulated["before"] if name in self.measured)

    def fit(self, run: str, output: str) -> float:
        """Fit in percent: 100 is exact, 0 is as good as a constant, less is worse.

        It is 100 (1 - ‖y - ŷ‖ / ‖y - mean y‖), by the normalised root mean square error.
        """
        y, simulated = self.measured[output], self.simulated[run][output]
        known = np.isfinite(y)
        spread = np.linalg.norm(y[known] - y[known].mean()) if known.any() else 0.0
        if not spread > 0 or not np.isfinite(simulated[known]).all():
            return float("nan")
        return float(100 * (1 - np.linalg.norm(y[known] - simulated[known]) / spread))

    def table(self) -> dict[str, FloatArray]:
        """Columns by name: time, commands, and every output measured, before, after."""
        columns = {"t": self.measured.time} | {name: self.measured[name] for name in self.inputs}
        for name in self.outputs:
            columns |= {name: self.measured[name]}
            columns |= {f"{name}_{run}": self.simulated[run][name] for run in RUNS}
        return columns


def first_stretch(recording: Recording, horizon: float) -> Recording:
    """The longest episode of a recording, cut to what a free run shows."""
    bounds = recording.bounds
    begin, end = (int(x) for x in bounds[np.argmax(bounds[:, 1] - bounds[:, 0])])
    part = slice(begin, min(end, begin + round(LONGEST * horizon / recording.step) + 1))
    return recording.rows(part)


def free_run(recording: Recording, before: Simulation, after: Simulation, horizon: float) -> FreeRun:
    """Run two simulations along a recording, each from the start that fits the whole of it best.

    Args:
        recording: One episode.
        before: The simulation as it was, its parameters refitted.
        after: The extended one.
        horizon: The diagnosis' windows [s], by which errors are weighed.
    """
    both = dict(zip(RUNS, (before, after), strict=True))
    starts = {run: best_start(recording, simulation, horizon) for run, simulation in both.items()}
    simulated = {run: s.free_run(recording, starts[run]).signals for run, s in both.items()}
    model = after.model
    outputs = [o.name for o in model.outputs]
    return FreeRun(
        recording,
        {run: {name: signals[name] for name in outputs} for run, signals in simulated.items()},
        tuple(s.name for s in model.inputs if s.name in recording),
        starts,
    )


def best_start(recording: Recording, simulation: Simulation, horizon: float) -> FloatArray | None:
    """The first state from which a simulation explains a recording best; None if it is too short for one."""
    try:
        problem = build(WholeRecords(simulation.model), [recording], horizon)
    except RecordingError:
        return None
    states: FloatArray = predict(problem, simulation.vector).states
    return states[:1] if np.isfinite(states[:1]).all() else None
