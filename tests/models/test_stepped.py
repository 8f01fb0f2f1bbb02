"""Stock effects that are stepped, against plain NumPy on a fine time grid, and against a recording."""

import numpy as np
import pytest

from fieldmodels.drivers.around import Surrounded
from fieldmodels.drivers.named import apply_reality, stepped, with_named
from fieldmodels.drivers.stepped import Channels
from fieldmodels.model import Model, ModelError, Parameter, Signal
from fieldmodels.recording import Recording, Windows

STEP, STEPS, FINE = 0.1, 60, 4000
rng = np.random.default_rng(3)
COMMANDS = rng.uniform(-2.0, 2.0, (STEPS, 2))
TRUE = 3.0 * np.cumsum(rng.standard_normal((STEPS, 2)), axis=0) / np.sqrt(STEPS)


class Plain(Model):
    """What two commands give is measured as it is, times a parameter."""

    name = "plain"
    inputs = (Signal("left", "V"), Signal("right", "V"))
    outputs = (Signal("first", "m", noise=0.1), Signal("second", "rad", noise=0.1, angle=True))
    states = ()
    parameters = (Parameter("scale", "1", 1.0, 0.2, 3.0, 0.1), Parameter("other", "1", 1.0, 0.0, 2.0, 0.1))
    effects = ()
    horizons = (1.0,)
    wrapped_outputs = ("second",)

    def simulate(self, parameters, windows):
        rows = windows.starts[:, None] + np.arange(windows.samples)
        both = np.stack([windows.recording[s.name][rows] for s in self.inputs], axis=-1)
        return np.atleast_2d(parameters)[:, 0][:, None, None, None] * both

    def initial_states(self, recording, starts):
        return np.zeros((len(starts), 0))


CHANNELS = Channels(("left", "right"), ("first", "second"))


def stepping(reality, batch=1):
    model, read = apply_reality(Plain(), reality, CHANNELS)
    made = stepped(model, read, CHANNELS, batch, STEP)
    made.begin(range(batch))
    return made


def given_by(reality, commands=COMMANDS):
    """What the actuators give, step by step."""
    made, out = stepping(reality), []
    for command in commands:
        out.append(made.given(command[None])[0])
        made.tick()
    return np.array(out)


def shown_by(reality, true=TRUE):
    made, out = stepping(reality), []
    for value in true:
        out.append(made.shown(value[None])[0])
        made.tick()
    return np.array(out)


def held(command, time, delay=0.0):
    """A held command as it arrives; before the first there was the first."""
    return command[np.maximum(np.floor((time - delay) / STEP + 1e-9).astype(int), 0)]


def averaged(fine):
    return fine.reshape(STEPS, FINE).mean(axis=1)


TIME = (np.arange(STEPS * FINE) + 0.5) * STEP / FINE


def lagging(aim, time_constant, limit=np.inf):
    """T dF/dt = u - F with |dF/dt| <= limit, by small steps."""
    force, out, h = aim[0], np.empty(len(aim)), STEP / FINE
    for i, u in enumerate(aim):
        rate = (u - force) / max(time_constant, h)
        force += h * min(max(rate, -limit), limit)
        out[i] = force
    return out


def played(command, width):
    out, engaged = [], command[0]
    for u in command:
        engaged = min(max(engaged, u - width / 2), u + width / 2)
        out.append(engaged)
    return np.array(out)


U = COMMANDS[:, 0]
ACTUATORS = {
    "gain": ({"left_gain": {"gain": 0.7}}, lambda: 0.7 * U),
    "bias": ({"left_bias": {"bias": -0.3}}, lambda: U - 0.3),
    "asymmetry": ({"left_asymmetry": {"difference": 0.4}}, lambda: np.where(U > 0, 1.2 * U, 0.8 * U)),
    "play": ({"left_play": {"width": 0.9}}, lambda: played(U, 0.9)),
    "dead zone": (
        {"left_dead_zone": {"width": 0.5}},
        lambda: np.sign(U) * np.maximum(np.abs(U) - 0.5, 0.0),
    ),
    "saturation": ({"left_saturation": {"limit": 1.1}}, lambda: np.clip(U, -1.1, 1.1)),
    "jump": (
        {"left_parameter_step": {"time": 2.03, "factor": 0.4}},
        lambda: averaged(held(U, TIME) * np.where(TIME > 2.03, 0.4, 1.0)),
    ),
    "lag": (
        {"left_lag": {"time_constant": 0.17}},
        lambda: averaged(lagging(held(U, TIME), 0.17)),
    ),
    "limited rate": (
        {"left_rate_limit": {"rate": 9.0}, "left_lag": {"time_constant": 0.05}},
        lambda: averaged(lagging(held(U, TIME), 0.05, 9.0)),
    ),
    "delay": ({"left_delay": {"delay": 0.234}}, lambda: averaged(held(U, TIME, 0.234))),
    "curve": (
        {"left_curve": {"low": -1.0, "high": 1.5, "value_1": 0.4, "value_2": -0.2, "value_3": 0.7}},
        lambda: U + np.interp(U, [-1.0, 0.25, 1.5], [0.4, -0.2, 0.7]),
    ),
}


@pytest.mark.every("kind", ACTUATORS)
def test_an_actuator_gives_what_numpy_says(kind):
    reality, oracle = ACTUATORS[kind]
    given = given_by(reality)
    expected = oracle()
    assert np.abs(expected - U).max() > 0.1
    np.testing.assert_allclose(given[:, 0], expected, atol=2e-3)
    np.testing.assert_array_equal(given[:, 1], COMMANDS[:, 1])  # the other command passes


def fine_lag(values, time_constant):
    """A lag behind values that go along lines."""
    time = np.arange((STEPS - 1) * FINE + 1) * STEP / FINE
    fine = np.interp(time, np.arange(STEPS) * STEP, values)
    return lagging(fine, time_constant)[::FINE]


Y = TRUE[:, 0]
CLOCK = np.arange(STEPS) * STEP
SENSORS = {
    "gain and bias": (
        {"first_gain": {"gain": 1.2}, "first_bias": {"bias": 0.3}},
        lambda: 1.2 * Y + 0.3,
    ),
    "bend": ({"first_bend": {"curvature": 0.2}}, lambda: Y + 0.2 * Y * np.abs(Y)),
    "drift": ({"first_drift": {"rate": 0.1}}, lambda: Y + 0.1 * CLOCK),
    "wave": (
        {"first_eccentricity": {"sine": 0.2, "cosine": -0.1, "period": 0.8}},
        lambda: Y + 0.2 * np.sin(2 * np.pi * Y / 0.8) - 0.1 * np.cos(2 * np.pi * Y / 0.8),
    ),
    "clipping": ({"first_clipping": {"limit": 0.9}}, lambda: np.clip(Y, -0.9, 0.9)),
    "quantisation": ({"first_quantisation": {"step": 0.5}}, lambda: 0.5 * np.floor(Y / 0.5 + 0.5)),
    "lag": ({"first_lag": {"time_constant": 0.3}}, lambda: fine_lag(Y, 0.3)),
    "delay": ({"first_delay": {"delay": 0.26}}, lambda: np.interp(CLOCK - 0.26, CLOCK, Y)),
    "curve": (
        {"first_curve": {"low": -2.0, "high": 2.0, "value_1": -0.5, "value_2": 0.4, "value_3": 0.0}},
        lambda: Y + np.interp(Y, [-2.0, 0.0, 2.0], [-0.5, 0.4, 0.0]),
    ),
}


@pytest.mark.every("kind", SENSORS)
def test_a_sensor_shows_what_numpy_says(kind):
    reality, oracle = SENSORS[kind]
    shown = shown_by(reality)
    expected = oracle()
    assert np.abs(expected - Y).max() > 0.1
    np.testing.assert_allclose(shown[:, 0], expected, atol=1e-3 if kind == "lag" else 1e-12)
    np.testing.assert_array_equal(shown[:, 1], TRUE[:, 1])


def test_an_angle_turns_on_where_it_is_wrapped():
    """A heading that passes pi is late as any other: nothing of the jump by a turn is seen."""
    turning = np.column_stack([np.zeros(STEPS), 0.3 * np.arange(STEPS)])
    wrapped = (turning + np.pi) % (2 * np.pi) - np.pi
    shown = shown_by({"second_delay": {"delay": 0.15}}, wrapped)[:, 1]
    late = np.interp(CLOCK - 0.15, CLOCK, turning[:, 1])
    np.testing.assert_allclose(np.cos(shown - late), 1.0, atol=1e-12)
    assert np.abs(shown).max() <= np.pi


def test_parameters_change_by_their_mean_over_the_time_that_comes_within_their_bounds():
    made = stepping({"scale_step": {"time": 1.04, "change": 0.5}, "other_drift": {"rate": -0.3}})
    seen = []
    for _ in range(STEPS):
        seen.append(made.change([0], STEP)[0])
        made.tick()
    begin = CLOCK
    expected = 1.0 + 0.5 * np.clip((begin + STEP - 1.04) / STEP, 0.0, 1.0)
    np.testing.assert_allclose(np.array(seen)[:, 0], expected, atol=1e-12)
    np.testing.assert_allclose(
        np.array(seen)[:, 1], np.maximum(1.0 - 0.3 * (begin + STEP / 2), 0.0), atol=1e-12
    )
    made.begin([0])
    assert made.change([0], 0.0)[0].tolist() == [1.0, 1.0]


EVERYTHING = {
    "left_gain": {"gain": 0.8},
    "left_lag": {"time_constant": 0.13},
    "left_delay": {"delay": 0.17},
    "right_curve": {"low": -2.0, "high": 2.0, "value_1": 0.2, "value_2": -0.3},
    "right_play": {"width": 0.4},
    "first_bend": {"curvature": 0.3},
    "second_curve": {"low": -1.0, "high": 1.0, "value_1": 0.1, "value_2": 0.0, "value_3": -0.2},
    "first_drift": {"rate": 0.2},
}


def test_steps_are_what_a_model_with_the_same_effects_predicts_of_a_recording():
    """And with nothing around, the model stays itself."""
    model = with_named(Plain(), EVERYTHING)
    assert isinstance(model, Surrounded)
    signals = {"left": COMMANDS[:, 0], "right": COMMANDS[:, 1]}
    recording = Recording(CLOCK, signals | {"first": np.zeros(STEPS), "second": np.zeros(STEPS)})
    observed = np.ones((1, STEPS, 2), dtype=bool)
    windows = Windows(recording, np.array([0]), np.array([STEPS]), np.zeros((1, 0)), observed)
    predicted = model.simulate(model.vector(effects=EVERYTHING)[None], windows)[0, 0]
    given = given_by(EVERYTHING)
    np.testing.assert_allclose(shown_by(EVERYTHING, given), predicted, atol=1e-12)
    assert np.abs(predicted - COMMANDS).max() > 0.1
    plain = Plain()
    assert with_named(plain, {}) is plain
    assert stepped(plain, apply_reality(plain, None)[1], CHANNELS, 1, STEP) is None


def test_a_late_sensor_is_simulated_over_whole_episodes_only():
    reality = {"first_delay": {"delay": 0.26}, "first_lag": {"time_constant": 0.2}}
    model, read = apply_reality(Plain(), reality)
    episode = np.repeat([0, 1], STEPS // 2)
    signals = {"left": U, "right": U, "first": np.zeros(STEPS), "second": np.zeros(STEPS)}
    recording = Recording(np.tile(CLOCK[: STEPS // 2], 2), signals, episode=episode)
    half = STEPS // 2
    windows = Windows(
        recording, np.array([0, half]), np.array([half, half]), np.zeros((2, 0)), np.ones((2, half, 2), bool)
    )
    out = model.simulate(read.vector(model)[None], windows)[0]
    for k, part in enumerate((U[:half], U[half:])):
        one = shown_by(reality, np.column_stack([part, part]))[:, 0]
        np.testing.assert_allclose(out[k, :, 0], one, atol=1e-12)
    with pytest.raises(ModelError, match="beginning"):
        model.simulate(read.vector(model)[None], windows.select(np.array([1])).__class__(
            recording, np.array([3]), np.array([5]), np.zeros((1, 0)), np.ones((1, 5, 2), bool)
        ))  # fmt: skip


def test_each_row_remembers_its_own_and_comes_back_from_a_snapshot():
    random = {name: dict(values) for name, values in EVERYTHING.items()}
    random["left_lag"]["time_constant"] = {"uniform": [0.0, 0.5]}
    random["left_delay"]["delay"] = {"choice": [0.0, 0.31]}
    random["scale_drift"] = {"rate": {"uniform": [-0.1, 0.1]}}
    model, read = apply_reality(Plain(), random, CHANNELS)
    drawn = [read.draw(model, np.random.default_rng(k)) for k in range(3)]
    made = stepped(model, read, CHANNELS, 3, STEP)
    made.set_parameters([0, 1, 2], np.array([d.vector(model) for d in drawn]))

    def run(one, rows, count, first=0):
        out = []
        for k in range(first, first + count):
            part = one.change(list(range(rows)), STEP), one.given(np.tile(COMMANDS[k], (rows, 1)))
            out.append(np.column_stack([*part, one.shown(np.tile(TRUE[k], (rows, 1)))]))
            one.tick()
        return np.array(out)

    made.begin([0, 1, 2])
    together = run(made, 3, 20)
    state = made.state()
    rest = run(made, 3, 20, 20)
    for k, reality in enumerate(drawn):
        alone = stepped(model, reality, CHANNELS, 1, STEP)
        alone.begin([0])
        np.testing.assert_array_equal(run(alone, 1, 20)[:, 0], together[:, k])
    made.begin([0, 1, 2])
    made.set_state(state)
    np.testing.assert_array_equal(run(made, 3, 20, 20), rest)
    made.begin([1])  # the others go on
    again = run(made, 3, 1)
    np.testing.assert_array_equal(again[0, 1], together[0, 1])
    with pytest.raises(ValueError, match="snapshot"):
        stepping(EVERYTHING).set_state(state)


def test_what_cannot_act_is_said():
    legs = Channels(("left",), ("first",), "the other one is a mirror", prompt=("left",))
    with pytest.raises(ModelError, match=r"mirror. There are the commands left; the sensors first"):
        apply_reality(Plain(), {"right_gain": {"gain": 1.1}}, legs)
    with pytest.raises(ModelError, match="takes no time"):
        apply_reality(Plain(), {"left_lag": {"time_constant": 1.1}}, legs)
    with pytest.raises(ModelError, match="did you mean 'left_gain'"):
        apply_reality(Plain(), {"left_gian": {"gain": 1.1}})
    with pytest.raises(ModelError, match="outside"):
        apply_reality(Plain(), {"left_gain": {"gain": 1e9}})


def test_where_legs_are_taken_a_jump_acts_from_the_next_leg_on():
    legs = Channels(("left",), ("first",), prompt=("left", "first"))
    reality = {
        "left_parameter_step": {"time": 3.0, "factor": 0.5},
        "scale_step": {"time": 3.0, "change": 0.5},
    }
    model, read = apply_reality(Plain(), reality, legs)
    made = stepped(model, read, legs, 1, 0.0)
    made.begin([0])
    for time, factor in ((0.0, 1.0), (2.9, 1.0), (3.0, 0.5), (7.0, 0.5)):
        made.clock[:] = time
        assert made.given(np.array([[2.0]]))[0, 0] == 2.0 * factor
        assert made.change([0], 0.0)[0, 0] == 2.0 - factor


def test_scaled_to_data_it_keeps_its_slow_sensors_and_its_neutral_self():
    model = with_named(
        Plain(), {"first_lag": {"time_constant": 0.1}, "left_curve": {"value_1": 0.0, "value_4": 0.0}}
    )
    signals = {"left": 5.0 * U, "right": U, "first": Y, "second": Y}
    scaled = model.scaled_to([Recording(CLOCK, signals)])
    assert scaled.names == model.names
    assert scaled.effect("first_lag").parameters[0].nominal == 0.0
    low, high = (p.nominal for p in scaled.effect("left_curve").parameters[:2])
    assert (low, high) == pytest.approx(np.quantile(5.0 * U, [0.05, 0.95]))  # where the data are
    assert len(scaled.effect("left_curve").parameters) == 3 + 4
