"""It runs wherever it is put: nothing but the result folder must be writable, and no terminal is needed."""

import os
import pty
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from fieldmodels.yaml import save_yaml

ROOT = Path(__file__).parents[2]
PACKAGES = {name: ROOT / room / name for name, room in
            (("fieldmodels", "src"), ("fieldgym", "envs"), ("fieldagents", "agents"))}  # fmt: skip
RECORD = {"name": "log", "model": "rig", "excitation": {"amplitude": 3}, "duration": 4}


def command(folder, *words, before=(), **environment):
    """A command as a newcomer would run it, in a folder of its own; what became of it."""
    code = "from fieldagents.cli import main; main()"
    usual = {k: v for k, v in os.environ.items() if k not in ("HOME", "XDG_CACHE_HOME", "NUMBA_CACHE_DIR")}
    given = {**usual, "TMPDIR": str(folder), **environment}
    return subprocess.run(
        [*before, sys.executable, "-c", code, *map(str, words)],
        cwd=folder, env={k: v for k, v in given.items() if v}, capture_output=True, check=False,
    )  # fmt: skip


def recorded(folder, where="out", **more):
    save_yaml(RECORD, folder / "record.yaml")
    done = command(folder, "record", folder / "record.yaml", "--out", folder / where, **more)
    assert done.returncode == 0, done.stderr.decode()
    assert (folder / where / "log.csv").stat().st_size > 1000
    return done


NOWHERE = "/proc/nowhere"
HOMES = {
    "none": {},
    "one that cannot be written": {"HOME": NOWHERE},
    "a file": {"HOME": "/dev/null"},
    "no place for kernels at all": {"HOME": NOWHERE, "TMPDIR": NOWHERE, "NUMBA_CACHE_DIR": NOWHERE},
}


@pytest.mark.matrix(keep=("one that cannot be written",))
@pytest.mark.parametrize("home", HOMES)
def test_without_a_home_of_one_s_own(tmp_path, home):
    done = command(tmp_path, "list", "rig", **HOMES[home])
    assert done.returncode == 0, done.stderr.decode()


@pytest.mark.nightly  # compiles
@pytest.mark.parametrize("home", HOMES)
def test_a_recording_without_a_home_of_one_s_own(tmp_path, home):
    recorded(tmp_path, **HOMES[home])


def test_a_path_with_spaces_and_umlauts(tmp_path):
    folder = tmp_path / "Prüfstand Nr. 3, Ölbad"
    folder.mkdir()
    recorded(
        folder,
        "Läufe von heute",
        XDG_CACHE_HOME=os.environ.get("XDG_CACHE_HOME", str(Path.home() / ".cache")),
    )


@pytest.mark.matrix(
    keep=(
        "words0",
        "words1",
    )
)
@pytest.mark.parametrize("words", [("list",), ("diagnose", "--help"), ("record", "ü.yaml")])
def test_a_terminal_that_knows_ascii_alone(tmp_path, words):
    done = command(tmp_path, *words, LANG="C", LC_ALL="C", PYTHONIOENCODING="ascii", PYTHONUTF8="0")
    assert done.returncode == (2 if "record" in words else 0)
    assert b"Traceback" not in done.stderr
    (done.stdout + done.stderr).decode("ascii")


def test_in_a_terminal_and_without_one(tmp_path):
    save_yaml(RECORD, tmp_path / "record.yaml")
    ours, theirs = pty.openpty()
    code = "from fieldagents.cli import main; main()"
    process = subprocess.Popen(
        [sys.executable, "-c", code, "evaluate", "--help"], stdin=theirs, stdout=theirs, stderr=theirs
    )
    os.close(theirs)
    said = b""
    while part := _read(ours):
        said += part
    assert process.wait() == 0
    assert b"Compare" in said
    closed = command(tmp_path, "list", "rig", before=["sh", "-c", '"$@" <&-', "sh"])
    assert closed.returncode == 0, closed.stderr.decode()


def _read(end):
    try:
        return os.read(end, 4096)
    except OSError:  # Linux's word for a terminal's end
        return b""


@pytest.mark.nightly  # compiles
@pytest.mark.skipif(os.geteuid() != 0 or not shutil.which("setpriv"), reason="needs root, to be another")
def test_another_user_with_an_installation_that_can_only_be_read(tmp_path):
    tree = Path("/tmp") / f"fieldgym-{os.getpid()} read only"
    work = Path("/tmp") / f"fieldgym-{os.getpid()}-work"
    try:
        for name, source in PACKAGES.items():
            shutil.copytree(source, tree / name, ignore=shutil.ignore_patterns("__pycache__", "zoo"))
        subprocess.run(["chmod", "-R", "a-w,a+rX", tree], check=True)
        work.mkdir()
        save_yaml(RECORD, work / "record.yaml")
        shutil.chown(work, 65534, 65534)
        before = ["setpriv", "--reuid=65534", "--regid=65534", "--clear-groups"]
        done = command(
            work, "record", work / "record.yaml", "--out", work / "out", before=before,
            PYTHONPATH=str(tree), HOME="/nonexistent", PYTHONDONTWRITEBYTECODE="",
        )  # fmt: skip
        assert done.returncode == 0, done.stderr.decode()
        assert (work / "out" / "log.csv").stat().st_uid == 65534
        refused = command(
            work, "record", work / "record.yaml", "--out", "/root/out", before=before, PYTHONPATH=str(tree)
        )
        assert refused.returncode == 2
        assert b"cannot be written" in refused.stderr
    finally:
        shutil.rmtree(work, ignore_errors=True)
        subprocess.run(["chmod", "-R", "u+w", tree], check=False)
        shutil.rmtree(tree, ignore_errors=True)


def test_the_containerfile_installs_what_is_pinned_and_runs_as_nobody_special():
    text = (ROOT / "Containerfile").read_text()
    lines = re.sub(r"\\\n", " ", text).splitlines()
    steps = [line.split(maxsplit=1) for line in lines if line and not line.startswith("#")]
    known = {"FROM", "WORKDIR", "COPY", "RUN", "USER", "ENV", "HEALTHCHECK", "ENTRYPOINT", "CMD"}
    assert {name for name, _ in steps} <= known
    assert all(re.search(r":\d+\.\d+", rest) for name, rest in steps if name == "FROM")
    last = [name for name, _ in steps[max(i for i, (name, _) in enumerate(steps) if name == "FROM") :]]
    assert last.index("USER") < last.index("ENTRYPOINT")
    assert "--constraint constraints.txt" in text
    ignored = (ROOT / ".containerignore").read_text().splitlines()
    assert ignored[0] == "*"
    for line in ignored[1:]:
        assert (ROOT / line.removeprefix("!")).exists(), line
    # what the build reads of the tree is let in
    build = (ROOT / "pyproject.toml").read_text()
    for name in ("src", "envs", "agents", "configs", "sbom.cdx.json", "README.md", "LICENSE"):
        assert name in build
        assert f"!{name}" in ignored
