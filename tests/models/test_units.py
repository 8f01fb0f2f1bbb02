"""Units convert by their definitions, and a unit of another quantity is refused."""

from math import pi

import pytest

from fieldmodels.recording.units import UnitError, canonical, factor, known_units, si_unit, simplified


@pytest.mark.every(
    ("unit", "wanted", "expected"),
    [
        ("deg", "rad", pi / 180),
        ("°", "rad", pi / 180),
        ("rpm", "rad/s", 2 * pi / 60),
        ("ms", "s", 1e-3),
        ("mm", "m", 1e-3),
        ("km/h", "m/s", 1000 / 3600),
        ("g", "kg", 1e-3),
        ("g", "m/s^2", 9.80665),
        ("kgf", "N", 9.80665),
        ("Nm", "N m", 1.0),
        ("N*m", "N m", 1.0),
        ("mNm", "N m", 1e-3),
        ("%", "1", 0.01),
        ("furlong", "furlong", 1.0),
    ],
)
def test_factor(unit, wanted, expected):
    assert factor(unit, wanted) == pytest.approx(expected, rel=1e-15)


def test_another_quantity_is_refused():
    with pytest.raises(UnitError, match=r"'mm' does not measure a quantity in 'rad' \(possible: rad, .*deg"):
        factor("mm", "rad")


def test_a_misspelt_unit_is_guessed():
    with pytest.raises(UnitError, match="did you mean 'deg'"):
        factor("degg", "rad")
    with pytest.raises(UnitError, match="unknown unit 'xyzzy'"):
        si_unit("xyzzy")


def test_a_g_alone_is_ambiguous():
    with pytest.raises(UnitError, match=r"kg|m/s\^2"):
        si_unit("g")


def test_every_unit_leads_to_one_of_factor_one():
    for unit in known_units():
        if unit != "g":
            si, scale = si_unit(unit)
            assert factor(si, si) == 1.0
            assert scale > 0
            assert canonical(unit) == unit


@pytest.mark.every(
    ("written", "simple"),
    [
        ("rad/s^2 / (rad/s)", "1/s"), ("1/s^2 s", "1/s"), ("rad/s rad/s", "rad^2/s^2"), ("V V", "V^2"),
        ("N m / (rad/s)", "N m s/rad"), ("N m", "N m"), ("1 s", "s"), ("1 1", "1"), ("N / (m)", "N/m"),
        ("rad/s/V", "rad/s/V"), ("°C s", "°C s"), ("furlongs s", "furlongs s"),
        ("counts / (s)", "counts / (s)"),
    ],
)  # fmt: skip
def test_products_and_quotients_have_each_unit_once(written, simple):
    assert simplified(written) == simple
