"""Aircraft, signature, detection and lock loss of the UAV route against the source's tables and geometry."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator
from scipy.spatial.transform import Rotation

from fieldmodels.machines.uav_route.aircraft import (
    banked_time,
    ground_speed,
    heading_of,
    turn_into,
    turn_time,
)
from fieldmodels.machines.uav_route.detection import detection_range, probability_of_detection
from fieldmodels.machines.uav_route.lock_loss import timers_after
from fieldmodels.machines.uav_route.parameters import (
    INSTANT_KILL,
    PRINTED,
    Aircraft,
    Detection,
    LockLoss,
    Reading,
    World,
    kernel_world,
)
from fieldmodels.machines.uav_route.signature import aspect, signature_of
from fieldmodels.model import ModelError

AS_IT_IS = kernel_world(World())
AZIMUTHS = (0, 30, 31, 159, 160, 180)
TABLE_1 = {
    90: (1, 1, 1, 1, 1, 1),
    45: (5e-3, 5e-3, 1, 1, 5e-3, 5e-3),
    20: (5e-4, 5e-4, 0.5, 0.5, 5e-4, 5e-4),
    0: (5e-5, 5e-5, 0.5, 0.5, 5e-5, 5e-5),
    -20: (5e-4, 5e-4, 0.5, 0.5, 5e-4, 5e-4),
    -45: (5e-3, 5e-3, 1, 1, 5e-3, 5e-3),
    -90: (1, 1, 1, 1, 1, 1),
}
TABLE_2 = {
    1: (380, 481.2, 555.6, 656.6),
    1e-1: (213.7, 270.6, 312.5, 369.2),
    1e-2: (120.2, 152.2, 175.7, 207.6),
    1e-3: (67.6, 85.6, 98.8, 116.8),
    1e-4: (38, 48.1, 55.6, 65.7),
    1e-5: (21.4, 27.1, 31.2, 36.9),
    1e-6: (12, 15.2, 17.6, 20.8),
}
COLUMNS = (0.99, 0.5, 0.1, 0.01)


def with_reading(**reading):
    return kernel_world(World(reading=Reading(**reading)))


def random_turns(count=2000, seed=0):
    """Velocities, legs and their ends, anywhere on a map around the radar."""
    rng = np.random.default_rng(seed)
    return (
        rng.normal(size=(count, 2)),
        rng.normal(scale=50, size=(count, 2)),
        rng.normal(scale=400, size=(count, 2)),
    )


def test_table_of_signatures_is_met_and_symmetric():
    for elevation, row in TABLE_1.items():
        for azimuth, value in zip(AZIMUTHS, row, strict=True):
            for sign in (1, -1):
                assert signature_of(sign * math.radians(azimuth), math.radians(elevation)) == pytest.approx(
                    value
                )


def test_signature_is_bilinear_between_the_entries():
    rng = np.random.default_rng(1)
    azimuth, elevation = rng.uniform(-180, 180, 3000), rng.uniform(-90, 90, 3000)
    elevations = sorted(TABLE_1)
    table = RegularGridInterpolator((elevations, AZIMUTHS), [TABLE_1[e] for e in elevations])
    expected = table(np.column_stack([elevation, np.abs(azimuth)]))
    np.testing.assert_allclose(
        signature_of(np.radians(azimuth), np.radians(elevation)), expected, rtol=1e-9, atol=1e-12
    )


@pytest.mark.every("interpolation", ["linear", "log"])
def test_table_of_detection_is_met_both_ways(interpolation):
    for signature, row in TABLE_2.items():
        np.testing.assert_allclose(detection_range(signature, COLUMNS, interpolation), row, rtol=1e-12)
        np.testing.assert_allclose(
            probability_of_detection(signature, row, interpolation), COLUMNS, rtol=1e-9
        )


@pytest.mark.every("interpolation", ["linear", "log"])
def test_detection_grows_with_signature_and_falls_with_range(interpolation):
    signature, slant = np.geomspace(5e-5, 1, 60)[:, None], np.linspace(5, 700, 400)
    chance = probability_of_detection(signature, slant, interpolation)
    assert (np.diff(chance, axis=0) >= -1e-12).all()
    assert (np.diff(chance, axis=1) <= 1e-12).all()
    assert chance.min() == 0.01
    assert chance.max() == 0.99


@pytest.mark.every("interpolation", ["linear", "log"])
def test_range_inverts_probability(interpolation):
    rng = np.random.default_rng(2)
    signature, chance = 10 ** rng.uniform(-6, 0, 500), rng.uniform(0.01, 0.99, 500)
    slant = detection_range(signature, chance, interpolation)
    np.testing.assert_allclose(probability_of_detection(signature, slant, interpolation), chance, rtol=1e-9)


def test_linear_interpolation_puts_the_example_outside_its_circle_and_log_inside():
    """The example's start, 371.7 km away, must lie outside the drawn circle for 0.5 (figure 4.4)."""
    start = math.hypot(350, 125)
    np.testing.assert_allclose(detection_range(0.5, [0.5, 0.6, 0.7]), [364.2, 348.57, 332.94], atol=0.01)
    assert detection_range(0.5, 0.5) < start < detection_range(0.5, 0.5, "log")


def test_ranges_of_the_table_follow_the_fourth_root():
    """Radar equation: R ~ signature^(1/4), within the table's rounding."""
    for column in range(4):
        ratio = [TABLE_2[s][column] / (TABLE_2[1][column] * s**0.25) for s in TABLE_2]
        np.testing.assert_allclose(ratio, 1.0, atol=0.002)


def test_aspect_is_a_rotation_into_body_axes():
    rng = np.random.default_rng(3)
    for _ in range(200):
        to = np.array([*rng.uniform(-400, 400, 2), 10.0])
        heading, bank = rng.uniform(-math.pi, math.pi), rng.uniform(-0.8, 0.8)
        nose, right, belly = Rotation.from_euler("ZX", [heading, bank]).inv().apply(to)
        slant, azimuth, elevation = aspect(
            *to, math.cos(heading), math.sin(heading), math.cos(bank), math.sin(bank)
        )
        assert slant == pytest.approx(np.linalg.norm(to))
        assert azimuth == pytest.approx(math.atan2(right, nose))
        assert elevation == pytest.approx(math.asin(-belly / slant))


def test_every_side_on_turn_of_the_example_is_detected_but_a_turn_into_the_nose_is_not():
    level = (math.cos(math.pi / 4), math.sin(math.pi / 4))
    slant, azimuth, elevation = aspect(0.0, 371.7, 10.0, 1.0, 0.0, *level)  # radar abeam to the right
    assert math.degrees(elevation) == pytest.approx(43.46, abs=0.01)
    seen = signature_of(azimuth, elevation)
    assert seen == pytest.approx(0.97, abs=0.005)
    assert slant < detection_range(seen, 0.5) == pytest.approx(473, abs=2)
    _, azimuth, elevation = aspect(250.0, 0.0, 10.0, 1.0, 0.0, *level)  # radar ahead
    assert detection_range(signature_of(azimuth, elevation), 0.5) < 60


def test_turn_is_the_angle_between_courses_positive_to_the_right():
    velocity, leg, to = random_turns()
    old, new = np.arctan2(velocity[:, 1], velocity[:, 0]), np.arctan2(leg[:, 1], leg[:, 0])
    expected = (new - old + math.pi) % (2 * math.pi) - math.pi
    turns = [turn_into(*v, *d, *p, AS_IT_IS) for v, d, p in zip(velocity, leg, to, strict=True)]
    np.testing.assert_allclose(turns, expected, atol=1e-9)


def test_printed_side_of_a_turn_is_mostly_wrong():
    """Absolute position and reversed sign: legs short against their distance from the origin make it chance;
    legs from anywhere to anywhere make it right in a quarter of the cases (8 standard errors allowed)."""
    rng = np.random.default_rng(4)
    printed = with_reading(side="absolute")
    velocity, place, to = (rng.normal(size=(20_000, 2)) for _ in range(3))
    leg = to - place
    right = [
        turn_into(*v, *d, *p, printed) * turn_into(*v, *d, *p, AS_IT_IS) > 0
        for v, d, p in zip(velocity, leg, to, strict=True)
    ]
    assert np.mean(right) == pytest.approx(0.25, abs=8 * math.sqrt(0.25 * 0.75 / len(right)))


def test_printed_clamp_loses_some_exact_reversals():
    velocity, _, _ = random_turns()
    reversals = [turn_into(*v, *(-13.7 * v), 0.0, 0.0, with_reading(clamp="upper")) for v in velocity]
    assert 0.1 < np.mean(np.isnan(reversals)) < 0.5
    mended = [abs(turn_into(*v, *(-13.7 * v), 0.0, 0.0, AS_IT_IS)) for v in velocity]
    np.testing.assert_allclose(mended, math.pi)
    assert banked_time(math.nan, 0.25, math.pi / 4, 100.0, AS_IT_IS) == 0.0


def test_printed_arctangent_turns_southbound_legs_round():
    for angle in np.linspace(-3, 3, 13):
        north, east = math.cos(angle), math.sin(angle)
        assert heading_of(north, east, False) == pytest.approx(angle)
        wrong = math.cos(heading_of(north, east, True) - angle) < 0
        assert wrong == (north < 0)


def test_turn_time_is_that_of_the_coordinated_turn():
    """32 s for a right angle at 0.2 km/s: not small against a step of 50 s, as section 4.3 assumes."""
    assert turn_time(math.pi / 2, 0.2, math.pi / 4) == pytest.approx(32.0, abs=0.1)
    assert banked_time(math.pi / 2, 0.2, math.pi / 4, 10.0, AS_IT_IS) == 10.0  # a leg shorter than its turn


def test_ground_speed_holds_the_course():
    course = np.array([math.cos(0.7), math.sin(0.7)])
    speed, *nose = ground_speed(*course, 0.25, 0.02, -0.05)
    np.testing.assert_allclose(0.25 * np.array(nose) + [0.02, -0.05], speed * course, atol=1e-15)
    assert ground_speed(*course, 0.25, 0.0, 0.0) == (0.25, *course)


def run(detections, step, constants):
    """Timers after each step, events, and the time of the first hit."""
    timers, losses, hit = (0.0, 0.0, 0.0), 0, math.inf
    trace = []
    for i, detected in enumerate(detections):
        *timers, lost, damaged = timers_after(*timers, detected, step, constants)
        losses += lost
        if damaged and math.isinf(hit):
            hit = (i + 1) * step
        trace.append(tuple(timers))
    return trace, losses, hit


@pytest.mark.every("step", [0.1, 1.0, 5.0, 20.0])
def test_damage_comes_after_engagement_and_missile_whatever_the_step(step):
    _, losses, hit = run([True] * 3000, step, AS_IT_IS)
    assert 200.0 - 1e-6 <= hit <= 200.0 + step + 1e-6
    assert losses == 0


def test_printed_timers_depend_on_the_sample_time():
    """Counts of samples against thresholds in seconds: three times the sample time, three times as long."""
    printed = with_reading(timers="samples")
    hits = [run([True] * 3000, step, printed)[2] for step in (1.0, 3.0)]
    assert hits[1] == 3 * hits[0]
    assert hits[0] == pytest.approx(200.0, abs=3.0)  # right at one second, a sample late an event


def test_a_pause_as_long_as_the_lock_loss_time_frees_the_aircraft():
    pattern = ([True] * 140 + [False] * 50) * 5
    trace, losses, hit = run(pattern, 1.0, AS_IT_IS)
    assert losses == 5
    assert math.isinf(hit)
    assert trace[189][1:] == (0.0, 0.0)
    _, losses, hit = run(([True] * 140 + [False] * 49) * 5, 1.0, AS_IT_IS)
    assert losses == 0
    assert hit < math.inf


def test_a_missile_is_shaken_off_by_lock_loss_only_before_it_hits():
    assert math.isinf(run([True] * 170 + [False] * 60 + [True] * 140, 1.0, replace_lock_loss(lose=25.0))[2])
    assert run([True] * 170 + [False] * 60, 1.0, AS_IT_IS)[2] == pytest.approx(200.0)


def replace_lock_loss(**times):
    return kernel_world(World(lock_loss=replace(LockLoss(), **times)))


def test_what_the_engage_timer_holds():
    pattern = [True] * 100 + [False] * 30 + [True] * 60
    held = {
        engaged: run(pattern, 1.0, kernel_world(World(lock_loss=LockLoss(engaged=engaged))))[0][-1][1]
        for engaged in ("accumulated", "unbroken", "elapsed")
    }
    assert held == {"accumulated": 160.0, "unbroken": 60.0, "elapsed": 190.0}


def test_instant_kill():
    constants = kernel_world(World(lock_loss=INSTANT_KILL))
    assert run([False] * 9 + [True], 1.0, constants)[2] == 10.0
    assert math.isinf(run([False] * 99, 1.0, constants)[2])


@pytest.mark.every(
    ("make", "words"),
    [
        (lambda: Aircraft(speed=0.0), "speed"),
        (lambda: Aircraft(altitude=-1.0), "altitude"),
        (lambda: Aircraft(bank=2.0), "bank"),
        (lambda: Detection(threshold=0.995), "threshold"),
        (lambda: Detection(interpolation="cubic"), "interpolation"),
        (lambda: Detection(scan_interval=0.0), "scan_interval"),
        (lambda: LockLoss(lose=-1.0), "lose"),
        (lambda: detection_range(0.5, 0.999), "probability"),
        (lambda: probability_of_detection(0.0, 100.0), "signature"),
    ],
)
def test_impossible_numbers_are_refused(make, words):
    with pytest.raises(ModelError, match=words):
        make()


def test_printed_reading_is_printed_throughout():
    right, printed = Reading(), PRINTED
    assert not {name for name in vars(right) if getattr(right, name) == getattr(printed, name)}
