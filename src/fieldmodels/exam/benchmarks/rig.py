"""The rig under a multisine on steps, with pauses."""

from __future__ import annotations

from types import MappingProxyType

from fieldmodels.exam.benchmarks.bench import DURATION, Bench


class Rig(Bench):
    """A mass of 2 kg on a spring, driven by up to 8 N."""

    name = "rig"
    excitation = "mixed"
    amplitude = 8.0
    motion = (0.05, 0.25)
    force = 3.0
    constants = MappingProxyType(
        {
            "periodic_force.frequency": 1.3,
            "stribeck_friction.velocity": 0.03,
            "hysteresis.distance": 0.005,
            "cogging.period": 0.08,
            "parameter_step.time": 0.45 * DURATION,
        }
    )
