"""Cost (16), as printed and with frozen weights, and the optimiser (17)-(23)."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from fieldmodels.machines.excitation.adjustment import (
    adjust,
    cost,
    frozen_residuals,
    printed_residuals,
    shares,
)
from fieldmodels.model import ModelError

bits = arrays(np.float64, 22, elements=st.floats(0.0, 10.0))


@settings(max_examples=50, deadline=None, derandomize=True)
@given(bits)
def test_both_costs_are_equation_16_to_the_letter(information):
    x = information / 10.0
    first_line = 0.5 * np.sum(1.0 - (1.0 - x) * x)
    second_line = 0.5 * np.sum(1.0 - x + x**2)
    assert first_line == pytest.approx(second_line)
    assert cost(printed_residuals(information)) == pytest.approx(second_line)
    # With the weights of the very information that is judged, frozen and printed are the same sum.
    assert cost(frozen_residuals(information, information)) == pytest.approx(first_line)


def test_as_printed_full_knowledge_costs_as_much_as_none_and_half_is_best():
    nothing, half, everything = (cost(printed_residuals(np.full(22, v))) for v in (0.0, 5.0, 10.0))
    assert nothing == pytest.approx(everything)
    assert half == pytest.approx(0.75 * nothing)


@settings(max_examples=50, deadline=None, derandomize=True)
@given(bits, bits, st.integers(0, 21), st.floats(0.01, 5.0))
def test_with_frozen_weights_more_information_never_costs(information, current, which, more):
    better = information.copy()
    better[which] += more
    assert cost(frozen_residuals(better, current)) <= cost(frozen_residuals(information, current))
    if current[which] < 9.0 and better[which] <= 10.0:
        assert cost(frozen_residuals(better, current)) < cost(frozen_residuals(information, current))


def test_frozen_weights_favour_what_is_least_known():
    current = np.array([1.0, 9.0])
    gains = [cost(frozen_residuals(current + step, current)) for step in ([0.5, 0.0], [0.0, 0.5])]
    assert gains[0] < gains[1]


def test_the_maximum_may_be_the_greatest_of_the_estimates():
    information = np.array([[1.0, 4.0], [2.0, 0.0]])
    np.testing.assert_allclose(shares(information, None), [[0.25, 1.0], [1.0, 0.0]])
    np.testing.assert_allclose(shares(information, 8.0), information / 8.0)
    assert frozen_residuals(information, information[0], None)[0, 1] == pytest.approx(1.0)
    with pytest.raises(ModelError, match="positive"):
        shares(information, 0.0)


MATRIX = np.array([[2.0, 0.3, 0.1], [0.0, 1.5, -0.4], [0.2, 0.1, 1.0], [0.5, -0.5, 0.5]])
WANTED = np.array([0.3, 6.0, 0.4])
LOW, HIGH = np.array([0.0, 0.5, -1.5]), np.array([1.5, 12.0, 1.5])


def linear(commands):
    return (commands - WANTED) / (HIGH - LOW) @ MATRIX.T


def curved(commands):
    return np.tanh(linear(commands)) + 0.3 * linear(commands) ** 2


def test_gauss_newton_solves_a_linear_problem_in_one_step():
    found = adjust(linear, [1.2, 2.0, -1.0], LOW, HIGH, kind="gauss_newton", iterations=1)
    np.testing.assert_allclose(found.command, WANTED, atol=1e-9)
    assert found.cost == pytest.approx(0.0, abs=1e-18)


def test_steepest_descent_is_another_direction_than_equation_23():
    short = adjust(linear, [1.2, 2.0, -1.0], LOW, HIGH, kind="steepest_descent", iterations=1)
    assert 1e-3 < short.cost < cost(linear(np.array([[1.2, 2.0, -1.0]])))[0]


@pytest.mark.every("kind", ["levenberg_marquardt", "gauss_newton", "steepest_descent"])
@settings(max_examples=40, deadline=None, derandomize=True)
@given(start=arrays(np.float64, 3, elements=st.floats(0.0, 1.0)))
def test_a_step_never_costs_and_never_leaves_the_range(kind, start):
    command = LOW + (HIGH - LOW) * start
    before = cost(curved(command[None]))[0]
    found = adjust(curved, command, LOW, HIGH, kind=kind, iterations=2)
    assert found.cost <= before
    assert found.cost == pytest.approx(cost(curved(found.command[None]))[0])
    assert np.all(found.command >= LOW - 1e-12)
    assert np.all(found.command <= HIGH + 1e-12)


def test_levenberg_marquardt_converges_on_a_curved_problem():
    found = adjust(curved, [1.2, 2.0, -1.0], LOW, HIGH, iterations=15)
    assert found.cost < 1e-8


def test_a_command_without_influence_does_not_stop_the_others():
    # An amplitude of zero leaves the frequency without any: J'J is singular there.
    def silent(commands):
        return np.stack([commands[:, 0] * np.sin(commands[:, 1]), commands[:, 2] - 0.5], axis=1)

    for kind in ("levenberg_marquardt", "gauss_newton"):
        found = adjust(silent, [0.0, 3.0, -1.0], LOW, HIGH, kind=kind)
        assert found.command[2] == pytest.approx(0.5, abs=1e-3)


def test_evaluations_are_counted():
    asked = 0

    def counted(commands):
        nonlocal asked
        asked += len(commands)
        return curved(commands)

    assert adjust(counted, WANTED + 0.1, LOW, HIGH, iterations=3).evaluations == asked


def test_bad_arguments_are_named():
    with pytest.raises(ModelError, match="gauss_newton"):
        adjust(linear, WANTED, LOW, HIGH, kind="newton")
    with pytest.raises(ModelError, match="least below"):
        adjust(linear, WANTED, HIGH, LOW)
    with pytest.raises(ModelError, match="finite"):
        adjust(lambda d: linear(d) * np.nan, WANTED, LOW, HIGH)
