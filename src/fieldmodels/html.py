"""One look for all reports: a self-contained HTML page, and figures inside it."""

from __future__ import annotations

import base64
import csv
import html
import io
import math
import re
import uuid
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from fieldmodels.files import write_bytes, write_text

Numbers = Mapping[str, Iterable[Any]]
"""Columns by name, all of one length."""
INK, BEFORE, AFTER = "#1c2430", "#d55e00", "#0072b2"
PURPLE, GREEN, AMBER, GREY = "#be9cc9", "#7ec270", "#e5b800", "#61666b"
CYCLE = (AFTER, BEFORE, GREEN, PURPLE, AMBER, GREY, INK)  # of the curves of a figure
LINE = "#d9dee6"  # of a grid; the others differ for every kind of eye, here and in the dark (page.css)
WIDE, NARROW = 9.6, 4.4  # inches: for a screen and for a phone
FIGURES = "figures"  # folder beside a page
HEAVY = 1_000_000  # bytes of an SVG above which pixels are lighter

# What a figure is drawn with, and the name of the page's colour that takes its place.
THEMED = {INK: "ink", "#000000": "ink", "#ffffff": "figure", "#b0b0b0": "line", LINE: "line",
          BEFORE: "before", AFTER: "after", PURPLE: "purple", GREEN: "green", AMBER: "amber",
          GREY: "grey"}  # fmt: skip

STYLE = (Path(__file__).parent / "page.css").read_text(encoding="utf-8")


@dataclass(frozen=True)
class Picture:
    """A figure of a report.

    Attributes:
        name: File name without its ending.
        draw: Draws it so many inches wide.
        caption: Plain text below it.
        says: What it shows, for who does not see it.
        numbers: Its data; by default what is read off its lines, points and bars.
    """

    name: str
    draw: Callable[[float], Any]
    caption: str
    says: str
    numbers: Numbers | None = None

    def fragment(self, folder: str = "") -> str:
        """As HTML, for a screen and for a phone, with links to its files.

        Args:
            folder: Where ``save`` has put the files, as the page sees it; "" for no links.
        """
        names = [f"{self.name}.png", *([f"{self.name}.csv"] if folder and self.data else [])]
        links = " ".join(f'<a href="{text(f"{folder}/{n}")}" download>{n[-3:].upper()}</a>' for n in names)
        said = f'{text(self.caption)} <span class="files">{links}</span>' if folder else text(self.caption)
        below = f"<figcaption>{said}</figcaption>" if said else ""
        return f"<figure>{self.content}{below}</figure>"

    @cached_property
    def content(self) -> str:
        """What is drawn, as HTML; it is drawn once, on however many pages it stands."""
        with palette():
            svgs = (
                ("wide", _svg(self._wide, self.says)),
                ("narrow", _svg(_laid_out(self.draw(NARROW)), self.says)),
            )
        return "".join(f'<div class="{kind}">{svg}</div>' for kind, svg in svgs)

    @cached_property
    def _wide(self) -> Any:
        """As it is for a screen, in a file, and in its data."""
        with palette():
            return _laid_out(self.draw(WIDE))

    @cached_property
    def data(self) -> Numbers:
        """Its data; none of a photograph."""
        return drawn(self._wide) if self.numbers is None else self.numbers

    def save(self, folder: Path) -> list[Path]:
        """Write a PNG and, where there are data, a CSV file."""
        stream = io.BytesIO()
        with palette():
            self._wide.savefig(stream, format="png", dpi=150, facecolor="white")
        paths = [folder / f"{self.name}.png"]
        write_bytes(paths[0], stream.getvalue())
        if self.data:
            paths.append(folder / f"{self.name}.csv")
            lines = io.StringIO()
            rows = zip(*self.data.values(), strict=True)
            cells = ([f"{c:.9g}" if isinstance(c, float) else c for c in row] for row in rows)
            csv.writer(lines, lineterminator="\n").writerows([list(self.data), *cells])
            write_text(paths[1], lines.getvalue())
        return paths


def columns_of(rows: Sequence[Mapping[str, Any]]) -> Numbers:
    """Columns by name out of rows that have the same names."""
    return {name: [row[name] for row in rows] for name in (rows[0] if rows else ())}


def page(title: str, body_html: str) -> str:
    """Return a whole HTML page that needs nothing from outside itself.

    Args:
        title: Plain text of the tab and of the heading.
        body_html: Trusted HTML below the heading; escape foreign text with ``text``.
    """
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<link rel="icon" href="data:,">'
        f"<title>{text(title)}</title><style>{STYLE}</style></head>"
        f"<body><main><h1>{text(title)}</h1>\n{body_html}\n</main></body></html>\n"
    )


def text(value: object) -> str:
    """Escape plain text for HTML."""
    return html.escape(str(value))


def plain(fragment: str) -> list[str]:
    """The lines of an HTML fragment without its tags."""
    return [html.unescape(re.sub("<[^>]+>", "", line)) for line in fragment.split("<br>")]


def _laid_out(drawing: Any) -> Any:
    """A figure whose layout is found once, and not anew for every file: that takes a third of the time."""
    engine = drawing.get_layout_engine()
    if engine is not None:
        engine.execute(drawing)
        drawing.set_layout_engine("none")
    return drawing


def palette() -> AbstractContextManager[None]:
    """In its block, matplotlib draws by default in the colours of the reports."""
    import matplotlib as mpl
    from cycler import cycler

    return mpl.rc_context({"axes.prop_cycle": cycler(color=CYCLE), "legend.edgecolor": LINE})


def drawn(drawing: Any) -> Numbers:
    """What a matplotlib figure shows: a row for every point and bar, with its panel and its label.

    A place that has a name on its axis, as an agent has, is given by that name. Of a photograph: {}.
    """
    rows: list[tuple[str, str, Any, Any]] = []
    for number, axes in enumerate(drawing.axes, 1):
        panel = axes.get_title() or axes.get_xlabel() or f"panel {number}"
        shown = [(line.get_label(), line.get_xydata()) for line in axes.lines]
        shown += [
            (one.get_label(), one.get_offsets()) for one in axes.collections if len(one.get_offsets()) > 1
        ]
        for bars in axes.containers:
            boxes = [bar.get_bbox() for bar in getattr(bars, "patches", ())]
            upright = getattr(bars, "orientation", "vertical") == "vertical"
            middle = [((b.x0 + b.x1) / 2, b.y1) if upright else (b.x1, (b.y0 + b.y1) / 2) for b in boxes]
            shown.append((bars.get_label(), middle))
        names = [_names(axis) for axis in (axes.xaxis, axes.yaxis)]
        for label, points in shown:
            own = "" if str(label).startswith("_") else str(label)
            for place in ([float(v) for v in point] for point in points):
                if all(map(math.isfinite, place)):
                    x, y = (known.get(round(v), v) for known, v in zip(names, place, strict=True))
                    rows.append((panel, own, x, y))
    columns = ("panel", "curve", "x", "y")
    return {name: [row[k] for row in rows] for k, name in enumerate(columns)} if rows else {}


def _names(axis: Any) -> dict[int, str]:
    """Names of the places on an axis that has names instead of numbers."""
    from matplotlib.category import StrCategoryLocator
    from matplotlib.ticker import FixedLocator

    if not isinstance(axis.get_major_locator(), FixedLocator | StrCategoryLocator):
        return {}
    labels = [label.get_text().replace("\n", " ") for label in axis.get_majorticklabels()]
    known = {round(float(v)): name for v, name in zip(axis.get_majorticklocs(), labels, strict=False) if name}
    return known if any(character.isalpha() for name in known.values() for character in name) else {}


def figure(
    drawing: Any, caption: str = "", says: str = "", name: str = "", beside: Path | None = None
) -> str:
    """Return a figure as an HTML fragment.

    Args:
        drawing: A matplotlib figure, whose axes are stacked for a phone, or a function that draws one so
            many inches wide: inline SVG in the page's colours, or a PNG where that would exceed 1 MB.
        caption: Plain text below the figure.
        says: What it shows, for who does not see it; by default the caption.
        name: File name without its ending.
        beside: The page's folder, in whose ``figures`` its PNG and CSV are written; None for no files.
    """
    draw = drawing if callable(drawing) else partial(_as_wide, drawing)
    picture = Picture(re.sub(r"[^\w.-]+", "_", name), draw, caption, says or caption or "figure")
    if beside is not None:
        picture.save(beside / FIGURES)
    return picture.fragment(FIGURES if beside is not None else "")


def _as_wide(drawing: Any, width: float) -> Any:
    """A finished figure: as it is for a screen, its axes one below the other for a phone."""
    if width == WIDE or any(axes.get_subplotspec() is None for axes in drawing.axes):
        return drawing
    heights = []
    for axes in drawing.axes:  # each keeps its shape, within reason
        box = axes.get_window_extent()
        heights.append(min(max(width * box.height / box.width, 1.5), 4.5))
        axes.tick_params(labelleft=True, labelbottom=True)
    grid = drawing.add_gridspec(len(heights), 1, height_ratios=heights)
    for axes, place in zip(drawing.axes, grid, strict=True):
        axes.set_subplotspec(place)
    drawing.set_size_inches(width, sum(heights) + 0.5 * len(heights))
    drawing.set_layout_engine("constrained")
    return drawing


def facts(rows: Iterable[tuple[str, str]]) -> str:
    """Return questions with their answers (trusted HTML); what has no answer is left out."""
    items = "".join(f"<dt>{text(name)}</dt><dd>{answer}</dd>" for name, answer in rows if answer)
    return f'<dl class="facts">{items}</dl>'


def details(title: str, body_html: str, *, opened: bool = False) -> str:
    """Return something to be opened by who wants it; nothing for an empty body."""
    state = " open" if opened else ""
    return f"<details{state}><summary>{text(title)}</summary>{body_html}</details>" if body_html else ""


def table(header: Sequence[str], rows: Iterable[Sequence[object]], caption: str = "") -> str:
    """Return a table; cells that look like numbers are right-aligned, plain text is escaped."""
    body = [[str(cell) for cell in row] for row in rows]
    numeric = [bool(body) and all(_NUMBER.fullmatch(row[j]) for row in body) for j in range(len(header))]
    kind = [' class="number"' if n else "" for n in numeric]
    head = "".join(f'<th scope="col"{k}>{text(h)}</th>' for h, k in zip(header, kind, strict=True))
    lines = "".join(
        "<tr>" + "".join(f"<td{k}>{text(c)}</td>" for c, k in zip(row, kind, strict=True)) + "</tr>"
        for row in body
    )
    above = f'<p class="soft">{text(caption)}</p>' if caption else ""
    inner = f"<thead><tr>{head}</tr></thead><tbody>{lines}</tbody>"
    label = f' aria-label="{text(caption)}"' if caption else ""
    return f'{above}<div class="scroll" tabindex="0"><table{label}>{inner}</table></div>'


_NUMBER = re.compile(
    r"\s*|[-–—]|baseline|none|[<>≤≥~]?\s*[-+−]?[\d.,]+([eE][-+]?\d+)?( ± [\d.]+)?\s*(%|s|ms|mm|m|rad)?"
)


def _svg(drawing: Any, says: str) -> str:
    import matplotlib as mpl
    from matplotlib import pyplot as plt

    stream = io.StringIO()
    prefix = uuid.uuid4().hex[:8]  # several SVGs in one page must not share ids
    with mpl.rc_context({"svg.hashsalt": prefix, "svg.fonttype": "none"}):
        drawing.savefig(stream, format="svg", bbox_inches="tight", metadata={"Date": None})
    svg = stream.getvalue()
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg[svg.index("<svg") :], flags=re.DOTALL)
    if len(svg) > HEAVY:
        pixels = io.BytesIO()
        drawing.savefig(pixels, format="png", dpi=110, bbox_inches="tight")
        data = base64.b64encode(pixels.getvalue()).decode("ascii")
        svg = f'<img alt="{text(says)}" src="data:image/png;base64,{data}">'
    else:
        svg = re.sub("|".join(THEMED), lambda found: f"var(--{THEMED[found[0]]})", svg)
        svg = svg.replace("<svg", f'<svg role="img" aria-label="{text(says)}"', 1)
    plt.close(drawing)
    return _unique_ids(svg, prefix)


def _unique_ids(svg: str, prefix: str) -> str:
    svg = re.sub(r'\bid="([^"]+)"', rf'id="{prefix}-\1"', svg)
    svg = re.sub(r'href="#([^"]+)"', rf'href="#{prefix}-\1"', svg)
    return re.sub(r"url\(#([^)]+)\)", rf"url(#{prefix}-\1)", svg)
