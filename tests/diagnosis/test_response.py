"""The response to a force on segments of a window, against a mass that flies freely."""

import numpy as np

from exam.benches import get_bench
from exam.benches.base import Conditions
from fieldmodels.diagnosis.curves import Curves
from fieldmodels.diagnosis.fit import fit
from fieldmodels.diagnosis.linearisation import PRIOR
from fieldmodels.diagnosis.options import DEFAULT
from fieldmodels.diagnosis.problem import build
from fieldmodels.diagnosis.response import offsets, responses
from fieldmodels.drivers.curved import Curved, FreeCurve
from fieldmodels.drivers.variables import SEGMENTS
from fieldmodels.registry import get_model
from fieldmodels.synthesis import synthesise


def test_a_free_mass_answers_a_unit_force_by_newton_s_law():
    rig = get_model("rig")
    record = synthesise(rig, {}, "mixed", duration=12.0, amplitude=5.0, rng=np.random.default_rng(1))
    problem = build(rig, [record], 0.5)
    vector = rig.vector({"mass": 2.5, "damping": 0.0, "stiffness": 0.0})
    none = np.zeros(0, dtype=np.int64)
    whitener = np.diag(1 / problem.output_scale)
    fitted = fit(problem, vector, none, whitener, iterations=0)
    found = responses(problem, fitted)[""]
    assert found.shape[2] == SEGMENTS
    # All segments together: a constant force of 1 N. Then v = t / m and x = t^2 / 2 m.
    part = problem.parts[0]
    time = record.step * np.arange(part.windows.samples)
    for output, motion in ((0, 0.5 * time**2 / 2.5), (1, time / 2.5)):
        for feature in np.flatnonzero(problem.outputs == output):
            inside = part.slots[0, :, output] == feature
            expected = motion[inside].mean()
            np.testing.assert_allclose(found[:, feature].sum(axis=1), expected, rtol=0.02, atol=1e-5)


def walk():
    """Windows of a leg, fitted nowhere."""
    bench = get_bench("heel_strike")
    leg, conditions = bench.model, Conditions(duration=30.0)
    record = bench.recording(bench.log((), conditions, 1, False), conditions, 1)
    problem = build(leg, [record], 1.0)
    none = np.zeros(0, dtype=np.int64)
    return problem, fit(problem, leg.vector({}), none, np.diag(1 / problem.output_scale), iterations=0)


def test_a_gyro_that_shows_more_makes_strides_close_worse():
    problem, _ = walk()
    part, gyro, closure = problem.parts[0], 0, 2
    shifts = offsets(problem, gyro).sum(axis=2)
    np.testing.assert_allclose(shifts[:, problem.outputs == gyro], 1.0)
    strikes = np.flatnonzero(part.windows.recording["strike"] > 0.5)
    seen = 0
    for window, start in enumerate(part.windows.starts):
        for sample in np.flatnonzero(part.slots[window, :, closure] >= 0):
            then = start + sample
            latest = max(start, strikes[strikes < then].max(initial=-1))
            turned = (then - latest) * part.windows.recording.step  # of one radian per second too much
            found = shifts[window, part.slots[window, sample, closure]]
            np.testing.assert_allclose(found, -turned, rtol=1e-9, atol=1e-12)
            seen += turned > 0
    assert seen > 10


def test_a_curve_of_a_gyro_moves_what_is_derived_from_it():
    """One that is the same everywhere is a bias, in the closures and the push-off as in the readings."""
    problem, fitted = walk()
    model, windows, bias = problem.model, problem.parts[0].windows, 0.01
    curved = Curved(
        model, [FreeCurve("sensor", "gyro", "gyro", np.array([-2.0, 2.0]), np.full((2, 1), bias))]
    )
    true = windows.states - [0.0, bias]  # the start is what the gyro reads
    found = curved.simulate(np.append(fitted.parameters, 1.0)[None], windows.with_states(true))[0]
    effect = model.vector(effects={"gyro_bias": {"rate": bias}})
    expected = model.simulate(effect[None], windows)[0]
    without = model.simulate(model.nominal[None], windows)[0]
    for j, largest in enumerate((1e-12, 1e-12, 1e-12, 1e-12, 1e-3)):
        seen = windows.observed[..., j]
        assert np.abs((found - expected)[seen, j]).max() < largest
        assert np.abs((without - expected)[seen, j]).max() > (0.05 if j == 4 else 1e-4)


def test_an_erring_sensor_errs_at_the_start_too():
    """A bias of the gyro alone is all of the misfit, at the start as later."""
    problem, fitted = walk()
    curves = Curves(problem, fitted, DEFAULT)
    curve = next(
        c for c in curves.all if c.place == "sensor" and c.target == "gyro" and c.shapes.shape[1] > 2
    )
    states = [s.name for s in problem.model.states]
    expected = np.zeros(len(states))
    expected[states.index("reading")] = 1 / (PRIOR * problem.state_scale[states.index("reading")])
    of_start = curves._of_start("gyro")
    np.testing.assert_allclose(of_start[:, 0], expected)
    assert not of_start[:, 1:].any()  # a window starts in its first segment
    # All of a table's columns together add one everywhere.
    one = offsets(problem, 0).sum(axis=2)
    rows = np.concatenate([one @ fitted.whitener.T, np.tile(expected, (len(problem), 1))], axis=1)
    rows -= np.einsum("wfs,wgs,wg->wf", fitted.basis, fitted.basis, rows)
    np.testing.assert_allclose(curves.response(curve).sum(axis=2), rows, atol=1e-8)
