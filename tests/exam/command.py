"""The command `fieldgym exam`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from fieldagents.console import Address, DryRun, EngineName, Json, Workers, begin, print_result
from fieldagents.progress import progress

if TYPE_CHECKING:
    from fieldmodels.engine import Engine

_SET = "Cases to develop a diagnosis on, or to report on; they have nothing in common."
_FRESH = "Draw other cases than the published ones, which nobody has seen: any number of yours."
_KIND = """`nothing`, `single`, `pair`, `triple`, `unlisted`, `mixed`, `growing` or `log`; repeatable
(default: all). Or `degenerate`: hostile and unlucky input to every command."""


def _machines(incomplete: str) -> list[str]:
    from exam.cases import examined

    return [name for name in examined() if name.startswith(incomplete)]


def exam(
    which: Annotated[Literal["develop", "report"], typer.Option("--set", help=_SET)] = "report",
    machine: Annotated[
        list[str] | None,
        typer.Option(help="Machine to examine; repeatable (default: all).", autocompletion=_machines),
    ] = None,
    kind: Annotated[list[str] | None, typer.Option(help=_KIND)] = None,
    cases: Annotated[
        int | None, typer.Option(help="How many at most, a sample of all (default: all).", min=1)
    ] = None,
    fresh: Annotated[int, typer.Option(metavar="NUMBER", help=_FRESH, min=0)] = 0,
    engine: EngineName = "local",
    workers: Workers = 2,
    address: Address = "",
    out: Annotated[Path | None, typer.Option(help="Result folder (default: `results/exam-<set>`).")] = None,
    publish: Annotated[
        Path | None, typer.Option(metavar="PAGE", help="Page of Markdown to put the rates into.")
    ] = None,
    dry_run: DryRun = False,
    as_json: Json = False,
) -> None:
    """Hide faults in simulated data and count how often the diagnosis is right.

    The data are simulated by code that shares nothing with the models. Writes `cases.jsonl` (a line a case,
    as it comes: an interrupted run goes on), `exam.json`, `exam.md`, `report.html`.

    For example:

        fieldgym exam

        fieldgym exam --set develop --machine rig --cases 20

        fieldgym exam --set develop --kind unlisted --kind nothing --workers 1

        fieldgym exam --cases 1000 --publish docs/exam.md

        fieldgym exam --kind single --kind triple --fresh 7

        fieldgym exam --kind degenerate --cases 300
    """
    from fieldagents import plan
    from fieldmodels.engine import Engine

    if kind == ["degenerate"]:
        _degenerate(cases or 1000, Engine(workers=workers), out, publish, dry_run, as_json)
        return
    from exam import table
    from exam.cases import cases_of, examined
    from exam.run import run_cases

    chosen = cases_of(which, machine or examined(), kind or (), cases, fresh)
    name = f"exam-{which}-{fresh}" if fresh else f"exam-{which}"
    by, out = Engine(engine, workers, address), out or Path("results") / name
    folder = begin(plan.of_exam([case.machine for case in chosen], out, by), dry_run, as_json)
    with progress() as report:
        rows = run_cases(chosen, folder, engine=by, progress=report)
    written, found = table.write(rows, folder), table.summary(rows)
    if publish is not None:
        table.publish(found, publish)
    print_result(as_json, found, lambda _: print(written["exam.md"].read_text(encoding="utf-8")), written)


def _degenerate(
    count: int, engine: Engine, out: Path | None, publish: Path | None, dry_run: bool, as_json: bool
) -> None:
    """Examine what becomes of hostile and unlucky input."""
    from exam import degenerate
    from exam.hostile import cases_of
    from exam.table import put
    from fieldagents import plan
    from fieldagents.cli import app

    planned = plan.of_exam(["degenerate"] * count, out or Path("results") / "exam-degenerate", engine)
    folder = begin(planned, dry_run, as_json)
    with progress() as report:
        rows = degenerate.run_cases(cases_of(count), folder, app, workers=engine.workers, progress=report)
    written, found = degenerate.write(rows, folder), degenerate.summary(rows)
    if publish is not None:
        put(degenerate.markdown(found), publish)
    print_result(as_json, found, lambda _: print(written["exam.md"].read_text(encoding="utf-8")), written)
    if found["faults"]:
        raise typer.Exit(1)
