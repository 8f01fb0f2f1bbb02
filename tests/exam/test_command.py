"""The command `fieldgym exam`: every set, whoever answers; what is done is kept."""

import json
import sys

import pytest
from typer.testing import CliRunner

from fieldagents.cli import app

CASE = "--set field --kind few_windows --machine motor --cases 1 --workers 0 --publish page.md"


def exam(words, code=0):
    done = CliRunner().invoke(app, ["exam", *words.split()])
    assert done.exit_code == code, done.output
    return done


def test_the_field_set_goes_on_and_a_rival_stands_beside_the_diagnosis(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page, log = tmp_path / "page.md", tmp_path / "results" / "exam-field" / "cases.jsonl"
    marks = [
        f"<!-- field by {by}: {edge} -->" for by in ("diagnosis", "forward") for edge in ("begin", "end")
    ]
    page.write_text("\n".join(marks))
    assert "| **all that count** | 1/1" in exam(CASE).stdout
    log.write_text(json.dumps(json.loads(log.read_text()) | {"seconds": 77.0}) + "\n")
    assert json.loads(exam(f"{CASE} --json").stdout)["cases"] == 1
    assert "| diagnosis | 1/1" in exam(f"{CASE} --by forward").stdout
    assert log.with_name("exam.json").exists()
    for words in ("**all that count**", "| 77.0 |", "| forward | "):  # the diagnosis was not asked again
        assert words in page.read_text()


@pytest.mark.every(
    ("words", "said"),
    [
        ("--set field --kind hills", "--set field: no kind of cases 'hills': it is of --set field-report"),
        ("--set field --kind few_window", "did you mean 'few_windows'?"),
        ("--set field --machine moter", "no machine 'moter' (did you mean 'motor'?)"),
        ("--set field --kind few_windows --machine tanks", "--set field: no such cases: leave out --kind or"),
        ("--kind singel", "no kind of cases 'singel' (did you mean 'single'?)"),
        ("--kind log --machine uav_route", "--set report: no such cases"),
        ("--kind degenerate --machine rig", "--kind degenerate: leave out other kinds, --machine"),
        ("--by sindy", "pip install pysindy"),
        ("--set feld", "'field-report'"),
    ],
)
def test_a_mistake_is_said_with_its_remedy(words, said, monkeypatch):
    monkeypatch.setitem(sys.modules, "pysindy", None)
    assert said in exam(f"{words} --dry-run", 2).stderr
