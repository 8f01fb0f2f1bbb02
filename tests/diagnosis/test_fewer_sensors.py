"""What is found when not all outputs of a machine are measured, and what is then proposed to measure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from exam.benches import Conditions, Hidden, get_bench
from exam.sizes import recordings
from fieldmodels.diagnosis import Diagnosis, diagnose
from fieldmodels.diagnosis.next_measurement import LONGEST
from fieldmodels.machines.pose_reaching.recording import record_commands, record_drive
from fieldmodels.recording import Recording
from fieldmodels.registry import get_model

SLOW = pytest.mark.nightly
WITHOUT = {
    "pose_reaching": ("left_wheel", "right_wheel"),
    "line_following": ("offset", "heading"),
    "uav_route": ("bank", "detected"),
}
"""Model to what is not measured: the pose, the camera, the tracked position are left."""
INDISTINGUISHABLE = {"turn_gain": "yaw_slip", "yaw_slip": "turn_gain"}
"""From the pose alone, whatever is commanded."""


def diagnosed(machine: str, sizes: dict[str, float], seed: int, noise: str = "white") -> Diagnosis:
    """From one record, without the model's additional sensors."""
    hidden = [Hidden(name, abs(size), 1 if size > 0 else -1) for name, size in sizes.items()]
    bench = get_bench(machine)
    return diagnose(
        bench.model, [fewer(recordings(bench, hidden, Conditions(noise=noise), seed)[0], machine)]
    )


def fewer(recording: Recording, machine: str) -> Recording:
    """Without the additional sensors."""
    kept = {name: v for name, v in recording.signals.items() if name not in WITHOUT[machine]}
    return replace(recording, signals=kept)


def named(found: Diagnosis) -> list[set[str]]:
    """Each cause with what cannot be distinguished from it."""
    return [{cause.effect, *cause.alternatives} for cause in found.causes]


@pytest.mark.parametrize(
    ("effect", "size"),
    [
        ("slope", 2.7),
        ("yaw_slip", 1.0),
        pytest.param("actuator_gain", 0.6, marks=SLOW),
        pytest.param("unequal_wheels", 1.1, marks=SLOW),
        pytest.param("heading_bias", -2.7, marks=SLOW),
    ],
)
def test_the_pose_alone_suffices_up_to_what_needs_the_wheels(effect: str, size: float):
    found = diagnosed("pose_reaching", {effect: size}, 90_003)
    other = INDISTINGUISHABLE.get(effect)
    assert named(found) == [{effect, other} if other else {effect}]
    if other:
        assert found.next_measurement is not None
        assert found.next_measurement.input["measure"] == ["left_wheel", "right_wheel"]


@pytest.mark.matrix(keep=("12",))
@pytest.mark.parametrize("seed", [11, 12, *(pytest.param(k, marks=SLOW) for k in range(13, 21))])
def test_nothing_is_named_from_the_pose_alone_where_nothing_is_hidden(seed: int):
    found = diagnosed("pose_reaching", {}, 90_000 + seed, "autoregressive" if seed % 2 else "white")
    assert found.verdict == "consistent", found.summary()


def test_what_no_listed_effect_explains_is_unknown_from_the_pose_alone():
    found = diagnosed("pose_reaching", {"weak_left": 1.3}, 90_021)
    assert found.verdict == "unknown", found.summary()
    assert found.unknown is not None
    assert found.unknown.certain
    assert "turn_rate" in found.unknown.direction


def test_a_measurement_is_proposed_that_distinguishes_a_late_command_from_a_lag():
    drive = record_drive(120.0, np.random.default_rng(77), {"actuator_delay": {"delay": 0.0051}})
    found = diagnose(get_model("pose_reaching"), [fewer(drive, "pose_reaching")])
    assert found.verdict == "ambiguous"
    assert found.next_measurement is not None
    planned = found.next_measurement.input
    assert planned["signal"] == ["speed", "turn_rate"]
    assert planned["nats"] >= max(planned["compared"].values()) > 0.2
    assert "It needs room: x " in found.next_measurement.why
    # At 20 Hz a lag and a delay of 5 ms differ by little, and it says so.
    assert planned["duration_s"] == LONGEST
    assert planned["probability"] < 0.95
    plan = found.next_measurement.plan
    assert plan is not None
    again = record_commands(
        np.column_stack([plan["speed"], plan["turn_rate"]]), np.random.default_rng(78), wheels=False
    )
    np.testing.assert_array_equal(again["turn_rate"], plan["turn_rate"])
    assert again["speed"].min() >= 0
    assert again["speed"].max() <= 1


def test_the_camera_alone_suffices_for_a_steering_bias():
    found = diagnosed("line_following", {"steering_bias": 6.0}, 90_008)
    assert found.causes[0].effect == "steering_bias"


@pytest.mark.parametrize(("effect", "size"), [("wind", -1.2), ("sensor_bias", -1.6)])
def test_the_position_alone_suffices_but_for_the_bank(effect: str, size: float):
    assert [cause.effect for cause in diagnosed("uav_route", {effect: size}, 90_008).causes] == [effect]


def test_a_weaker_bank_does_not_show_in_the_position():
    """Legs are straight whatever the bank (4.1): without a logged bank nothing is seen, and none is named."""
    assert diagnosed("uav_route", {"weaker_bank": -0.6}, 90_009).verdict == "consistent"
