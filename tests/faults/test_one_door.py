"""What comes from outside is checked at the door and at every later call; a mistake is one clear message."""

import json
import sys
from pathlib import Path

import numpy as np
import onnx
import pytest
from gymnasium import spaces
from onnx import TensorProto, helper
from typer.testing import CliRunner

from fieldagents.agent import AgentError, checked_actions
from fieldagents.cli import app
from fieldagents.evaluation.agents import make_agent
from fieldagents.policies.policy import OnnxAgent, PolicyError
from fieldmodels.contract import at_rest
from fieldmodels.guard import ContractError
from fieldmodels.model import ModelError, Signal
from fieldmodels.model_files import load_model_file
from fieldmodels.reality import read_reality
from fieldmodels.registry import get_model
from fieldmodels.settings import Setting
from fieldmodels.yaml import YamlError, load_yaml, parse_yaml

LAG = (Path(__file__).parents[2] / "docs" / "lag.py").read_text()

LATE = {
    "a list": ("result = result.tolist()", None),
    "complex": ("result = result + 1j", "returned an array of complex128, not an array of real numbers"),
    "objects": ("result = result.astype(object)", "returned an array of object"),
    "nothing": ("return None", "simulate returned NoneType"),
    "ragged": ("return [[1.0], [1.0, 2.0]]", "simulate returned"),
    "shape": ("result = result[0]", r"simulate returned shape \(\d+, \d+, 1\), not"),
    "an exception": ("raise KeyError('late')", r"lag\.py:\d+: KeyError: 'late' \(in simulate\)"),
    "an exit": ("raise SystemExit(0)", r"lag\.py:\d+: SystemExit: 0 \(in simulate\)"),
    "an endless loop": ("while True: pass", r"lag\.py:\d+: took longer than 0.2 s \(in simulate\)"),
}


def late_model(folder, what, calls=1):
    """The page's simulator, which does something else after some calls."""
    path = folder / "lag.py"
    text = LAG.replace("import numpy as np", "import numpy as np\n\nCALLS = [0]\n", 1)
    assert text.count("        return result\n") == 1
    more = (
        f"        CALLS[0] += 1\n        if CALLS[0] > {calls}:\n            {what}\n        return result\n"
    )
    path.write_text(text.replace("        return result\n", more))
    return path


@pytest.mark.every("what", LATE)
def test_a_model_is_checked_at_every_call(tmp_path, what):
    code, message = LATE[what]
    model = load_model_file(str(late_model(tmp_path, code)), call_limit=0.2)
    recording = at_rest(model, 0.01, 1.0, np.random.default_rng(0))
    windows = model.windows(recording, 0.1)
    first = model.simulate(model.nominal[None], windows)
    copied = model.scaled_to([recording])  # what a diagnosis works with is under guard too
    if message is None:
        np.testing.assert_array_equal(copied.simulate(model.nominal[None], windows), first)
    else:
        with pytest.raises(ModelError, match=message):
            copied.simulate(model.nominal[None], windows)


def test_states_of_a_model_are_checked_at_every_call(tmp_path):
    path = late_model(tmp_path, "pass")
    path.write_text(path.read_text().replace("[starts][:, None]", "[starts][:, None] * np.nan"))
    model = load_model_file(str(path))
    recording = at_rest(model, 0.01, 1.0, np.random.default_rng(0))
    with pytest.raises(ContractError, match=r"initial_states: state 'speed' is nan at sample 0"):
        model.windows(recording, 0.1)


def test_what_a_model_prints_leaves_json_alone(tmp_path, capsys):
    model = load_model_file(str(late_model(tmp_path, "print('hello')", calls=0)))
    recording = at_rest(model, 0.01, 1.0, np.random.default_rng(0))
    model.simulate(model.nominal[None], model.windows(recording, 0.1))
    seen = capsys.readouterr()
    assert seen.out == ""
    assert "hello" in seen.err


@pytest.mark.every("noise", [-1.0, float("nan"), float("inf"), "0.1"])
def test_a_signal_s_noise_is_a_standard_deviation(noise):
    with pytest.raises(ModelError, match="noise is a standard deviation in m"):
        Signal("position", "m", noise=noise)


ACTIONS = {
    "NaN": (np.array([[0.0], [np.nan]]), r"the action nan in row 1"),
    "infinity": (np.array([[np.inf], [0.0]]), "the action inf in row 0"),
    "shape": (np.zeros((2, 2)), r"shape \(2, 2\), not \(2, 1\)"),
    "a scalar": (0.0, r"shape \(\), not \(2, 1\)"),
    "text": (np.array([["a"], ["b"]]), "not numbers"),
    "complex": (np.zeros((2, 1), dtype=complex), "not numbers"),
    "None": (None, "not numbers"),
    "ragged": ([[1.0], [1.0, 2.0]], "not numbers"),
}


@pytest.mark.every("what", ACTIONS)
def test_actions_are_finite_numbers_of_the_space_s_shape(what):
    actions, message = ACTIONS[what]
    with pytest.raises(AgentError, match=message):
        checked_actions(actions, "mine", 2, spaces.Box(-1.0, 1.0, (1,)))


def policy(node, shape=("batch", 3), out=("batch", 1)):
    """An ONNX file with one operation."""
    graph = helper.make_graph(
        [node],
        "g",
        [helper.make_tensor_value_info("observation", TensorProto.FLOAT, shape)],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, out)],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    return onnx.load_from_string(model.SerializeToString()).SerializeToString()


BOX = spaces.Box(-np.inf, np.inf, (3,)), spaces.Box(-1.0, 1.0, (1,))
POLICIES = {
    "NaN": helper.make_node("ReduceLogSum", ["observation"], ["action"], axes=[1], keepdims=1),
    "wrong width": helper.make_node("Identity", ["observation"], ["action"]),
    "scalar": helper.make_node("ReduceSum", ["observation"], ["action"], keepdims=0),
}


@pytest.mark.every("what", POLICIES)
def test_a_policy_that_gives_no_actions_is_refused(what):
    agent = OnnxAgent(policy(POLICIES[what], out=None))
    with pytest.raises(PolicyError, match="gives"):
        agent.fits(*BOX)


def test_a_policy_of_a_fixed_batch_is_refused():
    agent = OnnxAgent(policy(helper.make_node("Identity", ["observation"], ["action"]), (1, 3), (1, 3)))
    with pytest.raises(PolicyError, match="cannot be run"):
        agent.fits(*BOX)


OWN = """
import numpy as np
from fieldagents.agent import Agent

class Mine(Agent):
    name = "mine"

    def __init__(self, settings):
        pass

    def act(self, observation, info):
        {act}
"""


@pytest.mark.every(
    ("act", "message"),
    [
        ("return 1 / 0", r"mine_agent\.py:12: ZeroDivisionError: division by zero \(in act\)"),
        ("raise SystemExit(0)", r"mine_agent\.py:12: SystemExit: 0 \(in act\)"),
    ],
)
def test_an_own_agent_s_mistake_has_its_line(tmp_path, monkeypatch, act, message):
    (tmp_path / "mine_agent.py").write_text(OWN.format(act=act))
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "mine_agent", raising=False)
    (agent,) = make_agent("mine_agent:Mine", "heel_strike", {}).runs
    with pytest.raises(ModelError, match=message):
        agent.act(np.zeros((1, 3)), {})


@pytest.mark.every("text", ["raise SystemExit(0)", "1 / 0", "def f(:"])
def test_an_own_agent_s_module_may_do_anything(tmp_path, monkeypatch, text):
    (tmp_path / "bad_agent.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(AgentError, match="cannot be imported"):
        make_agent("bad_agent:Mine", "heel_strike", {})


BOMB = "a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n" + "".join(
    f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]\n" for i in range(1, 10)
)
HOSTILE = {
    "aliases that multiply": (BOMB, r"f:5: more than 100,000 values"),
    "an alias of itself": ("a: &a [*a]", r"f:1: alias \*a"),
    "depth": ("[" * 3000, "nested deeper than 50"),
    "an integer of 5,000 digits": ("a: " + "9" * 5000, "a value cannot be read"),
    "a thirteenth month": ("a: 2026-13-45", "a value cannot be read"),
    "a Python object": ("a: !!python/object:os.system x", "could not determine a constructor"),
    "a zero byte": ("\0", "unacceptable character"),
}


@pytest.mark.every("what", HOSTILE)
def test_hostile_yaml_is_refused_with_its_place(what):
    text, message = HOSTILE[what]
    with pytest.raises(YamlError, match=message):
        parse_yaml(text, "f")


def test_aliases_as_people_use_them_are_read():
    assert parse_yaml("a: &a {x: 1}\nb: *a\nc: {<<: *a, y: 2}", "f")["c"] == {"x": 1, "y": 2}


@pytest.mark.every("path", ["/dev/zero", "/", "/dev/null/x"])
def test_what_is_no_file_is_refused(path):
    with pytest.raises(YamlError, match=path):
        load_yaml(Path(path))


def test_a_schema_that_nobody_knows_is_refused(tmp_path):
    path = tmp_path / "extended.yaml"
    path.write_text("schema: 99\nmodel: rig\neffects: {}\n")
    with pytest.raises(ModelError, match="schema 99, but this version reads schema 1; use the version"):
        read_reality(path, get_model("rig"))


def test_parameters_that_are_no_mapping_are_refused():
    with pytest.raises(ModelError, match="'parameters' must be a mapping"):
        read_reality({"parameters": 3}, get_model("rig"))


@pytest.mark.every("value", [np.inf, -np.inf, np.nan, 1e300])
@pytest.mark.every("setting", [Setting("x"), Setting("x", least=0), Setting("x", above=0)])
def test_a_setting_is_a_number_that_can_be_squared(setting, value):
    assert not setting.allows(value)


def test_a_leg_beyond_the_earth_is_refused():
    result = CliRunner().invoke(app, ["watch", "uav_route", "--set", "settings.longest_leg=1e300"])
    assert result.exit_code == 2
    assert "longest_leg" in result.output


def test_a_model_that_turns_into_nan_has_no_verdict(tmp_path):
    data = tmp_path / "motor.csv"
    rng = np.random.default_rng(1)
    voltage = np.repeat(rng.uniform(-6.0, 6.0, 20), 20)
    speed = 10.0 * voltage + 0.2 * rng.standard_normal(400)
    rows = [f"{0.01 * i:.2f},{u:.4f},{w:.4f}" for i, (u, w) in enumerate(zip(voltage, speed, strict=True))]
    data.write_text("\n".join(["t,voltage,speed", *rows]))
    path = late_model(tmp_path, "result = result * np.nan", calls=60)
    command = ["diagnose", str(data), "--machine", str(path), "--out", str(tmp_path / "out"), "--json"]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 2, result.output
    assert "no value is finite" in result.output
    assert not (tmp_path / "out" / "diagnosis.json").exists()
    with pytest.raises(json.JSONDecodeError):
        json.loads(result.output)
