"""Units of columns, and their factors to the SI units of the models: pint's, behind a table of spellings.

Pint alone reads several spellings silently wrong (``Hz`` and ``1/min`` as radians, ``Nm`` as a number of
metres, ``g`` as a gram of acceleration): what is written in logs goes through the table first.
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fieldmodels.names import did_you_mean
from fieldmodels.yaml import load_yaml

if TYPE_CHECKING:
    from pint import UnitRegistry

STANDARD_GRAVITY = 9.80665
"""Standard acceleration of gravity [m/s^2], exact (CGPM 1901)."""

_TABLES = load_yaml(Path(__file__).with_name("units.yaml"))
_UNITS: dict[str, dict[str, str]] = _TABLES["units"]
_SPELLINGS: dict[str, str] = {
    other: unit for unit, others in _TABLES["spellings"].items() for other in others
}
_UNSCALED = (
    "counts",
    "count",
    "cnt",
    "cts",
    "ticks",
    "tick",
    "lsb",
    "inc",
    "inkremente",
    "digits",
    "raw",
    "steps",
)
_TEMPERATURES = {
    ("°C", "K"): (1.0, 273.15),
    ("K", "°C"): (1.0, -273.15),
    ("°F", "K"): (5 / 9, 273.15 - 160 / 9),
    ("°F", "°C"): (5 / 9, -160 / 9),
}
"""Gain and offset between units whose zeros differ, exact by definition (BIPM 2019)."""
_ANGLES = ("radian", "degree", "turn", "arcminute", "arcsecond", "grade", "revolutions_per_minute")
_WRITTEN = re.compile(r"[\w µμ°%/*^().⁻¹²³-]{1,40}")
_SCALED = re.compile(r"(\d+(?:\.\d+)?(?:[eE][-+]?\d+)?)(?:/([1-9]\d*))? *[*x×]? *([^\W\d].*|[°%].*)")


class UnitError(ValueError):
    """A unit that is unknown, or that does not measure the wanted quantity."""


def canonical(unit: str) -> str:
    """Return the project's spelling of a unit ("Nm" and "N*m" are "N m")."""
    spelled = " ".join(re.sub(r"[*·⋅]|(?<=[A-Za-z])[.-](?=[A-Za-z])", " ", unit).strip(" []()").split())
    small = spelled.lower()
    plain = small if len(small) > 1 and spelled.isupper() and small in known_units() else spelled  # MM/S
    return _SPELLINGS.get(spelled, _SPELLINGS.get(small, plain))


@cache
def known_units() -> tuple[str, ...]:
    """The usual units that a column may be declared in; any that pint knows may be, too."""
    return tuple(dict.fromkeys(u for si, others in _UNITS.items() for u in (si, *others)))


def is_unit(text: str, usual: bool = False) -> bool:
    """Whether a word is a unit of a quantity that models have; one of the usual ones, if asked so."""
    have = _scaled(canonical(text))[1]
    if not text.strip(" []()") or have in known_units() or usual:
        return bool(text.strip(" []()")) and have in known_units()
    return any(_measures(have, si) for si in _UNITS if si != "1")  # pint's numbers are bits and mils


def is_unscaled(text: str) -> bool:
    """Whether a header's word counts something without saying what one is worth."""
    return canonical(text).lower().partition("/")[0].strip() in _UNSCALED


def converts(unit: str, wanted: str) -> bool:
    """Whether ``factor`` knows a number."""
    try:
        return factor(unit, wanted) > 0
    except UnitError:
        return False


def other_units(wanted: str) -> dict[str, float]:
    """Units of the same quantity as an SI unit, with their factors to it; none for an unknown unit."""
    want = canonical(wanted)
    return {unit: _ratio(name, want) for unit, name in _UNITS.get(want, {}).items()}


def factor(unit: str, wanted: str) -> float:
    """Number by which a value in ``unit`` is multiplied to be in the SI unit ``wanted``.

    Raises:
        UnitError: If the unit is unknown or measures another quantity.
    """
    have, want = canonical(unit), canonical(wanted)
    size, bare = _scaled(have)
    if size != 1.0:
        return size * factor(bare, wanted)
    if have == want:
        return 1.0
    others = _UNITS.get(want, {})
    if have in others:
        return _ratio(others[have], want)
    if known := zero_of(unit, wanted):
        gain = "" if known[0] == 1.0 else f"{known[0]:.7g}*"
        raise UnitError(
            f"{unit!r} has another zero than {want!r}: declare it as "
            f"'SIGNAL={gain}COLUMN{known[1]:+.7g}:{want}', or if it is a difference of temperatures, as "
            f"'SIGNAL={gain}COLUMN:{want}'"
        )
    allowed = ", ".join([want, *others])
    if is_unscaled(unit):
        raise UnitError(
            f"unit {unit!r} has no size; state what one is worth, as in 'SIGNAL=0.0015*COLUMN:{want}', or "
            f"'SIGNAL=0.0015*COLUMN%4096:{want}' if it wraps around at 4096"
        )
    if have not in known_units() and want in _UNITS and _measures(have, want):
        return _ratio(have.replace(" ", "*"), want)
    if have in known_units():
        raise UnitError(f"unit {unit!r} does not measure a quantity in {wanted!r} (possible: {allowed})")
    raise UnitError(
        f"unknown unit {unit!r}{did_you_mean(have, [want, *others])}; possible: {allowed}; of another one "
        f"state what it is worth, as in 'SIGNAL=0.0015*COLUMN:{want}'"
    )


def _scaled(unit: str) -> tuple[float, str]:
    """How many of a unit one is, and that unit ("0.01 deg", "1/100 deg", "10 ms"); "10 V" may be a range."""
    found = _SCALED.fullmatch(unit)
    size, bare = (float(found[1]) / float(found[2] or 1), canonical(found[3])) if found else (1.0, unit)
    return (size, bare) if size < 1.0 or bare in _UNITS["s"] else (1.0, unit)


def zero_of(unit: str, wanted: str) -> tuple[float, float] | None:
    """Gain and offset from one unit of temperature to another with another zero; None for other units."""
    have, want = canonical(unit), canonical(wanted)
    return _TEMPERATURES.get(({"C": "°C", "F": "°F"}.get(have, have), want))


def si_unit(unit: str) -> tuple[str, float]:
    """Return the SI unit of a unit's quantity, and the factor to it.

    Raises:
        UnitError: If the unit is unknown; for "g" too, which could be a mass or an acceleration.
    """
    size, have = _scaled(canonical(unit))
    if size != 1.0:
        si, worth = si_unit(have)
        return si, size * worth
    homes = [si for si, others in _UNITS.items() if have == si or have in others]
    if len(homes) == 1:
        return homes[0], factor(have, homes[0])
    if homes:
        raise UnitError(f"unit {unit!r} could mean {' or '.join(homes)}; convert the column first")
    for si in _UNITS:
        if _measures(have, si):
            return si, _ratio(have.replace(" ", "*"), si)
    raise UnitError(f"unknown unit {unit!r}{did_you_mean(have, known_units())}")


def _measures(unit: str, si: str) -> bool:
    """Whether pint knows a unit, and as one of an SI unit's quantity."""
    try:
        return _ratio(unit.replace(" ", "*"), si) > 0
    except UnitError:
        return False


@cache
def simplified(unit: str) -> str:
    """A product or quotient of units with each of them once; one that pint does not know stays as it is.

    "rad/s^2 / (rad/s)" is "1/s", and "rad/s rad/s" is "rad^2/s^2".
    """
    if " " not in unit:  # one without a product, for which pint need not be imported
        return unit
    product = re.sub(r"(?<=[^\s/*]) (?=[^\s/*])", "*", unit).replace("^", "**")
    try:
        parsed = (1.0 * _registry().parse_units(product)).unit_items()
        powers = {f"{_registry().Unit(name):~C}": power for name, power in parsed}
    except Exception:  # pint's own, and those of Python's tokenizer
        return unit
    words = re.split(r"[ /*^()]+", unit)
    if not all(name in words for name in powers):  # pint spells it otherwise
        return unit
    names = sorted(powers, key=words.index)
    above = " ".join(_powered(name, powers[name]) for name in names if powers[name] > 0)
    return (above or "1") + "".join(f"/{_powered(n, -powers[n])}" for n in names if powers[n] < 0)


def _powered(name: str, power: float) -> str:
    return name if power == 1 else f"{name}^{power:g}"


@cache
def _registry() -> UnitRegistry[Any]:
    from pint import UnitRegistry  # a third of a second, which most logs do not need

    registry: UnitRegistry[Any] = UnitRegistry(cache_folder=None)
    registry.define("@alias turn = rev")
    return registry


@cache
def _ratio(name: str, si: str) -> float:
    """The factor from what pint calls a unit to an SI unit; an angle is no number, though pint allows it."""
    if (
        not _WRITTEN.fullmatch(name)
        or re.match(r"\d[\d.]*\*", name)
        or re.search(r"\^\s*\(?-?\d\d|\*\*", name)
    ):
        raise UnitError(f"unknown unit {name!r}")
    registry = _registry()
    try:
        have = registry.Quantity(1.0) * registry.parse_expression(name)
        if any(str(unit).endswith(_ANGLES) for unit, _ in have.unit_items()) is not ("rad" in si):
            raise UnitError(name)
        return float(have.to("" if si == "1" else si.replace(" ", "*")).magnitude)
    except Exception as error:  # pint's own, and those of Python's tokenizer and attribute look-up
        raise UnitError(f"unknown unit {name!r}") from error
