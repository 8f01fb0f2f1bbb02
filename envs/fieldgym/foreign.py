"""Third-party environments as tasks: any that Gymnasium makes."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from typing import Any

import gymnasium
from gymnasium.envs.registration import registry
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from fieldgym.task import Task, Wrap, wrapped
from fieldmodels.model_files import is_model_file

VERSIONED = re.compile(r"(?:[A-Za-z_][\w.]*:)?(?:[\w-]+/)?[\w.-]+-v\d+")
IN_A_MODULE = re.compile(r"[A-Za-z_][\w.]*:(?:[\w-]+/)?[\w.-]+")


class ForeignError(ValueError):
    """A third-party environment that cannot be made."""


def is_foreign(name: str) -> bool:
    """Whether a task's name is that of a third-party environment: ``Pendulum-v1``, ``module:Id``."""
    if is_model_file(name):
        return False
    return name in registry or any(one.fullmatch(name) for one in (VERSIONED, IN_A_MODULE))


@dataclass(frozen=True)
class ForeignTask(Task):
    """A third-party environment as a task; its settings are the keyword arguments of ``gymnasium.make``.

    Attributes:
        identifier: What ``gymnasium.make`` takes.
    """

    identifier: str = ""

    @property
    def env_id(self) -> str:
        """The identifier that ``gymnasium.make`` takes."""
        return self.identifier

    @property
    def channels(self) -> None:
        """Of no model."""
        return None

    def find(self) -> gymnasium.envs.registration.EnvSpec:
        """What Gymnasium knows of it; imports the module that is to register it.

        Raises:
            ForeignError: If there is no such module or environment.
        """
        module, _, identifier = self.identifier.rpartition(":")
        if module:
            try:
                import_module(module)
            except (Exception, SystemExit) as error:  # of a user's module, which may do anything
                raise ForeignError(
                    f"{module!r}, which is to register {identifier!r}, cannot be imported:"
                    f" {type(error).__name__}: {error}"
                ) from None
        try:
            return gymnasium.spec(identifier)
        except gymnasium.error.Error as error:
            remedy = "" if module else " If a module of yours registers it, write module:Id."
            raise ForeignError(f"Gymnasium has no {identifier!r}: {error}{remedy}") from None

    def make(
        self,
        wrappers: Sequence[Wrap] = (),
        settings: Mapping[str, Any] | None = None,
        reality: None = None,
        **options: Any,
    ) -> Any:
        """See ``Task.make``.

        Raises:
            ForeignError: If it cannot be made.
        """
        del reality
        self.find()
        try:
            made = gymnasium.make(self.identifier, **(settings or {}), **options)
        except Exception as error:  # of anybody's environment
            raise ForeignError(
                f"{self.identifier} cannot be made with these settings: {type(error).__name__}: {error}"
            ) from error
        return wrapped(made, wrappers)

    def make_vec(
        self,
        count: int,
        wrappers: Sequence[Wrap] = (),
        autoreset_mode: AutoresetMode = AutoresetMode.NEXT_STEP,
        **options: Any,
    ) -> Any:
        """See ``Task.make_vec``; its rows are scalar environments, one after the other."""
        return SyncVectorEnv([partial(self.make, wrappers, **options)] * count, autoreset_mode=autoreset_mode)


def foreign_task(name: str) -> ForeignTask:
    """A third-party environment as a task; nothing is imported for it."""
    plain = re.sub(r"[^\w.-]+", "-", name)
    return ForeignTask(plain, name, f"Gymnasium's {name}.", identifier=name)
