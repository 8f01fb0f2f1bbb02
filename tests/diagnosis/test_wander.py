"""Noise that wanders is no fault: its likelihood against SciPy, and what is said of such records."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import multivariate_normal

from exam.benches import Conditions, Hidden, get_bench
from exam.cases import cases_of
from exam.sizes import recordings, records
from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.answer import headline, what_to_do
from fieldmodels.diagnosis.wander import _Walks, beside_returning, is_steady, wander, wandering_zeros
from fieldmodels.machines.excitation import model as excitation
from fieldmodels.model import Signal

FEATURES = 4
OUTPUTS = np.repeat([0, 1], FEATURES)


def fitted(residual, jacobian=None):
    """A fit of windows of two sensors without states: what is left, and columns that are free."""
    windows = len(residual)
    recording = Recorded(np.arange(float(windows)), np.zeros(windows, int))
    part = SimpleNamespace(windows=SimpleNamespace(recording=recording, starts=np.arange(windows)))
    model = SimpleNamespace(
        outputs=(Signal("a", "m"), Signal("b", "m")), states=(), measured_states={}, noisy_inputs=False,
        random_force=False,
    )  # fmt: skip
    problem = Sensors(model, (part,), windows)
    columns = np.zeros((windows, 2 * FEATURES, 0)) if jacobian is None else jacobian
    fit = SimpleNamespace(
        residual=residual, jacobian=columns, active=np.ones(columns.shape[2], bool),
        states=np.zeros((windows, 0)),
        basis=np.zeros((windows, 2 * FEATURES, 0)), whitener=np.eye(2 * FEATURES), weight=None, runs=None,
    )  # fmt: skip
    return problem, fit


class Sensors:
    """A problem of two sensors, a window a second."""

    outputs, events, horizon, state_scale = OUTPUTS, np.zeros(2 * FEATURES, bool), 1.0, np.zeros(0)

    def __init__(self, model, parts, windows):
        self.model, self.windows = model, windows
        self.parts = parts

    def __len__(self):
        return self.windows

    def resolved(self, output):
        return 0.0

    @property
    def zeros(self):
        return {j: np.repeat((j == OUTPUTS)[None] * 1.0, self.windows, axis=0) for j in (0, 1)}


class Recorded:
    def __init__(self, time, episode):
        self.time, self.episode = time, episode

    def __len__(self):
        return len(self.time)


def walked(windows, pace, rng):
    """Offsets that had walked as long before."""
    steps = rng.normal(size=windows) * np.sqrt(pace / windows)
    steps[0] = rng.normal() * np.sqrt(pace)
    return np.cumsum(steps)


@pytest.mark.parametrize("returns", [0.0, 5.0])
@pytest.mark.parametrize(("paces", "share"), [({0: 3.0}, 1.0), ({0: 3.0, 1: 0.2}, 0.3)])
def test_the_likelihood_is_that_of_a_gaussian_with_walks(paces, share, returns):
    rng = np.random.default_rng(1)
    windows = 12
    residual = rng.normal(size=(windows, 2 * FEATURES))
    problem, fit = fitted(residual)
    covariance = np.zeros((windows, 2 * FEATURES, windows, 2 * FEATURES))
    times = 1.0 + np.arange(windows) / windows  # in durations: it began one before
    walk = np.minimum(times[:, None], times[None])
    if returns:
        walk = np.exp(-returns * np.abs(times[:, None] - times)) / (2.0 * returns)
    for w in range(windows):
        block = np.eye(2 * FEATURES)
        for j in paces:
            one = (j == OUTPUTS) / np.sqrt(FEATURES)
            block -= (1.0 - share) * np.outer(one, one)
        covariance[w, :, w] += block
    for j, pace in paces.items():
        own = (j == OUTPUTS).astype(float)
        covariance += pace * walk[:, None, :, None] * own[None, :, None, None] * own
    size = residual.size
    exact = -multivariate_normal(np.zeros(size), covariance.reshape(size, size)).logpdf(residual.ravel())
    (cost,) = _Walks(problem, fit, returns).costs([*paces], np.array([[*paces.values()]]), np.array([share]))
    assert cost + 0.5 * size * np.log(2 * np.pi) == pytest.approx(exact)


def returning(windows, decay, rng):
    """Offsets of variance one that return to zero."""
    steps = rng.normal(size=windows) * np.sqrt(1.0 - decay**2)
    steps[0] = rng.normal()
    return lfilter([1.0], [1.0, -decay], steps)


def gain_of_an_offset(residual):
    """Of a constant offset of the second sensor beside zeros that return, and whether it is steady."""
    problem, parent = fitted(residual)
    column = np.repeat((OUTPUTS == 1)[None, :, None] * 1.0, len(residual), axis=0)
    problem, child = fitted(residual, column)
    return beside_returning(problem, parent, child), is_steady(parent, child)


def test_an_offset_is_told_from_zeros_that_return():
    """By no more than generalised least squares with the true covariance, which nobody knows, says."""
    rng, windows, decay = np.random.default_rng(11), 200, 0.5
    own = np.tile(OUTPUTS == 1, windows)
    times = np.arange(windows)
    zero = decay ** np.abs(times[:, None] - times)
    covariance = np.kron(zero, np.outer(OUTPUTS == 1, OUTPUTS == 1)) + np.eye(own.size)
    weighed = np.linalg.solve(covariance, own * 1.0)
    for offset in (0.0, 2.0):
        noise = returning(windows, decay, rng)[:, None] * (OUTPUTS == 1)
        residual = rng.normal(size=(windows, 2 * FEATURES)) + noise + offset * (OUTPUTS == 1)
        exact = 0.5 * (weighed @ residual.ravel()) ** 2 / (weighed @ own)
        gain, steady = gain_of_an_offset(residual)
        assert gain < exact + 1.0
        assert (gain > 16.0) == bool(offset)
        assert steady


def test_walks_hold_no_offset():
    rng = np.random.default_rng(13)
    for _ in range(20):
        walk = walked(200, 30.0, rng)[:, None] * (OUTPUTS == 1)
        assert gain_of_an_offset(rng.normal(size=(200, 2 * FEATURES)) + walk)[0] < 5.0


def test_a_ramp_is_not_steady():
    rng, time = np.random.default_rng(12), np.linspace(0.0, 1.0, 50)
    ramp = (time[:, None] * (OUTPUTS == 1))[:, :, None]
    _, parent = fitted(rng.normal(size=(50, 2 * FEATURES)) + 9.0 * ramp[:, :, 0])
    _, child = fitted(parent.residual, ramp)
    assert not is_steady(parent, child)


def test_columns_that_say_the_same_twice_count_once():
    rng = np.random.default_rng(7)
    residual, column = rng.normal(size=(60, 2 * FEATURES)), rng.normal(size=(60, 2 * FEATURES, 1))
    tried = np.array([[1.0], [100.0]]), np.array([0.3, 0.3])
    once, twice = (
        _Walks(*fitted(residual, columns)).costs([0], *tried) for columns in (column, column[:, :, [0, 0]])
    )
    assert twice == pytest.approx(once, rel=1e-9)


def test_a_walk_is_found_and_white_noise_is_none():
    rng = np.random.default_rng(2)
    white = rng.normal(size=(60, 2 * FEATURES))
    assert wander(*fitted(white), 1.0).gain < 2.0
    walking = white + walked(60, 30.0, rng)[:, None] * (OUTPUTS == 1)
    found = wander(*fitted(walking), 1.0)
    assert found.outputs == (1,)
    assert found.gain > 20.0


def test_how_far_a_zero_wanders_is_said_where_it_certainly_does():
    """Of a walk and of a drift; white noise and an offset that stays say nothing."""
    rng = np.random.default_rng(4)
    white = rng.normal(size=(60, 2 * FEATURES))
    for zero in (walked(60, 30.0, rng), np.linspace(0.0, 4.0, 60)):
        problem, fit = fitted(white + zero[:, None] * (OUTPUTS == 1))
        said = wandering_zeros(problem, fit, 1.0)
        assert said == {"b": pytest.approx(zero.std(), rel=0.25)}
    assert wandering_zeros(*fitted(white), 1.0) == {}
    assert wandering_zeros(*fitted(white + 0.3 * (OUTPUTS == 1)), 1.0) == {}
    once = white + 30.0 * (np.arange(60) == 20)[:, None] * (OUTPUTS == 1)
    assert wandering_zeros(*fitted(once), 1.0) == {}


@pytest.mark.matrix(
    keep=(
        "white",
        "quantised",
    )
)
@pytest.mark.parametrize("noise", ["white", "heavy_tailed", "bursting", "quantised"])
def test_noise_that_does_not_wander_is_not_said_to(noise):
    bench = get_bench("pendulum")
    train, test = recordings(bench, (), Conditions(noise=noise), 90_001)
    assert diagnose(bench.model, [train], [test]).wandering == {}


def test_a_tracker_that_drifts_is_not_biased():
    """A drift is no walk, but nearly: its zero wanders, it says, as far as it did, and names no bias."""
    bench, size = get_bench("uav_route"), 19.0
    train, test = recordings(bench, [Hidden("drifting_tracker", size)], Conditions(), 8004)
    found = diagnose(bench.model, [train], [test])
    assert (found.verdict, [c.effect for c in found.causes]) == ("consistent", [])
    assert found.wandering["north"] == pytest.approx(2.0 * size / np.sqrt(12.0), rel=0.5)
    assert found.of_sensors[0][1:] in found.summary()
    assert found.of_sensors[0] in headline(found)
    assert "Zero that sensor" in " ".join(what_to_do(found))
    assert found.to_json()["wandering"].keys() == found.wandering.keys()


def test_what_a_free_column_explains_is_no_walk():
    rng = np.random.default_rng(3)
    shape = np.sin(np.arange(60) / 10.0)[:, None, None] * (OUTPUTS == 1)[None, :, None]
    residual = rng.normal(size=(60, 2 * FEATURES)) + 3.0 * shape[:, :, 0]
    assert wander(*fitted(residual), 1.0).gain > 20.0
    assert wander(*fitted(residual, shape), 1.0).gain < 2.0


@pytest.mark.matrix(
    keep=(
        "rig-1012",
        "rig-1042",
        "line_following-1036",
        "line_following-1010",
    )
)
@pytest.mark.parametrize(
    ("machine", "seed"),
    [
        ("rig", 1012),  # errors of 5 times the white noise
        ("rig", 1042),  # in closed loop; a curve of the velocity's sensor over time
        ("pose_reaching", 1050),  # the measured wheels wander, and drive
        ("line_following", 1036),  # the start of a window is what a wandering sensor shows
        ("line_following", 1010),
        ("heel_strike", 1007),  # a step brings 85 nats beside walks, and walks 103 beside it
        ("heel_strike", 1022),  # a force over time, by a walk of which the start is measured, too
        ("differential_drive", 1024),  # in closed loop; a wheel's sensor over time
        ("pose_reaching", 1066),  # the same; a turn rate over the place, along which it drives
    ],
)
def test_a_sensor_that_wanders_is_nothing_missing(machine, seed):
    case = next(c for c in cases_of("develop", [machine], ["nothing"]) if c.seed == seed)
    assert case.conditions.noise == "random_walk"
    bench = get_bench(machine)
    logs = records(bench, (), case.conditions, seed)
    train, test = (bench.recording(log, case.conditions, seed) for log in logs)
    found = diagnose(bench.model, [train], [test])
    assert (found.verdict, found.possible) == ("consistent", ())


def test_a_shaken_vehicle_is_simulated_as_finely_as_its_model_says(monkeypatch):
    """Else its error is named on data that are nearly free of noise (accelerometer gain, soil)."""
    bench = get_bench("excitation")
    model, case = bench.model, next(iter(cases_of("develop", ["excitation"], ["nothing"])))
    record = bench.recording(records(bench, (), case.conditions, 7)[0], case.conditions, 7)
    windows, vector = model.windows(record, 0.8), np.array([p.nominal for p in model.all_parameters])
    shown = []
    for step in (excitation.STEP, excitation.STEP / 4):
        monkeypatch.setattr(excitation, "STEP", step)
        shown.append(model.simulate(vector[None], windows)[0])
    off = np.sqrt(np.nanmean((shown[1] - shown[0]) ** 2, axis=(0, 1))) / np.nanstd(shown[1], axis=(0, 1))
    assert (off < model.resolution).all()
    assert (off > 0.2 * np.array(model.resolution)).all()


@pytest.mark.parametrize("seed", [1023, 1048])
def test_a_walker_that_its_law_alone_steers_lacks_nothing(seed):
    """The command follows what a robot really does, and a start that is measured errs."""
    bench = get_bench("line_following")
    train, test = recordings(bench, (), Conditions(commands="law"), seed)
    found = diagnose(bench.model, [train], [test])
    assert (found.verdict, found.possible) == ("consistent", ())


def test_a_bias_is_found_where_errors_are_white_but_smaller_than_they_are_weighed():
    """On few windows errors along a sensor's offset are smaller than their weights say; that is no walk."""
    bench = get_bench("excitation")
    train, test = recordings(bench, [Hidden("accelerometer_bias", 3.0)], Conditions(), 2019)
    assert [cause.effect for cause in diagnose(bench.model, [train], [test]).causes] == ["accelerometer_bias"]
