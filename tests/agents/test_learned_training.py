"""Training from a config: the run folder, exact resume, export, and clear errors."""

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pandas as pd
import pytest

pytest.importorskip("stable_baselines3")

import torch
from packaging.version import Version
from stable_baselines3.common.vec_env import VecNormalize

from fieldagents.agent import AgentError
from fieldagents.config import ConfigError, load_config
from fieldagents.evaluation.agents import make_agent
from fieldagents.learned import training
from fieldagents.learned.checkpoint import CheckpointError, load_checkpoint, save_checkpoint, to_arrays
from fieldagents.learned.config import TrainConfig
from fieldagents.learned.publish import publish
from fieldagents.learned.recorder import plateau
from fieldagents.learned.training import TrainingError, train
from fieldagents.policies.policy import OnnxAgent, PolicyError
from fieldagents.policies.zoo import ZooError, list_zoo
from fieldmodels.extras import MissingExtraError
from fieldmodels.yaml import save_yaml

TINY = {
    "name": "tiny",
    "task": "heel_strike",
    "seed": 1,
    "steps": 640,
    "num_envs": 4,
    "checkpoint_every": 1,
    # episodes of 9 strides end inside, at the end of and across the rounds of 16 steps
    "environment": {"settings": {"strides": 9}},
    "network": {"hidden": [8]},
    "normalise": {"reward": True},
    "validation": {"every": 3, "episodes": 4},
}
ON_POLICY = {"n_steps": 16, "batch_size": 32, "n_epochs": 2, "learning_rate_decay": "linear"}
# the buffer's 80 rows are written twice; the first checkpoints hold random actions only
OFF_POLICY = {
    "buffer_size": 320,
    "learning_starts": 150,
    "batch_size": 32,
    "train_freq": 2,
    "gradient_steps": 2,
    "n_steps": 3,
    "learning_rate_decay": "linear",
}
RUNS = {
    "ppo": {"learner": ON_POLICY},
    "stacked": {"learner": ON_POLICY, "stack": 3},
    "imitating": {
        "learner": ON_POLICY,
        "stack": 2,
        "also": [{"settings": {"collision_kind": "low_pass"}}],
        "imitate": {"teacher": "oracle_gains", "rounds": 2, "steps": 12, "batch_size": 16},
        "validation": {"every": 3, "episodes": 4, "by": "return"},
    },
    "recurrent_ppo": {
        "learner": ON_POLICY,
        "policy": "MlpLstmPolicy",
        "network": {"hidden": [8], "more": {"lstm_hidden_size": 6, "n_lstm_layers": 2}},
    },
    "annealed": {
        "learner": {**ON_POLICY, "stds": [0.3, 0.03], "critic": 0.5},
        "algorithm": "fieldagents.learned.annealed:AnnealedPPO",
    },
    "sac": {"learner": OFF_POLICY, "round_updates": 8},
    "td3": {"learner": OFF_POLICY, "round_updates": 8},
    "tqc": {"learner": OFF_POLICY, "round_updates": 8, "algorithm": "sb3_contrib.tqc.tqc:TQC"},
}
"""A run of each kind: on-policy and off-policy, with and without a memory, by name and by import path."""

ALGORITHMS = {"stacked": "ppo", "imitating": "ppo"}


def tiny(kind="ppo", **changes) -> TrainConfig:
    return TrainConfig(**{**TINY, "algorithm": ALGORITHMS.get(kind, kind), **RUNS[kind], **changes})


class Killed(BaseException):
    """Stands in for the end of the process."""


@pytest.fixture(scope="module")
def finished_runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    return {name: train(tiny(name), progress=False, out=folder / name) for name in RUNS}


@pytest.fixture(params=RUNS)
def algorithm(request):
    return request.param


@pytest.fixture
def finished_each(finished_runs, algorithm):
    """The finished run of each algorithm in turn."""
    return finished_runs[algorithm]


@pytest.fixture
def finished(finished_runs):
    """The finished run of PPO, where the algorithm does not matter."""
    return finished_runs["ppo"]


def test_the_run_folder_holds_what_it_promises(finished_each, algorithm):
    finished = finished_each
    names = {path.name for path in finished.iterdir()}
    remembers = algorithm in ("stacked", "imitating", "annealed")  # or has code of its own
    assert names == (set() if remembers else {"policy.zip", "vecnormalize.pkl"}) | {
        "config.yaml",
        "versions.json",
        "curve.csv",
        "checkpoints",
        "policy.onnx",
        "run.json",
        "tensorboard",
    }
    assert load_config(finished / "config.yaml", TrainConfig) == tiny(algorithm)
    version = json.loads((finished / "versions.json").read_text())["torch"]
    assert Version(version).public == Version(torch.__version__).public  # builds differ: 2.13.0+cu130
    curve = pd.read_csv(finished / "curve.csv")
    before = [0] if algorithm == "imitating" else []
    assert list(curve["steps"]) == before + list(range(64, 641, 64))
    assert list(curve.loc[curve["validation_return"].notna(), "steps"]) == [*before, 192, 384, 576, 640]
    run = json.loads((finished / "run.json").read_text())
    best = curve["validation_return"].idxmax()
    if tiny(algorithm).validation.by == "metric":
        best = curve["validation_error_mm"].idxmin()
    assert run["best_steps"] == curve["steps"][best]
    assert run["validation_return"] == curve["validation_return"][best]
    assert len(list((finished / "checkpoints").glob("*.pt"))) == 3
    assert list((finished / "tensorboard").glob("events*"))


def assert_equal_runs(one, other):
    for name in ("curve.csv", "policy.onnx"):
        assert (one / name).read_bytes() == (other / name).read_bytes(), name
    last = [load_checkpoint(sorted((run / "checkpoints").glob("*.pt"))[-1]) for run in (one, other)]
    assert_equal_state(*last)


def assert_equal_state(one, other):
    assert type(one) is type(other)
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        for key in one:
            assert_equal_state(one[key], other[key])
    elif isinstance(one, list):
        assert len(one) == len(other)
        for left, right in zip(one, other, strict=True):
            assert_equal_state(left, right)
    elif isinstance(one, torch.Tensor):
        assert one.dtype == other.dtype
        assert one.numpy().tobytes() == other.numpy().tobytes()
    else:
        assert one == other


@pytest.mark.matrix(
    keep=(
        "stacked",
        "annealed",
    )
)
def test_equal_seeds_train_equally_and_others_do_not(finished_each, algorithm, tmp_path):
    assert_equal_runs(finished_each, train(tiny(algorithm), progress=False, out=tmp_path / "again"))
    other = train(tiny(algorithm, seed=2), progress=False, out=tmp_path / "other")
    assert (finished_each / "policy.onnx").read_bytes() != (other / "policy.onnx").read_bytes()


@pytest.mark.matrix(
    keep=(
        "ppo-kills1",
        "stacked-kills0",
        "annealed-kills1",
        "td3-kills1",
    )
)
@pytest.mark.parametrize("kills", [(1, 4), (5,)])
def test_a_killed_run_resumes_bit_for_bit(finished_each, algorithm, tmp_path, monkeypatch, kills):
    from fieldagents.learned import recorder

    run = tmp_path / "run"
    resume = None
    for kill in kills:
        saved = []

        def save_and_die(state, path, saved=saved, kill=kill):
            save_checkpoint(state, path)
            saved.append(path)
            if len(saved) == kill:
                raise Killed

        monkeypatch.setattr(recorder, "save_checkpoint", save_and_die)
        with pytest.raises(Killed):
            train(tiny(algorithm), progress=False, resume=resume, out=None if resume else run)
        resume = run
        # what other work does to the global streams meanwhile must not matter
        torch.manual_seed(99)
        np.random.seed(99)  # noqa: NPY002
    monkeypatch.setattr(recorder, "save_checkpoint", save_checkpoint)
    train(tiny(algorithm), progress=False, resume=run)
    assert_equal_runs(finished_each, run)


@pytest.mark.every("kind", ["ppo", "sac", "recurrent_ppo"])
def test_what_stable_baselines3_takes_acts_as_the_exported_policy_does(finished_runs, kind, tmp_path):
    run = finished_runs[kind]
    pair = make_agent(f"{run}/policy.zip+{run}/vecnormalize.pkl", "heel_strike", {}, trust_pickle=True).runs[
        0
    ]
    exported = OnnxAgent(run / "policy.onnx")
    rng = np.random.default_rng(0)
    for step in range(3):
        seen = rng.uniform(-1, 1, (4, 6)).astype(np.float32)
        for one in (pair, exported):
            one.begin_episodes(np.full(4, step == 0))
        np.testing.assert_allclose(pair.act(seen, {}), exported.act(seen, {}), atol=1e-5)
    with pytest.raises(AgentError, match="trust-pickle"):
        make_agent(f"{run}/policy.zip+{run}/vecnormalize.pkl", "heel_strike", {})
    with pytest.raises(AgentError, match="no such file"):
        make_agent(f"{run}/policy.zip+{run}/no.pkl", "heel_strike", {}, trust_pickle=True)
    (tmp_path / "other.pkl").write_bytes(b"no pickle")
    with pytest.raises(PolicyError, match="not the statistics"):
        make_agent(f"{run}/policy.zip+{tmp_path}/other.pkl", "heel_strike", {}, trust_pickle=True)


@pytest.mark.every("number", [signal.SIGTERM, signal.SIGINT])
def test_a_run_that_is_asked_to_stop_keeps_a_checkpoint(finished, tmp_path, monkeypatch, number):
    from fieldagents.learned.checkpoint import checkpoints
    from fieldagents.learned.recorder import Recorder

    validate = Recorder._validate

    def asked_meanwhile(recorder):
        os.kill(os.getpid(), number)
        return validate(recorder)

    monkeypatch.setattr(Recorder, "_validate", asked_meanwhile)
    with pytest.raises(KeyboardInterrupt, match=f"go on with --resume {tmp_path / 'run'}"):
        train(tiny(), progress=False, out=tmp_path / "run")
    assert len(checkpoints(tmp_path / "run" / "checkpoints")) == 3
    monkeypatch.setattr(Recorder, "_validate", validate)
    assert_equal_runs(finished, train(tiny(), progress=False, resume=tmp_path / "run"))


def test_a_damaged_file_of_a_run_is_named(tmp_path):
    save_yaml(tiny().model_dump(mode="json"), tmp_path / "config.yaml")
    (tmp_path / "versions.json").write_text("{half")
    with pytest.raises(TrainingError, match=r"versions\.json: damaged"):
        train(tiny(), progress=False, resume=tmp_path)
    (tmp_path / "versions.json").unlink()
    save_checkpoint({"steps": 16}, tmp_path / "checkpoints" / "000000000016.pt")
    with pytest.raises(CheckpointError, match="not checkpoints of this config: KeyError: 'networks'"):
        train(tiny(), progress=False, resume=tmp_path)


def test_a_damaged_learning_curve_is_named(finished, tmp_path):
    run = tmp_path / "run"
    shutil.copytree(finished, run)
    (run / "run.json").unlink()
    (run / "curve.csv").write_text("steps\nmany\n")
    with pytest.raises(CheckpointError, match=r"curve\.csv: not the learning curve of this run"):
        train(tiny(), progress=False, resume=run)


def test_a_run_killed_before_its_first_checkpoint_begins_anew(finished, tmp_path):
    save_yaml(tiny().model_dump(mode="json"), tmp_path / "config.yaml")
    assert_equal_runs(finished, train(tiny(), progress=False, resume=tmp_path))


@pytest.mark.nightly
def test_a_process_killed_by_the_system_resumes_bit_for_bit(tmp_path):
    config = tmp_path / "tiny.yaml"
    run = tmp_path / "run"
    changed = {"steps": 64 * 16, "validation": {"every": 20, "episodes": 2}}
    save_yaml({**TINY, **RUNS["ppo"], **changed}, config)
    script = (
        "import sys; from pathlib import Path; from fieldagents.config import load_config;"
        "from fieldagents.learned.config import TrainConfig; from fieldagents.learned.training import train;"
        "train(load_config(Path(sys.argv[1]), TrainConfig), out=Path(sys.argv[2]))"
    )
    process = subprocess.Popen([sys.executable, "-c", script, config, run], stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 120
    while process.poll() is None and time.monotonic() < deadline:
        if len(list(run.glob("checkpoints/0*.pt"))) >= 2:
            os.kill(process.pid, signal.SIGKILL)
        time.sleep(0.005)
    assert process.wait() == -signal.SIGKILL
    assert not (run / "run.json").exists()
    checked = load_config(config, TrainConfig)
    train(checked, progress=False, resume=run)
    assert_equal_runs(train(checked, progress=False, out=tmp_path / "whole"), run)


def test_onnx_acts_as_the_trained_policy_does(finished_each, algorithm):
    """Over episodes that begin at different times, so that memories are cleared row by row."""
    import gymnasium

    import fieldgym
    from fieldagents.learned.export import to_onnx
    from fieldagents.learned.run import Run
    from fieldgym.sb3 import NativeVecEnv

    env_id = fieldgym.TASKS["heel_strike"].env_id
    config = tiny(algorithm)
    natives = [
        gymnasium.make_vec(
            env_id,
            num_envs=4 // len(config.environments),
            vectorization_mode="vector_entry_point",
            settings=one.settings,
        )
        for one in config.environments
    ]
    native = natives[0]
    run = Run(config, NativeVecEnv(*natives, seed=0))
    run.restore(load_checkpoint(sorted((finished_each / "checkpoints").glob("*.pt"))[-1]))
    quiet = OnnxAgent(to_onnx(run.policy, run.normaliser, "test", config.stack))
    with torch.no_grad():  # large outputs, so that some actions meet their limits
        last_layer(run.policy).weight.mul_(2000 if algorithm == "recurrent_ppo" else 60)
    loud = OnnxAgent(to_onnx(run.policy, run.normaliser, "test", config.stack))
    rng = np.random.default_rng(0)
    low, high = native.single_observation_space.low, native.single_observation_space.high
    count, steps = 50, 12
    stacked = np.zeros((count, config.stack * len(low)), dtype=np.float32)
    state, differs, limited = None, [], []
    for step in range(steps):
        begun = rng.random(count) < 0.2 if step else np.ones(count, dtype=bool)
        observation = rng.uniform(low, high, (count, len(low))).astype(np.float32)
        stacked[begun] = 0.0
        stacked = np.concatenate([stacked[:, len(low) :], observation], axis=1)
        expected, state = run.model.predict(
            run.normaliser.normalize_obs(stacked), state, episode_start=begun, deterministic=True
        )
        loud.begin_episodes(begun)
        np.testing.assert_allclose(loud.act(observation, {}), expected, atol=1e-5)
        limited.append(np.abs(expected) > 0.9999)
        quiet.begin_episodes(begun)
        differs.append(np.abs(quiet.act(observation, {}) - expected).max())
    assert 0.05 < np.mean(limited) < 0.999
    assert max(differs) > 1e-2
    run.environment.close()


def last_layer(policy):
    """The layer that gives the most likely action."""
    if hasattr(policy, "action_net"):
        return policy.action_net
    actor = policy.actor
    return actor.mu if isinstance(actor.mu, torch.nn.Linear) else actor.mu[-2]


@pytest.mark.every("kind", ["PPO", "SAC"])
def test_onnx_keeps_other_limits_and_shapes(kind):
    """Actions between limits of their own; observations in two dimensions; normalisation that clips."""
    import gymnasium
    import stable_baselines3
    from stable_baselines3.common.vec_env import DummyVecEnv

    from fieldagents.learned.export import to_onnx

    class Odd(gymnasium.Env):
        observation_space = gymnasium.spaces.Box(-5, 5, (2, 3), np.float32)
        action_space = gymnasium.spaces.Box(np.array([0, -4], np.float32), np.array([1, 4], np.float32))

        def reset(self, *, seed=None, options=None):
            super().reset(seed=seed)
            return self.observation_space.sample(), {}

        def step(self, action):
            return self.observation_space.sample(), 0.0, False, True, {}

    normaliser = VecNormalize(DummyVecEnv([Odd]), clip_obs=1.0)
    normaliser.obs_rms.mean[:] = np.arange(6).reshape(2, 3)
    model = getattr(stable_baselines3, kind)("MlpPolicy", normaliser, seed=0, device="cpu")
    observation = np.random.default_rng(0).uniform(-5, 5, (300, 2, 3)).astype(np.float32)
    with torch.no_grad():
        if kind == "PPO":  # its last layer begins a hundredth as large
            model.policy.action_net.weight.mul_(2000)
        else:
            model.policy.actor.mu.weight.mul_(20)
    expected = model.predict(normaliser.normalize_obs(observation), deterministic=True)[0]
    agent = OnnxAgent(to_onnx(model.policy, normaliser, "test"))
    assert agent.shape == (2, 3)
    np.testing.assert_allclose(agent.act(observation, {}), expected, atol=1e-4)
    assert np.abs(expected[:, 1]).max() > 1.5  # limits of -1 and 1 would cut it


def test_onnx_of_a_discrete_policy_acts_as_stable_baselines_does():
    import gymnasium
    from stable_baselines3 import PPO

    from fieldagents.learned.export import to_onnx
    from fieldgym.sb3 import NativeVecEnv

    native = gymnasium.vector.SyncVectorEnv(
        [lambda: gymnasium.make("CartPole-v1")] * 4, autoreset_mode=gymnasium.vector.AutoresetMode.DISABLED
    )
    normaliser = VecNormalize(NativeVecEnv(native, seed=0))
    model = PPO("MlpPolicy", normaliser, n_steps=16, batch_size=16, seed=0, device="cpu").learn(64)
    observation = np.random.default_rng(0).normal(size=(200, 4)).astype(np.float32)
    expected = model.predict(normaliser.normalize_obs(observation), deterministic=True)[0]
    actions = OnnxAgent(to_onnx(model.policy, normaliser, "test")).act(observation, {})
    np.testing.assert_array_equal(actions, expected)
    assert set(expected) == {0, 1}


def test_a_learned_agent_needs_no_torch(finished):
    script = (
        "import sys; from fieldagents.policies.policy import OnnxAgent; import numpy as np;"
        "agent = OnnxAgent(sys.argv[1]); n = agent.shape[0];"
        "print(agent.act(np.zeros((2, n)), {}).shape, 'torch' in sys.modules)"
    )
    command = [sys.executable, "-c", script, finished / "policy.onnx"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "(2, 3) False"


def test_policy_files_that_do_not_fit_are_refused(finished, tmp_path):
    with pytest.raises(PolicyError, match="no such policy file"):
        OnnxAgent(tmp_path / "none.onnx")
    (tmp_path / "text.onnx").write_text("hello")
    with pytest.raises(PolicyError, match="not an ONNX policy"):
        OnnxAgent(tmp_path / "text.onnx")
    with pytest.raises(PolicyError, match=r"observations of shape .* the environment gives \(99,\)"):
        OnnxAgent(finished / "policy.onnx").act(np.zeros((3, 99)), {})


def test_checkpoints_are_checked_and_run_no_code(tmp_path):
    import pickle

    path = tmp_path / "1.pt"
    path.write_bytes(b"no checkpoint")
    with pytest.raises(CheckpointError, match=r"1\.pt: not a checkpoint"):
        load_checkpoint(path)

    class Evil:
        def __reduce__(self):
            return (os.mkdir, (str(tmp_path / "ran"),))

    torch.save({"schema": 3, "policy": Evil()}, path)
    with pytest.raises(CheckpointError, match="not a checkpoint"):
        load_checkpoint(path)
    path.write_bytes(pickle.dumps(Evil(), protocol=2))
    with pytest.raises(CheckpointError, match="not a checkpoint"):
        load_checkpoint(path)
    assert not (tmp_path / "ran").exists()


def test_checkpoints_keep_every_kind_of_value(tmp_path):
    kind = np.dtype([("keys", np.uint64, (2,)), ("x", np.float64)])
    state = {
        "walkers": np.array([((2**64 - 1, 3), 0.1)], dtype=kind),
        "arrays": [np.array([True, False]), np.array(2**64 - 1, dtype=np.uint64)],
        "generator": np.random.default_rng(3).bit_generator.state,
        "number": np.float64(0.1),
        "nothing": None,
    }
    save_checkpoint(state, tmp_path / "1.pt")
    loaded = to_arrays(load_checkpoint(tmp_path / "1.pt"))
    assert loaded["walkers"].dtype == kind
    assert loaded["walkers"] == state["walkers"]
    np.testing.assert_array_equal(loaded["arrays"][0], [True, False])
    assert loaded["arrays"][1] == 2**64 - 1
    assert loaded["generator"] == state["generator"]
    assert loaded["number"] == 0.1
    assert loaded["nothing"] is None


def test_a_training_leaves_no_thread_behind(tmp_path):
    before = set(threading.enumerate())
    train(tiny(), progress=False, out=tmp_path / "run")
    assert not set(threading.enumerate()) - before


def test_a_finished_run_is_not_trained_again(finished, capsys):
    before = (finished / "run.json").stat().st_mtime_ns
    assert train(tiny(), progress=False, out=finished) == finished
    assert "trained already" in capsys.readouterr().err
    assert (finished / "run.json").stat().st_mtime_ns == before


def test_folders_that_do_not_fit_are_refused(finished, tmp_path):
    with pytest.raises(TrainingError, match="differs from this config"):
        train(tiny(seed=3), progress=False, resume=finished)
    with pytest.raises(TrainingError, match="not a run's folder"):
        train(tiny(), progress=False, resume=tmp_path)
    with pytest.raises(TrainingError, match="either --resume or --out"):
        train(tiny(), progress=False, resume=finished, out=tmp_path)
    save_yaml(tiny().model_dump(mode="json"), tmp_path / "begun" / "config.yaml")
    with pytest.raises(TrainingError, match="go on with --resume"):
        train(tiny(), progress=False, out=tmp_path / "begun")


def test_a_reality_from_a_file_is_kept_in_the_run(tmp_path):
    path = tmp_path / "extended.yaml"
    effects = {"gyro_bias": {"rate": {"value": 0.004, "std": 0.001, "unit": "rad/s"}}}
    save_yaml({"schema": 1, "model": "heel_strike", "parameters": {}, "effects": effects}, path)
    config = tiny(steps=64, environment={"settings": {"strides": 9}, "reality": str(path)})
    run = train(config, progress=False, out=tmp_path / "run")
    kept = load_config(run / "config.yaml", TrainConfig)
    assert kept.environment.reality == {"gyro_bias": {"rate": 0.004}}
    same = train(kept, progress=False, out=tmp_path / "same")
    nominal = train(tiny(steps=64), progress=False, out=tmp_path / "nominal")
    curves = [pd.read_csv(one / "curve.csv") for one in (run, same, nominal)]
    assert curves[0].equals(curves[1])
    assert not curves[0].equals(curves[2])


def test_a_missing_extra_is_named(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    with pytest.raises(MissingExtraError, match=r"stable_baselines3.*pip install 'fieldgym\[train\]'"):
        train(tiny(), out=tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_config_mistakes_come_all_at_once_with_their_lines(tmp_path):
    path = tmp_path / "ppo.yaml"
    path.write_text(
        "name: ppo\ntask: heel_strik\nsteps: 1000\nlearner:\n  learning_rat: 3e-4\n  gamma: 1.5\n  seed: 1\n",
        encoding="utf-8",
    )
    with pytest.raises(ConfigError) as caught:
        load_config(path, TrainConfig)
    text = str(caught.value)
    assert "ppo.yaml:2: task: there is no task 'heel_strik' (did you mean 'heel_strike'?)" in text
    assert "ppo.yaml:5: learner.learning_rat: unknown key (did you mean 'learning_rate'?)" in text
    assert "ppo.yaml:6: learner.gamma: Input should be less than or equal to 1" in text
    assert "ppo.yaml:7: learner.seed: not an argument of this section; its place: the key seed" in text
    path.write_text(
        "name: ppo\ntask: heel_strike\nseed: 0.5\nsteps: 1000\nnum_envs: 3\n"
        "environment:\n  settings:\n    dwel: 9\n  reality: {gyro_bais: {rate: 1}}\n",
        encoding="utf-8",
    )
    with pytest.raises(ConfigError) as caught:
        load_config(path, TrainConfig)
    found = [problem.removeprefix(f"{tmp_path}/").split(": ")[:2] for problem in caught.value.problems]
    assert found == [
        ["ppo.yaml:3", "seed"],
        ["ppo.yaml:8", "environment.settings.dwel"],
        ["ppo.yaml:9", "environment.reality.gyro_bais"],
    ]
    with pytest.raises(ValueError, match=r"48 does not divide the 64 steps"):
        tiny(learner={"n_steps": 16, "batch_size": 48})
    with pytest.raises(ValueError, match="groups of 3 twins in 1 environments do not divide num_envs, 4"):
        tiny(twins=3)
    with pytest.raises(ValueError, match="stride"):
        tiny(environment={"settings": {"stride": 9}})


def test_arguments_are_those_of_the_algorithm(tmp_path):
    path = tmp_path / "sac.yaml"
    path.write_text(
        "name: sac\ntask: heel_strike\nalgorithm: sac\nsteps: 1000\nnum_envs: 8\n"
        "learner:\n  n_epochs: 3\n  gradient_steps: 0\n  ent_coef: automatic\n",
        encoding="utf-8",
    )
    with pytest.raises(ConfigError) as caught:
        load_config(path, TrainConfig)
    text = str(caught.value)
    assert "sac.yaml:7: learner.n_epochs: unknown key" in text
    assert "sac.yaml:8: learner.gradient_steps: nothing is learned without" in text
    assert "sac.yaml:9: learner.ent_coef: a number, auto or auto_0.1, not 'automatic'" in text
    path.write_text(
        "name: sac\ntask: heel_strike\nalgorithm: sac\nsteps: 1000\nnum_envs: 8\n"
        "learner: {learning_starts: 1000, buffer_size: 8}\n",
        encoding="utf-8",
    )
    with pytest.raises(ConfigError) as caught:
        load_config(path, TrainConfig)
    assert "learner.learning_starts: 1000 leaves none of the 1000 steps" in str(caught.value)
    assert "learner.buffer_size: 8 is less than 16" in str(caught.value)


@pytest.mark.every(
    ("name", "message"),
    [
        ("pppo", r"no algorithm 'pppo' \(did you mean 'ppo'\?\)"),
        ("no_such_module:Class", "cannot be imported"),
        ("json:JSONDecoder", "not an algorithm with the interface of Stable-Baselines3"),
    ],
)
def test_what_is_no_algorithm_is_refused(name, message):
    with pytest.raises(ValueError, match=message):
        tiny(algorithm=name)


def test_a_learner_that_cannot_take_the_spaces_says_so():
    import gymnasium

    from fieldagents.learned.run import Run, SpaceError
    from fieldgym.sb3 import NativeVecEnv

    native = gymnasium.vector.SyncVectorEnv(
        [lambda: gymnasium.make("CartPole-v1")] * 4, autoreset_mode=gymnasium.vector.AutoresetMode.DISABLED
    )
    with pytest.raises(SpaceError, match=r"sac cannot be made .* Discrete"):
        Run(tiny("sac"), NativeVecEnv(native, seed=0))
    late = gymnasium.make_vec("CartPole-v1", num_envs=4, vectorization_mode="vector_entry_point")
    with pytest.raises(ValueError, match=r"autoreset_mode=AutoresetMode\.DISABLED"):
        NativeVecEnv(late, seed=0)


@pytest.mark.every("kind", ["ppo", "sac"])
def test_a_diverged_training_stops_with_the_reason(tmp_path, kind):
    wild = {**RUNS[kind]["learner"], "learning_rate": 1e30}
    with pytest.raises(ValueError, match=r"diverged at step \d+: try a lower learner.learning_rate"):
        train(tiny(kind, learner=wild), progress=False, out=tmp_path / "run")


def test_training_seeds_never_meet_tuning_or_test_seeds():
    from fieldagents.learned.config import ENVIRONMENTS_MOST, RUNS_MOST, VALIDATION_SEEDS
    from fieldagents.seeds import TEST_SEEDS, TRAINING_SEEDS, TUNING_SEEDS

    first, last = tiny(seed=0).environment_seed, tiny(seed=RUNS_MOST - 1).environment_seed
    assert first in TRAINING_SEEDS
    assert last + ENVIRONMENTS_MOST - 1 in TRAINING_SEEDS
    assert set(VALIDATION_SEEDS) <= set(TUNING_SEEDS)
    assert not set(TRAINING_SEEDS) & (set(TUNING_SEEDS) | set(TEST_SEEDS))


def test_publishing_writes_an_entry_and_refuses_what_is_no_replication(finished, tmp_path):
    other = train(tiny(seed=2), progress=False, out=tmp_path / "other")
    folder = publish([other, finished], "tiny", "short", "a tiny policy", tmp_path / "zoo", episodes=3)
    (entry,) = list_zoo(folder=tmp_path / "zoo")
    assert str(entry) == "heel_strike/tiny"
    assert entry.title == "a tiny policy"
    (training,) = entry.trainings
    assert str(training) == "heel_strike/tiny/short"
    assert training.seeds == (1, 2)
    assert [agent.title for agent in entry.agents()] == ["a tiny policy"] * 2
    assert training.card["config"]["steps"] == 640
    assert training.settings == {"strides": 9}
    assert [dict(agent.settings) for agent in entry.agents()] == [{}] * 2
    publish([other, finished], "tiny", "short", "t", tmp_path / "asking", episodes=3, asks=["strides"])
    (asking,) = list_zoo(folder=tmp_path / "asking")
    assert [agent.settings for agent in asking.agents()] == [{"strides": 9}] * 2
    with pytest.raises(ZooError, match="no setting of the training: bands"):
        publish([other, finished], "tiny", "short", "t", tmp_path / "asking", episodes=3, asks=["bands"])
    assert set(pd.read_csv(folder / "curve.csv")["seed"]) == {1, 2}
    with pytest.raises(ZooError, match="same training seed"):
        publish([finished, finished], "tiny", "short", "", tmp_path / "zoo")
    unlike = train(tiny(seed=3, steps=64), progress=False, out=tmp_path / "unlike")
    with pytest.raises(ZooError, match="seed alone"):
        publish([finished, unlike], "tiny", "short", "", tmp_path / "zoo")
    (unlike / "run.json").unlink()
    with pytest.raises(ZooError, match="not the folder of a finished run"):
        publish([unlike], "tiny", "short", "", tmp_path / "zoo")


def test_a_commit_is_recorded_in_a_checkout():
    assert set(training.versions()) == {"python", "machine", *training.VERSIONED, "commit"}


def test_a_plateau_is_where_the_last_third_gains_less_than_its_interval():
    rng = np.random.default_rng(0)
    luck = rng.normal(size=32)  # of the episodes, which are the same at each score

    def scores(curve):
        return [(100 * (k + 1), (level + luck + 0.1 * rng.normal(size=32)).tolist()) for k, level in curve]

    rising = [(k, 0.1 * k) for k in range(30)]
    flat = [(k, 0.1 * min(k, 10)) for k in range(30)]
    assert not plateau(scores(rising))
    assert plateau(scores(flat))
    assert not plateau(scores(flat[:15]))  # the third before was still rising
    assert not plateau(scores([(k, 0.0) for k in range(9)]))  # too few to say
    assert sum(plateau(scores([(k, 0.02 * k) for k in range(12)])) for _ in range(200)) == 0


def test_a_run_ends_at_its_plateau_and_says_so(tmp_path, monkeypatch):
    """A policy that cannot learn, at a rate of nearly zero, ends at its tenth score; killed there, too."""
    from fieldagents.learned import recorder

    still = {"learner": {**ON_POLICY, "learning_rate": 1e-12}, "steps": 1280}
    still["validation"] = {"every": 1, "episodes": 4, "until_plateau": True}
    run = train(tiny(**still), progress=False, out=tmp_path / "run")
    result = json.loads((run / "run.json").read_text())
    assert (result["ended"], result["steps"]) == ("plateau", 640)
    assert list(pd.read_csv(run / "curve.csv")["steps"]) == list(range(64, 641, 64))

    def save_and_die(state, path):
        save_checkpoint(state, path)
        if path.name.endswith("640.pt"):
            raise Killed

    monkeypatch.setattr(recorder, "save_checkpoint", save_and_die)
    with pytest.raises(Killed):
        train(tiny(**still), progress=False, out=tmp_path / "killed")
    monkeypatch.setattr(recorder, "save_checkpoint", save_checkpoint)
    again = train(tiny(**still), progress=False, resume=tmp_path / "killed")
    assert (again / "policy.onnx").read_bytes() == (run / "policy.onnx").read_bytes()
    assert (again / "curve.csv").read_text() == (run / "curve.csv").read_text()
