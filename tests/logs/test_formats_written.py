"""Other tools read in the new logs what was measured: the truth that readers are held to."""

import json
import re
import sqlite3
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from bench import Run
from expected import Expected, made, makers, names
from foreign import DEG, RPM

Found = dict[str, tuple[np.ndarray, np.ndarray]]  # signal -> times [s], values in SI units


def ulog(told: Expected) -> list[Found]:
    pyulog = pytest.importorskip("pyulog")
    log, found = pyulog.ULog(told.source), {}
    for signal, column in told.columns.items():
        if signal != "t":
            topic, field = column.rpartition(":")[0].split(".")
            data = log.get_dataset(topic).data
            found[signal] = 1e-6 * data["timestamp"], data[field]
    return [found]


def px4_rover(told: Expected) -> list[Found]:
    (found,) = ulog(told)
    return [{s: (t, v * 10 if s in told.scaled else v) for s, (t, v) in found.items()}]


def ardupilot(told: Expected) -> list[Found]:
    reader = pytest.importorskip("pymavlink.DFReader").DFReader_binary(told.source)
    rows = []
    while message := reader.recv_match(type="ATT"):
        assert message.fmt.units[:3] == ["µs", "deg", "deg"]  # not centi: the format c has divided already
        rows.append((message.TimeUS * 1e-6, message.DesRoll * DEG, message.Roll * DEG))
    t, set_point, position = np.transpose(rows)
    return [{"set_point": (t, set_point), "position": (t, position)}]


def mavlink(told: Expected) -> list[Found]:
    reader = pytest.importorskip("pymavlink.mavutil").mavlink_connection(told.source)
    rows = {"NAV_CONTROLLER_OUTPUT": [], "ATTITUDE": []}
    while message := reader.recv_match(type=list(rows)):
        value = getattr(message, "nav_roll", 0) * DEG or getattr(message, "roll", 0)
        rows[message.get_type()].append((message._timestamp, value))
    told_by, seen = (np.transpose(one) for one in rows.values())
    return [{"set_point": tuple(told_by), "position": tuple(seen)}]


def lvm(told: Expected) -> list[Found]:
    """By another author's reader than its writer."""
    whole = pytest.importorskip("lvm_read").read(told.source, read_from_pickle=False, dump_file=False)
    gain = {"N": 1.0, "Newtons": 1.0, "mm": 1e-3, "m/s": 1.0}
    parts: list[Found] = [{} for _ in range(whole["Segments"])]
    for k, found in enumerate(parts):
        for signal, column in told.columns.items():
            if signal != "t":
                j = whole[k]["Channel names"].index(column.rpartition(":")[0])
                values = whole[k]["data"][:, j]
                values = values[np.isfinite(values)]
                about = j - (whole["X_Columns"] != "No")  # headers do not count the column of times
                step, unit = whole[k]["Delta_X"][about], whole[k]["Y_Unit_Label"][about]
                found[signal] = step * np.arange(len(values)), gain[unit] * values
    return parts


def tdms(told: Expected) -> list[Found]:
    file, found = pytest.importorskip("nptdms").TdmsFile.read(told.source), {}
    gain = {"mN.m": 1e-3, "deg": DEG, "rpm": RPM}
    for signal, column in told.columns.items():
        name, _, unit = column.rpartition(":")
        channel = file["/".join(name.split(".")[:1])][name.split(".")[1]]
        assert channel.properties["unit_string"] == unit
        found[signal] = channel.time_track(), gain[unit] * channel[:]
    return [found]


def wpilog(told: Expected) -> list[Found]:
    reader = pytest.importorskip("wpiutil.log").DataLogReader(told.source)
    kinds, rows = {}, {}
    for record in reader:
        if record.isStart():
            start = record.getStartData()
            kinds[start.entry] = start.name, start.type, start.metadata
        elif not record.isControl() and kinds[record.getEntry()][1] == "double":
            rows.setdefault(kinds[record.getEntry()][0], []).append(
                (record.getTimestamp(), record.getDouble())
            )
    assert {n.partition("-")[0]: m for n, _, m in kinds.values()}["velocity"] == "Meter per Second"
    found = {s: np.transpose(rows[c.rpartition(":")[0]]) for s, c in told.columns.items()}
    return [{s: (1e-6 * t, v) for s, (t, v) in found.items()}]


def can_trace(told: Expected) -> list[Found]:
    can, cantools = pytest.importorskip("can"), pytest.importorskip("cantools")
    trace, dbc = told.source.split("+")
    base, rows = cantools.database.load_file(dbc), {"ForceCmd": [], "Position": [], "Speed": []}
    for message in can.CanutilsLogReader(trace):
        if not message.is_extended_id:
            for name, value in base.decode_message(message.arbitration_id, message.data).items():
                rows.setdefault(name, []).append((message.timestamp, value))
    gains = {"force": ("ForceCmd", 1.0), "position": ("Position", 1e-3), "velocity": ("Speed", 1e-3)}
    return [{s: (np.transpose(rows[n])[0], g * np.transpose(rows[n])[1]) for s, (n, g) in gains.items()}]


def lerobot(told: Expected) -> list[Found]:
    pandas, folder = pytest.importorskip("pandas"), Path(told.source)
    info, parts = json.loads((folder / "meta/info.json").read_text()), []
    for k in range(info["total_episodes"]):
        table = pandas.read_parquet(folder / info["data_path"].format(episode_chunk=0, episode_index=k))
        j = info["features"]["action"]["names"].index("shoulder_lift.pos")
        both = {"set_point": table["action"], "position": table["observation.state"]}
        t = table["timestamp"].to_numpy()
        parts.append({s: (t, DEG * np.stack(rows.to_list())[:, j]) for s, rows in both.items()})
    return parts


def betaflight_raw(told: Expected) -> list[Found]:
    parser = pytest.importorskip("orangebox").Parser.load(told.source)
    columns = dict(
        zip(parser.field_names, np.transpose([f.data for f in parser.frames()]).astype(float), strict=True)
    )
    t = 1e-6 * columns["time"]
    return [{"command": (t, DEG * columns["setpoint[0]"]), "response": (t, DEG * columns["gyroADC[0]"])}]


def sqlite(told: Expected) -> list[Found]:
    with sqlite3.connect(told.source) as base:
        t, u, y, v = np.transpose(base.execute("select * from samples").fetchall())
    return [{"force": (t, u), "position": (t, 1e-3 * y), "velocity": (t, 1e-3 * v)}]


READ = {
    "px4_yaw": ulog, "px4_rover": px4_rover, "ardupilot": ardupilot, "mavlink": mavlink, "lvm_no_clock": lvm,
    "lvm_comma": lvm, "lvm_segments": lvm, "tdms": tdms, "wpilog": wpilog, "can_trace": can_trace,
    "lerobot": lerobot, "sqlite": sqlite, "betaflight_raw": betaflight_raw,
}  # fmt: skip


def written(name: str, folder: Path) -> Expected:
    try:
        return made(name, folder)
    except ImportError as error:
        pytest.skip(f"{name} is written by a library that is missing: {error.name}")


def off(found: tuple[np.ndarray, np.ndarray], run: Run, signal: str) -> float:
    """Error in shares of the spread, where the samples stand; steps of a command are a row wide."""
    time, values = found
    truth = np.interp(time - time[0], run.time, run.signals[signal])
    return float(np.quantile(np.abs(values - truth), 0.95) / np.std(truth))


@pytest.mark.parametrize("name", READ)
def test_another_tool_reads_what_was_measured(tmp_path, name):
    told = written(name, tmp_path)
    parts, runs = READ[name](told), told.parts or (told.run,)
    assert len(parts) == len(runs)
    for found, run in zip(parts, runs, strict=True):
        assert set(found) == set(run.signals)
        assert {s: e for s, one in found.items() if (e := off(one, run, s)) > 0.05} == {}


def test_objects_of_matlab_are_what_matlab_calls_so(tmp_path):
    h5py, scipy = pytest.importorskip("h5py"), pytest.importorskip("scipy.io")
    new, old = (made(name, tmp_path) for name in ("matlab_dataset", "matlab_timeseries"))
    assert Path(new.source).read_bytes().startswith(b"MATLAB 7.3")
    with h5py.File(new.source) as file:
        assert file["logsout"].attrs["MATLAB_class"] == b"Simulink.SimulationData.Dataset"
    kept = scipy.loadmat(old.source)
    assert list(kept["None"][0])[:3] == [b"angle", b"MCOS", b"timeseries"]
    for one in (new, old):
        angle = scipy.loadmat(one.remedy, squeeze_me=True)["angle"]
        np.testing.assert_array_equal(angle if one is old else angle["data"].item(), one.run.signals["angle"])


def test_every_log_has_its_truth_and_its_set(tmp_path):
    """Thirty-two that are read and three that are refused; names of columns stand in the files of text."""
    assert sorted(names("develop") + names("report")) == sorted(makers())
    assert min(len(names("develop")), len(names("report"))) >= len(makers()) // 3
    logs = {name: written(name, tmp_path) for name in makers() if name not in READ}
    for name, told in logs.items():
        assert bool(told.refused) == bool(told.remedy), name
        assert set(told.columns) - {"t"} == set(told.run.signals), name
        path = Path(told.remedy or told.source.split("+")[-1])
        if path.suffix in (".csv", ".txt", ".log"):
            text = "".join(Path(p).read_text() for p in (told.remedy or told.source).split("+"))
            for column in told.columns.values():
                assert column.rpartition(":")[0].removeprefix("Axis 2 ") in text, (name, column)


@pytest.mark.parametrize("name", ["spikes", "stuck", "lying_clock"])
def test_the_rows_of_a_fault_are_lines_of_its_file(tmp_path, name):
    told = made(name, tmp_path)
    lines = [line.split(",") for line in Path(told.source).read_text().splitlines()]
    cells = {kind: [lines[k - 1] for k in rows] for kind, rows in told.rows.items()}
    before = {kind: [lines[k - 2] for k in rows] for kind, rows in told.rows.items()}
    assert all(re.search(r",30\.0|-12854", ",".join(row)) for row in cells.get("spike", []))
    assert len({row[2] for row in cells.get("stuck", [])}) <= 1
    assert cells.get("repeated") == before.get("repeated")
    jumps = [
        float(a[0]) - float(b[0])
        for a, b in zip(cells.get("clock", []), before.get("clock", []), strict=True)
    ]
    assert jumps == pytest.approx([-0.49, 3.01][: len(jumps)])
