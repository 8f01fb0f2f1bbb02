"""Every effect of every machine has an oracle, and values at which the model is held against it."""

import ast
import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

from exam import oracles
from fieldmodels.registry import get_model, model_names

HERE = Path(__file__).parent


def cases():
    """CASES of all test modules of this folder."""
    found = {}
    for file in sorted(HERE.glob("test_*.py")):
        if file.name == Path(__file__).name:
            continue
        spec = importlib.util.spec_from_file_location(file.stem, file)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        found.update(getattr(module, "CASES", {}))
    return found


MACHINES = list(model_names())


@pytest.mark.parametrize("machine", MACHINES)
def test_an_oracle_knows_every_effect_of_its_machine(machine):
    declared = {e.name: {p.name for p in e.parameters} for e in get_model(machine).effects}
    assert {e: set(values) for e, values in oracles.find_oracle(machine).NEUTRAL.items()} == declared


@pytest.mark.parametrize("machine", MACHINES)
def test_every_effect_is_tried_at_several_values_on_both_sides(machine):
    tried = cases()[machine]
    for effect in get_model(machine).effects:
        values = tried[effect.name]
        assert len(values) >= 2, effect.name
        for p in effect.parameters:
            given = np.array([value.get(p.name, p.nominal) for value in values])
            assert np.ptp(given) > 0, f"{effect.name}.{p.name} is tried at one value only"
            sides = {np.sign(g - p.nominal) for g in given}
            if p.smooth and p.lower < p.nominal < p.upper and p.name not in SHAPES:
                assert {-1.0, 1.0} <= sides, f"{effect.name}.{p.name} is tried on one side only"


SHAPES = ("velocity", "distance", "period", "frequency", "length")
"""Parameters that only shape an effect which another one switches on."""


@pytest.mark.parametrize("file", sorted(Path(oracles.__file__).parent.glob("*.py")), ids=lambda f: f.stem)
def test_an_oracle_shares_no_code_with_what_it_checks(file):
    shared = ("fieldmodels.arrays", "exam.oracles", "numpy", "scipy")
    for node in ast.walk(ast.parse(file.read_text())):
        modules = [node.module] if isinstance(node, ast.ImportFrom) else []
        modules += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        for module in modules:
            standard = module.split(".")[0] in sys.stdlib_module_names
            assert standard or module.startswith(shared), f"{file.name} imports {module}"
    assert "import_module" not in file.read_text() or file.name == "__init__.py"


def test_an_unknown_machine_effect_or_parameter_is_refused():
    with pytest.raises(oracles.OracleError, match="no oracle for 'boat'"):
        oracles.find_oracle("boat")
    neutral = {"wind": {"speed": 0.0}}
    assert oracles.filled({}, neutral) == neutral
    for wrong in ({"wind": {"sped": 1.0}}, {"rain": {"speed": 1.0}}):
        with pytest.raises(oracles.OracleError, match="does not know"):
            oracles.filled(wrong, neutral)
