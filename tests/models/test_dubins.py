"""Dubins' shortest paths: ends, symmetries, limits, known cases, and a search over controls."""

import itertools
import math
from contextlib import suppress

import numpy as np
import pytest

from fieldmodels.machines.pose_reaching.dubins import WORDS, dubins_path
from fieldmodels.model import ModelError

RADIUS = 0.3


def dubins_lengths(starts, goals, radius):
    """Lengths of the shortest paths between pairs of poses, of the broadcast shape."""
    pairs = np.broadcast_arrays(np.asarray(starts, float), np.asarray(goals, float))
    lengths = [
        dubins_path(*pair, radius).length for pair in zip(*(p.reshape(-1, 3) for p in pairs), strict=True)
    ]
    return np.reshape(lengths, pairs[0].shape[:-1])


def poses(count: int, seed: int, spread: float = 2.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(-spread, spread, (count, 2)), rng.uniform(-7.0, 7.0, count)])


def test_every_word_ends_at_the_goal_and_every_word_is_sometimes_the_shortest():
    seen = set()
    for start, goal in zip(poses(1500, 0, 0.8), poses(1500, 1, 0.8), strict=True):
        path = dubins_path(start, goal, RADIUS)
        seen.add(path.word)
        end = path.at([path.length])[0] - goal
        assert np.hypot(*end[:2]) < 1e-9
        assert abs(math.remainder(end[2], 2 * math.pi)) < 1e-9
    assert seen == set(WORDS)


def test_each_word_alone_ends_at_the_goal():
    # The shortest path hides a wrong word that is longer than it should be; so each is driven by itself.
    for start, goal in zip(poses(300, 2, 0.6), poses(300, 3, 0.6), strict=True):
        paths = []
        for word in WORDS:
            with suppress(ModelError):  # without a path by this word
                paths.append(dubins_path(start, goal, RADIUS, word))
        assert len(paths) >= 3
        for path in paths:
            end = path.at([path.length])[0] - goal
            assert np.hypot(*end[:2]) < 1e-7, path
            assert abs(math.remainder(end[2], 2 * math.pi)) < 1e-7


def test_symmetries():
    starts, goals = poses(2000, 6), poses(2000, 7)
    lengths = dubins_lengths(starts, goals, RADIUS)
    mirror = np.array([1.0, -1.0, -1.0])
    assert dubins_lengths(starts * mirror, goals * mirror, RADIUS) == pytest.approx(lengths, abs=1e-9)
    back = np.array([0.0, 0.0, math.pi])  # driven backwards, a path turned around
    assert dubins_lengths(goals + back, starts + back, RADIUS) == pytest.approx(lengths, abs=1e-9)
    assert dubins_lengths(starts * [2, 2, 1], goals * [2, 2, 1], 2 * RADIUS) == pytest.approx(2 * lengths)
    c, s = math.cos(0.7), math.sin(0.7)
    turned = [p @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + [1.0, 2.0, 0.7] for p in (starts, goals)]
    assert dubins_lengths(*turned, RADIUS) == pytest.approx(lengths, abs=1e-9)


def test_never_shorter_than_the_straight_line_or_the_turn_and_nearly_straight_when_far():
    starts, goals = poses(5000, 8, 5.0), poses(5000, 9, 5.0)
    lengths = dubins_lengths(starts, goals, RADIUS)
    straight = np.hypot(*(goals - starts).T[:2])
    turn = np.abs(np.remainder(goals[:, 2] - starts[:, 2] + np.pi, 2 * np.pi) - np.pi)
    assert (lengths >= straight - 1e-12).all()
    assert (lengths >= RADIUS * turn - 1e-9).all()
    # The bound of Savla, Frazzoli and Bullo (On the point-to-point and traveling salesperson problems for
    # Dubins' vehicle, 2005): no pair of headings costs more than 2.658 half circles.
    assert (lengths <= straight + 2.658 * np.pi * RADIUS).all()
    assert dubins_lengths(starts, goals, 1e-6) == pytest.approx(straight, abs=1e-4)


@pytest.mark.every(
    ("start", "goal", "length"),
    [
        ((0, 0, 1.0), (0, 0, 1.0), 0.0),
        ((-1, -1, math.pi / 4), (2, 2, math.pi / 4), math.hypot(3, 3)),
        ((0, 0, 0), (0, 2, math.pi), math.pi),  # a half circle
        ((0, 0, 0), (1, 1, math.pi / 2), math.pi / 2),  # a quarter
        ((0, 0, 0), (0, 0, math.pi), 7 * math.pi / 3),  # turn on the spot: 60 + 300 + 60 degrees
        ((0, 0, 0), (0, 4, 0), 2 * math.pi),  # an S of two half circles that touch
        ((0, 0, 0), (-4, 0, 0), 2 * math.pi + 4),  # around, back along, around
        ((0, 0, 0), (0, -4, math.pi), math.pi + 2),  # half circle, straight, half circle
    ],
)
def test_known_cases(start: tuple[float, ...], goal: tuple[float, ...], length: float):
    assert dubins_lengths(start, goal, 1.0) == pytest.approx(length, abs=1e-9)


def test_rounding_never_adds_a_circle():
    # Goals that lie exactly ahead, on an arc or on a straight line: any turn may come out as -1e-16.
    for pose in poses(300, 10):
        for word in ("S", "L", "R"):
            path = np.array({"S": (0.0, 1.0), "L": (1.0, 1.0), "R": (-1.0, 1.0)}[word])
            heading = pose[2] + path[0] * 1.0 / RADIUS * 0.3
            if word == "S":
                goal = pose + np.array([np.cos(pose[2]), np.sin(pose[2]), 0.0])
                wanted = 1.0
            else:
                side = path[0]
                goal = np.array(
                    [
                        pose[0] + side * RADIUS * (np.sin(heading) - np.sin(pose[2])),
                        pose[1] - side * RADIUS * (np.cos(heading) - np.cos(pose[2])),
                        heading,
                    ]
                )
                wanted = 0.3
            assert dubins_lengths(pose, goal, RADIUS) == pytest.approx(wanted, abs=1e-6)


def test_no_sequence_of_turns_and_straights_is_shorter():
    # All paths of four segments on a grid of lengths, each with any of the three controls: where such a
    # path ends, the shortest path is no longer than it.
    rng = np.random.default_rng(11)
    controls = np.array(list(itertools.product((-1.0, 0.0, 1.0), repeat=4)))
    chosen = controls[rng.integers(len(controls), size=20000)]
    parts = rng.uniform(0.0, 1.2, (20000, 4)) * rng.integers(0, 2, (20000, 4))
    pose = np.zeros((20000, 3))
    for k in range(4):
        turn = chosen[:, k] * parts[:, k] / RADIUS
        with np.errstate(invalid="ignore"):
            chord = np.where(turn == 0, 1.0, np.sin(turn / 2) / (turn / 2))
        pose[:, 0] += parts[:, k] * chord * np.cos(pose[:, 2] + turn / 2)
        pose[:, 1] += parts[:, k] * chord * np.sin(pose[:, 2] + turn / 2)
        pose[:, 2] += turn
    lengths = dubins_lengths(np.zeros(3), pose, RADIUS)
    assert (lengths <= parts.sum(axis=1) + 1e-7).all()


def test_samples_are_even_and_reach_both_ends():
    path = dubins_path((1.0, -0.5, 2.0), (0.0, 0.0, math.pi / 2), RADIUS)
    points = path.sampled(0.05)
    assert points[0] == pytest.approx([1.0, -0.5, 2.0])
    assert points[-1, :2] == pytest.approx([0.0, 0.0], abs=1e-9)
    gaps = np.hypot(*np.diff(points, axis=0).T[:2])
    assert gaps.max() <= 0.05
    assert gaps.min() > 0.98 * path.length / (len(points) - 1)
    assert np.abs(np.diff(points[:, 2])).max() <= 0.05 / RADIUS + 1e-12
    assert path.at([-1.0, 1e9]) == pytest.approx(points[[0, -1]])


def test_bad_input_is_named():
    with pytest.raises(ModelError, match="a pose is"):
        dubins_path([0.0, 1.0], [0, 0, 0], RADIUS)
    with pytest.raises(ModelError, match="a pose is"):
        dubins_path([0.0, 1.0, np.nan], [0, 0, 0], RADIUS)
    with pytest.raises(ModelError, match="radius"):
        dubins_path([0.0, 1.0, 0.0], [0, 0, 0], 0.0)
    with pytest.raises(ModelError, match="word"):
        dubins_path([0.0, 1.0, 0.0], [0, 0, 0], RADIUS, "LLL")
