"""The walker's leg and gyro against the exam's plant: every effect, alone and with others."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from numpy.typing import NDArray

import fieldgym  # noqa: F401
from exam.benches import get_bench
from exam.plants import leg
from fieldmodels.machines.heel_strike.model import HeelStrikeModel, samples_around, with_derived
from fieldmodels.recording import Recording, Windows

Array = NDArray[np.float64]
Effects = dict[str, dict[str, float]]

VALUES: Effects = {
    "viscous_friction": {"rate": 0.71},
    "coulomb_friction": {"acceleration": 0.37},
    "quadratic_drag": {"coefficient": 0.37},
    "constant_force": {"acceleration": 0.31},
    "periodic_force": {"sine": -1.3, "cosine": 0.47, "frequency": 2.91},
    "gyro_bias": {"rate": -0.231},
    "gyro_drift": {"rate": -0.0073},
    "gyro_gain": {"gain": 1.71},
    "gyro_delay": {"delay": 0.0193},
    "gyro_quantisation": {"step": 0.231},
    "parameter_step": {"rate": -0.213, "time": 2.1313},
}
OF_GYRO = ("gyro_bias", "gyro_drift", "gyro_gain", "gyro_delay", "parameter_step")
TOGETHER: list[Effects] = [
    {e: VALUES[e] for e in OF_GYRO},
    {e: VALUES[e] for e in ("coulomb_friction", "periodic_force", "viscous_friction", "gyro_delay")},
    {e: VALUES[e] for e in ("gyro_quantisation", "gyro_gain", "gyro_bias")},
]
REALITIES: list[Effects] = [{}, *({e: VALUES[e]} for e in get_bench("heel_strike").effects), *TOGETHER]
PREDICTED = 1e-6
"""Largest error as a share of what the effect changes. A step of RK4 is 2 ms, 6 mrad of the leg's oscillation
and 0.16 rad of the fastest torque's, which errs by 0.16^5 / 2880, or 4e-8, of that torque."""
SHARP = 1e-5
"""Dry friction fades within 0.01 rad/s, which the leg crosses in 4 ms: two steps of RK4."""
FLOOR = 1e-9
"""Errors of RK4 on the leg without effects add up to less over three seconds [rad, rad/s]."""
STEP, COUNT, LENGTH = 0.002, 3000, 1.0371


def walked(effects: Effects, torques: Array, length: float = LENGTH) -> Array:
    """Strike, gyro and angle at the latest strike by the plant, which makes finer steps, shape (n, 3)."""
    plant = leg.Leg(length, steps=16)
    leg.install(plant, effects)
    return leg.simulate(plant, torques, np.zeros((len(torques), 2)), STEP)


def expected(effects: Effects) -> tuple[Recording, Array, Array]:
    """The plant's walk as a recording, its true rate, and gyro, closure and push-off as they should be."""
    still = np.zeros(COUNT)
    rows = walked({e: v for e, v in effects.items() if e != "gyro_quantisation"}, still)
    true = walked({e: v for e, v in effects.items() if "gyro" not in e and e != "parameter_step"}, still)
    time = STEP * np.arange(1.0, len(rows) + 1.0)
    signals = dict(zip(("strike", "gyro", "strike_angle"), rows.T, strict=True))
    recording = with_derived(Recording(time, signals), HeelStrikeModel().leg)
    around, struck = samples_around(recording), np.flatnonzero(rows[:, 0])
    gyro, angle = rows[:, 1], rows[:, 2]
    out = np.full((len(rows), 3), np.nan)
    out[:, 0] = gyro
    turned = np.cumsum(gyro) * STEP
    out[struck[1:], 1] = np.diff(angle[struck]) - np.diff(turned[struck])
    for n in struck[(struck >= around) & (struck + around < len(rows))]:
        before = gyro[n - around + 1 : n + 1].mean()
        after = gyro[n + 1 : n + 1 + around].mean()
        out[n + around, 2] = after - (before + 0.5 * (np.sign(before) - before))
    return recording, true[:, 1], out


def both(effects: Effects) -> tuple[Array, Array, Array]:
    """What the model predicts from strike on, over two strides, also without effects; the plant's."""
    model = HeelStrikeModel()
    recording, true, out = expected(effects)
    starts = np.flatnonzero(recording["strike"])[:-2]
    gain = effects.get("gyro_gain", {}).get("gain", 1.0)
    states = []
    for n in starts:
        time = recording.time[n]
        offset = effects.get("gyro_bias", {}).get("rate", 0.0)
        offset += effects.get("gyro_drift", {}).get("rate", 0.0) * time
        jump = effects.get("parameter_step", {"rate": 0.0, "time": 0.0})
        offset += jump["rate"] * (time >= jump["time"])
        states.append([recording["strike_angle"][n], gain * true[n] + offset])
    ends = np.append(starts, np.flatnonzero(recording["strike"])[-2:])[2:] + 1
    lengths = ends - starts
    observed = np.ones((len(starts), lengths.max(), 4), dtype=np.bool_)
    windows = Windows(recording, starts, lengths, np.array(states), observed)
    vectors = np.array([model.vector({"length": LENGTH}, on) for on in (effects, {})])
    predicted = model.simulate(vectors, windows)[..., [0, 2, 3]]
    seen = np.full(predicted.shape[1:], np.nan)
    for w, (first, length) in enumerate(zip(starts, lengths, strict=True)):
        seen[w, :length] = out[first : first + length]
        seen[w, 0, 1:] = np.nan  # of the stride before
        seen[w, 2 * samples_around(recording) :, 2] = np.nan
    return predicted[0], predicted[1], seen


def apart(ours: Array, theirs: Array) -> Array:
    """Largest difference of each output."""
    return np.nanmax(np.abs(ours - theirs), axis=(0, 1))


@pytest.mark.every("effects", REALITIES)
def test_prediction(effects: Effects) -> None:
    """Effects change a prediction as their equations say, one or more at a time."""
    ours, without, theirs = both(effects)
    change = apart(ours, without)
    assert (change.max() > 1e-3) == bool(
        effects and effects != {"gyro_quantisation": VALUES["gyro_quantisation"]}
    )
    share = SHARP if "coulomb_friction" in effects else PREDICTED
    np.testing.assert_array_less(apart(ours, theirs), share * change + FLOOR)


def test_a_torque_turns_the_leg() -> None:
    """A window's disturbance acts from a sample to the next by its mean."""
    torques = np.repeat(np.random.default_rng(7).uniform(-1.0, 1.0, COUNT // 50), 50)
    rows = walked({}, 0.5 * (torques + np.append(torques[1:], 0.0)))
    first = int(np.flatnonzero(rows[:, 0])[0])
    signals = dict(zip(("strike", "gyro", "strike_angle"), rows.T, strict=True))
    model, time = HeelStrikeModel(), STEP * np.arange(1.0, COUNT + 1.0)
    windows = Windows(
        with_derived(Recording(time, signals), model.leg),
        np.array([first]),
        np.array([1000]),
        rows[None, first, [2, 1]],
        np.ones((1, 1000, 4), dtype=np.bool_),
        np.append(torques[1:], 0.0),
    )
    predicted = model.simulate(model.vector({"length": LENGTH}, {})[None], windows)[0, 0, :, 0]
    np.testing.assert_allclose(predicted, rows[first : first + 1000, 1], rtol=0, atol=FLOOR)


def quiet(effects: Effects, process: float) -> Any:
    """The environment with nothing random but a process torque."""
    settings = {"floor": (0, 0), "collision": (0, 0), "gyro": 0.0, "process": (process, process)}
    env: Any = gym.make("fieldgym/HeelStrike-v0", settings=settings, reality=effects).unwrapped
    env.reset(seed=3)
    return env


@pytest.mark.every("effects", REALITIES[1:])
def test_environment(effects: Effects) -> None:
    """The environment in this reality walks, and reads its gyro, as the plant does under the same torque."""
    strides, parts, strike = quiet(effects, 0.3)._task.strides, [], []
    for _ in range(6):
        result = strides.advance((1.0, 1.0, 0.1, 333.0), traces=True)
        assert not result.fallen[0]
        parts.append(result.traces[0, : result.samples[0]])
        strike.append(np.arange(1, len(parts[-1]) + 1) == len(parts[-1]))
    trace = np.concatenate(parts)
    rows, without = (walked(on, trace[:, 7], 1.0) for on in (effects, dict[str, Any]()))
    np.testing.assert_array_equal(np.concatenate(strike), rows[:, 0] > 0.5)
    change = np.abs(rows[:, 1] - without[:, 1]).max()
    assert change > 5e-4
    limit = (SHARP if "coulomb_friction" in effects else PREDICTED) * change + FLOOR
    np.testing.assert_allclose(trace[:, 0], STEP * np.arange(1.0, len(trace) + 1.0), rtol=1e-12)
    np.testing.assert_allclose(trace[:, 3], rows[:, 1], rtol=0, atol=limit)
    struck = rows[:, 0] > 0.5
    np.testing.assert_allclose(trace[struck, 1], rows[struck, 2], rtol=0, atol=limit)


def test_environment_tells_what_rangers_estimator_makes_of_the_gyro() -> None:
    """``step`` reports Ranger's error by (2.2) and (2.3), and the time, of the walk that the plant makes."""
    effects = {"gyro_delay": {"delay": 0.0047}, "gyro_gain": {"gain": 1.037}, "gyro_bias": {"rate": -0.0171}}
    env = quiet(effects, 0.0)
    steps = [env.step(np.ones(3, dtype=np.float32))[-1] for _ in range(5)]
    rows = walked(effects, np.zeros(3500), 1.0)
    ends = np.flatnonzero(rows[:, 0])[:5]
    np.testing.assert_allclose([info["duration"] for info in steps], np.diff(ends, prepend=-1) * STEP)
    estimate, before, first = 0.0, 1.0, 0
    for end, info in zip(ends, steps, strict=True):
        gyro = np.concatenate([[before], rows[first : end + 1, 1]])
        estimate += np.trapezoid(gyro, dx=STEP)
        assert info["error_mm_ranger"] == pytest.approx(350 * abs(estimate - rows[end, 2]), abs=1e-6)
        estimate += 0.1 * (rows[end, 2] - estimate)
        before, first = gyro[-1] + 0.5 * (np.sign(gyro[-1]) - gyro[-1]), end + 1
