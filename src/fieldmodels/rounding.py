"""Numbers for readers: no more digits than are known."""

from __future__ import annotations

import math

KNOWN = 3  # digits of a value whose error nobody states
SMALL, LARGE = 1e-3, 1e5  # outside of these a power of ten is factored out
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def with_error(value: float, error: float = float("nan"), unit: str = "") -> str:
    """A value with its standard error: two digits of the error, and as many decimals of the value.

    Args:
        value: Any number.
        error: Its standard error; the value has three digits where it is 0 or not finite.
        unit: Its unit; "" or "1" for none.
    """
    unit = "" if unit in ("", "1") else f" {unit}"
    if not math.isfinite(value):
        return "unknown"
    known = math.isfinite(error) and error > 0
    size = max(abs(value), error if known else 0.0)
    power = math.floor(math.log10(size)) if size > 0 and not SMALL <= size < LARGE else 0
    value, error = value / 10.0**power, error / 10.0**power
    if known:
        decimals = max(_decimals(error, 2), 0)
        text = f"{value:.{decimals}f} ± {error:.{decimals}f}"
    else:
        text = f"{value:.{max(_decimals(value, KNOWN), 0)}f}"
    if power:
        scaled = f" · 10{str(power).translate(RAISED)}"
        text = f"({text}){scaled}" if known else text + scaled
    return text.replace("-", "−") + unit


def percent(value: float, interval: tuple[float, float] | None = None) -> str:
    """A share in percent with its interval: whole numbers, but one decimal within 1 % of 0 or of 100."""
    if not math.isfinite(value):
        return "unknown"
    ends = [] if interval is None or not all(map(math.isfinite, interval)) else list(interval)
    near = any(0 < abs(x - edge) < 1 for x in (value, *ends) for edge in (0, 100))
    main, *others = (f"{x:.{1 if near else 0}f}".replace("-", "−") for x in (value, *ends))
    return f"{main} %" + (f" ({others[0]} to {others[1]} %)" if others else "")


def words(name: str) -> str:
    """An identifier as a reader writes it: "Coulomb friction"."""
    plain = name.replace("_", " ").replace("one sided", "one-sided")
    return plain.replace("coulomb", "Coulomb").replace("stribeck", "Stribeck")


def listed(parts: list[str], last: str = "and") -> str:
    """Words as a list: "a, b and c"."""
    return f" {last} ".join([", ".join(parts[:-1]), parts[-1]] if len(parts) > 1 else parts)


def _decimals(value: float, digits: int) -> int:
    """Decimals that leave a number so many digits."""
    return 0 if value == 0 else digits - 1 - math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
