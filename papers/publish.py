"""Write `papers/ledger.md` and its summary `docs/ledger.md`, from the claims and the last full run's numbers.

    python -m papers.publish [results/ledger/ledger.json]

With a result of `fieldgym reproduce --all` its numbers are kept in `ledger.json` beside this file; claims
that it does not hold keep those that they have.
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from matplotlib import rc_context
from matplotlib.figure import Figure

from fieldmodels.files import write_text
from fieldmodels.html import AMBER, BEFORE, GREEN, GREY, INK, PURPLE
from fieldmodels.rounding import words
from papers.claim import Claim, Decided, Statistic
from papers.ledger import claims_of
from papers.source import all_sources

FOLDER = Path(__file__).parent
NUMBERS = FOLDER / "ledger.json"
DOCS = FOLDER.parent / "docs"
COLOURS = {
    "reproduced": GREEN,
    "depends": AMBER,
    "refuted": BEFORE,
    "undecided": PURPLE,
    "not computable": GREY,
}

MEANING = """- *reproduced*: the 95 % interval of our number lies within what the claim allows
- *refuted*: it lies outside
- *depends*: readings of an ambiguous text disagree
- *not computable*: a photograph, a drawing or a measurement on the authors' hardware
"""
INTRODUCTION = f"""# The sources' claims

Every claim of the sources with the number that comes out here; written by `python -m papers.publish` from
the last full `fieldgym reproduce --all`.

{MEANING}
![Claims of each task by verdict](../docs/pictures/ledger.svg)

"""
SUMMARY = f"""# The sources' claims

![Claims of each task by verdict](pictures/ledger.svg)

`fieldgym reproduce --all` recomputes what the two sources claim: tables, figures, numbers in the text and
algorithms. It runs in a checkout alone. Every claim, the printed value and ours are in `papers/ledger.md` of
the repository.

{MEANING}
"""


def decided() -> list[Decided]:
    """Every claim with the numbers that are kept."""
    numbers = json.loads(NUMBERS.read_text(encoding="utf-8"))
    return [_decided(task, claim, numbers.get(f"{task}/{claim.name}", {})) for task, claim in claims_of()]


def draw(claims: Iterable[Decided], path: Path) -> None:
    """Draw how many claims of each task have which verdict."""
    counts = Counter((one.task, verdict_of(one)) for one in claims)
    tasks = [*all_sources()][::-1]
    figure = Figure(figsize=(8, 2.6), layout="constrained")
    axes, left = figure.subplots(), [0] * len(tasks)
    for verdict, colour in COLOURS.items():
        widths = [counts[task, verdict] for task in tasks]
        if any(widths):
            ink = "white" if colour == GREY else INK
            bars = axes.barh([words(task) for task in tasks], widths, left=left, color=colour, label=verdict)
            axes.bar_label(bars, [str(n or "") for n in widths], label_type="center", fontsize=8, color=ink)
            left = [a + b for a, b in zip(left, widths, strict=True)]
    axes.set_xlabel("claims")
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(axis="y", length=0)
    figure.legend(frameon=False, ncols=len(COLOURS), loc="outside upper left")
    with rc_context({"svg.hashsalt": "ledger"}):
        figure.savefig(path, metadata={"Date": None}, facecolor="white")


def page() -> str:
    """The Markdown page: a table for each task."""
    claims = decided()
    counts = Counter(verdict_of(one) for one in claims)
    parts = [
        INTRODUCTION,
        f"**{len(claims)} claims**: {', '.join(f'{n} {v}' for v, n in counts.most_common())}. "
        f"{_assumed(claims)}\n\n{_figures(claims)}\n",
    ]
    for task in all_sources():
        rows = [one for one in claims if one.task == task]
        if rows:
            parts.append(
                f"\n## {task}\n\n| verdict | where | claim | printed | ours |\n|---|---|---|---|---|\n"
            )
            parts += map(_row, rows)
    return "".join(parts)


def summary() -> str:
    """The page of the documentation: how many claims of each task have which verdict."""
    claims = decided()
    counts = Counter((one.task, verdict_of(one)) for one in claims)
    verdicts = [one for one in COLOURS if any(counts[task, one] for task in all_sources())]
    rows = [[task, *(counts[task, one] for one in verdicts)] for task in all_sources()]
    rows.append(["all", *(sum(counts[task, one] for task in all_sources()) for one in verdicts)])
    lines = [f"| task | {' | '.join(verdicts)} |", "|---" * (len(verdicts) + 1) + "|"]
    lines += [f"| {' | '.join(map(str, row))} |" for row in rows]
    return "\n".join([SUMMARY + lines[0], *lines[1:], "", f"{_assumed(claims)} {_figures(claims)}", ""])


def _assumed(claims: Iterable[Decided]) -> str:
    """How many claims are reproduced as printed, and how many under an assumption, in a sentence."""
    found = [bool(one.claim.assumes) for one in claims if verdict_of(one) == "reproduced"]
    return (
        f"Of those reproduced {found.count(False)} are decided by what is printed, {found.count(True)} under "
        "an assumption that is stated."
    )


def _figures(claims: Iterable[Decided]) -> str:
    """How many of the sources' numbered figures and tables are decided, in a sentence."""
    verdicts: dict[tuple[str, str], set[str]] = {}
    for one in claims:
        for place in one.claim.where:
            if place.startswith(("Fig ", "Table ")):
                verdicts.setdefault((one.task, place), set()).add(verdict_of(one))
    idle = sum(found == {"not computable"} for found in verdicts.values())
    open_ = sum(bool(found & {"undecided", "failed"}) for found in verdicts.values())
    return (
        f"Of {len(verdicts)} figures and tables {len(verdicts) - idle} hold something to compute; of these "
        f"{len(verdicts) - idle - open_} are decided."
    )


def verdict_of(one: Decided) -> str:
    """The verdict, or the expected one where no number has been kept."""
    known = one.claim.because or all(one.measured.values())
    words = one.words if known else one.claim.expected
    return words if not words.startswith("depends") else "depends"


def _decided(task: str, claim: Claim, kept: dict[str, list[float]]) -> Decided:
    measured = {name: Statistic(*kept[name]) if name in kept else None for name in claim.readings}
    return Decided(claim, task, measured)


def _row(one: Decided) -> str:
    claim, verdict = one.claim, verdict_of(one)
    if verdict == "depends":
        verdict = f"depends on {claim.depends_on}"
    says = " ".join(
        text for text in (claim.says, f"*{claim.because}*" * bool(claim.because), claim.comment) if text
    )
    printed = "; ".join(
        text for text in (claim.printed, claim.condition and f"holds: {claim.condition}") if text
    )
    cells = (f"**{verdict}**", ", ".join(claim.where), says, printed, "; ".join(_ours(one)))
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |\n"


def _ours(one: Decided) -> Iterator[str]:
    for name, ours in one.claim.readings.items():
        options = "".join(f" --set {key}={value}" for key, value in ours.options.items())
        number = one.measured[name]
        yield f"{name or ours.statistic}: {number or 'not run yet'} (`{ours.run}{options}`)"


def keep(claims: Iterable[dict[str, Any]]) -> None:
    """Keep the numbers of a full run for the page."""
    numbers = json.loads(NUMBERS.read_text(encoding="utf-8"))
    for claim in claims:
        found = {
            one["reading"]: [one[key] for key in ("value", "low", "high")]
            for one in claim["ours"]
            if "value" in one
        }
        if found:
            numbers[claim["name"]] = found
    known = {f"{task}/{claim.name}": set(claim.readings) for task, claim in claims_of()}
    kept = {name: one for name, one in sorted(numbers.items()) if set(one) == known.get(name)}
    lines = ",\n".join(f"{json.dumps(name)}: {json.dumps(one)}" for name, one in kept.items())
    write_text(NUMBERS, f"{{\n{lines}\n}}\n")


if __name__ == "__main__":
    if len(sys.argv) > 1:
        result = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
        if result["quick"]:
            raise SystemExit(f"{sys.argv[1]} is of quick runs; give the result of a full one")
        keep(result["claims"])
    write_text(FOLDER / "ledger.md", page())
    write_text(DOCS / "ledger.md", summary())
    draw(decided(), DOCS / "pictures" / "ledger.svg")
