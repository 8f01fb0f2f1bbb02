"""The one-axis benches: integrated eight times finer than a diagnosis predicts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from fieldmodels.exam.benchmarks.base import Benchmark, Outside
from fieldmodels.model import EffectValues
from fieldmodels.recording import Recording
from fieldmodels.synthesis import synthesise

DURATION = 30.0
STEP = 0.01
Force = Callable[[float, float, float, float], float]

OUTSIDE = MappingProxyType(
    {
        "gear_error": "An eccentric gear of the position sensor: it errs by a wave over the range.",
        "end_stop": "An elastic stop that the axis presses on one side.",
        "place_damping": "Damping that grows with the square of the deflection.",
        "progressive_actuator": "An actuator that gives more than in proportion when it is commanded much.",
    }
)


class Bench(Benchmark):
    """A bench of one axis.

    Attributes:
        excitation: Name of the excitation.
        amplitude: Its peak.
        motion: Typical deflection [m or rad] and speed [m/s or rad/s].
        force: Typical force [N or N m], by which faults from outside are measured.
    """

    outside = OUTSIDE
    needs_base = frozenset({"payload", "actuator_gain"})
    excitation: ClassVar[str]
    amplitude: ClassVar[float]
    motion: ClassVar[tuple[float, float]]
    force: ClassVar[float]

    def record(
        self,
        reality: EffectValues,
        seed: int,
        *,
        noise: bool = True,
        coloured: float = 0.0,
        outside: Outside | None = None,
    ) -> Recording:
        """See ``Benchmark.record``: half a minute at 100 Hz."""
        forced = outside is not None and outside.name != "gear_error"
        recording = synthesise(
            self.model, reality, self.excitation, duration=DURATION, step=STEP, amplitude=self.amplitude,
            rng=np.random.default_rng(seed), noise=noise, coloured=coloured,
            outside=self._force(outside) if outside and forced else None,
        )  # fmt: skip
        if outside and not forced:
            place, name = self.motion[0], self.model.outputs[0].name
            wave = outside.size * place * np.sin(3.0 * recording[name] / place)
            return replace(recording, signals={**recording.signals, name: recording[name] + wave})
        return recording

    def _force(self, outside: Outside) -> Force:
        """The force of a fault, of ``size`` times the bench's typical force at its typical motion."""
        size = outside.size * self.force
        place, speed = self.motion
        if outside.name == "end_stop":
            return lambda _t, x, _v, _u: -size * max(x / place - 0.8, 0.0)
        if outside.name == "place_damping":
            return lambda _t, x, v, _u: -size * (v / speed) * (x / place) ** 2
        assert outside.name == "progressive_actuator"
        return lambda _t, _x, _v, u: size * (u / self.force) ** 3
