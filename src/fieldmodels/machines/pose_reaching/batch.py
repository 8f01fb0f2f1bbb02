"""Robots on the field, a batch at a time: what environments and evaluations work with.

A robot's starts depend on its seed and the number of its episode alone; its motion is deterministic.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.declared import any_on, as_rows, neutral
from fieldmodels.drivers.stepped import Channels, Stepped
from fieldmodels.machines.pose_reaching.declaration import BASE, EFFECTS, ROW
from fieldmodels.machines.pose_reaching.extended import Extended, make_extended
from fieldmodels.machines.pose_reaching.kernel import (
    NUMBERS,
    OBSERVED,
    ROBOT,
    advance_all,
    observe_all,
    see_all,
    start_all,
    start_all_at,
)
from fieldmodels.machines.pose_reaching.parameters import FIELD, LOOSE, STRICT, Arrival, Field, Limits
from fieldmodels.model import ModelError
from fieldmodels.settings import Setting, check_declared, kernel_rows
from fieldmodels.streams import drawn_key

NOBODY = np.zeros(0, dtype=np.int64)
INSTANT = 0.01
"""Longest time between instants at which arrival is tested [s]: 1 cm and 2.3 deg at full speed and rate."""

CHANNELS = Channels(
    commands=("speed", "turn_rate"),
    observed=("x", "y", "heading"),
    without="a robot is told how to move, and measures its pose",
)
"""Where stock effects can act on a robot."""


@dataclass(frozen=True)
class Rules:
    """What is played, as the environment's settings state it."""

    starts: Annotated[
        Literal["T1", "T2", "T3"],
        Setting(
            "Where episodes begin: `T1` on the right half, facing the ball; `T2` on both sides, up to 45 "
            "deg off; `T3` anywhere, with any heading."
        ),
    ] = "T3"
    success: Annotated[
        Literal["strict", "loose"],
        Setting("`strict`: within 5 cm of the ball and 10 deg of the heading; `loose`: 10 cm and 15 deg."),
    ] = "strict"
    drive: Annotated[
        Literal["unicycle", "omnidirectional"],
        Setting(
            "`unicycle` drives forwards; `omnidirectional` also backwards and sideways.",
            fixed="it shapes the actions",
        ),
    ] = "unicycle"
    tick: Annotated[
        float,
        Setting(
            "Time for which a command holds.",
            "s",
            least=0.001,
            most=1,
            fixed="it sets the instants of a tick",
        ),
    ] = 0.1
    timeout: Annotated[float, Setting("Longest episode.", "s", above=0, most=3600)] = 15.0
    max_speed: Annotated[float, Setting("Largest speed.", "m/s", above=0, most=10)] = 1.0
    max_rate: Annotated[float, Setting("Largest turn rate.", "rad/s", above=0, most=30)] = 4.0
    walls: Annotated[
        Literal["stop", "slide"],
        Setting("`stop`: the robot stands at a wall until it has turned away; `slide`: it slides along."),
    ] = "stop"
    time_cost: Annotated[float, Setting("Cost of a second.", least=0, most=1000)] = 1.0
    success_reward: Annotated[float, Setting("Reward of arriving.", least=0, most=1000)] = 10.0
    progress_reward: Annotated[
        float,
        Setting(
            "Reward of a metre towards the ball.",
            least=0,
            most=1000,
        ),
    ] = 1.0
    wall_cost: Annotated[float, Setting("Cost of driving into a wall.", least=0, most=1000)] = 0.0

    def __post_init__(self) -> None:
        """Check the numbers; see ``check_declared``."""
        check_declared(self)

    @property
    def action_count(self) -> int:
        """Numbers in an action."""
        return 3 if self.drive == "omnidirectional" else 2

    @property
    def arrival(self) -> Arrival:
        """When the robot has arrived."""
        return ARRIVALS[self.success]

    @property
    def limits(self) -> Limits:
        """What can be commanded."""
        return Limits(max_speed=self.max_speed, max_rate=self.max_rate)


ARRIVALS = {"strict": STRICT, "loose": LOOSE}


def kernel_rules(rules: Rules, batch: int, field: Field, arrival: Arrival) -> NDArray[Any]:
    """The rules as the kernels read them, shape (batch,)."""
    derived = {
        "substeps": max(1, math.ceil(rules.tick / INSTANT - 1e-9)),
        "last_tick": max(1, math.ceil(rules.timeout / rules.tick - 1e-9)),
        "half_length": field.length / 2,
        "half_width": field.width / 2,
        "near": arrival.distance,
        "cosine_of_angle": math.cos(arrival.angle),
        "radius": rules.limits.radius,
    }
    return kernel_rows(rules, batch, derived)


class Tick(NamedTuple):
    """What one tick of every robot gave, in arrays of its own.

    Attributes:
        observed: What is observed of each robot, shape (batch, 7), float32, columns as in ``OBSERVED``.
        numbers: Shape (6, batch), rows as in ``NUMBERS``: 1 where the robot has just arrived; time since
            the start [s]; length of the path [m]; length of the shortest Dubins path from the start [m];
            the time that it takes at full speed [s]; times that the robot drove into a wall.
        poses: x [m], y [m], heading [rad] of each robot as measured, shape (batch, 3).
        true_poses: The same as it is (privileged); without effects the same array.
        reward: Score of the tick, shape (batch,).
        success: True where the robot has arrived in this tick, shape (batch,).
        late: True where time has run out, shape (batch,).
    """

    observed: NDArray[np.float32]
    numbers: FloatArray
    poses: FloatArray
    true_poses: FloatArray
    reward: FloatArray
    success: NDArray[np.bool_]
    late: NDArray[np.bool_]


def commanded(
    actions: NDArray[np.floating[Any]], max_speed: float | FloatArray, max_rate: float | FloatArray
) -> FloatArray:
    """What actions command: speed, speed to the left [m/s] and turn rate [rad/s], shape (batch, 3).

    An omnidirectional robot's velocity is shortened to the largest speed.

    Args:
        actions: Of unicycles, shape (batch, 2), or of omnidirectional robots, shape (batch, 3).
        max_speed: Largest speed [m/s], of all or each.
        max_rate: Largest turn rate [rad/s], of all or each.
    """
    clipped = np.clip(np.asarray(actions, dtype=np.float64), -1.0, 1.0)
    ahead, rate = clipped[:, 0], max_rate * clipped[:, 1]
    if clipped.shape[1] == 2:
        return np.column_stack([0.5 * np.asarray(max_speed) * (1.0 + ahead), 0.0 * rate, rate])
    left = clipped[:, 2]
    scale = max_speed / np.maximum(np.hypot(ahead, left), 1.0)
    return np.column_stack([scale * ahead, scale * left, rate])


class Robots:
    """A batch of robots in one reality (or one reality each), each with an episode of its own.

    Attributes:
        rules: The task's rules.
        field: On which field.
        robots: State of every robot, shape (batch,), dtype ``ROBOT``.
        extended: What they truly are, with effects; None if all are nominal.
        stock: Stock effects around the robots, or None.
    """

    def __init__(
        self,
        batch: int,
        rules: Rules | None = None,
        reality: ArrayLike | None = None,
        *,
        possible: ArrayLike | None = None,
        field: Field = FIELD,
        arrival: Arrival | None = None,
        stock: Stepped | None = None,
    ) -> None:
        """Make robots; seed and restart each before the first tick.

        Args:
            batch: Number of robots.
            rules: The task's rules.
            reality: Parameter vector of ``PoseReaching``, shape (n,) or (batch, n); None is nominal.
            possible: Parameter vectors as extreme as ``set_reality`` will give, shape (k, n); None for none.
            field: The playing field.
            arrival: When a robot has arrived; None takes that of the rules.
            stock: Stock effects around them, by ``CHANNELS``.

        Raises:
            ModelError: If the reality has the wrong shape or the batch is empty.
        """
        if batch < 1:
            raise ModelError(f"a batch needs at least one robot, not {batch}")
        nominal = neutral(BASE, EFFECTS)
        vector = np.asarray(nominal if reality is None else reality, dtype=np.float64)
        if vector.shape not in (nominal.shape, (batch, *nominal.shape)):
            raise ModelError(
                f"reality must have shape {nominal.shape} or {(batch, *nominal.shape)}, not {vector.shape}"
            )
        self.rules = rules or Rules()
        self.robots: NDArray[Any] = np.zeros(batch, dtype=ROBOT)
        self.extended: Extended | None = None
        self.field = field
        self._rules = kernel_rules(self.rules, batch, field, arrival or self.rules.arrival)
        self.stock = stock
        self._shown = np.zeros((batch, len(CHANNELS.observed)))
        if stock is not None:
            stock.kept["shown"] = self._shown
        later = vector if possible is None else np.asarray(possible, dtype=np.float64)
        if stock or any_on(vector, BASE, EFFECTS).any() or any_on(later, BASE, EFFECTS).any():
            vectors = np.array(np.broadcast_to(vector, (batch, len(nominal))))
            instant = self.rules.tick / int(self._rules["substeps"][0])
            on = self._on(vectors)
            self.extended = make_extended(as_rows(vectors, ROW), on, instant, as_rows(later, ROW))
        self._seeded = np.zeros(batch, dtype=np.bool_)
        self._ready = False

    def __len__(self) -> int:
        """Number of robots."""
        return len(self.robots)

    def set_reality(self, rows: Sequence[int] | IntArray, vectors: FloatArray) -> None:
        """Give some robots, before their next episode, other parameters; shape (len(rows), n)."""
        if self.extended is None:
            raise ModelError("robots that are to have effects later need them among ``possible``")
        self.extended.rows[rows] = as_rows(vectors, ROW)
        self.extended.on[rows] = self._on(vectors)

    def _on(self, vectors: FloatArray) -> NDArray[np.bool_]:
        """Which robots go from instant to instant: those with an effect; all if stock effects are around."""
        return any_on(vectors, BASE, EFFECTS) | (self.stock is not None)

    def set_rules(self, row: int, rules: Rules) -> None:
        """Give one robot, before its next episode, other rules with the same tick."""
        self._rules[row] = kernel_rules(rules, 1, self.field, rules.arrival)[0]

    def seed(self, i: int, rng: np.random.Generator) -> None:
        """Give robot ``i`` a stream keyed by one draw from ``rng``; its next episode is its first."""
        self.robots["key"][i] = drawn_key(rng)
        self.robots[i]["episode"] = 0
        self._seeded[i] = True
        self._ready = False

    def restart(self, which: Iterable[int], poses: ArrayLike | None = None) -> None:
        """Begin the next episode of some robots.

        Args:
            which: Their numbers.
            poses: Where they start: x [m], y [m], heading [rad], shape (3,) or (len(which), 3); drawn from
                the robots' own streams if None.

        Raises:
            ModelError: If a robot was never seeded, or a pose is not one in the field.
        """
        rows = np.fromiter(which, dtype=np.int64)
        if not self._seeded[rows].all():
            raise ModelError("seed every robot before its first episode")
        if poses is None:
            start_all(self.robots, rows, self.extended, self._rules)
        else:
            start_all_at(self.robots, rows, self._inside(poses, len(rows)), self.extended, self._rules)
        self._ready = bool(self._seeded.all())
        if self.stock is not None:
            self._begin_stock(rows, self.stock)
            self._shown[rows] = self.stock.shown(self._seen().poses[rows], rows)

    def _begin_stock(self, rows: IntArray, stock: Stepped) -> None:
        """Begin the stock effects' episodes of some robots."""
        stock.begin(rows)
        if stock.moves:
            self.set_reality(rows, stock.change(rows, 0.0))

    def observe(self) -> Tick:
        """What is observed of every robot as it stands; the rewards are zero."""
        tick = self._seen()
        if self.stock is not None and self.stock.senses:
            see_all(self._shown, tick.observed, tick.poses)
        return tick

    def _seen(self) -> Tick:
        """As ``observe``, before stock effects of the sensors."""
        tick = self._empty()
        observe_all(
            self.robots,
            self.extended,
            self._rules,
            tick.observed,
            tick.numbers,
            tick.poses,
            tick.true_poses,
        )
        for array in (tick.reward, tick.success, tick.late):
            array[...] = 0
        return tick

    def advance(self, actions: NDArray[np.floating[Any]], restarting: bool = False) -> Tick:
        """Take every robot through one tick.

        Args:
            actions: Speed from 0 (-1) to the largest (1), turn rate from the largest to the right (-1) to
                the largest to the left (1), clipped; shape (batch, 2), float, C-contiguous. Of an
                omnidirectional robot speed from the largest backwards (-1), and the speed to the left, from
                -1 to 1, as the third, shape (batch, 3).
            restarting: True lets a robot whose episode is over begin its next one instead; its action is
                ignored, its reward 0, and what is observed of it is the new episode's start.

        Raises:
            ModelError: If the actions are not finite, or a robot never began an episode.
        """
        if not self._ready:
            raise ModelError("seed and restart every robot before the first tick")
        given, sideways = self._commanded(actions)
        begin = np.flatnonzero(self.robots["over"]) if self.stock and restarting else NOBODY
        tick = self._empty()
        finite = advance_all(
            self.robots,
            actions,
            restarting,
            given,
            sideways,
            self.extended,
            self._rules,
            tick.observed,
            tick.numbers,
            tick.poses,
            tick.true_poses,
            tick.reward,
            tick.success,
            tick.late,
        )
        if not finite:
            raise ModelError(f"actions must be finite numbers, not {actions}")
        if self.stock is not None:
            self.stock.tick()
            self._begin_stock(begin, self.stock)
            if self.stock.senses:
                self._shown[:] = self.stock.shown(tick.poses)
                see_all(self._shown, tick.observed, tick.poses)
        return tick

    def _commanded(self, actions: NDArray[np.floating[Any]]) -> tuple[FloatArray | None, FloatArray | None]:
        """Speeds and turn rates that the drive is given, and speeds to the left; None as actions say."""
        omnidirectional = self.rules.drive == "omnidirectional"
        if self.stock is None and not omnidirectional:
            return None, None
        commands = self.commands(actions)
        given = np.ascontiguousarray(commands[:, ::2])
        if self.stock is not None:
            if self.stock.moves:
                every = np.arange(len(self))
                self.set_reality(every, self.stock.change(every, self.rules.tick))
            given = self.stock.given(given)
        return given, np.ascontiguousarray(commands[:, 1]) if omnidirectional else None

    def commands(self, actions: NDArray[np.floating[Any]]) -> FloatArray:
        """What actions command; see ``commanded``."""
        return commanded(actions, self._rules["max_speed"], self._rules["max_rate"])

    def state(self) -> dict[str, NDArray[Any]]:
        """An exact snapshot of all robots: plain arrays, the first structured."""
        state = {"robots": self.robots.copy()}
        return state | {name: array.copy() for name, array in self._remembered().items()}

    def set_state(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Return to a snapshot.

        Raises:
            ModelError: If the snapshot is of another batch size or kind.
        """
        robots, own = np.asarray(state["robots"]), self._remembered()
        if robots.dtype != ROBOT or robots.shape != self.robots.shape:
            raise ModelError(f"a snapshot of {len(self)} robots is needed, not {robots.shape} {robots.dtype}")
        if state.keys() != {"robots", *own} or any(state[k].shape != own[k].shape for k in own):
            raise ModelError("the snapshot is one of a reality with other effects")
        self.robots[...] = robots
        for name, array in own.items():
            array[...] = state[name]
        self._seeded[:] = True
        self._ready = True

    def _remembered(self) -> dict[str, FloatArray]:
        """What effects remember, by name; empty without effects."""
        if self.extended is None:
            return {}
        return {name: getattr(self.extended, name) for name in ("speeds", "aims", "poses")}

    def _inside(self, poses: ArrayLike, count: int) -> FloatArray:
        """Given starts, checked, shape (count, 3)."""
        try:
            values = np.asarray(poses, dtype=np.float64)
        except (TypeError, ValueError):
            raise ModelError(f"a start is x [m], y [m] and heading [rad], not {poses!r:.80}") from None
        if not np.isfinite(values).all():
            raise ModelError(f"a start is x [m], y [m] and heading [rad], finite numbers, not {poses!r:.80}")
        if values.shape not in ((3,), (count, 3)):
            raise ModelError(
                f"starts are x [m], y [m] and heading [rad], shape (3,) or ({count}, 3), not {poses!r:.80}"
            )
        values = np.ascontiguousarray(np.broadcast_to(values, (count, 3)))
        edge = np.array([self.field.length / 2, self.field.width / 2])
        if (np.abs(values[:, :2]) > edge).any():
            raise ModelError(f"a start must lie within +-{edge[0]} m and +-{edge[1]} m, not {poses!r:.80}")
        return values

    def _empty(self) -> Tick:
        """Arrays for a tick."""
        batch = len(self.robots)
        poses = np.empty((batch, 3))
        return Tick(
            np.empty((batch, len(OBSERVED)), np.float32),
            np.empty((len(NUMBERS), batch)),
            poses,
            poses if self.extended is None else np.empty((batch, 3)),
            np.empty(batch),
            np.empty(batch, dtype=np.bool_),
            np.empty(batch, dtype=np.bool_),
        )
