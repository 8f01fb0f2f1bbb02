"""How large forces, motions, times and noise are on a bench: taken from its own data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.drivers.sizes import white_noise
from fieldmodels.effects import Sizes
from fieldmodels.recording import Recording

USUAL_PACE = 4.0  # times slower or faster than the nominal bench: from there on horizons follow
LEAST_STEPS = 10.0  # steps in the main horizon
LEAST_SHORT = 4.0  # steps in the shortest


@dataclass(frozen=True)
class Scales:
    """Typical sizes on one bench, from which fits take their steps and starts.

    Attributes:
        base: Estimates of the base parameters, in the model's order.
        force: Root mean square of the command [N or N m].
        high_forces: Sizes that 0.5, 3, 10 and 30 % of the commands exceed [N or N m].
        rate: Largest rate of the command from one sample to the next [N/s or N m/s].
        position: Root mean square of the position about its mean [m or rad].
        velocity: Root mean square of the velocity [m/s or rad/s].
        duration: Length of the longest recording [s].
        step: Sampling interval [s].
        position_noise: Standard deviation of the position sensor's white noise [m or rad].
        velocity_noise: The same of the velocity sensor [m/s or rad/s].
        frequencies: Where the force that the equation of motion leaves over has its peaks [Hz].
    """

    base: tuple[float, ...]
    force: float
    high_forces: tuple[float, ...]
    rate: float
    position: float
    velocity: float
    duration: float
    step: float
    position_noise: float
    velocity_noise: float
    frequencies: tuple[float, ...]

    @property
    def sizes(self) -> Sizes:
        """What stock effects need to know of them."""
        return Sizes(
            force=self.force,
            high_forces=self.high_forces,
            rate=self.rate,
            position=self.position,
            velocity=self.velocity,
            duration=self.duration,
            step=self.step,
            frequencies=self.frequencies,
        )


def measure_scales(
    recordings: Sequence[Recording],
    command: str,
    position: str,
    velocity: str,
    rotary: bool,
    damped: bool,
    nominal: Scales,
) -> Scales:
    """Measure a bench's scales.

    Args:
        recordings: The measured data.
        command: Name of the command.
        position: Name of the position.
        velocity: Name of the velocity, which recordings may lack.
        rotary: Under gravity, or on a spring.
        damped: Whether the nominal machine has viscous friction.
        nominal: Scales that hold where the data cannot tell.
    """
    force = np.concatenate([r[command] for r in recordings])
    shown = np.concatenate([r[position] - r[position].mean() for r in recordings])
    slopes = np.concatenate([_slopes(r, position) for r in recordings])
    rate = max(float(np.max(np.abs(np.diff(r[command])), initial=0.0)) / r.step for r in recordings)
    noise = float(np.median([white_noise(r[position]) for r in recordings]))
    with_velocity = [r for r in recordings if velocity in r]
    high = np.quantile(np.abs(force), [0.995, 0.97, 0.9, 0.7])
    base, frequencies = _regress(recordings, command, position, rotary, damped, noise, nominal)
    return Scales(
        base=base,
        force=float(np.sqrt(np.mean(force**2))) or nominal.force,
        high_forces=tuple(float(f) for f in high) if (high > 0).all() else nominal.high_forces,
        rate=rate or nominal.rate,
        position=float(np.sqrt(np.mean(shown**2))) or nominal.position,
        velocity=float(np.sqrt(np.mean(slopes**2))) or nominal.velocity,
        duration=max(len(r) * r.step for r in recordings),
        step=recordings[0].step,
        position_noise=noise or nominal.position_noise,
        velocity_noise=float(np.median([white_noise(r[velocity]) for r in with_velocity]))
        if with_velocity
        else nominal.velocity_noise,
        frequencies=frequencies,
    )


def horizons_for(horizons: tuple[float, ...], scales: Scales, nominal: Scales) -> tuple[float, ...]:
    """Prediction horizons [s] for a bench: the nominal ones, unless it is far slower or faster.

    A bench that moves in a hundredth of the time must be predicted over a hundredth of it; one that is
    sampled slowly, over enough samples.
    """
    pace = (scales.position / scales.velocity) / (nominal.position / nominal.velocity)
    factor = 1.0 if 1.0 / USUAL_PACE <= pace <= USUAL_PACE else pace
    main = horizons[min(1, len(horizons) - 1)]
    factor = max(factor, LEAST_STEPS * scales.step / main, LEAST_SHORT * scales.step / horizons[0])
    return tuple(float(f"{factor * h:.2g}") for h in horizons) if factor != 1.0 else horizons


def _slopes(recording: Recording, position: str) -> FloatArray:
    """Slopes of the position over about a fiftieth of the recording, at most 20 samples."""
    span = max(1, min(20, len(recording) // 50))
    inside = recording.episode[span:] == recording.episode[:-span]
    slopes = (recording[position][span:] - recording[position][:-span]) / (span * recording.step)
    return np.asarray(slopes[inside])


@dataclass(frozen=True)
class WeakForm:
    """The equation of motion under bump functions: ``columns @ parameters = forces``.

    Attributes:
        columns: Inertia, damping, restoring force, Coulomb friction, offset, shape (bumps, 5).
        forces: The command under each bump, shape (bumps,).
        times: Middle of each bump on the recording's clock [s], shape (bumps,).
        noise: Covariance of the columns for position noise of variance one, shape (5, 5).
    """

    columns: FloatArray
    forces: FloatArray
    times: FloatArray
    noise: FloatArray


def weak_form(recording: Recording, command: str, position: str, rotary: bool, span: float) -> WeakForm:
    """Multiply the equation of motion by bumps and integrate by parts.

    The bumps vanish with their slopes at both ends, so that no measured signal is differentiated:

        M int(b'' x) - c int(b' x) + k int(b x) = int(b F).

    Args:
        recording: The measured data.
        command: Name of the command.
        position: Name of the position.
        rotary: Under gravity, or on a spring.
        span: Length of a bump [s]; bumps overlap by half.
    """
    count = max(round(span / recording.step), 16)
    s = np.linspace(0.0, 1.0, count + 1)
    length = count * recording.step
    arch = s * (1.0 - s)
    bump = arch**5
    slope = 5.0 * arch**4 * (1.0 - 2.0 * s) / length
    curvature = 10.0 * arch**3 * (2.0 * (1.0 - 2.0 * s) ** 2 - arch) / length**2
    starts = np.concatenate([np.arange(a, b - count, max(count // 2, 1)) for a, b in recording.bounds])
    rows = starts[:, None] + np.arange(count + 1)[None, :]
    x = recording[position][rows]
    u = recording[command]
    held = 0.5 * (u[rows] + u[np.maximum(rows - 1, 0)])  # a held command acts half a sample later
    smooth = np.convolve(recording[position], np.full(9, 1 / 9), mode="same")
    sign = np.sign(np.gradient(smooth)) if len(smooth) > 9 else np.zeros_like(u)
    back = np.sin(x) if rotary else x
    columns = [x @ curvature, -(x @ slope), back @ bump, sign[rows] @ bump, np.full(len(starts), bump.sum())]
    weight = 1.0 / float(bump.sum())
    kernels = np.array([curvature, -slope, bump, 0.0 * bump, 0.0 * bump])
    return WeakForm(
        columns=np.column_stack(columns) * weight,
        forces=held @ bump * weight,
        times=(starts + 0.5 * count) * recording.step,
        noise=weight**2 * kernels @ kernels.T,
    )


def _regress(
    recordings: Sequence[Recording],
    command: str,
    position: str,
    rotary: bool,
    damped: bool,
    noise: float,
    nominal: Scales,
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Estimate the base parameters, and the frequencies at which a force is left over.

    An offset and a Coulomb column keep the commonest unmodelled forces out of the estimates.
    """
    forms = [
        weak_form(r, command, position, rotary, span)
        for r in recordings
        for span in (0.2, 0.4, 1.0)
        if (np.diff(r.bounds, axis=1) * r.step > span).all()
    ]
    columns = np.concatenate([form.columns for form in forms]) if forms else np.zeros((0, 5))
    if len(columns) < 10:
        return nominal.base, nominal.frequencies
    size = np.linalg.norm(columns, axis=0)
    size[size == 0] = 1.0
    # Noise in the columns would draw the estimates towards zero: its share of the normal matrix is
    # known, and is taken off (bias-compensated least squares).
    square = sum(
        form.columns.T @ form.columns - 0.9 * len(form.times) * noise**2 * form.noise for form in forms
    )
    right = sum(form.columns.T @ form.forces for form in forms)
    solution = np.linalg.lstsq(square / np.outer(size, size), right / size, rcond=1e-9)[0] / size
    chosen = solution[:3] if damped else solution[[0, 2]]
    base = tuple(
        float(c) if np.isfinite(c) and c > 0 else f for c, f in zip(chosen, nominal.base, strict=True)
    )
    finest = forms[0]
    return base, _peaks(finest.times, finest.forces - finest.columns @ solution)


def _peaks(times: FloatArray, left: FloatArray, count: int = 4) -> tuple[float, ...]:
    """Frequencies [Hz] of the highest separate peaks of a periodogram up to 8 Hz."""
    spacing = float(np.median(np.diff(times)))
    size = 4 * len(left)  # zero padding: a quarter of a spectral line
    grid = np.fft.rfftfreq(size, spacing)
    line = 1.0 / (len(left) * spacing)
    inside = (grid >= max(0.1, line)) & (grid <= 8.0)
    power = np.where(inside, np.abs(np.fft.rfft(left - left.mean(), size)), 0.0)
    found: list[float] = []
    for i in np.argsort(-power):
        if power[i] > 0.0 and all(abs(grid[i] - f) > 1.5 * line for f in found):
            found.append(float(grid[i]))
        if len(found) == count:
            break
    return tuple(found) or (1.0,)
