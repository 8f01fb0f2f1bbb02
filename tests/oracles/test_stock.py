"""Every stock effect and curve against adaptive integration of its equation, on machines of all kinds."""

import itertools
import math
import random
from dataclasses import replace
from zlib import crc32

import numpy as np
import pytest

from exam.oracles.stock import Axis, Episode, Plant, Shape
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
    """Two axes and two commands that turn each other, an own effect, an inertia that is a method."""

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
        pull = input.push - p.drag * state.speed + 0.3 * state.rate * state.rate
        swing = input.turn - 0.4 * state.rate - 2.1 * math.sin(state.angle) - 0.2 * state.rate * state.speed
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


def _axis(state, given, p):
    return state[1], (given[0] - p["damping"] * state[1] - p["stiffness"] * state[0]) / p["mass"]


def _cart(state, given, p):
    speed, angle, rate = state
    mass = p["mass"] + p["cargo_mass"]
    turning = given[1] - 0.4 * rate - 2.1 * np.sin(angle) - 0.2 * rate * speed
    return (given[0] - p["drag"] * speed + 0.3 * rate**2) / mass, rate, turning / p["inertia"]


ONE = (Axis(1, 0, lambda p: p["mass"]),)
TWO = (Axis(0, None, lambda p: p["mass"] + p["cargo_mass"], 0), Axis(2, 1, lambda p: p["inertia"], 1))
NAMES = ("place", "speed")
PLANTS = {
    "everything": Plant(NAMES, ("push",), NAMES, _axis, ONE),
    "interpolated": Plant(NAMES, ("push",), NAMES, _axis, ONE, held=False),
    "stepped": Plant(NAMES, ("push",), NAMES, _axis, ONE),
    "cart": Plant(
        ("speed", "angle", "rate"), ("push", "turn"), ("speed", "angle", "sideways"), _cart, TWO,
        lambda state, _p: (state[0], state[1], state[0] * state[2]),
    ),
    "motor": Plant(
        ("speed",), ("voltage",), ("speed",),
        lambda state, given, p: [(p["gain"] * given[0] - state[0]) / p["time_constant"]], (Axis(0),),
    ),
}  # fmt: skip
MACHINES = {m.name: m for m in (Everything(), Interpolated(), Stepped(), Cart(), Motor())}
PLACES = {"actuator": actuators, "force": forces, "sensor": sensors, "change": changes}


STEP, COUNT, MIDDLE, RESTING = 0.01, 130, 57, 12
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


def values(place, f, x, v):
    """Values of every kind of a place, for typical sizes of force or command, position or output, rate."""
    return {
        "actuator": {
            "gain": [{"gain": g} for g in (0.613, 1.731)],
            "bias": [{"bias": k * f} for k in (-0.0171, 0.231)],
            "asymmetry": [{"difference": d} for d in (-0.713, 0.0217)],
            "play": [{"width": k * f} for k in (0.0171, 0.31)],
            "lag": [{"time_constant": t} for t in (0.00131, 0.0713)],
            "rate_limit": [{"rate": k * f} for k in (97.1, 5.31)],
            "delay": [{"delay": d} for d in (0.00137, 0.01, 0.0431)],
            "saturation": [{"limit": k * f} for k in (0.713, 0.431)],
            "dead_zone": [{"width": k * f} for k in (0.0043, 0.313)],
            "parameter_step": [{"time": 0.7371, "factor": 0.613}, {"time": 0.3, "factor": 1.731}],
        },
        "force": {
            "viscous_friction": [{"coefficient": k * f / v} for k in (0.0117, 0.231)],
            "coulomb_friction": [{"force": k * f} for k in (0.0137, 0.143)],
            "stribeck_friction": [
                {"force": 0.0171 * f, "velocity": 0.317 * v},
                {"force": 0.17 * f, "velocity": v},
            ],
            "load_friction": [{"share": k} for k in (0.0137, 0.171)],
            "hysteresis": [
                {"force": 0.0213 * f, "distance": 0.37 * x},
                {"force": 0.21 * f, "distance": 2.31 * x},
            ],
            "cogging": [
                {"sine": -0.0173 * f, "cosine": 0.0091 * f, "period": 0.713 * x},
                {"sine": 0.131 * f, "cosine": 0.217 * f, "period": 3.17 * x},
            ],
            "asymmetric_damping": [{"coefficient": k * f / v} for k in (-0.0117, 0.171)],
            "quadratic_drag": [{"coefficient": k * f / v**2} for k in (0.0117, 0.331)],
            "linear_stiffness": [{"coefficient": k * f / x} for k in (-0.0113, 0.31)],
            "cubic_stiffness": [{"coefficient": k * f / x**3} for k in (-0.0113, 0.31)],
            "elastic_stop": [
                {"stiffness": k * f / x, "place": p * x} for k, p in ((0.71, 0.11), (9.3, 0.21))
            ],
            "one_sided_spring": [
                {"stiffness": k * f / x, "place": p * x} for k, p in ((0.71, -0.1), (7.1, 0.13))
            ],
            "constant_force": [{"force": k * f} for k in (-0.0171, 0.231)],
            "periodic_force": [
                {"sine": -0.0113 * f, "cosine": 0.0071 * f, "frequency": 0.731},
                {"sine": 0.131 * f, "cosine": -0.0217 * f, "frequency": 5.37},
            ],
        },
        "sensor": {
            "bias": [{"bias": k * x} for k in (-0.0171, 0.31)],
            "drift": [{"rate": k * x} for k in (-0.0171, 0.37)],
            "gain": [{"gain": g} for g in (0.613, 1.731)],
            "bend": [{"curvature": k / x} for k in (-0.0131, 0.231)],
            "eccentricity": [
                {"sine": 0.0131 * x, "cosine": -0.0091 * x, "period": 1.31 * x},
                {"sine": -0.071 * x, "cosine": 0.131 * x, "period": 3.1 * x},
            ],
            "lag": [{"time_constant": t} for t in (0.00231, 0.0413)],
            "delay": [{"delay": d} for d in (0.00153, 0.01, 0.0371)],
            "backlash": [{"gap": k * x} for k in (0.0137, 0.83)],
            "clipping": [{"limit": k * x} for k in (0.071, 0.21)],
            "quantisation": [{"step": k * x} for k in (0.00371, 0.231)],
        },
        "change": {
            "step": [{"time": 0.7371, "change": -0.31 * f}, {"time": 0.4, "change": 0.0213 * f}],
            "drift": [{"rate": k * f} for k in (-0.071, 0.31)],
        },
    }[place]


DIRECTION = {"coulomb_friction", "stribeck_friction", "load_friction", "hysteresis"}
KINKED = {"elastic_stop", "one_sided_spring", "curve"}
"""Effects whose force jumps, or bends, at a place that steps do not know."""


def cases(machine, k=slice(None)):
    """(effect's name, its values) of every stock effect that a machine declares, curves apart."""
    sizes = SIZES[machine]
    for e in MACHINES[machine].stock:
        if isinstance(e, Curve):
            continue
        f, x, v = sizes["force"], sizes.get(e.signal, 1.0), sizes.get(e.signal, 1.0)
        if e.place == "actuator":
            f = sizes[e.signal]
        if e.place == "force":
            axis = next(a for a in MACHINES[machine].forces if a.velocity == e.signal)
            x = sizes.get(axis.position, 1.0)
        if e.place == "change":
            f = float(MACHINES[machine].nominal[MACHINES[machine].index(e.signal)])
        yield from ((e.name, chosen) for chosen in values(e.place, f, x, v)[e.kind][k])


def shape_of(machine, name):
    """A curve's shape with values by chance, over ranges that the machine leaves."""
    c = next(e for e in MACHINES[machine].stock if e.name == name)
    sizes, rng = SIZES[machine], np.random.default_rng(crc32(name.encode()))
    knots = []
    for words in c.over:
        reach = 0.6 * np.prod([sizes.get(word, 1.5) for word in words.split("*")])
        knots.append(
            np.linspace(0.1, 0.9, c.knots) if words == "time" else np.linspace(-reach, 1.1 * reach, c.knots)
        )
    nominal = dict(zip(MACHINES[machine].names, MACHINES[machine].nominal, strict=True))
    size = {
        "actuator": 0.2 * sizes.get(c.signal, 1.0),
        "force": 0.15 * sizes["force"],
        "sensor": 0.04 * sizes.get(c.signal, 1.0),
        "parameter": 0.3 * nominal.get(c.signal, 1.0),
    }[c.where]
    grid = size * rng.uniform(-1.0, 1.0, size=[c.knots] * len(c.over))
    return Shape(c.where, c.signal, c.over, tuple(knots), grid)


def curve_values(shape):
    tags = [""] if len(shape.over) == 1 else [f"_{k + 1}" for k in range(len(shape.over))]
    ends = {
        f"{end}{tag}": k[i]
        for tag, k in zip(tags, shape.knots, strict=True)
        for i, end in ((0, "low"), (-1, "high"))
    }
    return ends | {f"value_{i + 1}": value for i, value in enumerate(shape.values.ravel())}


class Both:
    """A machine and its oracle with some stock effects on."""

    def __init__(self, machine, effects, shapes=(), own=None):
        self.machine, self.model, self.plant = machine, MACHINES[machine], PLANTS[machine]
        self.effects, self.shapes, self.own = dict(effects), [shape_of(machine, s) for s in shapes], own or {}
        named = {e.name: e for e in self.model.stock}
        self.faults = {(named[n].place, named[n].signal, named[n].kind): v for n, v in self.effects.items()}
        self.base = {p.name: p.nominal * (1.0 + 0.04 * (k + 1)) for k, p in enumerate(self.model.parameters)}
        numbers = {}
        for name, chosen in self.effects.items():
            numbers[name] = dict(
                zip(
                    [p.name for p in self.model.effect(name).parameters],
                    self._ordered(named[name], chosen),
                    strict=True,
                )
            )
        for name, shape in zip(shapes, self.shapes, strict=True):
            numbers[name] = curve_values(shape)
        self.vector = self.model.vector(self.base, numbers | self.own)

    @staticmethod
    def _ordered(e, chosen):
        row = PLACES[e.place].ROW
        return [chosen[row.names[slot].removeprefix(f"{e.kind}_")] for slot in row.slots(e.kind)]

    @property
    def numbers(self):
        """Base parameters and own effects', as the oracle's plant takes them."""
        own = {f"{e}_{p}": v for e, values in self.own.items() for p, v in values.items()}
        return self.base | ({"cargo_mass": 0.0} if self.machine == "cart" else {}) | own

    def oracle(self, commands, start=None):
        episode = Episode(self.plant, self.numbers, self.faults, self.shapes, commands, STEP)
        return episode.run(np.zeros(len(self.plant.states)) if start is None else start)

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


def commands_for(machine, rng):
    """Random steps, each held for 3 to 20 samples, from rest; shape (n, inputs)."""
    columns = []
    for signal in MACHINES[machine].inputs:
        level = (
            SIZES[machine][signal.name]
            * rng.uniform(-1.0, 1.0, size=COUNT)
            * (rng.uniform(size=COUNT) > 0.15)
        )
        level[0] = 0.0
        counts = rng.integers(3, 21, size=COUNT)
        counts[0] = RESTING
        columns.append(np.repeat(level, counts)[:COUNT])
    return np.column_stack(columns)


@pytest.fixture
def agree_with_the_oracle(rng, agree):
    def check(machine, effects, shapes=(), own=None, tolerance=1e-3, refine=None, begins=(0, MIDDLE)):
        commands = commands_for(machine, rng)
        both, none = Both(machine, effects, shapes, own), Both(machine, {})
        on, off = both.oracle(commands), none.oracle(commands)
        kinds = {e.kind for e in MACHINES[machine].stock if e.name in {*both.effects, *shapes}}
        slow = any(
            n.endswith("sensor_lag") for n in both.effects
        )  # a filter takes a step's motion for a line
        refine = refine or (8 if slow or kinds & (DIRECTION | KINKED) else 1)
        kept = {n: v for n, v in effects.items() if not n.endswith(("quantisation", "clipping"))}
        seen = Both(machine, kept, shapes, own).oracle(commands) if kept != effects else on
        for begin in begins:
            state = states_shown(both, commands, seen, begin)
            got = both.simulated(commands, on, state, begin, refine)
            agree(got, on[begin:], off[begin:], tolerance, absolute=3e-6 * np.abs(on).max(axis=0))

    return check


def states_shown(both, commands, shown, begin):
    """State at a sample as the sensors show it; what they do not, as it is."""
    outputs = [s.name for s in both.model.outputs]
    states = both.plant.states
    true = np.zeros(len(states))
    if begin and not set(states) <= set(outputs):
        plant = replace(both.plant, outputs=states, shown=None)
        faults = {key: v for key, v in both.faults.items() if key[0] != "sensor"}
        true = Episode(plant, both.numbers, faults, both.shapes, commands, STEP).run(true)[begin]
    return [shown[begin, outputs.index(n)] if n in outputs else true[k] for k, n in enumerate(states)]


# What was listed last comes last: a case's commands follow from its number.
LAST = ("asymmetric_damping", "linear_stiffness")
ALL = sorted(
    ((m, name, v) for m in MACHINES for name, v in cases(m)),
    key=lambda case: max((k + 1 for k, kind in enumerate(LAST) if kind in case[1]), default=0),
)
IDS = [f"{m}-{name}-{k}" for k, (m, name, _) in enumerate(ALL)]


LIMITS = {
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


@pytest.mark.matrix(
    keep=(
        "everything-stiffness_drift-90",
        "interpolated-actuator_bias-97",
        "stepped-actuator_gain-123",
        "cart-sensor_delay-283",
        "motor-sensor_gain-329",
        "interpolated-linear_stiffness-349",
    )
)
@pytest.mark.parametrize("case", ALL, ids=IDS)
def test_a_stock_effect_from_rest_and_from_what_the_sensors_show(case, agree_with_the_oracle):
    machine, name, chosen = case
    slow = "sensor" in name and name.endswith("lag")
    how = {"begins": (0,) if slow else (0, MIDDLE)} | LIMITS.get((machine, name), {})
    agree_with_the_oracle(machine, {name: chosen}, **how)


CURVES = [(m, e.name) for m in MACHINES for e in MACHINES[m].stock if isinstance(e, Curve)]


@pytest.mark.parametrize("case", CURVES, ids="-".join)
def test_a_curve_or_table(case, agree_with_the_oracle):
    machine, name = case
    agree_with_the_oracle(machine, {}, (name,))


def test_every_kind_and_every_place_of_a_curve_has_a_case():
    """A stock kind that nobody tries against an oracle has no business in a library."""
    for place, module in PLACES.items():
        tried = {e.kind for m in MACHINES.values() for e in m.stock if e.place == place}
        assert tried == set(module.LIBRARY)
        for kind, chosen in values(place, 1.0, 1.0, 1.0).items():
            names = {module.ROW.names[k].removeprefix(f"{kind}_") for k in module.ROW.slots(kind)}
            assert len(chosen) >= 2
            assert all(set(one) == names for one in chosen), f"{place} {kind}: {names}"
    assert {MACHINES[m].stock[0].place for m in MACHINES} == {"actuator"}
    assert {e.where for m in MACHINES.values() for e in m.stock if isinstance(e, Curve)} == set(WHERE)


LAST = {m: dict(cases(m)) for m in MACHINES}
ACTUATOR = [f"actuator_{kind}" for kind in actuators.LIBRARY]
SENSOR = [f"sensor_{kind}" for kind in sensors.LIBRARY if kind not in ("lag", "delay")]
HOLDING = [
    ("coulomb_friction", e) for e in ("load_friction", "periodic_force", "actuator_lag", "stribeck_friction")
]
PAIRS = [
    *(
        ("everything", *pair)
        for pair in [*itertools.combinations(ACTUATOR, 2), *itertools.combinations(SENSOR, 2)]
    ),
    *(("everything", *pair) for pair in HOLDING),
    *(("everything", "sensor_delay", e) for e in ("sensor_lag", "sensor_backlash", "actuator_delay")),
    *(("everything", "push_curve", e) for e in ACTUATOR),
    *(("everything", "place_curve", e) for e in SENSOR),
    *(("interpolated", "actuator_rate_limit", e) for e in ACTUATOR if e != "actuator_rate_limit"),
    *(
        ("cart", f"drive_{a}", f"steering_{b}")
        for a, b in itertools.product(("coulomb_friction", "load_friction"), repeat=2)
    ),
    *(("cart", *pair) for pair in random.Random(3).sample([*itertools.combinations(LAST["cart"], 2)], 12)),
]


@pytest.mark.matrix(
    keep=(
        "everything-actuator_play-actuator_delay",
        "interpolated-actuator_rate_limit-actuator_delay",
        "cart-turn_bias-steering_stribeck_friction",
    )
)
@pytest.mark.parametrize("pair", PAIRS, ids="-".join)
def test_pairs_act_in_the_documented_order(pair, agree_with_the_oracle):
    machine, *names = pair
    effects = {name: LAST[machine][name] for name in names if name in LAST[machine]}
    shapes = [name for name in names if name not in effects]
    from_rest = any("begins" in LIMITS.get((machine, name), {}) for name in names)
    begins = (0,) if "sensor_lag" in names or from_rest else (0, MIDDLE)
    agree_with_the_oracle(machine, effects, shapes, tolerance=2e-3, begins=begins)


@pytest.mark.parametrize(
    "effects", [{}, {"drive_coulomb_friction": {"force": 0.9}}], ids=["alone", "with friction"]
)
def test_an_own_effect_and_an_inertia_that_is_a_method(effects, agree_with_the_oracle):
    agree_with_the_oracle("cart", effects, own={"cargo": {"mass": 0.71}})
