"""Logs of other people's making are read to the values that were measured, and reversed signs are said."""

import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from foreign import SETS, Log, text
from goals import MOST, actions

from fieldmodels.recording import Recording, RecordingError
from fieldmodels.recording.bench import Bench
from fieldmodels.recording.files import recording_of
from fieldmodels.recording.proposals import propose
from fieldmodels.recording.sources import read_log
from fieldmodels.registry import get_model
from fieldmodels.synthesis import synthesise


@pytest.fixture(scope="module", params=sorted(SETS))
def logs(request, tmp_path_factory) -> list[Log]:
    return SETS[request.param](tmp_path_factory.mktemp(request.param))


def read(log: Log) -> tuple[Recording, dict[str, float]]:
    """The recording as proposed, and each signal's gain."""
    table, model = read_log(log.source), get_model(log.run.model)
    proposal = propose(table, model, log.options.get("rate"))
    assert not proposal.missing, f"{log.about}: {proposal.missing}, {table.header}"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return recording_of(table, proposal.bench(), model), {c.role: c.gain for c in proposal.columns}


def wrong(log: Log) -> list[str]:
    """What differs from what was measured."""
    try:
        recording, gains = read(log)
    except (AssertionError, RecordingError) as error:
        return [str(error)]
    found = [] if set(recording.signals) == set(log.run.signals) else [f"signals {sorted(recording.signals)}"]
    if abs(recording.step / np.median(np.diff(log.run.time)) - 1) > 1e-3:
        found.append(f"step {recording.step}")
    for name in set(recording.signals) & set(log.run.signals):
        truth = np.interp(recording.time - recording.time[0] + log.late, log.run.time, log.run.signals[name])
        values = recording[name] * (np.ptp(truth) / np.ptp(recording[name]) if name in log.scaled else 1.0)
        error = np.quantile(np.abs(values - truth), 0.95) / np.std(
            truth
        )  # steps move by a row where clocks differ
        if error > 0.05 or (name == log.reversed) != (gains[name] < 0):
            found.append(f"{name}: off by {error:.2g} of its spread, gain {gains[name]:g}")
    return found


@pytest.mark.matrix(keep=("report",))
def test_logs_are_read_as_they_were_measured(logs):
    found = {log.about: said for log in logs if (said := wrong(log))}
    assert not found, "\n".join(f"{about}: {said}" for about, said in found.items())
    assert len(logs) == 20
    assert sum(bool(log.reversed) for log in logs) == 5


@pytest.mark.nightly
def test_logs_lead_to_the_right_cause(tmp_path):
    """The goals, by the command line alone; seconds are the processor's, so that load does not count."""
    rows = [actions(log, tmp_path / f"{k}") for k, log in enumerate(SETS["report"](tmp_path))]
    assert all(row["loaded"] and row["actions"] <= MOST for row in rows), rows
    right = [row for row in rows if row["right"] and row["seconds"] <= 60]
    assert len(right) >= 18, rows
    assert [row["reversed_said"] for row in rows if row["reversed"]] == [True] * 5


def test_two_loggers_may_count_time_in_units_of_their_own(tmp_path):
    """Milliseconds and seconds, 7 s apart: one clock, to a tenth of a step."""
    rig = get_model("rig")
    run = synthesise(rig, {}, "mixed", duration=20.0, step=0.01, amplitude=5.0, rng=np.random.default_rng(4))
    drive, daq = tmp_path / "drive.csv", tmp_path / "daq.csv"
    text(drive, ["time [ms],force,encoder"], [1e3 * run.time, run["force"], run["position"]])
    text(daq, ["t,position"], [run.time + 7.0, run["position"]])
    both = read_log(f"{drive}+{daq}")
    bench = propose(both, rig).bench()
    assert bench.columns["t2"].offset == pytest.approx(7.0, abs=1e-3)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = recording_of(both, bench, rig)
        np.testing.assert_allclose(found.step, 0.01, rtol=1e-6)
        forces = np.interp(found.time, run.time + found.time[0], run["force"])
        assert np.mean(np.abs(found["force"] - forces) < 1e-5) > 0.95
        declared = Bench.of({"t": "time [ms]:ms", "force": "force", "position": "position"}, both.header)
        with pytest.raises(RecordingError, match=r"time \[ms\].*read in seconds, not ms"):
            recording_of(both, declared, rig)
