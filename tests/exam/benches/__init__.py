"""The benches of the exam: records of one machine each by a plant that shares no code with its model."""

from __future__ import annotations

from importlib import import_module

from exam.benches.base import FIRST, FIT, TEST, THIRD, Bench, Conditions, Hidden, Log, Set
from fieldmodels.model import ModelError
from fieldmodels.names import did_you_mean

PLACES = {
    "rig": "axis",
    "pendulum": "axis",
    "propeller_arm": "axis",
    "servo": "axis",
    "pose_reaching": "drive",
    "differential_drive": "drive",
    "line_following": "walk",
    "heel_strike": "leg",
    "uav_route": "flight",
    "excitation": "vehicle",
    "map": "map",
}
"""Which module here makes the records of a machine."""


def bench_names() -> tuple[str, ...]:
    """Names of the machines that are examined."""
    return tuple(PLACES)


def get_bench(name: str) -> Bench:
    """The bench of a machine, imported when it is asked for.

    Raises:
        ModelError: If the machine has none; the message says which have.
    """
    if name not in PLACES:
        raise ModelError(f"no exam of a machine {name!r}{did_you_mean(name, PLACES)}")
    benches: dict[str, Bench] = import_module(f"{__name__}.{PLACES[name]}").BENCHES
    return benches[name]


__all__ = [
    "FIRST", "FIT", "TEST", "THIRD", "Bench", "Conditions", "Hidden", "Log", "Set", "bench_names",
    "get_bench",
]  # fmt: skip
