"""Sine, cosine and exponential against the C library, to the last two bits."""

import math

import numpy as np
import pytest

from fieldmodels.compiled import compiled
from fieldmodels.elementary import cosine, exponential, hyperbolic_tangent, sine, sine_and_cosine


@compiled
def side_by_side(x, which):
    """As a loop over lanes takes them: as vector instructions."""
    out = np.empty_like(x)
    for i in range(len(x)):
        out[i] = sine(x[i]) if which == 0 else cosine(x[i]) if which == 1 else exponential(x[i])
    return out


@pytest.mark.every("size", [1e-300, 1e-8, 0.1, 1.0, 1.6, 3.2, 100.0, 1e4, 1e6])
def test_equal_to_the_c_library(size):
    near_zeros = np.arange(-300, 300) * (math.pi / 2) * min(1.0, size / 500.0)
    x = np.concatenate(
        [np.random.default_rng(0).uniform(-size, size, 20_000), near_zeros, [0.0, size, -size]]
    )
    functions = (math.sin, math.cos, math.exp)
    for which, function in enumerate(functions):
        inside = x[np.abs(x) <= 700.0] if function is math.exp else x
        right = np.array([function(value) for value in inside])
        np.testing.assert_allclose(side_by_side(inside, which), right, rtol=5e-16, atol=0.0)


def test_both_of_a_small_angle():
    x = np.r_[np.random.default_rng(0).uniform(-0.8, 0.8, 20_000), 0.785, 0.7850001, 0.0, 1e-300, -3.0, 1e6]
    both = np.array([sine_and_cosine(value) for value in x])
    np.testing.assert_allclose(both, np.stack([np.sin(x), np.cos(x)], axis=1), rtol=5e-16, atol=0.0)


def test_the_hyperbolic_tangent():
    for x in (-400.0, -3.0, -0.2, 0.0, 1e-9, 0.7, 20.0, 1e6):
        assert hyperbolic_tangent(x) == pytest.approx(math.tanh(x), abs=1e-15, rel=0.0)


def test_beyond_their_ranges():
    assert side_by_side(np.array([-1e9, -np.inf]), 2) == pytest.approx(0.0, abs=1e-300)
    assert side_by_side(np.array([1e9]), 2)[0] > 1e300
    assert not np.isfinite(side_by_side(np.array([np.inf, np.nan]), 0)).any()
