"""Equations (4) to (16), the comparison with the condition number, and section VI's weightings.

Source: V. A. Sujan and S. Dubowsky, "An optimal information method for mobile manipulator dynamic parameter
identification", IEEE/ASME Trans. Mechatronics 8(2), 2003. What is compared with the printed equations is
written out here once more.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import Field
from scipy.stats import norm, spearmanr

from fieldagents.progress import Report
from fieldagents.seeds import TUNING_SEEDS
from fieldagents.task import get_task
from fieldgym.excitation import ExcitationSettings, ExcitationVectorEnv
from fieldmodels.information import BITS
from fieldmodels.machines.excitation.adjustment import cost, frozen_residuals, printed_residuals
from fieldmodels.machines.excitation.dynamics import simulate
from fieldmodels.machines.excitation.motion import arm_motion
from fieldmodels.machines.excitation.parameters import PRIOR_VARIANCE, SAMPLE, TABLE1, Arm
from fieldmodels.machines.excitation.regression import regressor
from papers.claim import Statistic
from papers.excitation.course import SOURCE, Episodes, play
from papers.source import Reproduction, reproduces
from papers.statistics import exact, ratio_of

Floats = NDArray[np.float64]
POLICIES, DECISIONS = 48, 25


@reproduces("equations", processor_s=(1, 1))
def equations(_progress: Report) -> Reproduction:
    """Equations (4), (9) to (16)."""
    commands = np.array([[2 * np.pi / 9, np.pi / 2, np.pi / 4]] * DECISIONS)
    moved, _ = arm_motion(commands, 25.0, start=(np.pi / 4, 0.0, 0.0), per_decision=320)
    signals = simulate(TABLE1, moved, Arm().row(), SAMPLE)[0]
    a, f = regressor(signals.transpose(1, 0, 2))
    a, f = a.reshape(-1, a.shape[-2], 22)[: f.size // a.shape[-2]], f.reshape(-1, a.shape[-2])
    size = np.sqrt(PRIOR_VARIANCE)
    noisy = f + np.random.default_rng(0).normal(0, 0.01 * np.abs(f).max(), f.shape)
    scaled = a * size
    inverse = np.linalg.lstsq(scaled.reshape(-1, 22), noisy.ravel(), rcond=None)[0]
    share = np.linspace(0, 1, 1001)[:, None]
    half = np.array([0.5 * BITS])
    information = {signs: _information(signs) for signs in (1, -1)}
    statistics = {
        "A x - F over the largest F": exact(float(np.abs(a @ TABLE1 - f).max() / np.abs(f).max())),
        "rank of A": exact(float(np.linalg.matrix_rank(scaled.reshape(-1, 22)))),
        "Kalman filter less pseudo-inverse, over the prior's deviations": exact(
            float(np.abs(_kalman(scaled, noisy) - inverse).max())
        ),
        "information of an estimate known to 1 %, (15) as printed [bits]": exact(information[1]),
        "information of an estimate known to 1 %, (15) with minus signs [bits]": exact(information[-1]),
        "information of an exact estimate [bits]": exact(_information(-1, 1e-9)),
        "In / In max at which the cost is least, (16) as printed": exact(
            float(share[cost(printed_residuals(BITS * share)).argmin(), 0])
        ),
        "In / In max at which the cost is least, weights of the current estimate": exact(
            float(share[cost(frozen_residuals(BITS * share, half)).argmin(), 0])
        ),
    }
    table = pd.DataFrame({"what": list(statistics), "ours": [one.value for one in statistics.values()]})
    return Reproduction(
        SOURCE + "sections III to VI: the constant excitation (24) on Table I's vehicle",
        table,
        statistics=statistics,
    )


def _kalman(a: Floats, f: Floats) -> Floats:
    """Fig 5 with constant unknowns: one update for each set of measurements, from hardly any prior."""
    mean, covariance = np.zeros(22), 1e8 * np.eye(22)
    for rows, measured in zip(a, f, strict=True):
        innovation = np.linalg.solve(rows @ covariance @ rows.T + np.eye(len(rows)), rows @ covariance)
        mean = mean + innovation.T @ (measured - rows @ mean)
        covariance = covariance - covariance @ rows.T @ innovation
        covariance = 0.5 * (covariance + covariance.T)
    return mean


def _information(sign: int, sigma: float = 0.01) -> float:
    """In = H(x) - H(x|y) [bits] of a 10-bit sensor on [0, 1], (11) and (15), with a sign before the sums."""
    count = 2**BITS
    middle = 0.5 + 0.5 / count
    inside = np.diff(norm.cdf(np.linspace(0, 1, count + 1), middle, sigma))
    q = inside[inside > 0] / inside.sum()
    return float(sign * (-np.log2(count)) - sign * (q * np.log2(q)).sum())


@reproduces("condition-number", quick={"episodes": 60}, processor_s=(75, 24))
def condition_number(
    progress: Report,
    *,
    episodes: Episodes = 200,
    limits: Literal["paper", "wide"] = "paper",
) -> Reproduction:
    """Convergence under information and under the condition number."""
    settings = ExcitationSettings(limits=limits)
    courses = {}
    for i, name in enumerate(("condition_number", "frozen_weight")):
        progress(name, i / 2)
        agent = get_task("excitation").agents[name].make({"limits": limits})
        courses[name] = play(agent, settings, TABLE1.copy(), episodes).average(slice(None))
    condition, weighted = courses.values()
    level = 2 * float(np.median(condition[-1]))
    first = {name: 1.0 + (found > level).cumprod(axis=0).sum(axis=0) for name, found in courses.items()}
    table = pd.DataFrame(
        {
            "agent": list(courses),
            f"decisions until the error is below {level:.1f} %": [one.mean() for one in first.values()],
            "error at the end [%]": [one[-1].mean() for one in courses.values()],
        }
    )
    return Reproduction(
        SOURCE + f"section VII-A, limits {limits}, {episodes} runs",
        table,
        statistics={
            "decisions by the condition number over those by information": ratio_of(*first.values()),
            "error by the condition number over that by information": ratio_of(condition[-1], weighted[-1]),
        },
    )


@reproduces("weightings", quick={"seeds": 12}, processor_s=(48, 24))
def weightings(
    progress: Report,
    *,
    limits: Literal["paper", "wide"] = "paper",
    kind: Literal["various", "alike"] = "various",
    seeds: Annotated[int, Field(ge=4, le=1000)] = 24,
) -> Reproduction:
    """Which reward ranks motions by their error.

    Policies look at nothing. The various ones hold a command for the episode or for five decisions; those
    that are alike draw a new one at every decision.
    """
    rng = np.random.default_rng(1)
    held = [1 if kind == "alike" else DECISIONS if i % 2 else 5 for i in range(POLICIES)]
    actions = np.array([np.repeat(rng.uniform(-1, 1, (DECISIONS // n, 3)), n, axis=0) for n in held])
    rewards: dict[str, dict[str, Any]] = {
        "bits": {},
        "bits of the inertia": {"weights": (0.0, 1.0, 0.0, 0.0, 0.0)},
        "relative error": {"reward": "relative_error"},
    }
    rows, statistics = [], {}
    for i, (name, chosen) in enumerate(rewards.items()):
        progress(name, i / len(rewards))
        gained, error = _played(actions, seeds, {"limits": limits, **chosen})
        found = _rank_correlation(gained.mean(axis=1), error.mean(axis=1))
        itself = float(spearmanr(error[:, ::2].mean(axis=1), error[:, 1::2].mean(axis=1)).statistic)
        rows.append({"reward": name, "rank correlation": str(found), "error with itself": itself})
        statistics[f"rank correlation of return and error, {name}"] = found
    return Reproduction(
        SOURCE + f"section VI; limits {limits}, {POLICIES} policies ({kind}) on {seeds} seeds each",
        pd.DataFrame(rows),
        remarks=(
            "Error with itself: rank correlation between the two halves of the seeds. Where it is near 0 "
            "there is little to rank.",
        ),
        statistics=statistics,
    )


def _played(actions: Floats, seeds: int, settings: dict[str, Any]) -> tuple[Floats, Floats]:
    """Return and final error [%] of each policy on each seed, shape (policies, seeds)."""
    envs = ExcitationVectorEnv(num_envs=POLICIES * seeds, settings=settings)
    envs.reset(seed=[*TUNING_SEEDS[:seeds]] * POLICIES)
    total = np.zeros(POLICIES * seeds)
    for k in range(DECISIONS):
        _, reward, _, _, info = envs.step(np.repeat(actions[:, k], seeds, axis=0).astype(np.float32))
        total += reward
    return total.reshape(POLICIES, seeds), np.asarray(info["error_percent"]).reshape(POLICIES, seeds)


def _rank_correlation(a: Floats, b: Floats) -> Statistic:
    """Spearman's, with a bootstrap interval over the policies."""
    rng = np.random.default_rng(2)
    drawn = [rng.integers(0, len(a), len(a)) for _ in range(2000)]
    low, high = np.quantile([spearmanr(a[i], b[i]).statistic for i in drawn], (0.025, 0.975))
    return Statistic(float(spearmanr(a, b).statistic), float(low), float(high))


EQUATIONS = (equations, condition_number, weightings)
"""In the order of presentation."""
