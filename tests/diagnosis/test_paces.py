"""A servo of any pace, from a telescope's axis to a galvanometer's mirror, moved exactly by its equation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import cont2discrete

from fieldmodels.diagnosis import diagnose
from fieldmodels.recording import Recording
from fieldmodels.registry import get_model

SAMPLES, PER_PERIOD, FINE, DAMPING = 3000, 30, 10, 0.8
"""Samples, how many of them in a natural period, steps in each, and the damping ratio."""


def moved(seed: int, frequency: float, fastest: float = np.inf, rests: int = 1) -> Recording:
    """A log of a servo under steps of its set-point.

    Args:
        seed: Of the steps and the noise.
        frequency: Its natural frequency [Hz].
        fastest: How far the set-point that it follows goes in a natural period, at most [rad].
        rests: By what the usual time between steps is longer.
    """
    rng, mode = np.random.default_rng(seed), 2.0 * np.pi * frequency
    step = 1.0 / (frequency * PER_PERIOD)
    rates = np.array([[0.0, 1.0], [-(mode**2), -2.0 * DAMPING * mode]])
    a, b, *_ = cont2discrete((rates, np.array([[0.0], [mode**2]]), np.eye(2), np.zeros((2, 1))), step / FINE)
    given = np.repeat(rng.uniform(-0.3, 0.3, 200), rests * rng.integers(10, 60, 200))[:SAMPLES]
    states, state, followed = np.zeros((SAMPLES, 2)), np.zeros(2), given[0]
    for i in range(SAMPLES):
        states[i] = state
        for _ in range(FINE):
            followed += np.clip(
                given[i] - followed, -fastest / PER_PERIOD / FINE, fastest / PER_PERIOD / FINE
            )
            state = a @ state + b[:, 0] * followed
    noise = rng.standard_normal((SAMPLES, 2)) * (5e-4, 5e-4 * mode)
    signals = {
        "set_point": given,
        "position": states[:, 0] + noise[:, 0],
        "velocity": states[:, 1] + noise[:, 1],
    }
    return Recording(step * np.arange(SAMPLES), signals, f"{frequency} Hz")


@pytest.mark.matrix(keep=("0.05",))
@pytest.mark.parametrize("frequency", [0.05, 5.0, 340.0, 2000.0])
def test_a_servo_of_any_pace_is_fitted(frequency: float):
    found = diagnose(get_model("servo"), [moved(1, frequency)], [moved(2, frequency)])
    assert found.verdict == "consistent", found.summary()
    mode = 2.0 * np.pi * frequency
    assert found.parameters["inertia"].value == pytest.approx(mode**-2, rel=0.01)
    assert found.parameters["damping"].value == pytest.approx(2.0 * DAMPING / mode, rel=0.01)


def test_a_limit_that_is_seldom_reached_is_certain():
    """It acts in a few blocks of the record, so that what it brings differs from block to block."""
    logs = [[moved(seed, 5.0, fastest=0.3, rests=10)] for seed in (1, 2)]
    found = diagnose(get_model("servo"), *logs)
    [cause] = found.causes
    assert cause.effect == "actuator_rate_limit"
    assert cause.parameters["rate"].value == pytest.approx(0.3 * 5.0, rel=0.02)
    assert cause.chance < 1e-6 < cause.p_value
