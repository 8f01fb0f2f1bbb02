"""The contract of models: names, vectors, bounds; and realities read from dicts and files."""

import numpy as np
import pytest

from fieldmodels.files import replacing, write_text
from fieldmodels.model import Effect, Model, ModelError, Parameter, Signal
from fieldmodels.reality import Reality, read_reality
from fieldmodels.yaml import YamlError, load_yaml, save_yaml


class Cart(Model):
    """A mass with one effect of two parameters and one of one."""

    name = "cart"
    inputs = (Signal("force", "N"),)
    outputs = (Signal("position", "m", noise=1e-3),)
    states = (Signal("position", "m"), Signal("velocity", "m/s"))
    parameters = (Parameter("mass", "kg", 2.0, 0.1, 10.0, 1.0),)
    effects = (
        Effect(
            "periodic_force",
            "Something shakes the cart.",
            "force",
            (
                Parameter("amplitude", "N", 0.0, 0.0, 5.0, 1.0),
                Parameter("frequency", "Hz", 1.0, 0.1, 10.0, 1.0),
            ),
        ),
        Effect(
            "constant_force",
            "The track is not level.",
            "force",
            (Parameter("force", "N", 0.0, -5.0, 5.0, 1.0),),
        ),
    )
    horizons = (0.5, 1.0)

    def simulate(self, parameters, windows):
        raise AssertionError("not called here")

    def initial_states(self, recording, starts):
        raise AssertionError("not called here")


def test_a_vector_holds_base_then_effects_in_the_order_of_names():
    cart = Cart()
    assert cart.names == (
        "mass",
        "periodic_force.amplitude",
        "periodic_force.frequency",
        "constant_force.force",
    )
    vector = cart.vector({"mass": 3.0}, {"constant_force": {"force": -1.5}})
    np.testing.assert_array_equal(vector, [3.0, 0.0, 1.0, -1.5])
    np.testing.assert_array_equal(cart.nominal, [2.0, 0.0, 1.0, 0.0])
    assert cart.slice_of("constant_force") == slice(3, 4)
    assert cart.slice_of("periodic_force") == slice(1, 3)


@pytest.mark.every(
    ("base", "effects", "message"),
    [
        ({"maas": 1.0}, {}, "did you mean 'mass'"),
        ({"mass": 11.0}, {}, r"outside \[0.1, 10.0\] kg"),
        ({"mass": float("nan")}, {}, "outside"),
        ({"mass": "heavy"}, {}, "must be a number in kg"),
        ({}, {"constant_forse": {"force": 1.0}}, "did you mean 'constant_force'"),
        ({}, {"constant_force": {"forse": 1.0}}, "did you mean 'force'"),
        ({}, {"constant_force": 1.0}, r"takes a mapping of its parameters: force \[N\]"),
    ],
)
def test_unknown_names_and_values_out_of_bounds_raise(base, effects, message):
    with pytest.raises(ModelError, match=message):
        Cart().vector(base, effects)


def test_a_parameter_that_contradicts_itself_is_refused():
    with pytest.raises(ModelError, match="outside"):
        Parameter("mass", "kg", 0.0, 1.0, 2.0, 1.0)
    with pytest.raises(ModelError, match="scale"):
        Parameter("mass", "kg", 1.0, 1.0, 2.0, 0.0)


@pytest.mark.every("key", ["machine", "model"])  # model: files of 0.1
def test_a_reality_comes_from_nothing_a_mapping_or_a_file(tmp_path, key):
    cart = Cart()
    assert read_reality(None, cart) == Reality()
    from_mapping = read_reality({"constant_force": {"force": 1.0}, "parameters": {"mass": 4.0}}, cart)
    np.testing.assert_array_equal(from_mapping.vector(cart), [4.0, 0.0, 1.0, 1.0])

    path = tmp_path / "extended.yaml"
    save_yaml(
        {
            "schema": 1,
            key: "cart",
            "parameters": {"mass": {"value": 4.0, "std": 0.1, "unit": "kg"}},
            "effects": {"constant_force": {"force": {"value": 1.0, "std": 0.2, "unit": "N"}}},
        },
        path,
    )
    np.testing.assert_array_equal(read_reality(path, cart).vector(cart), from_mapping.vector(cart))


@pytest.mark.every(
    ("content", "message"),
    [
        ("machine: ship\neffects: {}\n", "made for machine 'ship', not for 'cart'"),
        ("model: cart\n", "needs the keys"),
        ("- 1\n", "needs the keys"),
        ("model: cart\neffects: {wind: {speed: 1}}\n", "no effect 'wind'"),
        ("model: cart\neffects: {constant_force: {force: much}}\n", "number"),
        ("model: cart\neffects: [1]\n", "mapping"),
        ("model: cart\neffects: {constant_force: 3}\n", "mapping"),
    ],
)
def test_a_bad_extended_file_is_refused_with_its_reason(tmp_path, content, message):
    path = tmp_path / "extended.yaml"
    path.write_text(content)
    with pytest.raises(ModelError, match=message):
        read_reality(path, Cart())


def test_yaml_is_version_1_2_and_safe(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_text("rate: 3e-4\nbig: 1e5\nlight: off\n")
    assert load_yaml(path) == {"rate": 3e-4, "big": 1e5, "light": "off"}
    path.write_text("!!python/object/apply:os.system ['true']\n")
    with pytest.raises(YamlError):
        load_yaml(path)
    path.write_text("a: 1\nb: [1, 2\n")
    with pytest.raises(YamlError, match=r"a\.yaml:\d"):
        load_yaml(path)
    with pytest.raises(YamlError, match="no such file"):
        load_yaml(tmp_path / "b.yaml")


def test_writing_is_all_or_nothing(tmp_path):
    path = tmp_path / "deep" / "result.txt"
    write_text(path, "old")

    def fail_in_the_middle():
        with replacing(path) as temporary:
            temporary.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail_in_the_middle()
    assert path.read_text() == "old"
    assert [p.name for p in path.parent.iterdir()] == ["result.txt"]
