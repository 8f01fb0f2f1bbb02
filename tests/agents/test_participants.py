"""Who may take part in an evaluation beside the project's own agents, and when a misfit is told."""

import sys

import numpy as np
import onnx
import pytest

from fieldagents.agent import Agent
from fieldagents.config import EnvironmentConfig
from fieldagents.evaluation.agents import AgentError, make_agent
from fieldagents.evaluation.config import EvaluateConfig
from fieldagents.evaluation.episodes import run_episodes
from fieldagents.evaluation.evaluate import evaluate
from fieldagents.policies.policy import OnnxAgent, PolicyError
from fieldagents.seeds import TEST_SEEDS

TASK = "heel_strike"
SHORT = {"settings": {"strides": 8}}


class Middle(Agent):
    """An agent of a user's own: the middle of every action, and a count of what it was asked."""

    asked = 0

    def __init__(self, settings):
        self.name, self.settings_given = "middle", dict(settings)

    def act(self, observation, info):
        Middle.asked += 1
        return np.zeros((len(observation), 3), dtype=np.float32)


def not_an_agent(settings):
    return settings


def linear_policy(path, inputs, outputs, memory=False):
    """An ONNX file made by hand: the first inputs; with a memory, also how many steps an episode has had."""
    helper, kind = onnx.helper, onnx.TensorProto.FLOAT
    matrix = np.eye(inputs, outputs, dtype=np.float32) * 0.1
    weights = helper.make_tensor("w", kind, matrix.shape, matrix.tobytes(), raw=True)
    one = helper.make_tensor("one", kind, [1], [0.125])
    given = [helper.make_tensor_value_info("observation", kind, ["batch", inputs])]
    result = [helper.make_tensor_value_info("action", kind, ["batch", outputs])]
    if memory:
        given.append(helper.make_tensor_value_info("memory", kind, ["batch", 1]))
        result.append(helper.make_tensor_value_info("next_memory", kind, ["batch", 1]))
        zero = helper.make_tensor("zero", kind, matrix.shape, np.zeros_like(matrix).tobytes(), raw=True)
        nodes = [
            helper.make_node("Add", ["memory", "one"], ["next_memory"]),
            helper.make_node("MatMul", ["observation", "zero"], ["none"]),
            helper.make_node("Add", ["none", "next_memory"], ["action"]),
        ]
        tensors = [one, zero]
    else:
        nodes, tensors = [helper.make_node("MatMul", ["observation", "w"], ["action"])], [weights]
    graph = helper.make_graph(nodes, "policy", given, result, tensors)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    path.parent.mkdir(parents=True, exist_ok=True)
    onnx.save(model, path)
    return path


def config(*agents, **more):
    return EvaluateConfig(
        name="own",
        task=TASK,
        environments={"short": SHORT},
        agents=agents,
        baseline=agents[0],
        episodes=3,
        **more,
    )


@pytest.fixture
def importable(monkeypatch):
    monkeypatch.setitem(sys.modules, "own_agents", sys.modules[__name__])


@pytest.mark.usefixtures("importable")
def test_an_agent_of_ones_own_takes_part_by_its_import_path(tmp_path):
    summary = evaluate(config("own_agents:Middle", "fixed_tuned"), tmp_path)
    rows = {row.agent: row for row in summary.scenarios["short"]}
    assert rows["own_agents:Middle"].kind == "observation"
    alone = run_episodes(Middle({}), TASK, EnvironmentConfig(**SHORT), TEST_SEEDS[:3])
    assert rows["own_agents:Middle"].means["error_mm"] == alone["error_mm"].mean()
    assert make_agent("own_agents:Middle", TASK, {"strides": 8}).runs[0].settings_given == {"strides": 8}


@pytest.mark.usefixtures("importable")
def test_what_is_no_agent_is_refused_by_name(tmp_path):
    for name, message in (
        ("no_such_module:Middle", "cannot be imported"),
        ("own_agents:Midle", "cannot be imported"),
        ("rangr", "did you mean 'ranger'"),
        (str(tmp_path), "no policy.onnx in this folder"),
        ("no.onnx", "no such file"),
        ("no.zip", "no such file"),
    ):
        with pytest.raises(ValueError, match=message):
            config(name, "ranger")
    with pytest.raises(AgentError, match="gives dict, which is not"):
        make_agent("own_agents:not_an_agent", TASK, {})


def test_a_folder_of_runs_is_one_participant_with_a_verdict_over_runs(tmp_path):
    runs = tmp_path / "runs"
    for i in range(5):
        linear_policy(runs / f"seed{i}" / "policy.onnx", 6, 3)
    entry = make_agent(str(runs), TASK, {})
    assert len(entry.runs) == 5
    assert entry.learned
    summary = evaluate(config("ranger", str(runs)), tmp_path / "out")
    (row,) = [row for row in summary.scenarios["short"] if row.agent == str(runs)]
    assert row.runs == 5
    assert row.of_training is not None
    single = make_agent(str(runs / "seed3"), TASK, {})
    assert len(single.runs) == 1


@pytest.mark.usefixtures("importable")
@pytest.mark.every(("inputs", "outputs", "word"), [(9, 3, "observations"), (6, 2, "actions")])
def test_a_policy_of_other_spaces_is_refused_before_anybody_plays(tmp_path, inputs, outputs, word):
    path = linear_policy(tmp_path / "wrong.onnx", inputs, outputs)
    Middle.asked = 0
    with pytest.raises(PolicyError, match=f"wrong.onnx: .*{word} of shape"):
        evaluate(config("own_agents:Middle", str(path)), tmp_path / "out")
    assert Middle.asked == 0
    assert not (tmp_path / "out").exists()


def test_a_policy_forgets_where_an_episode_begins(tmp_path):
    agent = OnnxAgent(linear_policy(tmp_path / "counter.onnx", 6, 1, memory=True))
    seen = np.zeros((3, 6), dtype=np.float32)
    begun = np.ones(3, dtype=bool)
    counts = []
    for step in range(4):
        agent.begin_episodes(begun)
        counts.append(8 * agent.act(seen, {})[:, 0])
        begun = np.array([False, step == 1, False])
    np.testing.assert_array_equal(counts, [[1, 1, 1], [2, 2, 2], [3, 1, 3], [4, 2, 4]])
    agent.reset(0)
    np.testing.assert_array_equal(8 * agent.act(seen[:2], {})[:, 0], [1, 1])


@pytest.mark.every("kind", ["PPO", "SAC", "RecurrentPPO"])
def test_a_zip_of_stable_baselines_acts_if_it_is_trusted(tmp_path, kind):
    sb3 = pytest.importorskip("stable_baselines3")
    contrib = pytest.importorskip("sb3_contrib")
    import gymnasium

    import fieldgym

    env = gymnasium.make(fieldgym.TASKS[TASK].env_id)
    policy = "MlpLstmPolicy" if kind == "RecurrentPPO" else "MlpPolicy"
    model = getattr(sb3, kind, None) or getattr(contrib, kind)
    model = model(policy, env, seed=1, device="cpu")
    model.save(tmp_path / "model.zip")
    name = str(tmp_path / "model.zip")
    with pytest.raises(AgentError, match="hold pickles, which run any code"):
        make_agent(name, TASK, {})
    (agent,) = make_agent(name, TASK, {}, trust_pickle=True).runs
    agent.fits(env.observation_space, env.action_space)
    rng = np.random.default_rng(0)
    state = None
    for step in range(4):
        begun = np.array([step == 0, step in (0, 2)])
        seen = rng.uniform(-1, 1, (2, *env.observation_space.shape)).astype(np.float32)
        expected, state = model.predict(seen, state, episode_start=begun, deterministic=True)
        agent.begin_episodes(begun)
        np.testing.assert_array_equal(agent.act(seen, {}), expected)
    (tmp_path / "other.zip").write_bytes(b"no archive")
    with pytest.raises(PolicyError, match="not a model saved by"):
        make_agent(str(tmp_path / "other.zip"), TASK, {}, trust_pickle=True)
