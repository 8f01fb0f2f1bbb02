"""Tables and figures of the excitation's source, redone.

Source: V. A. Sujan and S. Dubowsky, "An optimal information method for mobile manipulator dynamic parameter
identification", IEEE/ASME Trans. Mechatronics 8(2), 2003.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from fieldagents.progress import Report
from fieldagents.task import get_task
from fieldgym.excitation import ExcitationSettings
from fieldmodels.html import AFTER, BEFORE, GREY, LINE
from fieldmodels.machines.excitation.motion import DECISION
from fieldmodels.machines.excitation.parameters import NAMES, SOFT, TABLE1, VEHICLE
from papers.claim import Statistic
from papers.excitation.course import SOURCE, Course, Episodes, Floats, play
from papers.excitation.equations import EQUATIONS
from papers.source import Reproduction, reproduces
from papers.statistics import exact, mean_of, ratio_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PRINTED_CONSTANT = (
    "4.0", "0.12", "0.05", "0.12", "0.05", "0.07", "0.04", "0.03", "0.5", "-1.1", "142", "140", "22", "79",
    "105", "134", "1103", "1095", "390", "945", "1950", "2403",
)  # fmt: skip
PRINTED_VARIABLE = (
    "3.6", "0.14", "0.09", "0.18", "0.01", "0.04", "0.01", "0.01", "0.3", "0.1", "78", "76", "17", "195",
    "266", "334", "979", "1244", "375", "1934", "2394", "2892",
)  # fmt: skip
"""Table I as printed, in its order: the digits say how it was rounded."""
PRINTED_AVERAGE = (108.8, 18.9)

TABLE2_TRUE = {"inertia_x": 0.072, "cg_y": 0.054356, "cg_z": 0.036195, "damping_pitch": 1.5,
               "stiffness_pitch": 317.0}  # fmt: skip
TABLE2_PRINTED = (0.04, -0.07, -0.09, 7.5, 355.0)
"""The one column of estimates that survives in Table II; its averages are printed as 208.4 and 26.8."""

BLUE, RED = AFTER, BEFORE


def rounded(digits: str) -> tuple[float, float, float]:
    """A printed number, and the least and greatest that are rounded to it."""
    places = len(digits.partition(".")[2])
    half = 0.5 * 10.0**-places
    return float(digits), float(digits) - half, float(digits) + half


def printed_average(column: tuple[str, ...], rows: NDArray[np.bool_] | None = None) -> tuple[Floats, Floats]:
    """Average % error of a printed column over its nonzero rows: as printed, and its ends by rounding.

    Args:
        column: Of Table I.
        rows: Rows that count; None takes all that are not zero.

    Returns:
        Percent of each counted row, and the average with its least and greatest value.
    """
    use = (TABLE1 != 0) if rows is None else rows
    errors, least, most = [], [], []
    for text, true in zip(np.array(column)[use], TABLE1[use], strict=True):
        value, low, high = rounded(str(text))
        errors.append(abs(value - true) / abs(true))
        ends = (abs(low - true) / abs(true), abs(high - true) / abs(true))
        least.append(0.0 if low <= true <= high else min(ends))
        most.append(max(ends))
    averages = 100 * np.array([np.mean(errors), np.mean(least), np.mean(most)])
    return 100 * np.array(errors), averages


@reproduces("table-1", quick={"episodes": 60}, processor_s=(42, 14))
def table_1(
    progress: Report,
    *,
    episodes: Episodes = 200,
    limits: Literal["paper", "wide"] = "paper",
    noise: Literal["full_scale", "running_max"] = "full_scale",
    adaptive: str = "frozen_weight",
) -> Reproduction:
    """The 22 unknowns under constant and adaptive excitation (with Figs 7 to 10)."""
    settings = ExcitationSettings(limits=limits, noise=noise)
    agents = ("constant", adaptive)
    courses = {}
    for i, name in enumerate(agents):
        progress(name, i / len(agents))
        agent = get_task("excitation").agents[name].make({"limits": limits, "noise": noise})
        courses[name] = play(agent, settings, TABLE1.copy(), episodes)
    table = pd.DataFrame(
        {
            "parameter": NAMES,
            "unit": [p.unit for p in VEHICLE],
            "true": TABLE1,
            "printed constant": [float(v) for v in PRINTED_CONSTANT],
            "printed variable": [float(v) for v in PRINTED_VARIABLE],
            **{
                f"{name}, {kind} filter, {what}": value
                for name, course in courses.items()
                for kind, naive in (("naive", True), ("compensated", False))
                for what, value in (
                    ("first run", (course.naive if naive else course.mean)[-1, 0]),
                    ("|error| %", course.percent(naive)),
                )
            },
        }
    )
    averages = {column: np.nanmean(table[column]) for column in table.columns if column.endswith("%")}
    last = {"parameter": "average |error| %", "printed constant": PRINTED_AVERAGE[0],
            "printed variable": PRINTED_AVERAGE[1], **averages}  # fmt: skip
    table = pd.concat([table, pd.DataFrame([last])], ignore_index=True)
    remarks = _remarks_on_print()
    factors = [
        averages[f"constant, {kind} filter, |error| %"] / averages[f"{adaptive}, {kind} filter, |error| %"]
        for kind in ("naive", "compensated")
    ]
    remarks.append(
        f"Average error of constant over that of {adaptive}: printed "
        f"{PRINTED_AVERAGE[0] / PRINTED_AVERAGE[1]:.1f} times; ours {factors[0]:.1f} times with the filter "
        f"as published, {factors[1]:.1f} times with the compensated one."
    )
    return Reproduction(
        SOURCE + f"Table I and Figs 7 to 10; limits {limits}, noise {noise}, {episodes} runs",
        table,
        {
            "figures-7-8": motion_figure(courses),
            "figure-9": bits_figure(courses, "stiffness_pitch"),
            "figure-10": convergence_figure(courses, ("cg_z", "stiffness_pitch")),
        },
        tuple(remarks),
        _course_statistics(courses, ("cg_z", "stiffness_pitch"))
        | _printed_statistics()
        | _motion_statistics(courses),
    )


def _course_statistics(courses: dict[str, Course], shown: tuple[str, ...]) -> dict[str, Statistic]:
    """Average errors by both filters, and the errors and bits of the parameters that the figures show."""
    constant, adaptive = courses.values()
    statistics = {}
    for kind, naive in (("filter as published", True), ("compensated filter", False)):
        errors = [one.average(naive=naive) for one in (constant, adaptive)]
        statistics[f"average error, constant, {kind} [%]"] = mean_of(errors[0])
        statistics[f"average error, adaptive, {kind} [%]"] = mean_of(errors[1])
        statistics[f"average error, constant over adaptive, {kind}"] = ratio_of(*errors)
        for name in shown:
            k = NAMES.index(name)
            one = [
                np.abs((c.naive if naive else c.mean)[-1, :, k] - c.truth[k]) for c in (constant, adaptive)
            ]
            statistics[f"error of {name}, constant over adaptive, {kind}"] = ratio_of(*one)
    k = NAMES.index("stiffness_pitch")
    statistics["bits of stiffness_pitch, adaptive less constant"] = mean_of(
        adaptive.bits[-1, :, k] - constant.bits[-1, :, k]
    )
    return statistics


def _printed_statistics() -> dict[str, Statistic]:
    """Where Table I's printed averages stand between the least and the greatest that its digits allow."""
    statistics = {}
    columns = zip(
        ("constant", "variable"), (PRINTED_CONSTANT, PRINTED_VARIABLE), PRINTED_AVERAGE, strict=True
    )
    for title, column, average in columns:
        _, (_, low, high) = printed_average(column)
        statistics[f"place of the printed average within its rounding, {title}"] = exact(
            (average - low) / (high - low)
        )
    z = NAMES.index("damping_z")
    errors = [100 * abs(float(c[z]) - TABLE1[z]) / TABLE1[z] for c in (PRINTED_CONSTANT, PRINTED_VARIABLE)]
    statistics["printed error of damping z, constant over variable"] = exact(errors[0] / errors[1])
    return statistics


def _motion_statistics(courses: dict[str, Course]) -> dict[str, Statistic]:
    """The constant motion against eq (24), and the mean commands of the adaptive one."""
    constant, adaptive = courses.values()
    time = DECISION * len(constant.command) * np.arange(1, len(constant.angle) + 1) / len(constant.angle)
    printed = np.pi / 4 + 2 * np.pi / 9 * np.sin(np.pi / 2 * time)
    amplitude, frequency, offset = adaptive.command.mean(axis=0).T
    return {
        "constant motion less (24) [rad]": exact(float(np.abs(constant.angle - printed).max())),
        "mean amplitude of the adaptive motion [rad]": mean_of(np.abs(amplitude)),
        "mean frequency of the adaptive motion [rad/s]": mean_of(frequency),
        "mean offset of the adaptive motion [rad]": mean_of(offset),
    }


def _remarks_on_print() -> list[str]:
    """What is odd about Table I's own columns."""
    without = (TABLE1 != 0) & (np.array(NAMES) != "cg_z")
    remarks = []
    for title, column, claimed in (
        ("constant", PRINTED_CONSTANT, PRINTED_AVERAGE[0]),
        ("variable", PRINTED_VARIABLE, PRINTED_AVERAGE[1]),
    ):
        rows, (average, low, high) = printed_average(column)
        _, (rest, _, _) = printed_average(column, without)
        remarks.append(
            f"Printed column {title}: its 20 nonzero rows average {average:.1f} %, by rounding anything from "
            f"{low:.1f} to {high:.1f}; {claimed} is printed. Median {np.median(rows):.0f} %; without c.g. z "
            f"the average is {rest:.0f} %."
        )
    remarks.append("Damping z is wrong by about 94 % in both printed columns: no effect of the excitation.")
    return remarks


@reproduces("table-2", quick={"episodes": 60}, processor_s=(36, 12))
def table_2(
    progress: Report,
    *,
    episodes: Episodes = 200,
    limits: Literal["paper", "wide"] = "paper",
    adaptive: str = "frozen_weight",
) -> Reproduction:
    """Five unknowns without an accelerometer (with Figs 11 to 13)."""
    chosen: dict[str, Any] = {"limits": limits, "variant": "table2", "preset": "soft"}
    settings = ExcitationSettings(**chosen)
    vehicle = SOFT.copy()
    for name, value in TABLE2_TRUE.items():
        vehicle[NAMES.index(name)] = value
    courses = {}
    for i, name in enumerate(("constant", adaptive)):
        progress(name, i / 2)
        courses[name] = play(get_task("excitation").agents[name].make(chosen), settings, vehicle, episodes)
    index = [NAMES.index(name) for name in TABLE2_TRUE]
    true = vehicle[index]
    table = pd.DataFrame({"parameter": list(TABLE2_TRUE), "true": true, "printed": TABLE2_PRINTED})
    for name, course in courses.items():
        for kind, naive in (("naive", True), ("compensated", False)):
            table[f"{name}, {kind} filter, |error| %"] = course.percent(naive)[index]
    printed = 100 * np.abs(np.array(TABLE2_PRINTED) - true) / true
    averages = {column: table[column].mean() for column in table.columns[3:]}
    table["printed |error| %"] = printed
    last = {"parameter": "average |error| %", "printed |error| %": printed.mean(), **averages}
    return Reproduction(
        SOURCE + f"Table II and Figs 11 to 13; limits {limits}, {episodes} simulated runs",
        pd.concat([table, pd.DataFrame([last])], ignore_index=True),
        {
            "figures-11-12": motion_figure(courses),
            "figure-13": convergence_figure(courses, ("damping_pitch", "stiffness_pitch")),
        },
        (
            f"The one column of estimates that survives in print averages {printed.mean():.1f} %: it is that "
            "of the constant excitation (208.4 printed); that of the variable one (26.8) is lost.",
            "The source measured a real robot, whose other parameters it does not print; here they are those "
            "of the soft vehicle.",
        ),
        _course_statistics(courses, ("damping_pitch", "stiffness_pitch"))
        | {"average error of the printed column [%]": _printed_table2(true)},
    )


def _printed_table2(true: Floats) -> Statistic:
    """Average % error of the surviving column of Table II, with its ends by the rounding of its digits."""
    printed = np.array(TABLE2_PRINTED)
    half = 0.5 * np.array([0.01, 0.01, 0.01, 0.1, 1.0])
    value, spread = (100 * (one / true).mean() for one in (np.abs(printed - true), half))
    return Statistic(value, value - spread, value + spread)


def motion_figure(courses: dict[str, Course]) -> Figure:
    """The arm's angle over time, one panel an agent (Figs 7, 8, 11, 12)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 2.2 * len(courses)))
    panels = figure.subplots(len(courses), 1, sharex=True, sharey=True)
    for (name, course), axes in zip(courses.items(), panels, strict=True):
        duration = DECISION * (len(course.mean) - 1)
        time = duration * np.arange(1, len(course.angle) + 1) / len(course.angle)
        axes.plot(time, course.angle, color=BLUE, linewidth=1)
        axes.set_title(name, loc="left", fontsize=10)
        axes.set_ylabel("arm angle [rad]")
        axes.grid(color=LINE, linewidth=0.8)
    panels[-1].set_xlabel("time [s]")
    figure.tight_layout()
    return figure


def bits_figure(courses: dict[str, Course], parameter: str) -> Figure:
    """Information about one parameter over the decisions (Fig 9): each run, and their mean."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 3.6))
    axes = figure.subplots()
    for (name, course), colour in zip(courses.items(), (RED, BLUE), strict=True):
        bits = course.bits[:, :, NAMES.index(parameter)]
        time = DECISION * np.arange(len(bits))
        axes.plot(time, bits, color=colour, linewidth=0.4, alpha=0.25)
        axes.plot(time, bits.mean(axis=1), color=colour, linewidth=2, label=name)
    axes.set_xlabel("time [s]")
    axes.set_ylabel(f"information about {parameter} [bits]")
    axes.set_ylim(0, 10)
    axes.legend()
    axes.grid(color=LINE, linewidth=0.8)
    figure.tight_layout()
    return figure


def convergence_figure(courses: dict[str, Course], parameters: tuple[str, ...]) -> Figure:
    """Estimates over time (Figs 10, 13): of the compensated filter, and of the one as published."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 3.4 * len(parameters)))
    panels = figure.subplots(len(parameters), 2, sharex=True, squeeze=False)
    for parameter, pair in zip(parameters, panels, strict=True):
        k = NAMES.index(parameter)
        for axes, title in zip(pair, ("compensated filter", "naive filter, as published"), strict=True):
            for (name, course), colour in zip(courses.items(), (RED, BLUE), strict=True):
                values = (course.mean if title.startswith("comp") else course.naive)[:, :, k]
                low, middle, high = np.quantile(values, (0.1, 0.5, 0.9), axis=1)
                time = DECISION * np.arange(len(values))
                axes.fill_between(time, low, high, color=colour, alpha=0.15, linewidth=0)
                axes.plot(time, middle, color=colour, label=f"{name}: median, 80 % of the runs")
            truth = next(iter(courses.values())).truth[k]
            axes.axhline(truth, color=GREY, linestyle=":", label="true")
            # The prior lies far off: the axis shows where the runs end, and the true value.
            both = [c.mean if title.startswith("comp") else c.naive for c in courses.values()]
            ends = np.quantile([found[len(time) // 2 :, :, k] for found in both], (0.1, 0.9), axis=(1, 2))
            low, high = min(truth, ends.min()), max(truth, ends.max())
            axes.set_ylim(low - 0.5 * (high - low), high + 0.5 * (high - low))
            axes.set_title(title, loc="left", fontsize=10)
            axes.set_ylabel(f"{parameter} [{VEHICLE[k].unit}]")
            axes.grid(color=LINE, linewidth=0.8)
    panels[0][0].legend(fontsize=8)
    for axes in panels[-1]:
        axes.set_xlabel("time [s]")
    figure.tight_layout()
    return figure


FIGURES = (table_1, table_2, *EQUATIONS)
"""In the order of presentation."""
