"""The aircraft, watched by a tracker, its own gauge of the bank, and a radar's scans."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import MappingProxyType

import numpy as np

from exam.benches.base import Bench, Conditions, Hidden, Log
from exam.plants import flight, lookalikes
from exam.plants.noise import NOISES, noise
from exam.plants.ruler import Ruler, Windows
from fieldmodels.arrays import FloatArray
from fieldmodels.recording import Recording

DURATION, STEP = 6000.0, 2.0
HORIZON = 60
"""Samples by which a fault is measured."""
DEVIATIONS = (20.0, 20.0, 0.02, 0.3, 0.1)
"""By which errors are weighed: that of a scan's result is chance."""
TYPICAL: Mapping[str, Callable[[float, int, float], dict[str, float]]] = {
    "wind": lambda k, _s, a: {
        "north": 40.0 * math.tanh(0.02 * k) * math.cos(a), "east": 40.0 * math.tanh(0.02 * k) * math.sin(a),
    },
    "turn_speed_loss": lambda k, _s, _a: {"share": 0.45 * math.tanh(0.02 * k)},
    "weaker_bank": lambda k, s, _a: {"factor": math.exp(0.35 * s * math.tanh(0.05 * k))},
    "sensor_bias": lambda k, _s, a: {
        "north": 4e3 * math.tanh(0.005 * k) * math.cos(a), "east": 4e3 * math.tanh(0.005 * k) * math.sin(a),
    },
    # Radars that see more would hardly show: side-on, the aircraft is seen for certain already.
    "signature_scale": lambda k, _s, _a: {"factor": math.exp(-2.9 * math.tanh(0.1 * k))},
    "nose_cone_width": lambda k, s, _a: {"factor": math.exp(0.65 * s * math.tanh(0.1 * k))},
    "radar_range_scale": lambda k, _s, _a: {"factor": math.exp(-math.tanh(0.05 * k))},
    "radar_position": lambda k, _s, a: {
        "north": 9e4 * math.tanh(0.05 * k) * math.cos(a), "east": 9e4 * math.tanh(0.05 * k) * math.sin(a),
    },
    "scan_interval": lambda k, s, _a: {"factor": math.exp(0.8 * s * math.tanh(0.01 * k))},
}  # fmt: skip
"""Values of every effect's parameters: (size, sign, angle)."""


class UavRoute(Bench):
    """A hundred minutes at 0.5 Hz from one random waypoint to the next, about a radar."""

    name = "uav_route"
    effects = flight.LISTED
    steady = ("wind", "weaker_bank", "sensor_bias", "scan_interval")
    alike = frozenset(
        frozenset(pair)
        for pair in (
            ("signature_scale", "radar_range_scale"),
            ("signature_scale", "nose_cone_width"),
            ("radar_range_scale", "nose_cone_width"),
        )
    )
    typical = TYPICAL
    unlisted = MappingProxyType({"develop": {**flight.DEVELOP, **lookalikes.FLIGHT}, "report": flight.REPORT})
    usual_length = 150.0

    def base(self, seed: int) -> dict[str, float]:
        """See ``Bench.base``; the radar stands at zero."""
        speed = 250.0 * math.exp(np.random.default_rng([seed, 1]).uniform(-0.1, 0.1))
        return {"speed": speed, "radar_north": 0.0, "radar_east": 0.0}

    def log(self, hidden: Sequence[Hidden], conditions: Conditions, seed: int, record: int) -> Log:
        """See ``Bench.log``."""
        n = round((conditions.duration or DURATION) / STEP)
        given = round(conditions.cut / STEP) or n
        rng = np.random.default_rng([seed, 2 + record])
        errors = noise(conditions.noise, np.array(flight.NOISE), n, rng) * conditions.factor
        plant = flight.Flight(self.base(seed)["speed"])
        flight.install(plant, self.hide(hidden, plant, n * STEP, seed, record))
        rows = flight.simulate(plant, errors, STEP, *rng.spawn(2))[:given]
        if conditions.noise == "quantised":
            quanta = 2.0 * np.array(flight.NOISE[:3]) * max(conditions.factor, 1e-12)
            rows[:, 2:5] = quanta * np.round(rows[:, 2:5] / quanta)
        return Log(STEP, rows[:, :2], rows[:, 2:])

    def errors(self, train: Log, test: Log, conditions: Conditions, seed: int, known: bool) -> FloatArray:
        """See ``Bench.errors``."""
        del conditions
        ruler = Ruler(_legs, np.array(DEVIATIONS), np.array([20.0, 20.0, 0.005]), np.ones(3))
        return ruler.errors(_windows(train), _windows(test), np.array([self.base(seed)["speed"]]), not known)

    def recording(self, log: Log, conditions: Conditions, seed: int) -> Recording:
        """See ``Bench.recording``: without a scan the gap is 0."""
        names = [signal.name for signal in (*self.model.inputs, *self.model.outputs)]
        columns = np.nan_to_num(np.column_stack([log.inputs, log.outputs])).T
        return self.recorded(dict(zip(names, columns, strict=True)), STEP, conditions, seed)

    def nothing(self) -> Iterator[Conditions]:
        """See ``Bench.nothing``."""
        for factor in (0.0, 1e-4, 1e-2, 0.1, 1.0):
            yield Conditions(factor=factor)
        for kind in NOISES:
            yield Conditions(noise=kind)
        yield Conditions(duration=2.0 * DURATION)


def _windows(log: Log) -> Windows:
    """Windows with, beside the waypoint, how long its leg is flown already and whether it is the first."""
    aim = log.inputs @ (1.0, 1j)
    place = log.outputs[:, :2] @ (1.0, 1j)
    begun = np.flatnonzero(np.r_[True, np.diff(aim) != 0.0])
    leg = np.searchsorted(begun, np.arange(len(aim)), side="right") - 1
    since, before = np.arange(len(aim)) - begun[leg], np.maximum(leg - 1, 0)
    course = np.angle(place[begun[leg]] - place[begun[before]])
    rows = np.arange((len(aim) - 1) // HORIZON)[:, None] * HORIZON + np.arange(HORIZON + 1)
    inputs = np.column_stack([log.inputs, since * log.step, leg == 0])
    first = rows[:, 0]
    states = np.column_stack([log.outputs[first, :2], course[first]])
    return Windows(inputs[rows], log.outputs[rows], states, first.astype(float) * log.step)


def _legs(p: FloatArray, states: FloatArray, inputs: FloatArray, times: FloatArray) -> FloatArray:
    """Windows of the nominal aircraft, a scan in the middle between samples."""
    del times
    speed = np.broadcast_to(p[:, 0, None], states.shape[:2])
    place, course = states[:, :, 0] + 1j * states[:, :, 1], np.exp(1j * states[:, :, 2])
    out = np.empty((*speed.shape, inputs.shape[1], 5))
    left, side, share, scanned = np.zeros(speed.shape), np.zeros(speed.shape), np.zeros(speed.shape), place
    for k in range(inputs.shape[1]):
        aim, since, first = inputs[:, k, 0] + 1j * inputs[:, k, 1], inputs[:, k, 2], inputs[:, k, 3] > 0.0
        begins = (since == 0.0) | (k == 0)
        to = aim - place
        new, before = np.where(begins, to / np.abs(to), course), side
        turn = np.where(first, 0.0, np.angle(new / course))
        time = np.where(np.abs(turn) >= flight.LEAST_TURN, np.abs(turn) * speed / flight.GRAVITY, 0.0)
        left = np.where(begins, time - since, left)
        side = np.where(begins, np.copysign(flight.BANK, turn), side)
        looked = course
        if k == 0:
            share = np.clip(left + STEP, 0.0, np.where(since > 0.0, STEP, 0.0)) / STEP
            looked, before = new, side
        out[:, :, k, 0], out[:, :, k, 1], out[:, :, k, 2] = place.real, place.imag, share * before
        banked, level = (_chances(scanned, looked, bank) for bank in (before, 0.0 * before))
        out[:, :, k, 3], out[:, :, k, 4] = share * banked + (1.0 - share) * level, flight.INTERVAL
        course = new
        share = np.clip(left, 0.0, STEP) / STEP
        scanned = place + 0.5 * STEP * speed * course
        place = place + STEP * speed * course
        left = left - STEP
    return out


def _chances(place: FloatArray, course: FloatArray, bank: FloatArray) -> FloatArray:
    """Tables 4.1 and 4.2 for arrays of places."""
    to = -place / course
    wing = (to.imag + 1j * flight.ALTITUDE) * np.exp(-1j * bank)
    flat = np.hypot(to.real, wing.real)
    side = np.interp(np.abs(np.arctan2(wing.real, to.real)), flight.EDGES, flight.SIDE)
    up = np.abs(np.arctan2(wing.imag, flat))
    cone, between = np.interp(up, flight.UP, flight.CONE), np.interp(up, flight.UP, flight.BETWEEN)
    shown = (1.0 - side) * cone + side * between
    slant = np.hypot(flat, wing.imag)
    ranges = [1e3 * np.interp(shown, flight.SIZES, column) for column in flight.RANGES]
    result = np.full(slant.shape, flight.CHANCES[0])
    for k in range(3):
        share = np.clip((slant - ranges[k]) / (ranges[k + 1] - ranges[k]), 0.0, 1.0)
        result = result + share * (flight.CHANCES[k + 1] - flight.CHANCES[k])
    return np.where(slant <= flight.REACH, result, 0.0)


BENCHES: Mapping[str, UavRoute] = {"uav_route": UavRoute()}
