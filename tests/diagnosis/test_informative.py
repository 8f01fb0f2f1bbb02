"""Long records: the windows that tell most are fitted, and simulated as within the whole record."""

import numpy as np
import pytest

from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.candidates import Candidates
from fieldmodels.diagnosis.informative import evenly, informative
from fieldmodels.diagnosis.options import DiagnosisOptions
from fieldmodels.diagnosis.problem import build
from fieldmodels.registry import get_model
from fieldmodels.synthesis import synthesise

STEP, COUNT = 0.02, 10_000
MOVING = slice(6000, 6800)


@pytest.fixture(scope="module")
def record():
    """A rig that shivers for 200 s, but for 16 s in which it moves; its friction is hidden."""
    rng = np.random.default_rng(3)
    command = 0.02 * np.repeat(rng.uniform(-1.0, 1.0, COUNT // 20), 20)
    command[MOVING] *= 400.0
    return synthesise(
        get_model("rig"), {"coulomb_friction": {"force": 0.3}}, command[:, None], step=STEP, rng=rng
    )


def candidates_of(record, rows):
    model = get_model("rig").scaled_to([record])
    problem = build(model, [record], 0.5)
    return Candidates(
        problem=problem, start=model.nominal, fixed=frozenset(), folds=problem.folds,
        whitener=np.diag(1 / problem.output_scale), options=DiagnosisOptions(rows=rows),
    )  # fmt: skip


def test_windows_in_which_something_moves_are_chosen(record):
    candidates = candidates_of(record, rows=3200)
    chosen, said = informative(candidates)
    starts = chosen.parts[0].windows.starts
    inside = (starts >= MOVING.start) & (starts < MOVING.stop - 25)
    whole = candidates.problem.parts[0].windows.starts
    moving = np.sum((whole >= MOVING.start) & (whole < MOVING.stop - 25))
    assert inside.sum() >= 0.8 * moving, "an even choice has a third of them"
    assert np.ptp(starts[~inside]) > 0.8 * COUNT, "the rest is spread over the record"
    assert len(chosen) < 0.4 * len(candidates.problem)
    assert said.startswith(f"{len(chosen)} of {len(candidates.problem)} training windows are fitted")
    assert np.array_equal(informative(candidates)[0].parts[0].windows.starts, starts), "no chance"


def test_blocks_of_a_choice_are_numbered_anew_so_that_folds_are_balanced(record):
    kept, said = evenly(candidates_of(record, 3200).problem, 3200)
    assert np.array_equal(np.unique(kept.blocks), np.arange(kept.blocks.max() + 1))
    assert np.ptp(np.bincount(kept.folds)) <= 8
    assert said == f"{len(kept)} of {len(candidates_of(record, 3200).problem)} windows, spread evenly"


def test_chosen_windows_are_simulated_as_within_the_whole_record(record):
    """What led to them counts: commands that a delay and a lag have kept."""
    whole = candidates_of(record, 3200).problem
    kept, _ = evenly(whole, 3200)
    effects = {
        "actuator_lag": {"time_constant": 0.03}, "actuator_delay": {"delay": 0.11},
        "hysteresis": {"force": 0.4, "distance": 0.002}, "periodic_force": {"sine": 0.5, "frequency": 0.7},
    }  # fmt: skip
    for name in effects:
        vector = whole.model.vector(effects={name: effects[name]})[None]
        part = kept.parts[0]
        same = np.isin(whole.parts[0].windows.starts, part.windows.starts)
        expected = whole.simulate(vector, whole.states)[:, same]
        assert len(part.windows.pieces) > 10
        found = kept.simulate(vector, kept.states)
        assert np.allclose(found, expected, rtol=0, atol=1e-6 * expected.std()), name


@pytest.mark.nightly
def test_a_diagnosis_of_chosen_windows_says_so_and_finds_what_is_hidden(record):
    diagnosis = diagnose(get_model("rig"), [record], options=DiagnosisOptions(rows=3200))
    assert [c.effect for c in diagnosis.causes] == ["coulomb_friction"]
    assert diagnosis.causes[0].parameters["force"].value == pytest.approx(0.3, abs=0.01)
    assert diagnosis.notes[0].startswith(f"{diagnosis.windows[0]} of ")
    assert list(diagnosis.notes) == diagnosis.to_json()["data"]["notes"]
