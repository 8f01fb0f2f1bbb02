"""Write the table of the whole suite into the page on evaluation.

fieldgym evaluate benchmark; python docs/suite.py results/benchmark/suite.json
"""

from __future__ import annotations

import json
import sys
from itertools import groupby
from pathlib import Path
from typing import Any

from fieldagents.task import get_task
from fieldmodels.files import write_text

PAGE = Path(__file__).parent / "evaluation.md"
BEGIN, END = "<!-- suite: begin -->", "<!-- suite: end -->"
HEADER = "| task, scenario | metric | who plays by the rules, and the gap that each closes |\n|---|---|---|\n"


def row(lines: list[dict[str, Any]]) -> str:
    """A scenario's row: agents that see no more than the settings, with their means, as ranked."""
    first = lines[0]
    metric = next(one for one in get_task(first["task"]).metrics if one.name == first["metric"])
    fair = [line for line in lines if line["sees"] in ("observation", "model") and line["mean"] is not None]
    agents = []
    for line in fair:
        gap = "" if line["gap_closed"] is None else f" {round(100 * line['gap_closed'])} %"
        share = "" if line["share"] == 1.0 else f" of {100 * line['share']:.0f} %"
        agents.append(f"`{line['agent']}`{gap} ({line['mean']:.3g}{share})")
    label = metric.label.replace("|", "&#124;")
    return f"| {first['task']}, {first['scenario']} | {label} | {', '.join(agents)} |\n"


def table(lines: list[dict[str, Any]]) -> str:
    """All scenarios."""
    scenarios = groupby(lines, key=lambda line: (line["task"], line["scenario"]))
    return HEADER + "".join(row(list(group)) for _, group in scenarios)


if __name__ == "__main__":
    found = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))["lines"]
    text = PAGE.read_text(encoding="utf-8")
    before, rest = text.split(BEGIN)
    write_text(PAGE, f"{before}{BEGIN}\n{table(found)}{END}{rest.split(END)[1]}")
