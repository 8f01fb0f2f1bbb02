"""Code that is written by a program and can be read as any other: in tracebacks, by ``inspect``."""

from __future__ import annotations

import linecache
from typing import Any


def run_text(text: str, title: str, scope: dict[str, Any]) -> None:
    """Run Python text, and remember it.

    Args:
        text: The text.
        title: In the place of its file's name, in angle brackets.
        scope: Its global names, to which it adds.
    """
    linecache.cache[title] = (len(text), None, text.splitlines(keepends=True), title)
    exec(compile(text, title, "exec"), scope)
