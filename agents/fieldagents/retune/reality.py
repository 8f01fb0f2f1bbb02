"""The loop closed in one drawn reality: recorded, diagnosed, tuned for, tested."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd

from fieldagents.agent import Agent
from fieldagents.config import EnvironmentConfig
from fieldagents.evaluation.episodes import play_episodes
from fieldagents.progress import Report, stages
from fieldagents.record import make_recording
from fieldagents.record.config import RecordConfig
from fieldagents.retune.after import nothing_to_retune
from fieldagents.retune.config import RealitiesConfig, seeds_of
from fieldagents.retune.result import NOMINAL, ORACLE, RETUNED
from fieldagents.retune.trained import tuner_of
from fieldagents.seeds import LARGEST_SEED
from fieldgym import find_task
from fieldmodels.diagnosis import diagnose
from fieldmodels.drivers.named import apply_reality
from fieldmodels.files import replacing
from fieldmodels.model import StrayedError
from fieldmodels.recording import Recording, RecordingError
from fieldmodels.registry import get_model
from fieldmodels.yaml import save_yaml

EPISODES = "episodes.parquet"
DRAW = 2
"""Stream of a seed from which a reality is drawn, apart from the recording's noise."""
AGAIN = 3
"""Stream from which the seeds of further walks are drawn, of a robot that strays."""
WALKS = 100
"""Times that such a robot is put back, at most."""


def close(config: RealitiesConfig, number: int, folder: Path, report: Report) -> dict[str, Any]:
    """Draw a reality, record it, diagnose the recording, tune by the result, and test.

    Args:
        config: What realities are drawn from, how they are recorded, what is tuned.
        number: Which reality.
        folder: Where the table of episodes and the ``extended.yaml`` are left.
        report: Shown the progress.

    Returns:
        Those attributes of ``realities.Closed`` that do not follow from the episodes.
    """
    seeds = seeds_of(config.seeds)
    hidden = drawn(config, seeds[number])
    seconds: dict[str, float] = {}
    began = time.process_time()

    def took(part: str) -> None:
        nonlocal began
        now = time.process_time()
        seconds[part], began = round(now - began, 2), now

    try:
        recording = recorded(config, hidden, seeds[number])
        took("record")
        model = get_model(find_task(config.task).model)
        found = diagnose(model, [recording], progress=lambda stage, part: report(stage, 0.5 * part))
    except RecordingError as error:  # too short: the robot has left what it follows
        verdict, extended, skipped = "not recorded", {}, f"Nothing to re-tune with: {error}"
    else:
        verdict, extended, skipped = found.verdict, found.extended(), nothing_to_retune(found) or ""
    save_yaml(extended, folder / "extended.yaml")
    took("diagnose")
    agents: dict[str, list[Agent]] = {}
    agents[NOMINAL] = _nominal(config.model_dump_json(include={"task", "agent", "options", "settings"}))
    took(NOMINAL)
    stays = skipped and not tuner_of(config.task, config.agent).conditioned
    agents[RETUNED] = agents[NOMINAL] if stays else _made(config, str(folder / "extended.yaml"))
    took(RETUNED)
    agents[ORACLE] = _made(config, hidden)
    took(ORACLE)
    where = EnvironmentConfig(settings=config.settings, reality=hidden)
    own = seeds[number * config.episodes : (number + 1) * config.episodes]
    tables = [
        play_episodes(agent, config.task, where, own, stages(report, 0.5)).table.assign(agent=name, run=run)
        for name, runs in agents.items()
        for run, agent in enumerate(runs)
    ]
    with replacing(folder / EPISODES) as temporary:
        pd.concat(tables, ignore_index=True).to_parquet(temporary, index=False)
    named = {} if skipped else extended["effects"]
    return {
        "hidden": hidden,
        "verdict": verdict,
        "named": {
            effect: {key: float(value["value"]) for key, value in values.items()}
            for effect, values in named.items()
        },
        "skipped": skipped,
        "seconds": seconds,
    }


def recorded(config: RealitiesConfig, hidden: Any, seed: int) -> Recording:
    """A reality's recording; a robot that strays is put back and recorded again, until as much is recorded.

    Raises:
        RecordingError: If it strays at once.
    """
    walks: list[Recording] = []
    left, again = float(config.record["duration"]), np.random.default_rng([seed, AGAIN])
    while left > 0 and len(walks) < WALKS:
        log = _until_it_strays(config, hidden, int(again.integers(LARGEST_SEED)) if walks else seed, left)
        if log is None:
            break
        walks.append(log)
        left -= len(log) * log.step
    if not walks:
        raise RecordingError("the robot strays at once")
    if len(walks) == 1:
        return walks[0]
    return replace(
        walks[0],
        time=np.concatenate([log.time for log in walks]),
        signals={name: np.concatenate([log[name] for log in walks]) for name in walks[0].signals},
        episode=np.repeat(np.arange(len(walks)), [len(log) for log in walks]),
    )


def _until_it_strays(config: RealitiesConfig, hidden: Any, seed: int, duration: float) -> Recording | None:
    """A walk of at most so long [s]; nobody has a log of what comes after the robot has strayed."""
    parts = {"name": "record", "machine": find_task(config.task).model, "reality": hidden, "seed": seed}
    while duration > 0:
        try:
            return make_recording(
                RecordConfig.model_validate({**config.record, **parts, "duration": duration})
            )
        except StrayedError as error:
            duration = error.lasted
    return None


def drawn(config: RealitiesConfig, seed: int) -> dict[str, dict[str, float]]:
    """Some of the config's faults, with drawn sizes."""
    rng = np.random.default_rng([seed, DRAW])
    names = list(config.hidden)
    count = int(rng.integers(1, min(config.together, len(names)) + 1))
    chosen = sorted(rng.choice(len(names), count, replace=False))
    model, reality = apply_reality(
        get_model(find_task(config.task).model), {names[i]: config.hidden[names[i]] for i in chosen}
    )
    return reality.draw(model, rng).plain()


def _made(config: RealitiesConfig | SimpleNamespace, reality: Any) -> list[Agent]:
    """The agent for a reality; of a policy that is told, every training run unless one is asked for."""
    tuner = tuner_of(config.task, config.agent)
    options = tuner.options.model_validate(config.options)
    if tuner.conditioned and "run" not in config.options:
        each = [options.model_copy(update={"run": run}) for run in range(tuner.runs)]
    else:
        each = [options]
    return [tuner.tune(config.settings, reality, one) for one in each]


@lru_cache(maxsize=1)
def _nominal(config: str) -> list[Agent]:
    """The agent of the nominal simulation, the same in all realities; by the config's parts that matter."""
    return _made(SimpleNamespace(**json.loads(config)), None)
