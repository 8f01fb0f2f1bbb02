"""Chapter 3's walks: the turn of 9 m, the exhibition's dark corner and low sun, the search for the law."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal

import gymnasium
import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import Field
from scipy.stats import spearmanr

from fieldagents.agent import visible
from fieldagents.evaluation.agents import make_agent
from fieldagents.progress import Report
from fieldagents.seeds import TEST_SEEDS
from fieldagents.tasks.line_following.search import RANGES, SETS, STEPS, random_search
from fieldgym import TASKS
from fieldgym.info import part
from fieldmodels.machines.line_following.body import Hardware
from fieldmodels.machines.line_following.parameters import TAPES, Noise
from fieldmodels.machines.line_following.tracks import RADIUS, oval
from papers.claim import Statistic
from papers.line_following.photographs import INK, MUTED, RED, SOURCE
from papers.source import Reproduction, reproduces
from papers.statistics import mean_of, share_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BETWEEN = Hardware.inner_width - TAPES["duvetyne"].width / 2.0
"""Distance from the line within which the tape lies between the inner feet [m]."""
CORNER = (14.0, 9.0, 1.5, 0.12)
SUN = (1.57, 2.0)


@dataclass(frozen=True)
class Walked:
    """Walks of one agent, stride by stride; what comes after a walk's end is NaN.

    Attributes:
        place: Distance from the line, left positive [m], shape (strides, walks).
        curvature: Of the line where the robot is [1/m].
        lost: 1 where the line is not seen.
        effort: Change of the turn [rad].
        failed: Whether each walk ended for leaving or losing the line, shape (walks,).
    """

    place: NDArray[np.float64]
    curvature: NDArray[np.float64]
    lost: NDArray[np.float64]
    effort: NDArray[np.float64]
    failed: NDArray[np.bool_]


def walk(agent: str, walks: int, **settings: Any) -> Walked:
    """Let a reference agent walk on the published test seeds."""
    envs: Any = gymnasium.make_vec(
        TASKS["line_following"].env_id,
        num_envs=walks,
        vectorization_mode="vector_entry_point",
        settings=settings,
    )
    one = make_agent(agent, "line_following", settings).runs[0]
    observation, info = envs.reset(seed=list(TEST_SEEDS[:walks]))
    one.reset(0)
    one.begin_episodes(np.ones(walks, dtype=np.bool_))
    going, failed = np.ones(walks, dtype=np.bool_), np.zeros(walks, dtype=np.bool_)
    kept: dict[str, list[NDArray[np.float64]]] = {}
    while going.any():
        action = one.act(observation, visible(info, one.sees, "line_following"))
        observation, _, terminated, truncated, info = envs.step(action)
        hidden = part(info, "privileged")
        now = {"place": hidden["offset"], "curvature": hidden["curvature"], "lost": info["lost"]}
        for name, values in {**now, "effort": info["effort"]}.items():
            kept.setdefault(name, []).append(np.where(going, values, np.nan))
        failed |= going & terminated
        going &= ~(terminated | truncated)
    return Walked(**{name: np.array(values) for name, values in kept.items()}, failed=failed)


def _traces(axes: Axes, walked: Walked, title: str) -> None:
    axes.plot(walked.place[:, :20] * 100.0, color=INK, linewidth=0.6)
    axes.axhspan(-100 * BETWEEN, 100 * BETWEEN, color=MUTED, alpha=0.2)
    axes.set_ylim(-60, 60)
    axes.set_title(title, loc="left", fontsize=10)
    axes.set_xlabel("stride")
    axes.set_ylabel("from the line [cm]")


@reproduces("figure-3.16", quick={"walks": 20}, processor_s=(5, 2))
def figure_3_16(
    progress: Report,
    *,
    walks: Annotated[int, Field(ge=10, le=10_000)] = 60,
    plant: Literal["kinematic", "pymunk"] = "kinematic",
) -> Reproduction:
    """Self steering along a curve of 9 m."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3.5))
    rows: list[dict[str, Any]] = []
    statistics: dict[str, Statistic] = {}
    for axes, agent in zip(figure.subplots(1, 2), ("printed", "tuned"), strict=True):
        progress(agent, len(rows) / 2)
        walked = walk(agent, walks, track="oval", plant=plant, friction=0.6)
        curved = np.abs(walked.curvature) > 0.5 / RADIUS
        inside = [
            np.mean(np.abs(place[where]) < BETWEEN)
            for place, where in zip(walked.place.T, curved.T, strict=True)
        ]
        statistics |= {
            f"strides in the curve with the line between the inner feet, {agent} [1]": mean_of(inside),
            f"walks that stay on the line, {agent} [1]": share_of(~walked.failed),
        }
        rows.append({"law (3.1)": agent, "between the inner feet [%]": 100 * np.mean(inside)})
        _traces(axes, walked, f"{agent} weights, curves of {RADIUS:g} m")
    figure.tight_layout()
    return Reproduction(
        SOURCE + "Fig 3.16 and section 3.6",
        pd.DataFrame(rows),
        {"figure-3.16": figure},
        (
            f"The tape lies between the inner feet within {1000 * BETWEEN:.0f} mm of the line, with feet "
            f"{2000 * Hardware.inner_width:.0f} mm apart (assumed). Grey in the picture; a walk begins up to "
            "200 mm beside the line.",
        ),
        statistics,
    )


@reproduces("figure-3.17", quick={"walks": 40, "laps": 1}, processor_s=(5, 3))
def figure_3_17(
    progress: Report,
    *,
    walks: Annotated[int, Field(ge=10, le=10_000)] = 60,
    laps: Annotated[int, Field(ge=1, le=20)] = 3,
) -> Reproduction:
    """The exhibition's track by its light: laps, dark corner, thicker tape, shadow."""
    from matplotlib.figure import Figure

    track = oval()
    lap = round(track.length / 0.7)
    cases: dict[str, dict[str, Any]] = {
        "well lit": {"strides": laps * lap},
        "dark corner, 2 inches": {"strides": lap, "dark_corner": CORNER},
        "dark corner, 4 inches": {"strides": lap, "dark_corner": CORNER, "tape": "duvetyne_wide"},
        "low sun": {"strides": lap, "sun": SUN},
    }
    figure = Figure(figsize=(11, 6))
    rows: list[dict[str, Any]] = []
    statistics: dict[str, Statistic] = {}
    for k, (axes, (case, settings)) in enumerate(
        zip(figure.subplots(2, 2).ravel(), cases.items(), strict=True)
    ):
        progress(case, k / len(cases))
        walked = walk("tuned", walks, track="oval", sight="image", **settings)
        ever = np.nansum(walked.lost, axis=0) > 0
        statistics |= {
            f"walks that lose sight of the line, {case} [1]": share_of(ever),
            f"walks without an operator, {case} [1]": share_of(~walked.failed),
        }
        rows.append(
            {
                "light": case,
                "lose sight [%]": 100 * ever.mean(),
                "would need the operator [%]": 100 * walked.failed.mean(),
            }
        )
        _traces(axes, walked, case)
        strides, which = np.nonzero(walked.lost[:, :20] > 0)
        axes.plot(strides, 100 * walked.place[:, :20][strides, which], ".", color=RED, markersize=4)
    figure.tight_layout()
    return Reproduction(
        SOURCE + "Fig 3.17 and section 3.6",
        pd.DataFrame(rows),
        {"figure-3.17": figure},
        (
            f"The law (3.1) on images: {laps} laps well lit, one in every other light. Red dots: the line is "
            "lost. Sizes and places of dark corner and shadow are assumed.",
        ),
        statistics,
    )


@reproduces("law", quick={"searches": 3}, processor_s=(4, 2))
def law(
    progress: Report,
    *,
    searches: Annotated[int, Field(ge=3, le=100)] = 8,
    walks: Annotated[int, Field(ge=10, le=1000)] = 40,
    noise: Annotated[float, Field(ge=0, le=2)] = 1.0,
) -> Reproduction:
    """The random search for the weights of the law (3.1); overshoot and effort."""
    from matplotlib.figure import Figure

    lower, upper = np.array(list(RANGES.values())).T
    rows, correlations = [], []
    figure = Figure(figsize=(5, 4))
    axes = figure.subplots()
    for k in range(searches):
        progress(f"search {k + 1}", k / searches)
        rng = np.random.default_rng([33, k])
        best = random_search(rng)
        sets = rng.uniform(lower, upper, (SETS, 3))
        far, effort, failed = _from_aside(sets, TEST_SEEDS[k], noise)
        held = ~failed
        correlations.append(float(spearmanr(far[held], effort[held]).statistic))
        settings = {"track": "oval", "strides": STEPS // 2}
        walked = _linear(np.array([best[entry] for entry in RANGES]), walks, settings)
        rows.append(
            {
                "search": k + 1,
                **dict(zip("abc", best.values(), strict=True)),
                "walks that stay [%]": 100 * (1 - walked.mean()),
                "overshoot and effort, rank correlation": correlations[-1],
            }
        )
    axes.scatter(100 * far[held], 1000 * effort[held], s=4, color=INK)
    axes.set_xlabel("overshoot from 0.3 m [cm]")
    axes.set_ylabel("mean change of the turn [mrad]")
    axes.set_xscale("symlog", linthresh=1)
    axes.set_yscale("log")
    figure.tight_layout()
    table = pd.DataFrame(rows)
    return Reproduction(
        SOURCE + "eq (3.1) and section 3.5.3",
        table,
        {"law": figure},
        (
            f"Each search draws {SETS} sets of weights and keeps the one that stays closest to the line for "
            f"{STEPS} steps; it is then walked on {walks} test seeds.",
            "Overshoot and effort are of as many other sets on a straight line, from 0.3 m beside it; sets "
            f"that lose the line are left out. Noise: {noise:g} times the task's.",
        ),
        {
            "walks of the best set that stay on the line [1]": mean_of(table["walks that stay [%]"] / 100),
            "rank correlation of overshoot and effort [1]": mean_of(correlations),
        },
    )


def _from_aside(
    sets: NDArray[np.float64], seed: int, noise: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Overshoot [m], mean change of the turn [rad] and failure of each set of weights, in the same noise."""
    noises = {name: noise * value for name, value in asdict(Noise()).items()}
    settings = {"track": "straight", "offset": 0.3, "sided": True, "strides": STEPS // 2, **noises}
    far, effort = np.zeros(len(sets)), np.zeros(len(sets))
    failed = np.zeros(len(sets), dtype=np.bool_)
    for info, terminated, going in _steps(sets, [seed] * len(sets), settings):
        far = np.where(going, info["overshoot"], far)
        effort += np.where(going, info["effort"], 0.0)
        failed |= going & terminated
    return far, effort / (STEPS // 2), failed


def _linear(weights: NDArray[np.float64], walks: int, settings: dict[str, Any]) -> NDArray[np.bool_]:
    """Which walks of one set of weights fail."""
    failed = np.zeros(walks, dtype=np.bool_)
    for _, terminated, going in _steps(np.tile(weights, (walks, 1)), list(TEST_SEEDS[:walks]), settings):
        failed |= going & terminated
    return failed


def _steps(sets: NDArray[np.float64], seeds: list[int], settings: dict[str, Any]) -> Iterator[Any]:
    """Walk with weights a, b, c in each row; gives info, what ended, and who was still walking."""
    envs: Any = gymnasium.make_vec(
        TASKS["line_following"].env_id,
        num_envs=len(sets),
        vectorization_mode="vector_entry_point",
        settings=settings,
    )
    observation, _ = envs.reset(seed=seeds)
    limit = float(envs.unwrapped.settings.limit)
    scale = np.array([0.3 / limit, 0.3 / limit, 1.0])
    going = np.ones(len(sets), dtype=np.bool_)
    while going.any():
        turns = np.einsum("ij,ij->i", observation[:, list(RANGES)], sets * scale)
        turns = np.where(observation[:, 8] > 0.5, observation[:, 4], turns)
        observation, _, terminated, truncated, info = envs.step(turns[:, None].clip(-1, 1).astype(np.float32))
        yield info, terminated, going.copy()
        going &= ~(terminated | truncated)
