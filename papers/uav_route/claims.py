"""What chapter 4 of the dissertation claims, in its order."""

from __future__ import annotations

from papers.claim import Claim, Ours, at_least, at_most, near

PATHS = "figure-4.5"

CLAIMS = (
    Claim(
        "turn-angle",
        ("Fig 4.1",),
        "The turn angle lies between the velocity and the way to the next waypoint.",
        because="a drawing; what it defines is (4.2), and the next claim",
    ),
    Claim(
        "turn-side",
        ("section 4.2.1",),
        "The sign of y(t_i+1) v_x - x(t_i+1) v_y tells the side of a turn: positive is left.",
        holds=near(1.0, 1e-3),
        ours=Ours("section-4.2", "share of turns whose printed side is right"),
        expected="refuted",
        remark='"If y(t_i+1) v_x(t_i) - x(t_i+1) v_y(t_i) > 0, then the change in turn angle is negative": '
        "absolute positions stand for relative ones, with the opposite sign (`test_uav_route_physics.py`).",
    ),
    Claim(
        "signature-table",
        ("Table 4.1",),
        "Signature as a function of azimuth and elevation.",
        because="data that the model takes over; both ways through it are tested",
    ),
    Claim(
        "detection-table",
        ("Table 4.2", "section 4.2.2"),
        "Probability of detection rises with the signature and falls with the range.",
        holds=at_least(0.999),
        ours=Ours(
            "section-4.2", "share of cases in which Table 4.2 rises with signature and falls with range"
        ),
        remark="Interpolated linearly, within Wilson's interval.",
    ),
    Claim(
        "lock-loss-states",
        ("Fig 4.2",),
        "Disengaged, engaged, launched, damaged.",
        because="a diagram of states; its timers (4.3)-(4.7) are tested as printed and as they should be",
    ),
    Claim(
        "polygons",
        ("Fig 4.3",),
        "A circle and its polygons of 4 and 8 sides.",
        because="a drawing",
    ),
    Claim(
        "linear-variables",
        ("section 4.5.1",),
        "The program for one aircraft has 72 linear variables.",
        "72",
        holds=near(72, 0.5),
        ours=Ours(PATHS, "linear variables, one aircraft"),
        remark="With T = 12, which the source does not print: x, y, v_x, v_y, v and distance at each step.",
    ),
    Claim(
        "linear-variables-of-two",
        ("section 4.5.1", "two UAVs"),
        "The program for two aircraft has 116 linear variables.",
        "116",
        holds=near(116, 0.5),
        ours=Ours(PATHS, "linear variables, two aircraft"),
        expected="refuted",
        remark="So T = 12 is open: what the second aircraft adds, 44 linear variables, 9,674 binaries and "
        "3,995 constraints, has no common divisor, so that no number of steps with as many of each a step "
        "gives it, shared parts or not. Counted after AMPL's presolve, say, they tell nothing of T.",
    ),
    Claim(
        "binaries-and-constraints",
        ("section 4.5.1",),
        "15,363 binaries and 10,359 constraints; for two aircraft 25,037 and 14,354.",
        because="neither M nor the table of tangents is printed; M = 24 and 36 have 7,608 and 16,536",
    ),
    Claim(
        "not-directly",
        ("Fig 4.4", "section 4.5.1"),
        "The aircraft does not fly directly, but stays away until it can turn towards the radar.",
        holds=at_least(1.0),
        ours=Ours(PATHS, "detour of the undetected route [km]"),
    ),
    Claim(
        "never-detected",
        ("Fig 4.4", "section 4.3.2"),
        "At any time the distance is greater than the one looked up, so that a path is valid.",
        holds=at_most(1.0),
        ours=Ours(PATHS, "detected time of the printed plan [s]"),
        expected="refuted",
        remark='"For any path to be valid it must be true that for any given time the distance ... is '
        'greater than the look up distance": between the steps nothing is asked, the slack of 1.01 bends '
        "headings by 8 degrees, and banks are left out.",
    ),
    Claim(
        "risk-buys-length",
        ("Fig 4.5", "section 4.5.2"),
        "A higher acceptable probability of detection allows a more direct path.",
        holds=at_least(0.1),
        ours={
            "the printed cost, in steps": Ours(
                PATHS, "kilometres saved by 0.7 instead of 0.5, printed program"
            ),
            "the length of undetected routes": Ours(
                PATHS, "kilometres saved by 0.7 instead of 0.5, undetected legs"
            ),
        },
        depends_on="what is minimised",
        expected="depends",
        remark="(4.22) counts steps: 0.5 and 0.7 both take 11; which path is drawn is the solver's choice.",
    ),
    Claim(
        "minutes",
        ("section 4.5.3",),
        "Each path takes about 3 minutes, with lock loss 3.5.",
        because="their computer and CPLEX of 2004",
    ),
    Claim(
        "lock-loss-buys-length",
        ("Fig 4.6", "section 4.5.4"),
        "With lock loss another path is taken, which profits from it.",
        holds=at_least(0.1),
        ours={
            "the printed cost, in steps": Ours(PATHS, "kilometres saved by lock loss, printed program"),
            "the length of routes that no missile hits": Ours(
                PATHS, "kilometres saved by lock loss, lattice"
            ),
        },
        depends_on="what is minimised",
        expected="depends",
        remark="In steps nothing is gained; a route of any legs saves a twelfth of its length.",
    ),
    Claim(
        "lock-loss-survives",
        ("Fig 4.6", "section 4.5.4"),
        "Not detected for four consecutive steps, the aircraft is not destroyed.",
        holds=at_most(0.5),
        ours={
            "the printed program": Ours(PATHS, "missile hits the printed plan with lock loss"),
            "the timers of (4.3)-(4.7) along the path": Ours(
                PATHS, "missile hits the lattice's plan with lock loss"
            ),
        },
        depends_on="whether detection counts at the steps alone or all along the path",
        expected="depends",
        remark='"As long as the UAV is not detected for four consecutive time steps": between its steps the '
        "printed plan is detected without a break for longer.",
    ),
)
"""In the source's order."""
