"""The path memory's worked example, and what its source leaves to others: humans, other robots, more paths.

Source: A. I. Chaudhry, "Topics in robot locomotion", Cornell University 2015, chapter 5.
"""

from __future__ import annotations

import math
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import numpy as np
import pandas as pd
from pydantic import Field as Bounded

from fieldagents.agent import Agent
from fieldagents.config import EnvironmentConfig
from fieldagents.evaluation.episodes import run_episodes
from fieldagents.progress import Report
from fieldagents.seeds import TEST_SEEDS
from fieldagents.task import get_task
from fieldagents.tasks.pose_reaching.agents import memory_driver, nine_paths
from fieldagents.tasks.pose_reaching.drives import RecordedDrives
from fieldagents.tasks.pose_reaching.path_memory.matrices import (
    BEARING,
    DISTANCE,
    EXAMPLE_ANGLE,
    EXAMPLE_DISTANCE,
    FULL_TURN,
    combined,
    lambdas,
    membership,
)
from fieldagents.tasks.pose_reaching.path_memory.memory import PathMemory
from fieldagents.tasks.pose_reaching.path_memory.reading import AS_IT_WORKS, Reading, rounded_speed
from fieldagents.tasks.pose_reaching.path_memory.teachers import starts_facing
from fieldgym.pose_reaching import PoseReachingEnv, PoseReachingSettings
from fieldmodels.machines.pose_reaching.parameters import GOAL_HEADING, STRICT, Limits
from papers.pose_reaching.pilot import drive_by_keys
from papers.source import Reproduction, reproduces
from papers.statistics import exact, mean_of, share_of

SOURCE = "A. I. Chaudhry, Topics in robot locomotion, Cornell University 2015, chapter 5, "
SETTINGS = PoseReachingSettings()
Episodes = Annotated[int, Bounded(ge=20, le=10_000)]

STATES = np.array(
    [
        [3.2, -1, -1, 2, -1], [2.4, -0.62, -0.88, 0.9, -0.86], [1.1, -0.1, -0.57, 0.2, -0.58],
        [3.6, 0.5, 0, 2.6, 0], [2.1, 0.2, -0.33, 1.7, -0.34], [0.8, 0, -0.49, 0.3, -0.48],
        [2.9, -0.77, 0.1, 2.2, 0.1], [1.5, -0.3, -0.43, 1.3, -0.42], [0.2, 0, -0.5, 0.4, -0.49],
    ]
) * [1, math.pi, math.pi, 1, math.pi]  # fmt: skip
"""The nine states of section 5.2.2: d, theta, psi, v, omega."""
ROUNDED_SPEEDS = [2, 1, 0, 3, 2, 0, 2, 1, 0]
LAMBDA_D = [0.45, 0.2, 0, 0.3, 0.2, 0, 0.45, 0.2, 0]
LAMBDA_THETA = [0, 0, 0, 0.3, 0.2, 0.1, 0.4, 0.3, 0.1]
LAMBDA_PSI = [0, 0, 0, 0.3, 0.1, 0.1, 0.5, 0.2, 0.1]
PRODUCT = [0, 0, 0, 0.027, 0.004, 0, 0.09, 0.012, 0]


def _angle(angles: Any) -> Any:
    return np.abs((np.asarray(angles) + math.pi) % FULL_TURN - math.pi)


@reproduces("worked-example", processor_s=(0.02, 0.02))
def worked_example(_progress: Report) -> Reproduction:
    """The path memory's worked example (sections 5.2.2 to 5.2.4)."""
    d, theta, psi, v, omega = STATES.T
    matrix = membership(EXAMPLE_DISTANCE.nearest(d), EXAMPLE_DISTANCE)
    (lambda_d,) = lambdas([matrix], [3.2], [EXAMPLE_DISTANCE])
    product = combined([lambda_d, LAMBDA_THETA, LAMBDA_PSI])
    angles = membership(EXAMPLE_ANGLE.nearest(theta), EXAMPLE_ANGLE)
    circle = np.linspace(-math.pi, math.pi, 2001)[:-1]
    off = [np.abs(lambdas([angles], [one], [EXAMPLE_ANGLE])[0] - LAMBDA_THETA).max() for one in circle]
    numbers = {
        "lambda_d and the product: largest difference from the print": max(
            float(np.abs(lambda_d - LAMBDA_D).max()), float(np.abs(product - PRODUCT).max())
        ),
        "number of the winner": float(np.argmax(product) + 1),
        "lambda_theta: least largest difference from the print over all theta": float(min(off)),
        "states with psi = theta - psi_f": float((_angle(theta - GOAL_HEADING - psi) < 1e-9).sum()),
        "states with omega = psi within 0.2 pi / 10": float((_angle(omega - psi) < 0.0201 * math.pi).sum()),
        "speeds rounded to the nearest of their grid": float(
            (rounded_speed(v, "grid") == ROUNDED_SPEEDS).sum()
        ),
        "values of d": float(DISTANCE.count),
        "values of theta": float(BEARING.count),
        "remembered states": float(len(nine_paths("graceful", SETTINGS))),
    }
    return Reproduction(
        SOURCE + "sections 5.2.2 to 5.3.2",
        pd.DataFrame({"number": list(numbers), "ours": list(numbers.values())}),
        statistics={name: exact(value) for name, value in numbers.items()},
    )


@reproduces("crossing", processor_s=(0.2, 0.2))
def crossing(_progress: Report, *, poses: Episodes = 2000) -> Reproduction:
    """Which state is chosen where paths cross."""
    rng = np.random.default_rng(10_000)
    places = rng.uniform((0.1, -1.4, -math.pi), (2.4, 1.4, math.pi), (poses, 3))
    turned = places + np.array([0, 0, math.pi / 2])
    states, statistics = nine_paths("graceful", SETTINGS), {}
    for name, reading in (("d and theta", AS_IT_WORKS), ("d, theta and psi", Reading(offset=True))):
        memory = PathMemory(states, reading)
        winners = [memory.commands(some, SETTINGS.tick)[1] for some in (places, turned)]
        statistics[f"share of places where the orientation decides: {name}"] = share_of(
            winners[0] != winners[1]
        )
    return Reproduction(
        SOURCE + "section 5.3.2",
        pd.DataFrame({"inputs": list(statistics), "share": [one.value for one in statistics.values()]}),
        statistics=statistics,
        remarks=("A robot at a random place, and one there that heads a right angle to the left.",),
    )


@reproduces("taught", quick={"episodes": 60}, processor_s=(0.3, 0.2))
def taught_by_a_human(
    progress: Report,
    *,
    paths: Annotated[int, Bounded(ge=1, le=50)] = 9,
    episodes: Episodes = 300,
) -> Reproduction:
    """Paths taught by a human operator (section 5.4)."""
    rows, statistics = [], {}
    with TemporaryDirectory() as folder:
        drives = RecordedDrives(Path(folder) / "drives.csv", {})
        env = PoseReachingEnv({"success": "loose", "timeout": 60.0})
        for number, start in enumerate(starts_facing(paths)):
            progress(f"drive {number + 1}", number / (paths + 3))
            drive_by_keys(env, drives, start)
        agent = drives.agent()
        kept = 0 if drives.recording is None else len(drives.recording.bounds)
        for starts in ("T1", "T2", "T3"):
            progress(f"left to itself, {starts}", (paths + int(starts[1]) - 1) / (paths + 3))
            table = _played(agent, episodes, starts=starts)
            statistics[f"arrivals, {starts}"] = share_of(table["success"])
            rows.append(_row(starts, table) | {"drives": kept})
    return Reproduction(
        SOURCE + "section 5.4",
        pd.DataFrame(rows),
        statistics=statistics,
        remarks=(f"{kept} drives; {episodes} test episodes each, strict.",),
    )


@reproduces("omnidirectional", quick={"episodes": 60}, processor_s=(0.2, 0.1))
def omnidirectional(progress: Report, *, episodes: Episodes = 300) -> Reproduction:
    """The omnidirectional robot (section 5.3.2)."""
    env = PoseReachingEnv()
    starts = np.array([env.reset(seed=seed)[1]["pose"] for seed in TEST_SEEDS[:episodes]])
    limits, distance = Limits(), np.hypot(starts[:, 0], starts[:, 1])
    turn = _angle(starts[:, 2] - GOAL_HEADING)
    least = np.maximum(
        np.maximum(distance - STRICT.distance, 0.0) / limits.max_speed,
        np.maximum(turn - STRICT.angle, 0.0) / limits.max_rate,
    )
    rows, statistics = [], {}
    cases = [(drive, name) for drive in ("unicycle", "omnidirectional") for name in ("path_memory", "direct")]
    cases.insert(3, ("omnidirectional", "path_memory_straight"))
    for done, (drive, name) in enumerate(cases):
        progress(f"{drive}: {name}", done / len(cases))
        settings = {"drive": drive, "starts": "T3"}
        agent = get_task("pose_reaching").agents[name].make(settings)
        table = _played(agent, episodes, **settings)
        arrived = table["success"] > 0
        rows.append(
            _row(drive, table) | {"agent": name, "above the least time [s]": (table["time"] - least).mean()}
        )
        statistics[f"arrivals, {drive}, {name}"] = share_of(table["success"])
        way = (table["length_ratio"] * table["dubins_length"])[arrived]
        straight = np.maximum(distance - STRICT.distance, 1e-9)[arrived]
        statistics[f"way over the straight line, {drive}, {name}"] = mean_of((way / straight)[straight > 0.3])
        statistics[f"time above the least [s], {drive}, {name}"] = mean_of((table["time"] - least)[arrived])
    return Reproduction(
        SOURCE + "section 5.3.2",
        pd.DataFrame(rows),
        statistics=statistics,
        remarks=(
            f"{episodes} test episodes from anywhere, strict. Least: distance over speed or turn over turn "
            "rate, whichever is longer, up to the edge of the goal.",
        ),
    )


@reproduces("smoothness", quick={"episodes": 40}, processor_s=(1.6, 0.4))
def smoothness(
    progress: Report,
    *,
    few: Annotated[int, Bounded(ge=2, le=200)] = 5,
    many: Annotated[int, Bounded(ge=2, le=200)] = 45,
    episodes: Episodes = 200,
) -> Reproduction:
    """Bumps against the number of training paths."""
    bumps = {}
    for done, count in enumerate((few, many)):
        progress(f"{count} paths", done / 2)
        memory = PathMemory(nine_paths("graceful", SETTINGS, count))
        bumps[count] = np.array([_bump(memory, seed) for seed in TEST_SEEDS[:episodes]])
    both = np.isfinite(bumps[few]) & np.isfinite(bumps[many])
    ratio = bumps[many][both] / bumps[few][both]
    return Reproduction(
        SOURCE + "section 5.3.2",
        pd.DataFrame(
            {"paths": [few, many], "mean bump [deg]": [np.degrees(np.nanmean(bumps[c])) for c in (few, many)]}
        ),
        statistics={
            "share of drives that are smoother with more paths": share_of(ratio < 1.0),
            "bump with more paths over that with few": mean_of(ratio),
        },
        remarks=(
            "A bump: the root mean square change of a tick's turn from one tick to the next, from T1 starts.",
        ),
    )


def _bump(memory: PathMemory, seed: int) -> float:
    """Roughness of one drive [rad]; NaN if it is over at once."""
    env = PoseReachingEnv({"starts": "T1"})
    agent = memory_driver(SETTINGS, memory)
    observation, info = env.reset(seed=seed)
    headings, over = [float(info["pose"][2])], False
    while not over:
        observation, _, arrived, late, info = env.step(agent.act(observation[None], {})[0])
        headings.append(float(info["pose"][2]))
        over = arrived or late
    turns = np.diff(np.unwrap(headings))
    return float(np.sqrt(np.mean(np.diff(turns) ** 2))) if len(turns) > 2 else math.nan


def _played(agent: Agent, episodes: int, **settings: Any) -> pd.DataFrame:
    return run_episodes(agent, "pose_reaching", EnvironmentConfig(settings=settings), TEST_SEEDS[:episodes])


def _row(name: str, table: pd.DataFrame) -> dict[str, Any]:
    return {
        "case": name,
        "success [%]": 100 * table["success"].mean(),
        "time [s]": table["time"].mean(),
        "time over Dubins": table["time_ratio"].mean(),
    }


EXTENSIONS = (worked_example, crossing, smoothness, taught_by_a_human, omnidirectional)
