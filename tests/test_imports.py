"""No module imports itself by way of others, not even by an import inside a function or for types only."""

import grimp

PACKAGES = ("fieldmodels", "fieldgym", "fieldagents")


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
