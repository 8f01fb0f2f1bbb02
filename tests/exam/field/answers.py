"""What is right to say of a case, as ``answers.yaml`` fixed it before any engine ran."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fieldmodels.yaml import load_yaml

from .cases import FieldCase


@dataclass(frozen=True)
class Right:
    """What is right to say of a case; the file says what its words mean.

    Attributes:
        names: Sets of effects, of which any is right.
        curves: Places over variables, of which any is right.
        unexplained: Whether it is right to say that something is missing, and not what.
        refusal: A word of an answer that refuses; empty where none is right.
    """

    names: tuple[frozenset[str], ...] = ()
    curves: tuple[str, ...] = ()
    unexplained: bool = False
    refusal: str = ""


ANSWERS: dict[str, dict[str, dict[str, Any]]] = load_yaml(Path(__file__).parent / "answers.yaml")
"""By kind, then by machine and size, by machine, or ``all``."""


def right(case: FieldCase) -> Right:
    """What is right to say of a case.

    Raises:
        KeyError: If the file does not say.
    """
    of_kind = ANSWERS[case.kind]
    words = f"{case.machine}/{case.size}", case.machine, "all"
    said = next((of_kind[word] for word in words if word in of_kind), None)
    if said is None:
        raise KeyError(case.key)
    return Right(
        tuple(frozenset(one) for one in said.get("names", ())),
        tuple(said.get("curves", ())),
        bool(said.get("unexplained", False)),
        str(said.get("refusal", "")),
    )
