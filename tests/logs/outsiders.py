"""Logs of tools that no other log here is from; all but the last ten written down before any was read.

Each is written by its tool's own writer where one installs, else as its documents show it.
"""

from __future__ import annotations

import json
import re
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from bench import Run, axis, commands, drive, follower, joint, swing
from expected import Expected, entry, machine
from exporters import log, pendulum
from foreign import DEG, EPOCH, RPM, comma, signals, stamps, text


def motor(folder: Path, seed: int, command: str = "V", response: str = "rpm", gain: float = 100.0) -> Run:
    """A motor that follows its command with a lag, and the machine that its owner has for it."""
    told = commands(np.random.default_rng(seed), 4000, 0.01, 5.0)
    source = machine(folder, command, response, f"{response}/{command}", 0.02 * gain)
    run = follower(source, "actuator_lag", told, 0.01, 0.15)
    return Run(run.model, run.cause, run.time, {"command": told, "response": gain * run.signals["response"]})


# --- oscilloscopes, cameras, phones -------------------------------------------------------------------


@log
def rigol(folder: Path) -> Expected:
    """Oscilloscope (Rigol DS1000Z): a number a row, the start and the step beside the header's units."""
    run = pendulum("coulomb_friction", 501)
    u, y = signals(run)
    head = ["X,CH1,CH2,Start,Increment,", "Sequence,Volt,Volt,-2.000000e+01,1.000000e-02"]
    columns = ([str(k) for k in range(len(u))], u, y, [""] * len(u))
    text(folder / "NewFile1.csv", head, columns, form="{:.2e}".format)
    return entry(
        folder / "NewFile1.csv", run, "torque=CH1:V; angle=CH2:V",
        options={"columns": {"torque": "CH1:N m", "angle": "CH2:rad"}, "rate": 100.0},
    )  # fmt: skip


@log
def siglent(folder: Path) -> Expected:
    """Oscilloscope (Siglent SDS): settings of each channel, units as words above the names."""
    run = pendulum("actuator_lag", 502)
    u, y = signals(run)
    head = ["Record Length,Analog:4000", "Sample Interval,Analog:1.00E-02", "Vertical Units,C1:V C2:V",
            "Vertical Scale,C1:1.00E+00 C2:1.00E+00", "Horizontal Units,s", "Horizontal Scale,2.00E+00",
            "Model Number,SDS2354X Plus", "Serial Number,SDS2PFFD7R0000", "Software Version,1.6.2.0.19",
            "Source,CH1,CH2", "Second,Volt,Volt"]  # fmt: skip
    text(folder / "SDS00001.csv", head, (run.time - 20.0, u, y), form="{:.8E}".format)
    return entry(
        folder / "SDS00001.csv", run, "t=Source:s; torque=CH1:V; angle=CH2:V",
        options={"columns": {"torque": "CH1:N m", "angle": "CH2:rad"}},
    )  # fmt: skip


@log
def keysight(folder: Path) -> Expected:
    """Oscilloscope (Keysight InfiniiVision): the channels are numbers, `x-axis,1,2`, units as words below."""
    run = pendulum("actuator_delay", 503)
    u, y = signals(run)
    head = ["x-axis,1,2", "second,Volt,Volt"]
    text(folder / "scope_1.csv", head, (run.time - 20.0, u, y), form="{:+.8E}".format, end="\r\n")
    return entry(
        folder / "scope_1.csv", run, "t=x-axis:s; torque=1:V; angle=2:V",
        options={"columns": {"torque": "1:N m", "angle": "2:rad"}},
    )  # fmt: skip


@log
def motive(folder: Path) -> Expected:
    """Cameras (OptiTrack Motive): five rows of groups, Rotation and Position with the same X, Y, Z below."""
    run = axis("rig", "coulomb_friction", 504).only("force", "position")
    u, y = signals(run)
    rng = np.random.default_rng(504)
    still = [0.5 + 1e-4 * rng.standard_normal(len(u)) for _ in range(2)]
    head = ["Format Version,1.23,Take Name,Take 3,Capture Frame Rate,100.000000,Length Units,Meters,"
            "Coordinate Space,Global", "",
            ",Type,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body",
            ",Name,cart,cart,cart,cart,cart,cart,cart", ",ID,7,7,7,7,7,7,7",
            ",,Rotation,Rotation,Rotation,Rotation,Position,Position,Position",
            "Frame,Time (Seconds),X,Y,Z,W,X,Y,Z"]  # fmt: skip
    turned = [1e-4 * rng.standard_normal(len(u)) for _ in range(3)]
    count = [str(k) for k in range(len(u))]
    columns = (count, run.time, *turned, [f"{1:.6f}"] * len(u), y, *still)
    text(folder / "Take3.csv", head, columns, end="\r\n")
    text(folder / "control.csv", ["t,force"], (run.time, u))
    return entry(
        f"{folder / 'Take3.csv'}+{folder / 'control.csv'}", run,
        "t=Time (Seconds):s; force=force:; position=Position X:",
        options={"columns": {"position": "Position X:m"}},
    )  # fmt: skip


@log
def xsens(folder: Path) -> Expected:
    """Inertial sensor (Xsens MT Manager): `//` above, tabs, a counter of samples, degrees without a unit."""
    run = swing(505)
    (y,) = signals(run)
    rng = np.random.default_rng(505)
    head = ["// Start Time: Unknown", "// Update Rate: 100.0Hz", "// Filter Profile: human (46.1)",
            "// Option Flags: AHS Disabled ICC Disabled ", "// Firmware Version: 4.6.0",
            "PacketCounter\tSampleTimeFine\tYear\tMonth\tDay\tSecond\tRoll\tPitch\tYaw"]  # fmt: skip
    n = len(y)
    fine = [str(73_412 + 100 * k) for k in range(n)]
    others = [0.3 * rng.standard_normal(n) for _ in range(2)]
    columns = ([f"{4301 + k:05d}" for k in range(n)], fine, [""] * n, [""] * n, [""] * n, [""] * n,
               others[0], y / DEG, others[1])  # fmt: skip
    text(folder / "MT_0120.txt", head, columns, "\t")
    return entry(
        folder / "MT_0120.txt", run, "angle=Pitch:",
        options={"columns": {"torque": "none", "t": "1e-4*SampleTimeFine:s", "angle": "Pitch:deg"}},
    )  # fmt: skip


@log
def phyphox(folder: Path) -> Expected:
    """A phone (phyphox, French): `;`, decimal commas in numbers with exponents, units in brackets."""
    run = swing(506)
    (y,) = signals(run)
    flat = 0.01 * np.random.default_rng(506).standard_normal(len(y))
    head = ['"t (s)";"Tilt up/down (deg)";"Tilt left/right (deg)"']

    def form(value: float) -> str:
        return f"{value:.9E}".replace(".", ",").replace("E+0", "E").replace("E-0", "E-")

    text(folder / "Inclination.csv", head, (run.time, y / DEG, flat), ";", form)
    return entry(
        folder / "Inclination.csv", run, "t=t (s):s; angle=Tilt up/down (deg):deg",
        options={"columns": {"torque": "none", "angle": "Tilt up/down (deg)"}},
    )  # fmt: skip


@log
def sensor_logger(folder: Path) -> Expected:
    """A phone (Sensor Logger): JSON of one value a record, all of them texts, three sensors in turn."""
    run = swing(507)
    (y,) = signals(run)
    rng = np.random.default_rng(507)
    records: list[dict[str, str]] = [{"sensor": "Metadata", "version": "3", "device name": "phone"}]
    for t, angle in zip(run.time, y, strict=True):
        stamp = {"time": str(round((EPOCH + t) * 1e9)), "seconds_elapsed": f"{t + 0.0312:.6f}"}
        roll, yaw, x = (f"{1e-3 * v:.7f}" for v in rng.standard_normal(3))
        records.append({"sensor": "Orientation", **stamp, "pitch": f"{angle:.7f}", "roll": roll, "yaw": yaw})
        records.append({"sensor": "Gravity", **stamp, "x": x, "y": f"{9.81 * np.sin(angle):.6f}"})
    (folder / "2026-11-22.json").write_text(json.dumps(records))
    return entry(
        folder / "2026-11-22.json", run, "angle=Orientation.pitch:",
        options={"columns": {"torque": "none", "t": "Orientation.seconds_elapsed:s",
                             "angle": "Orientation.pitch:rad"}},
    )  # fmt: skip


# --- drives, controllers, drones ----------------------------------------------------------------------


@log
def vesc(folder: Path) -> Expected:
    """VESC Tool: `;`, milliseconds of the day, a duty cycle as the command, turns a minute of the field."""
    run = motor(folder, 508, "1", "rpm", 3000.0)
    told, seen = signals(run)
    run.signals["command"][:] = told = 0.15 * told
    run.signals["response"][:] = seen = 0.15 * seen
    n = len(told)
    head = ["ms_today;input_voltage;temp_mos_max;current_motor;current_in;erpm;duty_cycle;tacho;fault_code"]
    columns = (1e3 * run.time + 36_000_000, np.full(n, 36.4), np.full(n, 31.2), 2 * told, told**2,
               seen, told, np.cumsum(seen) / 600.0, ["0"] * n)  # fmt: skip
    text(folder / "vesc.csv", head, columns, ";", "{:.4f}".format)
    return entry(
        folder / "vesc.csv", run, "t=ms_today:; command=duty_cycle:; response=erpm:",
        options={"columns": {"t": "ms_today:ms", "command": "duty_cycle", "response": "erpm:rpm"}},
    )  # fmt: skip


@log
def elmo(folder: Path) -> Expected:
    """A drive's recorder (Elmo): positions in counts (`cnt`), speeds in counts a second, amperes."""
    run = axis("pendulum", "coulomb_friction", 509)
    u, y, v = signals(run)
    counts = 4096 / (2 * np.pi)
    head = ["Time [sec],Torque Command [Nm],Position Feedback [cnt],Velocity Feedback [cnt/sec]"]
    text(folder / "recorder.csv", head, (run.time, u, np.round(counts * y), counts * v))
    return entry(
        folder / "recorder.csv", run,
        "t=Time [sec]:s; torque=Torque Command [Nm]:N m; angle=Position Feedback [cnt]:cnt; "
        "velocity=Velocity Feedback [cnt/sec]:cnt/sec",
        options={"columns": {
            "angle": f"{1 / counts:.12g}*Position Feedback [cnt]:rad",
            "velocity": f"{1 / counts:.12g}*Velocity Feedback [cnt/sec]:rad/s",
        }},
    )  # fmt: skip


@log
def scaled_units(folder: Path) -> Expected:
    """A PLC's trend: integers whose units say what one is worth, as `[0.1 Nm]`, `[0.01 deg]`, `[10 ms]`."""
    run = axis("pendulum", "actuator_delay", 510)
    u, y, v = signals(run)
    head = ["Time [10 ms],Torque [0.001 Nm],Angle [0.01 °],Speed [0.1 rpm]"]
    columns = (100 * run.time, 1e3 * u, 100 * y / DEG, 10 * v / RPM)
    text(folder / "trend.csv", head, columns, form="{:.0f}".format)
    return entry(
        folder / "trend.csv", run,
        "t=Time [10 ms]:10 ms; torque=Torque [0.001 Nm]:0.001 Nm; angle=Angle [0.01 °]:0.01 °; "
        "velocity=Speed [0.1 rpm]:0.1 rpm",
    )  # fmt: skip


@log
def weintek(folder: Path) -> Expected:
    """A panel (Weintek): the date, the time to the second and its milliseconds in three columns."""
    run = axis("rig", "coulomb_friction", 511)
    u, y, v = signals(run)
    head = ["Date,Time,Millisecond,Force [N],Position [mm],Velocity [mm/s]"]
    thousandths = [str(round(1e3 * t) % 1000) for t in run.time]
    columns = (stamps(run.time, "%Y/%m/%d", 6), stamps(run.time, "%H:%M:%S", 6), thousandths,
               u, 1e3 * y, 1e3 * v)  # fmt: skip
    text(folder / "20261122.csv", head, columns)
    return entry(
        folder / "20261122.csv", run,
        "t=Time:s; force=Force [N]:N; position=Position [mm]:mm; velocity=Velocity [mm/s]:mm/s",
    )  # fmt: skip


@log
def crazyflie(folder: Path) -> Expected:
    """Crazyflie's client: milliseconds since its start, variables by group, degrees without a unit."""
    run = joint("actuator_delay", 512, rate=100.0)
    told, seen = signals(run)
    head = ["Timestamp,ctrltarget.roll,stateEstimate.roll,stateEstimate.pitch,pm.vbat"]
    pitch = 0.2 * np.random.default_rng(512).standard_normal(len(told))
    columns = (1e3 * run.time + 48_211, told / DEG, seen / DEG, pitch, np.full(len(told), 3.91))
    text(folder / "attitude-20261122T10-00-00.csv", head, columns, form="{:.4f}".format)
    return entry(
        folder / "attitude-20261122T10-00-00.csv", run,
        "t=Timestamp:; set_point=ctrltarget.roll:; position=stateEstimate.roll:",
        options={"columns": {"set_point": "ctrltarget.roll:deg", "position": "stateEstimate.roll:deg"}},
    )  # fmt: skip


@log
def dataflash_text(folder: Path) -> Expected:
    """ArduPilot's log as text (Mission Planner): rows of several messages, named by rows of FMT."""
    run = joint("actuator_lag", 513, rate=50.0)
    told, seen = signals(run)
    lines = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns",
             "FMT, 129, 31, PARM, QNff, TimeUS,Name,Value,Default",
             "FMT, 130, 45, ATT, QccccCCCCB, TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw,AE",
             "FMT, 131, 75, MSG, QZ, TimeUS,Message",
             "PARM, 112574000, SYSID_THISMAV, 1, 1",
             "MSG, 112574000, ArduCopter V4.5.7 (2a3dc4b7)"]  # fmt: skip
    for t, a, b in zip(run.time, told / DEG, seen / DEG, strict=True):
        lines.append(
            f"ATT, {112_574_000 + round(1e6 * t)}, {a:.3f}, {b:.3f}, 0, 0.02, 351.2, 351.3, 0.01, 0.02, 3"
        )
    (folder / "00000012.log").write_text("\n".join(lines) + "\n")
    return entry(
        folder / "00000012.log", run, "t=ATT.TimeUS:us; set_point=ATT.DesRoll:; position=ATT.Roll:",
        options={"columns": {"set_point": "ATT.DesRoll:deg", "position": "ATT.Roll:deg"}},
    )  # fmt: skip


@log
def teleplot(folder: Path) -> Expected:
    """Teleplot's lines on a serial port: `>name:milliseconds:value§unit`, one value a line."""
    run = axis("pendulum", "actuator_saturation", 514)
    lines = []
    for k, t in enumerate(run.time):
        u, y, v = (s[k] for s in run.signals.values())
        stamp = round(1e3 * (EPOCH + t))
        lines += [f">torque:{stamp}:{u:.4f}§Nm", f">angle:{stamp}:{y / DEG:.4f}§deg",
                  f">speed:{stamp}:{v / RPM:.4f}§rpm"]  # fmt: skip
    (folder / "teleplot.log").write_text("\n".join(lines) + "\n")
    cells = [re.split("[>:§]", line)[1:] for line in lines]
    table = ["time,name,value,unit", *(f"{t},{name},{value},{unit}" for name, t, value, unit in cells)]
    (folder / "table.csv").write_text("\n".join(table) + "\n")
    return entry(
        folder / "teleplot.log", run, "torque=torque:N m; angle=angle:deg; velocity=speed:rpm",
        refused=("row 1, '>torque", "time, name, value"), remedy=str(folder / "table.csv"),
    )  # fmt: skip


@log
def greek(folder: Path) -> Expected:
    """A script of a laboratory: Greek letters as names, `τ [N·m]`, `θ [°]`, `ω [rad·s⁻¹]`."""
    run = axis("pendulum", "hysteresis", 515)
    u, y, v = signals(run)
    text(folder / "run15.csv", ["t [s],τ [N·m],θ [°],ω [rad·s⁻¹]"], (run.time, u, y / DEG, v))
    return entry(
        folder / "run15.csv", run,
        "t=t [s]:s; torque=τ [N·m]:N m; angle=θ [°]:deg; velocity=ω [rad·s⁻¹]:rad·s⁻¹",
    )  # fmt: skip


@log
def labview_waveforms(folder: Path) -> Expected:
    """LabVIEW's Export Waveforms to Spreadsheet: `t0`, `delta t`, each channel with dates at its left."""
    run = axis("rig", "actuator_lag", 516)
    u, y, v = signals(run)
    names = ["Force_N", "Position_mm", "Velocity_mm_s"]
    when = [s.replace(".", ",", 2)[::1] for s in stamps(run.time, "%d.%m.%Y %H:%M:%S.%f", 6)]
    when = [f"{s[:10].replace(',', '.')}{s[10:]}" for s in when]
    head = ["\t".join(["waveform", *(c for name in names for c in (f"[{name}]", ""))]),
            "\t".join(["t0", *(c for _ in names for c in (when[0], ""))]),
            "\t".join(["delta t", *(c for _ in names for c in ("0,010000", ""))]), "",
            "\t".join(f"time[{k}]\tY[{k}]" for k in range(3))]  # fmt: skip
    cells = [c for s in (u, 1e3 * y, 1e3 * v) for c in (when, [comma(x) for x in s])]
    text(folder / "waveforms.txt", head, cells, "\t", end="\r\n")
    return entry(
        folder / "waveforms.txt", run, "t=time[0]:s; force=Y[0]:; position=Y[1]:; velocity=Y[2]:",
        options={"columns": {"force": "Y[0]:N", "position": "Y[1]:mm", "velocity": "Y[2]:mm/s"}},
    )  # fmt: skip


@log
def dewesoft(folder: Path) -> Expected:
    """Dewesoft's text: `Key: value` and blank lines above, names with `/ave`, units in brackets, tabs."""
    run = axis("rig", "actuator_saturation", 517)
    u, y, v = signals(run)
    head = ["Data file info", "File name: C:\\data\\rig_0003.dxd", "Start time: 11/22/2026 10:00:00.000",
            "Number of channels: 3", "Sample rate: 100 Hz", "Store type: always fast", "", "Events",
            "Event Type\tEvent Time\tComment", "1\t0\tStoring started at 10:00:00.000", "", "Data1",
            "Time (s)\tForce/ave (N)\tPosition/ave (mm)\tVelocity/ave (mm/s)"]  # fmt: skip
    text(folder / "rig_0003.txt", head, (run.time, u, 1e3 * y, 1e3 * v), "\t", end="\r\n")
    return entry(
        folder / "rig_0003.txt", run,
        "t=Time (s):s; force=Force/ave (N):N; position=Position/ave (mm):mm; "
        "velocity=Velocity/ave (mm/s):mm/s",
    )  # fmt: skip


@log
def advantagescope(folder: Path) -> Expected:
    """AdvantageScope's list of an FRC robot: `Timestamp,Key,Value`, texts and flags among the numbers."""
    run = joint("coulomb_friction", 518, rate=50.0)
    told, seen = signals(run)
    lines = ["Timestamp,Key,Value", "0.0,/DriverStation/Enabled,false", '0.0,/Arm/State,"Idle"']
    for t, a, b in zip(run.time, told, seen, strict=True):
        lines += [f"{t + 4.2:.6f},/Arm/GoalRad,{a:.6f}", f"{t + 4.2:.6f},/Arm/PositionRad,{b:.6f}"]
        if abs(t - 10.0) < 0.001:
            lines += [f"{t + 4.2:.6f},/DriverStation/Enabled,true", f'{t + 4.2:.6f},/Arm/State,"Moving"']
    (folder / "log.csv").write_text("\n".join(lines) + "\n")
    return entry(
        folder / "log.csv", run, "set_point=/Arm/GoalRad:; position=/Arm/PositionRad:",
        options={"columns": {"set_point": "/Arm/GoalRad:rad", "position": "/Arm/PositionRad:rad"}},
    )  # fmt: skip


@log
def bagpy(folder: Path) -> Expected:
    """bagpy's CSV of a joint's states and of its command: one file a topic, stamps in two columns."""
    run = axis("pendulum", "actuator_dead_zone", 519)
    u, y, v = signals(run)
    n = len(u)
    when = [f"{EPOCH + t:.6f}" for t in run.time]
    secs, nsecs = [str(int(EPOCH + t)) for t in run.time], [str(round(t % 1 * 1e9)) for t in run.time]
    head = ["Time,header.seq,header.stamp.secs,header.stamp.nsecs,header.frame_id,name_0,position_0,"
            "velocity_0"]  # fmt: skip
    count = [str(k) for k in range(n)]
    text(folder / "joint_states.csv", head, (when, count, secs, nsecs, [""] * n, ["hip"] * n, y, v))
    text(folder / "torque_cmd.csv", ["Time,data"], (when, u))
    return entry(
        f"{folder / 'joint_states.csv'}+{folder / 'torque_cmd.csv'}", run,
        "t=Time (joint_states):s; torque=data:; angle=position_0:; velocity=velocity_0:",
        options={"columns": {"torque": "data", "angle": "position_0:rad", "velocity": "velocity_0:rad/s"}},
    )  # fmt: skip


# --- MATLAB, Octave, Simulink -------------------------------------------------------------------------


@log
def data_inspector(folder: Path) -> Expected:
    """Simulink's Data Inspector, CSV: rows `Type: double`, `Unit: mm`, `Interp: zoh` below the names."""
    run = axis("rig", "actuator_dead_zone", 520)
    u, y, v = signals(run)
    head = ["time,force,position,velocity", ",Type: double,Type: double,Type: double",
            ",Unit: N,Unit: mm,Unit: mm/s", ",Interp: zoh,Interp: linear,Interp: linear",
            ",BlockPath: rig/Command,BlockPath: rig/Plant,BlockPath: rig/Plant",
            ",PortIndex: 1,PortIndex: 1,PortIndex: 2"]  # fmt: skip
    text(folder / "run1.csv", head, (run.time, u, 1e3 * y, 1e3 * v), form="{:.9g}".format)
    return entry(
        folder / "run1.csv", run, "t=time:; force=force:N; position=position:mm; velocity=velocity:mm/s"
    )


@log
def valid_names(folder: Path) -> Expected:
    """MATLAB's writetable after readtable: brackets in names have become `_`, as in `Torque_Nm_`."""
    run = axis("pendulum", "coulomb_friction", 521)
    u, y, v = signals(run)
    head = ["Time_ms_,Torque_Nm_,Angle_deg_,Speed_rpm_"]
    text(folder / "table.csv", head, (1e3 * run.time, u, y / DEG, v / RPM), form="{:.10g}".format)
    return entry(
        folder / "table.csv", run,
        "t=Time_ms_:ms; torque=Torque_Nm_:N m; angle=Angle_deg_:deg; velocity=Speed_rpm_:rpm",
    )  # fmt: skip


@log
def structure_with_time(folder: Path) -> Expected:
    """Simulink's Structure With Time (To Workspace, Scope): `signals` is an array of `values`, `label`."""
    from scipy.io import savemat

    run = axis("pendulum", "actuator_saturation", 522)
    parts = np.empty((1, 3), dtype=[(f, object) for f in ("values", "dimensions", "label", "title")])
    for k, (name, values) in enumerate(zip(("torque", "angle", "velocity"), signals(run), strict=True)):
        parts[0, k] = values[:, None], 1.0, name, ""
    scope = {"time": run.time[:, None], "signals": parts, "blockName": "pendulum/Scope"}
    savemat(folder / "scope.mat", {"ScopeData": scope})
    return entry(
        folder / "scope.mat", run,
        "t=ScopeData.time:; torque=ScopeData.signals.torque:; angle=ScopeData.signals.angle:; "
        "velocity=ScopeData.signals.velocity:",
    )  # fmt: skip


@log
def controldesk_mat(folder: Path) -> Expected:
    """dSPACE ControlDesk, MATLAB: `X` with the times, `Y` an array of `Name`, `Unit`, `Data`."""
    from scipy.io import savemat

    run = axis("rig", "coulomb_friction", 523)
    u, y, v = signals(run)
    fields = [(f, object) for f in ("Name", "Type", "Data", "Unit", "Path", "XIndex")]
    told = [("force", u, "N"), ("position", 1e3 * y, "mm"), ("velocity", 1e3 * v, "mm/s")]
    parts, clock = np.empty((1, 3), dtype=fields), np.empty((1, 1), dtype=fields[:3])
    for k, (name, values, unit) in enumerate(told):
        parts[0, k] = name, 4, values[None, :], unit, "Model Root/Plant", 1
    clock[0, 0] = "HostService", 4, run.time[None, :]
    savemat(folder / "rec004.mat", {"rec004": {"X": clock, "Y": parts, "Description": {"General": "rig"}}})
    return entry(
        folder / "rec004.mat", run,
        "t=rec004.X.HostService:; force=rec004.Y.force [N]:N; position=rec004.Y.position [mm]:mm; "
        "velocity=rec004.Y.velocity [mm/s]:mm/s",
    )  # fmt: skip


@log
def octave_text(folder: Path) -> Expected:
    """Octave's `save log.mat`, which is text: `# name`, `# type`, `# rows`, then numbers, by variable."""
    from scipy.io import savemat

    run = axis("rig", "actuator_delay", 524)
    names = dict(zip(("t", "force", "position", "velocity"), (run.time, *signals(run)), strict=True))
    lines = ["# Created by Octave 8.4.0, Sun Nov 22 10:00:00 2026 GMT <user@bench>"]
    for name, values in names.items():
        lines += [f"# name: {name}", "# type: matrix", f"# rows: {len(values)}", "# columns: 1"]
        lines += [*(f" {x:.16g}" for x in values), "", ""]
    (folder / "log.mat").write_text("\n".join(lines) + "\n")
    savemat(folder / "log7.mat", names)
    return entry(
        folder / "log.mat", run, "t=t:; force=force:; position=position:; velocity=velocity:",
        refused=("Octave", "save -v7"), remedy=str(folder / "log7.mat"),
    )  # fmt: skip


# --- Python and robot learning ------------------------------------------------------------------------


def frame(run: Run, **units: tuple[str, float]) -> pd.DataFrame:
    """A run as pandas has it: names by signal, and what a unit is worth."""
    columns = {name: run.signals[signal] / worth for signal, (name, worth) in units.items()}
    return pd.DataFrame({"time_s": run.time, **columns})


@log
def pandas_json(folder: Path) -> Expected:
    """pandas' to_json as it is by default: of each column a mapping from the row's number, as text."""
    run = axis("pendulum", "actuator_dead_zone", 525)
    table = frame(run, torque=("torque_Nm", 1.0), angle=("angle_deg", DEG), velocity=("speed_rpm", RPM))
    table.to_json(folder / "frame.json", double_precision=9)
    return entry(
        folder / "frame.json", run,
        "t=time_s:s; torque=torque_Nm:N m; angle=angle_deg:deg; velocity=speed_rpm:rpm",
    )  # fmt: skip


@log
def pandas_json_table(folder: Path) -> Expected:
    """pandas' to_json(orient="table"): a schema beside the records, the index a time difference."""
    run = axis("rig", "actuator_lag", 526)
    table = frame(
        run, force=("force_N", 1.0), position=("position_mm", 1e-3), velocity=("velocity_mm_s", 1e-3)
    )
    table.to_json(folder / "frame.json", orient="table", double_precision=9)
    return entry(
        folder / "frame.json", run,
        "t=time_s:s; force=force_N:N; position=position_mm:mm; velocity=velocity_mm_s:mm/s",
    )  # fmt: skip


@log
def pandas_excel(folder: Path) -> Expected:
    """pandas' to_excel of two header rows: merged cells, an empty row below them, a column of the index."""
    import openpyxl  # noqa: F401  # what pandas writes with

    run = axis("rig", "coulomb_friction", 527)
    u, y, v = signals(run)
    columns = {("clock", "time [s]"): run.time, ("command", "force [N]"): u,
               ("encoder", "position [mm]"): 1e3 * y, ("encoder", "velocity [mm/s]"): 1e3 * v}  # fmt: skip
    pd.DataFrame(columns).to_excel(folder / "frame.xlsx", sheet_name="log")
    return entry(
        folder / "frame.xlsx", run,
        "t=time [s]:s; force=force [N]:N; position=position [mm]:mm; velocity=velocity [mm/s]:mm/s",
    )  # fmt: skip


@log
def excel_dates(folder: Path) -> Expected:
    """A workbook with real dates, a row of units below the names, a remark in the last column of one row."""
    import openpyxl  # noqa: F401

    run = pendulum("actuator_lag", 528)
    u, y = signals(run)
    when = pd.Timestamp("2026-11-22 10:00:00") + pd.to_timedelta(run.time, unit="s")
    rows = pd.DataFrame({"Zeitpunkt": when, "Moment": u, "Winkel": y / DEG, "Bemerkung": ""}).astype(object)
    units = pd.DataFrame([["", "Nm", "°", ""]], columns=rows.columns)
    rows.loc[20, "Bemerkung"] = "Tür offen"
    pd.concat([units, rows]).to_excel(folder / "frame.xlsx", index=False)
    return entry(folder / "frame.xlsx", run, "t=Zeitpunkt:s; torque=Moment:N m; angle=Winkel:deg")


@log
def polars_parquet(folder: Path) -> Expected:
    """Parquet as polars writes it: Datetime in ns, Decimal, Float32, Categorical, zstd."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    run = axis("pendulum", "actuator_delay", 529)
    u, y, v = signals(run)
    stamp = pa.array(
        ((EPOCH + run.time) * 1e9).round(-3).astype("int64"), pa.timestamp("ns", "Europe/Berlin")
    )
    numbers = pa.array([f"{x:.4f}" for x in u]).cast(pa.decimal128(38, 4))
    state = pa.array(["run"] * len(u)).dictionary_encode()
    columns = {"ts": stamp, "torque_nm": numbers, "angle_rad": pa.array(y, pa.float32()),
               "velocity_rad_s": pa.array(v, pa.float32()), "state": state}  # fmt: skip
    pq.write_table(pa.table(columns), folder / "log.parquet", compression="zstd")
    return entry(
        folder / "log.parquet", run,
        "t=ts:s; torque=torque_nm:N m; angle=angle_rad:rad; velocity=velocity_rad_s:rad/s",
    )  # fmt: skip


@log
def robomimic(folder: Path) -> Expected:
    """HDF5 of demonstrations (robomimic): `data/demo_0/actions`, `obs/...`, each a run; no clock."""
    import h5py

    runs = [joint("coulomb_friction", seed, rate=20.0, seconds=30.0 + k) for k, seed in enumerate((530, 531))]
    rng = np.random.default_rng(530)
    with h5py.File(folder / "demo.hdf5", "w") as file:
        data = file.create_group("data")
        data.attrs["env_args"] = json.dumps({"env_name": "arm", "control_freq": 20})
        for k, run in enumerate(runs):
            told, seen = signals(run)
            demo = data.create_group(f"demo_{k}")
            demo.attrs["num_samples"] = len(told)
            other = 0.01 * rng.standard_normal((2, len(told)))
            demo["actions"] = np.stack([other[0], told], axis=1)
            demo["dones"] = np.zeros(len(told), dtype=np.int64)
            demo["obs/joint_pos"] = np.stack([other[1], seen], axis=1)
    own = {"set_point": "actions[2]:rad", "position": "obs.joint_pos[2]:rad"}
    return entry(
        folder / "demo.hdf5", runs[0], "set_point=actions[2]:; position=obs.joint_pos[2]:",
        parts=tuple(runs), options={"columns": own, "rate": 20.0},
    )  # fmt: skip


@log
def aloha(folder: Path) -> Expected:
    """HDF5 of one episode (ACT, ALOHA): `action`, `observations/qpos`, pictures beside them; no clock."""
    import h5py

    run = joint("actuator_delay", 532, rate=50.0)
    told, seen = signals(run)
    other = 0.01 * np.random.default_rng(532).standard_normal((2, len(told)))
    with h5py.File(folder / "episode_0.hdf5", "w", rdcc_nbytes=2 * 1024**2) as file:
        file.attrs["sim"] = False
        file.create_dataset("observations/images/cam_high", data=np.zeros((len(told), 4, 6, 3), np.uint8))
        file["observations/qpos"] = np.stack([seen, other[0]], axis=1)
        file["action"] = np.stack([told, other[1]], axis=1)
    return entry(
        folder / "episode_0.hdf5", run, "set_point=action[1]:; position=observations.qpos[1]:",
        options={"columns": {"set_point": "action[1]:rad", "position": "observations.qpos[1]:rad"},
                 "rate": 50.0},
    )  # fmt: skip


# --- buses, robots' middleware, test stands -----------------------------------------------------------


@log
def can_csv(folder: Path) -> Expected:
    """python-can's CSV of a bus, whose bytes are in base 64, and its DBC, written by canmatrix."""
    import can

    run = axis("rig", "actuator_dead_zone", 533)
    u, y, _ = signals(run)
    (folder / "bench.dbc").write_text(
        'VERSION ""\n\nNS_ :\n\nBS_:\n\nBU_: ECU\n\nBO_ 256 Command: 8 ECU\n'
        ' SG_ Force : 0|16@1- (0.001,0) [-32|32] "N" ECU\n\nBO_ 257 Encoder: 8 ECU\n'
        ' SG_ Position : 0|32@1- (0.0001,0) [-1000|1000] "mm" ECU\n'
    )
    with can.CSVWriter(str(folder / "bus.csv")) as file:
        for t, a, b in zip((EPOCH + run.time).tolist(), u, y, strict=True):
            for number, value, size in ((256, 1e3 * a, 2), (257, 1e7 * b, 4)):
                data = round(value).to_bytes(size, "little", signed=True).ljust(8, b"\0")
                file(can.Message(timestamp=t, arbitration_id=number, data=data, is_extended_id=False))
    return entry(
        f"{folder / 'bus.csv'}+{folder / 'bench.dbc'}", run.only("force", "position"),
        "t=Encoder.t:s; force=Command.Force:N; position=Encoder.Position:mm",
    )  # fmt: skip


@log
def unitree(folder: Path) -> Expected:
    """ROS 2 bag with messages of its own: `LowState` with a list of motors, `LowCmd` the same; MCAP."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    run = joint("coulomb_friction", 534)
    told, seen = signals(run)
    store = get_typestore(Stores.ROS2_HUMBLE)
    texts = {"MotorState": "uint8 mode\nfloat32 q\nfloat32 dq\nint8 temperature\n",
             "LowState": "uint32 tick\nMotorState[2] motor_state\n",
             "MotorCmd": "uint8 mode\nfloat32 q\nfloat32 kp\n",
             "LowCmd": "uint32 crc\nMotorCmd[2] motor_cmd\n"}  # fmt: skip
    for name, lines in texts.items():
        store.register(get_types_from_msg(lines, f"unitree_go/msg/{name}"))
    kinds: dict[str, Any] = {name: store.types[f"unitree_go/msg/{name}"] for name in texts}
    with Writer(folder / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as file:
        state = file.add_connection("/lowstate", "unitree_go/msg/LowState", typestore=store)
        order = file.add_connection("/lowcmd", "unitree_go/msg/LowCmd", typestore=store)
        for k, t in enumerate(run.time):
            stamp, other = round((EPOCH + t) * 1e9), 0.1 * np.sin(0.3 * t)
            motors = [kinds["MotorState"](1, q, 0.0, 40) for q in (other, seen[k])]
            orders = [kinds["MotorCmd"](1, q, 20.0) for q in (other, told[k])]
            for line, kind, message in ((order, "LowCmd", kinds["LowCmd"](7, orders)),
                                        (state, "LowState", kinds["LowState"](k, motors))):  # fmt: skip
                file.write(line, stamp, store.serialize_cdr(message, f"unitree_go/msg/{kind}"))
    return entry(
        folder / "bag", run,
        "t=/lowstate.t:s; set_point=/lowcmd.motor_cmd[1].q:; position=/lowstate.motor_state[1].q:",
        options={"columns": {
            "set_point": "/lowcmd.motor_cmd[1].q:rad", "position": "/lowstate.motor_state[1].q:rad",
        }},
    )  # fmt: skip


@log
def joint_controller(folder: Path) -> Expected:
    """ROS 1 bag of a joint controller's state: `joint_names`, `desired.positions`, `actual.positions`."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    run = joint("actuator_lag", 535)
    told, seen = signals(run)
    store = get_typestore(Stores.ROS1_NOETIC)
    name = "control_msgs/msg/JointTrajectoryControllerState"
    store.register(get_types_from_msg(
        "std_msgs/Header header\nstring[] joint_names\ntrajectory_msgs/JointTrajectoryPoint desired\n"
        "trajectory_msgs/JointTrajectoryPoint actual\n", name,
    ))  # fmt: skip
    point, header = (
        store.types["trajectory_msgs/msg/JointTrajectoryPoint"],
        store.types["std_msgs/msg/Header"],
    )
    moment, empty = store.types["builtin_interfaces/msg/Time"], np.zeros(0)
    lasts = store.types["builtin_interfaces/msg/Duration"](0, 0)
    with Writer(folder / "arm.bag") as file:
        state = file.add_connection("/arm_controller/state", name, typestore=store)
        for k, t in enumerate(run.time):
            stamp, other = round((EPOCH + t) * 1e9), 0.1 * np.sin(0.3 * t)
            points = [
                point(np.array([other, x[k]]), empty, empty, empty, time_from_start=lasts)
                for x in (told, seen)
            ]
            head = header(seq=k, stamp=moment(stamp // 10**9, stamp % 10**9), frame_id="")
            message = store.types[name](head, ["shoulder", "elbow"], *points)
            file.write(state, stamp, store.serialize_ros1(message, name))
    column = "/arm_controller/state.{}.positions[elbow]"
    return entry(
        folder / "arm.bag", run,
        f"t=/arm_controller/state.t:s; set_point={column.format('desired')}:; "
        f"position={column.format('actual')}:",
        options={"columns": {
            "set_point": f"{column.format('desired')}:rad", "position": f"{column.format('actual')}:rad",
        }},
    )  # fmt: skip


@log
def tdms_stamps(folder: Path) -> Expected:
    """LabVIEW's .tdms (FlexLogger): a channel of dates instead of a step, groups named by their rate."""
    from nptdms import ChannelObject, TdmsWriter

    run = axis("pendulum", "coulomb_friction", 536)
    u, y, v = signals(run)
    when = np.datetime64("2026-11-22T10:00:00", "us") + (1e6 * run.time).round().astype("timedelta64[us]")
    columns = {"Torque": (u, "N.m"), "Angle": (y / DEG, "deg"), "Speed": (v / RPM, "rpm")}
    with TdmsWriter(folder / "log.tdms") as file:
        file.write_segment([
            ChannelObject("Log", "Time", when),
            *(ChannelObject("Log", n, x, {"unit_string": unit}) for n, (x, unit) in columns.items()),
        ])  # fmt: skip
    return entry(
        folder / "log.tdms",
        run,
        "t=Log.Time:s; torque=Log.Torque:N m; angle=Log.Angle:deg; velocity=Log.Speed:rpm",
    )


@log
def asammdf_csv(folder: Path) -> Expected:
    """asammdf's own CSV of a measurement: `timestamps` and names in quotes, a row of units below."""
    from asammdf import MDF, Signal

    run = axis("rig", "actuator_lag", 537)
    u, y, v = signals(run)
    columns = (("Force_Cmd", u, "N"), ("Pos_Act", 1e3 * y, "mm"), ("Vel_Act", 1e3 * v, "mm/s"))
    with MDF(version="4.10") as file:
        file.append([Signal(x, run.time, name=n, unit=unit) for n, x, unit in columns])
        file.export("csv", folder / "rig.csv", single_time_base=True, add_units=True)
    return entry(
        folder / "rig.csv",
        run,
        "t=timestamps:s; force=Force_Cmd:N; position=Pos_Act:mm; velocity=Vel_Act:mm/s",
    )


@log
def mdf_conversions(folder: Path) -> Expected:
    """MDF 4 of a vehicle: raw integers with linear conversions, a channel of words, three rates."""
    from asammdf import MDF, Signal

    run = axis("rig", "actuator_saturation", 538, hold=2)
    u, y, _ = signals(run)
    with MDF(version="4.10") as file:
        for name, time, raw, gain, unit in (
            ("Force_Req", run.time[::2], 1e2 * u[::2], 0.01, "N"),
            ("Pos_Act", run.time, 1e5 * y, 0.01, "mm"),
        ):
            linear = {"a": gain, "b": 0.0}
            file.append(Signal(raw.round().astype("<i4"), time, name=name, unit=unit, conversion=linear))
        words = {"val_0": 0, "text_0": b"IDLE", "val_1": 1, "text_1": b"ACTIVE"}
        slow = run.time[::100]
        file.append(Signal((slow > 3).astype("u1"), slow, name="Mode", conversion=words))
        file.save(folder / "rig.mf4")
    return entry(
        folder / "rig.mf4", run.only("force", "position"), "force=Force_Req:N; position=Pos_Act:mm",
        options={"columns": {"force": "Force_Req", "position": "Pos_Act"}},
    )  # fmt: skip


@log
def ulog2csv(folder: Path) -> Expected:
    """PX4's log after `ulog2csv`: two files, microseconds since the start, `timestamp` without a unit."""
    run = joint("actuator_delay", 539, rate=50.0)
    told, seen = signals(run)
    time = [str(112_574_000 + round(1e6 * t)) for t in run.time]
    zero = ["0"] * len(time)
    point, place = folder / "log_vehicle_attitude_setpoint_0.csv", folder / "log_vehicle_local_position_0.csv"
    text(point, ["timestamp,yaw_body,yaw_sp_move_rate"], (time, told, zero))
    text(place, ["timestamp,timestamp_sample,heading,heading_var"], (time, time, seen, zero))
    return entry(
        f"{point}+{place}", run, "set_point=yaw_body:; position=heading:",
        options={"columns": {"set_point": "yaw_body:rad", "position": "heading:rad"}},
    )  # fmt: skip


@log
def robot_table(folder: Path) -> Expected:
    """A mobile robot's CSV (ROS 2 recorder): stamps in two columns, `sec` and `nanosec`, speeds of wheels."""
    run = drive("actuator_delay", 540)
    left, right, x, y, heading = signals(run)
    sec, nanosec = [str(int(EPOCH + t)) for t in run.time], [str(round(t % 1 * 1e9)) for t in run.time]
    head = ["stamp.sec,stamp.nanosec,left_wheel_cmd [rad/s],right_wheel_cmd [rad/s],pose.x [m],pose.y [m],"
            "pose.yaw [rad]"]  # fmt: skip
    text(folder / "robot.csv", head, (sec, nanosec, left, right, x, y, heading))
    return entry(
        folder / "robot.csv", run,
        "left_command=left_wheel_cmd [rad/s]:rad/s; right_command=right_wheel_cmd [rad/s]:rad/s; "
        "x=pose.x [m]:m; y=pose.y [m]:m; heading=pose.yaw [rad]:rad",
    )  # fmt: skip


# --- a second batch, after the first was read ---------------------------------------------------------


@log
def rockwell(folder: Path) -> Expected:
    """Rockwell's trend: each row begins with `Data`, the date and the time apart, `;` before milliseconds."""
    run = axis("rig", "coulomb_friction", 601)
    u, y, v = signals(run)
    head = ['"Controller Name:","L71"', '"Trend Name:","Axis"', '"Trend Tags:",3', '"Sample Period:","10 ms"',
            '"Header:","Date","Time","Force [N]","Position [mm]","Velocity [mm/s]"']  # fmt: skip
    when = [[f'"{s}"' for s in stamps(run.time, form, 6)] for form in ("%m/%d/%Y", "%H:%M:%S;%f")]
    text(folder / "trend.csv", head, (["Data"] * len(u), *when, u, 1e3 * y, 1e3 * v))
    return entry(
        folder / "trend.csv", run,
        "t=Time:s; force=Force [N]:N; position=Position [mm]:mm; velocity=Velocity [mm/s]:mm/s",
    )  # fmt: skip


@log
def codesys(folder: Path) -> Expected:
    """CODESYS's trace: `;`, each variable with its own microseconds at its left, names by the program."""
    run = axis("pendulum", "actuator_lag", 602)
    names = ["PLC_PRG.fTorque", "PLC_PRG.fAngle", "PLC_PRG.fVelocity"]
    time = [str(round(1e6 * t)) for t in run.time]
    cells = [one for values in signals(run) for one in (time, values)]
    text(folder / "trace.csv", [";".join(f"Timestamp {name};{name}" for name in names)], cells, ";")
    own = dict(
        zip(("torque", "angle", "velocity"), zip(names, ("N m", "rad", "rad/s"), strict=True), strict=True)
    )
    return entry(
        folder / "trace.csv", run, "; ".join(f"{s}={name}:" for s, (name, _) in own.items()),
        options={"columns": {s: f"{name}:{unit}" for s, (name, unit) in own.items()}},
    )  # fmt: skip


@log
def tuples(folder: Path) -> Expected:
    """What `print((t, u, x, v))` of MicroPython leaves: rows in brackets, no header."""
    run = axis("pendulum", "coulomb_friction", 604)
    rows = zip(run.time, *signals(run), strict=True)
    (folder / "log.txt").write_text("".join(f"({t:.3f}, {a:.5f}, {b:.5f}, {c:.5f})\n" for t, a, b, c in rows))
    names = dict(zip(("t", "torque", "angle", "velocity"), ("s", "N m", "rad", "rad/s"), strict=True))
    return entry(
        folder / "log.txt", run, "; ".join(f"{name}=column {k}:" for k, name in enumerate(names, 1)),
        options={"columns": {n: f"column {k}:{unit}" for k, (n, unit) in enumerate(names.items(), 1)}},
    )  # fmt: skip


@log
def esp_idf(folder: Path) -> Expected:
    """ESP-IDF's console: `I (milliseconds) tag: name=value unit`, the boot's lines above."""
    run = axis("pendulum", "actuator_saturation", 607)
    lines = ["ESP-ROM:esp32s3", "I (20) boot: start"]
    for t, a, b, c in zip(run.time, *signals(run), strict=True):
        told = f"torque={a:.4f} Nm angle={b / DEG:.3f} deg speed={c / RPM:.3f} rpm"
        lines.append(f"I ({round(1e3 * t) + 4312}) motor: {told}")
    (folder / "esp.log").write_text("\n".join(lines) + "\n")
    return entry(
        folder / "esp.log", run, "torque=torque:N m; angle=angle:deg; velocity=speed:rpm",
        options={"rate": 100.0},
    )  # fmt: skip


@log
def mqtt(folder: Path) -> Expected:
    """A recorder of MQTT: a record a line with the topic and its payload, milliseconds since 1970."""
    run = axis("rig", "actuator_lag", 608)
    lines = []
    for t, a, b, c in zip(EPOCH + run.time, *signals(run), strict=True):
        for late, topic, told in (
            (0, "rig/cmd", {"force_N": round(a, 5)}),
            (1, "rig/state", {"position_mm": round(1e3 * b, 5), "velocity_mm_s": round(1e3 * c, 4)}),
        ):
            lines.append(json.dumps({"ts": round(1e3 * t) + late, "topic": topic, "payload": told}))
    (folder / "mqtt.jsonl").write_text("\n".join(lines) + "\n")
    return entry(
        folder / "mqtt.jsonl", run,
        "force=rig/cmd.payload.force_N:N; position=rig/state.payload.position_mm:mm; "
        "velocity=rig/state.payload.velocity_mm_s:mm/s",
    )  # fmt: skip


@log
def capitals(folder: Path) -> Expected:
    """A test stand of old (a Fortran program): columns of blanks, everything in capitals, `POS(MM)`."""
    run = axis("rig", "actuator_lag", 616)
    u, y, v = signals(run)
    columns = {"TIME(SEC)": run.time, "FORCE(N)": u, "POS(MM)": 1e3 * y, "VEL(MM/S)": 1e3 * v}
    (folder / "run16.dat").write_text(pd.DataFrame(columns).to_string(index=False))
    return entry(
        folder / "run16.dat",
        run,
        "t=TIME(SEC):s; force=FORCE(N):N; position=POS(MM):mm; velocity=VEL(MM/S):mm/s",
    )


@log
def prefixes(folder: Path) -> Expected:
    """A drive's trace in units with prefixes: mN·m, mrev, krpm, microseconds."""
    run = axis("pendulum", "coulomb_friction", 619)
    u, y, v = signals(run)
    head = ["time [µs],torque [mN·m],position [mrev],velocity [krpm]"]
    columns = (1e6 * run.time, 1e3 * u, 1e3 * y / (2 * np.pi), 1e-3 * v / RPM)
    text(folder / "trace.csv", head, columns, form="{:.7f}".format)
    return entry(
        folder / "trace.csv", run,
        "t=time [µs]:us; torque=torque [mN·m]:mN m; angle=position [mrev]:mrev; "
        "velocity=velocity [krpm]:krpm",
    )  # fmt: skip


@log
def topic_echo(folder: Path) -> Expected:
    """`ros2 topic echo`: a document of YAML a message; with `--csv` rows without names, two stamps."""
    run = axis("pendulum", "coulomb_friction", 612)
    u, y, v = signals(run)
    sec, nanosec = [str(int(EPOCH + t)) for t in run.time], [str(round(t % 1 * 1e9)) for t in run.time]
    documents = [
        f"header:\n  stamp:\n    sec: {s}\n    nanosec: {n}\nposition:\n- {b:.6f}\neffort:\n- {a:.6f}\n---\n"
        for s, n, a, b in zip(sec, nanosec, u, y, strict=True)
    ]
    (folder / "echo.yaml").write_text("".join(documents))
    text(folder / "echo.csv", [], (sec, nanosec, ["base"] * len(u), ["hip"] * len(u), y, v, u))
    return entry(
        folder / "echo.yaml", run, "torque=column 7:; angle=column 5:; velocity=column 6:",
        options={"columns": {
            "torque": "column 7:N m", "angle": "column 5:rad", "velocity": "column 6:rad/s",
        }},
        refused=("documents of YAML", "--csv"), remedy=str(folder / "echo.csv"),
    )  # fmt: skip


@log
def archive(folder: Path) -> Expected:
    """What a phone or a web page gives: a .zip with the table and what describes the device."""
    run = axis("rig", "actuator_lag", 609)
    u, y, v = signals(run)
    head = ['"Time (s)","Force (N)","Position (mm)","Velocity (mm/s)"']
    table = text(folder / "Raw Data.csv", head, (run.time, u, 1e3 * y, 1e3 * v))
    with zipfile.ZipFile(folder / "log.zip", "w") as file:
        file.write(table, table.name)
        file.writestr("meta/device.csv", "property,value\nname,phone\n")
    return entry(
        folder / "log.zip", run,
        "t=Time (s):s; force=Force (N):N; position=Position (mm):mm; velocity=Velocity (mm/s):mm/s",
        refused=("unpack it", "Raw Data.csv"), remedy=str(table),
    )  # fmt: skip


@log
def pickled(folder: Path) -> Expected:
    """NumPy's .npz of an episode as a dictionary, which is a pickle."""
    run = axis("rig", "actuator_dead_zone", 611)
    episode = dict(zip(("t", "force", "position", "velocity"), (run.time, *signals(run)), strict=True))
    np.savez(folder / "episode.npz", episode=np.array(episode, dtype=object))
    np.savez(folder / "plain.npz", **np.load(folder / "episode.npz", allow_pickle=True)["episode"].item())
    return entry(
        folder / "episode.npz", run, "t=t:; force=force:; position=position:; velocity=velocity:",
        refused=("may run code", r"numpy.savez\('plain.npz', \*\*numpy.load\('episode.npz'"),
        remedy=str(folder / "plain.npz"),
    )  # fmt: skip
