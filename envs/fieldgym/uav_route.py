"""UAV route: fly to a goal past radars that see an aircraft's sides, leg by leg.

Source: A. I. Chaudhry, "Topics in robot locomotion: state estimation and feasible-path generation for
wheeled and legged robots", Cornell University 2015, chapter 4 ("the dissertation").
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass

from fieldgym.base import (
    BatchTask,
    Flags,
    Floats,
    Outcome,
    RealityLike,
    TaskEnv,
    TaskVectorEnv,
    VectorStep,
)
from fieldgym.info import Info, complete
from fieldgym.settings import read_random_settings
from fieldmodels.compiled import compiled
from fieldmodels.machines.uav_route.batch import (
    CHANNELS,
    Flights,
    Leg,
    Rules,
    check_plants,
    observed_names,
)
from fieldmodels.machines.uav_route.model import UavRoute
from fieldmodels.machines.uav_route.parameters import (
    EXAMPLE,
    INSTANT_KILL,
    PRINTED,
    RADARS,
    RIGHT,
    SECOND_UAV,
    TEAM,
    Aircraft,
    Detection,
    Layout,
    LegRules,
    LockLoss,
    World,
)
from fieldmodels.machines.uav_route.plan_simulation import simulate_plan
from fieldmodels.machines.uav_route.state import BOUND, FLYING, KNOWN, NUMBERS, OF_RADAR
from fieldmodels.machines.uav_route.team import Team, team_names
from fieldmodels.model import ModelError
from fieldmodels.settings import Setting, part_of

if TYPE_CHECKING:
    from fieldgym.rendering.canvas import Frame
    from fieldgym.rendering.uav_route import Picture

Place = tuple[Annotated[float, Field(allow_inf_nan=False)], Annotated[float, Field(allow_inf_nan=False)]]

TRACED = 4.0
"""Longest time between the points of a drawn path [s]."""


COMBINED: Mapping[str, Callable[..., Any]] = {
    "success": np.min,
    "damaged": np.max,
    "time": np.max,
    "path_length": np.sum,
    "remaining": np.sum,
    "time_over": np.sum,
    "longest_detection": np.max,
    "largest_probability": np.max,
    "lock_losses": np.sum,
    "legs": np.sum,
}
"""What ``NUMBERS`` of several aircraft say of all of them."""


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class UavEnds:
    """Where a further aircraft flies.

    Attributes:
        start: North and east [km].
        goal: North and east [km].
    """

    start: Place
    goal: Place


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class UavLayout:
    """A layout of one's own.

    Attributes:
        start: North and east [km].
        goal: North and east [km].
        radars: North and east of each radar [km], 1 to 4.
        others: Start and goal of each further aircraft.
    """

    start: Place
    goal: Place
    radars: Annotated[tuple[Place, ...], Field(min_length=1, max_length=RADARS)]
    others: Annotated[tuple[UavEnds, ...], Field(max_length=TEAM - 1)] = ()


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class UavRouteSettings(LegRules, LockLoss, Detection, Aircraft):
    """What can be set in ``fieldgym/UavRoute-v1``: aircraft, radars, legs, and three more."""

    layout: Annotated[
        Literal["random", "example"] | UavLayout,
        Setting(
            "`random`, the source's `example`, or a mapping of `start`, `goal` and `radars`, each north "
            "and east [km], and of `others`, a list of `start` and `goal` of each further aircraft.",
            fixed="its radars shape the observation",
        ),
    ] = "random"
    lock_loss: Annotated[bool, Setting("Whether a lock can be lost; else detection destroys at once.")] = True
    reading: Annotated[
        Literal["right", "printed"],
        Setting("The source's equations corrected (`right`) or as `printed`, but for the heading."),
    ] = "right"

    @property
    def world(self) -> World:
        """Aircraft, detection, lock loss and reading, as `fieldmodels` takes them."""
        return World(
            aircraft=part_of(self, Aircraft),
            detection=part_of(self, Detection),
            lock_loss=part_of(self, LockLoss) if self.lock_loss else INSTANT_KILL,
            reading=RIGHT if self.reading == "right" else replace(PRINTED, heading="own_leg"),
        )

    @property
    def rules(self) -> tuple[Rules, ...]:
        """The rules of each aircraft as `fieldmodels` takes them.

        Raises:
            ModelError: If the legs' limits or the layout are not possible.
        """
        layouts: tuple[Layout | None, ...] = (None,) * self.aircraft
        if isinstance(self.layout, UavLayout):
            own = self.layout
            ends = [(own.start, own.goal), *((other.start, other.goal) for other in own.others)]
            layouts = tuple(Layout(start, goal, own.radars) for start, goal in ends)
        elif self.layout == "example":
            layouts = (EXAMPLE, SECOND_UAV)[: self.aircraft]
        if len(layouts) != self.aircraft:
            raise ModelError(
                f"the layout says where {len(layouts)} aircraft fly, and aircraft={self.aircraft}: give "
                "`others` a start and a goal for each further one, or draw layouts at random"
            )
        return tuple(part_of(self, Rules, world=self.world, layout=layout) for layout in layouts)


def actions_towards(
    waypoints: ArrayLike, info: Mapping[str, Any], settings: UavRouteSettings
) -> NDArray[np.float32]:
    """Actions that fly straight to waypoints, or as far towards them as a leg may lead.

    Args:
        waypoints: North and east [km], shape (batch, 2); of several aircraft, (batch, aircraft, 2).
        info: The ``info`` of a batch, of which ``place`` and ``radial`` are used.
        settings: The environment's settings.

    Returns:
        Actions, shape (batch, 2 aircraft), float32.
    """
    ahead = np.asarray(waypoints, dtype=np.float64) - info["place"]
    turn = np.arctan2(ahead[..., 1], ahead[..., 0]) - info["radial"]
    turn = (turn + np.pi) % (2 * np.pi) - np.pi
    length = np.clip(np.hypot(ahead[..., 0], ahead[..., 1]), settings.least_leg, settings.longest_leg)
    spread = math.log(settings.longest_leg / settings.least_leg)
    share = np.log(length / settings.least_leg) / spread if spread > 0.0 else np.zeros_like(length)
    actions = np.stack([turn / np.pi, 2.0 * share - 1.0], axis=-1).astype(np.float32)
    return actions.reshape(len(actions), -1)


@compiled
def legs_of(actions: Floats, least: float, longest: float) -> Floats:
    """Heading [rad] and length [km] of the legs that actions mean, shape (batch, 2)."""
    legs = np.empty_like(actions)
    for i in range(len(actions)):
        legs[i, 0] = math.pi * actions[i, 0]
        legs[i, 1] = least * (longest / least) ** (0.5 * (1.0 + actions[i, 1]))
    return legs


def model_of(settings: UavRouteSettings) -> UavRoute:
    """The model of what is set: its nominal speed is the settings'."""
    return UavRoute(settings.world)


class _UavRouteTask(BatchTask):
    """The task on a batch of flights."""

    settings: UavRouteSettings
    channels = CHANNELS
    longest = "max_legs"

    def __init__(self, batch: int, settings: Any, reality: RealityLike, drawing: bool) -> None:
        self.settings, samplers = read_random_settings(settings, UavRouteSettings)
        rules, model = self.settings.rules, model_of(self.settings)
        truth = self.configure(batch, reality, samplers, model, 0.0, model_of)
        self._model = model
        for extreme in self.drawn.extremes():
            ends = self.reality.extremes(truth.around(model_of(extreme)))
            check_plants(model.plant(ends[:, : len(model.names)]))
            extreme.rules  # noqa: B018 - raises if they are not possible
        plants, self._aircraft = model.plant(truth.typical), self.settings.aircraft
        if self._aircraft == 1:
            self.flights = Flights(batch, rules[0], plants, truth.stock)
        elif truth.stock is None:
            self.flights = Team(batch, rules, plants)
        else:
            raise ModelError(
                "stock effects of signals act on a single aircraft: choose aircraft=1, or effects of the "
                "model uav_route (fieldgym list) in the reality"
            )
        self.simulated, self._drawing = self.flights, drawing
        self._trails: list[list[Floats]] = [[] for _ in range(len(self.flights))]
        self._plan: Floats | None = None
        self._seen: Leg | None = None

    def spaces(self) -> tuple[Box, Box]:
        """Heading and length of a leg; where goal and radars are, and what they do."""
        names = observed_names if self._aircraft == 1 else team_names
        columns = self._aircraft * len(names(self.flights.rules.count))
        return (
            Box(-1.0, 1.0, (2 * self._aircraft,), np.float32),
            Box(-BOUND, BOUND, (columns,), np.float32),
        )

    def _by_episode(self, each: NDArray[Any]) -> NDArray[Any]:
        """What is known of each flight, shape (flights, ...), by episode: of several aircraft, each's."""
        return each if self._aircraft == 1 else each.reshape(-1, self._aircraft, *each.shape[1:])

    def set_reality(self, rows: list[int], vectors: Floats) -> None:
        """See ``BatchTask.set_reality``."""
        self.flights.set_plants(rows, self._model.plant(vectors))

    def set_settings(self, row: int, settings: Any) -> None:
        """See ``BatchTask.set_settings``."""
        if isinstance(self.flights, Team):
            self.flights.set_team_rules(row, settings.rules)
        else:
            self.flights.set_rules(row, settings.rules[0])

    def begin(self, rows: list[int]) -> None:
        """Begin new episodes of some flights."""
        for i in self._flights_of(rows):
            self._trails[i] = []
        self._seen = self.flights.restart(rows)

    def _flights_of(self, rows: list[int]) -> list[int]:
        """The flights of some episodes."""
        return [row * self._aircraft + a for row in rows for a in range(self._aircraft)]

    @property
    def seen(self) -> Leg:
        """What is seen of every flight as it stands."""
        if self._seen is None:
            self._seen = self.flights.observe()
        return self._seen

    def observation(self) -> NDArray[Any]:
        """Goal, radars and timers."""
        observed = self.seen.observed
        return observed if self._aircraft == 1 else observed.reshape(-1, self._aircraft * observed.shape[1])

    def reset_info(self) -> Info:
        """The info that ``reset`` returns: the same as after each step."""
        return self._info(self.seen)

    def advance(
        self, actions: NDArray[Any], begin: Flags, generators: Sequence[np.random.Generator]
    ) -> VectorStep:
        """See ``BatchTask.advance``; one kernel flies some and restarts the others where it can."""
        if self._aircraft > 1 or self.stock is not None or self._drawing or not begin.any():
            return super().advance(actions, begin, generators)
        rows = np.flatnonzero(begin).tolist()
        begun = [generators[i] for i in rows]
        for i, generator in zip(rows, begun, strict=True):
            self.flights.rekey(i, generator)
        self.redraw(rows, begun)
        flown = self._fly(actions, restarting=True)
        return (*flown[:4], complete(flown.info, len(begin)))

    def step(self, actions: NDArray[Any]) -> Outcome:
        """Take every flight through one leg, or several aircraft on until the first leg ends."""
        return self._fly(actions)

    def _fly(self, actions: NDArray[Any], restarting: bool = False) -> Outcome:
        """As ``step``; ``restarting`` begins the next episodes of flights that are over."""
        settings = self.settings
        actions = actions if self._aircraft == 1 else actions.reshape(-1, 2)
        before = self.flights.flights.copy() if self._drawing else None
        legs = legs_of(actions, settings.least_leg, settings.longest_leg)
        leg = self._seen = self.flights.advance(legs, restarting)
        if before is not None:
            for i in np.flatnonzero(before["over"] == FLYING).tolist():
                self._trace(i, before[i])
        reward, terminated = leg.reward, leg.over != FLYING
        if self._aircraft > 1:
            reward, terminated = (
                self._by_episode(reward).sum(axis=1),
                self._by_episode(terminated).all(axis=1),
            )
        return Outcome(
            observation=self.observation(),
            reward=reward,
            terminated=terminated,
            truncated=np.zeros(len(reward), dtype=np.bool_),
            info=self._info(leg),
        )

    def _info(self, leg: Leg) -> Info:
        """The info."""
        count, numbers = self.flights.rules.count, leg.numbers
        known = self._by_episode(leg.known)
        radars = known[..., len(KNOWN) :].reshape(*known.shape[:-1], count, len(OF_RADAR))
        of_all = radars if self._aircraft == 1 else radars[:, 0]
        others: dict[str, Any] = {  # places in the orders of KNOWN and OF_RADAR
            "place": known[..., 0:2],
            "course": known[..., 2],
            "radial": known[..., 3],
            "timers": radars[..., 2:5],
            "detected": radars[..., 5],
            "layout.start": known[..., 6:8],
            "layout.goal": known[..., 8:10],
            "layout.radars": of_all[..., 0:2],
            "privileged.place": known[..., 4:6],
            **self.drawn.info,
        }
        if isinstance(self.flights, Team):
            split = numbers.reshape(len(NUMBERS), -1, self._aircraft)
            others |= {f"each.{name}": own for name, own in zip(NUMBERS, split.copy(), strict=True)}
            others["leg_left"] = self.flights.legs["way"].copy()
            others["tracked"] = self.flights.tracked[:, :count].copy()
            numbers = np.array([COMBINED[n](of, axis=1) for n, of in zip(NUMBERS, split, strict=True)])
        return Info(NUMBERS, numbers, others)

    def state(self) -> dict[str, Any]:
        """Everything that the next steps depend on but the random generators."""
        rows = len(self.flights) // self._aircraft
        state: dict[str, Any] = {"flights": self.flights.state().view(np.uint8).reshape(rows, -1).copy()}
        if isinstance(self.flights, Team):
            state["legs"] = self.flights.legs.copy().view(np.uint8).reshape(rows, -1)
            state["tracked"] = self.flights.tracked.copy()
        return state

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Return to a snapshot; what has been flown before it is not drawn any more."""
        kind, given = self.flights.flights.dtype, {k: np.ascontiguousarray(state[k]) for k in self.state()}
        own = self.state()
        if any(v.dtype != own[k].dtype or v.shape != own[k].shape for k, v in given.items()):
            raise ValueError("not a snapshot of this environment; get_state makes one")
        self.flights.set_state(given["flights"].view(kind).reshape(-1))
        if isinstance(self.flights, Team):
            self.flights.legs[...] = given["legs"].view(self.flights.legs.dtype)
            self.flights.tracked[...] = given["tracked"]
        self._trails = [[] for _ in self._trails]
        self._seen = None

    def show(self, plan: ArrayLike | None) -> None:
        """Take over what is drawn beside the task; see ``UavRouteEnv.show``."""
        points = None if plan is None else np.asarray(plan, dtype=np.float64)
        if points is not None:
            if points.ndim not in (2, 3) or points.shape[-1] != 2:
                raise ValueError(f"a plan has shape (points, 2) or (flights, points, 2), not {points.shape}")
            points = np.broadcast_to(points, (len(self.flights), *points.shape[-2:]))
        self._plan = points

    def _trace(self, i: int, before: Any) -> None:
        """Keep what a flight has flown for the picture: north, east, largest probability of detection."""
        one = self.flights.flights[i]
        if (one["place"] == before["place"]).all():
            return
        heading = None if before["legs"] == 0 else math.atan2(before["course"][1], before["course"][0])
        flown = simulate_plan(
            [before["place"], one["place"]],
            one["radars"][: self.flights.rules.count],
            self.drawn.settings[i // self._aircraft].world,
            heading=heading,
            step=TRACED,
        )
        self._trails[i].append(np.column_stack([flown.position, flown.probability.max(axis=1)]))

    def frame(self, i: int) -> Frame:
        """Draw one episode."""
        from fieldgym.rendering.uav_route import draw

        numbers = self._info(self.seen).numbers[:, i].tolist()
        return draw(
            [self._picture(row) for row in self._flights_of([i])], dict(zip(NUMBERS, numbers, strict=True))
        )

    def _picture(self, i: int) -> Picture:
        """What is drawn of one flight."""
        from fieldgym.rendering.uav_route import Picture

        flights, rules = self.flights, self.drawn.settings[i // self._aircraft].rules[0]
        one = flights.flights[i]
        trail = self._trails[i]
        return Picture(
            layout=flights.layout(i),
            world=rules.world,
            capture=rules.capture,
            max_legs=rules.max_legs,
            place=one["place"].copy(),
            course=one["course"].copy(),
            trail=np.concatenate(trail) if trail else np.zeros((0, 3)),
            probability=one["probability"][: rules.count].copy(),
            detected=one["detected"][: rules.count] == 1,
            timers=one["timers"][: rules.count].copy(),
            over=int(one["over"]),
            plan=None if self._plan is None else self._plan[i],
        )


class UavRouteEnv(TaskEnv):
    r"""Fly to a goal past radars that see an aircraft's sides, leg by leg.

    ## Description

    An aircraft flies at a fixed height from waypoint to waypoint (A. I. Chaudhry, "Topics in robot
    locomotion", Cornell University 2015, chapter 4). A radar detects it by range and signature: next to
    nothing within 30 degrees of nose and tail, much from its sides, most when it banks. Detected for long
    enough, it is hit by a missile; hidden for long enough, it breaks the radar's lock (figure 4.2).

    One step is one straight leg at 0.25 km/s, banked at its beginning while it turns. The radars scan every
    5 s at most. [Physics, planners and results](../uav_route.md).

    ### Several aircraft

    With `aircraft` above 1 all fly at once, each to its own goal. A step ends when the first leg does; the
    others finish theirs, whatever their action says. Actions and observations are those of each in turn.

    - `tracking="each"`: every radar follows each aircraft with timers of its own.
    - `tracking="one"`: a free radar locks on the aircraft that it detects with the largest probability,
      until that lock is lost or that flight is over (figure 4.2).

    Aircraft do not collide. Stock effects of signals act on a single aircraft only.

    ## Action Space

    `Box(-1, 1, (2,), float32)`; several aircraft: `(2 aircraft,)`.

    | Num | Action | -1 | 0 | +1 |
    |-----|--------|----|---|----|
    | 0 | heading from the nearest radar's bearing, units of pi, right positive | away | at it | away |
    | 1 | length of the leg, geometric | 2.5 km (`least_leg`) | 35 km | 500 km (`longest_leg`) |

    `fieldgym.uav_route.actions_towards` gives the actions that fly to waypoints on the map.

    ## Observation Space

    `Box(-100, 100, (8 + 9 radars,), float32)`, in the frame of the nearest radar's bearing.

    | Num | Observation | Unit |
    |-----|-------------|------|
    | 0, 1 | the goal ahead (towards the nearest radar), to the right | 100 km |
    | 2 | logarithm of its distance, from 1 km | log 100 km |
    | 3, 4 | cosine and sine of its bearing | 1 |
    | 5, 6 | cosine and sine of the course of the last leg; at the start, of the goal's bearing | 1 |
    | 7 | share of the legs that are left | 1 |

    and for each radar, the nearest first

    | Num | Observation | Unit |
    |-----|-------------|------|
    | 8-10 | slant range beyond that of a side-on detection: tanh of 5 km, tanh of 50 km, in 500 km | - |
    | 11, 12 | cosine and sine of its bearing | 1 |
    | 13-15 | lock-loss, engage and launch timer | their thresholds, at most 1 |
    | 16 | 1 if its last scan detected the aircraft | 1 |

    Several aircraft, `(aircraft * (10 + 10 radars),)`: for each the columns above, what is left of its leg
    (100 km), 1 while it flies, and for each radar 1 if it follows another.

    ## Rewards

    The sum of

    | Setting | Counts |
    |---|---|
    | `-length_cost` | a kilometre flown |
    | `progress_reward` | a kilometre by which the goal has come nearer (a potential's difference) |
    | `arrival_reward` | arrival at the goal |
    | `-damage_cost` | a hit |
    | `-late_cost` | no leg left |
    | `-detection_cost`, `-sighting_cost` | a detected second; a leg with a detection (default 0) |

    Of several aircraft it is the sum; `-sighting_cost` then counts steps.

    `info` holds after each step, and after `reset`

    | Key | Meaning |
    |-----|---------|
    | `success`, `damaged` | 1 if the aircraft has just arrived, just been hit |
    | `time` | since the start [s] |
    | `path_length`, `remaining` | flown since then; distance to the goal [km] |
    | `time_over`, `longest_detection` | time in which any radar detected it; unbroken, by one [s] |
    | `largest_probability` | largest probability of detection of a scan |
    | `lock_losses`, `legs` | how often an engaged radar lost its lock; legs flown |
    | `place` | north and east as the aircraft measures it [km] |
    | `course`, `radial` | of the last leg, clockwise from north; bearing of the nearest radar [rad] |
    | `timers` | lock-loss, engage and launch timer of each radar [s], shape (radars, 3) |
    | `detected` | 1 for each radar whose last scan detected the aircraft, shape (radars,) |
    | `layout.start`, `layout.goal`, `layout.radars` | north and east [km], shapes (2,), (2,), (radars, 2) |
    | `privileged.place` | the true place, if a sensor is faulty [km] |

    Of several aircraft, `success` is 1 if all have arrived, `damaged` if one is hit; `time`,
    `longest_detection` and `largest_probability` are the largest, other numbers sums; arrays have an axis
    of aircraft first. `each.success` and so on are those of each, `leg_left` is what is left of its leg
    [km], `tracked` whom each radar follows (-1 for none).

    ## Starting State

    `layout="random"`: one radar in the middle of the map; the start 1 to 30 % outside the circle within
    which it detects an aircraft from the side, the goal mostly inside (0.69 to 0.995 of it), up to 60
    degrees aside. Further radars leave a route of two legs undetected. `layout="example"` is section
    4.5.1's: from (350, 125) to (340, 0) km, the radar at (0, 0). Further aircraft likewise; the example's
    second starts at (-350, 125), its goal mirrored.

    ## Episode End

    Terminated within `capture` (5 km) of the goal, by a hit, or when none of `max_legs` (60) is left; never
    truncated. Several aircraft: when the last flight is over.

    ## Arguments

    ```python
    import gymnasium as gym

    gym.make(
        "fieldgym:fieldgym/UavRoute-v1",
        settings={"radars": 3, "lock_loss": False, "threshold": 0.6},
        reality={"wind": {"north": 20.0, "east": 0.0}},
        render_mode="rgb_array",
    )
    gym.make_vec("fieldgym/UavRoute-v1", num_envs=1024)  # one kernel, same bits
    ```

    `reality` takes effects of the machine `uav_route`, stock effects, or the path of an `extended.yaml`.
    `render_mode` is `rgb_array` (960 x 540, a frame a leg) or `human`; `unwrapped.show(plan=...)` also draws
    an agent's plan. [What all environments share](../your_library.md).

    ## Matches, deviates, assumed

    - **Matches**: aircraft and turns (4.1)-(4.2); Tables 4.1 and 4.2; timers (4.3)-(4.7); the example
      (4.5.1); certain (4.18) and drawn (4.2.2) detection.
    - **Deviates**: where the source is wrong (`reading="printed"` is the source's, but for the heading,
      which cannot be flown leg by leg). Legs have any length, not steps of 50 s.
    - **Assumed**: [speed, height, interpolation, thresholds, scan interval](../uav_route.md); capture radius,
      layouts, number of legs, reward; `tracking="one"`.

    ## Version History

    - v1: progress is measured around the circle; progress, length and arrival count 4, 2 and 3 times as much
      by default
    - v0: first version
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 4}  # noqa: RUF012
    batch_task = _UavRouteTask
    title = "UAV route"

    def show(self, plan: ArrayLike | None = None) -> None:
        """Draw an agent's plan beside the task, until the next call; no argument: nothing.

        Args:
            plan: Waypoints, north and east [km], shape (points, 2), or (aircraft, points, 2).

        Raises:
            ValueError: If the shape is wrong.
        """
        assert isinstance(self._task, _UavRouteTask)
        self._task.show(plan)


class UavRouteVectorEnv(TaskVectorEnv):
    """Many flights in one kernel; each row is ``UavRouteEnv`` to the bit."""

    batch_task = _UavRouteTask

    def show(self, plan: ArrayLike | None = None) -> None:
        """As ``UavRouteEnv.show``; ``plan`` of shape (points, 2) or (num_envs * aircraft, points, 2)."""
        assert isinstance(self._task, _UavRouteTask)
        self._task.show(plan)
