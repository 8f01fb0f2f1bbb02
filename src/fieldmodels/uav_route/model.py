"""The UAV's model: commanded waypoints in, position and bank out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fieldmodels.model import FloatArray, Model, Parameter, Signal
from fieldmodels.recording import Recording, Windows
from fieldmodels.uav_route.effects import EFFECTS
from fieldmodels.uav_route.parameters import World, make_constants
from fieldmodels.uav_route.simulation import KM, PARAMETERS, simulate

IntArray = NDArray[np.int64]


class UavRoute(Model):
    """Flights of section 4.2.1 from waypoint to waypoint, as an aircraft would log them.

    Recordings hold, in SI units on a uniform time grid, the waypoint that is being flown to, ``to_north`` and
    ``to_east`` [m]; the position ``north`` and ``east`` [m] as a tracker measures it; and, where it is
    logged, the mean ``bank`` [rad] since the sample before, positive with the right wing down.
    """

    name = "uav_route"
    inputs = (Signal("to_north", "m"), Signal("to_east", "m"))
    outputs = (
        Signal("north", "m", noise=20.0),
        Signal("east", "m", noise=20.0),
        Signal("bank", "rad", noise=0.02, optional=True, angle=True, averaged=True),
    )
    states = (
        Signal("north", "m", noise=20.0),
        Signal("east", "m", noise=20.0),
        Signal("course_before", "rad", noise=0.005, angle=True),
    )
    effects = EFFECTS
    horizons = (40.0, 120.0, 300.0)
    disturbance_unit = "m/s"

    def __init__(self, world: World | None = None) -> None:
        """Declare the parameters for a world's aircraft."""
        self.world = world or World()
        self.parameters = (Parameter("speed", "m/s", KM * self.world.aircraft.speed, 50.0, 1000.0, 2.0),)
        self._constants = make_constants(self.world)
        assert len(self.names) == PARAMETERS

    def plant(self, vector: FloatArray) -> FloatArray:
        """A reality as ``Flights`` take it: shape (..., 7), from SI units to [km] and [km/s]."""
        plant: FloatArray = np.asarray(vector, dtype=np.float64) / np.array([KM, KM, KM, 1.0, 1.0, KM, KM])
        return plant

    def simulate(self, parameters: FloatArray, windows: Windows) -> FloatArray:
        """See ``Model.simulate``."""
        recording, force = windows.recording, windows.disturbance
        parameters = np.ascontiguousarray(np.atleast_2d(parameters), dtype=np.float64)
        counts = np.diff(recording.bounds, axis=1)[:, 0]
        waypoints = np.column_stack([recording["to_north"], recording["to_east"]]).astype(np.float64)
        out = np.full((len(parameters), len(windows), windows.samples, len(self.outputs)), np.nan)
        simulate(
            parameters,
            waypoints,
            _leg_starts(recording),
            np.repeat(recording.bounds[:, 0], counts),
            np.zeros(0) if force is None else np.ascontiguousarray(force, dtype=np.float64),
            recording.step,
            windows.starts,
            windows.lengths,
            np.ascontiguousarray(windows.states),
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
