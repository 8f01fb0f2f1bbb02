"""The excitation model: an arm's command in, what the vehicle's sensors measure out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fieldmodels.arrays import FloatArray
from fieldmodels.machines.excitation.declaration import EFFECTS, as_vehicles
from fieldmodels.machines.excitation.parameters import DAMPING, VEHICLE, Arm, preset
from fieldmodels.machines.excitation.sensor_effects import OUTPUTS
from fieldmodels.machines.excitation.simulation import Runs, simulate_runs
from fieldmodels.model import ForceDirection, Model, Signal
from fieldmodels.recording import Recording, RecordingError, Windows, uniform_windows

STEP = 0.0025
"""Longest integration step [s]: 5 ms err by an eighth of the accelerometer's noise, which passed for soil."""
RATE, ACCELERATION = "arm_rate", "arm_acceleration"
"""Derived columns: derivatives of the commanded angle [rad/s], [rad/s2]."""
WAYS = (
    ("along x", "N"), ("along y", "N"), ("along z", "N"), ("in pitch", "N m"), ("in roll", "N m"),
    ("in yaw", "N m"),
)  # fmt: skip
"""In which an unlisted force or torque may act on the vehicle."""
ARM, WAY, COLUMNS = len(WAYS), len(WAYS) + 1, len(WAYS) + 2
"""Errors of the arm's angle, and of its way since it rested (a gear without absolute zero), come last."""
SUSPENDED = ("time", "arm_angle", "deflection_x", "deflection_y", "deflection_z", "pitch", "roll", "yaw")
"""On which such a force may depend, and on their rates."""


def _column(column: int) -> tuple[float, ...]:
    return tuple(np.eye(COLUMNS)[column].tolist())


class ExcitationModel(Model):
    """A vehicle on its suspension, shaken by its arm, as a model for diagnosis.

    Each episode of a recording is one run: the vehicle stands level at rest with its arm at the first
    ``arm_angle`` [rad], then the arm turns about one axis, ``arm_axis`` (1, 2, 3: x forward to the right,
    y forward, z up; for 2 it stands upright, else it points forward). All sensors are zeroed at rest. Since
    the start is known, a run is predicted from there, and a window has no initial state of its own.

    Refitted are damping and stiffness, or all 22 unknowns. Mass, inertia and centre of gravity usually come
    from scales and drawings: with constants as in Table I the motion hardly shows the inertia.
    """

    name = "excitation"
    inputs_are_free = False
    inputs = (Signal("arm_angle", "rad", angle=True), Signal("arm_axis", "1"))
    outputs = (
        *(Signal(f"acceleration_{axis}", "m/s2", noise=0.02) for axis in ("x", "y", "z")),
        *(Signal(turn, "rad", noise=0.002, angle=True) for turn in ("pitch", "roll")),
        *(Signal(f"force_{axis}", "N", noise=0.05, optional=True) for axis in ("x", "y", "z")),
        *(Signal(f"torque_{axis}", "N m", noise=0.1, optional=True) for axis in ("x", "y", "z")),
    )
    unmeasured = (*(Signal(f"deflection_{axis}", "m") for axis in ("x", "y", "z")), Signal("yaw", "rad"))
    states = ()
    effects = EFFECTS
    disturbance_unit = "N"
    directions = (
        *(
            ForceDirection(f"suspension {way}", unit, _column(column), over=SUSPENDED)
            for column, (way, unit) in enumerate(WAYS)
        ),
        ForceDirection(
            "arm's angle", "rad", _column(ARM), over=("time", "arm_angle"), moves=True, input="arm_angle"
        ),
        ForceDirection("arm's way from rest", "rad", _column(WAY), over=("arm_angle",), moves=True),
    )
    lasting = 1.2
    horizons = (0.2, 0.4, 0.8)
    resolution = (*(1e-3,) * 3, *(4e-4,) * 8)  # of steps of 2.5 ms, found with steps of 0.6 ms: 7e-4 and 2e-4

    def __init__(self, vehicle: str = "soft", arm: Arm | None = None, refit_body: bool = False) -> None:
        """Take a preset's vehicle as the nominal one; ``refit_body`` also refits what a scale would tell."""
        self.arm = arm or Arm()
        self.parameters = tuple(
            replace(
                p,
                nominal=float(value),
                lower=-5.0 if p.lower < 0 else 0.0,
                upper=1e5 if i >= DAMPING else 100.0,
                scale=max(0.1 * abs(float(value)), 0.01),
                source="Table I" if vehicle == "table1" or i < DAMPING else "assumed",
                refitted=refit_body or i >= DAMPING,
            )
            for i, (p, value) in enumerate(zip(VEHICLE, preset(vehicle), strict=True))
        )

    def simulate(self, parameters: FloatArray, windows: Windows) -> FloatArray:
        """See ``Model.simulate``."""
        return self.simulate_all(parameters, windows)[..., :OUTPUTS]

    def simulate_all(self, parameters: FloatArray, windows: Windows) -> FloatArray:
        """Simulate every run from rest, and cut the windows out of it; see ``Model.simulate_all``."""
        recording = windows.recording if RATE in windows.recording else with_derivatives(windows.recording)
        vehicles = as_vehicles(np.atleast_2d(parameters))
        bounds = recording.bounds
        ends = windows.starts + windows.lengths
        # No run is simulated beyond its last window.
        last = [ends[(windows.starts >= a) & (windows.starts < b)].max(initial=a) for a, b in bounds]
        first = bounds[:, 0]
        motion = np.column_stack([recording[name] for name in ("arm_angle", RATE, ACCELERATION)])
        pushes = windows.pushed(COLUMNS)
        if len(pushes) and pushes[:, ARM:].any():
            moved = pushes[:, ARM] + pushes[:, WAY] - np.repeat(pushes[first, WAY], np.diff(bounds)[:, 0])
            motion += np.column_stack([moved, *derivatives(moved, bounds, recording.step)])
        runs = Runs(
            bounds=np.column_stack([first, np.array(last, dtype=np.int64)]),
            modes=np.rint(recording["arm_axis"][first]).astype(np.int64) - 1,
            times=recording.time[first],
            motion=motion,
            pushes=np.ascontiguousarray(pushes[:, :ARM]),
            arm=self.arm.row(),
            step=recording.step,
            substeps=max(1, round(recording.step / STEP)),
        )
        values = np.empty((len(vehicles), len(recording), OUTPUTS + len(self.unmeasured)))
        simulate_runs(vehicles, runs, values)
        rows = windows.starts[:, None] + np.arange(windows.samples)
        result = values[:, np.minimum(rows, len(recording) - 1)]
        result[:, np.arange(windows.samples) >= windows.lengths[:, None]] = np.nan
        return np.asarray(result)

    def initial_states(self, recording: Recording, starts: NDArray[np.int64]) -> FloatArray:
        """No states: every run starts at rest, shape (len(starts), 0)."""
        del recording
        return np.zeros((len(starts), 0))

    def windows(self, recording: Recording, horizon: float) -> Windows:
        """Cut every run into windows; see ``Model.windows``.

        Raises:
            RecordingError: If the axis is not 1, 2 or 3, or changes within an episode.
        """
        for a, b in recording.bounds:
            axis = recording["arm_axis"][a:b]
            if axis[0] not in (1, 2, 3) or np.ptp(axis) > 0:
                raise RecordingError(
                    f"{recording.source}: column 'arm_axis' must be 1, 2 or 3 (the arm turns about x, y, z) "
                    "throughout an episode; give each run an 'episode' number of its own"
                )
        return uniform_windows(
            with_derivatives(recording), horizon, [s.name for s in self.outputs], self.initial_states
        )

    def between(self, commands: FloatArray, refine: int) -> FloatArray:
        """The arm moves smoothly between samples; see ``Model.between``."""
        from scipy.interpolate import make_interp_spline  # slow to import

        count = len(commands)
        spline = make_interp_spline(np.arange(count), commands[:, 0], k=min(5, count - 1))
        fine = np.arange(count * refine) / refine
        return np.column_stack([spline(fine), np.repeat(commands[:, 1], refine)])

    def with_commands(self, recording: Recording, commands: Mapping[str, FloatArray]) -> Recording:
        """The same recording under other commands, with their derivatives; see ``Model.with_commands``."""
        return with_derivatives(super().with_commands(recording, commands))


def with_derivatives(recording: Recording) -> Recording:
    """Add the commanded angle's derivatives."""
    rate, acceleration = derivatives(recording["arm_angle"], recording.bounds, recording.step)
    return replace(
        recording,
        signals={**recording.signals, RATE: rate, ACCELERATION: acceleration},
        units={**recording.units, RATE: "rad/s", ACCELERATION: "rad/s2"},
    )


def derivatives(angle: FloatArray, bounds: NDArray[np.int64], step: float) -> tuple[FloatArray, FloatArray]:
    """First and second derivative of an angle, by a spline of fifth order through each run."""
    from scipy.interpolate import make_interp_spline

    rate, acceleration = np.zeros(len(angle)), np.zeros(len(angle))
    for a, b in bounds:
        if b - a < 2:
            continue
        grid = np.arange(b - a) * step
        spline = make_interp_spline(grid, angle[a:b], k=min(5, b - a - 1))
        rate[a:b], acceleration[a:b] = spline(grid, 1), spline(grid, 2)
    return rate, acceleration


def joined_runs(runs: Sequence[Recording], source: str) -> Recording:
    """Runs as the episodes of one recording."""
    return Recording(
        time=np.concatenate([run.time for run in runs]),
        signals={name: np.concatenate([run[name] for run in runs]) for name in runs[0].signals},
        units=runs[0].units,
        episode=np.repeat(np.arange(len(runs)), [len(run) for run in runs]),
        source=source,
    )
