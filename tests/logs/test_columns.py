"""Which column is what: constants are no commands, temperatures have another zero, bad cells are counted."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from fieldagents.logs import Logs, listed
from fieldmodels.machine import Machine, number
from fieldmodels.model import Signal
from fieldmodels.recording import RecordingError
from fieldmodels.recording.bench import Bench, Channel
from fieldmodels.recording.evidence import counts
from fieldmodels.recording.files import load_recording
from fieldmodels.recording.proposals import propose
from fieldmodels.recording.reading import read_table
from fieldmodels.recording.words import unit_of
from fieldmodels.registry import get_model
from fieldmodels.synthesis import synthesise

PENDULUM, RIG = get_model("pendulum"), get_model("rig")


@pytest.fixture(scope="module")
def run():
    rng = np.random.default_rng(0)
    made = synthesise(PENDULUM, {}, "mixed", duration=15.0, step=0.01, amplitude=3.0, rng=rng, noise=True)
    return {"t": made.time, "u": made["torque"], "y": made["angle"]}


def written(path, **columns):
    rows = zip(*columns.values(), strict=True)
    lines = [",".join(columns), *(",".join(f"{cell:.6g}" for cell in row) for row in rows)]
    path.write_text("\n".join(lines).replace("nan", "") + "\n")
    return path


@pytest.mark.every("name", ["torque", "torque_cmd", "motor_torque_limit", "u"])
@pytest.mark.every("other", ["ch1", ""])
def test_a_column_that_never_changes_is_no_command(tmp_path, run, name, other):
    moving = {other: run["u"]} if other else {}
    columns = {"time": run["t"], name: np.full(1500, 24.0), **moving, "winkel": run["y"]}
    proposal = propose(read_table(written(tmp_path / "log.csv", **columns)), PENDULUM)
    assert name not in {c.column for c in proposal.columns}
    assert proposal.constant == (name,)
    assert f"{name!r} never changes: it tells nothing, and no command" in listed(proposal)
    if other:
        assert proposal.bench().columns["torque"].column == other
    else:
        with pytest.raises(RecordingError, match=f"no column seems to hold torque .{name!r} never changes"):
            Logs(PENDULUM).read(str(tmp_path / "log.csv"))
        told = Logs(PENDULUM, {"": {"torque": f"{name}:N m"}}, accept=True)  # whoever says so knows
        assert np.ptp(told.read(str(tmp_path / "log.csv"))["torque"]) == 0


def test_a_column_that_never_changes_is_no_optional_signal_unless_declared(tmp_path, run):
    for name in ("velocity", "omega"):
        columns = {"t": run["t"], "torque": run["u"], "angle": run["y"], name: np.full(1500, 3.0)}
        path = written(tmp_path / f"{name}.csv", **columns)
        proposal = propose(read_table(path), PENDULUM)
        assert name not in {c.column for c in proposal.columns}
        assert f"{name!r} never changes" in listed(proposal)
    path = tmp_path / "velocity.csv"
    with pytest.warns(match="'velocity' never changes: it tells nothing, and is not read as 'velocity'"):
        assert "velocity" not in load_recording(path, PENDULUM)
    with pytest.warns(match="'velocity' never changes; is the sensor connected"):
        assert "velocity" in load_recording(path, PENDULUM, {"velocity": "velocity:rad/s"})


def test_a_command_that_begins_late_is_one(tmp_path, run):
    """The machine stands still in the first 100,000 rows; only some 20,000 are looked at."""
    still = np.zeros(100_000)
    columns = {
        "time": 0.01 * np.arange(101_500),
        "torque_cmd": np.concatenate([still, run["u"]]),
        "winkel": np.concatenate([still, run["y"]]),
    }
    proposal = propose(read_table(written(tmp_path / "log.csv", **columns)), PENDULUM)
    assert proposal.bench().columns["torque"].column == "torque_cmd"
    assert proposal.constant == ()


class Oven(Machine):
    """An oven in a room of 293 K."""

    inputs = (Signal("heater", "W"),)
    states = outputs = (Signal("temperature", "K", noise=0.1),)
    loss = number("W/K", 1.0, 0.01, 10.0)

    def derivative(self, state, input, p):
        """Newton's law of cooling, with a capacity of 10 J/K."""
        return (input.heater - p.loss * (state.temperature - 293.0)) / 10.0


HEADS = [("temperature [°C]", 1.0, 273.15), ("temperature (celsius)", 1.0, 273.15),
         ("temperature [degF]", 5 / 9, 255.3722)]  # fmt: skip


@pytest.mark.matrix(
    keep=(
        "temperature (celsius)-1.0-273.15",
        "temperature [degF]-0.5555555555555556-255.3722",
    )
)
@pytest.mark.parametrize(("head", "gain", "offset"), HEADS)
def test_a_temperature_is_told_with_its_zero_and_reads_as_told(tmp_path, head, gain, offset):
    """Water freezes at 0 °C and 32 °F, which are 273.15 K."""
    time = 0.01 * np.arange(500)
    columns = {"t": time, "heater [W]": np.sin(time), head: 20 + np.cos(time)}
    path = written(tmp_path / "log.csv", **columns)
    with pytest.raises(RecordingError, match="has another zero than 'K'") as error:
        load_recording(path, Oven())
    remedy = str(error.value).split("declare it as 'temperature=")[1].split("'")[0]
    read = load_recording(path, Oven(), {"temperature": remedy})
    np.testing.assert_allclose(read["temperature"], gain * columns[head] + offset, atol=1e-3)
    proposed = propose(read_table(path), Oven()).bench().columns["temperature"]
    assert (proposed.gain, proposed.offset) == pytest.approx((gain, offset))


def test_a_model_in_celsius_reads_any_spelling_of_it(tmp_path):
    class Room(Oven):
        states = outputs = (Signal("temperature", "degC", noise=0.1),)

    time = 0.01 * np.arange(500)
    for head in ("temperature [°C]", "temperature [deg C]", "temperature (Celsius)", "temperature"):
        path = written(tmp_path / "log.csv", t=time, heater=np.sin(time), **{head: 20 + np.cos(time)})
        assert load_recording(path, Room())["temperature"][0] == pytest.approx(21.0)


def test_counts_are_told_how_they_are_declared(tmp_path, run):
    path = written(tmp_path / "log.csv", t=run["t"], torque=run["u"], **{"angle [counts]": run["y"]})
    with pytest.raises(RecordingError, match=r"'angle=0\.0015\*angle \[counts\]%4096:rad' if it wraps"):
        load_recording(path, PENDULUM)


@pytest.mark.every("spec", ["enc%4096", "-enc%360:deg", "0.001*enc%4096-2:m", "2*enc%1e3+1.5"])
def test_a_period_is_read_as_written_and_kept(tmp_path, spec):
    channel = Channel.parse(spec, ("enc", "t"))
    assert (channel.column, str(channel)) == ("enc", spec.replace("1e3", "1000"))
    assert channel.period in (4096.0, 360.0, 1000.0)
    assert Channel.parse(spec) == channel  # whether or not the header is known
    assert Channel.parse("duty%50", ("duty%50",)) == Channel("duty%50")
    bench = Bench({"angle": channel})
    bench.save(tmp_path / "bench.yaml")
    assert Bench.load(tmp_path / "bench.yaml") == bench


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_missing_cells_are_counted_and_their_rows_given(tmp_path, run, kind):
    columns = {"t": run["t"], "torque": run["u"].copy(), "angle": run["y"].copy()}
    columns["torque"][[4, 8, 9, 10, 11, 40]] = np.nan
    columns["angle"][100:300:20] = np.nan
    columns["angle"][1000:1100] = np.nan
    path = tmp_path / f"log.{kind}"
    if kind == "csv":
        written(path, **columns)
    else:
        pq.write_table(pa.table(columns), path)
    first = 2 if kind == "csv" else 1  # a text's header is row 1
    with pytest.warns(match="lost") as warned:
        read = load_recording(path, PENDULUM)
    said = next(str(w.message) for w in warned if "lost" in str(w.message))
    rows = f"rows {first + 4}, {first + 8} to {first + 11} and {first + 40} (6 rows)"
    assert f"column 'torque': empty in {rows}, where the command before is held" in said
    few = ", ".join(str(first + row) for row in range(100, 200, 20))
    assert (
        f"column 'angle': empty in rows {few} and 6 more stretches up to row {first + 1099} (110 rows)"
        in said
    )
    assert np.array_equal(np.flatnonzero(read.lost["angle"]), [*range(100, 300, 20), *range(1000, 1100)])
    assert read["torque"][8:12] == pytest.approx(read["torque"][7])
    assert "torque" not in read.lost


def test_leaving_the_rows_out_is_a_remedy(tmp_path, run):
    """As the message says: a gap of four is filled, a longer one begins a new episode."""
    bad = np.zeros(1500, dtype=bool)
    bad[[300, 301, 302, 303, *range(800, 860)]] = True
    path = written(tmp_path / "log.csv", t=np.where(bad, np.nan, run["t"]), torque=run["u"], angle=run["y"])
    with pytest.raises(RecordingError, match=r"leave such rows out .gaps of up to four are then filled"):
        load_recording(path, PENDULUM)
    written(path, t=run["t"][~bad], torque=run["u"][~bad], angle=run["y"][~bad])
    with pytest.warns(match="rows"):
        read = load_recording(path, PENDULUM)
    assert len(read.bounds) == 2
    at = np.argmin(np.abs(read.time - run["t"][302]))
    assert read["angle"][at] == pytest.approx(run["y"][302], abs=0.02)


# What a logger writes of machines that are no motor


class Chamber(Machine):
    inputs = (Signal("heat", "W"), Signal("ambient", "°C"))
    states = outputs = (Signal("temperature", "°C", noise=0.05),)
    capacity = number("J/K", 9e3, 1e3, 1e6)
    loss = number("W/K", 10.0, 0.1, 1e3)

    def derivative(self, state, input, p):
        return (input.heat - p.loss * (state.temperature - input.ambient)) / p.capacity


class Altitude(Machine):
    inputs = (Signal("throttle", "1"),)
    states = (Signal("height", "m"), Signal("climb", "m/s"))
    outputs = (Signal("height", "m"), Signal("climb", "m/s"))
    thrust = number("m/s^2", 20.0, 5.0, 100.0)

    def derivative(self, state, input, p):
        return state.climb, p.thrust * input.throttle - 9.81


@pytest.mark.nightly
def test_a_quantity_is_known_by_its_unit_and_its_own_word(tmp_path):
    """Two temperatures are told by the word that one shares with the model, a power by its watts."""
    heat = np.repeat([0.0, 400.0, 100.0, 800.0, 0.0, 600.0], 100)
    chamber = [21.0]
    for power in heat[:-1]:
        chamber.append(chamber[-1] + 5.0 / 9e3 * (power - 10.0 * (chamber[-1] - 21.0)))
    rows = [
        f"{9 + k // 720:02d}:{k // 12 % 60:02d}:{k % 12 * 5:02d}\t{k + 1}\t{power:.0f}\t{t:.2f}\t"
        f"{21 + k % 7 / 50:.2f}"
        for k, (power, t) in enumerate(zip(heat, chamber, strict=True))
    ]
    header = "Time\tCount\tStage Power/W\tChamber T/°C\tAmbient T/°C"
    (tmp_path / "log.txt").write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    proposal = propose(read_table(tmp_path / "log.txt"), Chamber())
    assert {c.role: c.column for c in proposal.columns} == {
        "t": "Time", "heat": "Stage Power/W", "ambient": "Ambient T/°C", "temperature": "Chamber T/°C",
    }  # fmt: skip
    assert proposal.sure


@pytest.mark.nightly
def test_a_height_is_one_by_its_name(tmp_path):
    t = 0.02 * np.arange(500)
    height = 1.0 + 0.3 * np.sin(t)
    columns = {
        "stamp_ms": 1e3 * t,
        "throttle_pct": 49.0 - 1.5 * np.sin(t),
        "range_alt_m": height,
        "climb_rate": 0.3 * np.cos(t),
        "vbat": 12.0 - 0.03 * t - 0.1 * np.sin(t),
    }
    found = {
        c.role: c for c in propose(read_table(written(tmp_path / "log.csv", **columns)), Altitude()).columns
    }
    assert found["height"].column == "range_alt_m"
    assert found["height"].evidence[0] == "its name"
    assert found["climb"].column == "climb_rate"


def test_what_is_in_another_unit_is_no_signal_however_well_it_goes(tmp_path, run):
    """No name tells, and a bearing warms as the axis turns: what is in degrees Celsius is no angle."""
    noise = np.random.default_rng(1).normal(0.0, 0.3, 1500)
    columns = {"time": run["t"], "a [°C]": 30.0 + run["y"], "b": run["u"], "c": run["y"] + noise}
    found = propose(read_table(written(tmp_path / "log.csv", **columns)), PENDULUM).bench().columns
    assert (found["torque"].column, found["angle"].column) == ("b", "c")


def test_a_heading_is_a_yaw_and_no_pitch(tmp_path):
    rows = np.random.default_rng(0).normal(size=(5, 300)).cumsum(axis=1)
    names = ("left_command", "right_command", "x", "y", "icp_pitch", "icp_yaw")
    columns = {"t": 0.02 * np.arange(300), **dict(zip(names, [*rows, rows[0]], strict=True))}
    proposal = propose(read_table(written(tmp_path / "log.csv", **columns)), get_model("differential_drive"))
    assert proposal.bench().columns["heading"].column == "icp_yaw"


def test_what_numbers_the_rows_is_no_signal(tmp_path, run):
    assert counts(np.arange(1500.0) % 256)
    assert not counts(run["y"])
    assert not counts(np.round(run["y"], 1))
    columns = {"time": run["t"], "nr": np.arange(1500.0) % 256, "winkel": run["y"]}
    proposal = propose(read_table(written(tmp_path / "log.csv", **columns)), PENDULUM)
    assert proposal.missing == ("torque",)


@pytest.mark.every(
    ("name", "unit"),
    [
        ("power/W", "W"), ("omega/rad/s", "rad/s"), ("T / °C", "°C"), ("U/V", "V"),
        ("/robot/s", ""), ("left/right", ""), ("pos_deg", "deg"), ("F_N", "N"),
    ],
)  # fmt: skip
def test_a_quantity_is_divided_by_its_unit(name, unit):
    assert unit_of(name) == unit


@pytest.mark.every(
    ("texts", "seconds"),
    [
        (("23:59:59", "0:00:04"), 5.0),
        (("2026-05-03 14:59:40", "2026-05-03 14:59:45"), 5.0),
        (("3.5.2026 9:05:01", "3.5.2026 9:05:06"), 5.0),
        (("9:00:00:120", "9:00:00:220"), 0.1),
        (("2:59:58 PM", "3:00:03 PM"), 5.0),
        (("11:59:58 am", "12:00:03 pm"), 5.0),
        (("12:59:58 AM", "1:00:03 AM"), 5.0),
        (("5/3/2026 2:59:40.5 PM", "5/3/2026 2:59:45.5 PM"), 5.0),
        (("03-May-2026 14:59:40", "03-May-2026 14:59:45"), 5.0),
        (("31 Dec 2026 23:59:58", "1 Jan 2027 00:00:03"), 5.0),
    ],
)
def test_times_as_loggers_write_them(tmp_path, texts, seconds):
    rows = "".join(f"{text},{k}.5\n" for k, text in enumerate(texts))
    (tmp_path / "log.csv").write_text(f"time,x\n{rows}")
    assert np.diff(read_table(tmp_path / "log.csv")["time"])[0] == pytest.approx(seconds, abs=1e-6)


@pytest.mark.every(
    ("texts", "step"),
    [
        (("23:59:58", "23:59:58.500", "23:59:59", "23:59:59.500", "0:00:00"), 0.5),
        (("5/11/2026 23:00", "5/12/2026 11:00", "5/12/2026 23:00", "5/13/2026 11:00"), 43200.0),
        (("5/11/2026 23:00", "5/12/2026 11:00", "5/12/2026 23:00"), 43200.0),
        (("11/12/26 11:59 PM", "12/12/26 12:01 AM"), 120.0),
        (("2026-10-25T02:59:59+02:00", "2026-10-25T02:00:00+01:00"), 1.0),
    ],
)
def test_times_of_one_column_are_read_alike_however_long_it_is(tmp_path, monkeypatch, texts, step):
    """Days before months, and midnight, show in a later block than the first; each row is one here."""
    monkeypatch.setattr("fieldmodels.recording.text._BLOCK", 2)
    (tmp_path / "log.csv").write_text("time,x\n" + "".join(f"{text},{k}.5\n" for k, text in enumerate(texts)))
    assert np.diff(read_table(tmp_path / "log.csv")["time"]) == pytest.approx(step)
