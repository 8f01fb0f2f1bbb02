"""The parts of a machine's kernels: a step by hand, as plain Python, and in lanes."""

from dataclasses import replace

import numpy as np
import pytest

from fieldmodels.drivers.kernel.compose import Kernels, kernels_of
from fieldmodels.drivers.kernel.equations import Numbers, equations_of
from fieldmodels.drivers.kernel.facts import facts_of
from fieldmodels.drivers.kernel.tuples import along, changed, floats, put, take
from fieldmodels.drivers.methods import methods_of
from fieldmodels.drivers.windows import Rows
from fieldmodels.recording import Recording
from fieldmodels.registry import get_model

MASS, DAMPING, STIFFNESS, STEP = 2.0, 4.0, 80.0, 0.01
EFFECTS = {"coulomb_friction": {"force": 0.3}, "cubic_stiffness": {"coefficient": 500.0}}
WAVES = EFFECTS | {"cogging": {"sine": 0.2, "cosine": 0.1, "period": 0.03}}
TIME = STEP * np.arange(200)
SHAKEN = {"force": 3.0 * np.sin(8.0 * TIME) + 1.0, "position": 0.05 * np.sin(8.0 * TIME)}


def plain(machine, lanes=4):
    """A machine's kernels as Python."""
    own = {m.own: m.function for m in methods_of(machine)}
    return Kernels(replace(facts_of(machine, lanes), compiles=False, functions=own))


def numbers(machine, effects):
    facts = plain(machine).facts
    sets = Rows(machine).sets(machine.vector(effects=effects)[None])
    equations = equations_of(facts)
    rows = equations.rows(sets.frc[0])
    return equations, Numbers(equations.parameters(sets.base[0]), rows, sets.curves[0])


def test_a_step_is_runge_and_kuttas():
    """Of a mass on a spring that stiffens, against Coulomb friction, written out."""
    x, v, u = 0.05, -0.2, 1.5

    def rates(x, v):
        pull = -500.0 * x**3 + 0.3  # friction opposes a motion back
        return v, (u - DAMPING * v - STIFFNESS * x + pull) / MASS

    a = rates(x, v)
    b = rates(x + 0.5 * STEP * a[0], v + 0.5 * STEP * a[1])
    c = rates(x + 0.5 * STEP * b[0], v + 0.5 * STEP * b[1])
    d = rates(x + STEP * c[0], v + STEP * c[1])
    wanted = [s + STEP / 6.0 * (a[i] + 2.0 * (b[i] + c[i]) + d[i]) for i, s in enumerate((x, v))]
    equations, q = numbers(get_model("rig"), EFFECTS)
    for step in (equations.calm, equations.whole):
        found, way = step(0.0, STEP, (x, v), (u,), (u,), (u,), (0.0,), q, (-1.0,), (0.0,))
        np.testing.assert_allclose(found, wanted, rtol=1e-14)
        assert way[1] == pytest.approx(0.5 * STEP * (v + found[1]), rel=1e-3)


def test_what_friction_holds_stands_still():
    equations, q = numbers(get_model("rig"), EFFECTS)
    found, _ = equations.calm(0.0, STEP, (0.01, 0.0), *[(0.9,)] * 3, (0.0,), q, (2.0,), (0.0,))
    assert found == (0.01, 0.0)


@pytest.mark.every(
    "effects",
    [{}, EFFECTS, WAVES, {"actuator_rate_limit": {"rate": 20.0}}, {"sensor_delay": {"delay": 0.013}}],
)
def test_compiled_kernels_do_what_their_python_does(effects):
    machine = get_model("rig")
    windows = machine.windows(Recording(TIME, SHAKEN), 0.2)
    vectors = machine.vector(effects=effects)[None]
    out = machine.simulate(vectors, windows)
    machine.driver.kernels = plain(machine)
    np.testing.assert_allclose(machine.simulate(vectors, windows), out, rtol=1e-12, atol=1e-15)


@pytest.mark.every("effects", [EFFECTS, WAVES])
def test_a_window_is_the_same_alone_and_beside_others(effects):
    machine = get_model("rig")
    windows = machine.windows(Recording(TIME, SHAKEN), 0.2)
    vectors = machine.vector(effects=effects)[None]
    out = machine.simulate(vectors, windows)
    assert len(windows) > 4
    alone = [machine.simulate(vectors, windows.select(np.array([k])))[:, 0] for k in range(len(windows))]
    np.testing.assert_array_equal(np.stack(alone, axis=1), out)


@pytest.mark.every("n", [1, 2, 3, 5])
def test_tuples_are_added_changed_and_kept(n):
    def as_it_is(function):
        return function

    s, d = tuple(range(1, n + 1)), tuple(0.5 * k for k in range(n))
    assert along(n, as_it_is)(s, 2.0, d) == tuple(a + 2.0 * b for a, b in zip(s, d, strict=True))
    for i in range(n):
        assert changed(n, as_it_is)(d, i, 7.0) == (*d[:i], 7.0, *d[i + 1 :])
    w = np.zeros(4 * n)
    put(n, 4, as_it_is)(w, 1, d)
    assert take(n, 4, as_it_is)(w, 1) == d
    assert w[1::4].tolist() == list(d)
    assert w.sum() == sum(d)
    converted = floats(n, as_it_is)(s)
    assert all(isinstance(value, float) for value in converted)


def test_machines_that_are_alike_share_their_kernels():
    assert kernels_of(get_model("rig")) is kernels_of(get_model("rig"))
    assert kernels_of(get_model("rig")) is not kernels_of(get_model("rig"), 1)
