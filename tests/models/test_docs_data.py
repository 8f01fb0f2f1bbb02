"""The pages on measured data: their programs run, and their messages are the program's."""

import re
from pathlib import Path

import pytest

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
            assert f"`{signal.name}` [{signal.unit}]" in row


def test_the_data_pages_declarations_and_message_are_real(tmp_path, monkeypatch):
    text = (DOCS / "data.md").read_text()
    monkeypatch.chdir(tmp_path)
    Path("log.csv").write_text("stamp,pos,tau\n" + "".join(f"{i},{i % 9},{i % 5}\n" for i in range(400)))
    scope: dict = {}
    exec("\n".join(blocks("data.md", "python")), scope)
    assert scope["recording"].step == pytest.approx(1e-3)
    assert load_recording("log.parquet").units["angle"] == "rad"

    shown = next(block for block in blocks("data.md", "") if "2 problems" in block)
    rows = [f'{i / 100},"0,5",1' if i == 3 else f"{i / 100},1,{'' if i == 7 else 1}" for i in range(99)]
    Path("log.csv").write_text("\n".join(["t,torque,angle", *rows]))
    with pytest.raises(RecordingError) as caught:
        load_recording("log.csv", get_model("pendulum"))
    assert str(caught.value) == shown.strip()
    for name in dataset_names():
        assert name in text or f"`{name.split('/')[1]}`" in text


def test_the_data_page_lists_every_unit():
    table = (DOCS / "data.md").read_text().split("| quantity | units |")[1].split("\n\n")[0]
    listed = {word.strip() for word in re.split(r"[,;|()]", table)}
    assert set(known_units()) <= listed
