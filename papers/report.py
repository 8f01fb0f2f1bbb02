"""A reproduction on disk and in the terminal."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fieldmodels import html
from fieldmodels.files import write_text
from papers.claim import Decided, Verdict
from papers.source import Reproducible, Reproduction

if TYPE_CHECKING:
    from rich.console import Console

WIDTH = 100
"""Columns of a terminal that a table may take."""

STYLES: Mapping[Verdict, tuple[str, str]] = {
    "reproduced": ("green", "good"),
    "refuted": ("yellow", "warn"),
    "depends": ("yellow", "warn"),
    "undecided": ("bright_black", "soft"),
    "not computable": ("bright_black", "soft"),
    "failed": ("red", "bad"),
}
"""Colour in the terminal and class on a page; an unexpected verdict is red."""


def write(what: str, result: Reproduction, out: Path) -> None:
    """Write ``table.csv``, a PNG and a CSV for each figure, and a self-contained ``report.html``."""
    write_text(out / "table.csv", result.table.to_csv(index=False, lineterminator="\n"))
    shown = [html.figure(figure, says=name, name=name, beside=out) for name, figure in result.figures.items()]
    header, rows = cells(result)
    counts = Counter(one.verdict for one in result.decided)
    said = ", ".join(f"{count} {verdict}" for verdict, count in counts.items())
    first = f"Claims of the source: {said}." if said else next(iter(result.remarks), "")
    body = [f'<p class="lead">{html.text(first)}</p>'] if first else []
    body += shown[:1]
    body += [claims_html(result.decided)] if result.decided else []
    if result.remarks:
        items = "".join(f"<li>{html.text(remark)}</li>" for remark in result.remarks)
        body.append(f"<h2>What agrees, what does not</h2><ul>{items}</ul>")
    body += shown[1:]
    body.append(html.table(header, rows))
    body.append(f'<p class="soft">Source: {html.text(result.source)}</p>')
    body.append(f'<p class="soft">Made by <code>fieldgym reproduce {html.text(what)}</code>.</p>')
    write_text(out / "report.html", html.page(result.title, "\n".join(body)))


def claims_html(claims: Sequence[Decided]) -> str:
    """A table of claims, verdict first."""
    names = ("verdict", "claim", "printed", "ours, interval at 95 %")
    head = "".join(f"<th>{name}</th>" for name in names)
    rows = "".join(map(_row_html, claims))
    inner = f"<thead><tr>{head}</tr></thead><tbody>{rows}</tbody>"
    return f'<div class="scroll"><table class="claims">{inner}</table></div>'


def _row_html(one: Decided) -> str:
    style = "bad" if one.unexpected else STYLES[one.verdict][1]
    soft = [
        f'<span class="soft">{html.text(text)}</span>' for text in (*_notes(one), one.claim.comment) if text
    ]
    where = f'<span class="soft">{html.text("; ".join(one.claim.where))}</span>'
    claim = "<br>".join([where, html.text(one.claim.says), *soft])
    printed, ours = ("<br>".join(map(html.text, lines)) for lines in (_printed(one), numbers(one)))
    others = f'<td>{claim}</td><td data-label="printed">{printed}</td><td data-label="ours">{ours}</td>'
    return f'<tr><td class="{style}">{html.text(_verdict(one))}</td>{others}</tr>'


def show_claims(claims: Sequence[Decided], console: Console) -> None:
    """Print claims as a table of at most `WIDTH` columns, verdict first."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(width=WIDTH, box=box.SIMPLE_HEAD, show_lines=True)
    for name, width in (("verdict", 14), ("claim", 34), ("printed", 14), ("ours, interval at 95 %", 30)):
        table.add_column(name, width=width, overflow="fold")
    for one in claims:
        colour = "bold red" if one.unexpected else STYLES[one.verdict][0]
        claim = [f"{one.claim.where[0]}: {one.claim.says}", *_notes(one)]
        lines = ("\n".join(part) for part in (claim, _printed(one), numbers(one)))
        table.add_row(Text(_verdict(one), colour), *map(Text, lines))
    console.print(table)


def numbers(one: Decided) -> list[str]:
    """What our number is, and its value, in each reading where there are several."""
    readings, verdicts = one.claim.readings, one.verdicts
    names = {readings[name].statistic for name in one.measured}
    lines = [f"{names.copy().pop()}:"] if len(names) == 1 else []
    for name, number in one.measured.items():
        lines.append(f"{name}: {number or '-'}, {verdicts[name]}" if name else str(number or "-"))
    return lines


def _verdict(one: Decided) -> str:
    return one.words + (f" (expected: {one.claim.expected})" if one.unexpected else "")


def _notes(one: Decided) -> list[str]:
    return [text for text in (one.claim.because, *one.errors.values()) if text]


def _printed(one: Decided) -> list[str]:
    """What the source prints, and what ours must be."""
    condition = one.claim.condition
    return [text for text in (one.claim.printed, condition and f"ours must be {condition}") if text]


def written(result: Reproduction, out: Path) -> dict[str, str]:
    """The files of a reproduction, by their names."""
    names = ["table.csv", *(f"{html.FIGURES}/{name}.png" for name in result.figures), "report.html"]
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
        "claims": [
            {"name": one.claim.name, "verdict": one.verdict, "expected": one.claim.expected}
            for one in result.decided
        ],
        "statistics": {name: asdict(number) for name, number in result.statistics.items()},
        "table": rows,
        "remarks": list(result.remarks),
        "files": written(result, out),
    }


def show(result: Reproduction, console: Console) -> None:
    """Print the verdicts, then the remarks, the table and its source."""
    from rich import box
    from rich.table import Table

    console.print(result.title, style="bold", markup=False)
    if result.decided:
        show_claims(result.decided, console)
    for remark in result.remarks:
        console.print(f"- {remark}", markup=False, width=WIDTH)
    header, rows = cells(result)
    words = [max([0, *map(len, name.split())]) for name in header]
    widths = [min(max([least, *(len(row[j]) for row in rows)]), 40) for j, least in enumerate(words)]
    for columns in _blocks(widths):
        table = Table(box=box.SIMPLE_HEAD)
        for j in columns:
            table.add_column(header[j], width=widths[j], overflow="fold")
        for row in rows:
            table.add_row(*(row[j] for j in columns))
        console.print(table, width=WIDTH, markup=False)
    console.print(f"Source: {result.source}", markup=False, width=WIDTH)


def _blocks(widths: Sequence[int]) -> list[list[int]]:
    """Columns side by side as far as `WIDTH` allows; each further block begins with the first column."""
    blocks = [[0]]
    for j in range(1, len(widths)):
        if sum(widths[i] + 3 for i in (*blocks[-1], j)) > WIDTH - 2:
            blocks.append([0])
        blocks[-1].append(j)
    return blocks


def show_reproducible(known: Mapping[str, Reproducible], console: Console) -> None:
    """Print what can be reproduced."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD)
    table.add_column("name", no_wrap=True)
    for name in ("what it is", "processor s", "options"):
        table.add_column(name, overflow="fold")
    for name, entry in known.items():
        options = "\n".join(f"{option}={default}" for option, default in entry.options.items())
        seconds = f"{entry.processor_s[0]:.0f}" if entry.processor_s else "?"
        table.add_row(name, entry.title, seconds, options)
    console.print(table, width=WIDTH)


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
