"""Learning from a teacher before learning by reward: DAgger (Ross, Gordon and Bagnell, 2011, algorithm 3.1).

A teacher that sees what the policy does not (the hidden truth) is distilled into a policy that has to infer
it, from a stack of observations; a teacher with the same rights is imitated.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray

from fieldagents.agent import Agent, visible
from fieldagents.evaluation.agents import make_agent
from fieldagents.learned.run import Run, SpaceError
from fieldagents.progress import Report

Floats = NDArray[np.float32]


def imitate(run: Run, report: Report) -> None:
    """Fit a run's policy to its teacher, as the config says; normalisers learn on the way.

    Args:
        run: A run that has not begun to learn.
        report: Shown the progress.

    Raises:
        SpaceError: If the policy is recurrent, or its actions are not continuous.
        ValueError: If the teacher cannot act in the environment.
    """
    config = run.config.imitate
    assert config is not None
    if hasattr(run.policy, "lstm_hidden_state_shape"):
        raise SpaceError("a policy that imitates remembers by a stack of observations, not by recurrence")
    if not isinstance(run.model.action_space, spaces.Box):
        raise SpaceError(f"only continuous actions are imitated, not {run.model.action_space}")
    teachers = Teachers(run)
    rng = np.random.default_rng(run.config.seed)
    optimiser = torch.optim.Adam(run.policy.parameters(), lr=config.learning_rate)
    # what the last rounds fit, they fit to all data: the rate falls to a twentieth by then
    rate = torch.optim.lr_scheduler.LinearLR(optimiser, 1.0, 0.05, config.rounds * config.epochs)
    raw: list[Floats] = []
    wanted: list[Floats] = []
    run.normaliser.reset()
    teachers.begin_episodes(np.ones(run.environment.num_envs, dtype=np.bool_))
    for number in range(config.rounds):
        report(f"imitating {config.teacher}", number / config.rounds)
        seen, said = _round(run, teachers, config.steps, teacher_acts=number == 0)
        raw.append(seen)
        wanted.append(said)
        inputs = torch.as_tensor(run.normaliser.normalize_obs(np.concatenate(raw)))
        targets = _as_the_network_gives_them(run, torch.as_tensor(np.concatenate(wanted)))
        for _ in range(config.epochs):
            _fit(run, optimiser, inputs, targets, config.batch_size, rng)
            rate.step()


class Teachers:
    """The teacher of each of a run's environments, made for its settings."""

    def __init__(self, run: Run) -> None:
        config, self._environment = run.config, run.environment
        assert config.imitate is not None
        self._task = config.task
        self._all: list[tuple[Agent, slice]] = []
        for place, part, rows in zip(
            config.environments, run.environment.parts, run.environment.rows, strict=True
        ):
            teacher = make_agent(config.imitate.teacher, config.task, place.settings).runs[0]
            teacher.fits(part.single_observation_space, part.single_action_space)
            teacher.reset(config.seed)
            self._all.append((teacher, rows))

    def begin_episodes(self, begun: NDArray[np.bool_]) -> None:
        """See ``Agent.begin_episodes``."""
        for teacher, rows in self._all:
            teacher.begin_episodes(begun[rows])

    def act(self, observation: NDArray[Any]) -> Floats:
        """What they would do, each with what it may see."""
        commands = [
            teacher.act(observation[rows], visible(info, teacher.sees, self._task))
            for (teacher, rows), info in zip(self._all, self._environment.infos, strict=True)
        ]
        return np.concatenate(commands).astype(np.float32)

    def overruled(self, action: NDArray[np.float32]) -> None:
        """See ``Agent.overruled``."""
        for teacher, rows in self._all:
            teacher.overruled(action[rows])


def _round(run: Run, teachers: Teachers, steps: int, teacher_acts: bool) -> tuple[Floats, Floats]:
    """Observations as the policy is given them, before normalisation, and what the teacher would do.

    Both have shape (steps x environments, ...).
    """
    seen, said = [], []
    space = cast(spaces.Box, run.environment.action_space)
    for _ in range(steps):
        stacked = np.array(run.normaliser.get_original_obs(), dtype=np.float32)
        command = teachers.act(run.environment.latest)
        seen.append(stacked)
        said.append(np.clip(command, space.low, space.high))
        action = command
        if not teacher_acts:
            action, _ = run.model.predict(run.normaliser.normalize_obs(stacked), deterministic=True)
            teachers.overruled(action)
        _, _, ended, _ = run.normaliser.step(action)
        teachers.begin_episodes(ended)
    return np.concatenate(seen), np.concatenate(said)


def _as_the_network_gives_them(run: Run, actions: torch.Tensor) -> torch.Tensor:
    """Actions in the scale of the network's outputs."""
    if not run.policy.squash_output:
        return actions
    space = cast(spaces.Box, run.environment.action_space)
    low, high = torch.as_tensor(space.low), torch.as_tensor(space.high)
    return 2.0 * (actions - low) / (high - low) - 1.0


def _fit(
    run: Run,
    optimiser: torch.optim.Optimizer,
    inputs: torch.Tensor,
    targets: torch.Tensor,
    batch_size: int,
    rng: np.random.Generator,
) -> None:
    """Least squares from observations to the teacher's actions, once through all of them."""
    run.policy.set_training_mode(True)
    for part in np.array_split(rng.permutation(len(inputs)), max(1, len(inputs) // batch_size)):
        rows = torch.as_tensor(part)
        outputs = run.policy._predict(inputs[rows], deterministic=True)
        loss = torch.nn.functional.mse_loss(outputs.reshape(targets[rows].shape), targets[rows])
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimiser.step()
    run.policy.set_training_mode(False)
