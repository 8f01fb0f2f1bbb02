"""What a task declares of its agents, and where a task is found by its name.

A task is a folder of ``fieldagents.tasks``. Its ``task.py`` holds ``TASK``, a `TaskDefinition`. Two files
beside it are imported only when they are asked for, and may be missing: ``agents.py`` with ``AGENTS``
(`ReferenceAgent`) and ``tuning.py`` with ``TUNERS`` (`Tuner`).
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from pkgutil import iter_modules, resolve_name
from typing import TYPE_CHECKING, Any, Literal, Protocol

from fieldagents.agent import Agent, Sees
from fieldagents.config import Config
from fieldagents.operator import Operator
from fieldgym.foreign import is_foreign
from fieldmodels.code import reached_code
from fieldmodels.model_files import is_model_file, split_class
from fieldmodels.names import did_you_mean
from fieldmodels.registry import model_names

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from fieldmodels.model import Model
    from fieldmodels.reality import Reality
    from fieldmodels.recording import Recording

FOLDERS = "fieldagents.tasks"
"""The package whose folders are the tasks."""


class TaskError(ValueError):
    """A task that has no folder, or whose folder is not as it must be."""


@dataclass(frozen=True)
class ReferenceAgent:
    """How a reference agent is made.

    Attributes:
        name: Its name in configs and tables.
        title: One line that says what it does.
        build: Builds it for an environment's settings.
        sees: What it may see.
        estimator: Whether it is an estimator outside the action space, scored on the same strides.
        extra: The package's extra that it needs; empty for those that work everywhere.
    """

    name: str
    title: str
    build: Callable[[Mapping[str, Any]], Agent]
    sees: Sees = "observation"
    estimator: bool = False
    extra: str = ""

    def make(self, settings: Mapping[str, Any]) -> Agent:
        """The agent for an environment's settings, under its name."""
        agent = self.build(settings)
        agent.name, agent.title, agent.sees = self.name, self.title, self.sees
        return agent

    @property
    def kind(self) -> str:
        """How its results are to be read, as ``Agent.kind``."""
        return f"estimator, {self.sees}" if self.estimator else self.sees


@dataclass(frozen=True)
class Metric:
    """A number for each episode, made from what ``info`` says at its steps.

    Attributes:
        name: Column of the results.
        unit: Its unit, "1" if it has none.
        title: What it is, in a few words.
        key: Where the environment's ``info`` has it; an estimator's row reads its own key instead of
            the first metric's.
        lower_is_better: Whether a lower value is a better one.
        common: Whether it does not depend on the agent: proof that all met the same noise.
        over: How an episode's number comes from its steps: their ``mean``, their ``sum``, or the ``last``
            one's.
        binary: Whether an episode's number is 0 or 1, as a success is; its mean is then a share, with an
            interval of its own kind.
        optional: Whether an episode may have no value (NaN), as the time at which something was reached
            that was not; means and differences are then over the episodes that have one.
        given: Entry of ``info`` without which an episode has no value: a metric of the successful episodes
            names that of the success, which the episode's last step must hold.
        per: Entry of ``info`` that the episode's value is divided by, as it is at the last step.
        bound: Where a function is, ``module:function``, of the environment's settings, its first ``info`` and
            who is told what it does, whose value for each episode that episode's is divided by.
    """

    name: str
    unit: str
    title: str
    key: str
    lower_is_better: bool = True
    common: bool = False
    over: Literal["mean", "sum", "last"] = "mean"
    binary: bool = False
    optional: bool = False
    given: str = ""
    per: str = ""
    bound: str = ""

    @property
    def may_miss(self) -> bool:
        """Whether an episode may be without a value."""
        return self.optional or bool(self.given)

    @property
    def label(self) -> str:
        """Title and unit."""
        unit = "%" if self.binary else self.unit
        return self.title if unit == "1" else f"{self.title} [{unit}]"


@dataclass(frozen=True)
class Recorder:
    """How data of some models are recorded that are not simply driven by a command.

    Attributes:
        models: Names of the models.
        keys: Keys of a ``RecordConfig`` that it takes beside those that every recording has.
        record: Records: config (a ``RecordConfig``), model, true parameters, source of all randomness.
    """

    models: tuple[str, ...]
    keys: tuple[str, ...]
    record: Callable[[Any, Model, Reality, np.random.Generator], Recording]


@dataclass(frozen=True)
class Tuner:
    """How an agent is tuned, planned or designed for a simulation.

    Attributes:
        name: Name of the agent in configs: that of the reference agent which it makes anew.
        title: What is tuned, and how, in a line.
        options: What a config may say of the effort.
        tune: Makes the agent from the environment's settings, the reality in which it is simulated, and the
            options, with tuning seeds alone. Equal arguments give equal agents, so that what is tuned in the
            right simulation is the oracle to the bit.
        conditioned: Whether the agent is not made anew but given what a diagnosis has found, if anything.
        runs: Number of training runs of one that is told; its options say which one is made.
    """

    name: str
    title: str
    options: type[Config]
    tune: Callable[[Mapping[str, Any], Any, Any], Agent]
    conditioned: bool = False
    runs: int = 1


class Drives(Protocol):
    """Recorded drives that an agent learns from; made of a file, which may not exist yet, and settings."""

    def __init__(self, path: Path, settings: Mapping[str, Any]) -> None:
        """Load and check the drives that the file holds."""

    def row(self, info: Mapping[str, Any], action: NDArray[Any]) -> Mapping[str, float]:
        """What is kept of an instant: signals by name."""

    def add(self, rows: Sequence[Mapping[str, float]]) -> str:
        """Add a drive to the file; returns what became of it, in words."""

    def agent(self) -> Agent:
        """The agent that these drives teach."""


@dataclass(frozen=True)
class TaskDefinition:
    """What the layer of agents knows of a task.

    Attributes:
        name: Its name in every layer.
        metrics: What is measured in an episode; verdicts are about the first.
        recorder: Who records its model's data; None for a model that is driven by a command.
        picture: The agent that ``watch`` and the documentation's film show; None for the first that acts.
        steer: What a human operator's stick does: the operator's action in the place of the agent's own.
        drives: Where the class is that keeps drives and makes an agent of them, ``module:class`` of a
            `Drives`; empty if the task has none.
    """

    name: str
    metrics: tuple[Metric, ...]
    recorder: Recorder | None = None
    picture: str | None = None
    steer: Callable[[Operator, NDArray[np.float32]], NDArray[np.float32]] = Operator.action
    drives: str = ""

    @property
    def agents(self) -> dict[str, ReferenceAgent]:
        """The reference agents by name, in the order of presentation."""
        return {agent.name: agent for agent in self._listed("agents")}

    @property
    def tuners(self) -> dict[str, Tuner]:
        """Who tunes agents for a given simulation, by name; the first is the most telling."""
        return {tuner.name: tuner for tuner in self._listed("tuning", "TUNERS")}

    def _listed(self, module: str, name: str = "") -> Sequence[Any]:
        """A tuple of the module beside the task's ``task.py``; empty without such a module."""
        place = f"{FOLDERS}.{self.name}.{module}"
        if find_spec(place) is None:
            return ()
        found: Sequence[Any] = getattr(import_module(place), name or module.upper())
        return found


def task_names() -> tuple[str, ...]:
    """Names of all tasks: the folders of ``fieldagents.tasks``."""
    folders = iter_modules(import_module(FOLDERS).__path__)
    return tuple(sorted(folder.name for folder in folders if folder.ispkg))


@cache
def get_task(name: str) -> TaskDefinition:
    """A task by its name, that of a machine or of a third-party environment (see ``fieldgym.find_task``).

    Raises:
        TaskError: If there is neither; the message says which tasks there are.
    """
    if name not in (known := task_names()):
        if is_foreign(name):
            foreign: TaskDefinition = resolve_name("fieldagents.foreign:definition")(name)
            return foreign
        if name in model_names() or is_model_file(name):
            bench: TaskDefinition = resolve_name("fieldagents.bench:definition")(name)
            return bench
        raise TaskError(f"{FOLDERS} has no folder {name!r}{did_you_mean(name, known)}")
    task: TaskDefinition = import_module(f"{FOLDERS}.{name}.task").TASK
    if task.name != name:
        raise TaskError(f"{FOLDERS}.{name}.task: TASK is named {task.name!r}, its folder {name!r}")
    return task


def all_tasks() -> Iterator[TaskDefinition]:
    """Every task."""
    return map(get_task, task_names())


def recorder_of(model: str) -> Recorder | None:
    """Who records a model's data; None for one that is driven by a command."""
    recorders = (task.recorder for task in all_tasks() if task.recorder)
    return next((recorder for recorder in recorders if model in recorder.models), None)


def code_of(task: str, *also: str) -> str:
    """Hash over the code that a task's results rest on: its own on all floors, and what this imports.

    Args:
        task: Name of the task.
        also: Further modules.
    """
    if is_model_file(task):
        text = Path(split_class(task)[0]).read_bytes()
        return f"{reached_code(('fieldagents.bench', *also))}-{hashlib.sha256(text).hexdigest()[:16]}"
    if is_foreign(task):
        module = task.rpartition(":")[0]
        return (
            f"{reached_code(('fieldagents.foreign', *filter(None, [module]), *also))}-{version('gymnasium')}"
        )
    own = (f"{FOLDERS}.{task}", f"fieldmodels.machines.{task}", f"fieldgym.{task}", f"fieldgym.tasks.{task}")
    bench = () if task in task_names() else ("fieldagents.bench",)
    return reached_code((*own, *bench, *also))
