"""Heel strike's walks, recorded once and walked again with the gains of any policy."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fieldagents.tasks.heel_strike.search import recorded
from fieldgym import find_task
from fieldgym.heel_strike import FEATURE_HIGH, FEATURE_LOW, GAIN_LOW, HeelStrikeSettings
from fieldgym.info import part
from fieldmodels.machines.heel_strike.search import Walks
from fieldmodels.machines.heel_strike.sensitivity import loss_slopes, stride_slopes
from fieldmodels.reality import Reality


class RecordedWalks:
    """See ``fieldagents.learned.pathwise.Recorded``: the rewards are those of the environment.

    Args:
        settings: Of the environment.
        reality: Of the environment; of a random one, each walk has what its seed draws there.
        seeds: One for each walk.
    """

    def __init__(self, settings: HeelStrikeSettings, reality: Reality, seeds: range) -> None:
        self._settings = settings
        self.drawn = _drawn(settings, reality, seeds)
        self._walks = _walks(settings, reality, seeds, self.drawn)
        shape = (len(seeds), settings.strides, -1)
        bounded = np.clip(self._walks.features, FEATURE_LOW, FEATURE_HIGH)
        self.observations = bounded.astype(np.float32).reshape(shape)
        self._ends = np.concatenate([[0], np.cumsum(self._walks.samples)])

    def play(
        self, which: NDArray[np.int64], actions: NDArray[np.float32]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """See ``Recorded.play``."""
        own, walks = self._settings, self._some(which)
        octaves = -np.log(GAIN_LOW) / 2
        chosen = GAIN_LOW * np.exp(octaves * (actions.reshape(-1, 3).astype(np.float64) + 1))
        gains = np.column_stack([chosen, np.full(len(chosen), own.decay)])
        errors, slopes = stride_slopes(walks, gains)
        if own.score == "angle_and_floor":
            errors = errors + walks.height * (1000 * walks.leg.step_length)
        rewards = -np.minimum(np.abs(errors) / own.scale_mm, own.reward_limit)
        by_error = np.where(-rewards < own.reward_limit, -np.sign(errors) / own.scale_mm, 0.0)
        by_action = loss_slopes(walks, slopes, by_error) * chosen * octaves
        return rewards.reshape(len(which), -1).sum(axis=1), by_action.reshape(actions.shape)

    def _some(self, which: NDArray[np.int64]) -> Walks:
        """Some of the walks, end to end."""
        every, steps = self._walks, self._settings.strides
        strides = (np.asarray(which)[:, None] * steps + np.arange(steps)).ravel()
        pieces = [every.gyro[self._ends[i * steps] : self._ends[(i + 1) * steps]] for i in which]
        parts = ("samples", "walk", "theta", "height", "features", "levels", "estimator_mm")
        chosen = {name: getattr(every, name)[strides] for name in parts}
        return replace(every, gyro=np.concatenate(pieces), **chosen)


def _drawn(settings: HeelStrikeSettings, reality: Reality, seeds: range) -> dict[str, dict[str, Any]]:
    """What each of some environments draws of a random reality, arrays of shape (seeds,)."""
    if not reality.random:
        return {}
    env = find_task("heel_strike").make_vec(len(seeds), settings=settings, reality=reality)
    _, info = env.reset(seed=list(seeds))
    env.close()
    found = part(info, "privileged.reality")
    return {effect: {name: found[effect][name] for name in own} for effect, own in reality.plain().items()}


def _walks(
    settings: HeelStrikeSettings, reality: Reality, seeds: range, drawn: dict[str, dict[str, Any]]
) -> Walks:
    """The walks of all seeds end to end, each in its own reality."""
    if not drawn:
        return recorded(settings, seeds, reality)
    walks = []
    for i, seed in enumerate(seeds):
        own = {
            effect: {name: float(of[i]) for name, of in values.items()} for effect, values in drawn.items()
        }
        walks.append(recorded(settings, range(seed, seed + 1), own))
    joined: dict[str, Any] = {
        name: np.concatenate([getattr(one, name) for one in walks])
        for name in ("gyro", "samples", "theta", "height", "features", "levels", "estimator_mm")
    }
    return replace(walks[0], walk=np.repeat(np.arange(len(walks)), settings.strides), **joined)
