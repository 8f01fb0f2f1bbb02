"""`fieldgym record`: measured data from a hidden reality, as a bench or a robot would deliver them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fieldagents.config import ROBOTS, ExcitationConfig, RecordConfig, WalkConfig
from fieldmodels.reality import read_reality
from fieldmodels.recording import Recording
from fieldmodels.recording_files import save_recording
from fieldmodels.registry import get_model
from fieldmodels.yaml import save_yaml


def record(config: RecordConfig, out: Path) -> dict[str, Path]:
    """Record and save.

    Args:
        config: Model, reality, excitation or noise, duration.
        out: Result folder.

    Returns:
        The ``recording`` (CSV or Parquet, without any trace of the reality) and the hidden ``reality``,
        kept apart in ``<name>.reality.yaml`` to compare a diagnosis with.
    """
    data = out / f"{config.name}.{config.format}"
    save_recording(make_recording(config), data)
    model = get_model(config.model)
    truth = read_reality(config.reality, model)
    hidden = out / f"{config.name}.reality.yaml"
    save_yaml(
        {
            "schema": 1,
            "model": config.model,
            "parameters": dict(truth.base),
            "effects": {name: dict(values) for name, values in truth.effects.items()},
        },
        hidden,
    )
    return {"recording": data, "reality": hidden}


def make_recording(config: RecordConfig) -> Recording:
    """The measured data that a config describes; equal configs give equal data."""
    model = get_model(config.model)
    reality = read_reality(config.reality, model)
    rng = np.random.default_rng(config.seed)
    if config.model == "heel_strike":
        from fieldmodels.heel_strike.parameters import Noise, Regimes
        from fieldmodels.heel_strike.recording import record_walk

        walk = config.walk or WalkConfig()
        kind = walk.collision_kind
        noise = Regimes.preset(kind) if walk.regimes else Noise(collision_kind=kind)
        return record_walk(config.duration, rng, noise, reality)
    if config.model in ROBOTS:
        from fieldmodels.pose_reaching.model import PoseReaching
        from fieldmodels.pose_reaching.recording import record_drive

        assert isinstance(model, PoseReaching)
        return record_drive(
            config.duration,
            rng,
            reality,
            step=config.step or 0.05,
            episodes=config.episodes,
            noise=config.noise,
            model=model,
        )
    from fieldmodels.synthesis import synthesise

    drive = config.excitation or ExcitationConfig()
    return synthesise(
        model,
        reality,
        drive.kind,
        duration=config.duration,
        step=config.step or 0.01,
        amplitude=drive.amplitude,
        episodes=config.episodes,
        rng=rng,
        noise=config.noise,
    )
