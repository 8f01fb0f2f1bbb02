"""Settings of a task, each declared once: what it means, its unit, its bounds and its default.

A class of settings is a frozen dataclass whose fields are annotated::

    capture: Annotated[float, Setting("Distance at which the goal counts as reached.", "km", above=0)] = 5.0

From that one line come the checks, the page's table, the list of settings, and the record in which a kernel
reads the value: ``rules[b].capture``. Where a class of the ground floor declares its numbers so, the settings
of an environment inherit them from it, and ``part_of`` makes it of the settings: nothing is said again.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import lru_cache
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import annotated_types
import numpy as np
from numpy.typing import NDArray

from fieldmodels.model import ModelError

T = TypeVar("T")
LARGEST = 1e12
"""No finite number of a setting is larger: sums and squares of such numbers stay finite."""


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
            yield annotated_types.Le(LARGEST)

    def allows(self, value: float) -> bool:
        """Whether a number is within the bounds."""
        return (
            not math.isnan(value)
            and (abs(value) <= LARGEST or not self.finite)
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
        optional: Whether it may be None.
        items: What is declared of each number, if it is a tuple of numbers.
    """

    name: str
    default: Any
    type: Any
    setting: Setting
    optional: bool = False
    items: tuple[Setting, ...] = ()

    @property
    def choices(self) -> tuple[Any, ...]:
        """What it may be, if that is a list of names or numbers."""
        return get_args(self.type) if get_origin(self.type) is Literal else ()

    def range(self) -> str:
        """What it may be, in words: its choices, or its bounds and its unit."""
        if self.choices:
            return " or ".join(f"`{choice}`" for choice in self.choices)
        if self.items:
            return "; ".join(dict.fromkeys(item.range() for item in self.items))
        return self.setting.range() if self.type in (int, float) else ""

    def problem(self, value: Any) -> str:
        """What is wrong with a value, "" if it is allowed."""
        if value is None and self.optional:
            return ""
        unit = self.setting.unit
        if self.choices:
            if value not in self.choices:
                return f"{self.name} must be one of {', '.join(map(repr, self.choices))}, not {value!r}"
        elif self.items:
            if not isinstance(value, tuple | list) or len(value) != len(self.items):
                return f"{self.name} must be {len(self.items)} numbers, not {value!r}"
            for item, number in zip(self.items, value, strict=True):
                if not _is_number(number) or not item.allows(number):
                    return f"each of {self.name} must be {item.range()} {unit}".rstrip() + f", not {value!r}"
        elif self.type in (int, float) and not (_is_number(value) and self.setting.allows(value)):
            return f"{self.name} must be {self.setting.range()} {unit}".rstrip() + f", not {value!r}"
        return ""


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float | np.integer | np.floating)


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
        own, setting = _annotated(hints[field.name])
        optional = False
        if get_origin(own) in (Union, UnionType):
            parts = [part for part in get_args(own) if part is not NoneType]
            optional = len(parts) < len(get_args(own))
            if len(parts) == 1:
                own, inner = _annotated(parts[0])
                setting = setting or inner
        if setting is not None:
            items = tuple(_annotated(item)[1] for item in get_args(own)) if get_origin(own) is tuple else ()
            found[field.name] = Declared(
                field.name,
                field.default,
                own,
                setting,
                optional,
                tuple(item for item in items if item is not None),
            )
    return found


def _annotated(hint: Any) -> tuple[Any, Setting | None]:
    """A type without its annotation, and the setting that this declares."""
    if get_origin(hint) is not Annotated:
        return hint, None
    own, *notes = get_args(hint)
    return own, next((note for note in notes if isinstance(note, Setting)), None)


def check_declared(settings: Any) -> None:
    """Check all settings of an object against their declarations; for its ``__post_init__``.

    Raises:
        ModelError: With every value that is not allowed.
    """
    wrong = [one.problem(getattr(settings, name)) for name, one in declared(type(settings)).items()]
    if any(wrong):
        raise ModelError("; ".join(problem for problem in wrong if problem))


def part_of(settings: Any, kind: type[T], **others: Any) -> T:
    """An object of a class of the ground floor, made of the settings that have the names of its fields.

    Args:
        settings: An object of a class of settings.
        kind: A dataclass.
        others: Fields whose values are not the settings' own.
    """
    assert is_dataclass(kind)
    shared = {f.name: getattr(settings, f.name) for f in fields(kind) if f.name in declared(type(settings))}
    made: T = kind(**shared | others)
    return made


def code(kind: Any, name: str, choice: Any) -> int:
    """The number by which a kernel knows a choice: its place among the declared ones."""
    return declared(kind)[name].choices.index(choice)


def kernel_rows(settings: Any, batch: int, derived: Mapping[str, Any] | None = None) -> NDArray[Any]:
    """Settings as a kernel reads them: a record for each row, ``rules[b].capture``.

    Settings of objects that are fields of this one are read likewise, without the field's name. A choice is
    its ``code``. What is neither number, flag, choice nor a tuple of numbers is left out, and so is None.

    Args:
        settings: An object of a class of settings.
        batch: Number of rows.
        derived: What else the kernel needs, computed from the settings: numbers, flags, arrays; or what it
            shall read in the place of a setting.

    Returns:
        Structured array of shape (batch,), all rows equal.
    """
    values = _kernel_values(settings) | dict(derived or {})
    # by name, since NumPy puts one record into another by position
    columns = tuple((name, *_column(values[name])) for name in sorted(values))
    row = np.zeros(1, dtype=_record_type(columns))
    for name, value in values.items():
        row[name] = value
    return np.repeat(row, batch)


@lru_cache(maxsize=64)
def _record_type(columns: tuple[Any, ...]) -> np.dtype[Any]:
    """One and the same object for equal columns: at each call of a kernel Numba would compare others."""
    return np.dtype(list(columns))


def _kernel_values(settings: Any) -> dict[str, Any]:
    values: dict[str, Any] = {}
    own = declared(type(settings))
    for field in fields(settings):
        value, one = getattr(settings, field.name), own.get(field.name)
        if one is None:
            inner = _kernel_values(value) if is_dataclass(value) else {}
            assert not values.keys() & inner.keys(), f"{field.name}: a name is declared twice"
            values |= inner
        elif one.choices:
            values[field.name] = one.choices.index(value)
        elif one.items and value is not None:
            values[field.name] = np.array(value, dtype=np.float64)
        elif one.type in (int, float, bool) and value is not None:
            values[field.name] = one.type(value)
    return values


def _column(value: Any) -> tuple[Any, tuple[int, ...]]:
    if isinstance(value, np.ndarray):
        return value.dtype, value.shape
    if isinstance(value, bool | np.bool_):
        return np.bool_, ()
    return (np.int64 if isinstance(value, int | np.integer) else np.float64), ()
