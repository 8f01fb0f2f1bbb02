"""The walker against an oracle by SciPy that shares no code with it: every effect, alone and in pairs."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from numpy.typing import NDArray

import fieldgym  # noqa: F401
from exam.oracles.heel_strike import Leg, Walk, simulate, walk
from fieldmodels.machines.heel_strike.model import HeelStrikeModel, samples_around, with_derived
from fieldmodels.recording import Recording, Windows

Array = NDArray[np.float64]
Effects = dict[str, dict[str, float]]

LEG: dict[str, tuple[dict[str, float], ...]] = {
    "viscous_friction": ({"rate": 0.0137}, {"rate": 1.71}, {"rate": -0.283}),
    "coulomb_friction": ({"acceleration": 0.0217}, {"acceleration": 0.37}),
    "quadratic_drag": ({"coefficient": 0.0171}, {"coefficient": 1.37}),
    "constant_force": ({"acceleration": 0.0171}, {"acceleration": -0.93}, {"acceleration": 1.31}),
    "periodic_force": (
        {"sine": 0.037, "cosine": -0.021, "frequency": 0.73},
        {"sine": -1.3, "cosine": 0.47, "frequency": 2.91},
        {"sine": 0.31, "cosine": 0.83, "frequency": 13.3},
    ),
    "gyro_bias": ({"rate": 0.0021}, {"rate": -0.231}),
    "gyro_drift": ({"rate": 0.00013}, {"rate": -0.0073}),
    "gyro_gain": ({"gain": 1.0117}, {"gain": 0.613}, {"gain": 1.71}),
    "gyro_delay": ({"delay": 0.00073}, {"delay": 0.0131}, {"delay": 0.0193}),
    "gyro_quantisation": ({"step": 0.0117}, {"step": 0.231}),
    "parameter_step": ({"rate": 0.0037, "time": 2.7313}, {"rate": -0.213, "time": 3.471}),
}
CASES = {"heel_strike": LEG}
ALONE: list[Effects] = [{name: values} for name, cases in LEG.items() for values in cases]
PAIRS: list[Effects] = [
    {a: LEG[a][-1], b: LEG[b][-1]}
    for a, b in (
        ("gyro_bias", "gyro_gain"),
        ("gyro_drift", "gyro_gain"),
        ("parameter_step", "gyro_gain"),
        ("gyro_delay", "gyro_drift"),
        ("gyro_delay", "gyro_gain"),
        ("gyro_quantisation", "gyro_bias"),
        ("gyro_quantisation", "gyro_gain"),
        ("coulomb_friction", "gyro_delay"),
        ("periodic_force", "viscous_friction"),
        ("constant_force", "gyro_bias"),
    )
]
PAIRS.append({effect: cases[0] for effect, cases in LEG.items()})  # and all of them at once

PREDICTED = 1e-6
"""Largest error as a share of what the effect changes. A step of RK4 is 2 ms, 6 mrad of the leg's oscillation
and 0.16 rad of the fastest torque's, which errs by 0.16^5 / 2880, or 4e-8, of that torque."""
SHARP = {"coulomb_friction": 1e-5}
"""Dry friction fades within 0.01 rad/s, which the leg crosses in 4 ms: two steps of RK4."""
FLOOR = 1e-9
"""Errors of RK4 on the leg without effects add up to less over three seconds [rad, rad/s]."""


def names(values: Effects) -> str:
    """Name of a test's case."""
    if len(values) > 2:
        return "all"
    return "+".join(f"{effect}:{','.join(f'{v:g}' for v in v.values())}" for effect, v in values.items())


def windows(torque: bool = False) -> Windows:
    """Windows of 0.12 to 3.2 s, with and without strikes, from slow and fast states, shape (5,)."""
    step, count = 0.002, 3000
    time = 1.3 + np.arange(count) * step
    strike = np.zeros(count)
    strike[[100, 620, 1137, 1650, 2210]] = 1.0
    zeros = np.zeros(count)
    recording = Recording(time, {"strike": strike, "gyro": zeros, "strike_angle": zeros})
    recording = with_derived(recording, HeelStrikeModel().leg)
    states = np.array([[0.0131, 0.973], [0.0021, -0.91], [0.31, 0.05], [-0.173, 0.64], [-0.004, 1.07]])
    lengths = np.array([521, 1100, 61, 300, 1600])
    rng = np.random.default_rng(7)
    wave = np.repeat(rng.uniform(-1, 1, count // 50), 50)
    return Windows(
        recording,
        np.array([100, 620, 1300, 37, 1137]),
        lengths,
        states,
        np.ones((5, lengths.max(), 4), dtype=np.bool_),
        wave if torque else None,
    )


def both(effects: Effects, torque: bool = False) -> tuple[list[Array], list[Array]]:
    """What the model and the oracle predict of the windows."""
    model, made = HeelStrikeModel(), windows(torque)
    base = {"length": 1.0371}
    predicted = model.simulate(model.vector(base, effects)[None], made)[0]
    ours, theirs = [], []
    recording, around = made.recording, samples_around(made.recording)
    force = np.zeros(len(recording)) if made.disturbance is None else made.disturbance
    for w, (first, length) in enumerate(zip(made.starts, made.lengths, strict=True)):
        rows, leg = slice(first, first + length), Leg(effects)
        time = recording.time[first]
        offset, gain = leg.offset(np.array([time]))[0], leg.value("gyro_gain", "gain")
        theta, reading = made.states[w]
        oracle = simulate(
            base,
            effects,
            np.column_stack([recording["strike"][rows], force[rows]]),
            recording.step,
            {"theta": theta, "omega": (reading - offset) / gain, "time": time},
        )
        only = np.arange(length) != around
        oracle[only, 3] = np.nan
        own = predicted[w, :length, :4].copy()  # a long turn is predicted by what was measured
        own[only, 3] = np.nan
        ours.append(own)
        theirs.append(oracle)
    return ours, theirs


def apart(ours: list[Array], theirs: list[Array]) -> Array:
    """Largest difference of each output over all windows, shape (outputs,)."""
    return np.nanmax(np.abs(np.concatenate(ours) - np.concatenate(theirs)), axis=0)


@pytest.mark.parametrize("torque", [False, True])
def test_nominal_predictions(torque: bool) -> None:
    """With no effect on, and under a torque, the prediction is the oracle's."""
    assert (apart(*both({}, torque)) < FLOOR).all()


def test_prediction(effect: str, values: dict[str, float]) -> None:
    """One effect changes a prediction as its equation says."""
    ours, theirs = both({effect: values})
    _, without = both({})
    change = apart(theirs, without)
    assert (change.max() > 1e-5) == (effect != "gyro_quantisation")
    share = SHARP.get(effect, PREDICTED)
    np.testing.assert_array_less(apart(ours, theirs), share * change + FLOOR)


@pytest.mark.parametrize("values", PAIRS, ids=map(names, PAIRS))
def test_prediction_of_pairs(values: Effects) -> None:
    """Effects act together in the order that their equations say."""
    ours, theirs = both(values)
    change = apart(theirs, both({})[1])
    share = max(SHARP.get(effect, PREDICTED) for effect in values)
    np.testing.assert_array_less(apart(ours, theirs), share * change + FLOOR)


def quiet(effects: Effects, process: float) -> Any:
    """The environment with nothing random but a process torque."""
    settings = {"floor": (0, 0), "collision": (0, 0), "gyro": 0.0, "process": (process, process)}
    env: Any = gym.make("fieldgym/HeelStrike-v0", settings=settings, reality=effects).unwrapped
    env.reset(seed=3)
    return env


def walked(effects: Effects, strides: int = 6) -> tuple[Walk, Array]:
    """Samples of a walk in the environment, and the torque before each."""
    strides_of = quiet(effects, 0.3)._task.strides
    parts, strike = [], []
    for _ in range(strides):
        result = strides_of.advance((1.0, 1.0, 0.1, 333.0), traces=True)
        assert not result.fallen[0]
        parts.append(result.traces[0, : result.samples[0]])
        strike.append(np.arange(1, len(parts[-1]) + 1) == len(parts[-1]))
    trace = np.concatenate(parts)
    return Walk(*trace[:, :4].T, np.concatenate(strike)), trace[:, 7]


REALITIES = [*ALONE, *PAIRS]


@pytest.mark.matrix(
    keep=(
        "quadratic_drag:0.0171",
        "constant_force:-0.93",
        "constant_force:1.31",
        "gyro_drift:-0.0073",
        "gyro_gain:1.0117",
        "gyro_gain:0.613",
    )
)
@pytest.mark.parametrize("effects", REALITIES, ids=map(names, REALITIES))
def test_environment(effects: Effects) -> None:
    """The environment in this reality walks, and reads its gyro, as the oracle does under the same torque."""
    own, torque = walked(effects)
    theirs, without = (
        walk(Leg(on), len(own.time), torque=lambda k: torque[k]) for on in (effects, dict[str, Any]())
    )
    np.testing.assert_array_equal(own.strike, theirs.strike)
    change = np.abs(theirs.gyro - without.gyro).max()
    assert change > 5e-4
    limit = max(SHARP.get(effect, PREDICTED) for effect in effects) * change + FLOOR
    np.testing.assert_allclose(own.time, theirs.time, rtol=1e-12)
    for ours, oracle in ((own.angle, theirs.angle), (own.speed, theirs.speed), (own.gyro, theirs.gyro)):
        np.testing.assert_allclose(ours, oracle, rtol=0, atol=limit)


def test_environment_tells_what_rangers_estimator_makes_of_the_gyro() -> None:
    """``step`` reports Ranger's error by (2.2) and (2.3), and the time, of the walk that the oracle makes."""
    effects = {"gyro_delay": {"delay": 0.0047}, "gyro_gain": {"gain": 1.037}, "gyro_bias": {"rate": -0.0171}}
    env, leg = quiet(effects, 0.0), Leg(effects)
    steps = [env.step(np.ones(3, dtype=np.float32))[-1] for _ in range(5)]
    made = walk(leg, 3500)
    ends = np.flatnonzero(made.strike)[:5]
    np.testing.assert_allclose([info["duration"] for info in steps], np.diff(ends, prepend=-1) * 0.002)
    estimate, before, first = 0.0, 1.0, 0
    for end, info in zip(ends, steps, strict=True):
        gyro = np.concatenate([[before], made.gyro[first : end + 1]])
        estimate += np.trapezoid(gyro, dx=0.002)
        assert info["error_mm_ranger"] == pytest.approx(350 * abs(estimate - made.angle[end]), abs=1e-6)
        estimate += 0.1 * (made.angle[end] - estimate)
        before, first = leg.pushed(gyro[-1]), end + 1
