"""Exponents of cost: how a step's time grows with copies and radars, a diagnosis' with data and candidates.

``run.py`` shows them among what users wait for; 1 is a cost in proportion, less is better.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from diagnosis_speed import COULOMB, DELAY, record

from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.options import DiagnosisOptions
from fieldmodels.machines.rig import Rig
from fieldmodels.registry import get_model

ROUNDS = 5
COPIES = (16, 64, 256)
RADARS = ((12.0, 9.0), (4.0, 14.0), (16.0, 4.0), (9.0, 16.0))
"""North and east [km], around the way from one corner to the other."""


def exponent(works: Mapping[float, Callable[[], object]], rounds: int = ROUNDS) -> float:
    """Slope of the logarithm of processor time against that of a size, rounds in turns after one untimed."""
    best = dict.fromkeys(works, np.inf)
    for i in range(rounds + 1):
        for size, work in works.items():
            began = time.process_time()
            work()
            if i:
                best[size] = min(best[size], time.process_time() - began)
    return float(np.polyfit(np.log(list(best)), np.log(list(best.values())), 1)[0])


def steps_of(env_id: str, copies: int, calls: int, **settings: Any) -> Callable[[], object]:
    """So many steps of a vector environment."""
    env = gym.make_vec(env_id, num_envs=copies, vectorization_mode="vector_entry_point", settings=settings)
    env.reset(seed=0)
    action = env.action_space.sample()

    def work() -> None:
        for _ in range(calls):
            env.step(action)

    return work


def with_copies(env_id: str, settings: Mapping[str, Any]) -> float:
    """Exponent of a batch's step against its rows."""
    calls = 1 if "Excitation" in env_id else 8
    return exponent({n: steps_of(env_id, n, calls, **settings) for n in COPIES})


def with_radars(env_id: str) -> float:
    """Exponent of a step of 64 UAV routes against the number of radars."""
    ends = {"start": (0.0, 0.0), "goal": (20.0, 20.0)}
    layouts = {n: ends | {"radars": RADARS[:n]} for n in (1, 2, 4)}
    return exponent({n: steps_of(env_id, 64, 40, layout=layout) for n, layout in layouts.items()})


def diagnosing(*sizes: tuple[int, float]) -> Callable[[], object]:
    """A diagnosis of a rig with friction and a delay on one thread: rows and step of each recording."""
    data = [record(COULOMB | DELAY, *size, seed=k) for k, size in enumerate(sizes, 1)]
    return lambda: diagnose(get_model("rig"), data, options=DiagnosisOptions(threads=1))


def with_candidates() -> float:
    """Cost of a diagnosis of a rig with friction where all its effects may be the cause, over that with 8.

    No exponent: that is near zero, and a factor of it says nothing.
    """
    data = [record(COULOMB, 1000, 0.01)]

    def looked(count: int) -> Callable[[], object]:
        model = type(f"Rig{count}", (Rig,), {"effects": Rig.effects[:count]})()
        return lambda: diagnose(model, data, options=DiagnosisOptions(threads=1))

    few, many = 8, len(Rig.effects)
    return float((many / few) ** exponent({count: looked(count) for count in (few, 15, many)}, 1))


def with_rate() -> float:
    """Exponent of a diagnosis of the same ten seconds against the rate of their samples."""
    return exponent({rate: diagnosing((10 * rate, 1.0 / rate)) for rate in (100, 1000)}, 1)


def with_recordings() -> float:
    """Exponent of a diagnosis against the number of recordings of ten seconds."""
    return exponent({n: diagnosing(*[(1000, 0.01)] * n) for n in (1, 2, 4)}, 1)
