"""Nothing is lost: whichever write, fsync or rename fails, files are whole or absent; a second run mends all.

The disk fails below the program (``disk.c``, preloaded), so no line of the program is left out.
"""

import errno
import json
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from fieldagents.cli import app
from fieldagents.learned.checkpoint import CheckpointError, checkpoints, latest_checkpoint, save_checkpoint
from fieldmodels.files import OutputError, claimed, write_text

sys.path.insert(0, str(Path(__file__).parent))

import matrix

needs_compiler = pytest.mark.skipif(matrix.COMPILER is None, reason="needs a C compiler")


@pytest.mark.nightly
@needs_compiler
def test_a_recording_survives_every_failure_of_the_disk():
    found = matrix.examined("record", errno.ENOSPC, 10**6)  # more than there are: all
    assert found["tried"] == found["places"] >= 4  # a write and a rename of two files at least
    assert found["faults"] == []


@pytest.mark.nightly  # all places: `python tests/faults/matrix.py`
@needs_compiler
@pytest.mark.parametrize("failure", matrix.FAILURES)
@pytest.mark.parametrize("name", matrix.COMMANDS)
def test_every_command_survives_failures_of_the_disk(name, failure):
    assert matrix.examined(name, matrix.FAILURES[failure], 5)["faults"] == []


def test_the_page_has_what_the_matrix_found():
    kept = json.loads(matrix.KEPT.read_text())
    assert {"record", "evaluate", "train"} <= set(kept)
    page = matrix.PAGE.read_text()
    for name, row in kept.items():
        found = [row.get(failure) for failure in matrix.FAILURES]
        counts = {f"{one['tried']} of {one['places']}" if one else "not run" for one in found}
        assert f"| {name} | {'; '.join(sorted(counts))} |" in page


WHOLE = {"a": "1", "b": "2"}
LINES = {
    "torn": (
        {"code": 2, "said": "No space left on device", "files": {"a": "3"}},
        {"code": 0, "files": WHOLE},
    ),
    "traceback": (
        {"code": 1, "said": "Traceback\nOSError: No space left on device", "files": {}},
        {"code": 0, "files": WHOLE},
    ),
    "does not say": ({"code": 2, "said": "Error: no", "files": {}}, {"code": 0, "files": WHOLE}),
    "second run differs in b": (
        {"code": 0, "said": "", "files": {}},
        {"code": 0, "files": {"a": "1", "b": "3"}},
    ),
    "second run ends": ({"code": 0, "said": "", "files": {}}, {"code": 2, "said": "", "files": {}}),
}


@pytest.mark.every("what", LINES)
def test_the_matrix_sees_what_is_wrong(what):
    first, second = LINES[what]
    (found,) = matrix.wrong({"first": first, "second": second}, WHOLE, errno.ENOSPC)
    assert what in found
    good = {"code": 2, "said": "No space left on device", "files": {"a": "1", ".b.part": "0"}}
    assert matrix.wrong({"first": good, "second": {"code": 0, "files": WHOLE}}, WHOLE, errno.ENOSPC) == []


@pytest.mark.every("name", matrix.COMMANDS)
def test_the_second_of_two_writers_is_told(tmp_path, name):
    words = [*matrix.prepared(tmp_path, name), "--out", str(tmp_path / "out")]
    with claimed(tmp_path / "out"):
        told = CliRunner().invoke(app, words)
    assert (told.exit_code, "another process is writing here" in told.output) == (2, True), told.output


def test_a_folder_has_one_writer(tmp_path):
    other = (
        "import sys; from pathlib import Path; from fieldmodels.files import OutputError, claimed\n"
        "try:\n"
        "    with claimed(Path(sys.argv[1])): print('held')\n"
        "except OutputError as error: print(error)"
    )

    def second():
        command = [sys.executable, "-c", other, tmp_path / "out"]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout

    with claimed(tmp_path / "out"):
        assert "another process is writing here" in second()
    assert second() == "held\n"
    assert not (tmp_path / "out").exists()  # nothing was written


def test_what_a_killed_writer_left_is_removed(tmp_path):
    (tmp_path / ".curve.csv.abc.part.csv").write_text("half")
    (tmp_path / "checkpoints").mkdir()
    (tmp_path / "checkpoints" / ".16.pt.abc.part.pt").write_text("half")
    with claimed(tmp_path):
        write_text(tmp_path / "a.txt", "whole")
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == ["a.txt"]


@pytest.mark.every("place", ["/dev/null", "/proc/nothing", "/dev/full/x"])
def test_a_place_that_cannot_be_written_is_refused_before_the_work(place):
    with pytest.raises(OutputError, match=place), claimed(Path(place)):
        raise AssertionError("work began")


def test_an_earlier_checkpoint_serves_where_the_newest_is_damaged(tmp_path):
    for steps in (16, 32):
        save_checkpoint({"steps": steps}, tmp_path / f"{steps:012d}.pt")
    (tmp_path / ".000000000048.pt.abc.part.pt").write_bytes(b"half")  # a kill while it was written
    assert [path.stem for path in checkpoints(tmp_path)] == ["000000000016", "000000000032"]
    newest = tmp_path / "000000000032.pt"
    newest.write_bytes(newest.read_bytes()[:100])
    said = []
    assert latest_checkpoint(tmp_path, said.append)["steps"] == 16
    assert "000000000032.pt" in said[0]
    (tmp_path / "000000000016.pt").write_bytes(b"")
    with pytest.raises(CheckpointError, match="000000000016"):
        latest_checkpoint(tmp_path, said.append)


def test_equal_states_are_equal_files(tmp_path):
    words = ["a b", "".join(["a", " b"])]
    assert words[0] is not words[1]
    for name, keys in (("1.pt", words), ("2.pt", words[:1] * 2)):
        save_checkpoint({"steps": 1, "names": keys}, tmp_path / name)
    assert (tmp_path / "1.pt").read_bytes() == (tmp_path / "2.pt").read_bytes()


def test_a_kill_within_the_first_checkpoint_leaves_none(tmp_path):
    (tmp_path / ".000000000016.pt.abc.part.pt").write_bytes(b"half")
    assert latest_checkpoint(tmp_path, print) is None
