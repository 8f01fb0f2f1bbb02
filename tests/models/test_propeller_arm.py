"""An arm that a propeller lifts, against the pendulum, and what it hides."""

from __future__ import annotations

import numpy as np
import pytest

from fieldmodels.diagnosis import diagnose
from fieldmodels.machines.pendulum import Pendulum
from fieldmodels.machines.propeller_arm import PropellerArm
from fieldmodels.recording import Recording, Windows
from fieldmodels.synthesis import synthesise

STEP = 0.01
BASE = {"inertia": 0.02, "damping": 0.01, "gravity_moment": 0.17}


def flown(command, effects, model=None, base=None):
    """Angle and rate of one window under a command, from 0.2 rad at rest."""
    model = model or PropellerArm()
    n = len(command)
    recording = Recording(
        np.arange(n) * STEP, {model.inputs[0].name: command, "angle": np.zeros(n), "velocity": np.zeros(n)}
    )
    states, observed = np.array([[0.2, 0.0]]), np.ones((1, n, 2), dtype=bool)
    windows = Windows(recording, np.array([0]), np.array([n]), states, observed)
    return model.simulate(model.vector(base or BASE, effects)[None], windows)[0, 0]


def commands(n=300):
    return np.repeat(np.random.default_rng(4).uniform(-0.2, 0.6, n // 20), 20)


def test_without_a_thrust_curve_it_is_the_pendulum_to_rounding():
    command = commands()
    base = {"inertia": 0.02, "gravity_moment": 0.17}
    as_pendulum = flown(command, {"viscous_friction": {"coefficient": 0.01}}, Pendulum(), base)
    np.testing.assert_allclose(flown(command, {}), as_pendulum, rtol=1e-12)


def test_vectors_of_a_batch_have_exponents_of_their_own():
    arm = PropellerArm()
    command = commands()
    recording = Recording(np.arange(300) * STEP, {"command": command, "angle": 0.1 * command})
    windows = arm.windows(recording, 0.5)
    effects = [{}, {"thrust_curve": {"exponent": 2.0}}, {"thrust_curve": {"exponent": 1.5}}, {}]
    vectors = np.array([arm.vector(BASE, e) for e in effects])
    together = arm.simulate(vectors, windows)
    for vector, outputs in zip(vectors, together, strict=True):
        np.testing.assert_array_equal(arm.simulate(vector[None], windows)[0], outputs)
    assert np.abs(together[0] - together[1]).max() > 0.01


def test_effects_with_a_mass_in_kilograms_are_left_out():
    names = [effect.name for effect in PropellerArm().effects]
    assert "payload" not in names
    assert set(names) - {"thrust_curve"} < {effect.name for effect in Pendulum().effects}


def test_a_square_of_the_command_that_is_hidden_is_found():
    rng = np.random.default_rng(3)
    arm, reality = PropellerArm(), {"parameters": BASE, "thrust_curve": {"exponent": 2.0}}
    # Held up by a steady thrust, moved about there, as the bench's controller does.
    drives = [0.33 + 0.08 * rng.uniform(-1, 1, 60).repeat(40) for _ in range(2)]
    train, test = (
        synthesise(arm, reality, drive, step=STEP, noise={"angle": 2e-3, "velocity": 0}, rng=rng)
        for drive in drives
    )
    # The rate is not measured on the bench.
    train, test = (Recording(r.time, {k: r[k] for k in ("command", "angle")}) for r in (train, test))
    found = diagnose(arm, [train], [test])
    (curve,) = found.causes
    assert curve.effect == "thrust_curve"
    assert curve.parameters["exponent"].value == pytest.approx(2.0, abs=0.1)
