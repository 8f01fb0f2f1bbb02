"""What is read from files gives an answer or a clear message, whatever a fuzzer makes of the files."""

import sys
from pathlib import Path

import pytest

from fieldmodels.model import ModelError
from fieldmodels.reality import read_reality
from fieldmodels.registry import get_model

sys.path.insert(0, str(Path(__file__).parent))

import fuzz

PLANTED = """
def door(path):
    data = path.read_bytes()
    if data[:1] == b"{":
        if data[1:2] == b"&":
            if data[2:3] == b"a":
                if data[3:4] == b"}":
                    raise KeyError("deep")
"""


@pytest.mark.every("name", fuzz.DOORS)
def test_a_sample_of_fuzzed_files_gets_through_no_door(name):
    counts, _, faults = fuzz.through(name, 60, 7)  # blind, so that it is the same whatever ran before
    assert faults == {}
    assert counts["answered"] >= 1  # of the file that is right
    assert counts["refused"] >= 10


def test_what_is_behind_several_conditions_is_found_by_its_ways_alone(tmp_path):
    place = tmp_path / "planted.py"
    place.write_text(PLANTED)
    names = {}
    exec(compile(PLANTED, str(place), "exec"), names)
    given = names["door"], (b"{", b"&", b"a", b"}"), [(".txt", b"xxxx")], 3000, 0
    assert any("KeyError" in what for what in fuzz.fuzzed(*given, fuzz.Traced(tmp_path))[2])
    assert fuzz.fuzzed(*given)[2] == {}  # blind


@pytest.mark.every("key", ["99", "null", "1.5", "true"])
def test_a_name_in_a_reality_that_is_no_text_is_refused(tmp_path, key):
    path = tmp_path / "extended.yaml"
    for text in (f"coulomb_friction: {{{key}: 1.0}}", f"{key}: {{force: 1.0}}"):
        path.write_text(f"schema: 1\nmodel: rig\neffects: {{{text}}}\n")
        with pytest.raises(ModelError, match="is no name; a reality has names"):
            read_reality(path, get_model("rig"))
