"""The notebooks of the docs run, and show what their text says."""

import importlib.util
from pathlib import Path

import pytest

PLACE = Path(__file__).parents[2] / "docs" / "notebooks.py"
SPEC = importlib.util.spec_from_file_location("notebooks", PLACE)
notebooks = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(notebooks)

SHOWN = {
    "my_first_log": ("torque = -Sollmoment [Nm]", "named", "Coulomb friction", "angle_predicted"),
    "my_own_simulator": ("named", "actuator dead zone"),
    "train_and_compare": ("policy.onnx", "feedback", "still"),
    "hide_and_find": ("named", "actuator delay", "% of the loss recovered"),
    "a_papers_figure": ("heel_strike: ", "decay", "Figure"),
}


@pytest.mark.matrix(keep=("a_papers_figure",))
@pytest.mark.parametrize("path", notebooks.PATHS, ids=lambda path: path.stem)
def test_a_notebook_runs_and_shows_what_it_says(path, tmp_path):
    fresh = notebooks.shown(notebooks.executed(path, tmp_path))
    kept = notebooks.shown(notebooks.nbformat.read(path, as_version=4))
    for text in (fresh, kept):
        missing = [said for said in SHOWN[path.stem] if said not in text]
        assert not missing, text
    assert (PLACE.parent / "pictures" / f"{path.stem}-1.png").stat().st_size > 5000
    assert not (path.parent / "bench.yaml").exists()  # it has written into its own folder
