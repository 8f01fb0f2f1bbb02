"""Faults that come from other physics than a model's own effects, or that are special to one machine."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from exam.benches import Conditions, Log, get_bench
from exam.benches.axis import DURATION, STEP
from exam.plants.axis import simulate
from exam.sizes import recordings
from fieldmodels.diagnosis import diagnose
from fieldmodels.machines.excitation.recording import record_experiment
from fieldmodels.machines.heel_strike.recording import record_walk as record_leg
from fieldmodels.machines.line_following.body import Body, Hardware
from fieldmodels.machines.line_following.model import LineFollowing
from fieldmodels.machines.line_following.parameters import Noise
from fieldmodels.machines.line_following.recording import record_walk
from fieldmodels.machines.line_following.tracks import oval, straight
from fieldmodels.machines.line_following.walks import Scene
from fieldmodels.machines.pose_reaching.recording import record_drive
from fieldmodels.machines.uav_route.recording import record_flight
from fieldmodels.reality import Reality
from fieldmodels.recording import Recording
from fieldmodels.registry import get_model

QUIET = Noise(bias=0.0)
SLOW = pytest.mark.nightly


def walk(strides: int, seed: int, scene: Scene) -> Recording:
    """A walk of a robot with no fault of the model's own."""
    return record_walk(None, strides, scene=scene, rng=np.random.default_rng(seed))


def flight(reality: object, seed: int, **how: object) -> Recording:
    """Four flights of 2000 s."""
    return record_flight(reality, 2000.0, episodes=4, rng=np.random.default_rng(seed), **how)  # type: ignore[arg-type]


def test_a_walk_on_a_curved_line_is_consistent():
    assert diagnose(LineFollowing(), [walk(600, 3, Scene(oval(), noise=QUIET))]).verdict == "consistent"


@pytest.mark.nightly
def test_rigid_bodies_on_a_dry_floor_are_consistent_with_plane_kinematics():
    scene = Scene(straight(700), plant="pymunk", noise=QUIET)
    assert diagnose(LineFollowing(), [walk(700, 5, scene)]).verdict == "consistent"


@pytest.mark.matrix(keep=("hardware1-actuator_saturation",))
@pytest.mark.parametrize(
    ("hardware", "effect"),
    [(Hardware(friction=0.15), "foot_slip"), (Hardware(motor=0.15), "actuator_saturation")],
)
def test_what_rigid_bodies_suffer_is_named(hardware: Hardware, effect: str):
    """Slip and a weak motor come from contact forces and a torque limit, not from this model's own terms."""
    scene = Scene(straight(700), plant="pymunk", hardware=hardware, noise=QUIET)
    found = diagnose(LineFollowing(), [walk(700, 6, scene)])
    assert found.verdict in ("named", "ambiguous")
    assert effect in (found.causes[0].effect, *found.causes[0].alternatives)


@pytest.mark.nightly
def test_the_slip_that_is_named_is_the_bodies_own_response_to_turns():
    """Bodies alone, told the same turns: what is done at once, and what follows a stride later."""
    slippery = Hardware(friction=0.15)
    recorded = walk(700, 7, Scene(straight(700), plant="pymunk", hardware=slippery, noise=QUIET))
    body, headings, turns = Body(hardware=slippery), [0.0], recorded["steering"]
    for turn in turns:
        body.stride(float(turn))
        headings.append(body.pose[2])
    told = np.column_stack([turns[1:], turns[:-1]])
    at_once, later = np.linalg.lstsq(told, np.diff(headings)[1:], rcond=None)[0]
    assert at_once < 0.97
    assert later > 0.17
    (cause,) = diagnose(LineFollowing(), [recorded]).causes
    assert cause.effect == "foot_slip"
    assert 1.0 - cause.parameters["turn"].value == pytest.approx(at_once, abs=0.03)
    assert cause.parameters["twist"].value == pytest.approx(later, abs=0.03)


@pytest.mark.nightly
@pytest.mark.parametrize("mass", [0.8, *(pytest.param(m, marks=SLOW) for m in (0.1, 0.3))])
def test_a_payload_of_the_vehicle_is_named_alone_whatever_its_size(mass: float):
    """Base parameters fitted without a large one are far off, and the way back is not a straight one."""
    hidden = {"payload": {"mass": mass}}
    found = diagnose(
        get_model("excitation"), [record_experiment(np.random.default_rng(301), hidden, duration=4.0)]
    )
    assert [cause.effect for cause in found.causes] == ["payload"]
    assert found.causes[0].parameters["mass"].value == pytest.approx(mass, rel=0.01)
    assert found.unknown is None


@pytest.mark.matrix(keep=("heel_strike-length",))
@pytest.mark.parametrize(
    ("model", "parameter"), [("excitation", "stiffness_pitch"), ("heel_strike", "length")]
)
def test_base_parameters_are_refitted(model: str, parameter: str):
    bench = get_bench(model)
    found = diagnose(bench.model, recordings(bench, [], Conditions(), 90_201)[:1])
    assert found.parameters[parameter].value == pytest.approx(bench.base(90_201)[parameter], rel=0.01)


@pytest.mark.nightly
def test_another_speed_of_the_aircraft_is_refitted_not_named():
    model = get_model("uav_route")
    assert diagnose(model, [flight({"parameters": {"speed": 243.0}}, 6)]).causes == ()


@pytest.mark.nightly
def test_faults_of_both_stages_are_named_together():
    hidden, model = (
        {"yaw_slip": {"share": 0.1}, "actuator_lag": {"time_constant": 0.05}},
        get_model("pose_reaching"),
    )
    found = diagnose(model, [record_drive(120.0, np.random.default_rng(4), hidden)])
    assert [cause.effect for cause in found.causes] == ["yaw_slip", "actuator_lag"]
    assert found.verdict == "named"
    assert found.gain["heading"].gain.percent > 50
    assert found.gain["left_wheel"].gain.percent > 50
    assert set(found.extended()["effects"]) == {"yaw_slip", "actuator_lag"}
    assert found.vector[model.index("yaw_slip.share")] == pytest.approx(0.1, abs=0.005)
    assert found.vector[model.index("actuator_lag.time_constant")] == pytest.approx(0.05, abs=0.003)


def detent(x: float) -> float:
    """A notch that pulls the pendulum towards one place [N m]."""
    return -0.8 * (x - 0.3) * math.exp(-(((x - 0.3) / 0.15) ** 2))


def one_sided_stop(x: float) -> float:
    """An elastic stop on one side of the rig [N]."""
    return -20.0 * max(x - 0.03, 0.0)


def forced(machine: str, force: Callable[[float], float], seed: int) -> list[Recording]:
    """Two records of a machine's plant with a force of the place."""
    bench, records = get_bench(machine), []
    count = round(DURATION / STEP)
    for k in range(2):
        rng, base = np.random.default_rng([seed, k]), bench.base(seed)
        control, _ = bench.control(Conditions(), base, count, STEP, rng)
        plant = bench.plant(base)
        plant.forces.append(lambda _t, x, _v, _u: force(x))
        rows = simulate(plant, control, np.array(bench.noise) * rng.standard_normal((count, 2)), STEP)
        records.append(bench.recording(Log(STEP, rows[:, :1], rows[:, 1:]), Conditions(), seed))
    return records


@pytest.mark.matrix(keep=("2-pendulum, detent",))
@pytest.mark.parametrize(
    ("machine", "force"),
    [("rig", one_sided_stop), ("pendulum", detent)],
    ids=["rig, one-sided stop", "pendulum, detent"],
)
@pytest.mark.parametrize("seed", [1, 2])
def test_a_force_of_the_place_is_unknown_and_its_shape_is_given(
    machine: str, force: Callable[[float], float], seed: int
):
    train, test = forced(machine, force, seed)
    found = diagnose(get_model(machine), [train], [test])
    assert found.verdict == "unknown", found.summary()
    assert found.unknown is not None
    assert found.unknown.direction.split()[0] in ("position", "angle")
    assert 0.0 < found.unknown.percent <= 100.0
    place, values, _ = found.unknown.curve.T
    assert len(place) > 3
    # Its shape, up to what the refitted base takes up: a constant and a spring.
    base = np.column_stack([np.ones_like(place), place])
    truth = np.array([force(x) for x in place])
    left = [y - base @ np.linalg.lstsq(base, y, rcond=None)[0] for y in (values, truth)]
    assert np.corrcoef(left)[0, 1] > 0.8


@pytest.mark.nightly
def test_a_gyro_that_drifts_is_found_in_a_long_walk():
    """Of so long a walk a model states its peaks by size."""
    drift = Reality(effects={"gyro_drift": {"rate": 2e-5}})
    log = record_leg(1200.0, np.random.default_rng(48), reality=drift)
    found = diagnose(get_model("heel_strike"), [log]).extended()["effects"]["gyro_drift"]["rate"]
    assert abs(found["value"] - 2e-5) < 3 * found["std"] < 1e-5


@pytest.mark.nightly
def test_a_small_bias_of_a_gyro_is_found_beside_friction():
    """Of a minute of strides, as much as is fitted, each by itself tells 1.4 mrad/s, six together 0.25."""
    reality = Reality(effects={"gyro_bias": {"rate": 0.002}, "viscous_friction": {"rate": 0.14}})
    log = record_leg(300.0, np.random.default_rng(49), reality=reality)
    found = diagnose(get_model("heel_strike"), [log]).extended()["effects"]["gyro_bias"]["rate"]
    assert abs(found["value"] - 0.002) < 3 * found["std"] < 1e-3


def test_a_tracker_that_is_off_by_kilometres_is_not_believed_more_than_the_way_of_the_flight():
    """The base alone explains the courses by positions 2 km aside; from there a fit said 1849 m."""
    off = {"sensor_bias": {"north": 2200.0, "east": -200.0}}
    found = diagnose(get_model("uav_route"), [flight(off, 5)]).extended()["effects"]["sensor_bias"]
    for side, true in off["sensor_bias"].items():
        assert abs(found[side]["value"] - true) < 3 * found[side]["std"] < 60


@pytest.mark.nightly
def test_each_cause_says_in_which_signal_it_shows():
    both = {"turn_speed_loss": {"share": 0.08}, "radar_position": {"north": 20e3, "east": -15e3}}
    found = diagnose(get_model("uav_route"), [flight(both, 7)])
    signals = {cause.effect: cause.signal for cause in found.causes}
    assert set(signals) == set(both)
    assert signals["radar_position"] == "detected"
    assert signals["turn_speed_loss"] != "detected"


@pytest.mark.nightly
def test_a_speed_that_depends_on_the_place_is_unknown_and_its_shape_is_given():
    """No listed effect: the aircraft is faster in the north than in the south."""
    faster = flight(None, 21, added=lambda place: 6.0 * math.tanh(place.real / 50e3))
    found = diagnose(get_model("uav_route"), [faster])
    assert found.verdict == "unknown"
    assert found.unknown.direction == "north, in the speed along the course"


@pytest.mark.nightly
def test_a_radar_that_tires_is_unknown_and_given_against_time():
    """No listed effect: its ranges shrink by half in the middle of each flight."""
    tired = flight(None, 22, faded=lambda _, time: 1 - 0.3 * math.tanh((time - 1000) / 300))
    found = diagnose(get_model("uav_route"), [tired])
    assert found.verdict == "unknown"
    assert not found.causes
    assert found.unknown.direction == "time, in the log-odds of detected"
    curve = np.array(found.unknown.curve)
    assert curve[0, 1] > curve[-1, 1] + 1.0
