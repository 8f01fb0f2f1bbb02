"""Recordings survive a file; what is wrong with a file is said with column, row and remedy."""

import subprocess
import sys
import textwrap
import warnings
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fieldmodels.model import Signal
from fieldmodels.recording import Recording, RecordingError, RecordingWarning
from fieldmodels.recording.checks import is_even
from fieldmodels.recording.files import load_recording, save_recording
from fieldmodels.recording.proposals import propose
from fieldmodels.recording.reading import read_table
from fieldmodels.registry import get_model

PENDULUM = get_model("pendulum")
RIG = get_model("rig")


def table(**columns) -> str:
    """CSV text of named columns."""
    rows = zip(*columns.values(), strict=True)
    return "\n".join([",".join(columns), *(",".join(str(cell) for cell in row) for row in rows)]) + "\n"


def bench(n=100, step=0.01, **more) -> dict[str, list]:
    """Columns of a good record of the rig."""
    time = [round(i * step, 9) for i in range(n)]
    columns = {"t": time, "force": [0.5] * n, "position": [0.001 * (i % 7) for i in range(n)]}
    return {**columns, **more}


@pytest.fixture
def write(tmp_path):
    """Write a file and give its path."""

    def write_(content: str | bytes, name="log.csv") -> Path:
        path = tmp_path / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return write_


def refused(path, *parts, model=RIG, **options) -> str:
    """Loading fails; the message names the file and has all parts."""
    with pytest.raises(RecordingError) as caught:
        load_recording(path, model, **options)
    message = str(caught.value)
    for part in (str(path), *parts):
        assert part in message, message
    return message


# Round trip

NAMES = st.text(
    st.characters(codec="utf-8", exclude_characters='"\r\n', exclude_categories=["Cs", "Cc", "Zs"]),
    min_size=1,
    max_size=8,
).filter(lambda name: name.strip() == name and name not in ("t", "episode"))
FINITE = st.floats(allow_nan=False, allow_infinity=False)


@st.composite
def recordings(draw) -> Recording:
    """Any recording on an even grid, values of any size."""
    lengths = draw(st.lists(st.integers(2, 5), min_size=1, max_size=3))
    labels = draw(st.lists(st.integers(-(2**53), 2**53), min_size=3, max_size=3, unique=True))
    step = draw(st.sampled_from([1e-3, 0.01, 1 / 3]))
    n = sum(lengths)
    column = st.lists(FINITE, min_size=n, max_size=n).map(np.array)
    return Recording(
        time=np.concatenate([np.arange(length) * step for length in lengths]),
        signals=draw(st.dictionaries(NAMES, column, min_size=1, max_size=3)),
        episode=np.repeat(labels[: len(lengths)], lengths),
    )


@pytest.mark.matrix(keep=(".parquet",))
@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(recording=recordings())
def test_saved_and_loaded_is_equal_to_the_bit(tmp_path, suffix, recording):
    path = tmp_path / f"r{suffix}"
    save_recording(recording, path)
    loaded = load_recording(path)
    assert list(loaded.signals) == list(recording.signals)
    for name in recording.signals:
        assert loaded[name].tobytes() == recording[name].tobytes()
    assert loaded.time.tobytes() == recording.time.tobytes()
    assert np.array_equal(loaded.episode, recording.episode)


def test_parquet_keeps_units_and_converts_them(tmp_path):
    time = np.arange(50) * 0.01
    degrees = Recording(time, {"torque": time, "angle": 90 + time}, {"torque": "N m", "angle": "deg"})
    save_recording(degrees, tmp_path / "r.parquet")
    assert load_recording(tmp_path / "r.parquet").units == {"torque": "N m", "angle": "deg"}
    loaded = load_recording(tmp_path / "r.parquet", PENDULUM)
    assert loaded.units["angle"] == "rad"
    assert loaded["angle"][0] == pytest.approx(np.pi / 2, rel=1e-15)


def test_a_failed_save_leaves_the_old_file(tmp_path):
    path = tmp_path / "r.csv"
    time = np.arange(3.0)
    save_recording(Recording(time, {"x": time}), path)
    before = path.read_bytes()
    with pytest.raises(RecordingError, match="signal 'x', sample 1: nan"):
        save_recording(Recording(time, {"x": np.array([0, np.nan, 1])}), path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["r.csv"]


@pytest.mark.every("name", ["t", "episode", "", " x", 'a"b', "a\nb"])
def test_a_name_that_no_header_carries_is_refused(tmp_path, name):
    with pytest.raises(RecordingError, match="cannot be named"):
        save_recording(Recording(np.arange(3.0), {name: np.arange(3.0)}), tmp_path / "r.csv")


# What is read


def test_only_the_models_signals_are_read(write):
    path = write(table(**bench(note=["text"] * 100)))
    loaded = load_recording(path, RIG)
    assert sorted(loaded.signals) == ["force", "position"]
    assert loaded.units == {"force": "N", "position": "m"}
    assert loaded.step == pytest.approx(0.01)


def test_columns_are_renamed_and_converted(write):
    n = 100
    path = write(table(time=[10 * i for i in range(n)], pos=[180] * n, Tau=[7.0] * n))
    with pytest.warns(RecordingWarning, match="'angle' never changes"):
        loaded = load_recording(path, PENDULUM, {"t": "time:ms", "angle": "pos:deg", "torque": "Tau:mNm"})
    assert loaded.time[-1] == pytest.approx(0.99)
    assert np.allclose(loaded["angle"], np.pi, rtol=1e-15)
    assert np.allclose(loaded["torque"], 0.007, rtol=1e-15)


def test_a_column_named_with_a_colon_is_taken_by_its_name(write):
    path = write("t,angle:deg\n0,1\n0.1,2\n")
    assert load_recording(path, columns={"angle": "angle:deg"})["angle"][1] == 2


@pytest.mark.every(
    "text",
    [
        "\ufefft,x\n0,1\n0.5,2\n",
        "t , x\r\n0, 1\r\n0.5 ,2\r\n",
        't,"x"\n0,"1"\n0.5,2',
        "t,x\n0,1\n\n0.5,2\n\n",
    ],
)
def test_harmless_varieties_of_csv_are_read(write, text):
    loaded = load_recording(write(text))
    assert loaded.time.tolist() == [0, 0.5]
    assert loaded["x"].tolist() == [1, 2]


# Header


def test_a_missing_column_is_guessed(write):
    path = write(table(**bench(postion=[1] * 100)).replace(",position", ",x"))
    refused(path, "column 'position' [m] is missing", "did you mean 'postion'?", "t, force, x, postion")


def test_a_unit_in_the_header_is_read(write):
    text = table(**bench(step=10)).replace("position", "Position [mm]").replace("t,", "time (ms),", 1)
    loaded = load_recording(write(text), RIG)
    assert loaded.step == pytest.approx(0.01)
    assert loaded["position"][3] == pytest.approx(3e-6)


def test_a_doubled_name_and_a_missing_column_are_both_reported(write):
    path = write(table(**bench()).replace("t,force", "t,position"))
    refused(path, "2 problems", "'position': appears more than once", "column 'force' [N] is missing")


def test_a_wrong_mapping_is_reported(write):
    path = write(table(**bench()))
    refused(path, "no signal 'forze'", "did you mean 'force'", columns={"forze": "force"})
    refused(path, "column 'force'", "'mm' does not measure a quantity in 'N'", columns={"force": "force:mm"})
    refused(path, "column 'x'", "missing", columns={"force": "x"})
    refused(path, "declared for two signals", columns={"force": "position"})


@pytest.mark.every(
    ("text", "parts"),
    [
        ("", ["empty"]),
        ("\n\n", ["empty"]),
        ("t,force,position", ["no data rows"]),
        ("t,force,position\n", ["no data rows"]),
        ("t,force,position\n0,1,2\n", ["one data row"]),
        ("0,1,2\n0.1,1,2\n", ["the header has column 1, column 2, column 3"]),
    ],
)
def test_files_without_header_or_rows(write, text, parts):
    refused(write(text), *parts)


# Cells


@pytest.mark.every(
    ("cell", "part"),
    [
        ("high", "'high' is not a number"),
        ('"0,5"', "'0,5' has a decimal comma; write 0.5"),
        ("inf", "inf is not a finite number"),
        ("0x1p3", "'0x1p3' is not a number"),
        ("0,5", "row 5: 4 cells, but the header has 3; a decimal comma?"),
    ],
)
def test_a_bad_cell_is_named_by_column_and_row(write, cell, part):
    lines = table(**bench()).splitlines()
    lines[4] = f"0.03,{cell},0.1"
    message = refused(write("\n".join(lines)), part, "row 5")
    assert cell == "0,5" or "column 'force'" in message


def test_rows_count_as_an_editor_shows_them(write):
    lines = table(**bench()).splitlines()
    lines[50] = "0.49,oops,0"
    lines.insert(10, "")
    lines.insert(20, "")
    path = write("\n".join(lines))
    row = 1 + path.read_text().splitlines().index("0.49,oops,0")
    refused(path, f"column 'force', row {row}: 'oops'")


def test_several_bad_cells_are_reported_at_once(write):
    columns = bench()
    columns["force"][3] = "a"
    columns["position"][7] = ""
    refused(write(table(**columns)), "2 problems", "'force', row 5", "'position', row 9")


def test_a_bad_cell_far_down_is_found(write):
    columns = bench(200_000)
    columns["position"][199_000] = "x"
    refused(write(table(**columns)), "column 'position', row 199002: 'x' is not a number")


# Time


def test_gaps_between_episodes_are_none(write):
    columns = bench(200, episode=[1] * 120 + [2] * 80)
    columns["t"] = [t + (100 if e == 2 else 0) for t, e in zip(columns["t"], columns["episode"], strict=True)]
    assert load_recording(write(table(**columns)), RIG).bounds.tolist() == [[0, 120], [120, 200]]


def test_time_that_falls_or_stands_still(write):
    columns = {k: v[::-1] for k, v in bench().items()}
    refused(write(table(**columns)), "'t', row 3: time falls from row to row; sort the rows by time")
    two_runs = {k: v + v for k, v in bench().items()}
    refused(write(table(**two_runs)), "row 102", "a new run? number the runs in a column 'episode'")
    columns = bench()
    columns["t"][40] = columns["t"][30]
    refused(write(table(**columns)), "'t', row 42: t = 0.3 s does not come after 0.39 s; sort the rows")
    refused(write(table(**{**bench(), "t": [5.0] * 100})), "time stands still at 5 s")


def test_episode_numbers_are_integers_and_not_taken_up_again(write):
    refused(write(table(**bench(episode=[1] * 50 + [1.5] * 50))), "'episode', row 52: 1.5 is not an integer")
    refused(
        write(table(**bench(episode=[1] * 20 + [2] * 20 + [1] * 60))), "row 42: episode 1 is taken up again"
    )


def test_a_record_shorter_than_the_horizon(write):
    refused(write(table(**bench(15))), "the longest record lasts 0.14 s, shorter than the 0.2 s", "longer")
    refused(write(table(**bench(50))), "0.49 s, shorter than the 2 s", horizon=2.0)
    refused(write(table(**bench(50, step=0.6))), "one row every 0.6 s is too coarse", "sample faster")
    assert load_recording(write(table(**bench(50, step=0.1))), RIG).step == pytest.approx(0.1)


def test_milliseconds_are_recognised(write):
    path = write(table(**bench(step=10)))
    refused(path, "one row every 10 s", "looks like ms: declare it as 't=t:ms'")
    assert load_recording(path, RIG, {"t": "t:ms"}).step == pytest.approx(0.01)
    with pytest.warns(RecordingWarning, match="'t=t:ms'"):
        load_recording(path)


# Suspicions


def swing(scale=1.0, rate=1.0, amplitude=1.2) -> str:
    t = np.arange(500) * 0.01
    return table(
        t=t,
        torque=np.sin(t),
        angle=scale * amplitude * np.sin(3 * t),
        velocity=rate * 3 * amplitude * np.cos(3 * t),
    )


def test_a_good_record_raises_no_suspicion(write):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load_recording(write(swing()), PENDULUM)
        load_recording(write(table(**bench())), RIG)


def test_an_angle_in_degrees_is_suspected_and_why(write):
    degrees = 180 / np.pi
    swings = 40 * np.sin(np.pi * (np.arange(100) - 50) / 50)
    text = table(**{**bench(), "angle": swings, "torque": [0] * 100})
    with pytest.warns(
        RecordingWarning, match=r"'angle' spans 80, as radians 12\.7 turns; .*'angle=angle:deg'"
    ):
        load_recording(write(text), PENDULUM)
    with pytest.warns(
        RecordingWarning,
        match="'angle' looks as if it were in deg: it changes 57.* as fast as 'velocity' says",
    ):
        load_recording(write(swing(scale=degrees, amplitude=0.05)), PENDULUM)
    with pytest.warns(
        RecordingWarning, match="'velocity' looks as if it were in deg/s: it is 57.*'velocity=velocity:deg/s'"
    ):
        load_recording(write(swing(rate=degrees)), PENDULUM)


def test_an_axis_that_spins_or_has_a_stated_unit_is_not_suspected(write):
    """Twelve turns one way are no degrees; nor is an angle doubted whose unit was declared."""
    spins = table(**{**bench(), "angle": np.linspace(-40, 40, 100), "torque": [0] * 100})
    swings = table(**{**bench(), "angle": 40 * np.sin(np.arange(100) / 9), "torque": [0] * 100})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load_recording(write(spins), PENDULUM)
        load_recording(write(swings), PENDULUM, {"angle": "angle:deg"})
        load_recording(write(swings.replace("angle", "angle [deg]")), PENDULUM)


def over_the_top(unit: float = 1.0, seconds: float = 60.0, step: float = 0.01) -> dict[str, np.ndarray]:
    """A pendulum that is driven round, many turns there and many back, by Euler's rule in small steps."""
    t = step * np.arange(int(seconds / step))
    torque = np.where(t < 0.5 * seconds, 2.0, -2.0) + 1.5 * np.sin(1.7 * t)
    angle, place, speed = np.empty(len(t)), 0.0, 0.0
    for k, drive in enumerate(torque):
        angle[k] = place
        for _ in range(20):
            speed += step / 20 * (drive - 0.8 * np.sin(place) - 0.2 * speed) / 0.05
            place += step / 20 * speed
    return {"t": t, "torque": torque, "angle": unit * angle}


def test_an_axis_that_turns_there_and_back_is_not_suspected_where_the_model_tells(write):
    """Dozens of turns and back are no degrees if the model answers so; the same swings in degrees are."""
    turning = over_the_top()
    assert np.ptp(turning["angle"]) > 40 * 2 * np.pi
    assert abs(turning["angle"][-1] - turning["angle"][0]) < 0.5 * np.abs(np.diff(turning["angle"])).sum()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load_recording(write(table(**turning)), PENDULUM)
    swings = 0.4 * np.sin(turning["t"]) * np.sin(0.37 * turning["t"])  # slow: torque and weight balance
    small = {**turning, "torque": 0.8 * np.sin(swings), "angle": 180 / np.pi * swings}
    with pytest.warns(RecordingWarning, match="if it is in degrees"):
        load_recording(write(table(**small)), PENDULUM)


def test_turns_are_no_degrees_in_a_proposal_either(write):
    proposal = propose(read_table(write(table(**over_the_top()))), PENDULUM)
    assert {c.role: c.unit for c in proposal.columns}["angle"] == "rad"


def test_an_excerpt_keeps_whole_stretches_of_every_part():
    """Rows as they were, in order, none twice, no stretch across the end of an episode."""
    rows = np.arange(100_000)
    whole = Recording(0.01 * rows, {"x": rows.astype(float)}, episode=np.searchsorted([30_000, 30_050], rows))
    some = whole.excerpt(60_000)
    kept = some["x"].astype(int)
    np.testing.assert_array_equal(some.time, whole.time[kept])
    assert np.all(np.diff(kept) > 0)
    assert 55_000 <= len(some) <= 60_000
    for first, end in some.bounds:
        np.testing.assert_array_equal(np.diff(kept[first:end]), 1)
        assert len(set(whole.episode[kept[first:end]])) == 1
    assert np.histogram(kept, 10, (0, len(whole)))[0].min() >= 4_000
    assert whole.excerpt(100_000) is whole


@pytest.mark.every(
    ("unit", "scale"),
    [("rpm", 60 / (2 * np.pi)), ("rev/s", 1 / (2 * np.pi)), ("mrad/s", 1e3), ("deg/s", 57.3)],
)
def test_a_rate_in_another_unit_is_suspected_also_in_noise_at_10_khz(write, unit, scale):
    rng = np.random.default_rng(0)
    time = np.arange(20_000) * 1e-4
    angle = 0.4 * np.sin(5 * time) + 1e-3 * rng.standard_normal(len(time))
    columns = {"t": time, "torque": np.sin(time), "angle": angle, "velocity": scale * 2.0 * np.cos(5 * time)}
    with pytest.warns(RecordingWarning, match=f"'velocity' looks as if it were in {unit}: it is"):
        load_recording(write(table(**columns)), PENDULUM)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load_recording(write(table(**columns)), PENDULUM, {"velocity": f"velocity:{unit}"})


def test_microseconds_are_recognised(write):
    path = write(table(**bench(step=10_000)))
    refused(path, "looks like us: declare it as 't=t:us'")
    assert load_recording(path, RIG, {"t": "t:us"}).step == pytest.approx(0.01)


def test_an_accelerometer_in_g_is_suspected(write):
    class Accelerometer(type(RIG)):
        outputs = (*type(RIG).outputs, Signal("acceleration", "m/s^2"))

    columns = {**bench(), "acceleration": 1.0 + 0.05 * np.sin(np.arange(100.0))}
    with pytest.warns(RecordingWarning, match="'acceleration' is usually 1.0.*'acceleration=acceleration:g'"):
        load_recording(write(table(**columns)), Accelerometer())


def test_a_position_in_millimetres_is_suspected(write):
    t = np.arange(500) * 0.01
    text = table(t=t, force=np.sin(t), position=100 * np.sin(3 * t), velocity=0.3 * np.cos(3 * t))
    with pytest.warns(
        RecordingWarning, match="'position' looks as if it were in mm: .*'position=position:mm'"
    ):
        load_recording(write(text), RIG)


# Files that are not what they seem


@pytest.mark.every(
    ("content", "part"),
    [
        (b"\x00\x01\x02\x03" * 100, "binary file"),
        (b"t,x\n0,1\n\x00\x00", "binary file"),
        (b"PAR1\x15\x04", "not a readable Parquet file"),
        (b"PK\x03\x04\x14", "not a readable workbook"),
        (b"\x1f\x8b\x08", "damaged archive"),
        (b"\x93NUMPY\x01", "not a readable NumPy file"),
    ],
)
def test_other_content_named_csv(write, content, part):
    refused(write(content), part)


def test_binary_content_after_a_good_start(write):
    text = table(**bench(20_000)).encode()
    refused(write(text + bytes(range(1, 256)) * 10), "row 20002")


@pytest.mark.every("content", [b"", b"t,x\n0,1\n", b"PAR1" + b"\x00" * 50 + b"PAR1"])
def test_broken_parquet(write, content):
    refused(write(content, "log.parquet"), "not a readable Parquet file")


def test_damaged_parquet_pages(write, tmp_path):
    path = tmp_path / "log.parquet"
    pq.write_table(pa.table(bench(5000)), path)
    data = bytearray(path.read_bytes())
    data[4:400] = b"\xff" * 396
    refused(write(bytes(data), "log.parquet"), "damaged data")


@pytest.mark.every("suffix", [".csv", ".parquet"])
def test_a_damaged_file_is_read_or_refused_and_nothing_else(tmp_path, suffix):
    """Bytes changed, cut out, put in: never another exception than the one that names the file."""
    rng = np.random.default_rng(5)
    t = np.arange(100) * 0.01
    path = tmp_path / f"log{suffix}"
    save_recording(Recording(t, {"force": np.sin(t), "position": np.cos(t)}), path)
    whole = path.read_bytes()
    refusals = []
    for _ in range(150):
        data = bytearray(whole)
        for share in rng.random(rng.choice([1, 3, 20])):
            place = int(share * len(data))
            kind = rng.integers(3)
            if kind == 0:
                data[place] = rng.integers(256)
            elif kind == 1:
                del data[place : place + rng.integers(1, 100)]
            else:
                data[place:place] = [b",", b"\n", b'"', b"\r", b"e9", b"\0", b"nan"][rng.integers(7)]
        path.write_bytes(data)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", RecordingWarning)
                load_recording(path, RIG)
        except RecordingError as error:
            refusals.append(str(error))
    assert len(refusals) > 100
    assert all(str(path) in message for message in refusals)


def test_parquet_cells_and_types(tmp_path):
    path = tmp_path / "log.parquet"
    columns = bench()
    columns["force"] = [*columns["force"][:9], None, *columns["force"][10:]]
    pq.write_table(pa.table(columns), path)
    with pytest.warns(RecordingWarning, match="'force': empty in row 10, where the command before is held"):
        assert load_recording(path, RIG)["force"][9] == columns["force"][8]
    pq.write_table(pa.table(columns | {"t": [None, *bench()["t"][1:]]}), path)
    refused(path, "column 't', row 1: the cell is empty or NaN")
    pq.write_table(pa.table(bench(force=["1"] * 100)), path)
    refused(path, "column 'force'", "holds string, not numbers")
    pq.write_table(pa.table(bench(300) | {"t": pa.array(range(300), pa.timestamp("ms"))}), path)
    assert load_recording(path, RIG).step == pytest.approx(0.001)


def test_paths_that_are_no_readable_file(tmp_path, write):
    write("t,x\n", "bench_1.csv")
    refused(tmp_path / "bench1.csv", "no such file", "did you mean", "bench_1.csv")
    refused(tmp_path / "nowhere" / "a.csv", "there is no directory")
    refused(tmp_path, "is a directory", "bench_1.csv")
    refused(write("t,x\n", "log.xlsx"), "not a readable workbook")


# Size


@pytest.mark.nightly
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="reads Linux's /proc")
def test_memory_is_bounded_by_the_columns_that_are_kept(tmp_path):
    """150 MB of text, of which 3 columns of 24 are kept (5 MB): the peak stays far below the file's size."""
    script = textwrap.dedent(
        """
        import sys, re
        import numpy as np, pyarrow as pa, pyarrow.csv
        from pathlib import Path
        from fieldmodels.recording.files import load_recording
        from fieldmodels.registry import get_model

        peak = lambda: int(re.search(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text())[1])
        path, rows = Path(sys.argv[1]), 20_000
        noise = np.random.default_rng(0).normal(size=(22, rows))
        rig = get_model("rig")
        with path.open("wb") as file:
            file.write((",".join(["t", "force", "position", *(f"x{i}" for i in range(21))]) + "\\n").encode())
            for block in range(17):
                time = (block * rows + np.arange(rows)) * 0.001
                columns = pa.table([time, *noise, np.sin(time)], names=[str(i) for i in range(24)])
                pa.csv.write_csv(columns, file, pa.csv.WriteOptions(include_header=False))
        small = path.with_name("small.csv")
        with path.open("rb") as whole:  # what is compiled or imported first is no part of it
            small.write_bytes(b"".join(whole.readline() for _ in range(2000)))
        load_recording(small, rig)
        before = peak()
        recording = load_recording(path, rig)
        assert len(recording) == 17 * rows
        print(path.stat().st_size / 1e6, (peak() - before) / 1e3)
        """
    )
    run = subprocess.run(
        [sys.executable, "-c", script, tmp_path / "big.csv"], capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    size, grown = map(float, run.stdout.split())
    assert size > 130
    assert grown < size / 2


def test_stamps_of_few_digits_tell_the_clock_by_their_mean():
    """60 Hz to a tenth of a millisecond: steps of 0.0166 and 0.0167 s; their median is 0.2 % too long."""
    clock = Recording(np.round(np.arange(2400) / 60.0, 4), {})
    assert is_even(clock)
    assert clock.step == pytest.approx(1.0 / 60.0, rel=1e-5)
    for count, lost in ((2400, [7, 8, 900]), (200_000, [7])):  # many gaps, and one that no spread shows
        gaps = Recording(np.delete(np.arange(count) / 60.0, lost), {})
        assert gaps.step == pytest.approx(1.0 / 60.0, rel=1e-9)


def test_one_gap_in_a_long_record_is_not_even():
    """Twenty thousand rows with one missing: their standard deviation alone would pass for even."""
    time = 0.01 * np.arange(20_000)
    assert is_even(Recording(time, {}))
    assert not is_even(Recording(np.delete(time, 7_000), {}))
    assert is_even(Recording(np.delete(time, 7_000), {}, episode=np.repeat([0, 1], [7_000, 12_999])))
