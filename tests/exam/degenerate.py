"""An exam of faults: whatever a user hands in ends in an answer or in one clear message.

Each case runs as a user would run it, in a process of its own with limits; what is left is judged.
"""

from __future__ import annotations

import ctypes
import json
import os
import re
import resource
import shutil
import signal
import sys
import tempfile
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout, suppress
from io import StringIO
from pathlib import Path
from typing import Any

from exam.hostile import HONEST, RECORD, Case
from exam.run import Row, read_rows, write_row
from fieldmodels.files import PART, write_text
from fieldmodels.yaml import save_yaml

PROCESSOR_S, MEMORY = 120, 6 << 30
"""A case that takes more processor time hangs [s]; memory that it may have [bytes]."""
FAULTS = ("traceback", "bare warning", "hang", "false name", "consistent", "torn file", "died")
NO_RELATION = ("unrelated", "noise alone")
"""Kinds of which no answer may say that the simulation is consistent with them."""


def run_cases(
    cases: Sequence[Case],
    out: Path,
    command: Callable[[list[str]], Any],
    *,
    workers: int,
    progress: Callable[[str, float], None],
) -> list[Row]:
    """Run the cases, or what is left of them; ``cases.jsonl`` has a line for each.

    Args:
        cases: The cases.
        out: Result folder.
        command: The command line, called with its words.
        workers: Cases at a time.
        progress: Shown the progress.
    """
    log = out / "cases.jsonl"
    done = {row["key"]: row for row in read_rows(log)}
    left = [case for case in cases if case.key not in done]
    _warm(command)
    running: dict[int, tuple[Case, Path]] = {}
    with log.open("a", encoding="utf-8") as lines:
        while left or running:
            while left and len(running) < workers:
                case, folder = left.pop(0), Path(tempfile.mkdtemp(prefix="fieldgym-fault-"))
                running[_started(case, folder, command)] = case, folder
            pid, status, used = os.wait4(-1, 0)
            if pid not in running:
                continue
            case, folder = running.pop(pid)
            done[case.key] = judged(case, folder, status, used.ru_utime + used.ru_stime)
            shutil.rmtree(folder, ignore_errors=True)
            write_row(lines, done[case.key])
            progress(case.kind, len(done) / len(cases))
    return [done[case.key] for case in cases]


def _warm(command: Callable[[list[str]], Any]) -> None:
    """Import and load before the forks what cases need: run two commands that nothing is wrong with."""
    import fieldagents.evaluation  # noqa: F401
    import fieldmodels.contract  # noqa: F401

    with tempfile.TemporaryDirectory() as name, redirect_stdout(StringIO()), redirect_stderr(StringIO()):
        folder = Path(name)
        save_yaml(RECORD, folder / "record.yaml")
        for words in (["record", f"{folder}/record.yaml"], Case("clean", 0).make(folder)):
            with suppress(SystemExit):
                command([*words, "--out", f"{folder}/{words[0]}", "--json"])


def _started(case: Case, folder: Path, command: Callable[[list[str]], Any]) -> int:
    """Start a case in a child; its process id."""
    sys.stdout.flush()
    sys.stderr.flush()
    child = os.fork()
    if child:
        return child
    code = 70
    try:
        _die_with_the_parent()
        words = case.make(folder)
        os.chdir(folder)
        sys.path.insert(0, str(folder))
        resource.setrlimit(resource.RLIMIT_CPU, (PROCESSOR_S, PROCESSOR_S + 5))
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        signal.signal(signal.SIGXCPU, signal.SIG_DFL)
        for number, name in ((1, "stdout"), (2, "stderr")):
            os.dup2(os.open(folder / f".{name}", os.O_WRONLY | os.O_CREAT), number)
        sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
        warnings.simplefilter("always", RuntimeWarning)  # also what the warm parent met before
        try:
            command([*words, "--out", str(folder / "out"), "--json"])
            code = 0
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 0 if end.code is None else 1
        except BaseException:
            traceback.print_exc()
            code = 1
        sys.stdout.flush()
        sys.stderr.flush()
    finally:
        os._exit(code)


def _die_with_the_parent() -> None:
    """On Linux, so that nobody has to look for the children of a run that was killed."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG


def judged(case: Case, folder: Path, status: int, seconds: float) -> Row:
    """The outcome of a case: ``answered``, ``refused``, or one of `FAULTS`."""
    kept = (folder / name for name in (".stderr", ".stdout"))
    said, result = (path.read_text(errors="replace") if path.exists() else "" for path in kept)
    code = os.waitstatus_to_exitcode(status)
    row: Row = {"key": case.key, "kind": case.kind, "code": code, "seconds": round(seconds, 2)}
    last = next((line for line in reversed(said.splitlines()) if line.strip()), "")
    if torn := _torn(folder / "out"):
        return row | {"outcome": "torn file", "said": torn}
    if code in (-signal.SIGXCPU, -signal.SIGKILL):
        return row | {"outcome": "hang", "said": last[:300]}
    if "Traceback (most recent call last)" in said:
        return row | {"outcome": "traceback", "said": _where(said)}
    if warned := re.search(r"^.*:\d+: \w*Warning: .*", said, re.MULTILINE):  # NumPy's own tell a user nothing
        return row | {"outcome": "bare warning", "said": warned[0][-300:]}
    if code != 0:  # 1: of jobs that failed
        clean = code in (1, 2) and re.search("^Error: |Usage", said, re.MULTILINE)
        return row | {"outcome": "refused" if clean else "died", "said": f"exit code {code}: {last[:300]}"}
    try:
        answer = json.loads(result)
    except ValueError:
        return row | {"outcome": "torn file", "said": f"standard output is not JSON: {result[:200]!r}"}
    names = [cause["effect"] for cause in answer.get("causes", ())]
    if names and case.kind in HONEST and answer.get("verdict") in ("named", "ambiguous"):
        return row | {"outcome": "false name", "said": ", ".join(names)}
    if case.kind in NO_RELATION and answer.get("verdict") == "consistent":
        return row | {"outcome": "consistent", "said": "though no command explains the response"}
    return row | {"outcome": "answered", "said": str(answer.get("verdict", "")), "named": names}


def _torn(out: Path) -> str:
    """A file that is left half written, or whose own kind cannot read it; empty if there is none."""
    if not out.is_dir():
        return ""
    for path in out.rglob("*"):
        if PART in path.name:
            return f"{path.name} was left"
        try:
            if path.suffix == ".json":
                json.loads(path.read_text(encoding="utf-8"))
            elif path.suffix == ".html" and "</html>" not in path.read_text(encoding="utf-8"):
                return f"{path.name} has no end"
            elif path.suffix == ".parquet":
                import pyarrow.parquet as pq

                pq.read_metadata(path)
        except (OSError, ValueError) as error:
            return f"{path.name}: {error}"
    return ""


def _where(said: str) -> str:
    """The last place of ours in a traceback, and the error."""
    lines = said.splitlines()
    ours = [line.strip() for line in lines if "/field" in line and line.strip().startswith("File")]
    place = ours[-1].split("/")[-1] if ours else ""
    return f"{lines[-1][:200]} ({place})"


def summary(rows: Sequence[Row]) -> dict[str, Any]:
    """Counts of outcomes, whole and by kind, and every fault."""
    kinds = list(dict.fromkeys(row["kind"] for row in rows))
    return {
        "schema": 1,
        "cases": len(rows),
        "outcomes": dict(Counter(row["outcome"] for row in rows)),
        "kinds": {kind: dict(Counter(r["outcome"] for r in rows if r["kind"] == kind)) for kind in kinds},
        "faults": [row for row in rows if row["outcome"] in FAULTS],
    }


def markdown(found: dict[str, Any]) -> str:
    """The counts as a table; faults of a kind in one column, each of them below."""
    lines = [
        f"{found['cases']} cases by `fieldgym exam --kind degenerate --cases {found['cases']}`.\n",
        "| kind | answered | refused | faults |",
        "|---|---:|---:|---:|",
    ]
    for kind, counts in {**found["kinds"], "**all**": found["outcomes"]}.items():
        faults = sum(counts.get(name, 0) for name in FAULTS)
        lines.append(f"| {kind} | {counts.get('answered', 0)} | {counts.get('refused', 0)} | {faults} |")
    if found["faults"]:
        lines.append("\nFaults:\n")
        lines += [f"- `{row['key']}`: {row['outcome']}: {row['said']}" for row in found["faults"]]
    return "\n".join([*lines, ""])


def write(rows: Sequence[Row], out: Path) -> dict[str, Path]:
    """Write ``exam.json`` and ``exam.md``."""
    found = summary(rows)
    texts = {"exam.md": markdown(found), "exam.json": json.dumps(found, indent=1) + "\n"}
    for name, text in texts.items():
        write_text(out / name, text)
    return {name: out / name for name in texts}
