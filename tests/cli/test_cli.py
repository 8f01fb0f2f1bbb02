"""The command line: results on standard output, one clear message for a mistake, never a traceback."""

import json
import os
import re
import resource
import subprocess
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pandas as pd
import pytest
import typer
from typer.testing import CliRunner, Result

from fieldagents import checkout
from fieldagents.cli import app
from fieldmodels.drivers.named import apply_reality
from fieldmodels.recording.files import load_recording
from fieldmodels.registry import get_model

CONFIGS = Path(__file__).parents[2] / "configs"
COMMANDS = ("list", "train", "evaluate", "record", "diagnose", "open", "export", "reproduce", "watch", "demo")
RIG = """\
name: rig
model: rig
reality: {coulomb_friction: {force: 0.3}}
excitation: {kind: mixed, amplitude: 5}
duration: 4
seed: 1
"""


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(a) for a in arguments])


def shell(*arguments: object, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """The installed command in a process of its own, without a terminal."""
    command = [sys.executable, "-c", "from fieldagents.cli import main; main()", *map(str, arguments)]
    environment = {**os.environ, "COLUMNS": "100", "NO_COLOR": "1"}
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, env=environment, check=False)


def mistake(*arguments: object) -> str:
    """The message of a command that must refuse."""
    result = run(*arguments)
    assert result.exit_code == 2, result.output
    assert "Traceback" not in result.output
    assert result.stdout == ""
    assert re.search(r"^Error: |Usage", result.stderr, re.MULTILINE)
    return result.stderr


@pytest.mark.every(
    ("line", "offered"),
    [
        ("diagnose log.csv --machine pen", {"pendulum"}),
        ("export a.yaml b.py --machine serv", {"servo"}),
        ("exam --machine pen", {"pendulum"}),
        ("watch heel", {"heel_strike"}),
        ("watch heel_strike --agent ranger_", {"ranger_tuned"}),
        ("watch heel_strike --agent straight", set()),
        ("watch --agent straight", {"straight"}),
        ("list pose", {"pose_reaching"}),
        ("list rig", {"rig"}),
        (
            "train heel_strike/",
            {f"heel_strike/{name}" for name in ("conditioned", "pathwise", "ppo", "sac")},
        ),
        ("evaluate heel_strike/", {"heel_strike/benchmark", "heel_strike/realities"}),
        ("evaluate bench", {"benchmark"}),
        ("sweep heel_strike/", {"heel_strike/sweep", "heel_strike/tune"}),
        ("record rig/", {"rig/record"}),
        ("diagnose log.csv --then-retune heel", {"heel_strike/retune"}),
        ("diagnose log.csv --test dfki_simple_pendulum/dd", {"dfki_simple_pendulum/ddp"}),
        ("diagnose dfki_simple_pendulum/dd", {"dfki_simple_pendulum/ddp"}),
        ("reproduce heel_strike/figure-2.12", {"heel_strike/figure-2.12"}),
    ],
)
def test_a_shell_is_offered_names(line: str, offered: set[str]):
    """Asked as bash asks: by the variables of its completion."""
    words = f"fieldgym {line}"
    asked = {
        "_FIELDGYM_COMPLETE": "complete_bash",
        "COMP_WORDS": words,
        "COMP_CWORD": str(len(words.split()) - 1),
    }
    answer = CliRunner().invoke(app, [], env=asked, prog_name="fieldgym")
    assert answer.exit_code == 0
    assert set(answer.stdout.split()) == offered


@pytest.fixture
def rig_config(tmp_path):
    path = tmp_path / "rig.yaml"
    path.write_text(RIG)
    return path


def test_help_is_quick_and_imports_nothing_heavy():
    code = (
        "import sys; from fieldagents import cli\n"
        "heavy = {'numba', 'torch', 'gymnasium', 'pandas', 'scipy', 'matplotlib'} & set(sys.modules)\n"
        "sys.exit(str(heavy) if heavy else 0)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
    began = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    result = shell("--help")
    assert result.returncode == 0
    assert resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - began < 5  # 0.2 s of a processor
    for command in COMMANDS:
        assert command in result.stdout


@pytest.mark.every("command", COMMANDS)
def test_every_command_has_help_with_examples(command):
    result = run(command, "--help")
    assert result.exit_code == 0
    assert "For example:" in result.stdout
    assert f"fieldgym {command}" in result.stdout
    assert "--json" in result.stdout


@pytest.mark.every(("name", "place"), [("exam", "tests/exam"), ("reproduce", "papers")])
def test_a_command_that_does_not_install_says_how_to_get_it(tmp_path, monkeypatch, name, place):
    monkeypatch.setattr(checkout, "ROOT", tmp_path)
    bare = typer.Typer(callback=lambda: None)
    checkout.add_command(bare, name, place)
    found = CliRunner().invoke(bare, [name, "--machine", "rig"])
    assert isinstance(found.exception, checkout.CheckoutError)
    assert f"git clone REPOSITORY fieldgym && cd fieldgym && make {Path(place).name}" in str(found.exception)


def test_version():
    assert run("--version").stdout.startswith("fieldgym 0.")


def test_list_names_what_there_is():
    found = json.loads(run("list", "--json").stdout)
    (task,) = [task for task in found["tasks"] if task["name"] == "heel_strike"]
    assert {"ranger", "adaptive", "imm"} <= {agent["name"] for agent in task["agents"]}
    (route,) = [task for task in found["tasks"] if task["name"] == "uav_route"]
    (capture,) = [setting for setting in route["settings"] if setting["name"] == "capture"]
    assert (capture["default"], capture["unit"], capture["range"]) == (5.0, "km", "greater than 0")
    effects = {model["name"]: {e["name"] for e in model["effects"]} for model in found["models"]}
    assert {"rig", "pendulum", "heel_strike"} <= set(effects)
    assert "coulomb_friction" in effects["rig"]
    assert "gyro_bias" in effects["heel_strike"]
    shown = run("list").stdout
    for name in (
        "heel_strike",
        "coulomb_friction",
        "capture",
        "adaptive",
        "dfki_simple_pendulum/ddp",
        "fieldgym[filters]",  # brackets are text, not markup
    ):
        assert name in shown


def test_record_is_repeatable_and_keeps_the_reality_apart(rig_config, tmp_path):
    first, second = tmp_path / "a", tmp_path / "b"
    written = json.loads(run("record", rig_config, "--out", first, "--json").stdout)
    assert run("record", rig_config, "--out", second).exit_code == 0
    assert set(written) == {"recording", "reality"}
    assert (first / "rig.csv").read_bytes() == (second / "rig.csv").read_bytes()
    header, *rows = (first / "rig.csv").read_text().splitlines()
    assert header.split(",")[:2] == ["t", "force"]
    assert len(rows) == 400
    assert "friction" not in (first / "rig.csv").read_text()
    assert "coulomb_friction" in (first / "rig.reality.yaml").read_text()


def test_recorded_reality_loads_back(rig_config, tmp_path):
    run("record", rig_config, "--out", tmp_path / "a")
    again = run(
        "record",
        rig_config,
        "--set",
        f"reality={tmp_path / 'a' / 'rig.reality.yaml'}",
        "--out",
        tmp_path / "b",
    )
    assert again.exit_code == 0, again.output
    assert (tmp_path / "a" / "rig.csv").read_bytes() == (tmp_path / "b" / "rig.csv").read_bytes()


def test_record_a_walk(tmp_path):
    config = CONFIGS / "heel_strike" / "record.yaml"
    result = run("record", config, "--set", "duration=5", "--set", "format=parquet", "--out", tmp_path)
    assert result.exit_code == 0, result.output
    assert (tmp_path / "biased_walk.parquet").exists()


def test_record_an_experiment_in_three_modes(tmp_path):
    config = CONFIGS / "excitation" / "record.yaml"
    result = run("record", config, "--set", "duration=2", "--out", tmp_path)
    assert result.exit_code == 0, result.output
    table = pd.read_csv(tmp_path / "laden_arm.csv")
    assert table.groupby("episode")["arm_axis"].unique().map(list).tolist() == [[1], [2], [3]] * 2
    assert table.groupby("episode")["arm_angle"].std().gt(0.05).all()  # the arm moves in each


@pytest.mark.nightly
def test_recorded_flights_are_diagnosed(tmp_path):
    """The radar's scans survive the file: both hidden effects come back, the near twin beside one of them."""
    result = run("record", CONFIGS / "uav_route" / "record.yaml", "--out", tmp_path)
    assert result.exit_code == 0, result.output
    table = pd.read_csv(tmp_path / "seen_too_well.csv")
    assert set(table["detected"]) == {0, 1}
    assert (table["scan_gap"] == 0).mean() == pytest.approx(
        0.6, abs=0.01
    )  # a scan every 5 s, a row every 2 s
    out = tmp_path / "found"
    result = run("diagnose", tmp_path / "seen_too_well.csv", "--machine", "uav_route", "--out", out)
    assert result.exit_code == 0, result.output
    causes = json.loads((out / "diagnosis.json").read_text())["causes"]
    found = [{cause["effect"], *cause["alternatives"]} for cause in causes]
    assert found[0] == {"wind"}
    assert {"signature_scale"} <= found[1] <= {"signature_scale", "radar_range_scale"}
    assert len(found) == 2


def test_a_recorded_line_follower_has_no_bias_that_nobody_asked_for(tmp_path):
    """Whatever else is set; a bias that is asked for turns the robot."""
    config, command = CONFIGS / "line_following" / "record.yaml", {}
    for name, changes in {"none": [], "some": ["settings.bias=0.05"]}.items():
        changes = ["duration=240", "reality={}", "settings.sensor=0.01", *changes]
        overrides = [part for change in changes for part in ("--set", change)]
        result = run("record", config, *overrides, "--out", tmp_path / name)
        assert result.exit_code == 0, result.output
        table = pd.read_csv(tmp_path / name / "weak_turns.csv")
        assert (table["curvature"] == 0).all()  # a straight line unless another is set
        command[name] = abs(table["steering"][20:].mean())
    assert command["none"] < 0.003 < command["some"]  # what holds against a bias


@pytest.mark.every(
    ("change", "message"),
    [
        ("settings.track=ovel", "no track 'ovel' (did you mean 'oval'?)"),
        ("settings.plan=pymunk", "settings.plan: unknown key"),
        ("settings.latency_strides=2", "settings.latency_strides: Input should be less than or equal to 1"),
        ("reality.turn_gane.factor=0.8", "no effect 'turn_gane' (did you mean 'turn_gain'?)"),
        ("reality.actuator_delay.strides=2", "the robot left its line"),
    ],
)
def test_mistakes_in_a_recorded_walk_along_a_line(tmp_path, change, message):
    config = CONFIGS / "line_following" / "record.yaml"
    assert message in mistake("record", config, "--set", change, "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_keys_that_do_not_fit_a_model_are_refused(tmp_path):
    drive = "--set=excitation={kind: steps}"
    for task, key in (
        ("excitation", drive),
        ("heel_strike", "--set=noise=0"),
        ("pose_reaching", "--set=walk={}"),
    ):
        text = mistake("record", CONFIGS / task / "record.yaml", key, "--out", tmp_path)
        assert f"machine '{task}' does not take this key" in text


@pytest.mark.every("path", sorted(CONFIGS.glob("*/record*.yaml")))
def test_shipped_record_configs_load(path):
    from fieldagents.config import load_config
    from fieldagents.record.config import RecordConfig

    load_config(path, RecordConfig)


@pytest.mark.every(
    "path", [*sorted(CONFIGS.glob("*/benchmark*.yaml")), CONFIGS / "line_following" / "light.yaml"]
)
def test_shipped_benchmarks_load(path):
    from fieldagents.config import load_config
    from fieldagents.evaluation.config import EvaluateConfig

    slow = path.stem == "benchmark_printed"  # half a minute an episode
    assert load_config(path, EvaluateConfig).episodes >= (6 if slow else 40)


EVALUATE = ("evaluate", CONFIGS / "heel_strike" / "benchmark.yaml")
FEW = ("--set", "agents=[ranger,fixed_tuned]", "--set", "environments={short: {settings: {strides: 5}}}")


def test_evaluate_prints_json_alone(tmp_path):
    result = shell(*EVALUATE, *FEW, "--set", "episodes=20", "--out", tmp_path, "--json")
    assert result.returncode == 0, result.stderr
    summary = json.loads(result.stdout)
    assert summary["schema"] == 2
    assert [row["agent"] for row in summary["scenarios"]["short"]] == ["fixed_tuned", "ranger"]
    assert "short: ranger" in result.stderr  # progress, as plain lines


def test_evaluate_prints_a_table_and_its_files(tmp_path):
    result = run(*EVALUATE, *FEW, "--set", "episodes=3", "--out", tmp_path)
    assert result.exit_code == 0, result.output
    assert "insufficient" in result.stdout
    assert str(tmp_path / "report.html") in result.stdout.replace("\n", "")


@pytest.mark.every(
    ("changes", "messages"),
    [
        (["agents=[rangr]"], ["agents.0: there is no agent 'rangr' (did you mean 'ranger'?)"]),
        (["agents=[ranger,ranger]", "baseline=ranger"], ["agents.1: agent 'ranger' is listed twice"]),
        (["agents=[nowhere.onnx]"], ["agents.0: no such file: nowhere.onnx"]),
        (["baseline=best"], ["baseline: 'best' is not among the agents"]),
        (["task=heelstrike"], ["task: there is no task 'heelstrike' (did you mean 'heel_strike'?)"]),
        (["episodes=1"], ["episodes: Input should be greater than or equal to 2"]),
        (
            [
                "environments.ar1.settings.colision_kind=ar1",
                "environments.ar1.settings.dwell=0.5",
                "epsiodes=9",
            ],
            [
                "environments.ar1.settings.colision_kind: unknown key (did you mean 'collision_kind'?)",
                "environments.ar1.settings.dwell: Input should be greater than or equal to 1",
                "epsiodes: unknown key (did you mean 'episodes'?)",
            ],
        ),
        (
            ["environments.ar1.reality.gyro_bais.rate=0.01"],
            ["environments.ar1.reality.gyro_bais: model 'heel_strike' has no effect 'gyro_bais'"],
        ),
        (["environments.ar1.reality=missing.yaml"], ["missing.yaml: no such file"]),
        (
            ["environments.ar1.reality.gyro_bias={rte: 1, rate: fast}"],
            [
                "environments.ar1.reality.gyro_bias.rte: effect 'gyro_bias' has no parameter 'rte'",
                "environments.ar1.reality.gyro_bias.rate: 'gyro_bias.rate' must be a number",
            ],
        ),
        (
            ["agents=[rangr]", "baseline=rangr"],
            ["2 mistakes:", "agents.0: there is no agent 'rangr'", "baseline: there is no agent 'rangr'"],
        ),
    ],
)
def test_mistakes_in_an_evaluation_are_named_before_any_work(tmp_path, changes, messages):
    overrides = [part for change in changes for part in ("--set", change)]
    text = mistake(*EVALUATE, *overrides, "--out", tmp_path / "out")
    for message in messages:
        assert message in text
    assert not (tmp_path / "out").exists()


@pytest.mark.every(
    ("change", "message"),
    [
        ("model=rigg", "no model 'rigg' (did you mean 'rig'?)"),
        ("reality.coulomb_friction.force=-1", "reality.coulomb_friction.force: "),
        ("walk.regimes=true", "walk: machine 'rig' does not take this key"),
        ("duration=0", "duration: Input should be greater than 0"),
        ("duration=0.001", "record for longer"),
        ("name=../up", "name: "),
        ("format=xlsx", "format: Input should be 'csv' or 'parquet'"),
    ],
)
def test_mistakes_in_a_recording(rig_config, tmp_path, change, message):
    assert message in mistake("record", rig_config, "--set", change, "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.every("command", ["train", "evaluate", "record"])
def test_a_missing_config_is_named(command, tmp_path):
    assert f"{tmp_path}/nowhere.yaml: no such file" in mistake(command, tmp_path / "nowhere.yaml")


def test_a_folder_is_no_config(tmp_path):
    assert str(tmp_path) in mistake("evaluate", tmp_path)


def test_an_unwritable_result_folder_is_named(rig_config, tmp_path):
    (tmp_path / "file").write_text("")
    assert "file" in mistake("record", rig_config, "--out", tmp_path / "file" / "out")


def test_missing_arguments_explain_themselves():
    assert run("diagnose", "data.csv").exit_code == 2
    assert run("evaluate").exit_code == 2
    assert run("nonsense").exit_code == 2


def test_a_mistake_in_a_process_of_its_own_has_no_traceback(tmp_path):
    result = shell("evaluate", "nowhere.yaml", cwd=tmp_path)
    assert result.returncode == 2
    assert result.stdout == ""
    assert result.stderr == "Error: nowhere.yaml: no such file\n"


def test_problems_of_a_file_are_counted_once(tmp_path):
    path = tmp_path / "bench.csv"
    path.write_text("t,force,position\n0,a,0\n0.01,b,0\n")
    text = mistake("diagnose", path, "--machine", "rig")
    assert text.startswith(f"Error: {path}: 2 problems\n")
    assert "mistakes" not in text


@pytest.mark.every(
    ("arguments", "messages"),
    [
        (["--machine", "rigg"], ["no model 'rigg' (did you mean 'rig'?)"]),
        (
            ["--machine", "rig", "--set", "mas=1", "--set", "mass=heavy", "--set", "mass=-1"],
            [
                "--set mas=1: rig has no base parameter 'mas' (did you mean 'mass'?)",
                "--set mass=heavy: write --set mass=NUMBER",
                "--set mass=-1: 'mass' = -1.0 is outside",
            ],
        ),
        (
            ["--machine", "rig", "--column", "positon=x", "--column", "force"],
            [
                "--column positon=x: rig has no signal 'positon' (did you mean 'position'?)",
                "--column force: write --column signal=column",
            ],
        ),
        (["--machine", "rig"], ["nowhere.csv"]),
    ],
)
def test_mistakes_in_a_diagnosis(tmp_path, arguments, messages):
    text = mistake("diagnose", tmp_path / "nowhere.csv", *arguments, "--out", tmp_path / "out")
    for message in messages:
        assert message in text
    assert not (tmp_path / "out").exists()


@pytest.mark.nightly
def test_diagnose_reads_what_record_wrote_and_finds_what_it_hid(rig_config, tmp_path):
    settings = ("--set", "duration=20", "--set", "reality.coulomb_friction.force=0.6")
    for seed in (1, 2):
        run("record", rig_config, *settings, "--set", f"seed={seed}", "--out", tmp_path / str(seed))
    result = run(
        "diagnose",
        tmp_path / "1" / "rig.csv",
        "--test",
        tmp_path / "2" / "rig.csv",
        "--machine",
        "rig",
        "--out",
        tmp_path / "out",
        "--json",
    )
    assert result.exit_code == 0, result.output
    diagnosis = json.loads(result.stdout, parse_constant=pytest.fail)
    assert diagnosis["verdict"] == "named"
    assert [cause["effect"] for cause in diagnosis["causes"]] == ["coulomb_friction"]
    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    # Hysteresis over a tiny distance is Coulomb friction: what would distinguish them may be planned.
    planned = ["next_input.csv", "next_record.yaml"] if diagnosis["next_measurement"] else []
    assert names == sorted(["diagnosis.json", "extended.yaml", "figures", "report.html", *planned])
    assert json.loads((tmp_path / "out" / "diagnosis.json").read_text()) == diagnosis


def test_what_a_diagnosis_found_reads_in_the_terminal():
    from rich.console import Console

    from fieldagents.findings import show

    gain = {"percent": 52.1, "ci95": [48.0, 61.0]}
    diagnosis = {
        "verdict": "named",
        "causes": [
            {
                "effect": "coulomb_friction",
                "cause": "Dry friction.",
                "where": "force",
                "parameters": {"torque": {"value": 0.18, "std": 0.01, "unit": "N m"}},
                "gain": {"signal": "angle", **gain},
                "alternatives": [],
            }
        ],
        "gain": {"angle": {"unit": "rad", "rmse_before": 0.66, "rmse_after": 0.15, "horizon_s": 0.2, **gain}},
        "next_measurement": None,
    }
    console = Console(width=120, record=True)
    show(diagnosis, console, ["The simulation lacks Coulomb friction."])
    shown = console.export_text()
    answer, verdict, *_ = shown.strip().splitlines()
    assert (answer.strip(), verdict.strip()) == ("The simulation lacks Coulomb friction.", "Verdict: named")
    for part in ("named", "coulomb_friction", "0.180 ± 0.010 N m", "52.1 % (48.0 to 61.0)", "0.66", "0.2 s"):
        assert part in shown


def test_stock_effects_are_recorded_and_flown_from_a_file(tmp_path):
    """A hidden reality of stock effects goes through files: recorded, predicted, and flown by a task."""
    config = tmp_path / "record.yaml"
    config.write_text(
        "name: lazy\nmodel: line_following\nduration: 360\nsettings: {yaw: 0.0, lateral: 0.0, sensor: 0.0}\n"
        "reality: {steering_gain: {gain: 0.6}, steering_lag: {time_constant: 0.5}}\n"
    )
    result = run("record", config, "--out", tmp_path)
    assert result.exit_code == 0, result.output
    extended = tmp_path / "lazy.reality.yaml"
    walk = load_recording(tmp_path / "lazy.csv")
    nominal = get_model("line_following")
    model, truth = apply_reality(nominal, extended)
    windows = nominal.windows(walk, nominal.horizons[0])
    measured = windows.measured([s.name for s in nominal.outputs])

    def error(one, vector):
        return np.sqrt(np.nanmean((one.simulate(vector[None], windows)[0] - measured)[..., 2] ** 2))

    assert error(model, truth.vector(model)) < 0.02  # the tracker's noise
    assert error(nominal, nominal.nominal) > 0.04
    env = gymnasium.make("fieldgym/LineFollowing-v1", reality=str(extended)).unwrapped
    env.reset(seed=0)
    assert env.reality.effects["steering_lag"]["time_constant"] == 0.5
    config.write_text(config.read_text().replace("steering_lag", "steering_lak"))
    result = run("record", config, "--out", tmp_path)
    assert result.exit_code != 0
    assert "did you mean 'steering_lag'" in result.output
