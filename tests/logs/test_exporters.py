"""What programs export is read to the signals that were measured, by own names and units."""

import sys
import warnings
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from expected import errors
from exporters import EXPORTERS

from fieldagents.logs import Logs
from fieldmodels.recording import RecordingError
from fieldmodels.recording.sources import read_log
from fieldmodels.recording.units import canonical
from fieldmodels.registry import get_model

OTHERWISE = {"tektronix": {"t", "torque", "angle"}, "twincat": {"t"}}
"""Signals whose columns have other names, or no unit, than the file was written down with."""


@pytest.mark.parametrize("name", EXPORTERS)
def test_an_export_is_read_as_it_was_measured(tmp_path, name):
    told = EXPORTERS[name](tmp_path)
    table = read_log(told.source)
    for signal, column in told.columns.items():
        own, _, unit = column.rpartition(":")
        if signal not in OTHERWISE.get(name, ()):
            assert own in table.numbers()
            assert canonical(table.units.get(own, "")) == canonical(unit)
    model, columns = get_model(told.run.model), {"": told.options.get("columns", {})}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        read = Logs(model, columns, accept=True, rate=told.options.get("rate")).read(told.source)
    assert set(read.signals) == set(told.run.signals)
    assert read.step == pytest.approx(np.median(np.diff(told.run.time)), rel=1e-3)
    assert {signal: error for signal, error in errors(told, read).items() if error > 0.05} == {}


@pytest.mark.parametrize("name", EXPORTERS)
def test_nothing_is_taken_wrongly_unasked(tmp_path, name):
    told = EXPORTERS[name](tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with suppress(RecordingError):  # it asks, or says what to declare
            read = Logs(get_model(told.run.model)).read(told.source)
            assert {signal: error for signal, error in errors(told, read).items() if error > 0.05} == {}
