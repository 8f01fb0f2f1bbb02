"""A diagnosis of what is hidden in the static map."""

from __future__ import annotations

import pytest

from exam.benches import Conditions, Hidden, get_bench
from exam.sizes import find_size, recordings
from fieldmodels.diagnosis import diagnose

BENCH = get_bench("map")


@pytest.mark.every("effect", BENCH.effects)
def test_every_effect_can_be_made_as_large_as_the_exam_asks(effect: str):
    found = find_size(BENCH, effect, 1, 25.0, Conditions(), 5)
    assert found.size is not None


@pytest.mark.every("effect", ["upper_limit", "actuator_play"])
def test_what_is_hidden_is_found(effect: str):
    found = find_size(BENCH, effect, 1, 30.0, Conditions(), 5)
    train, test = recordings(BENCH, [Hidden(effect, found.size)], Conditions(), 5)
    assert [cause.effect for cause in diagnose(BENCH.model, [train], [test]).causes] == [effect]
