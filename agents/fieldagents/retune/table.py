"""Loops as Markdown tables: ``python -m fieldagents.retune.table retune.json realities.json ...``."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from fieldagents.retune.result import HIDDEN, NOMINAL, ORACLE, RETUNED, SIMULATION

HEADER = [
    "task",
    "agent",
    "hidden reality",
    "score",
    *("predicted", NOMINAL, "re-tuned", ORACLE, "loss recovered"),
]
CELLS = (NOMINAL, SIMULATION), (NOMINAL, HIDDEN), (RETUNED, HIDDEN), (ORACLE, HIDDEN)
"""Of an agent and where it was tested: the scores of a row."""
DRAWN = NOMINAL, RETUNED, ORACLE
DRAWN_HEADER = [
    "task",
    "agent",
    "realities",
    "score",
    *(NOMINAL, "re-tuned", ORACLE, "loss won back"),
    "nothing named in",
    "diagnosis + tuning [s]",
]


def row(loop: dict[str, Any]) -> list[str]:
    """A loop's ``retune.json`` as a row of the table."""
    metric, found = loop["metric"], loop["recovered"]
    scale, unit = (100, "%") if metric["binary"] else (1, metric["unit"])
    effects = [
        f"{name} {', '.join(f'{key} {value:g}' for key, value in values.items())}"
        for name, values in loop["evaluation"]["environments"][HIDDEN]["reality"].items()
    ]
    scores = [loop["means"][agent][place] for agent, place in CELLS]
    share = str(found["outcome"])
    if found["share"] is not None:
        ends = [f"{100 * end:.1f}" for end in found["ci95"] or ()]
        share = f"{100 * found['share']:.1f} % ({' to '.join(ends) or 'too few episodes'})"
    begin = [loop["task"], loop["agent"], "; ".join(effects), f"{metric['title']} [{unit}]"]
    return [*begin, *("none" if score is None else f"{scale * score:.3g}" for score in scores), share]


def drawn_row(found: dict[str, Any]) -> list[str]:
    """Drawn realities' ``realities.json`` as a row of their table."""
    metric, closed = found["metric"], found["closed"]
    scale, unit = (100, "%") if metric["binary"] else (1, metric["unit"])
    scores = [scale * sum(one["means"][agent] for one in closed) / len(closed) for agent in DRAWN]
    share, ends = found["recovered"]["share"], found["recovered"]["ci95"]
    seconds = [sum(one["seconds"][part] for one in closed) / len(closed) for part in ("diagnose", RETUNED)]
    return [
        *(found["task"], found["agent"], str(len(closed)), f"{metric['title']} [{unit}]"),
        *(f"{score:.3g}" for score in scores),
        "nothing to recover"
        if share is None
        else f"{100 * share:.0f} % ({' to '.join(f'{100 * end:.0f}' for end in ends)})",
        str(sum(bool(one["skipped"]) for one in closed)),
        " + ".join(f"{one:.2g}" for one in seconds),
    ]


def tables(results: Iterable[dict[str, Any]]) -> str:
    """Closed loops and drawn realities as Markdown tables, one of each kind."""
    results = list(results)
    loops = [row(one) for one in results if one.get("hidden_known")]
    realities = [drawn_row(one) for one in results if "closed" in one]
    lines = []
    for header, rows in ((HEADER, loops), (DRAWN_HEADER, realities)):
        if rows:
            lines += [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


if __name__ == "__main__":
    print(tables(json.loads(Path(path).read_text(encoding="utf-8")) for path in sys.argv[1:]))
