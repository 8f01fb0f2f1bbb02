"""Ctrl-C and SIGTERM end every command soon, files whole; exit codes are those of the page."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from fieldagents.cli import app
from fieldmodels.yaml import save_yaml

DOCS = Path(__file__).parents[2] / "docs"
RECORD = {"name": "log", "model": "rig", "excitation": {"amplitude": 3}, "duration": 300}
TASKS = ("excitation", "heel_strike", "line_following", "pose_reaching", "uav_route")


def started(words, folder, more=""):
    """The command in a process of its own, once it is at work."""
    code = f"{more}\nfrom fieldagents.cli import main; main()"
    command = [sys.executable, "-c", code, *map(str, words), "--out", str(folder / "out")]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
    for line in process.stderr:
        if line.startswith("Plan:"):
            break
    return process


def stopped(process, number, after=1.0):
    """Processor seconds from a signal to the end (so that load does not count), exit code, what was said."""
    time.sleep(after)
    assert process.poll() is None, process.stderr.read()
    fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    before = sum(map(int, fields[11:13])) / os.sysconf("SC_CLK_TCK")
    process.send_signal(number)
    said = process.stderr.read()
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    return used.ru_utime + used.ru_stime - before, process.returncode, said


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    folder = tmp_path_factory.mktemp("log")
    save_yaml(RECORD, folder / "record.yaml")
    app(["record", f"{folder}/record.yaml", "--out", f"{folder}/out"], standalone_mode=False)
    return folder / "out" / "log.csv"


@pytest.mark.nightly
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_diagnosis_ends_on_request(log, tmp_path, number):
    seconds, code, said = stopped(started(["diagnose", log, "--machine", "rig"], tmp_path), number)
    assert code == 130
    assert "Stopped" in said
    assert "Traceback" not in said
    assert seconds < 2.0
    assert not (tmp_path / "out").exists()


LOOP = """
import time, numba, fieldagents.record.make as room

@numba.njit(nogil=True)
def endless(x):
    while x > 0.0:
        x = x * 1.0000001 if x < 2.0 else 1.0
    return x

endless(-1.0)
room.make_recording = lambda config: endless(1.0)
"""


@pytest.mark.matrix(keep=("15",))
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_compiled_loop_without_end_is_left(tmp_path, number):
    more = LOOP + "from fieldmodels.engine import stopping; stopping.PATIENCE[signal.SIGTERM] = 1.5"
    save_yaml(RECORD, tmp_path / "record.yaml")
    process = started(["record", tmp_path / "record.yaml"], tmp_path, f"import signal{more}")
    seconds, code, said = stopped(process, number)
    assert (code, "Stopped within a long step" in said) == (130, True), said
    assert seconds < 2.5
    assert not (tmp_path / "out").exists()


@pytest.mark.nightly
@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize("command", ["train", "record", "diagnose"])
def test_ctrl_c_ends_every_task_s_commands_within_two_seconds(command, task, tmp_path):
    words = {
        "train": ["train", f"{task}/ppo"],
        "record": ["record", f"{task}/record", "--set", "duration=20000"],
    }
    if command == "diagnose":
        app(["record", f"{task}/record", "--out", str(tmp_path / "log")], standalone_mode=False)
        data = next(p for p in (tmp_path / "log").iterdir() if "reality" not in p.name)
        words["diagnose"] = ["diagnose", data, "--machine", task]
    process = started(words[command], tmp_path)
    try:
        seconds, code, said = stopped(process, signal.SIGINT, 3.0)
    except AssertionError:
        assert process.returncode == 0  # it was done before
        return
    print(f"{command} {task}: {seconds:.2f} s")
    assert (code, "Traceback" in said) == (130, False), said
    assert seconds < 2.0


@pytest.mark.nightly
def test_a_killed_command_leaves_nothing_half_written(log, tmp_path):
    process = started(["diagnose", log, "--machine", "rig"], tmp_path)
    stopped(process, signal.SIGKILL)
    kept = [path.name for path in (tmp_path / "out").rglob("*")]
    assert [name for name in kept if not name.startswith(".")] == []


def test_what_a_library_s_thread_meets_is_a_warning(tmp_path):
    code = """
import errno, threading, fieldagents.catalogue as room
from fieldagents.cli import main

def full():
    raise OSError(errno.ENOSPC, "No space left on device")

def work(*given, **named):
    thread = threading.Thread(target=full)
    thread.start()
    thread.join()
    return {}

room.catalogue = work
room.selected = lambda *_: {}
main()
"""
    done = subprocess.run([sys.executable, "-c", code, "list", "--json"], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "Warning: writing: No space left on device\n")


@pytest.mark.nightly
def test_exit_codes_are_those_of_the_page(log, tmp_path):
    page = (DOCS / "cli.md").read_text()
    table = dict(re.findall(r"^- \*\*(\d+)\*\*: (.+)$", page, re.MULTILINE))
    assert set(table) == {"0", "1", "2", "130"}
    missing = "import fieldagents.record.make as m; m.make_recording = lambda config: 1 / 0"
    save_yaml(RECORD, tmp_path / "record.yaml")
    seen = {
        "0": ["list"],
        "1": ["record", tmp_path / "record.yaml", "--out", tmp_path / "out"],
        "2": ["record", tmp_path / "record.yaml", "--set", "step=-1"],
    }
    for code, words in seen.items():
        command = [sys.executable, "-c", f"{missing}\nfrom fieldagents.cli import main; main()"]
        done = subprocess.run([*command, *map(str, words)], capture_output=True, check=False, env=os.environ)
        assert done.returncode == int(code), done.stderr
