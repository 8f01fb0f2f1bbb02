"""A reproduction on disk and in the terminal."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fieldagents.task import Reproducible, Reproduction
from fieldmodels import html
from fieldmodels.files import write_bytes, write_text

if TYPE_CHECKING:
    from rich.console import Console


def write(what: str, result: Reproduction, out: Path) -> None:
    """Write ``table.csv``, a PNG for each figure, and a self-contained ``report.html``."""
    write_text(out / "table.csv", result.table.to_csv(index=False, lineterminator="\n"))
    for name, figure in result.figures.items():
        stream = io.BytesIO()
        figure.savefig(stream, format="png", dpi=120, bbox_inches="tight")
        write_bytes(out / f"{name}.png", stream.getvalue())
    header, rows = cells(result)
    body = [f'<p class="lead">{html.text(result.source)}</p>']
    body += [html.figure(figure) for figure in result.figures.values()]
    body.append(html.table(header, rows))
    if result.remarks:
        items = "".join(f"<li>{html.text(remark)}</li>" for remark in result.remarks)
        body.append(f"<h2>What agrees, what does not</h2><ul>{items}</ul>")
    body.append(f'<p class="soft">Made by <code>fieldgym reproduce {html.text(what)}</code>.</p>')
    write_text(out / "report.html", html.page(result.title, "\n".join(body)))


def written(result: Reproduction, out: Path) -> dict[str, str]:
    """The files of a reproduction, by their names."""
    names = ["table.csv", *(f"{name}.png" for name in result.figures), "report.html"]
    return {name: str(out / name) for name in names}


def to_json(result: Reproduction, out: Path) -> dict[str, Any]:
    """A reproduction as plain data."""
    rows = [
        {key: _plain(value) for key, value in row.items()} for row in result.table.to_dict(orient="records")
    ]
    return {
        "schema": 1,
        "title": result.title,
        "source": result.source,
        "table": rows,
        "remarks": list(result.remarks),
        "files": written(result, out),
    }


def show(result: Reproduction, console: Console) -> None:
    """Print a reproduction's table and remarks."""
    from rich.markup import escape
    from rich.table import Table

    header, rows = cells(result)
    table = Table(*map(escape, header), title=escape(result.title), caption=escape(result.source))
    for row in rows:
        table.add_row(*map(escape, row))
    console.print(table)
    for remark in result.remarks:
        console.print(f"- {remark}", markup=False)


def show_reproducible(known: Mapping[str, Reproducible], console: Console) -> None:
    """Print what can be reproduced."""
    from rich.table import Table

    table = Table("name", "what it is", "options")
    for name, entry in known.items():
        options = ", ".join(f"{option}={default}" for option, default in entry.options.items())
        table.add_row(name, entry.title, options)
    console.print(table)


def cells(result: Reproduction) -> tuple[list[str], list[list[str]]]:
    """Header and cells of a table, numbers with four digits, nothing where there is none."""
    rows = [[_cell(value) for value in row] for row in result.table.itertuples(index=False)]
    return [str(name) for name in result.table.columns], rows


def _cell(value: Any) -> str:
    plain = _plain(value)
    if plain is None:
        return ""
    return f"{plain:.4g}" if isinstance(plain, float) else str(plain)


def _plain(value: Any) -> Any:
    """A value as JSON knows it."""
    plain = value.item() if hasattr(value, "item") else value
    return None if isinstance(plain, float) and not math.isfinite(plain) else plain
