"""Nothing is silently wrong at the door: units, clocks and what a column is, on generated files."""

import numpy as np
import pytest

from fieldagents.logs import Logs
from fieldmodels.recording import RecordingError
from fieldmodels.recording.files import recording_of
from fieldmodels.recording.proposals import propose
from fieldmodels.recording.reading import read_table
from fieldmodels.recording.words import unit_of
from fieldmodels.registry import get_model
from fieldmodels.synthesis import synthesise

RIG = get_model("rig")


@pytest.fixture(scope="module")
def rig():
    rng = np.random.default_rng(0)
    made = synthesise(RIG, {}, "mixed", duration=15.0, step=0.01, amplitude=3.0, rng=rng, noise=True)
    return {
        "t": made.time,
        "force": made["force"],
        "position": made["position"],
        "velocity": made["velocity"],
    }


def written(path, header, *columns):
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.9g")
    return path


def known_as(path, model=RIG):
    """Signals as proposed, and the proposals by role."""
    table = read_table(path)
    proposal = propose(table, model)
    return recording_of(table, proposal.bench(), model), {c.role: c for c in proposal.columns}


# Units


@pytest.mark.parametrize(
    ("header", "unit"),
    [
        ("x [mm]", "mm"), ("x (in/s)", "in/s"), ("x_mm", "mm"), ("x/mm", "mm"), ("x in mm", "mm"),
        ("x in m", "m"), ("speed (rpm) left", "rpm"), ("angle [deg] (filtered)", "deg"), ("force_kip", "kip"),
        ("velocity in/s", "in/s"), ("speed_ft/s", "ft/s"), ("torque (ft-lb)", "ft-lb"), ("p [psi]", "psi"),
        ("control[0]", ""), ("data[3]", ""), ("q[1]", ""), ("q[0:3]", ""), ("Motor speed (5)", ""),
        ("x(t)", ""), ("W (IMU)", ""), ("torque (left)", ""), ("joint_act", ""), ("robot_psi", ""),
        ("force (kip2)", "kip2"), ("angle [foo]", "foo"), ("angle (counts)", "counts"),
    ],
)  # fmt: skip
def test_a_unit_is_read_from_any_notation(header, unit):
    """An index, a motor's number, an argument and words that describe are none; what nobody knows is kept."""
    assert unit_of(header) == unit


@pytest.mark.parametrize(
    "header",
    [
        "time (s),force (kip),position (in),velocity (in/s)",
        "time_s,force_kip,position_in,velocity_in/s",
        "time / s,force / kip,position / in,velocity / in/s",
        "time,force,position,velocity\ns,kip,in,in/s",
    ],
)
def test_units_beyond_the_usual_ones_have_their_factors(tmp_path, rig, header):
    """1 kip is 4448.222 N (1000 lbf), 1 in is 0.0254 m."""
    columns = rig["t"], rig["force"] / 4448.2216, rig["position"] / 0.0254, rig["velocity"] / 0.0254
    read, found = known_as(written(tmp_path / "log.csv", header, *columns))
    for name in ("force", "position", "velocity"):
        np.testing.assert_allclose(read[name], rig[name], rtol=1e-6, atol=1e-9)
        assert found[name].confidence >= 0.9


def test_an_unknown_unit_is_said_and_asked_and_an_accept_settles_it(tmp_path, rig):
    path = written(tmp_path / "log.csv", "t,force (kip2),position", rig["t"], rig["force"], rig["position"])
    with pytest.raises(
        RecordingError, match=r"the header says \(kip2\), which is no unit that is known"
    ) as error:
        Logs(RIG).read(str(path))
    assert "'force=force (kip2):UNIT'" in str(error.value)
    with pytest.warns(match="N is assumed"):
        read = Logs(RIG, accept=True).read(str(path))
    np.testing.assert_allclose(read["force"], rig["force"], rtol=1e-6)
    told = Logs(RIG, {"": {"force": "force (kip2):kip"}}, accept=True)
    (tmp_path / "bench.yaml").unlink()
    assert np.ptp(told.read(str(path))["force"]) == pytest.approx(4448.2216 * np.ptp(rig["force"]), rel=1e-6)


def test_a_clock_of_an_unknown_unit_is_asked_for(tmp_path, rig):
    path = written(tmp_path / "log.csv", "time (foo),force,position", rig["t"], rig["force"], rig["position"])
    clock = known_as(path)[1]["t"]
    assert (clock.unit, clock.confidence) == ("s", 0.8)
    assert "(foo)" in clock.evidence[0]


def test_words_in_brackets_tell_what_a_column_is(tmp_path, rig):
    """A description is no unit, and counts as a word of the name."""
    header = "time,force (measured),force (cmd),position"
    columns = rig["t"], rig["force"] + 0.5, rig["force"], rig["position"]
    assert known_as(written(tmp_path / "log.csv", header, *columns))[1]["force"].column == "force (cmd)"
