"""Speed of the pose-reaching environment beside Gymnasium's own CartPole, as ratios within one run.

python benchmarks/pose_reaching_speed.py

Both are stepped with actions drawn beforehand, episodes restart as they end, and all that a step returns is
made (observation, reward, flags, info). Rounds alternate between the two, and each round's processor time
is taken; printed are the fastest round of each and the ratio of the two.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import gymnasium as gym

import fieldgym  # noqa: F401 - registers the environments

OURS, THEIRS = "fieldgym/PoseReaching-v0", "CartPole-v1"
ROUNDS = 30
SECONDS = 0.05
ACTIONS = 64
FAULTS = {"actuator_lag": {"time_constant": 0.1}, "sensor_delay": {"delay": 0.1}}


def native(name: str, count: int, **options: Any) -> Callable[[int], object]:
    """A step of a native vector environment, with the k-th of its actions."""
    env = gym.make_vec(name, num_envs=count, vectorization_mode="vector_entry_point", **options)
    env.reset(seed=0)
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(ACTIONS)]
    return lambda k: env.step(actions[k % ACTIONS])


def scalar(name: str) -> Callable[[int], object]:
    """A step of a single environment, which restarts at an episode's end."""
    env = gym.make(name)
    env.reset(seed=0)
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(ACTIONS)]

    def step(k: int) -> None:
        _, _, terminated, truncated, _ = env.step(actions[k % ACTIONS])
        if terminated or truncated:
            env.reset()

    return step


def steps_a_second(steppers: list[tuple[Callable[[int], object], int]]) -> list[float]:
    """Steps of environments a second of each stepper, its fastest round of several."""
    for step, _ in steppers:
        step(0)  # may compile
    best = [0.0] * len(steppers)
    for _ in range(ROUNDS):
        for i, (step, count) in enumerate(steppers):
            calls, begin, start = 0, time.process_time(), time.perf_counter()
            while time.perf_counter() - start < SECONDS:
                for k in range(16):
                    step(k + calls)
                calls += 16
            best[i] = max(best[i], calls * count / (time.process_time() - begin))
    return best


def main() -> None:
    """Print the table."""
    print(f"{'million steps/s':28s}{'pose reaching':>16s}{'CartPole':>12s}{'ratio':>8s}{'with faults':>14s}")
    for count in (1, 64, 1024):
        ours, theirs, faulty = steps_a_second(
            [
                (native(OURS, count), count),
                (native(THEIRS, count), count),
                (native(OURS, count, reality=FAULTS), count),
            ]
        )
        label = f"native vector, {count}"
        print(f"{label:28s}{ours / 1e6:16.3f}{theirs / 1e6:12.3f}{ours / theirs:8.2f}{faulty / 1e6:14.3f}")
    ours, theirs = steps_a_second([(scalar(OURS), 1), (scalar(THEIRS), 1)])
    print(f"{'scalar, gym.make':28s}{ours / 1e6:16.3f}{theirs / 1e6:12.3f}{ours / theirs:8.2f}")


if __name__ == "__main__":
    main()
