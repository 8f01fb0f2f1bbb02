"""What the one-axis benches share: scales from the data, and stages where the force is measured, too."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar, Self

import numpy as np

from fieldmodels.arrays import FloatArray, IntArray
from fieldmodels.effects import Names, Sizes, Stock
from fieldmodels.machine import Machine
from fieldmodels.machines.one_axis.drive import Drive
from fieldmodels.machines.one_axis.scales import Scales, horizons_for, measure_scales
from fieldmodels.model import Effect, Signal, Stage
from fieldmodels.recording import Recording

DRIVE = ("actuator", "change")
"""Where effects act between the command and the force."""
LATEST = 50  # steps by which a measured force is looked for behind its command


class OneAxis(Machine):
    """An axis with one input and a measured position, optionally also a measured velocity.

    A recording may have both the command and the force that was measured (``force_measured``). Then each
    stage is predicted from what was measured before it: the force from the command, the motion from the
    measured force. So a fault of the drive does not hide one of the axis, nor the other way round.

    Effects that these data cannot tell from what is there are left out: a bias of the actuator (the same
    equation as a constant force, whose cause names both), for the rig a bias of the position sensor (a
    constant force on the spring) and viscous friction (its damping), and dry friction that differs by
    direction (Coulomb friction with a constant force, sliding and at rest: ``F_+`` and ``F_-`` are ``F_c`` +-
    ``F_0``).

    Attributes:
        nominal_scales: Scales of the nominal bench.
        rotary: Whether it hangs under gravity, instead of a spring.
        damped: Whether viscous friction is part of the nominal axis.
        scales: Scales of this bench.
    """

    nominal_scales: ClassVar[Scales]
    rotary: ClassVar[bool]
    damped: ClassVar[bool]

    def __init__(self, scales: Scales | None = None, driven_by_measured: bool = False) -> None:
        """Declare parameters, effects and outputs for a bench.

        Args:
            scales: Scales of the bench; by default the nominal ones.
            driven_by_measured: True to predict the motion from the measured force.
        """
        self.scales = scales or self.nominal_scales
        self.scale_parameter = self.numbers[0].name
        self.command = self.inputs[0].name
        self.measured_inputs = (measured_counterpart(self.inputs[0]),)
        self.driven_by_measured = driven_by_measured
        if driven_by_measured:
            self.inputs = self.measured_inputs
            self.inputs_are_free = False
        stock = [e for e in type(self).own_effects if isinstance(e, Stock)]
        self.own_effects = tuple(self._own(e) for e in type(self).own_effects)
        super().__init__([self._sizes(e) for e in stock])
        if scales is not None:
            self.parameters = tuple(
                replace(p, starts=(value,), scale=0.1 * value)
                for p, value in zip(self.parameters, scales.base, strict=True)
            )
            self.horizons = horizons_for(self.horizons, scales, self.nominal_scales)
            noise = (scales.position_noise, scales.velocity_noise)
            self.outputs = tuple(replace(s, noise=n) for s, n in zip(self.outputs, noise, strict=True))

    def _sizes(self, e: Stock) -> Sizes:
        """Sizes for a stock effect; those of the velocity's sensor are of the velocity."""
        sizes = replace(self.scales.sizes, measured=self.scales is not self.nominal_scales)
        of_velocity = e.place == "sensor" and e.signal == self.outputs[1].name
        return replace(sizes, position=sizes.velocity) if of_velocity else sizes

    def _own(self, e: Effect | Stock) -> Effect | Stock:
        """An effect as this bench has it: on its present input, or with steps of its scales."""
        if isinstance(e, Stock):
            return replace(e, signal=self.inputs[0].name) if e.place == "actuator" else e
        return self.suited(e)

    def suited(self, effect: Effect) -> Effect:
        """One of the bench's own effects with steps and starts that suit its scales."""
        return effect

    def names_of(self, e: Stock) -> Names:
        """Names and units of what a stock effect acts on: the force's own name for an input, too."""
        names = super().names_of(e)
        return replace(names, force=self.forces[0].name) if e.place == "actuator" else names

    def speeds(self) -> list[float]:
        """The usual speed of the axis."""
        return [self.scales.velocity]

    def scaled_to(self, recordings: Sequence[Recording]) -> Self:
        """Suit scales, starts and sensor noise to the data; see ``Model.scaled_to``."""
        position, velocity = (signal.name for signal in self.outputs)
        scales = measure_scales(
            recordings,
            self.inputs[0].name,
            position,
            velocity,
            self.rotary,
            self.damped,
            self.nominal_scales,
            self.hold,
        )
        result = type(self)(scales, self.driven_by_measured)
        result.hold = self.hold
        return result

    def stages(self, recordings: Sequence[Recording]) -> tuple[Stage, ...]:
        """Measured force to motion and command to measured force, where it is measured; else the whole."""
        names = [self.command, *(s.name for s in self.measured_inputs)]
        if self.driven_by_measured or len(names) < 2 or not all(n in r for r in recordings for n in names):
            return super().stages(recordings)
        drive = tuple(e.name for e in self.effects if e.where in DRIVE)
        motion = tuple(e.name for e in self.effects if e.where not in DRIVE)
        motor = type(self)(self.scales, True)
        motor.hold = self.hold
        return Stage(motor, motion), Stage(Drive(self), drive)

    def commands(self, recording: Recording, last: IntArray) -> FloatArray:
        """What is held over each step: the command, or what was measured of it, shape (n, 1)."""
        held = recording[self.inputs[0].name]
        if self.driven_by_measured and self.command in recording:  # a planned one has the force alone
            held = between(recording[self.command], held, last)
        return np.ascontiguousarray(held, dtype=np.float64)[:, None]


def between(command: FloatArray, measured: FloatArray, last: IntArray) -> FloatArray:
    """Mean over each step of a force that is measured at its start, right after the command.

    What jumps as the command does, at once or some steps late, holds over the step; what follows slowly is
    halfway to the next sample. How much jumps, the samples tell: the share of the command's jumps that the
    force shows in one row, in that row of the next ``LATEST`` in which it shows most.

    Args:
        command: Commanded force, shape (n,).
        measured: Measured force, shape (n,).
        last: Last sample of each sample's episode, shape (n,).

    Returns:
        Force to hold over each step, shape (n,).
    """
    rows = np.arange(len(command))
    after = np.minimum(rows + 1, last)
    given, seen = command[after] - command, measured[after] - measured
    jumps, found = np.diff(given), np.diff(seen)  # small where both move smoothly
    power = float(jumps @ jumps)
    if power == 0.0:
        return measured
    count = len(jumps)
    shares = [float(jumps[: count - k] @ found[k:]) / power for k in range(min(LATEST, count))]
    late = int(np.argmax(shares))
    share = min(max(shares[late], 0.0), 1.0)
    return np.asarray(measured + 0.5 * (seen - share * np.r_[np.zeros(late), given[: len(given) - late]]))


def measured_counterpart(signal: Signal) -> Signal:
    """The measured counterpart of a command: ``force_measured`` beside ``force``."""
    return replace(signal, name=f"{signal.name}_measured", optional=True)
