"""Several closed loops as one Markdown table: ``python -m fieldagents.retune.table RETUNE.JSON...``."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from fieldagents.retune.result import HIDDEN, NOMINAL, ORACLE, RETUNED, SIMULATION

HEADER = (
    "task",
    "agent",
    "hidden reality",
    "score",
    "predicted",
    "nominal",
    "re-tuned",
    "oracle",
    "loss recovered",
)


def markdown(loops: Sequence[dict[str, Any]]) -> str:
    """The table of some loops' ``retune.json``, those without a known hidden reality left out."""
    rows = [_row(loop) for loop in loops if loop["hidden_known"]]
    lines = [HEADER, ["---"] * len(HEADER), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def _row(loop: dict[str, Any]) -> list[str]:
    metric, means = loop["metric"], loop["means"]
    scale, unit = (100, "%") if metric["binary"] else (1, metric["unit"])
    hidden = loop["evaluation"]["environments"][HIDDEN]["reality"]
    effects = "; ".join(
        f"{name} {', '.join(f'{key} {value:g}' for key, value in values.items())}"
        for name, values in hidden.items()
    )
    cells = [(NOMINAL, SIMULATION), (NOMINAL, HIDDEN), (RETUNED, HIDDEN), (ORACLE, HIDDEN)]
    scores = [means[agent][place] for agent, place in cells]
    return [
        loop["task"],
        loop["agent"],
        effects,
        f"{metric['title']} [{unit}]",
        *("none" if score is None else f"{scale * score:.3g}" for score in scores),
        _recovered(loop["recovered"]),
    ]


def _recovered(found: dict[str, Any]) -> str:
    if found["share"] is None:
        return str(found["outcome"])
    if found["ci95"] is None:
        return f"{100 * found['share']:.1f} % (too few episodes)"
    low, high = found["ci95"]
    return f"{100 * found['share']:.1f} % ({100 * low:.1f} to {100 * high:.1f})"


def main(paths: Annotated[list[Path], typer.Argument(metavar="RETUNE.JSON...")]) -> None:
    """Print the table."""
    print(markdown([json.loads(path.read_text(encoding="utf-8")) for path in paths]))


if __name__ == "__main__":
    typer.run(main)
