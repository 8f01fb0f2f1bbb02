"""What a silent answer states, held against faults of known size that simulators of other code hide.

A curve of one signal at the size that it says it would have seen, over that signal and in random shapes, is
found nine times in ten; what depends on nothing measured adds no more than it says.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from exam.benches import Bench, Conditions, Hidden, get_bench
from exam.sizes import errors, recordings
from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.outcome import Diagnosis
from fieldmodels.diagnosis.unseen import LIMIT, mean_square

COMMANDS = ("", "steps", "waves")
OVER = {"time": 0, "position": 1, "velocity": 2, "force": 3}
"""Place of a variable among time, position, velocity and force."""


def with_fault(name: str, act: Callable[[Any], None]) -> Bench:
    """A bench of the exam whose plant has a fault of one's own."""

    class Faulty(type(get_bench(name))):  # type: ignore[misc]
        def hide(self, hidden: Any, plant: Any, scales: Any, seed: int, second: bool) -> Any:
            listed = super().hide(hidden, plant, scales, seed, second)
            act(plant)
            return listed

    return Faulty()


@cache
def quiet(name: str, seed: int, conditions: Conditions) -> Diagnosis:
    """The answer to data in which nothing is hidden."""
    train, test = recordings(get_bench(name), (), conditions, seed)
    return diagnose(get_bench(name).model, [train], [test])


def random_curve(values: np.ndarray, rng: np.random.Generator) -> Callable[[float], float]:
    """A curve through random values at eight quantiles of a variable, of size one over it."""
    knots = np.unique(np.quantile(values, np.linspace(0.01, 0.99, 8)))
    heights = rng.standard_normal(len(knots))
    heights /= np.sqrt(np.mean(np.interp(values, knots, heights) ** 2))
    return lambda x: float(np.interp(x, knots, heights))


def found(seed: int, place: str, target: str, times: float) -> bool:
    """Whether a rig with a random curve at a place, so many times as large as stated, is called faulty."""
    conditions, rng = Conditions(commands=COMMANDS[seed % 3]), np.random.default_rng([seed, len(target)])
    [stated] = [v for v in quiet("rig", seed, conditions).seen if (v.place, v.target) == (place, target)]
    over = stated.over if stated.over in OVER else str(rng.choice(["time", "velocity", "force"]))
    [log, *_] = recordings(get_bench("rig"), (), conditions, seed)
    curve = random_curve(log.time if over == "time" else log[over], rng)
    size, j = times * stated.size, OVER[over]

    def act(plant: Any) -> None:
        if place == "force":
            plant.forces.append(lambda *signals: size * curve(signals[j]))
        else:
            getattr(plant, target).append(lambda shown, *signals: shown + size * curve(signals[j]))

    train, test = recordings(with_fault("rig", act), (), conditions, seed)
    return diagnose(get_bench("rig").model, [train], [test]).verdict != "consistent"


PLACES = (("force", ""), ("sensor", "position"), ("sensor", "velocity"))


@pytest.mark.nightly
def test_nine_of_ten_curves_of_the_stated_size_are_found():
    """If it is nine of ten, five or more of 18 stay hidden in 3 % of such tests; at half the size 10 do."""
    missed = [(s, *p) for s in range(3000, 3006) for p in PLACES if not found(s, *p, 1.0)]
    assert len(missed) <= 4, missed


@pytest.mark.nightly
def test_what_is_much_smaller_than_stated_is_not_found():
    """The stated size is not merely safe: of a quarter of it at most three of nine are found."""
    told = [(s, *p) for s in range(3000, 3003) for p in PLACES if found(s, *p, 0.25)]
    assert len(told) <= 3, told


def test_a_drive_states_what_only_weights_of_its_own_would_show():
    """On 60 windows a wheel's error is noise by the weights of what a fit leaves, however large it is."""
    bench, conditions = get_bench("pose_reaching"), Conditions()
    stated = [v for v in quiet("pose_reaching", 1920, conditions).seen if v.target == "left wheel"]
    size = max(v.size for v in stated)
    assert np.isfinite(size)
    [log, *_] = recordings(bench, (), conditions, 1920)
    turns = np.gradient(np.unwrap(log["heading"]), log.time)
    curve = random_curve(np.convolve(turns, np.full(9, 1.0 / 9.0), "same"), np.random.default_rng(1920))

    def act(drive: Any) -> None:
        def slip(motion: Any, pose: Any, _time: float) -> Any:
            lost = size * curve(motion[2])
            return motion[0] - 0.5 * lost, motion[1], motion[2] + lost / drive.track

        drive.ground.append(slip)

    train, test = recordings(with_fault("pose_reaching", act), (), conditions, 1920)
    assert diagnose(bench.model, [train], [test]).verdict != "consistent"


# What depends on nothing measured.


def added_and_stated(name: str, hidden: Sequence[Hidden], seed: int) -> list[tuple[float, float, float]]:
    """Of each output what a fault adds without noise, what anything may add as stated, and the noise."""
    bench, still = get_bench(name), Conditions(factor=1e-3)
    train, test = recordings(bench, hidden, Conditions(), seed)
    answer = replace(diagnose(bench.model, [train], [test]), verdict="consistent")
    added = errors(bench, hidden, still, seed, False)
    return [
        (float(a), answer.unseen[n], answer.gain[n].noise_floor)
        for a, n in zip(added, answer.gain, strict=True)
    ]


@pytest.mark.nightly
@pytest.mark.parametrize(("name", "most"), [("rig", 0.15), ("pendulum", 1.0)])
def test_gusts_add_no_more_than_is_stated_and_that_is_no_empty_statement(name: str, most: float):
    """From nothing to the noise. One record in ten may exceed 95 % limits (two do in 9 % of such tests)."""
    rows = [
        added_and_stated(name, [Hidden("gusts", size, 1)], 3100 + k)[0]
        for k, size in enumerate(np.linspace(0.1, 1.0, 10) * most)
    ]
    assert sum(added > stated for added, stated, _ in rows) <= 1, rows
    for added, stated, noise in rows:
        assert stated < 1.2 * added + 0.5 * noise, rows


def test_the_limit_of_a_mean_square_holds_in_19_of_20_records():
    """Of errors that are alike in the four windows of a block; 2000 records tell 95 % to 1 %."""
    rng, blocks = np.random.default_rng(1), np.repeat(np.arange(40), 4)
    counts = rng.integers(20, 51, size=len(blocks)).astype(np.float64)
    sizes = np.exp(0.3 * rng.standard_normal((2000, 40)))[:, blocks]
    limits = [
        mean + LIMIT * error for mean, error in (mean_square(counts * s, counts, blocks) for s in sizes)
    ]
    held = np.mean(np.array(limits) > np.exp(0.5 * 0.3**2))
    assert 0.92 < held < 0.97


def test_noise_alone_leaves_a_third_of_it_to_anything():
    for name, seed in (("rig", 3200), ("pendulum", 3201), ("propeller_arm", 3202)):
        answer = quiet(name, seed, Conditions())
        for output, most in answer.unseen.items():
            assert 0.0 < most < 0.4 * answer.gain[output].noise_floor


@pytest.mark.nightly
def test_few_windows_of_many_sensors_state_only_what_is_asked_for():
    """Of a shaken vehicle's 2600 curves the best few are judged with weights of their own."""
    bench, conditions, seed = get_bench("excitation"), Conditions(), 2102
    [stated] = [v for v in quiet("excitation", seed, conditions).seen if v.target == "acceleration_y"]
    rng = np.random.default_rng(seed)
    curve = [random_curve(np.linspace(0.0, 4.0, 400), rng) for _ in range(5)][-1]
    column = [output.name for output in bench.model.outputs].index("acceleration_y")

    def act(plant: Any) -> None:
        def err(shown: np.ndarray, times: np.ndarray) -> np.ndarray:
            result = shown.copy()
            result[:, column] += stated.size * np.array([curve(t) for t in times])[:, None]
            return result

        plant.sensors.append(err)

    train, test = recordings(with_fault("excitation", act), (), conditions, seed)
    assert diagnose(bench.model, [train], [test]).verdict != "consistent"
