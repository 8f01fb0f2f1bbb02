"""The models by name, imported when they are asked for."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from pkgutil import iter_modules, resolve_name

from fieldmodels import machines
from fieldmodels.model import Model, ModelError, check_instance
from fieldmodels.model_files import is_model_file, load_model_file
from fieldmodels.names import class_name, did_you_mean


@cache
def _places() -> dict[str, str]:
    """Name to ``module:class`` of every machine of ``fieldmodels.machines``, none of them imported."""
    places = {}
    for found in iter_modules(machines.__path__):
        module = f"{machines.__name__}.{found.name}"
        if not found.ispkg:
            places[found.name] = f"{module}:{class_name(found.name)}"
        elif declared := getattr(import_module(module), "MODEL", None):
            places[found.name] = f"{module}.{declared}"
    return dict(sorted(places.items()))


def model_names() -> tuple[str, ...]:
    """Names of all models."""
    return tuple(_places())


def get_model(name: str | Model) -> Model:
    """Return a model by name, or a user's own from the Python file that is named.

    Args:
        name: A name of ``model_names``; or ``my_bench.py``, which is run, or ``my_bench.py:MyBench``. A model
            is returned as it is.

    Raises:
        ModelError: If there is no such model; the message says which there are.
    """
    check_instance(name)
    if isinstance(name, Model):
        return name
    if is_model_file(name):
        return load_model_file(name)
    if name not in (places := _places()):
        raise ModelError(f"no model {name!r}{did_you_mean(name, places)}")
    model: Model = resolve_name(places[name])()
    return model
