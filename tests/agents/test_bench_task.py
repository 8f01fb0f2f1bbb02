"""A bench of one's own in configs: trained for, evaluated, re-tuned."""

import numpy as np
import pytest
import yaml

from fieldagents.config import ConfigError, load_config
from fieldagents.evaluation.config import EvaluateConfig
from fieldagents.evaluation.evaluate import evaluate
from fieldagents.learned.config import TrainConfig
from fieldagents.learned.training import train
from fieldagents.retune.config import RetuneConfig
from fieldagents.retune.loop import retune
from fieldagents.retune.result import HIDDEN
from fieldgym import SettingsError, find_task
from fieldgym.bench import make_bench
from fieldmodels.model import ModelError

SHORT = {"duration": 1.0}
DELAY = {"actuator_delay": {"delay": 0.1}}
EXTENDED = {"schema": 1, "model": "pendulum", "effects": {"actuator_delay": {"delay": {"value": 0.1}}}}
OWN = """
from fieldmodels.effects import actuator
from fieldmodels.machine import Machine, number
from fieldmodels.model import Signal

print("this file was run")

class Cart(Machine):
    inputs = (Signal("force", "N"),)
    states = outputs = (Signal("speed", "m/s", noise=0.01),)
    mass = number("kg", 2.0, 0.1, 10.0)
    effects = actuator("force")

    def derivative(self, state, input, p):
        return (input.force - state.speed) / p.mass
"""


@pytest.fixture
def write(tmp_path):
    def written(name, data):
        path = tmp_path / name
        path.write_text(data if isinstance(data, str) else yaml.safe_dump(data))
        return path

    return written


def test_a_bench_is_trained_for_and_its_policy_takes_part(write, tmp_path):
    write("extended.yaml", EXTENDED)
    place = str(tmp_path / "extended.yaml")
    learner = {"n_steps": 32, "batch_size": 64}
    environment = {"settings": SHORT, "reality": place}
    config = {"name": "small", "task": place, "steps": 256, "num_envs": 4, "learner": learner}
    config |= {"environment": environment, "validation": {"every": 1, "episodes": 2}}
    folder = train(
        load_config(write("train.yaml", config), TrainConfig), progress=False, out=tmp_path / "run"
    )
    kept = yaml.safe_load((folder / "config.yaml").read_text())
    assert kept["task"] == "pendulum"
    assert kept["environment"]["reality"] == DELAY  # the file may change, the run does not
    config = {"name": "e", "task": "pendulum", "environments": {"late": environment}, "episodes": 3}
    config |= {"agents": ["still", str(folder)], "baseline": "still"}
    found = evaluate(load_config(write("evaluate.yaml", config), EvaluateConfig), tmp_path / "out")
    scores = {row.agent: row.scores["cost"].mean for row in found.scenarios["late"]}
    assert scores["still"] > 0
    assert scores[str(folder)] != scores["still"]


@pytest.mark.nightly
def test_what_was_tuned_in_the_right_simulation_loses_less(write, tmp_path):
    config = {"name": "late", "task": "pendulum", "agent": "feedback", "settings": {"duration": 2.0}}
    config |= {"options": {"rounds": 8, "episodes": 1}, "hidden": DELAY, "episodes": 4}
    loaded = load_config(write("retune.yaml", config), RetuneConfig)
    found = retune(loaded, write("extended.yaml", EXTENDED), tmp_path / "out")
    costs = {row.agent: row.scores["cost"].mean for row in found.evaluation.scenarios[HIDDEN]}
    assert costs["nominal"] > 3 * costs["retuned"]  # a delay makes the nominal gains oscillate
    assert costs["retuned"] == costs["oracle"]  # the same simulation, the same search


def test_cost_and_distance_are_those_of_what_is_observed():
    envs = find_task("rig").make_vec(3, settings={**SHORT, "noise": 0.0, "effort": 0.3}, reality=None)
    observation, _ = envs.reset(seed=5)
    rng, reach = np.random.default_rng(0), envs.unwrapped._task.reach
    for _ in range(20):
        action = rng.uniform(-1, 1, (3, 1)).astype(np.float32)
        observation, reward, _, _, info = envs.step(action)
        error = np.abs(observation[:, 0] - observation[:, -2]) / reach
        np.testing.assert_allclose(info["distance"], error, rtol=1e-4, atol=1e-6)
        np.testing.assert_allclose(info["cost"], np.minimum(error**2, 1) + 0.3 * action[:, 0] ** 2, rtol=1e-3)
        np.testing.assert_allclose(info["cost"], -reward)
        np.testing.assert_allclose(info["effort"], np.abs(action[:, 0]), rtol=1e-6)


def test_a_python_file_is_run_only_if_the_command_line_names_it(write, capsys):
    own = write("cart.py", OWN)
    path = write("train.yaml", {"name": "c", "task": str(own), "steps": 64, "num_envs": 2})
    with pytest.raises(ConfigError, match="only if the command line names it: --set task="):
        load_config(path, TrainConfig)
    sly = write("sly.yaml", {"model": str(own)})
    with pytest.raises(ConfigError, match="only if you name it yourself"):
        load_config(path, TrainConfig, [f"task={sly}"])
    with pytest.raises(ModelError, match="only if you name it yourself"):
        make_bench(sly)
    assert "this file was run" not in capsys.readouterr().err
    assert load_config(path, TrainConfig, [f"task={own}", "learner.n_steps=4", "learner.batch_size=8"])
    assert "this file was run" in capsys.readouterr().err


@pytest.mark.every(
    ("task", "message"),
    [("pendulm", "did you mean 'pendulum'"), ("differential_drive", "no Machine"), ("no.yaml", "no.yaml")],
)
def test_a_task_that_is_none_is_refused(write, task, message):
    with pytest.raises(ConfigError, match=message):
        load_config(write("t.yaml", {"name": "c", "task": task, "steps": 64}), TrainConfig)


def test_a_bench_without_a_machine_is_refused():
    with pytest.raises(SettingsError, match="which bench"):
        make_bench()
