"""The ``info`` of a batch, in the form that Gymnasium's vector environments give it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Flags = NDArray[np.bool_]


def row(info: Mapping[str, Any]) -> dict[str, Any]:
    """The info of a single environment from that of a batch of one."""
    single: dict[str, Any] = {}
    for key, value in info.items():
        if isinstance(value, dict):
            single[key] = row(value)
        else:
            single[key] = value[0].copy() if value.ndim > 1 else value[0].item()
    return single


def masked(info: Mapping[str, Any], rows: Flags) -> dict[str, Any]:
    """Gymnasium's form of a batch's info: zero where not meant, and a mask beside every entry."""
    result: dict[str, Any] = {}
    if not rows.any():
        return result
    for key, value in info.items():
        if isinstance(value, dict):
            result[key] = masked(value, rows)
        else:
            result[key] = np.where(rows.reshape(-1, *[1] * (value.ndim - 1)), value, np.zeros_like(value))
        result[f"_{key}"] = rows.copy()
    return result


def merged(first: Mapping[str, Any], second: Mapping[str, Any]) -> dict[str, Any]:
    """Join the infos of disjoint rows."""
    result = dict(first)
    for key, value in second.items():
        if key not in result:
            result[key] = value
        elif isinstance(value, dict):
            result[key] = merged(result[key], value)
        else:
            result[key] = result[key] | value if value.dtype == np.bool_ else result[key] + value
    return result
