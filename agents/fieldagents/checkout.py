"""Commands whose code stays in a checkout of the project: the exam, and the papers."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path

import typer

ROOT = Path(__file__).parents[2]
CLONE = """This runs in a checkout of the project alone; nothing of it installs:
git clone REPOSITORY fieldgym && cd fieldgym && make {}"""


class CheckoutError(ValueError):
    """A command is not installed; the message says how to get it."""


def add_command(app: typer.Typer, name: str, place: str) -> None:
    """Add a command of a checkout, or one that says how to get it.

    Args:
        app: The command line.
        name: Of the command: a function in the module ``command`` of a package.
        place: Where in a checkout the package is; `make` has a target of its name.
    """
    folder = ROOT / place
    if (folder / "command.py").is_file():
        sys.path.append(str(folder.parent))
        app.command(name)(getattr(import_module(f"{folder.name}.command"), name))
        return

    def missing() -> None:
        raise CheckoutError(CLONE.format(folder.name))

    missing.__doc__ = CLONE.format(folder.name)
    app.command(name, context_settings={"allow_extra_args": True, "ignore_unknown_options": True})(missing)
