"""The trained policies that come with the package, with everything that says where they come from.

``zoo/<task>/<name>/<scenario>/`` holds one ``policy_seed<N>.onnx`` for each training run (the unit of
replication), ``card.json`` (config, versions, commit, steps, seeds, scores) and ``curve.csv``. One name can
be trained in several scenarios, as the reference agents are tuned in each; the settings decide who acts.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from fieldagents.agent import Sees
from fieldagents.policies.policy import OnnxAgent
from fieldgym import find_task
from fieldmodels.names import did_you_mean

ZOO = Path(__file__).parent.parent / "zoo"


class ZooError(ValueError):
    """No such entry, or a damaged one."""


@dataclass(frozen=True)
class Training:
    """What was trained in one scenario: a policy for each training seed.

    Attributes:
        task: Name of the task.
        name: Name of the entry it belongs to.
        folder: Where it lies.
        card: What ``card.json`` says.
    """

    task: str
    name: str
    folder: Path
    card: dict[str, Any]

    @property
    def seeds(self) -> tuple[int, ...]:
        """Seeds of the training runs."""
        return tuple(run["seed"] for run in self.card["runs"])

    def policy(self, seed: int) -> Path:
        """The file of the policy of a training seed."""
        (run,) = (run for run in self.card["runs"] if run["seed"] == seed)
        return _intact(self.folder / run["policy"], run)

    @property
    def settings(self) -> dict[str, Any]:
        """Settings of the environment that it was trained in; what is not named had its default."""
        return dict(self.card["config"]["environment"]["settings"])

    def agents(self) -> tuple[OnnxAgent, ...]:
        """The policies of all training runs, in the order of `seeds`."""
        made = tuple(
            OnnxAgent(_intact(self.folder / run["policy"], run), name=self.name, title=self.card["title"])
            for run in self.card["runs"]
        )
        for agent in made:
            agent.settings = {key: self.settings[key] for key in self.card.get("asks", ())}
        return made

    def distance(self, settings: Mapping[str, Any]) -> int:
        """How many of the task's settings differ from those of the training; one that it drew never does."""
        kind = TypeAdapter(find_task(self.task).settings)
        drawn = {key for key, value in self.settings.items() if isinstance(value, Mapping)}
        fixed = {key: value for key, value in self.settings.items() if key not in drawn}
        mine, asked = (kind.dump_python(kind.validate_python(dict(one))) for one in (fixed, settings))
        return sum(mine[key] != asked[key] for key in mine if key not in drawn)

    def __str__(self) -> str:
        return f"{self.task}/{self.name}/{self.folder.name}"


def _intact(path: Path, run: Mapping[str, Any]) -> Path:
    """The file of a policy, which is that of its card.

    Raises:
        ZooError: If it is missing or another one.
    """
    try:
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise ZooError(f"{path}: cannot be read: {error.strerror}") from None
    if digest != run.get("sha256"):
        raise ZooError(f"{path}: not the policy that its card describes (checksum); install fieldgym anew")
    return path


@dataclass(frozen=True)
class ZooEntry:
    """A learned agent, trained in one or several scenarios.

    Attributes:
        task: Name of the task.
        name: Name of the entry, such as ``ppo``.
        trainings: One for each scenario.
    """

    task: str
    name: str
    trainings: tuple[Training, ...]

    @property
    def title(self) -> str:
        """One line that says what it is."""
        return str(self.trainings[0].card["title"])

    @property
    def sees(self) -> Sees:
        """What its policies may see."""
        config = self.trainings[0].card["config"]
        return "diagnosis" if config.get("conditioned", config.get("told")) else "observation"

    def agents(self, settings: Mapping[str, Any] | None = None) -> tuple[OnnxAgent, ...]:
        """The policies of all training runs in the scenario that is most like the settings."""
        return self.nearest(settings or {}).agents()

    def nearest(self, settings: Mapping[str, Any]) -> Training:
        """The training in the scenario that is most like the settings."""
        return min(self.trainings, key=lambda training: training.distance(settings))

    def __str__(self) -> str:
        return f"{self.task}/{self.name}"


def list_zoo(task: str | None = None, folder: Path = ZOO) -> tuple[ZooEntry, ...]:
    """The entries of one task, or of all.

    Raises:
        ZooError: If a card cannot be read.
    """
    found: dict[tuple[str, str], list[Training]] = {}
    for path in sorted(folder.glob(f"{task or '*'}/*/*/card.json")):
        name, of_task = path.parts[-3], path.parts[-4]
        try:
            card = json.loads(path.read_text(encoding="utf-8"))
            training = Training(of_task, name, path.parent, card)
            _ = card["title"], training.seeds, training.settings
        except (ValueError, KeyError, TypeError) as error:
            raise ZooError(f"{path}: not the card of a zoo entry: {error!r}") from None
        found.setdefault((of_task, name), []).append(training)
    return tuple(ZooEntry(of_task, name, tuple(group)) for (of_task, name), group in found.items())


def get_entry(task: str, name: str) -> ZooEntry:
    """The entry of a task by its name.

    Raises:
        ZooError: If there is none; names similar ones.
    """
    entries = {entry.name: entry for entry in list_zoo(task)}
    if name not in entries:
        raise ZooError(f"the zoo has no {name!r} for {task!r}{did_you_mean(name, entries)}")
    return entries[name]


def load(task: str, name: str, settings: Mapping[str, Any] | None = None, run: int = 0) -> OnnxAgent:
    """The policy of one training run (the first unless asked otherwise).

    Args:
        task: Name of the task.
        name: Name of the entry.
        settings: Settings of the environment it shall act in.
        run: Which of the training runs.

    Raises:
        ZooError: If there is no such entry or run.
    """
    entry = get_entry(task, name)
    agents = entry.agents(settings)
    if not 0 <= run < len(agents):
        raise ZooError(f"{entry}: there are {len(agents)} training runs, so run is 0 to {len(agents) - 1}")
    return agents[run]
