"""What a task declares of its environment."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any

import gymnasium
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from fieldmodels.names import class_name

if TYPE_CHECKING:
    from fieldmodels.drivers.stepped import Channels

BENCH = "fieldgym/Bench-v0"
"""A bench of one's own: ``gymnasium.make(BENCH, config="extended.yaml")``, or ``machine="pendulum"``."""


Wrap = Callable[[Any], Any]
"""Puts a wrapper around a scalar environment."""


def wrapped(env: Any, wrappers: Sequence[Wrap]) -> Any:
    """An environment in wrappers, the first innermost."""
    for wrap in wrappers:
        env = wrap(env)
    return env


@dataclass(frozen=True)
class Task:
    """A task as the layer above sees it; where nothing is said, everything goes by its name.

    Attributes:
        name: Its name in every layer (physics, environment, agents, configs, tests).
        title: Title for people.
        description: What is to be done, in one line.
        version: Of the environment; a change of behaviour gives the next.
        module: Module of this package that holds its environments; by default the task's own name.
        settings_name: Name of the class of its settings in that module.
        model: Name of its model in `fieldmodels`; by default the task's own name.
        reward_threshold: Mean return of the reference agent in the environment as it is registered, over the
            published test seeds: from there on the task counts as solved.
        operator: Whether a human operator can take over, as in the source.
        model_reads: Entries of ``info`` that follow from what was observed and from the model's constants,
            so that an agent with the right ``model`` may read them. All others are truth or scores.
        turned_by: Entry of ``info`` with the angle [rad], clockwise from north, by which observations are
            turned, if they are: what a policy is told of an effect's ``north`` and ``east`` is turned by it
            as well, step by step, so that an agent with the right ``diagnosis`` may read it.
    """

    name: str
    title: str
    description: str
    version: int = 0
    module: str = ""
    settings_name: str = ""
    model: str = ""
    reward_threshold: float | None = None
    operator: bool = False
    model_reads: tuple[str, ...] = ()
    turned_by: str = ""

    def __post_init__(self) -> None:
        defaults = {
            "module": self.name,
            "settings_name": f"{self.class_name}Settings",
            "model": self.name,
        }
        for key, value in defaults.items():
            if not getattr(self, key):
                object.__setattr__(self, key, value)

    @property
    def class_name(self) -> str:
        """Its name as its classes and its identifier have it, such as ``HeelStrike``."""
        return class_name(self.name)

    @property
    def env_id(self) -> str:
        """The identifier that ``gymnasium.make`` takes."""
        return f"fieldgym/{self.class_name}-v{self.version}"

    @property
    def entry_point(self) -> str:
        """Where its environment is, ``module:class``."""
        return f"fieldgym.{self.module}:{self.class_name}Env"

    @property
    def vector_entry_point(self) -> str:
        """Where its native vector environment is, ``module:class``."""
        return f"fieldgym.{self.module}:{self.class_name}VectorEnv"

    @property
    def channels(self) -> Channels | None:
        """Which of its model's signals it commands and measures, imported when asked for; None for all."""
        found: Channels = resolve_name(self.entry_point).batch_task.channels
        return found

    @property
    def settings(self) -> type[Any]:
        """The class of its settings, imported when asked for."""
        found: type[Any] = resolve_name(f"fieldgym.{self.module}:{self.settings_name}")
        return found

    @property
    def own(self) -> dict[str, Any]:
        """What ``gymnasium.make`` is given beside a user's options."""
        return {}

    def make(self, wrappers: Sequence[Wrap] = (), **options: Any) -> Any:
        """Its environment, by ``gymnasium.make`` with these options, in wrappers, the first innermost."""
        return wrapped(gymnasium.make(self.env_id, **self.own, **options), wrappers)

    def make_vec(
        self,
        count: int,
        wrappers: Sequence[Wrap] = (),
        autoreset_mode: AutoresetMode = AutoresetMode.NEXT_STEP,
        **options: Any,
    ) -> Any:
        """Its native vector environment of so many rows, by ``gymnasium.make_vec`` with these options.

        With wrappers, which take scalar environments, so many of these one after the other.
        """
        if wrappers:
            options = {"disable_env_checker": True, **options}
            one = partial(self.make, wrappers, **options)
            return SyncVectorEnv([one] * count, autoreset_mode=autoreset_mode)
        return gymnasium.make_vec(
            self.env_id,
            num_envs=count,
            vectorization_mode="vector_entry_point",
            autoreset_mode=autoreset_mode,
            **self.own,
            **options,
        )


@dataclass(frozen=True)
class BenchTask(Task):
    """A machine as a task: its output is to follow a reference, in ``Bench-v0``; see `fieldgym.bench`."""

    @property
    def env_id(self) -> str:
        """The identifier that all machines share."""
        return BENCH

    @property
    def channels(self) -> None:
        """All of its signals."""
        return None

    @property
    def own(self) -> dict[str, Any]:
        """See ``Task.own``."""
        return {"machine": self.model}
