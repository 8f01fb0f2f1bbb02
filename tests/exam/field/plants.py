"""The machines again, in plain NumPy by fixed steps, with anything wrong with them.

No line is shared with a model. Runs go side by side in lanes: states have the shape (states, lanes), commands
(inputs, lanes). A step of time is cut into finer ones, each by Runge and Kutta's fourth-order formula; dry
friction takes what it can from a velocity after each of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace as Numbers

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Rates = Callable[[float, Array, Array, Numbers], Sequence[Array]]
"""(time [s], states (s, lanes), what drives it (i, lanes), its numbers) to the rates of the states."""
Control = Callable[[float, Array, Array], Array]
"""(time [s], what is aimed at (i, lanes), outputs as shown (o, lanes)) to commands (i, lanes)."""
G = 9.81


@dataclass(frozen=True)
class Plant:
    """A machine without faults.

    Attributes:
        inputs: Their names.
        states: Likewise.
        outputs: Likewise; each is a state.
        rates: How it moves.
        numbers: Usual values of its numbers.
        known: Those that are not refitted.
        step: Sampling interval [s].
        finer: Steps of integration in it.
        samples: Rows of a usual record.
        window: Rows over which what a fault adds is measured.
        hold: For how many rows a command is held, at least and at most.
        centre: About what commands vary, each input.
        reach: By how much.
        noise: Standard deviation of what each sensor adds.
        start: First states.
        size: Of the states.
        ways: Positions by their velocities, as indices of states.
        control: Leads it to what is aimed at; None where the command is given.
    """

    inputs: tuple[str, ...]
    states: tuple[str, ...]
    outputs: tuple[str, ...]
    rates: Rates
    numbers: Mapping[str, float]
    step: float
    finer: int
    samples: int
    window: int
    hold: tuple[int, int]
    centre: tuple[float, ...]
    reach: tuple[float, ...]
    noise: tuple[float, ...]
    start: tuple[float, ...]
    size: tuple[float, ...]
    known: tuple[str, ...] = ()
    ways: Mapping[int, int] = field(default_factory=dict)
    control: Control | None = None

    @property
    def shown(self) -> list[int]:
        """Which states the outputs are."""
        return [self.states.index(name) for name in self.outputs]


@dataclass
class Log:
    """What happened, on the fine grid: (rows * finer + 1) instants.

    Attributes:
        time: Shape (instants,) [s].
        states: Shape (instants, s, lanes).
        drive: What drove it since the instant, shape (instants, i, lanes).
        shown: What sensors show, without noise, shape (instants, o, lanes).
        commands: Shape (rows, i, lanes).
    """

    time: Array
    states: Array
    drive: Array
    shown: Array
    commands: Array


Size = Array
"""How large a fault is in each lane, shape (lanes,)."""


@dataclass(frozen=True)
class Fault:
    """What is wrong with a machine, at a size of one; its parts act together.

    Attributes:
        rates: Each makes other rates of the rates, by a size.
        dry: Velocity's index; deceleration by (size, states, drive, numbers); another velocity that is moved
            by it and by how much, as (index, (states, numbers)).
        command: Each makes, by a size, what becomes of (time, command, states); asked once a row.
        lag: Of what drives it, by a size [s].
        delay: Likewise [s].
        fastest: Largest rate of what drives it, by a size.
        sensors: Each changes what is shown in a log, by a size.
        more: First values of states that the machine does not have.
        truth: Values of listed parameters by the size and the machine's numbers.
    """

    rates: tuple[Callable[[Rates, Size], Rates], ...] = ()
    dry: tuple[tuple[int, Callable[[Size, Array, Array, Numbers], Array], Couple | None], ...] = ()
    command: tuple[Callable[[Size], Callable[[float, Array, Array], Array]], ...] = ()
    lag: Callable[[Size], Size] | None = None
    delay: Callable[[Size], Size] | None = None
    fastest: Callable[[Size], Size] | None = None
    sensors: tuple[Callable[[Size, Log], None], ...] = ()
    more: tuple[float, ...] = ()
    truth: Mapping[str, Callable[[float, Numbers], float]] = field(default_factory=dict)

    def __add__(self, other: Fault) -> Fault:
        return Fault(
            self.rates + other.rates, self.dry + other.dry, self.command + other.command,
            self.lag or other.lag, self.delay or other.delay, self.fastest or other.fastest,
            self.sensors + other.sensors, self.more + other.more, {**self.truth, **other.truth},
        )  # fmt: skip


Couple = tuple[int, Callable[[Array, Numbers], Array]]
NOTHING = Fault()


def simulate(
    plant: Plant, numbers: Numbers, aims: Array, fault: Fault, size: Size, start: Array, noise: Array, *,
    step: float = 0.0, finer: int = 0, control: Control | None = None,
) -> Log:  # fmt: skip
    """Run a machine.

    Args:
        plant: The machine.
        numbers: Its numbers, each one or one a lane.
        aims: Commands, or what a controller leads it to, shape (rows, i, lanes).
        fault: What is wrong.
        size: How large that is, shape (lanes,).
        start: First states, shape (s, lanes).
        noise: What a controller's sensors add, shape (rows, o, lanes).
        step: Sampling interval [s], by default the usual one.
        finer: Steps in it, by default the usual number.
        control: Gives the commands; without one they are the aims.
    """
    rows, step, finer = len(aims), step or plant.step, finer or plant.finer
    h, count, lanes, seen = step / finer, len(plant.states), aims.shape[2], plant.shown
    rates = plant.rates
    for change in fault.rates:
        rates = change(rates, size)
    acts = [make(size) for make in fault.command]
    x = np.vstack([start, np.repeat(np.array(fault.more).reshape(-1, 1), lanes, axis=1)])
    states, drive = np.empty((rows * finer + 1, len(x), lanes)), np.empty((rows * finer + 1, *aims.shape[1:]))
    asked, commands = np.empty_like(aims), np.empty_like(aims)
    given: Array | None = None
    for i in range(rows):
        now = i * step
        commands[i] = aims[i] if control is None else control(now, aims[i], x[seen] + noise[i])
        asked[i] = commands[i]
        for act in acts:
            asked[i] = act(now, asked[i], x)
        for j in range(finer):
            t, k = now + j * h, i * finer + j
            u = asked[i] if fault.delay is None else _late(asked, i, t, h, step, fault.delay(size))
            if fault.lag is not None or fault.fastest is not None:
                given, u = _followed(u if given is None else given, u, h, fault, size)
            states[k], drive[k] = x, u
            with np.errstate(over="ignore", invalid="ignore"):
                x = _advanced(rates, t, x, u, numbers, h)
                if fault.dry:
                    x = _rubbed(rates, t + h, fault, size, x, u, numbers, h)
    states[-1], drive[-1] = x, drive[-2]
    time = np.asarray(np.arange(rows * finer + 1) * h, dtype=np.float64)
    log = Log(time, states[:, :count], drive, states[:, seen].copy(), commands)
    for sensor in fault.sensors:
        sensor(size, log)
    return log


def _advanced(rates: Rates, t: float, x: Array, u: Array, p: Numbers, h: float) -> Array:
    a = np.array(rates(t, x, u, p))
    b = np.array(rates(t + 0.5 * h, x + 0.5 * h * a, u, p))
    c = np.array(rates(t + 0.5 * h, x + 0.5 * h * b, u, p))
    d = np.array(rates(t + h, x + h * c, u, p))
    return np.asarray(x + h / 6.0 * (a + 2.0 * (b + c) + d))


def _rubbed(
    rates: Rates, t: float, fault: Fault, size: Size, x: Array, u: Array, p: Numbers, h: float
) -> Array:
    """Dry friction ends a velocity, or takes what it can in a step; others move as if it had all along."""
    after = x.copy()
    for which, taken, couple in fault.dry:
        left = np.sign(x[which]) * np.maximum(np.abs(x[which]) - h * taken(size, x, u, p), 0.0)
        if couple:
            after[couple[0]] += couple[1](x, p) * (left - x[which])
        after[which] = left
    moved = 0.5 * h * (np.array(rates(t, after, u, p)) - np.array(rates(t, x, u, p)))
    for which, _, _ in fault.dry:
        moved[which, after[which] == 0.0] = 0.0
    return after + moved


def _late(asked: Array, i: int, t: float, h: float, step: float, delay: Size) -> Array:
    """Mean over a fine step of commands that act late, held before the first one."""
    lanes = np.arange(asked.shape[2])
    begin, end = (t - delay) / step + 1e-9, (t + h - delay) / step - 1e-9
    k, m = np.floor(begin).astype(int), np.floor(end).astype(int)
    later = np.where(m > k, (end - m) / (end - begin), 0.0)
    early, late = (asked[np.clip(j, 0, i), :, lanes].T for j in (k, m))
    return np.asarray(early + later * (late - early))


def _followed(given: Array, aim: Array, h: float, fault: Fault, size: Size) -> tuple[Array, Array]:
    """What an actuator gives a fine step later, and its mean until then."""
    lag = np.maximum(fault.lag(size) if fault.lag else 0.0 * size, 1e-9)
    most = fault.fastest(size) * h if fault.fastest else np.inf
    change = (aim - given) * -np.expm1(-h / lag)
    after = given + np.clip(change, -most, most)
    mean = aim - (aim - given) * -np.expm1(-h / lag) * lag / h
    return after, np.where(np.abs(change) > most, 0.5 * (given + after), mean)


def _motor(_: float, x: Array, u: Array, p: Numbers) -> Sequence[Array]:
    current = (u[0] - p.resistance * x[0] - p.constant * x[1]) / p.inductance
    return current, (p.constant * x[0] - p.drag * x[1]) / p.inertia


def _tanks(_: float, x: Array, u: Array, p: Numbers) -> Sequence[Array]:
    upper, lower = np.sqrt(2.0 * G * np.maximum(x[:2], 0.0))
    runs = p.upper_outlet * upper
    return (p.flow * u[0] - runs) / p.area, (runs - p.lower_outlet * lower) / p.area


def _plate(_: float, x: Array, u: Array, p: Numbers) -> Sequence[Array]:
    return ((p.power * u[0] - p.loss * (x[0] - u[1])) / p.capacity,)


def _quadrotor(_: float, x: Array, u: Array, p: Numbers) -> Sequence[Array]:
    return x[1], G * (u[0] / p.hover - 1.0) - p.drag * x[1]


def _fly(_: float, aim: Array, y: Array) -> Array:
    return np.asarray(np.clip(0.45 * (1.0 + (1.2 * (aim - y[:1]) - 1.6 * y[1:2]) / G), 0.0, 1.0))


def _car(_: float, x: Array, u: Array, p: Numbers) -> Sequence[Array]:
    v = x[3]
    return v * np.cos(x[2]), v * np.sin(x[2]), v / p.wheelbase * np.tan(u[1]), p.push * u[0] - p.drag * v


def _crane(_: float, x: Array, u: Array, p: Numbers) -> Sequence[Array]:
    # Solved as two equations: (M + m) a + m l cos w' = F - c v + m l w^2 sin, cos a + l w' = -g sin.
    s, c, ml = np.sin(x[2]), np.cos(x[2]), p.load * p.cable
    right = u[0] - p.damping * x[1] + ml * x[3] ** 2 * s
    determinant = (p.mass + p.load) * p.cable - ml * c * c
    a = (right * p.cable + ml * c * G * s) / determinant
    return x[1], a, x[3], (-(p.mass + p.load) * G * s - c * right) / determinant


def _drive_crane(_: float, aim: Array, y: Array) -> Array:
    return np.asarray(60.0 * (aim - y[:1]))


def _cylinder(_: float, x: Array, u: Array, p: Numbers) -> Sequence[Array]:
    left = 1.0 - np.where(u[0] < 0.0, -1.0, 1.0) * x[2] / 6.0
    force = 1e5 * p.area * x[2] - p.damping * x[1] - p.spring * x[0]
    return x[1], force / p.mass, p.rise * u[0] * left - p.squeeze * x[1]


def _valve(_: float, x: Array, u: Array, p: Numbers) -> Sequence[Array]:
    return (u[0] - x[0]) / p.travel, (p.largest * 29.964100047397013 ** (x[0] - 1.0) - x[1]) / p.fill


def _rig(_: float, x: Array, u: Array, p: Numbers) -> Sequence[Array]:
    return x[1], (u[0] - p.damping * x[1] - p.stiffness * x[0]) / p.mass


def _pendulum(_: float, x: Array, u: Array, p: Numbers) -> Sequence[Array]:
    return x[1], (u[0] - p.gravity_moment * np.sin(x[0])) / p.inertia


def _swing(_: float, aim: Array, y: Array) -> Array:
    return np.asarray(1.5 * (aim - y[:1]) - 0.15 * y[1:2])


def _servo(_: float, x: Array, u: Array, p: Numbers) -> Sequence[Array]:
    return x[1], (u[0] - x[0] - p.damping * x[1] + p.offset) / p.inertia


def _robot(_: float, x: Array, u: Array, p: Numbers) -> Sequence[Array]:
    return u[0] * np.cos(x[2]), u[0] * np.sin(x[2]), u[1]


PLANTS: Mapping[str, Plant] = {
    "motor": Plant(
        ("voltage",), ("current", "speed"), ("current", "speed"), _motor,
        {"resistance": 1.0, "inductance": 0.02, "constant": 0.05, "inertia": 2e-4, "drag": 2e-4},
        0.005, 5, 2000, 40, (20, 200), (0.0,), (12.0,), (0.02, 0.3), (0.0, 0.0), (3.0, 100.0),
    ),
    "tanks": Plant(
        ("pump",), ("upper", "lower"), ("upper", "lower"), _tanks,
        {"area": 0.02, "flow": 3e-4, "upper_outlet": 1.2e-4, "lower_outlet": 1.5e-4},
        1.0, 4, 1200, 60, (15, 120), (0.6,), (0.35,), (1e-3, 1e-3), (0.1, 0.07), (0.1, 0.07), ("area",),
    ),
    "plate": Plant(
        ("heater", "ambient"), ("plate",), ("plate",), _plate, {"power": 40.0, "capacity": 60.0, "loss": 0.5},
        1.0, 2, 2400, 60, (40, 240), (0.5, 22.0), (0.5, 2.0), (0.1,), (22.0,), (20.0,), ("power",),
    ),
    "quadrotor": Plant(
        ("thrust",), ("height", "climb"), ("height", "climb"), _quadrotor, {"hover": 0.45, "drag": 0.3},
        0.02, 5, 2000, 50, (60, 250), (0.0,), (3.0,), (0.02, 0.05), (0.0, 0.0), (1.0, 1.0),
        ways={1: 0}, control=_fly,
    ),
    "car": Plant(
        ("throttle", "steer"), ("x", "y", "heading", "speed"), ("x", "y", "heading", "speed"), _car,
        {"push": 3.0, "drag": 0.25, "wheelbase": 2.6},
        0.05, 4, 1600, 40, (20, 120), (0.5, 0.0), (0.5, 0.2), (0.05, 0.05, 0.01, 0.05),
        (0.0, 0.0, 0.0, 4.0), (10.0, 10.0, 1.0, 5.0),
    ),
    "crane": Plant(
        ("force",), ("trolley", "speed", "angle", "rate"), ("trolley", "angle"), _crane,
        {"mass": 20.0, "load": 10.0, "cable": 2.0, "damping": 15.0},
        0.02, 5, 1800, 50, (80, 250), (0.0,), (1.0,), (1e-3, 2e-3), (0.0, 0.0, 0.0, 0.0),
        (0.5, 0.5, 0.2, 0.4), ways={1: 0, 3: 2}, control=_drive_crane,
    ),
    "cylinder": Plant(
        ("valve",), ("position", "speed", "pressure"), ("position", "pressure"), _cylinder,
        {"area": 1e-3, "mass": 8.0, "damping": 120.0, "spring": 2000.0, "rise": 40.0, "squeeze": 60.0},
        0.005, 6, 2000, 50, (20, 120), (0.0,), (0.7,), (2e-4, 0.02), (0.0, 0.0, 0.0), (0.1, 1.0, 2.0),
        ("area",), ways={1: 0},
    ),
    "valve": Plant(
        ("signal",), ("stem", "flow"), ("stem", "flow"), _valve, {"travel": 0.8, "largest": 4.0, "fill": 0.3},
        0.1, 4, 1500, 30, (20, 80), (0.55,), (0.4,), (2e-3, 0.01), (0.55, 0.866), (0.3, 1.0),
    ),
    "rig": Plant(
        ("force",), ("position", "velocity"), ("position", "velocity"), _rig,
        {"mass": 2.0, "damping": 4.0, "stiffness": 80.0},
        0.02, 8, 1500, 25, (10, 75), (0.0,), (8.0,), (2e-4, 5e-3), (0.0, 0.0), (0.05, 0.3), ways={1: 0},
    ),
    "pendulum": Plant(
        ("torque",), ("angle", "velocity"), ("angle", "velocity"), _pendulum,
        {"inertia": 0.0626, "gravity_moment": 1.0},
        0.02, 8, 1500, 20, (50, 150), (0.0,), (0.9,), (2e-3, 5e-2), (0.0, 0.0), (0.5, 2.0),
        ways={1: 0}, control=_swing,
    ),
    "servo": Plant(
        ("set_point",), ("position", "velocity"), ("position",), _servo,
        {"inertia": 1e-3, "damping": 0.075, "offset": 0.01},
        0.01, 8, 1500, 30, (20, 120), (0.0,), (0.4,), (5e-4,), (0.01, 0.0), (0.2, 2.0), ways={1: 0},
    ),
    "pose_reaching": Plant(
        ("speed", "turn_rate"), ("x", "y", "heading"), ("x", "y", "heading"), _robot,
        {"wheel_radius": 0.03, "track": 0.15},
        0.05, 4, 1200, 40, (10, 80), (0.2, 0.0), (0.3, 1.5), (3e-3, 3e-3, 0.01), (0.0, 0.0, 0.0),
        (1.0, 1.0, 1.0), ("wheel_radius", "track"),
    ),
}  # fmt: skip


def numbers_of(plant: Plant, rng: np.random.Generator, by: float = 1.0) -> Numbers:
    """Numbers of one such machine: up to a fifth off the usual ones, which are declared.

    Args:
        plant: The machine.
        rng: Source of chance.
        by: A factor on all that are not known.
    """
    off = np.exp(rng.uniform(-math.log(1.2), math.log(1.2), len(plant.numbers)))
    return Numbers(**{
        name: value if name in plant.known else value * factor * by
        for (name, value), factor in zip(plant.numbers.items(), off, strict=True)
    })  # fmt: skip
