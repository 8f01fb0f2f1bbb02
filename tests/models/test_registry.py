"""Machines are found where they live, and asking for their names imports none of them."""

import subprocess
import sys

import pytest

from fieldmodels.model import ModelError
from fieldmodels.registry import get_model, model_names


@pytest.mark.every("name", model_names())
def test_a_model_goes_by_the_name_of_its_file_or_folder(name):
    assert get_model(name).name == name


def test_the_tasks_machines_and_the_benches_are_there():
    assert set(model_names()) >= {"rig", "pendulum", "propeller_arm", "servo", "heel_strike", "uav_route"}


def test_asking_for_one_imports_no_other():
    code = (
        "import sys; from fieldmodels.registry import get_model, model_names; model_names();"
        "assert 'numba' not in sys.modules; get_model('rig');"
        "print([m for m in sys.modules if m.startswith('fieldmodels.machines.') and m.endswith('.model')])"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert told.strip() == "['fieldmodels.machines.one_axis.model']"


def test_a_misspelt_name_is_guessed():
    with pytest.raises(ModelError, match="did you mean 'pendulum'"):
        get_model("pendulm")
