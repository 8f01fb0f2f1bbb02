"""The ledger on one page, in the terminal and in the documentation."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

from fieldmodels import html
from fieldmodels.files import write_text
from papers.claim import Decided
from papers.ledger import Ledger, Outcome, Run
from papers.report import WIDTH, claims_html, show_claims

if TYPE_CHECKING:
    from rich.console import Console


def write_page(ledger: Ledger, out: Path) -> Path:
    """Write ``ledger.html``: counts, what is unexpected, then all claims with their pictures."""
    body = [f'<p class="lead">{html.text(summary(ledger))}</p>']
    odd = [one for one in ledger.claims if one.unexpected]
    if odd:
        body.append(f"<h2>Not as expected</h2>{claims_html(odd)}")
    for task, claims in groupby(ledger.claims, key=lambda one: one.task):
        body.append(f"<h2>{html.text(task)}</h2>")
        body += _sections(ledger, list(claims))
    path = out / "ledger.html"
    write_text(path, html.page("The sources' claims", "\n".join(body)))
    return path


def summary(ledger: Ledger) -> str:
    """How many claims have which verdict, in a sentence."""
    counts = ", ".join(f"{count} {verdict}" for verdict, count in ledger.counts.items())
    open_ = sum(one.verdict == "reproduced" and bool(one.claim.assumes) for one in ledger.claims)
    odd = sum(one.unexpected for one in ledger.claims)
    seconds = sum(outcome.processor_s for outcome in ledger.runs.values())
    expected = f"{odd} not as expected" if odd else "all as expected"
    kind = "quick runs" if ledger.quick else "full runs"
    return (
        f"{len(ledger.claims)} claims: {counts}; {expected}; of those reproduced {open_} "
        f"rest on an assumption of ours. {len(ledger.runs)} {kind}, "
        f"{seconds:.0f} s of processor time."
    )


def show_ledger(ledger: Ledger, console: Console) -> None:
    """Print all claims, task by task, then the summary."""
    for task, claims in groupby(ledger.claims, key=lambda one: one.task):
        console.print(task, style="bold")
        show_claims(list(claims), console)
    console.print(summary(ledger), width=WIDTH, markup=False)


def _sections(ledger: Ledger, claims: list[Decided]) -> Iterator[str]:
    """A task's claims, those that rest on the same runs together, and the pictures of these once."""
    groups: dict[tuple[Run, ...], list[Decided]] = {}
    for one in claims:
        groups.setdefault(tuple(outcome.run for outcome in ledger.outcomes(one)), []).append(one)
    shown: set[Run] = set()
    for runs, group in groups.items():
        yield claims_html(group)
        yield from (_pictures(ledger.runs[run]) for run in runs if run not in shown)
        shown.update(runs)


def _pictures(outcome: Outcome) -> str:
    images = "".join(
        f'<figure><img alt="{html.text(path.stem)}" src="data:image/png;base64,'
        f'{base64.b64encode(path.read_bytes()).decode("ascii")}"></figure>'
        for path in outcome.figures
    )
    again = f'<p class="soft"><code>{html.text(outcome.run.command)}</code>, {outcome.processor_s:.1f} s</p>'
    return again + images
