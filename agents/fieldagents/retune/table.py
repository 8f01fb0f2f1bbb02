"""Several closed loops as one Markdown table: ``python -m fieldagents.retune.table RETUNE.JSON...``."""

from __future__ import annotations

import json
import sys
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


if __name__ == "__main__":
    loops = [json.loads(Path(path).read_text(encoding="utf-8")) for path in sys.argv[1:]]
    for line in (HEADER, ["---"] * len(HEADER), *(row(loop) for loop in loops if loop["hidden_known"])):
        print("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |")
