"""What chapter 3 of the dissertation claims, in its order."""

from __future__ import annotations

from papers.claim import Claim, Ours, at_least, at_most, near

LIT = "well lit"
CLAIMS = (
    Claim(
        "turning-lag",
        ("section 3.1.1",),
        "A turn that is commanded while the inner legs swing waits for their stance.",
        because="the simulated robot is built on it",
    ),
    Claim(
        "ranger-and-its-operator",
        ("Fig 3.1", "section 3.1.1"),
        "Ranger with the operator who steers it by R/C.",
        because="a photograph; `fieldgym watch line_following` steers by keyboard",
    ),
    Claim(
        "side-sensors",
        ("section 3.1.2",),
        "Two RGB sensors that look aside cannot reliably distinguish the track's red-brown from its green as "
        "the lighting changes.",
        holds=at_most(0.95),
        ours={
            "by their components": Ours("side-sensors", "right, light and lamps change, by components [1]"),
            "by the ratio of red to green": Ours(
                "side-sensors", "right, light and lamps change, by ratio of red to green [1]"
            ),
        },
        depends_on="what of the components is compared",
        expected="depends",
        remark='"Unable to get the sensor to reliably distinguish between the two as lighting conditions '
        'changed": reliable is taken for 95 % of readings. A ratio does not change with the light; '
        "the source does not say what was compared. Colours, lamps and noise are assumed.",
    ),
    Claim(
        "satellites",
        ("section 3.1.2",),
        "GPS and pseudo-satellite beacons do not suit the task.",
        because="a matter of cost and set-up",
    ),
    Claim(
        "power",
        ("section 3.2", "section 3.3.1"),
        "The camera board takes 227.5 mW of Ranger's 16 W; a Kinect would take 5 W.",
        because="measurements on their hardware",
    ),
    Claim("camera-board", ("Fig 3.2", "section 3.3"), "The CMUcam4 board.", because="a photograph"),
    Claim("prop-plug", ("Fig 3.3", "section 3.3.1"), "The Propeller plug.", because="a photograph"),
    Claim("schematic", ("Fig 3.4", "section 3.3.1"), "The board's schematic.", because="a circuit diagram"),
    Claim(
        "centroid",
        ("Fig 3.5", "Fig 3.6", "section 3.3.2"),
        "The firmware finds where the line is from the centroid of the middle third of the view.",
        holds=at_most(5.0),
        ours=Ours("figure-3.5", "mean error of the centroid [mm]"),
        remark="Half a column of the image is 4 mm on the floor.",
    ),
    Claim("test-box", ("Fig 3.7", "section 3.3.3"), "The hand-held test box.", because="a photograph"),
    Claim(
        "dark-matte-tapes",
        ("section 3.4.1",),
        "Of tapes in many colours the darkest with matte finishes suffer least from changes of the light.",
        because="gloss decides it, of which the source gives no numbers",
    ),
    Claim(
        "three-peaks",
        ("Fig 3.8", "section 3.4.1"),
        "Black tape on grey and white shows three peaks in the histogram: tape, grey, white.",
        "three",
        at_least(0.9),
        Ours("figure-3.8", "photographs with three peaks in order [1]"),
    ),
    Claim(
        "grey-moves-right",
        ("Fig 3.9", "section 3.4.1"),
        "Without the white background the exposure changes and the grey peak moves to the right.",
        "further away, towards the center",
        at_least(10.0),
        Ours("figure-3.8", "shift of the grey peak [levels]"),
    ),
    Claim(
        "tape-moves-right",
        ("Fig 3.9", "section 3.4.1"),
        "The tape's peak moves to the right, too.",
        "shifted to the right",
        at_least(1.0),
        Ours("figure-3.8", "shift of the tape's peak [levels]"),
    ),
    Claim(
        "tape-widens",
        ("Fig 3.9", "section 3.4.1"),
        "The tape's peak becomes wider.",
        "is wider",
        at_least(1.05),
        Ours("figure-3.8", "width of the tape's peak, Fig 3.9 to 3.8 [1]"),
    ),
    Claim(
        "perfect-black",
        ("section 3.4.1",),
        "The peak of a perfectly black tape stays at zero in any light and exposure.",
        "all the way at zero",
        at_most(0.5),
        {
            "a camera that reads nothing without light": Ours(
                "figure-3.8", "level of a perfectly black tape, no pedestal [levels]"
            ),
            "the camera of Fig 3.13": Ours(
                "figure-3.8", "level of a perfectly black tape, the pedestal of Fig 3.13 [levels]"
            ),
        },
        depends_on="what the camera reads without light",
        expected="depends",
        remark="Duvetyne is 24 times darker than the floor (Fig 3.11) but reads 35 beside 165 (Fig 3.13): "
        "that camera adds a pedestal, which exposure amplifies; no tape reads zero.",
    ),
    Claim("tape-samples", ("Fig 3.10", "section 3.4.1"), "The four candidate tapes.", because="a photograph"),
    Claim(
        "five-peaks",
        ("Fig 3.11", "section 3.4.1"),
        "The four tapes and their background show five distinct peaks.",
        "five",
        at_least(0.9),
        Ours("figure-3.11", "photographs with five peaks [1]"),
        remark="By a photo camera with little noise (assumed).",
    ),
    Claim(
        "eight-times-as-bright",
        ("Fig 3.11", "Fig 3.12", "section 3.4.1"),
        "The background is eight times as bright as the lightest tape, Duvetyne twice as dark as the next.",
        because="measurements, from which the simulated tapes are made",
    ),
    Claim(
        "others-turn-white",
        ("Fig 3.12", "section 3.4.1"),
        "With levels altered around the darkest peak the three other tapes appear white.",
        "appear white",
        at_least(0.95),
        Ours("figure-3.11", "pixels of the three other tapes that are white [1]"),
    ),
    Claim(
        "duvetyne-turns-grey",
        ("Fig 3.12", "section 3.4.1"),
        "With levels altered around the darkest peak Duvetyne appears grey.",
        "appear grey",
        near(128.0, 96.0),
        Ours("figure-3.11", "level of Duvetyne, altered [levels]"),
        remark="Grey: neither of the outer eighths of the levels.",
    ),
    Claim(
        "tape-level",
        ("Fig 3.13", "section 3.4.2"),
        "Duvetyne reads in the mid-30s in red, green and blue.",
        "mid-30's",
        near(35.0, 2.0),
        Ours("figure-3.13", "tape in full light [levels]"),
        remark="Matched: the camera's pedestal, which the source does not give, is chosen for it.",
    ),
    Claim(
        "floor-level",
        ("Fig 3.13", "section 3.4.2"),
        "The linoleum in the same photo reads 160 to 170.",
        "160 to 170",
        (160.0, 170.0),
        Ours("figure-3.13", "floor in full light [levels]"),
        remark="Matched: the exposure's aim is chosen for it.",
    ),
    Claim(
        "levels-change-with-light",
        ("section 3.4.2",),
        "In other light the auto exposure gives the same tape other components.",
        "higher or lower",
        at_least(10.0),
        Ours("figure-3.13", "rise of the tape's level at light 0.2 [levels]"),
    ),
    Claim(
        "one-set-of-thresholds",
        ("section 3.4.2",),
        "One set of RGB thresholds separates tape and floor for a large range of lighting.",
        "a large range",
        at_least(0.9),
        Ours("figure-3.13", "line found at light 0.2, 2 inches [1]"),
        remark="Calibrated at full light and at 0.4 of it; large is taken for a factor of five.",
    ),
    Claim("mounting", ("Fig 3.14", "section 3.5.1"), "The camera on Ranger.", because="a photograph"),
    Claim(
        "view-moves-with-the-legs",
        ("section 3.5.1",),
        "The camera sees further ahead while the inner legs swing.",
        because="the simulated body does not pitch",
    ),
    Claim(
        "red-lights",
        ("Fig 3.15", "section 3.5.2"),
        "Six lights flash red where the line is lost, and a switch gives the steering to the operator.",
        because="a photograph; the task's picture has both",
    ),
    Claim(
        "random-search",
        ("eq (3.1)", "section 3.5.3"),
        "Of 1000 random sets of weights the best steers Ranger along the line.",
        "good values",
        at_least(0.9),
        Ours("law", "walks of the best set that stay on the line [1]"),
        remark="Ranges of the weights and the line are not given; ours are assumed, the line is the oval.",
    ),
    Claim(
        "overshoot-costs-effort",
        ("section 3.5.3",),
        "Less overshoot means fewer steering commands.",
        holds=at_least(0.1),
        ours={
            "without noise": Ours("law", "rank correlation of overshoot and effort [1]", {"noise": 0.0}),
            "with the task's noise": Ours("law", "rank correlation of overshoot and effort [1]"),
        },
        depends_on="the noise of sensor and walk",
        expected="depends",
        remark='"Minimizing overshoot reduces the number of steering commands": so it is if oscillation '
        "is what steers. Under noise laws without overshoot are those that answer every error of the sensor.",
    ),
    Claim(
        "between-the-feet",
        ("Fig 3.16", "section 3.6"),
        "In a curve of 9 m Ranger often keeps the line between its two inner feet.",
        "often",
        at_least(0.5),
        {
            "plane kinematics": Ours(
                "figure-3.16", "strides in the curve with the line between the inner feet, printed [1]"
            ),
            "rigid bodies, friction 0.6": Ours(
                "figure-3.16",
                "strides in the curve with the line between the inner feet, printed [1]",
                {"plant": "pymunk"},
            ),
        },
        depends_on="the plant",
        remark="Often is taken for every second stride; the feet's distance of 0.30 m is assumed.",
    ),
    Claim(
        "laps",
        ("Fig 3.17", "section 3.6"),
        "Ranger steers itself for several consecutive laps without an operator.",
        "several",
        at_least(0.9),
        Ours("figure-3.17", f"walks without an operator, {LIT} [1]"),
        remark="Several is taken for three; nine of ten walks must do it.",
    ),
    Claim(
        "dark-corner",
        ("section 3.6",),
        "In a dark corner Ranger loses the line.",
        holds=at_least(0.5),
        ours=Ours("figure-3.17", "walks that lose sight of the line, dark corner, 2 inches [1]"),
        remark="Place, size and light of the corner are assumed.",
    ),
    Claim(
        "thicker-line",
        ("section 3.6",),
        "Thickening the line with extra tape helps in the dark corner.",
        holds=at_most(0.1),
        ours=Ours("figure-3.17", "walks that lose sight of the line, dark corner, 4 inches [1]"),
        remark="The same corner and walks; the tape is twice as wide.",
    ),
    Claim(
        "own-shadow",
        ("section 3.6",),
        "In bright sun Ranger's own shadow contrasts enough with the floor to cause confusion.",
        holds=at_most(0.5),
        ours=Ours("figure-3.17", "walks without an operator, low sun [1]"),
        remark="Confusion: most walks would need the operator. The sun stands low for a whole lap.",
    ),
)
