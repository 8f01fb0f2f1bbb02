"""The pages on measured data: their programs run, and their messages are the program's."""

import re
import warnings
from pathlib import Path

import numpy as np
import pytest

from fieldmodels.machine import Machine, number
from fieldmodels.model import Signal
from fieldmodels.recording import RecordingError
from fieldmodels.recording.datasets import dataset_names
from fieldmodels.recording.files import load_recording
from fieldmodels.recording.units import known_units
from fieldmodels.registry import get_model, model_names

DOCS = Path(__file__).parents[2] / "docs"


def blocks(page: str, language: str) -> list[str]:
    inside = (DOCS / page).read_text().split("```")[1::2]
    return [text.removeprefix(f"{language}\n") for text in inside if text.startswith(f"{language}\n")]


def test_the_page_on_a_bench_of_ones_own_has_the_models_signals():
    text = (DOCS / "bring_your_own_bench.md").read_text()
    for name in ("rig", "pendulum", "pose_reaching", "differential_drive"):
        assert name in model_names()
        (row,) = [line for line in text.splitlines() if line.startswith(f"| `{name}`")]
        model = get_model(name)
        for signal in (*model.inputs, *model.outputs):
            assert re.search(rf"`{signal.name}`(, `\w+`)* \[{re.escape(signal.unit)}\]", row)


def test_the_data_pages_declarations_are_real(tmp_path, monkeypatch):
    text = (DOCS / "data.md").read_text()
    monkeypatch.chdir(tmp_path)
    Path("log.csv").write_text("stamp,pos,tau\n" + "".join(f"{i},{i % 9},{i % 5}\n" for i in range(400)))
    scope: dict = {}
    (saved,) = re.findall(r"`(fg\.save\(.+?\))`", text)
    exec("\n".join([*blocks("data.md", "python"), saved]), scope)
    assert scope["recording"].step == pytest.approx(1e-3)
    assert load_recording("log.parquet").units["angle"] == "rad"
    for name in dataset_names():
        assert name in text or f"`{name.split('/')[1]}`" in text


def test_all_problems_are_named_at_once_with_place_and_remedy(tmp_path):
    rows = [f'{i / 100},"0,5",1' if i == 3 else f"{i / 100},1,{'' if i == 7 else 1}" for i in range(99)]
    (tmp_path / "log.csv").write_text("\n".join(["t,torque,angle", *rows]))
    with pytest.raises(RecordingError) as caught:
        load_recording(tmp_path / "log.csv", get_model("pendulum"))
    assert str(caught.value).splitlines()[1:] == [
        "  - column 'torque', row 5: '0,5' has a decimal comma; write 0.5",
        "  - column 'angle', row 9: the cell is empty or NaN; leave such rows out (gaps of up to four are "
        "then filled, longer ones begin a new episode), or fill them",
    ]


def test_the_data_page_unwraps_counters_and_reads_temperatures(tmp_path):
    """The angle goes round three times; a twelfth of a turn is 30 deg and 341 counts, 20 °C are 293.15 K."""

    class Oven(Machine):
        inputs = (Signal("heater", "W"),)
        states = outputs = (Signal("temperature", "K"),)
        loss = number("1/s", 1.0, 0.0, 10.0)

        def derivative(self, state, input, p):
            return input.heater - p.loss * state.temperature

    turns = np.arange(300) / 100
    read = {"heading": 360 * turns % 360, "encoder": np.round(4096 * turns) % 4096, "thermometer": 20 + turns}
    lines = [",".join(["t,torque,heater", *read])] + [
        ",".join(f"{cell:g}" for cell in (t, np.cos(t), np.cos(t), *row))
        for t, row in zip(turns, zip(*read.values(), strict=True), strict=True)
    ]
    (tmp_path / "log.csv").write_text("\n".join(lines))
    section = (DOCS / "data.md").read_text().split("### Counters")[1].split("## What is checked")[0]
    commands = [line for line in section.splitlines() if line.startswith("fieldgym diagnose")]
    found = {}
    for line in commands:
        model = Oven() if "oven.py" in line else get_model(line.split("--machine ")[1].split()[0])
        signal, spec = line.split("--column ")[1].split("=")
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            found[spec] = load_recording(tmp_path / "log.csv", model, {signal: spec})[signal]
    degrees, counts, kelvins = found.values()
    np.testing.assert_allclose(degrees, 2 * np.pi * turns, atol=1e-4)
    np.testing.assert_allclose(counts, 2 * np.pi * turns, atol=2e-3)
    np.testing.assert_allclose(kelvins, 293.15 + turns, atol=1e-4)


def test_the_data_page_lists_every_unit():
    units = (DOCS / "data.md").read_text().split("Known units:\n\n- ")[1].split("\n\n")[0]
    listed = {word.strip() for word in re.split(r"[,;()]|\n- ", units)}
    assert set(known_units()) <= listed
