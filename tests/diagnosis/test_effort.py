"""What makes a diagnosis fast does not change its result: threads, and simulations that are used again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fieldmodels.diagnosis import candidates, diagnose, signs
from fieldmodels.diagnosis import fit as fitting
from fieldmodels.diagnosis.averages import resolving
from fieldmodels.diagnosis.candidates import Candidate, Candidates
from fieldmodels.diagnosis.effort import VARIABLE, metered, shared, threads_of
from fieldmodels.diagnosis.fit import fit
from fieldmodels.diagnosis.linearisation import Fit, linearise, pseudo_inverse, reweighed
from fieldmodels.diagnosis.options import DiagnosisOptions
from fieldmodels.diagnosis.problem import Problem, build
from fieldmodels.model import Model
from fieldmodels.recording import Recording
from fieldmodels.registry import get_model
from fieldmodels.synthesis import synthesise

SIMULATED = "simulate"


def recorded(seconds: float) -> Recording:
    return synthesise(
        get_model("rig"), {"coulomb_friction": {"force": 0.3}}, "mixed", duration=seconds, step=0.01,
        amplitude=8.0, rng=np.random.default_rng(3),
    )  # fmt: skip


@pytest.fixture(scope="module")
def problem() -> Problem:
    data = recorded(12.0)
    model: Model = get_model("rig").scaled_to([data])
    return build(model, [data], model.horizons[1])


@pytest.fixture(scope="module")
def fitted(problem: Problem) -> Fit:
    free = np.arange(len(problem.model.parameters))
    return fit(problem, problem.model.nominal, free, np.diag(1 / problem.output_scale), iterations=3)


def test_threads_change_no_bit_and_every_simulation_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    data, model = recorded(12.0), get_model("rig")
    windows = 0
    simulate = type(model).simulate

    def counted(self: Model, parameters: np.ndarray, some: object) -> np.ndarray:
        nonlocal windows
        windows += len(parameters) * len(some)  # type: ignore[arg-type]
        return simulate(self, parameters, some)  # type: ignore[arg-type]

    monkeypatch.setattr(type(model), SIMULATED, counted)
    one = diagnose(model, [data], options=DiagnosisOptions(threads=1))
    assert [c.effect for c in one.causes] == ["coulomb_friction"]
    assert 100 < one.simulations <= windows / one.windows[0]
    # Beside problems only a few plain calls simulate: a gain's horizons, the variables of curves.
    assert one.simulations > 0.9 * windows / one.windows[0]
    monkeypatch.undo()
    three = diagnose(model, [data], options=DiagnosisOptions(threads=3))
    assert three.simulations == one.simulations
    assert replace(three, seconds=one.seconds).to_json() == one.to_json()


def test_results_come_in_the_order_of_their_items() -> None:
    assert shared(lambda i: i * i, range(50), 4) == [i * i for i in range(50)]


def test_threads_are_as_wanted_or_as_the_environment_says(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "3")
    assert (threads_of(0), threads_of(2)) == (3, 2)
    monkeypatch.setenv(VARIABLE, "many")
    with pytest.raises(ValueError, match="FIELDGYM_THREADS=many"):
        threads_of(0)
    with pytest.raises(ValueError, match="threads: -1"):
        threads_of(-1)


def test_another_whitener_needs_no_simulation(problem: Problem, fitted: Fit) -> None:
    mixing = np.random.default_rng(0).normal(size=2 * (problem.features.shape[1],))
    again = reweighed(problem, fitted, mixing)
    fresh = linearise(problem, fitted.parameters, fitted.free, mixing, fitted.states, fitted.raw)
    for name in ("residual", "jacobian", "state_residual", "state_jacobian", "cost"):
        np.testing.assert_array_equal(getattr(again, name), getattr(fresh, name))


def test_states_are_projected_out_by_least_squares(problem: Problem, fitted: Fit) -> None:
    """Against NumPy's least squares, window by window."""
    states = fitted.states.shape[1]
    for w in (0, len(problem) - 1):
        columns = np.concatenate([fitted.whitener @ fitted.by_states[w], np.eye(states) / 2.0])
        prior = (problem.states[w] - fitted.states[w]) / (2.0 * problem.state_scale)
        wanted = np.concatenate([fitted.whitener @ fitted.raw[w], prior])
        solved = np.linalg.lstsq(columns, wanted)[0]
        np.testing.assert_allclose(fitted.state_residual[w], solved, rtol=1e-8, atol=1e-10)
        np.testing.assert_allclose(fitted.residual[w], wanted - columns @ solved, rtol=1e-7, atol=1e-9)


def test_states_are_moved_one_at_a_time(problem: Problem, fitted: Fit) -> None:
    steps = np.diag(problem.state_scale)
    together = problem.simulate_from(fitted.parameters, fitted.states + steps[:, None, :])
    for j, step in enumerate(steps):
        alone = problem.simulate(fitted.parameters[None], fitted.states + step)[0]
        np.testing.assert_allclose(together[j], alone, rtol=1e-12)


def test_some_windows_alone_are_simulated_to_the_bit_as_among_all(problem: Problem, fitted: Fit) -> None:
    some = np.arange(len(problem)) % 5 == 2
    alone = problem.simulate_from(fitted.parameters, fitted.states[None], np.flatnonzero(some))[0]
    assert np.array_equal(alone, problem.simulate(fitted.parameters[None], fitted.states)[0][some])


@pytest.mark.nightly
def test_where_steps_follow_from_some_windows_all_are_simulated(
    problem: Problem, fitted: Fit, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = type(problem.model)
    assert problem.model.windows_apart
    monkeypatch.setattr(rig, "pace", None)
    model = rig()
    assert not model.windows_apart
    some = np.arange(len(problem)) < 2
    with metered() as meter:
        other = replace(problem, model=model)
        other.simulate_from(fitted.parameters, fitted.states[None], np.flatnonzero(some))
    assert meter.windows == len(problem)


def test_a_fit_that_stays_at_its_bound_ends_as_the_simpler_effect_and_early(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """On dry friction a bristle's distance shrinks to nothing."""
    hidden = {"coulomb_friction": {"force": 0.3}, "actuator_delay": {"delay": 0.03}}
    data = synthesise(
        get_model("rig"), hidden, "mixed", duration=40.0, step=0.01, amplitude=8.0,
        rng=np.random.default_rng(1),
    )  # fmt: skip
    model = get_model("rig").scaled_to([data])
    problem = build(model, [data], model.horizons[1])

    def tried() -> tuple[Candidate | None, int]:
        search = Candidates(
            problem=problem, start=problem.model.nominal, fixed=frozenset(), folds=problem.folds,
            whitener=np.diag(1 / problem.output_scale),
        )  # fmt: skip
        base = search.base()
        with metered() as meter:
            found = search.extend(base, "hysteresis")
        return found, meter.windows

    early, few = tried()
    monkeypatch.setattr(candidates, "HELD", 1000)
    late, many = tried()
    assert early is late is None
    assert few < many


def test_derivatives_that_still_hold_are_used_again_and_the_end_is_the_same(
    problem: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    free = np.arange(len(problem.model.parameters))

    def ended() -> tuple[Fit, int]:
        with metered() as meter:
            found = fit(problem, 1.2 * problem.model.nominal, free, np.diag(1 / problem.output_scale))
        return found, meter.windows

    again, few = ended()
    monkeypatch.setattr(fitting, "FORESEEN", 0.0)
    anew, many = ended()
    assert few < 0.9 * many
    assert again.cost == pytest.approx(anew.cost, abs=2 * fitting.SETTLED)
    at = again.parameters, again.free, again.whitener, again.states, again.raw
    np.testing.assert_array_equal(again.jacobian, linearise(problem, *at).jacobian)


def test_few_periods_of_a_cogging_are_simulated_and_the_best_or_the_next_one_is_among_them() -> None:
    data = synthesise(
        get_model("rig"), {"cogging": {"sine": 0.4, "period": 0.02}}, "mixed", duration=20.0, step=0.01,
        amplitude=8.0, rng=np.random.default_rng(2),
    )  # fmt: skip
    problem = build(model := get_model("rig").scaled_to([data]), [data], model.horizons[1])
    search = Candidates(
        problem=problem, start=model.nominal, fixed=frozenset(), folds=problem.folds,
        whitener=np.diag(1 / problem.output_scale),
    )  # fmt: skip
    base, effect, own = search.base(), model.effect("cogging"), model.slice_of("cogging")
    few = search.start_vectors(base, effect)
    every = np.repeat(few[:1], len(effect.parameters[2].starts), axis=0)
    every[:, :, own.stop - 1] = np.array(effect.parameters[2].starts)[:, None]
    assert len(few) <= candidates.LINES < len(every)
    assert search.score(base, few)[0].max() > 0.95 * search.score(base, every)[0].max()


def test_what_repeats_beyond_the_way_is_no_cogging(problem: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    model = problem.model
    search = Candidates(
        problem=problem, start=model.nominal, fixed=frozenset(), folds=problem.folds,
        whitener=np.diag(1 / problem.output_scale),
    )  # fmt: skip
    base, cogging = search.base(), model.effect("cogging")
    positions = np.concatenate([part.windows.recording["position"] for part in problem.parts])
    way = 4.0 * np.std(positions)
    for share, beyond in ((0.95, False), (1.05, True)):
        vector = base.fit.parameters.copy()
        vector[model.slice_of("cogging").stop - 1] = share * way
        assert search._never_repeats(cogging, vector) == beyond
    monkeypatch.setattr(Candidates, "_never_repeats", lambda *_: True)
    assert search.extend(base, "cogging") is None


def test_columns_are_not_doubted_where_what_is_found_explains_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(signs, "_hypotheses", lambda *_: pytest.fail("doubted"))
    assert diagnose(get_model("rig"), [recorded(12.0)]).verdict == "named"


def test_averages_that_show_what_a_base_lacks_are_fine_enough(problem: Problem, fitted: Fit) -> None:
    assert resolving(problem, fitted.parameters, lambda _: pytest.fail("fitted more finely")) == 0


def test_pseudo_inverses_are_numpys() -> None:
    half = np.random.default_rng(5).normal(size=(6, 4, 3))
    powers = half @ half.swapaxes(1, 2)  # of rank three
    assert pseudo_inverse(powers) == pytest.approx(np.linalg.pinv(powers, hermitian=True), rel=1e-6, abs=1e-9)
    assert pseudo_inverse(np.zeros((2, 3, 3))) == pytest.approx(np.zeros((2, 3, 3)))
    assert pseudo_inverse(np.zeros((2, 0, 0))).shape == (2, 0, 0)
