"""Rows of a machine's numbers that kernels read by the names under which they are declared.

A parameter vector of a ``Model`` holds base parameters, then every effect's. Seen as a record of ``row_type``
the same memory is read as ``q.track`` and ``q.actuator_lag.time_constant`` in a compiled kernel, where a name
costs nothing and a wrong one does not compile, and as ``q["actuator_lag"]["time_constant"]`` in Python.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.model import Effect, ModelError, Parameter, Where

RowType = np.dtype[np.void]


def row_type(parameters: Sequence[Parameter], effects: Sequence[Effect], *, grouped: bool = False) -> RowType:
    """The type of one parameter vector as a record.

    Args:
        parameters: Base parameters, each a field of its own.
        effects: Effects, each a nested record of its parameters.
        grouped: True makes one array of neighbouring base parameters whose names differ in their last part
            only: ``damping_x``, ``damping_y``, ``damping_z`` are read as ``q.damping[axis]``.
    """
    names = [p.name.rpartition("_")[0] if grouped and "_" in p.name else p.name for p in parameters]
    fields: list[tuple[Any, ...]] = []
    for name, group in itertools.groupby(names):
        count = len(list(group))
        fields.append((name, np.float64, (count,)) if count > 1 else (name, np.float64))
    fields += [(effect.name, [(p.name, np.float64) for p in effect.parameters]) for effect in effects]
    return np.dtype(fields)


def as_rows(vectors: ArrayLike, row: RowType) -> NDArray[Any]:
    """Parameter vectors as records.

    Args:
        vectors: Shape (..., numbers of a row).
        row: Type of a row.

    Returns:
        Shape (...); it shares the memory of ``vectors`` if these are contiguous floats.

    Raises:
        ModelError: If a vector is not as long as a row.
    """
    array = np.ascontiguousarray(vectors, dtype=np.float64)
    length = row.itemsize // array.itemsize
    if array.ndim == 0 or array.shape[-1] != length:
        raise ModelError(f"a parameter vector of this machine has {length} numbers, not shape {array.shape}")
    rows: NDArray[Any] = array.view(row)[..., 0]
    return rows


def neutral(parameters: Sequence[Parameter], effects: Sequence[Effect]) -> FloatArray:
    """The declared values: base parameters as stated, every effect off; shape (numbers of a row,)."""
    return np.array([p.nominal for p in parameters] + [p.nominal for e in effects for p in e.parameters])


def any_on(
    vectors: FloatArray,
    parameters: Sequence[Parameter],
    effects: Sequence[Effect],
    where: Where | None = None,
) -> NDArray[np.bool_]:
    """Whether any effect is on in each vector, that is has a number other than its neutral one.

    Args:
        vectors: Parameter vectors, shape (..., numbers of a row).
        parameters: Base parameters.
        effects: All effects.
        where: Asks only for effects that act there.

    Returns:
        Shape (...).
    """
    asked = [False] * len(parameters)
    asked += [where in (None, effect.where) for effect in effects for _ in effect.parameters]
    on: NDArray[np.bool_] = ((vectors != neutral(parameters, effects)) & np.array(asked)).any(axis=-1)
    return on
