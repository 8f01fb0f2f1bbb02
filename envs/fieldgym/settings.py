"""How settings are read: from an object, a mapping or nothing, checked whole before any work starts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from fieldmodels.names import did_you_mean

S = TypeVar("S")


class SettingsError(ValueError):
    """Settings with an unknown key or a value that is not allowed; lists all that is wrong."""


def read_settings(source: S | Mapping[str, Any] | None, kind: type[S]) -> S:
    """Read the settings of an environment.

    Args:
        source: The settings object itself, a mapping of some of its fields, or None for the defaults.
        kind: The settings class, a frozen pydantic dataclass.

    Raises:
        SettingsError: For unknown keys or values out of range, all of them in one message.
    """
    if isinstance(source, kind):
        return source
    if source is not None and not isinstance(source, Mapping):
        raise SettingsError(f"settings must be a {kind.__name__}, a mapping or None, not {source!r}")
    try:
        return TypeAdapter(kind).validate_python(dict(source or {}))
    except ValidationError as error:
        known = [field.name for field in fields(kind)]  # type: ignore[arg-type]
        lines = []
        for problem in error.errors():
            place = ".".join(str(part) for part in problem["loc"])
            if problem["type"] in ("unexpected_keyword_argument", "extra_forbidden"):
                lines.append(f"  {place}: unknown setting{did_you_mean(place, known)}")
            else:
                given = f" (given: {problem['input']!r})" if place else ""
                lines.append(f"  {place or kind.__name__}: {problem['msg']}{given}")
        raise SettingsError(f"{kind.__name__}:\n" + "\n".join(lines)) from None
