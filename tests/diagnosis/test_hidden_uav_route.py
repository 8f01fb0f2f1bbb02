"""Every effect of the flight, hidden in data from another integration, must be found."""

import math

import numpy as np
import pytest

from fieldmodels.diagnosis import diagnose
from fieldmodels.uav_route.model import UavRoute
from fieldmodels.uav_route.recording import record_flight

MODEL = UavRoute()
HIDDEN = {
    "wind": {"north": 4.0, "east": -3.0},
    "turn_speed_loss": {"share": 0.08},
    "weaker_bank": {"factor": 0.85},
    "sensor_bias": {"north": 150.0, "east": -80.0},
}


def found(reality, seed, bank=True, duration=5000.0):
    recording = record_flight(reality, duration, bank=bank, rng=np.random.default_rng(seed))
    return diagnose(MODEL, [recording]).to_json()


def near(estimates, values):
    for name, value in values.items():
        estimate = estimates[name]
        assert abs(estimate["value"] - value) < max(4 * estimate["std"], 0.1 * abs(value))


def test_every_effect_has_a_case():
    assert {effect.name for effect in MODEL.effects} == set(HIDDEN)


@pytest.mark.parametrize("effect", HIDDEN)
@pytest.mark.parametrize("seed", [11, 12])
def test_hidden_effect_is_found(effect, seed):
    result = found({effect: HIDDEN[effect]}, seed)
    assert result["verdict"] == "named"
    assert [cause["effect"] for cause in result["causes"]] == [effect]
    near(result["causes"][0]["parameters"], HIDDEN[effect])


@pytest.mark.parametrize("seed", [3, 4, 5])
def test_nothing_hidden_is_consistent(seed):
    assert found(None, seed)["verdict"] == "consistent"


def test_another_speed_is_refitted_not_named():
    assert found({"parameters": {"speed": 243.0}}, 6)["causes"] == []


def test_two_effects_at_once():
    both = {name: HIDDEN[name] for name in ("wind", "turn_speed_loss")}
    result = found(both, 7)
    assert {cause["effect"] for cause in result["causes"]} == set(both)


@pytest.mark.parametrize("effect", ["wind", "turn_speed_loss", "sensor_bias"])
def test_position_alone_suffices_but_for_the_bank(effect):
    result = found({effect: HIDDEN[effect]}, 8, bank=False)
    assert [cause["effect"] for cause in result["causes"]] == [effect]


def test_a_weaker_bank_alone_does_not_show_in_position():
    """Legs are straight whatever the bank (4.1): without a logged bank nothing is seen, and none is named."""
    assert found({"weaker_bank": HIDDEN["weaker_bank"]}, 9, bank=False)["verdict"] == "consistent"


def test_a_speed_that_depends_on_the_place_is_unknown_and_its_shape_shown():
    """No listed effect: the aircraft is faster in the north than in the south."""
    recording = record_flight(
        None, 8000.0, added=lambda place: 6.0 * math.tanh(place.real / 50e3), rng=np.random.default_rng(21)
    )
    result = diagnose(MODEL, [recording]).to_json()
    assert result["verdict"] == "unknown"
    assert result["unknown"]["direction"] == "north"
