"""Logs of other people's making are read to the values that were measured, and reversed signs are said."""

import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from foreign import SETS, Log
from goals import MOST, actions

from fieldmodels.recording import Recording, RecordingError
from fieldmodels.recording.files import recording_of
from fieldmodels.recording.proposals import propose
from fieldmodels.registry import get_model


@pytest.fixture(scope="module", params=sorted(SETS))
def logs(request, tmp_path_factory) -> list[Log]:
    return SETS[request.param](tmp_path_factory.mktemp(request.param))


def read(log: Log) -> tuple[Recording, dict[str, float]]:
    """The recording as proposed, and each signal's gain."""
    from fieldagents.logs import _opened

    table, model = _opened(log.source), get_model(log.run.model)
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


def test_logs_are_read_as_they_were_measured(logs):
    found = {log.about: said for log in logs if (said := wrong(log))}
    assert not found, "\n".join(f"{about}: {said}" for about, said in found.items())
    assert len(logs) == 20
    assert sum(bool(log.reversed) for log in logs) == 5


@pytest.mark.slow
def test_logs_lead_to_the_right_cause(tmp_path):
    """The goals, by the command line alone; seconds are the processor's, so that load does not count."""
    rows = [actions(log, tmp_path / f"{k}") for k, log in enumerate(SETS["report"](tmp_path))]
    assert all(row["loaded"] and row["actions"] <= MOST for row in rows), rows
    right = [row for row in rows if row["right"] and row["seconds"] <= 60]
    assert len(right) >= 18, rows
    assert [row["reversed_said"] for row in rows if row["reversed"]] == [True] * 5
