"""What chapter 2 of the dissertation claims, in its order."""

from __future__ import annotations

from fieldagents.claim import Claim, Ours, at_most, near

ONE_OF_OURS = (0.025, 0.975)
"""A figure of one random walk is reproduced if its size is neither below nor above all but 2.5 % of ours."""

CLAIMS = (
    Claim(
        "ranger-in-barton-hall",
        ("Fig 2.1", "section 2.2"),
        "Ranger during its walk of 65 km.",
        because="a photograph",
    ),
    Claim(
        "gyro-noise",
        ("Fig 2.9", "section 2.4.3"),
        "Under gyro noise of 0.0051 rad/s alone the angle error of Ranger's estimator is 3e-4 rad.",
        "about 3e-4 rad",
        holds=ONE_OF_OURS,
        ours=Ours("figure-2.10", "share of walks with at most the printed error, gyro noise, 0.0051 rad/s"),
        remark="The figure shows one walk; ours are many of four strides.",
    ),
    Claim(
        "collision-noise",
        ("Fig 2.10", "section 2.4.3"),
        "Under collision noise of at most 0.5 rad/s alone the angle error goes up to 1e-3 rad.",
        "about 1e-3 rad",
        holds=ONE_OF_OURS,
        ours={
            "low-passed uniform draws": Ours(
                "figure-2.10",
                "share of walks with at most the printed error, collision noise 0.5 rad/s, low_pass",
            ),
            "amplitude 0.5 rad/s, correlation 0.995": Ours(
                "figure-2.10", "share of walks with at most the printed error, collision noise 0.5 rad/s, ar1"
            ),
        },
        depends_on="what has the amplitude of 0.5 rad/s",
        expected="depends",
        remark='"A maximum amplitude of 0.5 rad/s ... Each noise error value also has a 0.995 correlation '
        'with the previous value": noise of that amplitude gives errors many times those of the figure.',
    ),
    Claim(
        "best-decay",
        ("Fig 2.12", "section 2.5.1"),
        "Without noise the error is least at S_FD = 333 / s.",
        "around 333 / s",
        holds=near(333, 25),
        ours=Ours("figure-2.12", "best decay of the printed grid [1/s]"),
        remark="333 is 2 / (3 dt): a matter of the sampling rate.",
    ),
    Claim(
        "shallow-minimum",
        ("Fig 2.12", "section 2.5.1"),
        "The curve is shallow around S_FD = 333 / s, so that a range of values does as well.",
        "shallow nature of the curve",
        holds=at_most(2),
        ours=Ours("figure-2.12", "error 50 / s beside the best, over the least"),
        expected="refuted",
        remark="Shallow: one step of the grid beside the best at most doubles the error.",
    ),
)
