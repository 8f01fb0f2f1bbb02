import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fieldmodels.machines.line_following.tracks import (
    TRACKS,
    from_points,
    nearest,
    oval,
    point_at,
    read_track,
)
from fieldmodels.model import ModelError


@pytest.mark.every("name", TRACKS)
def test_points_are_evenly_spaced_and_tangents_follow_them(name):
    track = TRACKS[name]()
    points = np.vstack([track.points, track.points[:1]]) if track.closed else track.points
    steps = np.diff(points, axis=0)
    assert np.allclose(np.hypot(*steps.T), track.spacing, rtol=1e-5)
    directions = steps / track.spacing
    assert (np.einsum("ij,ij->i", directions, track.table[: len(steps), 2:]) > 0.9999).all()


def test_oval_turns_with_nine_metres():
    track = oval()
    heading = np.unwrap(np.arctan2(track.table[:, 3], track.table[:, 2]))
    turns = np.diff(heading) / track.spacing
    assert np.isclose(turns.max(), 1 / 9, rtol=1e-6)
    assert np.isclose(heading[-1] + turns[0] * track.spacing, 2 * math.pi, atol=1e-9)
    assert np.isclose(track.length, 20 + 18 * math.pi)


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(list(TRACKS)), st.floats(1, 55), st.floats(-0.8, 0.8), st.floats(-0.7, 0.7))
def test_nearest_point_is_the_foot_of_the_perpendicular(name, arc, offset, guess):
    track = TRACKS[name]()
    x, y, heading = track.at(arc)
    x, y = x - offset * math.sin(heading), y + offset * math.cos(heading)
    found, away, _, _ = nearest(track.table, track.spacing, track.closed, x, y, arc + guess)
    assert abs(away - offset) < 1e-4
    assert abs(found - arc) < 2e-3


def test_robot_stays_on_its_branch_where_the_line_meets_itself():
    track = TRACKS["figure_eight"]()
    turn = 18 * math.pi
    for arc in (turn - 0.4, turn + 0.4):
        x, y, _ = track.at(arc)
        found, _, _, _ = nearest(track.table, track.spacing, track.closed, x, y, arc - 0.5)
        assert abs(found - arc) < 1e-3


def test_a_winding_line_turns_as_its_number_says_and_never_sharper_than_the_s():
    lines = [read_track(f"winding_{number}") for number in range(20)]
    assert np.array_equal(read_track("winding_7").table, lines[7].table)
    for line in lines:
        bends = line.bends
        assert line.length > 100.0
        assert not line.closed
        assert np.abs(bends).max() < 1.01 / 9
        lasting = np.diff(np.flatnonzero(np.diff(bends.round(6)) != 0)) * line.spacing
        assert lasting[lasting > 0.3].min() > 1.5  # pieces of two metres and more
    spread = np.concatenate([line.bends for line in lines])
    assert abs(spread.mean()) < 0.02  # as often one way as the other
    assert 0.06 < spread.std() < 0.1
    with pytest.raises(ModelError, match="no track 'winding_'"):
        read_track("winding_")


def test_open_line_goes_on_straight_and_closed_line_begins_again():
    line = from_points([(0, 0), (1, 0), (2, 0)])
    assert np.allclose(point_at(line.table, line.spacing, False, 5.0), (5, 0, 1, 0))
    assert np.allclose(point_at(line.table, line.spacing, False, -1.0), (-1, 0, 1, 0))
    round_track = oval()
    assert np.allclose(
        point_at(round_track.table, round_track.spacing, True, 3.0 + round_track.length),
        point_at(round_track.table, round_track.spacing, True, 3.0),
    )


def test_own_polyline_is_smooth_and_keeps_its_corners(tmp_path):
    angle = np.linspace(0, 2 * math.pi, 25)
    file = tmp_path / "ring.csv"
    rows = "\n".join(f"{5 * math.cos(a)!r},{5 * math.sin(a)!r}" for a in angle[:-1])
    file.write_text(f"x,y\n{rows}\n5.0,0.0\n")
    track = read_track(file)
    assert track.closed
    assert track.name == "ring"
    assert np.allclose(np.hypot(*track.points.T), 5, atol=2e-4)
    assert np.isclose(track.length, 10 * math.pi, rtol=1e-4)


@pytest.mark.every(
    ("content", "message"),
    [
        ("x,z\n1,2\n", "column 'y' is missing"),
        ("x,y\n1,2\n3,oak\n", "line 3 holds no pair of numbers"),
        ("x,y\n1,2\n", "at least two points"),
        ("x,y\n1,2\n1,2\n3,4\n", "points 0 and 1 coincide"),
    ],
)
def test_bad_track_file_is_named(tmp_path, content, message):
    file = tmp_path / "track.csv"
    file.write_text(content)
    with pytest.raises(ModelError, match=message) as error:
        read_track(file)
    assert "track.csv" in str(error.value)


def test_unknown_track_gets_a_suggestion():
    with pytest.raises(ModelError, match="did you mean 'oval'"):
        read_track("ovla")
    with pytest.raises(ModelError, match="no such track file"):
        read_track("nowhere.csv")
