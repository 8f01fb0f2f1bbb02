"""Slow processes with a hidden state: two tanks in a cascade, simulated here by SciPy."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fieldmodels.diagnosis import diagnose, statements
from fieldmodels.diagnosis.fit import fit
from fieldmodels.diagnosis.linearisation import PRIOR
from fieldmodels.diagnosis.problem import build
from fieldmodels.diagnosis.whole import LONGER, WholeRecords
from fieldmodels.model import Effect, Model, Parameter, Signal
from fieldmodels.recording import Recording

STEP, COUNT = 5.0, 600
TRUE = {"pump": 0.05, "upper": 0.06, "lower": 0.045}


class Tanks(Model):
    """A pump fills an upper tank, which drains into a lower one, whose level alone is measured.

    upper' = pump u - k1 sqrt(upper),  lower' = k1 sqrt(upper) - k2 sqrt(lower); above ``top`` it spills.
    """

    name = "tanks"
    inputs = (Signal("voltage", "V"),)
    outputs = (Signal("lower", "V", noise=0.02),)
    states = (Signal("upper", "V", noise=3.0), Signal("lower", "V", noise=0.02))
    parameters = (
        Parameter("pump", "1/s", 0.1, 1e-3, 10.0, 0.01),
        Parameter("upper", "1/s", 0.1, 1e-3, 10.0, 0.01),
        Parameter("lower", "1/s", 0.1, 1e-3, 10.0, 0.01),
    )
    effects = (
        Effect("overflow", "A tank spills.", "environment",
               (Parameter("top", "V", 30.0, 1.0, 30.0, 0.5, starts=(10.0, 8.0, 6.0)),)),
        Effect("leak", "Water is lost.", "environment", (Parameter("rate", "V/s", 0.0, -1.0, 1.0, 0.005),)),
    )  # fmt: skip
    horizons = (60.0, 100.0)

    def simulate(self, parameters, windows):
        pump, k1, k2, top, leak = np.atleast_2d(parameters).T[:, :, None]
        voltage = windows.recording["voltage"]
        first = np.repeat(windows.states[None, :, 0], len(pump), axis=0)
        second = np.repeat(windows.states[None, :, 1], len(pump), axis=0)
        out = np.empty((len(pump), len(windows), windows.samples, 1))

        def rates(upper, lower, u):
            down = k1 * np.sqrt(np.maximum(upper, 0.0))
            return pump * u - down, down - k2 * np.sqrt(np.maximum(lower, 0.0)) - leak

        for n in range(windows.samples):
            out[:, :, n, 0] = second
            u = voltage[np.minimum(windows.starts + n, len(voltage) - 1)]
            a, b = rates(first, second, u)
            c, d = rates(np.minimum(first + STEP * a, top), second + STEP * b, u)
            first = np.minimum(first + 0.5 * STEP * (a + c), top)
            second = second + 0.5 * STEP * (b + d)
        return out

    def initial_states(self, recording, starts):
        return np.column_stack([np.full(len(starts), 4.0), recording["lower"][starts]])


def record(seed, top=np.inf, worn=0.0):
    """The same tanks by an adaptive integrator.

    Args:
        seed: Of the voltage and the noise.
        top: Level at which the upper tank is full.
        worn: What the pump loses of each volt, a volt.
    """
    rng = np.random.default_rng(seed)
    voltage = np.repeat(rng.uniform(1.0, 4.5, COUNT // 20), 20)

    def rates(t, x):
        down = TRUE["upper"] * np.sqrt(max(x[0], 0.0))
        volts = voltage[min(int(t / STEP), COUNT - 1)]
        into = TRUE["pump"] * volts * (1.0 - worn * volts) - down
        return [min(into, 0.0) if x[0] >= top else into, down - TRUE["lower"] * np.sqrt(max(x[1], 0.0))]

    time = np.arange(COUNT) * STEP
    run = solve_ivp(rates, (0.0, time[-1]), [7.0, 5.0], t_eval=time, max_step=STEP / 2, rtol=1e-6)
    return Recording(time, {"voltage": voltage, "lower": run.y[1] + 0.02 * rng.normal(size=COUNT)})


@pytest.fixture(scope="module")
def spilling():
    return record(1, top=8.0), record(2, top=8.0)


@pytest.mark.nightly
def test_the_overflow_is_found_over_whole_records(spilling):
    train, test = spilling
    diagnosis = diagnose(Tanks(), [train], [test], window="record")
    assert [c.effect for c in diagnosis.causes] == ["overflow"]
    assert diagnosis.causes[0].parameters["top"].value == pytest.approx(8.0, abs=0.3)
    for name, value in TRUE.items():
        found = diagnosis.parameters[name]
        assert found.value == pytest.approx(value, rel=0.03)
        assert found.std < 0.02 * value
    assert not diagnosis.undetermined
    assert diagnosis.gain["lower"].rmse_after < 0.04
    assert isinstance(diagnosis.machine, Tanks)


def test_a_run_has_one_start_and_its_windows_follow_from_it(spilling):
    model = WholeRecords(Tanks())
    problem = build(model, [spilling[0]], 100.0)
    assert np.ptp(problem.states, axis=0) == pytest.approx(0.0)
    vector, states = model.nominal, problem.states
    pieces = problem.samples(vector, states)[0]
    plain = build(Tanks(), [spilling[0]], STEP * (COUNT - 1) / 10)
    whole = plain.parts[0].windows
    run = replace(
        whole, starts=np.array([0]), lengths=np.array([COUNT]), states=states[:1],
        observed=np.ones((1, COUNT, 1), bool),
    )  # fmt: skip
    one = Tanks().simulate(vector[None], run)[0, 0, :, 0]
    for start, piece in zip(problem.parts[0].windows.starts, pieces[:, :, 0], strict=True):
        assert np.array_equal(piece, one[start : start + len(piece)])


def test_a_fit_of_runs_is_that_of_one_long_window(spilling):
    """Windows that share a start, against the same least squares written out for one vector of errors."""
    model = WholeRecords(Tanks())
    problem = build(model, [spilling[0]], 100.0)
    start = model.vector({"pump": 0.06, "upper": 0.07, "lower": 0.05})
    free = np.arange(3)
    weight = np.diag(1 / problem.output_scale)
    here = fit(problem, start, free, weight, iterations=0)

    def errors(z):
        vector = start.copy()
        vector[:3] = start[:3] * np.exp(z[:3])
        states = problem.states + z[3:] * problem.state_scale
        raw = problem.features - problem.simulate(vector[None], states)[0]
        return np.r_[(raw @ weight.T).ravel(), -z[3:] / PRIOR]

    jacobian = np.column_stack([(errors(1e-5 * one) - errors(-1e-5 * one)) / 2e-5 for one in np.eye(5)])
    expected = np.linalg.inv(jacobian.T @ jacobian)[:3, :3]
    assert np.linalg.inv(here.information) == pytest.approx(expected, rel=0.1)
    step = -np.linalg.lstsq(jacobian, errors(np.zeros(5)), rcond=None)[0]
    assert here.cost == pytest.approx(0.5 * np.sum(errors(np.zeros(5)) ** 2))
    found = here.state_residual[0] - here.state_jacobian[0] @ step[:3]
    assert found == pytest.approx(step[3:], rel=0.1, abs=0.02)


@pytest.mark.nightly
def test_short_windows_mislead_and_where_they_determine_little_whole_records_are_proposed(
    spilling, monkeypatch
):
    """Windows of four samples find no overflow, and say how little they know if that is asked of them."""

    class Brief(Tanks):
        horizons = (15.0, 20.0)

    monkeypatch.setattr(statements, "POORLY_KNOWN", 0.05)
    brief = diagnose(Brief(), [spilling[0]], [spilling[1]])
    assert brief.causes == ()
    assert brief.undetermined
    assert LONGER in brief.notes
    whole = diagnose(Brief(), [spilling[0]], [spilling[1]], window="record")
    assert [c.effect for c in whole.causes] == ["overflow"]
    assert LONGER not in whole.notes


@pytest.mark.nightly
def test_what_is_not_listed_is_seen_over_whole_records():
    """Errors of six times the noise; where walks had no way to count for whole records, no curve had one."""

    class Watertight(Tanks):
        effects = Tanks.effects[:1]

        def simulate(self, parameters, windows):
            given = np.atleast_2d(parameters)
            return super().simulate(np.column_stack([given, np.zeros(len(given))]), windows)

    diagnosis = diagnose(Watertight(), [record(1, worn=0.02)], [record(2, worn=0.02)], window="record")
    assert diagnosis.verdict == "unknown"
    assert diagnosis.curves[0].certain
    assert diagnose(Watertight(), [record(1)], [record(2)], window="record").verdict == "consistent"
