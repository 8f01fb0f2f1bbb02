"""The exam's plants against the oracles, which are slower and adaptive; faults that no model lists."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from exam.benches import Conditions, Hidden, bench_names, get_bench
from exam.oracles import find_oracle, heel_strike, line_following
from exam.plants import axis_listed, leg, vehicle, walk
from exam.plants.axis import simulate
from exam.plants.commands import COMMANDS
from exam.plants.noise import NOISES
from exam.plants.ruler import Ruler, Windows

AXES = ("rig", "pendulum", "propeller_arm", "servo")
STEP, SAMPLES = 0.01, 90
NEAR = {"coulomb_friction": 0.02, "stribeck_friction": 0.08, "hysteresis": 0.02, "actuator_rate_limit": 0.02}
"""Share of what an effect contributes by which a plant may err; else half a percent."""


def held(largest: float, rng: np.random.Generator) -> np.ndarray:
    """Commands that are held for 0.1 s, the first one zero, the largest one among them."""
    levels = rng.uniform(-1.0, 1.0, SAMPLES // 10)
    levels[0] = 0.0  # so that nothing happens before the first sample of a late sensor
    return largest * np.repeat(levels / np.abs(levels).max(), 10)


def at_rest(name: str) -> dict[str, float]:
    """A machine that stays where it is until its first command."""
    base = get_bench(name).base(3)
    return {**base, "offset": 0.0} if "offset" in base else base


def shown(name: str, effects: dict[str, Any], commands: np.ndarray) -> np.ndarray:
    """What a plant shows without noise."""
    bench: Any = get_bench(name)
    plant = bench.plant(at_rest(name))
    axis_listed.install(plant, effects, float(np.abs(commands).max()), bench.linear)
    rows = simulate(plant, lambda i, _x, _v: float(commands[i]), np.zeros((len(commands), 2)), STEP)
    np.testing.assert_array_equal(rows[:, 0], commands)
    return rows[:, 1:]


@pytest.mark.parametrize(("name", "effect"), [(n, e) for n in AXES for e in get_bench(n).effects])
def test_a_listed_effect_acts_as_its_oracle_says(name: str, effect: str):
    bench: Any = get_bench(name)
    commands = held(bench.sizes.u, np.random.default_rng([5, len(effect)]))
    values = bench.values(effect, 3.1, 1, 3)  # no delay of a whole number of steps
    if effect == "parameter_step":
        values["time"] = 0.4
    oracle = find_oracle(name)
    on, off = (
        oracle.simulate(at_rest(name), hidden, commands[:, None], STEP) for hidden in ({effect: values}, {})
    )
    contribution = np.abs(on - off).max(axis=0)
    assert contribution.max() > 0.0
    error = np.abs(shown(name, {effect: values}, commands) - on).max(axis=0)
    allowed = NEAR.get(effect, 0.005) * contribution + 1e-7 * np.abs(on).max(axis=0)
    assert (error <= allowed).all(), (error, allowed)


def test_several_effects_act_in_the_documented_order():
    effects = {
        "parameter_step": {"time": 0.3, "factor": 1.4}, "actuator_saturation": {"limit": 5.0},
        "actuator_dead_zone": {"width": 1.0}, "actuator_asymmetry": {"difference": 0.3},
        "actuator_gain": {"gain": 1.2}, "actuator_lag": {"time_constant": 0.03},
        "actuator_delay": {"delay": 0.013}, "sensor_gain": {"gain": 1.1}, "sensor_drift": {"rate": 0.02},
        "sensor_delay": {"delay": 0.017}, "backlash": {"gap": 0.01},
    }  # fmt: skip
    commands = held(8.0, np.random.default_rng(6))
    on = find_oracle("rig").simulate(get_bench("rig").base(3), effects, commands[:, None], STEP)
    np.testing.assert_allclose(shown("rig", effects, commands), on, atol=2e-3 * np.abs(on).max())


DRIVES = ("pose_reaching", "differential_drive")


@pytest.mark.parametrize(("name", "effect"), [(n, e) for n in DRIVES for e in get_bench(n).effects])
def test_a_listed_effect_of_a_drive_acts_as_its_oracle_says(name: str, effect: str):
    bench: Any = get_bench(name)
    conditions = Conditions(factor=0.0, duration=6.0)
    values = bench.values(effect, 6.0, 1, 3)
    if effect == "parameter_step":  # within the record
        bench = type(bench)()
        values["time"] = 2.5
        bench.values = lambda *_: values
    on, off = (bench.log(hidden, conditions, 3, False) for hidden in ([Hidden(effect, 6.0)], []))
    signals = bench.recording(on, conditions, 3)
    commands = np.column_stack([signals[s.name] for s in bench.model.inputs])
    truth = find_oracle(name).simulate(bench.base(3), {effect: values}, commands, on.step)
    contribution = np.abs(on.outputs - off.outputs).max(axis=0)
    assert contribution.max() > 0.0
    allowed = 5e-3 * contribution + 1e-8
    assert (np.abs(on.outputs - truth).max(axis=0) <= allowed).all()


@pytest.mark.parametrize("effect", [*get_bench("line_following").effects, "all"])
def test_a_listed_effect_of_a_walk_acts_as_its_oracle_says(effect: str):
    bench = get_bench("line_following")
    names = [name for name in bench.effects if effect in (name, "all")]
    hidden = [Hidden(name, 1.5) for name in names]
    rows = bench.log(hidden, Conditions(factor=0.0, duration=60.0), 3, False)
    values = {name: bench.values(name, 1.5, 1, 3) for name in names}
    line = line_following.Line(((100.0, 0.0),))
    truth = line_following.walk(line_following.Robot(values), line, 0.0, 0.0, rows.inputs[:, 0])
    np.testing.assert_allclose(rows.outputs, truth[:-1], atol=1e-9)


@pytest.mark.parametrize("effect", ["", *get_bench("heel_strike").effects])
def test_a_listed_effect_of_a_leg_acts_as_its_oracle_says(effect: str):
    values = {effect: get_bench("heel_strike").values(effect, 3.0, 1, 3)} if effect else {}
    if effect == "parameter_step":
        values[effect]["time"] = 5.0
    torques = np.repeat(np.random.default_rng(11).uniform(-0.15, 0.15, 40), 25)[:800]
    plant = leg.Leg(1.03)
    leg.install(plant, values)
    rows = leg.simulate(plant, torques, np.zeros((800, 2)), 0.01)
    truth = heel_strike.walk(heel_strike.Leg(values, 1.03), 800, 0.01, lambda k: float(torques[k]))
    np.testing.assert_array_equal(rows[:, 0], truth.strike)
    np.testing.assert_allclose(rows[:, 1], truth.gyro, atol=2e-5 if effect == "coulomb_friction" else 1e-7)
    struck = np.flatnonzero(truth.strike)
    np.testing.assert_allclose(rows[struck, 2], truth.angle[struck], atol=2e-5)


@pytest.mark.parametrize("effect", ["", *get_bench("uav_route").effects])
def test_a_listed_effect_of_a_flight_acts_as_its_oracle_says(effect: str):
    """Positions and banks exactly; chances of detection on average, as they are drawn."""
    bench = get_bench("uav_route")
    values = {effect: bench.values(effect, 10.0, 1, 3)} if effect else {}
    hidden = [Hidden(effect, 10.0)] if effect else []
    log = bench.log(hidden, Conditions(factor=0.0, duration=3000.0), 3, False)
    bias = values.get("sensor_bias", {"north": 0.0, "east": 0.0})
    start = {name: log.outputs[0, i] - bias[name] for i, name in enumerate(("north", "east"))}
    truth = find_oracle("uav_route").simulate(bench.base(3), values, log.inputs, log.step, start)
    np.testing.assert_allclose(log.outputs[:, :2], truth[:, :2], atol=1e-5)
    np.testing.assert_allclose(log.outputs[1:, 2], truth[1:, 2], atol=1e-9)
    scanned = np.isfinite(log.outputs[:, 3])
    np.testing.assert_allclose(log.outputs[scanned, 4], truth[scanned, 4])
    chance = truth[scanned, 3]
    surplus = (log.outputs[scanned, 3] - chance).sum() / math.sqrt((chance * (1.0 - chance)).sum())
    assert abs(surplus) < 3.0
    nominal = find_oracle("uav_route").simulate(bench.base(3), {}, log.inputs, log.step, start)[scanned, 3]
    if np.abs(nominal - chance).mean() > 0.02:  # the draws follow the effect, not the nominal chances
        assert np.mean((log.outputs[scanned, 3] - chance) ** 2) < np.mean(
            (log.outputs[scanned, 3] - nominal) ** 2
        )


@pytest.mark.parametrize("effect", ["", *get_bench("excitation").effects])
def test_a_listed_effect_of_a_shaken_vehicle_acts_as_its_oracle_says(effect: str):
    """To 2 % of the sensors' noise, or half a percent of what the effect contributes (soil: 2 %)."""
    bench, mode, count = get_bench("excitation"), len(effect) % 3, 50
    values = {effect: bench.values(effect, 6.0, 1, 3)} if effect else {}
    base = bench.base(3)
    shaped = [np.array([[base[f"{kind}_{a}"]] for a in vehicle.AXES]) for kind in ("damping", "stiffness")]
    plant = vehicle.Vehicle(*shaped)
    vehicle.install(plant, values)
    samples = vehicle.shaking(count * STEP, STEP, np.random.default_rng(7))
    spline = make_interp_spline(np.arange(count + 1.0), samples, k=5)
    fine = spline(np.arange(count * vehicle.FINE + 1) / vehicle.FINE)[:, None]
    rows = vehicle.simulate(plant, np.array([float(mode)]), fine, np.zeros((count, 11, 1)), STEP)[..., 0]
    commands = np.column_stack([samples, np.full(count + 1, mode + 1.0)])
    on, off = (
        find_oracle("excitation").simulate(base, hidden, commands, STEP)[:count] for hidden in (values, {})
    )
    allowed = 0.02 * np.array(vehicle.NOISE) + (0.02 if "soil" in effect else 0.005) * np.abs(on - off).max()
    assert (np.abs(rows - on).max(axis=0) <= allowed).all(), np.abs(rows - on).max(axis=0) / vehicle.NOISE


UNLISTED = [
    (name, kind)
    for name in bench_names()
    for which in ("develop", "report")
    for kind in get_bench(name).unlisted[which]
]


@pytest.mark.parametrize(("name", "kind"), UNLISTED)
def test_an_unlisted_fault_acts_the_more_the_larger_it_is_and_hardly_where_it_is_small(name: str, kind: str):
    bench = get_bench(name)
    lengths = {"line_following": 60.0, "heel_strike": 30.0, "uav_route": 3000.0, "excitation": 4.0}
    conditions = Conditions(duration=lengths.get(name, 6.0), factor=0.0)
    plain = np.nan_to_num(bench.log([], conditions, 4, False).outputs)

    def off(size: float) -> float:
        one = np.nan_to_num(bench.log([Hidden(kind, size)], conditions, 4, False).outputs)
        return float((np.sqrt(np.mean((one - plain) ** 2, axis=0)) / plain.std(axis=0)).max())

    small = off(1e-3)
    assert small < 0.02
    assert any(off(size) > max(3.0 * small, 1e-3) for size in (3.0, 10.0, 30.0))


def test_a_walker_s_own_chance_is_white_whatever_its_sensors_noise(monkeypatch):
    """What wanders between strides would be a fault of the robot."""
    drawn = []
    monkeypatch.setattr(
        walk, "simulate", lambda _walker, _added, noise: drawn.append(noise) or np.zeros((len(noise), 4))
    )
    get_bench("line_following").log([], Conditions(noise="random_walk"), 3, False)
    noise = drawn[0] / drawn[0].std(axis=0)
    alike = [float(np.corrcoef(one[1:], one[:-1])[0, 1]) for one in noise.T]
    assert min(alike[:3]) > 0.5
    assert np.abs(alike[3:]).max() < 0.13  # four standard errors


def test_a_controller_follows_a_path_by_what_is_shown():
    bench = get_bench("rig")
    closed = [bench.log((), Conditions(closed=True, factor=factor), 4, False) for factor in (0.0, 1.0)]
    assert np.abs(closed[0].inputs - closed[1].inputs).max() > 0.01  # noise is fed back
    assert np.corrcoef(closed[0].outputs[:, 0], closed[1].outputs[:, 0])[0, 1] > 0.999


@pytest.mark.parametrize("kind", NOISES)
def test_noise_has_the_variance_that_it_should(kind: str):
    rng = np.random.default_rng(8)
    noise = np.concatenate([NOISES[kind](20_000, rng) for _ in range(5)])
    local = float(np.std(np.diff(noise))) / math.sqrt(2.0)
    assert 0.2 < local < 1.6
    if kind not in ("random_walk", "bursting"):
        assert np.std(noise) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("kind", COMMANDS)
def test_commands_have_a_peak_of_one_at_most(kind: str):
    time = np.arange(3000) * 0.01
    commands = COMMANDS[kind](time, np.random.default_rng(9))
    assert commands.shape == time.shape
    assert 0.02 < np.abs(commands).max() <= 1.0 + 1e-12


def test_a_ruler_finds_the_parameters_that_made_the_data():
    """Of y = a t^2 / 2 + v t + x with noise, against the line fit in closed form."""
    rng, time = np.random.default_rng(10), np.arange(20) * 0.1

    def predict(p, states, inputs, _times):
        push = p[:, 0, None, None] * inputs[None, :, :, 0] * time**2 / 2
        return (push + states[:, :, 1, None] * time + states[:, :, 0, None])[..., None]

    states, inputs = rng.normal(size=(30, 2)), rng.normal(size=(30, 20, 1)) * 0 + rng.normal(size=(30, 1, 1))
    noisy = predict(np.array([[2.3]]), states[None], inputs, None)[0] + 0.05 * rng.normal(size=(30, 20, 1))
    windows = Windows(inputs, noisy, states + 0.1, np.zeros(30))
    ruler = Ruler(predict, np.array([0.05]), np.ones(2), np.full(2, np.inf))
    fitted, _, _ = ruler._fit(windows, np.array([1.0]), True)
    plane = np.column_stack([np.ones(20), time])
    left = np.eye(20) - plane @ np.linalg.pinv(plane)
    a = (left @ (inputs[:, :, 0] * time**2 / 2).T).ravel()
    assert fitted[0] == pytest.approx(float(a @ (left @ noisy[:, :, 0].T).ravel() / (a @ a)), rel=1e-6)
    expected = math.sqrt(
        np.mean((left @ (noisy[:, :, 0] - fitted[0] * inputs[:, :, 0] * time**2 / 2).T) ** 2)
    )
    assert ruler.errors(windows, windows, np.array([1.0]))[0] == pytest.approx(expected, rel=1e-6)
