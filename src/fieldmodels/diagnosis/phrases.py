"""How a curve reads in a sentence; in ``diagnosis.json`` its variable and its place keep their names."""

from __future__ import annotations

from fieldmodels.drivers.variables import CHANGE, MEMORY, PLAY, SHARE, WAY
from fieldmodels.rounding import words

SIZE, RATE = "size of ", "rate of "
FORMULAS = {"ends": "only near the ends of its range"}
"""How a formula reads where its name alone says too little."""


def depends_on(place: str, target: str, over: str, formula: str = "") -> str:
    """What a curve depends on, how, and where it acts: what follows "it depends on".

    Args:
        place: Where it acts, as of ``MissingCurve``.
        target: On what there.
        over: Its variable.
        formula: The known function that it is, "" if it is none.
    """
    acts = {
        "force": f"the {words(target)}" if target else "",
        "sensor": f"the sensor of {words(target)}",
        "parameter": words(target),
        "odds": f"the log-odds of {words(target)}",
    }[place]
    if target.startswith(SHARE):
        acts = f"the {words(target.removeprefix(SHARE))}, in proportion to it"
    run = f" ({FORMULAS.get(formula, formula)})" if formula else ""
    return f"{_variable(over)}{run}{f', and acts on {acts}' if acts else ''}"


def _variable(over: str) -> str:
    if " times " in over:
        return " times ".join(map(_variable, over.split(" times ", 1)))
    if over.startswith(SIZE):
        return f"the size of {_variable(over.removeprefix(SIZE))}"
    if over.startswith(RATE):
        return f"the rate of change of {words(over.removeprefix(RATE))}"
    if over.startswith(WAY):
        return f"the integral of {words(over.removeprefix(WAY))} over time"
    if over.startswith(CHANGE):
        return f"the {words(over)}"
    if over.startswith(MEMORY):
        name, _, time = over.removeprefix(MEMORY).rpartition(" over ")
        return f"the recent mean of {_variable(name)} (over {time})"
    if over.startswith(PLAY):
        name, _, half = over.removeprefix(PLAY).rpartition(" of ")
        return f"{_variable(name)} behind a play of {half}"
    return words(over)
