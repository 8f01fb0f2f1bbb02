"""Names: the class that goes by one, and what to say of one that nobody knows."""

import difflib
from collections.abc import Iterable


def did_you_mean(name: object, known: Iterable[str]) -> str:
    """Return " (did you mean 'x'?)" for the closest known name, or the list of known names."""
    choices = list(known)
    close = difflib.get_close_matches(str(name), choices, n=1)
    return f" (did you mean {close[0]!r}?)" if close else f" (known: {', '.join(choices) or 'none'})"


def class_name(name: str) -> str:
    """The class that goes by a name: ``HeelStrike`` by ``heel_strike``."""
    return name.title().replace("_", "")
