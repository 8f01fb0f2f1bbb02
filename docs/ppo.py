"""PPO in one file, in the style of CleanRL: copy it and change what you like.

envs = gymnasium.make_vec("fieldgym:fieldgym/PoseReaching-v0", num_envs=64, autoreset_mode="SameStep")
agent = train(envs, steps=200_000)
"""

import numpy as np
import torch
from torch import nn
from torch.distributions import Normal


class Agent(nn.Module):
    """A policy with a value: two networks, and a deviation that does not depend on what is observed."""

    def __init__(self, observations: int, actions: int, width: int = 64) -> None:
        super().__init__()

        def network(outputs: int) -> nn.Sequential:
            body = (nn.Linear(observations, width), nn.Tanh(), nn.Linear(width, width), nn.Tanh())
            return nn.Sequential(*body, nn.Linear(width, outputs))

        self.mean, self.value = network(actions), network(1)
        self.log_std = nn.Parameter(torch.zeros(actions))

    def distribution(self, observation: torch.Tensor) -> Normal:
        """Of actions."""
        return Normal(self.mean(observation), self.log_std.exp())

    def best(self, observation: torch.Tensor) -> torch.Tensor:
        """The action without noise, within its bounds."""
        return self.mean(observation).clamp(-1.0, 1.0)


def train(
    envs, steps, seed=0, length=64, epochs=10, minibatch=256, rate=1e-3, gamma=0.99, lam=0.95, clip=0.2
):
    """Train an agent on a vector environment that begins the next episode in the step that ends one."""
    torch.manual_seed(seed)
    agent = Agent(envs.single_observation_space.shape[0], envs.single_action_space.shape[0])
    optimizer = torch.optim.Adam(agent.parameters(), rate, eps=1e-5)
    seen, _ = envs.reset(seed=seed)
    for _ in range(steps // (length * envs.num_envs)):
        observations, actions, chances, values, rewards, ends, after = ([] for _ in range(7))
        for _ in range(length):
            with torch.no_grad():
                now = torch.as_tensor(seen, dtype=torch.float32)
                chosen = agent.distribution(now)
                action = chosen.sample()
                observations.append(now), actions.append(action)
                chances.append(chosen.log_prob(action).sum(1)), values.append(agent.value(now)[:, 0])
                seen, reward, terminated, truncated, info = envs.step(action.numpy())
                over, following = terminated | truncated, np.array(seen)
                for i in np.flatnonzero(over):
                    following[i] = info["final_obs"][i]
                after.append(agent.value(torch.as_tensor(following, dtype=torch.float32))[:, 0])
            rewards.append(torch.as_tensor(reward, dtype=torch.float32))
            after[-1] = after[-1] * torch.as_tensor(~terminated)  # a truncated episode would have gone on
            ends.append(torch.as_tensor(over))
        advantages, last = [], torch.zeros(envs.num_envs)
        for t in reversed(range(length)):
            surprise = rewards[t] + gamma * after[t] - values[t]
            last = surprise + gamma * lam * last * ~ends[t]
            advantages.insert(0, last)
        x, a, old, v, gain = map(torch.cat, (observations, actions, chances, values, advantages))
        target = gain + v
        for _ in range(epochs):
            for rows in torch.randperm(len(x)).split(minibatch):
                chosen = agent.distribution(x[rows])
                ratio = (chosen.log_prob(a[rows]).sum(1) - old[rows]).exp()
                scaled = (gain[rows] - gain[rows].mean()) / (gain[rows].std() + 1e-8)
                surrogate = torch.min(ratio * scaled, ratio.clamp(1 - clip, 1 + clip) * scaled).mean()
                error = (agent.value(x[rows])[:, 0] - target[rows]).square().mean()
                optimizer.zero_grad()
                (0.5 * error - surrogate).backward()
                nn.utils.clip_grad_norm_(agent.parameters(), 0.5)
                optimizer.step()
    return agent
