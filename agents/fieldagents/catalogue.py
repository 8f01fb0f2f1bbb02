"""What there is: tasks, agents, models with their effects, trained policies, recordings, reproductions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console


def catalogue() -> dict[str, Any]:
    """Everything that has a name, as plain data."""
    from fieldagents.evaluation.agents import describe_agents
    from fieldagents.policies.zoo import list_zoo
    from fieldagents.reproduce import reproducible
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
    models = []
    for name in model_names():
        model = get_model(name)
        signals = {"inputs": model.inputs, "outputs": model.outputs}
        models.append(
            {
                "name": name,
                **{
                    kind: [{"name": s.name, "unit": s.unit} for s in group] for kind, group in signals.items()
                },
                "parameters": [
                    {"name": p.name, "unit": p.unit, "nominal": p.nominal} for p in model.parameters
                ],
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
        )
    return {
        "tasks": tasks,
        "models": models,
        "zoo": [str(entry) for entry in list_zoo()],
        "datasets": list(dataset_names()),
        "reproductions": list(reproducible()),
    }


def show(found: dict[str, Any], console: Console) -> None:
    """Print a catalogue as tables."""
    from rich.table import Table

    for task in found["tasks"]:
        console.print(f"\n[bold]Task {task['name']}[/bold] ({task['env_id']}): {task['description']}")
        table = Table("agent", "sees", "what it does")
        for agent in task["agents"]:
            table.add_row(agent["name"], agent["sees"], agent["title"])
        console.print(table)
        table = Table("setting", "default", "range")
        for one in task["settings"]:
            table.add_row(one["name"], f"{one['default']} {one['unit']}".rstrip(), one["range"])
        console.print(table)
    for model in found["models"]:
        units = {
            kind: ", ".join(f"{s['name']} {_unit(s)}" for s in model[kind]) for kind in ("inputs", "outputs")
        }
        console.print(
            f"\n[bold]Model {model['name']}[/bold]: {units['inputs'] or 'no input'} → {units['outputs']}"
        )
        table = Table("effect", "where", "parameters", "cause")
        for effect in model["effects"]:
            names = ", ".join(f"{p['name']} {_unit(p)}" for p in effect["parameters"])
            table.add_row(effect["name"], effect["where"], names, effect["cause"])
        console.print(table)
    console.print("\n[bold]Trained policies[/bold]: " + (", ".join(found["zoo"]) or "none"))
    console.print("[bold]Public recordings[/bold]: " + (", ".join(found["datasets"]) or "none"))
    console.print("[bold]Reproductions[/bold]: " + ", ".join(found["reproductions"]))


def _unit(item: dict[str, Any]) -> str:
    return f"\\[{item['unit']}]"
