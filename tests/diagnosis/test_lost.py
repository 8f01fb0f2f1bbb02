"""Samples that a sensor loses or cannot show, in records written down here."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from exam.benches import Conditions, get_bench
from exam.sizes import recordings
from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.answer import headline, what_to_do
from fieldmodels.diagnosis.lost import lost_samples
from fieldmodels.recording import Recording
from fieldmodels.registry import get_model

STEP, COUNT = 0.01, 2000
RIG = get_model("rig")


def record(seed=0, noise=2e-4):
    rng = np.random.default_rng(seed)
    time = np.arange(COUNT) * STEP
    position = 0.1 * np.sin(3.0 * time) + noise * rng.standard_normal(COUNT)
    return Recording(time, {"force": np.cos(3.0 * time), "position": position})


def shown(one, position):
    return replace(one, signals={**one.signals, "position": position})


def held(values, lost):
    result = values.copy()
    for k in np.flatnonzero(lost):
        result[k] = result[k - 1]
    return result


def test_lost_samples_are_said_and_put_between_the_others():
    one = record()
    lost = np.random.default_rng(1).uniform(size=COUNT) < 0.05
    lost[0] = False
    lossy = shown(one, held(one["position"], lost))
    (mended,), (untouched, tested), said = lost_samples(RIG, [lossy], [one, lossy])
    assert np.array_equal(tested["position"], mended["position"])
    assert said == (
        f"the position sensor repeats its last value in {100 * lost.mean():.2g} % of the samples, which were "
        "lost and are interpolated here",
    )
    assert np.array_equal(mended["position"][~lost], one["position"][~lost])
    true = 0.1 * np.sin(3.0 * one.time)
    assert np.abs(mended["position"] - true)[lost].max() < 1.5e-3  # 3 mm a sample, if it stood still
    assert untouched is one


def test_an_angle_is_interpolated_across_a_turn():
    drive = get_model("differential_drive")
    time = np.arange(COUNT) * 0.05
    rng = np.random.default_rng(3)
    true = 0.3 * time + 0.01 * rng.standard_normal(COUNT)
    lost = rng.uniform(size=COUNT) < 0.1
    lost[0] = False
    shown_heading = held((true + np.pi) % (2 * np.pi) - np.pi, lost)
    given = {"heading": shown_heading, "x": time.copy(), "y": time.copy()}
    (mended,), _, said = lost_samples(drive, [Recording(time, given)], [])
    assert len(said) == 1
    error = (mended["heading"] - 0.3 * time + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(error[lost]).max() < 0.05
    assert np.abs(mended["heading"] - shown_heading).max() < 1.0  # no turn is added


def test_a_run_is_not_continued_by_the_next_one():
    """The last sample of a run is lost; the next run begins elsewhere."""
    one = record()
    episode = np.repeat([0, 1], COUNT // 2)
    apart = one["position"] + 10.0 * episode
    lost = np.random.default_rng(1).uniform(size=COUNT) < 0.05
    lost[[0, COUNT // 2]] = False
    lost[COUNT // 2 - 1] = True
    given = replace(shown(one, held(apart, lost)), episode=episode)
    (mended,), _, _ = lost_samples(RIG, [given], [])
    assert np.abs(mended["position"] - apart).max() < 0.01


@settings(max_examples=30, deadline=None)
@given(
    st.integers(0, 1000),
    st.sampled_from([0.0, 1e-4, 1e-3, 1e-2]),
    st.sampled_from(["", "float32", "two decimals less", "every second", "two of three", "at rest"]),
)
def test_nothing_is_said_of_a_sensor_that_is_coarse_slow_or_at_rest(seed, noise, form):
    one = record(seed, noise)
    values = one["position"]
    if form == "float32":
        values = values.astype(np.float32).astype(float)
    elif form == "two decimals less":
        values = np.round(values, 3)
    elif form == "every second":
        values = np.repeat(values[::2], 2)
    elif form == "two of three":
        values = held(values, np.arange(COUNT) % 3 == 2)
    elif form == "at rest":
        values = np.where(np.sin(0.5 * one.time) > 0.0, values, values[0])
    assert lost_samples(RIG, [shown(one, values)], [])[2] == ()


@pytest.mark.parametrize(
    ("machine", "seed", "conditions"),
    [
        ("pose_reaching", 1058, Conditions(factor=0.0)),  # turns on the spot
        ("pose_reaching", 1058, Conditions(factor=0.0, closed=True)),  # wheels at their limit
        ("differential_drive", 1042, Conditions(factor=0.0)),
        ("differential_drive", 1012, Conditions(noise="quantised")),  # a coarse heading of many turns
        ("uav_route", 1015, Conditions(factor=0.0)),  # the time since a radar's scan
    ],
)
def test_nothing_is_said_of_what_rests_without_noise_or_takes_few_values(machine, seed, conditions):
    bench = get_bench(machine)
    train, test = recordings(bench, (), conditions, seed)
    assert lost_samples(bench.model, [train], [test])[2] == ()


def test_the_answer_says_what_was_lost_and_what_to_do():
    bench = get_bench("rig")
    train, test = recordings(bench, (), Conditions(), 1000)
    lost = np.random.default_rng(0).uniform(size=len(train)) < 0.05
    lost[0] = False
    found = diagnose(bench.model, [shown(train, held(train["position"], lost))], [test])
    assert found.verdict == "consistent"
    assert found.lost[0] in headline(found)
    assert found.lost[0][1:] in found.summary()
    assert any("sensor" in step for step in what_to_do(found))
    assert found.lost[0] in found.notes
