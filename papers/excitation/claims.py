"""What the source of the excitation claims, in its order."""

from __future__ import annotations

import math

from papers.claim import Claim, Ours, at_least, at_most, near, times

FILTERS = ("filter as published", "compensated filter")
FILTER = "the filter"
ON_FILTERS = (
    "The published filter takes the noisy regressor A for exact and is biased by it; the compensated one "
    "subtracts that bias. "
)


def by_filter(run: str, statistic: str) -> dict[str, Ours]:
    """A number by the filter as published and by the one that allows for noise in A."""
    return {kind: Ours(run, statistic.format(kind=kind)) for kind in FILTERS}


METHOD = (
    Claim(
        "robot",
        ("Fig 1", "Fig 2", "Fig 3", "Fig 4", "Fig 6"),
        "The robot, its frames and force balances.",
        because="drawings and a photograph",
    ),
    Claim(
        "linear-in-the-unknowns",
        ("equation (4)", "section IV"),
        "The equations of motion (4) can be cast into A x = F, linear in the 22 unknowns.",
        "A x = F",
        at_most(1e-9),
        Ours("equations", "A x - F over the largest F"),
        remark="(3) is meant elementwise; rotational damping and stiffness have kg m2/s and kg m2/s2.",
    ),
    Claim(
        "all-observable",
        ("equation (8)", "section V-A"),
        "Three rotation modes give 18 equations a sample, enough for 22 unknowns: full rank.",
        "rank n",
        near(22, 0.5),
        Ours("equations", "rank of A"),
    ),
    Claim(
        "two-least-squares",
        ("Fig 5", "section IV"),
        "Pseudo-inverse and Kalman filter both result in the least-squares solution.",
        "both",
        at_most(1e-3),
        Ours("equations", "Kalman filter less pseudo-inverse, over the prior's deviations"),
        remark="A thousandth of the prior's deviation; noise in F alone, hardly any prior.",
    ),
    Claim(
        "information-is-positive",
        ("equation (11)", "equation (15)", "section V-B"),
        "The information of an estimate is at least 0.",
        "In >= 0",
        at_least(0),
        {
            reading: Ours("equations", f"information of an estimate known to 1 %, (15) {signs} [bits]")
            for reading, signs in (("(15) as printed", "as printed"), ("as (9)", "with minus signs"))
        },
        depends_on="the minus signs that (15) lacks beside (9)",
        expected="depends",
        remark='"H(x) = sum p log p" of (15a) and (15b) is negative; n stands both for bits and for states.',
    ),
    Claim(
        "ten-bits",
        ("section VII-A",),
        "With a sensor of n bits no estimate has more than n bits of information.",
        "10 bits",
        near(10, 1e-6),
        Ours("equations", "information of an exact estimate [bits]"),
    ),
    Claim(
        "cost-wants-information",
        ("equation (16)", "section VI"),
        "Reducing the cost (16) raises the information about every parameter.",
        "least where In = In max",
        at_least(0.99),
        {
            "as printed": Ours("equations", "In / In max at which the cost is least, (16) as printed"),
            "weights of the current estimate": Ours(
                "equations", "In / In max at which the cost is least, weights of the current estimate"
            ),
        },
        depends_on="whether the weights are held at the current estimate",
        expected="depends",
        remark="As printed, 1 - x + x^2, the cost is least at half of the bits and equal at none and all.",
    ),
    Claim(
        "problem-dependent-weightings",
        ("section VI",),
        'The cost "may be easily amended to include weightings that reflect the relative importance of the '
        'individual dynamic parameters or other weightings that may be problem dependent".',
        '"easily amended"',
        at_most(-0.5),
        {
            name: Ours("weightings", f"rank correlation of return and error, {name}")
            for name in ("bits of the inertia", "relative error")
        },
        depends_on="the weighting",
        remark="Here: a reward so weighted ranks motions by the error that they leave, rank correlation -0.5 "
        "or less under the source's limits, where unweighted bits do not do so reliably.",
    ),
)

SIMULATION = (
    Claim(
        "constant-motion",
        ("Fig 7", "equation (24)"),
        "The constant motion is pi/4 + 2 pi/9 sin(pi/2 t).",
        "(24)",
        at_most(1e-6),
        Ours("table-1", "constant motion less (24) [rad]"),
    ),
    Claim(
        "mean-motion",
        ("Fig 8", "equation (24)"),
        "The constant motion has the mean control parameters of the variable one: frequency pi/2 rad/s.",
        "pi/2 rad/s",
        near(math.pi / 2, 0.3),
        Ours("table-1", "mean frequency of the adaptive motion [rad/s]"),
        remark="Under the source's limits, as we read them: at most 3 rad/s and 5 rad/s2.",
    ),
    Claim(
        "more-bits",
        ("Fig 9",),
        "The variable motion gives more information about the stiffness in pitch.",
        "more",
        at_least(0),
        Ours("table-1", "bits of stiffness_pitch, adaptive less constant"),
    ),
    *(
        Claim(
            f"convergence-{name.replace('_', '-')}",
            ("Fig 10",),
            f"The variable motion estimates {title} more accurately.",
            "more accurate",
            at_least(1),
            by_filter("table-1", f"error of {name}, constant over adaptive, {{kind}}"),
            depends_on=FILTER,
        )
        for name, title in (("cg_z", "c.g. z"), ("stiffness_pitch", "the stiffness in pitch"))
    ),
    Claim(
        "table-1-constant",
        ("Table I",),
        "The constant motion leaves an average error of 108.8 %.",
        "108.8 %",
        times(108.8, 2),
        by_filter("table-1", "average error, constant, {kind} [%]"),
        depends_on=FILTER,
        expected="depends",
        remark=ON_FILTERS
        + "Within a factor of two: the source prints one run, with unstated frames and priors.",
    ),
    Claim(
        "table-1-variable",
        ("Table I",),
        "The variable motion leaves an average error of 18.9 %.",
        "18.9 %",
        times(18.9, 2),
        by_filter("table-1", "average error, adaptive, {kind} [%]"),
        depends_on=FILTER,
        remark="Within a factor of two, as above.",
    ),
    Claim(
        "table-1-factor",
        ("Table I", "section VII-A"),
        "The variable motion improves the average error by almost a factor of six.",
        '"almost a factor of six"',
        times(108.8 / 18.9, 1.5),
        by_filter("table-1", "average error, constant over adaptive, {kind}"),
        depends_on=FILTER,
        expected="depends",
        remark=ON_FILTERS + "So most of the factor is the filter's bias under the slow constant motion.",
    ),
    *(
        Claim(
            f"table-1-arithmetic-{title}",
            ("Table I",),
            f"The average of the printed column ({title}) is {average} %.",
            f"{average} %",
            (0, 1),
            Ours("table-1", f"place of the printed average within its rounding, {title}"),
            remark="0 and 1: the least and the greatest average that the printed digits can be rounded from.",
        )
        for title, average in (("constant", 108.8), ("variable", 18.9))
    ),
    Claim(
        "damping-z",
        ("Table I",),
        "The variable motion improves the estimate of the damping z.",
        "22 and 17 for 300",
        at_least(1.1),
        Ours("table-1", "printed error of damping z, constant over variable"),
        expected="refuted",
        remark="By the source's own digits: about 93 and 94 % wrong.",
    ),
    Claim(
        "processor-time",
        ("section VII-A",),
        "An evaluation step takes 75 ms on a Pentium III of 750 MHz.",
        because="a time on their computer",
    ),
    Claim(
        "order-of-magnitude-faster",
        ("section VII-A",),
        "Under the information metric the estimates converge an order of magnitude faster than under the "
        "condition number.",
        '"an order of magnitude"',
        at_least(5),
        Ours("condition-number", "decisions by the condition number over those by information"),
        expected="refuted",
        remark="Five times at least. Decisions until the error is below twice what the condition number ends "
        "with.",
    ),
    Claim(
        "similar-in-the-end",
        ("section VII-A",),
        "In the end both metrics give similar results.",
        '"convergence results are similar"',
        times(1, 1.5),
        Ours("condition-number", "error by the condition number over that by information"),
    ),
)

EXPERIMENT = (
    Claim(
        "experiment-motions",
        ("Fig 11", "Fig 12"),
        "The arm's angle in the two experiments.",
        because="recordings of their robot without numbers; `excitation/table-2` draws ours",
    ),
    Claim(
        "table-2-arithmetic",
        ("Table II",),
        "The surviving column of estimates averages 208.4 %.",
        "208.4 %",
        near(208.4, 10),
        Ours("table-2", "average error of the printed column [%]"),
        remark="So it is that of the constant motion; its digits allow 201 to 213 %.",
    ),
    Claim(
        "table-2-variable",
        ("Table II",),
        "The estimates of the variable motion.",
        because="their column is lost in print; the average, 26.8 %, cannot be computed again",
    ),
    Claim(
        "table-2-factor",
        ("Table II", "section VII-B"),
        "The variable motion improves the average error by almost a factor of eight.",
        '"almost a factor of 8"',
        times(208.4 / 26.8, 1.5),
        by_filter("table-2", "average error, constant over adaptive, {kind}"),
        depends_on=FILTER,
        expected="depends",
        remark=ON_FILTERS + "Simulated: the true values of Table II on a vehicle that is otherwise soft.",
    ),
    *(
        Claim(
            f"experiment-convergence-{name.replace('_', '-')}",
            ("Fig 13",),
            f"The variable motion estimates {title} more accurately.",
            "more accurate",
            at_least(1),
            by_filter("table-2", f"error of {name}, constant over adaptive, {{kind}}"),
            depends_on=FILTER,
        )
        for name, title in (
            ("damping_pitch", "the damping in pitch"),
            ("stiffness_pitch", "the stiffness in pitch"),
        )
    ),
)

CLAIMS = (*METHOD, *SIMULATION, *EXPERIMENT)
