"""Units of columns, and their factors to the SI units of the models."""

from __future__ import annotations

from math import pi

from fieldmodels.names import did_you_mean

STANDARD_GRAVITY = 9.80665
"""Standard acceleration of gravity [m/s^2], exact (CGPM 1901)."""

_DEGREE = pi / 180
_RPM = 2 * pi / 60

# SI unit -> other unit of the same quantity -> factor. Keyed by quantity, so that "g" is a gram
# for a mass and the acceleration of gravity for an acceleration.
_FACTORS: dict[str, dict[str, float]] = {
    "s": {"ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0},
    "rad": {"mrad": 1e-3, "deg": _DEGREE, "rev": 2 * pi},
    "rad/s": {"mrad/s": 1e-3, "deg/s": _DEGREE, "rpm": _RPM, "rev/s": 2 * pi},
    "rad/s^2": {"deg/s^2": _DEGREE},
    "m": {"um": 1e-6, "mm": 1e-3, "cm": 1e-2, "km": 1e3, "in": 0.0254, "ft": 0.3048},
    "m/s": {"mm/s": 1e-3, "cm/s": 1e-2, "km/h": 1 / 3.6, "mph": 0.44704},
    "m/s^2": {"mm/s^2": 1e-3, "g": STANDARD_GRAVITY},
    "kg": {"g": 1e-3, "t": 1e3},
    "N": {"mN": 1e-3, "kN": 1e3, "kgf": STANDARD_GRAVITY, "lbf": 0.45359237 * STANDARD_GRAVITY},
    "N m": {"mN m": 1e-3, "N cm": 1e-2, "N mm": 1e-3, "kN m": 1e3},
    "Pa": {"hPa": 1e2, "kPa": 1e3, "bar": 1e5},
    "V": {"mV": 1e-3},
    "A": {"mA": 1e-3},
    "W": {"mW": 1e-3, "kW": 1e3},
    "1": {"%": 1e-2},
}

# Other spellings, after dots, stars and spaces have been unified.
_SPELLINGS = {
    "sec": "s",
    "seconds": "s",
    "µs": "us",
    "μs": "us",
    "°": "deg",
    "degree": "deg",
    "degrees": "deg",
    "°/s": "deg/s",
    "dps": "deg/s",
    "radians": "rad",
    "rad/sec": "rad/s",
    "1/min": "rpm",
    "RPM": "rpm",
    "U/min": "rpm",
    "kmh": "km/h",
    "kph": "km/h",
    "µm": "um",
    "μm": "um",
    "Nm": "N m",
    "mNm": "mN m",
    "Ncm": "N cm",
    "Nmm": "N mm",
    "kNm": "kN m",
    "m/s2": "m/s^2",
    "m/s²": "m/s^2",
    "rad/s2": "rad/s^2",
    "rad/s²": "rad/s^2",
    "": "1",
}


class UnitError(ValueError):
    """A unit that is unknown, or that does not measure the wanted quantity."""


def canonical(unit: str) -> str:
    """Return the project's spelling of a unit ("Nm" and "N*m" are "N m")."""
    spelled = " ".join(unit.replace("*", " ").replace("·", " ").split())
    return _SPELLINGS.get(spelled, spelled)


def known_units() -> tuple[str, ...]:
    """All units that a column may be declared in."""
    return tuple(dict.fromkeys(u for si, others in _FACTORS.items() for u in (si, *others)))


def other_units(wanted: str) -> dict[str, float]:
    """Units of the same quantity as an SI unit, with their factors to it; none for an unknown unit."""
    return dict(_FACTORS.get(canonical(wanted), {}))


def factor(unit: str, wanted: str) -> float:
    """Number by which a value in ``unit`` is multiplied to be in the SI unit ``wanted``.

    Raises:
        UnitError: If the unit is unknown or measures another quantity.
    """
    have, want = canonical(unit), canonical(wanted)
    if have == want:
        return 1.0
    others = _FACTORS.get(want, {})
    if have in others:
        return others[have]
    allowed = ", ".join([want, *others])
    if have in known_units():
        raise UnitError(f"unit {unit!r} does not measure a quantity in {wanted!r} (possible: {allowed})")
    raise UnitError(f"unknown unit {unit!r}{did_you_mean(have, [want, *others])}; possible: {allowed}")


def si_unit(unit: str) -> tuple[str, float]:
    """Return the SI unit of a unit's quantity, and the factor to it.

    Raises:
        UnitError: If the unit is unknown; for "g" too, which could be a mass or an acceleration.
    """
    have = canonical(unit)
    homes = [si for si, others in _FACTORS.items() if have == si or have in others]
    if len(homes) == 1:
        return homes[0], factor(have, homes[0])
    if homes:
        raise UnitError(f"unit {unit!r} could mean {' or '.join(homes)}; convert the column first")
    raise UnitError(f"unknown unit {unit!r}{did_you_mean(have, known_units())}")
