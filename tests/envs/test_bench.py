"""Any machine as an environment: the same simulation as the model's, in steps."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from fieldgym.bench import as_env
from fieldgym.settings import SettingsError
from fieldmodels.effects import actuator, curve, friction, sensor
from fieldmodels.machine import Machine, number
from fieldmodels.model import ModelError, Signal
from fieldmodels.recording import Recording, Windows

SETTINGS = {"duration": 1.0, "noise": 0.0}


class Motor(Machine):
    """Speed of a motor: time_constant dw/dt = gain u - w."""

    inputs = (Signal("voltage", "V"),)
    states = outputs = (Signal("speed", "rad/s", noise=0.2),)
    gain = number("rad/s/V", 10.0, 0.0, 1e3)
    time_constant = number("s", 0.1, 0.01, 10.0)
    effects = actuator("voltage") + friction("speed") + sensor("speed") + curve("force", "speed")

    def derivative(self, state, input, p):
        return (p.gain * input.voltage - state.speed) / p.time_constant


REALITIES = {
    "nominal": {},
    "friction": {"coulomb_friction": {"rate": 20.0}},
    "late": {"actuator_lag": {"time_constant": 0.013}, "actuator_delay": {"delay": 0.017}},
    "play": {"actuator_play": {"width": 0.4}, "actuator_rate_limit": {"rate": 30.0}},
    "sensor": {"sensor_gain": {"gain": 1.1}, "sensor_lag": {"time_constant": 0.02}},
    "curve": {"speed_curve": {f"value_{i}": float(v) for i, v in enumerate([9, 4, 1, 0, 0, -1, -4, -9], 1)}},
}


def flown(env, seed=3, steps=80):
    """Commands and observations of one episode under random actions."""
    rng = np.random.default_rng(seed)
    observation, _ = env.reset(seed=seed)
    seen, commands, action = [observation[:1]], [], np.zeros(1)
    for k in range(steps):
        action = rng.uniform(-1, 1, 1) if k % 5 == 0 else action
        observation, _, terminated, _, info = env.step(action.astype(np.float32))
        assert not terminated
        seen.append(observation[:1])
        commands.append(np.atleast_1d(info["command"]))
    return np.array(commands), np.array(seen)


@pytest.mark.every("reality", REALITIES)
def test_an_episode_is_what_the_model_predicts_of_its_record(reality):
    machine = Motor()
    commands, seen = flown(as_env(machine, SETTINGS, REALITIES[reality]))
    n = len(commands)
    record = Recording(np.arange(n) * 0.01, {"voltage": commands[:, 0], "speed": seen[:n, 0].astype(float)})
    whole = Windows(record, np.array([0]), np.array([n]), np.zeros((1, 1)), np.ones((1, n, 1), dtype=bool))
    predicted = machine.simulate(machine.vector(effects=REALITIES[reality])[None], whole)[0, 0]
    np.testing.assert_allclose(seen[:n], predicted, atol=2e-6 * np.abs(predicted).max())
    nominal = machine.simulate(machine.nominal[None], whole)[0, 0]
    assert (np.abs(predicted - nominal).max() > 1e-2) == (reality != "nominal")


@pytest.mark.matrix(
    keep=(
        "rig",
        "pendulum",
        "Motor",
    )
)
@pytest.mark.parametrize("machine", ["rig", "pendulum", "propeller_arm", "servo", Motor])
def test_the_contract_of_gymnasium(machine):
    env = as_env(machine if isinstance(machine, str) else machine(), SETTINGS)
    check_env(env, skip_render_check=True)


def test_rows_of_the_vector_form_are_the_scalar_one_to_the_bit():
    reality = REALITIES["late"]
    rows = as_env("rig", {"duration": 0.3, "start": 0.5}, {**reality}, num_envs=3)
    singles = [as_env("rig", {"duration": 0.3, "start": 0.5}, {**reality}) for _ in range(3)]
    first, _ = rows.reset(seed=5)
    others = [env.reset(seed=5 + i)[0] for i, env in enumerate(singles)]
    np.testing.assert_array_equal(first, others)
    rng = np.random.default_rng(0)
    for _ in range(25):
        actions = rng.uniform(-1, 1, (3, 1)).astype(np.float32)
        stepped, reward, *_ = rows.step(actions)
        for i, env in enumerate(singles):
            observation, own, *_ = env.step(actions[i])
            np.testing.assert_array_equal(stepped[i], observation)
            assert reward[i] == own


def test_a_random_reality_is_drawn_for_each_episode_and_told():
    reality = {"actuator_gain": {"gain": {"uniform": [0.5, 1.5]}}}
    env = as_env(Motor(), SETTINGS | {"fastest": {"choice": [0.3, 0.6]}}, reality)
    gains = []
    for seed in range(4):
        _, info = env.reset(seed=seed)
        drawn = info["privileged.reality.actuator_gain.gain"]
        gains.append(drawn)
        fixed = as_env(Motor(), SETTINGS, {"actuator_gain": {"gain": drawn}})
        fixed.reset(seed=0)
        action = np.full(1, 0.5, dtype=np.float32)
        assert env.step(action)[0][0] == fixed.step(action)[0][0]
    assert len(set(gains)) == 4
    assert 0.5 <= min(gains) <= max(gains) <= 1.5
    with pytest.raises(SettingsError, match="reach"):
        as_env(Motor(), {"reach": {"uniform": [1, 2]}})


def test_a_snapshot_goes_on_to_the_bit():
    env = as_env(Motor(), {"duration": 1.0}, REALITIES["late"])
    flown(env, steps=20)
    state = env.get_state()
    action = np.array([0.7], dtype=np.float32)
    after = [env.step(action)[0] for _ in range(10)]
    env.reset(seed=9)
    env.set_state(state)
    np.testing.assert_array_equal(after, [env.step(action)[0] for _ in range(10)])


def test_an_episode_ends_in_time_and_an_escape_pays_for_the_rest():
    env = as_env(Motor(), {"duration": 0.5, "reach": 0.5, "escape": 2.0})
    env.reset(seed=0)
    total, steps, terminated, truncated = 0.0, 0, False, False
    while not (terminated or truncated):
        _, reward, terminated, truncated, _ = env.step(np.ones(1, dtype=np.float32))
        total, steps = total + reward, steps + 1
    assert terminated
    assert steps < 50
    assert -51 <= total <= -(50 - steps)
    env = as_env(Motor(), {"duration": 0.05})
    env.reset(seed=0)
    assert [env.step(np.zeros(1, dtype=np.float32))[3] for _ in range(5)] == [False] * 4 + [True]


def test_a_picture():
    env = as_env("pendulum", SETTINGS, render_mode="rgb_array")
    env.reset(seed=1)
    env.step(env.action_space.sample())
    frame = env.render()
    assert frame.shape == (540, 960, 3)
    assert frame.std() > 5


def test_what_cannot_be_is_said():
    with pytest.raises(SettingsError, match=r"no output 'sped'.*speed"):
        as_env(Motor(), {"track": "sped"})
    with pytest.raises(ModelError, match="no effect 'frction'"):
        as_env(Motor(), reality={"frction": {}})
    with pytest.raises(SettingsError, match="no Machine"):
        as_env("heel_strike")
    assert isinstance(as_env("rig", num_envs=2), gymnasium.vector.VectorEnv)


EXTENDED = """\
schema: 1
model: rig
parameters: {mass: {value: 2.5, std: 0.01, unit: kg}}
effects:
  coulomb_friction: {force: {value: 0.7, std: 0.02, unit: N}}
"""


def test_a_diagnosed_bench_is_made_by_gymnasium_in_its_extended_simulation(tmp_path):
    path = tmp_path / "extended.yaml"
    path.write_text(EXTENDED)
    env = gymnasium.make("fieldgym/Bench-v0", config=path, settings=SETTINGS)
    check_env(env.unwrapped, skip_render_check=True)
    given = as_env("rig", SETTINGS, {"parameters": {"mass": 2.5}, "coulomb_friction": {"force": 0.7}})
    nominal = as_env("rig", SETTINGS)
    seen, expected, other = (flown(e.unwrapped)[1] for e in (env, given, nominal))
    np.testing.assert_array_equal(seen, expected)
    assert np.abs(seen - other).max() > 1e-4
    many = gymnasium.make_vec("fieldgym/Bench-v0", num_envs=3, config=path, settings=SETTINGS)
    assert many.reset(seed=1)[0].shape == (3, 4)
    gymnasium.make("fieldgym/Bench-v0", config=path, machine="rig").close()


def test_a_bench_file_without_a_model_is_refused(tmp_path):
    path = tmp_path / "extended.yaml"
    path.write_text("effects: {}\n")
    with pytest.raises(ModelError, match="names no machine"):
        gymnasium.make("fieldgym/Bench-v0", config=path)


def test_an_agent_is_trained_in_a_diagnosed_bench(tmp_path):
    baselines = pytest.importorskip("stable_baselines3")
    (tmp_path / "extended.yaml").write_text(EXTENDED)
    env = gymnasium.make("fieldgym/Bench-v0", config=tmp_path / "extended.yaml", settings=SETTINGS)
    agent = baselines.PPO("MlpPolicy", env, n_steps=64, batch_size=32, seed=0)
    before = [p.clone() for p in agent.policy.parameters()]
    agent.learn(128)
    assert any((a != b).any() for a, b in zip(before, agent.policy.parameters(), strict=True))
