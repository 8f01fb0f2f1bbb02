"""The ``info`` of a batch, in the form that Gymnasium's vector environments give it.

Every entry is an array, under a name whose dots say where it belongs: ``privileged.reality.wind.north``.
Nested mappings, which Gymnasium allows, are more than libraries that store an ``info`` can take.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Flags = NDArray[np.bool_]


class Info(NamedTuple):
    """The info of a batch, most of it numbers that a kernel has written into one array.

    Attributes:
        names: Of the numbers.
        numbers: Shape (len(names), batch).
        others: Further entries, each an array of shape (batch, ...).
    """

    names: tuple[str, ...]
    numbers: NDArray[np.float64]
    others: dict[str, Any]

    def entries(self) -> dict[str, Any]:
        """All entries by name."""
        return dict(zip(self.names, self.numbers, strict=True)) | self.others


InfoLike = Info | dict[str, Any]


def part(info: Mapping[str, Any], name: str) -> dict[str, Any]:
    """What belongs to a name, without it and without masks, as nested mappings.

    ``part(info, "privileged")["reality"]`` reads again as ``reality=`` where ``info`` is of one environment.
    """
    result: dict[str, Any] = {}
    for key, value in info.items():
        if key.startswith(f"{name}."):
            *places, last = key[len(name) + 1 :].split(".")
            inner = result
            for place in places:
                inner = inner.setdefault(place, {})
            inner[last] = value
    return result


def row(info: InfoLike) -> dict[str, Any]:
    """The info of a single environment from that of a batch of one; arrays are views."""
    if type(info) is Info:
        names, numbers, info = info
        single: dict[str, Any] = dict(zip(names, numbers[:, 0].tolist(), strict=False))
    else:
        single = {}
    assert type(info) is dict
    for key, value in info.items():
        single[key] = value.item(0) if value.ndim == 1 else value[0]
    return single


@lru_cache(maxsize=64)
def every_row(batch: int) -> Flags:
    """The mask of an entry that is valid in all rows, shape (batch,), read-only."""
    mask = np.ones(batch, dtype=np.bool_)
    mask.flags.writeable = False
    return mask


_MASKS: dict[Any, dict[str, Flags]] = {}
"""Masks of an info's entries, by their names and the batch."""


def complete(info: InfoLike, batch: int) -> dict[str, Any]:
    """Gymnasium's form of a batch's info that is valid in all rows: a mask beside every entry."""
    names, numbers, others = info if type(info) is Info else ((), (), info)
    assert type(others) is dict
    key = (names, tuple(others), batch)
    masks = _MASKS.get(key)
    if masks is None:
        masks = _MASKS[key] = {"_" + name: every_row(batch) for name in (*names, *others)}
    result: dict[str, Any] = masks.copy()
    result.update(zip(names, numbers, strict=False))
    result.update(others)
    return result


def merged(stepped: InfoLike, restarted: InfoLike, begun: Flags) -> dict[str, Any]:
    """Gymnasium's form of the info of a batch in which some rows have begun a new episode.

    Args:
        stepped: Info of a step, computed for all rows.
        restarted: Info of a reset, computed for all rows; an entry of both has one shape and dtype.
        begun: Rows to which the latter applies, shape (batch,).

    Returns:
        Each entry beside its mask, and zero where it is not valid.
    """
    if begun.all():
        return complete(restarted, len(begun))
    steps = stepped.entries() if isinstance(stepped, Info) else stepped
    resets = restarted.entries() if isinstance(restarted, Info) else restarted
    result: dict[str, Any] = {}
    for key in {**steps, **resets}:
        step, reset = steps.get(key), resets.get(key)
        entry: Any = reset if step is None else step
        nothing = np.zeros_like(entry)
        result[key] = np.where(
            begun.reshape(-1, *[1] * (entry.ndim - 1)),
            nothing if reset is None else reset,
            nothing if step is None else step,
        )
        both = step is not None and reset is not None
        result["_" + key] = every_row(len(begun)) if both else begun.copy() if step is None else ~begun
    return result
