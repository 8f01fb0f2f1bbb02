"""The unicycle: exact arcs, walls, arrival, wheels."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fieldmodels.compiled import compiled
from fieldmodels.machines.pose_reaching import unicycle
from fieldmodels.machines.pose_reaching.parameters import STRICT, WARTHOG, Field


@compiled
def drive(poses: np.ndarray, distances: np.ndarray, turns: np.ndarray, steps: int) -> np.ndarray:
    result = np.empty((len(poses), 4))
    for i in range(len(poses)):
        x, y = poses[i, 0], poses[i, 1]
        c, s = math.cos(poses[i, 2]), math.sin(poses[i, 2])
        for _ in range(steps):
            x, y, c, s = unicycle.arc(x, y, c, s, distances[i], turns[i])
        result[i, 0], result[i, 1], result[i, 2], result[i, 3] = x, y, c, s
    return result


@compiled
def near_walls(starts: np.ndarray, ends: np.ndarray, slide: bool) -> tuple[np.ndarray, np.ndarray]:
    places, hits = np.empty_like(ends), np.zeros(len(ends), dtype=np.bool_)
    for i in range(len(ends)):
        if slide:
            x, y, hit = unicycle.slid_along_walls(ends[i, 0], ends[i, 1], 2.5, 1.5)
        else:
            x, y, hit = unicycle.stopped_by_walls(
                starts[i, 0], starts[i, 1], ends[i, 0], ends[i, 1], 2.5, 1.5
            )
        places[i, 0], places[i, 1], hits[i] = x, y, hit
    return places, hits


@compiled
def shares(poses: np.ndarray, distance: float, turn: float, substeps: int) -> np.ndarray:
    result = np.empty(len(poses))
    for i in range(len(poses)):
        c, s = math.cos(poses[i, 2]), math.sin(poses[i, 2])
        result[i] = unicycle.arrival_share(
            poses[i, 0], poses[i, 1], c, s, distance, 0.0, turn, 0.05, math.cos(math.radians(10)), substeps
        )
    return result


def test_arcs_are_exact_at_every_turn_rate():
    # Against 40 digits would be the same: the chord's closed form in long double.
    turns = np.concatenate([[0.0], np.geomspace(1e-300, 20.0, 2000)])
    turns = np.concatenate([turns, -turns])
    distances = np.full_like(turns, 0.05)
    heading = 0.3
    result = drive(np.tile([0.0, 0.0, heading], (len(turns), 1)), distances, turns, 1)
    half = turns.astype(np.longdouble) / 2
    chord = np.longdouble(0.05) * np.where(half == 0, 1, np.sin(half) / np.where(half == 0, 1, half))
    assert np.abs(result[:, 0] - chord * np.cos(heading + half)).max() < 1e-15
    assert np.abs(result[:, 1] - chord * np.sin(heading + half)).max() < 1e-15
    assert np.abs(result[:, 2] - np.cos(heading + 2 * half)).max() < 4e-15
    assert np.abs(result[:, 3] - np.sin(heading + 2 * half)).max() < 4e-15


def test_arcs_against_an_independent_integrator():
    rng = np.random.default_rng(0)
    for _ in range(10):
        speed, rate, pose = rng.uniform(0, 1), rng.uniform(-4, 4), rng.uniform(-1, 1, 3)
        truth = solve_ivp(
            lambda _t, p, v=speed, w=rate: [v * np.cos(p[2]), v * np.sin(p[2]), w],
            (0, 2.0),
            pose,
            rtol=1e-12,
            atol=1e-13,
        ).y[:, -1]
        driven = unicycle.advance(pose[None], np.array([speed]), np.array([rate]), 2.0)[0]
        assert driven[:2] == pytest.approx(truth[:2], abs=1e-10)
        assert math.remainder(driven[2] - truth[2], 2 * math.pi) == pytest.approx(0, abs=1e-10)
        assert -math.pi < driven[2] <= math.pi


def test_many_small_arcs_make_one_large_one():
    pose = np.array([[0.2, -0.3, 1.0]])
    many = drive(pose, np.array([0.01]), np.array([0.04]), 5000)
    once = drive(pose, np.array([50.0]), np.array([200.0]), 1)
    assert many[0] == pytest.approx(once[0], abs=1e-11)
    assert np.hypot(many[0, 2], many[0, 3]) == pytest.approx(1.0, abs=5000 * 2.2e-16)


def test_wrapped_angles():
    angles = np.array([0.0, 3.0, -3.0, math.pi, -math.pi, 3 * math.pi, 100.0, -100.0])
    for angle in angles:
        wrapped = unicycle.wrapped(angle)
        assert -math.pi < wrapped <= math.pi
        assert math.remainder(wrapped - angle, 2 * math.pi) == pytest.approx(0, abs=1e-12)


def test_walls_hold_whatever_comes():
    rng = np.random.default_rng(1)
    field = Field()
    half = np.array([field.length, field.width]) / 2
    starts = rng.uniform(-half, half, (20000, 2))
    ends = starts + rng.uniform(-2, 2, (20000, 2))
    outside = (np.abs(ends) > half).any(axis=1)
    for slide in (False, True):
        places, hits = near_walls(starts, ends, slide)
        assert (hits == outside).all()
        assert (np.abs(places) <= half).all()
        assert (places[~hits] == ends[~hits]).all()
        assert (np.isclose(np.abs(places[hits]), half, atol=1e-12).any(axis=1)).all()
    # Stopped: still on the chord. Sliding: what leads along the wall is kept.
    stopped, hits = near_walls(starts, ends, False)
    along, chord = stopped[hits] - starts[hits], (ends - starts)[hits]
    assert np.abs(along[:, 0] * chord[:, 1] - along[:, 1] * chord[:, 0]).max() < 1e-12
    slid, _ = near_walls(starts, ends, True)
    free = np.abs(ends) <= half
    assert (slid[free] == ends[free]).all()


def test_arrival_needs_place_and_heading_at_one_instant():
    up, tilted = math.pi / 2, math.pi / 2 + math.radians(10.5)
    # Drives 0.2 m in a step: through the circle, which neither end of the step lies in.
    poses = np.array(
        [[0.0, -0.101, up], [0.049, -0.1, up], [0.051, -0.1, up], [0.0, -0.1, tilted], [1.0, 1.0, up]]
    )
    found = shares(poses, 0.2, 0.0, 40)
    assert 0.255 < found[0] <= 0.255 + 1 / 40 + 1e-9
    assert found[1] < 1.0
    assert (found[2:] == 2.0).all()
    # Turning on the spot: arrived as soon as the heading is right, not when it is right no more.
    spot = shares(np.array([[0.02, 0.02, up - math.radians(30.0)]]), 0.0, math.radians(60.0), 60)
    assert spot[0] == pytest.approx(20 / 60, abs=1 / 60 + 1e-9)
    assert (STRICT.distance, math.degrees(STRICT.angle)) == pytest.approx((0.05, 10.0))


def test_wheels_and_body_are_inverse_and_turn_the_right_way():
    left, right = unicycle.wheel_speeds(0.7, 1.3, WARTHOG.radius, WARTHOG.track)
    assert right > left  # turns left, counter-clockwise
    assert unicycle.body_speeds(left, right, WARTHOG.radius, WARTHOG.track) == pytest.approx((0.7, 1.3))
    # On the spot the wheels run against each other, each at half the track times the rate.
    assert unicycle.wheel_speeds(0.0, 2.0, 0.1, 0.5) == pytest.approx((-5.0, 5.0))
