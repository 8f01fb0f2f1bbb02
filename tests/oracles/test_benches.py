"""The benches against adaptive integration of what docs/models.md says."""

import itertools
import random

import numpy as np
import pytest

from exam.oracles import find_oracle, one_axis
from exam.oracles.piecewise import current
from fieldmodels.recording import Recording, Windows
from fieldmodels.registry import get_model
from fieldmodels.synthesis import synthesise

STEP, COUNT, MIDDLE = 0.01, 110, 43


def library(force, f, x, v):
    """Values of the effects that all benches have, for typical sizes of force, position and velocity."""
    return {
        "coulomb_friction": [{force: 0.0137 * f}, {force: 0.117 * f}, {force: 0.43 * f}],
        "stribeck_friction": [
            {force: 0.0171 * f, "velocity": 0.317 * v},
            {force: 0.37 * f, "velocity": 1.31 * v},
            {force: 0.213 * f, "velocity": 0.171 * v},
        ],
        "hysteresis": [
            {force: 0.0213 * f, "distance": 0.37 * x},
            {force: 0.41 * f, "distance": 2.31 * x},
            {force: 0.173 * f, "distance": 0.131 * x},
        ],
        "cogging": [
            {"sine": -0.0173 * f, "cosine": 0.0091 * f, "period": 0.713 * x},
            {"sine": 0.131 * f, "cosine": 0.217 * f, "period": 3.17 * x},
            {"sine": 0.113 * f, "cosine": -0.071 * f, "period": 0.431 * x},
        ],
        "quadratic_drag": [{"coefficient": k * f / v**2} for k in (0.0117, 0.131, 1.73)],
        "cubic_stiffness": [{"coefficient": k * f / x**3} for k in (-0.0113, 0.0171, -0.131, 0.71)],
        "backlash": [{"gap": k * x} for k in (0.0037, 0.117, 0.83)],
        "constant_force": [{force: k * f} for k in (0.0117, -0.0171, 0.231, -0.617)],
        "periodic_force": [
            {"sine": -0.0113 * f, "cosine": 0.0071 * f, "frequency": 0.731},
            {"sine": 0.131 * f, "cosine": -0.0217 * f, "frequency": 5.37},
            {"sine": 0.071 * f, "cosine": 0.317 * f, "frequency": 1.917},
        ],
        "actuator_gain": [{"gain": g} for g in (0.987, 1.013, 1.731, 0.613)],
        "actuator_asymmetry": [{"difference": d} for d in (-0.0131, 0.0217, -0.713, 0.531)],
        "actuator_lag": [{"time_constant": t} for t in (0.0131, 1.37, 0.0713)],
        "actuator_rate_limit": [{"rate": r * f} for r in (971.0, 0.713, 53.1, 7.31)],
        "actuator_delay": [{"delay": d} for d in (0.00137, 0.01, 0.0137, 0.0831)],
        "actuator_saturation": [{"limit": k * f} for k in (0.113, 0.971, 0.431)],
        "actuator_dead_zone": [{"width": k * f} for k in (0.0037, 0.0431, 0.313)],
        "sensor_bias": [{"bias": k * x} for k in (-0.0113, 0.0171, 0.831, -0.31)],
        "sensor_drift": [{"rate": k * x} for k in (-0.0071, 0.0113, 0.171, -0.37)],
        "sensor_gain": [{"gain": g} for g in (0.987, 1.013, 0.613, 1.731)],
        "sensor_delay": [{"delay": d} for d in (0.00053, 0.01, 0.0371, 0.0137)],
        "velocity_lag": [{"time_constant": t} for t in (0.00231, 0.0173, 0.231)],
        "sensor_quantisation": [{"step": k * x} for k in (0.00371, 0.731, 0.0917)],
        "parameter_step": [
            {"time": 0.337, "factor": 0.613},
            {"time": 0.5131, "factor": 0.981},
            {"time": 0.0, "factor": 1.23},
            {"time": 0.5, "factor": 1.731},
        ],
    }


DIRECTION = {"coulomb_friction", "stribeck_friction", "hysteresis", "dead_band", "torque_limit"}
"""Effects whose force jumps, or bends, where the motion turns back or a limit is reached."""
SIZES = {
    "rig": (8.0, 0.1, 0.6),
    "pendulum": (0.8, 0.8, 4.0),
    "propeller_arm": (0.4, 0.8, 4.0),
    "servo": (0.7, 0.5, 4.0),
}
"""Command, position and velocity of each bench."""
SERVO = {effect.name for effect in get_model("servo").effects}
CASES = {
    "rig": library("force", *SIZES["rig"])
    | {
        "payload": [{"mass": m} for m in (0.0137, 0.31, 5.3)],
        "asymmetric_damping": [{"coefficient": c} for c in (0.17, -0.31, 2.3, -3.7)],
    },
    "pendulum": library("torque", *SIZES["pendulum"])
    | {
        "viscous_friction": [{"coefficient": c} for c in (0.00071, 0.0131, 0.31)],
        "payload": [{"mass": 0.0137, "length": 0.31}, {"mass": 0.31, "length": 0.713}, {"mass": 0.71}],
    },
    "propeller_arm": library("torque", *SIZES["propeller_arm"])
    | {"thrust_curve": [{"exponent": e} for e in (0.981, 1.017, 0.613, 2.131)]},
    "servo": {e: values for e, values in library("torque", *SIZES["servo"]).items() if e in SERVO}
    | {
        "gravity": [{"sine": 0.0131, "cosine": -0.0217}, {"sine": -0.31, "cosine": 0.13}],
        "dead_band": [{"width": w} for w in (0.0031, 0.0131, 0.171)],
        "torque_limit": [{"limit": t} for t in (0.531, 0.0713, 0.231)],
    },
}


HEAVY = {"inertia": 0.043, "damping": 0.13, "offset": 0.017}
"""A servo as slow as the other benches: behind a late sensor a state is extrapolated over the delay."""


def base_of(machine):
    """Base parameters that are not the nominal ones."""
    if machine == "servo":
        return HEAVY
    return {p.name: p.nominal * (1.0 + 0.07 * (k + 1)) for k, p in enumerate(get_model(machine).parameters)}


def commands_for(machine, rng):
    """Random steps, each held for 3 to 20 samples, with some at rest; shape (n, 1)."""
    size = SIZES[machine][0]
    level = size * rng.uniform(-1.0, 1.0, size=COUNT) * (rng.uniform(size=COUNT) > 0.15)
    level[1] = -size
    return np.repeat(level, rng.integers(3, 21, size=COUNT))[:COUNT, None]


def predicted(machine, effects, commands, shown, begin=0, state=None, velocity=True, refine=1):
    """Outputs of the model from what the sensors show at a sample on, shape (n - begin, 2).

    The model runs on a grid of time that is ``refine`` times finer, with the same commands held.
    """
    model = get_model(machine)
    commands = np.repeat(commands, refine, axis=0)
    count, begin = len(commands), begin * refine
    position, speed = model.outputs
    signals = {model.inputs[0].name: commands[:, 0]}
    fine = np.arange(count) / refine
    signals[position.name] = np.interp(fine, np.arange(len(shown)), shown[:, 0])
    if velocity:
        signals[speed.name] = np.repeat(shown[:, 1], refine)
    windows = Windows(
        recording=Recording(time=np.arange(count) * STEP / refine, signals=signals),
        starts=np.array([begin]),
        lengths=np.array([count - begin]),
        states=np.array([shown[begin // refine] if state is None else state]),
        observed=np.ones((1, count - begin, 2), dtype=np.bool_),
    )
    vector = model.vector(base_of(machine), effects)
    return model.simulate(vector, windows)[0, 0][::refine]


def oracle_of(machine, effects, commands, start=None):
    return find_oracle(machine).simulate(base_of(machine), effects, commands, STEP, start)


@pytest.fixture
def agree_on_a_bench(rng, agree):
    """The integration's steps leave two millionths of an output, and less than a thousandth of any effect.

    On the grid of the samples, but where forces jump with the direction of motion: there an eighth of it.
    """

    def check(machine, effects, begins=(0, MIDDLE), tolerance=1e-3, **how):
        commands = commands_for(machine, rng)
        on, off = (oracle_of(machine, e, commands) for e in (effects, {}))
        # A rounded position is no state to start from.
        smooth = {name: values for name, values in effects.items() if name != "sensor_quantisation"}
        states = oracle_of(machine, smooth, commands) if smooth != effects else on
        how.setdefault("refine", 8 if DIRECTION & set(effects) else 1)
        for begin in begins:
            got = predicted(machine, effects, commands, on, begin, **{"state": states[begin], **how})
            agree(got, on[begin:], off[begin:], tolerance, absolute=2e-6 * np.abs(on).max(axis=0))

    return check


def test_the_model_from_rest_and_from_what_the_sensors_show(machine, effect, values, agree_on_a_bench):
    if effect == "sensor_delay":
        # At rest when the sensor first shows the axis; beside a velocity that is not late, see below.
        agree_on_a_bench(machine, {effect: values}, begins=(0,), velocity=False, state=(0.0, 0.0))
    elif effect == "velocity_lag":
        # A filter takes what a speed does within a step for straight; later a speed is guessed by its slope.
        agree_on_a_bench(machine, {effect: values}, begins=(0,), tolerance=2e-2)
    else:
        agree_on_a_bench(machine, {effect: values})


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_limited_torque_brakes_against_its_error(sign, agree):
    """A joint that runs fast towards its set-point is braked at the limit: a parabola, in closed form."""
    limit, count, (place, speed) = 0.05, 20, (0.0, 4.0 * sign)
    commands, time = np.full((count, 1), 2.0 * HEAVY["offset"] + 0.3 * sign), np.arange(count) * STEP
    push = (HEAVY["offset"] - sign * limit) / HEAVY["inertia"]
    rates = speed + push * time
    places = place + speed * time + 0.5 * push * time**2
    assert (np.abs(commands[:, 0] - places - HEAVY["damping"] * rates) > 1.1 * limit).all()
    assert (sign * (commands[:, 0] - places) > 0.0)[:6].all()  # the error says: on; the torque: back
    effects, shown = {"torque_limit": {"limit": limit}}, np.column_stack([places, rates])
    agree(predicted("servo", effects, commands, shown), shown, 0.0 * shown, 1e-6)


@pytest.mark.parametrize("machine", CASES)
@pytest.mark.parametrize("delay", [0.01, 0.0371])
def test_a_late_position_beside_a_velocity_that_is_not(machine, delay, agree_on_a_bench):
    agree_on_a_bench(machine, {"sensor_delay": {"delay": delay}}, begins=(MIDDLE,))


SHOWING = ["sensor_bias", "sensor_drift", "sensor_gain", "backlash"]
LATE = [
    ("sensor_delay",),
    *(("sensor_delay", effect) for effect in (*SHOWING, "actuator_delay", "actuator_lag", "periodic_force")),
]


SHOWN = [
    (machine, effects)
    for machine in CASES
    for effects in [*((effect,) for effect in SHOWING), *LATE]
    if set(effects) <= set(CASES[machine])
]


@pytest.mark.matrix(
    keep=(
        "0-servo-effects38",
        "43-servo-effects39",
    )
)
@pytest.mark.parametrize(("machine", "effects"), SHOWN)
@pytest.mark.parametrize("begin", [0, MIDDLE])
def test_a_bench_without_a_velocity_sensor(machine, effects, begin, rng, agree):
    """Then a window's velocity is the slope of the shown position, here of one that is three samples late."""
    values = {effect: CASES[machine][effect][-1] for effect in effects}
    values |= {"sensor_delay": {"delay": 0.03}} if "sensor_delay" in effects else {}
    commands, behind = commands_for(machine, rng), 3 if "sensor_delay" in effects else 0
    on, off = (oracle_of(machine, e, commands) for e in (values, {}))
    true = oracle_of(machine, {e: v for e, v in values.items() if e not in SHOWING}, commands)
    gain, drift = (
        values.get("sensor_gain", {}).get("gain", 1.0),
        values.get("sensor_drift", {}).get("rate", 0.0),
    )
    slope = gain * (true[begin - behind, 1] if begin else 0.0) + drift
    got = predicted(machine, values, commands, on, begin, (on[begin, 0], slope), velocity=False)
    agree(got, on[begin:], off[begin:], 1e-3, absolute=2e-6 * np.abs(on).max(axis=0))


@pytest.mark.parametrize("machine", CASES)
@pytest.mark.parametrize("lag", [0.0003, 0.00053, 0.00127, 0.00271])
def test_a_lag_shorter_than_a_sample(machine, lag, agree_on_a_bench):
    agree_on_a_bench(machine, {"actuator_lag": {"time_constant": lag}}, refine=1)


@pytest.mark.parametrize("machine", CASES)
def test_hardly_any_lag_is_none(machine, rng):
    commands = commands_for(machine, rng)
    off = oracle_of(machine, {}, commands)
    with_lag, without = (
        predicted(machine, effects, commands, off, 0, off[0])
        for effects in ({"actuator_lag": {"time_constant": 1e-9}}, {})
    )
    np.testing.assert_allclose(with_lag, without, atol=1e-6 * np.abs(off).max())


@pytest.mark.parametrize("machine", CASES)
@pytest.mark.parametrize("effect", ["coulomb_friction", "stribeck_friction", "hysteresis"])
def test_small_dry_friction_on_the_grid_of_the_samples(machine, effect, agree_on_a_bench):
    agree_on_a_bench(machine, {effect: CASES[machine][effect][0]}, refine=1)


ACTUATOR = [e for e in CASES["rig"] if e.startswith("actuator") or e == "parameter_step"]
SENSOR = ["backlash", *(e for e in CASES["rig"] if e.startswith("sensor") and e != "sensor_delay")]
HOLDING = [
    ("coulomb_friction", e) for e in ("periodic_force", "actuator_lag", "actuator_rate_limit", "hysteresis")
]


def pairs(machine):
    """Pairs of which the order shows, pairs with what holds the axis, and some by chance."""
    chosen = [*itertools.combinations(SENSOR, 2), *HOLDING]
    if machine == "rig":
        chosen += itertools.combinations(ACTUATOR, 2)
    if machine == "servo":
        chosen += [("torque_limit", "dead_band"), ("dead_band", "coulomb_friction")]
    if machine == "propeller_arm":
        chosen += [("thrust_curve", effect) for effect in ACTUATOR]
    others = [
        p for p in itertools.combinations(CASES[machine], 2) if p not in chosen and "sensor_delay" not in p
    ]
    chosen = [pair for pair in chosen if set(pair) <= set(CASES[machine])]
    return chosen + random.Random(11).sample(others, 8)


PAIRS = [(machine, *pair) for machine in CASES for pair in pairs(machine)]


@pytest.mark.parametrize("pair", PAIRS, ids="+".join)
def test_pairs_act_in_the_documented_order(pair, agree_on_a_bench):
    machine, *effects = pair
    agree_on_a_bench(machine, {effect: CASES[machine][effect][-1] for effect in effects}, tolerance=2e-3)


@pytest.mark.parametrize("machine", CASES)
@pytest.mark.parametrize("effect", ["actuator_delay", "actuator_lag", "actuator_rate_limit", "hysteresis"])
def test_an_episode_knows_nothing_of_the_one_before(machine, effect, rng, agree):
    model, values = get_model(machine), CASES[machine][effect][-1]
    commands = commands_for(machine, rng)
    on, off = (oracle_of(machine, e, commands) for e in ({effect: values}, {}))
    names = (model.inputs[0].name, *(output.name for output in model.outputs))
    own = np.column_stack([commands, on])
    recording = Recording(
        time=np.tile(np.arange(COUNT) * STEP, 2),
        signals=dict(zip(names, np.concatenate([[SIZES[machine][0], 0.0, 0.0] - own, own]).T, strict=True)),
        episode=np.repeat([0, 1], COUNT),
    )
    for begin in (0, 2):
        windows = Windows(
            recording=recording,
            starts=np.array([COUNT + begin]),
            lengths=np.array([COUNT - begin]),
            states=on[begin, None],
            observed=np.ones((1, COUNT - begin, 2), dtype=np.bool_),
        )
        got = model.simulate(model.vector(base_of(machine), {effect: values}), windows)[0, 0]
        agree(got, on[begin:], off[begin:], 0.02)  # coarse steps; a wrong memory is as large as the effect


READ = 0.01
"""Share of a step after its command at which a force is measured."""


@pytest.mark.parametrize("machine", ["rig", "pendulum"])
@pytest.mark.parametrize(
    "effects", [*((e,) for e in ACTUATOR), ("actuator_lag", "actuator_rate_limit")], ids="+".join
)
def test_the_force_that_an_actuator_gives(machine, effects, rng, agree):
    """Where it is measured beside its command, just after it; a delay in whole samples."""
    values = {effect: CASES[machine][effect][-1] for effect in effects}
    values |= {"actuator_delay": {"delay": 0.03}} if "actuator_delay" in effects else {}
    model, commands = get_model(machine), commands_for(machine, rng)
    force, times = model.inputs[0].name, np.arange(COUNT) * STEP
    signals = {force: commands[:, 0], f"{force}_measured": commands[:, 0]}
    signals |= {output.name: np.zeros(COUNT) for output in model.outputs}
    recording = Recording(time=times, signals=signals)
    (drive,) = [stage.model for stage in model.stages([recording]) if effects[0] in stage.effects]
    windows = Windows(
        recording=recording,
        starts=np.array([0]),
        lengths=np.array([COUNT]),
        states=np.zeros((1, 1)),
        observed=np.ones((1, COUNT, 1), dtype=np.bool_),
    )
    got = drive.simulate(drive.vector(effects=values), windows)[0, 0]
    [pieces] = one_axis.episode(lambda *_: 0.0, 1.0, values, commands[:, 0], STEP).pieces
    on = np.array([[current(pieces, t).at(t)] for t in times + READ * STEP])
    agree(got, on, commands, 1e-9)


@pytest.mark.parametrize(
    "effect", ["actuator_delay", "coulomb_friction", "sensor_gain", "sensor_quantisation"]
)
def test_a_recording_from_a_hidden_reality(effect, rng, agree):
    machine, values = "pendulum", CASES["pendulum"][effect][-1]
    commands = commands_for(machine, rng)
    reality = {effect: values, "parameters": base_of(machine)}
    recording = synthesise(get_model(machine), reality, commands, step=STEP, rng=rng, noise=False)
    on, off = (oracle_of(machine, e, commands) for e in ({effect: values}, {}))
    agree(np.column_stack([recording["angle"], recording["velocity"]]), on, off, 1e-3)
