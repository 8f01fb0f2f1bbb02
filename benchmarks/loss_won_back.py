"""How much of what unknown realities cost does a policy win back that is told what a diagnosis knows?

    python benchmarks/loss_won_back.py RUN... [--blind RUN...] [--episodes 500]

RUN: folders of finished runs of one config with ``told`` (`configs/pose_reaching/ppo_told.yaml`). All meet
the same random realities on test seeds; the nominal policies are the zoo's ``ppo``, trained on the ideal
robot. The bound is the same policy, told the truth. Blind ones met the same realities in training and were
told nothing (``--set 'told={}'``).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from fieldagents.agent import Agent
from fieldagents.config import EnvironmentConfig, load_config
from fieldagents.evaluation.agents import make_agent
from fieldagents.evaluation.episodes import run_episodes
from fieldagents.learned.config import TrainConfig
from fieldagents.learned.told import ToldAgent
from fieldagents.policies.policy import OnnxAgent
from fieldagents.retune.recovery import recovery
from fieldagents.seeds import TEST_SEEDS


def main() -> None:
    """Play, and print shares with their intervals."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", nargs="+", type=Path)
    parser.add_argument("--blind", nargs="*", type=Path, default=[])
    parser.add_argument("--episodes", type=int, default=500)
    arguments = parser.parse_args()
    config = load_config(arguments.runs[0] / "config.yaml", TrainConfig)
    random = config.environment
    ideal = EnvironmentConfig(settings=random.settings)

    def play(agents: list[Agent], environment: EnvironmentConfig) -> tuple[np.ndarray, np.ndarray]:
        tables = [
            run_episodes(one, config.task, environment, TEST_SEEDS[: arguments.episodes]) for one in agents
        ]
        return tuple(np.mean([t[key].to_numpy() for t in tables], axis=0) for key in ("return", "success"))

    nominal = list(make_agent("ppo", config.task, random.settings).runs)
    policies = [OnnxAgent(run / "policy.onnx") for run in arguments.runs]
    told = [ToldAgent(policy, config.told) for policy in policies]
    sure = [ToldAgent(policy, dict.fromkeys(config.told, 0.0)) for policy in policies]
    results = {
        "nominal, ideal robot": play(nominal, ideal),
        "nominal": play(nominal, random),
        "told estimates": play(told, random),
        "told the truth": play(sure, random),
    }
    if arguments.blind:
        results["blind"] = play([OnnxAgent(run / "policy.onnx") for run in arguments.blind], random)
    for name, (returns, success) in results.items():
        print(f"{name:22} return {returns.mean():8.3f}   arrived {100 * success.mean():6.2f} %")
    three = [results[name][0] for name in ("nominal", "told estimates", "told the truth")]
    won = recovery(*three, lower_is_better=False, rng=np.random.default_rng(0))
    print(f"share of the loss won back (return): {won}")


if __name__ == "__main__":
    main()
