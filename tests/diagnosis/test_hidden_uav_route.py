"""Every effect of flight and radar, hidden in data from another integration, must be found."""

import math

import numpy as np
import pytest

from fieldmodels.diagnosis import diagnose
from fieldmodels.machines.uav_route.model import UavRoute
from fieldmodels.machines.uav_route.recording import record_flight

MODEL = UavRoute()
FLOWN = {
    "wind": {"north": 4.0, "east": -3.0},
    "turn_speed_loss": {"share": 0.08},
    "weaker_bank": {"factor": 0.85},
    "sensor_bias": {"north": 150.0, "east": -80.0},
}
SEEN = {
    "signature_scale": {"factor": 1.8},
    "nose_cone_width": {"factor": 0.75},
    "radar_range_scale": {"factor": 0.88},
    "radar_position": {"north": 20e3, "east": -15e3},
    "look_interval": {"factor": 1.05},
}
"""What acts on a radar's looks alone."""
TWINS = {"signature_scale", "radar_range_scale"}
"""All that is seen grows with either: only banks, and the rows of the tables, tell them apart."""


def record(reality, seed, duration=1200.0, **options):
    return record_flight(reality, duration, episodes=4, rng=np.random.default_rng(seed), **options)


def found(reality, seed, **options):
    return diagnose(MODEL, [record(reality, seed, **options)]).to_json()


def near(estimates, values):
    for name, value in values.items():
        estimate = estimates[name]
        assert abs(estimate["value"] - value) < max(4 * estimate["std"], 0.1 * abs(value))


def test_every_effect_has_a_case():
    assert {effect.name for effect in MODEL.effects} == {*FLOWN, *SEEN}


@pytest.mark.parametrize("effect", FLOWN)
def test_hidden_effect_of_the_flight_is_found(effect):
    result = found({effect: FLOWN[effect]}, 11)
    assert result["verdict"] == "named"
    assert [cause["effect"] for cause in result["causes"]] == [effect]
    near(result["causes"][0]["parameters"], FLOWN[effect])


@pytest.mark.parametrize("effect", SEEN)
def test_hidden_effect_of_the_radar_is_found(effect):
    """Alone, or with its twin beside it; its value is right where it stands alone or first."""
    result = found({effect: SEEN[effect]}, 13, duration=2000.0)
    (cause,) = result["causes"]
    named = {cause["effect"], *cause["alternatives"]}
    assert effect in named
    assert named <= (TWINS if effect in TWINS else {effect})
    if cause["effect"] == effect:
        near(cause["parameters"], SEEN[effect])


@pytest.mark.parametrize("seed", [3, 4])
def test_nothing_hidden_is_consistent(seed):
    """The docs give the error rate over many seeds; these are two of them."""
    assert found(None, seed)["verdict"] == "consistent"


def test_another_speed_is_refitted_not_named():
    assert found({"parameters": {"speed": 243.0}}, 6)["causes"] == []


def test_an_effect_of_the_flight_and_one_of_the_radar_at_once():
    both = {"turn_speed_loss": FLOWN["turn_speed_loss"], "radar_position": SEEN["radar_position"]}
    result = diagnose(MODEL, [record(both, 7, duration=2000.0)])
    signals = {cause.effect: cause.signal for cause in result.causes}
    assert set(signals) == set(both)
    assert signals["radar_position"] == "detected"
    assert signals["turn_speed_loss"] != "detected"


@pytest.mark.parametrize("effect", ["wind", "sensor_bias"])
def test_position_alone_suffices_but_for_the_bank(effect):
    result = found({effect: FLOWN[effect]}, 8, bank=False, looks=False)
    assert [cause["effect"] for cause in result["causes"]] == [effect]


def test_a_weaker_bank_alone_does_not_show_in_position():
    """Legs are straight whatever the bank (4.1): without a logged bank nothing is seen, and none is named."""
    hidden = {"weaker_bank": FLOWN["weaker_bank"]}
    assert found(hidden, 9, bank=False, looks=False)["verdict"] == "consistent"


def test_a_speed_that_depends_on_the_place_is_unknown_and_its_shape_shown():
    """No listed effect: the aircraft is faster in the north than in the south."""
    result = diagnose(
        MODEL, [record(None, 21, duration=2000.0, added=lambda place: 6.0 * math.tanh(place.real / 50e3))]
    ).to_json()
    assert result["verdict"] == "unknown"
    assert result["unknown"]["direction"] == "north"


def test_a_radar_that_tires_is_unknown_and_shown_against_time():
    """No listed effect: its ranges shrink by half in the middle of each flight."""
    tired = record(None, 22, duration=2000.0, faded=lambda _, time: 1 - 0.3 * math.tanh((time - 1000) / 300))
    result = diagnose(MODEL, [tired]).to_json()
    assert result["verdict"] == "unknown"
    assert result["causes"] == []
    assert result["unknown"]["direction"] == "time, in the log-odds of detected"
    curve = np.array(result["unknown"]["curve"])
    assert curve[0, 1] > curve[-1, 1] + 1.0
