"""Values that vary by chance: how often steady ones are said to."""

from __future__ import annotations

import numpy as np
import pytest

from fieldmodels.diagnosis.chance import _p_value

BLOCKS = np.repeat(np.arange(20), 5)
"""Twenty blocks of five windows."""


def drawn(rng: np.random.Generator, tied: float) -> float:
    """p-value where errors burst and sensitivities change from block to block, perhaps together.

    Args:
        rng: Source of randomness.
        tied: Power of the sensitivity by which errors grow.
    """
    change = np.exp(rng.standard_normal(20))[BLOCKS][:, None] * np.ones(12)
    bursts = np.exp(rng.standard_normal(20))[BLOCKS][:, None]
    error = bursts * change**tied * rng.standard_normal((100, 12))
    return _p_value([(error, change)], BLOCKS)


def test_bursts_of_noise_are_no_chance_of_a_value():
    """By chance 5 % are below 0.05, of 400 more than 33 in two of 1000 runs."""
    rng = np.random.default_rng(1)
    assert sum(drawn(rng, 0.0) < 0.05 for _ in range(400)) <= 33
    assert sum(drawn(rng, 1.0) < 0.05 for _ in range(100)) > 80


def test_errors_that_grow_within_every_window_prove_nothing():
    """Both grow from a window's start; among samples as late they have nothing to do with each other."""
    rng = np.random.default_rng(2)
    late = np.linspace(0.1, 1.0, 12)
    found = [
        _p_value(
            [(late * rng.standard_normal((100, 12)), late * np.exp(rng.standard_normal((100, 12))))], BLOCKS
        )
        for _ in range(400)
    ]
    assert sum(p < 0.05 for p in found) <= 33


@pytest.mark.filterwarnings("error")
def test_a_sample_that_no_window_shows_says_nothing():
    """Where every simulation fails from some sample on, the samples before it decide."""
    rng = np.random.default_rng(3)
    error, change = rng.standard_normal((100, 12)), np.exp(rng.standard_normal((100, 12)))
    cut = error.copy()
    cut[:, 8:] = np.nan
    assert _p_value([(cut, change)], BLOCKS) == pytest.approx(
        _p_value([(error[:, :8], change[:, :8])], BLOCKS), rel=1e-9
    )
