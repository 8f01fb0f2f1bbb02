"""The aircraft and its radar against an oracle in closed form that shares no code with them."""

from __future__ import annotations

import cmath
import math
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from numpy.typing import NDArray

import fieldgym  # noqa: F401
from exam.oracles.uav_route import Aircraft, Flight, simulate
from fieldmodels.machines.uav_route.model import UavRoute
from fieldmodels.recording import Recording, Windows

Array = NDArray[np.float64]
Effects = dict[str, dict[str, float]]

FAULTS: dict[str, tuple[dict[str, float], ...]] = {
    "wind": ({"north": 0.37, "east": -1.13}, {"north": -23.1, "east": 31.7}, {"north": 41.0, "east": 7.3}),
    "turn_speed_loss": ({"share": 0.0073}, {"share": 0.371}),
    "weaker_bank": ({"factor": 0.983}, {"factor": 0.371}, {"factor": 1.37}),
    "sensor_bias": ({"north": 17.3, "east": -31.7}, {"north": -2371.0, "east": 1713.0}),
    "signature_scale": ({"factor": 1.037}, {"factor": 0.137}, {"factor": 7.3}),
    "nose_cone_width": ({"factor": 1.017}, {"factor": 0.57}, {"factor": 1.73}),
    "radar_range_scale": ({"factor": 0.983}, {"factor": 0.61}, {"factor": 1.37}),
    "radar_position": ({"north": 371.0, "east": -1730.0}, {"north": -31.7e3, "east": 47.1e3}),
    "scan_interval": ({"factor": 1.0137}, {"factor": 0.473}, {"factor": 2.71}),
}
CASES = {"uav_route": FAULTS}
ALONE: list[Effects] = [{name: values} for name, cases in FAULTS.items() for values in cases]
PAIRS: list[Effects] = [
    {a: FAULTS[a][1], b: FAULTS[b][1]}
    for a, b in (
        ("wind", "turn_speed_loss"),
        ("wind", "weaker_bank"),
        ("turn_speed_loss", "weaker_bank"),
        ("sensor_bias", "radar_position"),
        ("signature_scale", "nose_cone_width"),
        ("signature_scale", "radar_range_scale"),
        ("radar_position", "nose_cone_width"),
        ("wind", "nose_cone_width"),
        ("scan_interval", "wind"),
    )
]
PAIRS.append({effect: cases[0] for effect, cases in FAULTS.items()})  # and all of them at once
REALITIES = [{}, *ALONE, *PAIRS]

EXACT = 1e-9
"""Both sides are closed forms: they differ by rounding, taken relative to what the effect changes."""
FLOOR = np.array([1e-6, 1e-6, 1e-9, 1e-9, 1e-9])
"""Rounding of positions of 4e5 m, of angles and probabilities."""
RADAR = 31e3 - 17e3j


def names(effects: Effects) -> str:
    """Name of a test's case."""
    if len(effects) > 2:
        return "all"
    return "+".join(f"{e}:{','.join(f'{v:g}' for v in values.values())}" for e, values in effects.items())


def windows() -> Windows:
    """Windows of a flight about the radar: from the start, from a leg's start, in a bank and after it."""
    rng = np.random.default_rng(11)
    count, step = 900, 2.0
    place, target = RADAR + cmath.rect(350e3, 0.3), 0j
    to, flown = np.empty((count, 2)), np.empty(count, dtype=np.complex128)
    changes, left = [], 0
    for i in range(count):
        if left == 0:
            left = int(rng.integers(4, 50))
            out = 30e3 * cmath.exp(1j * rng.uniform(-math.pi, math.pi))
            # Later legs have the radar at the edge of the nose cone, which is one degree wide.
            side = math.radians(rng.uniform(29, 33)) * rng.choice([-1, 1])
            target = place + (out if i < 500 else 0.5 * (RADAR - place) * cmath.exp(1j * side))
            changes.append(i)
        to[i], flown[i] = (target.real, target.imag), place
        place += 500.0 * (target - place) / abs(target - place)
        left -= 1
    recording = Recording(
        time=step * np.arange(count),
        signals={
            "to_north": to[:, 0],
            "to_east": to[:, 1],
            "north": np.zeros(count),
            "east": np.zeros(count),
            "detected": np.zeros(count),
            "scan_gap": np.ones(count),
        },
    )
    starts = np.array([0, changes[3], changes[5] + 1, changes[6] + 3, changes[8] + 2, *range(400, 700, 60)])
    lengths = rng.integers(80, 150, len(starts))
    near = flown[starts] + 1e3 * rng.uniform(-1, 1, len(starts))
    states = np.column_stack([near.real, near.imag, rng.uniform(-3, 3, len(starts))])
    observed = np.ones((len(starts), lengths.max(), 5), dtype=np.bool_)
    return Windows(recording, starts, lengths, states, observed)


def both(effects: Effects) -> tuple[Array, Array]:
    """What the model and the oracle predict, shape (all windows' samples, 5)."""
    model, made = UavRoute(), windows()
    base = {"speed": 243.7, "radar_north": RADAR.real, "radar_east": RADAR.imag}
    predicted = model.simulate(model.vector(base, effects)[None], made)[0]
    recording = made.recording
    to = np.column_stack([recording["to_north"], recording["to_east"]])
    changed = np.r_[True, (np.diff(to, axis=0) != 0).any(axis=1)]
    begun = np.maximum.accumulate(np.where(changed, np.arange(len(to)), 0))
    ours, theirs = [], []
    bias = effects.get("sensor_bias", {"north": 0.0, "east": 0.0})
    for w, (first, length) in enumerate(zip(made.starts, made.lengths, strict=True)):
        north, east, before = made.states[w]
        start = {
            "north": north - bias["north"],
            "east": east - bias["east"],
            "since": (first - begun[first]) * recording.step,
        }
        if begun[first] > 0:
            start["course_before"] = before
        ours.append(predicted[w, :length])
        theirs.append(simulate(base, effects, to[first : first + length], recording.step, start))
    return np.concatenate(ours), np.concatenate(theirs)


NOMINAL = both({})[1]


@pytest.mark.matrix(
    keep=(
        "sensor_bias:-2371,1713",
        "signature_scale:1.037",
        "signature_scale:7.3",
        "radar_range_scale:0.983",
        "radar_position:371,-1730",
        "turn_speed_loss:0.371+weaker_bank:0.371",
        "radar_position:-31700,47100+nose_cone_width:0.57",
        "all",
    )
)
@pytest.mark.parametrize("effects", REALITIES, ids=map(names, REALITIES))
def test_prediction(effects: Effects) -> None:
    """Effects change a prediction as their equations say."""
    ours, theirs = both(effects)
    change = np.abs(theirs - NOMINAL).max(axis=0)
    assert not effects or (change > 1e4 * FLOOR).any()
    np.testing.assert_array_less(np.abs(ours - theirs).max(axis=0), EXACT * change + FLOOR)


LAYOUT = {"start": (375.0, 125.0), "goal": (-900.0, 40.0), "radars": ((-31.0, -17.0), (-260.0, 340.0))}
PLANS = (
    ((20.0, 9e3), (61.0, 7e3), (-80.0, 12e3), (-32.0, 21e3), (29.0, 33e3)),
    ((30.3, 11e3), (31.5, 9e3), (100.0, 37e3), (-30.4, 51e3)),
    ((-150.0, 7e3), (95.0, 6.1e3), (30.3, 23e3), (-90.0, 71e3), (61.0, 83e3), (115.0, 5.3e3)),
)
"""Headings relative to the bearing of the nearest radar [deg] and lengths [m] of three flights' legs."""


@pytest.mark.matrix(
    keep=(
        "deterministic-signature_scale:0.137+radar_range_scale:0.61",
        "stochastic-scan_interval:2.71",
    )
)
@pytest.mark.parametrize("effects", REALITIES, ids=map(names, REALITIES))
@pytest.mark.parametrize("detection", ["deterministic", "stochastic"])
def test_environment(effects: Effects, detection: str) -> None:
    """The environment in this reality tells of the flights that the oracle makes."""
    rules = {"lose": 17.0, "engage": 61.0}
    settings: dict[str, Any] = {"layout": LAYOUT, "capture": 1e-3, "detection": detection, "target": 1e9}
    env = gym.make("fieldgym/UavRoute-v1", settings=settings | rules, reality=effects)
    start, radars = 1e3 * complex(*LAYOUT["start"]), tuple(1e3 * complex(*r) for r in LAYOUT["radars"])
    change = np.zeros(4)
    for plan in PLANS:
        env.reset(seed=0)
        flight, nominal = (
            Flight(Aircraft(on), start, radars, drawn=detection == "stochastic", **rules)
            for on in (effects, dict[str, Any]())
        )
        for degrees, length in plan:
            action = degrees / 180.0, 2.0 * math.log(length / 2.5e3) / math.log(200.0) - 1.0
            info = env.step(np.array(action))[-1]
            for one in (flight, nominal):
                one.fly(math.radians(degrees), length)
            assert 1e3 * complex(*info["place"]) == pytest.approx(flight.measured, abs=1e-6)
            assert info["time"] == pytest.approx(flight.time, abs=1e-9)
            assert info["largest_probability"] == pytest.approx(flight.largest, abs=1e-9)
            if not flight.drawn:
                assert info["time_over"] == pytest.approx(flight.time_over, abs=1e-9)
                np.testing.assert_array_equal(info["detected"], flight.detected)
                np.testing.assert_allclose(info["timers"], flight.timers, atol=1e-9)
            own, without = (
                np.array([abs(f.measured), f.time, f.largest, f.time_over]) for f in (flight, nominal)
            )
            change = np.maximum(change, np.abs(own - without))
    drawn_only = set(effects) == {"scan_interval"} and detection == "deterministic"
    assert (change.max() > 1e-4) == bool(effects and not drawn_only)
