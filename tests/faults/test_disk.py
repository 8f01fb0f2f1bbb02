"""Nothing is lost: whichever write, fsync or rename fails, files are whole or absent; a second run mends all.

The disk fails below the program (``disk.c``, preloaded), so no line of the program is left out.
"""

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from fieldagents.learned.checkpoint import CheckpointError, checkpoints, latest_checkpoint, save_checkpoint
from fieldmodels.files import OutputError, claimed, write_text
from fieldmodels.yaml import save_yaml

HERE = Path(__file__).parent
COMPILER = shutil.which("cc")
RECORD = {
    "name": "log", "model": "rig", "reality": {"coulomb_friction": {"force": 0.5}}, "duration": 6,
    "excitation": {"amplitude": 3},
}  # fmt: skip
EVALUATE = {
    "name": "two", "task": "heel_strike", "environments": {"usual": {"settings": {"strides": 5}}},
    "agents": ["adaptive", "ranger"], "baseline": "ranger", "episodes": 3,
}  # fmt: skip
TRAIN = {
    "name": "tiny", "task": "heel_strike", "algorithm": "ppo", "seed": 1, "steps": 192, "num_envs": 4,
    "checkpoint_every": 1, "environment": {"settings": {"strides": 5}}, "network": {"hidden": [4]},
    "learner": {"n_steps": 16, "batch_size": 32, "n_epochs": 1}, "validation": {"every": 2, "episodes": 2},
}  # fmt: skip
SWEEP = {"name": "grid", "grid": {"seed": [1]}}
EVERY = {"record": 1, "diagnose": 9, "evaluate": 9, "train": 23, "exam": 6, "sweep": 29}
"""Of how many places one fails; the others are of the same kinds."""
KILL = -signal.SIGKILL
SENTENCE = {errno.ENOSPC: "No space left on device", errno.EIO: "Input/output error"}


def commands(folder):
    sweep = SWEEP | {"train": [f"{folder}/train.yaml"]}
    for name, config in (("record", RECORD), ("evaluate", EVALUATE), ("train", TRAIN), ("sweep", sweep)):
        save_yaml(config, folder / f"{name}.yaml")
    return {
        "record": ["record", f"{folder}/record.yaml", "--out", "{out}"],
        "diagnose": ["diagnose", f"{folder}/log/log.csv", "--model", "rig", "--out", "{out}", "--json"],
        "evaluate": ["evaluate", f"{folder}/evaluate.yaml", "--out", "{out}", "--json"],
        "train": ["train", f"{folder}/train.yaml", "--out", "{out}", "--json"],
        "sweep": ["sweep", f"{folder}/sweep.yaml", "--out", "{out}", "--workers", "0", "--json"],
        "exam": [
            "exam", "--set", "develop", "--machine", "rig", "--kind", "nothing", "--cases", "1",
            "--workers", "0", "--out", "{out}", "--json",
        ],
    }  # fmt: skip


def run_on_failing_disk(folder, name, error, every):
    """A line for the clean run, and one for each place of failure."""
    library = folder / "disk.so"
    subprocess.run([COMPILER, "-shared", "-fPIC", "-O1", "-o", library, HERE / "disk.c", "-ldl"], check=True)
    words = commands(folder)
    if name == "diagnose":
        from fieldagents.cli import app

        app(["record", f"{folder}/record.yaml", "--out", f"{folder}/log"], standalone_mode=False)
    command = [sys.executable, HERE / "disk.py", folder, str(error), str(every), *words[name]]
    environment = {**os.environ, "LD_PRELOAD": str(library), "OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    return [json.loads(line) for line in done.stdout.splitlines()]


def check(lines, error):
    clean, *rest = lines
    assert clean["code"] == 0, clean["said"]
    assert clean["operations"] >= 4  # a write and a rename of two files at least
    assert rest
    whole = clean["files"]
    for line in rest:
        first, second = line["first"], line["second"]
        assert "Traceback" not in first["said"], first["said"]
        if error < 0:
            assert first["code"] == error
        elif first["code"] != 0:
            assert first["code"] in (1, 2), first["said"]  # 1: of a job
            assert SENTENCE[error] in first["said"]
        for name, digest in first["files"].items():
            part = (
                "checkpoints" in name or "curve.csv" in name or name.endswith(".jsonl")
            )  # of an earlier step
            left = ".part" in name or Path(name).name in (".lock", "error.txt")
            assert part or left or digest == whole.get(name), (line["at"], name)
        assert second["code"] == 0, second["said"]
        assert second["files"] == whole, line["at"]


needs_compiler = pytest.mark.skipif(COMPILER is None, reason="needs a C compiler")


@needs_compiler
def test_a_recording_survives_every_failure_of_the_disk(tmp_path):
    check(run_on_failing_disk(tmp_path, "record", errno.ENOSPC, 1), errno.ENOSPC)


@pytest.mark.slow
@needs_compiler
@pytest.mark.parametrize("error", [*SENTENCE, KILL])
@pytest.mark.parametrize("name", EVERY)
def test_every_command_survives_every_failure_of_the_disk(tmp_path, name, error):
    lines = run_on_failing_disk(tmp_path, name, error, EVERY[name])
    print(f"{name}: {len(lines) - 1} of {lines[0]['operations']} places")
    check(lines, error)


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


@pytest.mark.parametrize("place", ["/dev/null", "/proc/nothing", "/dev/full/x"])
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


def test_a_kill_within_the_first_checkpoint_leaves_none(tmp_path):
    (tmp_path / ".000000000016.pt.abc.part.pt").write_bytes(b"half")
    assert latest_checkpoint(tmp_path, print) is None
