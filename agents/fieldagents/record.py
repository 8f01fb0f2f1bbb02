"""`fieldgym record`: measured data from a hidden reality, as a bench or a robot would deliver them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from fieldagents.config import ExcitationConfig, RecordConfig, WalkConfig
from fieldmodels.arrays import FloatArray
from fieldmodels.model import Model
from fieldmodels.reality import Reality, read_reality
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
    make = RECORDERS.get(config.model, _driven)
    return make(config, model, reality, np.random.default_rng(config.seed))


def _driven(config: RecordConfig, model: Model, reality: Reality, rng: np.random.Generator) -> Recording:
    """A model whose input is commanded; a user's own is checked first."""
    from fieldmodels.contract import at_rest, check_simulation
    from fieldmodels.model_files import is_model_file
    from fieldmodels.synthesis import synthesise

    drive = config.excitation or ExcitationConfig()
    if is_model_file(config.model):
        trial = at_rest(model, config.step or 0.01, drive.amplitude, np.random.default_rng(config.seed))
        check_simulation(model, trial, config.model)
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


def _experiment(config: RecordConfig, model: Model, reality: Reality, rng: np.random.Generator) -> Recording:
    """A vehicle that its arm shakes by random sinusoids, in all three modes."""
    from fieldmodels.machines.excitation.model import ExcitationModel
    from fieldmodels.machines.excitation.recording import record_experiment

    assert isinstance(model, ExcitationModel)
    return record_experiment(
        rng,
        reality,
        duration=config.duration,
        step=config.step or 0.01,
        repeats=config.episodes,
        noise=config.noise,
        model=model,
    )


def _walk(config: RecordConfig, _: Model, reality: Reality, rng: np.random.Generator) -> Recording:
    """A walker that nobody drives."""
    from fieldmodels.machines.heel_strike.parameters import Noise, Regimes
    from fieldmodels.machines.heel_strike.recording import record_walk

    walk = config.walk or WalkConfig()
    kind = walk.collision_kind
    noise = Regimes.preset(kind) if walk.regimes else Noise(collision_kind=kind)
    return record_walk(config.duration, rng, noise, reality)


def _line(config: RecordConfig, _: Model, reality: Reality, rng: np.random.Generator) -> Recording:
    """A walker that follows a line."""
    from fieldgym.line_following import LineFollowingSettings
    from fieldgym.settings import read_settings
    from fieldmodels.machines.line_following.parameters import Gait
    from fieldmodels.machines.line_following.recording import record_walk

    # a bias that is drawn would be an effect that nobody has switched on
    walked = read_settings(
        {"track": "straight", "bias": 0.0, **(config.settings or {})}, LineFollowingSettings
    )
    strides = max(1, round(config.duration / Gait().stride_time))
    return record_walk(reality, strides, scene=walked.scene(images=False), rng=rng)


def _drive(config: RecordConfig, model: Model, reality: Reality, rng: np.random.Generator) -> Recording:
    """A robot that drives by random commands."""
    from fieldmodels.machines.pose_reaching.model import PoseReaching
    from fieldmodels.machines.pose_reaching.recording import record_commands, record_drive

    assert isinstance(model, PoseReaching)
    if config.input is not None:
        given = commands(config, model, 0.05)
        return record_commands(
            given,
            rng,
            reality,
            step=config.step or 0.05,
            episodes=config.episodes,
            noise=config.noise,
            model=model,
        )
    return record_drive(
        config.duration,
        rng,
        reality,
        step=config.step or 0.05,
        episodes=config.episodes,
        noise=config.noise,
        model=model,
    )


def _flight(config: RecordConfig, _: Model, reality: Reality, rng: np.random.Generator) -> Recording:
    """An aircraft that flies from waypoint to waypoint under a radar's looks."""
    from fieldmodels.machines.uav_route.recording import record_flight

    return record_flight(
        reality,
        config.duration,
        episodes=config.episodes,
        step=config.step or 2.0,
        noise=config.noise,
        rng=rng,
    )


RECORDERS = {
    "excitation": _experiment,
    "heel_strike": _walk,
    "line_following": _line,
    "pose_reaching": _drive,
    "differential_drive": _drive,
    "uav_route": _flight,
}
"""Who records a model that is not simply driven by a command."""
