"""What is handed over is written, loaded and run on a record that had no say."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from exam.delivery import Stated, deliver
from fieldmodels.diagnosis.result import Estimate
from fieldmodels.diagnosis.use import Simulation, written
from fieldmodels.registry import get_model
from fieldmodels.synthesis import synthesise
from fieldmodels.yaml import load_yaml, save_yaml

RIG = get_model("rig")
TRUTH = {"coulomb_friction": {"force": 0.6}}
NOISE = {output.name: output.noise for output in RIG.outputs}
THIRD = synthesise(RIG, TRUTH, "mixed", duration=20.0, amplitude=8.0, rng=np.random.default_rng(5))


def handed(effects: Mapping[str, Mapping[str, float]], errors: float = 1.0) -> Stated:
    """A rig with these effects, said to err by so many times the noise, and thrice it without any."""

    def exactly(values: Mapping[str, float]) -> dict[str, Estimate]:
        return {name: Estimate(value, 0.0, "1") for name, value in values.items()}

    base = exactly({p.name: p.nominal for p in RIG.parameters})
    return Stated(
        file=written(RIG, base, {name: exactly(values) for name, values in effects.items()}),
        errors={name: (3.0 * noise, errors * noise) for name, noise in NOISE.items()},
        horizons=dict.fromkeys(NOISE, 0.5),
        nominal=Simulation(RIG, RIG.nominal),
        extended=bool(effects),
    )


def test_the_truth_errs_as_the_sensors_do_and_the_nominal_simulation_more():
    found = deliver(RIG, handed(TRUTH), [THIRD])
    for name, noise in NOISE.items():
        assert found.after[name] == pytest.approx(noise, rel=0.1)
        assert found.before[name] > 2.0 * noise
    assert not found.broken
    assert found.over_before < 0.5


def test_an_effect_that_the_file_lost_shows_in_what_is_delivered():
    lost = deliver(RIG, replace(handed(TRUTH), file=handed({}).file), [THIRD])
    assert lost.over_before == pytest.approx(1.0)
    harder = max(lost.before[name] / (3.0 * noise) for name, noise in NOISE.items())
    assert harder > 1.0  # and so much more may be delivered than is stated
    assert lost.over_stated == pytest.approx(3.0, rel=1e-6)


@pytest.mark.parametrize(
    ("effects", "words"),
    [
        ({"coulomb_fiction": {"force": 1.0}}, "coulomb_friction"),
        ({"coulomb_friction": {"force": -1.0}}, "force"),
    ],
)
def test_what_does_not_load_has_delivered_nothing(effects: Mapping[str, Mapping[str, float]], words: str):
    found = deliver(RIG, handed(effects), [THIRD])
    assert words in found.broken
    assert set(found.after.values()) == {np.inf}


def test_a_lag_of_half_a_minute_loads_as_it_was_found():
    """Without data a machine does not know how slow it is: what was found in them must load all the same."""
    slow = {"actuator_lag": {"time_constant": 30.0}}
    record = synthesise(RIG, slow, "mixed", duration=20.0, amplitude=8.0, rng=np.random.default_rng(5))
    found = deliver(RIG, handed(slow), [record])
    assert not found.broken
    assert found.after["velocity"] == pytest.approx(NOISE["velocity"], rel=0.2)


@pytest.mark.every("words", [1, 12, 40])
def test_a_file_holds_names_of_any_length(words: int, tmp_path: Path):
    """A curve is named by what it depends on, which may be long."""
    data = {"effects": {f"force_over_{' times '.join(['voltage'] * words)}": {"at_1": 0.5}}, "equations": {}}
    save_yaml(data, tmp_path / "extended.yaml")
    assert load_yaml(tmp_path / "extended.yaml") == data
