"""A declaration is said once: what checks, ranges, parts and kernels make of it."""

from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np
import pytest

from fieldmodels.compiled import compiled
from fieldmodels.model import ModelError
from fieldmodels.settings import Setting, check_declared, code, declared, kernel_rows, part_of

Level = Annotated[float, Setting("", least=0, most=10)]


@dataclass(frozen=True)
class Motor:
    """A part with a number that is no setting."""

    torque: Annotated[float, Setting("Largest torque.", "N m", above=0, most=5)] = 2.0
    poles: int = 4


@dataclass(frozen=True, kw_only=True)
class Bench(Motor):
    """What is set; the motor's number is inherited."""

    kind: Annotated[Literal["slow", "fast"], Setting("How it runs.")] = "slow"
    levels: Annotated[tuple[Level, Level], Setting("Low and high.", "V")] = (1.0, 2.0)
    scale: Annotated[float | None, Setting("Of the reward; None for one's own.", above=0)] = None
    steps: Annotated[int, Setting("Steps.", least=1, most=9, fixed="it shapes an array")] = 3
    quiet: Annotated[bool, Setting("Whether it is quiet.")] = False

    def __post_init__(self) -> None:
        """Check the numbers."""
        check_declared(self)


@dataclass(frozen=True)
class Machine:
    """A class whose fields have settings of their own."""

    motor: Motor = field(default_factory=Motor)
    speed: Annotated[float, Setting("Speed.", "m/s", least=0)] = 1.5


@compiled
def read(rows, out):
    for b in range(len(rows)):
        p = rows[b]
        out[b] = p.torque + 10.0 * p.kind + 100.0 * p.levels[1] + 1000.0 * p.steps + (1e4 if p.quiet else 0.0)


def test_a_kernel_reads_each_row_s_settings_by_their_names():
    rows = kernel_rows(Bench(), 2)
    rows[1] = kernel_rows(Bench(torque=1.0, kind="fast", levels=(0.0, 4.0), steps=1, quiet=True), 1)[0]
    out = np.zeros(2)
    read(rows, out)
    np.testing.assert_array_equal(out, [3202.0, 11411.0])
    assert "scale" not in rows.dtype.names
    assert "poles" not in rows.dtype.names
    assert kernel_rows(Bench(scale=2.0), 1)["scale"][0] == 2.0


def test_equal_records_have_one_type():
    """Not an equal one: Numba compares others, field by field, at every call."""
    assert kernel_rows(Bench(), 3).dtype is kernel_rows(Bench(torque=1.0), 1).dtype


def test_a_record_s_order_does_not_depend_on_what_is_computed():
    """NumPy puts one record into another by position."""
    rows = kernel_rows(Bench(scale=2.0), 2)
    rows[0] = kernel_rows(Bench(), 1, {"scale": 7.0})[0]
    assert (rows["scale"][0], rows["torque"][0], rows["steps"][0]) == (7.0, 2.0, 3)


def test_settings_of_a_part_are_read_beside_its_owner_s():
    row = kernel_rows(Machine(Motor(4.0)), 1, {"speed": 9.0, "twice": 3})[0]
    assert (row["torque"], row["speed"], row["twice"]) == (4.0, 9.0, 3)


def test_a_name_that_is_declared_twice_is_noticed():
    @dataclass(frozen=True)
    class Twice:
        torque: Annotated[float, Setting("A torque.")] = 1.0
        motor: Motor = field(default_factory=Motor)

    with pytest.raises(AssertionError, match="declared twice"):
        kernel_rows(Twice(), 1)


def test_a_part_is_made_of_the_settings_that_have_its_names():
    assert part_of(Bench(torque=3.0), Motor) == Motor(3.0)
    assert part_of(Bench(torque=3.0), Motor, torque=1.0, poles=8) == Motor(1.0, 8)


def test_choices_have_codes_and_ranges_have_words():
    assert (code(Bench, "kind", "slow"), code(Bench, "kind", "fast")) == (0, 1)
    ranges = {name: one.range() for name, one in declared(Bench).items()}
    assert ranges == {
        "torque": "greater than 0, at most 5",
        "kind": "`slow` or `fast`",
        "levels": "at least 0, at most 10",
        "scale": "greater than 0",
        "steps": "at least 1, at most 9",
        "quiet": "",
    }


@pytest.mark.every(
    ("wrong", "words"),
    [
        ({"torque": 6.0}, "torque must be greater than 0, at most 5 N m, not 6.0"),
        ({"torque": float("nan")}, "torque must be"),
        ({"torque": None}, "torque must be"),
        ({"kind": "still"}, "kind must be one of 'slow', 'fast', not 'still'"),
        ({"levels": (1.0, 11.0)}, r"each of levels must be at least 0, at most 10 V, not \(1.0, 11.0\)"),
        ({"levels": (1.0,)}, "levels must be 2 numbers"),
        ({"scale": 0.0}, "scale must be greater than 0, not 0.0"),
        ({"steps": 0, "torque": 0.0}, "torque must be .*; steps must be"),
    ],
)
def test_values_out_of_bounds_are_named(wrong, words):
    with pytest.raises(ModelError, match=words):
        Bench(**wrong)
