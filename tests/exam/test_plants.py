"""Faults that no model lists in the exam's plants, and what excites and disturbs these."""

from __future__ import annotations

import math

import numpy as np
import pytest

from exam.benches import Conditions, Hidden, bench_names, get_bench
from exam.plants import walk
from exam.plants.commands import COMMANDS
from exam.plants.noise import NOISES
from exam.plants.ruler import Ruler, Windows

LENGTHS = {"line_following": 60.0, "heel_strike": 30.0, "uav_route": 3000.0, "excitation": 4.0}


@pytest.mark.every("name", bench_names())
def test_an_unlisted_fault_acts_the_more_the_larger_it_is_and_hardly_where_it_is_small(name: str):
    bench, conditions = get_bench(name), Conditions(duration=LENGTHS.get(name, 6.0), factor=0.0)
    plain = np.nan_to_num(bench.log([], conditions, 4, False).outputs)

    def off(kind: str, size: float) -> float:
        one = np.nan_to_num(bench.log([Hidden(kind, size)], conditions, 4, False).outputs)
        return float((np.sqrt(np.mean((one - plain) ** 2, axis=0)) / plain.std(axis=0)).max())

    wrong = {}
    for kind in [kind for which in ("develop", "report") for kind in bench.unlisted[which]]:
        small = off(kind, 1e-3)
        if small >= 0.02 or not any(off(kind, size) > max(3.0 * small, 1e-3) for size in (3.0, 10.0, 30.0)):
            wrong[kind] = small
    assert not wrong


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


@pytest.mark.every("kind", NOISES)
def test_noise_has_the_variance_that_it_should(kind: str):
    rng = np.random.default_rng(8)
    noise = np.concatenate([NOISES[kind](20_000, rng) for _ in range(5)])
    local = float(np.std(np.diff(noise))) / math.sqrt(2.0)
    assert 0.2 < local < 1.6
    if kind not in ("random_walk", "bursting"):
        assert np.std(noise) == pytest.approx(1.0, abs=0.15)


@pytest.mark.every("kind", COMMANDS)
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
