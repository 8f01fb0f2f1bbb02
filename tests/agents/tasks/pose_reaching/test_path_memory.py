"""The path memory: its worked example, its identity, its look-ups, and what its training data come from."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fieldagents.tasks.pose_reaching.path_memory.least_time import LeastTime, Resolution, Task
from fieldagents.tasks.pose_reaching.path_memory.lookup import FORMS
from fieldagents.tasks.pose_reaching.path_memory.matrices import (
    BEARING,
    DISTANCE,
    EXAMPLE_ANGLE,
    EXAMPLE_DISTANCE,
    Grid,
    combined,
    input_vector,
    lambdas,
    membership,
)
from fieldagents.tasks.pose_reaching.path_memory.memory import PathMemory, States
from fieldagents.tasks.pose_reaching.path_memory.own_data import OwnData, babble
from fieldagents.tasks.pose_reaching.path_memory.reading import (
    AS_IT_WORKS,
    AS_PRINTED,
    Reading,
    columns,
    measure,
    rounded_speed,
)
from fieldagents.tasks.pose_reaching.path_memory.regression import NeighbourMemory
from fieldagents.tasks.pose_reaching.path_memory.teachers import (
    graceful_path,
    shortest_path,
    starts_anywhere,
    starts_facing,
    taught,
)
from fieldmodels.machines.pose_reaching.parameters import GOAL_HEADING, STRICT

PI = math.pi
# Section 5.2.2: the nine states p_1,1 to p_3,3 as measured: d, theta, psi, v, omega.
EXAMPLE = np.array(
    [
        [3.2, -PI, -PI, 2, -PI],
        [2.4, -0.62 * PI, -0.88 * PI, 0.9, -0.86 * PI],
        [1.1, -0.1 * PI, -0.57 * PI, 0.2, -0.58 * PI],
        [3.6, 0.5 * PI, 0, 2.6, 0],
        [2.1, 0.2 * PI, -0.33 * PI, 1.7, -0.34 * PI],
        [0.8, 0, -0.49 * PI, 0.3, -0.48 * PI],
        [2.9, -0.77 * PI, 0.1 * PI, 2.2, 0.1 * PI],
        [1.5, -0.3 * PI, -0.43 * PI, 1.3, -0.42 * PI],
        [0.2, 0, -0.5 * PI, 0.4, -0.49 * PI],
    ]
)
PRINTED_M_D = np.array(
    [
        [0, 0, 0.25, 0.5, 0.25],
        [0, 0.25, 0.5, 0.25, 0],
        [0.25, 0.5, 0.25, 0, 0],
        [0, 0, 0, 0.25, 0.5],
        [0, 0.25, 0.5, 0.25, 0],
        [0.25, 0.5, 0.25, 0, 0],
        [0, 0, 0.25, 0.5, 0.25],
        [0, 0.25, 0.5, 0.25, 0],
        [0.5, 0.25, 0, 0, 0],
    ]
)
PRINTED_LAMBDA_THETA = [0, 0, 0, 0.3, 0.2, 0.1, 0.4, 0.3, 0.1]
PRINTED_LAMBDA_PSI = [0, 0, 0, 0.3, 0.1, 0.1, 0.5, 0.2, 0.1]


def tent(away):
    """What interpolation times (0.25, 0.5, 0.25) amounts to, of distances in columns."""
    return np.maximum(0.0, 0.5 - 0.25 * np.abs(away))


def test_omega_is_the_heading_in_the_goals_frame():
    """In all nine states omega is psi, the heading less that of the goal, within 0.02 pi.

    So it is neither a turn rate nor an angle "relative to the robot's present heading", which of a unicycle
    is about zero: it is the direction of the velocity in the goal's frame.
    """
    psi, omega = EXAMPLE[:, 2], EXAMPLE[:, 4]
    assert np.abs(omega - psi).max() <= 0.02 * PI + 1e-12
    assert np.ptp(omega) > PI  # no accident of small numbers


def test_worked_example_of_the_source():
    distance = EXAMPLE_DISTANCE.nearest(EXAMPLE[:, 0])
    np.testing.assert_array_equal(distance, [3, 2, 1, 4, 2, 1, 3, 2, 0])
    matrix = membership(distance, EXAMPLE_DISTANCE)
    np.testing.assert_array_equal(matrix, PRINTED_M_D)
    np.testing.assert_allclose(input_vector(3.2, EXAMPLE_DISTANCE), [0, 0, 0, 0.8, 0.2], atol=1e-12)
    (lambda_d,) = lambdas([matrix], [3.2], [EXAMPLE_DISTANCE])
    np.testing.assert_allclose(lambda_d, [0.45, 0.2, 0, 0.3, 0.2, 0, 0.45, 0.2, 0], atol=1e-12)
    product = combined([lambda_d, PRINTED_LAMBDA_THETA, PRINTED_LAMBDA_PSI])
    np.testing.assert_allclose(product, [0, 0, 0, 0.027, 0.004, 0, 0.09, 0.012, 0], atol=1e-12)
    assert np.argmax(product) == 6  # p_3,1
    assert rounded_speed(EXAMPLE[6:7, 3], "integers")[0] == 2
    assert EXAMPLE_ANGLE.values[EXAMPLE_ANGLE.nearest(EXAMPLE[6, 4])] == pytest.approx(PI / 10)


def test_the_examples_angles_round_as_printed():
    theta = EXAMPLE_ANGLE.values[EXAMPLE_ANGLE.nearest(EXAMPLE[:, 1])] / PI * 10
    psi = EXAMPLE_ANGLE.values[EXAMPLE_ANGLE.nearest(EXAMPLE[:, 2])] / PI * 10
    np.testing.assert_allclose(theta, [-10, -6, -1, 5, 2, 0, -8, -3, 0], atol=1e-9)
    np.testing.assert_allclose(psi, [-10, -9, -6, 0, -3, -5, 1, -4, -5], atol=1e-9)


def test_errata_of_the_worked_example():
    # Speeds have the values 0, 0.5, ... 3, and are rounded to integers nevertheless.
    np.testing.assert_array_equal(rounded_speed(EXAMPLE[:, 3], "integers"), [2, 1, 0, 3, 2, 0, 2, 1, 0])
    np.testing.assert_array_equal(rounded_speed(EXAMPLE[:, 3], "grid"), [2, 1, 0, 2.5, 1.5, 0.5, 2, 1.5, 0.5])
    # psi = theta - psi_f with psi_f = 90 degrees: two states of nine, and five when rounded.
    for states, holds in ((EXAMPLE, 2), (np.round(EXAMPLE / (PI / 10)) * (PI / 10), 5)):
        off = states[:, 1] - PI / 2 - states[:, 2]
        assert (np.abs((off + PI) % (2 * PI) - PI) < 1e-9).sum() == holds
    # No theta gives the printed lambda_theta, and no psi the printed lambda_psi.
    for column, printed in ((1, PRINTED_LAMBDA_THETA), (2, PRINTED_LAMBDA_PSI)):
        matrix = membership(EXAMPLE_ANGLE.nearest(EXAMPLE[:, column]), EXAMPLE_ANGLE)
        every = np.array([matrix @ input_vector(x, EXAMPLE_ANGLE) for x in np.linspace(-PI, PI, 2001)])
        assert np.abs(every - printed).max(axis=1).min() > 0.15
    assert len(BEARING.values) == 33  # "126 by 32"
    assert BEARING.values[-1] == pytest.approx(3.2)
    assert DISTANCE.values[-1] == pytest.approx(1.6)  # of 2.9 m to the corner of the field


@pytest.mark.every("grid", [EXAMPLE_DISTANCE, EXAMPLE_ANGLE, BEARING])
@given(data=st.data())
def test_lambda_is_a_tent(grid, data):
    """Interpolation of (0.25, 0.5, 0.25) is max(0, 0.5 - 0.25 |x - c| / h), on any grid."""
    column = data.draw(st.integers(0, grid.count - 1))
    span = grid.count if grid.periodic else grid.count - 1
    x = grid.low + grid.step * span * data.draw(st.floats(0, 1))
    away = (x - grid.low) / grid.step - column
    if grid.periodic:
        away = (away + grid.count / 2) % grid.count - grid.count / 2
    row = membership(np.array([column]), grid)
    assert (row @ input_vector(x, grid))[0] == pytest.approx(float(tent(away)), abs=1e-9)


GRIDS = {
    "simulation": (DISTANCE, BEARING),
    "with offset": (DISTANCE, EXAMPLE_ANGLE, EXAMPLE_ANGLE),
    "without clamp": (replace(DISTANCE, clamp=False), EXAMPLE_ANGLE),
}


@pytest.mark.every("grids", GRIDS.values())
@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    states=st.integers(1, 60),
    fallback=st.sampled_from(["nearest", "stop", "first"]),
    ties=st.sampled_from(["first", "last"]),
    decimals=st.sampled_from([1, 2, 12]),  # coarse values make ties
)
def test_all_forms_give_the_same_winner(grids, seed, states, fallback, ties, decimals):
    rng = np.random.default_rng(seed)
    remembered = np.stack([rng.integers(0, grid.count, states) for grid in grids], axis=1)
    spans = [(grid.low - 0.5, grid.low + grid.count * grid.step + 0.5) for grid in grids]
    measured = np.stack([rng.uniform(*span, 12) for span in spans], axis=1).round(decimals)
    dense, *others = (form(remembered, grids, fallback, ties).winners(measured) for form in FORMS.values())
    for winners in others:
        np.testing.assert_array_equal(winners, dense)


def test_a_lookup_gives_the_largest_lambda():
    rng = np.random.default_rng(0)
    inputs = np.stack([rng.uniform(0.1, 1.6, 40), rng.uniform(0, PI, 40)], axis=1)
    grids = (DISTANCE, BEARING)
    remembered = columns(inputs, grids)
    values = np.stack([g.values[remembered[:, i]] for i, g in enumerate(grids)], axis=1)
    measured = np.stack([rng.uniform(0.1, 1.6, 500), rng.uniform(0, PI, 500)], axis=1)
    score = tent((measured[:, None] - values) / 0.1).prod(axis=2)
    winners = FORMS["table"](remembered, grids, "stop").winners(measured)
    np.testing.assert_array_equal(winners < 0, score.max(axis=1) < 1e-12)
    won = winners >= 0
    np.testing.assert_allclose(score[won, winners[won]], score[won].max(axis=1), atol=1e-12)
    assert 50 < won.sum() < 450


def test_what_answers_where_every_lambda_is_zero():
    grids = (DISTANCE, BEARING)
    remembered = np.array([[2, 3], [9, 20], [9, 28]])
    far = np.array([[1.1, 2.5]])
    for form in FORMS.values():
        assert form(remembered, grids, "stop").winners(far)[0] == -1
        assert form(remembered, grids, "first").winners(far)[0] == 0
        assert form(remembered, grids, "nearest").winners(far)[0] == 2


def test_a_periodic_grid_has_no_ends():
    grids = (DISTANCE, EXAMPLE_ANGLE)
    remembered = np.array([[5, 0], [5, 10]])  # headings -pi and 0
    below_pi = np.array([[0.6, 0.97 * PI]])
    assert FORMS["table"](remembered, grids, "stop").winners(below_pi)[0] == 0
    cut = (DISTANCE, replace(EXAMPLE_ANGLE, periodic=False))
    assert FORMS["table"](remembered, cut, "stop").winners(below_pi)[0] == -1


@pytest.mark.every(
    ("wrong", "message"),
    [
        (lambda: Grid(0.0, 0.1, 33, periodic=True), "full turn"),
        (lambda: Grid(0.0, -1.0, 3), "positive step"),
        (lambda: FORMS["table"](np.zeros((3, 1)), (DISTANCE, BEARING)), "shape"),
        (lambda: FORMS["table"](np.array([[16, 0]]), (DISTANCE, BEARING)), "column"),
        (lambda: FORMS["tree"](np.array([[0]]), (Grid(0, 1e-9, 10**9),)), "too fine"),
        (lambda: PathMemory(taught("dubins", starts_facing(1)), form="magic"), "dense, sparse, table, tree"),
        (lambda: OwnData().commands(np.zeros((1, 3))), "nothing has been learned"),
    ],
)
def test_what_cannot_be_is_refused(wrong, message):
    with pytest.raises(ValueError, match=message):
        wrong()


def test_bearing_runs_from_below_by_the_right_to_above():
    poses = np.array([[0, -1, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0]], dtype=float)
    inputs, side = measure(poses, AS_IT_WORKS)
    np.testing.assert_allclose(inputs[:, 1], [0, PI / 2, PI, PI / 2])
    np.testing.assert_array_equal(side, [1, 1, 1, -1])
    np.testing.assert_allclose(inputs[:, 0], 1)


@pytest.mark.every("reading", [AS_IT_WORKS, AS_PRINTED, replace(AS_IT_WORKS, offset=True)])
@given(
    x=st.floats(0.01, 2.5), y=st.floats(-1.5, 1.5), heading=st.floats(-3.1, 3.1)
)  # fmt: skip
def test_the_left_half_is_the_right_one_mirrored(reading, x, y, heading):
    memory = PathMemory(taught("dubins", starts_facing(5)), reading)
    right, first = memory.commands(np.array([[x, y, heading]]), 0.1)
    left, second = memory.commands(np.array([[-x, y, PI - heading]]), 0.1)
    assert first == second
    np.testing.assert_allclose(left[0, 0], right[0, 0])
    turn = left[0, 1] + right[0, 1]
    if reading.command == "direction":  # half a turn may go either way
        turn = (turn * 0.1 + PI) % (2 * PI) - PI
    assert abs(turn) < 1e-6


def test_every_rule_changes_something():
    """No switch is a dummy: each makes another decision somewhere on the field."""
    states = taught("graceful", starts_facing(9))
    rng = np.random.default_rng(0)
    distance, around, heading = rng.uniform((0, -PI, -PI), (2, PI, PI), (1000, 3)).T
    poses = np.stack([distance * np.cos(around), distance * np.sin(around), heading], axis=1)
    usual = PathMemory(states, AS_IT_WORKS).commands(poses, 0.1)[0]
    for change in (
        {"theta": "heading", "angle": EXAMPLE_ANGLE},
        {"offset": True},
        {"command": "rate"},
        {"mirror": False},
        {"wrap": False},
        {"clamp": False},
        {"ties": "last"},
        {"fallback": "stop"},
        {"fallback": "first"},
        {"speed": "grid"},
        {"speed": "integers"},
    ):
        other = PathMemory(states, replace(AS_IT_WORKS, **change)).commands(poses, 0.1)[0]
        assert not np.allclose(other, usual), change


@pytest.mark.every("drive", [graceful_path, shortest_path])
def test_a_teacher_arrives(drive):
    for start in [*starts_facing(9), *starts_anywhere(20, np.random.default_rng(0))]:
        path = drive(start)
        assert np.hypot(*path[-1, :2]) < 0.012
        off = (path[-1, 2] - GOAL_HEADING + PI) % (2 * PI) - PI
        assert abs(off) < math.radians(10)
        assert np.abs(np.diff(path[:, 2])).max() <= 4.0 * 0.002 + 1e-9  # the robot can turn that fast
        assert np.hypot(*np.diff(path[:, :2], axis=0).T).max() <= 0.002 + 1e-9


def test_training_paths_start_as_the_source_says():
    starts = starts_facing(9)
    x, y, heading = starts.T
    assert (x > -1e-12).all()  # right half
    np.testing.assert_allclose(np.cos(heading - np.arctan2(-y, -x)), 1)  # facing the ball
    assert (np.hypot(x, y) <= 1.6 + 1e-12).all()
    assert (np.abs(y) < 1.5).all()
    states = taught("graceful", starts)
    assert len(states) == 126
    assert [len(path) for path in states.paths] == [14] * 9


def test_what_is_remembered_drives_the_same_way():
    """Obeying a remembered state for its tick ends where the teacher was a tick later."""
    states = taught("dubins", starts_facing(4), points=10, tick=0.1)
    for i in range(len(states)):
        path = shortest_path(starts_facing(4)[states.path[i]])
        at = np.argmin(np.hypot(*(path[:, :2] - states.poses[i, :2]).T))
        after = path[min(at + 50, len(path) - 1)]
        turned = states.poses[i, 2] + states.rate[i] * 0.002 * (min(at + 50, len(path) - 1) - at)
        assert turned == pytest.approx(after[2], abs=1e-9) == states.direction[i]


def test_hindsight_by_the_book():
    """The compiled table equals a plain loop over all pairs of a drive."""
    rng = np.random.default_rng(0)
    ticks, tick = 60, 0.1
    commands = babble(ticks, 1, rng, tick, 1.0, 4.0)[:, 0]
    poses = np.zeros((ticks + 1, 3))
    for k, (speed, rate) in enumerate(commands):
        heading = poses[k, 2] + rate * tick / 2
        poses[k + 1] = poses[k] + tick * np.array([speed * np.cos(heading), speed * np.sin(heading), rate])
    free = np.ones(ticks, dtype=bool)
    free[30] = False
    table = OwnData()
    table.add(poses, commands, free, tick)
    best: dict[tuple[int, ...], float] = {}
    for goal in range(1, ticks + 1):
        for k in range(goal):
            if not free[k:goal].all():
                continue
            turn = PI / 2 - poses[goal, 2]
            rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
            x, y = rotation @ (poses[k, :2] - poses[goal, :2])
            heading = poses[k, 2] + turn
            if x < 0:
                x, heading = -x, PI - heading
            key = int(x / 0.1), math.floor((y + 1.5) / 0.1), math.floor((heading % (2 * PI)) / (PI / 18)) % 36
            best[key] = min(best.get(key, np.inf), (goal - k) * tick)
    known = {tuple(key): table.time[tuple(key)] for key in np.argwhere(np.isfinite(table.time)).tolist()}
    assert len(known) > 200
    assert known == pytest.approx(best)


def test_more_drives_never_make_a_way_longer():
    rng = np.random.default_rng(1)
    table = OwnData()
    before = table.time.copy()
    for _ in range(3):
        poses = rng.uniform(-1, 1, (40, 3))
        table.add(poses, rng.uniform(0, 1, (39, 2)), np.ones(39, dtype=bool), 0.1)
        assert (table.time <= before).all()
        before = table.time.copy()
    assert 0 < table.share < 1
    assert np.isfinite(table.commands(rng.uniform(-3, 3, (50, 3)))).all()


def test_neighbours_give_back_what_they_remember():
    states = taught("dubins", starts_anywhere(20, np.random.default_rng(0)))
    commands, chosen = NeighbourMemory(states).commands(states.poses)
    np.testing.assert_array_equal(chosen, np.arange(len(states)))
    np.testing.assert_allclose(commands, np.stack([states.speed, states.rate], axis=1))


def test_locally_weighted_regression_is_exact_for_a_plane():
    """Commands that are linear in position come out right between the remembered states."""
    rng = np.random.default_rng(0)
    poses = np.stack([rng.uniform(0.5, 1.5, 400), rng.uniform(-0.5, 0.5, 400), np.full(400, 1.0)], axis=1)
    states = States(
        poses, 0.3 + 0.2 * poses[:, 0], poses[:, 1] * 2, poses[:, 2], np.zeros(400, dtype=np.int64)
    )
    asked = np.stack([rng.uniform(0.7, 1.3, 50), rng.uniform(-0.3, 0.3, 50), np.full(50, 1.0)], axis=1)
    found = NeighbourMemory(states, 12).commands(asked)[0]
    nearest = NeighbourMemory(states, 1).commands(asked)[0]
    truth = np.stack([0.3 + 0.2 * asked[:, 0], asked[:, 1] * 2], axis=1)
    assert np.abs(found - truth).mean() < 0.25 * np.abs(nearest - truth).mean()


@pytest.fixture(scope="module")
def solved():
    return LeastTime(Task(STRICT), Resolution(32, 19, 36))


def test_least_time_of_what_is_known(solved):
    """Straight up to the ball takes d - 0.05 m, turning on the spot beside it the angle less 10 deg."""
    straight = np.array([[0.0, -d, PI / 2] for d in (0.3, 0.6, 1.0, 1.4)])
    np.testing.assert_allclose(solved.from_poses(straight), [0.25, 0.55, 0.95, 1.35], rtol=0.03)
    turn = np.array([[0.0, -0.02, PI / 2 + a] for a in (1.0, 2.0, 3.0, -2.0)])
    expected = (np.array([1.0, 2.0, 3.0, 2.0]) - math.radians(10)) / 4
    np.testing.assert_allclose(solved.from_poses(turn), expected, atol=0.05)
    assert solved.from_poses(np.array([[0.01, 0.0, PI / 2]]))[0] == pytest.approx(0.0, abs=1e-6)


def test_least_time_is_never_below_distance_and_is_mirrored(solved):
    poses = starts_anywhere(2000, np.random.default_rng(0))
    times = solved.from_poses(poses)
    assert (times > np.hypot(poses[:, 0], poses[:, 1]) - 0.05).mean() > 0.995
    mirrored = poses * [-1, 1, -1] + [0, 0, PI]
    np.testing.assert_allclose(solved.from_poses(mirrored), times, rtol=1e-9)


def test_a_reading_keeps_grids_of_less_than_a_turn_open():
    assert [grid.periodic for grid in Reading().grids] == [False, False]
    assert [grid.periodic for grid in AS_PRINTED.grids] == [False, True, True]
    assert [grid.periodic for grid in replace(AS_PRINTED, wrap=False).grids] == [False, False, False]
