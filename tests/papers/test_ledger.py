"""The ledger of claims: the rule of its verdicts, resuming, one failing claim, and every claim's data."""

import io
import json
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from pydantic import TypeAdapter
from rich.console import Console
from typer.testing import CliRunner

from fieldagents import task as tasks
from fieldagents.cli import app
from fieldmodels.code import files_reached
from papers import ledger as books
from papers import publish
from papers import run as running
from papers.claim import Claim, Decided, Ours, Statistic, at_least, at_most, decide, near, times
from papers.pages import show_ledger
from papers.source import Reproduction, all_sources, reproduces
from papers.statistics import exact, mean_of, median_of, share_of

CLAIMS = [(source, claim) for source in all_sources().values() for claim in source.claims.values()]


@pytest.mark.every(
    ("low", "high", "verdict"),
    [
        (9.5, 10.5, "reproduced"),
        (9.0, 11.0, "reproduced"),  # an end of the range still holds
        (8.9, 10.0, "undecided"),
        (10.9, 11.1, "undecided"),
        (5.0, 20.0, "undecided"),
        (11.1, 12.0, "refuted"),
        (7.0, 8.9, "refuted"),
    ],
)
def test_the_interval_decides(low, high, verdict):
    assert decide(Statistic((low + high) / 2, low, high), near(10, 1)) == verdict


def test_bounds_and_their_words():
    assert decide(exact(1e9), at_least(3)) == decide(exact(-1e9), at_most(3)) == "reproduced"
    assert decide(exact(2.9), at_least(3)) == decide(exact(3.1), at_most(3)) == "refuted"
    assert times(3e-4, 2) == (1.5e-4, 6e-4)
    words = [Claim("x", ("here",), "it", holds=h).condition for h in (near(10, 1), at_least(3), at_most(3))]
    assert words == ["9 to 11", "at least 3", "at most 3"]
    assert Claim("x", ("here",), "it").condition == ""


@pytest.mark.every("bad", [(1, 2, 3), (math.nan, math.nan, math.nan), (0, -math.inf, 1)])
def test_a_number_outside_its_interval_or_not_finite_is_refused(bad):
    with pytest.raises(ValueError, match="finite interval"):
        Statistic(*bad)


def decided(*numbers, holds=(0.0, 1.0), expected="reproduced"):
    readings = {f"reading {i}": Ours("run", "x") for i in range(len(numbers))}
    claim = Claim("x", ("Fig 1",), "it", holds=holds, ours=readings, depends_on="both", expected=expected)
    return Decided(claim, "task", dict(zip(readings, numbers, strict=True)))


def test_readings_that_differ_make_a_claim_depend_on_what_they_differ_in():
    one = decided(exact(0.5), exact(2), expected="depends")
    assert (one.verdict, one.words, one.unexpected) == ("depends", "depends on both", False)
    assert decided(exact(0.5), exact(2)).unexpected
    assert decided(exact(0.5), exact(0.6)).verdict == "reproduced"
    assert decided(exact(2), exact(3)).unexpected
    assert decided(exact(2), exact(3), expected="refuted").verdict == "refuted"
    assert decided(exact(0.5), Statistic(1, 0.5, 1.5)).verdict == "undecided"
    assert not decided(exact(0.5), Statistic(1, 0.5, 1.5)).unexpected
    assert decided(exact(0.5), None).verdict == "failed"
    assert decided(exact(0.5), None).unexpected


def test_intervals_cover():
    """Each covers its parameter in 95 of 100 cases: between 92 and 98 in 1000 (4 standard errors)."""
    rng = np.random.default_rng(0)
    hits = np.zeros(3)
    for _ in range(1000):
        x = rng.exponential(size=41)
        m, s = median_of(x), share_of(x < math.log(2))
        a = mean_of(rng.normal(5, 2, 9))
        hits += [m.low <= math.log(2) <= m.high, s.low <= 0.5 <= s.high, a.low <= 5 <= a.high]
    assert ((hits > 920) & (hits < 985)).all(), hits
    assert median_of(range(6)) == Statistic(2.5, 0, 5)
    assert share_of(np.ones(2000)).high == share_of(np.ones(2000)).value == 1.0
    with pytest.raises(ValueError, match="at least 6"):
        median_of([1, 2, 3, 4, 5])


@pytest.mark.every(("task", "claim"), CLAIMS)
def test_every_claim_names_what_decides_it_or_why_nothing_can(task, claim):
    assert claim.where
    assert claim.says.endswith(".")
    if claim.because:
        assert not claim.readings
        assert not claim.condition
        return
    assert claim.condition, "every value would be right"
    assert claim.expected in ("reproduced", "refuted", "depends")
    assert bool(claim.depends_on) == (len(claim.readings) > 1)
    assert claim.expected != "depends" or claim.depends_on
    assert claim.comment or claim.expected == "reproduced", "say why"
    for ours in claim.readings.values():
        entry = task.figures[ours.run]
        for option, value in {**entry.quick, **ours.options}.items():
            TypeAdapter(running.get_type_hints(entry.run, include_extras=True)[option]).validate_python(value)


def test_the_pages_are_current():
    """Renew with ``python -m papers.publish``."""
    assert (publish.FOLDER / "ledger.md").read_text() == publish.page()
    assert (publish.DOCS / "ledger.md").read_text() == publish.summary()


FIGURES = {
    "line_following": [*(f"Fig 3.{k}" for k in range(1, 18)), "eq (3.1)"],
    "uav_route": [*(f"Fig 4.{n}" for n in range(1, 7)), "Table 4.1", "Table 4.2"],
    "heel_strike": [f"Fig 2.{i}" for i in range(1, 24)],
    "pose_reaching": [f"Fig 5.{i}" for i in range(1, 11)],
    "excitation": [*(f"Fig {i}" for i in range(1, 14)), "Table I", "Table II"],
}
"""Numbered figures and tables of each source that the ledger covers; a source enters with its last claim."""


@pytest.mark.every("task", FIGURES)
def test_every_figure_and_table_is_in_the_ledger(task):
    listed = {place for claim in all_sources()[task].claims.values() for place in claim.where}
    assert not set(FIGURES[task]) - listed


@pytest.fixture
def small(monkeypatch):
    """Two runs and three claims in place of the tasks'."""
    done = []

    @reproduces("good", quick={"size": 5}, processor_s=(10, 2))
    def good(progress, *, size: int = 4) -> Reproduction:
        """Good."""
        done.append(("good", size))
        return Reproduction("a source", pd.DataFrame({"x": [1.0]}), statistics={"x": exact(size)})

    @reproduces("bad")
    def bad(progress) -> Reproduction:
        done.append(("bad",))
        raise RuntimeError("the leg fell")

    claims = (
        Claim("four", ("Fig 1",), "It is four.", "4", near(4, 0.5), Ours("good", "x")),
        Claim("broken", ("Fig 2",), "It runs.", "1", near(1, 1), Ours("bad", "x")),
        Claim("misspelt", ("Fig 3",), "It is y.", "1", near(1, 1), Ours("good", "y")),
        Claim("photo", ("Fig 4",), "A photograph.", because="a photograph"),
    )
    task = SimpleNamespace(
        name="small", figures={"good": good, "bad": bad}, claims={c.name: c for c in claims}
    )
    for module in (books, running):
        monkeypatch.setattr(module, "all_sources", lambda: {"small": task})
    task.code, task.done = "first", done
    return task


def test_one_failing_claim_is_listed_and_the_others_go_on(small, tmp_path):
    result = CliRunner().invoke(app, ["reproduce", "--all", "--out", str(tmp_path), "--json"])
    assert result.exit_code == 1
    assert "2 runs, 0 of them done before, and nobody has timed 1 of the others" in result.stderr
    data = json.loads(result.stdout, parse_constant=pytest.fail)
    verdicts = {one["name"]: one["verdict"] for one in data["claims"]}
    assert verdicts == {
        "small/four": "reproduced",
        "small/broken": "failed",
        "small/misspelt": "failed",
        "small/photo": "not computable",
    }
    errors = {one["name"]: one["ours"][0]["error"] for one in data["claims"] if one["ours"]}
    assert errors["small/broken"] == "RuntimeError: the leg fell"
    assert "good gives no 'y'" in errors["small/misspelt"]
    assert data["counts"] == {"reproduced": 1, "not computable": 1, "failed": 2}
    assert "the leg fell" in (tmp_path / "ledger.html").read_text()
    assert json.loads((tmp_path / "ledger.json").read_text()) == data


def test_a_finished_run_is_done_again_only_if_code_or_options_change(small, tmp_path):
    del small.claims["broken"], small.claims["misspelt"]
    first = books.decide(tmp_path)
    assert first.good
    again = books.decide(tmp_path)
    assert small.done == [("good", 4)]
    assert [outcome.resumed for outcome in again.runs.values()] == [True]
    assert again.claims == first.claims
    small.claims["four"] = Claim("four", ("Fig 1",), "It is five.", "5", near(5, 0.5), Ours("good", "x"))
    shifted = books.decide(tmp_path)  # another claim about the same run: only the verdict is new
    assert small.done == [("good", 4)]
    assert shifted.claims[0].verdict == "refuted"
    assert not shifted.good
    assert books.decide(tmp_path, quick=True).claims[0].verdict == "reproduced"
    assert small.done == [("good", 4), ("good", 5)]
    small.code = "second"
    books.decide(tmp_path)
    assert small.done == [("good", 4), ("good", 5), ("good", 4)]


def test_the_code_that_counts_reaches_kernels_and_tuned_values(monkeypatch):
    asked = []
    monkeypatch.setattr(tasks, "reached_code", lambda *given: asked.extend(given))
    assert all_sources()["heel_strike"].code is None
    files = {path.name for path in files_reached(*asked)}
    assert {"kernel.py", "equations.py", "tuned.json", "figures.py", "search.py"} <= files
    assert not {"claims.yaml", "cli.py", "pages.py"} & files


def every_claim() -> books.Ledger:
    """A ledger of all claims of all tasks, each with a long number, none of them run."""
    number = Statistic(-1234.5678, -123456.78, 0.000123456)
    found = [Decided(c, t.name, dict.fromkeys(c.readings, number), {"": "a fault"}) for t, c in CLAIMS]
    needed = books.needed([(task.name, claim) for task, claim in CLAIMS], quick=False)
    outcomes = {run: books.Outcome(run, {}, (), (), 1.0, resumed=False) for run in needed}
    return books.Ledger(tuple(found), outcomes, quick=False)


def test_no_line_of_the_terminal_exceeds_a_hundred_columns():
    console = Console(width=120, record=True, file=io.StringIO())
    show_ledger(every_claim(), console)
    text = console.export_text()
    assert max(map(len, map(str.rstrip, text.splitlines()))) <= 100
    assert "Fig 2.12" in text
    assert "…" not in text


def test_a_wide_table_is_cut_into_blocks_without_a_cut_word(tmp_path):
    out = ["--set", "episodes=3", "--out", str(tmp_path)]
    result = CliRunner().invoke(app, ["reproduce", "excitation/table-1", *out])
    lines = [line for line in result.stdout.splitlines() if str(tmp_path) not in line]
    assert max(map(len, lines)) <= 100
    assert "…" not in result.stdout
    assert result.stdout.count("damping_pitch") > 1  # each block begins with the first column


@pytest.mark.every(
    ("arguments", "words"),
    [
        (["--all", "heelstrike"], "did you mean 'heel_strike'"),
        (["--all", "--set", "a=1"], "--set goes with a single table"),
        (["--quick"], "--quick goes with --all"),
    ],
)
def test_mistakes(arguments, words, tmp_path):
    result = CliRunner().invoke(app, ["reproduce", *arguments, "--out", str(tmp_path / "x")])
    assert result.exit_code == 2
    assert words in result.stderr
    assert not Path(tmp_path / "x").exists()
