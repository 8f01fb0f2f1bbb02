"""Golden outputs of every model, environment and reference agent: what a change of structure must not move.

Run as a script, it records them anew into ``golden.npz``; do so only where behaviour changes on purpose, and
say so in the changelog with figures.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import gymnasium as gym
import numpy as np

import fieldgym
from fieldagents.config import EnvironmentConfig
from fieldagents.evaluation.episodes import run_episodes
from fieldagents.seeds import TEST_SEEDS
from fieldagents.task import get_task
from fieldmodels.machines.excitation.recording import record_experiment
from fieldmodels.machines.heel_strike import parameters as heel_strike
from fieldmodels.machines.heel_strike.recording import record_walk as record_leg
from fieldmodels.machines.line_following.parameters import Noise
from fieldmodels.machines.line_following.recording import record_walk
from fieldmodels.machines.line_following.tracks import straight
from fieldmodels.machines.line_following.walks import Scene
from fieldmodels.machines.pose_reaching.recording import record_drive
from fieldmodels.machines.uav_route.recording import record_flight
from fieldmodels.recording import Recording
from fieldmodels.registry import get_model
from fieldmodels.synthesis import synthesise

FILE = Path(__file__).with_name("golden.npz")
MODELS = (
    "rig",
    "pendulum",
    "propeller_arm",
    "servo",
    "differential_drive",
    "pose_reaching",
    "line_following",
    "uav_route",
    "heel_strike",
    "excitation",
)
RECORDED = {"propeller_arm": "pendulum", "servo": "rig", "differential_drive": "pose_reaching"}
"""Whose records are the data of a model that has no recorder of its own."""
RECORDERS: dict[str, Callable[[np.random.Generator], Recording]] = {
    "rig": lambda rng: synthesise(get_model("rig"), {}, "mixed", amplitude=8.0, rng=rng),
    "pendulum": lambda rng: synthesise(get_model("pendulum"), {}, "swing", amplitude=1.2, rng=rng),
    "pose_reaching": lambda rng: record_drive(120.0, rng),
    "line_following": lambda rng: record_walk(
        None, 1000, scene=Scene(straight(710.0), noise=Noise(bias=0.0)), rng=rng
    ),
    "uav_route": lambda rng: record_flight(None, 2000.0, episodes=4, rng=rng),
    "heel_strike": lambda rng: record_leg(
        120.0, rng, heel_strike.Noise(process=0.15, floor=0.001), leg=heel_strike.Leg(step=0.01)
    ),
    "excitation": lambda rng: record_experiment(rng, duration=4.0),
}
STEPS = 25
SLOW = {
    "uav_route": {"printed", "printed_joint", "printed_lock_loss"},
    "heel_strike": {"ekf_filterpy", "imm_filterpy"},
}
"""Agents that take minutes."""


def simulations(name: str) -> Iterator[tuple[str, np.ndarray]]:
    """Outputs of a model on recorded data: nominal, then with every effect on at its first start."""
    model = get_model(name)
    recording = RECORDERS[RECORDED.get(name, name)](np.random.default_rng(7))
    if name in RECORDED:  # the same data under this model's names of its inputs
        commands = [recording[s.name] for s in get_model(RECORDED[name]).inputs]
        own = dict(zip([s.name for s in model.inputs], commands, strict=True))
        signals = {**recording.signals, **own}
        recording = type(recording)(time=recording.time, signals=signals, episode=recording.episode)
    windows = model.windows(recording, model.horizons[1])
    some = np.unique(np.linspace(0, len(windows) - 1, 6).astype(int))
    windows = windows.select(some)
    yield (
        f"model/{name}/recording",
        np.column_stack(
            [recording[s.name][:: max(1, len(recording) // 40)] for s in model.outputs if s.name in recording]
        ),
    )
    rows, keys = [model.nominal], ["nominal"]
    for effect in model.effects:
        row = model.nominal.copy()
        part = model.slice_of(effect.name)
        row[part] = [p.starts[0] if p.starts else p.nominal + p.scale for p in effect.parameters]
        rows.append(row)
        keys.append(effect.name)
    out = model.simulate(np.array(rows), windows)
    thin = max(1, out.shape[2] // 8)
    for key, values in zip(keys, out, strict=True):
        yield f"model/{name}/{key}", values[:, ::thin]


def episodes(task: str) -> Iterator[tuple[str, np.ndarray]]:
    """Observations and rewards of an environment under seeded actions, scalar and as a batch of three."""
    spec = fieldgym.TASKS[task]
    model = get_model(spec.model)
    realities: list[tuple[str, object]] = [("nominal", None)]
    effect = model.effects[0]
    values = {p.name: p.starts[0] if p.starts else p.nominal + p.scale for p in effect.parameters}
    realities.append((effect.name, {effect.name: values}))
    for key, reality in realities:
        envs = gym.make_vec(spec.env_id, num_envs=3, reality=reality)
        rng = np.random.default_rng(5)
        observation, _ = envs.reset(seed=11)
        seen, rewards = [observation], []
        low, high = envs.single_action_space.low, envs.single_action_space.high
        for _ in range(STEPS):
            action = low + (high - low) * rng.random((3, *low.shape)) * 0.8
            observation, reward, *_ = envs.step(action.astype(np.float32))
            seen.append(observation)
            rewards.append(reward)
        flat = np.array(seen, dtype=float).reshape(STEPS + 1, -1)
        yield f"environment/{task}/{key}/observation", flat[::4, :: max(1, flat.shape[1] // 60)]
        yield f"environment/{task}/{key}/reward", np.array(rewards)


def agents(task: str) -> Iterator[tuple[str, np.ndarray]]:
    """Scores of every reference agent on the first two test seeds."""
    for name, reference in get_task(task).agents.items():
        if name in SLOW.get(task, ()):
            continue
        config = EnvironmentConfig()
        table = run_episodes(reference.make({}), task, config, TEST_SEEDS[:2])
        numbers = table.select_dtypes("number")
        yield f"agent/{task}/{name}", numbers.reindex(sorted(numbers.columns), axis=1).to_numpy(dtype=float)


def everything() -> Iterator[tuple[str, np.ndarray]]:
    """All golden outputs, by name."""
    for name in MODELS:
        yield from simulations(name)
    for task in fieldgym.TASKS:
        yield from episodes(task)
    for task in fieldgym.TASKS:
        yield from agents(task)


if __name__ == "__main__":
    import time

    found, begun = {}, time.perf_counter()
    for key, value in everything():
        found[key] = value
        now = time.perf_counter()
        if now - begun > 1.0:
            print(f"{now - begun:6.1f} s  {key}", file=sys.stderr, flush=True)
        begun = now
    np.savez_compressed(FILE, **found)
    print(len(found), "outputs,", FILE.stat().st_size, "bytes")
