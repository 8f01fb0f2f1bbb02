"""What holds for both benches: rig and pendulum share one kernel."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fieldmodels.machines.one_axis.model import OneAxis
from fieldmodels.model import Model, ModelError
from fieldmodels.recording import Recording, Windows
from fieldmodels.registry import get_model, model_names
from fieldmodels.synthesis import synthesise

STEP = 0.01
BENCHES = ("rig", "pendulum")


def bench(name: str) -> OneAxis:
    model = get_model(name)
    assert isinstance(model, OneAxis)
    return model


def recording(model: Model, command: np.ndarray, step: float = STEP) -> Recording:
    return Recording(
        time=np.arange(len(command)) * step,
        signals={model.inputs[0].name: command} | {o.name: np.zeros(len(command)) for o in model.outputs},
    )


def one_window(
    model: Model, command: np.ndarray, state: tuple[float, float] = (0.0, 0.0), step: float = STEP
) -> Windows:
    n = len(command)
    return Windows(
        recording=recording(model, command, step),
        starts=np.array([0]),
        lengths=np.array([n]),
        states=np.array([state]),
        observed=np.ones((1, n, 2), dtype=bool),
    )


def run(model, command, effects=None, base=None, state=(0.0, 0.0), step=STEP):
    windows = one_window(model, command, state, step)
    return model.simulate(model.vector(base, effects)[None, :], windows)[0, 0]


def wave(model: Model, n: int = 300, seed: int = 0) -> np.ndarray:
    """A lively command of the bench's usual size."""
    rng = np.random.default_rng(seed)
    return {"rig": 6.0, "pendulum": 0.5}[model.name] * np.repeat(rng.uniform(-1, 1, n // 10 + 1), 10)[:n]


def typical(model: OneAxis) -> dict[str, dict[str, float]]:
    """Every effect at a size that shows."""
    values = {}
    for effect in model.effects:
        values[effect.name] = {p.name: p.starts[-1] for p in effect.parameters}
    values["parameter_step"] = {"time": 1.0, "factor": 0.8}
    values["actuator_saturation"] = {"limit": 0.3 * float(np.max(wave(model)))}
    values["actuator_dead_zone"] = {"width": 0.2 * float(np.max(wave(model)))}
    return values


EFFECTS = [(name, effect.name) for name in BENCHES for effect in bench(name).effects]


def nominal_rest(model):
    if model.name == "rig":
        return 2.0, lambda x, v: -4.0 * v - 80.0 * x
    return 0.0626, lambda x, v: -1.0 * np.sin(x)


@pytest.mark.every(("name", "effect"), EFFECTS)
def test_an_effect_changes_the_output_and_its_neutral_values_do_not(name, effect):
    model = bench(name)
    command = wave(model)
    nominal = run(model, command)
    values = typical(model)[effect]
    assert np.abs(run(model, command, {effect: values}) - nominal).max() > 1e-4 * np.abs(nominal).max()
    off = {p.name: p.nominal for p in model.effect(effect).parameters}
    np.testing.assert_array_equal(run(model, command, {effect: off}), nominal)
    # The first parameter switches the effect, whatever the others are (the step's is its factor).
    switches = {
        "periodic_force": ("sine", "cosine"),
        "cogging": ("sine", "cosine"),
        "parameter_step": ("factor",),
    }
    for switch in switches.get(effect, (model.effect(effect).parameters[0].name,)):
        values[switch] = off[switch]
    np.testing.assert_array_equal(run(model, command, {effect: values}), nominal)


@pytest.mark.every("name", BENCHES)
def test_a_row_of_a_batch_equals_the_same_simulation_alone_to_the_bit(name):
    model = bench(name)
    data = synthesise(model, None, "swing", duration=3.0, amplitude=0.1, rng=np.random.default_rng(0))
    windows = model.windows(data, 0.3)
    batch = np.array([model.vector(effects={effect: values}) for effect, values in typical(model).items()])
    together = model.simulate(batch, windows)
    for i in range(len(batch)):
        np.testing.assert_array_equal(model.simulate(batch[i : i + 1], windows)[0], together[i])
    for w in (0, len(windows) - 1):
        alone = model.simulate(batch, windows.select(np.array([w])))
        np.testing.assert_array_equal(alone[:, 0], together[:, w])


@pytest.mark.every("name", BENCHES)
def test_mirrored_commands_give_mirrored_motion(name):
    model = bench(name)
    command = wave(model)
    one_sided = {
        "constant_force",
        "periodic_force",
        "cogging",
        "asymmetric_damping",
        "actuator_asymmetry",
        "sensor_bias",
        "sensor_drift",
    }
    effects = {k: v for k, v in typical(model).items() if k not in one_sided | {"sensor_quantisation"}}
    # Some kinds of rounding know a direction: all but equal to the bit.
    np.testing.assert_allclose(run(model, -command, effects), -run(model, command, effects), atol=1e-14)


@pytest.mark.every("name", BENCHES)
@pytest.mark.every("delay", [0.03, 0.0237])
def test_a_delay_shifts_the_response_and_sensor_delay_shows_the_velocity_in_time(name, delay):
    model = bench(name)
    command = np.concatenate([np.zeros(20), wave(model, 200)])
    fine = np.repeat(command, 100)  # 0.1 ms: both delays are whole numbers of it
    prompt = run(model, fine, step=STEP / 100)
    shift = round(delay / STEP * 100)
    expected = np.vstack([np.zeros((shift, 2)), prompt])[: len(fine) : 100]
    scale = np.abs(prompt).max(axis=0)
    late = run(model, command, {"actuator_delay": {"delay": delay}})
    np.testing.assert_allclose(late / scale, expected / scale, atol=3e-6)
    seen = run(model, command, {"sensor_delay": {"delay": delay}})
    np.testing.assert_allclose(seen[:, 0] / scale[0], expected[:, 0] / scale[0], atol=3e-6)
    np.testing.assert_allclose(seen[:, 1] / scale[1], prompt[::100, 1] / scale[1], atol=3e-6)


@pytest.mark.every("name", BENCHES)
@pytest.mark.every(
    "effects",
    [
        {"actuator_delay": {"delay": 0.0137}},
        {"actuator_lag": {"time_constant": 0.05}},
        {"actuator_lag": {"time_constant": 0.05}, "actuator_delay": {"delay": 0.0237}},
    ],
)
def test_a_window_remembers_the_commands_before_it(name, effects):
    model = bench(name)
    command = wave(model)
    whole = run(model, command, effects)
    later = replace(
        one_window(model, command),
        starts=np.array([100]),
        lengths=np.array([200]),
        states=whole[100:101],
        observed=np.ones((1, 200, 2), dtype=bool),
    )
    got = model.simulate(model.vector(effects=effects)[None, :], later)[0, 0]
    np.testing.assert_allclose(got, whole[100:], atol=1e-9 * np.abs(whole).max())


@pytest.mark.every("name", BENCHES)
def test_window_states_are_what_the_sensors_show(name):
    model = bench(name)
    command = wave(model)
    for effect in ("sensor_gain", "sensor_drift", "backlash"):
        values = {effect: typical(model)[effect]}
        out = run(model, command, values, state=(0.05, 0.1))
        assert out[0, 0] == pytest.approx(0.05, abs=1e-12), effect


@pytest.mark.every("name", BENCHES)
def test_coulomb_friction_holds_and_slides(name):
    model = bench(name)
    f = model.forces[0].name
    restless = run(model, np.full(200, 0.099), {"coulomb_friction": {f: 0.1}})
    np.testing.assert_array_equal(restless, 0.0)
    # Sliding at F_c below the command equals no friction under the difference, until it turns.
    pushed = run(model, np.full(10, 0.3), {"coulomb_friction": {f: 0.1}})
    np.testing.assert_allclose(pushed, run(model, np.full(10, 0.2)), atol=1e-12)
    # Released from a deflection, it comes to a full stop off its middle.
    released = run(model, np.zeros(1500), {"coulomb_friction": {f: 0.1}}, state=(0.4, 0.0))
    assert released[-1, 1] == 0.0
    assert released[-1, 0] != 0.0
    np.testing.assert_array_equal(released[-1], released[-100])


@pytest.mark.every("name", BENCHES)
def test_sampling_finer_does_not_change_coulomb_motion(name):
    model = bench(name)
    f = model.forces[0].name
    command = wave(model, 200)
    effects = {"coulomb_friction": {f: 0.3 * float(np.abs(command).max())}}
    coarse = run(model, command, effects)
    fine = run(model, np.repeat(command, 50), effects, step=STEP / 50)[::50]
    scale = np.abs(fine).max(axis=0)
    np.testing.assert_allclose(coarse / scale, fine / scale, atol=1e-3)


@pytest.mark.every("name", BENCHES)
def test_hysteresis_remembers_the_path_before_a_window(name):
    model = bench(name)
    command = wave(model)
    values = {model.forces[0].name: 0.3 * float(np.abs(command).max()), "distance": 0.05}
    whole = run(model, command, {"hysteresis": values})
    later = replace(
        one_window(model, command),
        starts=np.array([100]),
        lengths=np.array([200]),
        states=whole[100:101],
        observed=np.ones((1, 200, 2), dtype=bool),
    )
    position = model.outputs[0].name
    later = replace(
        later,
        recording=replace(later.recording, signals={**later.recording.signals, position: whole[:, 0].copy()}),
    )
    got = model.simulate(model.vector(effects={"hysteresis": values})[None, :], later)[0, 0]
    scale = np.abs(whole).max(axis=0)
    np.testing.assert_allclose(got / scale, whole[100:] / scale, atol=5e-3)


@pytest.mark.every("name", BENCHES)
def test_stribeck_friction_holds_and_is_coulomb_friction_where_its_speed_is_never_reached(name):
    model = bench(name)
    f = model.forces[0].name
    size = float(np.abs(wave(model)).max())
    friction = {f: 0.2 * size, "velocity": 0.3 * model.nominal_scales.velocity}
    held = run(model, np.full(50, 0.19 * size), {"stribeck_friction": friction})
    np.testing.assert_array_equal(held, 0.0)
    command = wave(model)
    slow = run(model, command, {"stribeck_friction": {f: 0.2 * size, "velocity": 1e9}})
    np.testing.assert_array_equal(slow, run(model, command, {"coulomb_friction": {f: 0.2 * size}}))


@pytest.mark.every("name", BENCHES)
def test_friction_that_differs_by_direction_is_coulomb_friction_with_a_constant_force(name):
    """So the library has no effect of its own for it; here it is integrated for itself, with sticking."""
    model = bench(name)
    f = model.forces[0].name
    command = wave(model, 200)
    forwards, backwards = (share * float(np.abs(command).max()) for share in (0.35, 0.1))
    inertia, rest = nominal_rest(model)
    x = v = 0.0
    h, fine = STEP / 400, []
    for i in range(len(command) * 400):
        if i % 400 == 0:
            fine.append((x, v))
        free = command[i // 400] + rest(x, v)
        if v == 0.0:
            total = free - forwards if free > forwards else free + backwards if free < -backwards else 0.0
        else:
            total = free - forwards if v > 0.0 else free + backwards
        new = v + h * total / inertia
        v = 0.0 if new * v < 0.0 else new
        x += h * v
    fine = np.array(fine)
    together = {
        "coulomb_friction": {f: 0.5 * (forwards + backwards)},
        "constant_force": {f: -0.5 * (forwards - backwards)},
    }
    scale = np.abs(fine).max(axis=0)
    np.testing.assert_allclose(run(model, command, together) / scale, fine / scale, atol=5e-3)
    assert np.sum(fine[:, 1] == 0.0) > 10


@pytest.mark.every("name", BENCHES)
def test_initial_states_are_close_with_and_without_a_velocity_sensor(name):
    model = bench(name)
    rng = np.random.default_rng(3)
    data = synthesise(model, None, "swing", duration=10.0, amplitude=0.3, rng=rng, noise=0.1)
    truth = synthesise(
        model, None, "swing", duration=10.0, amplitude=0.3, rng=np.random.default_rng(3), noise=False
    )
    starts = np.array([0, 1, 200, 500, 999])
    bare = replace(data, signals={k: v for k, v in data.signals.items() if k != "velocity"})
    for measured in (data, bare):
        states = model.initial_states(measured, starts)
        for j, signal in enumerate(model.outputs):
            span = np.ptp(truth[signal.name])
            assert np.abs(states[2:, j] - truth[signal.name][starts[2:]]).max() < 0.03 * span
            assert np.abs(states[:2, j] - truth[signal.name][starts[:2]]).max() < 0.1 * span


def test_scales_of_a_small_bench_are_found_from_its_data():
    """A bench of grams and micrometres: the starts fit it, though the nominal values are kilograms."""
    rig = bench("rig")
    base = {"mass": 3e-3, "damping": 2e-2, "stiffness": 1.5}
    data = synthesise(
        rig, {"parameters": base}, "multisine", amplitude=1e-3, duration=20.0,
        rng=np.random.default_rng(0), noise={"position": 1e-6, "velocity": 2e-5},
    )  # fmt: skip
    scaled = rig.scaled_to([data])
    for parameter in scaled.parameters:
        assert parameter.starts[0] == pytest.approx(base[parameter.name], rel=0.2)
    assert scaled.outputs[0].noise == pytest.approx(1e-6, rel=0.1)
    assert scaled.names == rig.names
    np.testing.assert_array_equal(scaled.nominal, rig.nominal)


def test_the_registry_knows_its_models_and_helps_with_a_slip():
    assert {"rig", "pendulum", "heel_strike"} <= set(model_names())
    with pytest.raises(ModelError, match="did you mean 'pendulum'"):
        get_model("pendulm")


def test_scales_and_windows_of_a_long_recording_take_no_long_time_or_memory():
    rig = bench("rig")
    reality = {"periodic_force": {"sine": 0.3, "frequency": 1.7}}
    data = synthesise(
        rig, reality, "steps", duration=3000.0, amplitude=8.0, refine=1, rng=np.random.default_rng(0)
    )
    scaled = rig.scaled_to([data])
    assert min(abs(f - 1.7) for f in scaled.scales.frequencies) < 1e-3
    assert len(scaled.windows(data, 0.5)) == 3000 // 0.51


def test_the_pages_name_every_effect_and_parameter():
    """Stock effects have their parameters on the page of realities, as effects of a command or a sensor."""
    docs = Path(__file__).parents[2] / "docs"
    models, realities = ((docs / f"{name}.md").read_text() for name in ("models", "realities"))
    rows = [line for line in f"{models}\n{realities}".splitlines() if line.startswith("| `")]
    for name in BENCHES:
        for effect in bench(name).effects:
            assert f"`{effect.name}`" in models
            stock = effect.name.replace("actuator_", "u_").replace("sensor_", "y_")
            own = [row for row in rows if f"`{effect.name}`" in row or f"`{stock}`" in row]
            for parameter in effect.parameters:
                assert any(f"`{parameter.name}`" in row for row in own), (effect.name, parameter.name)
