"""JSON Schemas of the configs, by which editors check and complete them.

``python -m fieldagents.schema`` writes them anew beside the shipped configs.
"""

from __future__ import annotations

import inspect
import json
import re
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from fieldagents.config import Config, shipped_configs
from fieldgym import TASKS
from fieldmodels.files import write_text
from fieldmodels.names import did_you_mean
from fieldmodels.registry import model_names
from fieldmodels.settings import declared

KINDS = {
    "train": "fieldagents.learned.config:TrainConfig",
    "evaluate": "fieldagents.evaluation.config:EvaluateConfig",
    "suite": "fieldagents.evaluation.suite:SuiteConfig",
    "sweep": "fieldagents.sweep.config:SweepConfig",
    "tune": "fieldagents.sweep.config:TuneConfig",
    "record": "fieldagents.record.config:RecordConfig",
    "retune": "fieldagents.retune.config:RetuneConfig",
    "realities": "fieldagents.retune.config:RealitiesConfig",
}
"""Where the config of each kind is."""

OTHERS = r"\.(yaml|yml|py)(:\w+)?$|-v\d+$|^[A-Za-z_][\w.]*:"
"""A task that is none of the package's: a file, or an environment that Gymnasium makes."""


class SchemaError(ValueError):
    """No such kind of config."""


def schema(kind: str) -> dict[str, Any]:
    """The JSON Schema of a kind of config.

    Args:
        kind: One of ``KINDS``.

    Raises:
        SchemaError: If there is no such kind.
    """
    if kind not in KINDS:
        raise SchemaError(
            f"there is no kind of config {kind!r}{did_you_mean(kind, KINDS)}; there are {', '.join(KINDS)}"
        )
    config: type[Config] = resolve_name(KINDS[kind])
    found = config.model_json_schema()
    for model in (found, *found.get("$defs", {}).values()):
        words = _attributes(model.get("description", ""))
        for name, field in model.get("properties", {}).items():
            if name in words:
                field.setdefault("description", words[name])
        if "description" in model:
            model["description"] = inspect.cleandoc(model["description"]).split("\n")[0]
    if "task" in found["properties"]:
        names = {"enum": sorted({*TASKS, *model_names()})}
        found["properties"]["task"]["anyOf"] = [names, {"pattern": OTHERS}]
        found["allOf"] = [_of_task(name, found["properties"]) for name in TASKS]
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **found}


def _of_task(task: str, properties: dict[str, Any]) -> dict[str, Any]:
    """What holds of the settings where a config names a task."""
    known = {
        name: {"description": f"{one.setting.meaning} {one.range().replace('`', '')}"}
        for name, one in declared(TASKS[task].settings).items()
    }
    settings = {"properties": known, "additionalProperties": False}
    environment = {"properties": {"settings": settings}}
    places = {
        "settings": settings,
        "environment": environment,
        "environments": {"additionalProperties": environment},
        "also": {"items": environment},
    }
    then = {name: place for name, place in places.items() if name in properties}
    return {"if": {"properties": {"task": {"const": task}}}, "then": {"properties": then}}


def _attributes(docstring: str) -> dict[str, str]:
    """What a docstring says of each attribute."""
    _, _, section = inspect.cleandoc(docstring).partition("Attributes:\n")
    entries = re.findall(r"^ {4}(\w+): (.*(?:\n {8}.*)*)", section, re.MULTILINE)
    return {name: " ".join(words.split()) for name, words in entries}


def write(folder: Path) -> None:
    """Write all schemas, ``<kind>.json`` each."""
    for kind in KINDS:
        write_text(folder / f"{kind}.json", json.dumps(schema(kind), indent=1) + "\n")


if __name__ == "__main__":
    write(shipped_configs() / "schema")
