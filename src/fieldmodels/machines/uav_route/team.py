"""Several aircraft that fly at once under the same radars (section 4.5.1 plans two), in a batch of teams."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.machines.uav_route.batch import Flights, Leg, Rules, empty_leg, kernel_rules, observed_names
from fieldmodels.machines.uav_route.parameters import RADARS
from fieldmodels.machines.uav_route.team_kernel import FREE, UNDERWAY, advance_team, start_team
from fieldmodels.model import ModelError


def team_names(radars: int) -> tuple[str, ...]:
    """Names of the columns of ``Leg.observed`` of one aircraft of a team."""
    busy = tuple(f"radar_{r}_follows_another" for r in range(radars))
    return (*observed_names(radars), "leg_left", "flying", *busy)


class Team(Flights):
    """A batch of teams: row ``team * aircraft + i`` of all arrays is aircraft ``i`` of a team.

    All aircraft of a team fly at once. A step ends when the first leg does: at its waypoint, at the goal, or
    by a hit; the others are then still on their legs and fly on in the next step, whatever is commanded. So
    every leg is flown whole, and aircraft that nothing couples fly as each does alone.

    Attributes:
        legs: What each aircraft remembers of an unfinished leg, shape (teams, aircraft), dtype ``UNDERWAY``.
        tracked: Which aircraft each radar follows, -1 for none, shape (teams, RADARS); always
            none with ``tracking="each"``.
    """

    def __init__(self, teams: int, each: Sequence[Rules], plant: NDArray[Any] | None = None) -> None:
        """Make teams; seed and restart each before the first step.

        Args:
            teams: Number of teams.
            each: The rules of each aircraft, which differ in start and goal only.
            plant: What the aircraft truly are, shape () or (teams,): those of a team are alike.

        Raises:
            ModelError: As for ``Flights``.
        """
        self._aircraft = len(each)
        if plant is not None and plant.shape == (teams,):
            plant = np.repeat(plant, self._aircraft)
        super().__init__(teams * self._aircraft, each[0], plant)
        self._columns = len(team_names(self.rules.count))
        self.legs = np.zeros((teams, self._aircraft), dtype=UNDERWAY)
        self.tracked = np.full((teams, RADARS), FREE, dtype=np.int64)
        for team in range(teams):
            self.set_team_rules(team, each)

    def rows(self, teams: Sequence[int]) -> list[int]:
        """The rows of some teams' aircraft."""
        return [team * self._aircraft + a for team in teams for a in range(self._aircraft)]

    def set_team_rules(self, team: int, each: Sequence[Rules]) -> None:
        """Give one team, before its next episode, other rules with as many radars."""
        for row, rules in zip(self.rows([team]), each, strict=True):
            self.records[row] = kernel_rules(rules, 1)[0]

    def set_plants(self, rows: Sequence[int] | IntArray, plants: NDArray[Any]) -> None:
        """Say what the aircraft of some teams truly are from their next episode on; shape (len(rows),)."""
        super().set_plants(self.rows(list(rows)), np.repeat(plants, self._aircraft))

    def seed(self, i: int, rng: np.random.Generator) -> None:
        """Give team ``i`` streams keyed by one draw from ``rng``, the first aircraft's as a single one's."""
        rows = self.rows([i])
        super().seed(rows[0], rng)
        self.flights["key"][rows] = self.flights["key"][rows[0]] + np.arange(len(rows), dtype=np.uint64)
        self.flights["episode"][rows] = 0
        self._seeded[rows], self._begun[rows] = True, False

    def restart(self, which: Iterable[int]) -> Leg | None:
        """Begin the next episode of some teams.

        Raises:
            ModelError: If a team was never seeded.
        """
        teams = list(which)
        rows = self.rows(teams)
        if not self._seeded[rows].all():
            raise ModelError("seed every flight before its first episode")
        start_team(self._grid(self.flights), self.legs, self.tracked, np.array(teams, dtype=np.int64),
                   self._grid(self.records))  # fmt: skip
        self._begun[rows] = True
        self._ready = bool(self._begun.all())
        return None

    def observe(self) -> Leg:
        """What is observed of every aircraft as it stands; the rewards are zero."""
        return self._fly(self._still, flying=False)

    def advance(self, actions: ArrayLike, restarting: bool = False) -> Leg:
        """Take every team on until its first leg ends.

        Args:
            actions: As for ``Flights``, shape (teams * aircraft, 2); ignored of an aircraft on its way.
            restarting: Not for teams.

        Raises:
            ModelError: If the actions have the wrong shape or are not finite, or a team never began.
        """
        if restarting:
            raise ModelError("teams are restarted by restart, not by advance")
        return self._fly(self._checked(actions), flying=True)

    def _grid(self, rows: NDArray[Any]) -> NDArray[Any]:
        """An array of all rows as one of teams and aircraft; a view."""
        return rows.reshape(-1, self._aircraft)

    def _fly(self, actions: FloatArray, *, flying: bool) -> Leg:
        if not self._ready:
            raise ModelError("seed and restart every flight before the first leg")
        leg = empty_leg(len(self), self._columns, self.rules.count)
        finite = advance_team(
            self._grid(self.flights), self.legs, self.tracked, actions, flying, self._grid(self.plants),
            self._grid(self.records), leg.observed, leg.numbers, leg.known, leg.reward, leg.over,
        )  # fmt: skip
        if not finite:
            raise ModelError(f"actions must be finite numbers, not {actions}")
        return leg
