"""What chapter 5 of the dissertation claims, in its order."""

from __future__ import annotations

from papers.claim import Claim, Ours, at_least, at_most, near

WORKS = at_least(0.8)
"""Share of arrivals from anywhere at which a method counts as working; the source prints no numbers."""


def _arrivals(rule: str, teacher: str = "graceful") -> Ours:
    return Ours("rules", f"arrivals, T3, {teacher}, {rule}")


def _example(statistic: str) -> Ours:
    return Ours("worked-example", statistic)


CLAIMS = (
    Claim(
        "states-of-a-path",
        ("Fig 5.1", "section 5.1.4", "section 5.2.1"),
        "With theta the robot's heading and omega its commanded turn, remembered paths lead to the ball.",
        holds=WORKS,
        ours={
            "heading and turn rate, to the letter": _arrivals("to the letter"),
            "heading and direction": _arrivals("direction, but theta the heading"),
            "bearing and turn rate": _arrivals("bearing, but omega a rate"),
            "bearing and direction": _arrivals("as it works"),
        },
        depends_on="what theta and omega are",
        expected="depends",
        remark='"A magnitude and an angle relative to the robot\'s present heading": obeyed within a tick, '
        "that is a turn rate. Only the bearing around the ball and a direction in the goal's frame work.",
    ),
    Claim(
        "omega-is-psi",
        ("section 5.2.2",),
        "In the nine example states omega is psi within 0.2 pi / 10: a direction in the goal's frame.",
        "nine states",
        near(9, 0),
        _example("states with omega = psi within 0.2 pi / 10"),
        remark="What the example shows; relative to its own heading a unicycle's velocity has no angle.",
    ),
    Claim(
        "heading-offset",
        ("Fig 5.1", "section 5.2.1"),
        "In the nine example states psi = theta - psi_f.",
        "psi = theta - psi_f",
        near(9, 0),
        _example("states with psi = theta - psi_f"),
        expected="refuted",
        remark="It holds for two; so theta is not the heading.",
    ),
    Claim(
        "rounded-speeds",
        ("section 5.2.2",),
        "Each parameter is rounded to the nearest of its values; speeds are multiples of 0.5.",
        "nine speeds",
        near(9, 0),
        _example("speeds rounded to the nearest of their grid"),
        expected="refuted",
        remark="Five of nine are rounded to integers instead: 2.6 to 3, 0.3 to 0.",
    ),
    Claim(
        "input-matrix",
        ("section 5.2.3", "section 5.2.4"),
        "M_d times the vector of d = 3.2 gives lambda_d, and the lambdas multiply to the printed product.",
        "0.45, 0.2, 0, 0.3, ... and 0.027, 0.004, 0, 0.09, 0.012",
        at_most(1e-9),
        _example("lambda_d and the product: largest difference from the print"),
        remark='By the printed matrix; the text before it has "5" for 0.5.',
    ),
    Claim(
        "winner",
        ("section 5.2.4",),
        "The seventh element is the largest, so p_3,1 is chosen.",
        "seventh",
        near(7, 0),
        _example("number of the winner"),
    ),
    Claim(
        "example-lambdas",
        ("section 5.2.4",),
        "A measured theta gives the printed lambda_theta.",
        "0, 0, 0, 0.3, 0.2, 0.1, 0.4, 0.3, 0.1",
        at_most(0.005),
        _example("lambda_theta: least largest difference from the print over all theta"),
        expected="refuted",
        remark="No theta of the whole circle does.",
    ),
    Claim("robocup-system", ("section 5.3.1",), "Cornell's RoboCup system.", because="their hardware"),
    Claim("simulator", ("Fig 5.2",), "Cornell's RoboCup simulator.", because="a screenshot"),
    Claim(
        "training-paths",
        ("Fig 5.3",),
        "The training paths give 126 states.",
        "126",
        near(126, 0),
        Ours("figure-5.9", "states"),
        remark="How many paths is not stated: nine of 14 states each.",
    ),
    Claim(
        "closer-orientation",
        ("section 5.3.2",),
        "Where paths cross, the state with the closer orientation is selected.",
        holds=at_least(0.05),
        ours={
            "inputs d and theta": Ours(
                "crossing", "share of places where the orientation decides: d and theta"
            ),
            "inputs d, theta and psi": Ours(
                "crossing", "share of places where the orientation decides: d, theta and psi"
            ),
        },
        depends_on="whether psi is an input, as in 5.2.3, or not, as in the simulation",
        expected="depends",
        remark='The simulation has "a M_d matrix of size 126 by 16 and a M_theta", and no M_psi.',
    ),
    Claim(
        "columns-of-m-d",
        ("section 5.3.2",),
        "d = 1.6, 1.5, ... 0.1 gives 16 columns.",
        "126 by 16",
        near(16, 0),
        _example("values of d"),
    ),
    Claim(
        "columns-of-m-theta",
        ("section 5.3.2",),
        "theta = 0, 0.1, ... 3.2 gives 32 columns.",
        "126 by 32",
        near(32, 0),
        _example("values of theta"),
        expected="refuted",
        remark="These are 33 values.",
    ),
    Claim(
        "symmetric-field",
        ("section 5.3.2",),
        "Training paths on the left side are unnecessary, since the field is symmetric.",
        holds=WORKS,
        ours={
            "poses on the left are mirrored": _arrivals("as it works"),
            "they are not": _arrivals("no mirror"),
        },
        depends_on="whether poses are mirrored, which the text does not say",
        expected="depends",
        remark='"Unnecessary due the symmetric nature of the field": if a robot on the left is mirrored.',
    ),
    Claim(
        "no-state-is-near",
        ("section 5.2.4",),
        "The largest element of lambda is the most likely state, whatever is measured.",
        holds=WORKS,
        ours={
            "nearest state where all elements are zero": _arrivals("no clamp"),
            "stop where all elements are zero": _arrivals("no clamp, stop"),
        },
        depends_on="what is done where every element is zero, which the text does not say",
        expected="depends",
        remark="As beyond the ends of d, 0.1 and 1.6 m, which do not cover the field.",
    ),
    Claim(
        "correction-near-the-ball",
        ("Fig 5.4",),
        "A robot a little off a path drives parallel to it and is corrected close to the ball.",
        holds=at_most(0.5),
        ours=Ours("figure-5.9", "Fig 5.4: straight until, over the starting distance"),
        remark="Close: on the nearer half of its way.",
    ),
    *(
        Claim(
            f"path-switching-{number[-1]}",
            (f"Fig {number}",),
            "The robot switches from one training path to another, and back.",
            holds=at_least(2),
            ours=Ours("figure-5.9", f"Fig {number}: changes of path"),
        )
        for number in ("5.5", "5.6", "5.7")
    ),
    Claim(
        "stays-on-the-top-path",
        ("Fig 5.8",),
        "Started near the top training path, the robot stays closest to it, and drives very smoothly.",
        holds=at_least(0.9),
        ours=Ours("figure-5.9", "Fig 5.8: share of its way on its first path"),
        remark="Nearly all of its way: within 0.4 m of the ball all paths run together and do not count.",
    ),
    Claim(
        "generated-paths",
        ("Fig 5.9",),
        "The generated paths of Figs 5.4 to 5.8 all reach the ball.",
        "five paths",
        near(5, 0),
        Ours("figure-5.9", "drives that arrive"),
    ),
    Claim(
        "more-paths-fewer-bumps",
        ("section 5.3.2",),
        "More training paths, spread evenly, make generated paths smoother.",
        holds=at_most(0.95),
        ours=Ours("smoothness", "bump with more paths over that with few"),
        remark="Bump: root mean square change of a tick's turn; 45 paths against five.",
    ),
    Claim(
        "direct-approach",
        ("section 5.3.2",),
        "Omnidirectional robots could approach the ball more directly than by unicycle paths.",
        '"a more direct approach to the ball"',
        at_most(1.1),
        {
            "driven as a unicycle, as the source's": Ours(
                "omnidirectional", "way over the straight line, omnidirectional, path_memory"
            ),
            "driven in the remembered direction at once": Ours(
                "omnidirectional", "way over the straight line, omnidirectional, path_memory_straight"
            ),
        },
        "whether the capability is used",
        expected="depends",
        remark="As claimed. Direct: at most a tenth longer than the straight line.",
    ),
    Claim(
        "orientation-on-the-way",
        ("section 5.3.2",),
        "Omnidirectional robots change orientation independently of the path.",
        holds=at_most(0.1),
        ours=Ours("omnidirectional", "time above the least [s], omnidirectional, path_memory_straight"),
        remark="Turning costs no time beside driving: a tick above what either takes alone.",
    ),
    Claim("team-member", ("Fig 5.10",), "A robot of Cornell's team.", because="a photograph"),
    Claim(
        "real-world",
        ("section 5.3.3",),
        "The method drove a real robot in real time.",
        because="their hardware",
    ),
    Claim(
        "any-teacher",
        ("section 5.4",),
        "The approach is independent of the methods used to create the training paths.",
        holds=WORKS,
        ours={
            "a smooth control law": _arrivals("as it works"),
            "shortest paths": _arrivals("as it works", "dubins"),
            "a human's arrow keys": Ours("taught", "arrivals, T3"),
        },
        depends_on="the teacher",
    ),
    Claim(
        "taught-by-a-human",
        ("section 5.4",),
        "Guided by a human a few times, the robot is then left to operate by itself.",
        holds=WORKS,
        ours=Ours("taught", "arrivals, T3"),
        remark="Nine drives by arrow keys; a stand-in taps them, 0.2 s late.",
    ),
    Claim(
        "own-training-data",
        ("section 5.4",),
        "By trial and error a robot could create its own training data.",
        holds=WORKS,
        ours=Ours("own-data", "arrivals, ideal, 300 s, 0 rounds"),
        remark="Five minutes of random motion, seen in hindsight.",
    ),
    Claim(
        "practice",
        ("section 5.4",),
        "By practice it could refine its movements.",
        holds=at_most(1.5),
        ours=Ours("own-data", "time over Dubins, ideal, 300 s, 6 rounds"),
        remark="Refined: from 1.8 times the shortest path's time to less than 1.5.",
    ),
)
