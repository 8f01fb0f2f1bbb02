"""Faults of a drive that no library lists, hidden by a simulator of its own in plain Python."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from exam.benches import Conditions, Hidden, get_bench
from exam.sizes import recordings
from fieldmodels.diagnosis import diagnose
from fieldmodels.drivers.named import extended_model
from fieldmodels.drivers.variables import variable
from fieldmodels.machines.line_following.model import LineFollowing
from fieldmodels.machines.pose_reaching.model import PoseReaching
from fieldmodels.machines.pose_reaching.recording import record_commands
from fieldmodels.machines.uav_route.model import UavRoute
from fieldmodels.recording import Recording, Windows
from fieldmodels.registry import get_model
from fieldmodels.yaml import save_yaml

STEP, FINE, SAMPLES = 0.05, 10, 2400
RADIUS, TRACK = 0.03, 0.15
NOISE = (0.003, 0.003, 0.01, 0.1, 0.1)
Motion = tuple[float, float, float]
Fault = Callable[[Motion, Motion], Motion]


def drive(
    seed: int, fault: Callable[[], Fault] | None = None, closed: bool = False, slips: bool = True
) -> Recording:
    """A log of a drive: levels held for a second or so, or a heading that a controller follows.

    Args:
        seed: Of commands and noise.
        fault: Makes, for a new run, what becomes of (speed ahead, to the left, turn rate) at (x, y, heading).
        closed: Whether the turn rate corrects the heading that was shown.
        slips: Whether wheels turn as they are told, whatever becomes of the motion.
    """
    rng, act = np.random.default_rng(seed), fault() if fault else None
    held = np.minimum(rng.integers(10, 30, 300).cumsum().searchsorted(np.arange(SAMPLES)), 299)
    speeds, rates = 0.5 * (1 + rng.uniform(-1, 1, 300))[held], rng.uniform(-3, 3, 300)[held]
    wanted, noise = np.cumsum(rates) * STEP * 0.3, rng.standard_normal((SAMPLES, 5)) * NOISE
    x = y = h = 0.0
    rows = np.empty((SAMPLES, 7))
    left = right = 0.0
    for i in range(SAMPLES):
        shown = np.array([x, y, h, left / RADIUS, right / RADIUS]) + noise[i]
        v, w = (0.0, 0.0) if i < 10 else (speeds[i], rates[i])
        if closed and i >= 10:
            w = 2.0 * (wanted[i] - shown[2])
        rows[i] = v, w, *shown
        ahead, aside, turn = act((v, 0.0, w), (x, y, h)) if act else (v, 0.0, w)
        way, change = (v, w) if slips else (ahead, turn)
        left, right = way - TRACK / 2 * change, way + TRACK / 2 * change
        for _ in range(FINE):
            middle, dt = h + 0.5 * turn * STEP / FINE, STEP / FINE
            x += dt * (ahead * math.cos(middle) - aside * math.sin(middle))
            y += dt * (ahead * math.sin(middle) + aside * math.cos(middle))
            h += dt * turn
    names = ("speed", "turn_rate", "x", "y", "heading", "left_wheel", "right_wheel")
    return Recording(
        time=np.arange(SAMPLES) * STEP,
        signals=dict(zip(names, rows.T, strict=True)),
        known={"wheel_radius": RADIUS, "track": TRACK},
        source=f"seed {seed}",
    )


def sliding() -> Fault:
    return lambda m, _p: (m[0], m[1] + 0.003 * m[2] * abs(m[2]), m[2])


def patch() -> Fault:
    return lambda m, p: (m[0] * (0.96 if math.sin(p[0]) > 0.0 else 1.0), m[1], m[2])


def soft() -> Fault:
    return lambda m, _p: (m[0] / (1.0 + 0.05 * abs(m[0])), m[1], m[2])


def loose() -> Fault:
    engaged = [0.0]

    def play(m: Motion, _p: Motion) -> Motion:
        engaged[0] = min(max(engaged[0], m[2] - 0.3), m[2] + 0.3)
        return m[0], m[1], engaged[0]

    return play


HIDDEN = {
    "sliding": (sliding, "sideways speed", "turn_rate"),
    "patch": (patch, "share of forward speed", "x"),
    "soft": (soft, "forward speed", "speed"),
    "loose": (loose, "turn rate", "play of turn_rate"),
}
"""A fault, the direction in which it acts, and what it depends on."""


@pytest.mark.matrix(keep=("sliding",))
@pytest.mark.parametrize("kind", list(HIDDEN))
def test_a_fault_in_any_direction_of_motion_is_found_as_a_curve_there(kind: str):
    fault, target, over = HIDDEN[kind]
    result = diagnose(get_model("pose_reaching"), [drive(1, fault)], [drive(2, fault)])
    assert result.verdict == "unknown", result.summary()
    assert (result.curves[0].place, result.curves[0].target) == ("force", target), result.curves
    assert result.curves[0].over.startswith(over), result.curves[0].over
    suffers = result.gain["heading" if kind == "loose" else "x"]
    assert suffers.rmse_with_curves < 0.5 * suffers.rmse_before + 0.5 * NOISE[2 if kind == "loose" else 0]


@pytest.mark.matrix(keep=("patch",))
@pytest.mark.parametrize("kind", ["loose", "patch"])
def test_the_extended_simulation_of_a_robot_runs_and_errs_less(kind: str, tmp_path: Path):
    logs = [drive(seed, HIDDEN[kind][0]) for seed in (1, 2)]
    found = diagnose(get_model("pose_reaching"), logs[:1], logs[1:])
    assert found.verdict == "unknown"
    assert not found.not_runnable
    path = tmp_path / "extended.yaml"
    save_yaml(found.extended(), path)
    given = np.column_stack([logs[1]["speed"], logs[1]["turn_rate"]])
    again = record_commands(given, np.random.default_rng(0), path, noise=0.0)
    base = {"parameters": {n: e.value for n, e in found.parameters.items()}}
    before = record_commands(given, np.random.default_rng(0), base, noise=0.0)

    def error(one):
        """Of the turn or the way over 2 s, which no drift of a long run hides."""
        changes = [np.unwrap(r["heading"])[40:] - np.unwrap(r["heading"])[:-40] for r in (one, logs[1])]
        ways = [np.hypot(*(r[n][40:] - r[n][:-40] for n in "xy")) for r in (one, logs[1])]
        pair = changes if kind == "loose" else ways
        return np.sqrt(np.mean((pair[0] - pair[1]) ** 2))

    assert error(again) < 0.75 * error(before)
    free = found.simulate(again)
    for name in "xy":  # a curve is held for an eighth of a sample in a recording
        assert np.abs(free[name] - again[name]).max() < 1e-4 * np.ptp(again[name])
    model, vector = extended_model(path)
    assert (model.names, len(vector)) == (found.simulation.model.names, len(found.simulation.vector))


@pytest.mark.parametrize("slips", [True, False])
def test_a_curve_acts_in_the_stage_in_which_it_was_found(slips: bool):
    """Behind the wheels' sensors it leaves the wheels alone; before them it does not move the pose twice."""
    logs = [drive(seed, lambda: lambda m, _p: (m[0], m[1], m[2] / (1.0 + 0.1 * abs(m[2]))), slips=slips)
            for seed in (1, 2)]  # fmt: skip
    found = diagnose(get_model("pose_reaching"), logs[:1], logs[1:])
    assert found.curve_effects
    suffers = found.gain["heading" if slips else "left_wheel"]
    assert suffers.rmse_with_curves < 0.7 * suffers.rmse_before
    after = found.predict(logs[1])
    for name, gain in found.gain.items():
        error = np.sqrt(np.mean((after[name] - after[f"{name}_predicted"]) ** 2))
        assert error == pytest.approx(gain.rmse_with_curves, rel=1e-3), name


@pytest.mark.nightly
@pytest.mark.parametrize("seed", [3, pytest.param(4, marks=pytest.mark.nightly)])
def test_noise_that_a_controller_feeds_back_is_no_curve(seed: int):
    """Commands hold the noise of poses, measured wheels their own: neither makes a curve."""
    result = diagnose(
        get_model("pose_reaching"), [drive(seed, closed=True)], [drive(seed + 500, closed=True)]
    )
    assert result.verdict == "consistent", result.summary()


def windows_of(
    signals: dict[str, np.ndarray], starts: list[int], length: int, episode: np.ndarray
) -> Windows:
    recording = Recording(time=np.arange(len(episode)) * STEP, signals=signals, episode=episode)
    return Windows(
        recording, np.array(starts), np.full(len(starts), length), np.zeros((len(starts), 3)),
        np.ones((len(starts), length, 5), dtype=np.bool_),
    )  # fmt: skip


def test_memory_and_play_follow_a_signal_from_each_episode_s_begin_on():
    rng, length = np.random.default_rng(5), 12
    episode = np.repeat([0, 1], 40)
    signals = {name: rng.normal(size=80) for name in ("speed", "turn_rate", "heading")}
    windows = windows_of(signals, [3, 40, 60], length, episode)
    out = rng.normal(size=(3, length, 5))

    def by_hand(values: np.ndarray, remembered: float, step: Callable[[float, float], float]) -> list[float]:
        result = []
        for value in values:
            remembered = step(remembered, float(value))
            result.append(remembered - float(value))
        return result

    keep = math.exp(-STEP / 0.3)
    rules: dict[str, Callable[[float, float], float]] = {
        "memory of {} over 0.3 s": lambda last, value: keep * last + (1.0 - keep) * value,
        "play of {} of 0.4": lambda last, value: min(max(last, value - 0.4), value + 0.4),
    }
    for name, rule in rules.items():
        got = variable(PoseReaching(), windows, out, name.format("speed"))
        shown = variable(PoseReaching(), windows, out, name.format("heading"))
        for w, start in enumerate(windows.starts):
            begin = 40 * (start // 40)
            along = by_hand(signals["speed"][begin:], float(signals["speed"][begin]), rule)
            np.testing.assert_allclose(got[w], along[start - begin : start - begin + length], atol=1e-12)
            # An output is as measured before the window, and as simulated in it.
            joined = np.concatenate([signals["heading"][begin:start], out[w, :, 2]])
            expected = by_hand(joined, float(joined[0]), rule)[start - begin :]
            np.testing.assert_allclose(shown[w], expected, atol=1e-12)


def test_a_push_moves_a_drive_ahead_and_to_its_left():
    """Beside a steady turn in closed form: the chord of an arc, and the same at a right angle."""
    n, turn = 30, 0.4
    signals = {name: np.zeros(n) for name in ("speed", "turn_rate", "x", "y", "heading")}
    windows = windows_of(signals, [0], n, np.zeros(n, dtype=int))
    pushed = windows.with_disturbance(np.tile([0.3, 0.4, 0.2, 0.03, -0.05, turn - 0.3, 0.1], (n, 1)))
    model = PoseReaching()
    out = model.simulate(model.nominal, pushed)[0, 0]
    angle = turn * STEP * np.arange(n)
    way = (0.5 + 0.2j) * (np.exp(1j * angle) - 1.0) / (1j * turn)
    way += (0.03 - 0.05j) * STEP * np.arange(n)  # the ground's own way, which does not turn with the drive
    np.testing.assert_allclose(out[:, 2], angle, atol=1e-12)
    np.testing.assert_allclose(out[:, 0] + 1j * out[:, 1], way, atol=1e-12)
    wheels = np.array([0.1 - 0.05 * TRACK_OF, 0.1 + 0.05 * TRACK_OF]) / RADIUS_OF  # by the drive alone
    np.testing.assert_allclose(out[5, 3:], wheels, rtol=1e-12)


TRACK_OF, RADIUS_OF = PoseReaching().wheels.track, PoseReaching().wheels.radius


def test_a_push_moves_a_walker_along_its_stride_and_to_its_left():
    model, n = LineFollowing(), 4
    recording = Recording(
        time=np.arange(n) * 1.2,
        signals={name: np.zeros(n) for name in ("steering", "curvature", "line", "offset", "heading")},
    )
    observed = np.ones((1, n, 3), dtype=np.bool_)
    windows = Windows(recording, np.array([0]), np.array([n]), np.array([[0.0, 0.3]]), observed)
    stride = model.nominal[model.index("stride")]
    out = model.simulate(model.nominal, windows.with_disturbance(np.tile([0.0, 0.1, 0.05], (n, 1))))[0, 0]
    each = (stride + 0.1) * math.sin(0.3) + 0.05 * math.cos(0.3)
    np.testing.assert_allclose(out[:, 1], each * np.arange(n), atol=1e-12)
    np.testing.assert_allclose(out[:, 2], 0.3, atol=1e-12)


def test_a_push_to_the_right_of_an_aircraft_s_course():
    """Towards the east a speed to the right goes south, and a wind goes its own way; the course stays."""
    model, n = UavRoute(), 12
    signals = {"to_north": np.zeros(n), "to_east": np.full(n, 1e5), "north": np.zeros(n), "east": np.zeros(n)}
    recording = Recording(time=np.arange(n) * 2.0, signals={**signals, "bank": np.zeros(n)})
    observed = np.ones((1, n, len(model.outputs)), dtype=np.bool_)
    states = np.array([[0.0, 0.0, 0.5 * math.pi]])
    windows = Windows(recording, np.array([0]), np.array([n]), states, observed)
    on, off = (
        model.simulate(model.nominal, windows.with_disturbance(push))[0, 0]
        for push in (np.tile([1.0, 0.5, 0.3, 0.2], (n, 1)), None)
    )
    names = [signal.name for signal in model.outputs]
    north, east = names.index("north"), names.index("east")
    time = 2.0 * np.arange(n)
    np.testing.assert_allclose((on - off)[:, north], (-0.5 + 0.3) * time, atol=1e-6)
    np.testing.assert_allclose((on - off)[:, east], (1.0 + 0.2) * time, atol=1e-6)


def test_a_drive_that_hunts_does_so_over_time():
    """Its speed swings once in 67 samples, whatever it is told."""
    bench = get_bench("pose_reaching")
    train, test = recordings(bench, [Hidden("hunting", 0.3)], Conditions(), 8001)
    found = diagnose(bench.model, [train], [test])
    assert found.unknown is not None
    assert (found.unknown.target, found.unknown.over) == ("forward speed of the drive", "time")
    assert f"repeats every {200 / 3 * train.step:.3g} s" in found.summary()


def test_a_force_in_one_direction_is_added_to_forces_in_several():
    """As where a walk of the turn rate is sought beside a given curve of another direction."""
    windows = PoseReaching().windows(drive(3), 2.0)
    n = len(windows.recording)
    given, turn = np.tile([0.1, 0.5, 0.2, 0.03, -0.05], (n, 1)), np.linspace(0.0, 1.0, n)
    expected = given + np.multiply.outer(turn, [1.0, 0.0, 0.0, 0.0, 0.0])
    for first, more in ((given, turn), (turn, given)):
        np.testing.assert_array_equal(windows.with_disturbance(first).with_force(more).pushed(5), expected)
    np.testing.assert_array_equal(windows.with_force(turn).with_force(turn).disturbance, 2.0 * turn)
