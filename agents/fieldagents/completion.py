"""What a shell offers for a word that is begun: names of the catalogue and of shipped configs."""

from __future__ import annotations

import re
from collections.abc import Iterable

import typer


def _begun(names: Iterable[str], word: str) -> list[str]:
    return [name for name in dict.fromkeys(names) if name.startswith(word)]


def _named(kind: str, word: str) -> list[str]:
    from fieldagents.catalogue import catalogue

    return _begun((one if isinstance(one, str) else one["name"] for one in catalogue()[kind]), word)


def machines(incomplete: str) -> list[str]:
    """Machines."""
    from fieldmodels.registry import model_names

    return _begun(model_names(), incomplete)


def tasks(incomplete: str) -> list[str]:
    """Tasks."""
    return _named("tasks", incomplete)


def tasks_and_machines(incomplete: str) -> list[str]:
    """What ``fieldgym list`` takes."""
    return _begun([*tasks(incomplete), *machines(incomplete)], incomplete)


def agents(ctx: typer.Context, incomplete: str) -> list[str]:
    """Agents of the task that the line names, of every task where it names none."""
    from fieldagents.catalogue import catalogue

    found = catalogue()["tasks"]
    given = {ctx.params.get("task"), *ctx.args}  # what precedes an option without its value stays in args
    chosen = [task for task in found if task["name"] in given] or found
    return _begun((agent["name"] for task in chosen for agent in task["agents"]), incomplete)


def configs(ctx: typer.Context, incomplete: str) -> list[str]:
    """Shipped configs of the kind that the command takes."""
    from fieldagents.config import shipped_configs

    folder = shipped_configs()
    names = {str(path.relative_to(folder).with_suffix("")): path for path in sorted(folder.rglob("*.yaml"))}
    takes = TAKES.get(ctx.command.name or "", ())

    def fits(name: str) -> bool:
        found = re.search(r"schema/(\w+)\.json", names[name].read_text(encoding="utf-8"))
        return (found[1] if found else "train") in takes

    return [name for name in _begun(names, incomplete) if fits(name)]


TAKES = {
    "train": ("train",), "evaluate": ("evaluate", "suite", "realities"), "sweep": ("sweep", "tune"),
    "record": ("record",), "diagnose": ("retune",),
}  # fmt: skip
"""Command to the kinds of config that it takes, as the configs' first lines name them."""


def recordings(incomplete: str) -> list[str]:
    """Public recordings; where none fits, a shell offers files."""
    return _named("datasets", incomplete)
