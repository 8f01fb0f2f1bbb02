"""What the environments' speed benchmarks share: things that step, and how fast they do."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import gymnasium as gym

import fieldgym  # noqa: F401 - registers the environments

ROUNDS = 12
SECONDS = 0.1
ACTIONS = 64
Stepper = Callable[[int], object]


def native(name: str, count: int, **options: Any) -> Stepper:
    """A step of a native vector environment, with the k-th of its actions."""
    env = gym.make_vec(name, num_envs=count, vectorization_mode="vector_entry_point", **options)
    env.reset(seed=0)
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(ACTIONS)]
    return lambda k: env.step(actions[k % ACTIONS])


def scalar(name: str, **options: Any) -> Stepper:
    """A step of a single environment, which restarts at an episode's end."""
    env = gym.make(name, **options)
    env.reset(seed=0)
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(ACTIONS)]

    def step(k: int) -> None:
        _, _, terminated, truncated, _ = env.step(actions[k % ACTIONS])
        if terminated or truncated:
            env.reset()

    return step


def steps_a_second(steppers: dict[str, tuple[Stepper, int]]) -> dict[str, float]:
    """Steps of environments a processor second of each stepper, its fastest round; rounds alternate."""
    for step, _ in steppers.values():
        step(0)  # may compile
    best = dict.fromkeys(steppers, 0.0)
    for _ in range(ROUNDS):
        for name, (step, count) in steppers.items():
            calls, begin, start = 0, time.process_time(), time.perf_counter()
            while time.perf_counter() - start < SECONDS:
                for k in range(16):
                    step(k + calls)
                calls += 16
            best[name] = max(best[name], calls * count / (time.process_time() - begin))
    return best
