"""Configs with samplers, end to end: training, evaluation, recording, and what is said of a wrong one."""

import json

import numpy as np
import pandas as pd
import pytest

from fieldagents.config import ConfigError, load_config
from fieldagents.evaluation.config import EvaluateConfig
from fieldagents.evaluation.evaluate import evaluate
from fieldagents.record.config import RecordConfig
from fieldagents.record.make import record
from fieldmodels.reality import read_reality
from fieldmodels.registry import get_model
from fieldmodels.yaml import load_yaml

ENVIRONMENT = """
  settings:
    timeout: {uniform: [0.5, 2.0]}
    starts: {choice: [T1, T2]}
  reality:
    actuator_lag: {time_constant: {log_uniform: [0.01, 0.2]}}
    yaw_slip: {share: {normal: [0.1, 0.1]}}
"""


def write(path, text):
    path.write_text(text)
    return path


def test_a_policy_trains_in_a_random_reality(tmp_path):
    """A few hundred steps; equal configs give equal policies, another distribution another policy."""
    pytest.importorskip("stable_baselines3")
    from fieldagents.learned.config import TrainConfig
    from fieldagents.learned.training import train

    text = (
        "name: random\ntask: pose_reaching\nseed: 1\nsteps: 512\nnum_envs: 4\n"
        "network: {hidden: [8]}\nvalidation: {every: 4, episodes: 4}\n"
        "learner: {n_steps: 32, batch_size: 64, n_epochs: 2}\nenvironment:" + ENVIRONMENT
    )
    config = load_config(write(tmp_path / "random.yaml", text), TrainConfig)
    runs = [train(config, progress=False, out=tmp_path / name) for name in ("a", "b")]
    assert (runs[0] / "policy.onnx").read_bytes() == (runs[1] / "policy.onnx").read_bytes()
    assert load_config(runs[0] / "config.yaml", TrainConfig) == config
    wider = text.replace("[0.01, 0.2]", "[0.2, 0.9]")
    other = train(
        load_config(write(tmp_path / "wider.yaml", wider), TrainConfig), progress=False, out=tmp_path / "c"
    )
    assert (runs[0] / "policy.onnx").read_bytes() != (other / "policy.onnx").read_bytes()


@pytest.mark.nightly
def test_agents_are_compared_in_equal_draws(tmp_path):
    text = (
        "name: random\ntask: pose_reaching\nagents: [graceful, path_memory_stop]\nbaseline: graceful\n"
        "episodes: 30\n"
        "environments:\n  random:" + ENVIRONMENT.replace("\n  ", "\n    ")
    )
    path = write(tmp_path / "random.yaml", text)
    for name in ("a", "b"):
        evaluate(load_config(path, EvaluateConfig), tmp_path / name)
    assert (tmp_path / "a/episodes.parquet").read_bytes() == (tmp_path / "b/episodes.parquet").read_bytes()
    said = json.loads((tmp_path / "a/summary.json").read_text())["environments"]["random"]
    assert said["reality"]["actuator_lag"] == {"time_constant": {"log_uniform": [0.01, 0.2]}}
    assert said["settings"]["timeout"] == {"uniform": [0.5, 2.0]}
    assert "log_uniform" in (tmp_path / "a/report.html").read_text()
    # Seeds fix start and draws, so both agents face the same shortest path in each episode.
    lengths = pd.read_parquet(tmp_path / "a/episodes.parquet").pivot_table(
        index="seed", columns="agent", values="dubins_length"
    )
    assert np.array_equal(lengths["graceful"], lengths["path_memory_stop"])


def test_a_recording_is_of_one_draw_and_says_which(tmp_path):
    text = (
        "name: drawn\nmodel: rig\nduration: 2\nseed: {seed}\n"
        "reality: {{coulomb_friction: {{force: {{uniform: [0.1, 0.9]}}}}}}\n"
    )
    drawn = []
    for seed in (1, 1, 2):
        path = write(tmp_path / "drawn.yaml", text.format(seed=seed))
        written = record(load_config(path, RecordConfig), tmp_path / str(len(drawn)))
        drawn.append(load_yaml(written["reality"])["effects"]["coulomb_friction"]["force"])
        fixed = read_reality(written["reality"], get_model("rig"))
        assert not fixed.random
    assert drawn[0] == drawn[1] != drawn[2]
    assert all(0.1 <= value <= 0.9 for value in drawn)


def test_wrong_samplers_are_named_with_their_line(tmp_path):
    text = (
        "name: wrong\ntask: pose_reaching\nagents: [graceful]\nepisodes: 10\nenvironments:\n  random:\n"
        "    settings:\n      max_speed: {uniform: [2, 1]}\n      tick: {uniform: [0.1, 0.2]}\n"
        "    reality:\n      yaw_slip: {share: {unifrom: [0, 1]}}\n"
    )
    with pytest.raises(ConfigError) as error:
        load_config(write(tmp_path / "wrong.yaml", text), EvaluateConfig)
    said = str(error.value)
    assert "wrong.yaml:8: environments.random.settings.max_speed" in said
    assert "smaller end first" in said
    assert "wrong.yaml:9: environments.random.settings.tick" in said
    assert "one value holds for all episodes" in said
    assert "wrong.yaml:11: environments.random.reality.yaw_slip" in said
    assert "did you mean 'uniform'" in said
