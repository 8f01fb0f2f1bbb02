"""Files that are too large, cut, damaged or of a missing extra: a clear error, before memory is taken."""

import gc
import gzip
import sys
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from fieldmodels.drivers.named import model_named_in
from fieldmodels.recording import RecordingError
from fieldmodels.recording.bench import Bench, Channel, beside
from fieldmodels.recording.files import load_recording
from fieldmodels.recording.reading import read_table
from fieldmodels.registry import get_model

sys.path.insert(0, str(Path(__file__).parent))
from bench import axis
from foreign import bag, joint, scalar

RIG = get_model("rig")
ROWS = "".join(f"{k / 100},{k % 7},{k % 5}\n" for k in range(300))


def refused(path: Path | str, *parts: str) -> None:
    with pytest.raises(RecordingError) as caught:
        load_recording(path, RIG)
    assert all(part in str(caught.value) for part in (str(path), *parts)), caught.value


@pytest.mark.nightly
def test_a_parquet_bomb_is_refused_by_its_row_count(tmp_path):
    path = tmp_path / "log.parquet"
    column = pa.array(np.zeros(1_000_000))
    with pq.ParquetWriter(path, pa.schema([(n, pa.float64()) for n in ("t", "force", "position")])) as file:
        for _ in range(200):
            file.write_table(pa.table([column] * 3, names=["t", "force", "position"]))
    assert path.stat().st_size < 8e6
    refused(path, "200,000,000 rows of 3 columns take 4.8 GB", "cut the log")


@pytest.mark.nightly
def test_archives_that_unpack_to_too_much_are_refused(tmp_path):
    path = tmp_path / "log.xlsx"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("xl/worksheets/sheet1.xml", b" " * ((1 << 30) + 1))
    refused(path, "unpacks to 1.1 GB")


def test_text_that_is_no_table(tmp_path):
    for name, content, part in (
        ("line.csv", b"a" * (2 << 20), "row 1 is longer than"),
        ("cell.csv", b"t,force,position\n0," + b"1" * 300_000 + b",2\n" + ROWS.encode(), "too long"),
        ("far.csv", b"t,force,position\n" + ROWS.encode() * 1000 + b"9," + b"1" * 3_000_000, "row 300002"),
    ):
        (tmp_path / name).write_bytes(content)
        refused(tmp_path / name, part)
    if Path("/dev/zero").exists():
        refused("/dev/zero", "is a device or a pipe")


def test_an_integer_without_end_is_refused(tmp_path):
    path = tmp_path / "log.json"
    rows = [f'{{"t": {k / 100}, "force": {k % 7}, "position": {k % 5}}}' for k in range(300)]
    path.write_text(f"[{','.join(rows)}]".replace('"position": 3', '"position": ' + "9" * 400, 1))
    refused(path, "position", "a number beyond 1e308")


def test_a_few_uneven_rows_are_refused(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,force,position\n0,1,2\n0.01,1,3\n0.02,2,3\n0.03,2,4\n0.04,2,5\n0.06,3,6\n")
    refused(path, "no 8 rows follow each other at the usual step of 0.01 s")


def test_a_header_of_many_columns_is_read_whole(tmp_path):
    names = ["t", "force", *(f"c{k}_{'x' * 90}" for k in range(2000)), "position"]
    path = tmp_path / "wide.csv"
    path.write_text(
        "\n".join([",".join(names), *(",".join([str(k / 100), *["1"] * 2002]) for k in range(100))])
    )
    assert read_table(path).header == tuple(names)
    with pytest.warns(UserWarning, match="never changes"):
        assert len(load_recording(path, RIG)) == 100


def test_a_row_that_the_logger_left_half_written_is_left_out(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,force,position\n" + ROWS + "3.0,4")
    assert len(load_recording(path, RIG)) == 300
    path.write_text("t,force,position\n" + ROWS[: len(ROWS) // 2] + "3.0,4\n" + ROWS[len(ROWS) // 2 :])
    refused(path, "cells, but the header has 3")


@pytest.mark.every("wrong", ["3.0,4,1\n", "3.0,4,1,1,5\n", "3.0,4,1\n3.01,4,1,1,5\n"])
def test_rows_with_cells_too_few_or_too_many_are_refused(tmp_path, wrong):
    path = tmp_path / "log.csv"
    path.write_text("t,force,position,mode\n" + ROWS.replace("\n", ",1\n") + wrong + "3.1,2,3,1\n")
    refused(path, "row 302", "cells, but the header has 4")


def test_a_cut_archive_is_a_clear_error(tmp_path):
    path = tmp_path / "log.csv.gz"
    whole = gzip.compress(("t,force,position\n" + ROWS).encode())
    path.write_bytes(whole[: len(whole) // 2])
    refused(path, "damaged archive")


@pytest.mark.matrix(keep=("log.h5-\\x89HDF\\r\\n\\x1a\\n",))
@pytest.mark.parametrize(
    ("name", "start"),
    [("log.mat", b"MATLAB 5.0 MAT-file"), ("log.h5", b"\x89HDF\r\n\x1a\n"), ("log.mf4", b"MDF     4.10"),
     ("log.mcap", b"\x89MCAP0\r\n"), ("log.npy", b"\x93NUMPY\x01\x00"), ("log.feather", b"ARROW1\0\0"),
     ("log.ulg", b"ULog\x01\x12\x35"), ("log.bin", b"\xa3\x95\x80"), ("log.tdms", b"TDSm"),
     ("log.wpilog", b"WPILOG\0\1"), ("log.blf", b"LOGG"), ("log.tlog", b""),
     ("log.json", b'{"a": ['), ("log.db3", b"SQLite format 3\0"), ("log.xlsx", b"PK\x03\x04")],
)  # fmt: skip
def test_damaged_files_of_every_format(tmp_path, monkeypatch, name, start):
    path, left = tmp_path / name, tmp_path / "temporary"
    left.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(left))
    late = []
    monkeypatch.setattr(sys, "unraisablehook", late.append)
    path.write_bytes(start.ljust(128) + np.random.default_rng(0).bytes(4000))
    refused(path, " no")  # "not a readable ...", or "no column" where nothing is found in it
    gc.collect()
    assert not late
    assert not list(left.iterdir())


def test_pickled_objects_are_not_loaded(tmp_path):
    np.save(tmp_path / "log.npy", np.array([{"a": 1}], dtype=object), allow_pickle=True)
    refused(tmp_path / "log.npy", "pickled")


@pytest.mark.every(
    ("module", "name", "start"),
    [
        ("pyarrow", "parquet", b"PAR1"),
        ("h5py", "hdf5", b"\x89HDF"),
        ("rosbags", "ros", b"#ROSBAG"),
        ("asammdf", "mdf", b"MDF "),
        ("pyulog", "px4", b"ULog"),
        ("pymavlink", "ardupilot", b"\xa3\x95\x80"),
        ("nptdms", "labview", b"TDSm"),
    ],
)
def test_a_missing_extra_is_named(tmp_path, monkeypatch, module, name, start):
    (tmp_path / "log").write_bytes(start)
    for known in [m for m in sys.modules if m.split(".")[0] == module or ".recording.readers." in m]:
        monkeypatch.delitem(sys.modules, known)
    monkeypatch.setitem(sys.modules, module, None)
    refused(tmp_path / "log", f"pip install 'fieldgym[{name}]'")


def test_a_truncated_bag_gives_the_part_that_is_there_or_an_error(tmp_path):
    run = axis("rig", "nothing", 0, seconds=5.0)
    topics = {
        "/force": ("std_msgs/msg/Float64", run.time, scalar(run.signals["force"])),
        "/state": (
            "sensor_msgs/msg/JointState",
            run.time,
            joint(run.signals["position"], run.signals["velocity"]),
        ),
    }
    folder = bag(tmp_path / "bag", topics, "MCAP")
    (log,) = folder.glob("*.mcap")
    whole = log.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) // 2])
    refused(cut, "not a readable bag")


def test_channels_are_read_as_written():
    header = ("tau", "a-1", "x:y", "adc")
    for text, expected in {
        "tau": Channel("tau"),
        "-tau": Channel("tau", "", -1.0),
        "-2.5*tau:N cm": Channel("tau", "N cm", -2.5),
        "0.1*adc-12:deg": Channel("adc", "deg", 0.1, -12.0),
        "a-1:V": Channel("a-1", "V"),
        "2*a-1+3": Channel("a-1", "", 2.0, 3.0),
        "x:y": Channel("x:y"),
        "1e-3*tau": Channel("tau", "", 1e-3),
    }.items():
        assert Channel.parse(text, header) == expected, text
        assert Channel.parse(str(expected), header) == expected


def test_a_bench_is_kept_and_found_beside_a_log(tmp_path):
    bench = Bench({"t": Channel("Zeit", "ms"), "force": Channel("F", "N", -2.0, 0.5)}, 100.0, "rig")
    bench.save(tmp_path / "bench.yaml")
    text = (tmp_path / "bench.yaml").read_text()
    for key in ("machine", "model"):  # model: files of 0.1
        (tmp_path / "bench.yaml").write_text(text.replace("machine: rig", f"{key}: rig"))
        assert f"{key}: rig" in (tmp_path / "bench.yaml").read_text()
        assert Bench.load(tmp_path / "bench.yaml") == bench
        assert model_named_in(tmp_path / "bench.yaml") == "rig"
    assert beside(tmp_path / "log.csv", "rig") == tmp_path / "bench.yaml"
    assert beside(tmp_path / "log.csv", "pendulum") is None
    for text, part in (("columns: 3", "maps signals"), ("a: 1", "nothing else"), ("rate: -1", "positive"),
                       ("columns: {t: {column: t, gain: 0}}", "numbers"), ("a: [", "bad.yaml")):  # fmt: skip
        (tmp_path / "bad.yaml").write_text(text)
        with pytest.raises(RecordingError, match=part):
            Bench.load(tmp_path / "bad.yaml")


def test_gain_and_offset_act_before_the_unit(tmp_path):
    (tmp_path / "log.csv").write_text("t,force,position\n" + ROWS)
    loaded = load_recording(tmp_path / "log.csv", RIG, {"force": "-2*force+1:kN", "position": "position:mm"})
    assert loaded["force"][3] == pytest.approx(-5000)
    assert loaded["position"][3] == pytest.approx(3e-3)
