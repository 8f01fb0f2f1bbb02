"""The UAV's model: commanded waypoints in; position, bank and a radar's scans out."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.machines.uav_route.declaration import EFFECTS, as_plants, base_parameters
from fieldmodels.machines.uav_route.parameters import World, kernel_world
from fieldmodels.machines.uav_route.simulation import Commands, simulate
from fieldmodels.model import ForceDirection, Model, Signal
from fieldmodels.recording import Recording, Windows, uniform_windows

IntArray = NDArray[np.int64]
DETECTED, GAP = "detected", "scan_gap"


class UavRoute(Model):
    """Flights of section 4.2.1 from waypoint to waypoint, as an aircraft would log them.

    Recordings hold, in SI units on a uniform time grid, the waypoint that is being flown to, ``to_north`` and
    ``to_east`` [m]; the position ``north`` and ``east`` [m] as a tracker measures it; and, where they are
    logged, the mean ``bank`` [rad] since the sample before, positive with the right wing down; and the scans
    of a radar at ``radar_north``, ``radar_east``: whether one since the sample before ``detected`` the
    aircraft, and ``scan_gap``, the time between it and the scan before [s], 0 without a scan. Without
    ``scan_gap`` every sample of ``detected`` that is a number is a scan.
    """

    name = "uav_route"
    inputs_are_free = False
    inputs = (Signal("to_north", "m"), Signal("to_east", "m"))
    outputs = (
        Signal("north", "m", noise=20.0),
        Signal("east", "m", noise=20.0),
        Signal("bank", "rad", noise=0.02, optional=True, angle=True, averaged=True),
        Signal("detected", "1", optional=True, event=True),
        Signal("scan_gap", "s", noise=0.1, optional=True),
    )
    states = (
        Signal("north", "m", noise=20.0),
        Signal("east", "m", noise=20.0),
        Signal("course_before", "rad", noise=0.005, angle=True),
    )
    effects = EFFECTS
    horizons = (40.0, 120.0, 300.0)
    disturbance_unit = "m/s"
    directions = (
        ForceDirection("speed along the course", "m/s", (1.0, 0.0, 0.0, 0.0)),
        ForceDirection("speed to the right", "m/s", (0.0, 1.0, 0.0, 0.0)),
        ForceDirection("wind to the north", "m/s", (0.0, 0.0, 1.0, 0.0)),
        ForceDirection("wind to the east", "m/s", (0.0, 0.0, 0.0, 1.0)),
    )

    def __init__(self, world: World | None = None) -> None:
        """Declare the parameters for a world's aircraft."""
        self.world = world or World()
        self.parameters = base_parameters(self.world.aircraft)
        self._constants = kernel_world(self.world)

    def plant(self, vector: FloatArray) -> NDArray[Any]:
        """Parameter vectors as ``Flights`` take them: records of dtype ``PLANT`` in [km] and [km/s]."""
        return as_plants(vector)

    def windows(self, recording: Recording, horizon: float) -> Windows:
        """See ``Model.windows``; what was not scanned, or was flown before the window, is not observed."""
        if GAP in recording:
            scanned = recording[GAP] > 0
            kept = {n: np.where(scanned, recording[n], np.nan) for n in (DETECTED, GAP) if n in recording}
            recording = replace(recording, signals={**recording.signals, **kept})
        windows = uniform_windows(recording, horizon, [s.name for s in self.outputs], self.initial_states)
        names = tuple(output.name for output in self.outputs)
        observed = windows.observed & np.isfinite(windows.measured(names))
        # The mean bank before a leg's first sample is that of the leg before, which a window does not know.
        begins = _leg_starts(recording)[windows.starts] == windows.starts
        observed[begins, 0, names.index("bank")] = False
        return replace(windows, observed=observed)

    def simulate(self, parameters: FloatArray, windows: Windows) -> FloatArray:
        """See ``Model.simulate``."""
        recording = windows.recording
        parameters = np.atleast_2d(parameters)
        counts = np.diff(recording.bounds, axis=1)[:, 0]
        waypoints = np.column_stack([recording["to_north"], recording["to_east"]]).astype(np.float64)
        out = np.full((len(parameters), len(windows), windows.samples, len(self.outputs)), np.nan)
        simulate(
            self.plant(parameters),
            Commands(
                waypoints=waypoints,
                begun=_leg_starts(recording),
                first=np.repeat(recording.bounds[:, 0], counts),
                force=windows.pushed(4),
                step=recording.step,
            ),
            windows.starts,
            windows.lengths,
            np.ascontiguousarray(windows.states),
            DETECTED in recording or GAP in recording,
            self._constants,
            out,
        )
        return out

    def initial_states(self, recording: Recording, starts: IntArray) -> FloatArray:
        """Position as measured, and the course of the leg before: from its first to its last position."""
        begun = _leg_starts(recording)
        this = begun[starts]
        last = np.maximum(this - 1, 0)
        before = begun[last]
        north, east = recording["north"], recording["east"]
        course = np.arctan2(east[this] - east[before], north[this] - north[before])
        return np.column_stack([north[starts], east[starts], course])


def _leg_starts(recording: Recording) -> IntArray:
    """The sample at which each sample's waypoint was commanded, shape (n,)."""
    change = np.zeros(len(recording), dtype=np.bool_)
    for name in ("to_north", "to_east"):
        change[1:] |= np.diff(recording[name]) != 0
    change[recording.bounds[:, 0]] = True
    rows: IntArray = np.maximum.accumulate(np.where(change, np.arange(len(recording)), 0))
    return rows
