"""What a column's name says, in the languages of ``words.yaml``, and how well it suits a model's signal."""

from __future__ import annotations

import re
import unicodedata
from functools import cache
from pathlib import Path

from fieldmodels.model import Model, Signal
from fieldmodels.recording.dialect import LETTERS, unit_of
from fieldmodels.recording.units import UnitError, canonical, factor, is_unit, si_unit, zero_of
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
}  # fmt: skip
_PLACES = ("left", "right", "x", "y")


@cache
def _words() -> dict[str, frozenset[str]]:
    """Word to what it may mean."""
    table = load_yaml(Path(__file__).with_name("words.yaml"))
    meanings: dict[str, set[str]] = {}
    for meaning, words in table.items():
        for word in words:
            meanings.setdefault(word, set()).add(str(meaning))
    return {word: frozenset(found) for word, found in meanings.items()}


def meanings(name: str) -> frozenset[str]:
    """What the words of a name mean, and longer ones that no list contains; its unit is left aside."""
    stated = unit_of(name)
    name = name[: -len(stated)] if stated and name.endswith(stated) else name
    bare = re.sub(r"[\[(][^\])]*[\])]", " ", name)
    plain = unicodedata.normalize("NFKD", bare.replace("ß", "ss"))
    plain = "".join(c for c in plain if not unicodedata.combining(c))
    parts = re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", plain)
    if len(parts) > 1 and (parts[-1] in (*LETTERS, "m") or (is_unit(parts[-1]) and len(parts[-1]) > 1)):
        parts = parts[:-1]
    found: set[str] = set()
    for part in (p.lower() for p in parts):
        whole = _words().get(part)
        if whole is not None:
            found |= whole
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
    return frozenset(found)


def quantity(found: frozenset[str], unit: str) -> str:
    """The quantity of a column by its words, else by its unit; empty if neither tells."""
    try:
        plain = si_unit(unit)[0] if unit else ""
        by_unit = _BY_UNIT.get(plain, "" if plain == "1" else plain)
    except UnitError:
        by_unit = ""
    by_word = next((q for q in _QUANTITIES if q in found), "")
    return by_unit or by_word or ("position" if {"x", "y"} & found else canonical(unit) if unit else "")


def suits(name: str, unit: str, signal: Signal, model: Model) -> float:
    """How well a column's name and unit suit a signal, 0 to 1; 1 only for the very name, its unit left aside.

    Args:
        name: The column's.
        unit: As the file states it, empty for none.
        signal: Of the model.
        model: Tells commands from measured signals.
    """
    convertible = True
    if unit and canonical(unit) != canonical(signal.unit):
        try:
            factor(unit, signal.unit)
        except UnitError:
            convertible = zero_of(unit, signal.unit) is not None
    if re.split(r"[\[(]", name)[0].strip().lower() == signal.name and convertible:
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
        score = min(score, 0.55) if theirs == "current" else 0.0
    if "turn" in wanted or "forward" in wanted or signal.name == "speed":
        turning = "turn" in found or _turning(unit)
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
    if not is_unit(unit) or canonical(unit) == canonical(signal.unit):
        return False
    theirs, ours = quantity(frozenset(), unit), quantity(frozenset(), signal.unit)
    return (
        theirs != ours
        and frozenset((theirs, ours)) not in _NEAR
        and "1" not in (signal.unit, canonical(unit))
    )


def _turning(unit: str) -> bool:
    try:
        return bool(unit) and si_unit(unit)[0] == "rad/s"
    except UnitError:
        return False


def is_time(name: str, unit: str) -> bool:
    """Whether a column's unit says that it holds times, or its name where no known unit is stated."""
    if unit:
        try:
            return si_unit(unit)[0] == "s"
        except UnitError:
            pass
    return "time" in meanings(name)
