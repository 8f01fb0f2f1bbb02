"""A walk of the very robot that the simulation is about."""

import numpy as np
import pytest

from fieldmodels.diagnosis import diagnose
from fieldmodels.machines.line_following.recording import record_walk
from fieldmodels.registry import get_model


@pytest.mark.matrix(keep=("1000000",))
@pytest.mark.parametrize("seed", [1_000_000, 5001])
def test_nothing_is_missing_in_a_short_walk_of_the_nominal_robot(seed):
    """Six minutes: a wave of more cycles than its variable has values fits any errors of 300 strides."""
    walk = record_walk(None, 300, rng=np.random.default_rng(seed))
    assert diagnose(get_model("line_following"), [walk]).verdict == "consistent"
