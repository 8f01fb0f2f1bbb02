"""The response to a force on segments of a window, against a mass that flies freely."""

import numpy as np

from fieldmodels.diagnosis.fit import fit
from fieldmodels.diagnosis.problem import build
from fieldmodels.diagnosis.response import responses
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
