"""How large the diagnosis is, by the graph of its calls.

    python tests/size.py                             # lines and numbers that `diagnose` reaches, by module
    python tests/size.py --without procedure._found  # what nothing reaches any more without a definition

Counted are definitions of `fieldmodels.diagnosis`: recordings, machines and their simulation are not. Numbers
are numeric literals but -1, 0, 1/2, 1 and 2, those inside arithmetic included, in modules that may change a
verdict. A method counts as reached if its class is, and its name is an attribute in anything that is.
"""

import argparse
import ast
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

SOURCE = Path(__file__).parents[1] / "src/fieldmodels/diagnosis"
PACKAGE, START = "fieldmodels.diagnosis", ("procedure", "diagnose")
SHOWN = {
    "answer", "correlation", "evidence", "figures", "free_run", "next_measurement", "outcome", "phrases",
    "planned_inputs", "power", "report", "residuals", "result", "runnable", "unseen", "use",
}  # fmt: skip
"""Modules that word, draw or measure what has been decided."""
PLAIN = {0, 0.5, 1, 2}

Name = tuple[str, str]
"""A module, and a definition in it or a method as Class.method."""


class Calls:
    """Who may call whom."""

    def __init__(self) -> None:
        self.nodes: dict[Name, ast.stmt] = {}
        self._seen: dict[str, dict[str, Name]] = {}
        self._trees = {path.stem: ast.parse(path.read_text()) for path in sorted(SOURCE.glob("*.py"))}
        for module, tree in self._trees.items():
            own = {one: (module, one) for node in tree.body for one in self._defined(module, node)}
            self._seen[module] = self._imported(tree) | own

    def _defined(self, module: str, node: ast.stmt) -> Iterator[str]:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            self.nodes[module, node.name] = node
            yield node.name
            for inner in node.body if isinstance(node, ast.ClassDef) else ():
                if isinstance(inner, ast.FunctionDef):
                    self.nodes[module, f"{node.name}.{inner.name}"] = inner
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
                for one in (n for n in ast.walk(target) if isinstance(n, ast.Name)):
                    self.nodes[module, one.id] = node
                    yield one.id

    def _imported(self, tree: ast.AST) -> dict[str, Name]:
        found: dict[str, Name] = {}
        for node in (n for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) and n.module):
            package, _, module = str(node.module).rpartition(".")
            for one in node.names:
                if package == PACKAGE:
                    found[one.asname or one.name] = module, one.name
                elif node.module == PACKAGE and one.name in self._trees:  # a module, used by its attributes
                    found |= {key[1]: key for key in self.nodes if key[0] == one.name}
        return found

    def reached(self, roots: set[Name], without: Name | None = None) -> set[Name]:
        """All definitions that some may call, without ever calling one of them."""
        result, attributes, waiting = set[Name](), set[str](), [*roots]
        while waiting:
            name = waiting.pop()
            if name in result or name == without or name not in self.nodes:
                continue
            result.add(name)
            parts: list[ast.AST] = [self.nodes[name]]
            if isinstance(whole := parts[0], ast.ClassDef):
                body = (n for n in whole.body if not isinstance(n, ast.FunctionDef))
                parts = [*whole.bases, *whole.decorator_list, *body]
            for node in (n for part in parts for n in ast.walk(part)):
                if isinstance(node, ast.Attribute):
                    attributes.add(node.attr)
                word = node.attr if isinstance(node, ast.Attribute) else getattr(node, "id", "")
                if word in self._seen[name[0]]:
                    waiting.append(self._seen[name[0]][word])
            for module, method in self.nodes:
                owner, dot, short = method.partition(".")
                called = short in attributes or (short.startswith("__") and short.endswith("__"))
                if dot and called and (module, owner) in result and (module, method) not in result:
                    waiting.append((module, method))
        return result


def numbers(node: ast.AST) -> int:
    """Numeric literals that are not plain."""
    found = (n.value for n in ast.walk(node) if isinstance(n, ast.Constant))
    return sum(isinstance(one, int | float) and abs(one) not in PLAIN for one in found)


def lines(calls: Calls, names: set[Name]) -> Counter[str]:
    """Lines of some definitions by module, each counted once."""
    spans = {
        (module, line)
        for module, name in names
        for line in range(calls.nodes[module, name].lineno, (calls.nodes[module, name].end_lineno or 0) + 1)
    }
    return Counter(module for module, _ in spans)


def main() -> None:
    """Print a line a module, and the sums."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--without", metavar="MODULE.NAME", help="a definition that is left out")
    calls, without = Calls(), parser.parse_args().without
    whole = calls.reached({START})
    if without:
        module, _, name = without.partition(".")
        if (module, name) not in calls.nodes:
            parser.error(f"--without {without}: there is no such definition in {SOURCE}")
        lost = whole - calls.reached({START}, (module, name))
        for module, size in sorted(lines(calls, lost).items()):
            print(f"{module:20}{size:6}  {', '.join(sorted(n for m, n in lost if m == module))}")
        print(f"{'all':20}{sum(lines(calls, lost).values()):6}")
        return
    found = lines(calls, whole)
    literal = Counter[str]()
    for module, name in whole:
        if module not in SHOWN and "." not in name:
            literal[module] += numbers(calls.nodes[module, name])
    for module, size in sorted(found.items()):
        print(f"{module:20}{size:6}{literal[module]:6}")
    print(f"{'all':20}{sum(found.values()):6}{sum(literal.values()):6}")


if __name__ == "__main__":
    main()
