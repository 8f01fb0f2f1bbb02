"""Numbers for readers have the digits that are known."""

import math

import numpy as np
import pytest

from fieldmodels.rounding import listed, percent, with_error


@pytest.mark.parametrize(
    ("value", "error", "shown"),
    [
        (0.1463, 0.02412, "0.146 ± 0.024 N m"),
        (9.81, 0.0996, "9.81 ± 0.10 N m"),
        (-3.44, 0.6, "−3.44 ± 0.60 N m"),
        (12345.6, 987.0, "12346 ± 987 N m"),
        (0.000400066, 0.0000021, "(4.001 ± 0.021) · 10⁻⁴ N m"),
        (2.0e6, 1.5e4, "(2.000 ± 0.015) · 10⁶ N m"),
        (0.0, 0.0123, "0.000 ± 0.012 N m"),
        (0.0106123, math.nan, "0.0106 N m"),
        (705.2, 0.0, "705 N m"),
        (math.nan, 1.0, "unknown"),
    ],
)
def test_a_value_has_the_digits_that_its_error_leaves(value: float, error: float, shown: str):
    assert with_error(value, error, "N m") == shown


def test_what_is_printed_is_within_the_errors_last_digit():
    rng = np.random.default_rng(1)
    for value, error in zip(rng.normal(0, 10, 200), 10 ** rng.uniform(-4, 2, 200), strict=True):
        text = with_error(value, error)
        power = text.translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")).partition("· 10")[2]
        scale = 10.0 ** int(power) if power else 1.0
        printed, _, spread = text.partition("· 10")[0].strip(" ()").replace("−", "-").partition(" ± ")
        assert abs(float(printed) * scale - value) <= 0.051 * error + 0.5 * (error >= 10)
        assert float(spread) * scale == pytest.approx(error, rel=0.051)


def test_shares_and_lists():
    assert percent(59.7, (56.2, 64.9)) == "60 % (56 to 65 %)"
    assert percent(99.82) == "99.8 %"
    assert percent(math.nan) == "unknown"
    assert listed(["a", "b", "c"], "or") == "a, b or c"
