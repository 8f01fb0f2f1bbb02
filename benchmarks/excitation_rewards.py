"""Which reward ranks motions by the error that they leave: bits, weighted bits, relative error.

    python benchmarks/excitation_rewards.py [--seeds 24]

Policies that look at nothing: commands held for an episode or for five decisions (various: how well they do
differs), or a new random command at every decision (alike: they hardly differ). Over the policies' means:
Spearman's correlation between an episode's return and its final error as Table I counts it, -1 for a perfect
ranking, with a bootstrap interval over policies. The last column is that of the error on half of the seeds
with the error on the other half: 1 if the seeds suffice to rank the policies at all, 0 if they cannot.
"""

from __future__ import annotations

import argparse

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

import fieldgym  # noqa: F401  (registers the environments)
from fieldagents.seeds import TUNING_SEEDS

POLICIES, DECISIONS = 48, 25
REWARDS = {
    "bits": {},
    "bits of the inertia": {"weights": (0.0, 1.0, 0.0, 0.0, 0.0)},
    "relative error": {"reward": "relative_error"},
}
Floats = NDArray[np.float64]


def policies(kind: str, rng: np.random.Generator) -> Floats:
    """Actions of each policy, shape (policies, decisions, 3)."""
    if kind == "alike":
        return rng.uniform(-1, 1, (POLICIES, DECISIONS, 3))
    held = [DECISIONS if i % 2 else 5 for i in range(POLICIES)]
    return np.array([np.repeat(rng.uniform(-1, 1, (DECISIONS // n, 3)), n, axis=0) for n in held])


def played(actions: Floats, seeds: int, settings: dict[str, object]) -> tuple[Floats, Floats]:
    """Return and final error [%] of each policy on each seed, shape (policies, seeds)."""
    envs = gym.make_vec("fieldgym/Excitation-v0", num_envs=POLICIES * seeds, settings=settings)
    envs.reset(seed=[*TUNING_SEEDS[:seeds]] * POLICIES)
    total = np.zeros(POLICIES * seeds)
    for k in range(DECISIONS):
        _, reward, _, _, info = envs.step(np.repeat(actions[:, k], seeds, axis=0).astype(np.float32))
        total += reward
    return total.reshape(POLICIES, seeds), info["error_percent"].reshape(POLICIES, seeds)


def rank(a: Floats, b: Floats) -> float:
    """Spearman's correlation."""
    return float(spearmanr(a, b).statistic)


def main() -> None:
    """Print one row for each limits, kind of policies and reward."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=24, help="episodes of each policy")
    seeds = parser.parse_args().seeds
    print("| limits | policies | reward | rank correlation with the error | error with itself |")
    print("|---|---|---|---|---|")
    for limits in ("paper", "wide"):
        for kind in ("various", "alike"):
            actions = policies(kind, np.random.default_rng(1))
            for name, chosen in REWARDS.items():
                gained, error = played(actions, seeds, {"limits": limits, **chosen})
                a, b = gained.mean(axis=1), error.mean(axis=1)
                rng = np.random.default_rng(2)
                drawn = [rng.integers(0, POLICIES, POLICIES) for _ in range(2000)]
                low, high = np.quantile([rank(a[i], b[i]) for i in drawn], (0.025, 0.975))
                itself = rank(error[:, ::2].mean(axis=1), error[:, 1::2].mean(axis=1))
                found = f"{rank(a, b):.2f} [{low:.2f}, {high:.2f}] | {itself:.2f}"
                print(f"| {limits} | {kind} | {name} | {found} |", flush=True)


if __name__ == "__main__":
    main()
