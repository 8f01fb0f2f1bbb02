import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fieldmodels.machines.line_following.firmware import calibrate, centroid, line_position
from fieldmodels.machines.line_following.parameters import TAPES, Camera, Exposure, Lighting, Tape
from fieldmodels.machines.line_following.renderer import Renderer, make_view
from fieldmodels.machines.line_following.sensor import make_optics, see_line
from fieldmodels.machines.line_following.tracks import TRACKS, straight
from fieldmodels.model import ModelError

CAMERA = Camera()
THRESHOLD = Exposure().threshold


def test_band_sees_the_floor_a_metre_ahead():
    # by hand: rows 40 and 79 lie 6.48 degrees above and below the axis, which looks down by 45 degrees
    assert np.isclose(CAMERA.distance(40), 1 / math.tan(math.radians(45 - 6.484)), rtol=1e-4)
    assert np.isclose(CAMERA.distance(79), 1 / math.tan(math.radians(45 + 6.484)), rtol=1e-4)
    assert np.isclose(CAMERA.look_ahead, 1.0, atol=1e-9)
    assert np.isclose(CAMERA.metres_per_pixel, math.sqrt(2) / CAMERA.focal)


def test_levels_are_those_of_figure_3_13():
    image = Renderer(straight(), CAMERA).image((20, 0.0, 0.0), 20, 1)
    assert 25 <= np.median(image[40:80, 79:81]) <= 45
    assert 160 <= np.median(image) <= 170


@pytest.mark.every("name", ["straight", "s", "oval"])
def test_centroid_of_images_agrees_with_geometry_within_a_millimetre(name):
    track, rng, errors = TRACKS[name](), np.random.default_rng(1), []
    renderer, optics = Renderer(track, CAMERA), make_optics(CAMERA)
    for k in range(400):
        arc, offset = rng.uniform(5, 55), rng.uniform(-0.3, 0.3)
        x, y, along = track.at(arc)
        x, y = x - offset * math.sin(along), y + offset * math.cos(along)
        heading = along + rng.uniform(-0.2, 0.2)
        seen, found = line_position(renderer.image((x, y, heading), arc, k), CAMERA, THRESHOLD)
        meant, there = see_line(
            track.table, track.spacing, track.closed, TAPES["duvetyne"].width, x, y,
            math.cos(heading), math.sin(heading), arc, 0.0, CAMERA.height, optics,
        )  # fmt: skip
        if found and there:
            errors.append(seen - meant)
    assert len(errors) > 350
    assert np.std(errors) < 1e-3
    assert abs(np.mean(errors)) < 2e-4


@pytest.mark.every("error", [-0.05, 0.0, 0.08])
def test_a_camera_pitched_down_sees_nearer_ground(error):
    """The centroid of a line that runs askew, by a pinhole camera of its own that looks row by row."""
    track, heading, offset = straight(), 0.15, 0.05
    pitch = CAMERA.pitch + error
    rows = np.linspace(CAMERA.first_row, CAMERA.last_row, 4001) + 0.0
    below = pitch + np.arctan((rows - CAMERA.rows / 2) / CAMERA.focal)  # the ray's angle below the horizon
    ahead = CAMERA.height / np.tan(below)
    depth = np.hypot(CAMERA.height, ahead) * np.cos(below - pitch)
    # The line y = 0 seen from (0, offset) under a heading: where it crosses the floor's row at ahead.
    beside = -(offset + ahead * math.sin(heading)) / math.cos(heading)
    weight = 1 / depth  # tape looks narrower far away
    centroid = np.sum(weight * CAMERA.focal * beside / depth) / np.sum(weight)
    x, y, along = track.at(20.0)
    place, found = see_line(
        track.table, track.spacing, track.closed, 0.05, x - offset * math.sin(along), y + offset,
        math.cos(heading), math.sin(heading), 20.0, error, CAMERA.height, make_optics(CAMERA),
    )  # fmt: skip
    assert found
    assert place == pytest.approx(centroid * CAMERA.metres_per_pixel, abs=5e-4)


def test_centroid_counts_what_is_below_the_threshold_in_the_band_only():
    image = np.full((120, 160), 200, dtype=np.uint8)
    image[10:30, 3:9] = 10
    image[50:60, 100:104] = 89
    image[60, 140] = 90
    column, count = centroid(image, 40, 80, 90.0)
    assert count == 40
    assert column == 102.0
    assert line_position(image, CAMERA, 90.0) == (0.0, False)  # 40 pixels are too few


def test_colours_are_those_of_the_floor_under_one_exposure():
    """By hand: a level is gain (reflectance + 0.065), and the gain makes the mean of all components 160."""
    view = make_view(CAMERA, floor="track_red", colour=True)
    image = Renderer(straight(), CAMERA, view).image((20, 0.0, 0.0), 20, 1)
    floor = np.median(image[:, :40].reshape(-1, 3), axis=0)
    tape = np.median(image[50:70, 79:81].reshape(-1, 3), axis=0)
    parts = np.array([0.30, 0.14, 0.10]) + 0.065
    np.testing.assert_allclose(floor / floor[1], parts / parts[1], atol=0.02)
    np.testing.assert_allclose(tape, floor[0] * (0.0125 + 0.065) / parts[0], atol=4)
    assert image.mean() == pytest.approx(160, abs=1)
    grey = Renderer(straight(), CAMERA, make_view(CAMERA, floor="track_red")).image((20, 0.0, 0.0), 20, 1)
    assert np.median(grey[:, :40]) == pytest.approx(floor.mean(), abs=2)
    noise = image[:, :40].reshape(-1, 3).astype(float) - np.median(image[:, :40], axis=1)[:, None].mean(
        axis=0
    )
    assert np.abs(np.corrcoef(noise.T)[np.triu_indices(3, 1)]).max() < 0.05


def test_a_pixel_is_tape_only_if_red_green_and_blue_are_dark():
    """A dark red stripe is dark enough for a grey camera; the rule of section 3.4.2 leaves it alone."""
    red = Tape(reflectance=(0.16, 0.0, 0.0))
    found = {}
    for colour in (False, True):
        renderer = Renderer(straight(), CAMERA, make_view(CAMERA, red, colour=colour))
        found[colour] = line_position(renderer.image((20, 0.05, 0), 20, 1), CAMERA, THRESHOLD)
    assert found[False][1]
    assert not found[True][1]
    black = Renderer(straight(), CAMERA, make_view(CAMERA, colour=True)).image((20, 0.05, 0), 20, 1)
    place, seen = line_position(black, CAMERA, (THRESHOLD,) * 3)
    assert seen
    assert place == pytest.approx(-0.05, abs=0.004)
    assert not line_position(black, CAMERA, (THRESHOLD, 5.0, THRESHOLD))[1]  # the camera reads 35 in each


def test_dark_loses_the_line_and_wider_tape_brings_it_back():
    """The dark corner of section 3.6: lost with two inches of tape, found with four."""

    def share(tape, light):
        renderer = Renderer(straight(), CAMERA, make_view(CAMERA, tape, lighting=Lighting(light=light)))
        images = (renderer.image((20, 0.05, 0.0), 20, k) for k in range(40))
        return np.mean([line_position(image, CAMERA, THRESHOLD)[1] for image in images])

    assert share("duvetyne", 1.0) == 1
    assert share("duvetyne", 0.12) < 0.1
    assert share("duvetyne_wide", 0.12) > 0.8
    assert share("duvetyne_wide", 0.0) == 0  # no light: lost, not tape everywhere


def test_dark_corner_is_dark_only_there():
    lighting = Lighting(dark_corner=(20.0, 0.0, 2.0, 0.03))
    renderer = Renderer(straight(), CAMERA, make_view(CAMERA, lighting=lighting))
    assert not line_position(renderer.image((19, 0, 0), 19, 1), CAMERA, THRESHOLD)[1]
    assert line_position(renderer.image((5, 0, 0), 5, 1), CAMERA, THRESHOLD)[1]


def test_own_shadow_draws_the_centroid_aside():
    """Section 3.6: at times the robot's own shadow contrasted enough with the floor to confuse it."""
    lighting = Lighting(sun=(0.4, 2.0))
    renderer = Renderer(straight(), CAMERA, make_view(CAMERA, lighting=lighting))
    place, found = line_position(renderer.image((20, 0, 0), 20, 1), CAMERA, THRESHOLD)
    assert found
    assert place > 0.2  # the line is straight ahead, the shadow falls to the left


@settings(max_examples=40, deadline=None)
@given(st.floats(-0.3, 0.3), st.floats(-0.2, 0.2))
def test_mirrored_pose_mirrors_the_centroid(offset, heading):
    track, optics = straight(), make_optics(CAMERA)
    places = [
        see_line(
            track.table, track.spacing, False, 0.05, 20.0, sign * offset,
            math.cos(heading), math.sin(sign * heading), 20.0, 0.0, CAMERA.height, optics,
        )[0]
        for sign in (1, -1)
    ]  # fmt: skip
    assert math.isclose(places[0], -places[1], abs_tol=1e-12)


def test_same_key_gives_the_same_image_and_another_key_another_noise():
    renderer = Renderer(straight(), CAMERA)
    first, same, other = (renderer.image((20, 0, 0), 20, key) for key in (5, 5, 6))
    assert np.array_equal(first, same)
    assert not np.array_equal(first, other)
    difference = first.astype(float) - other
    assert math.isclose(difference[:, :60].std() / math.sqrt(2), 5, abs_tol=0.15)  # levels


def photos(lights):
    images, masks = [], []
    for k, light in enumerate(lights):
        view = make_view(CAMERA, lighting=Lighting(light=light))
        images.append(Renderer(straight(), CAMERA, view).image((20, 0, 0), 20, k))
        mask = np.zeros((120, 160), dtype=bool)
        mask[:, 78:82] = True
        masks.append(mask)
    floor = np.ones((120, 160), dtype=bool)
    floor[:, 70:90] = False
    return images, masks, floor


def test_calibration_puts_the_threshold_between_tape_and_floor():
    images, masks, floor = photos([1.0, 0.5, 0.3])
    wide = [np.where(mask | floor, image, 165) for image, mask in zip(images, masks, strict=True)]
    level = calibrate(wide, masks)
    assert 75 < level < 130
    for image in images:
        assert line_position(image, CAMERA, level)[1]


def test_calibration_says_when_no_level_separates_tape_from_floor():
    images, masks, _ = photos([1.0, 0.02])
    with pytest.raises(ModelError, match="leave out the darkest light"):
        calibrate(images, masks)


def test_band_outside_the_image_is_refused():
    with pytest.raises(ModelError, match="no band of 120 rows"):
        Camera(first_row=100, last_row=130)
    with pytest.raises(ModelError, match="above the horizon"):
        Camera(pitch=0.2)
