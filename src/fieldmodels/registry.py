"""The models by name, imported when they are asked for."""

from __future__ import annotations

from importlib import import_module

from fieldmodels.model import Model, ModelError
from fieldmodels.model_files import is_model_file, load_model_file
from fieldmodels.names import did_you_mean

_MODELS = {
    "rig": "fieldmodels.machines.rig:Rig",
    "pendulum": "fieldmodels.machines.pendulum:Pendulum",
    "propeller_arm": "fieldmodels.machines.propeller_arm:PropellerArm",
    "heel_strike": "fieldmodels.machines.heel_strike.model:HeelStrikeModel",
    "excitation": "fieldmodels.machines.excitation.model:ExcitationModel",
    "line_following": "fieldmodels.machines.line_following.model:LineFollowing",
    "pose_reaching": "fieldmodels.machines.pose_reaching.model:PoseReaching",
    "differential_drive": "fieldmodels.machines.pose_reaching.model:DifferentialDrive",
    "uav_route": "fieldmodels.machines.uav_route.model:UavRoute",
}


def model_names() -> tuple[str, ...]:
    """Names of all models."""
    return tuple(_MODELS)


def get_model(name: str) -> Model:
    """Return a model by name, or a user's own from the Python file that is named.

    Args:
        name: A name of ``model_names``; or ``my_bench.py``, which is run, or ``my_bench.py:MyBench``.

    Raises:
        ModelError: If there is no such model; the message says which there are.
    """
    if is_model_file(name):
        return load_model_file(name)
    if name not in _MODELS:
        raise ModelError(f"no model {name!r}{did_you_mean(name, _MODELS)}")
    module, _, attribute = _MODELS[name].partition(":")
    model: Model = getattr(import_module(module), attribute)()
    return model
