"""How answers on the field set are judged, and how rivals are set beside the diagnosis."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from exam import sets
from exam.answers import CURVE, Answer
from exam.delivery import Delivery
from exam.field.answers import Right
from exam.field.cases import FieldCase
from exam.field.judge import judged, outcome_of
from exam.rivals import forward
from fieldmodels.registry import get_model
from fieldmodels.synthesis import synthesise

DRY = Right((frozenset({"coulomb_friction"}),), ("force speed over speed",))
PLAY = Right(
    (frozenset({"actuator_play"}),), ("force stem over memory of signal", "actuator signal over signal")
)


def answer(
    *named: tuple[str, ...], verdict: str = "named", curves: tuple[tuple[str, str, str], ...] = ()
) -> Answer:
    """An answer that names these and shows such curves."""
    return Answer(verdict, named, False, {}, {}, 1.0, "", curve=bool(curves), curves=curves)


def shown(*curve: str) -> Answer:
    """An answer that shows one curve, and names nothing."""
    place, target, over = curve
    return answer(verdict="unknown", curves=((place, target, over),))


@pytest.mark.every(
    ("right", "given", "expected"),
    [
        (DRY, answer(("coulomb_friction",)), "right alone"),
        (DRY, answer(("coulomb_friction", CURVE)), "in a set"),
        (DRY, answer(("viscous_friction",)), "wrong"),
        (DRY, answer(("coulomb_friction",), ("sensor_gain",)), "with a false one"),
        (DRY, shown("force", "force on speed", "size of speed"), "curve"),
        (DRY, shown("force", "", "speed"), "curve"),  # the only force of its machine
        (DRY, shown("force", "rate of current", "speed"), "elsewhere"),
        (DRY, shown("force", "force on speed", "current"), "elsewhere"),
        (DRY, answer(verdict="unknown"), "abstained"),
        (DRY, answer(verdict="consistent"), "silent"),
        (DRY, answer(verdict="unrelated"), "wrong"),
        (PLAY, shown("force", "rate of stem", "play of signal of 0.02"), "curve"),
        (PLAY, shown("force", "rate of stem", "signal"), "curve"),  # as its actuator's own curve
        (PLAY, shown("force", "rate of stem", "stem"), "elsewhere"),
        (Right((frozenset({"a", "b"}), frozenset({"a"})), ()), answer(("a",)), "right alone"),
        (Right((), (), True), answer(verdict="unknown"), "unexplained"),
        (Right((), (), False, "unrelated"), answer(verdict="unrelated"), "refused"),
    ],
)
def test_an_answer_is_the_best_that_one_of_the_right_ones_makes_of_it(
    right: Right, given: Answer, expected: str
):
    assert outcome_of(FieldCase("kind", "motor", 0, "usual"), right, given) == expected


@pytest.mark.every(
    ("given", "expected"),
    [
        (answer(verdict="consistent"), "consistent"),
        (answer(("a",)), "false name"),
        (shown("force", "", "x"), "doubted"),
    ],
)
def test_where_nothing_is_hidden_nothing_is_right_but_silence(given: Answer, expected: str):
    assert outcome_of(FieldCase("nothing", "motor", 0, "none"), Right(), given) == expected


def row(key: int, outcome: str, kind: str = "single", hidden: str = "dry", **more: Any) -> dict[str, Any]:
    """A line of a run."""
    usual = {"kind": kind, "hidden": [hidden], "seconds": 1.0, "size": "usual", "regained": None}
    return {"key": str(key), "outcome": outcome, **usual, **more}


def test_a_rival_stands_beside_the_diagnosis_with_rates_of_the_same_cases():
    """What failed has regained nothing; what runs away errs more than before; spikes do not count yet."""
    rows = [
        row(1, "right alone", regained=0.9, stated=0.99, extended=True, over_before=0.5),
        row(2, "wrong", regained=0.2, stated=0.96, extended=True, over_before=None),
        row(3, "failed"),
        row(4, "silent", regained=0.0, stated=None, extended=False, over_before=1.0),
        row(5, "consistent", kind="nothing", hidden="-"),
        row(6, "wrong", hidden="spikes", stated=0.99),
    ]
    (line,) = [one for one in sets.versus({"forward": rows}).splitlines() if one.startswith("| forward")]
    counts = [cell.split(" (")[0].strip() for cell in line.split("|")[2:7]]
    assert counts == ["2/5", "1/5", "1/5", "1/4", "1/2"]
    table = sets.by_kind(rows)
    assert "| spikes (counts later) | 0/1" in table
    assert "| **all that count** | 2/5" in table


def test_thirty_lines_find_dry_friction_and_deliver_it():
    rig, friction = get_model("rig"), {"coulomb_friction": {"force": 0.6}}
    train, test, third = (
        synthesise(rig, friction, "mixed", duration=10.0, amplitude=8.0, rng=np.random.default_rng(seed))
        for seed in (1, 2, 3)
    )
    found = forward(rig, [train], [test], {}, [third])
    assert ("coulomb_friction",) in found.named
    assert found.delivery is not None
    assert not found.delivery.broken
    assert found.delivery.over_before < 0.5


def test_what_is_regained_is_a_part_of_what_the_fault_adds_to_the_output_that_suffers_most():
    """Of 3 in 1 what can go is 2; 1.8 have gone. The other output, whose error is its noise, says nothing."""
    delivery = Delivery(
        {"speed": 3.0, "current": 5.0}, {"speed": 1.2, "current": 5.0}, {"speed": (3.0, 1.2)}, True
    )
    given = replace(answer(("coulomb_friction",)), delivery=delivery)
    made = judged(FieldCase("kind", "motor", 0, "usual"), DRY, {"speed": 1.0, "current": 5.0}, given)
    assert made["regained"] == pytest.approx(0.9)
    assert (made["outcome"], made["over_before"]) == ("right alone", 1.0)
