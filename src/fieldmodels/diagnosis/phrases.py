"""How effects, signals and curves read in a sentence; in ``diagnosis.json`` they keep their names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from fieldmodels.drivers.variables import CHANGE, MEMORY, PLAY, SHARE, WAY
from fieldmodels.rounding import listed, words

SIZE, RATE = "size of ", "rate of "
CHANCE = "random changes of "
"""Begins the words for a value that varies by chance."""
CURVE = "curve of "
"""Begins the name of an alternative that is no listed effect."""
CONSTANT = "constant"
FORMULAS = {
    "ends": "only near the ends of its range",
    "sign": "by its sign alone",
    "sign and constant": "by its sign, and a constant",
    "size": "by its size",
    "square": "by its square",
    "root with sign": "by its root, with its sign",
    "power 1.5 with sign": "by its power 1.5, with its sign",
    "square with sign": "by its square, with its sign",
    "cube": "by its cube",
    "fifth power": "by its fifth power",
}
"""How a formula reads where its name alone says too little."""
UNCOUNTED = frozenset({
    "friction", "hysteresis", "cogging", "quantisation", "saturation", "clipping", "backlash", "slip", "drag",
    "compliance", "wind", "stiffness", "play", "wheels",
})  # fmt: skip
"""Last words of effects that take no article."""
QUANTITIES = frozenset({"gravity", "interval", "pitch", "position", "scale", "width", "yaw"})
"""Last words of effects that are named after a number of which the simulation has another value."""
NO_ARTICLE = frozenset({"time"})


def a(name: str) -> str:
    """An effect with its article: "an actuator delay", "Coulomb friction"."""
    if name.startswith(CURVE):
        over, _, place = name.removeprefix(CURVE).partition(", in ")
        if not place:
            return f"an unlisted force that depends on {_variable(over)}"
        return f"an unlisted dependence of {_place(place)} on {_variable(over)}"
    if name.startswith(CHANCE):
        return f"random changes of {the(name.removeprefix(CHANCE))}"
    plain = words(name)
    last = plain.rsplit(" ", 1)[-1]
    if last in QUANTITIES:
        return f"an error of the {plain}"
    if last in UNCOUNTED:
        return plain
    vowel = plain[0].lower() in "aeiou" and not plain.startswith(("one", "uni"))
    return f"{'an' if vowel else 'a'} {plain}"


def the(name: str) -> str:
    """A signal, a parameter or an effect that is known: "the left wheel", "x", "time"."""
    plain = words(name)
    return plain if len(plain) == 1 or plain in NO_ARTICLE or plain.startswith("the ") else f"the {plain}"


def sensor_of(name: str) -> str:
    """The sensor of a signal: "the position sensor"."""
    return f"the {words(name)} sensor"


def value_of(name: str) -> str:
    """A value by its full name: "the mass", "the actuator delay", "the force of the Coulomb friction"."""
    effect, _, parameter = name.rpartition(".")
    if not effect or effect.endswith(f"_{parameter}"):
        return the(effect or name)
    return f"the {words(parameter)} of {the(effect)}"


def lacking(sets: Sequence[Sequence[str]]) -> str:
    """What is missing: "a, b and c", or "either a or b, and c" where some could be another effect.

    Args:
        sets: Of each cause its name and those that could stand in its place.
    """
    parts = [listed([a(name) for name in names], "or") for names in sets]
    if all(len(names) == 1 for names in sets):
        return listed(parts)
    parts = [f"either {part}" if len(names) > 1 else part for part, names in zip(parts, sets, strict=True)]
    if len(parts) == 1:
        return parts[0]
    return f"{', '.join(parts[:-1])}, and {parts[-1]}"


def times_the_noise(ratios: Mapping[str, float]) -> str:
    """How far errors are above the noise, by signal: "3.0 times in the position"."""
    return listed([f"{times:.1f} times in {the(name)}" for name, times in ratios.items()])


def depends_on(place: str, target: str, over: str, formula: str = "") -> str:
    """What a curve depends on, how, and where it acts: what follows "it depends on".

    Args:
        place: Where it acts, as of ``MissingCurve``.
        target: On what there.
        over: Its variable.
        formula: The known function that it is, "" if it is none.
    """
    acts = {
        "force": the(target) if target else "",
        "sensor": sensor_of(target),
        "parameter": value_of(target),
        "odds": f"the log-odds of {the(target)}",
    }[place]
    if target.startswith(SHARE):
        acts = f"{the(target.removeprefix(SHARE))}, in proportion to it"
    run = f" ({FORMULAS.get(formula, formula)})" if formula else ""
    on = "nothing that was measured (it is constant)" if formula == CONSTANT else f"{_variable(over)}{run}"
    return f"{on}{f' and acts on {acts}' if acts else ''}"


def _place(name: str) -> str:
    """Where a curve acts, as ``direction_of`` says it."""
    plain = name.removeprefix("the ")
    if plain.startswith("sensor of "):
        return sensor_of(plain.removeprefix("sensor of "))
    if plain.startswith("log-odds of "):
        return f"the log-odds of {the(plain.removeprefix('log-odds of '))}"
    return value_of(plain.removeprefix(SHARE))


def _variable(over: str) -> str:
    if " times " in over:
        return " times ".join(map(_variable, over.split(" times ", 1)))
    if over.startswith(SIZE):
        return f"the size of {_variable(over.removeprefix(SIZE))}"
    if over.startswith(RATE):
        return f"the rate of change of {_variable(over.removeprefix(RATE))}"
    if over.startswith(WAY):
        return f"the integral of {_variable(over.removeprefix(WAY))} over time"
    if over.startswith(CHANGE):
        return f"the change of {the(over.removeprefix(CHANGE))}"
    if over.startswith(MEMORY):
        name, _, time = over.removeprefix(MEMORY).rpartition(" over ")
        return f"the recent mean of {_variable(name)} (over {time})"
    if over.startswith(PLAY):
        name, _, half = over.removeprefix(PLAY).rpartition(" of ")
        return f"{_variable(name)} behind a play of {half}"
    return the(over)
