"""A budget of time: the best verdict so far, labelled; without one the clock decides nothing."""

import numpy as np
import pytest

from fieldmodels.diagnosis import diagnose, procedure
from fieldmodels.diagnosis.budget import JUDGED, SEARCH, Budget
from fieldmodels.diagnosis.candidates import Candidates
from fieldmodels.diagnosis.effort import simulated
from fieldmodels.model import Effect, Model, Parameter, Signal
from fieldmodels.recording import Recording

STEP = 0.05


class Cart(Model):
    """v' = u / mass - drag v; v is measured, and the drag is hidden."""

    name = "cart"
    inputs = (Signal("force", "N"),)
    outputs = states = (Signal("speed", "m/s", noise=0.01),)
    parameters = (Parameter("mass", "kg", 1.0, 0.1, 10.0, 0.1),)
    effects = (
        Effect("drag", "Air.", "force", (Parameter("rate", "1/s", 0.0, -5.0, 5.0, 0.05),)),
        Effect("slope", "A hill.", "force", (Parameter("pull", "m/s2", 0.0, -5.0, 5.0, 0.05),)),
    )
    horizons = (0.5, 1.0)

    def simulate(self, parameters, windows):
        mass, rate, pull = np.atleast_2d(parameters).T[:, :, None]
        force = windows.recording["force"]
        speed = np.repeat(windows.states[None, :, 0], len(mass), axis=0)
        out = np.empty((len(mass), len(windows), windows.samples, 1))
        for n in range(windows.samples):
            out[:, :, n, 0] = speed
            u = force[np.minimum(windows.starts + n, len(force) - 1)]
            speed = speed + STEP * (u / mass - rate * speed + pull)
        return out

    def initial_states(self, recording, starts):
        return recording["speed"][starts][:, None]


def record(seed):
    rng = np.random.default_rng(seed)
    force = np.repeat(rng.normal(size=200), 10)
    speed = np.zeros(2001)
    for n, u in enumerate(force):
        speed[n + 1] = speed[n] + STEP * (u / 1.4 - 0.6 * speed[n])
    noisy = speed[:-1] + 0.01 * rng.normal(size=2000)
    return Recording(np.arange(2000) * STEP, {"force": force, "speed": noisy})


def ticking(monkeypatch, ticks):
    """A clock that moves a second whenever it is looked at, in place of the diagnosis's."""
    monkeypatch.setattr(
        procedure, "Budget", lambda seconds: Budget(seconds, clock=iter(range(ticks)).__next__)
    )


def as_data(diagnosis):
    return diagnosis.to_json() | {"seconds": 0}


def test_the_best_so_far_is_given_and_what_was_not_tried_is_said(monkeypatch):
    """The clock moves a second with each effect that is fitted; search and judging end after two."""
    fitted, extended = [], Candidates._extended
    monkeypatch.setattr(Candidates, "_extended", lambda *given: (extended(*given), fitted.append(1))[0])
    monkeypatch.setattr(procedure, "Budget", lambda seconds: Budget(seconds, clock=lambda: len(fitted)))
    short = diagnose(Cart(), [record(1)], budget=1.9 / JUDGED)
    assert [c.effect for c in short.causes] == ["drag"]
    assert "not tried: drag + slope, slope + drag, mistaken columns, which effects" in short.stopped
    assert short.stopped in short.summary()
    assert short.to_json()["stopped"] == short.stopped


def test_before_anything_was_tried_nothing_is_named(monkeypatch):
    ticking(monkeypatch, 1000)
    short = diagnose(Cart(), [record(1)], budget=0.5 / SEARCH)
    assert short.causes == ()
    assert "not tried: drag, slope, mistaken columns, unlisted curves and" in short.stopped
    assert short.misfit == ()


def test_a_budget_that_suffices_changes_nothing():
    assert as_data(diagnose(Cart(), [record(2)], budget=1e6)) == as_data(diagnose(Cart(), [record(2)]))


def test_without_a_budget_the_clock_is_not_looked_at(monkeypatch):
    ticking(monkeypatch, 0)  # a look at this clock would raise
    assert diagnose(Cart(), [record(1)]).causes


def test_what_is_left_out_is_shortened():
    times = iter([0.0, 5.0, 5.0, 5.0, 5.0, 5.0, 5.0, 6.0])
    budget = Budget(4.0, clock=lambda: next(times))
    assert all(budget.lacks(what) for what in "abcdea")
    assert budget.words() == "Stopped after 6 s of a budget of 4 s; not tried: a, b, c, d and 1 more."
    with pytest.raises(ValueError, match="give a positive time"):
        Budget(0.0)


def test_a_step_that_outlasts_the_time_ends_amid_it_and_what_stood_before_stays():
    """The clock moves a second at each look: one before the step, one at each simulation in it."""
    budget = Budget(4.0 / JUDGED, clock=iter(range(20)).__next__)
    done = []

    def step():
        for n in range(10):
            simulated(1)
            done.append(n)
        return "with it"

    assert budget.within("a step", step, "without it") == "without it"
    assert done == [0, 1]
    assert budget.within("another", step, "without it") == "without it"
    assert budget.left_out == ["a step", "another"]
    assert Budget().within("a step", step, "without it") == "with it"
    simulated(1)  # nobody asks any more
