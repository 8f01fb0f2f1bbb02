"""The bound of each layout, proven once: kept in the user's cache folder, a file for each world.

Results are the same without such a file. One that cannot be read or is of other code is replaced; of two
processes that write at once one may prove again what the other has proven.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs

from fieldagents.tasks.uav_route import lower_bound
from fieldgym.settings import read_settings
from fieldgym.uav_route import UavRouteSettings
from fieldmodels.arrays import FloatArray
from fieldmodels.code import reached_code
from fieldmodels.files import OutputError, write_text
from fieldmodels.machines.uav_route.parameters import Layout, World


def shortest_flights(
    settings: Mapping[str, Any], info: Mapping[str, Any], say: Callable[[str], None]
) -> FloatArray:
    """The bound of each episode of a batch [km], of several aircraft their sum, shape (batch,).

    Args:
        settings: Those of the environment that are not the defaults.
        info: The first ``info`` of the episodes.
        say: Told what is proven, and how far that is.
    """
    read: UavRouteSettings = read_settings(dict(settings), UavRouteSettings)
    each = kept_bounds(lower_bound.layouts_of(info), read.world, read.capture, say)
    bounds: FloatArray = np.reshape(each, (-1, read.aircraft)).sum(axis=1)
    return bounds


def kept_bounds(
    layouts: Sequence[Layout], world: World, capture: float, say: Callable[[str], None]
) -> list[float]:
    """The length of ``bound_to_capture`` of each layout [km], computed only where it is not kept."""
    world = lower_bound.that_matters(world)
    folder = Path(platformdirs.user_cache_dir("fieldgym")) / "bounds"
    path = folder / f"{_hash((world, capture))}.json"
    known = _kept(path)
    keys = [_hash(layout) for layout in layouts]
    new = {key: layout for key, layout in zip(keys, layouts, strict=True) if key not in known}
    found = {}
    for number, (key, layout) in enumerate(new.items()):
        if number % math.ceil(len(new) / 10) == 0:
            say(f"Proving bounds of {len(new)} layouts ({number} of {len(new)})")
        found[key] = lower_bound.bound_to_capture(layout, world, capture)[0]
    if new:
        whole = {"code": _code(), "bounds": _kept(path) | found}
        with suppress(OSError, OutputError):
            write_text(path, json.dumps(whole))
    return [(known | found)[key] for key in keys]


def _kept(path: Path) -> dict[str, float]:
    """What a file keeps of this very code; nothing if it is damaged."""
    try:
        whole = json.loads(path.read_text(encoding="utf-8"))
        if whole["code"] == _code() and all(value > 0.0 for value in whole["bounds"].values()):
            return dict(whole["bounds"])
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        pass
    return {}


def _code() -> str:
    return reached_code((lower_bound.__name__,))


def _hash(of: object) -> str:
    """Of dataclasses of numbers and names, whose ``repr`` has every digit."""
    return hashlib.sha256(repr(of).encode()).hexdigest()[:20]
