"""The heel-strike model: the leg between heel strikes, watched by its gyro and by the geometry.

Process torque makes the gyro's path hard to predict, but whatever the torque did, the gyro's integral over
a stride must be the change of the angle that the geometry gives at its two strikes. That closure, and the
change of speed by the push-off, are derived from the measured columns and compared like measured signals:
they show a gyro's effects through noise that hides it in the path itself. What the geometry errs at a strike
enters two closures with opposite signs, so that over many strides it errs no more than over one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.machines.heel_strike.declaration import as_plants, base_parameters, leg_effects
from fieldmodels.machines.heel_strike.parameters import Leg
from fieldmodels.machines.heel_strike.simulation import Walk, simulate
from fieldmodels.machines.heel_strike.spectrum import torque_peaks
from fieldmodels.model import Model, Signal
from fieldmodels.recording import Recording, RecordingError, Windows

IntArray = NDArray[np.int64]

AROUND = 0.03
"""Time before and after a strike over which the gyro is averaged for the push-off [s]."""
STRIDES = 6
"""Of a long closure; of an even number, since a delay shows in strides to either side with opposite signs."""
LONG = 4
"""Number of the output ``long_turn``."""
TOLD = "span", "middle", "turned", "change"
"""Columns that predict it; see ``with_derived``."""


def samples_around(recording: Recording) -> int:
    """Samples of a recording in the time ``AROUND``."""
    return max(3, round(AROUND / recording.step))


class HeelStrikeModel(Model):
    """The leg of the dissertation's chapter 2 as a model for diagnosis.

    Recordings hold ``gyro`` [rad/s], ``strike`` (1 at the first sample after a heel strike, else 0) and
    ``strike_angle`` [rad] (the angle that the geometry gave at the latest strike, held). The gyro at a
    strike's sample is read before the push-off. ``closure`` [rad] (change of the strike angle less the
    gyro's integral), ``push_off`` [rad/s] (speed after a strike less the one that the push-off aims at) and
    ``long_turn`` [rad] (change of the strike angle over six strides, which the gyro's integral predicts) are
    derived; a recording need not have them. The base parameter is the pendulum's length. A window's state
    is the angle and the gyro's reading, from which the speed follows: the reading is known, the speed is not.

    The rounding of a coarse gyro is part of the truth, not of a prediction: noise dithers it, and the
    expected reading is the unrounded one.
    """

    name = "heel_strike"
    inputs_are_free = False
    inputs = (Signal("strike", "1"),)
    outputs = (
        Signal("gyro", "rad/s", noise=0.0041),
        Signal("strike_angle", "rad", noise=0.0066, angle=True),
        Signal("closure", "rad", noise=0.0093, optional=True, angle=True),
        Signal("push_off", "rad/s", noise=0.005, optional=True),
        Signal("long_turn", "rad", noise=0.0093, optional=True, angle=True),
    )
    states = (Signal("theta", "rad", noise=0.0066, angle=True), Signal("reading", "rad/s", noise=0.003))
    horizons = (0.5, 1.0, 2.0)
    disturbance_unit = "rad/s2"
    random_force = True
    resolution = (*[1.3e-5] * 4, 1e-3)  # trapezoids do not follow a torque that jumps
    measured_states: Mapping[str, str] = MappingProxyType({"theta": "strike_angle", "reading": "gyro"})

    def __init__(self, leg: Leg | None = None) -> None:
        """Take the nominal leg."""
        self.leg = leg or Leg()
        self.parameters = base_parameters(self.leg)
        self.effects = leg_effects()

    def scaled_to(self, recordings: Sequence[Recording]) -> Self:
        """The same model with times, and frequencies of a periodic force, sought where the data have them."""
        duration = max(float(r.time[-1] - r.time[0]) for r in recordings)
        result = type(self)(self.leg)
        stiffness = self.leg.gravity / self.leg.length
        result.effects = leg_effects(duration, torque_peaks(recordings, stiffness))
        return result

    def simulate(self, parameters: FloatArray, windows: Windows) -> FloatArray:
        """See ``Model.simulate``."""
        recording = windows.recording
        force = windows.disturbance
        walk = Walk(
            time=recording.time,
            strike=recording["strike"],
            disturbance=np.zeros(0) if force is None else np.asarray(force, dtype=np.float64),
            step=recording.step,
            gravity=self.leg.gravity,
            speed=self.leg.speed,
            share=self.leg.push_off,
            around=samples_around(recording),
        )
        plants, extended = as_plants(np.atleast_2d(parameters), "force")
        out = np.full((len(plants), len(windows), windows.samples, len(self.outputs)), np.nan)
        states = np.ascontiguousarray(windows.states)
        simulate(plants, extended, windows.starts, states, windows.lengths, walk, out)
        last = windows.lengths - 1
        turns = _long_turns(plants, recording, windows.starts + last, self.leg.gravity)
        out[:, np.arange(len(windows)), last, LONG] = turns
        return out

    def derived(self, outputs: FloatArray, shown: FloatArray, windows: Windows) -> FloatArray:
        """Closure and push-off of sensors that err; see ``Model.derived``.

        Before a window nothing is simulated: the gyro's error there is taken as that of the window's first
        sample, which is read before the push-off like those before it.
        """
        recording, result = windows.recording, shown.copy()
        error = np.nan_to_num(shown - outputs)
        gyro, angle = error[..., 0], error[..., 1]
        around, samples = samples_around(recording), np.arange(windows.samples)
        rows = np.minimum(windows.starts[:, None] + samples, len(recording) - 1)
        struck = np.where(recording["strike"][rows] > 0.5, samples, 0)
        latest = np.zeros_like(struck)  # the strike before each sample, or the window's start
        latest[:, 1:] = np.maximum.accumulate(struck, axis=1)[:, :-1]
        turned = np.cumsum(gyro, axis=2) * recording.step
        then = np.broadcast_to(latest, gyro.shape)
        result[..., 2] += angle - np.take_along_axis(angle, then, axis=2)
        result[..., 2] -= turned - np.take_along_axis(turned, then, axis=2)
        # From one pass of the lowest point to the next the gyro is taken to err as in the other strides.
        own, last = np.arange(len(windows)), windows.lengths - 1
        ends = np.stack([latest[own, last], last])
        at = windows.starts + ends
        since = recording["strike_angle"][at] / np.copysign(self.leg.speed, recording["gyro"][at])
        swung = turned[..., own, ends] - (since + 0.5 * recording.step) * gyro[..., own, ends]
        times = recording["span"][at[1]] / (np.diff(ends, axis=0)[0] * recording.step)
        result[..., own, last, LONG] -= times * (swung[..., 1, :] - swung[..., 0, :])
        after = (turned[..., min(around, windows.samples - 1)] - turned[..., 0]) / (around * recording.step)
        result[..., 3] += (after - (1.0 - self.leg.push_off) * gyro[..., 0])[..., None]
        return result

    def initial_states(self, recording: Recording, starts: IntArray) -> FloatArray:
        """Angle from the geometry and the gyro's integral since; the gyro's reading up to the start."""
        gyro, step, around = recording["gyro"], recording.step, samples_around(recording)
        turned = np.cumsum(gyro) * step
        first = recording.bounds[np.searchsorted(recording.bounds[:, 0], starts, side="right") - 1, 0]
        struck = recording["strike"] > 0.5
        latest = np.maximum.accumulate(np.where(struck, np.arange(len(recording)), -1))[starts]
        latest = np.maximum(latest, first)
        angle = recording["strike_angle"][starts] + turned[starts] - turned[latest]
        speed = np.empty(len(starts))
        for i, (start, begin) in enumerate(zip(starts, np.maximum(first, latest), strict=True)):
            # A strike's own sample is read before the push-off, so the samples up to it belong together.
            begin = first[i] if start == latest[i] else begin + 1
            low = max(start - around + 1, begin)
            lag = np.arange(low - start, 1) * step
            level = gyro[low : start + 1].mean()
            slope = -self.leg.gravity / self.leg.length * np.sin(angle[i])
            speed[i] = level - slope * lag.mean()
        return np.column_stack([angle, speed])

    def windows(self, recording: Recording, horizon: float) -> Windows:
        """Cut a recording from strike to strike.

        A horizon of half a stride gives the second half of every stride; longer ones as many whole strides
        as fit best.

        Raises:
            RecordingError: If the recording has too few strikes.
        """
        recording, around = with_derived(recording, self.leg), samples_around(recording)
        strikes = [
            np.flatnonzero(recording["strike"][a:b] > 0.5).astype(np.int64) + a for a, b in recording.bounds
        ]
        lengths = np.concatenate([np.diff(s) for s in strikes]) if strikes else np.zeros(0)
        if len(lengths) == 0:
            raise RecordingError(
                f"{recording.source}: column 'strike' marks fewer than two heel strikes; it must be 1 at "
                "the first sample after each strike and 0 elsewhere"
            )
        usual = float(np.median(lengths))
        half = horizon < 0.75 * usual * recording.step
        count = max(1, round(horizon / (usual * recording.step)))
        starts: list[int] = []
        ends: list[int] = []
        for (begin, _), own in zip(recording.bounds, strikes, strict=True):
            own = own[own - around >= begin]
            for i in range(0, len(own) - count, count):
                inside = np.diff(own[i : i + count + 1])
                # A stride of unusual length is a missed or a doubled strike.
                if inside.max() < 1.5 * usual and inside.min() > max(0.5 * usual, 4 * around):
                    starts.append(int(own[i] + inside[0] // 2 if half else own[i]))
                    ends.append(int(own[i + count]))
        if not starts:
            raise RecordingError(
                f"{recording.source}: too short for windows of {count} strides; record longer"
            )
        first = np.array(starts, dtype=np.int64)
        length = np.array(ends, dtype=np.int64) - first + 1
        rows = first[:, None] + np.arange(length.max())[None, :]
        inside = np.arange(length.max())[None, :] < length[:, None]
        struck = inside & (recording["strike"][np.minimum(rows, len(recording) - 1)] > 0.5)
        observed = np.zeros((*inside.shape, len(self.outputs)), dtype=np.bool_)
        observed[:, :, 0] = inside
        observed[:, :, 1] = struck
        if not half:
            observed[:, 1:, 2] = struck[:, 1:]
            observed[:, around, 3] = True
            observed[np.arange(len(first)), length - 1, LONG] = True
        return Windows(
            recording=recording,
            starts=first,
            lengths=length,
            states=self.initial_states(recording, first),
            observed=observed,
        )


def with_derived(recording: Recording, leg: Leg) -> Recording:
    """Add what strikes tell: ``closure`` and ``long_turn``, and ``push_off`` some samples after each.

    And what predicts a long closure: its ``span`` and the ``middle`` of that [s], how far the gyro ``turned``
    in it [rad], and the ``change`` of its readings from the first strike to the last [rad/s].
    """
    gyro, angle, step = recording["gyro"], recording["strike_angle"], recording.step
    around, struck = samples_around(recording), recording["strike"] > 0.5
    turned = np.concatenate([[0.0], np.cumsum(gyro)]) * step
    # By trapezoids, of which one begins after each push-off.
    pushes = np.where(struck, pushed(gyro, leg) - gyro, 0.0)
    swung = turned[1:] + 0.5 * step * (np.cumsum(pushes) - pushes - gyro)
    closure, push, long, *told = np.zeros((7, len(recording)))
    for begin, end in recording.bounds:
        strikes = np.flatnonzero(struck[begin:end]) + begin
        if len(strikes) > 1:
            now, then = strikes[1:], strikes[:-1]
            closure[now] = angle[now] - angle[then] - (turned[now + 1] - turned[then + 1])
        if len(strikes) > STRIDES:  # near the ends of an episode there is none, and nothing is predicted
            middle = strikes[STRIDES // 2 : -STRIDES // 2]
            ends = np.stack([strikes[:-STRIDES], strikes[STRIDES:]])
            rows = np.stack([recording.time, swung, gyro, angle])[:, ends]
            span, both, change, geometry = rows[:, 1] - rows[:, 0]
            long[middle] = geometry
            # After a push-off half a step has a part of the gyro's error alone.
            told[0][middle] = span - 0.5 * step * leg.push_off * STRIDES
            told[1][middle] = rows[0].mean(axis=0)
            told[2][middle], told[3][middle] = both, change
        inside = strikes[(strikes - around + 1 >= begin) & (strikes + around < end)]
        before = (turned[inside + 1] - turned[inside + 1 - around]) / (around * step)
        after = (turned[inside + 1 + around] - turned[inside + 1]) / (around * step)
        push[inside + around] = after - pushed(before, leg)
    derived = {"closure": closure, "push_off": push, "long_turn": long}
    units = {"closure": "rad", "push_off": "rad/s", "long_turn": "rad"}
    return replace(
        recording,
        signals={**recording.signals, **derived, **dict(zip(TOLD, told, strict=True))},
        units={**recording.units, **units},
    )


def _long_turns(plants: NDArray[Any], recording: Recording, rows: IntArray, gravity: float) -> FloatArray:
    """How far the leg turned over many strides by what the gyro measured, its faults undone, (plants, rows).

    Of a delay the speeds at both ends remain, at which the geometry is ahead of the gyro. Trapezoids err by
    step^2 / 12 times the pendulum's change of acceleration.
    """
    span, middle, turned, change = (recording[name][rows] for name in TOLD)
    bias, drift, jump = (plants[name][:, None] for name in ("gyro_bias", "gyro_drift", "parameter_step"))
    after = np.clip(middle + 0.5 * span - jump["time"], 0.0, span)
    faults = (bias["rate"] + drift["rate"] * middle) * span + jump["rate"] * after
    late = plants["gyro_delay"]["delay"][:, None] * change
    short = 1.0 + recording.step**2 / 12.0 * gravity / plants["length"][:, None]
    return np.asarray(short * (turned - faults + late) / plants["gyro_gain"]["gain"][:, None])


def pushed(before: FloatArray, leg: Leg) -> FloatArray:
    """Speed that the push-off makes of the speed before a strike."""
    return np.asarray(before - leg.push_off * (before - np.copysign(leg.speed, before)))
