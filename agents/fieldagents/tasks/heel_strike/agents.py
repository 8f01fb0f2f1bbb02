"""Heel strike: the dissertation's estimators, tuned as it says and as it could be, and what bounds them.

Source: A. I. Chaudhry, "Topics in robot locomotion: state estimation and feasible-path generation for
wheeled and legged robots", Cornell University 2015, chapter 2 ("the dissertation"). Tuned values are in
``tuned.json``, made by ``python -m fieldagents.tasks.heel_strike.search`` on tuning seeds alone.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fieldagents.agent import Agent, Sees
from fieldagents.task import ReferenceAgent
from fieldgym.heel_strike import GAIN_LOW, HeelStrikeSettings
from fieldgym.info import part
from fieldgym.settings import read_settings

ActionArray = NDArray[np.float32]


def to_action(gains: ArrayLike) -> ActionArray:
    """Actions that choose S_MS early, S_MS late and S_HR; gains out of range are taken to its ends.

    Args:
        gains: Shape (..., 3).
    """
    logs = np.log(np.maximum(np.asarray(gains, dtype=np.float64), 1e-12) / GAIN_LOW) / np.log(1 / GAIN_LOW)
    return np.asarray(np.clip(2 * logs - 1, -1, 1), dtype=np.float32)


class FixedGains(Agent):
    """The same gains in every stride: the model-based estimator (2.14) as the dissertation uses it."""

    def __init__(self, gains: ArrayLike) -> None:
        self.gains = np.asarray(gains, dtype=np.float64)
        self._action = to_action(self.gains)

    def act(self, observation: NDArray[Any], info: Mapping[str, Any]) -> ActionArray:  # noqa: ARG002
        """See ``Agent.act``."""
        return np.tile(self._action, (len(observation), 1))


class LinearRule(Agent):
    """Log gains linear in the observation.

    Args:
        weights: Shape (3, 6), from features to actions.
        bias: Shape (3,).
    """

    def __init__(self, weights: ArrayLike, bias: ArrayLike) -> None:
        self.weights, self.bias = np.asarray(weights, dtype=np.float64), np.asarray(bias, dtype=np.float64)

    def act(self, observation: NDArray[Any], info: Mapping[str, Any]) -> ActionArray:  # noqa: ARG002
        """See ``Agent.act``."""
        return np.clip(observation @ self.weights.T + self.bias, -1, 1).astype(np.float32)


class RegimeFilter(Agent):
    """Infers the regime as a hidden Markov model does, and mixes the gains of the eight regimes.

    It keeps one thing: how probable each regime is (forward algorithm, Baum 1966). The regimes look like
    Gaussian clouds of log innovation^2, log torque^2 and log collision^2 of the latest stride.

    Args:
        means: Mean of the three features in each regime, shape (8, 3).
        covariances: Their covariances, shape (8, 3, 3).
        actions: Action for each regime, shape (8, 3); may lie beyond the action's limits, which hold
            for the mixture.
        dwell: Mean number of strides between switches of one noise level.
    """

    LATEST = (0, 2, 4)
    """Columns of the observation that describe the latest stride alone."""

    def __init__(self, means: ArrayLike, covariances: ArrayLike, actions: ArrayLike, dwell: float) -> None:
        self._means = np.asarray(means, dtype=np.float64)
        self._precisions = np.linalg.inv(np.asarray(covariances, dtype=np.float64))
        self._log_volumes = 0.5 * np.linalg.slogdet(self._precisions)[1]
        self._actions = np.asarray(actions, dtype=np.float64)
        switch = 1 / dwell
        one = np.array([[1 - switch, switch], [switch, 1 - switch]])
        self._transition = np.kron(one, np.kron(one, one))
        self._probability = np.empty((0, 8))
        self._begun = np.empty(0, dtype=np.bool_)

    def begin_episodes(self, begun: NDArray[np.bool_]) -> None:
        """See ``Agent.begin_episodes``."""
        if len(self._begun) != len(begun):
            self._probability = np.full((len(begun), 8), 1 / 8)
        self._begun = begun.copy()
        self._probability[begun] = 1 / 8

    def regimes(self, observation: NDArray[Any]) -> NDArray[np.float64]:
        """Probability of each regime in the latest stride, shape (environments, 8); call once a stride.

        Regime number: 4 process + 2 floor + collision, each 0 low or 1 high.
        """
        if len(self._begun) != len(observation):
            self.begin_episodes(np.ones(len(observation), dtype=np.bool_))
        away = np.asarray(observation, dtype=np.float64)[:, None, self.LATEST] - self._means
        log = self._log_volumes - 0.5 * np.einsum("nri,rij,nrj->nr", away, self._precisions, away)
        posterior = (self._probability @ self._transition) * np.exp(log - log.max(axis=1, keepdims=True))
        posterior /= posterior.sum(axis=1, keepdims=True)
        # Before the first stride there is nothing to learn from.
        self._probability = np.where(self._begun[:, None], 1 / 8, posterior)
        self._begun[:] = False
        return self._probability.copy()

    def act(self, observation: NDArray[Any], info: Mapping[str, Any]) -> ActionArray:  # noqa: ARG002
        """See ``Agent.act``."""
        return np.clip(self.regimes(observation) @ self._actions, -1, 1).astype(np.float32)


class OracleGains(Agent):
    """The best gains for the regime of each stride, which no robot knows.

    Args:
        table: S_MS early, S_MS late and S_HR for each row of ``oracle_row``, shape (16, 3).
    """

    def __init__(self, table: ArrayLike) -> None:
        self._actions = to_action(table)

    def act(self, observation: NDArray[Any], info: Mapping[str, Any]) -> ActionArray:  # noqa: ARG002
        """See ``Agent.act``."""
        hidden = part(info, "privileged")
        return self._actions[oracle_row(hidden["levels"], hidden["previous_levels"])]


def oracle_row(levels: NDArray[np.int64], previous: NDArray[np.int64]) -> NDArray[np.int64]:
    """Row of the oracle's table: what matters in a stride and for the reset at its start.

    Args:
        levels: Regime of the stride to come (process, floor, collision), shape (..., 3).
        previous: Regime of the stride before, whose floor and collisions the reset has to weigh.

    Returns:
        8 process + 4 collision + 2 previous collision + previous floor, shape (...).
    """
    return np.asarray(8 * levels[..., 0] + 4 * levels[..., 2] + 2 * previous[..., 2] + previous[..., 1])


class Estimator(Agent):
    """An estimator outside the action space: it reads the same sensors on the same strides.

    Args:
        key: Its entry of ``info``.
        settings: Settings of the environment that compute it and change nothing else.
    """

    def __init__(self, key: str, settings: Mapping[str, Any]) -> None:
        self.estimator, self.settings = key, settings

    def act(self, observation: NDArray[Any], info: Mapping[str, Any]) -> ActionArray:  # noqa: ARG002
        """Neutral actions, which do not touch the estimator."""
        return np.zeros((len(observation), len(GAIN_LOW)), dtype=np.float32)


@cache
def tuned() -> dict[str, Any]:
    """The tuned values of each collision kind, as ``tuning.py`` wrote them."""
    text = Path(__file__).with_name("tuned.json").read_text(encoding="utf-8")
    return dict(json.loads(text))


def _tuned(settings: Mapping[str, Any], what: str) -> Any:
    kind = read_settings(settings, HeelStrikeSettings).collision_kind
    return tuned()[kind][what]


def _fixed(name: str, title: str) -> ReferenceAgent:
    return ReferenceAgent(name, title, lambda settings: FixedGains(_tuned(settings, name)["gains"]))


def _estimator(name: str, title: str, sees: Sees = "observation", **extra: Any) -> ReferenceAgent:
    needed = "filters" if extra.get("filterpy") else ""
    return ReferenceAgent(
        name, title, lambda _: Estimator(f"error_mm_{name}", extra), sees, estimator=True, extra=needed
    )


FIXED_TUNED = "(2.14) with the best S_MS and S_HR of a logarithmic grid"
GATED_TUNED = "(2.14) with the best fixed gains, S_MS apart during the collision noise"
ADAPTIVE = "Log gains linear in the observation, tuned by CMA-ES"

AGENTS = (
    _estimator(
        "ranger",
        "Ranger's estimator (2.2)-(2.3): the integrated gyro, a tenth of the geometry at each strike",
    ),
    ReferenceAgent(
        "ranger_tuned",
        "Ranger's estimator with its heel-strike reset tuned",
        lambda settings: Estimator(
            "error_mm_ranger_tuned", {"tuned_reset": _tuned(settings, "ranger_tuned")["reset"]}
        ),
        estimator=True,
    ),
    ReferenceAgent(
        "sensor_only",
        "Ranger's estimator as an action: S_MS = 1, S_HR = 0.1",
        lambda _: FixedGains((1.0, 1.0, 0.1)),
    ),
    _fixed("paper_grid", "(2.14) with the best of the source's grids of S_FD, S_MS and S_HR"),
    _fixed("fixed_tuned", FIXED_TUNED),
    _fixed("gated_tuned", GATED_TUNED),
    ReferenceAgent(
        "adaptive",
        ADAPTIVE,
        lambda settings: LinearRule(*(_tuned(settings, "adaptive")[key] for key in ("weights", "bias"))),
    ),
    ReferenceAgent(
        "regime_filter",
        "Infers the regime by a Gaussian hidden Markov model and mixes the gains tuned for each",
        lambda settings: RegimeFilter(
            *(_tuned(settings, "regime_filter")[key] for key in ("means", "covariances", "actions", "dwell"))
        ),
    ),
    ReferenceAgent(
        "oracle_gains",
        "The best gains for each stride's regime",
        lambda settings: OracleGains(_tuned(settings, "oracle_gains")["table"]),
        "privileged",
    ),
    _estimator(
        "ekf",
        "Extended Kalman filter with torque and collision states, given the typical noise levels",
        "model",
    ),
    _estimator(
        "imm",
        "Eight extended Kalman filters (interacting multiple models), given levels and dwell",
        "model",
        bank=True,
    ),
    _estimator(
        "ekf_filterpy",
        "The filter of ekf by the library filterpy; slow, needs fieldgym[filters]",
        "model",
        filterpy=True,
    ),
    _estimator(
        "imm_filterpy",
        "The bank of imm by the library filterpy; slow, needs fieldgym[filters]",
        "model",
        bank=True,
        filterpy=True,
    ),
)
"""The reference agents, in the order of presentation."""
