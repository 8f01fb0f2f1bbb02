"""A trained policy as one ONNX file, with its observation normaliser and its action limits inside."""

from __future__ import annotations

import io
import warnings
from typing import cast

import numpy as np
import onnx
import torch
from gymnasium import spaces
from stable_baselines3.common.policies import ActorCriticPolicy, BasePolicy
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecNormalize
from stable_baselines3.sac.policies import SACPolicy

from fieldagents.learned.pixels import is_image


class DeterministicPolicy(torch.nn.Module):
    """Raw observation to the action an agent takes: normalise, network, most likely action, limits.

    PPO's most likely action is clipped to the limits; SAC's is squashed between them.
    """

    mean: torch.Tensor
    scale: torch.Tensor
    low: torch.Tensor
    high: torch.Tensor

    def __init__(self, policy: BasePolicy, normaliser: VecNormalize) -> None:
        super().__init__()
        self.policy = policy
        self.clip = float(normaliser.clip_obs) if normaliser.norm_obs else np.inf
        shape = normaliser.observation_space.shape or ()
        self.image = is_image(normaliser.observation_space)
        mean, scale = np.zeros(shape), np.ones(shape)
        if normaliser.norm_obs:
            statistics = cast(RunningMeanStd, normaliser.obs_rms)
            mean, scale = statistics.mean, np.sqrt(statistics.var + normaliser.epsilon)
        self.register_buffer("mean", torch.tensor(mean, dtype=torch.float64))
        self.register_buffer("scale", torch.tensor(scale, dtype=torch.float64))
        space = policy.action_space
        self.discrete = isinstance(space, spaces.Discrete)
        if isinstance(space, spaces.Box):
            self.register_buffer("low", torch.tensor(space.low))
            self.register_buffer("high", torch.tensor(space.high))

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Actions, shape (batch, ...), for observations, shape (batch, ...)."""
        if self.image:
            assert isinstance(self.policy, ActorCriticPolicy)
            pixels = observation.permute(0, 3, 1, 2) / 255.0  # the learner sees channels first
            return self._limited(
                self.policy.mlp_extractor.forward_actor(self.policy.pi_features_extractor(pixels))
            )
        # in double precision, as the normaliser of the training does it
        normal = ((observation.double() - self.mean) / self.scale).clamp(-self.clip, self.clip).float()
        if isinstance(self.policy, SACPolicy):
            actor = self.policy.actor
            squashed = torch.tanh(actor.mu(actor.latent_pi(normal.flatten(1))))
            return self.low + 0.5 * (squashed + 1.0) * (self.high - self.low)
        assert isinstance(self.policy, ActorCriticPolicy)
        return self._limited(self.policy.mlp_extractor.forward_actor(normal.flatten(1)))

    def _limited(self, latent: torch.Tensor) -> torch.Tensor:
        """PPO's most likely action within its limits."""
        assert isinstance(self.policy, ActorCriticPolicy)
        action: torch.Tensor = self.policy.action_net(latent)
        if self.discrete:
            return action.argmax(dim=1)
        return torch.minimum(torch.maximum(action, self.low), self.high)


def to_onnx(policy: BasePolicy, normaliser: VecNormalize, note: str) -> bytes:
    """Export a policy; equal weights give equal bytes.

    Args:
        policy: A trained policy of Stable-Baselines3.
        normaliser: Holds the statistics of the observations.
        note: One line about where it comes from, kept in the file as its documentation.
    """
    module = DeterministicPolicy(policy, normaliser).eval()
    example = torch.zeros(1, *(normaliser.observation_space.shape or ()), dtype=torch.float32)
    stream = io.BytesIO()
    with warnings.catch_warnings():
        # the exporter that needs no further package; its deprecation is torch's affair, pinned here
        warnings.simplefilter("ignore", DeprecationWarning)
        torch.onnx.export(
            module,
            (example,),
            stream,  # type: ignore[arg-type]
            input_names=["observation"],
            output_names=["action"],
            dynamic_axes={"observation": {0: "batch"}, "action": {0: "batch"}},
            opset_version=17,
            dynamo=False,
        )
    model = onnx.load_from_string(stream.getvalue())
    model.doc_string = note
    onnx.checker.check_model(model)
    return cast(bytes, model.SerializeToString(deterministic=True))
