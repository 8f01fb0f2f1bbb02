"""Recordings of a walk in a hidden reality: what a robot would log."""

from __future__ import annotations

import math

import numpy as np

from fieldmodels.drivers.named import apply_reality, stepped
from fieldmodels.machines.heel_strike.model import HeelStrikeModel
from fieldmodels.machines.heel_strike.parameters import Leg, Noise, Regimes
from fieldmodels.machines.heel_strike.strides import CHANNELS, Strides
from fieldmodels.model import ModelError
from fieldmodels.reality import Reality
from fieldmodels.recording import Recording


def record_walk(
    duration: float,
    rng: np.random.Generator,
    noise: Noise | Regimes | None = None,
    reality: Reality | None = None,
    leg: Leg | None = None,
) -> Recording:
    """Record the gyro and the strikes of one walk.

    Args:
        duration: Length of the recording [s]; it ends with a whole stride.
        rng: Source of all randomness.
        noise: Stationary noise (default: Ranger's nominal levels) or hidden regimes.
        reality: What differs from the nominal leg.
        leg: The nominal leg.

    Returns:
        Columns gyro [rad/s], strike [1] and strike_angle [rad], as ``HeelStrikeModel`` describes them.

    Raises:
        ModelError: For a reality that the model does not know, or if the leg falls.
    """
    model = HeelStrikeModel(leg)
    around, truth = apply_reality(model, reality, CHANNELS)
    vector = truth.vector(around)[: len(model.names)]
    stock = stepped(around, truth, CHANNELS, 1, model.leg.step)
    walker = Strides(1, model.leg, noise or Noise(), vector, stock=stock)
    walker.seed(0, rng)
    gyro, strike, angle = [], [], []
    samples, latest = 0, 0.0
    while samples < math.ceil(duration / model.leg.step):
        result = walker.advance((1.0, 1.0, 0.1, 2 / 3 / model.leg.step), traces=True)
        if result.fallen[0]:
            raise ModelError(
                f"the leg fell after {samples * model.leg.step:.1f} s; "
                "make the reality's torques or the noise smaller"
            )
        assert result.traces is not None
        n = int(result.samples[0])
        gyro.append(result.traces[0, :, 3])
        strike.append(np.eye(1, n, n - 1)[0])
        angle.append(np.full(n, latest))
        latest = float(walker.walkers["geometry"][0])
        angle[-1][-1] = latest
        samples += n
    return Recording(
        time=np.arange(1, samples + 1, dtype=np.float64) * model.leg.step,
        signals={
            "gyro": np.concatenate(gyro),
            "strike": np.concatenate(strike),
            "strike_angle": np.concatenate(angle),
        },
        units={"gyro": "rad/s", "strike": "1", "strike_angle": "rad"},
        source="simulated walk",
    )
