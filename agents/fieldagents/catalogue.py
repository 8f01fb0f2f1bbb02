"""What there is: tasks, agents, machines with their effects, trained policies, recordings."""

from __future__ import annotations

import hashlib
import json
import os
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fieldmodels.files import OutputError, write_text
from fieldmodels.names import did_you_mean

if TYPE_CHECKING:
    from rich.console import Console

    from fieldmodels.model import Model


class CatalogueError(ValueError):
    """Nothing has the name that was asked for."""


def catalogue() -> dict[str, Any]:
    """Everything that has a name, as plain data; kept on disk, since gathering it takes seconds."""
    home = Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser() / "fieldgym"
    path = home / f"catalogue-{_state_of_files()}.json"
    with suppress(OSError, ValueError):
        kept: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        return kept
    found = _gathered()
    with suppress(OSError, OutputError):
        for old in home.glob("catalogue-*.json"):
            old.unlink()
        write_text(path, json.dumps(found))
    return found


def own_machine(name: str) -> dict[str, Any] | None:
    """The part for a machine's Python file, or for a file of YAML that names one; None for another name.

    Raises:
        ModelError: If the file has no model, or names a Python file, which is run only if it is named itself.
    """
    from fieldmodels.drivers.named import model_named_in
    from fieldmodels.model_files import is_model_file
    from fieldmodels.registry import get_model

    if name.endswith((".yaml", ".yml")):
        name = model_named_in(name)
    elif not is_model_file(name):
        return None
    return {"tasks": [], "machines": [_described(name, get_model(name))]}


def selected(found: dict[str, Any], name: str | None, agents: bool) -> dict[str, Any]:
    """A part of a catalogue.

    Args:
        found: The catalogue.
        name: Only the task and the machine of this name.
        agents: Only the tasks' agents.

    Raises:
        CatalogueError: If nothing has the name.
    """
    tasks, machines = found["tasks"], found["machines"]
    if name is not None:
        known = list(dict.fromkeys(one["name"] for one in [*tasks, *machines]))
        if name not in known:
            raise CatalogueError(f"no task or machine {name!r}{did_you_mean(name, known)}")
        tasks, machines = ([one for one in group if one["name"] == name] for group in (tasks, machines))
    if agents:
        kept = ("name", "env_id", "description", "agents")
        return {"tasks": [{key: one[key] for key in kept} for one in tasks]}
    return {"tasks": tasks, "machines": machines} if name else found


def _state_of_files() -> str:
    """Changes with any file of the packages."""
    digest = hashlib.sha256()
    for package in ("fieldmodels", "fieldgym", "fieldagents"):
        spec = find_spec(package)
        for place in (spec and spec.submodule_search_locations) or ():
            for folder, _, names in sorted(os.walk(place)):
                for name in sorted(names):
                    if name.endswith((".py", ".json", ".onnx")):
                        status = os.stat(f"{folder}/{name}")  # noqa: PTH116 - of a thousand files
                        digest.update(f"{folder}/{name} {status.st_size} {status.st_mtime_ns}".encode())
    return digest.hexdigest()[:16]


def _gathered() -> dict[str, Any]:
    from fieldagents.evaluation.agents import describe_agents
    from fieldagents.policies.zoo import list_zoo
    from fieldgym import TASKS
    from fieldmodels.recording.datasets import dataset_names
    from fieldmodels.registry import get_model, model_names
    from fieldmodels.settings import declared

    tasks = [
        {
            "name": task.name,
            "env_id": task.env_id,
            "description": task.description,
            "agents": describe_agents(task.name),
            "settings": [
                {
                    "name": name,
                    "default": one.default,
                    "unit": one.setting.unit,
                    "range": one.range().replace("`", ""),
                    "meaning": one.setting.meaning,
                    "fixed": one.setting.fixed,
                }
                for name, one in declared(task.settings).items()
            ],
        }
        for task in TASKS.values()
    ]
    return {
        "tasks": tasks,
        "machines": [_described(name, get_model(name)) for name in model_names()],
        "zoo": [str(entry) for entry in list_zoo()],
        "datasets": list(dataset_names()),
    }


def _described(name: str, model: Model) -> dict[str, Any]:
    """A model's signals, parameters and effects."""
    signals = {"inputs": model.inputs, "outputs": model.outputs}
    return {
        "name": name,
        **{kind: [{"name": s.name, "unit": s.unit} for s in group] for kind, group in signals.items()},
        "parameters": [{"name": p.name, "unit": p.unit, "nominal": p.nominal} for p in model.parameters],
        "effects": [
            {
                "name": effect.name,
                "where": effect.where,
                "cause": effect.cause,
                "parameters": [{"name": p.name, "unit": p.unit} for p in effect.parameters],
            }
            for effect in model.effects
        ],
    }


def show(found: dict[str, Any], console: Console) -> None:
    """Print a catalogue as tables."""
    from rich.markup import escape
    from rich.table import Table

    for task in found["tasks"]:
        console.print(f"\n[bold]Task {task['name']}[/bold] ({task['env_id']}): {task['description']}")
        table = Table("agent", "sees", "what it does")
        for agent in task["agents"]:
            table.add_row(agent["name"], agent["sees"], escape(agent["title"]))
        console.print(table)
        if "settings" not in task:
            continue
        table = Table("setting", "default", "range")
        for one in task["settings"]:
            table.add_row(one["name"], f"{one['default']} {one['unit']}".rstrip(), one["range"])
        console.print(table)
    for model in found.get("machines", ()):
        units = {
            kind: ", ".join(f"{s['name']} {_unit(s)}" for s in model[kind]) for kind in ("inputs", "outputs")
        }
        console.print(
            f"\n[bold]Machine {model['name']}[/bold]: {units['inputs'] or 'no input'} → {units['outputs']}"
        )
        table = Table("parameter", "unit", "nominal")
        for one in model["parameters"]:
            table.add_row(one["name"], escape(one["unit"]), f"{one['nominal']:g}")
        console.print(table)
        table = Table("effect", "where", "parameters", "cause")
        for effect in model["effects"]:
            names = ", ".join(f"{p['name']} {_unit(p)}" for p in effect["parameters"])
            table.add_row(effect["name"], effect["where"], names, effect["cause"])
        console.print(table)
    if "zoo" not in found:
        return
    console.print("\n[bold]Trained policies[/bold]: " + (", ".join(found["zoo"]) or "none"))
    console.print("[bold]Public recordings[/bold]: " + (", ".join(found["datasets"]) or "none"))


def _unit(item: dict[str, Any]) -> str:
    return f"\\[{item['unit']}]"
