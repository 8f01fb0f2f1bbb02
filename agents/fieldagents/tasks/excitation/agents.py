"""Excitation: the source's constant and adaptive commands, other criteria, longer views, and bounds.

Source: V. A. Sujan and S. Dubowsky, "An optimal information method for mobile manipulator dynamic parameter
identification", IEEE/ASME Trans. Mechatronics 8(2), 2003. Tuned values are in ``tuned.json``, made by
``python -m fieldagents.tasks.excitation.search``.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fieldagents.agent import Agent, Sees
from fieldagents.task import ReferenceAgent
from fieldagents.tasks.excitation.criteria import (
    CRITERIA,
    Floats,
    Forecast,
    forecast,
    residuals_frozen,
)
from fieldgym.excitation import ExcitationSettings
from fieldgym.info import part
from fieldgym.settings import read_settings
from fieldmodels.machines.excitation.adjustment import adjust
from fieldmodels.machines.excitation.motion import CONSTANT
from fieldmodels.machines.excitation.parameters import LIMITS, Limits
from fieldmodels.machines.excitation.prediction import Predictor, Situation
from fieldmodels.machines.excitation.shaker import VARIANTS

ActionArray = NDArray[np.float32]

RANDOM_CANDIDATES, LOCAL_STEPS = 16, 8
"""Of a decision: random commands, then steps from the best of them."""
PLANNER = {"horizon": 2, "candidates": 48, "steps": 24}
"""Of the planner: decisions ahead, random plans and local steps."""
FIRST_STEP = 0.5
"""Standard deviation of the first local step, in the action's units; each step is 0.75 of the last."""


def command_ranges(limits: Limits) -> tuple[Floats, Floats]:
    """Smallest and largest amplitude [rad], frequency [rad/s] and offset [rad], each of shape (3,)."""
    ends = zip((0.0, limits.amplitude), limits.frequency, limits.offset, strict=True)
    low, high = (np.array(end) for end in ends)
    return low, high


def to_command(action: ArrayLike, limits: Limits) -> Floats:
    """Commands that the environment makes of actions, shape (..., 3)."""
    low, high = command_ranges(limits)
    return np.asarray(low + (high - low) * (np.clip(np.asarray(action, dtype=np.float64), -1, 1) + 1) / 2)


def to_action(command: ArrayLike, limits: Limits) -> Floats:
    """Actions that choose commands; those out of range are taken to its ends, shape (..., 3)."""
    low, high = command_ranges(limits)
    return np.asarray(np.clip(2 * (np.asarray(command, dtype=np.float64) - low) / (high - low) - 1, -1, 1))


class Schedule(Agent):
    """The same actions in every episode, decided before it begins.

    Args:
        actions: Action of each decision, shape (decisions, 3); the last one is kept up.
    """

    def __init__(self, actions: ArrayLike) -> None:
        self._actions = np.asarray(actions, dtype=np.float32)
        self._decision = np.empty(0, dtype=np.int64)

    def begin_episodes(self, begun: NDArray[np.bool_]) -> None:
        """See ``Agent.begin_episodes``."""
        if len(self._decision) != len(begun):
            self._decision = np.zeros(len(begun), dtype=np.int64)
        self._decision[begun] = 0

    def act(self, observation: NDArray[Any], info: Mapping[str, Any]) -> ActionArray:  # noqa: ARG002
        """See ``Agent.act``."""
        if len(self._decision) != len(observation):
            self.begin_episodes(np.ones(len(observation), dtype=np.bool_))
        chosen = self._actions[np.minimum(self._decision, len(self._actions) - 1)]
        self._decision += 1
        return chosen


class RandomCommands(Agent):
    """Commands uniform within the limits."""

    def __init__(self) -> None:
        self._rng = np.random.default_rng(0)

    def reset(self, seed: int) -> None:
        """See ``Agent.reset``."""
        self._rng = np.random.default_rng(seed)

    def act(self, observation: NDArray[Any], info: Mapping[str, Any]) -> ActionArray:  # noqa: ARG002
        """See ``Agent.act``."""
        return self._rng.uniform(-1, 1, (len(observation), 3)).astype(np.float32)


class ModelBased(Agent):
    """What agents share that foresee what a command will teach.

    Args:
        settings: Of the environment.
        oracle: True shakes the true vehicle in its forecasts (privileged).
    """

    sees: Sees = "model"

    def __init__(self, settings: ExcitationSettings, oracle: bool = False) -> None:
        self._oracle = oracle
        self.limits = LIMITS[settings.limits]
        variant = VARIANTS[settings.variant]
        self._estimated, self._most = variant.unknowns, settings.bits
        self._predictor = Predictor(
            limits=self.limits,
            noise=settings.sensor_noise,
            method=settings.estimator,
            variant=variant,
        )
        self._rng = np.random.default_rng(0)

    def reset(self, seed: int) -> None:
        """See ``Agent.reset``."""
        self._rng = np.random.default_rng(seed)

    def foresee(self, info: Mapping[str, Any], actions: Floats) -> Forecast:
        """What candidates are expected to lead to.

        Args:
            info: Of the environment.
            actions: Of each decision ahead, shape (environments, candidates, decisions, 3).
        """
        now = situation(info)
        truth = info["privileged.truth"] if self._oracle else None
        outlook = self._predictor.outlook(now, to_command(actions, self.limits), truth)
        return forecast(now, outlook, self._estimated, self._most)


class Search(ModelBased):
    """Takes the best of random commands, improved by local steps, under one criterion.

    All environments of a batch try the same random candidates and steps: a row does not depend on its
    neighbours.

    Args:
        settings: Of the environment.
        criterion: Cost of a forecast.
        horizon: Decisions ahead; the first of them is made, then all are chosen anew.
        candidates: Random plans tried at a decision.
        steps: Local steps from the best one.
        oracle: See ``ModelBased``.
    """

    def __init__(
        self,
        settings: ExcitationSettings,
        criterion: Callable[[Forecast], Floats],
        horizon: int = 1,
        candidates: int = RANDOM_CANDIDATES,
        steps: int = LOCAL_STEPS,
        oracle: bool = False,
    ) -> None:
        super().__init__(settings, oracle)
        self._criterion = criterion
        self._horizon, self._candidates, self._steps = horizon, candidates, steps
        self._plan = np.empty((0, horizon, 3))
        self._planned = np.empty(0, dtype=np.bool_)

    def begin_episodes(self, begun: NDArray[np.bool_]) -> None:
        """See ``Agent.begin_episodes``."""
        if len(self._planned) != len(begun):
            self._plan = np.zeros((len(begun), self._horizon, 3))
            self._planned = np.zeros(len(begun), dtype=np.bool_)
        self._planned[begun] = False

    def act(self, observation: NDArray[Any], info: Mapping[str, Any]) -> ActionArray:
        """See ``Agent.act``."""
        count = len(observation)
        if len(self._planned) != count:
            self.begin_episodes(np.ones(count, dtype=np.bool_))
        tried = self._rng.uniform(-1, 1, (self._candidates, self._horizon, 3))
        plans = np.tile(tried, (count, 1, 1, 1))
        if self._horizon > 1:
            # The rest of the last plan is a candidate too, its last command kept up.
            kept = np.concatenate([self._plan[:, 1:], self._plan[:, -1:]], axis=1)
            plans[self._planned, 0] = kept[self._planned]
        costs = self._criterion(self.foresee(info, plans))
        rows = np.arange(count)
        winner = np.argmin(costs, axis=1)
        best, least = plans[rows, winner], costs[rows, winner]
        width = FIRST_STEP
        for _ in range(self._steps):
            step = self._rng.normal(0.0, width, (self._horizon, 3))
            trial = np.clip(best + step, -1, 1)
            value = self._criterion(self.foresee(info, trial[:, None]))[:, 0]
            better = value < least
            best[better], least[better] = trial[better], value[better]
            width *= 0.75
        self._plan, self._planned[:] = best, True
        return np.asarray(best[:, 0], dtype=np.float32)


class PrintedOptimiser(ModelBased):
    """Adjusts the command in force by eqs (17)-(23), damped as Levenberg and Marquardt's."""

    def act(self, observation: NDArray[Any], info: Mapping[str, Any]) -> ActionArray:
        """See ``Agent.act``."""
        now = situation(info)
        start = to_action(now.command, self.limits)
        chosen = np.empty((len(observation), 3), dtype=np.float32)
        for i in range(len(observation)):
            own = one_row(info, i)

            def residuals(actions: Floats, own: Mapping[str, Any] = own) -> Floats:
                return np.asarray(residuals_frozen(self.foresee(own, actions[None, :, None]))[0])

            chosen[i] = adjust(residuals, start[i], np.full(3, -1.0), np.ones(3), iterations=2).command
        return chosen


def situation(info: Mapping[str, Any]) -> Situation:
    """What is known, as the environment gives it."""
    estimate, arm = part(info, "estimate"), part(info, "arm")
    return Situation(
        mean=estimate["mean"],
        covariance=estimate["covariance"],
        moments=estimate["moments"],
        noise=estimate["noise"],
        samples=estimate["samples"],
        command=arm["command"],
        phase=arm["phase"],
        variances=info["variances"],
    )


def one_row(info: Mapping[str, Any], i: int) -> dict[str, Any]:
    """The info of one environment, as a batch of one."""
    return {
        key: one_row(value, i) if isinstance(value, Mapping) else value[i : i + 1]
        for key, value in info.items()
    }


@cache
def tuned() -> dict[str, Any]:
    """What ``excitation_tuning.py`` found, by ``preset/limits/noise``."""
    text = Path(__file__).with_name("tuned.json").read_text(encoding="utf-8")
    return dict(json.loads(text))


def tuned_actions(name: str, settings: ExcitationSettings) -> Floats:
    """Actions of an agent that decides beforehand, shape (decisions, 3), tuned for what is nearest.

    Args:
        name: Of the agent.
        settings: Of the environment; what was not tuned for falls back to the preset's wide limits.
    """
    found = tuned()
    keys = (
        f"{settings.preset}/{settings.limits}/{settings.noise}",
        f"{settings.preset}/wide/full_scale",
    )
    key = next(key for key in keys if key in found)
    return np.array(found[key][name]["actions"])


def _schedule(name: str, title: str, sees: Sees = "observation") -> ReferenceAgent:
    def build(settings: Mapping[str, Any]) -> Agent:
        return Schedule(tuned_actions(name, read_settings(settings, ExcitationSettings)))

    return ReferenceAgent(name, title, build, sees)


def _constant(settings: Mapping[str, Any]) -> Agent:
    return Schedule(to_action(CONSTANT, LIMITS[read_settings(settings, ExcitationSettings).limits])[None])


def _search(
    name: str, title: str, criterion: str = "", effort: Mapping[str, int] | None = None, oracle: bool = False
) -> ReferenceAgent:
    def build(settings: Mapping[str, Any]) -> Agent:
        own = read_settings(settings, ExcitationSettings)
        return Search(own, CRITERIA[criterion or name], oracle=oracle, **effort or {})

    return ReferenceAgent(name, title, build, "privileged" if oracle else "model")


AGENTS = (
    ReferenceAgent("constant", "The source's constant excitation, eq (24)", _constant),
    _schedule("best_constant", "The best constant command of a grid"),
    ReferenceAgent("random", "Commands uniform within the limits", lambda _: RandomCommands()),
    _search("condition_number", "Least condition number of A (section VII-A)"),
    _search("printed_cost", "Cost (16) as printed"),
    ReferenceAgent(
        "printed_optimiser",
        "(16) with frozen weights, optimised by (17)-(23)",
        lambda settings: PrintedOptimiser(read_settings(settings, ExcitationSettings)),
        "model",
    ),
    _search("frozen_weight", "Cost (16), weights frozen at the current estimate: the reference"),
    _search("sum_of_bits", "Most bits about all parameters"),
    _search("a_optimal", "Least mean variance"),
    _search("d_optimal", "Least volume of the uncertainty ellipsoid"),
    _search("relative_error", "Least expected error as Table I counts it"),
    _search(
        "planner",
        "Least expected error two decisions ahead, with three times the search",
        "relative_error",
        PLANNER,
    ),
    _schedule("schedule", "Schedule for vehicles drawn from the prior, by CMA-ES"),
    _search("oracle_planner", "The planner, given the true vehicle", "relative_error", PLANNER, True),
    _schedule("oracle_schedule", "Schedule for the true vehicle, by CMA-ES", "privileged"),
)
"""The reference agents, in the order of presentation."""
