"""What an estimator's error costs a gait: sections 2.2 and 2.3.3 of the dissertation.

The inverted pendulum of Fig 2.5: a point mass on massless legs. A push-off is an impulse along the trailing
leg; a heel strike takes away the speed along the leading leg. Between the two the mass flies; no leg pulls.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import Field
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from fieldagents.progress import Report
from fieldmodels.arrays import FloatArray
from fieldmodels.html import AFTER, AMBER, LINE
from fieldmodels.machines.heel_strike.parameters import Noise
from fieldmodels.machines.heel_strike.search import score_gains, stride_errors
from papers.claim import Statistic
from papers.heel_strike.sweeps import SOURCE, gain_sets, walked
from papers.source import Reproduction, reproduces
from papers.statistics import exact, mean_of

GRAVITY, LENGTH, STEP_LENGTH = 9.81, 1.0, 0.35
SPEED = STEP_LENGTH / 0.6
"""Ranger's mean speed: a step of 0.35 m in 600 ms (section 2.3.1), taken for that at mid-stance [m/s]."""
HALF = math.asin(STEP_LENGTH / (2 * LENGTH))
ENERGY = 0.5 * SPEED**2 + GRAVITY * LENGTH
LEADS = np.arange(-40, 61) * 1e-3
"""How long before the heel strike the push-off comes [s]; below 0 it comes afterwards."""


def step(lead: float, impulse: float) -> tuple[float, float]:
    """One step from mid-stance to the next stance.

    Args:
        lead: Time of the push-off before the heel strike that would come without it [s].
        impulse: Of the push-off, per mass [m/s].

    Returns:
        Energy per mass on the next leg, and work per mass of the push-off [J/kg].
    """
    front = np.array([STEP_LENGTH, 0.0])
    angle, rate = _swing(HALF, -math.sqrt(2 * (ENERGY - GRAVITY * math.cos(HALF))), max(lead, 0.0))
    leg = np.array([math.sin(angle), math.cos(angle)])
    position, velocity = leg, -rate * np.array([leg[1], -leg[0]])
    if lead < 0:
        velocity = _strike(position, velocity, front)
        turned, rate = _swing(-HALF, -float(velocity @ _along(position - front)), -lead)
        position = front + np.array([math.sin(turned), math.cos(turned)])
        leg = position / np.linalg.norm(position)
        velocity = -rate * _along(position - front)
    pushed = velocity + impulse * leg
    work = 0.5 * float(pushed @ pushed - velocity @ velocity)
    position, velocity = _fly(position, pushed, front)
    velocity = _strike(position, velocity, front)
    return 0.5 * float(velocity @ velocity) + GRAVITY * float(position[1]), work


def _swing(angle: float, rate: float, time: float) -> tuple[float, float]:
    """Inverted pendulum: forward from an angle if it lies behind the foot, back from one before it."""
    if time == 0:
        return angle, rate
    ahead = -time if angle > 0 else time

    def fall_over(_t: float, y: FloatArray) -> list[float]:
        return [-y[1], -GRAVITY / LENGTH * math.sin(y[0])]

    end = solve_ivp(fall_over, (0, ahead), [angle, rate], rtol=1e-10, atol=1e-12).y[:, -1]
    return float(end[0]), float(end[1])


def _along(leg: FloatArray) -> FloatArray:
    """Unit vector forward, across a leg."""
    return np.asarray(np.array([leg[1], -leg[0]]) / np.linalg.norm(leg))


def _strike(position: FloatArray, velocity: FloatArray, foot: FloatArray) -> FloatArray:
    """Velocity across the leading leg is all that a heel strike leaves."""
    across = _along(position - foot)
    return np.asarray(across * float(velocity @ across))


def _fly(position: FloatArray, velocity: FloatArray, foot: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Free flight until the leading leg, stretched to its length, meets the mass on its way down."""

    def gap(time: float) -> float:
        return float(np.hypot(*(at(time) - foot))) - LENGTH

    def at(time: float) -> FloatArray:
        return np.asarray(position + velocity * time - np.array([0.0, 0.5 * GRAVITY * time**2]))

    times = np.linspace(0, 0.5, 2001)
    gaps = np.array([gap(time) for time in times])
    below = np.flatnonzero((gaps[1:] <= 0) & (gaps[:-1] > 1e-12))
    if gaps[0] > 1e-9 or (gaps[1] > 0 and len(below)):
        landing = brentq(gap, times[below[0]], times[below[0] + 1])
        return at(landing), velocity - np.array([0.0, GRAVITY * landing])
    return position, velocity


def needed(lead: float) -> tuple[float, float]:
    """Impulse [m/s] and work [J/kg] of the push-off that keeps the energy from step to step."""
    impulse = brentq(lambda p: step(lead, p)[0] - ENERGY, 1e-4, 1.5, xtol=1e-10)
    return impulse, step(lead, impulse)[1]


def double_pendulum(share: float, time: FloatArray) -> FloatArray:
    """Rate of the stance leg [rad/s] with a swing leg at the hip, a share of all mass in its middle."""

    def rates(_t: float, y: FloatArray) -> list[float]:
        stance, swing, w1, w2 = y
        cosine, sine = math.cos(stance + swing), math.sin(stance + swing)
        middle = 0.5 * LENGTH
        matrix = np.array([[LENGTH, share * middle * cosine], [LENGTH * cosine, middle]])
        right = [
            share * middle * sine * w2**2 + GRAVITY * math.sin(stance),
            LENGTH * sine * w1**2 - GRAVITY * math.sin(swing),
        ]
        return [w1, w2, *np.linalg.solve(matrix, right)]

    behind = [-HALF, -HALF, math.sqrt(2 * (ENERGY - GRAVITY * LENGTH * math.cos(HALF))) / LENGTH, 0.0]
    return np.asarray(solve_ivp(rates, (0, time[-1]), behind, "DOP853", time, rtol=1e-10, atol=1e-12).y[2])


@reproduces("gait", quick={"strides": 600}, processor_s=(8, 5))
def gait(
    progress: Report,
    *,
    strides: Annotated[int, Field(ge=100, le=100_000)] = 3000,
    walks: Annotated[int, Field(ge=3, le=100)] = 12,
) -> Reproduction:
    """What an estimator's error costs a gait (section 2.3.3)."""
    from matplotlib.figure import Figure

    progress("push-off", 0.0)
    impulses, works = np.array([needed(lead) for lead in LEADS]).T
    best = int(works.argmin())
    late = float(works[LEADS < 0].min())
    early = 1e3 * LEADS[(works <= late) & (LEADS >= 0)]
    progress("estimators", 0.5)
    errors = _timing_errors(strides, walks)
    costs = {name: _expected(works, found) for name, found in errors.items()}
    ten = int(np.flatnonzero(np.isclose(LEADS, LEADS[best] + 0.01))[0])
    energies = [step(LEADS[k], impulses[best])[0] - GRAVITY * LENGTH for k in (best, ten)]
    time = np.linspace(0, 0.5, 101)
    single = double_pendulum(1e-9, time)
    statistics: dict[str, Statistic] = {
        "best lead of the push-off [ms]": exact(1e3 * LEADS[best]),
        "longest lead with less work than after the strike [ms]": exact(float(early.max())),
        "work after the strike over the least": exact(late / float(works[best])),
        "change of the next mid-stance's speed by 10 ms [%]": exact(
            100 * abs(1 - math.sqrt(max(energies[1], 0.0) / energies[0]))
        ),
        **{f"work over the least, {name}": mean_of(found / works[best]) for name, found in costs.items()},
        "work saved by the model [%]": mean_of(100 * (1 - costs["model-based"] / costs["sensor-based"])),
        **{
            f"change of the stance leg's rate by a leg of {share:.0%} of the mass [%]": exact(
                float(100 * np.abs(double_pendulum(share, time) / single - 1).max())
            )
            for share in (0.05, 0.2)
        },
    }
    figure = Figure(figsize=(7, 4), layout="constrained")
    axes = figure.subplots()
    axes.plot(1e3 * LEADS, works / works[best], color=AFTER)
    axes.axvspan(0, 20, color=AMBER, alpha=0.25, label="20 ms before the heel strike")
    axes.set(xlabel="push-off before the heel strike [ms]", ylabel="work over the least", ylim=(0, 12))
    axes.grid(color=LINE, linewidth=0.8)
    axes.legend()
    table = pd.DataFrame({"lead [ms]": 1e3 * LEADS, "impulse [m/s]": impulses, "work [J/kg]": works})
    return Reproduction(
        SOURCE + "sections 2.2 and 2.3.3: inverted pendulum, steps of 0.35 m in 0.6 s, impulsive push-off",
        table.iloc[::5],
        {"gait": figure},
        statistics=statistics,
    )


def _timing_errors(strides: int, walks: int) -> dict[str, FloatArray]:
    """Errors in the time of the strike [s], shape (walks, strides), of the best of each kind on 4 mm."""
    noise = Noise(process=0.2)
    tuned, tested = walked((33, 0), noise, strides), walked((33, 1), noise, 150, walks)
    sets = gain_sets(np.linspace(0, 1, 21), np.linspace(0, 1, 11), [1000 / 3])
    scores = score_gains(tuned, sets)
    alone = np.flatnonzero(sets[:, 0] == 1)
    chosen = sets[[int(alone[scores[alone].argmin()]), int(scores.argmin())]]
    rate = math.sqrt(2 * (ENERGY - GRAVITY * math.cos(HALF))) / LENGTH
    seconds = stride_errors(tested, chosen).reshape(2, walks, -1) / 350 / rate
    return {"sensor-based": seconds[0], "model-based": seconds[1]}


def _expected(works: FloatArray, errors: FloatArray) -> NDArray[np.float64]:
    """Mean work of each walk at the intended lead that is best under these errors, shape (walks,)."""
    leads = np.arange(0, 0.04, 0.001)
    means = np.array([np.interp(lead + errors, LEADS, works).mean(axis=1) for lead in leads])
    return np.asarray(means[means.mean(axis=1).argmin()])


GAIT = (gait,)
"""In the order of presentation."""
