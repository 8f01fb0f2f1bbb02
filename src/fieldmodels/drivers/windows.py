"""The driver of windows: a machine's predictions for a diagnosis, batched over parameter vectors."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Generic, TypeVar

import numpy as np

from fieldmodels.arrays import BoolArray, FloatArray, IntArray
from fieldmodels.drivers.declaration import Declaration, param_indices
from fieldmodels.drivers.kernel.compose import kernels_of
from fieldmodels.drivers.kernel.episodes import Sets
from fieldmodels.drivers.kernel.facts import Facts, curve_places
from fieldmodels.drivers.kernel.windows import Fineness, Log, Room, Spans, room_of
from fieldmodels.drivers.rates import slopes
from fieldmodels.effects import actuators, changes, forces, sensors
from fieldmodels.effects.curves import Curve
from fieldmodels.recording import Recording, Windows

LAG = sensors.ROW.column("lag_time_constant")
BRISTLE = forces.ROW.column("hysteresis_force")
FAST = 2.0  # times the usual speed: faster than nearly all of a recording
Made = TypeVar("Made")
PLAY = 0.02  # of the largest command, over which play is crossed


class Rows:
    """A machine's parameter vectors as the rows that drivers take, one for each place of stock effects.

    A row is gathered from the parameter vector with the neutral numbers of all places behind it. A machine
    without inputs has the row of one that does nothing.
    """

    def __init__(self, machine: Declaration) -> None:
        """Find where each number comes from."""
        self.base = np.array(param_indices(machine), dtype=np.int64)
        places = {
            "actuator": ([s.name for s in machine.inputs], actuators.ROW),
            "force": ([f.velocity for f in machine.forces], forces.ROW),
            "sensor": ([s.name for s in machine.outputs], sensors.ROW),
            # A change acts on all of p, own effects' numbers included.
            "change": ([str(i) for i in self.base], changes.ROW),
        }
        self.neutral = np.concatenate([layout.neutral for _, layout in places.values()])
        self.sources: dict[str, IntArray] = {}
        first = len(machine.names)
        for place, (signals, layout) in places.items():
            count = max(len(signals), 1) if place == "actuator" else len(signals)
            self.sources[place] = np.tile(np.arange(first, first + len(layout)), (count, 1))
            first += len(layout)
        parameters = [p.name for p in machine.parameters]
        for e in machine.stock:
            if isinstance(e, Curve):
                continue
            signals, layout = places[e.place]
            signal = (parameters if e.place == "change" else signals).index(e.signal)
            slots, start = layout.slots(e.kind), machine.slice_of(e.name).start
            self.sources[e.place][signal, slots] = start + np.arange(len(slots))
        self.curves = np.array(
            [i for c, _, _ in curve_places(machine) for i in range(*_bounds(machine, c))], dtype=np.int64
        )

    def of(self, parameters: FloatArray, *places: str) -> list[FloatArray]:
        """Rows of some places, each (batch, signals, len(layout))."""
        count = parameters.shape[1]
        numbers = np.empty((len(parameters), count + len(self.neutral)))
        numbers[:, :count], numbers[:, count:] = parameters, self.neutral
        return [numbers.take(self.sources[place], axis=1) for place in places]

    def sets(self, parameters: FloatArray) -> Sets:
        """All that kernels take of parameter vectors, shape (batch, n)."""
        act, frc, sen, changing = self.of(parameters, "actuator", "force", "sensor", "change")
        curves = parameters.take(self.curves, axis=1)
        return Sets(parameters.take(self.base, axis=1), act, frc, sen, changing, curves)


class WindowDriver:
    """Simulates windows of a recording for a batch of parameter vectors of one machine."""

    def __init__(self, machine: Declaration) -> None:
        """Compile the driver, or load it."""
        self.machine = machine
        self.rows = Rows(machine)
        self.kernels = kernels_of(machine)
        self._driving, self._path = Once(self._prepare), Once(self._smooth)
        self._slopes = Once(self._changing)
        self.paced = getattr(type(machine), "pace", None) is not None
        """Whether the machine says itself how fast it moves, whatever its states."""
        self.alike = np.ones(len(machine.states))

    def __call__(self, parameters: FloatArray, windows: Windows) -> FloatArray:
        """Outputs, shape (batch, windows, samples, outputs); see ``Model.simulate``."""
        states = np.ascontiguousarray(windows.states, dtype=np.float64)
        parameters = np.ascontiguousarray(parameters, dtype=np.float64)
        machine, recording = self.machine, windows.recording
        out = np.empty((len(parameters), len(windows), windows.samples, len(machine.outputs)))
        if not len(windows):
            return out
        if windows.lengths.min() < windows.samples:
            out[:] = np.nan
        driving, pieces = self._driving(recording), windows.pieces
        inside = pieces[np.searchsorted(pieces[:, 0], windows.starts, side="right") - 1]
        # A column of one row is contiguous and one of several is not: two kernels for the compiler.
        firsts, lasts = np.ascontiguousarray(inside[:, 0]), inside[:, 1] - 1
        sets = self.rows.sets(parameters)
        path = np.zeros((len(machine.forces), 0))
        if sets.frc[:, :, BRISTLE].any():
            path = self._path(recording)
        log = Log(
            command=driving.command,
            disturbance=np.ascontiguousarray(windows.pushed(len(machine.forces))),
            episodes=recording.bounds,  # a bristle remembers for as long as it is not turned round
            pieces=pieces,
            measured=driving.measured,
            slopes=self._slopes(recording) if sets.sen[:, :, LAG].any() else np.zeros((2, 0, out.shape[-1])),
            path=path,
            step=recording.step,
            interpolated=machine.hold == "interpolated",
            play=driving.play,
        )
        spans = Spans(windows.starts, windows.lengths, firsts, lasts, states)
        sizes = self.alike if self.paced else _spread(windows.states)
        room = driving.room(self.kernels.facts, path.shape[1])
        self.kernels.simulate(sets, log, spans, Fineness(self.speeds, sizes, machine.substeps), room, out)
        driving.give_back(room)
        return out

    @cached_property
    def speeds(self) -> FloatArray:
        """Speeds along the forces that are hardly exceeded."""
        return np.array([FAST * speed for speed in self.machine.speeds()])

    def _prepare(self, recording: Recording) -> _Driving:
        command = self.machine.commands(recording, episode_edges(recording)[1])
        return _Driving(
            command,
            PLAY * float(np.max(np.abs(command[:, :1]), initial=0.0)) or 1.0,
            np.array([s.name in recording for s in self.machine.outputs]),
        )

    def _changing(self, recording: Recording) -> FloatArray:
        """Rates of what sensors show, and the rates of those, shape (2, n, outputs); 0 if not measured."""
        found = np.zeros((2, len(recording), len(self.machine.outputs)))
        for k, output in enumerate(self.machine.outputs):
            if output.name in recording and not output.event:
                found[:, :, k] = slopes(recording, output.name, 1), slopes(recording, output.name, 2)
        return found

    def _smooth(self, recording: Recording) -> FloatArray:
        """Measured position along each force, freed of noise, shape (forces, n)."""
        positions = [f.position for f in self.machine.forces]
        return np.array(
            [without_noise(recording, p) if p in recording else np.zeros(len(recording)) for p in positions]
        )


@dataclass
class _Driving:
    """What drives a machine along a recording, and the memory to simulate it in.

    Attributes:
        command: Commands, shape (n, inputs).
        play: Command over which play is crossed.
        measured: Which outputs the recording has, shape (outputs,).
        rooms: Memory that no call uses at present, by the length of its path.
    """

    command: FloatArray
    play: float
    measured: BoolArray
    rooms: dict[int, list[Room]] = field(default_factory=dict)

    def room(self, facts: Facts, path: int) -> Room:
        """Memory for one call, used before or new; no number in it outlives a call."""
        kept = self.rooms.setdefault(path, [])
        try:
            return kept.pop()  # in one step, whatever other threads do
        except IndexError:
            return room_of(facts, len(self.command), path)

    def give_back(self, room: Room) -> None:
        """Keep a call's memory for the next one."""
        self.rooms[room.bent.shape[1]].append(room)


def _spread(states: FloatArray) -> FloatArray:
    """Standard deviation of each initial state over the windows, 1 where there is none, shape (states,)."""
    apart = states - np.add.reduce(states, axis=0) / len(states)
    sizes = np.sqrt(np.einsum("ij,ij->j", apart, apart) / len(states))
    return np.asarray(np.where(sizes > 0.0, sizes, 1.0))


class Once(Generic[Made]):
    """Makes something of a recording, once as long as the recording exists."""

    def __init__(self, make: Callable[[Recording], Made]) -> None:
        self.make = make
        self.made: dict[int, tuple[weakref.ref[Recording], Made]] = {}

    def __reduce__(self) -> tuple[Any, ...]:
        return Once, (self.make,)

    def __call__(self, recording: Recording) -> Made:
        """What was made of it."""
        key = id(recording)
        if key not in self.made:
            gone = weakref.ref(recording, lambda _: self.made.pop(key, None))
            self.made[key] = gone, self.make(recording)
        return self.made[key][1]


def _bounds(machine: Declaration, c: Curve) -> tuple[int, int]:
    part = machine.slice_of(c.name)
    return int(part.start), int(part.stop)


def episode_edges(recording: Recording) -> tuple[IntArray, IntArray]:
    """First and last sample of the episode that each sample belongs to."""
    counts = np.diff(recording.bounds, axis=1)[:, 0]
    return np.repeat(recording.bounds[:, 0], counts), np.repeat(recording.bounds[:, 1] - 1, counts)


def without_noise(recording: Recording, name: str) -> FloatArray:
    """A signal smoothed by a parabola through nine samples, episode by episode, shape (n,)."""
    from scipy.signal import savgol_filter  # half of the time that environments take to be imported

    parts = [recording[name][a:b] for a, b in recording.bounds]
    smooth = [savgol_filter(part, 9, 2) if len(part) >= 9 else part for part in parts]
    return np.ascontiguousarray(np.concatenate(smooth), dtype=np.float64)
