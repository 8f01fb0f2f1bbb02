"""The command `fieldgym exam`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from fieldagents.console import Address, DryRun, EngineName, Json, Workers, begin, print_result
from fieldagents.progress import progress

if TYPE_CHECKING:
    from fieldmodels.engine import Engine

_SET = """Cases to develop a diagnosis on, or to report on; they have nothing in common. `field` and
`field-report`: the same of logs as the field has them."""
_BY = "Who answers: the diagnosis, its search by evidence, or a rival, which is set beside the diagnosis."
_FRESH = "Draw other cases than the published ones, which nobody has seen: any number of yours."
_KIND = """`nothing`, `single`, `pair`, `triple`, `unlisted`, `mixed`, `growing` or `log`, or a kind of the
field set; repeatable (default: all). Or `degenerate`: hostile and unlucky input to every command."""
_OUT = "Result folder (default: `results/exam-<set>`)."


def _machines(incomplete: str) -> list[str]:
    from exam.cases import examined
    from exam.field.plants import PLANTS

    return [name for name in dict.fromkeys([*examined(), *PLANTS]) if name.startswith(incomplete)]


def exam(
    which: Annotated[
        Literal["develop", "report", "field", "field-report"], typer.Option("--set", help=_SET)
    ] = "report",
    by: Annotated[Literal["diagnosis", "evidence", "forward", "sindy"], typer.Option(help=_BY)] = "diagnosis",
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
    out: Annotated[Path | None, typer.Option(help=_OUT)] = None,
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

        fieldgym exam --cases 300

        fieldgym exam --set field-report --by forward

        fieldgym exam --set develop --machine rig --kind unlisted --kind nothing --workers 1

        fieldgym exam --kind degenerate --cases 300
    """
    from exam import sets, table
    from fieldagents import plan
    from fieldmodels.engine import Engine
    from fieldmodels.model import ModelError

    asked, kinds = Engine(engine, workers, address), kind or []
    if "degenerate" in kinds:
        if len(kinds) > 1 or machine or fresh or by != "diagnosis":
            raise ModelError("--kind degenerate: leave out other kinds, --machine, --fresh and --by")
        _degenerate(cases or 1000, out or Path("results/exam-degenerate"), asked, publish, dry_run, as_json)
        return
    machines, run = sets.chosen(which, by, machine or [], kinds, cases, fresh)
    own = Path("results") / (f"exam-{which}-{fresh}" if fresh else f"exam-{which}")
    out = out or (own if by == "diagnosis" else own.with_name(f"{own.name}-{by}"))
    folder = begin(plan.of_exam(machines, out, asked), dry_run, as_json)
    with progress() as report:
        rows = run(out=folder, engine=asked, progress=report)
    written, found = table.write(rows, folder), table.summary(rows)
    text = sets.published(rows) if by == "diagnosis" else sets.beside(by, rows, own / "cases.jsonl")
    if publish is not None:
        table.put(text, publish, f"{which} by {by}")
    print_result(as_json, found, lambda _: print(*table.notes_of(found), "", text, sep="\n"), written)


def _degenerate(
    count: int, out: Path, engine: Engine, publish: Path | None, dry_run: bool, as_json: bool
) -> None:
    from exam import degenerate, hostile, table
    from fieldagents import plan
    from fieldagents.cli import app

    folder = begin(plan.of_exam(["degenerate"] * count, out, engine), dry_run, as_json)
    with progress() as report:
        rows = degenerate.run_cases(
            hostile.cases_of(count), folder, app, workers=max(engine.workers, 1), progress=report
        )
    written, found = degenerate.write(rows, folder), degenerate.summary(rows)
    text = degenerate.markdown(found)
    if publish is not None:
        table.put(text, publish)
    print_result(as_json, found, lambda _: print(text), written)
    if found["faults"]:
        raise typer.Exit(1)
