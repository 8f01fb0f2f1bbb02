"""Commands whose code stays in a checkout of the project: the exam of the diagnosis."""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import typer

ROOT = Path(__file__).parents[2]
CLONE = """It is in a checkout of the project alone, and nothing of it installs:
git clone REPOSITORY fieldgym && cd fieldgym && make {name}"""


class CheckoutError(ValueError):
    """A command is not installed; the message says how to get it."""


def add_command(app: typer.Typer, name: str, folder: str) -> None:
    """Add a command of a checkout, or one that says how to get it.

    Args:
        app: The command line.
        name: Of the command, and of its package, whose module ``command`` has a function of this name.
        folder: Where in a checkout the package is.
    """
    if (ROOT / folder / name / "command.py").is_file():
        sys.path.append(str(ROOT / folder))
        app.command(name)(getattr(import_module(f"{name}.command"), name))
    else:
        app.command(name, context_settings={"allow_extra_args": True, "ignore_unknown_options": True})(
            _missing(name)
        )


def _missing(name: str) -> Callable[..., Any]:
    def command() -> None:
        raise CheckoutError(CLONE.format(name=name))

    command.__doc__ = CLONE.format(name=name)
    return command
