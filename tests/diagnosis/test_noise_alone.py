"""Where nothing is missing but noise is unusual, nothing is said: records of the exam's plants."""

from types import SimpleNamespace

import pytest

from exam.benches import get_bench
from exam.benches.base import Conditions
from exam.cases import cases_of
from exam.sizes import records
from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.options import DEFAULT
from fieldmodels.diagnosis.verdict import most_likely


def verdict(machine, conditions, seed):
    bench = get_bench(machine)
    train, test = (bench.recording(log, conditions, seed) for log in records(bench, (), conditions, seed))
    return diagnose(bench.model, [train], [test])


def test_wheels_at_rest_drive_nothing():
    """A slip of 0.99 would remove 8 % of the heading's error, which is the wheels' own noise."""
    found = verdict("differential_drive", Conditions(commands="rest"), 7)
    assert found.verdict == "consistent"
    assert not found.causes


def test_slow_wheels_are_used():
    bench, conditions = get_bench("differential_drive"), Conditions()
    logs = records(bench, (), conditions, 7)
    assert len(bench.model.stages([bench.recording(log, conditions, 7) for log in logs])) == 2


@pytest.mark.nightly
def test_a_straight_drive_tells_nothing_of_a_slip_in_turning():
    """Its heading moves by the wheels' noise alone, and so the heading's error follows the heading."""
    bench, conditions = get_bench("differential_drive"), Conditions(commands="straight")
    logs = [bench.recording(log, conditions, 1074) for log in records(bench, (), conditions, 1074)]
    motion, drive = bench.model.stages(logs)
    assert not {"yaw_slip"} & {*motion.effects, *drive.effects}
    assert diagnose(bench.model, logs[:1], logs[1:]).verdict == "consistent"


class Tried:
    """Curves that are scored already."""

    needed = 9.0

    def __init__(self, *judged):
        self.judged = judged

    def judge(self, _kept):
        return list(self.judged)

    def beside_walks(self, _kept, scored):
        return scored.walks


def scored(place, over, total, p, walks=5.0):
    curve = SimpleNamespace(place=place, over=over)
    return SimpleNamespace(curve=curve, total=total, p_value=p, walks=walks)


@pytest.mark.parametrize(
    ("curve", "far", "doubted"),
    [
        (scored("force", "angle", 10.0, 0.06), False, True),
        (scored("force", "angle", 8.0, 0.06), False, False),  # too few nats
        (scored("force", "angle", 31.0, 0.001, 4.0), False, False),  # a sensor that wanders
        (scored("force", "x", 25.0, 0.12), False, False),  # not steady over blocks
        (scored("sensor", "angle", 31.0, 0.015), False, False),  # of the sensor
        (scored("force", "time", 31.0, 0.015), False, False),  # a drift
        (scored("sensor", "time", 1.0, 0.9), True, True),  # whatever it is
    ],
)
def test_an_error_above_white_noise_needs_a_likely_curve_unless_it_is_far_above(curve, far, doubted):
    assert bool(most_likely(Tried(curve), None, far, DEFAULT)) == doubted


def test_pink_noise_is_nothing_missing():
    """Of 3 times its white part over a third of a second."""
    case = next(
        case for case in cases_of("develop", ["pendulum"], ["nothing"])
        if case.conditions == Conditions(noise="pink")
    )  # fmt: skip
    found = verdict("pendulum", case.conditions, case.seed)
    assert max(found.above_noise.values()) > DEFAULT.above
    assert found.verdict == "consistent"
