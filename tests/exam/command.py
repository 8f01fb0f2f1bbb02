"""The command `fieldgym exam`."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType
from typing import Annotated, Literal

import typer

from fieldagents.console import Address, DryRun, EngineName, Json, Workers, begin, print_result
from fieldagents.progress import progress

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

        fieldgym exam --cases 1000

        fieldgym exam --kind single --kind triple --fresh 7

        fieldgym exam --kind degenerate --cases 300
    """
    from exam import degenerate, table
    from exam.cases import cases_of, examined
    from exam.hostile import cases_of as hostile_cases
    from exam.run import run_cases
    from fieldagents import plan
    from fieldagents.cli import app
    from fieldmodels.engine import Engine

    by, of_faults = Engine(engine, workers, address), kind == ["degenerate"]
    tables: ModuleType = degenerate if of_faults else table
    if of_faults:
        hostile, name = hostile_cases(cases or 1000), "exam-degenerate"
        machines = ["degenerate"] * len(hostile)
    else:
        chosen = cases_of(which, machine or examined(), kind or (), cases, fresh)
        name = f"exam-{which}-{fresh}" if fresh else f"exam-{which}"
        machines = [case.machine for case in chosen]
    folder = begin(plan.of_exam(machines, out or Path("results") / name, by), dry_run, as_json)
    with progress() as report:
        if of_faults:
            rows = degenerate.run_cases(hostile, folder, app, workers=workers, progress=report)
        else:
            rows = run_cases(chosen, folder, engine=by, progress=report)
    written, found = tables.write(rows, folder), tables.summary(rows)
    if publish is not None:
        table.put(tables.markdown(found), publish)
    print_result(as_json, found, lambda _: print(written["exam.md"].read_text(encoding="utf-8")), written)
    if of_faults and found["faults"]:
        raise typer.Exit(1)
