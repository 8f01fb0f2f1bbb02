"""The arm's motion: smooth from command to command, within its acceleration, and eq (24) if left alone."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from fieldmodels.machines.excitation.motion import CONSTANT, DECISION, STEADY_SHARE, arm_motion
from fieldmodels.model import ModelError

LIMITS = {"paper": (3.0, 5.0), "wide": (12.0, 25.0)}


@st.composite
def schedules(draw):
    """Any sequence of commands, also ones that the arm cannot follow, and the acceleration it has."""
    frequency, acceleration = LIMITS[draw(st.sampled_from(sorted(LIMITS)))]
    command = st.tuples(st.floats(0, 2), st.floats(0, frequency), st.floats(-2, 2))
    return np.array(draw(st.lists(command, min_size=1, max_size=12))), acceleration


def test_constant_command_is_equation_24():
    motion, attained = arm_motion(np.tile(CONSTANT, (25, 1)), 5.0)
    t = np.arange(2001) * 0.005
    np.testing.assert_allclose(motion[:, 0], np.pi / 4 + 2 * np.pi / 9 * np.sin(np.pi / 2 * t), atol=1e-13)
    np.testing.assert_allclose(motion[:, 2], -(np.pi**3) / 18 * np.sin(np.pi / 2 * t), atol=1e-13)
    assert np.array_equal(attained, np.tile(CONSTANT, (25, 1)))


@settings(max_examples=100, deadline=None, derandomize=True)
@given(schedules())
def test_acceleration_is_never_exceeded(case):
    commands, acceleration = case
    motion, _ = arm_motion(commands, acceleration)
    assert np.abs(motion[:, 2]).max() <= acceleration
    fine, _ = arm_motion(commands, acceleration, per_decision=1600)
    assert np.abs(fine[:, 2]).max() <= 1.003 * acceleration


@settings(max_examples=50, deadline=None, derandomize=True)
@example((np.array([[1.0, 6.0, 0.0], [0.0, 0.0, 0.0], [2.0, 0.0, 2.0], [0.0, 6.0, 0.0]]), 25.0))
@given(schedules())
def test_angle_speed_and_acceleration_are_continuous_and_belong_together(case):
    """Trapezoid sums over 0.125 ms: a jump of any of the three at a joint would stand out."""
    commands, acceleration = case
    per = 3200
    motion, _ = arm_motion(commands, acceleration, per_decision=per)
    step = DECISION / per
    for k in (0, 1):
        sums = step * 0.5 * (motion[1:, k + 1] + motion[:-1, k + 1])
        np.testing.assert_allclose(np.diff(motion[:, k]), sums, rtol=0, atol=1e-5 * acceleration * step)
    # The acceleration changes by no more than its slope allows: the blend's is below 60 / T^3 a radian.
    steepest = 4 * acceleration * 15 + 60 / DECISION**3 * 4
    assert np.abs(np.diff(motion[:, 2])).max() <= steepest * step


@settings(max_examples=50, deadline=None, derandomize=True)
@given(schedules())
def test_angle_stays_between_those_of_the_commands(case):
    commands, acceleration = case
    motion, _ = arm_motion(commands, acceleration)
    ends = np.vstack([CONSTANT, commands])
    assert motion[:, 0].max() <= (ends[:, 2] + ends[:, 0]).max() + 1e-12
    assert motion[:, 0].min() >= (ends[:, 2] - ends[:, 0]).min() - 1e-12


@pytest.mark.every("limits", LIMITS)
def test_any_command_is_reached_in_a_few_decisions(limits):
    """No command traps the arm: 200 pairs of commands, half of them as strong as the arm can keep up."""
    frequency, acceleration = LIMITS[limits]
    rng = np.random.default_rng(5)
    slowest = 0
    for trial in range(200):
        two = np.column_stack(
            [rng.uniform(0, 1, 2), rng.uniform(0.5, frequency, 2), rng.uniform(0, np.pi / 2, 2)]
        )
        strongest = STEADY_SHARE * acceleration / two[:, 1] ** 2
        two[:, 0] = np.minimum(1.0, strongest) if trial % 2 else np.minimum(two[:, 0], strongest)
        _, attained = arm_motion(np.tile(two[1], (30, 1)), acceleration, start=two[0])
        arrived = np.isclose(attained, two[1], rtol=1e-12).all(axis=1)
        assert arrived.any()
        slowest = max(slowest, int(arrived.argmax()) + 1)
    assert slowest <= 20


def test_amplitude_is_cut_to_what_can_be_kept_up():
    _, attained = arm_motion(np.tile([1.0, 12.0, 0.5], (20, 1)), 25.0)
    assert attained[-1, 0] == pytest.approx(STEADY_SHARE * 25.0 / 144.0)
    np.testing.assert_allclose(attained[-1, 1:], [12.0, 0.5])


@pytest.mark.every(
    ("commands", "start", "message"),
    [
        ([1.0, 2.0, 3.0], CONSTANT, "shape"),
        ([[1.0, -2.0, 3.0]], CONSTANT, "not negative"),
        ([[1.0, np.nan, 3.0]], CONSTANT, "finite"),
        ([[1.0, 2.0, 3.0]], [1.0, 10.0, 0.0], "keeps up"),
    ],
)
def test_impossible_commands_are_refused(commands, start, message):
    with pytest.raises(ModelError, match=message):
        arm_motion(commands, 25.0, start=start)
