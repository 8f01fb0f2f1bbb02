"""The excitation model for diagnosis: effects that are off, what each one does, and its recordings."""

import numpy as np
import pytest

from fieldmodels.arrays import FloatArray
from fieldmodels.machines.excitation.declaration import NUMBERS
from fieldmodels.machines.excitation.dynamics import SUBSTEPS, simulate
from fieldmodels.machines.excitation.model import ExcitationModel, with_derivatives
from fieldmodels.machines.excitation.motion import arm_motion
from fieldmodels.machines.excitation.parameters import NAMES, SAMPLE, SOFT, TABLE1
from fieldmodels.machines.excitation.recording import record_experiment, shaking
from fieldmodels.recording import Recording, RecordingError
from fieldmodels.registry import get_model

MODEL = ExcitationModel()
COMMANDS = np.array([[0.9, 9.0, 0.4], [0.3, 12.0, -0.8], [1.2, 4.0, 0.9]])


def run(mode: int = 0, step: float = SAMPLE) -> Recording:
    """A recording of 1.2 s whose outputs are empty."""
    motion, _ = arm_motion(COMMANDS, 25.0, start=(0.0, 1.0, 0.3), per_decision=round(0.4 / step))
    n = len(motion)
    signals = {"arm_angle": motion[:, 0], "arm_axis": np.full(n, mode + 1.0)}
    signals |= {signal.name: np.zeros(n) for signal in MODEL.outputs}
    return Recording(time=np.arange(n) * step, signals=signals)


def predicted(recording: Recording, effects: dict[str, dict[str, float]] | None = None) -> FloatArray:
    """Outputs of the one long window, shape (samples, 11)."""
    windows = MODEL.windows(recording, 1.2)
    return MODEL.simulate(MODEL.vector(effects=effects), windows)[0, 0]


def test_it_is_registered_with_table_ones_unknowns() -> None:
    model = get_model("excitation")
    assert tuple(p.name for p in model.parameters) == NAMES
    assert len(model.names) == len(NUMBERS)
    assert model.nominal[:22] == pytest.approx(SOFT)
    assert ExcitationModel("table1").nominal[:22] == pytest.approx(TABLE1)
    assert sum(p.refitted for p in model.parameters) == 12
    assert all(p.refitted for p in ExcitationModel(refit_body=True).parameters)


@pytest.mark.every("mode", [0, 1, 2])
def test_it_is_the_experiments_own_dynamics(mode: int) -> None:
    """From the commanded angle alone, 0.4 % of each sensor's largest value: a spline rounds jerks."""
    fine, _ = arm_motion(COMMANDS, 25.0, start=(0.0, 1.0, 0.3), per_decision=80 * SUBSTEPS)
    signals = simulate(SOFT, fine, MODEL.arm.row(), SAMPLE)[0, mode]
    outputs = predicted(run(mode))[1:]
    for columns, sources in (
        (slice(3, 5), [9, 10]),
        (slice(5, 8), [18, 19, 20]),
        (slice(8, 11), [21, 22, 23]),
    ):
        expected = signals[:, sources]
        assert np.abs(outputs[:, columns] - expected).max() < 4e-3 * np.abs(expected).max()


def test_neutral_effects_change_no_bit() -> None:
    neutral = {e.name: {p.name: p.nominal for p in e.parameters} for e in MODEL.effects}
    assert (predicted(run(), neutral) == predicted(run())).all()


def test_a_batch_is_equal_to_the_bit() -> None:
    windows = MODEL.windows(run(2), 0.4)
    vectors = np.stack([MODEL.vector(effects={"payload": {"mass": 0.01 * k}}) for k in range(3)])
    together = MODEL.simulate(vectors, windows)
    for k in range(3):
        assert (MODEL.simulate(vectors[k], windows)[0] == together[k]).all()


def test_sensors_do_what_their_effects_say() -> None:
    plain = predicted(run())
    biased = predicted(run(), {"accelerometer_bias": {"y": 0.1}, "inclinometer_bias": {"roll": 0.02}})
    expected = plain + np.array([0, 0.1, 0, 0, 0.02, 0, 0, 0, 0, 0, 0])
    assert biased == pytest.approx(expected, abs=1e-12)
    scaled = predicted(run(), {"accelerometer_gain": {"gain": 1.1}, "force_torque_gain": {"gain": 0.9}})
    assert scaled == pytest.approx(plain * np.repeat([1.1, 1.0, 0.9], [3, 2, 6]), abs=1e-12)
    late = predicted(run(), {"inclinometer_delay": {"delay": 4 * SAMPLE}})
    assert late[4:, 3:5] == pytest.approx(plain[:-4, 3:5], abs=1e-12)
    part = predicted(run(), {"inclinometer_delay": {"delay": 0.3 * SAMPLE}})[1:, 3]
    between = 0.7 * plain[1:, 3] + 0.3 * plain[:-1, 3]
    assert np.abs(part - between).max() < 1e-3 * np.abs(plain[:, 3]).max()


def test_a_lagging_arm_moves_like_a_filtered_command() -> None:
    """A long lag smooths the arm's reactions; a short one shifts them by its time constant."""
    plain = predicted(run())[:, 8]
    lagged = predicted(run(), {"actuator_lag": {"time_constant": SAMPLE}})[:, 8]
    shifted = plain[:-1]
    assert np.abs(lagged[1:] - shifted).max() < 0.15 * np.abs(plain).max()
    assert np.abs(lagged - plain).max() > 2 * np.abs(lagged[1:] - shifted).max()
    slow = predicted(run(), {"actuator_lag": {"time_constant": 0.2}})[:, 5]
    assert np.abs(slow).max() < 0.7 * np.abs(predicted(run())[:, 5]).max()


def test_derivatives_of_the_command_are_its_own() -> None:
    motion, _ = arm_motion(COMMANDS, 25.0, start=(0.0, 1.0, 0.3), per_decision=80)
    recording = with_derivatives(run())
    assert recording["arm_rate"] == pytest.approx(motion[:, 1], abs=2e-3)
    assert recording["arm_acceleration"][5:-5] == pytest.approx(
        motion[5:-5, 2], abs=0.4
    )  # jerks jump at decisions


def test_a_recording_agrees_with_the_model_but_for_its_noise() -> None:
    """Simulated eight times finer: what is left is white and of the sensors' size (within 10 %)."""
    recording = record_experiment(np.random.default_rng(4), duration=4.0)
    windows = MODEL.windows(recording, 0.4)
    left = windows.measured(tuple(o.name for o in MODEL.outputs)) - MODEL.simulate(MODEL.nominal, windows)[0]
    ratio = np.sqrt(np.nanmean(left**2, axis=(0, 1))) / [o.noise for o in MODEL.outputs]
    assert ratio == pytest.approx(np.ones(11), rel=0.1)
    assert len(recording.bounds) == 3


def test_shaking_starts_at_rest_and_stays_within_its_limits() -> None:
    angle = shaking(4.0, 0.005, np.random.default_rng(0))
    assert np.abs(np.diff(angle, 2)).max() < 25.1 * 0.005**2
    assert abs(angle[1] - angle[0]) < 0.1 * 25.0 * 0.005**2


@pytest.mark.every("axis", [0.0, 1.5, 4.0])
def test_an_impossible_axis_is_refused(axis: float) -> None:
    recording = run()
    recording.signals["arm_axis"][:] = axis
    with pytest.raises(RecordingError, match=r"arm_axis.*1, 2 or 3"):
        MODEL.windows(recording, 0.4)


def test_an_axis_that_changes_within_a_run_is_refused() -> None:
    recording = run()
    recording.signals["arm_axis"][100:] = 2.0
    with pytest.raises(RecordingError, match="episode"):
        MODEL.windows(recording, 0.4)
