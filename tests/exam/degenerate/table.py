"""The outcomes as a table."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from exam.degenerate.run import FAULTS, Row
from exam.table import put
from fieldmodels.files import write_text


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
    """The table as Markdown."""
    columns = ("answered", "refused", *FAULTS)
    lines = [
        f"{found['cases']} cases by `fieldgym exam --kind degenerate --cases {found['cases']}`.",
        "",
        f"| kind | {' | '.join(columns)} |",
        f"|---|{'---:|' * len(columns)}",
    ]
    for kind, counts in {**found["kinds"], "**all**": found["outcomes"]}.items():
        lines.append(f"| {kind} | " + " | ".join(str(counts.get(name, 0)) for name in columns) + " |")
    if found["faults"]:
        lines += ["", "Faults:", ""]
        lines += [f"- `{row['key']}`: {row['outcome']}: {row['said']}" for row in found["faults"]]
    return "\n".join([*lines, ""])


def write(rows: Sequence[Row], out: Path) -> dict[str, Path]:
    """Write ``exam.json`` and ``exam.md``."""
    found = summary(rows)
    write_text(out / "exam.json", json.dumps(found, indent=1) + "\n")
    write_text(out / "exam.md", markdown(found))
    return {name: out / name for name in ("exam.md", "exam.json")}


def publish(found: dict[str, Any], page: Path) -> None:
    """Put the table between the marks of a page."""
    put(markdown(found), page)
