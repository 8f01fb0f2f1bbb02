"""Every command on a disk that fails: what is tried, what must hold, and the table of it in docs/faults.md.

``python tests/faults/matrix.py [PLACES [COMMAND...]]`` lets so many places of each command fail in turn
(all by default), keeps what was found in ``matrix.json``, and publishes the table.
"""

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

from exam.table import put
from fieldmodels.yaml import save_yaml

HERE = Path(__file__).parent
KEPT = HERE / "matrix.json"
PAGE = HERE.parents[1] / "docs" / "faults.md"
COMPILER = shutil.which("cc")
FAILURES = {"full disk": errno.ENOSPC, "I/O error": errno.EIO, "killed": -signal.SIGKILL}
SENTENCE = {errno.ENOSPC: "No space left on device", errno.EIO: "Input/output error"}
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
COMMANDS = {
    "record": ["record", "{folder}/record.yaml"],
    "diagnose": ["diagnose", "{folder}/log/log.csv", "--machine", "rig"],
    "evaluate": ["evaluate", "{folder}/evaluate.yaml"],
    "train": ["train", "{folder}/train.yaml"],
    "sweep": ["sweep", "{folder}/sweep.yaml", "--workers", "0"],
    "exam": ["exam", "--set=develop", "--machine=rig", "--kind=nothing", "--cases=1", "--workers=0"],
}


def prepared(folder, name):
    """The words of a command, without the place of results, whose files lie in a folder."""
    sweep = {"name": "grid", "grid": {"seed": [1]}, "train": [f"{folder}/train.yaml"]}
    for file, config in (("record", RECORD), ("evaluate", EVALUATE), ("train", TRAIN), ("sweep", sweep)):
        save_yaml(config, folder / f"{file}.yaml")
    if name == "diagnose":
        from fieldagents.cli import app

        app([*prepared(folder, "record"), "--out", f"{folder}/log"], standalone_mode=False)
    return [*(word.format(folder=folder) for word in COMMANDS[name]), "--json"]


def run_on_failing_disk(folder, name, error, places):
    """A line for the clean run, and one for each place of failure."""
    library = folder / "disk.so"
    subprocess.run([COMPILER, "-shared", "-fPIC", "-O1", "-o", library, HERE / "disk.c", "-ldl"], check=True)
    words = [*prepared(folder, name), "--out", "{out}"]
    command = [sys.executable, HERE / "disk.py", folder, str(error), str(places), *words]
    environment = {**os.environ, "LD_PRELOAD": str(library), "OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    return [json.loads(line) for line in done.stdout.splitlines()]


def wrong(line, whole, error):
    """What a place of failure left that it should not have; empty if nothing."""
    first, second = line["first"], line["second"]
    found = []
    if "Traceback" in first["said"]:
        found.append(f"traceback: {first['said'].splitlines()[-1]}")
    if error < 0 and first["code"] != error:
        found.append(f"exit code {first['code']} of a process that was killed")
    if error > 0 and first["code"] != 0:
        if first["code"] not in (1, 2):  # 1: of a job
            found.append(f"exit code {first['code']}")
        if SENTENCE[error] not in first["said"]:
            found.append("the message does not say why")
    for name, digest in first["files"].items():
        grows = "checkpoints" in name or "curve.csv" in name or name.endswith(".jsonl")  # of an earlier step
        left = ".part" in name or Path(name).name in (".lock", "error.txt")
        if not (grows or left or digest == whole.get(name)):
            found.append(f"{name} is torn")
    if second["code"] != 0:
        found.append(f"the second run ends with exit code {second['code']}: {second['said'][-200:]}")
    elif second["files"] != whole:
        other = {n for n in {*whole, *second["files"]} if second["files"].get(n) != whole.get(n)}
        found.append(f"the second run differs in {', '.join(sorted(other))}")
    return found


def examined(name, error, places):
    """How many places a command has, at how many it was failed, and what was wrong there."""
    with tempfile.TemporaryDirectory() as folder:
        clean, *lines = run_on_failing_disk(Path(folder), name, error, places)
    assert clean["code"] == 0, clean["said"]
    faults = [f"{line['at']}: {one}" for line in lines for one in wrong(line, clean["files"], error)]
    return {"places": clean["operations"], "tried": len(lines), "faults": faults}


def publish(kept):
    """Put the table into the page."""
    lines = [f"| command | points, each with {', '.join(FAILURES)} |", "|---|---|"]
    for name in COMMANDS:
        found = [kept.get(name, {}).get(failure) for failure in FAILURES]
        said = {f"{one['tried']} of {one['places']}" if one else "not run" for one in found}
        lines.append(f"| {name} | {'; '.join(sorted(said))} |")
    faults = [
        f"- {name}, {failure}, place {fault}"
        for name, row in kept.items() for failure, one in row.items() for fault in one["faults"]
    ]  # fmt: skip
    end = faults or ["At each of them every file was whole or absent, and a second run gave the same bits."]
    put("\n".join([*lines, "", *end, ""]), PAGE, "disk")


def main(places=10**6, *names):
    """Try commands, and publish what was found of all."""
    for name in names or COMMANDS:
        for failure, error in FAILURES.items():
            found = examined(name, error, int(places))
            print(name, failure, found, flush=True)
            kept = json.loads(KEPT.read_text()) if KEPT.exists() else {}
            kept.setdefault(name, {})[failure] = found
            KEPT.write_text(json.dumps(kept, indent=1) + "\n")
            publish(kept)


if __name__ == "__main__":
    main(*sys.argv[1:])
