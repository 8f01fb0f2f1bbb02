"""The shaken vehicle: its runs integrated eight times finer than a diagnosis predicts them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.exam.benchmarks.base import Benchmark, Outside
from fieldmodels.machines.excitation.recording import record_experiment
from fieldmodels.model import EffectValues
from fieldmodels.recording import Recording

DURATION = 4.0


class Excitation(Benchmark):
    """One run of 4 s a mode, 100 Hz."""

    name = "excitation"
    outside = MappingProxyType(
        {
            "gear_error": "An arm whose gear errs with its angle by a wave.",
            "cross_axis": "An accelerometer whose axis x also feels axis z, and z feels x.",
            "fluid_inclinometer": "An inclinometer whose fluid is moved by the acceleration it hangs in.",
            "force_bend": "A force sensor whose scale grows with the square of the force.",
        }
    )
    coloured_share = 0.3

    def record(
        self,
        reality: EffectValues,
        seed: int,
        *,
        noise: bool = True,
        coloured: float = 0.0,
        outside: Outside | None = None,
    ) -> Recording:
        """See ``Benchmark.record``."""
        applied = _gear_error(outside.size) if outside and outside.name == "gear_error" else None
        run = record_experiment(
            np.random.default_rng(seed), dict(reality), duration=DURATION, noise=noise, coloured=coloured,
            model=self.model, applied=applied,  # type: ignore[arg-type]
        )  # fmt: skip
        if outside and outside.name != "gear_error":
            return replace(run, signals={**run.signals, **_faulty(outside, run)})
        return run


def _gear_error(size: float) -> Callable[[FloatArray, float], FloatArray]:
    """An arm that errs by so many radians, eight times a radian."""
    return lambda commands, _step: (
        commands + np.column_stack([size * np.sin(8.0 * commands[:, 0]), 0.0 * commands[:, 1]])
    )


def _faulty(outside: Outside, run: Recording) -> dict[str, FloatArray]:
    """Signals that a faulty sensor shows."""
    if outside.name == "cross_axis":
        x, z = run["acceleration_x"], run["acceleration_z"]
        return {"acceleration_x": x + outside.size * z, "acceleration_z": z + outside.size * x}
    if outside.name == "fluid_inclinometer":
        return {"pitch": run["pitch"] + outside.size * run["acceleration_x"]}
    assert outside.name == "force_bend"
    scale = np.std(run["force_x"])
    return {"force_x": run["force_x"] * (1.0 + outside.size * (run["force_x"] / scale) ** 2)}
