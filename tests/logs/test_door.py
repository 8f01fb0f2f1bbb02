"""Nothing is silently wrong at the door: units, clocks and what a column is, on generated files."""

from dataclasses import replace

import h5py
import numpy as np
import pytest
from scipy.signal import lfilter

from fieldagents.logs import Logs
from fieldmodels.diagnosis import diagnose
from fieldmodels.effects import actuator, friction
from fieldmodels.machine import Machine, number
from fieldmodels.model import Signal
from fieldmodels.recording import RecordingError
from fieldmodels.recording.bench import Bench
from fieldmodels.recording.evidence import coding_of
from fieldmodels.recording.files import recording_of
from fieldmodels.recording.proposals import SURE, propose
from fieldmodels.recording.reading import read_table
from fieldmodels.recording.sources import read_log
from fieldmodels.recording.words import meanings, unit_of
from fieldmodels.registry import get_model
from fieldmodels.synthesis import synthesise

RIG = get_model("rig")


@pytest.fixture(scope="module")
def rig():
    rng = np.random.default_rng(0)
    made = synthesise(RIG, {}, "mixed", duration=15.0, step=0.01, amplitude=3.0, rng=rng, noise=True)
    return {
        "t": made.time,
        "force": made["force"],
        "position": made["position"],
        "velocity": made["velocity"],
    }


def written(path, header, *columns):
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.14g")
    return path


def known_as(path, model=RIG):
    """Signals as proposed, and the proposals by role."""
    table = read_table(path)
    proposal = propose(table, model)
    return recording_of(table, proposal.bench(), model), {c.role: c for c in proposal.columns}


# Units


@pytest.mark.every(
    ("header", "unit"),
    [
        ("x [mm]", "mm"), ("x (in/s)", "in/s"), ("x_mm", "mm"), ("x/mm", "mm"), ("x in mm", "mm"),
        ("x in m", "m"), ("speed (rpm) left", "rpm"), ("angle [deg] (filtered)", "deg"), ("force_kip", "kip"),
        ("velocity in/s", "in/s"), ("speed_ft/s", "ft/s"), ("torque (ft-lb)", "ft-lb"), ("p [psi]", "psi"),
        ("control[0]", ""), ("data[3]", ""), ("q[1]", ""), ("q[0:3]", ""), ("Motor speed (5)", ""),
        ("x(t)", ""), ("W (IMU)", ""), ("torque (left)", ""), ("joint_act", ""), ("robot_psi", ""),
        ("force (kip2)", "kip2"), ("angle [foo]", "foo"), ("angle (counts)", "counts"), ("current_in", ""),
        ("Torque_Nm_", "Nm"), ("torque_nm", "N m"), ("x_nm", "nm"), ("angle [0.01 °]", "0.01 °"),
    ],
)  # fmt: skip
def test_a_unit_is_read_from_any_notation(header, unit):
    """An index, a motor's number, an argument and words that describe are none; what nobody knows is kept."""
    assert unit_of(header) == unit


@pytest.mark.every(
    "header",
    [
        "time (s),force (kip),position (in),velocity (in/s)",
        "time_s,force_kip,position_in,velocity_in/s",
        "time / s,force / kip,position / in,velocity / in/s",
        "time,force,position,velocity\ns,kip,in,in/s",
    ],
)
def test_units_beyond_the_usual_ones_have_their_factors(tmp_path, rig, header):
    """1 kip is 4448.222 N (1000 lbf), 1 in is 0.0254 m."""
    columns = rig["t"], rig["force"] / 4448.2216, rig["position"] / 0.0254, rig["velocity"] / 0.0254
    read, found = known_as(written(tmp_path / "log.csv", header, *columns))
    for name in ("force", "position", "velocity"):
        np.testing.assert_allclose(read[name], rig[name], rtol=1e-6, atol=1e-9)
        assert found[name].confidence >= 0.9


def test_an_unknown_unit_is_said_and_asked_and_an_accept_settles_it(tmp_path, rig):
    path = written(tmp_path / "log.csv", "t,force (kip2),position", rig["t"], rig["force"], rig["position"])
    with pytest.raises(
        RecordingError, match=r"the header says \(kip2\), which is no unit that is known"
    ) as error:
        Logs(RIG).read(str(path))
    assert "--column 'force=GAIN*force (kip2):N' tells" in str(error.value)
    with pytest.warns(match="N is assumed"):
        read = Logs(RIG, accept=True).read(str(path))
    np.testing.assert_allclose(read["force"], rig["force"], rtol=1e-6)
    told = Logs(RIG, {"": {"force": "force (kip2):kip"}}, accept=True)
    (tmp_path / "bench.yaml").unlink()
    assert np.ptp(told.read(str(path))["force"]) == pytest.approx(4448.2216 * np.ptp(rig["force"]), rel=1e-6)


def test_greek_letters_are_their_names_and_of_two_roles_the_last_word_tells():
    assert meanings("τ_cmd") == {"torque", "command"}
    assert meanings("/arm_controller/state.desired.positions[1]") == {"command", "position"}
    assert meanings("/arm_controller/state.actual.positions[1]") == {"measured", "position"}


def test_a_response_is_of_its_commands_axis_and_an_unknown_rate_tells_no_angle(tmp_path, rig):
    names = "t,target.roll,state.pitch,state.roll,state.rate [foo/s]"
    table = read_table(written(tmp_path / "log.csv", names, *rig.values(), rig["velocity"]))
    columns = {c.role: c.column for c in propose(table, get_model("servo")).columns}
    assert (columns["set_point"], columns["position"]) == ("target.roll", "state.roll")
    propose(table, get_model("pendulum"))


def test_a_range_is_no_unit_and_counts_a_second_have_no_size(tmp_path, rig):
    path = written(tmp_path / "log.csv", "t,force [10 kN],position [m],velocity [cnt/s]", *rig.values())
    found = known_as(path)[1]
    assert [found[name].confidence for name in ("force", "velocity")] == [0.6, 0.6]
    assert "(10 kN), which is no unit that is known" in found["force"].evidence[1]
    assert "cnt/s, which has no size" in found["velocity"].evidence[1]


def test_a_clock_of_an_unknown_unit_is_asked_for(tmp_path, rig):
    path = written(tmp_path / "log.csv", "time (foo),force,position", rig["t"], rig["force"], rig["position"])
    clock = known_as(path)[1]["t"]
    assert (clock.unit, clock.confidence) == ("s", 0.8)
    assert "(foo)" in clock.evidence[0]
    path = written(
        tmp_path / "log.csv", "stamp,force,position", 1e4 * rig["t"], rig["force"], rig["position"]
    )
    assert known_as(path)[1]["t"].confidence == 0.8  # 10,000 rows a second, if it counts microseconds


def test_words_in_brackets_tell_what_a_column_is(tmp_path, rig):
    """A description is no unit, and counts as a word of the name."""
    header = "time,force (measured),force (cmd),position"
    columns = rig["t"], rig["force"] + 0.5, rig["force"], rig["position"]
    assert known_as(written(tmp_path / "log.csv", header, *columns))[1]["force"].column == "force (cmd)"


# Clocks


class Motor(Machine):
    inputs = (Signal("voltage", "V"),)
    states = outputs = (Signal("speed", "rad/s", noise=0.005),)
    gain = number("rad/s/V", 1.0, 0.0, 1e3)
    time_constant = number("s", 0.1, 0.01, 10.0)
    effects = actuator("voltage", ("delay", "dead_zone")) + friction("speed")

    def derivative(self, state, input, p):
        return (p.gain * input.voltage - state.speed) / p.time_constant


def late(seed=1):
    """A speed that follows a command 120 ms late and with a lag of 30 ms, at 1 kHz for 40 s."""
    rng, n = np.random.default_rng(seed), 40_000
    command = np.zeros(n)
    for k in np.flatnonzero(rng.random(n) < 1.5e-3):
        command[k:] = rng.uniform(-1, 1)
    command = np.repeat(np.convolve(command, np.ones(200) / 200, "same")[::10], 10)  # held for 10 ms
    speed = lfilter([1 / 30], [1, 1 / 30 - 1], np.concatenate([np.zeros(121), command])[:n])
    return 1e-3 * np.arange(n), command, speed + 0.005 * rng.normal(size=n)


def two_files(folder, offset=0.0, more=(), units=1.0):
    """Command and response by two files, the second with a clock ``offset`` ahead; more columns in both."""
    t, command, speed = late()
    rng = np.random.default_rng(2)
    noisy = [command + 0.01 * rng.normal(size=len(t)) for _ in range(2)]
    files = []
    for k, (name, values, rows) in enumerate((("voltage", command, 10), ("speed", speed, 10))):
        path = folder / f"{('setpoint', 'attitude')[k]}.csv"
        clock = ((t + 112.574 + k * offset) * (units if k else 1.0))[3 * k :: rows]
        columns = [clock, values[3 * k :: rows], *(noisy[k][3 * k :: rows] for _ in more)]
        files.append(written(path, ",".join(["time", name, *more]), *columns))
    return f"{files[1]}+{files[0]}"


def asked(source, **options):
    with pytest.raises(RecordingError, match="which is not sure") as error:
        Logs(Motor(), **options).read(source)
    return str(error.value)


def delayed(read):
    """By how much the response follows, by the slope of the phase of what it makes of its command [s]."""
    a, b = read["voltage"] - read["voltage"].mean(), read["speed"] - read["speed"].mean()
    lags = np.arange(-500, 500)
    return read.step * lags[np.argmax([np.roll(a, k) @ b for k in lags])]


def test_clocks_that_agree_are_not_moved_and_the_delay_is_found(tmp_path):
    """As in flight logs: two topics of one logger, 120 ms and a lag of 30 ms between them."""
    with pytest.warns(match="taken to have one clock: stamps are used as they are"):
        read = Logs(Motor()).read(two_files(tmp_path))
    assert not read.aligned
    assert delayed(read) == pytest.approx(0.15, abs=0.015)
    found = diagnose(Motor(), [read])
    (cause,) = found.causes
    assert cause.effect == "actuator_delay"
    assert cause.parameters["delay"].value == pytest.approx(0.12, abs=0.005)


def test_topics_of_one_file_are_not_moved(tmp_path):
    t, command, speed = late()
    topics = {"command/time": t[::10], "command/voltage": command[::10],
              "motor/time": t[3::10], "motor/speed": speed[3::10]}  # fmt: skip
    with h5py.File(tmp_path / "log.h5", "w") as file:
        for name, values in topics.items():
            file[name] = values
    table = read_table(tmp_path / "log.h5")
    proposal = propose(table, Motor())
    assert [c.role for c in proposal.columns] == ["t", "voltage", "speed"]
    assert delayed(recording_of(table, proposal.bench(), Motor())) == pytest.approx(0.15, abs=0.015)


@pytest.mark.every(
    ("offset", "units", "why"),
    [
        (100.0, 1.0, "their times do not overlap"),
        (1.7e9, 1.0, "one clock counts from 1970 and the other does not"),
        (7.0, 1e3, "one clock is in ms, the other in s"),
    ],
)
def test_two_clocks_are_put_together_when_asked_and_no_delay_is_named(tmp_path, offset, units, why):
    source = two_files(tmp_path, offset, units=units)
    said = asked(source)
    assert why in said
    assert "no delay can be told from such a shift" in said
    with pytest.warns(match="no delay can be told"):
        read = Logs(Motor(), accept=True).read(source)
    assert delayed(read) == pytest.approx(0.0, abs=0.015)
    again = Logs(Motor()).read(source)  # what was confirmed is kept, and what it rests on
    assert again.aligned
    assert np.array_equal(again["speed"], read["speed"])


def test_what_is_aligned_on_request_names_no_delay(tmp_path):
    with pytest.warns(match="as requested"):
        read = Logs(Motor(), align=True).read(two_files(tmp_path))
    assert read.aligned
    plain = Logs(Motor()).read(two_files(tmp_path))
    found = diagnose(Motor(), [replace(plain, aligned=True)])  # even where a delay is there to be seen
    assert "actuator_delay" in found.not_testable
    assert not any("delay" in name for c in found.causes for name in (c.effect, *c.alternatives))


@pytest.mark.parametrize("offset", [3.2, -0.7])
def test_a_channel_that_both_recorded_tells_the_shift_and_leaves_the_delay(tmp_path, offset):
    source = two_files(tmp_path, offset, more=("shunt",))
    assert "both recorded one signal" in asked(source)
    with pytest.warns(match="its clock was moved"):
        read = Logs(Motor(), accept=True).read(source)
    assert not read.aligned
    assert delayed(read) == pytest.approx(0.15, abs=0.015)


@pytest.mark.every(("drift", "offset"), [(200e-6, 0.0), (-200e-6, 3.2), (0.0, 0.0), (0.0, 3.2)])
def test_a_channel_that_both_recorded_tells_a_drift_and_leaves_the_delay(tmp_path, drift, offset):
    """Ten minutes, at the end of which two clocks are 0.12 s further apart than at their beginning."""
    rng, t = np.random.default_rng(4), 0.02 * np.arange(30_000)
    command = np.repeat(rng.uniform(-1, 1, 1000), 30)
    speed = lfilter([0.5], [1, -0.5], np.concatenate([np.zeros(6), command])[: len(t)])
    shunt = lfilter([0.1], [1, -0.9], command)
    shunts = [shunt + 0.01 * rng.normal(size=len(t)) for _ in range(2)]
    one = written(tmp_path / "drive.csv", "time,speed,shunt", t, speed, shunts[0])
    clock = (t - offset) / (1 + drift)
    two = written(tmp_path / "desk.csv", "time,voltage,shunt", clock[2:], command[2:], shunts[1][2:])
    table = read_log(f"{one}+{two}")
    proposal = propose(table, Motor())
    moved = [c for c in proposal.columns if c.role == "t2"]
    assert len(moved) == bool(drift or offset)
    for clock in moved:
        assert clock.confidence < SURE
        assert ("the clocks drift" in clock.evidence[0]) == bool(drift)
        assert clock.gain - 1 == pytest.approx(drift, abs=3e-6)
        assert clock.offset == pytest.approx(offset, abs=2e-3 if drift else 5e-3)
    read = recording_of(table, proposal.bench(), Motor())
    assert not read.aligned
    for part in (slice(0, 5_000), slice(-5_000, None)):
        lags = [np.roll(read["voltage"][part], k) @ read["speed"][part] for k in range(20)]
        assert read.step * np.argmax(lags) == pytest.approx(0.12, abs=0.025)


def test_the_shift_of_a_clock_may_be_declared(tmp_path):
    source = two_files(tmp_path, 3.2)
    columns = {"": {"t2": "time (setpoint)+3.2:s"}}
    with pytest.warns(match="moved by"):
        read = Logs(Motor(), columns, accept=True).read(source)
    assert delayed(read) == pytest.approx(0.15, abs=0.015)
    with pytest.raises(RecordingError, match="is the clock of no further file"):
        recording_of(read_log(source), Bench.of({"t2": "voltage"}), Motor())


# What a column is


class Wheels(Machine):
    inputs = (Signal("throttle", "1"),)
    states = (Signal("speed", "m/s", noise=0.01), Signal("turn_rate", "rad/s", noise=0.01))
    outputs = states
    gain = number("m/s^2", 10.0, 0.1, 1e3)

    def derivative(self, state, input, p):
        return p.gain * input.throttle - state.speed, -state.turn_rate


@pytest.mark.every("gyro", ["W (IMU)", "imu.gyro.z", "gyro_z", "yaw_rate"])
@pytest.mark.every("encoder", ["vel encoder", "wheel speed", "odom.vel", "v"])
def test_a_speed_is_an_encoders_and_a_turn_rate_a_gyros(tmp_path, gyro, encoder):
    """The gyro's column stands first, and no unit is stated."""
    t = 0.01 * np.arange(1000)
    path = written(
        tmp_path / "log.csv", f"time,{gyro},throttle,{encoder}", t, np.cos(3 * t), np.sin(t), np.sin(t - 0.5)
    )
    found = {c.role: c.column for c in propose(read_table(path), Wheels()).columns}
    assert (found["speed"], found["turn_rate"]) == (encoder, gyro)


def driven(seed=3):
    """A motor's command, in steps both ways, and its speed: time, voltage, speed at 100 Hz."""
    rng = np.random.default_rng(seed)
    command = np.repeat(rng.uniform(-1, 1, 60), 50)
    speed = lfilter([0.1], [1, -0.9], np.concatenate([[0.0], command[:-1]]))
    return 0.01 * np.arange(len(command)), command, speed + 0.003 * rng.normal(size=len(command))


@pytest.mark.every("lost", ["voltage", "speed"])
@pytest.mark.every("names", ["time,duty,velocity", "t,voltage,speed"])
def test_a_magnitude_is_said_and_no_sign_proposed_for_it(tmp_path, lost, names):
    t, command, speed = driven()
    sized = [t, np.abs(command), speed] if lost == "voltage" else [t, command, np.abs(speed)]
    path = written(tmp_path / "log.csv", names, *sized)
    found = {c.role: c for c in propose(read_table(path), Motor()).columns}
    assert "is never negative while" in found[lost].evidence[-1]
    assert found[lost].confidence < 0.9
    assert found["voltage"].gain == found["speed"].gain == 1.0
    with pytest.warns(match="a magnitude"):
        Logs(Motor(), accept=True).read(str(path))


def test_a_command_of_one_side_is_no_magnitude(tmp_path, rig):
    """A force that only pushes, against a spring: the carriage goes both ways nevertheless."""
    moved = rig["force"] + 2 * np.abs(rig["force"]).max()
    path = written(
        tmp_path / "log.csv", "time,f_cmd,pos,vel", rig["t"], moved, rig["position"], rig["velocity"]
    )
    assert "magnitude" not in str(propose(read_table(path), RIG))


CODINGS = {
    "int16": lambda v: v % 65536,
    "int12": lambda v: v % 4096,
    "sign1024": lambda v: np.where(v < 0, 1024 - v, v),
    "sign32768": lambda v: np.where(v < 0, 32768 - v, v),
}


@pytest.mark.every(("coding", "size"), [(c, s) for c in CODINGS for s in (150, 900)] + [("int16", 3e4)])
def test_signed_numbers_in_cells_without_a_sign_are_recognised(tmp_path, coding, size):
    t, command, speed = driven()
    counts = np.round(size * speed / np.abs(speed).max())
    path = written(tmp_path / "log.csv", "time,voltage,velocity", t, command, CODINGS[coding](counts))
    read, found = known_as(path, Motor())
    assert found["speed"].coding == coding
    assert found["speed"].confidence < 0.9
    assert str(found["speed"].channel) == f"velocity%{coding}:rad/s"
    np.testing.assert_array_equal(read["speed"], counts)
    with pytest.warns(match="velocity"):  # kept, and read again from what was kept
        Logs(Motor(), accept=True).read(str(path))
    assert Bench.load(tmp_path / "bench.yaml").columns["speed"].coding == coding
    plain = written(tmp_path / "plain.csv", "t,voltage,speed", t, command, CODINGS[coding](counts))
    with pytest.warns(match=rf"declare it as 'speed=speed%{coding}'"):
        recording_of(read_table(plain), Bench(), Motor())


@pytest.mark.every("coding", CODINGS)
def test_what_may_be_signed_has_lost_no_samples(tmp_path, coding):
    """One row below zero leaps over the whole range of an undeclared coding, as a spike does."""
    t, command, speed = driven()
    counts = np.round(200 * speed)
    counts[990:1030], counts[1010] = 2 + np.arange(40) % 2, -2
    path = written(tmp_path / "log.csv", "t,voltage,speed", t, command, CODINGS[coding](counts))
    with pytest.warns(match=rf"declare it as 'speed=speed%{coding}'"):
        read = recording_of(read_table(path), Bench(), Motor())
    assert read.lost == {}


def test_plain_counts_are_not_taken_for_signed_ones(tmp_path):
    rng = np.random.default_rng(5)
    for cells in (
        np.round(500 + 400 * np.sin(0.01 * np.arange(3000))),
        rng.integers(0, 65536, 3000).astype(float),
        np.repeat(rng.choice([0.0, 65535.0], 60), 50),
        np.arange(30_000.0) % 4096,
    ):
        assert coding_of(cells) == ("", "")


@pytest.mark.parametrize(
    ("head", "period", "gain"), [("angle", 4096, 2 * np.pi / 4096), ("angle_deg", 360, 1)]
)
def test_a_counter_that_wraps_is_proposed_with_its_period(tmp_path, head, period, gain):
    t, command, speed = driven()
    turns = 0.5 + np.cumsum(0.01 * (speed + 1.5))
    path = written(
        tmp_path / "log.csv", f"time,torque_cmd,{head}", t, command, np.floor(turns * period) % period
    )
    one = known_as(path, get_model("pendulum"))[1]["angle"]
    assert (one.period, one.gain) == (period, pytest.approx(gain))
    assert one.confidence < 0.9
    read = known_as(path, get_model("pendulum"))[0]
    np.testing.assert_allclose(np.ptp(read["angle"]), 2 * np.pi * np.ptp(turns), rtol=1e-2)


def lying(kind):
    t, command, speed = driven()
    if kind == "goes back":
        t[700:] -= 0.015
    elif kind == "jumps":
        t[700:] += 3600.0
    elif kind == "stands still":
        t[700] = t[699]
    return t, command, speed


@pytest.mark.every("kind", ["goes back", "jumps", "stands still"])
def test_a_clock_that_lies_is_said_with_its_row(tmp_path, kind):
    path = written(tmp_path / "log.csv", "t,voltage,speed", *lying(kind))
    with pytest.warns(match=rf"column 't': the clock {kind}.* at row 702"):
        recording_of(read_table(path), Bench(), Motor())


def test_a_clock_that_stands_still_is_refused(tmp_path):
    _, command, speed = driven()
    path = written(tmp_path / "log.csv", "t,voltage,speed", np.zeros_like(speed), command, speed)
    with pytest.raises(RecordingError, match="time stands still at 0 s"):
        Logs(Motor()).read(str(path))


def test_a_counter_that_begins_anew_is_refused_with_its_period(tmp_path):
    t, command, speed = driven()
    path = written(tmp_path / "log.csv", "ticks,voltage,speed", (60_000 + 1e3 * t) % 65536, command, speed)
    with pytest.raises(RecordingError, match=r"row 556.*declare its period, as 't=COLUMN%65536:ms'"):
        recording_of(read_table(path), Bench.of({"t": "ticks:ms"}), Motor())
    read = recording_of(read_table(path), Bench.of({"t": "ticks%65536:ms"}, ["ticks"]), Motor())
    assert np.ptp(read.time) == pytest.approx(np.ptp(t))
