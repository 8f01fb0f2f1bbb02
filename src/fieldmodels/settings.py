"""Settings of a task, each declared once: what it means, its unit, its bounds and its default.

A class of settings is a frozen dataclass whose fields are annotated::

    capture: Annotated[float, Setting("Distance at which the goal counts as reached.", "km", above=0)] = 5.0

From that one line come the checks, the page's table, and the record in which a kernel reads the value:
``rules[b].capture``.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import lru_cache
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import annotated_types
import numpy as np
from numpy.typing import NDArray

from fieldmodels.model import ModelError


@dataclass(frozen=True)
class Setting:
    """What a setting means, and what it may be; pydantic understands the bounds.

    Attributes:
        meaning: One sentence, in Markdown.
        unit: Its unit, "" if it has none.
        least: Smallest value.
        above: It must be greater.
        most: Largest value.
        below: It must be smaller.
        finite: False if infinity has a meaning.
        fixed: Why it is one for all episodes and rows ("it shapes the observation"); "" if it may be random.
    """

    meaning: str
    unit: str = ""
    least: float | None = None
    above: float | None = None
    most: float | None = None
    below: float | None = None
    finite: bool = True
    fixed: str = ""

    __is_annotated_types_grouped_metadata__ = True

    def __iter__(self) -> Iterator[annotated_types.BaseMetadata]:
        """The bounds, one by one."""
        if self.least is not None:
            yield annotated_types.Ge(self.least)
        if self.above is not None:
            yield annotated_types.Gt(self.above)
        if self.most is not None:
            yield annotated_types.Le(self.most)
        if self.below is not None:
            yield annotated_types.Lt(self.below)
        elif self.most is None and self.finite and not (self.least is None and self.above is None):
            yield annotated_types.Lt(math.inf)

    def allows(self, value: float) -> bool:
        """Whether a number is within the bounds."""
        return (
            not math.isnan(value)
            and (math.isfinite(value) or not self.finite)
            and (self.least is None or value >= self.least)
            and (self.above is None or value > self.above)
            and (self.most is None or value <= self.most)
            and (self.below is None or value < self.below)
        )

    def range(self) -> str:
        """The bounds in words: "greater than 0, at most 10"."""
        words = (
            (self.least, "at least"),
            (self.above, "greater than"),
            (self.most, "at most"),
            (self.below, "less than"),
        )
        stated = [f"{word} {value:g}" for value, word in words if value is not None]
        return ", ".join(stated) or "a finite number"


@dataclass(frozen=True)
class Declared:
    """One declared setting of a class.

    Attributes:
        name: Of the field.
        default: Its default.
        type: Its type without the annotation.
        setting: What is declared.
    """

    name: str
    default: Any
    type: Any
    setting: Setting

    @property
    def choices(self) -> tuple[Any, ...]:
        """What it may be, if that is a list of names or numbers."""
        return get_args(self.type) if get_origin(self.type) is Literal else ()


def declared(kind: Any) -> Mapping[str, Declared]:
    """The settings that a class declares, by name, in order."""
    return _declared(kind)


@lru_cache(maxsize=64)
def _declared(kind: Hashable) -> Mapping[str, Declared]:
    assert isinstance(kind, type)
    assert is_dataclass(kind)
    hints = get_type_hints(kind, include_extras=True)
    found = {}
    for field in fields(kind):
        hint = hints[field.name]
        if get_origin(hint) in (Union, UnionType):  # Annotated[float, Setting(...)] | None
            hint = next((part for part in get_args(hint) if get_origin(part) is Annotated), hint)
        if get_origin(hint) is Annotated:
            own, *notes = get_args(hint)
            setting = next((note for note in notes if isinstance(note, Setting)), None)
            if setting is not None:
                found[field.name] = Declared(field.name, field.default, own, setting)
    return found


def check_declared(settings: Any) -> None:
    """Check all settings of an object against their declarations; for its ``__post_init__``.

    Raises:
        ModelError: With every value that is not allowed.
    """
    wrong = []
    for name, one in declared(type(settings)).items():
        value = getattr(settings, name)
        if one.choices:
            if value not in one.choices:
                wrong.append(f"{name} must be one of {', '.join(map(repr, one.choices))}, not {value!r}")
        elif one.type in (int, float):
            number = isinstance(value, int | float | np.integer | np.floating) and value == value
            if not number or not one.setting.allows(value):
                wrong.append(
                    f"{name} must be {one.setting.range()} {one.setting.unit}".rstrip() + f", not {value!r}"
                )
    if wrong:
        raise ModelError("; ".join(wrong))


def kernel_rows(settings: Any, batch: int, derived: Mapping[str, Any]) -> NDArray[Any]:
    """Settings as a kernel reads them: a record for each row, ``rules[b].capture``.

    A choice is its place among the choices. Settings that are neither number, flag nor choice are left out.

    Args:
        settings: An object of a class of settings.
        batch: Number of rows.
        derived: What else the kernel needs, computed from the settings: numbers, flags, arrays.

    Returns:
        Structured array of shape (batch,), all rows equal.
    """
    values: dict[str, Any] = {}
    for name, one in declared(type(settings)).items():
        value = getattr(settings, name)
        if one.choices:
            values[name] = one.choices.index(value)
        elif one.type in (int, float, bool):
            values[name] = one.type(value)
    values |= derived
    kind = np.dtype([(name, *_column(value)) for name, value in values.items()])
    row = np.zeros(1, dtype=kind)
    for name, value in values.items():
        row[name] = value
    return np.repeat(row, batch)


def _column(value: Any) -> tuple[Any, tuple[int, ...]]:
    if isinstance(value, np.ndarray):
        return value.dtype, value.shape
    if isinstance(value, bool | np.bool_):
        return np.bool_, ()
    return (np.int64 if isinstance(value, int | np.integer) else np.float64), ()
