"""Every stock effect and curve against the exam's plant of an axis, on machines of all kinds."""

import math
from functools import cache
from zlib import crc32

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator
from scipy.signal import lfilter

from exam.plants import axis_listed
from exam.plants.axis import Axis, simulate
from fieldmodels.effects import actuator, actuators, change, changes, curve, force, forces, sensor, sensors
from fieldmodels.effects.curves import WHERE, Curve
from fieldmodels.effects.forces import PLACED
from fieldmodels.machine import Force, Machine, number
from fieldmodels.model import Effect, Parameter, Signal
from fieldmodels.recording import Recording, Windows


class Everything(Machine):
    """An axis on a soft spring with all stock effects, and curves at all four places."""

    inputs = (Signal("push", "N"),)
    states = outputs = (Signal("place", "m"), Signal("speed", "m/s"))
    mass = number("kg", 1.3, 0.1, 10.0)
    damping = number("N s/m", 1.1, 0.0, 10.0)
    stiffness = number("N/m", 9.0, 0.0, 100.0)
    forces = (Force("speed", "place", "N", "mass", name="force"),)
    effects = (
        *actuator("push"),
        *force("speed"),
        *sensor("place", tuple(sensors.LIBRARY)),
        *sensor("speed", tuple(sensors.LIBRARY), prefix="speed_sensor_"),
        *change("stiffness"),
        *change("damping"),
        *curve("actuator", "push"),
        *curve("force", "speed"),
        *curve("force", "speed", over="place"),
        *curve("force", "speed", over="push"),
        *curve("force", "speed", over="time"),
        *curve("force", "speed", over="speed*push"),
        *curve("force", "speed", over=("place", "speed")),
        *curve("sensor", "place"),
        *curve("sensor", "speed", over="place", name="speed_sensor_over_place"),
        *curve("sensor", "speed", over="time", name="speed_sensor_over_time"),
        *curve("parameter", "damping", over="time"),
        *curve("parameter", "damping", over="speed"),
    )

    def derivative(self, state, input, p):
        return state.speed, (input.push - p.damping * state.speed - p.stiffness * state.place) / p.mass


class Interpolated(Everything):
    """The same, its command going along lines from sample to sample."""

    hold = "interpolated"
    effects = (
        *actuator("push"),
        *force("speed", ("coulomb_friction", "load_friction", "periodic_force")),
        *force("speed", ("asymmetric_damping", "linear_stiffness")),
    )


class Stepped(Everything):
    """The same axis, declared by what it does in a step: exactly, for a held command."""

    effects = (*actuator("push"), *force("speed"), *sensor("place"), *change("damping"))
    substeps = 4

    def step(self, state, input, p, dt):
        rest = input.push / p.stiffness
        decay = 0.5 * p.damping / p.mass
        swing = math.sqrt(p.stiffness / p.mass - decay * decay)
        a = state.place - rest
        b = (state.speed + decay * a) / swing
        c, s, e = math.cos(swing * dt), math.sin(swing * dt), math.exp(-decay * dt)
        place = e * (a * c + b * s)
        speed = e * ((b * swing - decay * a) * c - (a * swing + decay * b) * s)
        return rest + place, speed

    derivative = None


class Cart(Machine):
    """Two axes with a command each, an own effect, an inertia that is a method."""

    inputs = (Signal("push", "N"), Signal("turn", "N m"))
    states = (Signal("speed", "m/s"), Signal("angle", "rad"), Signal("rate", "rad/s"))
    outputs = (Signal("speed", "m/s"), Signal("angle", "rad"), Signal("sideways", "m/s^2"))
    mass = number("kg", 2.1, 0.1, 10.0)
    drag = number("N s/m", 1.7, 0.0, 10.0)
    inertia = number("kg m^2", 0.31, 0.01, 10.0)
    forces = (
        Force("speed", unit="N", inertia="moved"),
        Force("rate", "angle", "N m", "inertia", input="turn"),
    )
    effects = (
        *actuator("push"),
        *actuator("turn", prefix="turn_"),
        *force("speed", without=PLACED, prefix="drive_"),
        *force("rate", prefix="steering_"),
        *sensor("sideways"),
        Effect("cargo", "Cargo is on it.", "force", (Parameter("mass", "kg", 0.0, 0.0, 9.0, 0.1),)),
    )

    def moved(self, p):
        return p.mass + p.cargo_mass

    def derivative(self, state, input, p):
        pull = input.push - p.drag * state.speed
        swing = input.turn - 0.4 * state.rate - 2.1 * math.sin(state.angle)
        return pull / (p.mass + p.cargo_mass), state.rate, swing / p.inertia

    def observe(self, state, p):
        return state.speed, state.angle, state.speed * state.rate


class Motor(Machine):
    """A single state, on which forces act without a position."""

    inputs = (Signal("voltage", "V"),)
    states = outputs = (Signal("speed", "rad/s"),)
    gain = number("rad/s/V", 10.0, 0.0, 1e3)
    time_constant = number("s", 0.1, 0.01, 10.0)
    effects = (
        *actuator("voltage"),
        *force("speed", without=PLACED),
        *sensor("speed"),
        *change("gain"),
        *curve("force", "speed"),
        *curve("parameter", "gain", over="speed"),
    )

    def derivative(self, state, input, p):
        return (p.gain * input.voltage - state.speed) / p.time_constant


MACHINES = {m.name: m for m in (Everything(), Interpolated(), Stepped(), Cart(), Motor())}
PLACES = {"actuator": actuators, "force": forces, "sensor": sensors, "change": changes}
STEP, COUNT, MIDDLE, RESTING = 0.01, 130, 57, 12
PARTS = 4
"""Of a sample, between which a plant is looked at."""
SIZES = {
    "everything": {"push": 8.0, "place": 0.5, "speed": 2.0, "force": 8.0},
    "motor": {"voltage": 6.0, "speed": 30.0, "force": 300.0},
    "cart": {
        "push": 9.0,
        "turn": 4.0,
        "speed": 2.0,
        "angle": 0.8,
        "rate": 3.0,
        "sideways": 4.0,
        "force": 5.0,
    },
}
SIZES |= {"interpolated": SIZES["everything"], "stepped": SIZES["everything"]}
JUMP = 0.7375
"""When something jumps, which a plant knows at a part of a sample [s]."""


def values(place, f, x, v):
    """Values of every kind of a place, for typical sizes of force or command, position or output, rate."""
    return {
        "actuator": {
            "gain": {"gain": 1.731},
            "bias": {"bias": 0.231 * f},
            "asymmetry": {"difference": -0.713},
            "play": {"width": 0.31 * f},
            "lag": {"time_constant": 0.0713},
            "rate_limit": {"rate": 5.31 * f},
            "delay": {"delay": 0.0431},
            "saturation": {"limit": 0.431 * f},
            "dead_zone": {"width": 0.313 * f},
            "parameter_step": {"time": JUMP, "factor": 1.731},
        },
        "force": {
            "viscous_friction": {"coefficient": 0.231 * f / v},
            "coulomb_friction": {"force": 0.143 * f},
            "stribeck_friction": {"force": 0.17 * f, "velocity": v},
            "load_friction": {"share": 0.171},
            "hysteresis": {"force": 0.21 * f, "distance": 2.31 * x},
            "cogging": {"sine": 0.131 * f, "cosine": 0.217 * f, "period": 3.17 * x},
            "asymmetric_damping": {"coefficient": 0.171 * f / v},
            "quadratic_drag": {"coefficient": 0.331 * f / v**2},
            "linear_stiffness": {"coefficient": 0.31 * f / x},
            "cubic_stiffness": {"coefficient": 0.31 * f / x**3},
            "elastic_stop": {"stiffness": 9.3 * f / x, "place": 0.21 * x},
            "one_sided_spring": {"stiffness": 7.1 * f / x, "place": -0.1 * x},
            "constant_force": {"force": 0.231 * f},
            "periodic_force": {"sine": 0.131 * f, "cosine": -0.0217 * f, "frequency": 5.37},
        },
        "sensor": {
            "bias": {"bias": 0.31 * x},
            "drift": {"rate": 0.37 * x},
            "gain": {"gain": 1.731},
            "bend": {"curvature": 0.231 / x},
            "eccentricity": {"sine": -0.071 * x, "cosine": 0.131 * x, "period": 3.1 * x},
            "lag": {"time_constant": 0.0413},
            "delay": {"delay": 0.0371},
            "backlash": {"gap": 0.83 * x},
            "clipping": {"limit": 0.1 * x},
            "quantisation": {"step": 0.231 * x},
        },
        "change": {"step": {"time": JUMP, "change": -0.31 * f}, "drift": {"rate": 0.31 * f}},
    }[place]


DRY = {"coulomb_friction", "stribeck_friction", "load_friction"}
BENT = {*DRY, "hysteresis", "rate_limit", "elastic_stop", "one_sided_spring", "curve", "lag"}
"""Kinds that jump or bend at a place that steps do not know, or take a step's motion for a line."""


def values_of(machine, e):
    """Values of a stock effect that a machine declares."""
    sizes = SIZES[machine]
    f, x = sizes["force"], sizes.get(e.signal, 1.0)
    if e.place == "actuator":
        f = sizes[e.signal]
    if e.place == "force":
        x = sizes.get(next(a.position for a in MACHINES[machine].forces if a.velocity == e.signal), 1.0)
    if e.place == "change":
        f = float(MACHINES[machine].nominal[MACHINES[machine].index(e.signal)])
    return values(e.place, f, x, sizes.get(e.signal, 1.0))[e.kind]


class Shape:
    """A curve or table with values by chance, over ranges that its machine leaves."""

    def __init__(self, machine, c):
        sizes, rng = SIZES[machine], np.random.default_rng(crc32(c.name.encode()))
        self.where, self.signal, self.over, self.knots = c.where, c.signal, c.over, []
        for words in c.over:
            reach = 0.6 * np.prod([sizes.get(word, 1.5) for word in words.split("*")])
            ends = (0.1, 0.9) if words == "time" else (-reach, 1.1 * reach)
            self.knots.append(np.linspace(*ends, c.knots))
        nominal = dict(zip(MACHINES[machine].names, MACHINES[machine].nominal, strict=True))
        size = {
            "actuator": 0.2 * sizes.get(c.signal, 1.0),
            "force": 0.15 * sizes["force"],
            "sensor": 0.04 * sizes.get(c.signal, 1.0),
            "parameter": 0.3 * nominal.get(c.signal, 1.0),
        }[c.where]
        self.grid = size * rng.uniform(-1.0, 1.0, size=[c.knots] * len(c.over))

    def at(self, known):
        """Its value for the values of all signals."""
        point = [math.prod(known[name.strip()] for name in words.split("*")) for words in self.over]
        if len(point) == 1:
            return np.interp(point[0], self.knots[0], self.grid)
        inside = [min(max(x, k[0]), k[-1]) for x, k in zip(point, self.knots, strict=True)]
        return RegularGridInterpolator(self.knots, self.grid)(inside)[0]

    @property
    def numbers(self):
        """As a model takes them."""
        tags = [""] if len(self.over) == 1 else [f"_{k + 1}" for k in range(len(self.over))]
        pairs = zip(tags, self.knots, strict=True)
        ends = {f"{end}{tag}": k[i] for tag, k in pairs for i, end in ((0, "low"), (-1, "high"))}
        return ends | {f"value_{i + 1}": value for i, value in enumerate(self.grid.ravel())}


def _later(change, t):
    """By how much a parameter differs at a time."""
    step, drift = change.get("step", {"time": 0.0, "change": 0.0}), change.get("drift", {"rate": 0.0})
    return step["change"] * (t >= step["time"] - 1e-9) + drift["rate"] * t


MORE = {
    "load_friction": lambda a, r: a.dry.append(lambda _t, _x, _v, f: r["share"] * abs(f)),
    "linear_stiffness": lambda a, r: a.forces.append(lambda _t, x, _v, _f: -r["coefficient"] * x),
    "elastic_stop": lambda a, r: a.forces.append(
        lambda _t, x, _v, _f: -r["stiffness"] * math.copysign(max(abs(x) - r["place"], 0.0), x)
    ),
    "one_sided_spring": lambda a, r: a.forces.append(
        lambda _t, x, _v, _f: -r["stiffness"] * max(x - r["place"], 0.0)
    ),
}
"""Forces of the library that no bench of the exam lists."""


class Both:
    """A machine and its plants with some stock effects, curves and own effects on."""

    def __init__(self, machine, names, own=None):
        self.machine, self.model = machine, MACHINES[machine]
        self.base = {p.name: p.nominal * (1.0 + 0.04 * (k + 1)) for k, p in enumerate(self.model.parameters)}
        self.cargo = (own or {}).get("cargo", {"mass": 0.0})["mass"]
        self.stock = [e for e in self.model.stock if e.name in names]
        self.kinds = {"curve" if isinstance(e, Curve) else e.kind for e in self.stock}
        self.shapes = [Shape(machine, e) for e in self.stock if isinstance(e, Curve)]
        self.faults, numbers, shapes = {}, dict(own or {}), iter(self.shapes)
        for e in self.stock:
            if isinstance(e, Curve):
                numbers[e.name] = next(shapes).numbers
                continue
            chosen = values_of(machine, e)
            self.faults.setdefault((e.place, e.signal), {})[e.kind] = chosen
            row = PLACES[e.place].ROW
            slots = [row.names[slot].removeprefix(f"{e.kind}_") for slot in row.slots(e.kind)]
            given = [p.name for p in self.model.effect(e.name).parameters]
            numbers[e.name] = dict(zip(given, [chosen[name] for name in slots], strict=True))
        self.vector = self.model.vector(self.base, numbers)

    def axes(self):
        """Plants of its axes, each with its input, its position and velocity, and what scales forces."""
        p = self.base
        if self.machine == "cart":
            speed = Axis(p["mass"] + self.cargo, p["drag"])
            return [
                (speed, "push", "", "speed", 1.0),
                (Axis(p["inertia"], 0.4, gravity=2.1), "turn", "angle", "rate", 1.0),
            ]
        if self.machine == "motor":  # (T/g) dv/dt = u - v/g + (T/g) forces
            share = p["time_constant"] / p["gain"]
            return [(Axis(share, 1.0 / p["gain"]), "voltage", "", "speed", share)]
        return [(Axis(p["mass"], p["damping"], p["stiffness"]), "push", "place", "speed", 1.0)]

    def aims(self, name, commands):
        """What acts of a command, at every part of a sample."""
        r, aims, engaged = self.faults.get(("actuator", name), {}), [], math.nan
        bend = [s for s in self.shapes if (s.where, s.signal) == ("actuator", name)]
        for command in commands.tolist():
            u = r.get("gain", {"gain": 1.0})["gain"] * command + r.get("bias", {"bias": 0.0})["bias"]
            u += sum(float(s.at({name: u})) for s in bend)
            for kind in ("asymmetry", "play", "dead_zone", "saturation"):
                if kind == "play" and kind in r:
                    half = 0.5 * r["play"]["width"]
                    engaged = u if math.isnan(engaged) else min(max(engaged, u - half), u + half)
                    u = engaged
                elif kind in r:
                    u = axis_listed.MAPS[f"actuator_{kind}"](r[kind])(u, 0.0)
            aims.append(u)
        parts = np.arange(len(aims) * PARTS)
        middles = np.interp((parts + 0.5) / PARTS, np.arange(len(aims)), aims)
        fine = middles if self.model.hold == "interpolated" else np.repeat(aims, PARTS)
        jump = r.get("parameter_step", {"time": 0.0, "factor": 1.0})
        return fine * np.where(parts * STEP / PARTS >= jump["time"] - 1e-9, jump["factor"], 1.0)

    def driven(self, axis, name, position, velocity, scale, commands):
        """Position, velocity and force of an axis at every part of a sample."""
        rows, actuators_ = [], self.faults.get(("actuator", name), {})
        for kind in ("lag", "rate_limit", "delay"):
            if kind in actuators_:
                axis_listed.SIMPLE[f"actuator_{kind}"](axis, actuators_[kind])
        own = Axis(1.0)
        for kind, chosen in self.faults.get(("force", velocity), {}).items():
            (MORE.get(kind) or axis_listed.FORCES[kind])(own, chosen)
        axis.damping += scale * own.damping
        axis.forces += [lambda t, x, v, f, g=g: scale * g(t, x, v, f) for g in own.forces]
        axis.dry += [lambda t, x, v, f, g=g: scale * g(t, x, v, f) for g in own.dry]
        for bristle in own.bristles:
            bristle.limit *= scale
        axis.bristles += own.bristles
        for parameter, factor in {
            "stiffness": lambda x, _v, _f: -x,
            "damping": lambda _x, v, _f: -v,
            "gain": lambda _x, _v, f: f / self.base["gain"],
        }.items():
            changed = self.faults.get(("change", parameter), {})
            bends = [s for s in self.shapes if (s.where, s.signal) == ("parameter", parameter)]
            if changed or bends:
                axis.forces.append(
                    lambda t, x, v, f, factor=factor, changed=changed, bends=bends: (
                        factor(x, v, f)
                        * (_later(changed, t) + sum(s.at({"time": t, "speed": v}) for s in bends))
                    )
                )
        for s in self.shapes:
            if (s.where, s.signal) == ("force", velocity):
                known = position or "place"
                axis.forces.append(
                    lambda t, x, v, f, s=s, known=known: (
                        scale * float(s.at({known: x, velocity: v, name: f, "time": t}))
                    )
                )
        axis.finer = 16 if axis.dry else 1
        axis.position.append(lambda y, _t, x, v, f: (rows.append((x, v, f)), y)[1])
        aims = self.aims(name, commands).tolist()
        simulate(axis, lambda i, _x, _v: aims[i], np.zeros((len(aims), 2)), STEP / PARTS)
        return np.array(rows)

    def plant(self, commands):
        """What the sensors show at the samples, and all states there."""
        signals, column = {}, {s.name: k for k, s in enumerate(self.model.inputs)}
        for axis, name, position, velocity, scale in self.axes():
            rows = self.driven(axis, name, position, velocity, scale, commands[:, column[name]])
            signals |= {position: rows[:, 0], velocity: rows[:, 1], name: rows[:, 2]}
        if self.machine == "cart":
            signals["sideways"] = signals["speed"] * signals["rate"]
        shown = [self.sensed(s.name, signals, commands)[::PARTS] for s in self.model.outputs]
        return np.column_stack(shown), np.column_stack([signals[s.name][::PARTS] for s in self.model.states])

    def sensed(self, name, signals, commands):
        """What a sensor makes of a true signal."""
        r, h = self.faults.get(("sensor", name), {}), STEP / PARTS
        time, y = h * np.arange(len(signals[name])), signals[name].copy()
        known = signals | {"time": time}
        for s in self.shapes:
            if (s.where, s.signal) == ("sensor", name):
                y += s.at(known)

        def of(kind, key, neutral=0.0):
            return r.get(kind, {}).get(key, neutral)

        if lag := of("lag", "time_constant"):
            fade = math.exp(-h / lag)
            late = lag / h * (1.0 - fade)
            driven = (1.0 - fade) * y[:-1] + (1.0 - late) * np.diff(y)
            y = np.append(y[0], lfilter([1.0], [1.0, -fade], driven, zi=fade * y[:1])[0])
        force = signals[self.model.inputs[0].name]
        if delay := of("delay", "delay"):
            y = np.interp(time - delay, time, y)
            force = force[np.maximum(np.floor((time - delay) / h + 1e-9), 0).astype(int)]
        phase = 2.0 * np.pi * y / of("eccentricity", "period", 1.0)
        value = of("gain", "gain", 1.0) * y + of("bend", "curvature") * y * np.abs(y)
        value += of("eccentricity", "sine") * np.sin(phase) + of("eccentricity", "cosine") * np.cos(phase)
        value += of("bias", "bias") + of("drift", "rate") * time
        value += 0.5 * of("backlash", "gap") * np.tanh(force / (0.02 * np.abs(commands[:, 0]).max()))
        value = np.clip(value, -of("clipping", "limit", math.inf), of("clipping", "limit", math.inf))
        quantum = of("quantisation", "step")
        return quantum * np.floor(value / quantum + 0.5) if quantum else value

    def simulated(self, commands, shown, state, begin=0, refine=1):
        """Outputs of the model from a sample on, on a grid of time ``refine`` times finer."""
        count = len(commands) * refine
        fine = np.arange(count) / refine
        held = self.model.between(commands, refine)
        signals = {s.name: held[:, i] for i, s in enumerate(self.model.inputs)}
        signals |= {
            s.name: np.interp(fine, np.arange(len(shown)), shown[:, o])
            for o, s in enumerate(self.model.outputs)
        }
        windows = Windows(
            recording=Recording(time=np.arange(count) * STEP / refine, signals=signals),
            starts=np.array([begin * refine]),
            lengths=np.array([count - begin * refine]),
            states=np.array([state], dtype=float),
            observed=np.ones((1, count - begin * refine, shown.shape[1]), dtype=np.bool_),
        )
        return self.model.simulate(self.vector, windows)[0, 0][::refine]


@cache
def without(machine):
    """Commands, random steps from rest that are held for 3 to 20 samples, and what is shown of them."""
    columns, rng = [], np.random.default_rng(crc32(machine.encode()))
    for signal in MACHINES[machine].inputs:
        size = SIZES[machine][signal.name]
        level = size * rng.uniform(-1.0, 1.0, size=COUNT) * (rng.uniform(size=COUNT) > 0.15)
        level[0] = 0.0
        counts = rng.integers(3, 21, size=COUNT)
        counts[0] = RESTING
        columns.append(np.repeat(level, counts)[:COUNT])
    commands = np.column_stack(columns)
    return commands, Both(machine, ()).plant(commands)[0]


@pytest.fixture
def agree_with_the_plant(agree):
    def check(machine, names, own=None, tolerance=2e-3, begins=(0, MIDDLE)):
        commands, off = without(machine)
        both = Both(machine, names, own)
        on, true = both.plant(commands)
        # A rounded or cut-off position is no state to start from; what is not shown starts as it is.
        kept = [n for n in names if not n.endswith(("quantisation", "clipping"))]
        seen = Both(machine, kept, own).plant(commands)[0] if kept != list(names) else on
        outputs = [s.name for s in both.model.outputs]
        for begin in begins:
            state = [
                seen[begin, outputs.index(s.name)] if s.name in outputs else true[begin, k]
                for k, s in enumerate(both.model.states)
            ]
            got = both.simulated(commands, on, state, begin, 8 if both.kinds & BENT else 1)
            agree(got, on[begin:], off[begin:], tolerance, absolute=5e-6 * np.abs(on).max(axis=0))

    return check


LIMITS = {
    ("interpolated", "actuator_rate_limit"): {"tolerance": 1e-2},
    ("interpolated", "actuator_parameter_step"): {"tolerance": 2e-2},  # the jump is spread over a sample
    ("interpolated", "coulomb_friction"): {
        "tolerance": 2e-2
    },  # breaking away is noticed at a step's beginning
    ("interpolated", "load_friction"): {"tolerance": 5e-2},
    ("stepped", "actuator_lag"): {"tolerance": 0.1},  # a step of its own takes the input in its middle
    ("stepped", "sensor_delay"): {"begins": (0,)},  # no derivative, by which the start could be guessed
    ("cart", "sensor_delay"): {"begins": (0,)},  # a state that nothing shows stays where it was given
}
"""What holds less well than the rest, and why."""


@pytest.mark.every(("machine", "name"), [(m, e.name) for m in MACHINES for e in MACHINES[m].stock])
def test_a_stock_effect_from_rest_and_from_what_the_sensors_show(machine, name, agree_with_the_plant):
    slow = "sensor" in name and name.endswith("lag")
    how = {"begins": (0,) if slow else (0, MIDDLE)} | LIMITS.get((machine, name), {})
    agree_with_the_plant(machine, [name], **how)


def test_every_kind_and_every_place_of_a_curve_has_a_case():
    """A stock kind that nobody compares with a plant has no business in a library."""
    for place, module in PLACES.items():
        tried = {e.kind for m in MACHINES.values() for e in m.stock if e.place == place}
        assert tried == set(module.LIBRARY) == set(values(place, 1.0, 1.0, 1.0))
    assert {e.where for m in MACHINES.values() for e in m.stock if isinstance(e, Curve)} == set(WHERE)


TOGETHER = [
    ("everything", [f"actuator_{kind}" for kind in actuators.LIBRARY]),
    ("everything", [f"sensor_{kind}" for kind in sensors.LIBRARY if kind not in ("lag", "delay")]),
    (
        "everything",
        ["coulomb_friction", "stribeck_friction", "load_friction", "periodic_force", "actuator_lag"],
    ),
    ("everything", ["sensor_delay", "sensor_backlash", "actuator_delay"]),
    ("everything", ["push_curve", "place_curve", "actuator_play", "sensor_gain"]),
    ("interpolated", ["actuator_rate_limit", "actuator_lag", "actuator_delay", "actuator_gain"]),
    ("cart", ["drive_coulomb_friction", "steering_coulomb_friction", "steering_load_friction", "turn_bias"]),
]


@pytest.mark.every(("machine", "names"), TOGETHER)
def test_several_effects_act_in_the_documented_order(machine, names, agree_with_the_plant):
    agree_with_the_plant(machine, names, tolerance=4e-3)


def test_an_own_effect_and_an_inertia_that_is_a_method(agree_with_the_plant):
    for names in ([], ["drive_coulomb_friction"]):
        agree_with_the_plant("cart", names, own={"cargo": {"mass": 0.71}})
