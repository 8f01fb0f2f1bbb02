"""Which learner a config means: any algorithm of Stable-Baselines3's interface, by name or by import path."""

from __future__ import annotations

import importlib
import inspect
import re
from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, PositiveFloat, PositiveInt, TypeAdapter, ValidationError

from fieldagents.made import imported, imported_class
from fieldmodels.extras import needed
from fieldmodels.names import did_you_mean

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

LIBRARIES = ("stable_baselines3", "sb3_contrib")

OWN_PLACE = {
    "policy": "the key policy",
    "policy_kwargs": "the section network",
    "env": "the section environment",
    "seed": "the key seed",
    "device": "no place: training runs on the processor, so that it can be repeated to the bit",
    "verbose": "no place: progress is shown anyway",
    "tensorboard_log": "no place: the run's folder has it",
    "stats_window_size": "no place: the curve is of the latest 100 episodes",
    "_init_setup_model": "no place",
}
"""Arguments of a learner that a config does not give in its section, and where they stand instead."""

Fraction = Annotated[float, Field(ge=0.0, le=1.0)]
Natural = Annotated[int, Field(ge=0)]
TYPES: dict[str, Any] = {
    "learning_rate": PositiveFloat,
    "gamma": Fraction,
    "gae_lambda": Fraction,
    "tau": Annotated[float, Field(gt=0.0, le=1.0)],
    "batch_size": PositiveInt,
    "n_steps": PositiveInt,
    "n_epochs": PositiveInt,
    "buffer_size": PositiveInt,
    "learning_starts": Natural,
    "train_freq": PositiveInt,
    "gradient_steps": Annotated[int, Field(ge=-1)],
    "max_grad_norm": PositiveFloat,
    "target_kl": PositiveFloat | None,
    "vf_coef": Annotated[float, Field(ge=0.0)],
    "ent_coef": Annotated[float, Field(ge=0.0)] | str,
}
"""Types of arguments that mean the same in every algorithm; further ones are the algorithm's own business."""


def require_extra() -> None:
    """Raise MissingExtraError unless all that training needs is installed."""
    for package in ("torch", *LIBRARIES, "tensorboard", "onnx"):
        needed(package)


@cache
def algorithms() -> dict[str, type[BaseAlgorithm]]:
    """The algorithms of Stable-Baselines3 and sb3-contrib by the names that configs have for them."""
    require_extra()
    from stable_baselines3.common.base_class import BaseAlgorithm

    return {
        re.sub(r"(?<=[a-z])(?=[A-Z])", "_", word).lower(): one
        for library in LIBRARIES
        for word, one in vars(importlib.import_module(library)).items()
        if inspect.isclass(one) and issubclass(one, BaseAlgorithm)
    }


@cache
def find_algorithm(name: str) -> type[BaseAlgorithm]:
    """The class of a learner.

    Args:
        name: Of an algorithm of Stable-Baselines3 or sb3-contrib, such as ``ppo`` or ``recurrent_ppo``, or
            ``module:Class`` of any other with their interface.

    Raises:
        MissingExtraError: Without the packages of the ``train`` extra.
        ValueError: If there is no such algorithm.
    """
    require_extra()
    from stable_baselines3.common.base_class import BaseAlgorithm

    if ":" in name:
        found = imported(name)
    else:
        known = algorithms()
        if name.lower() not in known:
            hint = did_you_mean(name, known) or f"; there are {', '.join(sorted(known))}"
            raise ValueError(f"there is no algorithm {name!r}{hint}, or name your own as module:Class")
        found = known[name.lower()]
    if not (inspect.isclass(found) and issubclass(found, BaseAlgorithm)):
        raise ValueError(f"{name!r} is not an algorithm with the interface of Stable-Baselines3")
    return found


def find_policy(kind: type[BaseAlgorithm], name: str) -> str | type[Any]:
    """A policy as a learner takes it: one of its own by name, or the class of ``module:Class``.

    Raises:
        ValueError: If there is no such policy.
    """
    from stable_baselines3.common.policies import BasePolicy

    if ":" in name:
        return imported_class(name, BasePolicy)
    if kind.policy_aliases and name not in kind.policy_aliases:
        known = did_you_mean(name, kind.policy_aliases) or f"; there are {', '.join(kind.policy_aliases)}"
        raise ValueError(f"{kind.__name__} has no policy {name!r}{known}, or name your own as module:Class")
    return name


def is_on_policy(kind: type[BaseAlgorithm]) -> bool:
    """Whether it learns from what its present policy has just done."""
    from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm

    return issubclass(kind, OnPolicyAlgorithm)


def default_of(kind: type[BaseAlgorithm], key: str, otherwise: Any = None) -> Any:
    """The library's default of a learner's argument; ``otherwise`` if there is none."""
    for one in kind.__mro__:  # what a class hands on by **kwargs is an argument of its base
        parameter = inspect.signature(one).parameters.get(key)
        if parameter is not None and parameter.default is not parameter.empty:
            return parameter.default
    return otherwise


def wrong_arguments(kind: type[BaseAlgorithm], given: Mapping[str, Any]) -> list[tuple[str, str]]:
    """What is wrong with the arguments of a learner: the key and the message of each mistake."""
    signature = inspect.signature(kind).parameters
    free = any(one.kind is one.VAR_KEYWORD for one in signature.values())
    known = [key for key in signature if key not in OWN_PLACE] + ["learning_rate_decay"]
    problems = []
    for key, value in given.items():
        if key in OWN_PLACE:
            problems.append((key, f"not an argument of this section; its place: {OWN_PLACE[key]}"))
        elif key not in known and not free:
            problems.append((key, f"unknown key{did_you_mean(key, known)}"))
        elif key == "learning_rate_decay" and value not in ("constant", "linear"):
            problems.append((key, f"constant or linear, not {value!r}"))
        elif key in TYPES:
            try:
                TypeAdapter(TYPES[key]).validate_python(value)
            except ValidationError as error:
                problems.append((key, f"{error.errors()[0]['msg']}, not {value!r}"))
    if given.get("gradient_steps") == 0:
        problems.append(("gradient_steps", "nothing is learned without gradient steps: at least 1, or -1"))
    entropy = given.get("ent_coef", "auto")
    if isinstance(entropy, str) and not re.fullmatch(r"auto(_\d*\.?\d+)?", entropy):
        problems.append(("ent_coef", f"a number, auto or auto_0.1, not {entropy!r}"))
    return problems
