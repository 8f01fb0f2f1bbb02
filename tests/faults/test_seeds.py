"""A seed decides all randomness of a run, and what is no seed is refused before the work."""

import sys
from pathlib import Path

import pytest
from typer.main import get_command
from typer.testing import CliRunner

from fieldagents.cli import app
from fieldagents.config import load_config
from fieldagents.sweep.config import TuneConfig

sys.path.insert(0, str(Path(__file__).parent))

import disk
import matrix

WATCH = ["watch", "heel_strike", "--agent", "sensor_only", "--seconds", "0.3", "--json"]
OPTION = {
    "train": lambda folder: matrix.prepared(folder, "train"),
    "diagnose": lambda folder: matrix.prepared(folder, "diagnose"),
    "watch": lambda folder: WATCH,
}
"""What goes before ``--seed`` of every command that has it."""
KEY = {"record": lambda folder: matrix.prepared(folder, "record"), "train": OPTION["train"]}
"""Likewise of those that take ``--set seed=``."""
WRONG = ("-1", "two", "1.5", "", "inf", "nan", "4294967296", "1" + 400 * "0", "1" + 5000 * "0")


def test_every_command_with_a_seed_is_here():
    commands = get_command(app).commands.items()
    assert {name for name, one in commands if "seed" in {p.name for p in one.params}} == set(OPTION)


def refused(words, folder):
    done = CliRunner().invoke(app, [*words, "--out", str(folder / "out.gif")])
    assert done.exit_code == 2, done.output
    assert isinstance(done.exception, SystemExit)
    assert done.stdout == ""
    assert "seed" in done.stderr
    assert done.stderr.count("Error") == 1
    assert not (folder / "out.gif").exists()


@pytest.mark.every("wrong", WRONG)
def test_what_is_no_seed_is_refused_before_the_work(tmp_path, wrong):
    refused(["diagnose", "log.csv", "--machine", "rig", "--seed", wrong], tmp_path)
    refused([*WATCH, "--seed", wrong], tmp_path)
    refused([*OPTION["train"](tmp_path), "--seed", wrong], tmp_path)
    for command in KEY.values():
        refused([*command(tmp_path), "--set", f"seed={wrong}"], tmp_path)


def test_no_seed_of_a_search_is_larger_than_its_sampler_takes(tmp_path):
    config = Path(__file__).parents[2] / "configs" / "heel_strike" / "tune.yaml"
    assert load_config(config, TuneConfig, ["seed=4294967295"]).seed == 2**32 - 1
    with pytest.raises(ValueError, match="seed: Input should be less than or equal to 4294967295"):
        load_config(config, TuneConfig, ["seed=4294967296"])


def outcome(words, out):
    """The files of a command but those that hold a clock's time or the seed itself."""
    code, said = disk._told([*words, "--out", str(out)])
    assert code == 0, said
    if out.is_file():
        return {out.suffix: out.read_bytes()}
    names = [str(path.relative_to(out)) for path in sorted(out.rglob("*")) if path.is_file()]
    volatile = {*disk.VOLATILE, "tensorboard", "config.yaml"}
    return {name: (out / name).read_bytes() for name in names if not {*Path(name).parts} & volatile}


@pytest.mark.nightly
@pytest.mark.parametrize("name", [*OPTION, "record"])
def test_a_seed_decides_the_result(tmp_path, name):
    words = {**KEY, **OPTION}[name](tmp_path)
    ends = [["--seed", n] if name in OPTION else ["--set", f"seed={n}"] for n in ("7", "7", "8")]
    suffix = ".gif" if name == "watch" else ""
    first, again, other = (outcome([*words, *end], tmp_path / f"{k}{suffix}") for k, end in enumerate(ends))
    assert first == again
    assert first.keys() == other.keys()
    assert first != other
