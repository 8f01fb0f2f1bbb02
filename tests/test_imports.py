"""No module imports itself by way of others; scripts beside the packages import what there is."""

import ast
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import grimp
import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("fieldmodels", "fieldgym", "fieldagents", "exam", "papers")


def circles(imports: dict[str, set[str]]) -> set[frozenset[str]]:
    """Groups of modules that reach each other, by following every import from every module."""
    reached = {module: set(direct) for module, direct in imports.items()}
    for through in imports:
        for module, found in reached.items():
            if through in found:
                reached[module] = found | reached[through]
    return {
        frozenset(other for other in found if module in reached[other])
        for module, found in reached.items()
        if module in found
    }


def test_circles_are_seen():
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"a", "d"}, "d": set()}) == {frozenset("abc")}
    assert circles({"a": {"b", "c"}, "b": {"c"}, "c": set()}) == set()


def test_no_module_imports_itself_by_way_of_others():
    graph = grimp.build_graph(*PACKAGES, cache_dir=None)
    found = circles({module: graph.find_modules_directly_imported_by(module) for module in graph.modules})
    assert not [sorted(circle) for circle in found]


SCRIPTS = sorted(
    path.relative_to(ROOT).as_posix()
    for folder in ("benchmarks", "docs")
    for path in ROOT.glob(f"{folder}/*.py")
)


@pytest.mark.every("script", SCRIPTS)
def test_what_a_script_imports_is_there(script: str):
    """A benchmark that the docs name had imported a function that was deleted."""
    tree = ast.parse((ROOT / script).read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] in PACKAGES:
            module = import_module(node.module)
            # What is not yet an attribute may be a module of a package.
            missing = [
                one.name
                for one in node.names
                if not hasattr(module, one.name)
                and not (hasattr(module, "__path__") and find_spec(f"{node.module}.{one.name}"))
            ]
            assert not missing, f"{node.module} has no {missing}"
