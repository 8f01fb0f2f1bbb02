"""A user's own equations: each mistake is one message, and what roboticists write works as if written out."""

import math
import warnings

import numpy as np
import pytest

from fieldmodels.compiled import allocation_free, compiled
from fieldmodels.contract import ModelWarning
from fieldmodels.drivers import numpy_words as numpy_words
from fieldmodels.drivers.compilable import compilable
from fieldmodels.machine import Force, Machine, number
from fieldmodels.model import ModelError, Signal
from fieldmodels.model_files import load_model_file
from fieldmodels.recording import Recording

HEAD = """
import math
import numpy as np
from fieldmodels.machine import Force, Machine, number
from fieldmodels.model import Signal
LIST, TABLE, TUPLE, DICT = [1.0, 2.0], np.array([1.0, 2.0]), (1.0, 2.0), {"mass": 2.0}


class Axis(Machine):
    inputs = (Signal("push", "N"),)
    states = (Signal("place", "m"), Signal("speed", "m/s"))
    outputs = (Signal("place", "m"),)
    mass = number("kg", 2.0, 0.1, 10.0)
"""
RETURN = "return state.speed, input.push / p.mass"


def written(folder, body):
    path = folder / "axis.py"
    path.write_text(HEAD + "".join(f"    {line}\n" for line in body.splitlines()))
    return path


def derivative(*lines):
    return "\n".join(["def derivative(self, state, input, p):", *(f"    {line}" for line in lines)])


GOOD = derivative(RETURN)
RATES = "return the states' rates: return rate_of_place, rate_of_speed"
MISTAKES = {
    "too many rates": (derivative("return state.speed, 0.0, 1.0"), f"returns 3 numbers, not 2; {RATES}", 15),
    "too few": (derivative("return (state.speed,)"), f"returns 1 number, not 2; {RATES}", 15),
    "one number": (derivative("rate = state.speed", "return rate"), "returns 1 number, not 2", 14),
    "nothing": (derivative("rate = state.speed"), f"returns nothing; {RATES}", 14),
    "nothing, not always": (derivative("if state.place > 1e9:", "    return", RETURN), "returns nothing", 16),
    "a list": (derivative("return [state.speed, 0.0]"), f"returns a list, .*; {RATES}", 15),
    "an array": (derivative("return np.array([state.speed, 0.0])"), "returns a NumPy array", 14),
    "a text": (derivative("return state.speed, 'fast'"), "returns 'fast' for speed, not a number", 14),
    "no such state": (
        derivative("return state.sped, 0.0"),
        r"there is no state\.sped; the states are place, speed \(did you mean 'speed'\?\)",
        15,
    ),
    "no such state, on another way": (
        derivative("if state.place > 1e9:", "    return state.sped, 0.0", RETURN), r"no state\.sped", 16,
    ),
    "no such input": (derivative("return state.speed, input.volts"), "the inputs are push$", 15),
    "no such number": (derivative("return state.speed, p.drag"), "the declared numbers are mass$", 15),
    "a state of p": (derivative("return p.speed, 0.0"), r"'speed' is one of the states: state\.speed", 15),
    "by another name": (derivative("s = state", "return s.sped, 0.0"), r"no state\.sped", 16),
    "self": (derivative("return state.speed, self.mass"), r"self is None .*; write p\.mass", 15),
    "self, own value": (
        "DRAG = 3.0\n" + derivative("return state.speed, self.DRAG"),
        r"self\.DRAG: self is None .*; declare DRAG = number\(\.\.\.\) and write p\.DRAG, or write DRAG = ",
        16,
    ),
    "self, own function": (
        "def drag(self, x):\n    return x\n" + derivative("return state.speed, self.drag(state.speed)"),
        "write drag as a function outside of the class",
        17,
    ),
    "without p": (
        "def derivative(self, state, input):\n    return state.speed, 0.0",
        r"takes \(self, state, input\); it is handed \(self, state, input, p\)",
        14,
    ),
    "without self": (
        "def derivative(state, input, p):\n    return state.speed, 0.0", r"takes \(state, input, p\)", 14,
    ),
    "swapped": (
        "def derivative(self, input, state, p):\n    return state.speed, 0.0",
        r"in the order \(self, state, input, p\)",
        14,
    ),
    "not imported": (
        derivative("return state.speed, cos(state.place)"),
        r"'cos' is not defined; write import math above the class, and math\.cos",
        15,
    ),
    "a wrong call": (derivative("return state.speed, math.sin()"), "TypeError: math.sin", 15),
    "counts that differ": (
        derivative("rates = state.speed, 0.0", "if state.place > 1e9:", "    return state.place", RETURN),
        "different counts of numbers",
        14,
    ),
    "step": (
        "def step(self, state, input, p, dt):\n    return state.place",
        "return the states a time dt later: return place, speed",
        14,
    ),
    "step without dt": (
        "def step(self, state, input, p):\n    return state", r"handed \(self, state, input, p, dt\)", 14,
    ),
    "observe": (
        GOOD + "\ndef observe(self, state, p):\n    return state.place, state.speed",
        "returns 2 numbers, not 1; return the outputs: return place",
        17,
    ),
    "pace": (GOOD + "\ndef pace(self, p):\n    return (p.mass,)", r"fastest mode \[rad/s\], one number", 16),
    "pace of a state": (GOOD + "\ndef pace(self, p):\n    return p.place", r"no p\.place", 17),
    "inertia": (
        'forces = (Force("speed", inertia="moved"),)\n' + GOOD + "\ndef moved(self, p):\n    return p.load",
        r"Axis\.moved, line 18: there is no p\.load",
        18,
    ),
    "no function": ("derivative = 3.0", r"derivative: must be a function: def derivative\(self, state", None),
}  # fmt: skip


@pytest.mark.every("mistake", MISTAKES)
def test_a_mistake_is_one_message_with_its_line(tmp_path, mistake):
    body, message, line = MISTAKES[mistake]
    with pytest.raises(ModelError, match=message) as raised:
        compilable(load_model_file(str(written(tmp_path, body))))
    assert "\n" not in str(raised.value)
    assert str(raised.value).startswith(f"{tmp_path}/axis.py: Axis.") or mistake == "counts that differ"
    assert line is None or f", line {line}: " in str(raised.value)


def test_an_output_that_is_no_state_needs_observe(tmp_path):
    body = 'outputs = (Signal("height", "m"),)\n' + GOOD
    with pytest.raises(ModelError, match=r"output 'height' is no state \(place, speed\); give .* observe"):
        load_model_file(str(written(tmp_path, body)))


def test_an_inertia_and_an_input_that_are_not_there():
    def declared(**force):
        def moves(self, state, input, p):
            return state.speed

        body = {"forces": (Force("speed", **force),), "inputs": (Signal("push", "N"),), "derivative": moves}
        signals = (Signal("speed", "m/s"),)
        return type("Cart", (Machine,), {**body, "states": signals, "outputs": signals, "effects": ()})()

    with pytest.raises(ModelError, match="no number or method 'mass' for an inertia"):
        declared(inertia="mass")
    with pytest.raises(ModelError, match=r"no input 'pull' .*push"):
        declared(input="pull")


LACKS = {
    "a list": (derivative("return state.speed, LIST[0]"), "it reads LIST, a list; make it a tuple or", 15),
    "a dictionary": (derivative("return state.speed, DICT['mass']"), r"it reads DICT \(dict\), which is", 15),
    "an array": (
        derivative("rates = np.array([state.speed, 0.0])", "return rates[0], rates[1]"),
        "it makes a list, a dictionary or an array, .*; write its numbers out",
        15,
    ),
    "a matrix": (derivative("a = np.zeros(2)", "return a[0], a[1]"), "it makes a list, a dictionary", 15),
    "np.polyval": (derivative("return state.speed, np.polyval(TABLE, 1.0)"), r"not know np\.polyval", 15),
    "math.fsum": (derivative("return state.speed, math.fsum(TUPLE)"), r"does not know math\.fsum", 15),
    "a generator": (derivative("return state.speed, sum(x for x in TUPLE)"), "a generator .*; write a", 15),
    "a text": (derivative("f'{state.speed:.1f}'", RETURN), "it makes a text; leave it out", 15),
    "an import": (derivative("import cmath", RETURN), "import it above the class", 15),
    "an exception": (
        derivative("try:", "    return state.speed, 1 / p.mass", "except ValueError:", f"    {RETURN}"),
        "it catches an exception; ask for the condition",
        17,
    ),
}  # fmt: skip


@pytest.mark.every("lack", LACKS)
def test_what_numba_lacks_is_said_once_in_words(tmp_path, lack):
    body, message, line = LACKS[lack]
    machine = load_model_file(str(written(tmp_path, body)))
    with pytest.warns(ModelWarning, match=message) as said:
        assert not compilable(machine)
    assert [one.category for one in said] == [ModelWarning]
    assert f": Axis.derivative, line {line}: " in str(said[0].message)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not compilable(machine)


FINE = {
    "integers": derivative("return (0, 0) if state.place > 1.0 else (state.speed, 1)"),
    "integers on one way": derivative("if state.place > 1.0:", "    return 0, 0", RETURN),
    "a division by a state": derivative("return state.speed, input.push / state.place"),
    "a root of what is negative there": derivative("return state.speed, math.sqrt(state.place - 1.0)"),
    "tables": derivative("return state.speed, np.interp(state.place, TABLE, TABLE) + TUPLE[1]"),
    "a step": "def step(self, state, input, p, dt):\n    return state.place + dt * state.speed, state.speed",
    "an output as a tuple": GOOD + "\ndef observe(self, state, p):\n    return (state.place,)",
    "unpacked": derivative("place, speed = state", "(push,) = input", "return speed, push / p[0]"),
    "names at hand": derivative("state = state._replace(speed=1.0)", "return state.speed, 0.0"),
    "arguments by other names": "def derivative(self, x, u, q):\n    return x.speed, u.push / q.mass",
}


@pytest.mark.every("form", [form for form in FINE if form != "names at hand"])
@pytest.mark.filterwarnings("error")
def test_what_is_no_mistake_compiles(tmp_path, form):
    machine = load_model_file(str(written(tmp_path, FINE[form])))
    assert compilable(machine)


def test_a_name_that_is_bound_anew_is_no_argument(tmp_path):
    load_model_file(str(written(tmp_path, FINE["names at hand"])))


KNOTS, HEIGHTS = np.array([-1.0, 0.2, 1.5]), (0.5, -0.3, 2.0)


def drag(speed):
    return np.sign(speed) * np.square(speed) + bent(speed)


def bent(speed):
    return np.interp(speed, KNOTS, HEIGHTS)


class Plain(Machine):
    """A speed under a clipped command and a drag, written out."""

    inputs = (Signal("push", "N"),)
    states = outputs = (Signal("speed", "m/s"),)
    gain = number("1/s", 2.0, 0.0, 10.0)

    def derivative(self, state, input, p):
        speed, push = state.speed, min(max(p.gain * input.push, -1.0), 1.5)
        between = 0.5 - 0.8 / 1.2 * (speed + 1.0) if speed < 0.2 else -0.3 + 2.3 / 1.3 * (speed - 0.2)
        table = 0.5 if speed < -1.0 else 2.0 if speed > 1.5 else between
        return push - speed * abs(speed) - table - (0.1 if push > 0.0 else 0.0) - 0.2 * math.sin(speed)


class Written(Plain):
    """The same as a roboticist writes it."""

    def derivative(self, state, input, p):
        push = np.clip(p.gain * input.push, -1, 1.5)
        asked = np.where(push > 0.0, 0.1, 0)
        return (push - drag(state.speed) - asked - 0.2 * np.sin(state.speed),)


@pytest.mark.nightly
@pytest.mark.filterwarnings("error::fieldmodels.contract.ModelWarning")
def test_it_moves_as_if_written_out():
    rng = np.random.default_rng(3)
    time = 0.02 * np.arange(120)
    recording = Recording(time, {"push": rng.uniform(-2.0, 2.0, 120), "speed": np.zeros(120)})
    plain, own = Plain(), Written()
    windows = plain.windows(recording, 0.8)
    windows = windows.select(np.array([0, 1])).with_states(np.array([[-1.3], [0.7]]))
    vectors = np.array([[2.0], [0.4]])
    np.testing.assert_allclose(own.simulate(vectors, windows), plain.simulate(vectors, windows), rtol=1e-12)


INSIDE = np.array([-0.7, 0.31, 0.85])
BEYOND = np.array([1.2, 2.6])
WORDS = {
    **{name: (getattr(np, name), INSIDE) for name in ("sin", "cos", "tan", "arcsin", "arccos", "arctan")},
    **{name: (getattr(np, name), INSIDE) for name in ("sinh", "cosh", "tanh", "arcsinh", "arctanh", "exp")},
    **{name: (getattr(np, name), INSIDE) for name in ("expm1", "log1p", "abs", "fabs", "square", "negative")},
    **{name: (getattr(np, name), BEYOND) for name in ("log", "log2", "log10", "sqrt", "arccosh")},
    **{name: (getattr(np, name), INSIDE) for name in ("radians", "deg2rad", "degrees", "rad2deg")},
    **{name: (getattr(np, name), INSIDE) for name in ("sign", "floor", "ceil", "trunc", "rint")},
    "arctan2": (lambda x: np.arctan2(x, 0.4) + np.arctan2(0.4, x), INSIDE),
    "hypot": (lambda x: np.hypot(x, 0.4), INSIDE),
    "copysign": (lambda x: np.copysign(x, -1.0), INSIDE),
    "power": (lambda x: np.power(x, 2), INSIDE),
    "maximum": (lambda x: np.maximum(x, 0.5) + np.minimum(0, x), INSIDE),
    "arithmetic": (lambda x: np.add(x, np.multiply(2, x)) - np.divide(np.subtract(x, 1), 3.0), INSIDE),
    "mod": (lambda x: np.mod(x, 0.3), INSIDE),
    "remainder": (lambda x: np.remainder(x, 0.3), INSIDE),
    "fmod": (lambda x: np.fmod(x, 0.3) + math.fmod(x, -0.4), INSIDE),
    "clip": (lambda x: np.clip(x, -0.5, 0.5) + np.clip(x, a_min=0, a_max=1), INSIDE),
    "clip from one side": (lambda x: np.clip(x, None, 0.5) + np.clip(x, 0.0, None), INSIDE),
    "clip between": (lambda x: np.clip(0.2, -x * x, x * x), INSIDE),
    "where": (lambda x: np.where(x > 0.0, x * x, 1), INSIDE),
    "heaviside": (lambda x: x * np.heaviside(x, 0.5), INSIDE),
    "interp": (lambda x: np.interp(3.0 * x, KNOTS, HEIGHTS), INSIDE),
    "finite": (lambda x: x if np.isfinite(x) and not np.isnan(x) else 0.0, INSIDE),
}  # fmt: skip


@pytest.mark.every("word", WORDS)
def test_functions_of_a_number(word):
    """Compiled, against NumPy's own."""
    function, at = WORDS[word]
    inner = compiled(function) if isinstance(function, type(lambda: 0)) else function

    @allocation_free
    def run(given, out):
        for i in range(len(given)):
            out[i] = inner(given[i])

    found = np.zeros(len(at))
    run(at.copy(), found)
    np.testing.assert_allclose(found, [float(function(x)) for x in at], rtol=1e-14, atol=1e-15)


def test_ends_and_what_is_no_number():
    @compiled
    def run(x):
        return np.interp(x, KNOTS, KNOTS), np.clip(x, 0.0, 1.0), np.heaviside(x, 0.25)

    np.testing.assert_equal(run(math.nan)[:2], (math.nan, math.nan))
    for far in (9.0, math.inf):
        assert run(-far) == (-1.0, 0.0, 0.0)
        assert run(far) == (1.5, 1.0, 1.0)
    assert run(0.0)[2] == 0.25
