"""A policy whose weights are found by CMA-ES, by the returns of whole episodes.

Hansen, "The CMA evolution strategy: a tutorial", 2016, by his package ``cma``. It needs no gradient and no
critic, and suits policies of up to some hundreds of weights.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv
from torch.func import functional_call, vmap

from fieldgym.sb3 import NativeVecEnv
from fieldmodels.extras import needed


class Evolution(PPO):
    """CMA-ES over the weights that the most likely action depends on.

    In each group of twins row i plays candidate i: all meet the same episodes, so that returns differ by what
    the candidates do alone. A rollout is best an episode long.

    Args:
        policy: See ``PPO``; the critic is not used.
        env: With as many ``twins`` as there shall be candidates, four at least.
        spread: Standard deviation of the first candidates' weights.
        beyond: What an action costs that is beyond its limits, times the square of how far: where it makes
            no difference, the search would drift.
        keep: Parts of the names of weights that stay what they are, such as ``bias``.
        more: Further arguments of ``PPO``; none that says how it learns holds here.

    Raises:
        ValueError: If the candidates would not meet the same episodes.
    """

    def __init__(
        self,
        policy: Any,
        env: VecEnv,
        spread: float = 0.1,
        beyond: float = 1.0,
        keep: tuple[str, ...] = (),
        **more: Any,
    ) -> None:
        super().__init__(policy, env, **more)
        native = env.unwrapped
        self.candidates = native.twins if isinstance(native, NativeVecEnv) else 1
        if self.candidates < 4:
            raise ValueError(f"candidates meet the same episodes as twins: 4 at least, not {self.candidates}")
        self.keep = tuple(keep)
        self.beyond, self.spread, self.draws = beyond, spread, int(torch.randint(2**31, ()))
        self.begun: NDArray[np.float64] | None = None
        """Weights from which the search began; with the costs told to it, all that it depends on."""
        self.told: list[NDArray[np.float64]] = []
        self._search: Any = None
        self._asked: list[NDArray[np.float64]] = []

    def collect_rollouts(self, env: VecEnv, callback: Any, *_: Any, **__: Any) -> bool:
        """Let each candidate play its rows."""
        callback.on_rollout_start()
        if self._search is None:
            self._begin()
        self._asked = self._search.ask()
        weights = self._weights(torch.as_tensor(np.array(self._asked), dtype=torch.float32))
        low, high = self.action_space.low, self.action_space.high  # type: ignore[attr-defined]
        returns = np.zeros(self.n_envs)
        for _step in range(self.n_steps):
            actions = self._acted(weights, torch.as_tensor(self._last_obs))
            allowed = np.clip(actions, low, high)
            self._last_obs, rewards, ended, infos = env.step(allowed)  # type: ignore[assignment]
            returns += rewards - self.beyond * np.square(actions - allowed).reshape(self.n_envs, -1).sum(
                axis=1
            )
            self.num_timesteps += self.n_envs
            callback.update_locals(locals())
            if not callback.on_step():
                return False
            self._update_info_buffer(infos, ended)
        self.told.append(-returns.reshape(-1, self.candidates).mean(axis=0))
        callback.on_rollout_end()
        return True

    def train(self) -> None:
        """Tell the search what its candidates have earned, and act by its mean."""
        self._search.tell(self._asked, self.told[-1].tolist())
        mean = torch.as_tensor(self._search.result.xfavorite, dtype=torch.float32)[None]
        with torch.no_grad():
            for name, weights in self._weights(mean).items():
                self.policy.get_parameter(name.removeprefix("policy.")).copy_(weights[0])

    def _begin(self) -> None:
        """Begin the search; that of a resumed run is told again what it was told before."""
        if self.begun is None:
            actor = [weights.detach().numpy().ravel() for weights in self._actor().values()]
            self.begun = np.concatenate(actor).astype(np.float64)
        rng = np.random.default_rng(self.draws)
        options = {
            "popsize": self.candidates,
            "seed": np.nan,
            "verbose": -9,
            "randn": lambda *n: rng.normal(size=n),
        }
        self._search = needed("cma").CMAEvolutionStrategy(self.begun, self.spread, options)
        for costs in self.told:
            self._search.tell(self._search.ask(), np.asarray(costs).tolist())

    def _actor(self) -> dict[str, torch.nn.Parameter]:
        """The weights that the most likely action depends on."""
        apart = ("value", "vf", "log_std", *self.keep)
        everything = self.policy.named_parameters()
        return {name: own for name, own in everything if not any(part in name for part in apart)}

    def _weights(self, vectors: torch.Tensor) -> dict[str, torch.Tensor]:
        """Weights of several policies by their names in ``_Mean``, each of shape (policies, ...)."""
        shapes = {name: own.shape for name, own in self._actor().items()}
        parts = torch.split(vectors, [int(np.prod(shape)) for shape in shapes.values()], dim=1)
        named = zip(shapes.items(), parts, strict=True)
        return {f"policy.{name}": part.reshape(-1, *shape) for (name, shape), part in named}

    def _acted(self, weights: dict[str, torch.Tensor], observation: torch.Tensor) -> NDArray[np.float32]:
        """Actions of the rows, each by its candidate."""
        rows = observation.reshape(-1, self.candidates, *observation.shape[1:]).transpose(0, 1)
        mean = _Mean(self.policy)
        with torch.no_grad():
            actions = vmap(lambda own, seen: functional_call(mean, own, (seen,)))(weights, rows)
        return np.asarray(actions.transpose(0, 1).reshape(len(observation), -1))


class _Mean(torch.nn.Module):
    """The most likely action of a policy, as a module that can be called with other weights."""

    def __init__(self, policy: Any) -> None:
        super().__init__()
        self.policy = policy

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Actions, shape (batch, ...), before their limits."""
        policy = self.policy
        features = policy.extract_features(observation.float(), policy.pi_features_extractor)
        actions: torch.Tensor = policy.action_net(policy.mlp_extractor.forward_actor(features))
        return actions
