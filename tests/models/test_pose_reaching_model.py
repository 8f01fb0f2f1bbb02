"""The pose-reaching model: exact where nothing is wrong, and right where something is."""

from dataclasses import replace

import numpy as np
import pytest

from fieldmodels.diagnosis.problem import build
from fieldmodels.machines.differential_drive import DifferentialDrive
from fieldmodels.machines.pose_reaching import unicycle
from fieldmodels.machines.pose_reaching.batch import Robots, Rules
from fieldmodels.machines.pose_reaching.model import POSE, WHEELS, PoseReaching
from fieldmodels.machines.pose_reaching.parameters import ROBOCUP, WARTHOG, Arrival, Field, Limits
from fieldmodels.machines.pose_reaching.recording import random_commands, record_drive
from fieldmodels.model import ModelError
from fieldmodels.reality import Reality
from fieldmodels.recording import Recording, RecordingError, Windows
from fieldmodels.recording.files import load_recording, save_recording
from fieldmodels.registry import get_model

STEP = 0.05
FAULTS = {
    "actuator_gain": {"gain": 0.9},
    "turn_gain": {"gain": 1.1},
    "actuator_lag": {"time_constant": 0.13},
    "actuator_rate_limit": {"rate": 2.0},
    "actuator_delay": {"delay": 0.07},
    "actuator_saturation": {"limit": 0.8},
    "actuator_dead_zone": {"width": 0.05},
    "unequal_wheels": {"difference": 0.04},
    "yaw_slip": {"share": 0.2},
    "sideways_slip": {"coefficient": 0.1},
    "slope": {"x": 0.05, "y": -0.03},
    "sensor_delay": {"delay": 0.12},
    "heading_bias": {"angle": 0.3},
    "parameter_step": {"time": 2.0, "factor": 0.8},
}


def commanded(count: int = 120, seed: int = 0, **more: np.ndarray) -> Recording:
    """Random commands without a measured output."""
    values = random_commands(count * STEP, STEP, Limits(), np.random.default_rng(seed))
    return Recording(
        time=np.arange(count) * STEP,
        signals={"speed": values[:, 0], "turn_rate": values[:, 1], **more},
    )


def whole(model: PoseReaching, recording: Recording, state: tuple[float, ...] = (0.0, 0.0, 0.0)) -> Windows:
    """One window over a whole recording."""
    return Windows(
        recording=recording,
        starts=np.zeros(1, dtype=np.int64),
        lengths=np.array([len(recording)]),
        states=np.array([state]),
        observed=np.ones((1, len(recording), len(model.outputs)), dtype=np.bool_),
    )


def measured(model: PoseReaching, windows: Windows) -> np.ndarray:
    return windows.measured(tuple(output.name for output in model.outputs))


def test_without_faults_it_is_the_exact_unicycle():
    model, recording = PoseReaching(), commanded()
    outputs = model.simulate(model.nominal, whole(model, recording, (0.3, -0.2, 1.0)))[0, 0]
    pose = np.array([[0.3, -0.2, 1.0]])
    for k in range(len(recording)):
        assert outputs[k, :2] == pytest.approx(pose[0, :2], abs=1e-12)
        assert unicycle.wrapped(outputs[k, 2] - pose[0, 2]) == pytest.approx(0.0, abs=1e-12)
        speed, rate = recording["speed"][k : k + 1], recording["turn_rate"][k : k + 1]
        pose = unicycle.advance(pose, speed, rate, STEP)
        if k + 1 < len(recording):
            wheels = unicycle.wheel_speeds(speed[0], rate[0], ROBOCUP.radius, ROBOCUP.track)
            assert outputs[k + 1, 3:] == pytest.approx(wheels, abs=1e-9)


def test_batches_and_neighbours_change_no_bit():
    model, recording = PoseReaching(), commanded(400, seed=1)
    windows = replace(
        whole(model, recording),
        starts=np.array([0, 100, 250]), lengths=np.array([100, 150, 80]),
        states=np.array([[0, 0, 0], [1, 2, 3], [-1, 0, 1.0]]),
        observed=np.ones((3, 150, 5), dtype=np.bool_),
    )  # fmt: skip
    vectors = np.stack([model.nominal, model.vector(effects=FAULTS)])
    together = model.simulate(vectors, windows)
    for p in range(2):
        for w in range(3):
            alone = model.simulate(vectors[p], windows.select(np.array([w])))
            assert np.array_equal(alone[0, 0], together[p, w], equal_nan=True)
    assert np.isnan(together[:, 0, 100:]).all()


def test_mirrored_commands_give_the_mirrored_path():
    model, recording = PoseReaching(), commanded(seed=2)
    faults = {k: v for k, v in FAULTS.items() if k not in ("unequal_wheels", "slope", "heading_bias")}
    q = model.vector(effects=faults)
    mirrored = replace(recording, signals={**recording.signals, "turn_rate": -recording["turn_rate"]})
    first = model.simulate(q, whole(model, recording))[0, 0]
    second = model.simulate(q, whole(model, mirrored))[0, 0]
    assert second == pytest.approx(first[:, [0, 1, 2, 4, 3]] * [1, -1, -1, 1, 1], abs=1e-10)


def test_both_fronts_are_one_robot():
    body, wheel = PoseReaching(WARTHOG), DifferentialDrive(WARTHOG)
    recording = commanded(seed=4)
    left, right = unicycle.wheel_speeds(
        recording["speed"], recording["turn_rate"], WARTHOG.radius, WARTHOG.track
    )
    other = replace(recording, signals={"left_command": left, "right_command": right})
    q = body.vector(effects=FAULTS)
    assert wheel.names == body.names
    assert wheel.simulate(q, whole(wheel, other)) == pytest.approx(
        body.simulate(q, whole(body, recording)), abs=1e-9
    )


def test_a_pose_beside_measured_wheels_follows_them_whatever_was_commanded():
    model = PoseReaching()
    recording = record_drive(20.0, np.random.default_rng(0), FAULTS, noise=0.0)
    base = model.vector(effects={k: v for k, v in FAULTS.items() if k in ("unequal_wheels", "yaw_slip",
                        "sideways_slip", "slope", "sensor_delay", "heading_bias")})  # fmt: skip
    misled = replace(recording, signals={**recording.signals, "speed": 0 * recording["speed"]})
    for record in (recording, misled):
        windows = model.windows(record, 2.0)
        error = (measured(model, windows) - model.simulate(base, windows)[0])[:, :, :3]
        assert np.abs(error).max() < 0.01
    # Without wheels the command is all there is.
    alone = replace(misled, signals={k: v for k, v in misled.signals.items() if k not in WHEELS})
    windows = model.windows(alone, 2.0)
    assert np.abs((measured(model, windows) - model.simulate(base, windows)[0])[:, :, :3]).max() > 0.5


def test_wrapped_and_continuous_headings_are_one_recording():
    model = PoseReaching()
    wrapped = record_drive(30.0, np.random.default_rng(1), noise=1.0)
    assert np.abs(wrapped["heading"]).max() <= np.pi
    assert np.abs(np.diff(wrapped["heading"])).max() > 5  # it does wrap
    signals = {**wrapped.signals, "heading": np.unwrap(wrapped["heading"]) + 6 * np.pi}
    problems = [build(model, [r], 2.0) for r in (wrapped, replace(wrapped, signals=signals))]
    raw = [p.features - p.simulate(model.nominal[None], p.states)[0] for p in problems]
    assert raw[1] == pytest.approx(raw[0], abs=1e-9)
    assert np.abs(raw[0]).max() < 1.0  # no residual of a whole turn


def test_the_stages_of_a_recording():
    model = PoseReaching()
    both = record_drive(10.0, np.random.default_rng(2))
    names = {effect.name for effect in model.effects}
    motion, drive = model.stages([both])
    assert set(motion.effects) | set(drive.effects) == names
    assert not set(motion.effects) & set(drive.effects)
    assert motion.model.windows(both, 2.0).observed.any(axis=(0, 1)).tolist() == [True] * 3 + [False] * 2
    assert drive.model.windows(both, 2.0).observed.any(axis=(0, 1)).tolist() == [False] * 3 + [True] * 2
    pose = replace(both, signals={k: v for k, v in both.signals.items() if k not in WHEELS})
    assert [set(stage.effects) for stage in model.stages([pose])] == [names]
    wheels = replace(both, signals={k: v for k, v in both.signals.items() if k not in POSE})
    assert [stage.effects for stage in model.stages([wheels])] == [drive.effects]


def test_half_a_pose_and_no_output_are_refused():
    model = PoseReaching()
    with pytest.raises(RecordingError, match="has x, y but not heading"):
        model.windows(commanded(x=np.zeros(120), y=np.zeros(120)), 2.0)
    with pytest.raises(RecordingError, match="no output to compare with"):
        model.windows(commanded(), 2.0)
    with pytest.raises(RecordingError, match="too short or too coarse"):
        model.windows(record_drive(1.0, np.random.default_rng(0)), 2.0)
    with pytest.raises(ModelError, match=r"did you mean 'yaw_slip'"):
        record_drive(1.0, np.random.default_rng(0), {"yaw_slipp": {"share": 0.1}})


def test_scales_come_from_the_data():
    fast = record_drive(
        40.0, np.random.default_rng(3), limits=Limits(max_speed=4.0), step=0.1, model=PoseReaching(WARTHOG)
    )
    scaled = PoseReaching().scaled_to([replace(fast, known={"track": WARTHOG.track})])
    (limit,) = scaled.effect("actuator_saturation").parameters
    assert 3.0 < limit.starts[0] < 7.0
    assert scaled.effect("actuator_lag").parameters[0].starts[0] == pytest.approx(0.05)
    assert scaled.names == PoseReaching().names


def test_a_recording_is_repeatable_and_survives_a_file(tmp_path):
    first, again = (record_drive(8.0, np.random.default_rng(5), FAULTS, episodes=2) for _ in range(2))
    assert all(np.array_equal(first[name], again[name]) for name in first.signals)
    save_recording(first, tmp_path / "drive.csv")
    loaded = load_recording(tmp_path / "drive.csv", get_model("pose_reaching"))
    assert all(np.array_equal(first[name], loaded[name]) for name in loaded.signals)
    assert len(loaded.bounds) == 2


def test_realities_name_its_effects():
    assert set(FAULTS) == {effect.name for effect in PoseReaching().effects}
    reality = Reality(effects=FAULTS)
    assert reality.vector(PoseReaching())[PoseReaching().index("yaw_slip.share")] == 0.2


def test_robots_in_play_and_the_model_are_one_physics():
    # The environment's robots go from instant to instant, the model in closed form along its windows.
    rules, open_floor = Rules(timeout=60.0), {"field": Field(1e3, 1e3), "arrival": Arrival(1e-9, 1e-9)}
    model, limits = PoseReaching(), rules.limits
    recording = commanded(120, seed=6, left_wheel=np.zeros(120), right_wheel=np.zeros(120))  # from rest
    recording = replace(recording, time=np.arange(120) * rules.tick)
    start = (1.0, -2.0, 0.5)
    for faults in ({}, FAULTS):
        q = model.vector(effects=faults)
        robots = Robots(1, rules, q, **open_floor)
        robots.seed(0, np.random.default_rng(0))
        robots.restart([0], start)
        shown = [robots.observe().poses[0]]
        for speed, rate in zip(recording["speed"], recording["turn_rate"], strict=True):
            action = np.array([[2 * speed / limits.max_speed - 1, rate / limits.max_rate]], dtype=np.float32)
            shown.append(robots.advance(action).poses[0])
        first = (*start[:2], start[2] + (0.3 if faults else 0.0))
        expected = model.simulate(q, whole(model, recording, first))[0, 0]
        error = np.array(shown[:-1]) - expected[:, :3]
        error[:, 2] = np.remainder(error[:, 2] + np.pi, 2 * np.pi) - np.pi
        assert np.abs(error).max() < (6e-3 if faults else 1e-5)  # actions are float32
