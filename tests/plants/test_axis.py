"""The benches on an axis: every listed effect acts on the model as it does on the plant."""

import numpy as np
import pytest

from exam.benches import PLACES, get_bench
from exam.plants import axis_listed
from exam.plants.axis import simulate
from fieldmodels.recording import Recording, Windows
from fieldmodels.registry import get_model
from fieldmodels.synthesis import synthesise

AXES = tuple(name for name, kind in PLACES.items() if kind == "axis")
STEP, COUNT, MIDDLE = 0.01, 110, 43
READ = 0.01
"""Share of a step after its command at which a force is measured."""
DRY = {"coulomb_friction", "stribeck_friction"}
BENT = {*DRY, "hysteresis", "dead_band", "torque_limit", "actuator_rate_limit"}
"""Effects whose force jumps, or bends, where the motion turns back or a limit is reached."""
HEAVY = {"inertia": 0.043, "damping": 0.13, "offset": 0.017}
"""A servo as slow as the other benches: behind a late sensor a state is extrapolated over the delay."""
JUMP = {"time": 0.4129999, "factor": 0.613}
"""Within a sample, at a tenth of it."""


def base_of(name):
    return HEAVY if name == "servo" else get_bench(name).base(3)


def values_of(name, effect):
    size = 100.0 if effect == "sensor_drift" else 3.1  # within a second, not a record
    return JUMP if effect == "parameter_step" else get_bench(name).values(effect, size, 1, 3)


def commands_for(name, rng):
    """Random steps, each held for 3 to 20 samples, with some at rest; shape (n, 1)."""
    size = 0.8 * get_bench(name).sizes.u
    level = size * rng.uniform(-1.0, 1.0, size=COUNT) * (rng.uniform(size=COUNT) > 0.15)
    level[:2] = 0.0, -size  # at rest until a late sensor shows it
    return np.repeat(level, rng.integers(3, 21, size=COUNT))[:COUNT, None]


def shown(name, effects, commands, given=False):
    """What the plant shows without noise, shape (n, 2); if asked so, what it is driven by READ after that."""
    bench, base = get_bench(name), base_of(name)
    parts = round(1.0 / READ) if given else 10 if "parameter_step" in effects else 1
    plant = bench.plant({**base, "offset": 0.0} if "sensor_delay" in effects and "offset" in base else base)
    plant.finer *= max((64 if DRY & set(effects) else 16) // parts, 1)
    axis_listed.install(plant, effects, float(np.abs(commands).max()), bench.linear)
    if given:
        plant.position = [lambda _y, _t, _x, _v, force: force]
    held = np.repeat(commands[:, 0], parts).tolist()
    rows = simulate(plant, lambda i, _x, _v: held[i], np.zeros((len(held), 2)), STEP / parts)
    return rows[int(given) :: parts, 1:]


def predicted(name, effects, commands, seen, begin=0, state=None, velocity=True, refine=1):
    """Outputs of the model from what the sensors show at a sample on, shape (n - begin, 2).

    The model runs on a grid of time that is ``refine`` times finer, with the same commands held.
    """
    model, base = get_model(name), base_of(name)
    base = {**base, "offset": 0.0} if "sensor_delay" in effects and "offset" in base else base
    commands = np.repeat(commands, refine, axis=0)
    count, begin = len(commands), begin * refine
    position, speed = model.outputs
    signals = {model.inputs[0].name: commands[:, 0]}
    fine = np.arange(count) / refine
    signals[position.name] = np.interp(fine, np.arange(len(seen)), seen[:, 0])
    if velocity:
        signals[speed.name] = np.repeat(seen[:, 1], refine)
    windows = Windows(
        recording=Recording(time=np.arange(count) * STEP / refine, signals=signals),
        starts=np.array([begin]),
        lengths=np.array([count - begin]),
        states=np.array([seen[begin // refine] if state is None else state]),
        observed=np.ones((1, count - begin, 2), dtype=np.bool_),
    )
    return model.simulate(model.vector(base, effects), windows)[0, 0][::refine]


@pytest.fixture
def rng():
    """One motion for all effects."""
    return np.random.default_rng(5)


@pytest.fixture
def agree_on_a_bench(rng, agree):
    """The integration's steps leave two millionths of an output, and less than a thousandth of any effect.

    On the grid of the samples, but where forces jump with the direction of motion: there an eighth of it.
    """

    def check(name, effects, begins=(0, MIDDLE), tolerance=1e-3, **how):
        commands = commands_for(name, rng)
        tolerance *= 2 if BENT & set(effects) else 1
        on, off = (shown(name, e, commands) for e in (effects, {}))
        # A rounded position is no state to start from.
        smooth = {effect: values for effect, values in effects.items() if effect != "sensor_quantisation"}
        states = shown(name, smooth, commands) if smooth != effects else on
        how.setdefault("refine", 8 if BENT & set(effects) else 1)
        for begin in begins:
            got = predicted(name, effects, commands, on, begin, **{"state": states[begin], **how})
            agree(got, on[begin:], off[begin:], tolerance, absolute=2e-6 * np.abs(on).max(axis=0))

    return check


@pytest.mark.parametrize("name", AXES)
@pytest.mark.every("effect", sorted({e for name in AXES for e in get_bench(name).effects}))
def test_an_effect_from_rest_and_from_what_the_sensors_show(name, effect, agree_on_a_bench):
    if effect not in get_bench(name).effects:
        return
    effects = {effect: values_of(name, effect)}
    if effect == "sensor_delay":
        # At rest when the sensor first shows the axis; then beside a velocity that is not late.
        agree_on_a_bench(name, effects, begins=(0,), velocity=False, state=(0.0, 0.0))
        agree_on_a_bench(name, effects, begins=(MIDDLE,))
    elif effect == "velocity_lag":
        # A filter takes what a speed does within a step for straight; later a speed is guessed by its slope.
        agree_on_a_bench(name, effects, begins=(0,), tolerance=2e-2)
    else:
        agree_on_a_bench(name, effects)


ACTUATOR = [e for e in get_bench("rig").effects if e.startswith("actuator") or e == "parameter_step"]
SHOWING = ["sensor_bias", "sensor_drift", "sensor_gain", "backlash"]
TOGETHER = (
    [*ACTUATOR, "thrust_curve"],
    [*SHOWING, "sensor_quantisation"],
    ["sensor_gain", "sensor_drift"],
    ["coulomb_friction", "periodic_force", "actuator_lag", "actuator_rate_limit"],
    ["coulomb_friction", "hysteresis", "torque_limit", "dead_band"],
    ["payload", "cubic_stiffness", "cogging", "quadratic_drag", "constant_force", "velocity_lag"],
)
"""What acts in an order, what holds an axis, and what acts side by side."""


@pytest.mark.parametrize("name", AXES)
@pytest.mark.every("effects", TOGETHER)
def test_several_effects_act_in_the_documented_order(name, effects, agree_on_a_bench):
    chosen = {e: values_of(name, e) for e in effects if e in get_bench(name).effects}
    begins = (0,) if "velocity_lag" in chosen else (0, MIDDLE)
    agree_on_a_bench(name, chosen, begins, tolerance=2e-3)


def test_whether_friction_holds_an_axis_does_not_depend_on_a_bristle(agree_on_a_bench):
    """Beside friction that often holds it; counted as a drive, the bristle would set it free."""
    force = 0.4 * get_bench("rig").sizes.u
    bristle = {"force": force, "distance": 0.02}
    effects = {"coulomb_friction": {"force": force}, "hysteresis": bristle}
    agree_on_a_bench("rig", effects, begins=(0,), tolerance=2e-4)


@pytest.mark.every("sign", [-1.0, 1.0])
def test_a_limited_torque_brakes_against_its_error(sign, agree):
    """A joint that runs fast towards its set-point is braked at the limit: a parabola, in closed form."""
    limit, count, (place, speed) = 0.05, 20, (0.0, 4.0 * sign)
    commands, time = np.full((count, 1), 2.0 * HEAVY["offset"] + 0.3 * sign), np.arange(count) * STEP
    push = (HEAVY["offset"] - sign * limit) / HEAVY["inertia"]
    rates = speed + push * time
    places = place + speed * time + 0.5 * push * time**2
    assert (np.abs(commands[:, 0] - places - HEAVY["damping"] * rates) > 1.1 * limit).all()
    assert (sign * (commands[:, 0] - places) > 0.0)[:6].all()  # the error says: on; the torque: back
    effects, seen = {"torque_limit": {"limit": limit}}, np.column_stack([places, rates])
    agree(predicted("servo", effects, commands, seen), seen, 0.0 * seen, 1e-6)


@pytest.mark.every("name", ["rig", "servo"])
def test_a_bench_without_a_velocity_sensor(name, rng, agree):
    """Then a window's velocity is the slope of the shown position, here of one that is three samples late."""
    also = (*SHOWING, "actuator_delay", "actuator_lag", "periodic_force")
    for effects in [*((e,) for e in SHOWING), ("sensor_delay",), *(("sensor_delay", e) for e in also)]:
        if not set(effects) <= set(get_bench(name).effects):
            continue
        values = {effect: values_of(name, effect) for effect in effects}
        values |= {"sensor_delay": {"delay": 0.03}} if "sensor_delay" in effects else {}
        commands, behind = commands_for(name, rng), 3 if "sensor_delay" in effects else 0
        on = shown(name, values, commands)
        still = {"sensor_delay": {"delay": 0.0}} if "sensor_delay" in effects else {}
        off, true = (
            shown(name, still | {e: v for e, v in values.items() if e in kept}, commands)
            for kept in ((), set(effects) - {"sensor_delay", *SHOWING})
        )
        gain = values.get("sensor_gain", {}).get("gain", 1.0)
        # The plant rests until time zero, a wave before it or not.
        for begin in (MIDDLE,) if "periodic_force" in effects else (0, MIDDLE):
            slope = gain * (true[begin - behind, 1] if begin else 0.0)
            slope += values.get("sensor_drift", {}).get("rate", 0.0)
            got = predicted(name, values, commands, on, begin, (on[begin, 0], slope), velocity=False)
            agree(got, on[begin:], off[begin:], 1e-3, absolute=2e-6 * np.abs(on).max(axis=0))


def test_a_lag_shorter_than_a_sample(agree_on_a_bench):
    for lag in (0.0003, 0.00271):
        agree_on_a_bench("rig", {"actuator_lag": {"time_constant": lag}}, refine=1)


def test_hardly_any_lag_is_none(rng):
    commands = commands_for("rig", rng)
    off = shown("rig", {}, commands)
    with_lag, without = (
        predicted("rig", effects, commands, off)
        for effects in ({"actuator_lag": {"time_constant": 1e-9}}, {})
    )
    np.testing.assert_allclose(with_lag, without, atol=1e-6 * np.abs(off).max())


@pytest.mark.every("name", AXES)
def test_an_episode_knows_nothing_of_the_one_before(name, rng, agree):
    model, commands = get_model(name), commands_for(name, rng)
    names = (model.inputs[0].name, *(output.name for output in model.outputs))
    for effect in ("actuator_delay", "actuator_rate_limit", "hysteresis"):
        values = values_of(name, effect)
        on, off = (shown(name, e, commands) for e in ({effect: values}, {}))
        own = np.column_stack([commands, on])
        both = np.concatenate([[np.abs(commands).max(), 0.0, 0.0] - own, own])
        recording = Recording(
            time=np.tile(np.arange(COUNT) * STEP, 2),
            signals=dict(zip(names, both.T, strict=True)),
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
            got = model.simulate(model.vector(base_of(name), {effect: values}), windows)[0, 0]
            agree(
                got, on[begin:], off[begin:], 0.02
            )  # coarse steps; a wrong memory is as large as the effect


def test_the_force_that_an_actuator_gives(rng, agree):
    """Where it is measured beside its command, just after it; a delay in whole samples."""
    model, commands = get_model("rig"), commands_for("rig", rng)
    force, times = model.inputs[0].name, np.arange(COUNT) * STEP
    signals = {force: commands[:, 0], f"{force}_measured": commands[:, 0]}
    signals |= {output.name: np.zeros(COUNT) for output in model.outputs}
    recording = Recording(time=times, signals=signals)
    windows = Windows(
        recording=recording,
        starts=np.array([0]),
        lengths=np.array([COUNT]),
        states=np.zeros((1, 1)),
        observed=np.ones((1, COUNT, 1), dtype=np.bool_),
    )
    for effects in [*((e,) for e in ACTUATOR), ("actuator_lag", "actuator_rate_limit")]:
        values = {effect: values_of("rig", effect) for effect in effects}
        values |= {"actuator_delay": {"delay": 0.03}} if "actuator_delay" in effects else {}
        values |= {"parameter_step": {"time": 0.41, "factor": 0.7}} if "parameter_step" in effects else {}
        (drive,) = [stage.model for stage in model.stages([recording]) if effects[0] in stage.effects]
        got = drive.simulate(drive.vector(effects=values), windows)[0, 0]
        on = shown("rig", values, commands, given=True)[:, :1]
        agree(got, on, commands, 1e-7)


def test_a_recording_from_a_hidden_reality(rng, agree):
    commands = commands_for("pendulum", rng)
    for effect in ("actuator_delay", "coulomb_friction", "sensor_gain", "sensor_quantisation"):
        effects = {effect: values_of("pendulum", effect)}
        reality = effects | {"parameters": base_of("pendulum")}
        made = synthesise(get_model("pendulum"), reality, commands, step=STEP, rng=rng, noise=False)
        on, off = (shown("pendulum", e, commands) for e in (effects, {}))
        agree(np.column_stack([made["angle"], made["velocity"]]), on, off, 2e-3)
