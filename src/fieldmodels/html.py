"""One look for all reports: a self-contained HTML page, and figures inside it."""

from __future__ import annotations

import base64
import html
import io
import re
import uuid
from collections.abc import Iterable, Sequence
from typing import Any

STYLE = """
:root { color-scheme: light dark; --ink: #1c2430; --soft: #5b6675; --line: #d9dee6; --paper: #ffffff;
  --card: #f5f7fa; --accent: #0b6e99; --good: #1a7f4b; --bad: #b3402a; --warn: #9a6b00; }
@media (prefers-color-scheme: dark) { :root { --ink: #e4e8ee; --soft: #9aa6b5; --line: #343c48;
  --paper: #14181f; --card: #1d232c; --accent: #6cc1e8; --good: #62cf96; --bad: #f08a74; --warn: #e2b54d; } }
* { box-sizing: border-box; }
body { margin: 0; background: var(--paper); color: var(--ink);
  font: 16px/1.55 system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif; }
main { max-width: 1040px; margin: 0 auto; padding: 2rem 1.25rem 4rem; }
h1 { font-size: 1.7rem; line-height: 1.25; margin: 0 0 1rem; }
h2 { font-size: 1.25rem; margin: 2.4rem 0 .6rem; padding-top: .4rem; border-top: 1px solid var(--line); }
h3 { font-size: 1.05rem; margin: 1.6rem 0 .4rem; }
p, ul, ol { margin: .5rem 0; max-width: 48rem; }
a { color: var(--accent); }
code { font: .88em ui-monospace, "SF Mono", Menlo, Consolas, monospace; }
.lead { font-size: 1.15rem; padding: .9rem 1.1rem; margin: 1rem 0; background: var(--card);
  border-left: 4px solid var(--accent); border-radius: 4px; max-width: none; }
.good { color: var(--good); } .bad { color: var(--bad); } .warn { color: var(--warn); }
.soft, figcaption, caption { color: var(--soft); font-size: .9rem; }
.scroll { overflow-x: auto; margin: .8rem 0; }
table { border-collapse: collapse; font-size: .92rem; }
th, td { padding: .35rem .75rem; text-align: left; border-bottom: 1px solid var(--line);
  vertical-align: top; }
th { font-weight: 600; color: var(--soft); white-space: nowrap; }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
figure { margin: 1rem 0; padding: .6rem; background: #ffffff; border: 1px solid var(--line);
  border-radius: 4px; overflow-x: auto; }
figure svg, figure img { display: block; max-width: 100%; height: auto; margin: 0 auto; }
figcaption { color: #5b6675; margin-top: .4rem; }
details { margin: .8rem 0; } summary { cursor: pointer; color: var(--accent); }
"""


def page(title: str, body_html: str, *, plotly: bool = False) -> str:
    """Return a whole HTML page that needs nothing from outside itself.

    Args:
        title: Plain text of the tab and of the heading.
        body_html: Trusted HTML below the heading; escape foreign text with ``text``.
        plotly: Embed plotly.js once (about 5 MB); needed if the body holds Plotly figures.
    """
    script = ""
    if plotly:
        from plotly.offline import get_plotlyjs

        script = f"<script>{get_plotlyjs()}</script>"
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<link rel="icon" href="data:,">'
        f"<title>{text(title)}</title><style>{STYLE}</style>{script}</head>"
        f"<body><main><h1>{text(title)}</h1>\n{body_html}\n</main></body></html>\n"
    )


def text(value: object) -> str:
    """Escape plain text for HTML."""
    return html.escape(str(value))


def figure(drawing: Any, caption: str = "") -> str:
    """Return a figure as an HTML fragment, on a white card so that it reads in dark mode too.

    Args:
        drawing: A Plotly figure (the page then needs ``plotly=True``), or a matplotlib figure, which
            becomes inline SVG and is closed; a PNG inside where the SVG would exceed 1 MB.
        caption: Plain text below the figure.
    """
    content = _plotly(drawing) if hasattr(drawing, "to_plotly_json") else _matplotlib(drawing)
    below = f"<figcaption>{text(caption)}</figcaption>" if caption else ""
    return f"<figure>{content}{below}</figure>"


def table(header: Sequence[str], rows: Iterable[Sequence[object]], caption: str = "") -> str:
    """Return a table; cells that look like numbers are right-aligned, plain text is escaped."""
    body = [[str(cell) for cell in row] for row in rows]
    numeric = [bool(body) and all(_NUMBER.fullmatch(row[j]) for row in body) for j in range(len(header))]
    kind = [' class="number"' if n else "" for n in numeric]
    head = "".join(f"<th{k}>{text(h)}</th>" for h, k in zip(header, kind, strict=True))
    lines = "".join(
        "<tr>" + "".join(f"<td{k}>{text(c)}</td>" for c, k in zip(row, kind, strict=True)) + "</tr>"
        for row in body
    )
    above = f"<caption>{text(caption)}</caption>" if caption else ""
    inner = f"{above}<thead><tr>{head}</tr></thead><tbody>{lines}</tbody>"
    return f'<div class="scroll"><table>{inner}</table></div>'


_NUMBER = re.compile(r"\s*|[-–—]|[<>≤≥~]?\s*[-+−]?[\d.,]+([eE][-+]?\d+)?\s*(%|s|ms|mm|m|rad)?")


def _plotly(drawing: Any) -> str:
    return str(drawing.to_html(full_html=False, include_plotlyjs=False, div_id=f"p{uuid.uuid4().hex}"))


def _matplotlib(drawing: Any) -> str:
    import matplotlib as mpl
    from matplotlib import pyplot as plt

    stream = io.StringIO()
    prefix = uuid.uuid4().hex[:8]  # several SVGs in one page must not share ids
    with mpl.rc_context({"svg.hashsalt": prefix, "svg.fonttype": "none"}):
        drawing.savefig(stream, format="svg", bbox_inches="tight", metadata={"Date": None})
    svg = stream.getvalue()
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg[svg.index("<svg") :], flags=re.DOTALL)
    if len(svg) > 1_000_000:
        pixels = io.BytesIO()
        drawing.savefig(pixels, format="png", dpi=110, bbox_inches="tight")
        data = base64.b64encode(pixels.getvalue()).decode("ascii")
        svg = f'<img alt="" src="data:image/png;base64,{data}">'
    plt.close(drawing)
    return _unique_ids(svg, prefix)


def _unique_ids(svg: str, prefix: str) -> str:
    svg = re.sub(r'\bid="([^"]+)"', rf'id="{prefix}-\1"', svg)
    svg = re.sub(r'href="#([^"]+)"', rf'href="#{prefix}-\1"', svg)
    return re.sub(r"url\(#([^)]+)\)", rf"url(#{prefix}-\1)", svg)
