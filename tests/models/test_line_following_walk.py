import math

import numpy as np
import pymunk
import pytest

from fieldmodels.machines.line_following.body import Body, Hardware
from fieldmodels.machines.line_following.declaration import as_plants
from fieldmodels.machines.line_following.firmware import line_position
from fieldmodels.machines.line_following.model import LineFollowing
from fieldmodels.machines.line_following.parameters import Camera, Noise
from fieldmodels.machines.line_following.plant import measured, turn_of
from fieldmodels.machines.line_following.sensor import make_optics, see_line
from fieldmodels.machines.line_following.tracks import TRACKS, nearest, straight
from fieldmodels.machines.line_following.walks import Scene, Walks
from fieldmodels.model import ModelError
from fieldmodels.recording import Recording, Windows

QUIET = Noise(0, 0, 0, 0)
GAINS = (-0.3, 0.8, 0.2)


def vector(effects):
    return LineFollowing().vector(effects=effects)


def plant(effects):
    return as_plants(vector(effects))[()]


def walks(batch=1, track="straight", seed=3, effects=None, **options):
    result = Walks(batch, Scene(TRACKS[track](), **options), vector(effects) if effects else None)
    result.restart(range(batch), [np.random.default_rng(seed + i) for i in range(batch)])
    return result


def law(walk):
    """Equation (3.1)."""
    a, b, c = GAINS
    state = walk.walks
    return a * state["lines"][:, 0, 1] + b * state["lines"][:, 0, 0] + c * state["commands"][:, 0]


def test_a_turn_shows_one_stride_late():
    walk = walks(noise=QUIET, offset=0.0, misalignment=0.0)
    places = []
    for command in (0.1, 0.0, 0.0):
        walk.advance([command])
        places.append((float(walk.walks["x"][0]), float(walk.walks["y"][0]), float(walk.walks["heading"][0])))
    assert np.allclose(places[0], (0.7, 0.0, 0.1))  # the whole stride went along the old heading
    assert np.allclose(places[1], (0.7 + 0.7 * math.cos(0.1), 0.7 * math.sin(0.1), 0.1))


def test_rows_of_a_batch_are_batches_of_one():
    together = walks(5, "oval")
    alone = [walks(1, "oval", seed=3 + i) for i in range(5)]
    for _ in range(20):
        together.advance(law(together))
        for i, one in enumerate(alone):
            one.advance(law(one))
            assert one.walks[0] == together.walks[i]


def test_noise_does_not_depend_on_commands():
    first, second = walks(1, noise=Noise(bias=0.0)), walks(1, noise=Noise(bias=0.0))
    turns = []
    for walk, command in ((first, 0.0), (second, 0.1)):
        before = float(walk.walks["heading"][0])
        walk.advance([command])
        turns.append(float(walk.walks["heading"][0]) - before - command)
    assert math.isclose(turns[0], turns[1], abs_tol=1e-15)


def test_state_comes_back_exactly():
    walk = walks(4, "s")
    for _ in range(3):
        walk.advance(law(walk))
    kept = walk.state()
    for _ in range(5):
        walk.advance(law(walk))
    end = walk.state()
    walk.set_state(kept)
    for _ in range(5):
        walk.advance(law(walk))
    assert (walk.walks == end).all()


@pytest.mark.every("track", ["straight", "s", "oval"])
def test_bodies_and_kinematics_agree_in_closed_loop(track):
    """Two plants of one robot: on dry floor they stay together within 3 mm on average."""
    walk = walks(1, track, noise=QUIET, offset=0.2, misalignment=0.1)
    line, optics = walk.scenes[0].track, make_optics(Camera())
    x, y, heading = (float(walk.walks[name][0]) for name in ("x", "y", "heading"))
    body, arc = Body(), float(walk.walks["arc"][0])
    body.place(x, y, heading)
    seen, command, apart = [0.0, float(walk.walks["lines"][0, 0, 0])], 0.0, []
    for _ in range(60):
        command = GAINS[0] * seen[-2] + GAINS[1] * seen[-1] + GAINS[2] * command
        command = min(max(command, -0.15), 0.15)
        walk.advance(law(walk))
        body.stride(command)
        x, y, heading = body.pose
        arc, offset, _, _ = nearest(line.table, line.spacing, line.closed, x, y, arc + 0.7)
        seen.append(
            see_line(
                line.table, line.spacing, line.closed, 0.0508, x, y,
                math.cos(heading), math.sin(heading), arc, 0.0, Camera().height, optics,
            )[0]
        )  # fmt: skip
        apart.append(abs(offset - float(walk.walks["offset"][0])))
    assert np.mean(apart) <= 3e-3


def turned(commands, **hardware):
    body, headings = Body(hardware=Hardware(**hardware)), [0.0]
    for command in commands:
        body.stride(command)
        headings.append(body.pose[2])
    return np.diff(headings), body


def test_bodies_turn_as_told_on_dry_floor():
    turns, body = turned([0.0, 0.1, 0.1, -0.15, 0.0])
    assert np.allclose(turns, [0.0, 0.1, 0.1, -0.15, 0.0], atol=3e-3)  # momentum adds 1 % of the last turn
    assert 0.99 * 5 * 0.7 < math.hypot(*body.pose[:2]) <= 5 * 0.7


def moments(monkeypatch, strides=4, **hardware):
    """Speeds of frame, outer and inner legs at every moment of a straight walk, shape (moments, 3), [m/s]."""
    seen, step = [], pymunk.Space.step

    def watched(space, duration):
        step(space, duration)
        seen.append([body.velocity.x for body in sorted(space.bodies, key=lambda body: -body.moment)])

    monkeypatch.setattr(pymunk.Space, "step", watched)
    turned([0.0] * strides, **hardware)
    return np.array(seen)


def test_the_centre_of_mass_moves_as_an_inverted_pendulum(monkeypatch):
    """x'' = g x / 1 m from -0.175 to 0.175 m in 0.6 s, solved by hand; no momentum is lost between steps."""
    speeds = moments(monkeypatch)
    rate = math.sqrt(9.81)
    time = (np.arange(1, 73) / 120 - 0.3)[None] - 0.5 / 120  # of an interval, its middle
    expected = 0.175 * rate * np.cosh(rate * time) / math.sinh(0.3 * rate)
    centre = (speeds @ (8.0, 1.0, 1.0) / 10.0).reshape(-1, 72)
    np.testing.assert_allclose(centre, np.broadcast_to(expected, centre.shape), atol=0.01)
    assert speeds[:, 0].min() > 0.35
    assert np.abs(np.diff(speeds[:, 0])).max() < 0.03  # also from step to step


@pytest.mark.every(("friction", "slips"), [(0.19, False), (0.15, True)])
def test_straight_walking_needs_a_friction_of_half_a_step_over_the_height(monkeypatch, friction, slips):
    speeds = np.abs(moments(monkeypatch, friction=friction)).reshape(-1, 2, 72, 3)
    slip = np.sum([speeds[:, step, :, 1 + step].sum(axis=-1) / 120 for step in (0, 1)], axis=0)  # of a stride
    assert (slip.max() > 1e-4) == slips


def test_turning_grows_worse_with_every_loss_of_friction():
    """Of each stride's turn: what is done in it falls, its error grows, and a slalom's error grows."""
    frictions = (1.2, 0.8, 0.6, 0.5, 0.4, 0.3, 0.25, 0.2, 0.175, 0.15, 0.125, 0.1, 0.075, 0.05)
    slalom = 0.1 * np.sin(0.7 * np.arange(25))
    single, steady, error = [], [], []
    for friction in frictions:
        turns = turned([0.1] * 12, friction=friction)[0]
        single.append(turns[0] / 0.1)
        steady.append(abs(turns[2:].mean() / 0.1 - 1.0))
        error.append(np.std(turned(slalom, friction=friction)[0] - slalom) / np.std(slalom))
    assert (np.diff(single) < 1e-3).all()
    assert single[0] > 0.995
    assert single[-1] < 0.65
    assert (np.diff(steady) > 0).all()
    assert (np.diff(error) > 0).all()
    assert error[0] < 0.01
    assert error[-1] > 0.3


def test_weak_motor_gives_way():
    strong, _ = turned([0.0, 0.15, 0.15])
    weak, _ = turned([0.0, 0.15, 0.15], motor=0.1)
    assert (weak[1:] < 0.7 * strong[1:]).all()


def test_finer_steps_of_the_bodies_agree():
    coarse, _ = turned([0.0, 0.1, -0.1])
    fine, _ = turned([0.0, 0.1, -0.1], rate=240)
    assert np.allclose(coarse, fine, atol=6e-4)


def test_every_plant_parameter_turns_as_it_says():
    commands = np.array([0.1, 0.05, 0.0, 0.0])

    def turn(**effects):
        return turn_of(commands, plant(effects), 0.0, 0.15)

    assert turn() == 0.1
    assert math.isclose(turn(steering_bias={"turn": 0.01}), 0.11)
    assert math.isclose(turn(turn_gain={"factor": 0.8}), 0.08)
    assert math.isclose(turn(actuator_delay={"strides": 1.0}), 0.05)
    assert math.isclose(turn(actuator_delay={"strides": 0.25}), 0.0875)
    assert math.isclose(turn(actuator_saturation={"turn": 0.07}), 0.07)
    assert math.isclose(turn(foot_slip={"turn": 0.2}), 0.08)
    assert math.isclose(turn(foot_slip={"twist": 0.1}), 0.1 + 0.1 * 0.05)  # of the stride before
    # A gain is of what is commanded: neither the steering's bias nor that of the walk is multiplied by it.
    assert math.isclose(turn(turn_gain={"factor": 0.8}, steering_bias={"turn": 0.01}), 0.8 * 0.1 + 0.01)
    weak = plant({"turn_gain": {"factor": 0.8}})
    assert math.isclose(turn_of(commands, weak, 0.02, 0.15), 0.8 * 0.1 + 0.02)


def test_a_coarse_and_scaled_sensor_shows_the_nearest_step():
    coarse = plant({"sensor_gain": {"factor": 2.0}, "sensor_quantisation": {"step": 0.02}})
    assert math.isclose(measured(0.0376, coarse), 0.08)  # 0.0752, between 0.06 and 0.08
    assert math.isclose(measured(-0.0376, coarse), -0.08)


def test_a_slipping_step_is_shorter():
    walk = walks(noise=QUIET, offset=0.0, misalignment=0.0, effects={"foot_slip": {"step": 0.1}})
    walk.advance([0.0])
    assert walk.walks["x"][0] == pytest.approx(0.9 * 0.7)


def test_sideways_slip_is_at_right_angles_to_the_heading():
    walk = walks(64, noise=Noise(0, 0, 0.05, 0), offset=0.0, misalignment=0.4)
    before = walk.walks.copy()
    walk.advance(np.zeros(64))
    x, y = walk.walks["x"] - before["x"], walk.walks["y"] - before["y"]
    along = x * np.cos(before["heading"]) + y * np.sin(before["heading"])
    across = y * np.cos(before["heading"]) - x * np.sin(before["heading"])
    np.testing.assert_allclose(along, 0.7, rtol=1e-12)
    assert 0.03 < across.std() < 0.07


def test_misalignment_is_the_heading_against_the_line():
    walk = walks(16, "oval", noise=QUIET, offset=0.1, misalignment=0.3)
    walk.advance(np.zeros(16))
    for one in walk.walks:
        _, _, along = walk.scenes[0].track.at(float(one["arc"]))
        turned = (one["heading"] - along + math.pi) % (2 * math.pi) - math.pi
        assert one["misalignment"] == pytest.approx(turned, abs=1e-3)


def predicted(states, steering, curvature, parameters=None):
    """Line, offset and heading that the model of the diagnosis predicts, shape (strides, 3)."""
    model, count = LineFollowing(), len(steering)
    signals = {"steering": steering, "curvature": curvature}
    signals |= {name: np.zeros(count) for name in ("line", "offset", "heading")}
    recording = Recording(model.gait.stride_time * np.arange(count), signals)
    observed = np.ones((1, count, 3), dtype=np.bool_)
    one = Windows(recording, np.array([0]), np.array([count]), np.array([states]), observed)
    return model.simulate(model.nominal if parameters is None else parameters, one)[0, 0]


@pytest.mark.every("bend", [1 / 9, -1 / 9])
def test_the_prediction_on_a_circle_is_plane_geometry(bend):
    """The line goes through the origin eastwards and bends about (0, 1 / bend)."""
    steering = np.array([0.1, 0.0, -0.05, 0.15, 0.0, 0.1, 0.1, -0.1])
    found = predicted((0.06, -0.1), steering, np.full(len(steering), bend))
    radius = 1 / bend
    x, y, heading = 0.0, 0.06, -0.1
    for turn, row in zip(steering, found, strict=True):
        out_x, out_y = x, y - radius
        offset = radius - math.copysign(math.hypot(out_x, out_y), radius)
        tangent = math.atan2(out_x * math.copysign(1, radius), -out_y * math.copysign(1, radius))
        assert row[1] == pytest.approx(offset, abs=1e-9)
        assert row[2] == pytest.approx(heading - tangent, abs=1e-9)
        x, y, heading = x + 0.7 * math.cos(heading), y + 0.7 * math.sin(heading), heading + turn


def test_predicted_sight_is_that_of_the_walk():
    """Two ways to see a straight line, by one who walks and by one who predicts, which share no code."""
    askew = {"camera_yaw": {"angle": 0.05}, "camera_pitch": {"angle": 0.03}}
    walk = walks(16, noise=QUIET, offset=0.2, misalignment=0.1, effects=askew)
    for one in walk.walks:
        states = one["offset"], one["misalignment"]
        place = predicted(states, np.zeros(4), np.zeros(4), vector(askew))[0, 0]
        assert one["lines"][0, 0] == pytest.approx(place, abs=2e-3)


def test_latency_delays_every_command():
    now, late = walks(noise=QUIET), walks(noise=QUIET, latency_strides=1)
    headings = []
    for walk in (now, late):
        start = float(walk.walks["heading"][0])
        turns = []
        for command in (0.1, -0.05, 0.02, 0.0):
            walk.advance([command])
            turns.append(float(walk.walks["heading"][0]) - start)
            start = float(walk.walks["heading"][0])
        headings.append(turns)
    assert np.allclose(headings[0], [0.1, -0.05, 0.02, 0.0])
    assert np.allclose(headings[1], [0.0, 0.1, -0.05, 0.02])


def test_latency_and_delay_and_slip_together_reach_no_further_than_the_memory():
    """Three strides of waiting, and a twist by the stride before: the oldest command stands for that one."""
    effects = {"actuator_delay": {"strides": 2.0}, "foot_slip": {"twist": 0.5}}
    late = walks(noise=QUIET, latency_strides=1, effects=effects)
    late.walks["lines"][:] = 7.0  # what lies behind the commands in memory
    turns, before = [], float(late.walks["heading"][0])
    for command in (0.1, 0.0, 0.0, 0.0, 0.0):
        late.advance([command])
        turns.append(float(late.walks["heading"][0]) - before)
        before += turns[-1]
    assert np.allclose(turns, [0.0, 0.0, 0.0, 0.15, 0.0])


def test_picture_without_images_shows_what_the_camera_reads():
    """Also of a camera that is askew, tilted and turns with the inner legs."""
    askew = {"camera_yaw": {"angle": 0.05}, "camera_pitch": {"angle": 0.04}}
    walk = walks(1, "oval", effects=askew, camera_yaws_with_inner=True, noise=Noise(bias=0.0))
    for _ in range(6):
        walk.advance(law(walk))
        place, found = line_position(walk.image(0), walk.scenes[0].camera, 90.0)
        assert found
        assert abs(place - walk.walks["lines"][0, 0, 0]) < 6e-3


def test_camera_of_the_inner_legs_looks_where_they_point():
    """After a turn the inner feet still point along the old heading: a straight line stays in the middle."""
    for inner, seen in ((False, -0.1505), (True, 0.0)):
        for sight in ("geometry", "image"):
            options = {"offset": 0.0, "misalignment": 0.0, "camera_yaws_with_inner": inner, "sight": sight}
            walk = walks(noise=QUIET, **options)
            walk.advance([0.15])
            assert abs(walk.walks["lines"][0, 0, 0] - seen) < 2e-3


def test_lost_line_keeps_the_last_place_and_is_counted():
    walk = walks(noise=QUIET, offset=0.0, misalignment=0.0)
    before = float(walk.walks["lines"][0, 0, 0])
    for _ in range(12):
        walk.advance([0.15])  # walk in a circle until the line is out of view
        if walk.walks["lost"][0, 0]:
            break
        before = float(walk.walks["lines"][0, 0, 0])
    assert walk.walks["count"][0] < 12
    assert walk.walks["lines"][0, 0, 0] == before
    assert walk.walks["lost_strides"][0] == 1
    walk.advance([0.15])
    assert walk.walks["lost_strides"][0] == 2


def test_bad_options_are_refused():
    with pytest.raises(ModelError, match="bands must be at least 1, at most 2"):
        Scene(straight(), bands=3)
    with pytest.raises(ModelError, match="latency_strides must be at least 0, at most 1"):
        Scene(straight(), latency_strides=2)
    with pytest.raises(ModelError, match="at least one walk"):
        Walks(0, Scene(straight()))
    with pytest.raises(ModelError, match="parameter vector of this machine has"):
        Walks(1, Scene(straight()), np.zeros(3))
    with pytest.raises(ModelError, match="takes one reality or 2"):
        Walks(2, Scene(straight()), np.tile(LineFollowing().nominal, (3, 1)))


@pytest.mark.every("plant", ["kinematic", "pymunk"])
@pytest.mark.every("sight", ["geometry", "image"])
def test_each_walk_has_its_own_stride_and_camera(plant, sight):
    two = [LineFollowing().vector({"stride": s, "camera_height": h}) for s, h in ((0.6, 1.2), (0.8, 0.9))]
    scene = Scene(straight(), plant=plant, sight=sight, noise=Noise(lateral=0.0))
    together = Walks(2, scene, two)
    alone = [Walks(1, scene, one) for one in two]
    rng = np.random.default_rng
    together.restart([0, 1], [rng(5), rng(6)])
    for i in range(2):
        alone[i].restart([0], [rng(5 + i)])
    begun = together.walks["x"].copy()
    for _ in range(4):
        together.advance([0.05, 0.05])
        for i in range(2):
            alone[i].advance([0.05])
            assert together.walks[i] == alone[i].walks[0]
    assert together.walks["x"] - begun == pytest.approx([4 * 0.6, 4 * 0.8], rel=0.1)


def test_sight_by_image_agrees_with_sight_by_geometry():
    """Both sensors steer the same walk; the centroid differs by less than 4 mm in every stride."""
    options = {"noise": Noise(sensor=0.0, bias=0.0), "bands": 2}
    drawn, computed = walks(2, "oval", sight="image", **options), walks(2, "oval", **options)
    for _ in range(30):
        assert np.abs(drawn.walks["lines"] - computed.walks["lines"]).max() < 4e-3
        command = law(computed)
        drawn.advance(command)
        computed.advance(command)


def test_walks_of_bodies_are_exact_to_restore_and_the_same_in_any_batch():
    together = Walks(3, Scene(straight(), plant="pymunk", sight="image"))
    together.restart(range(3), [np.random.default_rng(i) for i in range(3)])
    alone = Walks(1, Scene(straight(), plant="pymunk", sight="image"))
    alone.restart([0], [np.random.default_rng(2)])
    for _ in range(3):
        together.advance(law(together))
        alone.advance(law(alone))
    assert together.walks[2] == alone.walks[0]
    kept = together.state()
    together.advance(law(together))
    end, images = together.state(), together.images.copy()
    together.set_state(kept)
    together.advance(law(together))
    assert (together.walks == end).all()
    assert np.array_equal(together.images, images)


def test_walk_must_begin_before_it_goes_on():
    with pytest.raises(ModelError, match="restart every walk"):
        Walks(2, Scene(straight())).advance([0.0, 0.0])
    with pytest.raises(ModelError, match="commands must have shape"):
        walks(2).advance([0.0])
    with pytest.raises(ModelError, match="friction must be positive"):
        Hardware(friction=0.0)
