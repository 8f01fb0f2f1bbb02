"""Measured data from a hidden reality: for ``fieldgym record``, for tests, and for exams of the diagnosis."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.signal import lfilter

from fieldmodels.arrays import FloatArray
from fieldmodels.drivers.declaration import slopes_at
from fieldmodels.drivers.named import apply_reality
from fieldmodels.machines.one_axis.model import OneAxis
from fieldmodels.model import Model, ModelError, Signal
from fieldmodels.names import did_you_mean
from fieldmodels.reality import Reality
from fieldmodels.recording import Recording, Windows
from fieldmodels.registry import get_model

Excitation = Callable[[float, float, np.random.Generator], FloatArray]
Noise = bool | float | Mapping[str, float]


def multisine(duration: float, step: float, rng: np.random.Generator) -> FloatArray:
    """Twelve sines of random phase from 0.1 to 4 Hz, falling with the root of the frequency."""
    time = np.arange(round(duration / step)) * step
    frequencies = np.geomspace(0.1, 4.0, 12) * rng.uniform(0.95, 1.05, 12)
    phases = rng.uniform(0, 2 * np.pi, 12)
    waves = np.sin(2 * np.pi * np.outer(time, frequencies) + phases) / np.sqrt(frequencies)
    return _peak_one(waves.sum(axis=1))


def prbs(duration: float, step: float, rng: np.random.Generator) -> FloatArray:
    """A pseudo-random binary sequence that may switch every 0.1 s."""
    return np.repeat(rng.choice([-1.0, 1.0], size=round(duration / 0.1) + 1), max(round(0.1 / step), 1))[
        : round(duration / step)
    ]


def steps(duration: float, step: float, rng: np.random.Generator) -> FloatArray:
    """Steps to random levels, each held for 0.3 to 1.5 s."""
    values = np.empty(round(duration / step))
    i = 0
    while i < len(values):
        count = round(rng.uniform(0.3, 1.5) / step)
        values[i : i + count] = rng.uniform(-1.0, 1.0)
        i += count
    return values


def chirp(duration: float, step: float, rng: np.random.Generator) -> FloatArray:
    """A sine that sweeps from 0.1 to 5 Hz, from a random phase."""
    time = np.arange(round(duration / step)) * step
    phase = 2 * np.pi * 0.1 * duration / np.log(50.0) * (50.0 ** (time / duration) - 1.0)
    return np.asarray(np.sin(phase + rng.uniform(0, 2 * np.pi)))


def mixed(duration: float, step: float, rng: np.random.Generator) -> FloatArray:
    """A multisine on steps, with pauses: slow and fast, large and small, and at rest."""
    wave = 0.6 * multisine(duration, step, rng) + 0.4 * steps(duration, step, rng)
    time = np.arange(len(wave)) * step
    envelope = np.interp(time, np.linspace(0, duration, 13), rng.permutation(np.linspace(0.15, 1.0, 13)))
    return _peak_one(wave * envelope)


EXCITATIONS: Mapping[str, Excitation] = {
    "multisine": multisine,
    "prbs": prbs,
    "steps": steps,
    "chirp": chirp,
    "mixed": mixed,
}


def swing(model: OneAxis, duration: float, step: float, peak: float, rng: np.random.Generator) -> FloatArray:
    """What moves the nominal axis along a smooth random path of a given peak: its inverse dynamics.

    An axis without damping (the nominal pendulum) would wander off under any other excitation.
    """
    time = np.arange(round(duration / step)) * step
    frequencies = np.geomspace(0.15, 1.8, 8) * rng.uniform(0.95, 1.05, 8)
    phases = rng.uniform(0, 2 * np.pi, 8)
    envelope = PchipInterpolator(np.linspace(0, duration, 9), rng.permutation(np.linspace(0.25, 1.0, 9)))(
        time
    )
    waves = np.sin(2 * np.pi * np.outer(time + 0.5 * step, frequencies) + phases) / np.sqrt(frequencies)
    path = peak * _peak_one(waves.sum(axis=1) * envelope * np.sin(0.5 * np.pi * np.minimum(time, 1.0)) ** 4)
    velocity = np.gradient(path, step)
    inertia = model.inertia_of(model.forces[0])
    free = [slopes_at(model, [x, v], 0.0)[1] for x, v in zip(path, velocity, strict=True)]
    return np.asarray(inertia * (np.gradient(velocity, step) - np.array(free)))


def excitation(name: str, duration: float, step: float, rng: np.random.Generator) -> FloatArray:
    """A command of peak one by name, shape (round(duration / step),).

    Raises:
        ModelError: If there is no such excitation.
    """
    if name not in EXCITATIONS:
        raise ModelError(f"no excitation {name!r}{did_you_mean(name, EXCITATIONS)}")
    return EXCITATIONS[name](duration, step, rng)


def synthesise(
    model: Model | str,
    reality: Reality | Mapping[str, Any] | None,
    inputs: str | Mapping[str, FloatArray] | FloatArray,
    *,
    duration: float = 30.0,
    step: float = 0.01,
    amplitude: float = 1.0,
    episodes: int = 1,
    rng: np.random.Generator,
    noise: Noise = True,
    coloured: float = 0.0,
    refine: int = 8,
) -> Recording:
    """Record what a hidden reality does under an excitation.

    The reality is simulated on a time grid ``refine`` times finer than the recording's, from the
    model's zero state, over whole episodes; so it is not computed as a diagnosis computes it.

    Args:
        model: The model whose extended form is the reality, or its name.
        reality: What differs from the nominal simulation; stock effects that it names act around the model.
        inputs: The name of an excitation ("swing" for a path, of an axis); or the commands
            themselves, each of shape (n,) per episode.
        duration: Length of an episode [s], if an excitation is named.
        step: Sampling interval [s].
        amplitude: Peak of the excitation, in the input's unit; of a swing, in the position's.
        episodes: Number of episodes.
        rng: Source of all randomness.
        noise: True for every output's own noise; a factor on it; or standard deviations by output.
        coloured: Share of the noise's variance that wanders slowly (correlation time 0.5 s).
        refine: How many times finer the simulation's time grid is.

    Returns:
        One row a sample: the commands and the measured outputs.

    Raises:
        ModelError: For an unknown excitation or reality, commands of a wrong shape, or fewer than two
            samples.
    """
    model = get_model(model)
    commands = _commands(model, inputs, duration, step, amplitude, episodes, rng)
    model, truth = apply_reality(model, reality)
    clean, quantum = _without_quantisation(truth)
    count = len(commands[0])
    fine = step / refine
    length = count * refine
    held = np.concatenate([model.between(c, refine) for c in commands])
    recording = Recording(
        time=np.tile(np.arange(length) * fine, episodes),
        signals={signal.name: held[:, i] for i, signal in enumerate(model.inputs)}
        | {signal.name: np.zeros(len(held)) for signal in model.outputs},
        episode=np.repeat(np.arange(episodes), length),
    )
    starts = np.arange(episodes) * length
    windows = Windows(
        recording=recording,
        starts=starts,
        lengths=np.full(episodes, length),
        states=np.zeros((episodes, len(model.states))),
        observed=np.ones((episodes, length, len(model.outputs)), dtype=np.bool_),
    )
    result = model.simulate(clean.vector(model)[None, :], windows)[0]
    signals = {signal.name: np.concatenate(commands)[:, i] for i, signal in enumerate(model.inputs)}
    for j, signal in enumerate(model.outputs):
        values = _sampled(result[:, :, j], refine, signal) + _noise(
            _deviation(noise, signal), coloured, (episodes, count), step, rng
        )
        if j == 0 and quantum > 0:
            values = quantum * np.round(values / quantum)
        signals[signal.name] = values.ravel()
    return Recording(
        time=np.tile(np.arange(count) * step, episodes),
        signals=signals,
        units={s.name: s.unit for s in (*model.inputs, *model.outputs)},
        episode=np.repeat(np.arange(episodes), count),
        source=f"simulation of {model.name}",
    )


def _commands(
    model: Model,
    inputs: str | Mapping[str, FloatArray] | FloatArray,
    duration: float,
    step: float,
    amplitude: float,
    episodes: int,
    rng: np.random.Generator,
) -> list[FloatArray]:
    """Commands of each episode, each of shape (n, inputs)."""
    if isinstance(inputs, str):
        if round(duration / step) < 2:
            raise ModelError(f"{duration:g} s at a step of {step:g} s is no recording; record for longer")
        if inputs == "swing" and isinstance(model, OneAxis):
            return [swing(model, duration, step, amplitude, rng)[:, None] for _ in range(episodes)]
        return [
            amplitude * np.column_stack([excitation(inputs, duration, step, rng) for _ in model.inputs])
            for _ in range(episodes)
        ]
    if isinstance(inputs, Mapping):
        missing = [signal.name for signal in model.inputs if signal.name not in inputs]
        if missing:
            raise ModelError(f"commands for {missing} are missing; model {model.name!r} needs them")
        given = np.column_stack([np.asarray(inputs[signal.name], dtype=float) for signal in model.inputs])
    else:
        given = np.asarray(inputs, dtype=float).reshape(len(inputs), -1)
        if given.shape[1] != len(model.inputs):
            raise ModelError(f"model {model.name!r} takes {len(model.inputs)} commands, not {given.shape[1]}")
    return [given] * episodes


def _without_quantisation(reality: Reality) -> tuple[Reality, float]:
    """The reality without its sensor's quantisation, which acts after the noise; and that step."""
    effects = {k: v for k, v in reality.effects.items() if k != "sensor_quantisation"}
    quantum = float(reality.effects.get("sensor_quantisation", {}).get("step", 0.0))
    return replace(reality, effects=effects), quantum


def _sampled(fine: FloatArray, refine: int, signal: Signal) -> FloatArray:
    """What a sensor shows of a fine simulation, shape (episodes, n)."""
    if not signal.averaged:
        return fine[:, ::refine]
    sums = np.cumsum(fine, axis=1)[:, ::refine]
    return np.concatenate([fine[:, :1], np.diff(sums, axis=1) / refine], axis=1)


def _deviation(noise: Noise, signal: Signal) -> float:
    if isinstance(noise, Mapping):
        return float(noise.get(signal.name, signal.noise))
    return float(noise) * signal.noise


def _noise(
    deviation: float, coloured: float, shape: tuple[int, int], step: float, rng: np.random.Generator
) -> FloatArray:
    """White noise, of whose variance a share wanders with a correlation time of 0.5 s."""
    white = rng.standard_normal(shape)
    decay = np.exp(-step / 0.5)
    drive = np.sqrt(1.0 - decay**2) * rng.standard_normal(shape)
    drive[:, 0] = rng.standard_normal(shape[0])
    wander = lfilter([1.0], [1.0, -decay], drive, axis=1)
    noise: FloatArray = deviation * (np.sqrt(1.0 - coloured) * white + np.sqrt(coloured) * wander)
    return noise


def _peak_one(values: FloatArray) -> FloatArray:
    peak: FloatArray = values / np.max(np.abs(values))
    return peak
