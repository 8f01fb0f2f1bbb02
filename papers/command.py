"""The command `fieldgym reproduce`."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fieldagents.console import Address, DryRun, EngineName, Json, Workers, begin, print_result
from fieldagents.progress import progress
from fieldmodels.files import write_text

if TYPE_CHECKING:
    from fieldmodels.engine import Engine


def _names(incomplete: str) -> list[str]:
    from papers.run import reproducible

    return [name for name in reproducible() if name.startswith(incomplete) and " " not in name]


def reproduce(
    what: Annotated[
        str | None,
        typer.Argument(
            metavar="[WHAT]",
            help="A table or figure; without it all are listed. With --all: a task.",
            autocompletion=_names,
        ),
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="OPTION=VALUE", help="Change an option of it; repeatable."),
    ] = None,
    everything: Annotated[
        bool, typer.Option("--all", help="Decide every claim of the sources, or of one task's source.")
    ] = False,
    quick: Annotated[bool, typer.Option("--quick", help="With --all: fewer samples.")] = False,
    out: Annotated[
        Path | None,
        typer.Option(help="Result folder (default: `results/reproduce/<what>`, `results/ledger`)."),
    ] = None,
    engine: EngineName = "local",
    workers: Workers = 0,
    address: Address = "",
    dry_run: DryRun = False,
    as_json: Json = False,
) -> None:
    """Redo a table or figure of the sources beside ours, or decide all that the sources claim.

    A table or figure gives `table.csv`, `report.html` and its figures as PNG and CSV. `--all` gives
    `ledger.html` and `ledger.json`: each claim with its verdict, the printed value, and ours with its
    interval. What was done before with the same code and options is not done again. The exit code is 1 if a
    run failed or a verdict is not the expected one.

    For example:

        fieldgym reproduce

        fieldgym reproduce heel_strike/figure-2.12

        fieldgym reproduce heel_strike/figure-2.14 --set strides=1000 --json

        fieldgym reproduce --all --quick

        fieldgym reproduce --all heel_strike
    """
    from fieldagents import plan
    from fieldmodels.engine import Engine
    from papers import report as pages
    from papers import run as room

    by = Engine(engine, workers, address)
    if everything:
        if overrides:
            raise room.ReproductionError("--set goes with a single table or figure, not with --all")
        out = out or Path("results") / ("ledger-quick" if quick else "ledger")
        _decide_all(what, quick, out, by, dry_run, as_json)
    elif quick:
        raise room.ReproductionError("--quick goes with --all; a single table or figure takes --set")
    elif what is None:
        known = room.reproducible()
        entries = [{"name": n, "title": one.title, "options": one.options} for n, one in known.items()]
        print_result(as_json, {"entries": entries}, partial(pages.show_reproducible, known))
    else:
        out = out or Path("results") / "reproduce" / what
        took = room.known_entry(what).processor_s
        planned = plan.of_reproduction(1, [took[0] if took else None], out, by)
        folder = begin(planned, dry_run, as_json)
        with progress() as report:
            result = room.reproduce(what, folder, overrides or [], report)
        data, written = pages.to_json(result, folder), pages.written(result, folder)
        print_result(as_json, data, partial(pages.show, result), written)


def _decide_all(
    task: str | None, quick: bool, out: Path, engine: Engine, dry_run: bool, as_json: bool
) -> None:
    """Decide the claims of all sources, or of one task's."""
    from fieldagents import plan
    from papers import ledger as books
    from papers.pages import show_ledger, write_page

    out = begin(plan.of_reproduction(*books.left(out, task, quick), out, engine), dry_run, as_json)
    with progress() as report:
        ledger = books.decide(out, task, quick=quick, engine=engine, progress=report)
    data = books.as_data(ledger) | {"files": {"ledger.html": str(write_page(ledger, out))}}
    write_text(out / "ledger.json", json.dumps(data, indent=1, allow_nan=False))
    print_result(as_json, data, partial(show_ledger, ledger), data["files"])
    if not ledger.good:
        raise typer.Exit(1)
