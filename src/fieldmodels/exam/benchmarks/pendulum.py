"""The pendulum along a smooth random path."""

from __future__ import annotations

from types import MappingProxyType

from fieldmodels.exam.benchmarks.bench import DURATION, Bench


class Pendulum(Bench):
    """A pendulum that is swung by up to 1.2 rad."""

    name = "pendulum"
    excitation = "swing"
    amplitude = 1.2
    motion = (0.5, 1.5)
    force = 0.4
    constants = MappingProxyType(
        {
            "periodic_force.frequency": 1.3,
            "stribeck_friction.velocity": 0.2,
            "hysteresis.distance": 0.08,
            "cogging.period": 0.8,
            "parameter_step.time": 0.45 * DURATION,
            "payload.length": 0.3,
        }
    )
