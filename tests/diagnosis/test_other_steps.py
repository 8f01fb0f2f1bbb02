"""The gain is measured on records of another step than the training one."""

import numpy as np
import pytest

from fieldmodels.diagnosis import diagnose
from fieldmodels.registry import get_model
from fieldmodels.synthesis import synthesise

HIDDEN = {"coulomb_friction": {"force": 0.3}}


def record(seed, step, duration=25.0):
    return synthesise(
        get_model("rig"), HIDDEN, "mixed", duration=duration, step=step, amplitude=8.0,
        rng=np.random.default_rng(seed),
    )  # fmt: skip


@pytest.mark.matrix(keep=("0.025",))
@pytest.mark.parametrize("step", [0.004, 0.025])
def test_a_test_record_may_have_another_step_than_the_training_one(step):
    diagnosis = diagnose(get_model("rig"), [record(1, 0.01)], [record(2, step)])
    (cause,) = diagnosis.causes
    assert cause.effect == "coulomb_friction"
    assert cause.parameters["force"].value == pytest.approx(0.3, abs=4 * cause.parameters["force"].std)
    # The error that remains is the sensors' noise at either step.
    assert diagnosis.gain["position"].rmse_after == pytest.approx(2e-4, rel=0.1)
    assert diagnosis.gain["position"].gain.ci95[0] > 0.0
