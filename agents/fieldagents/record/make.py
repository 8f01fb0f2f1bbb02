"""`fieldgym record`: measured data from a hidden reality, as a bench or a robot would deliver them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fieldagents.record.config import ExcitationConfig, RecordConfig
from fieldagents.task import recorder_of
from fieldmodels.arrays import FloatArray
from fieldmodels.drivers.named import apply_reality
from fieldmodels.model import Model
from fieldmodels.reality import SCHEMA, Reality
from fieldmodels.recording import Recording, RecordingError
from fieldmodels.recording.files import load_recording, save_recording
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
    truth = _reality(config)
    hidden = out / f"{config.name}.reality.yaml"
    save_yaml(
        {
            "schema": SCHEMA,
            "machine": config.machine,
            "parameters": dict(truth.base),
            "effects": {name: dict(values) for name, values in truth.effects.items()},
        },
        hidden,
    )
    return {"recording": data, "reality": hidden}


def _reality(config: RecordConfig) -> Reality:
    """The hidden reality; samplers in it are drawn once, by the config's seed but apart from the noise."""
    model, reality = apply_reality(get_model(config.machine), config.reality)
    return reality.draw(model, np.random.default_rng([config.seed, 1])) if reality.random else reality


def make_recording(config: RecordConfig) -> Recording:
    """The measured data that a config describes; equal configs give equal data."""
    reality = _reality(config)
    recorder = recorder_of(config.machine)
    make = recorder.record if recorder else _driven
    return make(config, get_model(config.machine), reality, np.random.default_rng(config.seed))


def _driven(config: RecordConfig, model: Model, reality: Reality, rng: np.random.Generator) -> Recording:
    """A model whose input is commanded; a user's own is checked first."""
    from fieldmodels.contract import at_rest, check_simulation
    from fieldmodels.model_files import is_model_file
    from fieldmodels.synthesis import synthesise

    drive = config.excitation or ExcitationConfig()
    if is_model_file(config.machine):
        trial = at_rest(model, config.step or 0.01, drive.amplitude, np.random.default_rng(config.seed))
        check_simulation(model, trial, config.machine)
    return synthesise(
        model,
        reality,
        drive.kind if config.input is None else commands(config, model, 0.01),
        duration=config.duration,
        step=config.step or 0.01,
        amplitude=drive.amplitude,
        episodes=config.episodes,
        rng=rng,
        noise=config.noise,
    )


def commands(config: RecordConfig, model: Model, usual_step: float) -> FloatArray:
    """The commands of the config's ``input`` file, cut to its duration, shape (n, inputs).

    Args:
        config: With an ``input``.
        model: Says which columns.
        usual_step: Sampling interval if the config states none [s].

    Raises:
        RecordingError: If the file lacks an input, has another step, or is too short.
    """
    assert config.input is not None
    planned = load_recording(config.input)
    names = [signal.name for signal in model.inputs]
    missing = [name for name in names if name not in planned]
    if missing:
        raise RecordingError(
            f"{config.input}: model {model.name!r} is commanded by {', '.join(names)}; column "
            f"{', '.join(missing)} is missing"
        )
    step = config.step or usual_step
    if abs(planned.step - step) > 1e-6 * step:
        raise RecordingError(
            f"{config.input}: rows are {planned.step:g} s apart, the recording's step is {step:g} s; "
            f"set step: {planned.step:g}"
        )
    count = round(config.duration / step)
    if len(planned) < count:
        raise RecordingError(
            f"{config.input}: {len(planned) * step:g} s of commands, but duration is {config.duration:g} s; "
            f"set duration: {len(planned) * step:g}"
        )
    return np.column_stack([planned[name] for name in names])[:count]
