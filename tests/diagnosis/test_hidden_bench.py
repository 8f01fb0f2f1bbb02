"""An effect hidden in a bench's data must be found; where nothing is hidden, nothing must be named.

Sizes raise the error of the refitted nominal simulation by about a third over the sensors' noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.result import Diagnosis
from fieldmodels.registry import get_model
from fieldmodels.synthesis import synthesise

Force = Callable[[float, float, float, float], float]
SEEDS = (1, 2)
EXCITATION = {"rig": ("mixed", 8.0), "pendulum": ("swing", 1.2)}
HIDDEN = {
    "rig": {
        "coulomb_friction": {"force": 0.04},
        "stribeck_friction": {"force": 0.12, "velocity": 0.03},
        "hysteresis": {"force": 0.035, "distance": 0.01},
        "cogging": {"sine": 0.025, "cosine": 0.025, "period": 0.08},
        "quadratic_drag": {"coefficient": 1.8},
        "cubic_stiffness": {"coefficient": 200.0},
        "backlash": {"gap": 0.0007},
        "payload": {"mass": 0.035},
        "constant_force": {"force": 0.017},
        "periodic_force": {"sine": 0.03, "cosine": 0.015, "frequency": 1.3},
        "actuator_gain": {"gain": 0.985},
        "actuator_asymmetry": {"difference": 0.015},
        "actuator_lag": {"time_constant": 0.005},
        "actuator_rate_limit": {"rate": 350.0},
        "actuator_delay": {"delay": 0.005},
        "actuator_saturation": {"limit": 6.5},
        "actuator_dead_zone": {"width": 0.035},
        "sensor_bias": {"bias": 0.0025},
        "sensor_drift": {"rate": 1.6e-5},
        "sensor_gain": {"gain": 0.98},
        "sensor_delay": {"delay": 0.003},
        "sensor_quantisation": {"step": 0.0006},
        "parameter_step": {"time": 11.0, "factor": 0.985},
    },
    "pendulum": {
        "viscous_friction": {"coefficient": 0.008},
        "coulomb_friction": {"torque": 0.011},
        "stribeck_friction": {"torque": 0.12, "velocity": 0.2},
        "hysteresis": {"torque": 0.04, "distance": 0.1},
        "cogging": {"sine": 0.006, "cosine": 0.006, "period": 0.4},
        "quadratic_drag": {"coefficient": 0.0042},
        "cubic_stiffness": {"coefficient": 0.085},
        "backlash": {"gap": 0.0045},
        "payload": {"mass": 0.008, "length": 0.3},
        "constant_force": {"torque": 0.008},
        "periodic_force": {"sine": 0.011, "cosine": 0.006, "frequency": 1.3},
        "actuator_gain": {"gain": 0.98},
        "actuator_asymmetry": {"difference": 0.03},
        "actuator_lag": {"time_constant": 0.002},
        "actuator_rate_limit": {"rate": 2.5},
        "actuator_delay": {"delay": 0.002},
        "actuator_saturation": {"limit": 0.95},
        "actuator_dead_zone": {"width": 0.027},
        "sensor_bias": {"bias": 0.009},
        "sensor_drift": {"rate": 0.0006},
        "sensor_gain": {"gain": 0.985},
        "sensor_delay": {"delay": 0.0017},
        "sensor_quantisation": {"step": 0.006},
        "parameter_step": {"time": 11.0, "factor": 0.97},
    },
}
NEEDS_BASE = {"payload", "actuator_gain"}  # refitting the base would absorb them


def examine(model_name: str, reality: dict[str, dict[str, float]], seed: int, **more: Any) -> Diagnosis:
    """Diagnose a record of 24 s, with one of 12 s to measure the gain on."""
    model = get_model(model_name)
    excitation, amplitude = EXCITATION[model_name]
    records = [
        synthesise(
            model, reality, excitation, duration=duration, amplitude=amplitude,
            rng=np.random.default_rng([seed, k]), **more,
        )
        for k, duration in enumerate((24.0, 12.0))
    ]  # fmt: skip
    fixed = {p.name: p.nominal for p in model.parameters} if NEEDS_BASE & set(reality) else {}
    return diagnose(model, records[:1], records[1:], fixed=fixed)


def named(diagnosis: Diagnosis) -> list[set[str]]:
    """Each cause with what the data cannot tell from it."""
    return [{cause.effect, *cause.alternatives} for cause in diagnosis.causes]


def test_every_listed_effect_has_its_case() -> None:
    for name, cases in HIDDEN.items():
        assert set(cases) == {effect.name for effect in get_model(name).effects}


@pytest.mark.parametrize("seed", [SEEDS[0], pytest.param(SEEDS[1], marks=pytest.mark.slow)])
@pytest.mark.parametrize(("model", "effect"), [(m, e) for m, cases in HIDDEN.items() for e in cases])
def test_a_hidden_effect_is_found(model: str, effect: str, seed: int) -> None:
    diagnosis = examine(model, {effect: HIDDEN[model][effect]}, seed)
    assert diagnosis.verdict in ("named", "ambiguous")
    assert len(diagnosis.causes) == 1, named(diagnosis)
    assert effect in named(diagnosis)[0], named(diagnosis)


@pytest.mark.parametrize("seed", range(11, 21))
@pytest.mark.parametrize("model", sorted(HIDDEN))
def test_where_nothing_is_hidden_nothing_is_named(model: str, seed: int) -> None:
    # Every other record has noise that wanders, which is easily taken for a cause.
    diagnosis = examine(model, {}, seed, coloured=0.5 * (seed % 2))
    assert diagnosis.verdict == "consistent", named(diagnosis)


def detent(stiffness: float, place: float, width: float) -> Force:
    """A notch that pulls the axis towards one place."""
    return lambda _t, x, _v, _u: -stiffness * (x - place) * math.exp(-(((x - place) / width) ** 2))


def one_sided_stop(stiffness: float, place: float) -> Force:
    """An elastic stop on one side."""
    return lambda _t, x, _v, _u: -stiffness * max(x - place, 0.0)


@pytest.mark.parametrize(
    ("model", "force"),
    [
        ("rig", one_sided_stop(20.0, 0.03)),
        ("pendulum", detent(0.8, 0.3, 0.15)),
    ],
    ids=["rig, one-sided stop", "pendulum, detent"],
)
@pytest.mark.parametrize("seed", SEEDS)
def test_what_no_listed_effect_explains_is_unknown(model: str, force: Force, seed: int) -> None:
    diagnosis = examine(model, {}, seed, outside=force)
    assert diagnosis.verdict == "unknown", named(diagnosis)
    assert diagnosis.unknown is not None
    assert diagnosis.unknown.direction.split()[0] in ("position", "angle")
    assert 0.0 < diagnosis.unknown.percent <= 100.0
    place, found = diagnosis.unknown.curve.T
    assert len(place) > 3
    # Its shape, up to what the refitted base takes up: a constant and a spring.
    base = np.column_stack([np.ones_like(place), place])
    truth = np.array([force(0.0, x, 0.0, 0.0) for x in place])
    left = [values - base @ np.linalg.lstsq(base, values, rcond=None)[0] for values in (found, truth)]
    assert np.corrcoef(left)[0, 1] > 0.8
