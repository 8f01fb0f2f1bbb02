"""Time of one decision: the metric for 22 parameters, the forecasts, and the adjustment of the command.

    python benchmarks/excitation_decision_speed.py

The source reports 75 ms for one evaluation of the metric and adjustment on a 750 MHz Pentium III (section
VII-A); a decision may take no longer than the 400 ms that it is for. Processor time of one core.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import gymnasium
import numpy as np

import fieldgym  # noqa: F401  (registers the tasks)
from fieldagents.agent import visible
from fieldagents.task import get_task
from fieldagents.tasks.excitation.agents import situation
from fieldmodels.information import binned, closed, fast
from fieldmodels.machines.excitation.dynamics import SUBSTEPS
from fieldmodels.machines.excitation.motion import CONSTANT, DECISION
from fieldmodels.machines.excitation.parameters import LOWER, UPPER
from fieldmodels.machines.excitation.prediction import Predictor

PAPER_MS, LIMIT_MS = 75.0, 15.0


def milliseconds(work: Callable[[], object], repeats: int) -> float:
    """Processor time of one call [ms]: the best of five rounds, after one to warm up."""
    work()
    best = np.inf
    for _ in range(5):
        begin = time.process_time()
        for _ in range(repeats):
            work()
        best = min(best, (time.process_time() - begin) / repeats)
    return 1000.0 * best


def main() -> None:
    """Print times and their ratio to the metric by its definition."""
    envs = gymnasium.make_vec("fieldgym/Excitation-v0", 1, vectorization_mode="vector_entry_point")
    observation, info = envs.reset(seed=0)
    for _ in range(3):  # a decision in the midst of an episode
        observation, _, _, _, info = envs.step(envs.action_space.sample() * 0)
    seen = visible(info, "model", "excitation")
    now = situation(seen)
    sigma = np.sqrt(np.diagonal(now.covariance[0]))
    reference = milliseconds(lambda: binned(now.mean[0], sigma, LOWER, UPPER), 20)
    rows = [
        ("metric, 22 parameters: sum over 1024 bins", reference),
        ("metric: closed form", milliseconds(lambda: closed(now.mean[0], sigma, LOWER, UPPER), 200)),
        ("metric: fast form", milliseconds(lambda: fast(sigma, LOWER, UPPER), 200)),
    ]
    for substeps in (1, SUBSTEPS):
        predictor = Predictor(substeps=substeps)
        commands = np.tile(CONSTANT, (1, 25, 1, 1))
        each = milliseconds(partial(predictor.outlook, now, commands), 4) / 25
        rows.append((f"one forecast of the filter, {substeps} integration steps a sample", each))
    decisions = {}
    for name, reference_agent in get_task("excitation").agents.items():
        if reference_agent.sees == "model":
            agent = reference_agent.make({})
            agent.reset(0)
            decisions[name] = milliseconds(partial(agent.act, observation, seen), 4)
            rows.append((f"decision: {name}", decisions[name]))
    for name, took in rows:
        print(f"{name:62s} {took:9.3f} ms   {took / reference:8.3f} x")
    adjusted = decisions["frozen_weight"]
    print(
        f"metric and adjustment of frozen_weight: {adjusted:.1f} ms (the source: {PAPER_MS:g} ms on its "
        f"machine), {1000 * DECISION / adjusted:.0f} times faster than the decisions come"
    )
    if adjusted > LIMIT_MS:
        raise SystemExit(f"a decision of frozen_weight took more than {LIMIT_MS:g} ms")
    envs.close()


if __name__ == "__main__":
    main()
