"""The values of a declared curve are a function already: none of them is tested for depending on more."""

import numpy as np
import pytest

from fieldmodels.diagnosis.candidates import Candidates
from fieldmodels.diagnosis.curves import Curves
from fieldmodels.diagnosis.cutting import split, start_vector
from fieldmodels.diagnosis.fit import fit
from fieldmodels.diagnosis.options import DEFAULT
from fieldmodels.effects import curve, force
from fieldmodels.machine import Force, Machine, number
from fieldmodels.model import Signal
from fieldmodels.recording import Recording


class Slide(Machine):
    inputs = (Signal("force", "N"),)
    states = (Signal("place", "m"), Signal("speed", "m/s"))
    outputs = (Signal("place", "m", noise=1e-4),)
    mass = number("kg", 2.0, 0.1, 100.0)
    damping = number("N s/m", 4.0, 0.0, 1e3)
    forces = (Force("speed", "place", unit="N", inertia="mass"),)
    effects = (
        force("speed", ("quadratic_drag",))
        + curve("force", "speed", name="brake")
        + curve("force", "speed", over=("place", "speed"), name="rail")
    )

    def derivative(self, state, input, p):
        return state.speed, (input.force - p.damping * state.speed) / p.mass


def record():
    """A slide, by Euler's steps of a tenth of a sample, with noise."""
    rng, step, rows = np.random.default_rng(0), 0.01, []
    place = speed = 0.0
    for force_ in np.repeat(rng.uniform(-9.0, 9.0, 60), 40):
        rows.append((force_, place + 1e-4 * rng.standard_normal()))
        for _ in range(10):
            speed += 0.1 * step * (force_ - 4.0 * speed - 2.0 * speed * abs(speed)) / 2.0
            place += 0.1 * step * speed
    columns = np.array(rows).T
    return Recording(step * np.arange(len(rows)), {"force": columns[0], "place": columns[1]})


@pytest.mark.parametrize(("name", "varied"), [("brake", False), ("rail", False), ("quadratic_drag", True)])
def test_only_the_numbers_of_named_effects_may_depend_on_more(name, varied):
    data = record()
    model = Slide().scaled_to([data])
    training, _ = split(model, [data], [])
    candidates = Candidates(
        training, start_vector(model, {}), frozenset(), training.folds, np.diag(1 / training.output_scale)
    )
    free = candidates.free((name,))
    beside = Curves(training, fit(training, candidates.start, free, candidates.whitener), DEFAULT)
    targets = {one.target for one in beside.all if one.place == "parameter"}
    assert {"mass", "damping"} <= targets
    assert any(target.startswith(f"{name}.") for target in targets) is varied
