"""A training run: its parts, and their state as a whole."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, cast

import gymnasium
import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.save_util import recursive_getattr
from stable_baselines3.common.vec_env import VecEnv, VecFrameStack, VecNormalize

from fieldagents.learned.checkpoint import random_state, restore_random_state, to_arrays
from fieldagents.learned.config import TrainConfig
from fieldagents.learned.features import FeaturedVecEnv
from fieldagents.learned.pixels import ImageFeatures, is_image
from fieldagents.made import makers
from fieldagents.policies.algorithms import is_on_policy
from fieldgym.sb3 import NativeVecEnv

ACTIVATIONS = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU}
LOGGED = {
    True: ("approx_kl", "explained_variance", "std"),
    False: ("actor_loss", "critic_loss", "ent_coef"),
}
"""What the learning curve keeps of an update, on-policy and off-policy, where the learner logs it."""

BOOKKEEPING = ("start_time", "_num_timesteps_at_start")
"""Of the rate that the library prints: differs from one run to the next, and nothing depends on it."""


@dataclass(frozen=True)
class Best:
    """The best validation so far.

    Attributes:
        steps: When it was.
        mean_return: Mean return of its episodes.
        rank: What it was compared by, the first that differs; more is better.
    """

    steps: int
    mean_return: float
    rank: list[float]


class SpaceError(ValueError):
    """An environment whose observations or actions the algorithm cannot take."""


class Run:
    """The parts of a training run, and their state as a whole, for any learner of the library's interface.

    Attributes:
        model: The learner.
        environment: The training environments.
        featured: Takes features of what they give; None without.
        normaliser: Normalises what comes of that, after stacking it.
        best: The best validation so far; None before the first.
        validated: Steps of every validation, and the returns of its episodes.
        logged: What the learning curve keeps of an update.

    Raises:
        SpaceError: If the learner refuses the environment's spaces, or its arguments.
    """

    def __init__(self, config: TrainConfig, environment: NativeVecEnv) -> None:
        space = environment.observation_space
        image = is_image(space)
        if not image and not (
            isinstance(space, gymnasium.spaces.Box) and np.dtype(space.dtype).kind in "fiu"
        ):
            raise SpaceError(
                f"{config.task} gives observations of {space}, and training needs an array of numbers or an"
                " image: put a wrapper around it, environment.wrappers:"
                " ['gymnasium.wrappers:FlattenObservation']"
            )
        given: VecEnv = environment
        self.featured: FeaturedVecEnv | None = None
        if config.features is not None:
            (make,) = makers((config.features,))
            try:
                given = self.featured = FeaturedVecEnv(environment, make(space))
            except (RuntimeError, TypeError, ValueError) as error:
                raise SpaceError(f"features cannot be taken of {config.task}: {error}") from error
            space, image = given.observation_space, False
        self._image = image
        if image and (config.stack > 1 or not is_on_policy(config.kind)):
            raise SpaceError(
                "images are learned from by on-policy algorithms such as ppo, without a stack; others, and a"
                " stack, need features: 'fieldagents.learned.pixels:DarkLine' or your own"
            )
        if config.stack > 1 and len(space.shape or ()) != 1:
            raise SpaceError(f"only observations of one dimension are stacked, not {space}")
        self.config, self.environment = config, environment
        self.best: Best | None = None
        self.validated: list[tuple[int, list[float]]] = []
        self.logged = LOGGED[is_on_policy(config.kind)]
        self._stacked: VecFrameStack | None = None
        if config.stack > 1:
            given = self._stacked = VecFrameStack(given, config.stack, channels_order="last")
        self.normaliser = VecNormalize(
            given,
            norm_obs=config.normalise.observation and not image,  # pixels have their scale
            norm_reward=config.normalise.reward,
            clip_obs=config.normalise.clip,
            clip_reward=config.normalise.clip,
            gamma=config.argument("gamma", 0.99),
        )
        network = config.network
        policy_kwargs = {
            "net_arch": list(network.hidden),
            "activation_fn": ACTIVATIONS[network.activation],
            **({} if network.log_std_init is None else {"log_std_init": network.log_std_init}),
            **({"features_extractor_class": ImageFeatures} if image else {}),
            **network.imported,
        }
        arguments = dict(config.learner)
        if arguments.pop("learning_rate_decay", "constant") == "linear":
            arguments["learning_rate"] = falling(config.argument("learning_rate"))
        try:
            self.model = config.kind(
                config.policy_kind, self.normaliser, policy_kwargs=policy_kwargs, device="cpu", **arguments
            )
        except (AssertionError, TypeError, ValueError) as error:
            raise SpaceError(f"{config.algorithm} cannot be made for {config.task}: {error}") from error
        if self.featured is not None and hasattr(self.policy, "lstm_hidden_state_shape"):
            raise SpaceError("features are remembered by a stack of them, not by recurrence")
        self.model.action_space.seed(config.seed)  # an off-policy learner draws its first actions from it

    @property
    def policy(self) -> BasePolicy:
        """The policy that is being trained."""
        return self.model.policy

    def let_learn(self) -> None:
        """Let the next update move all of the policy, or after imitation its critic alone."""
        config = self.config
        if config.imitate is None or not is_on_policy(config.kind):
            return
        held = self.model.num_timesteps < config.imitate.critic_updates * config.update_steps
        for name, weights in self.policy.named_parameters():
            weights.requires_grad_(not held or "value" in name or "critic" in name)

    def learn(self, steps: int, recorder: Any, fresh: bool) -> None:
        """Train for some more steps.

        Args:
            steps: How many.
            recorder: The callback to call, after those of the config.
            fresh: Whether the run begins.
        """
        # An off-policy learner would log every few episodes; the recorder does so every round.
        log: Any = 1 if is_on_policy(self.config.kind) else None
        callbacks = [*(make() for make in makers(self.config.callbacks)), recorder]
        self.model.learn(steps, callback=callbacks, reset_num_timesteps=fresh, log_interval=log)

    def state(self) -> dict[str, Any]:
        """All that the next update depends on."""
        normaliser, model = self.normaliser, self.model
        _, variables = model._get_torch_save_params()
        return {
            "algorithm": self.config.algorithm,
            "steps": model.num_timesteps,
            "networks": model.get_parameters(),
            "variables": {name: recursive_getattr(model, name).detach().clone() for name in variables},
            "counters": {name: value for name, value in self._attributes().items() if _is_plain(value)},
            "buffer": _filled(getattr(model, "replay_buffer", None)),
            "first_actions": model.action_space.np_random.bit_generator.state,
            "stack": None if self._stacked is None else self._stacked.stacked_obs.stacked_obs,
            "observation_statistics": _statistics(normaliser.obs_rms) if normaliser.norm_obs else None,
            "return_statistics": _statistics(normaliser.ret_rms),
            "returns": normaliser.returns,
            "environment": self.environment.get_state(),
            "random": random_state(),
            "best": None if self.best is None else asdict(self.best),
            "validated": self.validated,
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from a state that `state` gave, after a round trip through a file."""
        model, normaliser = self.model, self.normaliser
        model.learn(0, reset_num_timesteps=True)  # has the library set up what it sets up only here
        model.set_parameters(state["networks"], device="cpu")
        with torch.no_grad():
            for name, value in state["variables"].items():
                recursive_getattr(model, name).copy_(value)
        own = self._attributes()
        for name, value in state["counters"].items():
            setattr(model, name, _like(value, own.get(name)))
        if self._image:
            # the library turns images by a view, and the order in memory is that of torch's sums
            turned = np.array(np.moveaxis(cast(Any, model._last_obs), 1, 3), order="C", copy=True)
            model._last_obs = np.moveaxis(turned, 3, 1)
        _fill(getattr(model, "replay_buffer", None), to_arrays(state["buffer"]))
        model.action_space.np_random.bit_generator.state = state["first_actions"]
        if self._stacked is not None:
            self._stacked.stacked_obs.stacked_obs = state["stack"].numpy()
        if normaliser.norm_obs:
            _restore_statistics(normaliser.obs_rms, state["observation_statistics"])
        _restore_statistics(normaliser.ret_rms, state["return_statistics"])
        normaliser.returns = state["returns"].numpy()
        self.environment.set_state(to_arrays(state["environment"]))
        if not self.environment.exact:
            model._last_obs = None  # the library then begins new episodes
        self.best = None if state["best"] is None else Best(**state["best"])
        self.validated = [(int(steps), list(returns)) for steps, returns in state["validated"]]
        restore_random_state(state["random"])  # last, since building the rest draws from these streams

    def _attributes(self) -> dict[str, Any]:
        """The learner's own attributes but its networks, buffers and environments."""
        model = self.model
        networks, variables = model._get_torch_save_params()
        apart = {name.split(".")[0] for name in [*networks, *variables]}
        # what the library leaves out of a finished model, a run under way needs: a network's last memory
        apart |= {name for name in model._excluded_save_params() if not name.startswith("_last")}
        apart |= {*BOOKKEEPING}
        return {name: value for name, value in vars(model).items() if name not in apart}


def falling(rate: float) -> Callable[[float], float]:
    """A learning rate that falls to zero with the remaining part of the training, 1 to 0."""
    return lambda remaining: rate * remaining


def _is_plain(value: Any) -> bool:
    """Whether a value is made of numbers, texts, arrays and containers of these alone."""
    if isinstance(value, dict):
        return all(isinstance(key, str) and _is_plain(item) for key, item in value.items())
    if isinstance(value, list | tuple | deque):
        return all(_is_plain(item) for item in value)
    kinds = (bool, int, float, str, np.generic, np.ndarray, torch.Tensor)
    return value is None or isinstance(value, kinds)


def _like(value: Any, own: Any) -> Any:
    """A value that has come back from a file, in the types of the learner's own one."""
    if value is None:  # saved before the first step
        return None
    if isinstance(own, deque):
        return deque(value, maxlen=own.maxlen)
    if isinstance(own, tuple) and isinstance(value, list):
        items = [_like(one, like) for one, like in zip(value, own, strict=True)]
        return type(own)(*items) if hasattr(own, "_fields") else tuple(items)
    if isinstance(own, torch.Tensor):
        return value
    return to_arrays(value)


def _filled(buffer: Any) -> dict[str, Any] | None:
    """What a replay buffer holds, without the part that is still empty."""
    if buffer is None:
        return None
    rows = buffer.buffer_size if buffer.full else buffer.pos
    arrays = {name: array[:rows] for name, array in _arrays(buffer).items()}
    return {"position": buffer.pos, "full": buffer.full, "arrays": arrays}


def _fill(buffer: Any, state: dict[str, Any] | None) -> None:
    """Fill a replay buffer with what `_filled` gave."""
    if buffer is None or state is None:
        return
    buffer.pos, buffer.full = state["position"], state["full"]
    for name, array in _arrays(buffer).items():
        array[: len(state["arrays"][name])] = state["arrays"][name]


def _arrays(buffer: Any) -> dict[str, NDArray[Any]]:
    return {name: value for name, value in vars(buffer).items() if isinstance(value, np.ndarray)}


def _statistics(statistics: Any) -> list[Any]:
    running = cast(RunningMeanStd, statistics)
    return [np.asarray(running.mean), np.asarray(running.var), float(running.count)]


def _restore_statistics(statistics: Any, saved: list[Any]) -> None:
    statistics.mean, statistics.var, statistics.count = saved[0].numpy(), saved[1].numpy(), saved[2]
