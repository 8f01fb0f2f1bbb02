"""A bench may be a thousand times faster or slower, lighter or heavier: scales, starts and fits follow it.

The benches are integrated exactly by SciPy from their equation, and share no code with the models.
"""

import numpy as np
import pytest
from scipy.signal import cont2discrete, dlsim

from fieldmodels.diagnosis.candidates import Candidates, _parameter_starts
from fieldmodels.diagnosis.problem import build
from fieldmodels.drivers.rates import pace, rate_size, white_noise
from fieldmodels.machine import held_inputs
from fieldmodels.recording import Recording
from fieldmodels.registry import get_model

NOISE = 0.003  # of the position's spread
BENCHES = {
    "a resonance of grams": (69.0, 610.0, 6e-6, 0.02, 20.0, "interpolated"),
    "the same, held": (69.0, 610.0, 6e-6, 0.05, 20.0, "held"),
    "close to half the sampling rate": (20.0, 100.0, 1e3, 0.1, 60.0, "interpolated"),
    "a table-top rig": (1.0, 100.0, 2.0, 0.15, 30.0, "held"),
    "slower than anyone waits": (0.02, 10.0, 500.0, 0.05, 1000.0, "held"),
    "slow, sampled slowly": (0.02, 2.0, 500.0, 0.1, 2000.0, "held"),
    "a kilohertz mirror": (1000.0, 5e4, 1e-4, 0.1, 1.0, "held"),
}


def oscillation(bench, seed=0, shaken=0.0):
    """Forty sines up to 2.5 times the resonance; mass, damping and stiffness."""
    frequency, rate, mass, ratio, duration, hold = BENCHES[bench]
    rng = np.random.default_rng(seed)
    rad = 2 * np.pi * frequency
    true = np.array([mass, 2 * ratio * mass * rad, mass * rad**2])
    time = np.arange(round(duration * rate)) / rate
    force = sum(
        np.sin(2 * np.pi * (f * time + rng.uniform())) for f in rng.uniform(0.05, 2.5, 40) * frequency
    )
    disturbed = force + shaken * np.sin(2 * np.pi * 0.7 * frequency * time)
    matrices = [[0, 1], [-true[2] / mass, -true[1] / mass]], [[0], [1 / mass]], [[1, 0]], [[0]]
    system = cont2discrete([np.array(m) for m in matrices], 1 / rate, "zoh" if hold == "held" else "foh")
    position = dlsim(system, disturbed)[1][:, 0]
    noise = NOISE * np.std(position) * rng.standard_normal(len(time))
    return Recording(time, {"force": force, "position": position + noise}), true


def scaled(bench, record):
    return held_inputs(get_model("rig"), BENCHES[bench][-1]).scaled_to([record])


@pytest.mark.parametrize("bench", BENCHES)
def test_base_parameters_are_found_within_two_per_cent(bench):
    record, true = oscillation(bench)
    model = scaled(bench, record)
    assert [p.starts[0] for p in model.parameters] == pytest.approx(true, rel=0.25)
    problem = build(model, [record], model.horizons[1])
    candidates = Candidates(
        problem=problem, start=model.nominal, fixed=frozenset(), folds=problem.blocks % 4,
        whitener=np.diag(1 / problem.output_scale),
    )  # fmt: skip
    base = candidates.base()
    assert base.fit.parameters[:3] == pytest.approx(true, rel=0.02)
    # Errors are weighed by their own size: half a nat for each average, less what the states take.
    assert 0.3 < base.fit.cost / base.fit.raw.size < 0.51


@pytest.mark.parametrize("bench", BENCHES)
def test_horizons_follow_the_pace_and_hold_enough_samples(bench):
    frequency, rate, *_ = BENCHES[bench]
    record, _ = oscillation(bench)
    short, main, long = scaled(bench, record).horizons
    assert short < main < long
    assert main * rate > 9.5
    assert 0.2 < main * frequency < 2.5


@pytest.mark.parametrize("bench", ["a resonance of grams", "a table-top rig", "slower than anyone waits"])
def test_a_shaking_force_is_sought_where_it_is_whatever_the_pace(bench):
    record, _ = oscillation(bench, seed=1, shaken=0.5)
    expected = 0.7 * BENCHES[bench][0]
    found = scaled(bench, record).scales.frequencies
    assert min(abs(f / expected - 1) for f in found) < 2e-2


@pytest.mark.parametrize("bench", ["a resonance of grams", "a table-top rig", "slower than anyone waits"])
def test_lines_are_sought_around_the_resonance_whatever_the_pace(bench):
    record, _ = oscillation(bench)
    model, resonance = scaled(bench, record), BENCHES[bench][0]
    problem = build(model, [record], model.horizons[1])
    effect = model.effect("periodic_force")
    k = [p.name for p in effect.parameters].index("frequency")
    sought = np.array(_parameter_starts(problem, effect, k))
    near = sought[(sought > 0.5 * resonance) & (sought < 1.5 * resonance)]
    assert len(near) > 10
    assert np.max(np.diff(near)) < 0.1 * resonance


@pytest.mark.parametrize("radians", [0.01, 0.3, 0.7])
def test_rates_and_noise_of_a_sine_at_any_pace(radians):
    rng = np.random.default_rng(3)
    n = np.arange(40_000)
    true, noise = np.sin(radians * n), 0.01 * rng.standard_normal(len(n))
    record = Recording(n * 0.5, {"x": true + noise, "still": np.ones(len(n))})
    assert white_noise(record["x"]) == pytest.approx(0.01, rel=0.1)
    assert rate_size([record], "x") == pytest.approx(radians / 0.5 / np.sqrt(2), rel=0.05)
    assert rate_size([record], "x", 2) == pytest.approx((radians / 0.5) ** 2 / np.sqrt(2), rel=0.15)
    assert pace([record], "x") == pytest.approx(0.5 / radians, rel=0.06)
    assert pace([record], "still") == 0.0
    assert rate_size([record], "absent") == 0.0
