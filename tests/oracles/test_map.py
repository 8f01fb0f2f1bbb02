"""The static map against its oracle, row by row."""

import numpy as np
import pytest

from exam.oracles import find_oracle
from fieldmodels.recording import Recording, Windows
from fieldmodels.registry import get_model

MAP = get_model("map")
STEP, COUNT = 5.5, 400
BENT = {f"value_{k}": 0.1 * (-1) ** k * k for k in range(1, 8)}
CASES = {
    "map": {
        "dead_zone": [{"width": 0.31, "centre": 0.2}, {"width": 0.05, "centre": -0.7}],
        "upper_limit": [{"limit": limit} for limit in (0.71, -0.2)],
        "lower_limit": [{"limit": limit} for limit in (-0.31, 0.4)],
        "curvature": [
            {"low": -1.5, "high": 1.3, **BENT},
            {"low": -0.4, "high": 0.9, **{name: -0.7 * value for name, value in BENT.items()}},
        ],
        "actuator_play": [{"width": width} for width in (0.13, 0.71)],
        "sensor_drift": [{"rate": rate} for rate in (0.0013, -0.01)],
        "sensor_quantisation": [{"step": step} for step in (0.013, 0.31)],
    }
}
BASE = {"gain": -1.7, "offset": 0.23}


@pytest.mark.parametrize(
    ("effect", "values"), [(name, one) for name, many in CASES["map"].items() for one in many]
)
@pytest.mark.parametrize("begin", [0, 137])
def test_the_map_shows_in_each_row_what_its_command_makes(rng, effect, values, begin):
    commands = np.repeat(rng.uniform(-1.2, 1.2, COUNT // 4), 4)[:, None]
    shown = find_oracle("map").simulate(BASE, {effect: values}, commands, STEP)
    signals = {"command": commands[:, 0], "response": shown[:, 0]}
    recording = Recording(STEP * np.arange(COUNT), signals)
    starts = np.array([begin])
    windows = Windows(
        recording=recording,
        starts=starts,
        lengths=np.array([COUNT - begin]),
        states=MAP.initial_states(recording, starts),
        observed=np.ones((1, COUNT - begin, 1), dtype=np.bool_),
    )
    simulated = MAP.simulate(MAP.vector(BASE, {effect: values}), windows)[0, 0, :, 0]
    assert simulated[1:] == pytest.approx(shown[begin + 1 :, 0], abs=1e-9)
    assert np.ptp(simulated[1:]) > 0.1
