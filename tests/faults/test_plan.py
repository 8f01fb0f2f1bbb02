"""A plan before the work: it is said, refuses what cannot end, and changes no result."""

import json
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from fieldagents import plan
from fieldagents.cli import app
from fieldmodels.engine import HERE
from fieldmodels.yaml import save_yaml

RECORD = {"name": "log", "model": "rig", "excitation": {"amplitude": 3}, "duration": 6}


def run(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    folder = tmp_path_factory.mktemp("log")
    save_yaml(RECORD, folder / "record.yaml")
    assert run("record", folder / "record.yaml", "--out", folder / "out").exit_code == 0
    return folder / "out" / "log.csv"


COMMANDS = {
    "record": ["rig/record"],
    "train": ["heel_strike/ppo"],
    "evaluate": ["heel_strike/benchmark"],
    "sweep": ["heel_strike/sweep"],
    "exam": ["--set", "develop", "--machine", "rig", "--cases", "2"],
    "reproduce": ["heel_strike/figure-2.12"],
}
COUNTED = {
    "record": "recorded rows:rig", "train": "steps:heel_strike", "evaluate": "played:heel_strike/ranger",
           "sweep": "steps:heel_strike", "exam": "cases:rig", "reproduce": "seconds:any"}  # fmt: skip


@pytest.mark.parametrize("command", COMMANDS)
def test_a_plan_counts_work_and_writes_nothing(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = run(command, *COMMANDS[command], "--dry-run", "--json", "--out", tmp_path / "a" / "b")
    assert done.exit_code == 0, done.output
    said = json.loads(done.stdout)
    assert said["work"][COUNTED[command]] > 0
    assert said["processor_s"] > 0
    assert list(tmp_path.iterdir()) == []


def test_a_diagnosis_says_what_its_data_can_tell(log, tmp_path):
    done = run("diagnose", log, "--model", "rig", "--dry-run", "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    assert "600 rows" in done.stdout
    assert "can be told: mass, damping, stiffness" in done.stdout
    assert "absorb: payload, actuator_gain" in done.stdout  # a load is more mass, a gain scales all three
    known = run("diagnose", log, "--model", "rig", "--set", "mass=1.2", "--set", "stiffness=30", "--dry-run")
    assert "actuator_gain" not in known.stdout
    assert not (tmp_path / "out").exists()


def test_what_needs_more_memory_than_there_is_is_refused(tmp_path):
    words = ["--set", "duration=36000", "--set", "step=1e-6", "--out", tmp_path / "out"]
    done = run("record", "rig/record", *words)
    assert done.exit_code == 2
    assert "record 36000 s of rig (36,000,000,000 rows) needs about" in done.stderr
    assert not (tmp_path / "out").exists()


def test_what_would_take_years_is_refused(tmp_path):
    done = run("train", "heel_strike/ppo", "--set", "steps=1000000000000000", "--out", tmp_path / "out")
    assert done.exit_code == 2
    assert "would take about" in done.stderr
    assert "years" in done.stderr


@pytest.mark.parametrize("place", ["/dev/null/x", "/dev/full/x"])
def test_a_place_that_cannot_be_written_is_refused_by_a_dry_run(place):
    done = run("record", "rig/record", "--dry-run", "--out", place)
    assert done.exit_code == 2
    assert "name another place" in done.stderr


def test_no_result_depends_on_the_prices(log, tmp_path, monkeypatch):
    monkeypatch.setattr(plan, "price", lambda kind: 1e-3)
    save_yaml(RECORD, tmp_path / "record.yaml")
    assert run("record", tmp_path / "record.yaml", "--out", tmp_path / "out").exit_code == 0
    assert (tmp_path / "out" / "log.csv").read_bytes() == log.read_bytes()


def test_a_name_that_was_not_timed_has_the_price_of_its_kind(monkeypatch):
    prices = {"start:diagnose": 0.0, "cases:a": 1.0, "cases:b": 3.0, "cases:c": 9.0, "rows:a": 7.0}
    monkeypatch.setattr(plan, "_recorded", lambda: {"prices": prices, "machine_s": 1.0, "guessed": {}})
    assert plan.price("cases:c") == 9.0
    assert plan.price("cases:new") == 3.0
    counted = plan.of_exam(["a", "a", "new"], Path("out"), HERE).recorded_s
    assert counted == pytest.approx(2 * 1.0 + 3.0)


def test_every_kind_of_work_has_a_price():
    kinds = {name.partition(":")[0] for name in plan._recorded()["prices"]} | {*plan._recorded()["guessed"]}
    source = Path(plan.__file__).read_text()
    counted = set(re.findall(r'"([a-z ]+):[{a]', source))
    assert len(counted) > 10
    assert counted <= kinds
