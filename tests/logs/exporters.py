"""Text as programs export it, in notations that no other log here has; written down before any was read."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from bench import Run, axis, commands, follower, joint
from expected import Expected, entry, machine
from foreign import DEG, EPOCH, RPM, comma, signals, stamps, text

EXPORTERS: dict[str, Callable[[Path], Expected]] = {}


def log(make: Callable[[Path], Expected]) -> Callable[[Path], Expected]:
    """Register the maker of a log; its docstring says what program writes so."""
    EXPORTERS[make.__name__] = make
    return make


def quoted(cells) -> str:
    """Cells in quotes, separated by commas."""
    return ",".join(f'"{cell}"' for cell in cells)


def pendulum(cause: str, seed: int) -> Run:
    """A pendulum without its velocity."""
    return axis("pendulum", cause, seed).only("torque", "angle")


# --- oscilloscopes, logic analysers, multimeters ------------------------------------------------------


@log
def tektronix(folder: Path) -> Expected:
    """Oscilloscope (Tektronix MDO): pairs of settings, labels above the names, times from before zero."""
    run = pendulum("coulomb_friction", 401)
    u, y = signals(run)
    head = ["Model,MDO3024", "Firmware Version,1.26", ",", "Waveform Type,ANALOG", "Point Format,Y",
            "Horizontal Units,s", "Horizontal Scale,4", "Sample Interval,1.0e-02", "Record Length,4000",
            "Vertical Units,V,V", "Vertical Offset,0,0", "Label,Torque,Angle", "TIME,CH1,CH2"]  # fmt: skip
    text(folder / "tek0003.csv", head, (run.time - 2.0, u, y), form="{:.6e}".format)
    return entry(
        folder / "tek0003.csv", run, "t=TIME:s; torque=Torque:V; angle=Angle:V",
        options={"columns": {"torque": "Torque:N m", "angle": "Angle:rad"}},
    )  # fmt: skip


@log
def saleae(folder: Path) -> Expected:
    """Logic analyser (Saleae Logic 2, analog export): `Time [s]`, channels by their labels, no unit."""
    run = pendulum("actuator_dead_zone", 402)
    u, y = signals(run)
    columns = (run.time, 3.3 * (0.5 + 0.5 * u), y)
    text(folder / "analog.csv", ["Time [s],Motor torque,Angle sensor"], columns, form="{:.9f}".format)
    return entry(
        folder / "analog.csv", run, "t=Time [s]:s; torque=Motor torque:; angle=Angle sensor:",
        options={"columns": {"torque": "0.606060606*Motor torque-1:N m", "angle": "Angle sensor:rad"}},
    )  # fmt: skip


@log
def agilent(folder: Path) -> Expected:
    """Acquisition unit (Agilent 34970A): UTF-16, months first, `:` before milliseconds, alarms, (VDC)."""
    told = commands(np.random.default_rng(403), 1500, 0.5, 5.0)
    run = follower(machine(folder, "V", "V", "1"), "actuator_lag", told, 0.5, 3.0)
    rows = [stamps(run.time, "%m/%d/%Y %H:%M:%S:%f"), *signals(run)]
    count = [str(k + 1) for k in range(len(told))]
    columns = (count, rows[0], rows[1], ["0"] * len(told), rows[2], ["0"] * len(told))
    head = ["Name:,Data 1 11_22_2026", "Owner:,lab", "Comments:,", "Date:,11/22/2026 10:00:00 AM", "",
            "Scan,Time,101 <command> (VDC),Alarm 101,102 <response> (VDC),Alarm 102"]  # fmt: skip
    text(folder / "data1.csv", head, columns, form="{:.6E}".format, encoding="utf-16", end="\r\n")
    return entry(
        folder / "data1.csv", run,
        "t=Time:s; command=101 <command> (VDC):V; response=102 <response> (VDC):V",
    )  # fmt: skip


@log
def hobo(folder: Path) -> Expected:
    """Data logger (HOBOware): a title, `#` in the header, years of two digits, am and pm, serial numbers."""
    told = 20.0 + 5.0 * np.repeat(np.random.default_rng(404).integers(0, 6, 60), 25).astype(float)
    run = follower(machine(folder, "°C", "°C", "1"), "actuator_delay", told, 60.0, 600.0, late=900.0)
    head = ['"Plot Title: oven 3"', quoted([
        "#", "Date Time, GMT+01:00", "Set point, °C (LGR S/N: 20371, SEN S/N: 19)",
        "Temp, °C (LGR S/N: 20371, SEN S/N: 20)",
    ])]  # fmt: skip
    count = [str(k + 1) for k in range(len(told))]
    columns = (count, [s[:20] for s in stamps(run.time, "%m/%d/%y %I:%M:%S %p.%f")], *signals(run))
    text(folder / "oven3.csv", head, columns, form="{:.3f}".format, encoding="utf-8-sig")
    return entry(
        folder / "oven3.csv", run,
        "t=Date Time, GMT+01:00:s; command=Set point, °C (LGR S/N: 20371, SEN S/N: 19):°C; "
        "response=Temp, °C (LGR S/N: 20371, SEN S/N: 20):°C",
    )  # fmt: skip


# --- robots and simulators ----------------------------------------------------------------------------


@log
def rostopic(folder: Path) -> Expected:
    """`rostopic echo -p /joint_states`: the header begins with %, stamps in ns since 1970, a text column."""
    run = axis("pendulum", "actuator_delay", 405)
    u, y, v = signals(run)
    ns = [str(round((EPOCH + t) * 100) * 10**7) for t in run.time]
    count, frame = [str(k) for k in range(len(ns))], ["base"] * len(ns)
    head = "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.name0,field.position0,"
    head += "field.velocity0,field.effort0"
    text(folder / "joint_states.csv", [head], (ns, count, ns, frame, ["hip"] * len(ns), y, v, u))
    return entry(
        folder / "joint_states.csv", run,
        "t=time:; torque=field.effort0:; angle=field.position0:; velocity=field.velocity0:",
    )  # fmt: skip


@log
def plotjuggler(folder: Path) -> Expected:
    """PlotJuggler's CSV: `__time` since 1970, topics by their paths, no cell where a topic has no sample."""
    run = axis("pendulum", "coulomb_friction", 406, hold=2)
    u, y, v = signals(run)
    lines = ["__time,/cmd/torque,/joint_states/hip/position,/joint_states/hip/velocity"]
    for k, t in enumerate(EPOCH + run.time):
        if k % 2 == 0:
            lines.append(f"{t:.6f},{u[k]:.6f},,")
        lines.append(f"{t + 0.0012:.6f},,{y[k]:.6f},{v[k]:.6f}")
    (folder / "plot.csv").write_text("\n".join(lines) + "\n")
    return entry(
        folder / "plot.csv", run,
        "t=__time:; torque=/cmd/torque:; angle=/joint_states/hip/position:; "
        "velocity=/joint_states/hip/velocity:",
    )  # fmt: skip


@log
def foxglove(folder: Path) -> Expected:
    """Foxglove's download of a plot: one value a row, with its topic."""
    run = axis("pendulum", "actuator_saturation", 407)
    lines = ["elapsed time,receive time,header.stamp,topic,value"]
    paths = {
        "torque": "/cmd.effort",
        "angle": "/joint_states.position[0]",
        "velocity": "/joint_states.velocity[0]",
    }
    for name, values in run.signals.items():
        lines += [
            f"{t:.6f},{EPOCH + t:.6f},,{paths[name]},{x:.6f}" for t, x in zip(run.time, values, strict=True)
        ]
    (folder / "plot_data_export.csv").write_text("\n".join(lines) + "\n")
    columns = "; ".join(f"{name}={path}:" for name, path in paths.items())
    return entry(folder / "plot_data_export.csv", run, f"t=elapsed time:; {columns}")


@log
def odrive(folder: Path) -> Expected:
    """ODrive's GUI: milliseconds since 1970, paths of its objects, turns that nobody states."""
    run = joint("coulomb_friction", 408)
    told, seen = signals(run)
    columns = (1e3 * (EPOCH + run.time), told / (2 * np.pi), seen / (2 * np.pi))
    head = ["time,axis0.controller.input_pos,axis0.encoder.pos_estimate"]
    text(folder / "odrive.csv", head, columns, form="{:.5f}".format)
    return entry(
        folder / "odrive.csv", run,
        "t=time:; set_point=axis0.controller.input_pos:; position=axis0.encoder.pos_estimate:",
        options={"columns": {
            "set_point": "axis0.controller.input_pos:turn", "position": "axis0.encoder.pos_estimate:turn",
        }},
    )  # fmt: skip


@log
def dynamixel(folder: Path) -> Expected:
    """Dynamixel Wizard: the servo's number before the name, raw positions of which 4096 are a turn."""
    run = joint("actuator_delay", 409)
    told, seen = (np.round(2048 + s / (2 * np.pi) * 4096) for s in signals(run))
    head = ['"Time(ms)","[ID:001] Goal Position","[ID:001] Present Position"']
    text(folder / "wizard.csv", head, (1e3 * run.time, told, seen), form="{:.0f}".format)
    own = {"set_point": "Goal", "position": "Present"}
    return entry(
        folder / "wizard.csv", run,
        "t=Time(ms):ms; set_point=[ID:001] Goal Position:; position=[ID:001] Present Position:",
        options={"columns": {
            k: f"0.001533980788*[ID:001] {v} Position-3.141592654:rad" for k, v in own.items()
        }},
    )  # fmt: skip


# --- test stands, vehicles, machines ------------------------------------------------------------------


@log
def controldesk(folder: Path) -> Expected:
    """dSPACE ControlDesk: what a row is stands before it (names, units), blanks before the values."""
    run = axis("rig", "coulomb_friction", 410)
    u, y, v = signals(run)
    head = ["description,Recording 003", "date,2026-11-22 10:00:00",
            "path,,Model Root/Controller,Model Root/Plant,Model Root/Plant",
            "name,Time,force,position,velocity", "unit,s,N,mm,mm/s"]  # fmt: skip
    blank = ["values", *[""] * (len(u) - 1)]
    text(folder / "rec003.csv", head, (blank, run.time, u, 1e3 * y, 1e3 * v))
    return entry(
        folder / "rec003.csv", run, "t=Time:s; force=force:N; position=position:mm; velocity=velocity:mm/s"
    )


@log
def motec(folder: Path) -> Expected:
    """MoTeC i2: all cells in quotes, settings of up to six cells above, blank lines, a row of units."""
    told = 30.0 + commands(np.random.default_rng(411), 3000, 0.05, 30.0)
    run = follower(machine(folder, "%", "km/h", "km/h/%"), "actuator_lag", told, 0.05, 1.5)
    head = [quoted(["Format", "MoTeC CSV File"]) + ',,,"Workbook","Test"', quoted(["Venue", "Track"]),
            quoted(["Sample Rate", "20.000", "Hz"]) + ',,"Device","ADL"',
            quoted(["Duration", "150.000", "s"]), quoted(["Range", "entire outing"]), "", "",
            quoted(["Time", "Throttle Pos", "Ground Speed", "Gear"]), quoted(["s", "%", "km/h", ""]),
            "", ""]  # fmt: skip
    cells = [[f'"{x:.3f}"' for x in s] for s in (run.time, *signals(run))]
    text(folder / "outing.csv", head, (*cells, ['"3"'] * len(told)), end="\r\n")
    return entry(
        folder / "outing.csv", run, "t=Time:s; command=Throttle Pos:%; response=Ground Speed:km/h",
        options={"columns": {"command": "Throttle Pos", "response": "Ground Speed"}},
    )  # fmt: skip


@log
def twincat(folder: Path) -> Expected:
    """Beckhoff TwinCAT Scope: each channel with its times [ms] at its left, settings of channels above."""
    run = axis("rig", "actuator_dead_zone", 412)
    names = ["Force", "Position", "Velocity"]

    def row(key: str, values) -> str:
        return "\t".join(f"{key}\t{value}" for value in values)

    head = ["Name\tScope YT Project", "File\tC:\\data\\rig.svdx", "Starttime of export\t133768224000000000",
            "Endtime of export\t133768224400000000", "", row("Name", names),
            row("SymbolName", [f"MAIN.f{name}" for name in names]), row("Data-Type", ["LREAL"] * 3),
            row("SampleTime[ms]", ["10"] * 3), row("VariableSize", ["8"] * 3),
            row("Unit", ["N", "mm", "mm/s"]),
            row("Offset", ["0"] * 3), row("ScaleFactor", ["1"] * 3)]  # fmt: skip
    time = [str(round(1e3 * t)) for t in run.time]
    u, y, v = signals(run)
    text(folder / "scope.csv", head, (time, u, time, 1e3 * y, time, 1e3 * v), "\t", end="\r\n")
    return entry(
        folder / "scope.csv", run, "t=Name:ms; force=Force:N; position=Position:mm; velocity=Velocity:mm/s"
    )


@log
def tia_trace(folder: Path) -> Expected:
    """Siemens' trace of a drive: `;` and decimal commas, parameters with index, name and unit in one cell."""
    run = axis("pendulum", "actuator_saturation", 413)
    u, y, v = signals(run)
    head = ['Sample;"Time [ms]";"Drive_1: r79[0] Torque setpoint total [Nm]";'
            '"Drive_1: r482[0] Position actual value [°]";'
            '"Drive_1: r63[0] Speed actual value [rpm]"']  # fmt: skip
    cells = [[comma(x) for x in s] for s in (1e3 * run.time, u, y / DEG, v / RPM)]
    text(folder / "trace.csv", head, ([str(k) for k in range(len(u))], *cells), ";", end="\r\n")
    return entry(
        folder / "trace.csv", run,
        "t=Time [ms]:ms; torque=Drive_1: r79[0] Torque setpoint total [Nm]:N m; "
        "angle=Drive_1: r482[0] Position actual value [°]:deg; "
        "velocity=Drive_1: r63[0] Speed actual value [rpm]:rpm",
    )  # fmt: skip


@log
def tinkerforge(folder: Path) -> Expected:
    """Tinkerforge's brick logger: one value a row, with its device, variable and unit."""
    run = pendulum("coulomb_friction", 414)
    u, y = signals(run)
    lines = ["TIME;NAME;UID;VAR;RAW;UNIT"]
    for stamp, a, b in zip(stamps(run.time, "%Y-%m-%dT%H:%M:%S.%f"), u, y / DEG, strict=True):
        lines.append(f'{stamp}+01:00;"Servo Brick";"6Kd";"Torque";"{round(1e3 * a)}";"mNm"')
        lines.append(f'{stamp}+01:00;"IMU Brick";"6xH";"Angle";"{b:.2f}";"°"')
    (folder / "brick.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return entry(folder / "brick.csv", run, "t=TIME:s; torque=Torque:mN m; angle=Angle:deg")


# --- offices, dashboards, scripts ---------------------------------------------------------------------


@log
def excel_german(folder: Path) -> Expected:
    """German Excel: `sep=;` in the first line, decimal commas, dots between thousands, Windows-1252."""
    run = axis("pendulum", "hysteresis", 415)
    u, y, v = signals(run)
    head = ["sep=;", "Zeit [ms];Sollmoment [Nmm];Winkel ist [°];Drehzahl ist [U/min]"]
    columns = [[comma(x, 2, ".") for x in s] for s in (1e3 * run.time, 1e3 * u)]
    columns += [[comma(x, 4) for x in s] for s in (y / DEG, v / RPM)]
    text(folder / "versuch.csv", head, columns, ";", encoding="cp1252", end="\r\n")
    return entry(
        folder / "versuch.csv", run,
        "t=Zeit [ms]:ms; torque=Sollmoment [Nmm]:N mm; angle=Winkel ist [°]:deg; "
        "velocity=Drehzahl ist [U/min]:rpm",
    )  # fmt: skip


@log
def excel_unicode(folder: Path) -> Expected:
    """Excel's Unicode text: UTF-16 with its mark, tabs, decimal commas, names with a line break in quotes."""
    run = axis("rig", "actuator_delay", 416)
    u, y, v = signals(run)
    head = ['"Zeit\n[s]"\t"Kraft soll\n[N]"\t"Weg ist\n[mm]"\t"Geschwindigkeit ist\n[mm/s]"']
    columns = [[comma(x) for x in s] for s in (run.time, u, 1e3 * y, 1e3 * v)]
    text(folder / "rig.txt", head, columns, "\t", encoding="utf-16", end="\r\n")
    return entry(
        folder / "rig.txt", run,
        "t=Zeit [s]:s; force=Kraft soll [N]:N; position=Weg ist [mm]:mm; "
        "velocity=Geschwindigkeit ist [mm/s]:mm/s",
    )  # fmt: skip


@log
def excel_days(folder: Path) -> Expected:
    """A sheet whose times are Excel's days since 1900, as text; the header says `Date/Time`."""
    run = pendulum("actuator_lag", 417)
    days = [f"{46348.4166666667 + t / 86400:.10f}" for t in run.time]
    u, y = signals(run)
    text(folder / "days.csv", ["Date/Time,Torque [Nm],Angle [deg]"], (days, u, y / DEG))
    return entry(
        folder / "days.csv", run, "t=Date/Time:; torque=Torque [Nm]:N m; angle=Angle [deg]:deg",
        options={"columns": {"t": "Date/Time:d"}},
    )  # fmt: skip


@log
def grafana(folder: Path) -> Expected:
    """Grafana's formatted CSV: each cell with its unit, `;`, times in quotes."""
    run = pendulum("actuator_delay", 418)
    u, y = signals(run)
    columns = ([f'"{stamp}"' for stamp in stamps(run.time, "%Y-%m-%d %H:%M:%S.%f")],
               [f'"{x:.4f} N·m"' for x in u], [f'"{x:.3f} °"' for x in y / DEG])  # fmt: skip
    text(folder / "panel.csv", ['"Time";"torque {host=""cell""}";"angle {host=""cell""}"'], columns, ";")
    return entry(
        folder / "panel.csv", run,
        'torque=torque {host="cell"}:N m; angle=angle {host="cell"}:deg; t=Time:s',
    )  # fmt: skip


@log
def timetable(folder: Path) -> Expected:
    """MATLAB's writetimetable: durations as `0.02 sec`."""
    run = axis("rig", "coulomb_friction", 419)
    text(
        folder / "tt.csv",
        ["Time,force,position,velocity"],
        ([f"{t:.5g} sec" for t in run.time], *signals(run)),
    )
    return entry(
        folder / "tt.csv", run, "t=Time:s; force=force:; position=position:; velocity=velocity:"
    )  # fmt: skip


@log
def timedelta(folder: Path) -> Expected:
    """pandas' to_csv with time differences as index: no name above them, `0 days 00:00:00.020000`."""
    run = axis("rig", "actuator_dead_zone", 420)
    times = [f"0 days 00:{int(t // 60):02d}:{t % 60:09.6f}".removesuffix(".000000") for t in run.time]
    text(folder / "frame.csv", [",force,position,velocity"], (times, *signals(run)))
    return entry(
        folder / "frame.csv", run, "t=column 1:s; force=force:; position=position:; velocity=velocity:"
    )


@log
def vector(folder: Path) -> Expected:
    """CANalyzer's .asc with a DBC: a date, comments, absolute times, an error frame between."""
    run = axis("rig", "actuator_lag", 421)
    u, y, v = signals(run)
    (folder / "rig.dbc").write_text("\n".join([
        'VERSION ""', "BU_: A", "BO_ 256 Rig: 8 A", ' SG_ Force : 0|16@1- (0.001,0) [0|0] "N" A',
        ' SG_ Position : 16|32@1- (0.0001,0) [0|0] "mm" A', ' SG_ Velocity : 48|16@1- (0.1,0) [0|0] "mm/s" A',
        "",
    ]))  # fmt: skip
    lines = ["date Sun Nov 22 10:00:00.000 am 2026", "base hex  timestamps absolute",
             "internal events logged", "// version 13.0.0",
             "Begin TriggerBlock Sun Nov 22 10:00:00.000 am 2026",
             "   0.000000 Start of measurement"]  # fmt: skip
    for k, t in enumerate(run.time):
        data = b"".join(
            round(x).to_bytes(n, "little", signed=True)
            for x, n in ((1e3 * u[k], 2), (1e7 * y[k], 4), (1e4 * v[k], 2))
        )
        lines.append(f"{t + 0.001:11.6f} 1  100             Rx   d 8 {data.hex(' ').upper()}")
        lines += [f"{t + 0.002:11.6f} 1  ErrorFrame"] * (k == 700)
    (folder / "rig.asc").write_text("\n".join([*lines, "End TriggerBlock", ""]))
    return entry(
        f"{folder / 'rig.asc'}+{folder / 'rig.dbc'}", run,
        "force=Rig.Force:N; position=Rig.Position:mm; velocity=Rig.Velocity:mm/s",
    )  # fmt: skip


# --- nine more, written down after the first twenty-one were read, and before any of these was --------


@log
def influx(folder: Path) -> Expected:
    """InfluxDB's annotated CSV: lines of # above, an empty first column, one value a row, by field."""
    run = pendulum("coulomb_friction", 430)
    lines = ["#group,false,false,true,true,false,false,true",
             "#datatype,string,long,dateTime:RFC3339,dateTime:RFC3339,dateTime:RFC3339,double,string",
             "#default,_result,,,,,,", ",result,table,_start,_stop,_time,_value,_field"]  # fmt: skip
    at = stamps(run.time, "%Y-%m-%dT%H:%M:%S.%f")
    for k, (name, values) in enumerate(run.signals.items()):
        ends = "2026-11-22T10:00:00Z,2026-11-22T10:01:00Z"
        lines += [f",,{k},{ends},{t}Z,{x:.6f},{name}" for t, x in zip(at, values, strict=True)]
    (folder / "query.csv").write_text("\n".join(lines) + "\n")
    return entry(folder / "query.csv", run, "t=_time:s; torque=torque:; angle=angle:")


@log
def labchart(folder: Path) -> Expected:
    """ADInstruments LabChart: `Key=<tab>value` lines, titles and ranges in rows of their own, tabs."""
    run = axis("rig", "coulomb_friction", 431)
    u, y, v = signals(run)
    head = ["Interval=\t0.01 s", "ExcelDateTime=\t4.6348416666666667e+04\t11/22/2026 10:00:00",
            "TimeFormat=\tStartOfBlock", "DateFormat=\t", "ChannelTitle=\tForce\tPosition\tVelocity",
            "Range=\t20.000 N\t100.00 mm\t1000.0 mm/s"]  # fmt: skip
    text(folder / "labchart.txt", head, (run.time, u, 1e3 * y, 1e3 * v), "\t", end="\r\n")
    return entry(
        folder / "labchart.txt", run, "force=Force:N; position=Position:mm; velocity=Velocity:mm/s",
        options={"columns": {"force": "Force:N", "position": "Position:mm", "velocity": "Velocity:mm/s"}},
    )  # fmt: skip


@log
def picoscope(folder: Path) -> Expected:
    """PicoScope: names, units in brackets in the row below, an empty line, milliseconds from before zero."""
    run = pendulum("actuator_dead_zone", 432)
    u, y = signals(run)
    head = ["Time,Channel A,Channel B", "(ms),(V),(V)", ""]
    text(folder / "pico.csv", head, (1e3 * run.time - 500.0, u, y), form="{:.8f}".format)
    return entry(
        folder / "pico.csv", run, "t=Time:ms; torque=Channel A:V; angle=Channel B:V",
        options={"columns": {"torque": "Channel A:N m", "angle": "Channel B:rad"}},
    )  # fmt: skip


@log
def catman(folder: Path) -> Expected:
    """HBM catman: rows of settings for each channel below the names, French decimals, tabs, Windows-1252."""
    run = axis("rig", "actuator_delay", 433)
    u, y, v = signals(run)
    head = ["Temps 1 - taux par défaut\tForce consigne\tPosition\tVitesse", "s\tN\tmm\tmm/s",
            "Début : 22/11/2026 10:00:00\t\t\t",
            "Filtre\tBessel 10 Hz\tBessel 10 Hz\tBessel 10 Hz"]  # fmt: skip
    columns = [[comma(x) for x in s] for s in (run.time, u, 1e3 * y, 1e3 * v)]
    text(folder / "essai.txt", head, columns, "\t", encoding="cp1252", end="\r\n")
    return entry(
        folder / "essai.txt", run,
        "t=Temps 1 - taux par défaut:s; force=Force consigne:N; position=Position:mm; "
        "velocity=Vitesse:mm/s",
    )  # fmt: skip


@log
def gnuplot(folder: Path) -> Expected:
    """A file for gnuplot: `# 1:t[s] 2:tau[Nm] ...`, columns of blanks."""
    run = axis("pendulum", "actuator_saturation", 434)
    u, y, v = signals(run)
    rows = [f"{t:9.4f} {a:11.6f} {b:11.6f} {c:11.6f}" for t, a, b, c in zip(run.time, u, y, v, strict=True)]
    (folder / "run.dat").write_text("\n".join(["# 1:t[s] 2:tau[Nm] 3:phi[rad] 4:omega[rad/s]", *rows, ""]))
    return entry(
        folder / "run.dat", run, "t=1:t[s]:s; torque=2:tau[Nm]:N m; angle=3:phi[rad]:rad; "
        "velocity=4:omega[rad/s]:rad/s",
    )  # fmt: skip


@log
def modelica(folder: Path) -> Expected:
    """OpenModelica and Dymola: everything in quotes, der(...) and indices in names, no unit."""
    run = axis("pendulum", "coulomb_friction", 435)
    u, y, v = signals(run)
    head = ['"time","der(pendulum.phi)","pendulum.phi","motor.tau[1]"']
    text(folder / "pendulum_res.csv", head, (run.time, v, y, u), form="{:.9g}".format)
    return entry(
        folder / "pendulum_res.csv", run,
        "t=time:; torque=motor.tau[1]:; angle=pendulum.phi:; velocity=der(pendulum.phi):",
    )  # fmt: skip


@log
def kistler(folder: Path) -> Expected:
    """A press monitor: time of day with a comma, `;`, units as `name / unit`, a final empty cell."""
    run = axis("rig", "actuator_lag", 436)
    u, y, v = signals(run)
    head = ["Uhrzeit;Sollkraft / N;Weg / mm;Geschwindigkeit / mm/s;"]
    columns = [[comma(x) for x in s] for s in (u, 1e3 * y, 1e3 * v)]
    clock = [s.replace(".", ",") for s in stamps(run.time, "%H:%M:%S.%f")]
    text(folder / "presse.csv", head, (clock, *columns, [""] * len(u)), ";", encoding="cp1252")
    return entry(
        folder / "presse.csv", run,
        "t=Uhrzeit:s; force=Sollkraft / N:N; position=Weg / mm:mm; "
        "velocity=Geschwindigkeit / mm/s:mm/s",
    )  # fmt: skip


@log
def jsonlines_console(folder: Path) -> Expected:
    """A robot's console: a stamp in brackets before each line of JSON, other lines between."""
    run = joint("coulomb_friction", 437)
    told, seen = signals(run)
    lines = ["[INFO] [1795341599.900]: node started"]
    for t, a, b in zip(EPOCH + run.time, told, seen, strict=True):
        lines.append(f'[DEBUG] [{t:.3f}]: {{"goal_rad": {a:.5f}, "position_rad": {b:.5f}}}')
    (folder / "node.log").write_text("\n".join(lines) + "\n")
    return entry(
        folder / "node.log", run, "set_point=goal_rad:rad; position=position_rad:rad",
        options={"columns": {"set_point": "goal_rad:rad", "position": "position_rad:rad"}, "rate": 100.0},
    )  # fmt: skip


@log
def percent_of_full_scale(folder: Path) -> Expected:
    """A historian (OSIsoft PI): `Bad` and `No Data` among the numbers, `%`, dates with English months."""
    told = 50.0 + commands(np.random.default_rng(438), 2000, 0.5, 30.0)
    run = follower(machine(folder, "%", "°C", "°C/%"), "actuator_lag", told, 1.0, 20.0)
    u, y = ([f"{x:.3f}" for x in s] for s in signals(run))
    for k in (300, 301, 302, 900):
        y[k] = "Bad" if k < 900 else "No Data"
    head = ["Timestamp,TIC101.OP (%),TIC101.PV (°C)"]
    text(folder / "pi.csv", head, (stamps(run.time, "%d-%b-%Y %H:%M:%S.%f"), u, y))
    return entry(
        folder / "pi.csv", run, "t=Timestamp:s; command=TIC101.OP (%):%; response=TIC101.PV (°C):°C",
        options={"columns": {"command": "TIC101.OP (%)", "response": "TIC101.PV (°C)"}},
    )  # fmt: skip
