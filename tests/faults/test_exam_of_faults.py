"""The exam of faults judges what it is there to judge: each outcome is told from the others."""

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from exam import degenerate as room
from exam.degenerate import run_cases, summary
from exam.hostile import KINDS, Case, bench, cases_of, table
from fieldagents.cli import app
from fieldmodels.diagnosis.pilot import identifiable
from fieldmodels.recording import RecordingError
from fieldmodels.recording.files import load_recording
from fieldmodels.registry import get_model


def said(stdout="", stderr="", code=0, files=()):
    """A command that behaves so."""

    def command(words):
        out = Path(words[words.index("--out") + 1])
        out.mkdir()
        for name, text in files:
            (out / name).write_text(text)
        os.write(1, stdout.encode())
        os.write(2, stderr.encode())
        if code == "loop":
            while True:
                pass
        raise SystemExit(code)

    return command


NAMED = json.dumps({"verdict": "named", "causes": [{"effect": "backlash"}]})
OUTCOMES = {
    "answered": said(json.dumps({"verdict": "consistent", "causes": []})),
    "refused": said(stderr="Error: log.csv: no", code=2),
    "traceback": said(stderr="Traceback (most recent call last):\n  File x\nKeyError: 1", code=1),
    "bare warning": said("{}", "/lib/x.py:3: RuntimeWarning: overflow encountered in exp\n  np.exp(x)"),
    "false name": said(NAMED),
    "torn file": said("{}", files=[("diagnosis.json", "{half")]),
    "died": said(code=7),
    "hang": said(code="loop"),
}


@pytest.mark.every("outcome", OUTCOMES)
def test_an_outcome_is_what_it_is(tmp_path, monkeypatch, outcome):
    monkeypatch.setattr(room, "PROCESSOR_S", 1)
    monkeypatch.setattr(room, "_warm", lambda command: None)
    rows = run_cases([Case("dead", 0)], tmp_path, OUTCOMES[outcome], workers=1, progress=lambda *_: None)
    assert [row["outcome"] for row in rows] == [outcome]
    assert len(summary(rows)["faults"]) == (outcome not in ("answered", "refused"))
    again = run_cases([Case("dead", 0)], tmp_path, said(code=9), workers=1, progress=lambda *_: None)
    assert again == rows  # it goes on where it stopped


@pytest.mark.every("kind", KINDS)
def test_a_case_is_made_from_its_number_alone(tmp_path, kind):
    made, folder = [], tmp_path / "case"
    for _ in range(2):
        folder.mkdir()
        words = Case(kind, 3).make(folder)
        made.append((words, sorted((p.name, p.read_bytes()) for p in folder.iterdir())))
        shutil.rmtree(folder)
    assert made[0] == made[1]


def test_a_sample_has_every_kind():
    cases = cases_of(108)
    assert {case.kind for case in cases[:54]} == set(KINDS)
    assert len({case.key for case in cases}) == 108


@pytest.mark.every("size", [1e-300, 1e-150, 1e-30])
def test_a_motion_that_nothing_can_measure_is_refused_before_the_work(tmp_path, size):
    values = bench(np.random.default_rng(0), 200)
    values[:, 2] *= size
    log = load_recording(table(tmp_path / "log.csv", values), get_model("rig"))
    with pytest.raises(RecordingError, match="position never changes, whatever is commanded"):
        identifiable(get_model("rig"), [log], {})


@pytest.mark.nightly
def test_a_sensor_that_is_dead_in_some_of_many_records_is_said_of_each_and_nothing_is_named(tmp_path):
    paths = []
    for number in range(6):
        values = bench(np.random.default_rng(number), 200)
        values[:, 2] *= number not in (1, 4)
        paths.append(str(table(tmp_path / f"log{number}.csv", values)))
    words = ["diagnose", *paths, "--machine", "rig", "--out", str(tmp_path / "out"), "--json"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    said = [line for line in done.stderr.splitlines() if "'position' never changes" in line]
    assert [path for path in paths if any(path in line for line in said)] == [paths[1], paths[4]]
    found = json.loads(done.stdout)
    assert found["causes"] == []
    assert found["verdict"] == "unknown"
