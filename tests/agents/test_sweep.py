"""Sweeps: the grid is whole, a search repeats to the bit, keeps its budget, and goes on where it stopped."""

import json
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest
from typer.testing import CliRunner

from fieldagents.cli import app
from fieldagents.config import ConfigError, load_config
from fieldagents.learned.config import TrainConfig
from fieldagents.learned.training import train
from fieldagents.sweep import jobs
from fieldagents.sweep.config import SweepConfig, TuneConfig, changed
from fieldagents.sweep.grid import sweep
from fieldagents.sweep.jobs import train_job, trained
from fieldagents.sweep.run import load
from fieldagents.sweep.tune import tune
from fieldmodels.engine import Engine
from fieldmodels.engine.job import perform

CONFIGS = Path(__file__).parents[2] / "configs"
TINY = {
    "steps": 1600,
    "num_envs": 8,
    "learner.n_steps": 10,
    "learner.batch_size": 80,
    "validation.every": 5,
    "validation.episodes": 4,
    "environment.settings.strides": 10,
}
SETTINGS = {"settings": {"strides": 10}}


def grid(**values: object) -> SweepConfig:
    rest = {"grid": {"seed": [0, 1], "learner.gamma": [0.3, 0.6]}, **values}
    return SweepConfig.model_validate({"name": "tiny", "train": ["heel_strike/ppo"], "change": TINY, **rest})


def search(**values: object) -> TuneConfig:
    study = {
        "train": "heel_strike/ppo",
        "change": TINY,
        "search": {
            "learner.learning_rate": {"log_uniform": [1e-4, 1e-2]},
            "network.hidden": {"choice": [[8], [16, 16]]},
        },
    }
    gains = {key: {"log_uniform": [1e-3, 1.0]} for key in ("early", "late", "reset")}
    agent = {"agent": "fieldagents.tasks.heel_strike.tuning:fixed_gains", "search": gains}
    whole = {
        "name": "t",
        "task": "heel_strike",
        "environment": SETTINGS,
        "budget": 9600,
        "episodes": 4,
        "batch": 3,
    }
    return TuneConfig.model_validate({**whole, "studies": {"ppo": study, "gains": agent}, **values})


@pytest.mark.nightly
def test_a_grid_trains_every_combination_once_and_as_train_does(tmp_path):
    table = sweep(grid(), tmp_path / "here")
    assert list(table["learner.gamma"]) == [0.3, 0.6]
    assert list(table["count"]) == [2, 2]
    runs = pd.read_csv(tmp_path / "here" / "runs.csv")
    assert runs["seed"].tolist() == [0, 0, 1, 1]
    assert math.isclose(table["mean"][0], runs["score"][[0, 2]].mean())
    assert (runs["steps"] == 1600).all()
    alone = train(
        changed("heel_strike/ppo", TINY | {"seed": 1, "learner.gamma": 0.6}),
        out=tmp_path / "x",
        progress=False,
    )
    same = tmp_path / "here" / runs["run"][3]
    for name in ("policy.onnx", "curve.csv", "config.yaml"):
        assert (alone / name).read_bytes() == (same / name).read_bytes()
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "here").rglob("policy.onnx")}
    wider = grid(grid={"seed": [0, 1, 2], "learner.gamma": [0.3, 0.6]})
    sweep(wider, tmp_path / "here", engine=Engine(workers=2))
    after = {path: path.stat().st_mtime_ns for path in (tmp_path / "here").rglob("policy.onnx")}
    assert len(after) == 6
    assert before.items() <= after.items()  # only what was missing


def test_a_run_in_two_parts_is_the_run_in_one(tmp_path):
    config = changed("heel_strike/ppo", TINY)
    whole = perform(train_job(config, "", tmp_path / "whole"))
    first = perform(train_job(config, "", tmp_path / "parts", until=700))
    second = perform(train_job(config, "", tmp_path / "parts"))
    assert first.result["steps"] == 800  # up to the next validation
    assert first.job.key != second.job.key
    assert whole.result == second.result
    for name in ("policy.onnx", "curve.csv"):
        assert (whole.job.folder / name).read_bytes() == (second.job.folder / name).read_bytes()
    again = trained(config, 800, second.job.folder, lambda *_: None)  # asked for less than there is
    assert again == first.result


@pytest.fixture(scope="module")
def searched(tmp_path_factory):
    out = tmp_path_factory.mktemp("search")
    return tune(search(), out), out


@pytest.mark.nightly
def test_a_search_keeps_equal_budgets_and_prunes(searched):
    found, out = searched
    for trials in found.values():
        assert sum(trial.steps for trial in trials) <= 9600
        assert len(trials) > 5
    assert found["ppo"][0].values == {}  # the config as it is, to compare with
    pruned = [trial for trial in found["ppo"] if trial.pruned]
    assert pruned
    assert all(trial.steps < 1600 and len(trial.scores) < 3 for trial in pruned)
    assert all(trial.steps == 4 * 10 and len(trial.scores) == 1 for trial in found["gains"])
    best = load_config(out / "ppo.yaml", TrainConfig)
    whole = {trial.scores[-1]: trial.values for trial in found["ppo"] if not trial.pruned}
    assert whole[min(whole)].get("learner.learning_rate", 1e-3) == best.learner["learning_rate"]
    assert best.environment.settings == SETTINGS["settings"]
    stored = json.loads((out / "tune.json").read_text(), parse_constant=pytest.fail)
    assert len(stored["studies"]["ppo"]) == len(found["ppo"])


@pytest.mark.nightly
def test_a_search_goes_on_from_what_there_is(searched):
    found, out = searched
    times = {path: path.stat().st_mtime_ns for path in out.rglob("policy.onnx")}
    assert tune(search(), out) == found
    assert {path: path.stat().st_mtime_ns for path in out.rglob("policy.onnx")} == times


@pytest.mark.nightly
def test_a_search_gives_the_same_in_processes(tmp_path):
    whole = search(budget=4800, rungs=[0.5])
    config = whole.model_copy(
        update={"studies": {"ppo": whole.studies["ppo"]}}
    )  # few batches: each starts processes
    assert tune(config, tmp_path / "there", engine=Engine(workers=2)) == tune(config, tmp_path / "here")


def test_a_search_finds_better_gains_than_it_began_with(tmp_path):
    config = search(budget=40 * 60)
    trials = tune(config.model_copy(update={"studies": {"gains": config.studies["gains"]}}), tmp_path)[
        "gains"
    ]
    scores = [trial.scores[-1] for trial in trials]
    assert len(scores) == 60
    assert sum(scores[-20:]) < 0.8 * sum(scores[:20])


@pytest.mark.nightly
def test_sigterm_keeps_a_checkpoint_and_says_how_to_go_on(tmp_path):
    changes = TINY | {"steps": 10_000_000, "validation.every": 10**6}
    sets = [part for key, value in changes.items() for part in ("--set", f"{key}={json.dumps(value)}")]
    command = [
        sys.executable,
        "-c",
        "from fieldagents.cli import main; main()",
        "train",
        "heel_strike/ppo",
        *sets,
    ]
    process = subprocess.Popen(
        [*command, "--out", str(tmp_path / "run")], stderr=subprocess.PIPE, text=True, env=dict(os.environ)
    )
    curve = tmp_path / "run" / "curve.csv"
    end = time.monotonic() + 120
    while not curve.exists():
        assert process.poll() is None, process.stderr.read()
        assert time.monotonic() < end
        time.sleep(0.05)
    process.send_signal(signal.SIGTERM)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert f"Stopped: go on with --resume {tmp_path / 'run'}" in said
    steps = [int(path.stem) for path in (tmp_path / "run" / "checkpoints").glob("*.pt")]
    assert max(steps) == int(curve.read_text().splitlines()[-1].split(",")[0])  # the very last round


@pytest.mark.every("name", [f"{p.parent.name}/{p.stem}" for p in sorted(CONFIGS.glob("*/sweep.yaml"))])
def test_shipped_grids_load(name):
    assert len(load_config(Path(name), SweepConfig).runs) >= 10


@pytest.mark.every("name", [f"{p.parent.name}/{p.stem}" for p in sorted(CONFIGS.glob("*/tune.yaml"))])
def test_shipped_searches_load(name):
    config = load_config(Path(name), TuneConfig)
    for study in config.studies.values():
        if study.train:
            assert config.budget >= 8 * changed(study.train, study.change).steps


@pytest.mark.every(
    ("text", "words"),
    [
        ("train: [heel_strike/ppo]\ngrid: {learner.gama: [0.5]}", "unknown key (did you mean 'gamma'?)"),
        ("train: [heel_strike/pppo]", "did you mean"),
        ("task: heel_strike\nbudget: 9\nstudies: {a: {search: {x: {uniform: [0, 1]}}}}", "either a config"),
        (
            "task: heel_strike\nbudget: 9\nstudies: {a: {agent: 'math:sin', search: {x: {normal: [0, 1]}}}}",
            "x: a search needs ends",
        ),
        (
            "task: heel_strike\nbudget: 9\nstudies: {a: {train: uav_route/ppo, search: {seed: {choice: [1]}}}}",  # noqa: E501
            "trains uav_route, not heel_strike",
        ),
    ],
)
def test_mistakes_are_said_before_anything_runs(text, words, tmp_path):
    path = tmp_path / "bad.yaml"
    path.write_text(f"name: bad\n{text}\n")
    with pytest.raises(ConfigError) as caught:
        load(path, [])
    assert words in str(caught.value)


def test_a_failed_job_is_listed_and_the_exit_code_says_so(tmp_path, monkeypatch):
    """One of two runs is broken: the other one is trained and kept."""
    broken = jobs.prepare

    def prepare(config, folder):
        if config.seed == 1:
            raise RuntimeError("the disk is on fire")
        return broken(config, folder)

    monkeypatch.setattr(jobs, "prepare", prepare)
    (tmp_path / "two.yaml").write_text(json.dumps(grid(grid={"seed": [0, 1]}).model_dump(mode="json")))
    result = CliRunner().invoke(
        app, ["sweep", str(tmp_path / "two.yaml"), "--workers", "0", "--out", str(tmp_path / "out")]
    )
    assert result.exit_code == 1
    assert "1 of 2 jobs failed, the others are kept:" in result.stderr
    assert "seed=1: RuntimeError: the disk is on fire" in result.stderr
    assert len(list((tmp_path / "out").rglob("run.json"))) == 1
    assert len(list((tmp_path / "out").rglob("error.txt"))) == 1
