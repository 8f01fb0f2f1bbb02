"""A plan before the work: it is said, refuses what cannot end, and changes no result."""

import json
import re
from collections import Counter
from pathlib import Path

import pytest
from typer.testing import CliRunner

from fieldagents import plan
from fieldagents.cli import app
from fieldagents.config import load_config
from fieldagents.evaluation import play
from fieldagents.evaluation.config import EvaluateConfig
from fieldagents.evaluation.evaluate import evaluate
from fieldagents.learned.config import TrainConfig
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
    "record": "recorded rows:rig", "train": "steps:heel_strike/PPO", "evaluate": "played:heel_strike/ranger",
           "sweep": "steps:heel_strike/PPO", "exam": "cases:rig", "reproduce": "seconds:any"}  # fmt: skip


@pytest.mark.every("command", COMMANDS)
def test_a_plan_counts_work_and_writes_nothing(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = run(command, *COMMANDS[command], "--dry-run", "--json", "--out", tmp_path / "a" / "b")
    assert done.exit_code == 0, done.output
    said = json.loads(done.stdout)
    assert said["work"][COUNTED[command]] > 0
    assert said["processor_s"] > 0
    assert list(tmp_path.iterdir()) == []


def test_a_diagnosis_says_what_its_data_can_tell(log, tmp_path):
    done = run("diagnose", log, "--machine", "rig", "--dry-run", "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    assert "600 rows" in done.stdout
    assert "can be told: mass, damping, stiffness" in done.stdout
    assert "absorb: payload, actuator_gain" in done.stdout  # a load is more mass, a gain scales all three
    known = run(
        "diagnose", log, "--machine", "rig", "--set", "mass=1.2", "--set", "stiffness=30", "--dry-run"
    )
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


@pytest.mark.every("place", ["/dev/null/x", "/dev/full/x"])
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


SMALL = {
    "excitation/ppo": ["steps=900", "num_envs=16", "learner.batch_size=200", "learner.n_epochs=2"],
    "heel_strike/ppo": ["steps=5000", "validation.every=1", "environment.settings.strides=8"],
    "line_following/ppo": ["steps=4000", "also=[{settings: {track: s}}]", "num_envs=32"],
    "pose_reaching/sac": ["steps=1750", "round_updates=2", "validation.every=2"],
    "uav_route/ppo": ["steps=9000", "environment.settings.aircraft=2"],
}  # fmt: skip


@pytest.fixture
def done(tmp_path, monkeypatch):
    """What is really done, by the names of counted work."""
    from fieldagents.tasks.uav_route import kept_bounds, lower_bound

    monkeypatch.setattr(kept_bounds.platformdirs, "user_cache_dir", lambda _: str(tmp_path / "cache"))
    lower_bound._bound_to_capture.cache_clear()
    counts = Counter()

    def counted(room, name, work):
        own = getattr(room, name)

        def instead(*given, **named):
            counts.update(work(*given, **named))
            return own(*given, **named)

        monkeypatch.setattr(room, name, instead)

    counted(play, "play_episodes", lambda *of: {"played": len(of[3]) if len(of) > 4 else 0})
    return counts, counted, lambda: lower_bound._bound_to_capture.cache_info().misses


@pytest.mark.parametrize("name", SMALL)
def test_a_training_does_what_its_plan_counts(name, tmp_path, done, capsys):
    pytest.importorskip("stable_baselines3")
    from stable_baselines3 import PPO, SAC
    from torch.optim import Adam

    from fieldagents.learned import recorder
    from fieldagents.learned.training import train
    from fieldgym.sb3 import NativeVecEnv

    counts, counted, proven = done
    counted(NativeVecEnv, "step_wait", lambda envs: {"calls": 1, "steps": envs.num_envs})
    counted(recorder, "run_episodes", lambda *of: {"validations": 1, "validated": len(of[3])})
    counted(SAC, "train", lambda _, gradient_steps, batch_size: {"batches": gradient_steps})
    config = load_config(Path(name), TrainConfig, [*SMALL[name], "validation.episodes=3"])
    if issubclass(config.kind, PPO):
        counted(Adam, "step", lambda *_: {"batches": 1})
    planned = plan.of_training(config, tmp_path).work
    train(config, out=tmp_path / "run")
    small = {kind.partition(":")[0]: units for kind, units in planned.items()}
    small |= {kind: round(1000 * small[kind]) for kind in ("steps", "calls", "batches")}
    assert {kind: small[kind] for kind in counts} == counts
    routes = config.task == "uav_route"
    assert small.get("bounds", 0) == proven() == 2 * 3 * routes
    assert ("Proving bounds of 6 layouts (0 of 6)" in capsys.readouterr().err) == routes


def test_an_evaluation_does_what_its_plan_counts(tmp_path, done):
    counts, _, proven = done
    places = {"one": {}, "another": {"settings": {"threshold": 0.4}}}
    given = {"name": "e", "task": "uav_route", "environments": places, "episodes": 3}
    config = EvaluateConfig(**given, agents=["straight", "ppo"], baseline="straight")
    planned = plan.of_evaluation([config], "e", tmp_path, HERE).work
    evaluate(config, tmp_path)
    assert proven() == planned["bounds:uav_route"] == 2 * 3
    assert counts["played"] >= planned["played:uav_route/straight"] + planned["played:uav_route/ppo"] == 12
