"""How large forces, motions, times and noise are on a bench: taken from its own data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fieldmodels.arrays import FloatArray
from fieldmodels.drivers.declaration import Hold
from fieldmodels.drivers.rates import centred, rate_size, rms, white_noise
from fieldmodels.effects import Sizes
from fieldmodels.recording import Recording

USUAL_PACE = 4.0  # times slower or faster than the nominal bench: from there on horizons follow
LEAST_STEPS = 10.0  # steps in the main horizon
LEAST_SHORT = 4.0  # steps in the shortest
LEAST_WINDOWS = 40  # of the main horizon, in what is fitted, before a slow bench has longer ones than usual
SPANS = 0.8, 1.6, 4.0  # lengths of bumps, in the time in which the position changes by its size
LEAST_SPAN = 16  # samples in a bump
MOST_SPANS = 10  # bumps of one length that a recording must hold
ANYWHERE = np.pi / np.sqrt(3.0)  # rad: the size of an angle that is anywhere in a turn
SHOWN = 1.6  # oscillations within a bump that it still lets through, about a third


@dataclass(frozen=True)
class Scales:
    """Typical sizes on one bench, from which fits take their steps and starts.

    Attributes:
        base: Estimates of the base parameters, in the model's order.
        force: Root mean square of the command [N or N m].
        high_forces: Sizes that 0.5, 3, 10 and 30 % of the commands exceed [N or N m].
        rate: Largest rate of the command from one sample to the next [N/s or N m/s].
        position: Root mean square of the position about its mean [m or rad]; of an axis under gravity no more
            than that of an angle anywhere in a turn, after which it is where it was.
        velocity: Root mean square of the velocity [m/s or rad/s].
        duration: Length of the longest recording [s].
        step: Sampling interval [s].
        position_noise: Standard deviation of the position sensor's white noise [m or rad].
        velocity_noise: The same of the velocity sensor [m/s or rad/s].
        frequencies: Where the force that the equation of motion leaves over has its peaks [Hz].
        recorded: Length of all recordings together, to fit and to test [s].
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
    recorded: float = 0.0

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
    hold: Hold = "held",
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
        hold: What the command does between samples.
    """
    force = np.concatenate([r[command] for r in recordings])
    size = rms(centred(recordings, position)) or nominal.position
    size = min(size, ANYWHERE) if rotary else size
    speed = rate_size(recordings, position) or nominal.velocity
    rate = max(float(np.max(np.abs(np.diff(r[command])), initial=0.0)) / r.step for r in recordings)
    noise = float(np.median([white_noise(r[position]) for r in recordings]))
    with_velocity = [r for r in recordings if velocity in r]
    high = np.quantile(np.abs(force), [0.995, 0.97, 0.9, 0.7])
    forms = _forms(recordings, command, position, rotary, hold, size / speed)
    base, frequencies = _regress(forms, damped, noise, nominal)
    if not force.any():  # as large as what accelerates it
        usual = base[0] * speed**2 / size
        force, high = np.array([usual]), usual * np.array([2.0, 1.7, 1.4, 1.0])
    return Scales(
        base=base,
        force=float(np.sqrt(np.mean(force**2))),
        high_forces=tuple(float(f) for f in high) if (high > 0).all() else nominal.high_forces,
        rate=rate or nominal.rate,
        position=size,
        velocity=speed,
        duration=max(len(r) * r.step for r in recordings),
        step=recordings[0].step,
        position_noise=noise or nominal.position_noise,
        velocity_noise=float(np.median([white_noise(r[velocity]) for r in with_velocity]))
        if with_velocity
        else nominal.velocity_noise,
        frequencies=frequencies,
        recorded=sum(len(r) * r.step for r in recordings),
    )


def horizons_for(horizons: tuple[float, ...], scales: Scales, nominal: Scales) -> tuple[float, ...]:
    """Prediction horizons [s] for a bench: the nominal ones, unless it is far slower or faster.

    A bench that moves in a hundredth of the time must be predicted over a hundredth of it; one that is
    sampled slowly, over enough samples. Of one that moves slowly, half of what was recorded must hold enough
    windows: few long ones tell nothing apart (a robot's joint that is led slowly for 40 s).
    """
    pace = (scales.position / scales.velocity) / (nominal.position / nominal.velocity)
    factor = 1.0 if 1.0 / USUAL_PACE <= pace <= USUAL_PACE else pace
    main = horizons[min(1, len(horizons) - 1)]
    factor = min(factor, max(0.5 * scales.recorded / (LEAST_WINDOWS * main), 1.0))
    factor = max(factor, LEAST_STEPS * scales.step / main, LEAST_SHORT * scales.step / horizons[0])
    return tuple(float(f"{factor * h:.2g}") for h in horizons) if factor != 1.0 else horizons


@dataclass(frozen=True)
class WeakForm:
    """The equation of motion under bump functions: ``columns @ parameters = forces``.

    Attributes:
        columns: Inertia, damping, restoring force, Coulomb friction, offset, shape (bumps, 5).
        forces: The command under each bump, shape (bumps,).
        times: Middle of each bump on the recording's clock [s], shape (bumps,).
        noise: Covariance of the columns for position noise of variance one, shape (5, 5).
        span: Length of a bump [s].
    """

    columns: FloatArray
    forces: FloatArray
    times: FloatArray
    noise: FloatArray
    span: float


def weak_form(
    recording: Recording, command: str, position: str, rotary: bool, hold: Hold, samples: int, pace: float
) -> WeakForm:
    """Multiply the equation of motion by bumps and integrate by parts.

    The bumps vanish with their slopes at both ends, so that no measured signal is differentiated:

        M int(b'' x) - c int(b' x) + k int(b x) = int(b F).

    Args:
        recording: The measured data.
        command: Name of the command.
        position: Name of the position.
        rotary: Under gravity, or on a spring.
        hold: What the command does between samples.
        samples: Length of a bump; bumps overlap by three quarters.
        pace: Time in which the position changes by its size [s].
    """
    s = np.linspace(0.0, 1.0, samples + 1)
    length = samples * recording.step
    arch = s * (1.0 - s)
    bump = arch**5
    slope = 5.0 * arch**4 * (1.0 - 2.0 * s) / length
    curvature = 10.0 * arch**3 * (2.0 * (1.0 - 2.0 * s) ** 2 - arch) / length**2
    starts = np.concatenate([np.arange(a, b - samples, samples // 4) for a, b in recording.bounds])
    x, u = recording[position], recording[command]
    if hold == "held":  # it acts half a sample later
        u = 0.5 * (u + u[np.maximum(np.arange(len(u)) - 1, 0)])
    sign = np.sign(np.gradient(_smooth(x, pace / recording.step)))
    kinds = ((x, curvature), (x, -slope), (np.sin(x) if rotary else x, bump), (sign, bump), (u, bump))
    columns = [np.correlate(values, kernel)[starts] for values, kernel in kinds]
    columns.insert(4, np.full(len(starts), bump.sum()))
    weight = 1.0 / float(bump.sum())
    kernels = np.array([curvature, -slope, bump, 0.0 * bump, 0.0 * bump])
    return WeakForm(
        columns=np.column_stack(columns[:5]) * weight,
        forces=columns[5] * weight,
        times=(starts + 0.5 * samples) * recording.step,
        noise=weight**2 * kernels @ kernels.T,
        span=length,
    )


def _smooth(values: FloatArray, pace: float) -> FloatArray:
    """A running mean over at most nine samples, and a third of the samples in which a signal changes."""
    width = 2 * int(np.clip(pace / 6.0, 0, 4)) + 1
    return np.asarray(np.convolve(values, np.full(width, 1.0 / width), mode="same"))


def _forms(
    recordings: Sequence[Recording], command: str, position: str, rotary: bool, hold: Hold, pace: float
) -> list[WeakForm]:
    """The equation of motion under bumps that suit the pace, the shortest first."""
    forms = []
    for r in recordings:
        least = min(np.diff(r.bounds, axis=1).min() - 1, len(r) // MOST_SPANS)
        lengths = {
            min(max(4 * round(share * pace / r.step / 4), LEAST_SPAN), least // 4 * 4) for share in SPANS
        }
        forms += [
            weak_form(r, command, position, rotary, hold, n, pace) for n in sorted(lengths) if n >= LEAST_SPAN
        ]
    return sorted(forms, key=lambda form: form.span)


def _regress(
    forms: Sequence[WeakForm], damped: bool, noise: float, nominal: Scales
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Estimate the base parameters, and the frequencies at which a force is left over.

    An offset and a Coulomb column keep the commonest unmodelled forces out of the estimates.
    """
    columns = np.concatenate([form.columns for form in forms]) if forms else np.zeros((0, 5))
    if len(columns) < 10:
        return nominal.base, nominal.frequencies
    size = np.linalg.norm(columns, axis=0)
    size[size == 0] = 1.0
    # Noise in the columns would draw the estimates towards zero: its share of the normal matrix is
    # known, and is taken off (bias-compensated least squares).
    square = np.sum(
        [form.columns.T @ form.columns - 0.9 * len(form.times) * noise**2 * form.noise for form in forms],
        axis=0,
    )
    right = sum(form.columns.T @ form.forces for form in forms)
    free = slice(None)
    solution = np.zeros(len(size))
    if not any(np.any(form.forces) for form in forms):  # without a command, for the nominal inertia
        free, solution[0] = slice(1, None), nominal.base[0]
        right = -square[:, 0] * solution[0]
    equations = (square / np.outer(size, size))[free, free]
    solution[free] = np.linalg.lstsq(equations, (right / size)[free], rcond=1e-9)[0] / size[free]
    chosen = solution[:3] if damped else solution[[0, 2]]
    base = tuple(
        float(c) if np.isfinite(c) and c > 0 else f for c, f in zip(chosen, nominal.base, strict=True)
    )
    finest = forms[0]
    return base, _peaks(finest.times, finest.forces - finest.columns @ solution, SHOWN / finest.span)


def _peaks(times: FloatArray, left: FloatArray, highest: float, count: int = 4) -> tuple[float, ...]:
    """Frequencies [Hz] of the highest separate peaks of a periodogram up to the highest."""
    spacing = float(np.median(np.diff(times)))
    size = 4 * len(left)  # zero padding: a quarter of a spectral line
    grid = np.fft.rfftfreq(size, spacing)
    line = 1.0 / (len(left) * spacing)
    inside = (grid >= 2.0 * line) & (grid <= highest)
    power = np.where(inside, np.abs(np.fft.rfft(left - left.mean(), size)), 0.0)
    found: list[float] = []
    for i in np.argsort(-power):
        if power[i] > 0.0 and all(abs(grid[i] - f) > 1.5 * line for f in found):
            found.append(float(grid[i]))
        if len(found) == count:
            break
    return tuple(found) or (1.0,)
