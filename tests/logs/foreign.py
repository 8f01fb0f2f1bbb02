"""Logs as other people's loggers write them: 20 to develop on, 20 of other formats and words to report.

Each is written by the format's own library (or by hand, for text) and never by the project.
"""

from __future__ import annotations

import bz2
import gzip
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
from bench import Run, axis, drive

DEG, RPM = np.pi / 180, np.pi / 30
EPOCH = 1_795_341_600.0  # 2026-11-22 10:00:00 UTC


@dataclass(frozen=True)
class Log:
    """One log and the truth behind it.

    Attributes:
        about: Format, language, units.
        source: As the command line takes it.
        run: What was measured.
        reversed: The signal that was written with the wrong sign, empty for none.
        options: What its owner must say, since the file does not hold it.
        scaled: Signals whose unit the file does not tell.
        late: Time of the file's first row in the run [s].
    """

    about: str
    source: str
    run: Run
    reversed: str = ""
    options: dict[str, Any] = field(default_factory=dict)
    scaled: tuple[str, ...] = ()
    late: float = 0.0


Rows = Sequence[np.ndarray]


def comma(value: float, digits: int = 5, thousands: str = "") -> str:
    """A number with a decimal comma."""
    text = f"{value:,.{digits}f}" if thousands else f"{value:.{digits}f}"
    return text.replace(",", "\0").replace(".", ",").replace("\0", thousands)


def text(path, head, columns: Rows, separator=",", form="{:.6f}".format, encoding="utf-8", end="\n") -> Path:
    """A text file; columns may be texts already."""
    rows = (
        separator.join(c if isinstance(c, str) else form(c) for c in row)
        for row in zip(*columns, strict=True)
    )
    data = end.join([*head, *rows, ""]).encode(encoding)
    packed = {".gz": gzip.compress, ".bz2": bz2.compress}.get(path.suffix, bytes)
    path.write_bytes(packed(data))
    return path


def signals(run: Run, wrong: str = "") -> list[np.ndarray]:
    """A run's signals in order, one perhaps of the wrong sign."""
    return [(-1.0 if name == wrong else 1.0) * values for name, values in run.signals.items()]


def stamps(time: np.ndarray, form: str, digits: int = 3) -> list[str]:
    """Times as text."""
    start = datetime(2026, 11, 22, 10, 0, 0)
    return [
        (start + timedelta(seconds=float(t))).strftime(form)[: None if digits == 6 else digits - 6]
        for t in time
    ]


def workbook(path: Path, head: Sequence[Sequence[Any]], columns: Sequence[Sequence[Any]]) -> Path:
    import openpyxl

    book = openpyxl.Workbook()
    book.create_sheet("Info").append(["Prüfstand", 3])
    for row in [*head, *zip(*columns, strict=True)]:
        book.active.append([float(c) if isinstance(c, np.floating) else c for c in row])
    book.save(path)
    return path


def bag(
    path: Path, topics: dict[str, tuple[str, np.ndarray, Callable[[Any, int, Any], Any]]], plugin: str
) -> Path:
    """A bag of ROS 2 (``MCAP``, ``SQLITE3``) or ROS 1: topics by type, times and a maker of messages."""
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if plugin == "ROS1" else Stores.ROS2_JAZZY)
    writer: Any = (
        rosbag1.Writer(path)
        if plugin == "ROS1"
        else rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin[plugin])
    )
    pack = store.serialize_ros1 if plugin == "ROS1" else store.serialize_cdr
    with writer as file:
        for topic, (kind, times, make) in topics.items():
            connection = file.add_connection(topic, kind, typestore=store)
            for k, t in enumerate(times):
                stamp = int((EPOCH + t) * 1e9)
                message = make(store.types, k, _header(store.types, stamp, plugin))
                file.write(connection, stamp, pack(message, kind))
    return path


def _header(types: Any, stamp: int, plugin: str) -> Any:
    time = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    more = {"seq": 0} if plugin == "ROS1" else {}
    return types["std_msgs/msg/Header"](stamp=time, frame_id="", **more)


def joint(place: np.ndarray, rate: np.ndarray) -> Callable[[Any, int, Any], Any]:
    return lambda types, k, header: types["sensor_msgs/msg/JointState"](
        header=header, name=["axis"], position=place[k : k + 1], velocity=rate[k : k + 1], effort=np.zeros(0)
    )


def scalar(values: np.ndarray) -> Callable[[Any, int, Any], Any]:
    return lambda types, k, _: types["std_msgs/msg/Float64"](data=float(values[k]))


def channels(
    path: Path, groups: Sequence[tuple[np.ndarray, dict[str, tuple[np.ndarray, str]]]], version: str
) -> Path:
    from asammdf import MDF, Signal

    with MDF(version=version) as file:
        for time, columns in groups:
            file.append([Signal(v, time, name=n, unit=u) for n, (v, u) in columns.items()])
        file.save(path, overwrite=True)
    return path


def hdf5(path: Path, data: dict[str, tuple[np.ndarray, str]], matlab: bool = False) -> Path:
    import h5py

    with h5py.File(path, "w", userblock_size=512 if matlab else 0) as file:
        for name, (values, unit) in data.items():
            node = file.create_dataset(name, data=values[None, :] if matlab else values)
            if unit:
                node.attrs["units"] = unit
    if matlab:
        with path.open("r+b") as raw:
            raw.write(
                b"MATLAB 7.3 MAT-file, Platform: GLNXA64, HDF5 schema 1.00 .".ljust(124) + b"\x00\x02IM"
            )
    return path


def develop(folder: Path) -> list[Log]:
    """The logs that the readers were developed on."""
    import pyarrow as pa
    import pyarrow.feather
    import pyarrow.parquet
    from scipy.io import savemat

    logs = []

    def add(about: str, path: Path | str, run: Run, wrong: str = "", **more: Any) -> None:
        logs.append(Log(about, str(path), run, wrong, **more))

    run = axis("pendulum", "coulomb_friction", 1)
    u, y, v = signals(run)
    head = [
        "Prüfstand 3",
        "Datum: 22.11.2026",
        "",
        "Zeit;Sollmoment;Winkel;Winkelgeschwindigkeit",
        "[ms];[Nm];[°];[U/min]",
    ]
    path = text(
        folder / "motor.csv", head, (1e3 * run.time, u, y / DEG, v / RPM), ";", comma, "latin-1", "\r\n"
    )
    add("CSV, German, Latin-1, `;`, decimal comma, row of units (ms, °, U/min)", path, run)

    run = axis("pendulum", "actuator_delay", 2)
    u, y, v = signals(run)
    head = ["Temps (s);Couple (N.cm);Angle (deg);Vitesse (tr/min)"]
    path = text(folder / "essai.csv.gz", head, (run.time, 100 * u, y / DEG, v / RPM), ";", comma)
    add("CSV, French, gzip, decimal comma, N.cm, deg, tr/min", path, run)

    run = axis("rig", "actuator_dead_zone", 3)
    u, y, v = signals(run, "force")
    head = ["Tiempo [s]\tFuerza [N]\tPosición [mm]\tVelocidad [mm/s]"]
    add(
        "TSV, Spanish, mm, mm/s",
        text(folder / "ensayo.tsv", head, (run.time, u, 1e3 * y, 1e3 * v), "\t"),
        run,
        "force",
    )

    run = axis("rig", "coulomb_friction", 4)
    u, y, v = signals(run)
    path = text(
        folder / "prova.txt", ["# banco 2", "#   tempo    forza   posizione"], (run.time, u, y), "   "
    )
    add("text, Italian, blanks, header in a comment", path, run.only("force", "position"))

    run = axis("rig", "actuator_delay", 5)
    add("CSV without a header", text(folder / "raw.csv", [], (run.time, *signals(run))), run)

    run = axis("rig", "actuator_saturation", 6)
    u, y, v = signals(run)
    head = [["Messung 17"], [], ["Zeit [s]", "Soll Kraft [N]", "Weg [mm]", "Geschwindigkeit [mm/s]"]]
    add(
        "Excel, German, title, mm",
        workbook(folder / "messung.xlsx", head, (run.time, u, 1e3 * y, 1e3 * v)),
        run,
    )

    run = axis("pendulum", "actuator_dead_zone", 7)
    u, y, v = signals(run, "angle")
    names = ("timestamp_ms", "cmd_torque_nm", "joint_pos_deg", "joint_vel_dps")
    table = pa.table([1e3 * run.time, u, y / DEG, v / DEG], names=names)
    pa.feather.write_feather(table, folder / "joint.feather")
    add("Feather, units as suffixes (ms, deg, dps)", folder / "joint.feather", run, "angle")

    run = axis("rig", "coulomb_friction", 8)
    u, y, v = signals(run)
    when = pa.array(((EPOCH + run.time) * 1e6).astype(np.int64), pa.timestamp("us"))
    fields = [pa.field("time", when.type)] + [
        pa.field(n, pa.float64(), metadata={"unit": unit}) for n, unit in (("kraft", "mN"), ("weg", "cm"))
    ]
    table = pa.table([when, 1e3 * u, 1e2 * y], schema=pa.schema(fields))
    pa.parquet.write_table(table, folder / "log.parquet")
    add(
        "Parquet, time stamps, units in metadata (mN, cm)",
        folder / "log.parquet",
        run.only("force", "position"),
    )

    run = axis("pendulum", "coulomb_friction", 9)
    u, y, v = signals(run)
    np.savez(folder / "log.npz", time=run.time, tau=u, q=y, dq=v)
    add("NumPy archive, `tau`, `q`, `dq`", folder / "log.npz", run)

    run = axis("pendulum", "actuator_delay", 10)
    u, y, v = signals(run, "torque")
    table = np.rec.fromarrays([run.time, u, y / DEG], names="stamp,u,phi_deg")
    np.save(folder / "log.npy", table)
    add("NumPy structured array, `u`, `phi_deg`", folder / "log.npy", run.only("torque", "angle"), "torque")

    run = axis("rig", "actuator_delay", 11)
    u, y, v = signals(run)
    rows = [
        {"time": t, "command": {"force": a}, "state": {"position": b, "velocity": c}}
        for t, a, b, c in zip(run.time.tolist(), u.tolist(), y.tolist(), v.tolist(), strict=True)
    ]
    (folder / "records.json").write_text(json.dumps(rows))
    add("JSON records, nested", folder / "records.json", run)

    run = axis("rig", "coulomb_friction", 12)
    u, y, v = signals(run)
    savemat(folder / "log5.mat", {"log": {"t": run.time, "F_N": u, "x_mm": 1e3 * y}}, do_compression=True)
    add("MATLAB 5, a structure, `F_N`, `x_mm`", folder / "log5.mat", run.only("force", "position"))

    run = axis("pendulum", "actuator_lag", 13)
    u, y, v = signals(run)
    data = {"zeit": (run.time, ""), "moment": (u, ""), "winkel": (y, ""), "drehzahl": (v, "")}
    add("MATLAB 7.3, German", hdf5(folder / "log73.mat", data, matlab=True), run)

    run = axis("pendulum", "coulomb_friction", 14, hold=2)
    u, y, v = signals(run)
    data = {
        "command/time": (run.time[::2], "s"), "command/torque": (u[::2], "N m"),
        "encoder/time": (run.time, "s"),
        "encoder/angle": (y / DEG, "deg"), "encoder/velocity": (v / DEG, "deg/s"),
    }  # fmt: skip
    add("HDF5, two rates (50 and 100 Hz), deg", hdf5(folder / "log.h5", data), run)

    run = axis("pendulum", "coulomb_friction", 15)
    u, y, v = signals(run, "torque")
    topics = {
        "/motor/command": ("std_msgs/msg/Float64", run.time, scalar(u)),
        "/joint_states": ("sensor_msgs/msg/JointState", run.time, joint(y, v)),
    }
    add("ROS 2 bag, MCAP, two topics", bag(folder / "bag_mcap", topics, "MCAP"), run, "torque")

    run = axis("rig", "coulomb_friction", 16)
    u, y, v = signals(run)
    topics = {
        "/force_cmd": ("std_msgs/msg/Float64", run.time, scalar(u)),
        "/joint_states": ("sensor_msgs/msg/JointState", run.time, joint(y, v)),
    }
    add("ROS 2 bag, SQLite, two topics", bag(folder / "bag_db3", topics, "SQLITE3"), run)

    run = axis("rig", "actuator_dead_zone", 17)
    u, y, v = signals(run)
    groups = [
        (run.time, {"Kraft_Soll": (u, "N")}),
        (run.time, {"Weg_Ist": (1e3 * y, "mm"), "Geschw_Ist": (v, "m/s")}),
    ]
    add("MDF 4, two groups, German, mm", channels(folder / "log.mf4", groups, "4.10"), run)

    run = axis("rig", "coulomb_friction", 18)
    u, y, v = signals(run)
    rng = np.random.default_rng(18)
    seen = u + 0.01 * rng.standard_normal(len(u))
    one = text(folder / "control.csv", ["time,force_cmd"], (run.time, u))
    two = text(folder / "daq.csv", ["Time (s),Position (mm),Load (N)"], (run.time + 3.2145, 1e3 * y, seen))
    add("two CSV loggers, clocks 3.2145 s apart", f"{one}+{two}", run.only("force", "position"))

    run = axis("pendulum", "actuator_dead_zone", 19)
    u, y, v = signals(run)
    when = [
        s.replace(".", "\0", 2).replace(".", ",").replace("\0", ".")
        for s in stamps(run.time, "%d.%m.%Y %H:%M:%S.%f")
    ]
    path = text(
        folder / "dates.csv",
        ["Zeitstempel;Drehmoment [mNm];Lage [Grad]"],
        (when, 1e3 * u, y / DEG),
        ";",
        comma,
    )
    add("CSV, German dates, mNm, Grad", path, run.only("torque", "angle"))

    run = axis("pendulum", "coulomb_friction", 20)
    u, y, v = signals(run, "velocity")
    sometimes = [f"{c:.5f}" if k % 2 == 0 else "" for k, c in enumerate(v)]
    path = text(folder / "sparse.csv", ["t,torque,angle,velocity"], (run.time, u, y, sometimes))
    add("CSV, every second velocity empty", path, run, "velocity")
    return logs


def report(folder: Path) -> list[Log]:
    """Logs of formats, units and words that nothing was developed on."""
    import pyarrow as pa
    import pyarrow.feather
    import pyarrow.parquet
    from scipy.io import savemat

    logs = []

    def add(about: str, path: Path | str, run: Run, wrong: str = "", **more: Any) -> None:
        logs.append(Log(about, str(path), run, wrong, **more))

    run = axis("pendulum", "coulomb_friction", 101)
    u, y, v = signals(run)
    head = ["Tempo [ms]|Torque [kgf cm]|Ângulo [rad]|Velocidade angular [rad/s]"]
    path = text(folder / "ensaio.csv", head, (1e3 * run.time, u / 0.0980665, y, v), "|")
    add("CSV, Portuguese, `|`, kgf cm", path, run)

    run = axis("rig", "actuator_delay", 102)
    u, y, v = signals(run, "force")
    head = ["Zeit (s)\tStellgröße (N)\tAuslenkung (mm)"]
    path = text(folder / "unicode.txt", head, (run.time, u, 1e3 * y), "\t", comma, "utf-16")
    add("text, German, UTF-16, tabs, decimal comma", path, run.only("force", "position"), "force")

    run = axis("rig", "coulomb_friction", 103)
    u, y, v = signals(run)
    form = lambda value: comma(value, 3, ".")  # noqa: E731
    path = text(
        folder / "tausend.csv",
        ["Zeit in ms;Kraft in mN;Weg in um"],
        (1e3 * run.time, 1e3 * u, 1e6 * y),
        ";",
        form,
    )
    add("CSV, German, thousands points (1.234,567), mN, um", path, run.only("force", "position"))

    run = axis("rig", "actuator_dead_zone", 104)
    u, y, v = signals(run)
    form = lambda value: f'"{value:,.5f}"'  # noqa: E731
    head = ["# Load frame 4", "", '"Elapsed Time","Actuator Force","Displacement"', '"ms","lbf","in"']
    path = text(folder / "frame.csv", head, (1e3 * run.time, u / 4.4482216152605, y / 0.0254), ",", form)
    add("CSV, quoted, thousands commas, row of units (ms, lbf, in)", path, run.only("force", "position"))

    run = axis("pendulum", "actuator_delay", 105)
    u, y, v = signals(run, "angle")
    rows = [f"{t:.4f} {a:.5f} {b:.5f} {c:.5f}" for t, a, b, c in zip(run.time, u, y, v, strict=True)]
    rows.insert(2500, "% operator: all well")
    (folder / "essai.txt.bz2").write_bytes(
        bz2.compress("\n".join(["% temps couple_consigne angle vitesse", *rows, ""]).encode())
    )
    add("text, French, bzip2, blanks, a comment among the rows", folder / "essai.txt.bz2", run, "angle")

    run = axis("pendulum", "coulomb_friction", 106)
    u, y, v = signals(run)
    when = [datetime(2026, 11, 22, 10) + timedelta(seconds=float(t)) for t in run.time]
    head = [["Ora", "Coppia", "Angolo", "Velocità"], ["", "N mm", "deg", "giri/min"]]
    add(
        "Excel, Italian, dates, row of units (N mm, giri/min)",
        workbook(folder / "prova.xlsx", head, (when, 1e3 * u, y / DEG, v / RPM)),
        run,
    )

    run = axis("rig", "actuator_lag", 107)
    u, y, v = signals(run)
    when = [str(round((EPOCH + t) * 1e6)) for t in run.time]
    path = text(folder / "epoch.csv", ["stamp,fx_ref,s_meas,v_meas"], (when, u, y, v))
    add("CSV, microseconds since 1970, `fx_ref`, `s_meas`", path, run)

    run = axis("pendulum", "actuator_dead_zone", 108)
    u, y, v = signals(run)
    rows = [
        json.dumps({"ts": t, "tau_cmd": a, "theta_deg": b})
        for t, a, b in zip(run.time.tolist(), u.tolist(), (y / DEG).tolist(), strict=True)
    ]
    (folder / "stream.jsonl").write_text("\n".join(rows))
    add("JSON lines, `theta_deg`", folder / "stream.jsonl", run.only("torque", "angle"))

    run = axis("rig", "coulomb_friction", 109)
    u, y, v = signals(run, "velocity")
    whole = {
        "meta": {"bench": 3},
        "columns": ["t", "sollkraft", "position", "geschwindigkeit"],
        "data": np.stack([run.time, u, y, v], 1).tolist(),
    }
    (folder / "split.json").write_text(json.dumps(whole))
    add("JSON, names beside rows, German", folder / "split.json", run, "velocity")

    run = axis("pendulum", "coulomb_friction", 110)
    u, y, v = signals(run)
    np.save(folder / "plain.npy", np.stack([run.time, y, v, u], 1))
    add("NumPy array without names, command last", folder / "plain.npy", run)

    run = axis("rig", "actuator_saturation", 111)
    u, y, v = signals(run)
    savemat(
        folder / "vars.mat",
        {"t": run.time[:, None], "u": u[:, None], "x": y[:, None], "v": v[:, None], "note": "bench 3"},
    )
    add("MATLAB 5, plain variables `t`, `u`, `x`, `v`", folder / "vars.mat", run)

    run = axis("pendulum", "coulomb_friction", 112)
    u, y, v = signals(run)
    table = np.rec.fromarrays([run.time, u, y / DEG, v / DEG], names="time_s,torque_nm,angle_deg,rate_dps")
    add("HDF5, one table of named fields, deg, dps", hdf5(folder / "table.hdf5", {"log": (table, "")}), run)

    run = axis("rig", "actuator_delay", 113)
    u, y, v = signals(run, "force")
    since = pa.array((run.time * 1e9).round().astype(np.int64), pa.duration("ns"))
    pa.feather.write_feather(
        pa.table([since, u, 1e3 * y], names=["elapsed", "force_setpoint", "pos_mm"]),
        folder / "log.arrow",
        compression="zstd",
    )
    add("Arrow, durations, `pos_mm`", folder / "log.arrow", run.only("force", "position"), "force")

    run = axis("pendulum", "actuator_delay", 114)
    u, y, v = signals(run)
    topics = {
        "/effort_cmd": ("std_msgs/msg/Float64", run.time, scalar(u)),
        "/joint_states": ("sensor_msgs/msg/JointState", run.time, joint(y, v)),
    }
    add("ROS 1 bag, `/effort_cmd`, `/joint_states`", bag(folder / "log.bag", topics, "ROS1"), run)

    run = axis("rig", "coulomb_friction", 115, hold=5)
    u, y, v = signals(run)
    topics = {
        "/cmd/force": ("std_msgs/msg/Float64", run.time[::5], scalar(u[::5])),
        "/carriage": ("sensor_msgs/msg/JointState", run.time, joint(y, v)),
    }
    add("ROS 2 bag, MCAP, 20 and 100 Hz", bag(folder / "bag", topics, "MCAP"), run)

    run = axis("pendulum", "coulomb_friction", 116)
    u, y, v = signals(run)
    groups = [
        (
            run.time,
            {
                "MotTrq_Soll": (100 * u, "Ncm"),
                "Winkel_Ist": (y / (2 * np.pi), "U"),
                "Drehzahl_Ist": (v / RPM, "1/min"),
            },
        )
    ]
    add("MDF 3, Ncm, revolutions, 1/min", channels(folder / "log.mdf", groups, "3.30"), run)

    run = axis("rig", "actuator_dead_zone", 117)
    u, y, v = signals(run, "position")
    rng = np.random.default_rng(117)
    one = text(folder / "plc.csv", ["Time;Force_Set"], (run.time[300:], u[300:]), ";", comma)
    table = pa.table(
        [run.time + 100.0, y, v, u + 0.02 * rng.standard_normal(len(u))],
        names=["time", "position", "velocity", "load_cell"],
    )
    pa.parquet.write_table(table, folder / "daq.parquet")
    add(
        "CSV and Parquet of two loggers, 100 s apart, one started late",
        f"{one}+{folder / 'daq.parquet'}",
        run,
        "position",
        late=3.0,
    )

    run = axis("pendulum", "coulomb_friction", 118)
    u, y, v = signals(run)
    path = text(
        folder / "clock.csv",
        ["Uhrzeit,Moment (Nm),Drehwinkel (mrad)"],
        (stamps(run.time, "%H:%M:%S.%f"), u, 1e3 * y),
    )
    add("CSV, times of day, mrad", path, run.only("torque", "angle"))

    run = axis("pendulum", "coulomb_friction", 119)
    u, y, v = signals(run)
    path = text(folder / "strom.csv", ["Strom [A];Winkel [°]"], (u / 0.05, y / DEG), ";", comma)
    add(
        "CSV, German, a current, no clock",
        path,
        run.only("torque", "angle"),
        options={"rate": 100.0},
        scaled=("torque",),
    )

    run = drive("actuator_lag", 120)
    left, right, x, y, heading = signals(run)
    head = ["time [s],cmd_left [rpm],cmd_right [rpm],pose_x [cm],pose_y [cm],yaw [deg]"]
    path = text(
        folder / "robot.csv", head, (run.time, left / RPM, right / RPM, 100 * x, 100 * y, heading / DEG)
    )
    add("CSV, a robot, rpm, cm, deg", path, run)
    return logs


SETS = {"develop": develop, "report": report}
