"""A trained policy as one ONNX file, with its observation normaliser and its action limits inside.

A policy with a memory (a recurrent network, or a stack of observations) has a second input ``memory``, shape
(batch, n), and a second output ``next_memory``: zeros when an episode begins, then what the last call gave.
One that is told of its machine has the input ``diagnosis`` after the first, and the metadata ``told``.
"""

from __future__ import annotations

import io
import json
import warnings
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, cast

import numpy as np
import onnx
import torch
from gymnasium import spaces
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.running_mean_std import RunningMeanStd
from stable_baselines3.common.vec_env import VecNormalize

from fieldagents.learned.features import FeaturedVecEnv
from fieldagents.learned.pixels import is_image
from fieldagents.policies.conditioned import Condition
from fieldagents.policies.policy import CONDITIONS, DIAGNOSIS


class ExportedPolicy(torch.nn.Module):
    """Raw observation to the action an agent takes: normalise, network, most likely action, limits.

    As in the library, the action of a policy that squashes its outputs is scaled to the limits; that of any
    other is clipped to them.
    """

    mean: torch.Tensor
    scale: torch.Tensor
    low: torch.Tensor
    high: torch.Tensor

    def __init__(self, policy: BasePolicy, normaliser: VecNormalize) -> None:
        super().__init__()
        self.policy = policy
        self.clip = float(normaliser.clip_obs) if normaliser.norm_obs else np.inf
        space = normaliser.observation_space
        self.image = is_image(space)
        mean, scale = np.zeros(space.shape or ()), np.ones(space.shape or ())
        if normaliser.norm_obs:
            statistics = cast(RunningMeanStd, normaliser.obs_rms)
            mean, scale = statistics.mean, np.sqrt(statistics.var + normaliser.epsilon)
        self.register_buffer("mean", torch.tensor(mean, dtype=torch.float64))
        self.register_buffer("scale", torch.tensor(scale, dtype=torch.float64))
        limits = policy.action_space
        self.discrete = not isinstance(limits, spaces.Box)
        if isinstance(limits, spaces.Box):
            self.register_buffer("low", torch.tensor(limits.low))
            self.register_buffer("high", torch.tensor(limits.high))

    def normal(self, observation: torch.Tensor) -> torch.Tensor:
        """Observations as the network was given them."""
        if self.image:  # the network sees channels first
            return observation.permute(0, 3, 1, 2)
        # in double precision, as the normaliser of the training does it
        return ((observation.double() - self.mean) / self.scale).clamp(-self.clip, self.clip).float()

    def limited(self, action: torch.Tensor) -> torch.Tensor:
        """Actions of the network within their limits."""
        if self.discrete:
            return action
        action = action.reshape(-1, *self.low.shape)
        if self.policy.squash_output:
            return self.low + 0.5 * (action + 1.0) * (self.high - self.low)
        return torch.minimum(torch.maximum(action, self.low), self.high)


class PlainPolicy(ExportedPolicy):
    """A policy of the present observation alone."""

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Actions, shape (batch, ...), for observations, shape (batch, ...)."""
        return self.limited(self.policy._predict(self.normal(observation), deterministic=True))


class StackedPolicy(ExportedPolicy):
    """A policy of the latest observations, or of their features.

    Its memory is those before the present one; of features, also the action just taken.
    """

    def __init__(
        self, policy: BasePolicy, normaliser: VecNormalize, stack: int, featured: FeaturedVecEnv | None
    ) -> None:
        super().__init__(policy, normaliser)
        (whole,) = normaliser.observation_space.shape or (0,)
        self.features = None if featured is None else featured.features
        self.single = whole // stack
        self.before = whole - self.single
        self.memory = self.before + (0 if featured is None else featured.taken.shape[1])

    def forward(self, observation: torch.Tensor, memory: torch.Tensor) -> Any:
        """Actions, and what is remembered, shape (batch, memory)."""
        if self.features is None:
            present = [observation]
        else:
            present = [self.features(observation), memory[:, self.before :]]
        stacked = torch.cat([memory[:, : self.before], *present], dim=1)
        action = self.limited(self.policy._predict(self.normal(stacked), deterministic=True))
        remembered = stacked[:, self.single :]
        return action, remembered if self.features is None else torch.cat([remembered, action], dim=1)


class RecurrentPolicy(ExportedPolicy):
    """A policy with a network that remembers: its memory is the hidden state and the state of its cells."""

    def __init__(self, policy: BasePolicy, normaliser: VecNormalize) -> None:
        super().__init__(policy, normaliser)
        self.layers, _, self.units = cast(Any, policy).lstm_hidden_state_shape
        self.memory = 2 * self.layers * self.units

    def forward(self, observation: torch.Tensor, memory: torch.Tensor) -> Any:
        """Actions, and what is remembered, shape (batch, memory)."""
        state = memory.reshape(-1, 2, self.layers, self.units).permute(1, 2, 0, 3).contiguous()
        begun = torch.zeros_like(memory[:, 0])
        network = cast(Any, self.policy)
        action, (hidden, cells) = network._predict(
            self.normal(observation),
            lstm_states=(state[0], state[1]),
            episode_starts=begun,
            deterministic=True,
        )
        following = torch.stack([hidden, cells]).permute(2, 0, 1, 3).reshape(-1, self.memory)
        return self.limited(action), following


class ConditionedPolicy(torch.nn.Module):
    """A policy whose observations end with what it is told, which is given apart.

    Args:
        policy: Takes both in one.
    """

    def __init__(self, policy: ExportedPolicy) -> None:
        super().__init__()
        self.policy = policy

    def forward(self, observation: torch.Tensor, diagnosis: torch.Tensor, *memory: torch.Tensor) -> Any:
        """As of the policy."""
        return self.policy(torch.cat([observation, diagnosis], dim=1), *memory)


def to_onnx(
    policy: BasePolicy,
    normaliser: VecNormalize,
    note: str,
    stack: int = 1,
    featured: FeaturedVecEnv | None = None,
    conditions: Sequence[Condition] = (),
) -> bytes:
    """Export a policy; equal weights give equal bytes.

    Args:
        policy: A trained policy of Stable-Baselines3's interface.
        normaliser: Holds the statistics of the observations.
        note: One line about where it comes from, kept in the file as its documentation.
        stack: Observations that it is given at once.
        featured: What takes features of them.
        conditions: What the ends of its observations tell; the file has a further input for it.
    """
    names, outputs = ["observation"], ["action"]
    module: ExportedPolicy
    if hasattr(policy, "lstm_hidden_state_shape"):
        module = RecurrentPolicy(policy, normaliser)
    elif stack > 1 or featured is not None:
        module = StackedPolicy(policy, normaliser, stack, featured)
    else:
        module = PlainPolicy(policy, normaliser)
    shape = normaliser.unwrapped.observation_space.shape or ()
    example = [torch.zeros(2, *shape, dtype=torch.float32)]
    if isinstance(module, StackedPolicy | RecurrentPolicy):
        names, outputs = [*names, "memory"], [*outputs, "next_memory"]
        example.append(torch.zeros(2, module.memory))
    exported: torch.nn.Module = module
    if conditions:
        names.insert(1, DIAGNOSIS)
        own = shape[0] - 2 * len(conditions)
        example[:1] = [example[0][:, :own], example[0][:, own:]]
        exported = ConditionedPolicy(module)
    stream = io.BytesIO()
    with warnings.catch_warnings():
        # the exporter that needs no further package; its deprecation is torch's affair, pinned here
        warnings.simplefilter("ignore")
        torch.onnx.export(
            exported.eval(),
            tuple(example),
            stream,  # type: ignore[arg-type]
            input_names=names,
            output_names=outputs,
            dynamic_axes={name: {0: "batch"} for name in (*names, *outputs)},
            opset_version=17,
            dynamo=False,
        )
    model = onnx.load_from_string(stream.getvalue())
    model.doc_string = note
    if conditions:
        numbers = json.dumps([asdict(one) for one in conditions])
        onnx.helper.set_model_props(model, {CONDITIONS: numbers})
    onnx.checker.check_model(model)
    return cast(bytes, model.SerializeToString(deterministic=True))
