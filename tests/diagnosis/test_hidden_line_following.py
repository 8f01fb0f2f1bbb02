"""Every effect of the walk, hidden in data from another plant's code or from rigid bodies, must be found."""

import numpy as np
import pytest

from fieldmodels.diagnosis import diagnose
from fieldmodels.machines.line_following.body import Hardware
from fieldmodels.machines.line_following.model import LineFollowing
from fieldmodels.machines.line_following.parameters import Noise
from fieldmodels.machines.line_following.recording import GENTLE, LAW, record_walk
from fieldmodels.machines.line_following.tracks import oval, straight
from fieldmodels.machines.line_following.walks import Scene

MODEL = LineFollowing()
QUIET = Noise(bias=0.0)
HIDDEN = {
    "steering_bias": {"turn": 0.012},
    "turn_gain": {"factor": 0.8},
    "actuator_delay": {"strides": 1.0},
    "foot_slip": {"turn": 0.3, "twist": 0.2, "step": 0.06},
    "camera_yaw": {"angle": 0.05},
    "camera_pitch": {"angle": 0.1},
    "sensor_gain": {"factor": 1.25},
    "sensor_quantisation": {"step": 0.08},
    "actuator_saturation": {"turn": 0.05},
}
NESTED = {"turn_gain": {"foot_slip"}}
"""Slip without twist and without a shorter stride is a turn gain."""


def found(recording):
    return diagnose(MODEL, [recording]).to_json()


def test_every_effect_has_a_case():
    assert {effect.name for effect in MODEL.effects} == set(HIDDEN)


@pytest.mark.parametrize("effect", HIDDEN)
def test_hidden_effect_is_found(effect):
    law = GENTLE if effect == "actuator_delay" else LAW
    recording = record_walk({effect: HIDDEN[effect]}, 1000, law=law, rng=np.random.default_rng(11))
    result = found(recording)
    assert result["verdict"] in ("named", "ambiguous")
    assert len(result["causes"]) == 1
    cause = result["causes"][0]
    names = {cause["effect"], *cause["alternatives"]}
    assert effect in names
    assert names <= {effect, *NESTED.get(effect, ())}
    if cause["effect"] == effect:
        for name, value in HIDDEN[effect].items():
            estimate = cause["parameters"][name]
            assert abs(estimate["value"] - value) < max(4 * estimate["std"], 0.2 * value)


@pytest.mark.parametrize("track", [None, oval()])
def test_nothing_hidden_is_consistent(track):
    scene = None if track is None else Scene(track, noise=QUIET)
    result = found(record_walk(None, 600, scene=scene, rng=np.random.default_rng(3)))
    assert result["verdict"] == "consistent"


def test_rigid_bodies_on_a_dry_floor_are_consistent_with_plane_kinematics():
    scene = Scene(straight(700), plant="pymunk", noise=QUIET)
    result = found(record_walk(None, 700, scene=scene, rng=np.random.default_rng(5)))
    assert result["verdict"] == "consistent"


@pytest.mark.parametrize(
    ("hardware", "effect"),
    [(Hardware(friction=0.15), "foot_slip"), (Hardware(motor=0.15), "actuator_saturation")],
)
def test_what_the_rigid_bodies_suffer_is_named(hardware, effect):
    """Slip and a weak motor come from contact forces and a torque limit, not from this model's own terms."""
    scene = Scene(straight(700), plant="pymunk", hardware=hardware, noise=QUIET)
    result = found(record_walk(None, 700, scene=scene, rng=np.random.default_rng(6)))
    assert result["verdict"] in ("named", "ambiguous")
    assert effect in (result["causes"][0]["effect"], *result["causes"][0]["alternatives"])


def test_camera_alone_suffices_for_what_it_can_tell():
    recording = record_walk(
        {"steering_bias": {"turn": 0.015}}, 1000, tracked=False, rng=np.random.default_rng(8)
    )
    result = found(recording)
    assert result["causes"][0]["effect"] == "steering_bias"
