"""What chapter 2 of the dissertation claims, mostly in its order."""

from __future__ import annotations

from papers.claim import Claim, Ours, at_least, at_most, near, times

ONE_OF_OURS = (0.025, 0.975)
"""A figure of one random walk is reproduced if its size is not beyond all but 2.5 % of ours at an end."""

ESTIMATE, ADDED = "error of the estimate", "floor added to the error"
SCORE = "the score"
WORDS_OF_THE_SCORE = (
    "\"This height error is converted into the equivalent theta value ... and is added to estimators' error "
    "at heel-strike\": to the geometry's angle, or to the error that is scored. "
)


def by_score(run: str, statistic: str) -> dict[str, Ours]:
    """A number under both readings of section 2.4.5."""
    return {score: Ours(run, statistic.format(score=score)) for score in (ESTIMATE, ADDED)}


SETTING = (
    Claim(
        "ranger",
        ("Fig 2.1", "Fig 2.2", "section 2.2"),
        "Ranger during its walk of 65 km; its motors and sensors.",
        because="photographs",
    ),
    Claim(
        "gyro-average",
        ("Fig 2.3", "section 2.3.1"),
        "Averaging over 600 ms reduces the peak to peak of the gyro's noise to about 1/17 = 1/sqrt(300).",
        "about 17",
        times(17.3, 1.5),
        Ours("figure-2.3", "peak to peak, raw over averaged"),
        remark="The standard deviation falls by 17.3; the peaks of 10 500 averages lie lower than those of "
        'three million samples. The "variance of 0.0041 rad/s" has the unit of a standard deviation.',
    ),
    Claim(
        "encoder-angle",
        ("section 2.3.1",),
        "One of 2^13 counts of an encoder is 0.00077 rad.",
        "0.00077 rad, 0.044 degrees",
        near(0.00077, 0.000005),
        Ours("numbers", "one count of the encoder [rad]"),
    ),
    Claim(
        "encoder-height",
        ("section 2.3.1",),
        "After the leg's geometry that is about 0.15 mm of foot height, by the step length of 0.35 m.",
        "about 0.15 mm",
        near(0.15, 0.05),
        Ours("numbers", "one count of the encoder times the step length [mm]"),
        expected="refuted",
        remark="0.00077 x 350 mm = 0.27 mm.",
    ),
    Claim(
        "three-millimetres",
        ("section 2.3.2",),
        "An error of 3 mm in foot height is about 0.009 rad.",
        "0.009 rad",
        near(0.009, 0.0005),
        Ours("numbers", "3 mm over the step length [rad]"),
        remark="0.35 m is the step length here and called the leg length in section 2.4.5.",
    ),
    Claim(
        "schematics",
        ("Fig 2.4", "Fig 2.5", "Fig 2.6"),
        "Angles of Ranger, the inverted pendulum and its proxy.",
        because="drawings",
    ),
    Claim(
        "strikes",
        ("Fig 2.7", "section 2.3.5"),
        "The pendulum passes the lowest point twice a period, where its rate is greatest.",
        "twice; maximum or minimum",
        near(1, 0.01),
        Ours("figure-2.8", "rate at the strikes over the greatest rate"),
    ),
    Claim(
        "truth",
        ("section 2.4.2",),
        "RK4 at 2 ms errs by about 1e-9 against an accurate integration.",
        "about 1e-9",
        at_most(1e-9),
        Ours("figure-2.8", "error of RK4 after 20 s [rad]"),
        remark="Over 20 s; the source names no time.",
    ),
    Claim(
        "euler-energy",
        ("section 2.4.2", "equation (2.12)"),
        "Over one cycle Euler's energy grows in proportion to the step.",
        "order 1",
        near(1, 0.1),
        Ours("figure-2.8", "order of the energy's gain a cycle, Euler"),
    ),
    Claim(
        "cromer-energy",
        ("section 2.4.2", "equation (2.13)"),
        "Over one cycle Euler-Cromer's energy grows in proportion to the step cubed.",
        "order 3",
        near(3, 0.1),
        Ours("figure-2.8", "order of the energy's gain a cycle, Euler-Cromer"),
    ),
    Claim(
        "model-alone",
        ("Fig 2.8", "section 2.4.2", "equation (2.14)"),
        "Without noise the model alone stays within 1e-4 rad for 20 s.",
        "less than 1e-4",
        at_most(1e-4),
        Ours("figure-2.8", "error of the model alone after 20 s [rad]"),
        remark="From theta = 0, just after a strike.",
    ),
    Claim(
        "gyro-noise",
        ("Fig 2.9", "section 2.4.3", "equation (2.2)", "equation (2.3)"),
        "Under gyro noise of 0.0051 rad/s alone the angle error of Ranger's estimator is 3e-4 rad.",
        "about 3e-4 rad",
        ONE_OF_OURS,
        Ours("figure-2.10", "share of walks with at most the printed error, gyro noise, 0.0051 rad/s"),
        remark="The figure shows one walk; ours are many of four strides.",
    ),
    Claim(
        "gyro-noise-height",
        ("Fig 2.9",),
        "3e-4 rad is about 0.1 mm of foot height.",
        "about 0.1 mm",
        near(0.1, 0.05),
        Ours("numbers", "3e-4 rad times the step length [mm]"),
    ),
    Claim(
        "collision-noise",
        ("Fig 2.10", "section 2.4.3"),
        "Under collision noise of at most 0.5 rad/s alone the angle error goes up to 1e-3 rad.",
        "about 1e-3 rad",
        ONE_OF_OURS,
        {
            reading: Ours(
                "figure-2.10",
                f"share of walks with at most the printed error, collision noise 0.5 rad/s, {kind}",
            )
            for reading, kind in (("low-passed draws", "low_pass"), ("noise of that amplitude", "ar1"))
        },
        depends_on="what has the amplitude of 0.5 rad/s",
        expected="depends",
        remark='"A maximum amplitude of 0.5 rad/s ... Each noise error value also has a 0.995 correlation '
        'with the previous value": noise of that amplitude gives errors many times those of the figure.',
    ),
)

DECAY = (
    Claim(
        "stable-decay",
        ("Fig 2.11", "section 2.5.1", "equation (2.15)"),
        "With S_FD = 1005 / s the filter's error grows without bound.",
        "0 < S_FD < 1000 / s",
        at_least(100),
        Ours("figure-2.8", "error of the rate after 2 s, S_FD = 1005 [rad/s]"),
        remark='From 1 rad/s. The eigenvalue is 1 - S_FD dt; "the linear coefficient (1 - S_FD)" lacks dt.',
    ),
    Claim(
        "no-decay",
        ("Fig 2.11", "section 2.5.1"),
        "With S_FD = 0 there is no useful output at all.",
        "a constant",
        near(0, 1e-12),
        Ours("figure-2.8", "range of the output, S_FD = 0 [rad]"),
    ),
    Claim(
        "best-decay",
        ("Fig 2.12", "section 2.5.1"),
        "Without noise the error is least at S_FD = 333 / s.",
        "around 333 / s",
        near(333, 25),
        Ours("figure-2.12", "best decay of the printed grid [1/s]"),
        remark="333 is 2 / (3 dt): a matter of the sampling rate.",
    ),
    Claim(
        "shallow-minimum",
        ("Fig 2.12", "section 2.5.1"),
        "The curve is shallow around S_FD = 333 / s, so that a range of values does as well.",
        '"shallow nature of the curve"',
        at_most(2),
        Ours("figure-2.12", "error 50 / s beside the best, over the least"),
        expected="refuted",
        remark="Shallow: one step of the grid beside the best at most doubles the error.",
    ),
)

RATIO = (
    Claim(
        "process-noise-wants-the-sensor",
        ("Fig 2.13", "Fig 2.15", "section 2.5.2"),
        "The larger the process noise, the larger the best S_MS.",
        "goes to 1",
        at_least(0.4),
        Ours("figure-2.14", "best S_MS at 0.9 less that at 0.1 rad/s2"),
        remark="0.4 of the scale from 0 to 1 is clearly a rise.",
    ),
    Claim(
        "model-alone-is-worst",
        ("Fig 2.13", "section 2.5.2"),
        "With the model alone, S_MS = 0, the error is large.",
        '"large error"',
        at_least(5),
        Ours("figure-2.14", "error without sensor over the least"),
    ),
    Claim(
        "flat-curves",
        ("Fig 2.13", "Fig 2.14", "section 2.5.2"),
        "The curves are flat: at the best S_MS the error is not much less than by the sensor alone.",
        '"not much different"',
        at_most(10),
        {
            f"process noise {size} rad/s2": Ours("figure-2.14", f"saved at {size} rad/s2, all times [%]")
            for size in (0.5, 0.1)
        },
        depends_on="the size of the process noise",
        expected="depends",
        remark="Not much: at most 10 % less. At 0.1 rad/s2, each panel's lowest curve, the model saves more.",
    ),
    Claim(
        "long-process-noise-errs-more",
        ("Fig 2.14", "section 2.5.2"),
        "The longer process noise is held, the larger is the error.",
        "increases",
        at_least(1),
        Ours("figure-2.14", "error held for 0.4 s over that for 0.1 s"),
    ),
    Claim(
        "long-process-noise-wants-the-sensor",
        ("Fig 2.14", "Fig 2.15", "section 2.5.2"),
        "The longer process noise is held, the larger is the best S_MS.",
        "increases",
        at_least(0),
        Ours("figure-2.14", "best S_MS held for 0.4 s less that for 0.1 s"),
    ),
    Claim(
        "flat-under-sensor-noise",
        ("Fig 2.16", "section 2.5.2"),
        "Except for high sensor noise the curves are flat.",
        '"not much different"',
        at_most(5),
        Ours("figure-2.16", "saved at collision noise up to 0.5 rad/s [%]"),
        remark='Flat: at most 5 % less. The caption has "amplitude = 0.0041 rad/s2, amplitude time = 0.5" '
        "for the process noise, the body 0.5 rad/s2 for 0.25 s.",
    ),
    Claim(
        "model-under-high-sensor-noise",
        ("Fig 2.16", "section 2.5.2"),
        "Under high sensor noise the model pays.",
        '"the trade-off ... becomes more clear"',
        at_least(5),
        Ours("figure-2.16", "saved at collision noise of 0.9 rad/s [%]"),
    ),
    Claim(
        "sensor-noise-wants-the-model",
        ("Fig 2.17", "section 2.5.2"),
        "The larger the sensor noise, the smaller the best S_MS.",
        "goes to 0",
        at_least(0.2),
        Ours("figure-2.16", "best S_MS at 0.1 less that at 0.9 rad/s of collision noise"),
    ),
    Claim(
        "sensor-never-neglected",
        ("Fig 2.16", "section 2.5.2"),
        "The model is never favoured to the total neglect of the sensors.",
        "S_MS > 0",
        at_least(0.05),
        Ours("figure-2.16", "least best S_MS"),
    ),
    Claim(
        "collision-matters-more-than-gyro",
        ("Fig 2.17",),
        "The best S_MS depends on the collision noise more than on the gyro noise.",
        "lines overlap",
        at_least(2),
        Ours("figure-2.16", "fall of the best S_MS over the collision noise, over that over the gyro noise"),
    ),
)

RESET = (
    Claim(
        "rough-floor-wants-little-reset",
        ("Fig 2.18", "section 2.5.3", "equation (2.10)"),
        "On a floor of 4 mm the best S_HR is mostly at most 0.1.",
        '"mostly smaller than 0.1"',
        at_least(0.5),
        Ours("figure-2.18", "share of best S_HR up to 0.1, floor 4 mm"),
    ),
    Claim(
        "process-noise-wants-reset",
        ("Fig 2.18", "section 2.5.3"),
        "At small S_MS high process noise wants more reset than low process noise, on either floor.",
        '"required the most heel reset"',
        at_least(0),
        {
            f"floor {floor} mm": Ours(
                "figure-2.18",
                f"best S_HR at high less that at low process noise, S_MS to 0.2, floor {floor} mm",
            )
            for floor in (1, 4)
        },
        depends_on="the floor",
    ),
    Claim(
        "caption-2.18",
        ("Fig 2.18",),
        'The caption: at small S_MS low process noise is "indicated with a higher S_HR value".',
        "higher",
        at_most(0),
        Ours("figure-2.18", "best S_HR at high less that at low process noise, S_MS to 0.2, floor 1 mm"),
        expected="refuted",
        remark="The body says the contrary, and is right.",
    ),
    Claim(
        "sensor-noise-wants-reset",
        ("Fig 2.18", "section 2.5.3"),
        "At large S_MS high sensor noise wants more reset than low sensor noise.",
        '"require a larger"',
        at_least(0),
        Ours("figure-2.18", "best S_HR at high less that at low sensor noise, S_MS from 0.3, floor 1 mm"),
    ),
    Claim(
        "ranger-reset",
        ("Fig 2.18", "section 2.5.3"),
        "Ranger's S_HR of 0.1 is a good choice for the sensor alone.",
        "0.1",
        near(0.1, 0.1),
        Ours("figure-2.18", "best S_HR for the sensor alone, floor 4 mm"),
        remark="On the floor of 4 mm; on a flat floor Ranger's error falls by more than half with S_HR = 1.",
    ),
)

RESULTS = (
    Claim(
        "best-decay-everywhere",
        ("Fig 2.19", "section 2.6.1"),
        "For the vast majority of noises the best S_FD is in the neighbourhood of 333 / s.",
        '"vast majority"',
        at_least(0.8),
        by_score("figure-2.19", "share of noises with the best S_FD within 50 / s of 333, {score}"),
        depends_on=SCORE,
        remark='The process noise of "0.0 to 0.08 rad/s2" is taken for 0.8.',
    ),
    *(
        Claim(
            f"no-process-noise-{number}",
            (f"Fig {number}", "section 2.6.2"),
            f"Without process noise the model-based estimator does very well (under {kind} noise).",
            '"very well"',
            at_least(50),
            by_score("figure-2.20", f"Fig {number}, gain at 0 rad/s2, {{score}} [%]"),
            depends_on=SCORE,
            remark="Very well: half the error of the best sensor-based estimator, or less.",
        )
        for number, kind in (("2.20", "collision"), ("2.22", "gyro"))
    ),
    *(
        Claim(
            f"some-process-noise-{number}",
            (f"Fig {number}", "section 2.6.2"),
            f"With just a little process noise it is not significantly better (under {kind} noise).",
            '"not significantly better"',
            at_most(5),
            by_score("figure-2.20", f"Fig {number}, gain at 0.2 rad/s2, {{score}} [%]"),
            depends_on=SCORE,
            remark="Not significantly: at most 5 % less error. A little: 0.2 rad/s2.",
        )
        for number, kind in (("2.20", "collision"), ("2.22", "gyro"))
    ),
    *(
        Claim(
            f"rough-floor-{number}",
            (f"Fig {number}", "section 2.6.2"),
            f"The error due to a floor of 4 mm is much larger than that due to process and {kind} noise.",
            '"much larger"',
            at_least(2),
            by_score(
                "figure-2.20", f"Fig {number}, error of the sensor over that on a flat floor, {{score}}"
            ),
            depends_on=SCORE,
        )
        for number, kind in (("2.21", "collision"), ("2.23", "gyro"))
    ),
    *(
        Claim(
            f"little-advantage-{number}",
            (f"Fig {number}", "section 2.6.2"),
            f"When the floor is not smooth there is little advantage in a model (under {kind} noise).",
            '"little advantage"',
            at_most(5),
            by_score("figure-2.20", f"Fig {number}, gain at 0.2 rad/s2, {{score}} [%]"),
            depends_on=SCORE,
            expected="depends",
            remark=WORDS_OF_THE_SCORE
            + "Little: at most 5 %. Process noise of 0.2 rad/s2; tuned and tested on different walks.",
        )
        for number, kind in (("2.21", "collision"), ("2.23", "gyro"))
    ),
    Claim(
        "one-or-two-percent",
        ("section 2.7", "section 2.1"),
        "In real world cases the model-based estimator improves on Ranger's by one or two percent.",
        "one or two percent",
        at_most(2.5),
        {
            f"{score}, process noise {size} rad/s2": Ours(
                "section-2.7", f"gain over Ranger's estimator, {score} [%]", {"process": size}
            )
            for score in (ESTIMATE, ADDED)
            for size in (0.5, 0.2)
        },
        depends_on=SCORE,
        expected="depends",
        remark="At most 2.5 %: two, rounded. Nominal sensor noise, floor 4 mm, tuned and tested on different "
        "walks. " + WORDS_OF_THE_SCORE,
    ),
)

GAIT = (
    Claim(
        "push-off-before",
        ("section 2.2",),
        "Pushing off just before the heel strike, not just after, reduces the loss of the collision.",
        "reduces",
        at_least(1.5),
        Ours("gait", "work after the strike over the least"),
        remark="Reduces: by a third at least.",
    ),
    Claim(
        "push-off-window",
        ("section 2.2", "section 2.3.3"),
        "The most efficient stride has its push-off within 20 ms before the heel strike.",
        "20 ms",
        near(20, 5),
        Ours("gait", "longest lead with less work than after the strike [ms]"),
        remark="Inverted pendulum with Ranger's step and pace, impulsive push-off: earlier, a push-off costs "
        "more than one that comes too late.",
    ),
    Claim(
        "sensitive-push-off",
        ("section 2.2",),
        "The state of the next step is highly sensitive to the time of the push-off.",
        '"highly sensitive"',
        at_least(5),
        Ours("gait", "change of the next mid-stance's speed by 10 ms [%]"),
        remark="Highly: 5 % of the speed for half of the window of 20 ms.",
    ),
    Claim(
        "single-pendulum-is-enough",
        ("section 2.3.3",),
        "The swing leg's mass does not significantly change the rate of the stance leg.",
        '"not significantly"',
        at_most(10),
        {
            f"{share} of the mass in the leg": Ours(
                "gait", f"change of the stance leg's rate by a leg of {share} of the mass [%]"
            )
            for share in ("5%", "20%")
        },
        depends_on="the share of the mass in the legs, which is not given",
        expected="depends",
        remark="Not significantly: at most 10 % within a step of a double pendulum that swings freely.",
    ),
    Claim(
        "rarely-worth-it",
        ("section 2.7", "section 2.3.3"),
        "The model's small improvement will rarely be worth the effort.",
        '"small improvement"',
        at_most(5),
        Ours("gait", "work saved by the model [%]"),
        expected="refuted",
        remark="Small: at most 5 % of the push-off's work. Nominal sensor noise, floor 4 mm, process noise "
        "0.2 rad/s2, each estimator at the intended time that is best for it.",
    ),
)

CLAIMS = (*SETTING, *GAIT, *DECAY, *RATIO, *RESET, *RESULTS)
