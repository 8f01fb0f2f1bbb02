"""Cases of the field set on which the search by evidence rests, by plants that share no code with it."""

import numpy as np
import pytest

from exam.answers import ask
from exam.benches import get_bench
from exam.benches.base import Hidden
from exam.cases import cases_of
from exam.field.cases import field_cases, make
from exam.logs import STATEMENTS, NoDataError, failures
from exam.sizes import recordings
from fieldmodels.diagnosis import diagnose, procedure
from fieldmodels.diagnosis.candidates import Candidates
from fieldmodels.diagnosis.cutting import split
from fieldmodels.diagnosis.marginal import Evidence
from fieldmodels.diagnosis.options import DiagnosisOptions
from fieldmodels.registry import get_model

EVIDENCE = DiagnosisOptions(engine="evidence")


@pytest.mark.parametrize(
    ("key", "named"),
    [
        # By the base's weights 22 times the noise bring 3 nats: they look away from a constant error.
        ("crane/listed_single/large/0", {"angle_bias"}),
        # Fitted by the covariance of the base's errors the limit ends at 5.7 V in place of 3.7.
        ("motor/more_listed/usual/0", {"actuator_saturation"}),
    ],
)
def test_a_cause_is_found_whatever_the_weights_of_the_base_look_away_from(key, named):
    made = make(next(case for case in field_cases("develop", (), 0) if case.key == key))
    found = diagnose(made.model, made.train, made.test, fixed=made.fixed, options=EVIDENCE)
    assert {cause.effect for cause in found.causes} == named
    assert not found.curves


def test_a_curve_is_found_whatever_the_weights_of_the_base_look_away_from(monkeypatch):
    """By the covariance of what the base leaves, nothing brings anything: the drag of a load in the air.

    It is delivered as the search has fitted it: no second fit of it is made.
    """
    monkeypatch.setattr(procedure, "improving", None)
    made = make(next(c for c in field_cases("develop", (), 0) if c.key == "crane/load_in_the_air/usual/1"))
    found = diagnose(made.model, made.train, made.test, fixed=made.fixed, options=EVIDENCE)
    assert [(c.target, c.over) for c in found.curves if c.found] == [("rate of rate", "rate")]
    assert not found.causes


@pytest.mark.parametrize(
    ("machine", "seed"),
    [
        ("pose_reaching", 1050),  # its wheels' zeros walk, too, and drive its simulation
        ("differential_drive", 1009),  # 1/f noise gives a curve 30 nats that the test record does not repeat
    ],
)
def test_zeros_that_walk_at_random_are_no_cause(machine, seed):
    case = next(c for c in cases_of("develop", [machine], ["nothing"]) if c.seed == seed)
    bench = get_bench(case.machine)
    train, test = recordings(bench, (), case.conditions, case.seed)
    found = diagnose(bench.model, [train], [test], options=EVIDENCE)
    assert not found.causes
    assert not any(curve.found for curve in found.curves)
    assert set(found.wandering) <= {output.name for output in bench.model.outputs}


def test_inputs_that_sensors_show_wander_too():
    """Without that, the walks of its wheels are a force over time."""
    case = next(c for c in cases_of("develop", ["pose_reaching"], ["nothing"]) if c.seed == 1050)
    bench = get_bench(case.machine)
    train, _ = recordings(bench, (), case.conditions, case.seed)
    [model] = [stage.model for stage in bench.model.stages([train]) if stage.model.noisy_inputs]
    problem, _ = split(model, [train], [])
    candidates = Candidates(
        problem, model.vector({}, {}), frozenset(), problem.folds, np.diag(1 / problem.output_scale)
    )
    fitted, alone = candidates.base().fit, Evidence(problem)
    alone._pushed = []
    assert Evidence(problem).of(problem, fitted).value < alone.of(problem, fitted).value - 100.0


def test_noise_that_is_no_model_of_it_names_no_step():
    """In a loop a parameter's step gains 15 nats, which the test record does not repeat."""
    case = next(c for c in cases_of("develop", ["rig"], ["single"]) if c.seed == 2021)
    bench = get_bench(case.machine)
    hidden = [Hidden(name, 1.18, sign) for name, _, sign in case.drawn()]
    train, test = recordings(bench, hidden, case.conditions, case.seed)
    found = diagnose(bench.model, [train], [test], options=EVIDENCE)
    assert [cause.effect for cause in found.causes] == ["velocity_lag"]


@pytest.mark.parametrize(
    "log",
    [
        "emps_piece_0",  # two seconds, 1,500 times the noise: a periodic force is 15 N, with an error of 40
        "emps_piece_3",  # cogging of 0.6 N with an error of 0.9
        pytest.param("dfki_by_hand", marks=pytest.mark.nightly),  # no sensor wanders by 28 times its noise
    ],
)
def test_what_a_log_of_a_real_machine_does_not_tell_from_nothing_is_not_named(log):
    statement = STATEMENTS[log]
    model = get_model(statement.machine)
    try:
        records = statement.records(model)
    except NoDataError as lacking:
        pytest.skip(str(lacking))
    assert failures(statement, ask(model, *records, {}, (), EVIDENCE)) == []
