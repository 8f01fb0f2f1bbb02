"""What a column's name says, in the languages of ``words.yaml``, and how well it suits a model's signal."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator, Sequence
from functools import cache
from itertools import accumulate
from pathlib import Path

from fieldmodels.model import Model, Signal
from fieldmodels.recording.units import (
    UnitError,
    canonical,
    converts,
    is_unit,
    is_unscaled,
    known_units,
    si_unit,
    zero_of,
)
from fieldmodels.yaml import load_yaml

_SHORT = 4  # letters from which a word counts within a longer one (Sollmoment)
_QUANTITIES = (
    "acceleration", "velocity", "heading", "torque", "force", "current", "voltage", "temperature", "power",
    "pressure", "angle", "position",
)  # fmt: skip
_BY_UNIT = {  # of any other unit its dimension is the quantity
    "s": "time", "rad": "angle", "m": "position", "rad/s": "velocity", "m/s": "velocity", "N": "force",
    "N m": "torque", "A": "current", "V": "voltage", "rad/s^2": "acceleration", "m/s^2": "acceleration",
    "K": "temperature", "°C": "temperature", "W": "power", "Pa": "pressure",
}  # fmt: skip
_NEAR = {
    frozenset(("angle", "position")): 0.85, frozenset(("angle", "heading")): 0.9,
    frozenset(("torque", "force")): 0.5, frozenset(("torque", "current")): 0.55,
    frozenset(("force", "current")): 0.5, frozenset(("current", "voltage")): 0.3,
    frozenset(("torque", "voltage")): 0.4, frozenset(("force", "voltage")): 0.4,  # of a motor without a drive
}  # fmt: skip
_ROLES = {"command", "measured"}
_PLACES = ("left", "right", "x", "y")
_LETTERS = ("N", "V", "A", "s")  # units of one letter that a name may end with, as in F_N
_BRACKETS = re.compile(r"\[([^\[\]]*)\]|\(([^()]*)\)")
_INDEX = re.compile(r"[\d\s.,:;+-]*\d[\d\s.,:;+-]*")
_SIZE = re.compile(r"(?i)^([+-]?[1-9][\d.,]*\s+(?=\D)|units?:\s*)")
_GREEK = re.compile("[α-ωΑ-Ω]")
_ARGUMENT = re.compile(r"(?<=\w)[(\[][tkin][)\]]")  # x(t) is no number of tonnes


@cache
def _words() -> dict[str, frozenset[str]]:
    """Word to what it may mean."""
    table = load_yaml(Path(__file__).with_name("words.yaml"))
    meanings: dict[str, set[str]] = {}
    for meaning, words in table.items():
        for word in words:
            meanings.setdefault(word, set()).add(str(meaning))
    return {word: frozenset(found) for word, found in meanings.items()}


def unit_of(header: str) -> str:
    """The unit that a header states, known or not; empty for none: see ``without_unit``."""
    return without_unit(header)[1]


@cache
def without_unit(header: str) -> tuple[str, str]:
    """A column's name and the unit that its header states: the one place where units are read from names.

    ``angle [deg]``, ``speed (rpm) left``, ``power/W``, ``x in mm``, ``pos_deg`` and ``v_mm_s`` do. An index
    does not (``control[0]``, ``motor (5)``), nor words in brackets that describe (``W (IMU)``). What else
    stands in brackets is given as it is, whether or not it is a unit that anybody knows.
    """
    header = _ARGUMENT.sub("", header).rstrip("_")  # MATLAB makes Torque_Nm_ of Torque [Nm]
    found = [(match, (match[1] or match[2] or "").strip()) for match in _BRACKETS.finditer(header)]
    told = [(m, text) for m, text in found if m.start() and text and not _INDEX.fullmatch(text)]
    name, _, last = _BRACKETS.sub("", header).rpartition(", ")
    if name and _is_stated(last.strip(), name):  # Temp, °C (serial number)
        return name, last.strip()
    known = [
        (match, text)
        for match, text in told
        if _is_stated(text, header[: match.start()], match[0][0] == "[" or not _describes(text))
    ]
    for match, text in (known or [one for one in told if not _describes(one[1])])[-1:]:
        return f"{header[: match.start()]} {header[match.end() :]}".strip(), text
    parts = [] if header.startswith("/") else header.split("/")  # a topic has a path
    ends = [("/".join(parts[:i]), "/".join(parts[i:]), 1) for i in range(1, len(parts))]  # rad/s before its s
    ends += [(*header.rpartition(mark)[::2], least) for mark, least in ((" in ", 1), ("_", 2), (" ", 2))]
    words = header.split("_")
    ends += [("_".join(words[:-2]), "/".join(words[-2:]), 1)]  # speed_mm_s
    for name, last, least in sorted(ends, key=lambda end: -len(end[1])):
        name, last = name.strip(), last.strip()
        long = len(last) >= least or (last in _LETTERS and header == f"{name}_{last}")
        bare = name and long and not last.isdigit() and not set(last) & set("[]()")
        if bare and _is_stated(last, name) and _goes_with(name, last):
            return name, last
        if name and len(last) > 1 and header.islower() and (unit := _cased(last, name)):
            return name, unit
    return header, ""


def names_and_units(above: Sequence[Sequence[str]], width: int) -> tuple[list[str], list[str]]:
    """Which line above the data names the columns, and which states their units.

    Args:
        above: The last lines above the data, each a cell a column.
        width: Number of columns.

    Returns:
        Names and units, empty where there are none.
    """
    units, rest = [""] * width, list(above)
    for i, line in reversed(list(enumerate(above[1:] and above))):
        cells = [_SIZE.sub("", cell.strip("[]() ")) for cell in line]  # a range states a unit, too: 20 mm
        said = [_is_stated(cell, "", not _describes(cell)) for cell in cells if cell]
        if sum(said) > 0.5 * len(said):
            label = cells[0] and not said[0] and all(said[1:])  # of the row, not the unit of a column
            units = ["", *cells[1:]] if label else cells
            rest = (
                [above[i - 1]] if i and _full(above[i - 1]) else [*above[max(i - 2, 0) : i], *above[i + 1 :]]
            )
            break
    whole = filter(_full, rest)  # no title, no row of groups
    names = list(next(whole, rest[-1] if rest else [""] * width))
    if rest and len(set(names)) < width:
        # Each group's name stands above the first of its columns.
        groups: Iterator[str] = accumulate(rest[-2:][0], lambda last, cell: cell or last)
        told = [f"{group} {name}".strip() for group, name in zip(groups, names, strict=True)]
        names = told if len(rest) > 1 and len(set(told)) == width else names
        times = {n for n, unit in zip(names, units, strict=True) if names.count(n) > 1 and is_time(n, unit)}
        beside = zip(names, [*names[1:], ""], strict=True)  # of channels that each have times at their left
        names = [f"{name} ({channel})" if name in times and channel else name for name, channel in beside]
    return names, [unit or unit_of(name) for name, unit in zip(names, units, strict=True)]


def _full(line: Sequence[str]) -> bool:
    """Whether each column has a cell of its own."""
    return all(line) and len(set(line)) == len(line)


def short(header: str) -> str:
    """A name in lower case up to its first bracket."""
    return re.split(r"[\[(]", header)[0].strip().lower()


def _is_stated(text: str, name: str, sure: bool = False) -> bool:
    """Whether a text is a unit: a usual one, or one of pint's, which knows "act" as a small tonne.

    Args:
        text: The text.
        name: What it ends, of whose quantity one of pint's must be.
        sure: Unless it stands in brackets, or in a row of units, and is no other word.
    """
    if is_unit(text, usual=True) or is_unscaled(text):
        return True
    if len(text) < 2 or not (sure or quantity(meanings(name), "")) or not is_unit(text):
        return False
    return sure or _alike(quantity(meanings(name), ""), quantity(frozenset(), text))


def _cased(text: str, name: str) -> str:
    """The usual unit of a name's quantity that a name in lower case ends with (``torque_nm``), or nothing."""
    wanted = quantity(meanings(name), "")
    alike = (unit for unit in known_units() if canonical(unit).replace(" ", "").lower() == text)
    return next((unit for unit in alike if wanted and quantity(frozenset(), unit) == wanted), "")


def _goes_with(name: str, unit: str) -> bool:
    """Whether a name's quantity may have a unit: what flows in (`current_in`) is not in inches."""
    one, other = quantity(meanings(name), ""), quantity(frozenset(), unit)
    return not (one and other in _QUANTITIES) or _alike(one, other)


def _describes(text: str) -> bool:
    """Whether words in brackets say what a column is ("left", "IMU", "arm.phi"), and so state no unit."""
    return re.search(r"[A-Za-z]{3}\.\w", text) is not None or all(
        word in _words() for word in re.findall(r"[a-z]+", _plain(text).lower())
    )


def _plain(text: str) -> str:
    """Without accents, and Greek letters by their names."""
    letters = unicodedata.normalize("NFKD", text.replace("ß", "ss"))
    plain = "".join(c for c in letters if not unicodedata.combining(c))
    return _GREEK.sub(lambda letter: f" {unicodedata.name(letter[0]).split()[-1].lower()} ", plain)


def _alike(one: str, other: str) -> bool:
    return bool(one) and (one == other or frozenset((one, other)) in _NEAR)


@cache
def meanings(name: str) -> frozenset[str]:
    """What the words of a name mean, and longer ones that no list contains; its unit is left aside."""
    if rate := re.fullmatch(r"der\((.+)\)", name):  # Modelica's
        return meanings(rate[1]) | {"velocity"}
    plain = _plain(without_unit(name)[0])
    parts = re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", plain)
    if len(parts) > 1 and (
        parts[-1] in (*_LETTERS, "m") or (is_unit(parts[-1], usual=True) and len(parts[-1]) > 1)
    ):
        parts = parts[:-1]
    found: set[str] = set()
    for part in (p.lower() for p in parts):
        whole = _words().get(part)
        if whole is not None:
            found = found - (_ROLES if whole & _ROLES else set()) | whole  # the last one: controller.state
            continue
        inside = sorted((w for w in _words() if len(w) >= _SHORT and w in part), key=len, reverse=True)
        for word in inside:
            if word in part:
                found |= _words()[word]
                part = part.replace(word, " ")
        if part.startswith("ist"):
            found.add("measured")
        elif not inside and len(part) >= _SHORT:
            found.add(f"'{part}'")
    return frozenset(found | ({"turn"} if {"heading", "velocity"} <= found else set()))


def quantity(found: frozenset[str], unit: str) -> str:
    """The quantity of a column by its words, else by its unit; empty if neither tells."""
    try:
        plain = si_unit(unit)[0] if unit else ""
        by_unit = _BY_UNIT.get(plain, "" if plain == "1" else plain)
    except UnitError:
        by_unit = ""
    by_word = next((q for q in _QUANTITIES if q in found), "")
    if by_unit == "angle" and by_word == "heading":  # a pitch is an angle, too, and no heading
        return by_word
    return by_unit or by_word or ("position" if {"x", "y"} & found else canonical(unit) if unit else "")


def suits(name: str, unit: str, signal: Signal, model: Model) -> float:
    """How well a column's name and unit suit a signal, 0 to 1; 1 only for the very name, its unit left aside.

    Args:
        name: The column's.
        unit: As the file states it, empty for none.
        signal: Of the model.
        model: Tells commands from measured signals.
    """
    convertible = not (is_unit(unit) and signal.unit) or converts(unit, signal.unit)
    convertible = convertible or zero_of(unit, signal.unit) is not None
    if short(name) == signal.name and convertible:
        return 1.0
    found, wanted = meanings(name), meanings(signal.name)
    theirs = quantity(found, unit)
    ours = quantity(wanted, "" if signal.unit == "1" else signal.unit)
    command = signal in model.inputs
    places = [p for p in _PLACES if any(p in meanings(s.name) for s in model.signals)]
    if any((place in found) != (place in wanted) for place in places):
        return 0.0
    if theirs and ours:
        score = 1.0 if theirs == ours else _NEAR.get(frozenset((theirs, ours)), 0.0)
    else:
        score = 0.6 if command and "command" in found else 0.6 if found & wanted - {"measured"} else 0.0
    if not convertible:
        score = min(score, 0.55) if theirs in ("current", "voltage") else 0.0
    if "turn" in wanted or signal.unit == "m/s":  # a gyro shows the one, an encoder or odometry the other
        turning = ("turn" in found and "forward" not in found) or (unit != "" and converts(unit, "rad/s"))
        score *= 0.3 if turning != ("turn" in wanted) else 1.0
    if (command and "measured" in found) or (not command and "command" in found and "measured" not in found):
        score *= 0.4 if signal not in model.measured_inputs else 0.1
    if signal in model.measured_inputs and "measured" not in found:
        score *= 0.3
    if command and "command" in found:
        score += 0.03
    return min(0.95, 0.9 * score + 0.05 * bool(found & wanted)) if score > 0 else 0.0


def other_quantity(signal: Signal, unit: str) -> bool:
    """Whether a stated unit rules a signal out: of another quantity, which cannot stand for it."""
    if not (is_unit(unit) and signal.unit) or canonical(unit) == canonical(signal.unit):
        return False
    theirs, ours = quantity(frozenset(), unit), quantity(frozenset(), signal.unit)
    return (
        theirs != ours
        and frozenset((theirs, ours)) not in _NEAR
        and "1" not in (signal.unit, canonical(unit))
    )


def is_time(name: str, unit: str) -> bool:
    """Whether a column's unit says that it holds times, or its name where no known unit is stated."""
    return converts(unit, "s") if is_unit(unit) else "time" in meanings(name)
