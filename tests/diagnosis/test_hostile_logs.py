"""Benches and logs that nobody has foreseen: the right answer, or one clear message; never a wrong name."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from scipy.signal import cont2discrete

from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis import diagnose
from fieldmodels.recording import Recording, RecordingError, RecordingWarning
from fieldmodels.recording.files import load_recording, save_recording
from fieldmodels.registry import get_model

RIG = get_model("rig")


def bench(mass: float, period: float, step: float, count: int, seed: int, delay: int = 0) -> Recording:
    """A mass on a spring by its exact discrete response (no integrator at all), damped by a tenth.

    It is driven by a random binary force; with ``delay`` by the force of so many steps ago.
    """
    rng = np.random.default_rng(seed)
    stiffness = mass * (2 * np.pi / period) ** 2
    damping = 0.2 * np.sqrt(mass * stiffness)
    system = (
        np.array([[0.0, 1.0], [-stiffness / mass, -damping / mass]]),
        np.array([[0.0], [1 / mass]]),
        np.eye(2),
        np.zeros((2, 1)),
    )
    a, b = cont2discrete(system, step)[:2]
    hold = max(round(0.3 * period / step), 1)
    force = 0.1 * stiffness * rng.choice([-1.0, 1.0], count // hold + 1).repeat(hold)[:count]
    delayed = np.r_[np.full(delay, force[0]), force[: count - delay]]
    state, rows = np.zeros(2), []
    for u in delayed:
        rows.append(state)
        state = a @ state + b[:, 0] * u
    position = np.array(rows)[:, 0]
    noisy = position + 0.003 * position.std() * rng.standard_normal(count)
    return Recording(step * np.arange(count), {"force": force, "position": noisy}, source=f"bench {seed}")


SCALES = {
    "a gram at 10 kHz": (1e-3, 0.005, 1e-4),
    "a gram at 1 kHz": (1e-3, 0.05, 1e-3),
    "a table-top bench": (2.0, 1.0, 0.01),
    "a tonne at 5 Hz": (1e3, 20.0, 0.2),
    "a ship's mass at 1 Hz": (1e6, 90.0, 1.0),
}


QUICK = ("a gram at 1 kHz", "a tonne at 5 Hz")


@pytest.mark.matrix(keep=("a tonne at 5 Hz",))
@pytest.mark.parametrize(
    "size", [size if size in QUICK else pytest.param(size, marks=pytest.mark.nightly) for size in SCALES]
)
def test_a_bench_of_any_size_and_pace_has_its_delay_named_and_its_mass_weighed(size, tmp_path):
    mass, period, step = SCALES[size]
    for seed in (1, 2):
        save_recording(
            bench(mass, period, step, 4000, seed, delay=3 if step < 0.5 else 1), tmp_path / f"{seed}.csv"
        )
    clock = {"t": "t:s"}  # else a slow one is suspected to count milliseconds
    train, test = (load_recording(tmp_path / f"{seed}.csv", RIG, clock) for seed in (1, 2))
    found = diagnose(RIG, [train], [test])
    assert {found.causes[0].effect, *found.causes[0].alternatives} & {"actuator_delay", "sensor_delay"}
    assert len(found.causes) == 1
    assert found.parameters["mass"].value == pytest.approx(mass, rel=0.03)
    assert found.unknown is None


@pytest.mark.nightly
@pytest.mark.parametrize(
    "size", ["a tonne at 5 Hz", pytest.param("a gram at 10 kHz", marks=pytest.mark.nightly)]
)
def test_nothing_is_named_on_a_bench_of_any_pace_that_hides_nothing(size):
    mass, period, step = SCALES[size]
    found = diagnose(RIG, [bench(mass, period, step, 4000, 3)], [bench(mass, period, step, 4000, 4)])
    assert found.verdict == "consistent"


@pytest.mark.nightly
def test_a_command_that_never_changes_names_nothing():
    rng = np.random.default_rng(0)
    count = 3000
    still = {"force": np.full(count, 2.0), "position": 0.025 + 2e-4 * rng.standard_normal(count)}
    found = diagnose(RIG, [Recording(0.01 * np.arange(count), still)])
    assert found.causes == ()


def test_a_sensor_that_saturates_is_pointed_out(tmp_path):
    record = bench(2.0, 1.0, 0.01, 2000, 5)
    limit = 0.6 * float(np.abs(record["position"]).max())
    cut = Recording(record.time, {**record.signals, "position": np.clip(record["position"], -limit, limit)})
    save_recording(cut, tmp_path / "log.csv")
    with pytest.warns(RecordingWarning, match=r"'position' stays at its extreme values for up to \d+ rows"):
        load_recording(tmp_path / "log.csv", RIG)
    # An encoder that rests, and one that is coarse, are none.
    coarse = Recording(record.time, {**record.signals, "position": np.round(record["position"], 2)})
    save_recording(coarse, tmp_path / "log.csv")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load_recording(tmp_path / "log.csv", RIG)


def rows(values: FloatArray) -> str:
    return "\n".join(f"{0.01 * i:.2f},{u:.3f},{x:.5f}" for i, (u, x) in enumerate(values)) + "\n"


GOOD = rows(np.random.default_rng(0).standard_normal((400, 2)))
FILES = {
    "stamps": (
        "t,force,position\n" + GOOD.replace("0.05,", "2026-11-21T10:00:05,", 1),
        "column 't', row 7: '2026-11-21T10:00:05' is not a number",
    ),
    "clock times": (
        "t,force,position\n" + GOOD.replace("0.05,", "10:00:05,", 1),
        "column 't', row 7: '10:00:05' is not a number",
    ),
    "NaN": ("t,force,position\n" + GOOD + "nan,0,0\n", "'t', row 402: the cell is empty or NaN"),
    "very short": (
        "t,force,position\n" + rows(np.random.default_rng(0).standard_normal((12, 2))),
        "shorter than",
    ),
    "one row": ("t,force,position\n0,1,2\n", "one data row"),
}


@pytest.mark.parametrize("content", FILES)
def test_a_file_that_cannot_be_read_says_why(tmp_path, content):
    text, message = FILES[content]
    (tmp_path / "log.csv").write_text(text)
    with pytest.raises(RecordingError, match=message):
        load_recording(tmp_path / "log.csv", RIG)


def test_a_byte_order_mark_and_foreign_line_ends_do_no_harm(tmp_path):
    text = "\ufefft,force,position\n" + GOOD
    (tmp_path / "log.csv").write_bytes(text.replace("\n", "\r\n").encode())
    assert len(load_recording(tmp_path / "log.csv", RIG)) == 400
