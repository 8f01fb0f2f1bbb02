"""The next measurement stays within the recorded range, and distinguishes what the first one could not."""

from __future__ import annotations

import numpy as np
import pytest

from fieldagents.config import ConfigError, load_config
from fieldagents.record import make_recording
from fieldagents.record.config import RecordConfig
from fieldmodels.diagnosis import Diagnosis, diagnose
from fieldmodels.diagnosis.options import DiagnosisOptions
from fieldmodels.diagnosis.planned_inputs import limits_of, planned, shapes
from fieldmodels.diagnosis.report import write_results
from fieldmodels.recording import Recording, RecordingError
from fieldmodels.recording.files import load_recording, save_recording
from fieldmodels.registry import get_model
from fieldmodels.synthesis import synthesise

RIG = get_model("rig")


def recorded(reality: dict[str, dict[str, float]], seed: int) -> list[Recording]:
    """A record to fit, and one to measure gains on."""
    return [
        synthesise(
            RIG, reality, "mixed", duration=24.0, amplitude=8.0, rng=np.random.default_rng([seed, k]),
        )
        for k in range(2)
    ]  # fmt: skip


def named(found: Diagnosis) -> list[set[str]]:
    return [{cause.effect, *cause.alternatives} for cause in found.causes]


@pytest.fixture(scope="module", params=["rules", "evidence"])
def late(request: pytest.FixtureRequest) -> tuple[list[Recording], Diagnosis, DiagnosisOptions]:
    """A rig whose command is 6 ms late, for which a lag is as good an explanation."""
    records, options = (
        recorded({"actuator_delay": {"delay": 0.006}}, 9),
        DiagnosisOptions(engine=request.param),
    )
    return records, diagnose(RIG, records[:1], records[1:], options=options), options


def test_every_planned_input_keeps_to_the_recorded_range_and_rate():
    (record, _) = recorded({}, 1)
    limits = limits_of(RIG, [record])
    force = record["force"]
    time = np.arange(2000) * record.step
    for shape in shapes(record.step, force[:, None], limits).values():
        values = planned(limits, shape, time, 1.0, np.random.default_rng(0))[:, 0]
        assert values.min() >= force.min() - 1e-12
        assert values.max() <= force.max() + 1e-12
        assert np.abs(np.diff(values)).max() <= np.abs(np.diff(force)).max() + 1e-12
        assert np.ptp(values) > 0.2 * np.ptp(force)


@pytest.mark.nightly
def test_the_plan_keeps_the_machine_where_it_has_been(late):
    records, found, _ = late
    assert found.verdict == "ambiguous"
    assert named(found) == [{"actuator_lag", "actuator_delay"}]
    plan = found.next_measurement.plan
    shown = synthesise(
        RIG, {"actuator_delay": {"delay": 0.006}}, {"force": plan["force"]},
        rng=np.random.default_rng(1), noise=False,
    )  # fmt: skip
    for output in ("position", "velocity"):
        half = 0.5 * np.ptp(records[0][output])
        middle = records[0][output].min() + half
        assert np.abs(shown[output] - middle).max() < 1.1 * half
    assert "nothing beyond what was recorded" in found.next_measurement.why


def test_the_planned_measurement_decides_between_lag_and_delay(late, tmp_path):
    """From the first diagnosis to the second through the files that a user has."""
    records, found, options = late
    expected = found.next_measurement.input
    assert expected["nats"] == max(expected["nats"], *expected["compared"].values())
    assert 0.5 < expected["probability"] <= 1.0
    paths = write_results(found, tmp_path, drawn={})
    config = load_config(
        paths["next_record.yaml"], RecordConfig, ["reality.actuator_delay.delay=0.006", "seed=5"]
    )
    again = make_recording(config)
    np.testing.assert_allclose(again["force"], found.next_measurement.plan["force"])
    assert len(again) == round(expected["duration_s"] / 0.01)
    second = diagnose(RIG, [records[0], again], records[1:], options=options)
    assert named(second) == [{"actuator_delay"}]
    assert second.causes[0].parameters["delay"].value == pytest.approx(0.006, abs=3e-4)


@pytest.mark.nightly
def test_where_nobody_chooses_the_input_it_says_which_moments_count():
    from fieldmodels.diagnosis.candidates import Candidates
    from fieldmodels.diagnosis.next_measurement import next_measurement
    from fieldmodels.diagnosis.problem import build
    from fieldmodels.diagnosis.selection import Selection

    class Unsteered(type(RIG)):
        inputs_are_free = False

    (record, _) = recorded({"quadratic_drag": {"coefficient": 3.0}}, 3)
    model = Unsteered().scaled_to([record])
    problem = build(model, [record], 0.5)
    candidates = Candidates(
        problem, model.nominal, frozenset(), problem.blocks % 4, np.diag(1 / problem.output_scale)
    )
    base = candidates.base()
    drag, dry = (candidates.extend(base, name) for name in ("quadratic_drag", "coulomb_friction"))
    selection = Selection(base, drag, (dry,), base, (drag, dry), ())
    found = next_measurement(candidates, selection, "ambiguous", np.random.default_rng(0))
    assert found.plan is None
    assert found.input["nats"] > 1
    assert found.input["times"] > 1.2
    assert "s in which the" in found.why
    # Where single effects are no better than nothing, there is nothing to distinguish.
    assert next_measurement(candidates, selection, "consistent", np.random.default_rng(0)) is None


def test_what_is_promised_goes_by_the_errors_that_remained_and_only_the_ambiguous_is_measured_again():
    from fieldmodels.diagnosis.candidates import Candidates
    from fieldmodels.diagnosis.next_measurement import next_measurement
    from fieldmodels.diagnosis.problem import build
    from fieldmodels.diagnosis.selection import Selection

    promised = []
    for times in (1.0, 4.0):  # errors of so many times the noise that the model declares
        record = synthesise(
            RIG, {"actuator_delay": {"delay": 0.006}}, "mixed", duration=24.0, amplitude=8.0, noise=times,
            rng=np.random.default_rng(4),
        )  # fmt: skip
        problem = build(RIG, [record], 0.5)
        candidates = Candidates(
            problem, RIG.nominal, frozenset(), problem.blocks % 4, np.diag(1 / problem.output_scale)
        )
        base = candidates.base()
        late, slow = (candidates.extend(base, name) for name in ("actuator_delay", "actuator_lag"))
        selection = Selection(base, late, (slow,), base, (late, slow), ())
        plan = next_measurement(candidates, selection, "ambiguous", np.random.default_rng(0))
        promised.append(max(plan.input["compared"].values()))
        for verdict in ("named", "unknown", "consistent"):
            assert next_measurement(candidates, selection, verdict, np.random.default_rng(0)) is None
    assert 3.0 < promised[0] / promised[1] < 32.0  # by sensor noise alone it would be 1


def test_a_planned_input_that_does_not_fit_is_refused(tmp_path):
    time = np.arange(100) * 0.01
    save_recording(Recording(time=time, signals={"force": np.sin(time)}), tmp_path / "input.csv")
    assert "force" in load_recording(tmp_path / "input.csv")

    def config(**more: object) -> RecordConfig:
        return RecordConfig.model_validate(
            {"name": "next", "model": "rig", "input": str(tmp_path / "input.csv"), "duration": 1.0, **more}
        )

    assert len(make_recording(config())) == 100
    with pytest.raises(RecordingError, match="set duration: 1"):
        make_recording(config(duration=2.0))
    with pytest.raises(RecordingError, match=r"set step: 0\.01"):
        make_recording(config(step=0.02))
    with pytest.raises(RecordingError, match="column torque is missing"):
        make_recording(config(model="pendulum"))
    (tmp_path / "walk.yaml").write_text("name: a\nmodel: heel_strike\nduration: 3\ninput: input.csv\n")
    with pytest.raises(ConfigError, match="does not take this key"):
        load_config(tmp_path / "walk.yaml", RecordConfig)
