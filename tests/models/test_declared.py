"""Rows of parameters that kernels read by name: same memory, same order, checked lengths."""

import numpy as np
import pytest

from fieldmodels.compiled import compiled
from fieldmodels.declared import any_on, as_rows, neutral, row_type
from fieldmodels.machine import Machine, number
from fieldmodels.model import Effect, ModelError, Parameter, Signal

BASE = (Parameter("mass", "kg", 2.0, 0.1, 10.0, 0.1),)
EFFECTS = (
    Effect("wind", "It blows.", "force", tuple(Parameter(n, "N", 0.0, -9.0, 9.0, 0.1) for n in ("x", "y"))),
    Effect("lag", "It is late.", "actuator", (Parameter("time_constant", "s", 0.0, 0.0, 1.0, 0.01),)),
    Effect("gain", "It is scaled.", "sensor", (Parameter("factor", "1", 1.0, 0.5, 2.0, 0.01),)),
)
ROW = row_type(BASE, EFFECTS)


@compiled
def read(rows, out):
    for b in range(len(rows)):
        q = rows[b]
        out[b] = q.mass + 10.0 * q.wind.x + 100.0 * q.wind.y + 1e3 * q.lag.time_constant + 1e4 * q.gain.factor


def test_a_kernel_reads_each_number_by_its_declared_name():
    vectors, out = np.array([[1.0, 2.0, 3.0, 4.0, 5.0], [5.0, 4.0, 3.0, 2.0, 1.0]]), np.zeros(2)
    read(as_rows(vectors, ROW), out)
    np.testing.assert_array_equal(out, [54321.0, 12345.0])


def test_rows_share_the_memory_of_their_vectors():
    vectors = np.zeros((3, 5))
    as_rows(vectors, ROW)[1]["lag"]["time_constant"] = 0.5
    np.testing.assert_array_equal(np.argwhere(vectors), [[1, 3]])
    assert as_rows(vectors[0], ROW).shape == ()


@pytest.mark.every("shape", [(4,), (2, 6), ()])
def test_a_vector_of_another_length_is_refused(shape):
    with pytest.raises(ModelError, match="has 5 numbers"):
        as_rows(np.zeros(shape), ROW)


def test_neutral_values_are_the_declared_ones():
    np.testing.assert_array_equal(neutral(BASE, EFFECTS), [2.0, 0.0, 0.0, 0.0, 1.0])


def test_an_effect_is_on_if_one_of_its_numbers_is_not_neutral():
    vectors = np.tile(neutral(BASE, EFFECTS), (5, 1))
    vectors[1, 0] = 3.0  # a base parameter is no effect
    vectors[2, 2] = 0.1
    vectors[3, 3] = 0.1
    vectors[4, 4] = 0.9
    np.testing.assert_array_equal(any_on(vectors, BASE, EFFECTS), [False, False, True, True, True])
    np.testing.assert_array_equal(any_on(vectors, BASE, EFFECTS, "force"), [False, False, True, False, False])


def test_a_known_number_needs_no_limits_and_a_refitted_one_says_that_it_does():
    class Known(Machine):
        inputs = (Signal("force", "N"),)
        states = outputs = (Signal("speed", "m/s"),)
        mass = number("kg", 2.0, refitted=False)
        drag = number("N s/m", 1.0, 0.0, 10.0)

        def derivative(self, state, input, p):
            return (input.force - p.drag * state.speed) / p.mass

    mass = next(p for p in Known().parameters if p.name == "mass")
    assert not mass.refitted
    assert mass.lower == -np.inf
    assert mass.upper == np.inf
    with pytest.raises(ModelError, match=r"needs its lowest and highest value: number\('kg', 2, lowest"):
        number("kg", 2.0)
