"""Tables and figures of the sources: what is listed runs, and the numbers that the sources print come out."""

import inspect
import json
from typing import get_type_hints

import pandas as pd
import pytest
from pydantic import TypeAdapter
from typer.testing import CliRunner

from fieldagents.cli import app
from papers.run import ReproductionError, reproduce, reproducible
from papers.source import Reproduction


def run(*arguments: object):
    return CliRunner().invoke(app, ["reproduce", *map(str, arguments)])


@pytest.mark.every("name", reproducible())
def test_every_entry_has_a_function_with_typed_options(name):
    entry = reproducible()[name]
    assert get_type_hints(entry.run)["return"] is Reproduction
    positional = [p for p in inspect.signature(entry.run).parameters.values() if p.kind is not p.KEYWORD_ONLY]
    assert len(positional) == 1
    assert entry.title
    types = get_type_hints(entry.run, include_extras=True)
    for option, default in entry.options.items():
        TypeAdapter(types[option]).validate_python(default)


def test_files_are_written_and_the_decay_of_figure_2_12_comes_out(tmp_path):
    result = reproduce("heel_strike/figure-2.12", tmp_path, ["strides=200"])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["figures", "report.html", "table.csv"]
    table = pd.read_csv(tmp_path / "table.csv")
    assert len(table) == len(result.table) == 20
    best = table.loc[table["ours: mean |error| [mm]"].idxmin()]
    assert best["S_FD [1/s]"] == 333
    assert best["printed best"] == "best"
    page = (tmp_path / "report.html").read_text()
    assert "<svg" in page
    assert "2 / (3 dt)" in page


def test_figures_2_9_and_2_10_have_the_printed_size(tmp_path):
    """Medians of 40 walks scatter by 10 %."""
    table = reproduce("heel_strike/figure-2.10", tmp_path, ["walks=40"]).table
    gyro, low_pass, ar1 = table["ours: median of the walks"]
    assert 2e-4 < gyro < 7e-4
    assert 0.7e-3 < low_pass < 2e-3
    assert ar1 > 20e-3  # the text's amplitude contradicts the figure


def test_more_process_noise_wants_more_of_the_sensor(tmp_path):
    table = reproduce("heel_strike/figure-2.14", tmp_path, ["strides=400"]).table
    best = table.pivot_table(index="hold [s]", columns="process noise [rad/s2]", values=table.columns[2])
    assert (best[0.9] > best[0.1] + 0.4).all()
    assert best.loc[0.4].mean() > best.loc[0.1].mean()


def test_the_command_lists_and_prints_json(tmp_path):
    listed = json.loads(run("--json").stdout)["entries"]
    assert [entry["name"] for entry in listed] == list(reproducible())
    assert "heel_strike/figure-2.12" in run().stdout
    assert "…" not in run().stdout
    done = run("heel_strike/figure-2.12", "--set", "strides=50", "--out", tmp_path / "new", "--json")
    result = json.loads(done.stdout, parse_constant=pytest.fail)
    assert len(result["table"]) == 20
    assert set(result["files"]) == {"table.csv", "figures/figure-2.12.png", "report.html"}


def test_mistakes_come_all_at_once_before_any_work(tmp_path):
    with pytest.raises(ReproductionError, match=r"did you mean 'heel_strike/figure-2\.12'"):
        reproduce("heel_strike/figure_2.12", tmp_path / "x")
    with pytest.raises(ReproductionError) as caught:
        reproduce(
            "heel_strike/figure-2.12", tmp_path / "x", ["stride=9", "strides=many", "strides=1", "strides"]
        )
    text = str(caught.value)
    assert "--set stride=9: heel_strike/figure-2.12 has no option 'stride' (did you mean 'strides'?)" in text
    assert "--set strides=many: Input should be a valid integer" in text
    assert "--set strides=1: Input should be greater than or equal to 10" in text
    assert "--set strides: write --set option=value" in text
    assert not (tmp_path / "x").exists()
