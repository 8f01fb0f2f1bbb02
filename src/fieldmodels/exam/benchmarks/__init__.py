"""Records of one machine each for tests, by its own model on a finer grid.

A model has a benchmark if a module here goes by its name, with a class that does.
"""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules

from fieldmodels.exam.benchmarks.base import Benchmark, Outside
from fieldmodels.model import ModelError
from fieldmodels.names import class_name, did_you_mean
from fieldmodels.registry import model_names


def benchmark_names() -> tuple[str, ...]:
    """Names of the models that have a benchmark."""
    modules = {module.name for module in iter_modules(__path__)}
    return tuple(name for name in model_names() if name in modules)


def get_benchmark(name: str) -> Benchmark:
    """The benchmark of a model, imported when it is asked for.

    Raises:
        ModelError: If the model has none; the message says which have.
    """
    if name not in (known := benchmark_names()):
        raise ModelError(f"no benchmark of a model {name!r}{did_you_mean(name, known)}")
    benchmark: Benchmark = getattr(import_module(f"{__name__}.{name}"), class_name(name))()
    return benchmark


__all__ = ["Benchmark", "Outside", "benchmark_names", "get_benchmark"]
