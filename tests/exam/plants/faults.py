"""What a fault is that no model lists."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

P = TypeVar("P")
S = TypeVar("S")


@dataclass(frozen=True)
class Fault(Generic[P, S]):
    """A kind of fault that no model lists.

    Attributes:
        words: What is wrong, in one sentence.
        act: Lets it act on a plant: (plant, size, scales of the machine, source of randomness).
        near: Ends of names that say the same, if a diagnosis knows more than the model lists.
        random: Whether what it adds is chance, so that no extension of a simulation can regain it.
        needs: Outputs without which it does not show, or is the same as something listed.
        shows: Where a curve that is it acts, and over what, as ``places`` reads it; empty if no curve of the
            machine's signals is it.
    """

    words: str
    act: Callable[[P, float, S, np.random.Generator], None]
    near: tuple[str, ...] = ()
    random: bool = False
    needs: tuple[str, ...] = ()
    shows: tuple[str, ...] = ()
