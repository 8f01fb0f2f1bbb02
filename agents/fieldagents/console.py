"""What the commands of the line share: options, where results go, and how they are printed."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from contextvars import ContextVar
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from fieldmodels.files import claimed

if TYPE_CHECKING:
    from rich.console import Console

    from fieldagents.plan import Plan

DryRun = Annotated[
    bool, typer.Option("--dry-run", help="Say what would be done and what it takes, do and write nothing.")
]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON, alone on standard output.")]
EngineName = Annotated[
    Literal["local", "ray"],
    typer.Option("--engine", help="Who does the jobs: this machine, or a Ray cluster; results are equal."),
]
Workers = Annotated[
    int, typer.Option(help="Of `local`: processes of one thread each; 0: one job after another.", min=0)
]
ADDRESS = "Of `ray`: the cluster, as `auto` or `ray://head:10001` (default: RAY_ADDRESS, else a new one)."
Address = Annotated[str, typer.Option(help=ADDRESS)]

RESOURCES: ContextVar[ExitStack] = ContextVar("held")
"""What the running command holds until it ends."""


def announce(plan: Plan, dry_run: bool, as_json: bool) -> None:
    """Say what will be done, refuse what cannot end; end here if nothing more was asked for."""
    plan.check()
    if not dry_run:
        print_message(plan.words())
        return
    print_result(as_json, plan.to_json(), lambda _: print(plan.words()))
    raise typer.Exit


def begin(plan: Plan, dry_run: bool, as_json: bool) -> Path:
    """Announce, and claim the result folder."""
    announce(plan, dry_run, as_json)
    return claim_folder(plan.out)


def claim_folder(folder: Path) -> Path:
    """A result folder that can be written, and that nobody else writes until the command ends."""
    return RESOURCES.get().enter_context(claimed(folder))


def print_result(
    as_json: bool, data: Any, show: Callable[[Console], Any], written: Mapping[str, Path | str] | None = None
) -> None:
    """Print a result: as JSON, alone, or for a reader with the files that were written."""
    if as_json:
        print_json(data)
        return
    from rich.console import Console

    show(Console(width=None if sys.stdout.isatty() else 120, highlight=False))
    print_files(written or {})


def print_json(data: Any) -> None:
    """Print data as JSON."""
    print(json.dumps(data, indent=2, allow_nan=False))


def print_files(written: Mapping[str, Any], as_json: bool = False) -> None:
    """Print where each file is that was written."""
    if as_json:
        print_json({name: str(path) for name, path in written.items()})
        return
    for name, path in written.items():
        print(f"{name}: {path}")


def print_message(words: str) -> None:
    """Print a line to standard error."""
    print(words, file=sys.stderr, flush=True)
