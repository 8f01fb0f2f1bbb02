"""Tuning of the reference agents of heel strike, on tuning seeds alone.

``python -m fieldagents.tasks.heel_strike.search`` writes ``tuned.json`` anew (some minutes, one core).
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from gymnasium.utils.seeding import np_random
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from fieldagents.seeds import TUNING_SEEDS
from fieldagents.tasks.heel_strike.agents import RegimeFilter, oracle_row
from fieldgym.heel_strike import FEATURE_HIGH, FEATURE_LOW, GAIN_LOW, HeelStrikeSettings
from fieldmodels.drivers.named import apply_reality, stepped
from fieldmodels.extras import needed
from fieldmodels.files import write_text
from fieldmodels.machines.heel_strike.model import HeelStrikeModel
from fieldmodels.machines.heel_strike.search import Walks, record_walks, score_gains
from fieldmodels.machines.heel_strike.strides import CHANNELS

Floats = NDArray[np.float64]

WALKS = 40
"""Tuning walks of each kind of collision noise: the first seeds tune, as many later ones check."""

RESULT = Path(__file__).with_name("tuned.json")
"""What the reference agents read."""

PAPER_DECAYS = np.arange(33.0, 634.0, 50.0)  # section 2.6.1 and Fig 2.12: S_FD from 33 to 633
PAPER_RATIOS = np.linspace(0.0, 1.0, 21)  # section 2.5.3: S_MS from 0 to 1 by 0.05
PAPER_RESETS = np.linspace(0.0, 1.0, 11)  # section 2.6.1: S_HR from 0 to 1, by 0.1 (assumed)


def tune(settings: HeelStrikeSettings, log: Callable[[str], None] = lambda _: None) -> dict[str, Any]:
    """Tune every reference agent for one kind of environment.

    Args:
        settings: The environment's settings.
        log: Called with a line for each agent.

    Returns:
        Agent to its values, with the mean |error| [mm] on the walks that tuned it and on as many others.
    """
    walks, check = (recorded(settings, TUNING_SEEDS[first : first + WALKS]) for first in (0, 5000))
    found: dict[str, Any] = {}

    def keep(agent: str, score: Callable[[Walks], float], **values: Any) -> None:
        found[agent] = {
            **{key: np.round(value, 6).tolist() for key, value in values.items()},
            "tuned_mm": round(score(walks), 4),
            "checked_mm": round(score(check), 4),
        }
        log(f"{agent}: {found[agent]['tuned_mm']} mm, on other walks {found[agent]['checked_mm']} mm")

    share = _ranger_reset(walks)
    keep("ranger_tuned", lambda w: _ranger_error(w, share), reset=share)

    decay = settings.decay
    grid = np.array(
        [(ratio, ratio, reset, d) for ratio, reset, d in product(PAPER_RATIOS, PAPER_RESETS, PAPER_DECAYS)]
    )
    best = grid[np.argmin(score_gains(walks, grid))]
    # The action space holds S_FD fixed; the grid is searched with it, and its winner is reported.
    keep("paper_grid", lambda w: _score(w, best[:3], best[3]), gains=best[:3], decay=best[3])

    fixed = fixed_gains(walks, decay)
    keep("fixed_tuned", lambda w: _score(w, fixed, decay), gains=fixed)

    gated = gated_gains(walks, decay)
    keep("gated_tuned", lambda w: _score(w, gated, decay), gains=gated)

    weights, bias = linear_rule(walks, gated, decay)
    keep(
        "adaptive",
        lambda w: _linear_scores(w, weights[None], bias[None], decay)[0],
        weights=weights,
        bias=bias,
    )

    means, covariances = _clouds(walks)
    mixed = _regime_actions(walks, means, covariances, settings.dwell, gated, decay)
    keep(
        "regime_filter",
        lambda w: float(
            _mixed_scores(w, _regimes(w, means, covariances, settings.dwell), mixed[None], decay)[0]
        ),
        means=means,
        covariances=covariances,
        actions=mixed,
        dwell=settings.dwell,
    )

    table = _oracle(walks, gated, decay)
    keep("oracle_gains", lambda w: float(_table_scores(w, table[None], decay)[0]), table=table)
    return found


def recorded(settings: HeelStrikeSettings, seeds: range, reality: Any = None) -> Walks:
    """The very walks that the environment makes of these seeds.

    Args:
        settings: The environment's settings.
        seeds: One a walk.
        reality: The environment's reality.
    """
    rngs = [np_random(seed)[0] for seed in seeds]
    model = HeelStrikeModel(settings.leg)
    around, truth = apply_reality(model, reality, CHANNELS)
    own = truth.vector(around)[: len(model.names)]
    stock = stepped(around, truth, CHANNELS, 1, settings.leg.step)
    return record_walks(rngs, settings.strides, settings.leg, settings.walk.regimes, own, stock=stock)


def fixed_gains(walks: Walks, decay: float) -> Floats:
    """S_MS (the same early and late) and S_HR of least error on a logarithmic grid, shape (3,)."""
    ratios, resets = np.geomspace(0.001, 1, 49), np.geomspace(0.01, 1, 33)
    grid = np.array([(ratio, ratio, reset, decay) for ratio, reset in product(ratios, resets)])
    return np.asarray(grid[np.argmin(score_gains(walks, grid))][:3])


def gated_gains(walks: Walks, decay: float, evaluations: int = 1500) -> Floats:
    """S_MS early and late and S_HR of least error, by CMA-ES from the best of a coarse grid, shape (3,)."""
    coarse = np.geomspace(0.001, 1, 13)
    grid = np.array([(*gains, decay) for gains in product(coarse, coarse, np.geomspace(0.01, 1, 9))])
    start = grid[np.argmin(score_gains(walks, grid))][:3]
    return _gains(
        _cma(lambda x: score_gains(walks, _with_decay(_gains(x), decay)), _encode(start), evaluations)
    )


def _encode(gains: Floats) -> Floats:
    return np.asarray(2 * np.log(gains / GAIN_LOW) / np.log(1 / GAIN_LOW) - 1)


def _gains(action: Floats) -> Floats:
    """Gains of an action, as the environment decodes it, shape (..., 3)."""
    return np.asarray(GAIN_LOW * (1 / GAIN_LOW) ** ((np.clip(action, -1, 1) + 1) / 2))


def _with_decay(gains: Floats, decay: float) -> Floats:
    return np.concatenate([gains, np.full((*gains.shape[:-1], 1), decay)], axis=-1)


def _score(walks: Walks, gains: Floats, decay: float) -> float:
    return float(score_gains(walks, _with_decay(gains[None], decay))[0])


def _ranger_reset(walks: Walks) -> float:
    return float(minimize_scalar(lambda s: _ranger_error(walks, s), bounds=(0.01, 1), method="bounded").x)


def _ranger_error(walks: Walks, share: float) -> float:
    """Mean |error| [mm] of Ranger's estimator with another share of the geometry in its reset (2.3).

    Its reset is linear: between strikes the gyro's integral does not depend on the angle, so the error
    at a strike is that before it, shrunk, plus the floor's, plus what the stride adds.
    """
    published = 0.1
    signed = walks.estimator_mm[:, 1]
    height = walks.height * 1000 * walks.leg.step_length
    first = np.flatnonzero(np.diff(walks.walk, prepend=-1))
    before = np.roll(signed, 1) * (1 - published) + np.roll(height, 1) * published
    before[first] = 0.0
    added = signed - before
    error = np.empty_like(signed)
    is_first = np.zeros(len(signed), dtype=np.bool_)
    is_first[first] = True
    for i in range(len(signed)):
        held = 0.0 if is_first[i] else (1 - share) * error[i - 1] + share * height[i - 1]
        error[i] = held + added[i]
    return float(np.abs(error).mean())


def _linear_scores(walks: Walks, weights: Floats, bias: Floats, decay: float) -> Floats:
    """Mean |error| [mm] of linear rules, shapes (sets, 3, 6) and (sets, 3)."""
    features = np.clip(walks.features, FEATURE_LOW, FEATURE_HIGH)
    actions = np.einsum("sgf,nf->sng", weights, features) + bias[:, None, :]
    return np.asarray(score_gains(walks, _with_decay(_gains(actions), decay)))


def linear_rule(walks: Walks, start: Floats, decay: float, evaluations: int = 8000) -> tuple[Floats, Floats]:
    """Weights, shape (3, 6), and bias, shape (3,), of the best linear rule of the features.

    Args:
        walks: The walks on which it is searched, over standardised features.
        start: Fixed gains from which the search begins, shape (3,).
        decay: S_FD [1/s].
        evaluations: How many rules to try.
    """
    features = np.clip(walks.features, FEATURE_LOW, FEATURE_HIGH)
    centre, spread = features.mean(axis=0), features.std(axis=0)

    def decode(x: Floats) -> tuple[Floats, Floats]:
        scaled = x.reshape(-1, 3, features.shape[1] + 1)
        weights = scaled[:, :, :-1] / spread
        return weights, scaled[:, :, -1] - weights @ centre

    x = np.zeros((3, features.shape[1] + 1))
    x[:, -1] = _encode(start)
    best = _cma(lambda x: _linear_scores(walks, *decode(x), decay), x.ravel(), evaluations)
    weights, bias = decode(best)
    return weights[0], bias[0]


def _clouds(walks: Walks) -> tuple[Floats, Floats]:
    """Mean and covariance of the latest stride's features in each regime, shapes (8, 3), (8, 3, 3)."""
    features = np.clip(walks.features, FEATURE_LOW, FEATURE_HIGH)[:, RegimeFilter.LATEST]
    latest = np.roll(walks.regime, 1)  # features before a stride describe the one before
    later = np.diff(walks.walk, prepend=-1) == 0
    own = [features[later & (latest == regime)] for regime in range(8)]
    return np.array([x.mean(axis=0) for x in own]), np.array([np.cov(x.T) for x in own])


def _regimes(walks: Walks, means: Floats, covariances: Floats, dwell: float) -> Floats:
    """What the regime filter thinks before each stride, shape (strides, 8)."""
    number = walks.walk[-1] + 1
    features = np.clip(walks.features, FEATURE_LOW, FEATURE_HIGH).reshape(number, -1, walks.features.shape[1])
    agent = RegimeFilter(means, covariances, np.ones((8, 3)), dwell)
    agent.begin_episodes(np.ones(number, dtype=np.bool_))
    believed = [agent.regimes(features[:, stride]) for stride in range(features.shape[1])]
    return np.stack(believed, axis=1).reshape(-1, 8)


def _mixed_scores(walks: Walks, believed: Floats, actions: Floats, decay: float) -> Floats:
    """Mean |error| [mm] of actions for the regimes, shape (sets, 8, 3), mixed by what is believed."""
    mixed = np.einsum("nr,srg->sng", believed, actions)
    return score_gains(walks, _with_decay(_gains(mixed), decay))


def _regime_actions(
    walks: Walks, means: Floats, covariances: Floats, dwell: float, start: Floats, decay: float
) -> Floats:
    believed = _regimes(walks, means, covariances, dwell)
    best = _cma(
        lambda x: _mixed_scores(walks, believed, x.reshape(-1, 8, 3), decay),
        np.tile(_encode(start), 8),
        evaluations=10000,
    )
    return best.reshape(8, 3)


def _table_scores(walks: Walks, tables: Floats, decay: float) -> Floats:
    """Mean |error| [mm] of oracles, shape (sets, 16, 3)."""
    previous = np.roll(walks.levels, 1, axis=0)
    first = np.flatnonzero(np.diff(walks.walk, prepend=-1))
    previous[first] = walks.levels[first]
    return score_gains(walks, _with_decay(tables, decay), oracle_row(walks.levels, previous))


def _oracle(walks: Walks, start: Floats, decay: float) -> Floats:
    best = _cma(
        lambda x: _table_scores(walks, _gains(x.reshape(-1, 16, 3)), decay),
        np.tile(_encode(start), 16),
        evaluations=8000,
    )
    return _gains(best.reshape(16, 3))


def _cma(scores: Callable[[Floats], Floats], start: Floats, evaluations: int) -> Floats:
    """Covariance matrix adaptation (Hansen): the best of all candidates.

    Args:
        scores: From candidates, shape (sets, n), to their scores, lower is better.
        start: Where the search begins, shape (n,).
        evaluations: How many candidates to try.

    Raises:
        MissingExtraError: Without the package ``cma``.
    """
    cma = needed("cma")
    search = cma.CMAEvolutionStrategy(
        start, 0.3, {"seed": 1, "popsize": 24, "maxfevals": evaluations, "verbose": -9}
    )
    while not search.stop():
        candidates = search.ask()
        search.tell(candidates, scores(np.array(candidates)).tolist())
    return np.asarray(search.result.xbest)


def _main(
    out: Annotated[Path, typer.Option(help="Where the tuned values go.")] = RESULT,
) -> None:
    """Tune the reference agents of heel strike for both kinds of collision noise, in some minutes."""
    found: dict[str, Any] = {"command": "python -m fieldagents.tasks.heel_strike.search"}
    for kind in ("ar1", "low_pass"):
        print(kind, file=sys.stderr)
        settings = HeelStrikeSettings(collision_kind=kind)
        found[kind] = tune(settings, lambda line: print(" ", line, file=sys.stderr, flush=True))
    write_text(out, json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    typer.run(_main)
