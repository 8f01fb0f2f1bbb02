"""The walker's observer: its gain against Riccati's equation, and turns that a law's own commands hide."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from exam.benches import Conditions, Hidden, get_bench
from exam.plants import walk
from exam.sizes import recordings
from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.fit import fit
from fieldmodels.diagnosis.gain import predict
from fieldmodels.diagnosis.problem import build
from fieldmodels.diagnosis.response import averaged, offsets, segments
from fieldmodels.drivers.curved import Curved, FreeCurve
from fieldmodels.machines.line_following.observer import observer_gain
from fieldmodels.recording import Recording

OUTPUTS = ("line", "offset", "heading")


def of_riccati() -> np.ndarray:
    """Gain of the stationary Kalman filter of the plant, linear about the line."""
    robot, small = walk.Walker(), 1e-5
    here = robot.look(np.zeros(1), np.zeros(1))
    line = [
        (robot.look(np.array([a]), np.array([b])) - here)[0] / small for a, b in ((small, 0.0), (0.0, small))
    ]
    seen = np.array([line, [1.0, 0.0], [0.0, 1.0]])
    onward = np.array([[1.0, robot.stride], [0.0, 1.0]])
    chance = np.diag([walk.NOISE["lateral"], walk.NOISE["yaw"]]) ** 2
    noise = np.diag([walk.NOISE[name] for name in OUTPUTS]) ** 2
    spread = solve_discrete_are(onward.T, seen.T, chance, noise)
    return onward @ spread @ seen.T @ np.linalg.inv(seen @ spread @ seen.T + noise)


@pytest.mark.every("commands", ["", "law"])
def test_the_gain_is_that_of_a_kalman_filter_whether_or_not_the_law_adds_anything(commands):
    """From 20,000 strides to 0.04; standard errors are of 0.01."""
    conditions = Conditions(duration=24_000.0, commands=commands)
    train, _ = recordings(get_bench("line_following"), [], conditions, 7)
    assert observer_gain([train], OUTPUTS) == pytest.approx(of_riccati(), abs=0.04)


def test_short_records_have_no_observer():
    bench = get_bench("line_following")
    train, _ = recordings(bench, [], Conditions(duration=100.0), 7)
    assert observer_gain([train], OUTPUTS) is None
    assert not bench.model.scaled_to([train]).corrected


def test_the_law_that_answers_to_chance_makes_no_turn_seem_smaller():
    """Errors over seven strides had put a gain 1.5 standard errors too low on average, a lost turn 1.9 high.

    The mean of 8 standardised errors has a standard deviation of 0.35.
    """
    bench, off = get_bench("line_following"), []
    for seed in range(5_000, 5_008):
        train, test = recordings(bench, [Hidden("turn_gain", 3.0, -1)], Conditions(), seed)
        causes = diagnose(bench.model, [train], [test]).causes
        assert [cause.effect for cause in causes] == ["turn_gain"]
        gain = causes[0].parameters["factor"]
        off.append((gain.value - bench.values("turn_gain", 3.0, -1, seed)["factor"]) / gain.std)
    assert abs(np.mean(off)) < 1.0
    assert np.sqrt(np.mean(np.square(off))) < 1.8


def test_its_errors_are_innovations():
    """Alike at every sample of a window, its start included, and not foretold by those before, of any output.

    Of 2500 windows a correlation has a standard error of 0.02, a ratio of variances of 0.04.
    """
    train, _ = recordings(get_bench("line_following"), [], Conditions(duration=24_000.0), 5)
    model = get_bench("line_following").model.scaled_to([train])
    problem = build(model, [train], model.horizons[1])
    nominal, none = model.nominal, np.zeros(0, dtype=np.int64)
    fitted = fit(problem, nominal, none, np.diag(1.0 / problem.output_scale))
    assert (
        np.abs(fitted.states - problem.states).max() < 1e-5
    )  # a start that moved would hold the window's chance
    errors = np.stack([fitted.raw[:, problem.outputs == j] for j in range(3)], axis=2)
    errors = errors / errors.std(axis=(0, 1))
    _, samples, outputs = errors.shape
    assert np.mean(errors**2, axis=0) == pytest.approx(np.ones((samples, outputs)), abs=0.2)
    for lag in (1, 2, 3):
        before, after = errors[:, :-lag].reshape(-1, outputs), errors[:, lag:].reshape(-1, outputs)
        assert np.abs(before.T @ after / len(after)).max() < 0.05


@pytest.fixture(scope="module")
def short_walks():
    """Windows of eight strides, each an episode of its own: nothing was measured before they start."""
    bench = get_bench("line_following")
    train, _ = recordings(bench, [], Conditions(), 11)
    count = len(train) // 8 * 8
    signals = {name: values[:count] for name, values in train.signals.items()}
    apart = Recording(train.time[:count], signals, train.units, np.repeat(np.arange(count // 8), 8))
    model = bench.model.scaled_to([apart])
    assert model.corrected
    return build(model, [apart], model.horizons[1])


def gained(problem, factor):
    """Simulated windows of a camera whose scale is wrong."""
    model, windows = problem.model, problem.parts[0].windows
    return model.simulate(model.vector(effects={"sensor_gain": {"factor": factor}})[None], windows)[0]


def test_a_curve_of_a_sensor_is_not_believed_by_the_observer(short_walks):
    """One in proportion to the line is a gain of the camera, which the kernel has by itself."""
    model, windows = short_walks.model, short_walks.parts[0].windows
    knots = np.array([-2.0, 2.0])
    curved = Curved(model, [FreeCurve("sensor", "line", "line", knots, knots[:, None])])
    found = curved.simulate(np.append(model.nominal, 0.2)[None], windows)[0]
    expected, nominal = gained(short_walks, 1.2), gained(short_walks, 1.0)
    places = np.abs(nominal - expected)[..., 1:].max()  # of the robot, which it would take the error for
    assert places > 0.005
    assert np.abs(found - expected).max() < 0.1 * places


def test_what_is_made_of_a_sensors_offset_is_in_its_response(short_walks):
    problem, part = short_walks, short_walks.parts[0]
    model, none = problem.model, np.zeros(0, dtype=np.int64)
    fitted = fit(problem, model.nominal, none, np.diag(1.0 / problem.output_scale), iterations=0)
    nominal = gained(problem, 1.0)
    segment = segments(part.windows.lengths, part.windows.samples)
    line = averaged(nominal[:, :, 0], segment)
    found = np.einsum("wfk,wk->wf", offsets(problem, 0, fitted), line)
    expected = part.compressed((gained(problem, 1.01)[None] - nominal) / 0.01)[0]
    off = np.sqrt(np.mean((found - expected) ** 2) / np.mean(expected**2))
    assert off < 0.02
    believing = np.einsum("wfk,wk->wf", offsets(problem, 0), line)
    assert np.sqrt(np.mean((believing - expected) ** 2) / np.mean(expected**2)) > 0.1


def test_gains_are_measured_on_windows_that_nothing_puts_right(short_walks):
    found = predict(short_walks, short_walks.model.nominal)
    windows = short_walks.parts[0].windows.with_states(found.states)
    free = get_bench("line_following").model.simulate(short_walks.model.nominal[None], windows)[0]
    assert np.array_equal(found.simulated[0], free)
    assert not np.array_equal(gained(short_walks, 1.0), free)


def test_no_zero_wanders_by_a_millionth_of_the_noise():
    bench = get_bench("line_following")
    train, test = recordings(bench, [], Conditions(factor=1e-6), 3)
    found = diagnose(bench.model, [train], [test])
    assert (found.verdict, dict(found.wandering)) == ("consistent", {})
