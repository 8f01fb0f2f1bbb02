"""Figs 2.3, 2.7, 2.8 and 2.11 of the dissertation, its numerical integration, and its numbers in the text.

What is integrated here is written out from the printed equations once more, apart from the kernels.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import Field
from scipy.integrate import solve_ivp
from scipy.special import ellipk

from fieldagents.progress import Report
from fieldmodels.arrays import FloatArray
from fieldmodels.html import AFTER, BEFORE, GREY, LINE
from fieldmodels.machines.heel_strike.parameters import SILENT, Leg
from fieldmodels.machines.heel_strike.strides import Strides
from fieldmodels.machines.heel_strike.walker import TRACES
from papers.claim import Statistic
from papers.heel_strike.sweeps import SOURCE
from papers.source import Reproduction, reproduces
from papers.statistics import exact, mean_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

G_OVER_L = 9.81
STEP = 0.002
BLUE, RED = AFTER, BEFORE
State = tuple[float, float]


@reproduces("figure-2.3", quick={"records": 4}, processor_s=(2, 1))
def figure_2_3(
    _progress: Report,
    *,
    records: Annotated[int, Field(ge=2, le=1000)] = 20,
    minutes: Annotated[float, Field(gt=0, le=1000)] = 105.0,
) -> Reproduction:
    """A gyro at rest."""
    from matplotlib.figure import Figure

    samples = int(minutes * 60 / STEP) // 300 * 300
    ratios, deviations = [], []
    for i in range(records):
        raw = np.random.default_rng([23, i]).normal(-0.0043, 0.0041, samples)
        mean = raw.reshape(-1, 300).mean(axis=1)
        ratios.append(np.ptp(raw) / np.ptp(mean))
        deviations.append(raw.std() / mean.std())
    figure = Figure(figsize=(9, 4.5), layout="constrained")
    for axes, values, title in zip(
        figure.subplots(2, 1, sharex=True, sharey=True),
        (raw, np.repeat(mean, 300)),
        ("raw", "600 ms"),
        strict=True,
    ):
        axes.plot(np.arange(samples)[::100] * STEP / 60, values[::100], color=BLUE, linewidth=0.3)
        axes.set(title=title, ylabel="rate [rad/s]")
    axes.set_xlabel("time [min]")
    table = pd.DataFrame(
        {"peak to peak, raw over averaged": ratios, "standard deviation, raw over averaged": deviations}
    )
    return Reproduction(
        SOURCE
        + "Fig 2.3: 105 minutes at 500 Hz, mean -0.0043 rad/s, here with noise of 0.0041 rad/s and no drift",
        table,
        {"figure-2.3": figure},
        statistics={
            "peak to peak, raw over averaged": mean_of(ratios),
            "standard deviation, raw over averaged": mean_of(deviations),
        },
    )


@reproduces("figure-2.8", processor_s=(1, 1))
def figures_2_7_2_8_and_2_11(_progress: Report) -> Reproduction:
    """A pendulum without noise (Figs 2.7, 2.8, 2.11, section 2.4.2)."""
    trace = _silent_trace((0.0, 0.0, 0.0, 0.0), strides=20)
    column = {name: trace[:, i] for i, name in enumerate(TRACES)}
    error = np.abs(column["theta_agent"] - column["theta"])[column["time"] <= 20]
    rate = column["omega"]
    strikes = np.flatnonzero(np.diff(np.sign(column["theta"])) != 0)
    rates, angles = zip(*map(_filter_alone, (0.0, 995.0, 1005.0)), strict=True)
    orders = {name: _order(method) for name, method in (("Euler", _euler), ("Euler-Cromer", _cromer))}
    statistics = {
        "rate at the strikes over the greatest rate": mean_of(np.abs(rate[strikes]) / np.abs(rate).max()),
        "strikes a period": exact(2 * _period() / (2 * float(np.diff(column["time"][strikes]).mean()))),
        "error of the model alone after 20 s [rad]": exact(float(error.max())),
        "error of the rate after 2 s, S_FD = 1005 [rad/s]": exact(float(rates[2][-1])),
        "error of the rate after 2 s, S_FD = 995 [rad/s]": exact(float(rates[1][-1])),
        "range of the output, S_FD = 0 [rad]": exact(float(np.ptp(angles[0]))),
        "error of RK4 after 20 s [rad]": exact(_rk4_error()),
        **{f"order of the energy's gain a cycle, {name}": exact(order) for name, order in orders.items()},
    }
    return Reproduction(
        SOURCE + "Figs 2.7, 2.8 and 2.11, sections 2.4.2 and 2.5.1",
        pd.DataFrame({"what": list(statistics), "ours": [one.value for one in statistics.values()]}),
        {"figures-2.7-2.8-2.11": _silent_figure(column, strikes)},
        statistics=statistics,
    )


def _silent_trace(gains: tuple[float, float, float, float], strides: int) -> FloatArray:
    """Samples of a walk without noise and push-off, shape (samples, columns of ``TRACES``)."""
    walker = Strides(1, Leg(push_off=0.0), SILENT)
    walker.seed(0, np.random.default_rng(0))
    parts = []
    for _ in range(strides):
        result = walker.advance(gains, traces=True)
        assert result.traces is not None
        parts.append(result.traces[0, : int(result.samples[0])])
    return np.concatenate(parts)


def _filter_alone(decay: float) -> tuple[FloatArray, FloatArray]:
    """Error of the rate by (2.15), and angle by (2.14b), over 2 s of the true rate, from an estimate of 0."""
    trace = _silent_trace((0.0, 0.0, 0.0, 0.0), strides=2)
    omega, theta, found = 0.0, 0.0, []
    for measured in trace[:, TRACES.index("omega")]:
        omega = (1 - decay * STEP) * omega + decay * STEP * measured
        theta += omega * STEP
        found.append((abs(omega - measured), theta))
    errors, angles = np.array(found).T
    return errors, angles


def _euler(state: State, step: float) -> State:
    """Eq (2.12)."""
    theta, omega = state
    return theta + omega * step, omega - G_OVER_L * math.sin(theta) * step


def _cromer(state: State, step: float) -> State:
    """Eq (2.13)."""
    theta, omega = state
    faster = omega - G_OVER_L * math.sin(theta) * step
    return theta + faster * step, faster


def _order(method: Callable[[State, float], State]) -> float:
    """Power of the step with which the energy grows over one cycle, from steps of T/1000 and T/2000."""
    gains = []
    for steps in (1000, 2000):
        state, step = (0.0, 1.0), _period() / steps
        for _ in range(steps):
            state = method(state, step)
        gains.append(abs(_energy(state) - _energy((0.0, 1.0))))
    return math.log2(gains[0] / gains[1])


def _energy(state: State) -> float:
    return 0.5 * state[1] ** 2 - G_OVER_L * math.cos(state[0])


def _period() -> float:
    """Period of the swing that passes the lowest point at 1 rad/s [s], by the elliptic integral."""
    return float(4 * ellipk(1 / (4 * G_OVER_L)) / math.sqrt(G_OVER_L))


def _rk4_error() -> float:
    """Largest difference within 20 s between the kernel's truth and an integration to 1e-13 [rad]."""
    trace = _silent_trace((0.0, 0.0, 0.0, 0.0), strides=20)
    time = trace[:, TRACES.index("time")]
    use = time <= 20
    leg = Leg()
    start = [0.0, leg.speed]

    def swing(_t: float, y: FloatArray) -> list[float]:
        return [y[1], -leg.gravity / leg.length * math.sin(y[0])]

    exactly = solve_ivp(swing, (0, 21), start, "DOP853", time[use], rtol=1e-13, atol=1e-15)
    return float(np.abs(trace[use, TRACES.index("theta")] - exactly.y[0]).max())


@reproduces("numbers", processor_s=(0.1, 0.1))
def numbers_in_the_text(_progress: Report) -> Reproduction:
    """Arithmetic in the text."""
    count = 2 * math.pi / 2**13
    statistics: dict[str, Statistic] = {
        "one count of the encoder [rad]": exact(count),
        "one count of the encoder [degrees]": exact(math.degrees(count)),
        "one count of the encoder times the step length [mm]": exact(350 * count),
        "3 mm over the step length [rad]": exact(0.003 / 0.35),
        "3e-4 rad times the step length [mm]": exact(3e-4 * 350),
        "greatest stable S_FD [1/s]": exact(2 / STEP),
        "greatest stable S_FD by |1 - S_FD| < 1 [1/s]": exact(2.0),
    }
    table = pd.DataFrame({"what": list(statistics), "ours": [one.value for one in statistics.values()]})
    return Reproduction(SOURCE + "sections 2.3.1, 2.3.2, 2.4.3, 2.5.1", table, statistics=statistics)


def _silent_figure(column: dict[str, FloatArray], strikes: NDArray[np.intp]) -> Figure:
    """Fig 2.7: swing and strikes; Fig 2.8: error of the model alone; Fig 2.11: the filter at its bounds."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 8), layout="constrained")
    panels = figure.subplots(4, 1)
    few = column["time"] <= 5
    for name, unit, colour in (("theta", "rad", BLUE), ("omega", "rad/s", GREY)):
        panels[0].plot(column["time"][few], column[name][few], color=colour, label=f"{name} [{unit}]")
    marks = strikes[column["time"][strikes] <= 5]
    panels[0].plot(column["time"][marks], column["omega"][marks], "ko", label="heel strikes")
    panels[1].plot(column["time"], column["theta_agent"] - column["theta"], color=RED)
    panels[2].plot(_filter_alone(0.0)[1], color=BLUE)
    panels[3].plot(_filter_alone(1005.0)[1], color=BLUE)
    titles = (
        "Fig 2.7",
        "Fig 2.8: error of the model alone [rad]",
        "Fig 2.11: S_FD = 0 [rad]",
        "S_FD = 1005 [rad]",
    )
    for axes, title in zip(panels, titles, strict=True):
        axes.set_title(title, loc="left", fontsize=10)
        axes.grid(color=LINE, linewidth=0.8)
    panels[0].legend(fontsize=8)
    return figure


BASICS = (figure_2_3, figures_2_7_2_8_and_2_11, numbers_in_the_text)
"""In the order of presentation."""
