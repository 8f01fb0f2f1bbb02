"""The aircraft and its radar against the exam's plant."""

from __future__ import annotations

import cmath
import math
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from numpy.typing import NDArray

import fieldgym  # noqa: F401
from exam.benches import get_bench
from exam.plants import flight
from fieldmodels.machines.uav_route.model import UavRoute
from fieldmodels.recording import Recording, Windows

Array = NDArray[np.float64]
Effects = dict[str, dict[str, float]]

VALUES: Effects = {
    "wind": {"north": -23.1, "east": 31.7},
    "turn_speed_loss": {"share": 0.371},
    "weaker_bank": {"factor": 0.371},
    "sensor_bias": {"north": -2371.0, "east": 1713.0},
    "signature_scale": {"factor": 0.137},
    "nose_cone_width": {"factor": 1.73},
    "radar_range_scale": {"factor": 0.61},
    "radar_position": {"north": -31.7e3, "east": 47.1e3},
    "scan_interval": {"factor": 0.473},
}
REALITIES: list[Effects] = [{}, *({e: VALUES[e]} for e in get_bench("uav_route").effects), VALUES]
EXACT = np.array([1e-6, 1e-6, 1e-9, 1e-9, 1e-9])
"""Both sides are closed forms: they differ by the rounding of positions of 4e5 m, angles and chances."""
SPEED, STEP, COUNT = 243.7, 2.0, 900


def plant(effects: Effects, speed: float = SPEED) -> flight.Flight:
    """The aircraft in a reality."""
    made = flight.Flight(speed)
    flight.install(made, effects)
    return made


def flown(effects: Effects) -> tuple[Array, Array]:
    """Waypoints of a flight, and what the tracker, the gauge and the radar should show, shape (n, 5).

    A scan is expected in the middle of the way since the sample before, banked for its share of the time.
    """
    one, rngs = plant(effects), np.random.default_rng(11).spawn(2)
    rows = flight.simulate(one, np.zeros((COUNT, 4)), STEP, *rngs)
    aims, places = rows[:, 0] + 1j * rows[:, 1], rows[:, 2] + 1j * rows[:, 3] - one.bias
    out, course = rows[:, 2:].copy(), 0j
    for k in range(COUNT):
        if k > 0:
            share, bank = abs(rows[k, 4]) / abs(one.bank), math.copysign(one.bank, rows[k, 4])
            middle, chance = 0.5 * (places[k - 1] + places[k]), 0.0
            for part, side in ((share, bank), (1.0 - share, 0.0)):
                air = one.velocity(0.0, middle, course, side)[1]
                chance += part * one.chance(0.0, middle, air, side) if part > 0.0 else 0.0
            out[k, 3] = chance
        if k == 0 or aims[k] != aims[k - 1]:
            course = (aims[k] - places[k]) / abs(aims[k] - places[k])
    out[:, 4] = one.interval
    return rows[:, :2], out


@pytest.mark.every("effects", REALITIES)
def test_prediction(effects: Effects) -> None:
    """Effects change a prediction as their equations say: from a leg's start, in a bank and after it."""
    model, (to, shown) = UavRoute(), flown(effects)
    signals = dict(zip(("to_north", "to_east"), to.T, strict=True))
    signals |= dict(zip(("north", "east"), shown[:, :2].T, strict=True))
    recording = Recording(
        STEP * np.arange(COUNT), signals | {"detected": np.zeros(COUNT), "scan_gap": np.ones(COUNT)}
    )
    begun = np.flatnonzero(np.r_[True, (np.diff(to, axis=0) != 0.0).any(axis=1)])
    starts = np.array([0, begun[3], begun[5] + 1, begun[6] + 3, begun[8] + 2, *range(400, 700, 60)])
    leg = np.searchsorted(begun, starts, side="right") - 1
    places = (shown[begun, 0] + 1j * shown[begun, 1]) - plant(effects).bias
    ends = np.append(places[1:], np.nan)
    before = np.angle(ends - places)[np.maximum(leg - 1, 0)]
    states = np.column_stack([shown[starts, :2], before])
    lengths = np.full(len(starts), 120)
    observed = np.ones((len(starts), 120, 5), dtype=np.bool_)
    base = {"speed": SPEED, "radar_north": 0.0, "radar_east": 0.0}
    vectors = np.array([model.vector(base, on) for on in (effects, {})])
    ours, without = model.simulate(vectors, Windows(recording, starts, lengths, states, observed))
    change = np.abs(ours - without)[:, 1:].max(axis=(0, 1))
    assert not effects or (change > 1e4 * EXACT).any()
    for window, first in zip(ours, starts, strict=True):
        error = np.abs(window - shown[first : first + 120])[1:].max(axis=0)
        np.testing.assert_array_less(error, 1e-9 * change + EXACT)


LAYOUT = {"start": (375.0, 125.0), "goal": (-900.0, 40.0), "radars": ((-31.0, -17.0), (-260.0, 340.0))}
PLANS = (
    ((20.0, 9e3), (61.0, 7e3), (-80.0, 12e3), (-32.0, 21e3), (29.0, 33e3)),
    ((30.3, 11e3), (31.5, 9e3), (100.0, 37e3), (-30.4, 51e3)),
    ((-150.0, 7e3), (95.0, 6.1e3), (30.3, 23e3), (-90.0, 71e3), (61.0, 83e3), (115.0, 5.3e3)),
)
"""Headings relative to the bearing of the nearest radar [deg] and lengths [m] of three flights' legs."""


def pieces(
    one: flight.Flight, course: complex, turn: float, length: float
) -> list[tuple[float, complex, float]]:
    """Bank, velocity over ground and duration of a leg's two parts."""
    slow = one.speed * (1.0 - one.loss)
    left, result = abs(turn) * slow / (flight.GRAVITY * math.tan(one.bank)), []
    for bank in (math.copysign(one.bank, turn), 0.0):
        over = one.velocity(0.0, 0j, course, bank)[0]
        time = length / abs(over) if bank == 0.0 else min(left, length / abs(over))
        result.append((bank, over, time))
        length -= time * abs(over)
    return result


@pytest.mark.every("effects", REALITIES)
def test_environment(effects: Effects) -> None:
    """The environment in this reality tells of the flights that the plant makes, scans at most 5 s apart."""
    settings: dict[str, Any] = {
        "layout": LAYOUT,
        "capture": 1e-3,
        "detection": "deterministic",
        "target": 1e9,
    }
    env = gym.make("fieldgym/UavRoute-v1", settings=settings | {"lose": 1e9, "engage": 1e9}, reality=effects)
    one, radars = plant(effects, 250.0), [1e3 * complex(*r) for r in LAYOUT["radars"]]
    for plan in PLANS:
        env.reset(seed=0)
        place, before, clock, largest, over = 1e3 * complex(*LAYOUT["start"]), 0j, 0.0, 0.0, 0.0
        for degrees, length in plan:
            action = degrees / 180.0, 2.0 * math.log(length / 2.5e3) / math.log(200.0) - 1.0
            info = env.step(np.array(action))[-1]
            believed = place + one.bias
            nearest = min(radars, key=lambda r: abs(r - believed))
            course = cmath.rect(1.0, cmath.phase(nearest - believed) + math.radians(degrees))
            turn = cmath.phase(course / before) if before else 0.0
            for bank, velocity, time in pieces(one, course, turn, length):
                count = math.ceil(time / 5.0 - 1e-9)
                air = one.velocity(0.0, place, course, bank)[1]
                for j in range(count):
                    middle = place + (j + 0.5) * time / count * velocity
                    chances = []
                    for radar in radars:
                        one.site = radar + complex(
                            *effects.get("radar_position", {"north": 0.0, "east": 0.0}).values()
                        )
                        chances.append(one.chance(0.0, middle, air, bank))
                    largest, over = max(largest, *chances), over + time / count * (max(chances) > 0.5)
                place, clock = place + time * velocity, clock + time
            before = course
            assert 1e3 * complex(*info["place"]) == pytest.approx(place + one.bias, abs=1e-6)
            assert info["time"] == pytest.approx(clock, abs=1e-9)
            assert info["largest_probability"] == pytest.approx(largest, abs=1e-9)
            assert info["time_over"] == pytest.approx(over, abs=1e-9)
