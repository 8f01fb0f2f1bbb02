"""Where an exam lists a fault's curve: what fits and what does not, and that its machine has such places."""

from __future__ import annotations

import pytest

from exam.benches import bench_names, get_bench
from exam.places import PAST, read, shown_at, signals
from exam.plants import axis_unlisted
from fieldmodels.drivers.variables import CHANGE, MEMORY, SHARE, WAY, remembering
from fieldmodels.model import Model

FAMILIES = (("rig", "pendulum", "propeller_arm", "servo"), ("pose_reaching", "differential_drive"))
"""Machines that share their faults."""
ALONE = tuple((name,) for name in bench_names() if not any(name in family for family in FAMILIES))
CURVES = (*remembering("torque", 0.5, 1.2), *(f"{CHANGE}torque{over}" for over in ("", " over 0.02 s")))


@pytest.mark.every(
    ("curve", "listed"),
    [
        (("force", "", "velocity"), "force over velocity"),
        (("force", "", "size of velocity"), "force over velocity"),
        (("force", "", "rate of position"), "force over velocity"),
        (("force", "", "velocity times size of position"), "force over position*velocity"),
        (("force", "", "size of position times velocity"), "force over velocity*position"),
        (("force", "", "torque times memory of size of torque over 1 s"), "force over past of torque"),
        (("force", "", "change of torque times time"), "force over past of torque*time"),
        (("force", "turn rate", "turn_rate"), "force turn rate|left wheel over turn rate"),
        (("force", f"{SHARE}forward speed", f"{WAY}speed"), "force share of forward speed over speed"),
        (("sensor", "strike_angle", "time"), "sensor strike_angle over time"),
        (("sensor", "angle", "angle"), "sensor position|angle over position|angle"),
        (("sensor", "angle", "angle"), "sensor over angle"),
        (("sensor", "bank", "north"), "sensor bank"),
        (("parameter", "gravity_moment", "time"), "parameter gravity moment over time"),
        (("odds", "detected", "north times east"), "odds detected over north*east"),
    ],
)
def test_a_curve_fits_what_is_listed(curve: tuple[str, str, str], listed: str):
    assert shown_at(*curve, ["force over nothing", listed])


@pytest.mark.every(
    ("curve", "listed"),
    [
        (("force", "", "position"), "force over velocity"),
        (("force", "", "velocity"), "force over position*velocity"),
        (("force", "", "position times velocity"), "force over velocity"),
        (("force", "", "rate of velocity"), "force over velocity"),
        (("force", "", "torque"), "force over past of torque"),
        (("force", "", "memory of position over 1 s"), "force over past of torque"),
        (("force", "", "torque times time"), "force over past of torque*time"),
        (("sensor", "position", "velocity"), "force over velocity"),
        (("sensor", "velocity", "position"), "sensor position over position"),
        (("force", "turn rate", "speed"), "force forward speed over speed"),
        (("force", f"{SHARE}turn rate", "x"), "force turn rate over x"),
        (("parameter", "damping", "time"), "parameter stiffness over time"),
        (("sensor", "position", "time"), "sensor position|angle over position|angle"),
    ],
)
def test_another_variable_place_or_target_does_not_fit(curve: tuple[str, str, str], listed: str):
    assert not shown_at(*curve, [listed])


def test_nothing_fits_an_empty_list():
    assert not shown_at("force", "", "velocity", [])


@pytest.mark.every("over", CURVES)
def test_what_remembers_a_signal_is_read_as_its_past(over: str):
    assert signals(over) == {f"{PAST}torque"}
    assert shown_at("force", "", over, ["force over past of torque"])
    assert shown_at("force", "", over, ["force over torque"])


def places(model: Model) -> dict[str, set[str]]:
    """Targets that a machine has at every place."""
    pushes = (*model.pushes, *model.staged)
    return {
        "force": {p.name for p in pushes} | {f"{SHARE}{p.name}" for p in pushes if p.rate},
        "sensor": {s.name for s in model.outputs if not s.event},
        "parameter": {p.name for p in model.parameters},
        "odds": {s.name for s in model.outputs if s.event},
    }


def variables(model: Model) -> set[str]:
    """Signals over which curves of a machine may run."""
    moved = [s.name for s in (*model.outputs, *model.unmeasured)]
    told = [s.name for s in (*model.inputs, *model.sums)]
    return {"time", *moved, *told, *(f"rate of {name}" for name in moved)}


def plain(names: set[str]) -> set[str]:
    return {name.replace("_", " ") for name in names}


def lines(machine: str) -> dict[str, tuple[str, ...]]:
    """What is listed of every kind of unlisted fault on a machine."""
    kinds = get_bench(machine).unlisted.values()
    return {name: fault.shows for one in kinds for name, fault in one.items()}


@pytest.mark.every("family", [*FAMILIES, *ALONE])
def test_every_name_that_is_listed_exists_on_a_machine(family: tuple[str, ...]):
    models = [get_bench(name).model for name in family]
    known = {place: plain(set().union(*(places(m)[place] for m in models))) for place in places(models[0])}
    over = plain(set().union(*map(variables, models)))
    for fault, listed in lines(family[0]).items():
        for line in map(read, listed):
            assert line.targets or known[line.place] == {""} or line.place not in known, (fault, line)
            assert line.targets <= known[line.place], (fault, line.targets - known[line.place])
            for one in line.variables:
                named = {name.removeprefix(PAST) for name in one}
                assert named <= over, (fault, named - over)
                assert f"{PAST}time" not in one, fault


@pytest.mark.every("machine", bench_names())
def test_what_is_listed_of_a_fault_can_be_shown_on_each_machine(machine: str):
    model = get_bench(machine).model
    known, over = places(model), plain(variables(model))
    for fault, listed in lines(machine).items():
        possible = [
            line
            for line in map(read, listed)
            if (not line.targets or line.targets & plain(known[line.place]))
            and (not line.variables or any({n.removeprefix(PAST) for n in s} <= over for s in line.variables))
        ]
        assert possible or not listed, fault


def test_machines_of_a_family_have_the_same_lines():
    for family in FAMILIES:
        assert all(lines(name) == lines(family[0]) for name in family)


def test_a_late_sensor_is_not_a_bent_one():
    late, bent = axis_unlisted.LATE, axis_unlisted.BENT
    assert not shown_at("sensor", "position", "position", late)
    assert shown_at("sensor", "position", f"{MEMORY}position over 0.1 s", late)
    assert not shown_at("sensor", "position", "velocity", bent)
