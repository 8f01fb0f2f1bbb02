"""Text of LabVIEW, robots and consoles is read to the signals that were measured, by own names and units."""

import json
import os
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.feather
import pyarrow.parquet
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from expected import Expected, errors, made, read

from fieldagents.logs import Logs, listed
from fieldmodels.recording import RecordingError
from fieldmodels.recording.bench import Bench
from fieldmodels.recording.files import load_recording
from fieldmodels.recording.proposals import SURE, clock_of, propose
from fieldmodels.recording.reading import read_table
from fieldmodels.recording.sources import read_log
from fieldmodels.recording.tables import Table
from fieldmodels.recording.units import canonical
from fieldmodels.registry import get_model

LOGS = (
    "lvm_no_clock",
    "lvm_comma",
    "lvm_segments",
    "sysid",
    "rollouts",
    "lerobot",
    "preamble",
    "two_headers",
    "two_clocks",
    "console",
    "plotter",
    "blackbox_decode",
    "blackbox_explorer",
)
DATA = Path(os.environ.get("FIELDGYM_DATA", ""))


def real(name: str) -> Path:
    """A log of the collection, which is not everywhere."""
    if not os.environ.get("FIELDGYM_DATA") or not (DATA / name).exists():
        pytest.skip(f"FIELDGYM_DATA has no {name}")
    return DATA / name


def said(told: Expected) -> str:
    """What its owner reads who declares columns, and no unit of them."""
    table, model = read_log(told.source), get_model(told.run.model)
    columns = Bench.of(told.options.get("columns", {}), table.header).columns
    bare = {role: replace(channel, unit="") for role, channel in columns.items()}
    return "\n".join([listed(propose(table, model, told.options.get("rate"), bare)), *table.notes])


@pytest.mark.parametrize("name", LOGS)
def test_a_log_is_read_as_it_was_measured(tmp_path, name):
    try:
        told = made(name, tmp_path)
    except ImportError as error:
        pytest.skip(f"written by a library that is missing: {error.name}")
    table, recording = read(told)
    for column in told.columns.values():
        own, _, unit = column.rpartition(":")
        assert own in table.numbers()
        assert canonical(table.units.get(own, "")) == canonical(unit)
    text = said(told)
    assert [pattern for pattern in told.said if not re.search(pattern, text)] == []
    assert set(recording.signals) == set(told.run.signals)
    assert recording.step == pytest.approx(np.median(np.diff(told.run.time)), rel=1e-3)
    assert {name: error for name, error in errors(told, recording).items() if error > 0.05} == {}


@pytest.mark.every(
    ("name", "columns", "rows", "step", "units"),
    [
        ("long_single_header_multi_ch", "F m_1 m_2", 16_384, 0.000977, ("g", "m/s^2", "m/s^2")),
        ("short", "Excitation (Trigger)|Response (Trigger)", 10, 3.90625e-5, ("Newtons", "m/s^2")),
        ("with_empty_fields", "Dev0/Ai0|Dev0/Ai2|Dev0/Ai0 1", 7, 0.001, ("", "", "")),
    ],
)
def test_labviews_own_files_keep_names_units_and_steps(name, columns, rows, step, units):
    table = read_table(real(f"lvm_hammer/{name}.lvm"))
    clock, *names = table.numbers()
    assert names == columns.split("|" if "|" in columns else None)
    assert tuple(table.units.get(one, "") for one in names) == units
    values = table.read(table.numbers())
    assert {len(one) for one in values.values()} == {rows}
    assert table.units[clock] == "s"
    np.testing.assert_allclose(np.diff(values[clock]), step, rtol=1e-9)
    assert all(np.isfinite(one).all() for one in values.values())


LVM = """LabVIEW Measurement\t
Separator\tTab
Decimal_Separator\t,
X_Columns\tNo
***End_of_Header***\t
\t
Channels\t3\t\t
Y_Unit_Label\t°C\tV\tV\t
X_Dimension\tTime\tTime\tTime\t
X0\t2,0E+0\t2,0E+0\t2,0E+0\t
Delta_X\t0,5\t0,5\t0,25\t
***End_of_Header***\t\t\t\t
X_Value\tOven\tU\tU\tComment
\t20,5\t1,0\t1,5\tspecimen 4
\t21,5\t2,0\t2,5
\t\t\t3,5
\t\t\t4,5
"""


def test_labviews_header_tells_starts_steps_and_units_as_windows_writes_them(tmp_path):
    """Channels of one name are told apart, those of another step have a clock of their own."""
    (tmp_path / "a.lvm").write_bytes(LVM.encode("cp1252"))
    table = read_table(tmp_path / "a.lvm")
    assert table.header == ("X_Value", "Oven", "U (1)", "X_Value (U (2))", "U (2)")
    assert table.units["Oven"] == "°C"
    values = table.read(table.header)
    assert values["X_Value"].tolist() == [2.0, 2.5]
    assert values[table.clocks["U (2)"]].tolist() == [2.0, 2.25, 2.5, 2.75]
    assert [values["Oven"].tolist(), values["U (2)"].tolist()] == [[20.5, 21.5], [1.5, 2.5, 3.5, 4.5]]


@pytest.mark.every(
    ("name", "episodes", "rows"),
    [("real-action-state-dataset", 32, 2900), ("response", 96, 8516), ("drop-response-1", 1, 353)],
)
def test_each_rollout_of_a_servo_is_an_episode(name, episodes, rows):
    """Their types, targets and limits are no columns; the rate beside them makes the clock."""
    path = real(f"miuzei_servo/{name}.json")
    table = read_table(path)
    assert set(table.numbers()) == {"actions", "sensor_data", "t"} | ({"episode"} if episodes > 1 else set())
    values = table.read(table.numbers())
    assert len(values["t"]) == rows
    np.testing.assert_allclose(np.diff(values["t"]), 0.02, rtol=1e-9)
    data = json.loads(path.read_text())["data"]
    if episodes > 1:
        found = [values["sensor_data"][values["episode"] == k + 1].tolist() for k in range(episodes)]
        assert found == [one["sensor_data"] for one in data]


def written(path: Path, data: object) -> Path:
    path.write_text(json.dumps(data))
    return path


def test_rows_that_hold_the_joints_of_a_robot_are_no_rollouts(tmp_path):
    """A record with as many numbers as every other is a row, unless it is alone or has very many."""
    rows = [{"t": 0.1 * k, "q": [0.1 * k, 0.2, 0.3]} for k in range(5)]
    assert read_table(written(tmp_path / "a.json", rows)).header == ("t", "q[1]", "q[2]", "q[3]")
    one = [{"t": [0.0, 0.1, 0.2], "q": [1.0, 2.0, 3.0], "gains": [1.0, 2.0]}]
    assert read_table(written(tmp_path / "b.json", one)).header == ("t", "q")
    wide = [{"q": [0.1 * k] * 65} for k in range(5)]
    assert read_table(written(tmp_path / "c.json", {"fps": 30, "rows": wide})).header == ("q", "episode", "t")
    uneven = [{"q": [0.5] * n} for n in (9, 8, 9)]
    assert (
        read_table(written(tmp_path / "e.json", uneven))["episode"].tolist()
        == [1.0] * 9 + [2.0] * 8 + [3.0] * 9
    )
    two = {"hz": 50, "camera_fps": 30, "data": wide}
    assert "t" not in read_table(written(tmp_path / "d.json", two)).header


def test_records_are_of_several_sensors_only_if_each_has_fields_of_its_own(tmp_path):
    records = [{"t": 0.1 * k, "mode": "hold" if k % 2 else "run", "x": k, **({"e": 1} if k % 2 else {})}
               for k in range(6)]  # fmt: skip
    assert read_table(written(tmp_path / "a.json", records)).header == ("t", "mode", "x", "e")
    numbered = {str(k): {"t": 0.1 * k, "x": k} for k in range(6)}
    assert read_table(written(tmp_path / "b.json", numbered)).header == ("t", "x")
    motors = {"1": {"t": [0.0, 0.1], "x": [1.0, 2.0]}, "2": {"t": [0.0, 0.1], "x": [3.0, 4.0]}}
    assert read_table(written(tmp_path / "c.json", motors)).header == ("1.t", "1.x", "2.t", "2.x")


def test_sysid_tells_units_as_it_means_them(tmp_path):
    """Rotations times the size of one; a drivetrain's gyro is in radians; without a size, rotations."""
    rows = [[0.02 * k, 1.0, 2.0, 0.5, 0.25, 3.0, 4.0, 0.1, 0.2] for k in range(4)]
    data = {"sysid": True, "units": "Feet", "slow-forward": rows, "fast-forward": rows[:3]}
    table = read_table(written(tmp_path / "a.json", {**data, "unitsPerRotation": 2.0}))
    values = table.read(table.numbers())
    wanted = {"left_position": (1.0, "ft"), "right_velocity": (8.0, "ft/s"), "angle": (0.1, "rad")}
    assert {n: (values[n][0], table.units[n]) for n in wanted} == wanted
    assert values["episode"].tolist() == [1.0] * 4 + [2.0] * 3
    assert read_table(written(tmp_path / "b.json", data)).units["left_position"] == "rev"


def test_an_episode_of_a_data_set_knows_the_names_of_its_joints(tmp_path):
    told = made("lerobot", tmp_path)
    whole, one = (
        read_table(Path(told.source) / name) for name in ("", "data/chunk-000/episode_000001.parquet")
    )
    assert one.header == whole.header
    name = told.columns["position"].removesuffix(":")
    np.testing.assert_array_equal(one[name], whole[name][whole["episode_index"] == 1])
    declared = load_recording(told.source, get_model("servo"), told.options["columns"])
    assert len(declared.bounds) == 3  # also where nothing is proposed
    for file in Path(told.source).glob("data/*/*"):
        file.unlink()
    with pytest.raises(RecordingError, match="'data' holds no Parquet file"):
        read_table(told.source)


@pytest.mark.parametrize("write", [pa.parquet.write_table, pa.feather.write_feather])
def test_places_of_lists_are_columns(tmp_path, write):
    """Numbered from 1 as in JSON; lists of other lengths are said, the columns beside them are read."""
    uneven = [[1.0, 2.0], [3.0, 4.0], [5.0]]
    unit = pa.field("q", pa.list_(pa.float64()), metadata={"unit": "deg"})
    schema = pa.schema([("t", pa.float64()), unit, ("uneven", pa.list_(pa.float64())), ("name", pa.string())])
    write(
        pa.table([[0.0, 0.1, 0.2], [[1, 4], [2, 5], [3, 6]], uneven, ["a", "b", "c"]], schema), tmp_path / "a"
    )
    table = read_table(tmp_path / "a")
    assert table.header == ("t", "q[1]", "q[2]", "uneven[1]", "uneven[2]")
    assert table["q[2]"].tolist() == [4.0, 5.0, 6.0]
    assert table.units["q[1]"] == "deg"
    with pytest.raises(RecordingError, match="'uneven': its lists differ in length"):
        table.read(["uneven[1]"])


def table_of(folder: Path, text: str) -> Table:
    (folder / "log.txt").write_text(text)
    return read_table(folder / "log.txt")


ROWS = "".join(f"{k / 100},{k % 7}.5\n" for k in range(300))


@pytest.mark.every(
    "head",
    [
        "Specimen,17\nGain,2.0\n\nTime,Force\ns,kN\n",
        "Operator,K. Weber\nDate,2026-11-22\nGain,2.0\nTime (s),Force (kN)\n",
        "Time (s),Force (kN)\n",
    ],
)
def test_pairs_above_a_table_of_two_columns_are_no_rows(tmp_path, head):
    table = table_of(tmp_path, head + ROWS)
    assert [name[:4] for name in table.header] == ["Time", "Forc"]
    assert list(table.units.values()) == ["s", "kN"]
    assert table[table.header[1]].tolist() == [k % 7 + 0.5 for k in range(300)]


def test_a_first_row_that_is_no_number_is_no_pair(tmp_path):
    with pytest.raises(RecordingError, match="row 2: 'err' is not a number"):
        table_of(tmp_path, f"t,x\nerr,1\n{ROWS}").read(["t"])


@pytest.mark.every(
    ("line", "columns"),
    [
        ("t_ms: {t}, sp: {v:.2f}, err: 0", {"t_ms": "ms", "sp": "", "err": ""}),
        ("sp:{v:.2f}\tangle_deg:{t}", {"sp": "", "angle_deg": "deg"}),
        ("10:00:{t:09.6f} -> sp:{v} i:{t}", {"time": "s", "sp": "", "i": ""}),
        ("[2026-11-22 10:00:{t:02d}] speed = {v} rpm; V = 12.1V", {"time": "s", "speed": "rpm", "V": "V"}),
        ("I motor/3: Phase current=-{v}e-3 | sp={t}", {"Phase current": "", "sp": ""}),
    ],
)
def test_lines_of_names_and_values_are_rows(tmp_path, line, columns):
    """Other lines are left out, and one of them is shown; a value that is missing is said with its line."""
    lines = [line.format(t=k, v=k % 7 + 0.5) for k in range(50)]
    lines[20:20] = ["", "[WARN] bus voltage 23.1 V"]
    table = table_of(tmp_path, "\n".join(["boot", *lines, ""]))
    assert {name: table.units.get(name, "") for name in table.header} == columns
    assert "[WARN] bus voltage 23.1 V" in table.notes[0]
    values = table.read(table.header)
    assert {len(v) for v in values.values()} == {50}
    assert all(np.isfinite(v).all() for v in values.values())
    assert any(np.ptp(v) == pytest.approx(6.0 if "e-3" not in line else 6e-3) for v in values.values())
    lines[30] = re.sub(r"[\d.]+(?=\D*$)", "nan", lines[30], count=1)
    with pytest.raises(RecordingError, match="row 32: the cell is empty or NaN"):
        load_recording(table_of(tmp_path, "\n".join(["boot", *lines, ""])).path, rate=100.0)


@pytest.mark.every("line", ["{t},gear 1:5,{v}", "{t} a:1 b:2", "2026-01-01T10:{t:02d}Z,{v}"])
def test_a_table_with_a_colon_in_its_cells_is_no_console(tmp_path, line):
    text = "\n".join(line.format(t=k, v=k % 7 + 0.5) for k in range(50))
    assert not table_of(tmp_path, text).dialect.pairs


def test_names_below_the_names_of_groups(tmp_path):
    """Groups count where names alone are not distinct, also in Excel's merged cells; a title does not."""
    rows = "".join(f"{k / 100},{k},{-k},{k % 5}\n" for k in range(20))
    table = table_of(tmp_path, f",Left,,Right\nt,pos,vel,pos\ns,mm,mm/s,mm\n{rows}")
    assert table.header == ("t", "Left pos", "Left vel", "Right pos")
    assert table.units["Right pos"] == "mm"
    assert table_of(tmp_path, f"Run 7,,,\nt,pos,vel,err\n{rows}").header == ("t", "pos", "vel", "err")
    doubled = table_of(tmp_path, f"t,pos,vel,pos\n{rows}")
    assert doubled.numbers() == ("t", "vel")  # one of the others would be taken by chance


def side_by_side(folder: Path, head: str, second=lambda t: 2 * t + 0.003, count: int = 80) -> Table:
    rows = (f"{k / 100},{k}" + (f",{second(k / 100)},{-k}" if k < count else ",,") for k in range(100))
    return table_of(folder, f"{head}\n" + "\n".join(rows) + "\n")


def test_channels_side_by_side_have_the_times_at_their_left(tmp_path):
    """Nothing stands below the shorter one; doubled names of times are those of their channels."""
    table = side_by_side(tmp_path, "Time,Force,Time,Position")
    assert table.header == ("Time (Force)", "Force", "Time (Position)", "Position")
    assert table.clocks["Force"] == "Time (Force)"
    values = table.read(["Position", "Force"])
    assert [values["Force"].tolist(), values["Position"].tolist()] == [
        list(range(100)), [-k for k in range(80)]
    ]  # fmt: skip


@pytest.mark.every(
    ("head", "second"),
    [
        ("time [s],u,time [ms],y", lambda t: t), ("time,u,elapsed time,y", lambda t: 1000 * t),
        ("time,u,lap time,y", lambda t: t % 0.2), ("time,u,unix time,y", lambda t: 1.8e9 + t),
        ("time,timestamp,u,y", lambda t: t),
    ],
)  # fmt: skip
def test_times_that_are_no_clocks_of_their_own(tmp_path, head, second):
    """Of another unit or origin, beginning anew, or beside another one: rows belong together."""
    table = side_by_side(tmp_path, head, second, 100)
    assert dict(table.clocks) == {}


def test_words_further_down_leave_a_column_out_and_are_said(tmp_path):
    """A flag far below the header does not bar the others; a column that is needed is refused by its row."""
    rows = [f"{k / 100},{np.sin(k)},{np.cos(k)},0\n" for k in range(2000)]
    rows[1000] = "10.0,0.1,0.2,ARMED\n"
    path = table_of(tmp_path, "t,force,position,flags\n" + "".join(rows)).path
    table = read_table(path)
    assert set(table.signals()) == {"t", "force", "position"}
    (note,) = table.notes
    assert note.startswith("left out: column 'flags', row 1002: 'ARMED' is not a number")
    assert propose(read_table(path), get_model("rig")).missing == ()
    with pytest.raises(RecordingError, match="column 'flags', row 1002: 'ARMED' is not a number"):
        propose(read_table(path), get_model("rig"), known=Bench.of({"force": "flags"}).columns)
    rows[1000] = "10.0,0.1,ARMED,0\n"
    path.write_text("t,force,weg,flags\n" + "".join(rows))
    with pytest.raises(RecordingError, match=r"(?s)hold position.*column 'weg', row 1002: 'ARMED'"):
        Logs(get_model("rig"), accept=True).read(str(path))


def test_a_unit_behind_a_number_is_that_of_its_column(tmp_path):
    """Dashboards change the unit with the size; what is in another one is no number of this column."""
    rows = [f"{k / 100} s,{k % 7} V,{k % 5} mV,phase {k % 3} A\n" for k in range(300)]
    table = table_of(tmp_path, "t,u,v,state\n" + "".join(rows))
    assert table.units == {"t": "s", "u": "V", "v": "mV"}
    assert table.numbers() == ("t", "u", "v")
    np.testing.assert_array_equal(table["u"], np.arange(300) % 7)
    rows[200] = "2.0 s,600 mV,1 mV,phase 1 A\n"
    with pytest.raises(RecordingError, match="column 'u', row 202: '600 mV' is not a number"):
        table_of(tmp_path, "t,u,v,state\n" + "".join(rows))["u"]


@pytest.mark.every("mark", ['3" pipe', '"3"" pipe"', "pipe"])
def test_a_quote_within_a_cell_does_not_go_on_in_the_next_line(tmp_path, mark):
    table = table_of(tmp_path, "t,x,what\n" + "".join(f"{k / 100},{k % 7},{mark}\n" for k in range(300)))
    assert table.header == ("t", "x", "what")
    assert len(table["x"]) == 300


def test_one_value_a_row_is_a_long_table_and_a_state_beside_one_value_is_not(tmp_path):
    rows = [f"{k / 100},{name},{k + n}\n" for n, name in enumerate(("a", "b")) for k in range(300)]
    table = table_of(tmp_path, "time,topic,value\n" + "".join(rows))
    np.testing.assert_array_equal(table["b"], np.arange(300) + 1)
    rows = [f"{k / 100},{'run' if k > 100 else 'idle'},{k % 7}\n" for k in range(300)]
    assert table_of(tmp_path, "time,state,value\n" + "".join(rows)).numbers() == ("time", "value")
    again = [f"{k % 150 / 100},{'run' if k > 100 else 'idle'},{k % 7}\n" for k in range(300)]
    assert table_of(tmp_path, "time,state,value\n" + "".join(again)).numbers() == ("time", "value")


def test_days_of_a_spreadsheet_are_no_seconds(tmp_path):
    for start, step, unit in ((46348.4, 1 / 864000, "d"), (739943.4, 1 / 86400, "d"), (46348.4, 0.01, "s")):
        rows = [f"{start + k * step:.10f},{k % 7}\n" for k in range(300)]
        clock = clock_of(table_of(tmp_path, "time,x\n" + "".join(rows)))
        assert (clock.unit, clock.confidence < SURE) == (unit, unit == "d")
