"""Flights leg by leg, a batch at a time: what environments and evaluations work with.

A flight's layouts depend on its seed and the number of its episode alone, and the numbers that decide its
radars' scans on these and the scan's time: equal seeds give every agent the same luck.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.compiled import compiled
from fieldmodels.drivers.stepped import Channels, Stepped
from fieldmodels.machines.uav_route.declaration import KM, PLANT, as_plants, nominal_plant
from fieldmodels.machines.uav_route.kernel import advance_all
from fieldmodels.machines.uav_route.layouts import banked_range, side_on_range
from fieldmodels.machines.uav_route.parameters import RADARS, Layout, LegRules, World
from fieldmodels.machines.uav_route.state import EACH, FLIGHT, KNOWN, LATE, NUMBERS, OF_RADAR, OWN
from fieldmodels.model import ModelError
from fieldmodels.settings import Setting, kernel_rows
from fieldmodels.streams import drawn_key
from fieldmodels.threads import run_rows


@dataclass(frozen=True)
class Rules(LegRules):
    """What is flown.

    Attributes:
        world: Aircraft, detection, lock loss, and how the source's equations are read.
        layout: Start, goal and radars of every episode; None draws them anew for each.
    """

    world: World = field(default_factory=World)
    layout: Layout | None = None
    step: Annotated[float, Setting("Longest time between tests if detection is certain.", "s", above=0)] = 5.0

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            ModelError: If one is not possible.
        """
        super().__post_init__()
        if self.count not in range(1, RADARS + 1):
            raise ModelError(f"flights have 1 to {RADARS} radars, not {self.count}")
        if self.layout is not None and math.dist(self.layout.start, self.layout.goal) <= self.capture:
            raise ModelError("the layout's start lies within the capture radius of its goal")
        if self.world.reading.heading == "next_leg":
            raise ModelError(
                "the printed heading is that of the next leg, which is not known while a leg is flown: "
                "choose heading='own_leg', or simulate a whole plan"
            )

    @property
    def count(self) -> int:
        """Number of radars."""
        return self.radars if self.layout is None else len(self.layout.radars)


def kernel_rules(rules: Rules, batch: int) -> NDArray[Any]:
    """The rules as the kernels read them, shape (batch,)."""
    layout = rules.layout or Layout((0.0, 0.0), (0.0, 0.0), ())
    sites = np.zeros((RADARS, 2))
    for r, site in enumerate(layout.radars):
        sites[r] = site
    derived = {
        "radars": rules.count,
        "drawn": rules.layout is None,
        "start_north": float(layout.start[0]),
        "start_east": float(layout.start[1]),
        "goal_north": float(layout.goal[0]),
        "goal_east": float(layout.goal[1]),
        "sites": sites,
        "side_on": side_on_range(rules.world.detection),
        "banked": banked_range(rules.world.detection),
    }
    return kernel_rows(rules, batch, derived)


@dataclass(frozen=True, slots=True)
class Leg:
    """What one leg of every flight gave, in arrays of its own.

    Attributes:
        observed: What is observed of each flight, shape (batch, 8 + 9 radars), float32, columns as in
            ``observed_names``: all in the frame of the nearest radar's bearing, within 100 of zero.
        numbers: Shape (10, batch), rows as in ``NUMBERS``: 1 where the goal is reached; 1 where the
            aircraft is hit; time [s]; length of the path [km]; distance left to the goal [km]; time over
            the threshold or detected [s]; longest such time without a break [s]; largest probability of
            detection in any scan; lock losses; legs.
        known: What is known of each flight [km, rad, s], shape (batch, 10 + 6 radars): ``KNOWN``, then
            ``OF_RADAR`` of each radar.
        reward: Score of the leg, shape (batch,).
        over: 0 while a flight goes on, 1 arrived, 2 hit, 3 out of legs; shape (batch,).
    """

    observed: NDArray[np.float32]
    numbers: FloatArray
    known: FloatArray
    reward: FloatArray
    over: NDArray[np.int64]

    @property
    def places(self) -> FloatArray:
        """North and east of each aircraft as measured [km], shape (batch, 2)."""
        return self.known[:, :2]


def empty_leg(batch: int, columns: int, radars: int) -> Leg:
    """Room for what a leg of every flight gives, with so many columns of observations."""
    return Leg(
        np.empty((batch, columns), dtype=np.float32),
        np.empty((len(NUMBERS), batch)),
        np.empty((batch, len(KNOWN) + radars * len(OF_RADAR))),
        np.empty(batch),
        np.empty(batch, dtype=np.int64),
    )


def observed_names(radars: int) -> tuple[str, ...]:
    """Names of the columns of ``Leg.observed``; radars are numbered by their distance."""
    return OWN + tuple(f"radar_{r}_{name}" for r in range(radars) for name in EACH)


def check_plants(own: NDArray[Any]) -> None:
    """Make sure that aircraft can fly.

    Raises:
        ModelError: If a wind is stronger than its aircraft, or a factor is not positive.
    """
    slowest = own["speed"] * (1.0 - own["turn_speed_loss"]["share"])
    if not (np.hypot(own["wind"]["north"], own["wind"]["east"]) < slowest).all():
        raise ModelError("the wind is as fast as the aircraft in a turn: it could not hold its course")
    factors = ("signature_scale", "nose_cone_width", "radar_range_scale", "scan_interval")
    if not all((own[name]["factor"] > 0).all() for name in factors):
        raise ModelError(f"the factors of {', '.join(factors)} must be positive")


CHANNELS = Channels(
    commands=("to_north", "to_east"),
    observed=("north", "east"),
    without="an aircraft is sent to a waypoint and measures its position",
    prompt=("to_north", "to_east", "north", "east"),
)
"""Where stock effects can act on a flight: on the waypoint of each leg, and on the position at its end."""


class Flights:
    """A batch of flights, each with an episode of its own.

    Attributes:
        rules: What is flown.
        records: The rules of each flight as the kernels read them, shape (batch,), see ``kernel_rules``.
        flights: All state, shape (batch,), dtype ``FLIGHT``.
        plants: What each aircraft truly is, shape (batch,), as ``UavRoute.plant`` gives it; where stock
            effects act on sensors, its sensor's bias is how far the position that they show is off.
        stock: Stock effects around the flights, or None.
        threads: On which the flights advance, side by side.
    """

    threads = 1

    def __init__(
        self,
        batch: int,
        rules: Rules | None = None,
        plant: NDArray[Any] | None = None,
        stock: Stepped | None = None,
    ) -> None:
        """Make flights; seed and restart each before the first leg.

        Args:
            batch: Number of flights.
            rules: What is flown.
            plant: What the aircraft truly is, shape () or (batch,), see ``UavRoute.plant``; None is nominal.
            stock: Stock effects around them, by ``CHANNELS``.

        Raises:
            ModelError: If the batch is empty, the plant has the wrong type or shape, its wind is stronger
                than the aircraft, or a factor is not positive.
        """
        if batch < 1:
            raise ModelError(f"a batch needs at least one flight, not {batch}")
        self.rules = rules or Rules()
        own = nominal_plant(self.rules.world.aircraft.speed) if plant is None else np.asarray(plant)
        if own.dtype != PLANT or own.shape not in ((), (batch,)):
            raise ModelError(
                f"a plant comes from UavRoute.plant and has shape () or ({batch},), not {own.shape} of "
                f"{own.dtype.name}"
            )
        check_plants(own)
        self.flights: NDArray[Any] = np.zeros(batch, dtype=FLIGHT)
        self.plants = np.array(np.broadcast_to(own, (batch,)))
        self.records = kernel_rules(self.rules, batch)
        self._columns = len(OWN) + self.rules.count * len(EACH)
        self._still, self._rows = np.zeros((batch, 2)), np.arange(batch)
        self._seeded = np.zeros(batch, dtype=np.bool_)
        self._begun = np.zeros(batch, dtype=np.bool_)
        self._ready = False
        self.stock = stock
        self._shown = np.zeros((batch, 2))
        if stock is not None:
            stock.kept["shown"] = self._shown

    def __len__(self) -> int:
        """Number of flights."""
        return len(self.flights)

    def set_rules(self, row: int, rules: Rules) -> None:
        """Give one flight, before its next episode, other rules with as many radars."""
        self.records[row] = kernel_rules(rules, 1)[0]

    def set_plants(self, rows: Sequence[int] | IntArray, plants: NDArray[Any]) -> None:
        """Say what some aircraft truly are from their next episode on; shape (len(rows),).

        Raises:
            ModelError: If one cannot fly, see ``check_plants``.
        """
        check_plants(plants)
        self.plants[rows] = plants

    def seed(self, i: int, rng: np.random.Generator) -> None:
        """Give flight ``i`` a stream keyed by one draw from ``rng``; its next episode is its first."""
        self.rekey(i, rng)
        self._begun[i] = False
        self._ready = False

    def rekey(self, i: int, rng: np.random.Generator) -> None:
        """As ``seed``, for a flight that is over: ``advance`` may begin its next episode."""
        self.flights["key"][i] = drawn_key(rng)
        self.flights["episode"][i] = 0
        self._seeded[i] = True

    def restart(self, which: Iterable[int]) -> Leg | None:
        """Begin the next episode of some flights.

        Returns:
            As ``observe``, where all flights have begun and nothing remains to be sensed; else None.

        Raises:
            ModelError: If a flight was never seeded.
        """
        rows = np.fromiter(which, dtype=np.int64)
        if not self._seeded[rows].all():
            raise ModelError("seed every flight before its first episode")
        self.flights["over"][rows] = LATE  # whatever is over begins anew
        self._begun[rows] = True
        begun = self._run(rows, self._still, restarting=True)
        self._ready = bool(self._begun.all())
        if self.stock is not None:
            self._begin_stock(rows, self.stock)
        return begun if len(rows) == len(self) and self.stock is None else None

    def observe(self) -> Leg:
        """What is observed of every flight as it stands; the rewards are zero."""
        return self._step(self._still, flying=False)

    def advance(self, actions: ArrayLike, restarting: bool = False) -> Leg:
        """Take every flight through one leg; one that is over stays as it is.

        Args:
            actions: Heading relative to the bearing of the nearest radar [rad], positive to its right, and
                length of the leg [km], limited to the rules' shortest and longest; shape (batch, 2).
            restarting: True lets a flight that is over begin its next episode instead: its action is
                ignored, its reward 0, and what is observed of it is the new episode's start.

        Raises:
            ModelError: If the actions have the wrong shape or are not finite, or a flight never began.
        """
        checked = self._checked(actions)
        if self.stock is None:
            return self._step(checked, relative=True, restarting=restarting)
        return self._fly_as_given(checked, restarting, self.stock)

    def _fly_as_given(self, actions: FloatArray, restarting: bool, stock: Stepped) -> Leg:
        """As ``advance``, to the waypoints that stock effects make of those commanded."""
        every = np.arange(len(self))
        stock.clock[:] = self.flights["time"]
        self._change(every, stock)
        if stock.acts:
            believed = self.flights["place"] + _north_east(self.plants)
            length = np.clip(actions[:, 1], self.records["least_leg"], self.records["longest_leg"])
            course = actions[:, 0] + nearest_bearing(believed, self.flights["radars"][:, : self.rules.count])
            ahead = length[:, None] * np.column_stack([np.cos(course), np.sin(course)])
            ahead = stock.given(KM * (believed + ahead)) / KM - believed
            actions = np.column_stack([np.arctan2(ahead[:, 1], ahead[:, 0]), np.hypot(*ahead.T)])
        begin = np.flatnonzero(self.flights["over"]) if restarting else every[:0]
        flown = self._step(actions, relative=not stock.acts, restarting=restarting)
        stock.clock[:] = self.flights["time"]
        self._begin_stock(begin, stock)
        if not stock.senses:
            return flown
        self._sense(np.setdiff1d(every, begin), stock)
        seen = self.observe()
        return replace(seen, reward=flown.reward)

    def _begin_stock(self, rows: IntArray, stock: Stepped) -> None:
        """Begin the stock effects' episodes of some flights."""
        stock.begin(rows)
        self._change(rows, stock)
        if stock.senses:
            self._sense(rows, stock)

    def _change(self, rows: IntArray, stock: Stepped) -> None:
        """Let the parameters of some flights be what they are by now."""
        if stock.moves:
            self.set_plants(rows, as_plants(stock.change(rows, 0.0)))
            if stock.senses:
                self._believe(rows)

    def _sense(self, rows: IntArray, stock: Stepped) -> None:
        """Let some aircraft measure their positions, and believe them."""
        own = _north_east(as_plants(stock.current[rows]))
        self._shown[rows] = stock.shown(KM * (self.flights["place"][rows] + own), rows) / KM
        self._believe(rows)

    def _believe(self, rows: IntArray) -> None:
        """Put how far the shown positions are off in the place of the sensors' bias."""
        off = self._shown[rows] - self.flights["place"][rows]
        for axis, name in enumerate(("north", "east")):
            self.plants["sensor_bias"][name][rows] = off[:, axis]

    def fly_to(self, waypoints: ArrayLike) -> Leg:
        """Take every flight towards a waypoint, given as north and east [km], shape (batch, 2).

        The leg's length is limited like any other.

        Raises:
            ModelError: As for ``advance``.
        """
        ahead = self._checked(waypoints) - self.flights["place"]
        bearing = np.arctan2(ahead[:, 1], ahead[:, 0])
        return self._step(np.column_stack([bearing, np.hypot(ahead[:, 0], ahead[:, 1])]))

    def layout(self, i: int) -> Layout:
        """Start, goal and radars of flight ``i``."""
        one = self.flights[i]
        return Layout(
            (float(one["start"][0]), float(one["start"][1])),
            (float(one["goal"][0]), float(one["goal"][1])),
            tuple((float(x), float(y)) for x, y in one["radars"][: self.rules.count]),
        )

    def state(self) -> NDArray[Any]:
        """An exact snapshot of all flights: a plain structured array, shape (batch,)."""
        return self.flights.copy()

    def set_state(self, state: NDArray[Any]) -> None:
        """Return to a snapshot.

        Raises:
            ModelError: If the snapshot is of another batch size or kind.
        """
        if state.dtype != FLIGHT or state.shape != self.flights.shape:
            raise ModelError(f"a snapshot of {len(self)} flights is needed, not {state.shape} {state.dtype}")
        self.flights[...] = state
        self._seeded[:] = True
        self._begun[:] = True
        self._ready = True
        if self.stock is not None and self.stock.senses:
            self._believe(np.arange(len(self)))

    def _checked(self, values: ArrayLike) -> FloatArray:
        """Actions or waypoints, checked, shape (batch, 2)."""
        array = np.ascontiguousarray(values, dtype=np.float64)
        if array.shape != (len(self), 2):
            raise ModelError(f"every flight needs two numbers, shape ({len(self)}, 2), not {array.shape}")
        if np.count_nonzero(np.isfinite(array)) != array.size:
            raise ModelError(f"actions must be finite numbers, not {array}")
        return array

    def _step(
        self, actions: FloatArray, *, flying: bool = True, relative: bool = False, restarting: bool = False
    ) -> Leg:
        if not self._ready:
            raise ModelError("seed and restart every flight before the first leg")
        return self._run(self._rows, actions, flying, relative, restarting)

    def _run(
        self, rows: IntArray, actions: FloatArray, flying: bool = True, relative: bool = False,
        restarting: bool = False,
    ) -> Leg:  # fmt: skip
        """Run the kernel on some flights; of the others nothing is written down."""
        leg = empty_leg(len(self), self._columns, self.rules.count)
        arguments = (
            rows, self.flights, actions, flying, relative, restarting, self.plants, self.records,
            leg.observed, leg.numbers, leg.known, leg.reward, leg.over,
        )  # fmt: skip
        if self.threads == 1:
            advance_all(*arguments)
        else:
            run_rows(self.threads, len(rows), advance_all, *arguments, whole=range(1, len(arguments)))
        return leg


@compiled
def nearest_bearing(places: FloatArray, radars: FloatArray) -> FloatArray:
    """Bearing of the radar nearest to each place [rad], shape (batch,)."""
    bearing = np.empty(len(places))
    for b in range(len(places)):
        least = np.inf
        for r in range(radars.shape[1]):
            north, east = radars[b, r, 0] - places[b, 0], radars[b, r, 1] - places[b, 1]
            square = north * north + east * east
            if square < least:
                least, bearing[b] = square, np.arctan2(east, north)
    return bearing


def _north_east(plants: NDArray[Any]) -> FloatArray:
    """Bias of each aircraft's sensor [km], shape (batch, 2)."""
    return np.column_stack([plants["sensor_bias"]["north"], plants["sensor_bias"]["east"]])
