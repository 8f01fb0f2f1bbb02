"""What every environment over a batch kernel has in common: a scalar and a native vector form of one task.

A task writes its `BatchTask`, the task on a batch of robots, and derives its two environments from `TaskEnv`
and `TaskVectorEnv`; the scalar one is the batch of one.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium.error import InvalidAction, ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from fieldgym.info import masked, merged, row
from fieldmodels.reality import Reality

if TYPE_CHECKING:
    from fieldgym.rendering.canvas import Frame, Window

RealityLike = Reality | Mapping[str, Any] | str | Path | None
Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Box = gym.spaces.Box


@dataclass(frozen=True)
class Outcome:
    """One step of a batch: arrays of shape (batch, ...)."""

    observation: NDArray[Any]
    reward: Floats
    terminated: Flags
    truncated: Flags
    info: dict[str, Any]


class BatchTask(ABC):
    """A task on a batch.

    Attributes:
        settings: The task's settings.
        reality: What the simulation truly is.
        elapsed: Steps taken in each episode, shape (batch,).
    """

    settings: Any
    reality: Reality
    elapsed: NDArray[np.int64]

    @abstractmethod
    def __init__(self, batch: int, settings: Any, reality: RealityLike, drawing: bool) -> None:
        """Make a batch; ``drawing`` says whether pictures will be asked for."""

    @abstractmethod
    def spaces(self) -> tuple[Box, Box]:
        """Action and observation space of one environment."""

    @abstractmethod
    def restart(self, which: Sequence[int], generators: Sequence[np.random.Generator]) -> None:
        """Begin new episodes of some environments."""

    @abstractmethod
    def observation(self) -> NDArray[Any]:
        """Observations of the batch, shape (batch, ...)."""

    @abstractmethod
    def reset_info(self) -> dict[str, Any]:
        """The info that ``reset`` returns."""

    @abstractmethod
    def step(self, actions: NDArray[Any]) -> Outcome:
        """Take every environment one step on; actions have been checked, shape (batch, ...), float64."""

    @abstractmethod
    def state(self) -> dict[str, Any]:
        """Everything that the next steps depend on but the random generators."""

    @abstractmethod
    def set_state(self, state: Mapping[str, Any]) -> None:
        """Return to a snapshot that fits this batch."""

    @abstractmethod
    def frame(self, i: int) -> Frame:
        """Draw one environment."""


def checked_actions(actions: NDArray[Any], batch: int, space: Box) -> Floats:
    """Actions of a batch within the bounds of their space, shape (batch, ...), float64.

    Raises:
        InvalidAction: If they have the wrong shape or are not finite.
    """
    shape = (batch, *space.shape)
    if np.shape(actions)[:1] != (batch,):
        raise InvalidAction(f"actions of shape {shape} are needed, not {np.shape(actions)}")
    if np.shape(actions) != shape:
        raise InvalidAction(f"an action of shape {space.shape} is needed, not {np.shape(actions)[1:]}")
    values = np.asarray(actions, dtype=np.float64)
    if not np.isfinite(values).all():
        raise InvalidAction(f"actions must be finite numbers, not {actions}")
    return np.clip(values, space.low, space.high)


def check_state(state: Mapping[str, Any], batch: int, keys: Sequence[str]) -> None:
    """Make sure that a mapping is a snapshot of a batch.

    Raises:
        ValueError: If it is not.
    """
    if not {*keys, "elapsed", "generators"} <= set(state):
        raise ValueError("not a snapshot of this environment; get_state makes one")
    if len(state["elapsed"]) != batch:
        raise ValueError(
            f"the state is one of {len(state['elapsed'])} environments; make it with that num_envs"
        )


def row_seeds(seed: int | Sequence[int | None] | None, count: int) -> list[int | None]:
    """Seed of each row of a vector environment: ``seed + i``, ``seed[i]``, or None for its own stream.

    Raises:
        ValueError: If there is not one seed for each row.
    """
    if seed is None or isinstance(seed, (int, np.integer)):
        return [None if seed is None else int(seed) + i for i in range(count)]
    if len(seed) != count:
        raise ValueError(f"{count} environments need as many seeds, not {len(seed)}")
    return list(seed)


def check_render_mode(mode: str | None, metadata: Mapping[str, Any]) -> None:
    """Raise ValueError for a render mode that an environment does not have."""
    if mode is not None and mode not in metadata["render_modes"]:
        raise ValueError(f"render_mode {mode!r} is not one of {metadata['render_modes']} or None")


class TaskEnv(gym.Env[NDArray[Any], NDArray[Any]]):
    """A task's scalar environment: a batch of one.

    Attributes:
        batch_task: The task on a batch.
        title: Title of the window.
        window_fps: Most frames a second in a window; 0 for as many as ``metadata`` says.
    """

    batch_task: ClassVar[type[BatchTask]]
    title: ClassVar[str]
    window_fps: ClassVar[float] = 0.0

    def __init__(
        self, settings: Any = None, reality: RealityLike = None, render_mode: str | None = None
    ) -> None:
        check_render_mode(render_mode, self.metadata)
        self.render_mode = render_mode
        self._task = type(self).batch_task(1, settings, reality, render_mode is not None)
        self.settings, self.reality = self._task.settings, self._task.reality
        self._action, self.observation_space = self._task.spaces()
        self.action_space = self._action
        self._ready = False
        self._window: Window | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[Any], dict[str, Any]]:
        """Begin an episode; see ``gymnasium.Env.reset``. There are no options."""
        super().reset(seed=seed, options=options)
        self._task.restart([0], [self.np_random])
        self._ready = True
        self._render_window()
        return self._task.observation()[0], row(self._task.reset_info())

    def step(self, action: NDArray[Any]) -> tuple[NDArray[Any], float, bool, bool, dict[str, Any]]:
        """Take one step; see ``gymnasium.Env.step``.

        Raises:
            InvalidAction: If the action has the wrong shape or is not finite.
            ResetNeeded: Before the first ``reset``.
        """
        if not self._ready:
            raise ResetNeeded("call reset before step")
        outcome = self._task.step(checked_actions(np.asarray(action)[None], 1, self._action))
        self._render_window()
        return (
            outcome.observation[0],
            float(outcome.reward[0]),
            bool(outcome.terminated[0]),
            bool(outcome.truncated[0]),
            row(outcome.info),
        )

    def render(self) -> Frame | None:
        """The picture for ``rgb_array``, shape (540, 960, 3), uint8, else None."""
        if self.render_mode is None:
            gym.logger.warn("render needs a render_mode: gymnasium.make(..., render_mode='rgb_array')")
        if self.render_mode != "rgb_array":
            return None
        return self._task.frame(0)

    def get_state(self) -> dict[str, Any]:
        """Snapshot of all that the future depends on: arrays and plain numbers, no pickle needed."""
        return {**self._task.state(), "generators": [self.np_random.bit_generator.state]}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Return to a snapshot; what follows is equal to the bit.

        Raises:
            ValueError: If it is no snapshot, or one of another number of environments.
        """
        self._task.set_state(state)
        self.np_random.bit_generator.state = state["generators"][0]
        self._ready = True

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()
            self._window = None

    def _render_window(self) -> None:
        if self.render_mode != "human":
            return
        from fieldgym.rendering.canvas import Window

        if self._window is None:
            self._window = Window(f"fieldgym: {self.title}")
        for frame in self._window_frames():
            self._window.show(frame, self.window_fps or self.metadata["render_fps"])

    def _window_frames(self) -> Iterator[Frame]:
        """What the window shows after a step."""
        yield self._task.frame(0)


class TaskVectorEnv(VectorEnv[NDArray[Any], NDArray[np.float32], NDArray[Any]]):
    """A task's native vector environment; each row is the scalar environment to the bit.

    A finished episode restarts in the next step (``AutoresetMode.NEXT_STEP``, as in Gymnasium's own vector
    environments): that step ignores the row's action and returns its first observation and a reward of 0.
    An entry of ``info`` has shape (num_envs, ...); ``info["_key"]`` says in which rows it is valid.

    Attributes:
        batch_task: The task on a batch.
    """

    batch_task: ClassVar[type[BatchTask]]
    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": ["rgb_array"],
        "render_fps": 4,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        settings: Any = None,
        reality: RealityLike = None,
        render_mode: str | None = None,
    ) -> None:
        check_render_mode(render_mode, self.metadata)
        self.num_envs = num_envs
        self.render_mode = render_mode
        self._task = type(self).batch_task(num_envs, settings, reality, render_mode is not None)
        self.settings, self.reality = self._task.settings, self._task.reality
        self._action, self.single_observation_space = self._task.spaces()
        self.single_action_space = self._action
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._generators = [seeding.np_random()[0] for _ in range(num_envs)]
        self._finished = np.zeros(num_envs, dtype=np.bool_)
        self._ready = False

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[NDArray[Any], dict[str, Any]]:
        """Begin an episode in every row.

        Args:
            seed: Row i is seeded with ``seed + i``, or with ``seed[i]``; None continues its generator.
            options: There are none.

        Raises:
            ValueError: If there is not one seed for each environment.
        """
        seeds = row_seeds(seed, self.num_envs)
        super().reset(seed=seeds[0], options=options)
        for i, own in enumerate(seeds):
            if own is not None:
                self._generators[i] = seeding.np_random(own)[0]
        self._task.restart(range(self.num_envs), self._generators)
        self._ready = True
        self._finished[:] = False
        return self._task.observation(), masked(
            self._task.reset_info(), np.ones(self.num_envs, dtype=np.bool_)
        )

    def step(self, actions: NDArray[np.float32]) -> tuple[NDArray[Any], Floats, Flags, Flags, dict[str, Any]]:
        """Take one step in every row, or begin the next episode where the last one is over.

        Raises:
            InvalidAction: If the actions have the wrong shape or are not finite.
            ResetNeeded: Before the first ``reset``.
        """
        if not self._ready:
            raise ResetNeeded("call reset before step")
        outcome = self._task.step(checked_actions(np.asarray(actions), self.num_envs, self._action))
        begun = self._finished
        if not begun.any():
            self._finished = outcome.terminated | outcome.truncated
            info = masked(outcome.info, ~begun)
            return outcome.observation, outcome.reward, outcome.terminated, outcome.truncated, info
        rows = np.flatnonzero(begun)
        self._task.restart(rows.tolist(), [self._generators[i] for i in rows])
        info = merged(masked(outcome.info, ~begun), masked(self._task.reset_info(), begun))
        reward = np.where(begun, 0.0, outcome.reward)
        terminated, truncated = outcome.terminated & ~begun, outcome.truncated & ~begun
        self._finished = terminated | truncated
        return self._task.observation(), reward, terminated, truncated, info

    def render(self) -> tuple[Frame, ...] | None:
        """One picture for each row, shape (540, 960, 3), uint8; None without ``rgb_array``."""
        if self.render_mode is None:
            gym.logger.warn("render needs a render_mode: gymnasium.make_vec(..., render_mode='rgb_array')")
            return None
        return tuple(self._task.frame(i) for i in range(self.num_envs))

    def get_state(self) -> dict[str, Any]:
        """Snapshot of all that the future depends on: arrays and plain numbers, no pickle needed."""
        return {
            **self._task.state(),
            "generators": [generator.bit_generator.state for generator in self._generators],
            "finished": self._finished.copy(),
        }

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Return to a snapshot; what follows is equal to the bit.

        Raises:
            ValueError: If it is no snapshot, or one of another number of environments.
        """
        self._task.set_state(state)
        for generator, own in zip(self._generators, state["generators"], strict=True):
            generator.bit_generator.state = own
        self._finished = np.array(state["finished"], dtype=np.bool_)
        self._ready = True
