"""The subjects of the exam, one a model, imported when they are asked for."""

from __future__ import annotations

from importlib import import_module

from fieldmodels.exam.subjects.base import Outside, Subject
from fieldmodels.model import ModelError
from fieldmodels.names import did_you_mean

_SUBJECTS = {
    "rig": "Rig",
    "pendulum": "Pendulum",
    "heel_strike": "HeelStrike",
    "excitation": "Excitation",
    "line_following": "LineFollowing",
    "pose_reaching": "PoseReaching",
    "uav_route": "UavRoute",
}


def subject_names() -> tuple[str, ...]:
    """Names of the models that have an exam."""
    return tuple(_SUBJECTS)


def get_subject(name: str) -> Subject:
    """The subject that examines a model.

    Raises:
        ModelError: If the model has no exam; the message says which have.
    """
    if name not in _SUBJECTS:
        raise ModelError(f"no exam of a model {name!r}{did_you_mean(name, _SUBJECTS)}")
    module = import_module(f"fieldmodels.exam.subjects.{name}")
    subject: Subject = getattr(module, _SUBJECTS[name])()
    return subject


__all__ = ["Outside", "Subject", "get_subject", "subject_names"]
