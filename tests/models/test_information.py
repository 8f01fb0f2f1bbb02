"""The metric's three forms, eqs (9)-(15): equal where they must be, safe everywhere."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import entropy, norm

from fieldmodels.information import binned, closed, fast
from fieldmodels.model import ModelError

LOW, HIGH, BITS = -2.0, 3.0, 10
RANGE = HIGH - LOW
BIN = RANGE / 2**BITS

exponents = st.floats(-15.0, 15.0)
places = st.floats(0.0, 1.0)


def test_binned_is_equation_15_summed_by_hand():
    mean, sigma = 0.7, 0.4
    edges = np.linspace(LOW, HIGH, 2**BITS + 1)
    q = np.diff(norm.cdf(edges, mean, sigma))
    assert binned(mean, sigma, LOW, HIGH) == pytest.approx(BITS - entropy(q, base=2), abs=1e-10)


def test_fifteen_is_thirteen_for_a_uniform_source_with_wrapped_noise():
    # Where every output leaves the same uncertainty, the average over outputs (13) is one output's (15).
    count = 16
    shifts = np.exp(-0.5 * ((np.arange(count) - count / 2) / 2.0) ** 2)
    shifts /= shifts.sum()
    joint = np.array([np.roll(shifts, k) for k in range(count)]) / count
    outer = joint.sum(axis=1)[:, None] * joint.sum(axis=0)
    assert np.sum(joint * np.log2(joint / outer)) == pytest.approx(math.log2(count) - entropy(shifts, base=2))


@settings(max_examples=200, deadline=None, derandomize=True)
@given(places, st.floats(math.log(2 * BIN), math.log(1e3 * RANGE)))
def test_closed_form_equals_the_sum_from_two_bins_on(place, log_sigma):
    mean, sigma = LOW + place * RANGE, math.exp(log_sigma)
    # 0.026 bits at the very edge, where the density jumps inside a bin; 0.005 away from it.
    inside = min(place, 1 - place) * RANGE > 4 * sigma
    limit = 0.005 if inside else 0.03
    assert closed(mean, sigma, LOW, HIGH) == pytest.approx(binned(mean, sigma, LOW, HIGH), abs=limit)


@settings(max_examples=200, deadline=None, derandomize=True)
@given(places, st.floats(math.log(BIN), math.log(100 * BIN)))
def test_fast_form_equals_the_sum_for_estimates_inside(place, log_sigma):
    sigma = math.exp(log_sigma)
    # The fast form knows nothing of edges: a mean three sigma inside.
    room = RANGE - 6 * sigma
    mean = LOW + 3 * sigma + place * room
    assert fast(sigma, LOW, HIGH) == pytest.approx(binned(mean, sigma, LOW, HIGH), abs=0.06)


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.floats(math.log(0.5 * BIN), math.log(1e3 * RANGE)))
def test_fast_form_equals_the_sum_in_mid_range_for_all_sigma(log_sigma):
    # Centred on an edge of two bins at half a bin's sigma the difference is 0.069 bits, its greatest.
    sigma = math.exp(log_sigma)
    middle = 0.5 * (LOW + HIGH)
    assert fast(sigma, LOW, HIGH) == pytest.approx(binned(middle, sigma, LOW, HIGH), abs=0.07)


@settings(max_examples=300, deadline=None, derandomize=True)
@given(st.floats(-1e6, 1e6), exponents, st.integers(1, 16))
def test_all_forms_are_finite_and_lie_between_nothing_and_n_bits(mean, exponent, bits):
    sigma = 10.0**exponent
    for value in (
        binned(mean, sigma, LOW, HIGH, bits),
        closed(mean, sigma, LOW, HIGH, bits),
        fast(sigma, LOW, HIGH, bits),
    ):
        assert np.isfinite(value)
        assert -1e-9 <= value <= bits + 1e-9


@settings(max_examples=100, deadline=None, derandomize=True)
@given(st.floats(0.0, 5.0))
def test_a_mean_outside_is_clipped_where_printed_it_reads_as_certain(far):
    sigma = 0.02 * RANGE
    outside = HIGH + 10.0 ** (2 + far) * RANGE
    for form in (binned, closed):
        assert form(outside, sigma, LOW, HIGH) == pytest.approx(form(HIGH, sigma, LOW, HIGH))
        assert form(outside, sigma, LOW, HIGH) < 6.0
    assert binned(outside, sigma, LOW, HIGH, printed=True) == pytest.approx(-BITS, abs=0.01)


def test_as_printed_the_sign_is_wrong():
    inside = binned(0.3, 0.1, LOW, HIGH)
    assert inside > 0.0
    assert binned(0.3, 0.1, LOW, HIGH, printed=True) == pytest.approx(-inside)


@settings(max_examples=200, deadline=None, derandomize=True)
@given(places, st.floats(math.log(0.02 * BIN), math.log(50 * RANGE)), st.floats(0.01, 0.5))
def test_less_uncertainty_is_more_information(place, log_sigma, step):
    mean = LOW + place * RANGE
    wide, narrow = math.exp(log_sigma), math.exp(log_sigma - step)
    assert fast(narrow, LOW, HIGH) > fast(wide, LOW, HIGH)
    assert closed(mean, narrow, LOW, HIGH) >= closed(mean, wide, LOW, HIGH) - 1e-9


@pytest.mark.every("sigma", [RANGE / 4, RANGE / math.sqrt(12), RANGE, 5 * RANGE])
def test_the_slope_is_alive_where_little_is_known(sigma):
    # A capped untruncated entropy has slope zero here; the prior of a uniform range lies at R / sqrt(12).
    slope = (fast(sigma * 1.001, LOW, HIGH) - fast(sigma, LOW, HIGH)) / math.log(1.001)
    reference = (closed(0.5, sigma * 1.001, LOW, HIGH) - closed(0.5, sigma, LOW, HIGH)) / math.log(1.001)
    assert slope < 0.0
    assert slope == pytest.approx(reference, rel=0.4)


@pytest.mark.every(("place", "limit"), [(0.5, 10.0), (0.0, 9.0)])
def test_far_below_a_bin_the_sum_jumps_with_the_place_and_the_others_do_not(place, limit):
    mean = LOW + (300 + place) * BIN
    assert binned(mean, 1e-6 * BIN, LOW, HIGH) == pytest.approx(limit)
    assert closed(mean, 1e-6 * BIN, LOW, HIGH) == pytest.approx(10.0)
    assert fast(1e-6 * BIN, LOW, HIGH) == pytest.approx(10.0)


def test_arrays_broadcast_over_parameters():
    low, high = np.array([0.0, -1.0]), np.array([10.0, 1.0])
    batch = binned(np.zeros((3, 2)), np.full((3, 2), 0.1), low, high)
    assert batch.shape == (3, 2)
    assert batch[1, 1] == binned(0.0, 0.1, -1.0, 1.0)
    assert closed(np.zeros((3, 2)), 0.1, low, high).shape == fast(np.full((3, 2), 0.1), low, high).shape


@pytest.mark.every(
    ("arguments", "word"),
    [
        ((0.0, -1.0, 0.0, 1.0), "standard deviation"),
        ((0.0, math.nan, 0.0, 1.0), "standard deviation"),
        ((math.nan, 1.0, 0.0, 1.0), "finite mean"),
        ((0.0, 1.0, 1.0, 1.0), "range"),
        ((0.0, 1.0, 0.0, math.inf), "range"),
        ((0.0, 1.0, 0.0, 1.0, 0), "bits"),
    ],
)
def test_what_is_no_channel_is_refused(arguments, word):
    for form in (binned, closed):
        with pytest.raises(ModelError, match=word):
            form(*arguments)
