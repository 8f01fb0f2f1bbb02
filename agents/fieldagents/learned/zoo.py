"""The trained policies that come with the package, with everything that says where they come from.

An entry is a folder ``zoo/<task>/<name>/``: one ``policy_seed<N>.onnx`` for each training run (the unit of
replication), ``card.json`` (config, versions, commit, steps, seeds, scores) and ``curve.csv``.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fieldagents.learned.policy import OnnxAgent
from fieldmodels.model import did_you_mean

ZOO = Path(__file__).parent.parent / "zoo"


class ZooError(ValueError):
    """No such entry, or a damaged one."""


@dataclass(frozen=True)
class ZooEntry:
    """A trained policy, once for each training run.

    Attributes:
        task: Name of the task.
        name: Name of the entry, such as ``ppo``.
        folder: Where it lies.
        card: What ``card.json`` says.
    """

    task: str
    name: str
    folder: Path
    card: dict[str, Any]

    @property
    def title(self) -> str:
        """One line that says what it is."""
        return str(self.card["title"])

    @property
    def seeds(self) -> tuple[int, ...]:
        """Seeds of the training runs."""
        return tuple(run["seed"] for run in self.card["runs"])

    def agents(self) -> tuple[OnnxAgent, ...]:
        """The policies of all training runs, in the order of `seeds`."""
        return tuple(
            OnnxAgent(self.folder / run["policy"], name=self.name, title=self.title)
            for run in self.card["runs"]
        )

    def __str__(self) -> str:
        return f"{self.task}/{self.name}"


def list_zoo(task: str | None = None, folder: Path = ZOO) -> tuple[ZooEntry, ...]:
    """The entries of one task, or of all.

    Raises:
        ZooError: If a card cannot be read.
    """
    entries = []
    for path in sorted(folder.glob(f"{task or '*'}/*/card.json")):
        try:
            card = json.loads(path.read_text(encoding="utf-8"))
            entry = ZooEntry(path.parent.parent.name, path.parent.name, path.parent, card)
            _ = entry.title, entry.seeds
        except (ValueError, KeyError, TypeError) as error:
            raise ZooError(f"{path}: not the card of a zoo entry: {error!r}") from None
        entries.append(entry)
    return tuple(entries)


def get_entry(task: str, name: str) -> ZooEntry:
    """The entry of a task by its name.

    Raises:
        ZooError: If there is none; names similar ones.
    """
    entries = {entry.name: entry for entry in list_zoo(task)}
    if name not in entries:
        raise ZooError(f"the zoo has no {name!r} for {task!r}{did_you_mean(name, entries)}")
    return entries[name]


def load(task: str, name: str, run: int = 0) -> OnnxAgent:
    """The policy of one training run (the first unless asked otherwise).

    Raises:
        ZooError: If there is no such entry or run.
    """
    entry = get_entry(task, name)
    agents = entry.agents()
    if not 0 <= run < len(agents):
        raise ZooError(f"{entry}: there are {len(agents)} training runs, so run is 0 to {len(agents) - 1}")
    return agents[run]
