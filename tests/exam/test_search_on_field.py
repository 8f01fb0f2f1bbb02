"""Cases of the field set on which the search by evidence rests, by plants that share no code with it."""

import pytest

from exam.benches import get_bench
from exam.cases import cases_of
from exam.field.cases import field_cases, make
from exam.sizes import recordings
from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.options import DiagnosisOptions


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
    options = DiagnosisOptions(engine="evidence")
    found = diagnose(made.model, made.train, made.test, fixed=made.fixed, options=options)
    assert {cause.effect for cause in found.causes} == named
    assert not found.curves


def test_curves_beside_each_other_are_stated_of_the_simulation_without_them():
    """A robot whose sensors' zeros walk at random: two curves follow them."""
    case = next(c for c in cases_of("develop", ["pose_reaching"], ["nothing"]) if c.seed == 1050)
    bench = get_bench(case.machine)
    train, test = recordings(bench, (), case.conditions, case.seed)
    found = diagnose(bench.model, [train], [test], options=DiagnosisOptions(engine="evidence"))
    assert len(found.curves) == 2
    assert set(found.wandering) <= {output.name for output in bench.model.outputs}
