"""Figures of the path memory's source, redone, and what its text leaves open, measured.

Source: A. I. Chaudhry, "Topics in robot locomotion", Cornell University 2015, chapter 5.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import pandas as pd
from pydantic import Field as Bounded

from fieldagents.agent import Agent
from fieldagents.config import EnvironmentConfig
from fieldagents.evaluation.comparison import mean_interval
from fieldagents.evaluation.episodes import run_episodes
from fieldagents.progress import Report
from fieldagents.seeds import TEST_SEEDS
from fieldagents.tasks.pose_reaching.agents import POINTS, SEED, Driver, nine_paths, table_driver
from fieldagents.tasks.pose_reaching.path_memory.least_time import LeastTime, Resolution, Task
from fieldagents.tasks.pose_reaching.path_memory.matrices import EXAMPLE_ANGLE, Floats, Integers
from fieldagents.tasks.pose_reaching.path_memory.memory import PathMemory, States
from fieldagents.tasks.pose_reaching.path_memory.practice import own_data, to_action
from fieldagents.tasks.pose_reaching.path_memory.reading import AS_IT_WORKS, AS_PRINTED, Reading
from fieldagents.tasks.pose_reaching.path_memory.regression import NeighbourMemory
from fieldagents.tasks.pose_reaching.path_memory.teachers import (
    Teacher,
    starts_anywhere,
    starts_facing,
    taught,
)
from fieldgym.pose_reaching import PoseReachingEnv, PoseReachingSettings
from fieldmodels.html import AFTER, AMBER, BEFORE, GREY, LINE
from fieldmodels.machines.pose_reaching.parameters import STRICT, Field
from papers.pose_reaching.extensions import EXTENSIONS
from papers.source import Reproduction, reproduces
from papers.statistics import exact, mean_of, share_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SOURCE = "A. I. Chaudhry, Topics in robot locomotion, Cornell University 2015, chapter 5, "
SETTINGS = PoseReachingSettings()
BLUE, RED = AFTER, BEFORE
FAULTY = {"yaw_slip": {"share": 0.3}, "actuator_delay": {"delay": 0.1}}
"""A robot that turns 30 % too little, a tick late."""
Episodes = Annotated[int, Bounded(ge=20, le=10_000)]
Count = Annotated[int, Bounded(ge=1, le=100)]

MERGED = 0.4
"""Distance from the ball within which all training paths run together [m]."""

SAMPLES = {
    "5.4": ((0.09, -1.3), "starts below the ball, a little off a path; straight up, corrected near the ball"),
    "5.5": ((1.12, -0.75), "switches from one path to another and back"),
    "5.6": ((1.45, 0.28), "switches between two paths"),
    "5.7": ((0.9, 0.98), "switches between two paths"),
    "5.8": ((0.04, 1.38), "starts near the top path, stays with it, very smooth"),
}
"""Start [m] and what the source says of each figure."""


@dataclass(frozen=True)
class Drive:
    """One drive of a path memory.

    Attributes:
        poses: x [m], y [m], heading [rad], shape (n + 1, 3).
        paths: The path that each tick's winner is from, shape (n,).
        arrived: Whether it reached the goal.
    """

    poses: Floats
    paths: Integers
    arrived: bool

    @property
    def away_paths(self) -> Integers:
        """The paths of the winners farther than 0.4 m from the ball."""
        return np.asarray(self.paths[np.hypot(*self.poses[:-1, :2].T) > MERGED])

    @property
    def switches(self) -> int:
        """How often, farther than 0.4 m from the ball, the winner came from another path than before."""
        return int((np.diff(self.away_paths) != 0).sum())


@reproduces("figure-5.9", processor_s=(1.6, 1.6))
def figures_5_3_to_5_9(
    progress: Report,
    *,
    paths: Count = 9,
    teacher: Teacher = "graceful",
) -> Reproduction:
    """Training paths and generated paths of the path memory (Figs 5.3 to 5.9)."""
    states = nine_paths(teacher, SETTINGS, paths)
    memory = PathMemory(states)
    figures, rows, drives = {}, [], []
    for done, (number, (start, said)) in enumerate(SAMPLES.items()):
        progress(f"figure {number}", done / len(SAMPLES))
        drive = _drive(memory, np.array([*start, math.atan2(-start[1], -start[0])]))
        drives.append(drive)
        rows.append(
            {
                "figure": number,
                "the source": said,
                "ours: arrived": "yes" if drive.arrived else "no",
                "time [s]": SETTINGS.tick * (len(drive.poses) - 1),
                "changes of path": drive.switches,
                "straight until [m from the ball]": _straight_until(drive) if number == "5.4" else np.nan,
            }
        )
        figure, axes = _field()
        _training(axes, states)
        _generated(axes, drive, states)
        axes.set_title(f"Fig {number}: {said}".replace("; ", "\n"), fontsize=9, loc="left")
        figures[f"figure-{number}"] = figure
    figure, axes = _field()
    _training(axes, states)
    axes.set_title(f"Fig 5.3: {paths} training paths, {len(states)} states", fontsize=9, loc="left")
    figures = {"figure-5.3": figure, **figures}
    figure, axes = _field()
    _training(axes, states)
    for drive in drives:
        axes.plot(*drive.poses[:, :2].T, color=RED, linewidth=1.2)
    axes.set_title("Fig 5.9: training paths in blue, generated paths in orange", fontsize=9, loc="left")
    figures["figure-5.9"] = figure
    changes = [drive.switches for drive in drives]
    same = [float(np.mean(drive.away_paths == drive.paths[0])) for drive in drives]
    straight = rows[0]["straight until [m from the ball]"]
    return Reproduction(
        SOURCE + "Figs 5.3 to 5.9, described in section 5.3.2",
        pd.DataFrame(rows),
        figures,
        (
            "The source prints no numbers; compared is what its text says of each figure. The starts of 5.4 "
            "and 5.8 are as described, the others lie between two paths. Within 0.4 m of the ball all paths "
            "run together, and changes there are not counted.",
            f"Fig 5.4: the drive stays parallel to the path below until {straight:.2f} m from the ball, "
            "where another path becomes the closer one.",
            f"Figs 5.5 to 5.7: the path changes {', '.join(map(str, changes[1:4]))} times on the way, each "
            f"time with a bump. Fig 5.8: {changes[4]} times.",
        ),
        {
            "states": exact(len(states)),
            "drives that arrive": exact(sum(drive.arrived for drive in drives)),
            "Fig 5.4: straight until, over the starting distance": exact(
                straight / np.hypot(*SAMPLES["5.4"][0])
            ),
            **{f"Fig {n}: changes of path": exact(c) for n, c in zip(SAMPLES, changes, strict=True)},
            **{
                f"Fig {n}: share of its way on its first path": exact(s)
                for n, s in zip(SAMPLES, same, strict=True)
            },
        },
    )


@reproduces("rules", quick={"episodes": 60}, processor_s=(23, 7))
def rules(
    progress: Report,
    *,
    episodes: Episodes = 300,
) -> Reproduction:
    """The path memory with one rule changed at a time."""
    readings: dict[str, Reading] = {
        "as it works": AS_IT_WORKS,
        "to the letter": AS_PRINTED,
        "to the letter, speeds exact, nearest": replace(AS_PRINTED, speed="exact", fallback="nearest"),
        "bearing, but omega a rate": replace(AS_IT_WORKS, command="rate"),
        "direction, but theta the heading": replace(AS_IT_WORKS, theta="heading", angle=EXAMPLE_ANGLE),
        "with psi as a third input": replace(AS_IT_WORKS, offset=True),
        "stop where all lambda are zero": replace(AS_IT_WORKS, fallback="stop"),
        "first row where all lambda are zero": replace(AS_IT_WORKS, fallback="first"),
        "no mirror": replace(AS_IT_WORKS, mirror=False),
        "no wrap": replace(AS_IT_WORKS, wrap=False),
        "no clamp": replace(AS_IT_WORKS, clamp=False),
        "no clamp, stop": replace(AS_IT_WORKS, clamp=False, fallback="stop"),
        "last of equals": replace(AS_IT_WORKS, ties="last"),
        "speeds to 0.5": replace(AS_IT_WORKS, speed="grid"),
        "speeds to integers": replace(AS_IT_WORKS, speed="integers"),
    }
    teachers: tuple[Teacher, ...] = ("graceful", "dubins")
    rows: list[dict[str, Any]] = []
    statistics = {}
    total = len(readings) * len(teachers)
    for teacher in teachers:
        memories = {name: PathMemory(nine_paths(teacher, SETTINGS), one) for name, one in readings.items()}
        for name, memory in memories.items():
            progress(f"{teacher}: {name}", len(rows) / total)
            row: dict[str, Any] = {"teacher": teacher, "rule": name}
            for starts in ("T1", "T2", "T3"):
                result = _played(_agent(memory), episodes, starts)
                row[f"success on {starts} [%]"] = _share(result["success"])
                statistics[f"arrivals, {starts}, {teacher}, {name}"] = share_of(result["success"])
                row[f"time over Dubins, {starts}"] = float(result["time_ratio"].mean())
            rows.append(row)
    return Reproduction(
        SOURCE + "sections 5.1.4 to 5.3.2",
        pd.DataFrame(rows),
        remarks=(
            f"{episodes} test episodes each, the same for all; 95 % intervals in brackets.",
            "The text contradicts itself about what theta and omega are; bearing and direction are the only "
            "pair that works.",
        ),
        statistics=statistics,
    )


@reproduces("paths", quick={"seeds": 2, "episodes": 60, "most": 15}, processor_s=(87, 6))
def number_of_paths(
    progress: Report,
    *,
    seeds: Count = 8,
    episodes: Episodes = 200,
    most: Annotated[int, Bounded(ge=3, le=200)] = 200,
) -> Reproduction:
    """Success against the number of training paths."""
    from matplotlib.figure import Figure

    rows = []
    cases = list(_path_cases(seeds, most))
    for done, (memory_name, count, seed, agent) in enumerate(cases):
        progress(f"{memory_name}, {count} paths", done / len(cases))
        result = _played(agent, episodes)
        rows.append(
            {
                "memory": memory_name,
                "paths": count,
                "seed": seed,
                "success": result["success"].mean(),
                "ratio": result["time_ratio"].mean(),
            }
        )
    runs = pd.DataFrame(rows)
    grouped = runs.groupby(["memory", "paths"], sort=False)
    table = grouped.agg(
        **{
            "sets of paths": ("seed", "size"),
            "success [%]": ("success", lambda x: 100 * x.mean()),
            "least [%]": ("success", lambda x: 100 * x.min()),
            "most [%]": ("success", lambda x: 100 * x.max()),
            "time over Dubins": ("ratio", "mean"),
        }
    ).reset_index()
    figure = Figure(figsize=(8, 4.5))
    axes = figure.subplots()
    for name, part in table.groupby("memory", sort=False):
        (line,) = axes.plot(part["paths"], part["success [%]"], "o-", markersize=3, label=str(name))
        axes.fill_between(
            part["paths"], part["least [%]"], part["most [%]"], color=line.get_color(), alpha=0.12
        )
    axes.set_xscale("log")
    axes.set_xlabel("training paths (14 states each)")
    axes.set_ylabel("arrived from anywhere [%]")
    axes.grid(color=LINE, linewidth=0.8)
    axes.legend(fontsize=8)
    figure.tight_layout()
    return Reproduction(
        SOURCE
        + 'section 5.3.2: "increasing the number of training paths ... would allow for smoother paths"',
        table,
        {"paths": figure},
        (
            f"{seeds} sets of random training starts a point, {episodes} test episodes each, T3, strict; "
            "shaded: least and most of the sets.",
            "Facing: starts on the right half, facing the ball. Mixed: anywhere, any heading.",
        ),
    )


@reproduces("own-data", quick={"seeds": 1, "episodes": 60}, processor_s=(17, 3))
def own_training_data(
    progress: Report,
    *,
    seeds: Count = 5,
    episodes: Episodes = 200,
) -> Reproduction:
    """The robot that makes its own training data (section 5.4)."""
    rows: list[dict[str, Any]] = []
    statistics = {}
    cases = [
        (robot, seconds, rounds)
        for robot in ("ideal", "faulty", "faulty, data of the ideal one")
        for seconds, rounds in ((15, 0), (30, 0), (60, 0), (150, 0), (300, 0), (600, 0), (300, 2), (300, 6))
    ]
    for done, (robot, seconds, rounds) in enumerate(cases):
        progress(f"{robot}: {seconds} s, {rounds} rounds", done / len(cases))
        reality = None if robot == "ideal" else FAULTY
        results = []
        for seed in range(seeds):
            learned_in = FAULTY if robot == "faulty" else None
            table = own_data(
                SETTINGS, learned_in, seconds=seconds, rounds=rounds, seed=SEED + 20_000 * (seed + 1)
            )
            results.append(_played(table_driver(SETTINGS, table), episodes, reality=reality))
        success = [100 * result["success"].mean() for result in results]
        every = pd.concat(results)
        case = f"{robot}, {seconds} s, {rounds} rounds"
        statistics[f"arrivals, {case}"] = share_of(every["success"])
        statistics[f"time over Dubins, {case}"] = mean_of(every["time_ratio"].dropna())
        rows.append(
            {
                "robot": robot,
                "babble [s]": seconds,
                "rounds of practice": rounds,
                "robot time [s]": seconds * (1 + rounds),
                "success [%]": float(np.mean(success)),
                "least of the seeds [%]": min(success),
                "time over Dubins": float(np.mean([result["time_ratio"].mean() for result in results])),
            }
        )
    for robot, name in (("ideal", "path_memory"), ("faulty", "path_memory")):
        memory = PathMemory(nine_paths("graceful", SETTINGS))
        result = _played(_agent(memory), episodes, reality=None if robot == "ideal" else FAULTY)
        rows.append(
            {
                "robot": f"{robot}: {name}, taught",
                "success [%]": 100 * result["success"].mean(),
                "time over Dubins": result["time_ratio"].mean(),
            }
        )
    return Reproduction(
        SOURCE + "section 5.4, future work",
        pd.DataFrame(rows),
        remarks=(
            f"{seeds} training seeds, {episodes} test episodes each, T3, strict, walls in force.",
            "Faulty: turns 30 % too little (yaw slip) and hears commands 0.1 s late.",
        ),
        statistics=statistics,
    )


@reproduces("ceiling", quick={"episodes": 60, "finest": 2}, processor_s=(50, 11))
def ceiling(
    progress: Report,
    *,
    episodes: Episodes = 500,
    finest: Annotated[int, Bounded(ge=2, le=4)] = 3,
) -> Reproduction:
    """How near the ceiling is to the least time possible."""
    rows: list[dict[str, Any]] = []
    starts = _starts(episodes)
    for fine in range(1, finest + 1):
        progress(f"grid {fine}", (fine - 1) / finest)
        grid = Resolution(shells=31 * fine + 1, bearings=18 * fine + 1, sights=36 * fine)
        solved = LeastTime(Task(STRICT), grid)
        result = _played(_least_time_agent(solved), episodes)
        rows.append(
            {
                "grid": f"{grid.shells} x {grid.bearings} x {grid.sights}",
                "width": 1 / fine,
                "least time by the grid, mean [s]": float(solved.from_poses(starts).mean()),
                "time driven, mean of arrivals [s]": float(result["time"].mean()),
                "success [%]": 100 * float(result["success"].mean()),
            }
        )
    table = pd.DataFrame(rows)
    slope, limit = np.polyfit(table["width"], table["least time by the grid, mean [s]"], 1)
    off = slope * table["width"] + limit - table["least time by the grid, mean [s]"]
    usual = LeastTime(Task(STRICT))
    driven = float(_played(_least_time_agent(usual), episodes)["time"].mean())
    shape = " x ".join(map(str, usual.times.shape))
    return Reproduction(
        "no source: value iteration on grids of falling width",
        table,
        remarks=(
            f"The grid's least time falls in proportion to its width (largest misfit {off.abs().max():.3f} "
            f"s); extrapolated to zero it is {limit:.3f} s.",
            f"The agent least_time (grid {shape}, tick {SETTINGS.tick} s) drives {driven:.3f} s: "
            f"{100 * (driven / limit - 1):.1f} % above that limit.",
            "On fine grids some drives overshoot the goal: they plan finer than a tick of 0.1 s is.",
        ),
    )


def _least_time_agent(solved: LeastTime) -> Agent:
    return Driver(SETTINGS, lambda poses: (solved.commands(poses, SETTINGS.tick), None))


def _agent(memory: PathMemory | NeighbourMemory) -> Agent:
    if isinstance(memory, NeighbourMemory):
        return Driver(SETTINGS, memory.commands)
    return Driver(SETTINGS, lambda poses: memory.commands(poses, SETTINGS.tick))


def _path_cases(seeds: int, most: int) -> Iterator[tuple[str, int, int, Agent]]:
    """Memory, number of paths, seed and agent."""
    stop = replace(AS_IT_WORKS, fallback="stop")
    for count in (count for count in (3, 5, 7, 9, 15, 25, 50, 100, 200) if count <= most):
        for seed in range(seeds):
            rng = np.random.default_rng([SEED, seed])
            facing = _random_facing(count, rng)
            mixed = taught("dubins", starts_anywhere(count, rng), POINTS, SETTINGS.tick)
            for teacher, reading, name in (
                ("graceful", AS_IT_WORKS, "bearing memory, graceful, facing, nearest"),
                ("graceful", stop, "bearing memory, graceful, facing, stop"),
                ("dubins", AS_IT_WORKS, "bearing memory, Dubins, facing, nearest"),
            ):
                states = taught(teacher, facing, POINTS, SETTINGS.tick)  # type: ignore[arg-type]
                yield name, count, seed, _agent(PathMemory(states, reading))
            yield "bearing memory, Dubins, mixed, nearest", count, seed, _agent(PathMemory(mixed))
            yield "nearest neighbour, Dubins, mixed", count, seed, _agent(NeighbourMemory(mixed))


def _random_facing(count: int, rng: np.random.Generator) -> Floats:
    """Starts facing the ball at random places around it, as ``starts_facing`` has them evenly."""
    many = starts_facing(1001)
    return many[np.sort(rng.integers(0, len(many), count))]


def _played(
    agent: Agent, episodes: int, starts: str = "T3", reality: Mapping[str, Any] | None = None
) -> pd.DataFrame:
    environment = EnvironmentConfig(settings={"starts": starts}, reality=reality)
    return run_episodes(agent, "pose_reaching", environment, TEST_SEEDS[:episodes])


def _starts(episodes: int) -> Floats:
    """The poses in which the test episodes begin."""
    env = PoseReachingEnv()
    return np.array([env.reset(seed=seed)[1]["pose"] for seed in TEST_SEEDS[:episodes]])


def _share(success: pd.Series[float]) -> str:
    interval = mean_interval(success, 10, binary=True)
    mean = f"{100 * success.mean():.1f}"
    return mean if interval is None else f"{mean} [{100 * interval[0]:.1f}, {100 * interval[1]:.1f}]"


def _drive(memory: PathMemory, start: Floats) -> Drive:
    env = PoseReachingEnv(SETTINGS)
    _, info = env.reset(seed=0, options={"pose": start})
    poses, winners, over, arrived = [info["pose"]], [], False, False
    while not over:
        commands, winner = memory.commands(poses[-1][None], SETTINGS.tick)
        _, _, arrived, late, info = env.step(to_action(commands, SETTINGS)[0])
        poses.append(info["pose"])
        winners.append(memory.states.path[winner[0]])
        over = arrived or late
    return Drive(np.array(poses), np.array(winners), bool(arrived))


def _straight_until(drive: Drive) -> float:
    """Distance from the ball at which a drive first leaves its starting column by 3 cm [m]."""
    left = np.abs(drive.poses[:, 0] - drive.poses[0, 0]) >= 0.03
    return float(np.hypot(*drive.poses[int(np.argmax(left)) if left.any() else -1, :2]))


def _field() -> tuple[Figure, Axes]:
    from matplotlib.figure import Figure
    from matplotlib.patches import Circle, Rectangle

    field = Field()
    figure = Figure(figsize=(6, 6))
    axes = figure.subplots()
    axes.add_patch(
        Rectangle((-field.length / 2, -field.width / 2), field.length, field.width, fill=False, color=GREY)
    )
    axes.add_patch(Circle((0, 0), STRICT.distance, color=AMBER))
    axes.set_aspect("equal")
    axes.set_xlim(-0.5, 2.0)
    axes.set_ylim(-1.6, 1.6)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    return figure, axes


def _training(axes: Axes, states: States) -> None:
    for path in states.paths:
        axes.plot(*path[:, :2].T, ".-", color=BLUE, linewidth=0.7, markersize=4, alpha=0.6)


def _generated(axes: Axes, drive: Drive, states: States) -> None:
    """The drive; dots in another colour where the winner comes from another path."""
    axes.plot(*drive.poses[:, :2].T, color=RED, linewidth=1.2)
    used = {path: i for i, path in enumerate(np.unique(drive.paths))}
    for path, i in used.items():
        poses = states.poses[states.path == path]
        axes.plot(*poses[:, :2].T, ".", color=f"C{i}", markersize=5)
        axes.plot(*drive.poses[:-1][drive.paths == path, :2].T, "o", color=f"C{i}", markersize=4)


FIGURES = (figures_5_3_to_5_9, *EXTENSIONS, rules, number_of_paths, own_training_data, ceiling)
"""In the order of presentation."""
