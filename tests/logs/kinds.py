"""Text logs of the kinds that were taken wrongly: units, signs, spikes, clocks, preambles, consoles."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise, zip_longest
from pathlib import Path

import numpy as np
from bench import Run, axis, commands, follower, joint, swing
from expected import Expected, entry, log, machine
from foreign import DEG, RPM, signals, stamps, text
from formats import BOOT, RATES

# --- tables that do not begin with a header -------------------------------------------------------------


@log
def preamble(folder: Path) -> Expected:
    """CSV, eight lines of pairs above the table, some with numbers, then names and a row of units."""
    run = axis("rig", "coulomb_friction", 301)
    u, y, v = signals(run)
    pairs = ["Instrument,Hydropuls 25", "Operator,K. Weber", "Date,2026-11-22", "Specimen,17"]
    pairs += ["Sample Rate (Hz),100", "Load Cell Gain,2.0", "Test Temperature (C),21.5", ""]
    head = [*pairs, "Time,Axial Force,Axial Displacement,Axial Velocity", "s,kN,mm,mm/s"]
    path = text(folder / "specimen17.csv", head, (run.time, u / 1e3, 1e3 * y, 1e3 * v), form="{:.7f}".format)
    return entry(
        path,
        run,
        "t=Time:s; force=Axial Force:kN; position=Axial Displacement:mm; velocity=Axial Velocity:mm/s",
    )


@log
def two_headers(folder: Path) -> Expected:
    """CSV, two header rows and units: groups, of which two hold the same names, then names.

    Names of groups stand above the first of their columns only, as merged cells are exported.
    """
    run, other = (axis("pendulum", cause, 302) for cause in ("actuator_delay", "coulomb_friction"))
    first, second = (signals(one.only("torque", "angle")) for one in (other, run))
    head = [",Axis 1,,Axis 2,,Cabinet", "Time,Torque,Angle,Torque,Angle,Temperature", "s,Nm,deg,Nm,deg,°C"]
    columns = (run.time, first[0], first[1] / DEG, second[0], second[1] / DEG, np.full(len(run.time), 21.0))
    return entry(
        text(folder / "axes.csv", head, columns),
        run.only("torque", "angle"),
        "t=Time:s; torque=Axis 2 Torque:N m; angle=Axis 2 Angle:deg",
        options={"columns": {"torque": "Axis 2 Torque", "angle": "Axis 2 Angle"}},
    )


@log
def two_clocks(folder: Path) -> Expected:
    """Text of a LabVIEW graph: two clocks side by side (50 and 100 Hz), nothing below the shorter half."""
    run = axis("pendulum", "coulomb_friction", 303, hold=2).only("torque", "angle")
    u, y = signals(run)
    sides = [(run.time[::2], u[::2]), (run.time + 0.0037, y / DEG)]
    rows = zip_longest(*([f"{v:.6f}" for v in one] for side in sides for one in side), fillvalue="")
    head = ["Time - Torque (s)\tAmplitude - Torque (Nm)\tTime - Angle (s)\tAmplitude - Angle (deg)"]
    return entry(
        text(folder / "graph.txt", head, list(zip(*rows, strict=True)), "\t", end="\r\n"),
        run,
        "t=Time - Torque (s):s; torque=Amplitude - Torque (Nm):N m; angle=Amplitude - Angle (deg):deg",
    )


@log
def console(folder: Path) -> Expected:
    """Console of an STM32: `key: value, key: value`, three lines at its start, warnings between."""
    run = joint("actuator_delay", 304)
    told, seen = signals(run)
    lines = ["", "[BOOT] STM32F446 fw 1.4.2 (Nov 22 2026)", "[BOOT] CAN up, 1 drive found"]
    for k, t in enumerate(run.time):
        both = f"sp_deg: {told[k] / DEG:.2f}, pos_deg: {seen[k] / DEG:.2f}"
        lines.append(f"t_ms: {5210 + round(1e3 * t)}, {both}, err: 0")
        if k % 700 == 350:
            lines.append("[WARN] bus voltage 23.1 V")
    (folder / "putty.log").write_text("\r\n".join(lines) + "\r\n")
    return entry(
        folder / "putty.log",
        run,
        "t=t_ms:ms; set_point=sp_deg:deg; position=pos_deg:deg",
    )


@log
def plotter(folder: Path) -> Expected:
    """Arduino's serial monitor with its stamps: `name:value` and tabs, the first line broken, no unit."""
    run = joint("coulomb_friction", 305, rate=50.0, seconds=60.0, pace=6.0)
    rows = zip(stamps(run.time, "%H:%M:%S.%f"), *(s / DEG for s in signals(run)), strict=True)
    lines = [f"{t} -> target:{a:.2f}\tangle:{b:.2f}\n" for t, a, b in rows]
    lines[0] = "10:00:00.000 -> \u2e2erget:0.00\tang\n"  # the port was opened in the middle of a line
    (folder / "serial.txt").write_text("".join(lines), encoding="utf-8")
    return entry(
        folder / "serial.txt",
        run,
        "set_point=target:; position=angle:",
        late=0.02,
        options={"columns": {"set_point": "target:deg", "position": "angle:deg"}},
    )


# --- units and signs ------------------------------------------------------------------------------------


@log
def inches(folder: Path) -> Expected:
    """CSV in kip, in and in/s."""
    run = axis("rig", "actuator_dead_zone", 306)
    u, y, v = signals(run)
    head = ["time (s),force (kip),position (in),velocity (in/s)"]
    columns = (run.time, u / 4448.2216, y / 0.0254, v / 0.0254)
    path = text(folder / "damper.csv", head, columns, form="{:.8g}".format)
    return entry(
        path,
        run,
        "t=time (s):s; force=force (kip):kip; position=position (in):in; velocity=velocity (in/s):in/s",
    )


@log
def quotients(folder: Path) -> Expected:
    """CSV, quantity by unit as in DIN 1313, (1) is the motor's number."""
    run = axis("pendulum", "actuator_saturation", 307)
    u, y, v = signals(run)
    head = ["t/ms;M(1) / Ncm;phi/°;n/min-1"]
    path = text(folder / "din.csv", head, (1e3 * run.time, 100 * u, y / DEG, v / RPM), ";")
    return entry(
        path,
        run,
        "t=t/ms:ms; torque=M(1) / Ncm:N cm; angle=phi/°:deg; velocity=n/min-1:1/min",
    )


@log
def registers(folder: Path) -> Expected:
    """CSV of Modbus registers: 16 bits in two's complement read as unsigned (-1 is 65535)."""
    run = axis("rig", "coulomb_friction", 308).only("force", "position")
    whole = [np.round(g * s).astype(int) % 65536 for g, s in zip((1e3, 1e5), signals(run), strict=True)]
    head = ["time_s,force_cmd_raw,position_raw"]
    text(folder / "modbus.csv", head, [run.time, *whole], form="{:.6g}".format)
    return entry(
        folder / "modbus.csv",
        run,
        "t=time_s:s; force=force_cmd_raw:; position=position_raw:",
        scaled=("force", "position"),
        said=("force_cmd_raw.*two's complement", "position_raw.*two's complement"),
    )


@log
def sign_and_magnitude(folder: Path) -> Expected:
    """CSV of a bus servo: a drive in sign and magnitude (bit 10), an angle of 12 bits that wraps.

    So Feetech's servos: bit 10 is the sign of the drive, the encoder counts to 4096.
    """
    run = axis("pendulum", "actuator_delay", 309).only("torque", "angle")
    u, y = signals(run)
    drive, turn = np.round(900 * u / 0.7).astype(int), np.round(y / (2 * np.pi) * 4096).astype(int)
    columns = (run.time, np.where(drive < 0, 1024 - drive, drive), turn % 4096)
    text(folder / "servo.csv", ["time,goal_pwm,present_position"], columns, form="{:.6g}".format)
    return entry(
        folder / "servo.csv",
        run,
        "t=time:; torque=goal_pwm:; angle=present_position:",
        options={"columns": {"angle": "0.001533980788*present_position%4096:rad"}},
        scaled=("torque",),
        said=("goal_pwm.*sign.*1024", "present_position.*wraps.*4096"),
    )


@log
def magnitude(folder: Path) -> Expected:
    """CSV, a duty cycle logged without its direction beside a signed speed."""
    run = axis("pendulum", "actuator_dead_zone", 310)
    u, y, v = signals(run)
    head = ["time [s],duty [%],angle [rad],speed [rad/s]"]
    text(folder / "duty.csv", head, (run.time, 120 * np.abs(u), y, v))
    return entry(
        folder / "duty.csv",
        replace(run, signals={**run.signals, "torque": np.abs(u)}),
        "t=time [s]:s; torque=duty [%]:%; angle=angle [rad]:rad; velocity=speed [rad/s]:rad/s",
        scaled=("torque",),
        said=(r"duty \[%\].*magnitude",),
    )


# --- samples and stamps that lie ------------------------------------------------------------------------


@log
def spikes(folder: Path) -> Expected:
    """CSV, three positions of 30 m and a velocity of -12854 m/s."""
    run = axis("rig", "coulomb_friction", 311)
    u, y, v = signals(run)
    at = [10, 17, 31, 2501]
    y[at[:3]], v[at[3]] = 30.0, -12854.0
    text(folder / "spikes.csv", ["t,force,position,velocity"], (run.time, u, y, v))
    return entry(
        folder / "spikes.csv",
        run,
        "t=t:; force=force:; position=position:; velocity=velocity:",
        rows={"spike": tuple(k + 2 for k in at)},
        said=("position.*spike", "velocity.*spike"),
    )


@log
def stuck(folder: Path) -> Expected:
    """CSV, an angle stuck for 80 rows, four rows repeated.

    The encoder hangs for 0.8 s while the pendulum swings; four rows are written twice, stamps and all.
    """
    run = axis("pendulum", "coulomb_friction", 312).only("torque", "angle")
    u, y = signals(run)
    y[1200:1280] = y[1200]
    again = np.sort(np.concatenate([np.arange(len(y)), np.arange(3000, 3004)]))
    text(folder / "stuck.csv", ["t [s],torque [Nm],angle [rad]"], [one[again] for one in (run.time, u, y)])
    return entry(
        folder / "stuck.csv",
        run,
        "t=t [s]:s; torque=torque [Nm]:N m; angle=angle [rad]:rad",
        rows={"stuck": (1202, 1281), "repeated": (3003, 3005, 3007, 3009)},
        said=("angle.*stuck|angle.*same value", "repeat"),
    )


@log
def lying_clock(folder: Path) -> Expected:
    """CSV, a clock that goes back by 0.5 s at one row and jumps by 3 s at another.

    The machine went on evenly.
    """
    run = axis("rig", "actuator_delay", 313)
    shift, cuts = np.repeat([0.0, -0.5, 2.5], [1500, 1300, 1200]), [0, 1500, 2800, 4000]
    head = ["time [s],force [N],position [m],velocity [m/s]"]
    text(folder / "clock.csv", head, (run.time + shift, *signals(run)))
    pieces = tuple(
        replace(run, time=run.time[: b - a], signals={n: s[a:b] for n, s in run.signals.items()})
        for a, b in pairwise(cuts)
    )
    return entry(
        folder / "clock.csv",
        pieces[0],
        "t=time [s]:s; force=force [N]:N; position=position [m]:m; velocity=velocity [m/s]:m/s",
        parts=pieces,
        rows={"clock": (1502, 2802)},
        said=("back", "jump|gap"),
    )


@log
def one_clock(folder: Path) -> Expected:
    """Two CSV of one clock (us since its start): a set-point, and a rate 120 ms late with a lag of 30 ms.

    So ulog2csv writes two topics; no shift of clocks may swallow the delay.
    """
    step, n = 0.001, 40_000
    told = commands(np.random.default_rng(314), n, step, 2.0)
    told = np.convolve(told, np.full(200, 1 / 200), "same")
    run = follower(machine(folder, *RATES), "actuator_delay", told, step, 0.03, 0.12, 0.005)
    u, y = signals(run)
    stamped = [str(round((BOOT + t) * 1e6)) for t in run.time]
    one = text(folder / "log_7_setpoint_0.csv", ["timestamp,roll"], (stamped[::20], u[::20]))
    seen = (stamped[3::10], y[3::10], 0 * y[3::10])
    two = text(folder / "log_7_gyro_0.csv", ["timestamp,xyz[0],xyz[1]"], seen)
    return entry(
        f"{one}+{two}",
        replace(run, time=run.time[::10], signals={n: s[::10] for n, s in run.signals.items()}),
        "t=timestamp:; command=roll:; response=xyz[0]:",
        options={"columns": {"command": "roll:rad/s", "response": "xyz[0]:rad/s"}},
    )


@log
def swinging_out(folder: Path) -> Expected:
    """CSV of a pendulum that swings out: no command."""
    run = swing(315)
    path = text(folder / "decay.csv", ["time [s],angle [deg]"], (run.time, run.signals["angle"] / DEG))
    return entry(
        path,
        run,
        "t=time [s]:s; angle=angle [deg]:deg",
        options={"input": "none"},
        said=("no command|--input none",),
    )


@log
def slow(folder: Path) -> Expected:
    """CSV, rows 5.5 s apart: too coarse for any motion, a static map.

    A rotor's command and its steady speed, with a dead zone of 34 us and a saturation.
    """
    rng = np.random.default_rng(316)
    told = np.round(rng.uniform(-400, 400, 400))
    acted = np.clip(np.sign(told) * np.maximum(np.abs(told) - 34, 0), -300, 300)
    speed = 0.5 * acted + 0.5 * rng.standard_normal(400)
    model = machine(folder, "us", "rad/s", "rad/s/us", 0.5)
    run = Run(model, "actuator_dead_zone", 5.5 * np.arange(400), {"command": told, "response": speed})
    path = text(folder / "map.csv", ["time [s],command [us],response [rad/s]"], (run.time, told, speed))
    return entry(
        path,
        run,
        "t=time [s]:s; command=command [us]:us; response=response [rad/s]:rad/s",
        said=(r"5\.5 s apart", "map"),
    )
