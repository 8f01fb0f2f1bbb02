"""What programs export is read to the signals that were measured, by own names and units."""

import re
import shlex
import sys
import warnings
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
import outsiders  # noqa: F401  # they register themselves
from expected import Expected, errors
from exporters import EXPORTERS

from fieldagents.logs import Logs, declared
from fieldmodels.recording import Recording, RecordingError
from fieldmodels.recording.sources import read_log
from fieldmodels.recording.units import canonical
from fieldmodels.registry import get_model

OTHERWISE = {
    "tektronix": {"t", "torque", "angle"}, "twincat": {"t"}, "motive": {"force"}, "bagpy": {"torque"},
}  # fmt: skip
"""Signals whose columns have other names, or no unit, than the file was written down with."""
ASKED = [
    "rigol",
    "siglent",
    "keysight",
    "elmo",
    "aloha",
    "motive",
    "crazyflie",
    "unitree",
    "labview_waveforms",
]


def taken(told: Expected, columns: dict[str, str] | None = None, **how: object) -> Recording:
    """The log as the command line reads it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return Logs(get_model(told.run.model), {"": columns or {}}, **how).read(told.source)


def wrong(told: Expected, read: Recording) -> dict[str, float]:
    return {signal: error for signal, error in errors(told, read).items() if error > 0.05}


@pytest.mark.every("name", [*EXPORTERS])
def test_an_export_is_read_as_it_was_measured(tmp_path, name):
    told = EXPORTERS[name](tmp_path)
    if told.refused:
        with pytest.raises(RecordingError) as caught:
            read_log(told.source)
        assert all(re.search(pattern, str(caught.value)) for pattern in told.refused), caught.value
        told = replace(told, source=told.remedy)
    table = read_log(told.source)
    for signal, column in told.columns.items():
        own, _, unit = column.rpartition(":")
        if signal not in OTHERWISE.get(name, ()):
            assert own in table.numbers()
            assert canonical(table.units.get(own, "")) == canonical(unit)
    columns = told.options.get("columns", {})
    read = taken(told, columns, accept=True, rate=told.options.get("rate"))
    assert set(read.signals) - {s for s, c in columns.items() if c == "none"} == set(told.run.signals)
    assert read.step == pytest.approx(np.median(np.diff(told.run.time)), rel=1e-3)
    assert wrong(told, read) == {}


@pytest.mark.every("name", [*EXPORTERS])
def test_nothing_is_taken_wrongly_unasked(tmp_path, name):
    told = EXPORTERS[name](tmp_path)
    silent = {s: c for s, c in told.options.get("columns", {}).items() if c == "none"}
    with suppress(RecordingError):  # it asks, or says what to declare
        assert wrong(told, taken(told, silent)) == {}


@pytest.mark.every("name", ASKED)
def test_what_a_refusal_asks_for_can_be_typed(tmp_path, name):
    told = EXPORTERS[name](tmp_path)
    rate = {"rate": told.options.get("rate")}
    with pytest.raises(RecordingError) as caught:
        taken(told, **rate)
    typed = re.findall(r"--column ('[^']+')", str(caught.value))
    assert typed
    options = [shlex.split(one)[0].replace("GAIN", "1") for one in typed]
    taken(told, declared(get_model(told.run.model), options)[""], accept=True, **rate)
