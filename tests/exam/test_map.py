"""The plant of the static map against its oracle, and a diagnosis of what is hidden in it."""

from __future__ import annotations

import numpy as np
import pytest

from exam.benches import Conditions, Hidden, get_bench
from exam.oracles import find_oracle
from exam.plants import map as plants
from exam.sizes import find_size, recordings
from fieldmodels.diagnosis import diagnose

BENCH = get_bench("map")


@pytest.mark.parametrize("effect", ["", *BENCH.effects])
def test_a_listed_effect_acts_as_its_oracle_says(effect: str):
    values = {effect: BENCH.values(effect, 3.1, -1, 3)} if effect else {}
    commands = np.random.default_rng(4).uniform(-1.0, 1.0, 200)
    stand = plants.Stand(BENCH.base(3)["gain"], BENCH.base(3)["offset"], values)
    shown = plants.respond(stand, commands, np.zeros(200), 2.0)
    told, plain = (
        find_oracle("map").simulate(BENCH.base(3), v, commands[:, None], 2.0)[:, 0] for v in (values, {})
    )
    assert shown == pytest.approx(told, abs=1e-12)
    assert not effect or np.abs(told - plain).max() > 0.01


@pytest.mark.parametrize("effect", BENCH.effects)
def test_every_effect_can_be_made_as_large_as_the_exam_asks(effect: str):
    found = find_size(BENCH, effect, 1, 25.0, Conditions(), 5)
    assert found.size is not None


@pytest.mark.parametrize("effect", ["upper_limit", "actuator_play"])
def test_what_is_hidden_is_found(effect: str):
    found = find_size(BENCH, effect, 1, 30.0, Conditions(), 5)
    train, test = recordings(BENCH, [Hidden(effect, found.size)], Conditions(), 5)
    assert [cause.effect for cause in diagnose(BENCH.model, [train], [test]).causes] == [effect]
