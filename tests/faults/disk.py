"""Run a command again and again on a disk whose n-th operation fails; a line of JSON for each run.

``python disk.py FOLDER ERRNO PLACES COMMAND...``, with ``disk.c`` preloaded; a word may hold ``{out}``. A
negative ERRNO is a signal that kills there. So many places fail, spread evenly over all. Each run is a fork
of this process, so that imports and compiled kernels are paid once.
"""

import contextlib
import ctypes
import hashlib
import io
import json
import os
import sys
import traceback
from pathlib import Path

from matplotlib.figure import Figure

VOLATILE = (
    "policy.zip",  # what Stable-Baselines3 pickles holds times and generators
    "vecnormalize.pkl",
    "run.json",
    "result.json",
    "runs.csv",
    "summary.json",
    "report.html",
    "diagnosis.json",
    "cases.jsonl",
    "exam.json",
    "exam.md",
)
"""Files that hold a clock's time: compared by being there."""


def main(base: Path, error: int, places: int, words: list[str]) -> None:
    Figure.draw = lambda *_: None  # what pictures show is no matter here, and takes most of the time
    # Imports and compiled kernels, before the forks.
    _told([word.format(out=base / "warm") for word in words])
    clean, operations = _run(base / "clean", words, 0, 0)
    print(json.dumps({"at": 0, "operations": operations, **clean}), flush=True)
    tried = min(places, operations)
    for at in (1 + k * operations // tried for k in range(tried)):
        out = base / f"at{at}"
        first, _ = _run(out, words, at, error)
        second, _ = _run(out, _resumed(words, out), 0, 0)
        print(json.dumps({"at": at, "first": first, "second": second}), flush=True)


def _resumed(words: list[str], out: Path) -> list[str]:
    return [*words, "--resume", str(out)] if words[0] == "train" and (out / "config.yaml").exists() else words


def _told(words: list[str]) -> tuple[object, str]:
    """The exit code of a command, and what it says."""
    lines = io.StringIO()
    with contextlib.redirect_stdout(lines), contextlib.redirect_stderr(lines):
        try:
            from fieldagents.cli import app

            app(words, standalone_mode=True)
        except SystemExit as end:
            return end.code or 0, lines.getvalue()
        except BaseException:
            traceback.print_exc()
            return 1, lines.getvalue()
    return 0, lines.getvalue()


def _run(out: Path, words: list[str], at: int, error: int) -> tuple[dict, int]:
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(read)
        disk = ctypes.CDLL(None)
        resumed = "--resume" in words
        given = [word.format(out=out) for word in words if not (resumed and word in ("--out", "{out}"))]
        disk.disk_fails(str(out).encode(), ctypes.c_long(at), error)
        code, said = _told(given)
        count = disk.disk_operations()
        disk.disk_fails(b"-", ctypes.c_long(-1), 0)
        os.write(write, json.dumps([code, said[-3000:], count]).encode())
        os._exit(0)
    os.close(write)
    with os.fdopen(read) as pipe:
        told = pipe.read()
    _, status = os.waitpid(child, 0)
    code, said, count = json.loads(told) if told else (os.waitstatus_to_exitcode(status), "", 0)
    files = {}
    for path in sorted(p for p in out.rglob("*") if p.is_file()):
        name = str(path.relative_to(out))
        if "tensorboard" in name:  # the library's own log, named by the time
            continue
        data = b"" if {*Path(name).parts} & {*VOLATILE} else path.read_bytes()
        files[name] = hashlib.sha256(data).hexdigest()[:12]
    return {"code": code, "said": said, "files": files}, count


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), sys.argv[4:])
