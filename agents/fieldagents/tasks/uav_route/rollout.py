"""Search by flying: waypoints tried in copies of the flight, all at once in the environment's own kernel.

Cross-entropy (Rubinstein, 1999) over one and over two waypoints before the goal; the fewest legs that are not
longer by ``WORTH``, so that the plan is the same wherever on its way it is made anew.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldagents.agent import Agent, Sees
from fieldgym.settings import read_settings
from fieldgym.uav_route import UavRouteSettings, actions_towards
from fieldmodels.arrays import FloatArray
from fieldmodels.machines.uav_route.batch import Flights
from fieldmodels.machines.uav_route.declaration import nominal_plant
from fieldmodels.machines.uav_route.parameters import LockLoss
from fieldmodels.machines.uav_route.state import NUMBERS
from fieldmodels.model import ModelError

MARGIN = 2e-4
"""By what part radars are taken to see farther than they do: actions are single precision."""
CANDIDATES, ELITE, ROUNDS = 40, 5, 9
"""Of a round, those that the next one is drawn around, and rounds."""
SPREAD = 0.06
"""Standard deviation of the first candidates, of the distance to the goal."""
SEEN = (300.0, 2.0)
"""What being detected costs a candidate [km], and each second of it."""
WORTH = 0.3
"""By how much a further leg must shorten the way [km]."""
HEADINGS, LENGTHS = np.radians(np.linspace(-72.0, 72.0, 25)), np.linspace(0.15, 1.2, 8)
"""First corners tried: from the goal's bearing, and of its distance."""


class RolloutSearch(Agent):
    """Plans anew before every leg by flying candidates in the kernel.

    Args:
        settings: Of the environment, of a single aircraft.
        margin: By what part radars are taken to see farther than they do.

    Raises:
        ModelError: If the settings have several aircraft.
    """

    sees: Sees = "model"

    def __init__(self, settings: Mapping[str, Any], margin: float = MARGIN) -> None:
        self._settings: UavRouteSettings = read_settings(dict(settings), UavRouteSettings)
        if self._settings.aircraft > 1:
            raise ModelError("rollout_search plans for a single aircraft: set aircraft to 1, or ask legs")
        rules = self._settings.rules[0]
        harmless = LockLoss(math.inf, math.inf, math.inf)
        certain = replace(rules.world.detection, detection="deterministic")
        self._rules = replace(rules, world=replace(rules.world, lock_loss=harmless, detection=certain))
        self._plant = nominal_plant(rules.world.aircraft.speed)
        self._plant["radar_range_scale"]["factor"] = 1.0 + margin
        self._made: dict[int, tuple[Flights, NDArray[Any]]] = {}
        self._rng = np.random.default_rng(0)

    def act(self, observation: NDArray[Any], info: Mapping[str, Any]) -> NDArray[np.float32]:  # noqa: ARG002
        """See ``Agent.act``."""
        self._rng = np.random.default_rng(0)  # a row does not depend on the step, nor on its neighbours
        place, goal = np.asarray(info["place"]), np.asarray(info["layout.goal"])
        ahead, target = goal - place, goal.copy()
        best = self._costs(info, np.zeros((len(goal), 1, 0, 2)))[:, 0]
        corners = self._first_corners(place, ahead)
        points = corners[np.arange(len(goal)), self._costs(info, corners).argmin(axis=1)]
        for further in (False, True):
            if further:
                points = np.concatenate([points, 0.5 * (points + goal[:, None])], axis=1)
            points, costs = self._evolved(info, points, np.hypot(*ahead.T))
            better = costs < best - WORTH
            target[better], best[better] = points[better, 0], costs[better]
        return actions_towards(target, info, self._settings)

    def _first_corners(self, place: FloatArray, ahead: FloatArray) -> FloatArray:
        """One waypoint each, shape (flights, candidates, 1, 2)."""
        turns, lengths = (one.ravel() for one in np.meshgrid(HEADINGS, LENGTHS))
        north = lengths * (np.cos(turns) * ahead[:, :1] - np.sin(turns) * ahead[:, 1:])
        east = lengths * (np.sin(turns) * ahead[:, :1] + np.cos(turns) * ahead[:, 1:])
        corners: FloatArray = place[:, None, None] + np.stack([north, east], axis=-1)[:, :, None]
        return corners

    def _evolved(
        self, info: Mapping[str, Any], points: FloatArray, distance: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """The best waypoints found around some, shape (flights, n, 2), and what they cost."""
        rows = np.arange(len(points))[:, None]
        mean, spread = points, np.broadcast_to(SPREAD * distance[:, None, None], points.shape)
        for _ in range(ROUNDS):
            draws = self._rng.normal(size=(CANDIDATES, *points.shape[1:]))
            draws[0] = 0.0
            tried = mean[:, None] + spread[:, None] * draws
            costs = self._costs(info, tried)
            order = np.argsort(costs, axis=1)[:, :ELITE]
            elite = tried[rows, order]
            best, least = elite[:, 0], costs[rows[:, 0], order[:, 0]]
            mean, spread = best, np.maximum(elite.std(axis=1), 1e-3)
        return best, least

    def _costs(self, info: Mapping[str, Any], tried: FloatArray) -> FloatArray:
        """What it costs to fly by waypoints to the goal, shape (flights, candidates) [km].

        Args:
            info: Of the flights.
            tried: Waypoints before the goal, shape (flights, candidates, waypoints, 2).
        """
        batch, count, legs, _ = tried.shape
        flights, fresh = self._copies(batch * count)
        state = fresh.copy()
        for key, value in (
            ("place", info["place"]),
            ("goal", info["layout.goal"]),
            ("legs", np.asarray(info["path_length"]) > 0),  # the first leg needs no turn
            ("course", np.stack([np.cos(info["course"]), np.sin(info["course"])], axis=-1)),
        ):
            state[key] = np.repeat(value, count, axis=0)
        state["radars"][:, : self._rules.count] = np.repeat(info["layout.radars"], count, axis=0)
        flights.set_state(state)
        for k in range(legs):
            flights.fly_to(tried[:, :, k].reshape(-1, 2))
        leg = flights.fly_to(state["goal"])
        number = dict(zip(NUMBERS, leg.numbers, strict=True))
        over = number["time_over"]
        seen = np.where(over > 0, SEEN[0] + SEEN[1] * over, 0.0)
        missed = np.where(number["success"] > 0, 0.0, 10.0 * number["remaining"])
        costs: FloatArray = number["path_length"] + seen + missed
        return costs.reshape(batch, count)

    def _copies(self, batch: int) -> tuple[Flights, NDArray[Any]]:
        """Flights to try waypoints in, and their state when they have just begun."""
        if batch not in self._made:
            flights = Flights(batch, self._rules, self._plant)
            rng = np.random.default_rng(0)
            for i in range(batch):
                flights.seed(i, rng)
            flights.restart(range(batch))
            self._made[batch] = flights, flights.state()
        return self._made[batch]
