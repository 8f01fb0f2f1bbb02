"""Count how many foreign logs lead to the right cause, by the command line alone, in at most three actions.

python tests/logs/goals.py --set report --publish docs/bring_your_own_bench.md
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from foreign import SETS, Log

MOST = 3  # actions
MARKS = "<!-- foreign logs -->", "<!-- end of foreign logs -->"


def actions(log: Log, folder: Path) -> dict[str, Any]:
    """Do what each message asks for, until there is a verdict or three actions are spent."""
    command = ["fieldgym", "diagnose", log.source, "--model", log.run.model, "--json", "--out", str(folder)]
    said, before = "", resource.getrusage(resource.RUSAGE_CHILDREN)
    for count in range(1, MOST + 1):  # noqa: B007
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        said += done.stderr
        if done.returncode == 0:
            break
        rate = log.options.get("rate")
        if "--rate" in done.stderr and rate and "--rate" not in command:
            command += ["--rate", str(rate), "--accept"]
        elif "--accept" in done.stderr and "--accept" not in command:
            command += ["--accept"]
        else:
            return {"about": log.about, "loaded": False, "said": done.stderr[-500:]}
    if done.returncode:
        return {"about": log.about, "loaded": False, "said": done.stderr[-500:]}
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    found = json.loads(done.stdout)
    named = [name for cause in found["causes"] for name in (cause["effect"], *cause["alternatives"])]
    return {
        "about": log.about,
        "loaded": True,
        "actions": count,
        "seconds": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        "hidden": log.run.cause,
        "named": [cause["effect"] for cause in found["causes"]],
        "right": log.run.cause in named,
        "reversed": log.reversed,
        "reversed_said": bool(log.reversed) and f"{log.reversed} = -" in said,
    }


def table(rows: list[dict[str, Any]]) -> str:
    """What became of each log."""
    lines = [
        "| log | hidden | named | actions | sign | processor s |",
        "|---|---|---|---|---|---|",
        *(
            f"| {r['about'].replace('|', chr(92) + '|')} | `{r['hidden']}` | "
            f"{', '.join(f'`{n}`' for n in r['named']) or '–'} | {r['actions']} | "
            f"{('found' if r['reversed_said'] else 'missed') if r['reversed'] else ''} | {r['seconds']:.0f} |"
            if r["loaded"]
            else f"| {r['about'].replace('|', chr(92) + '|')} | not read | | | | |"
            for r in rows
        ),
    ]
    return "\n".join(lines)


def summary(rows: list[dict[str, Any]]) -> str:
    """What stands on the docs' page: counts, and the logs that failed."""
    good = [r for r in rows if r["loaded"]]
    turned = [r for r in good if r["reversed"]]
    failed = [r["about"] for r in rows if not (r["loaded"] and r["right"])]
    return (
        f"Loaded without editing: {len(good)} of {len(rows)}; right cause in at most {MOST} actions: "
        f"{sum(r['right'] for r in good)}; reversed signs reported: "
        f"{sum(r['reversed_said'] for r in turned)} of {len(turned)}."
        + (f" Failed: {'; '.join(failed)}." if failed else "")
    )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--set", choices=sorted(SETS), default="report")
    parser.add_argument("--out", type=Path, default=Path("results/logs"))
    parser.add_argument("--publish", type=Path)
    options = parser.parse_args()
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as name:
        for k, log in enumerate(SETS[options.set](Path(name))):
            rows.append(actions(log, Path(name) / "results" / str(k)))
            print(json.dumps(rows[-1]), file=sys.stderr, flush=True)
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / f"{options.set}.json").write_text(json.dumps(rows, indent=1))
    print(f"{table(rows)}\n\n{summary(rows)}")
    if options.publish:
        page = options.publish.read_text()
        before, after = page.split(MARKS[0])[0], page.split(MARKS[1])[1]
        options.publish.write_text(f"{before}{MARKS[0]}\n{summary(rows)}\n{MARKS[1]}{after}")


if __name__ == "__main__":
    main()
