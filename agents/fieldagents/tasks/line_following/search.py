"""Tuning of the reference agents of line following, on tuning seeds alone.

``python -m fieldagents.tasks.line_following.search`` writes ``tuned.json`` anew (a few minutes).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from itertools import product
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from fieldagents.agent import Agent, visible
from fieldagents.seeds import TUNING_SEEDS
from fieldagents.tasks.line_following.agents import TUNED, Linear, Lqg, Privileged
from fieldgym import TASKS
from fieldmodels.extras import needed
from fieldmodels.files import write_text

Floats = NDArray[np.float64]

TRACKS = ("straight", "s", "oval")
WALKS = 48
"""Tuning walks of each track; as many others check."""
SETS, STEPS = 1000, 200
"""Sets of weights and steps of each, as section 3.5.3 says."""
RANGES = {1: (-1.5, 0.5), 0: (0.0, 2.0), 4: (-0.5, 0.9)}
"""Where the weights a, b, c are drawn from (assumed)."""
LQG_CHOICES = tuple(product((0.003, 0.01, 0.02, 0.04), (0.03, 0.1, 0.3, 1.0, 3.0)))
"""Bends and efforts of the regulator."""
PLACES, TURNS, FAR = (0, 1, 2, 3), (4, 5, 6, 7), (9, 10, 11, 12)


REWARD_LIMIT = 3.0
"""Of the reward by which weights are judged: strides far from the line count more than in training."""


class Trials:
    """Walks on all tracks for a number of candidates at once, all of them on the same seeds.

    Attributes:
        settings: The environment's settings, but for the track.
        walks: Walks of each candidate on each track.
    """

    def __init__(
        self,
        candidates: int,
        seeds: range,
        tracks: Sequence[str] = TRACKS,
        reality: Any = None,
        **settings: Any,
    ) -> None:
        self.settings, self.walks = settings, len(seeds)
        self._seeds = list(seeds) * candidates
        self._shape = (candidates, len(seeds))
        self._envs: list[Any] = [
            gymnasium.make_vec(
                TASKS["line_following"].env_id,
                num_envs=len(self._seeds),
                vectorization_mode="vector_entry_point",
                settings={"reward_limit": REWARD_LIMIT, **settings, "track": track},
                reality=reality,
            )
            for track in tracks
        ]

    def losses(
        self,
        act: Callable[[NDArray[Any], Mapping[str, Any]], Floats],
        begin: Callable[[NDArray[np.bool_]], None] = lambda _: None,
    ) -> Floats:
        """Loss of a stride, for each candidate: minus the mean reward, shape (candidates,)."""
        total = np.zeros(self._shape)
        for envs in self._envs:
            observation, info = envs.reset(seed=self._seeds)
            going = np.ones(len(self._seeds), dtype=np.bool_)
            begin(going.copy())
            returns, strides = np.zeros(len(self._seeds)), envs.unwrapped.settings.strides
            while going.any():
                observation, reward, terminated, truncated, info = envs.step(act(observation, info))
                returns += np.where(going, reward, 0.0)
                going &= ~(terminated | truncated)
            total -= returns.reshape(self._shape) / strides
        return np.asarray(total.mean(axis=1) / len(self._envs))


def linear_losses(trials: Trials, entries: Sequence[int], weights: Floats) -> Floats:
    """Losses of linear laws, weights of shape (candidates, entries)."""
    laws = [Linear(trials.settings, dict(zip(entries, row, strict=True))) for row in weights]
    scaled = np.repeat([law._weights for law in laws], trials.walks, axis=0)

    def act(observation: NDArray[Any], info: Mapping[str, Any]) -> Floats:  # noqa: ARG001
        turns = np.einsum("ij,ij->i", observation[:, list(entries)], scaled) / laws[0].limit
        return np.where(observation[:, 8] > 0.5, observation[:, 4], turns)[:, None].clip(-1, 1)

    return trials.losses(act)


def random_search(rng: np.random.Generator) -> dict[int, float]:
    """Weights of (3.1) by the chapter's search: the set that stays closest to the line in one walk each.

    The chapter does not say on which line; this is the oval.
    """
    lower, upper = np.array(list(RANGES.values())).T
    sets = rng.uniform(lower, upper, (SETS, 3))
    # one walk of 200 steps, that is of 100 strides, for each set, all in the same noise
    trials = Trials(SETS, TUNING_SEEDS[:1], ("oval",), strides=STEPS // 2, effort_weight=0.0)
    best = sets[np.argmin(linear_losses(trials, list(RANGES), sets))]
    return dict(zip(RANGES, best.round(4).tolist(), strict=True))


def evolve(loss: Callable[[Floats], Floats], start: Sequence[float], spread: float, rounds: int) -> Floats:
    """Minimise by CMA-ES (the package ``cma``), all candidates of a round at once."""
    cma = needed("cma")
    search = cma.CMAEvolutionStrategy(list(start), spread, {"seed": 1, "verbose": -9, "popsize": CANDIDATES})
    for _ in range(rounds):
        asked = search.ask()
        search.tell(asked, loss(np.array(asked)).tolist())
    return np.asarray(search.result.xfavorite)


CANDIDATES = 16


def evolve_linear(
    entries: Sequence[int], start: Mapping[int, float], rounds: int, trials: Trials
) -> dict[int, float]:
    """Weights of a linear law by CMA-ES, on walks of ``CANDIDATES`` candidates at once."""
    first = [start.get(entry, 0.0) for entry in entries]
    found = evolve(lambda w: linear_losses(trials, entries, w), first, 0.15, rounds)
    return dict(zip(entries, found.round(4).tolist(), strict=True))


def one_loss(make: Callable[[], Any], seeds: range, **settings: Any) -> float:
    """Loss of one agent on all tracks."""
    return agent_loss(make(), Trials(1, seeds, **settings))


def agent_loss(agent: Agent, trials: Trials) -> float:
    """Loss of one agent on the walks of one candidate."""

    def act(observation: NDArray[Any], info: Mapping[str, Any]) -> Floats:
        return np.asarray(agent.act(observation, visible(info, agent.sees, "line_following")))

    return float(trials.losses(act, agent.begin_episodes)[0])


def tune(log: Callable[[str], None] = print) -> dict[str, Any]:
    """Tune every agent that has something to tune.

    Returns:
        Agent to its values, with its loss a stride on the walks that tuned it and on as many others.
    """
    first, check = TUNING_SEEDS[:WALKS], TUNING_SEEDS[5000 : 5000 + WALKS]
    found: dict[str, Any] = {}

    def keep(name: str, make: Callable[[], Any], values: dict[str, Any], **settings: Any) -> None:
        losses = [round(one_loss(make, seeds, **settings), 4) for seeds in (first, check)]
        found[name] = {**values, "tuned": losses[0], "checked": losses[1]}
        log(f"{name}: {found[name]}")

    def evolved(
        entries: Sequence[int], start: Mapping[int, float], rounds: int, **settings: Any
    ) -> dict[int, float]:
        return evolve_linear(entries, start, rounds, Trials(CANDIDATES, first, **settings))

    def keep_linear(name: str, weights: dict[int, float], **settings: Any) -> None:
        keep(name, lambda: Linear({}, weights), {"weights": weights}, **settings)

    keep_linear("printed", random_search(np.random.default_rng(0)))
    law = evolved(list(RANGES), found["printed"]["weights"], 60)
    keep_linear("tuned", law)
    keep_linear("memory", evolved([*PLACES, *TURNS], law, 150))
    keep_linear("two_bands", evolved([*PLACES, *TURNS, *FAR], law, 250, bands=2), bands=2)
    bend, effort = min(LQG_CHOICES, key=lambda c: one_loss(lambda: Lqg({}, *c), first))
    keep("lqg", lambda: Lqg({}, bend, effort), {"bend": bend, "effort": effort})
    gains = np.linspace(0.2, 1.0, 9).round(2).tolist()
    gain = min(gains, key=lambda g: one_loss(lambda: Privileged({}, g), first))
    keep("ceiling", lambda: Privileged({}, gain), {"gain": gain})
    return found


def main() -> None:
    """Tune, and write what the agents read."""
    found = {"command": "python -m fieldagents.tasks.line_following.search", **tune()}
    write_text(TUNED, json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
