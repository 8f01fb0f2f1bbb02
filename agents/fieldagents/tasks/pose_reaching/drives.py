"""Paths taught by a human operator (section 5.4): recorded drives become the path memory's states.

A file of drives is an ordinary recording of the model ``pose_reaching`` (CSV or Parquet: ``t``, ``episode``,
``speed``, ``turn_rate``, ``x``, ``y``, ``heading``), so a robot's own log teaches as well.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldagents.agent import Agent
from fieldagents.tasks.pose_reaching.agents import memory_driver
from fieldagents.tasks.pose_reaching.path_memory.matrices import Floats
from fieldagents.tasks.pose_reaching.path_memory.memory import PathMemory, States
from fieldagents.tasks.pose_reaching.path_memory.reading import wrapped
from fieldgym.pose_reaching import PoseReachingSettings
from fieldgym.settings import read_settings
from fieldmodels.machines.pose_reaching.batch import commanded
from fieldmodels.machines.pose_reaching.model import PoseReaching
from fieldmodels.machines.pose_reaching.parameters import GOAL_HEADING, LOOSE
from fieldmodels.recording import Recording, RecordingError
from fieldmodels.recording.files import load_recording, save_recording

SLOWEST = 0.05
"""Mean speed of a tick below which it teaches nothing [m/s]: a memory of standing would stand for ever."""
SIGNALS = {"speed": "m/s", "turn_rate": "rad/s", "x": "m", "y": "m", "heading": "rad"}


class RecordedDrives:
    """The drives of a file, and the agent that they teach; see ``fieldagents.task.Drives``.

    Args:
        path: The file; without one there are no drives yet.
        settings: Of the environment.

    Raises:
        RecordingError: If the file is no recording of poses, or its rows do not fit the environment's tick.
    """

    def __init__(self, path: Path, settings: Mapping[str, Any]) -> None:
        self.path, self.settings = path, read_settings(settings, PoseReachingSettings)
        if path.suffix.lower() not in (".csv", ".parquet"):
            raise RecordingError(f"{path}: drives are kept in a file that ends in .csv or .parquet")
        self.recording = self._load() if path.exists() else None

    def _load(self) -> Recording:
        recording = load_recording(self.path, PoseReaching())
        if missing := [name for name in ("x", "y", "heading") if name not in recording]:
            raise RecordingError(f"{self.path}: a drive teaches by its pose; {', '.join(missing)} is missing")
        rows = self.settings.tick / recording.step
        if round(rows) < 1 or abs(rows - round(rows)) > 1e-6 * rows:
            raise RecordingError(
                f"{self.path}: rows are {recording.step:g} s apart, which does not divide the tick of "
                f"{self.settings.tick:g} s; set settings.tick: {recording.step:g}"
            )
        return recording

    def row(self, info: Mapping[str, Any], action: NDArray[Any]) -> dict[str, float]:
        """What is kept of an instant: the pose, and the command that follows."""
        own = self.settings
        speed, _, rate = commanded(action[None], own.max_speed, own.max_rate)[0]
        return dict(zip(SIGNALS, (float(v) for v in (speed, rate, *info["pose"])), strict=True))

    def add(self, rows: Sequence[Mapping[str, float]]) -> str:
        """Add a drive to the file, which is written whole, if it arrived."""
        values = {name: np.array([row[name] for row in rows]) for name in SIGNALS}
        poses = np.stack([values["x"], values["y"], values["heading"]], axis=1)
        if _arrival(poses) is None:
            return "not kept: the drive did not arrive"
        time, before = self.settings.tick * np.arange(len(rows), dtype=np.float64), self.recording
        drive = Recording(time=time, signals=values, units=SIGNALS, source=str(self.path))
        if before is not None:
            if abs(before.step - self.settings.tick) > 1e-6 * before.step:
                return f"not kept: {self.path} has rows {before.step:g} s apart, not {self.settings.tick:g} s"
            number = np.full(len(rows), before.episode[-1] + 1)
            drive = Recording(
                time=np.concatenate([before.time, time]),
                signals={name: np.concatenate([before[name], values[name]]) for name in SIGNALS},
                units=SIGNALS,
                episode=np.concatenate([before.episode, number]),
                source=str(self.path),
            )
        save_recording(drive, self.path)
        self.recording = drive
        return f"{self.path}: {len(drive.bounds)} drives"

    def states(self) -> States:
        """What is remembered of the drives that arrive; pauses are left out.

        Raises:
            RecordingError: If no drive arrives.
        """
        if self.recording is None:
            raise RecordingError(f"{self.path}: no such file; fieldgym watch pose_reaching --save makes it")
        poses = np.column_stack([self.recording[name] for name in ("x", "y", "heading")])
        tick, ahead = self.settings.tick, round(self.settings.tick / self.recording.step)
        drives = [poses[a:b] for a, b in self.recording.bounds]
        sideways = self.settings.drive == "omnidirectional"
        taught = [
            _remembered(drive[: end + 1], ahead, tick, number, sideways)
            for number, drive in enumerate(drives)
            if (end := _arrival(drive)) is not None
        ]
        if not sum(map(len, taught)):
            nearest = min(float(np.hypot(*drive[:, :2].T).min()) for drive in drives)
            raise RecordingError(
                f"{self.path}: none of {len(drives)} drives moves and arrives within {LOOSE.distance} m and "
                f"{math.degrees(LOOSE.angle):.0f} deg of the goal (the nearest comes to {nearest:.2f} m)"
            )
        return States(
            *(np.concatenate([getattr(t, name) for t in taught]) for name in States.__annotations__)
        )

    def agent(self) -> Agent:
        """The path memory as it works, taught by these drives."""
        states = self.states()
        made = memory_driver(self.settings, PathMemory(states), sideways=True)
        made.name = str(self.path)
        made.title = f"The path memory as it works, taught by {len(np.unique(states.path))} recorded drives"
        return made


def _arrival(poses: Floats) -> int | None:
    """The first pose that is near the goal; None if none is."""
    away = np.abs(wrapped(poses[:, 2] - GOAL_HEADING))
    near = (np.hypot(poses[:, 0], poses[:, 1]) < LOOSE.distance) & (away < LOOSE.angle)
    return int(np.argmax(near)) if near.any() else None


def _remembered(poses: Floats, ahead: int, tick: float, number: int, sideways: bool) -> States:
    """What a drive did in the tick after each of its poses, whatever was commanded."""
    at = np.arange(max(len(poses) - ahead, 0))
    way = poses[at + ahead] - poses[at]
    turn = wrapped(way[:, 2])
    # An arc is longer than its chord.
    speed = np.hypot(way[:, 0], way[:, 1]) / np.sinc(turn / (2 * math.pi)) / tick
    moves = speed >= SLOWEST
    direction = np.arctan2(way[:, 1], way[:, 0]) if sideways else poses[at, 2] + turn
    return States(
        poses=poses[at][moves],
        speed=speed[moves],
        rate=turn[moves] / tick,
        direction=direction[moves],
        path=np.full(int(moves.sum()), number),
    )
