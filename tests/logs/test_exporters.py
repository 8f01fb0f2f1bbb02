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
from bench import axis
from expected import Expected, errors
from exporters import EXPORTERS
from foreign import RPM, signals, text

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
    assert not re.search(r"= ?X\b", str(caught.value))  # a counter of rows is no signal
    options = [shlex.split(one)[0].replace("GAIN", "1") for one in typed]
    taken(told, declared(get_model(told.run.model), options)[""], accept=True, **rate)


@pytest.mark.every(
    "name", ["crazyflie", "vesc", "codesys", "ulog2csv", "dataflash_text", "structure_with_time"]
)
def test_what_is_proposed_is_right(tmp_path, name):
    """Of what suits as well as another a response is the column of its command's joint, axis or index."""
    told = EXPORTERS[name](tmp_path)
    assert wrong(told, taken(told, accept=True)) == {}


def test_a_clock_that_counts_ten_thousand_rows_a_second_is_asked_for(tmp_path):
    """Its unit is no microsecond: the file says 100 rows a second."""
    told = EXPORTERS["xsens"](tmp_path)
    columns = {"torque": "none", "angle": "Pitch:deg"}
    with pytest.raises(
        RecordingError, match=r"t = 0.0001\*SampleTimeFine:s .*the file says 100 rows a second"
    ):
        taken(told, columns)
    assert wrong(told, taken(told, columns, accept=True)) == {}
    (tmp_path / "control.csv").write_text("t,torque\n" + "".join(f"{0.01 * k},0\n" for k in range(3000)))
    times = read_log(f"{told.source}+{tmp_path / 'control.csv'}")["SampleTimeFine"]
    assert np.ptp(times) == pytest.approx(np.ptp(told.run.time))


def test_a_file_without_a_clock_is_as_fast_as_it_says(tmp_path):
    run = axis("rig", "coulomb_friction", 620)
    text(tmp_path / "log.csv", ["Sample rate: 0.1 kHz", "", "force [N],position [mm]"],
         (run.signals["force"], 1e3 * run.signals["position"]))  # fmt: skip
    with pytest.warns(match="100 rows a second"):
        read = Logs(get_model("rig")).read(str(tmp_path / "log.csv"))
    assert read.step == pytest.approx(0.01)


def test_a_clock_of_whole_seconds_has_the_step_of_its_rows(tmp_path):
    run = axis("rig", "coulomb_friction", 621)
    columns = (np.floor(run.time), *signals(run))
    text(tmp_path / "log.csv", ["t [s],force [N],position [m],velocity [m/s]"], columns)
    assert taken(Expected("", str(tmp_path / "log.csv"), run)).step == pytest.approx(0.01, rel=1e-3)


def test_a_suspected_unit_is_declared_by_the_files_own_name(tmp_path):
    run = axis("pendulum", "coulomb_friction", 622)
    u, y, v = signals(run)
    text(tmp_path / "log.csv", ["t,torque,angle,Drehzahl"], (run.time, u, y, v / RPM))
    with pytest.warns(match="declare it as 'velocity=Drehzahl:rpm'"):
        Logs(get_model("pendulum"), {"": {"velocity": "Drehzahl"}}).read(str(tmp_path / "log.csv"))
