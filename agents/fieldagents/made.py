"""Third-party classes that a config names with their keyword arguments: wrappers, callbacks, policies."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from functools import partial
from pkgutil import resolve_name
from typing import Annotated, Any

from pydantic import BeforeValidator

WRITE = "write 'module:Class', or 'module:Class: {argument: value}'"


def _one(value: Any) -> Any:
    given = {value: None} if isinstance(value, str) else value
    if not isinstance(given, dict) or len(given) != 1:
        raise ValueError(f"{WRITE}, not {value!r}")
    ((place, arguments),) = given.items()
    if not isinstance(place, str) or not isinstance(arguments, dict | None):
        raise ValueError(f"{WRITE}, not {value!r}")
    return {place: arguments or {}}


Made = Annotated[
    dict[str, dict[str, Any]],
    BeforeValidator(_one, json_schema_input_type=str | dict[str, dict[str, Any] | None]),
]
"""``module:Class``, or a mapping from it to the keyword arguments that it is called with."""


def imported(place: str) -> Any:
    """What stands at ``module:name``.

    Raises:
        ValueError: If it cannot be imported.
    """
    if ":" not in place:
        raise ValueError(f"{place!r} is not module:Class")
    try:
        return resolve_name(place)
    except (Exception, SystemExit) as error:  # of a user's module, which may do anything
        raise ValueError(f"{place!r} cannot be imported: {type(error).__name__}: {error}") from None


def imported_class(place: str, base: type) -> type[Any]:
    """The class at ``module:Class``.

    Raises:
        ValueError: If there is none, or it does not inherit from ``base``.
    """
    found = imported(place)
    if not (inspect.isclass(found) and issubclass(found, base)):
        raise ValueError(f"{place!r} is no class that inherits from {base.__module__}.{base.__qualname__}")
    return found


def makers(given: tuple[Mapping[str, Mapping[str, Any]], ...]) -> tuple[Callable[..., Any], ...]:
    """What makes each, to be called with what comes before the keyword arguments."""
    return tuple(partial(imported(place), **arguments) for one in given for place, arguments in one.items())


def wrong_arguments_of(kind: Callable[..., Any], arguments: Mapping[str, Any], before: int = 0) -> str:
    """What is wrong with keyword arguments, with so many others before them; empty if nothing is."""
    try:
        inspect.signature(kind).bind(*[None] * before, **arguments)
    except TypeError as error:
        return f"{error}; it takes {inspect.signature(kind)}"
    except ValueError:  # of a class that does not tell its arguments
        pass
    return ""
