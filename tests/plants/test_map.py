"""The static map against the exam's plant, row by row."""

import numpy as np
import pytest

from exam.benches import get_bench
from exam.plants.map import Stand, respond
from fieldmodels.recording import Recording, Windows
from fieldmodels.registry import get_model

MAP, STEP, COUNT = get_model("map"), 5.5, 400
BASE = {"gain": -1.7, "offset": 0.23}


@pytest.mark.every("effect", get_bench("map").effects)
def test_the_map_shows_in_each_row_what_its_command_makes(rng, effect):
    commands = np.repeat(rng.uniform(-1.2, 1.2, COUNT // 4), 4)
    for sign in (-1, 1):
        values = {effect: get_bench("map").values(effect, 5.0, sign, 3)}
        shown, plain = (
            respond(Stand(*BASE.values(), v), commands, np.zeros(COUNT), STEP) for v in (values, {})
        )
        assert np.abs(shown - plain).max() > 0.01
        recording = Recording(STEP * np.arange(COUNT), {"command": commands, "response": shown})
        for begin in (0, 137):
            starts = np.array([begin])
            windows = Windows(
                recording=recording,
                starts=starts,
                lengths=np.array([COUNT - begin]),
                states=MAP.initial_states(recording, starts),
                observed=np.ones((1, COUNT - begin, 1), dtype=np.bool_),
            )
            simulated = MAP.simulate(MAP.vector(BASE, values), windows)[0, 0, :, 0]
            assert simulated[1:] == pytest.approx(shown[begin + 1 :], abs=1e-9)
