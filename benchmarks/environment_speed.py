"""Speed of the environments: native vector, one by one, and the bare kernel, as ratios within one run.

python benchmarks/environment_speed.py
"""

from __future__ import annotations

import time
from collections.abc import Callable

import gymnasium as gym
import numpy as np

import fieldgym  # noqa: F401 - registers the environments
from fieldmodels.machines.excitation.dynamics import SUBSTEPS
from fieldmodels.machines.excitation.motion import CONSTANT
from fieldmodels.machines.excitation.parameters import MODES, SAMPLES
from fieldmodels.machines.excitation.shaker import Shakers
from fieldmodels.machines.heel_strike.parameters import Leg, Regimes
from fieldmodels.machines.heel_strike.strides import Strides

HEEL_STRIKE, EXCITATION = "fieldgym/HeelStrike-v0", "fieldgym/Excitation-v0"
BATCH = 64
SECONDS = 2.0


def rate(step: Callable[[], object], per_call: int) -> float:
    """Steps a second; the first call (which may compile) is not timed."""
    step()
    calls, start = 0, time.perf_counter()
    while time.perf_counter() - start < SECONDS:
        step()
        calls += 1
    return calls * per_call / (time.perf_counter() - start)


def show(title: str, rates: dict[str, float], physics: float) -> None:
    """Print one task's table; ``physics`` is the number of physics steps in a step."""
    base = rates["single environment"]
    print(f"{title:48s}{'steps/s':>12s}{'physics steps/s':>18s}{'ratio':>8s}")
    for name, value in rates.items():
        print(f"{name:48s}{value:12,.0f}{value * physics:18,.0f}{value / base:8.2f}")


def heel_strike() -> None:
    """A step is a stride."""
    native = gym.make_vec(HEEL_STRIKE, num_envs=BATCH)
    bank = gym.make_vec(HEEL_STRIKE, num_envs=BATCH, settings={"bank": True})
    sync = gym.make_vec(HEEL_STRIKE, num_envs=BATCH, vectorization_mode="sync")
    single = gym.make(HEEL_STRIKE, settings={"strides": 1_000_000})
    strides = Strides(BATCH, Leg(), Regimes(collision_kind="ar1"))
    for i in range(BATCH):
        strides.seed(i, np.random.default_rng(i))
    for env in (native, bank, sync, single):
        env.reset(seed=0)
    actions = np.zeros((BATCH, 3), np.float32)
    samples = np.mean([strides.advance([0.03, 0.03, 0.1, 1000 / 3]).samples for _ in range(20)])
    rates = {
        f"bare kernel, {BATCH} walkers": rate(lambda: strides.advance([0.03, 0.03, 0.1, 1000 / 3]), BATCH),
        f"native vector, {BATCH} environments": rate(lambda: native.step(actions), BATCH),
        f"native vector with the bank of filters, {BATCH}": rate(lambda: bank.step(actions), BATCH),
        f"SyncVectorEnv, {BATCH} environments": rate(lambda: sync.step(actions), BATCH),
        "single environment": rate(lambda: single.step(actions[0]), 1),
    }
    show("heel_strike", rates, float(samples))


def excitation() -> None:
    """A step is a decision of 0.4 s in three runs, with two filters."""
    long = {"decisions": 100_000}
    native = gym.make_vec(EXCITATION, num_envs=BATCH, settings=long)
    sync = gym.make_vec(EXCITATION, num_envs=BATCH, settings=long, vectorization_mode="sync")
    single = gym.make(EXCITATION, settings=long)
    shakers = Shakers(BATCH)
    shakers.restart(range(BATCH), [np.random.default_rng(i) for i in range(BATCH)])
    for env in (native, sync, single):
        env.reset(seed=0)
    actions, constant = np.zeros((BATCH, 3), np.float32), np.tile(CONSTANT, (BATCH, 1))
    rates = {
        f"physics, sensors and filters, {BATCH} vehicles": rate(lambda: shakers.advance(constant), BATCH),
        f"native vector, {BATCH} environments": rate(lambda: native.step(actions), BATCH),
        f"SyncVectorEnv, {BATCH} environments": rate(lambda: sync.step(actions), BATCH),
        "single environment": rate(lambda: single.step(actions[0]), 1),
    }
    show("excitation", rates, MODES * SAMPLES * SUBSTEPS)


def main() -> None:
    """Print the tables."""
    heel_strike()
    print()
    excitation()


if __name__ == "__main__":
    main()
