"""Logs of flight controllers, LabVIEW, FRC robots, CAN buses, learned policies and MATLAB.

Each is written by another tool's writer, else byte for byte after the specification that its function cites.
"""

from __future__ import annotations

import json
import sqlite3
import struct
from collections.abc import Iterable, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from bench import Run, axis, commands, drive, follower, joint
from expected import Expected, entry, log, machine
from foreign import DEG, EPOCH, hdf5, signals, text

BOOT = 112.574  # seconds since its start when a controller began to log
RATES = ("rad/s", "rad/s", "1")


def rates(path: Path, seed: int, cause: str, lag: float, late: float, step: float, seconds: float) -> Run:
    """A rate loop of a drone, whose owner has a machine of one lag for it."""
    told = commands(np.random.default_rng(seed), int(seconds / step), step, 4.0)
    return follower(machine(path, *RATES), cause, told, step, lag, late)


# --- drones ---------------------------------------------------------------------------------------------


def ulog(path: Path, topics: dict[str, tuple[str, np.ndarray, list[Any]]]) -> Path:
    """A ULog of topics: fields, times [s], their values.

    https://docs.px4.io/main/en/dev_log/ulog_file_format
    """

    def message(kind: str, data: bytes) -> bytes:
        return struct.pack("<HB", len(data), ord(kind)) + data

    def said(key: str, value: bytes) -> bytes:
        return bytes([len(key)]) + key.encode() + value

    size = {"uint64_t": "Q", "uint16_t": "H", "uint8_t": "B", "float": "f", "bool": "?"}
    start = int(BOOT * 1e6)
    head = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", start), message("B", bytes(40))]
    head += [message("I", said("char[3] sys_name", b"PX4")), message("P", said("float MC_YAW_P", bytes(4)))]
    rows: list[tuple[float, bytes]] = [
        (0.0, message("L", struct.pack("<BQ", ord("6"), start) + b"[commander] Takeoff detected")),
        (3.0, message("S", bytes([0x2F, 0x73, 0x13, 0x20, 0x25, 0x0C, 0xBB, 0x12]))),
        (4.0, message("O", struct.pack("<H", 20))),
    ]
    for k, (topic, (fields, times, values)) in enumerate(topics.items()):
        head.append(message("F", f"{topic}:uint64_t timestamp;{fields}".encode()))
        head.append(message("A", struct.pack("<BH", 0, k) + topic.encode()))
        form = "<HQ"
        for kind in (one.split()[0] for one in fields.split(";") if one and "_padding" not in one):
            bare, _, count = kind.rstrip("]").partition("[")
            form += count + size[bare]
        for i, t in enumerate(times):
            row = [v[i] if isinstance(v, np.ndarray) else v for v in values]
            rows.append((t, message("D", struct.pack(form, k, int((BOOT + t) * 1e6), *row))))
    head.sort(key=lambda m: m[2] == ord("A"))  # definitions before data; the header and flags stay first
    path.write_bytes(b"".join(head + [m for _, m in sorted(rows, key=lambda row: row[0])]))
    return path


@log
def px4_yaw(folder: Path) -> Expected:
    """PX4 ULog: yaw set-points (50 Hz) and heading (100 Hz), three topics, a dropout."""
    run = joint("actuator_delay", 201, hold=2, pace=6.0)
    told, yaw = signals(run)
    place = "float x;float y;float z;float heading;bool xy_valid;uint8_t[3] _padding0;"
    topics = {
        "vehicle_local_position": (place, run.time + 0.0013, [0.1, 0.0, -2.0, yaw, True]),
        "trajectory_setpoint": ("float[3] position;float yaw;float yawspeed;", run.time[::2],
                                [0.0, 0.0, -2.0, told[::2], 0.0]),
        "vehicle_status": ("uint8_t nav_state;uint8_t arming_state;", run.time[::50], [14, 2]),
    }  # fmt: skip
    return entry(
        ulog(folder / "log_7.ulg", topics),
        run,
        "t=vehicle_local_position.timestamp:us; set_point=trajectory_setpoint.yaw:rad; "
        "position=vehicle_local_position.heading:rad",
    )


@log
def px4_rover(folder: Path) -> Expected:
    """PX4 ULog of a rover: `control[0]` right, `control[1]` left, both of [-1, 1], ten unused (NaN)."""
    run = drive("actuator_lag", 202)
    left, right, x, y, heading = signals(run)
    place = "float x;float y;float z;float vx;float heading;bool xy_valid;uint8_t[3] _padding0;"
    motors = "uint64_t timestamp_sample;float[12] control;uint16_t reversible_flags;uint8_t[6] _padding0;"
    stamps = ((BOOT + run.time) * 1e6).astype(np.int64)
    topics = {
        "actuator_motors": (motors, run.time, [stamps, right / 10, left / 10, *[np.nan] * 10, 3]),
        "vehicle_local_position": (place, run.time, [x, y, 0.0, 0.1, heading, True]),
    }
    motors, place = "actuator_motors", "vehicle_local_position"
    columns = {"left_command": f"{motors}.control[1]", "right_command": f"{motors}.control[0]"}
    return entry(
        ulog(folder / "rover.ulg", topics),
        run,
        f"left_command={motors}.control[1]:; right_command={motors}.control[0]:; "
        + "; ".join(f"{n}={place}.{n}:{u}" for n, u in (("x", "m"), ("y", "m"), ("heading", "rad"))),
        options={"columns": columns},
        scaled=("left_command", "right_command"),
    )


def dataflash(
    path: Path, formats: dict[str, tuple[int, str, str, str, str]], rows: Iterable[tuple[Any, ...]]
) -> Path:
    """An ArduPilot log: name -> type, format, labels, units, multipliers; rows of a name and its values.

    https://ardupilot.org/dev/docs/code-overview-adding-a-new-log-message.html and AP_Logger/LogStructure.h.
    """
    size = {**{c: c for c in "QBbfd"}, "M": "B", "c": "h", "C": "H", "n": "4s", "N": "16s", "Z": "64s"}
    own = {
        "FMT": (128, "BBnNZ", "Type,Length,Name,Format,Columns", "-b---", "-----"),
        "UNIT": (129, "QbZ", "TimeUS,Id,Label", "s--", "F--"),
        "FMTU": (130, "QBNN", "TimeUS,FmtType,UnitIds,MultIds", "s---", "F---"),
        "MULT": (131, "Qbd", "TimeUS,Id,Mult", "s--", "F--"),
    }
    known, out = {**own, **formats}, []

    def put(name: str, *values: Any) -> None:
        kind, form = known[name][:2]
        data = [v.encode() if isinstance(v, str) else v for v in values]
        out.append(struct.pack("<BBB" + "".join(size[c] for c in form), 0xA3, 0x95, kind, *data))

    for name, (kind, form, labels, *_) in known.items():
        put("FMT", kind, 3 + struct.calcsize("<" + "".join(size[c] for c in form)), name, form, labels)
    for key, label in zip("-sdhE#", ("", "s", "deg", "degheading", "rad/s", "instance"), strict=True):
        put("UNIT", 0, ord(key), label)
    for key, value in {"-": 0.0, "0": 1.0, "B": 1e-2, "F": 1e-6}.items():
        put("MULT", 0, ord(key), value)
    for kind, *_, units, factors in known.values():
        put("FMTU", 0, kind, units, factors)
    for row in rows:
        put(*row)
    path.write_bytes(b"".join(out))
    return path


ATT = "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw,AEKF"


@log
def ardupilot(folder: Path) -> Expected:
    """ArduPilot DataFlash: roll in hundredths of a degree, units and multipliers, two gyros."""
    run = joint("coulomb_friction", 203, pace=6.0)
    told, roll = (np.round(100 * s / DEG).astype(int) for s in signals(run))
    formats = {
        "PARM": (64, "QNff", "TimeUS,Name,Value,Default", "s---", "F---"),
        "MSG": (65, "QZ", "TimeUS,Message", "s-", "F-"),
        "MODE": (66, "QMBB", "TimeUS,Mode,ModeNum,Rsn", "s---", "F---"),
        "ATT": (67, "QccccCCCCB", ATT, "sddddhhdh-", "FBBBBBBBB-"),
        "IMU": (68, "QBfff", "TimeUS,I,GyrX,GyrY,GyrZ", "s#EEE", "F-000"),
    }
    rows: list[tuple[Any, ...]] = [("PARM", 0, "ATC_ANG_RLL_P", 4.5, 4.5), ("MSG", 0, "ArduCopter V4.5.7")]
    rows.append(("MODE", 0, 0, 0, 1))
    for t, a, b in zip(((BOOT + run.time) * 1e6).astype(int), told, roll, strict=True):
        rows.append(("ATT", int(t), a, b, 10, 12, 9000, 9010, 1, 1, 3))
        rows += [("IMU", int(t) + 40, unit, 0.01, 0.0, 0.0) for unit in (0, 1)]
    return entry(
        dataflash(folder / "00000017.BIN", formats, rows),
        run,
        "t=ATT.TimeUS:us; set_point=ATT.DesRoll:deg; position=ATT.Roll:deg",
    )


@log
def mavlink(folder: Path) -> Expected:
    """MAVLink tlog, 20 Hz: a set-point in degrees, the roll in radians, stamps of the ground station.

    As a ground station writes it: before each packet 8 bytes of stamp, big endian.
    """
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    run = joint("actuator_dead_zone", 204, rate=20.0, hold=2, pace=3.0)
    told, roll = signals(run)
    copter, station = (dialect.MAVLink(None, srcSystem=one) for one in (1, 255))
    late = 2e-3 * np.random.default_rng(204).random(len(run.time))
    with (folder / "flight.tlog").open("wb") as file:

        def put(t: float, sender: Any, message: Any) -> None:
            file.write(struct.pack(">Q", int((EPOCH + t) * 1e6)) + message.pack(sender))

        for k, t in enumerate(run.time + late):  # in the order in which they came in
            if k % 20 == 0:
                put(t, copter, dialect.MAVLink_heartbeat_message(2, 3, 81, 0, 4, 3))
                put(t, station, dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
            if k % 2 == 0:
                set_point = dialect.MAVLink_nav_controller_output_message
                put(t + 1e-4, copter, set_point(told[k] / DEG, 0.5, 90, 91, 12, 0, 0, 0))
            at = int((BOOT + run.time[k]) * 1e3)
            attitude = dialect.MAVLink_attitude_message(at, roll[k], 0.01, 1.57, 0.0, 0.0, 0.0)
            put(t + 2e-4, copter, attitude)
    return entry(
        folder / "flight.tlog",
        run,
        "set_point=NAV_CONTROLLER_OUTPUT.nav_roll:deg; position=ATTITUDE.roll:rad",
    )


def blackbox(run: Run) -> tuple[list[str], list[np.ndarray]]:
    """Names and whole numbers of a Betaflight log: rates in deg/s, time in us."""
    told, seen = (np.round(s / DEG).astype(int) for s in signals(run))
    zero, k = np.zeros_like(told), np.arange(len(told))
    columns = {
        "loopIteration": 52992 + 8 * k, "time": ((BOOT + run.time) * 1e6).astype(int),
        **{f"rcCommand[{j}]": zero + (told // 2 if j == 0 else 1000 * (j == 3)) for j in range(4)},
        **{f"setpoint[{j}]": told if j == 0 else zero for j in range(3)},
        "vbatLatest": zero + 15, **{f"gyroADC[{j}]": seen if j == 0 else zero + k % 3 for j in range(3)},
        **{f"motor[{j}]": 600 + (told - seen) * (-1) ** j for j in range(4)},
    }  # fmt: skip
    return list(columns), list(columns.values())


def decoded(path: Path, run: Run) -> Path:
    """What blackbox_decode makes of a log (its columns: https://github.com/betaflight/blackbox-tools)."""
    names, values = blackbox(run)
    units = {"time": "time (us)", "vbatLatest": "vbatLatest (V)"}
    cells = [[f"{v:3d}" if j > 1 else str(v) for v in one.tolist()] for j, one in enumerate(values)]
    flags = [["ANGLE_MODE" if k % 900 < 50 else "0" for k in range(len(run.time))], ["IDLE"] * len(run.time)]
    head = ", ".join([*(units.get(n, n) for n in names), "flightModeFlags (flags)", "failsafePhase (flags)"])
    return text(path, [head], [*cells, *flags], ", ")


RECORDER = "Blackbox flight data recorder by Nicholas Sherlock"
RATE_COLUMNS = "command=setpoint[0]:; response=gyroADC[0]:"
RATE_OPTIONS = {"columns": {"command": "setpoint[0]:deg/s", "response": "gyroADC[0]:deg/s"}}


@log
def blackbox_decode(folder: Path) -> Expected:
    """Betaflight CSV of blackbox_decode: blanks after commas, indices in brackets, columns of flags."""
    run = rates(folder, 205, "actuator_delay", 0.04, 0.03, 0.002, 20.0)
    return entry(
        decoded(folder / "LOG00007.01.csv", run),
        run,
        "t=time (us):us; " + RATE_COLUMNS,
        options=RATE_OPTIONS,
        said=(r"setpoint\[0\].*no unit", r"gyroADC\[0\].*no unit"),
    )


@log
def blackbox_explorer(folder: Path) -> Expected:
    """Betaflight CSV of Blackbox Explorer: pairs above the table, microseconds without a unit.

    https://github.com/betaflight/blackbox-log-viewer, csv-export-worker.js.
    """
    run = rates(folder, 206, "actuator_lag", 0.08, 0.0, 0.002, 20.0)
    names, values = blackbox(run)
    pairs = {"Product": RECORDER, "firmwareType": 3, "looptime": 125, "rollPID": "48,90,38", "Craft name": ""}
    head = [f'"{k}",' + (f'"{v}"' if isinstance(v, str) else str(v)) for k, v in pairs.items()]
    path = text(folder / "btfl_001.bbl.csv", [*head, ",".join(f'"{n}"' for n in names)], values, form=str)
    return entry(
        path,
        run,
        "t=time:; " + RATE_COLUMNS,
        options={"columns": {"t": "time:us", **RATE_OPTIONS["columns"]}},
    )


# --- LabVIEW ---------------------------------------------------------------------------------------------


def lvm(path: Path, segments: Sequence[Any], layout: str, **more: Any) -> str:
    """A measurement file by lvmio, whose layout is LabVIEW's (https://www.ni.com/tutorial/4139/en/)."""
    from lvmio import LvmFile, write_lvm

    decimal = more.pop("decimal", ".")
    file = LvmFile(list(segments), x_columns=layout, multi_headings=len(segments) > 1, time_pref="Absolute",
                   operator="lab", date="2026/11/22", time="10:00:00.7272")  # fmt: skip
    write_lvm(path, file, decimal_separator=decimal, encoding="cp1252")
    return str(path)


def channel(name: str, values: np.ndarray, unit: str, step: float) -> Any:
    from lvmio import Channel

    when = {"date": "2026/11/22", "time": "10:00:01.5"}
    return Channel(name, values.tolist(), unit=unit, delta_x=step, **when)


@log
def lvm_no_clock(folder: Path) -> Expected:
    """LabVIEW .lvm, X_Columns No: step, names, units in the header, an empty first and a comment column."""
    from lvmio import Segment

    run = axis("rig", "coulomb_friction", 207)
    u, y, v = signals(run)
    given = ("Force (Trigger)", u, "Newtons"), ("Position (Trigger)", 1e3 * y, "mm"), ("Velocity", v, "m/s")
    segment = Segment([channel(*one, 0.01) for one in given], comment="specimen 4, dry", notes="one header")
    return entry(
        lvm(folder / "test.lvm", [segment], "No"),
        run,
        "force=Force (Trigger):N; position=Position (Trigger):mm; velocity=Velocity:m/s",
    )


@log
def lvm_comma(folder: Path) -> Expected:
    """LabVIEW .lvm, X_Columns One, German, decimal comma, two channels empty."""
    from lvmio import Segment

    run = axis("rig", "actuator_saturation", 208).only("force", "position")
    u, y = signals(run)
    nothing = np.zeros(0)
    given = [
        ("Stellkraft", u, "N"),
        ("Untitled", nothing, ""),
        ("Weg", 1e3 * y, "mm"),
        ("Untitled 1", nothing, ""),
    ]
    segment = Segment([channel(*one, 0.01) for one in given], comment="Prüfung 12")
    return entry(
        lvm(folder / "pruefung.lvm", [segment], "One", decimal=","),
        run,
        "t=X_Value:s; force=Stellkraft:N; position=Weg:mm",
    )


@log
def lvm_segments(folder: Path) -> Expected:
    """LabVIEW .lvm, X_Columns Multi, two segments with headers of their own, channels of 50 and 100 Hz."""
    from lvmio import Segment

    parts = tuple(
        axis("rig", "actuator_delay", seed, seconds=15.0, hold=2).only("force", "position")
        for seed in (209, 210)
    )
    segments = [
        Segment([channel("Force", p.signals["force"][::2], "N", 0.02),
                 channel("Position", 1e3 * p.signals["position"], "mm", 0.01)], comment=f"run {k}")
        for k, p in enumerate(parts)
    ]  # fmt: skip
    return entry(
        lvm(folder / "runs.lvm", segments, "Multi"),
        parts[0],
        "t=X_Value:s; force=Force:N; position=Position:mm",
        parts=parts,
    )


@log
def tdms(folder: Path) -> Expected:
    """LabVIEW .tdms, two groups (50 and 100 Hz), no column of times: wf_increment, unit_string."""
    from nptdms import ChannelObject, RootObject, TdmsWriter

    run, start = axis("pendulum", "coulomb_friction", 211, hold=2), datetime(2026, 11, 22, 10)
    u, y, v = signals(run)
    given = [("Drive", "Torque", u[::2], "mN.m", 1e3, 0.02), ("Encoder", "Angle", y, "deg", 1 / DEG, 0.01),
             ("Encoder", "Speed", v, "rpm", 30 / np.pi, 0.01)]  # fmt: skip
    with TdmsWriter(folder / "bench.tdms") as file:
        for k in range(4):  # as a loop of acquisition appends
            objects: list[Any] = [RootObject({"operator": "lab", "DateTime": start})]
            for group, name, values, unit, gain, step in given:
                wave = {
                    "increment": step,
                    "start_offset": 0.0,
                    "start_time": start,
                    "samples": len(values) // 4,
                }
                about = {"unit_string": unit, **{f"wf_{key}": value for key, value in wave.items()}}
                objects.append(ChannelObject(group, name, gain * np.array_split(values, 4)[k], about))
            file.write_segment(objects)
    return entry(
        folder / "bench.tdms",
        run,
        "torque=Drive.Torque:mN.m; angle=Encoder.Angle:deg; velocity=Encoder.Speed:rpm",
    )


# --- robots ----------------------------------------------------------------------------------------------


@log
def wpilog(folder: Path) -> Expected:
    """WPILib's .wpilog with the entries of its SysIdRoutineLog, us, units as words in the metadata."""
    from wpiutil import DataLogWriter
    from wpiutil.log import DoubleLogEntry, StringLogEntry

    run = axis("rig", "coulomb_friction", 212, rate=50.0)
    tests = ("quasistatic-forward", "quasistatic-reverse", "dynamic-forward", "dynamic-reverse")
    file = DataLogWriter(str(folder / "FRC_20261122_100000.wpilog"), "robot 1")
    units = {"voltage": "Volt", "position": "Meter", "velocity": "Meter per Second"}
    entries = [DoubleLogEntry(file, f"{n}-motor-lift", unit, 1) for n, unit in units.items()]
    state = StringLogEntry(file, "sysid-test-state-lift", 1)
    battery = DoubleLogEntry(file, "NT:/SmartDashboard/battery", '{"source":"NT"}', 1)
    for k, t in enumerate(run.time):
        at = int((BOOT + t) * 1e6)
        for j, (one, values) in enumerate(zip(entries, signals(run), strict=True)):
            one.append(float(values[k]), at + 7 * j)  # some microseconds after another
        if k % 25 == 0:
            state.append(tests[4 * k // len(run.time)], at)
            battery.append(12.5, at)
    file.flush()
    file.stop()
    return entry(
        folder / "FRC_20261122_100000.wpilog",
        run,
        "force=voltage-motor-lift:V; position=position-motor-lift:m; velocity=velocity-motor-lift:m/s",
        scaled=("force",),
    )


@log
def sysid(folder: Path) -> Expected:
    """SysId's JSON: four tests of rows [time, voltage, position, velocity] without names, in rotations.

    Positions are in rotations, whatever ``units`` says (docs/data-collection.md of wpilibsuite/sysid).
    """
    around, start = 0.4788, BOOT
    parts, data = [], {"sysid": True, "test": "Elevator", "units": "Meters", "unitsPerRotation": around}
    for k, name in enumerate(("slow-forward", "slow-backward", "fast-forward", "fast-backward")):
        run = axis("rig", "coulomb_friction", 213 + k, rate=200.0, seconds=8.0)
        u, y, v = signals(run)
        data[name] = np.stack([start + run.time, u, y / around, v / around], 1).tolist()
        parts.append(run)
        start += 20.0
    (folder / "sysid_data20261122-100000.json").write_text(json.dumps(data))
    return entry(
        folder / "sysid_data20261122-100000.json",
        parts[0],
        "t=time:s; force=voltage:V; position=position:m; velocity=velocity:m/s",
        scaled=("force",),
        parts=tuple(parts),
    )


@log
def rollouts(folder: Path) -> Expected:
    """JSON of six rollouts: data[k].actions and sensor_data, the rate as action_hz, no unit."""
    parts = tuple(joint("actuator_delay", 220 + k, rate=50.0, seconds=6.0) for k in range(6))
    data = [
        {"type": ("chirp", "step", "prbs")[k % 3], "targets": [], "actions": p.signals["set_point"].tolist(),
         "sensor_data": p.signals["position"].tolist()}
        for k, p in enumerate(parts)
    ]  # fmt: skip
    config = {"action_hz": 50, "joint_limits": [-0.625, 0.625]}
    (folder / "response.json").write_text(json.dumps({"dataset": "real", "config": config, "data": data}))
    return entry(
        folder / "response.json",
        parts[0],
        "set_point=actions:; position=sensor_data:",
        options={"columns": {"set_point": "actions:rad", "position": "sensor_data:rad"}, "rate": 50.0},
        parts=parts,
    )


@log
def lerobot(folder: Path) -> Expected:
    """LeRobot data set (a folder): lists of two joints, three episodes, degrees without a unit.

    Version 2.1 of https://huggingface.co/docs/lerobot: a Parquet file an episode, names in meta/info.json.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    parts = tuple(joint("coulomb_friction", 230 + k, rate=30.0, seconds=12.0, pace=5.0) for k in range(3))
    places = ["shoulder_lift.pos", "gripper.pos"]
    vector = {"dtype": "float32", "shape": [2], "names": places}
    scalar = {"dtype": "int64", "shape": [1], "names": None}
    info = {
        "codebase_version": "v2.1", "robot_type": "so101_follower", "total_episodes": 3, "total_frames": 1080,
        "total_tasks": 1, "total_videos": 0, "total_chunks": 1, "chunks_size": 1000, "fps": 30,
        "splits": {"train": "0:3"}, "video_path": None,
        "data_path": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
        "features": {"action": vector, "observation.state": vector,
                     "timestamp": {"dtype": "float32", "shape": [1], "names": None},
                     **dict.fromkeys(("frame_index", "episode_index", "index", "task_index"), scalar)},
    }  # fmt: skip
    (folder / "set/meta").mkdir(parents=True)
    (folder / "set/data/chunk-000").mkdir(parents=True)
    (folder / "set/meta/info.json").write_text(json.dumps(info, indent=4))
    episodes = [{"episode_index": k, "tasks": ["wave"], "length": 360} for k in range(3)]
    (folder / "set/meta/episodes.jsonl").write_text("".join(json.dumps(one) + "\n" for one in episodes))
    (folder / "set/meta/tasks.jsonl").write_text(json.dumps({"task_index": 0, "task": "wave"}) + "\n")
    for k, part in enumerate(parts):
        rows, zero = np.arange(360), np.zeros(360, np.int64)
        both = [np.stack([s / DEG, np.full(360, 12.0)], 1).astype(np.float32).ravel() for s in signals(part)]
        columns = {
            **{n: pa.FixedSizeListArray.from_arrays(pa.array(v), 2)
               for n, v in zip(("action", "observation.state"), both, strict=True)},
            "timestamp": (rows / 30).astype(np.float32), "frame_index": rows, "episode_index": zero + k,
            "index": rows + 360 * k, "task_index": zero,
        }  # fmt: skip
        pq.write_table(pa.table(columns), folder / f"set/data/chunk-000/episode_{k:06d}.parquet")
    names = {"set_point": f"action[{places[0]}]", "position": f"observation.state[{places[0]}]"}
    return entry(
        folder / "set",
        parts[0],
        "t=timestamp:s; " + "; ".join(f"{signal}={name}:" for signal, name in names.items()),
        options={"columns": {signal: f"{name}:deg" for signal, name in names.items()}},
        parts=parts,
    )


DBC = """VERSION ""

NS_ :

BS_:

BU_: ECU PC

BO_ 256 Drive: 8 ECU
 SG_ ForceCmd : 0|16@1- (0.001,0) [-32|32] "N" PC
 SG_ Enabled : 16|1@1+ (1,0) [0|1] "" PC

BO_ 257 Encoder: 8 ECU
 SG_ Position : 7|32@0- (0.0001,0) [-1000|1000] "mm" PC
 SG_ Speed : 39|16@0- (0.1,0) [-3200|3200] "mm/s" PC

CM_ SG_ 256 ForceCmd "Commanded force";
"""
"""Little endian in the first message, Motorola's order in the second."""


@log
def can_trace(folder: Path) -> Expected:
    """CAN trace of candump and its DBC: 50 and 100 Hz, Intel's and Motorola's order, signed numbers.

    https://github.com/linux-can/can-utils; one message is in no DBC.
    """
    run = axis("rig", "actuator_dead_zone", 240, hold=2)
    u, y, v = signals(run)
    (folder / "bench.dbc").write_text(DBC)
    with (folder / "candump.log").open("w") as file:
        for k, t in enumerate(EPOCH + run.time):
            if k % 2 == 0:
                sent = struct.pack("<hB5x", round(1e3 * u[k]), 1).hex().upper()
                file.write(f"({t:.6f}) can0 100#{sent}\n")
            seen = struct.pack(">ihxx", round(1e7 * y[k]), round(1e4 * v[k])).hex().upper()
            file.write(f"({t + 4e-4:.6f}) can0 101#{seen}\n")
            if k % 100 == 0:
                file.write(f"({t + 5e-4:.6f}) can0 18FEF100#FFFF\n")
    return entry(
        f"{folder / 'candump.log'}+{folder / 'bench.dbc'}",
        run,
        "force=Drive.ForceCmd:N; position=Encoder.Position:mm; velocity=Encoder.Speed:mm/s",
    )


@log
def sqlite(folder: Path) -> Expected:
    """SQLite of nobody's format: a table of numbers."""
    run = axis("rig", "actuator_lag", 253)
    with sqlite3.connect(folder / "logger.db") as base:
        base.execute("create table samples (t real, force_cmd_N real, position_mm real, speed_mm_s real)")
        table = np.stack([run.time, *signals(run)], 1) * [1, 1, 1e3, 1e3]
        base.executemany("insert into samples values (?, ?, ?, ?)", table.tolist())
    base.close()
    return entry(
        folder / "logger.db",
        run,
        "t=t:; force=force_cmd_N:N; position=position_mm:mm; velocity=speed_mm_s:mm/s",
    )


# --- refused, with a remedy that works ------------------------------------------------------------------


def saved(path: Path, arrays: dict[str, Any]) -> str:
    """What MATLAB's ``save('plain.mat', '-struct', 's', '-v7')`` makes."""
    from scipy.io import savemat

    savemat(path, arrays, oned_as="column")
    return str(path)


@log
def matlab_dataset(folder: Path) -> Expected:
    """MATLAB 7.3 with a Simulink.SimulationData.Dataset.

    The variable is a reference of six numbers, the values are in ``#refs#`` without names.
    """
    import h5py

    run = axis("pendulum", "actuator_delay", 250).only("torque", "angle")
    hidden = {"#refs#/a": (run.time, ""), "#refs#/b": (run.signals["angle"], "")}
    path = hdf5(folder / "logsout.mat", hidden, matlab=True)
    with h5py.File(path, "r+") as file:
        node = file.create_dataset("logsout", data=np.array([[0xDD000000, 2, 1, 1, 1, 1]], np.uint32).T)
        node.attrs["MATLAB_class"] = np.bytes_("Simulink.SimulationData.Dataset")
        node.attrs["MATLAB_object_decode"] = np.int32(3)
        file.create_group("#subsystem#").create_dataset("MCOS", data=np.arange(9, dtype=np.uint8))
    elements = {name: {"t": run.time, "data": values} for name, values in run.signals.items()}
    return entry(
        path,
        run,
        "t=torque.t:; torque=torque.data:; angle=angle.data:",
        refused=(r"Simulink\.SimulationData\.Dataset", "logsout", r"save\("),
        remedy=saved(folder / "plain.mat", elements),
    )


@log
def matlab_timeseries(folder: Path) -> Expected:
    """MATLAB 5 with a timeseries.

    Class 17 (mxOPAQUE) as the notes in scipy.io's source describe it, and a subsystem at the end.
    """

    def element(kind: int, data: bytes) -> bytes:
        return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)

    def matrix(number: int, *parts: bytes) -> bytes:
        return element(14, element(6, struct.pack("<II", number, 0)) + b"".join(parts))

    def array(name: bytes, number: int, kind: int, values: np.ndarray) -> bytes:
        shape = struct.pack("<ii", values.size, 1)
        return matrix(number, element(5, shape), element(1, name), element(kind, values.tobytes()))

    run = axis("pendulum", "coulomb_friction", 251).only("torque", "angle")
    reference = array(b"", 13, 6, np.array([0xDD000000, 2, 1, 1, 1, 1], np.uint32))
    opaque = matrix(17, *(element(1, s) for s in (b"angle", b"MCOS", b"timeseries")), reference)
    inner = b"\x00\x01IM\0\0\0\0" + array(b"", 6, 9, run.signals["angle"])
    head = b"MATLAB 5.0 MAT-file, Platform: GLNXA64".ljust(116) + struct.pack("<Q", 128 + len(opaque))
    whole = head + b"\x00\x01IM" + opaque + array(b"", 9, 2, np.frombuffer(inner, np.uint8))
    (folder / "angle.mat").write_bytes(whole)
    return entry(
        folder / "angle.mat",
        run,
        "t=t:; torque=torque:; angle=angle:",
        refused=("timeseries", "angle", r"save\("),
        remedy=saved(folder / "plain.mat", {"t": run.time, **run.signals}),
    )


@log
def betaflight_raw(folder: Path) -> Expected:
    """Betaflight's raw .bbl.

    https://betaflight.com/docs/development/Blackbox-Internals: whole frames (I), each number a signed
    variable byte without a predictor.
    """
    run = rates(folder, 252, "actuator_delay", 0.04, 0.03, 0.002, 20.0)
    names, values = blackbox(run)

    def packed(value: int) -> bytes:
        left, out = (value << 1 ^ value >> 31) & 0xFFFFFFFF, bytearray()
        while left > 127:
            out.append(left & 127 | 128)
            left >>= 7
        return bytes([*out, left])

    zero = "0" * len(names)
    fields = {"name": names, "signed": "1" * len(names), "predictor": zero, "encoding": zero}
    lines = [f"Product:{RECORDER}", "Data version:2", "I interval:1", "looptime:125"]
    lines += [f"Field I {key}:{','.join(value)}" for key, value in fields.items()]
    frames = (b"I" + b"".join(map(packed, row)) for row in np.stack(values, 1).tolist())
    head = "".join(f"H {line}\n" for line in lines).encode()
    (folder / "LOG00009.BBL").write_bytes(head + b"".join(frames) + b"E\xffEnd of log\0")
    return entry(
        folder / "LOG00009.BBL",
        run,
        "t=time (us):us; " + RATE_COLUMNS,
        options=RATE_OPTIONS,
        refused=("Betaflight", "blackbox_decode"),
        remedy=str(decoded(folder / "LOG00009.01.csv", run)),
    )
