"""Samplers: what they draw, what they refuse, and that YAML gives them back.

The distributions are compared with SciPy's by a Kolmogorov-Smirnov test of 20,000 draws with fixed seeds; it
would refuse a right sampler with a probability of 1e-6, and finds a shift by a tenth of a deviation.
"""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from fieldmodels.model import ModelError
from fieldmodels.reality import Reality, read_reality
from fieldmodels.registry import get_model
from fieldmodels.sampling import Choice, LogUniform, Normal, Uniform, read_sampler
from fieldmodels.streams import drawn_key
from fieldmodels.yaml import load_yaml, save_yaml

MODEL = get_model("heel_strike")
FINITE = st.floats(-1e6, 1e6, allow_nan=False)
POSITIVE = st.floats(1e-9, 1e9)


def drawn(sampler, count=20_000, seed=1, bounds=(-math.inf, math.inf)):
    rng = np.random.default_rng(seed)
    return np.array([sampler.draw(rng, *bounds) for _ in range(count)])


@pytest.mark.every(
    ("sampler", "bounds", "expected"),
    [
        (Uniform(-2.0, 3.0), (-10, 10), stats.uniform(-2, 5)),
        (LogUniform(0.01, 100.0), (0, 1e3), stats.loguniform(0.01, 100)),
        (Normal(1.0, 0.5), (-math.inf, math.inf), stats.norm(1, 0.5)),
        (Normal(1.0, 0.5), (0.9, 1.4), stats.truncnorm(-0.2, 0.8, 1, 0.5)),
        (Normal(0.0, 1.0), (0.0, math.inf), stats.truncnorm(0, np.inf)),
    ],
)
def test_draws_have_the_stated_distribution(sampler, bounds, expected):
    values = drawn(sampler, bounds=bounds)
    assert values.min() >= bounds[0]
    assert values.max() <= bounds[1]
    assert stats.kstest(values, expected.cdf).pvalue > 1e-6
    shifted = values + 0.1 * expected.std()  # the test's own power
    assert stats.kstest(shifted, expected.cdf).pvalue < 1e-6


def test_choices_are_equally_likely():
    values = drawn(Choice((1.0, 5.0, 7.0)))
    counts = [(values == v).sum() for v in (1.0, 5.0, 7.0)]
    assert sum(counts) == len(values)
    assert stats.chisquare(counts).pvalue > 1e-6


def test_a_choice_may_hold_samplers_that_draw_in_their_turn():
    """A fault that is there in a third of the episodes."""
    source = {"gyro_bias": {"rate": {"choice": [0.0, 0.0, {"uniform": [0.004, 0.01]}]}}}
    reality = read_reality(source, MODEL)
    (sampler,) = reality.samplers(MODEL).values()
    values = drawn(sampler)
    there = values[values != 0.0]
    assert stats.binomtest(len(there), len(values), 1 / 3).pvalue > 1e-6
    assert stats.kstest(there, stats.uniform(0.004, 0.006).cdf).pvalue > 1e-6
    assert reality.plain() == source
    assert sampler.typical == 0.0
    assert sampler.extremes(-1.0, 1.0) == (0.0, 0.01)
    for wrong, said in (
        ({"uniform": [0, 99]}, "can draw 99"),
        ({"unifrom": [0, 1]}, "did you mean 'uniform'"),
    ):
        with pytest.raises(ModelError, match=said):
            read_reality({"gyro_bias": {"rate": {"choice": [0.0, wrong]}}}, MODEL)


def test_each_draw_uses_one_number_of_the_generator():
    for sampler in (Uniform(0, 1), LogUniform(1, 2), Normal(0, 1), Choice(("a", "b"))):
        rng, other = np.random.default_rng(3), np.random.default_rng(3)
        sampler.draw(rng, -1.0, 1.0)
        other.random()
        assert rng.random() == other.random()


SAMPLERS = st.one_of(
    st.tuples(FINITE, FINITE).map(lambda ends: Uniform(*sorted(ends))),
    st.tuples(POSITIVE, POSITIVE).map(lambda ends: LogUniform(*sorted(ends))),
    st.builds(Normal, FINITE, POSITIVE),
    st.lists(st.one_of(FINITE, st.sampled_from(["T1", "slide", "a b"])), min_size=1).map(
        lambda values: Choice(tuple(values))
    ),
)


@given(SAMPLERS)
def test_yaml_gives_a_sampler_back(tmp_path_factory, sampler):
    path = tmp_path_factory.mktemp("yaml") / "one.yaml"
    save_yaml({"value": sampler.as_mapping()}, path)
    assert read_sampler(load_yaml(path)["value"], "here") == sampler


@given(SAMPLERS, st.integers(0, 2**32))
def test_draws_stay_within_the_extremes(sampler, seed):
    if isinstance(sampler, Choice):
        assert sampler.draw(np.random.default_rng(seed)) in sampler.values
        return
    low, high = sampler.extremes(-1e7, 1e7)
    assert low <= sampler.draw(np.random.default_rng(seed), -1e7, 1e7) <= high
    assert low <= sampler.typical <= high


@pytest.mark.every(
    ("value", "words"),
    [
        ({"uniform": [1, 0]}, "gyro_bias.rate.*smaller end first"),
        ({"uniform": [0, math.inf]}, "gyro_bias.rate.*two finite numbers"),
        ({"uniform": [0]}, "gyro_bias.rate.*two numbers, smallest and largest"),
        ({"uniform": 3}, "gyro_bias.rate.*takes a list"),
        ({"uniform": ["a", "b"]}, "gyro_bias.rate.*two numbers"),
        ({"log_uniform": [0, 1]}, "gyro_bias.rate.*positive ends"),
        ({"normal": [0, 0]}, "gyro_bias.rate.*positive standard deviation"),
        ({"normal": [0, math.nan]}, "gyro_bias.rate.*positive standard deviation"),
        ({"normal": [1e9, 1]}, "gyro_bias.rate.*mean.*outside"),
        ({"choice": []}, "gyro_bias.rate.*at least one value"),
        ({"choice": [0.1, math.nan]}, "gyro_bias.rate.*finite"),
        ({"choice": [0.1, "b"]}, "gyro_bias.rate.*needs numbers here"),
        ({"choice": [0.1, 1e9]}, "gyro_bias.rate.*can draw 1e.09, outside"),
        ({"uniform": [0, 1e9]}, "gyro_bias.rate.*can draw 1e.09, outside .*rad/s"),
        ({"unifrom": [0, 1]}, "gyro_bias.rate.*did you mean 'uniform'"),
        ({"uniform": [0, 1], "normal": [0, 1]}, "gyro_bias.rate.*a mapping of one of"),
        ({}, "gyro_bias.rate.*a mapping of one of"),
    ],
)
def test_bad_samplers_are_refused_by_name(value, words):
    with pytest.raises(ModelError, match=words):
        read_reality({"gyro_bias": {"rate": value}}, MODEL)


@pytest.mark.every(
    "reality", [{"gyro_bais": {"rate": Uniform(0, 0.1)}}, {"gyro_bias": {"rat": Uniform(0, 0.1)}}]
)
def test_unknown_names_are_refused(reality):
    with pytest.raises(ModelError, match="did you mean 'gyro_bias"):
        read_reality(reality, MODEL)


def test_a_random_reality_is_refused_where_one_vector_is_needed():
    reality = read_reality({"gyro_bias": {"rate": Uniform(-0.01, 0.01)}}, MODEL)
    with pytest.raises(ModelError, match=r"gyro_bias\.rate: drawn for each episode"):
        reality.vector(MODEL)
    assert reality.typical(MODEL)[MODEL.index("gyro_bias.rate")] == 0.0


def test_a_reality_goes_through_a_file(tmp_path):
    path = tmp_path / "extended.yaml"
    path.write_text(
        "schema: 1\nmodel: heel_strike\nparameters: {}\n"
        "effects: {gyro_bias: {rate: {normal: [0.0, 0.002]}}, gyro_delay: {delay: {value: 0.01, std: 0.1}}}\n"
    )
    reality = read_reality(path, MODEL)
    expected = {"gyro_bias": {"rate": {"normal": [0.0, 0.002]}}, "gyro_delay": {"delay": 0.01}}
    assert reality.plain() == expected
    assert read_reality(expected, MODEL) == reality
    assert reality == Reality(
        effects={"gyro_bias": {"rate": Normal(0.0, 0.002)}, "gyro_delay": {"delay": 0.01}}
    )


@pytest.mark.every("kind", [np.random.PCG64, np.random.MT19937, np.random.Philox])
def test_a_key_is_a_draw_of_64_bits_whatever_the_generator(kind):
    one, other = (np.random.Generator(kind(3)) for _ in range(2))
    for _ in range(5):
        assert drawn_key(one) == other.integers(0, 2**64, dtype=np.uint64)
    assert one.random() == other.random()
