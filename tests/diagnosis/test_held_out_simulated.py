"""Held-out windows are simulated where a fit's linearisation holds for no step at all."""

import numpy as np

from fieldmodels.diagnosis.candidates import Candidates
from fieldmodels.diagnosis.fit import fit
from fieldmodels.diagnosis.held_out import held_out_loss, window_loss
from fieldmodels.diagnosis.problem import build
from fieldmodels.model import Model, Parameter, Signal
from fieldmodels.recording import Recording

STEP, NOISE, GAIN = 0.02, 0.002, 0.8
STUCK = 7  # the window in which a latch nearly opens


class Latch(Model):
    """A commanded level; in one window a latch opens by no more than 1.5 times the noise, at one gain."""

    name = "latch"
    inputs = (Signal("command", "1"), Signal("held", "1"))
    outputs = (Signal("level", "m", noise=NOISE),)
    states = (Signal("offset", "m"),)
    parameters = (Parameter("gain", "m", GAIN, -10.0, 10.0, 1e-3),)
    effects = ()
    horizons = (0.4, 0.8)

    def simulate(self, parameters, windows):
        gain = np.atleast_2d(parameters)[:, 0, None, None]
        rows = np.minimum(windows.starts[:, None] + np.arange(windows.samples), len(windows.recording) - 1)
        command, held = windows.recording["command"][rows], windows.recording["held"][rows]
        opened = 1.5 * NOISE * held * np.tanh((gain - GAIN) / 2e-6)
        return (windows.states[:, :1] + gain * command + opened)[..., None]

    def initial_states(self, recording, starts):
        return recording["level"][starts][:, None]


def test_a_window_with_an_infinite_slope_costs_what_it_costs_when_simulated():
    rng = np.random.default_rng(3)
    count = 1640
    command, held = rng.normal(size=count), np.zeros(count)
    start = STUCK * round(0.8 / STEP)
    held[start + 10 : start + 40] = np.linspace(0, 1, 30)
    level = GAIN * command + NOISE * rng.normal(size=count)
    recording = Recording(STEP * np.arange(count), {"command": command, "held": held, "level": level})
    problem = build(Latch(), [recording], 0.8)
    whitener = np.eye(len(problem.outputs)) * np.sqrt(8) / NOISE
    candidates = Candidates(problem, Latch().nominal, frozenset(), problem.folds, whitener)
    found = fit(problem, Latch().nominal, np.array([0]), whitener, iterations=0)
    fitted = window_loss(found)[STUCK]
    assert held_out_loss(found, problem.folds)[STUCK] > fitted + 20  # as the linearisation says
    assert candidates.held_out(found)[STUCK] < fitted + 8  # an opened latch errs by 1.5 times the noise
