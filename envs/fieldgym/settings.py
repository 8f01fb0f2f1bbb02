"""How settings are read: from an object, a mapping or nothing, checked whole before any work starts.

A sampler may stand in the place of a number, of one in a tuple, or of a choice (``fieldmodels.sampling``);
the environment draws it for each episode. Whoever reads the settings without drawing gets a typical value.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any, TypeVar

import numpy as np
from pydantic import TypeAdapter, ValidationError

from fieldmodels.model import ModelError
from fieldmodels.names import did_you_mean
from fieldmodels.sampling import KINDS, Choice, Each, Sampler, Uniform, is_sampler, read_sampler
from fieldmodels.settings import Declared, Setting, declared

S = TypeVar("S")


class SettingsError(ValueError):
    """Settings with an unknown key or a value that is not allowed; lists all that is wrong."""


def read_settings(source: S | Mapping[str, Any] | None, kind: type[S]) -> S:
    """Read the settings of an environment; see ``read_random_settings``, whose samplers are left out."""
    return read_random_settings(source, kind)[0]


def read_random_settings(source: S | Mapping[str, Any] | None, kind: type[S]) -> tuple[S, dict[str, Sampler]]:
    """Read the settings of an environment, some of which may be samplers.

    Args:
        source: The settings object itself, a mapping of some of its fields, or None for the defaults.
        kind: The settings class, a frozen pydantic dataclass.

    Returns:
        The settings, with a typical value where a sampler stands, and the samplers by name.

    Raises:
        SettingsError: For unknown keys, values out of range, or samplers that make no sense here, all of them
            in one message.
    """
    if isinstance(source, kind):
        return source, {}
    if source is not None and not isinstance(source, Mapping):
        raise SettingsError(f"settings must be a {kind.__name__}, a mapping or None, not {source!r}")
    fixed, samplers, wrong = take_samplers(source or {}, kind)
    lines = [f"  {message}" for _, message in wrong]
    try:
        settings = TypeAdapter(kind).validate_python(fixed)
    except ValidationError as error:
        known = [field.name for field in fields(kind)]  # type: ignore[arg-type]
        for problem in error.errors():
            place = ".".join(str(part) for part in problem["loc"])
            if problem["type"] in ("unexpected_keyword_argument", "extra_forbidden"):
                lines.append(f"  {place}: unknown setting{did_you_mean(place, known)}")
            else:
                given = f" (given: {problem['input']!r})" if place else ""
                lines.append(f"  {place or kind.__name__}: {problem['msg']}{given}")
        raise SettingsError(f"{kind.__name__}:\n" + "\n".join(lines)) from None
    if lines:
        raise SettingsError(f"{kind.__name__}:\n" + "\n".join(lines))
    return settings, samplers


def take_samplers(
    source: Mapping[str, Any], kind: type[Any]
) -> tuple[dict[str, Any], dict[str, Sampler], list[tuple[str, str]]]:
    """Take the samplers out of settings that a user hands in.

    Args:
        source: Some of the settings.
        kind: The settings class.

    Returns:
        The same settings with typical values in the samplers' places, the samplers by name, and what is wrong
        with them: name and message.
    """
    known, fixed = declared(kind), dict(source)
    samplers: dict[str, Sampler] = {}
    wrong = []
    for name, value in source.items():
        one = known.get(name)
        own = isinstance(value, Mapping) and bool(set(value) - KINDS)  # a setting may be a mapping
        if one is not None and _is_truth_for_number(value, one):
            wrong.append((name, f"{name} must be a number, not {value!r}"))
            del fixed[name]
        if not _drawn(value) or (own and (one is None or not _drawable(one))):
            continue
        try:
            sampler = _read(name, value, one, [n for n, o in known.items() if _drawable(o)])
            samplers[name] = sampler
            fixed[name] = int(sampler.typical) if one is not None and one.type is int else sampler.typical
        except ModelError as error:
            wrong.append((name, str(error)))
            del fixed[name]
    return fixed, dict(sorted(samplers.items())), wrong


def _is_truth_for_number(value: Any, one: Declared) -> bool:
    """Whether true or false stands where a number belongs; Python would take them for 1 and 0."""
    values = value if isinstance(value, list | tuple) and one.items else [value]
    return bool(one.items or one.type in (int, float)) and any(isinstance(v, bool | np.bool_) for v in values)


def _drawn(value: Any) -> bool:
    """Whether a value is a sampler, or a tuple some of whose numbers are."""
    return is_sampler(value) or (isinstance(value, list | tuple) and any(map(is_sampler, value)))


def _drawable(one: Declared) -> bool:
    return not one.setting.fixed and (bool(one.choices or one.items) or one.type in (int, float, bool))


def _read(name: str, value: Any, one: Declared | None, drawable: Sequence[str]) -> Sampler:
    if one is None or not _drawable(one):
        why = f" ({one.setting.fixed})" if one is not None and one.setting.fixed else ""
        raise ModelError(
            f"{name}: one value holds for all episodes and rows{why}; drawn may be {', '.join(drawable)}"
        )
    if one.items:
        return _read_tuple(name, value, one)
    sampler = read_sampler(value, name)
    if one.choices or one.type is bool:
        allowed = one.choices or (False, True)
        if not isinstance(sampler, Choice) or not set(sampler.values) <= set(allowed):
            raise ModelError(
                f"{name}: a choice out of {', '.join(map(repr, allowed))} is needed, not {sampler}"
            )
        return sampler
    lower, upper = bounds(one.setting)
    if one.type is int and not isinstance(sampler, Choice | Uniform):
        raise ModelError(f"{name}: a whole number is drawn by uniform or choice, not by {sampler}")
    sampler.check(name, lower, upper, one.setting.unit)
    numbers = sampler.values if isinstance(sampler, Choice) else sampler.extremes(lower, upper)
    if one.type is int and any(number != int(number) for number in numbers):
        raise ModelError(f"{name}: whole numbers are needed, not {sampler}")
    return sampler


def _read_tuple(name: str, value: Any, one: Declared) -> Sampler:
    """Read what draws a tuple of numbers: a choice of whole tuples, or a sampler for some of its numbers."""
    if isinstance(value, list | tuple):
        if len(value) != len(one.items):
            raise ModelError(f"{name} must be {len(one.items)} numbers or samplers, not {value!r}")
        parts = []
        for item, part in zip(one.items, value, strict=True):
            if is_sampler(part):
                part = read_sampler(part, name)
                part.check(name, *bounds(item), one.setting.unit)
            parts.append(part)
        sampler: Sampler = Each(tuple(parts), tuple(map(bounds, one.items)))
        tuples = [sampler.typical]
    else:
        sampler = read_sampler(value, name)
        if not isinstance(sampler, Choice) or not all(isinstance(v, list | tuple) for v in sampler.values):
            raise ModelError(f"{name}: a choice of tuples, or a list with samplers, is needed, not {sampler}")
        tuples = list(sampler.values)
        sampler = Choice(tuple(map(tuple, tuples)))
    for numbers in tuples:
        if problem := one.problem(numbers):
            raise ModelError(problem)
    return sampler


def draw_setting(one: Declared, sampler: Sampler, generator: np.random.Generator) -> Any:
    """Draw a setting, of its own type and within its bounds."""
    if one.choices or one.items or one.type is bool:
        return sampler.draw(generator)
    if one.type is int and isinstance(sampler, Uniform):
        return int(sampler.low + math.floor((sampler.high - sampler.low + 1.0) * float(generator.random())))
    return one.type(sampler.draw(generator, *bounds(one.setting)))


def extreme_settings(one: Declared, sampler: Sampler) -> tuple[Any, ...]:
    """Values of a setting as extreme as any that will be drawn."""
    if isinstance(sampler, Choice):
        return sampler.values
    ends = sampler.extremes(*bounds(one.setting))
    return ends if one.items else tuple(map(one.type, ends))


def bounds(setting: Setting) -> tuple[float, float]:
    """Smallest and largest number that a setting may be."""
    lower, upper = -math.inf, math.inf
    if setting.above is not None:
        lower = math.nextafter(setting.above, math.inf)
    elif setting.least is not None:
        lower = setting.least
    if setting.below is not None:
        upper = math.nextafter(setting.below, -math.inf)
    elif setting.most is not None:
        upper = setting.most
    return lower, upper
