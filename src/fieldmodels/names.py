"""Names: the machine's in a file, the class that goes by one, what to say of one that nobody knows."""

import difflib
from collections.abc import Iterable, Mapping
from typing import Any


def did_you_mean(name: object, known: Iterable[str]) -> str:
    """Return " (did you mean 'x'?)" for the closest known name, or the list of known names."""
    choices = list(known)
    close = difflib.get_close_matches(str(name), choices, n=1)
    return f" (did you mean {close[0]!r}?)" if close else f" (known: {', '.join(choices) or 'none'})"


def machine_in(data: Mapping[str, Any]) -> Any:
    """What a file names as its machine, under ``model`` as in 0.1, too; None if nothing."""
    return data.get("machine", data.get("model"))


def class_name(name: str) -> str:
    """The class that goes by a name: ``HeelStrike`` by ``heel_strike``."""
    return name.title().replace("_", "")
