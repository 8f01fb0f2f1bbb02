"""UAV route: routes planned again so that the simulation in force finds them undetected.

The planners know the tables as they are printed, a calm day and an aircraft that banks as it should. What
differs and has a place in their world is put there: speed, bank, where the radars stand, a shifted position.
Whatever else differs (stronger or wider signatures, longer ranges, wind) shows where a plan is flown: each is
flown in the simulation first, and of the thresholds from high to low the first one counts whose plan stays
undetected there by a margin.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Annotated, Any

import gymnasium
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from fieldagents.agent import Agent
from fieldagents.config import Config
from fieldagents.task import Tuner, get_task
from fieldagents.tasks.uav_route.agents import Planner, Planning, legs, two_legs
from fieldagents.tasks.uav_route.plan import Plan
from fieldgym.settings import read_settings
from fieldgym.uav_route import UavRouteSettings, actions_towards
from fieldmodels.drivers.named import apply_reality
from fieldmodels.machines.uav_route.model import UavRoute
from fieldmodels.machines.uav_route.parameters import Layout, World

Threshold = Annotated[float, Field(ge=0.01, lt=0.99)]

TASK = "uav_route"
LARGEST_BANK = 1.5
"""Of the environment's settings [rad]."""


class Thresholds(Config):
    """What is tried, and what is asked of it.

    Attributes:
        thresholds: Probabilities of detection that plans keep below, beside the environment's own.
        margin: How far below the environment's threshold the probability must stay in the simulation: room
            for what the simulation does not know, since a plan at the threshold is detected by any error.
    """

    thresholds: tuple[Threshold, ...] = (
        0.9,
        0.8,
        0.7,
        0.6,
        0.45,
        0.4,
        0.35,
        0.3,
        0.25,
        0.2,
        0.15,
        0.1,
        0.05,
        0.02,
    )
    margin: float = Field(default=0.1, ge=0, lt=1)


class Replanner(Planner):
    """Plans in one world and tries each plan in a simulation before it flies.

    Args:
        settings: Of the environment.
        plan: How it plans.
        reality: Of the simulation.
        options: Thresholds that it plans with, and the margin that it keeps.
    """

    def __init__(self, settings: UavRouteSettings, plan: Planning, reality: Any, options: Thresholds) -> None:
        nominal = UavRoute(settings.world)
        model, truth = apply_reality(nominal, reality)
        plant = nominal.plant(truth.vector(model)[: len(nominal.names)])
        bank = min(settings.bank * float(plant["weaker_bank"]["factor"]), LARGEST_BANK)
        believed = replace(settings, speed=float(plant["speed"]), bank=bank)
        super().__init__(believed, self._tried)
        own = self.world.detection.threshold
        self._thresholds = sorted({own, *options.thresholds}, reverse=True)
        self._most = own - options.margin
        self._candidate, self._simulated, self._reality = plan, settings, truth
        self._bias = _north_east(plant["sensor_bias"])
        self._site = _north_east(plant["radar_position"])
        self._answers: dict[Layout, Plan] = {}

    def act(self, observation: NDArray[Any], info: Mapping[str, Any]) -> NDArray[np.float32]:
        """See ``Agent.act``."""
        seen = {
            **info,
            "layout.goal": info["layout.goal"] + self._bias,
            "layout.radars": info["layout.radars"] + self._site + self._bias,
        }
        return super().act(observation, seen)

    def _tried(self, layout: Layout, world: World, heading: float | None) -> Plan:
        """The plan of the highest threshold that stays undetected; else the one that is seen least."""
        if layout in self._answers:
            return self._answers[layout]
        tried: list[tuple[float, Plan]] = []
        for threshold in self._thresholds:
            lower = replace(world, detection=replace(world.detection, threshold=threshold))
            plan = self._candidate(layout, lower, heading)
            tried.append((self.seen(plan, layout) if plan.found else math.inf, plan))
            if tried[-1][0] <= self._most or not plan.found:
                break  # a lower threshold is a longer way, or none
        answer = min(tried, key=lambda one: one[0])[1]
        self._answers[layout] = answer
        return answer

    def seen(self, plan: Plan, layout: Layout) -> float:
        """Largest probability with which a plan is detected in the simulation."""
        shift = self._site + self._bias
        settings = {
            **asdict(self._simulated),
            "layout": {
                "start": tuple(np.array(layout.start) - self._bias),
                "goal": tuple(np.array(layout.goal) - self._bias),
                "radars": tuple(tuple(np.array(radar) - shift) for radar in layout.radars),
            },
            "detection": "deterministic",
            "capture": 1e-3,  # to the end of the plan
        }
        env: Any = gymnasium.make_vec(
            "fieldgym/UavRoute-v1",
            num_envs=1,
            vectorization_mode="vector_entry_point",
            settings=settings,
            reality=self._reality,
        )
        _, info = env.reset(seed=0)
        for waypoint in self._flyable(plan.waypoints):
            _, _, terminated, truncated, info = env.step(
                actions_towards(waypoint[None], info, self._simulated)
            )
            if terminated[0] or truncated[0]:
                break
        env.close()
        return float(info["largest_probability"][0])


def _tuner(name: str, plan: Planning) -> Tuner:
    title = f"{get_task(TASK).agents[name].title}, at the highest threshold that is safe in the simulation"

    def design(settings: Mapping[str, Any], reality: Any, options: Thresholds) -> Agent:
        return Replanner(read_settings(dict(settings), UavRouteSettings), plan, reality, options)

    return Tuner(name, title, Thresholds, design)


TUNERS = (_tuner("legs", legs), _tuner("two_legs", two_legs))
"""In the order of presentation."""


def _north_east(pair: NDArray[Any]) -> NDArray[np.float64]:
    """A record of north and east as an array, shape (2,)."""
    return np.array([float(pair["north"]), float(pair["east"])])
