"""Packages that not every installation has, and the extra that brings each."""

from __future__ import annotations

from importlib import import_module
from typing import Any

EXTRAS = {
    "pyarrow": "parquet", "onnxruntime": "agents", "pygame": "render", "pymunk": "bodies", "torch": "train",
    "stable_baselines3": "train", "sb3_contrib": "train", "tensorboard": "train", "onnx": "train",
    "cma": "train", "optuna": "tune", "ray": "cluster", "filterpy": "filters", "pulp": "planning",
    "moviepy": "video", "cv2": "video", "imageio_ffmpeg": "video",
    "starlette": "app", "uvicorn": "app", "anyio": "app",
    "python_calamine": "excel", "h5py": "hdf5", "rosbags": "ros", "asammdf": "mdf",
    "pyulog": "px4", "pymavlink": "ardupilot", "nptdms": "labview", "lvm_read": "labview",
    "can": "can",
}  # fmt: skip
"""Package to the extra of ``pip install 'fieldgym[...]'``."""


class MissingExtraError(ImportError):
    """A package that only some work needs is not installed."""


def needed(package: str) -> Any:
    """Import a package of an extra.

    Raises:
        MissingExtraError: If it is not installed; names the extra.
    """
    try:
        return import_module(package)
    except ModuleNotFoundError as error:
        raise MissingExtraError(words(error)) from None


def words(error: ModuleNotFoundError) -> str:
    """What to say of a package that is missing; empty if no extra has it."""
    name = (error.name or "").partition(".")[0]
    return f"{name} is not installed: pip install 'fieldgym[{EXTRAS[name]}]'" if name in EXTRAS else ""
