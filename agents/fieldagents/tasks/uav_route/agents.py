"""The planners as agents: each plans where an episode begins and flies its plan leg by leg.

They know the layout and the world by the environment's settings (``model``), not what truly happens to an
aircraft. Who finds no plan does not try its luck: it turns its tail to the nearest radar and leaves, by the
shortest legs, until no leg is left; ``no_plan`` counts it. ``receding`` knows a radar only once it is in
sight and plans again on the way.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from fieldagents.agent import Agent, Sees
from fieldagents.task import ReferenceAgent
from fieldagents.tasks.uav_route.certified import certified_plan
from fieldagents.tasks.uav_route.lattice import lattice_plan
from fieldagents.tasks.uav_route.legs import leg_plan
from fieldagents.tasks.uav_route.lower_bound import bound_to_capture, layouts_of, lower_bound, moved_goal
from fieldagents.tasks.uav_route.plan import Plan, Search, make_plan
from fieldagents.tasks.uav_route.printed import Form, joint_printed_plans, printed_plan
from fieldagents.tasks.uav_route.rollout import RolloutSearch
from fieldagents.tasks.uav_route.straight import straight_plan
from fieldgym.settings import read_settings
from fieldgym.uav_route import UavRouteSettings, actions_towards
from fieldmodels.arrays import FloatArray
from fieldmodels.machines.uav_route.layouts import safe_route
from fieldmodels.machines.uav_route.parameters import Layout, World
from fieldmodels.machines.uav_route.plan_simulation import simulate_plan
from fieldmodels.model import ModelError

MARGIN = 1e-4
"""How far plans keep below the threshold: actions are single precision, a centimetre at the end of a leg."""
WITHIN = 0.05
"""How far inside the circle of arrival a plan ends [km]."""
REACHED = 0.5
"""Within this distance of a waypoint the next one is flown to [km]."""
NODES = 10
"""Nodes of the lattice along the straight line."""
LATTICE_LEG = 5.0
"""Smallest spacing of the lattice [km]."""
WORK = 150_000
"""Largest number of the solver's steps for one program: minutes at most, whatever the clock says."""
SIGHT = 500.0
"""Distance at which ``receding`` sees a radar [km]."""
WORTH = 1.0
"""By how much a new plan must be shorter than what is left of the old one [km]."""
ADVANCE = 100.0
"""Length that ``receding`` flies before it plans again [km]."""
CALM = (0.05, 0.1, 0.2, 0.3, 0.4)
"""Thresholds that ``legs_low`` tries, the lowest first."""


class Planning(Protocol):
    """A planner with all but the problem set."""

    def __call__(self, layout: Layout, world: World, heading: float | None) -> Plan:
        """Plan from a layout's start to its goal, flying with a heading [rad] or (None) with any."""


class Planner(Agent):
    """Plans at the start of an episode and flies from waypoint to waypoint.

    Args:
        settings: Of the environment.
        plan: How it plans.
        direct: Whether it enters the circle of arrival from where it comes, else where undetected paths do.
        sight: Distance within which it knows of a radar [km].
        advance: Length after which it plans again [km].
    """

    sees: Sees = "model"

    def __init__(
        self,
        settings: UavRouteSettings,
        plan: Planning,
        direct: bool = False,
        sight: float = math.inf,
        advance: float = math.inf,
    ) -> None:
        self._settings, self._plan, self._direct = settings, plan, direct
        self._sight, self._advance = sight, advance
        detection = settings.world.detection
        careful = replace(
            detection, threshold=max(detection.threshold - MARGIN, 0.01), detection="deterministic"
        )
        self.world = replace(settings.world, detection=careful)
        self._plans: dict[tuple[Layout, float | None], Plan] = {}
        self._routes: list[FloatArray] = []
        self._known: list[set[int]] = []
        self._planned: list[float] = []
        self._latest: list[Plan | None] = []
        self._left: NDArray[np.bool_] = np.zeros(0, dtype=np.bool_)

    def reset(self, seed: int) -> None:  # noqa: ARG002
        """See ``Agent.reset``."""
        self._plans, self._routes, self._known, self._planned, self._latest = {}, [], [], [], []

    def begin_episodes(self, begun: NDArray[np.bool_]) -> None:
        """See ``Agent.begin_episodes``."""
        begun = np.repeat(begun, self._settings.aircraft)
        if len(self._routes) != len(begun):
            self._routes = [np.zeros((0, 2)) for _ in begun]
            self._known, self._planned = [set() for _ in begun], [-math.inf for _ in begun]
            self._latest, self._left = [None for _ in begun], np.zeros(len(begun), dtype=np.bool_)
        self._left[begun] = False
        for i in np.flatnonzero(begun).tolist():
            self._routes[i], self._known[i], self._planned[i] = np.zeros((0, 2)), set(), -math.inf

    def act(self, observation: NDArray[Any], info: Mapping[str, Any]) -> NDArray[np.float32]:
        """See ``Agent.act``."""
        if not self._routes:
            self.begin_episodes(np.ones(len(observation), dtype=np.bool_))
        info = of_each_aircraft(info)
        layouts = layouts_of(info)
        self._foresee(layouts)
        targets = np.zeros((len(layouts), 2))
        for i, layout in enumerate(layouts):
            if info["leg_left"][i] > 0.0:
                continue  # on its way, whatever is commanded
            place, flown = np.array(info["place"][i]), float(info["path_length"][i])
            self._pass(i, place)
            new = self._in_sight(place, layout) - self._known[i]
            if self._planned[i] == -math.inf or new or flown - self._planned[i] >= self._advance:
                self._known[i] |= new
                heading = float(info["course"][i]) if flown > 0.0 else None
                self._routes[i] = self._planned_from(place, layout, i, heading)
                self._planned[i] = flown
            targets[i] = self._routes[i][0] if len(self._routes[i]) else layout.goal
        actions = actions_towards(targets, info, self._settings)
        actions[self._left] = (1.0, -1.0)  # away from the nearest radar, as short a leg as there is
        return actions.reshape(len(observation), -1)

    def _foresee(self, layouts: list[Layout]) -> None:
        """Make plans that are wanted before any aircraft makes its own: none here."""

    def account(self) -> Mapping[str, FloatArray]:
        """How the planning of each flight ended; see ``Agent.account`` and the task's metrics."""
        n = self._settings.aircraft
        plans = [self._latest[i : i + n] for i in range(0, len(self._latest), n)]
        # a search that several aircraft share counts once
        searches = [list({id(p.search): p.search for p in own if p}.values()) for own in plans]
        return {
            "no_plan": np.array(self._left.reshape(-1, n).any(axis=1), float),
            "infeasible": np.array([any(s.status == "infeasible" for s in own) for own in searches], float),
            "gap": np.array([max((s.gap for s in own), default=math.nan) for own in searches]),
            "bound": np.array([sum(s.bound for s in own) if own else math.nan for own in searches]),
        }

    def sketch(self) -> Mapping[str, Any] | None:
        """What is left of each plan, as the environment's ``show`` takes it."""
        longest = max((len(route) for route in self._routes), default=0)
        if not longest:
            return None
        padded = [np.concatenate([r, np.repeat(r[-1:], longest - len(r), axis=0)]) for r in self._routes]
        return {"plan": np.array(padded)}

    def _in_sight(self, place: FloatArray, layout: Layout) -> set[int]:
        return {r for r, site in enumerate(layout.radars) if math.dist(place, site) <= self._sight}

    def _planned_from(self, place: FloatArray, layout: Layout, i: int, heading: float | None) -> FloatArray:
        """The route from here: a new one, or what is left of the old one where that is no worse."""
        known = tuple(layout.radars[r] for r in sorted(self._known[i]))
        ahead = self._to_arrival(Layout((float(place[0]), float(place[1])), layout.goal, known))
        problem = (ahead, heading)
        if problem not in self._plans:
            self._plans[problem] = self._plan(ahead, self.world, heading)
        plan, left = self._plans[problem], np.concatenate([place[None], self._routes[i]])
        self._latest[i] = plan
        if len(left) > 1:
            still = simulate_plan(left, known, self.world, heading=heading).verification
            if not plan.found or (still.undetected and still.path_length <= plan.length + WORTH):
                return left[1:]
        self._left[i] = not plan.found
        return self._flyable(plan.waypoints) if plan.found else np.zeros((0, 2))

    def _to_arrival(self, layout: Layout) -> Layout:
        """The layout with its goal where the circle of arrival is entered best: nobody flies beyond."""
        capture, distance = self._settings.capture, math.dist(layout.start, layout.goal)
        if distance <= capture:
            return layout
        if self._direct:
            north, east = np.array(layout.start) - np.array(layout.goal)
            bearing = math.atan2(east, north)
        else:
            bearing = bound_to_capture(layout, self._settings.world, capture)[1]
        return moved_goal(layout, max(capture - WITHIN, 0.0), bearing)

    def _flyable(self, waypoints: FloatArray) -> FloatArray:
        """The waypoints after the first, legs divided that are too long, and none that is too short."""
        least, most = self._settings.least_leg, self._settings.longest_leg
        route = [waypoints[0]]
        for k, point in enumerate(waypoints[1:], 1):
            length = math.dist(route[-1], point)
            last = k == len(waypoints) - 1
            if length < least and not last:
                continue
            pieces = max(1, math.ceil(length / most - 1e-9))
            route += [route[-1] + (point - route[-1]) * (j / pieces) for j in range(1, pieces + 1)]
        return np.array(route[1:])

    def _pass(self, i: int, place: FloatArray) -> None:
        """Forget the waypoints that flight ``i`` has reached."""
        while len(self._routes[i]) and math.dist(self._routes[i][0], place) <= REACHED:
            self._routes[i] = self._routes[i][1:]


class JointPlanner(Planner):
    """Plans all aircraft of an episode in the source's one program, before they fly."""

    def _foresee(self, layouts: list[Layout]) -> None:
        """Plan the aircraft of each episode that begins."""
        for first in range(0, len(layouts), self._settings.aircraft):
            if self._planned[first] == -math.inf:
                team = [self._to_arrival(own) for own in layouts[first : first + self._settings.aircraft]]
                form = form_for(team, self.world)
                plans = joint_printed_plans(team, self.world, form, work=WORK)
                self._plans |= {(own, None): plan for own, plan in zip(team, plans, strict=True)}


def form_for(layouts: Sequence[Layout], world: World) -> Form:
    """The source's twelve steps, as long as the longest of some ways needs them to be."""
    form = Form(lookup="sets")
    need = 1.1 * max(lower_bound(own, world) for own in layouts) / (form.steps * world.aircraft.speed)
    return replace(form, step_time=max(form.step_time, need))


def printed(*, lock_loss: bool) -> Planning:
    """The source's program with its twelve steps, as long as the way needs them to be."""

    def plan(layout: Layout, world: World, heading: float | None) -> Plan:  # noqa: ARG001
        form = form_for((layout,), world)
        if lock_loss:
            lose, engage = world.lock_loss.lose, world.lock_loss.engage
            count = round((lose + engage) / form.step_time) if math.isfinite(lose) else 1
            form = replace(form, lock_loss=count) if count >= 2 else form
        return printed_plan(layout, world, form, work=WORK)

    return plan


def of_each_aircraft(info: Mapping[str, Any]) -> Mapping[str, Any]:
    """What planners read of an ``info``, by aircraft in turn; ``leg_left`` is none where there is one."""
    if np.ndim(info["place"]) == 2:
        return {**info, "leg_left": np.zeros(len(info["place"]))}
    count = np.shape(info["place"])[1]
    flown = np.repeat(info["path_length"] / count, count)  # all fly at once: about as far
    flat = {key: np.reshape(info[key], -1) for key in ("course", "radial", "leg_left")}
    return {
        **{key: value for key, value in info.items() if key.startswith("layout.")},
        **flat,
        "place": np.reshape(info["place"], (-1, 2)),
        "path_length": flown,
    }


def legs(layout: Layout, world: World, heading: float | None) -> Plan:
    """Two verified legs, polished into four; three where two find no way."""
    plan = leg_plan(layout, world, directions=72, polish=4, heading=heading, work=WORK)
    return plan if plan.found else leg_plan(layout, world, legs=3, polish=4, heading=heading, work=WORK)


def certified(settings: UavRouteSettings) -> Planning:
    """The shortest of legs and polished lattice paths, with a bound."""

    def plan(layout: Layout, world: World, heading: float | None) -> Plan:
        return certified_plan(layout, world, least_leg=settings.least_leg, heading=heading, work=WORK)

    return plan


def legs_low(layout: Layout, world: World, heading: float | None) -> Plan:
    """Whole legs at the lowest of some thresholds that leaves a way."""
    for threshold in CALM:
        if threshold < world.detection.threshold:
            lower = replace(world, detection=replace(world.detection, threshold=threshold))
            plan = leg_plan(layout, lower, heading=heading, work=WORK)
            if plan.found:
                return plan
    return legs(layout, world, heading)


def legs_lock_loss(layout: Layout, world: World, heading: float | None) -> Plan:
    """Three legs that may be detected for a while."""
    return leg_plan(layout, world, legs=3, lock_loss=True, heading=heading, work=WORK)


def over_lattice(settings: UavRouteSettings, *, lock_loss: bool) -> Planning:
    """The lattice, as fine as the way is short."""

    def plan(layout: Layout, world: World, heading: float | None) -> Plan:
        straight = math.dist(layout.start, layout.goal)
        spacing = max(LATTICE_LEG, straight / NODES)
        return lattice_plan(
            layout,
            world,
            spacing=min(spacing, max(0.2 * straight, 0.1)),
            lock_loss=lock_loss,
            least_leg=settings.least_leg,
            heading=heading,
        )

    return plan


def _straight(layout: Layout, world: World, heading: float | None) -> Plan:  # noqa: ARG001
    return straight_plan(layout, world)


def two_legs(layout: Layout, world: World, heading: float | None) -> Plan:
    """The route that random layouts are drawn around; where there is none it says so."""
    try:
        route = safe_route(layout, world.detection)
    except ModelError as error:
        return make_plan("two-legs", layout, world, Search("no plan", str(error), "none"))
    search = Search("feasible", "past the circle to the goal's radial, and in along it", "none")
    return make_plan("two-legs", layout, world, search, route, heading=heading)


def _reference(
    name: str,
    title: str,
    make: Callable[[UavRouteSettings], Planning],
    direct: bool = False,
    sight: float = math.inf,
    advance: float = math.inf,
    planner: type[Planner] = Planner,
) -> ReferenceAgent:
    def build(given: Mapping[str, Any]) -> Agent:
        settings = read_settings(dict(given), UavRouteSettings)
        return planner(settings, make(settings), direct, sight, advance)

    return ReferenceAgent(name, title, build, "model")


AGENTS = (
    _reference("straight", "Straight to the goal, whatever the radars see", lambda _: _straight, direct=True),
    _reference(
        "two_legs", "Past the nearest circle to the goal's radial, and in along it", lambda _: two_legs
    ),
    _reference(
        "printed",
        "The source's program (4.8)-(4.32), twelve steps as long as the way needs",
        lambda _: printed(lock_loss=False),
    ),
    _reference(
        "printed_lock_loss", "The same with lock loss, (4.33)", lambda _: printed(lock_loss=True), direct=True
    ),
    _reference(
        "printed_joint",
        "The source's program of all aircraft at once (section 4.5.1)",
        lambda _: printed(lock_loss=False),
        planner=JointPlanner,
    ),
    _reference("legs", "Two verified legs by a small program, then polished into four", lambda _: legs),
    _reference("certified", "The shortest of legs and polished lattice paths, with a proven gap", certified),
    _reference(
        "legs_low",
        "Two verified legs at the lowest probability of detection that leaves a way",
        lambda _: legs_low,
    ),
    _reference(
        "legs_lock_loss",
        "Three legs that may be detected as long as no missile is launched",
        lambda _: legs_lock_loss,
        direct=True,
    ),
    _reference(
        "lattice",
        "Shortest path over a lattice, undetected",
        lambda settings: over_lattice(settings, lock_loss=False),
    ),
    _reference(
        "lattice_lock_loss",
        "Shortest path over a lattice, detected as long as no missile is launched",
        lambda settings: over_lattice(settings, lock_loss=True),
        direct=True,
    ),
    _reference(
        "receding",
        "As legs, but a radar is known within 500 km; plans anew then and every 100 km",
        lambda _: legs,
        sight=SIGHT,
        advance=ADVANCE,
    ),
    ReferenceAgent(
        "rollout_search",
        "Waypoints tried in copies of the flight, anew before every leg",
        RolloutSearch,
        "model",
    ),
)
"""The reference agents, in the order of presentation."""
