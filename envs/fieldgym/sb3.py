"""Vector environments as Stable-Baselines3 wants them, without copying a step: ``fieldgym.make_sb3_vec``.

Gymnasium's vector environments reset one step late; Stable-Baselines3 expects the first observation of the
next episode from the step that ends one. So the ended rows are reset at once, by ``reset_mask``: every row
that a learner sees is a step that was made.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn

from fieldgym.base import TaskVectorEnv


def make_sb3_vec(env_id: str, num_envs: int = 1, *, seed: int | None = None, **options: Any) -> NativeVecEnv:
    """Make a task's native vector environment as a ``VecEnv`` of Stable-Baselines3.

    What `stable_baselines3.common.env_util.make_vec_env` gives, in one compiled kernel. Episodes are
    monitored: their returns and lengths, and ``is_success`` where a task knows success, are logged.

    Args:
        env_id: As ``gymnasium.make`` takes it, ``fieldgym/PoseReaching-v0``.
        num_envs: Number of rows.
        seed: Row i begins with ``seed + i``; by default what the learner's own seed says.
        options: Of ``gymnasium.make_vec``: ``settings``, ``reality``, ``render_mode``, ``threads``.

    Raises:
        MissingExtraError: Without Stable-Baselines3: ``pip install "fieldgym[train]"``.
        gymnasium.error.Error: For an identifier that there is not.
    """
    part = gym.make_vec(
        env_id, num_envs, "vector_entry_point", autoreset_mode=AutoresetMode.DISABLED, **options
    )
    return NativeVecEnv(part, seed=seed)


class NativeVecEnv(VecEnv):
    """Gymnasium vector environments behind the interface of Stable-Baselines3, as one.

    Args:
        parts: Vector environments of fieldgym, or others whose rows are reset from outside
            (``AutoresetMode.DISABLED``), of equal spaces; their rows one after the other.
        seed: Of the first reset; row i is seeded with ``seed + i // twins``. None for no seed.
        twins: Rows in a group that meets the same starts, truths and noise, and is rewarded for what it does
            better than the group's mean. Where noise does not depend on actions, what luck does to all of
            them says nothing about any of their actions. They begin episodes together: where one's ends, the
            others' are truncated.

    Attributes:
        rows: Which rows each part has.
        first_seed: Of the first reset.
        twins: Rows in a group.
        exact: Whether a state that `get_state` gave leads to the same steps; third-party environments and
            wrappers only say where their generators stand, and begin new episodes.
        infos: What each part last said beside its observations, of the episodes now under way. No learner is
            given it.
        latest: What each row last observed.

    Raises:
        ValueError: If the rows of a part cannot be reset one by one, or the spaces differ.
    """

    def __init__(self, *parts: VectorEnv[Any, Any, Any], seed: int | None, twins: int = 1) -> None:
        for part in parts:
            mode = part.metadata.get("autoreset_mode")
            if mode != AutoresetMode.DISABLED and not isinstance(part.unwrapped, TaskVectorEnv):
                raise ValueError(
                    "training resets the ended rows of a vector environment itself; make this one with"
                    f" autoreset_mode=AutoresetMode.DISABLED, not {mode}"
                )
        first = parts[0]
        for word in ("single_observation_space", "single_action_space"):
            if any(getattr(part, word) != getattr(first, word) for part in parts):
                raise ValueError(f"environments that train one policy need equal spaces: {word} differs")
        if any(part.num_envs % twins for part in parts):
            raise ValueError(
                f"groups of {twins} twins do not divide {[part.num_envs for part in parts]} rows"
            )
        ends = np.cumsum([part.num_envs for part in parts]).tolist()
        self.parts = parts
        self.exact = all(hasattr(part.unwrapped, "get_state") for part in parts)
        self.rows = [slice(end - part.num_envs, end) for part, end in zip(parts, ends, strict=True)]
        self.infos: list[dict[str, Any]] = [{} for _ in parts]
        self.latest: NDArray[Any] = np.zeros(0)
        self.first_seed = seed or 0
        self._seed = self._given = seed
        self.twins = twins
        self._returns = np.zeros(ends[-1])
        self._lengths = np.zeros(ends[-1], dtype=np.int64)
        self._actions: NDArray[Any] | None = None
        super().__init__(ends[-1], first.single_observation_space, first.single_action_space)

    def reset(self) -> NDArray[Any]:
        """Begin new episodes everywhere; the first time from the seed handed in."""
        observations = []
        for i, (part, rows) in enumerate(zip(self.parts, self.rows, strict=True)):
            numbers = (np.arange(rows.start, rows.stop) // self.twins).tolist()
            seeds: Any = None if self._seed is None else [self._seed + number for number in numbers]
            observation, self.infos[i] = part.reset(seed=seeds)
            observations.append(observation)
        self._seed = None
        self._returns[:], self._lengths[:] = 0.0, 0
        self.latest = np.concatenate(observations)
        return self.latest

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Seed the next reset, row i with ``seed + i // twins``, unless the constructor has said a seed.

        A learner with a seed of its own calls this.
        """
        if self._given is None:
            self._seed = seed
        return [None if seed is None else seed + i // self.twins for i in range(self.num_envs)]

    def get_images(self) -> Sequence[NDArray[Any] | None]:
        """A picture of each environment, with ``render_mode="rgb_array"``."""
        return [frame for part in self.parts for frame in cast(Any, part.render()) or [None] * part.num_envs]

    def step_async(self, actions: NDArray[Any]) -> None:
        """Take the actions of the next step."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Step every environment, and begin the next episode of those that have ended.

        Returns:
            Observations, rewards, ends of episodes, and a dict for each environment. It is empty but at an
            end: then it holds what the environment said, ``terminal_observation``, ``TimeLimit.truncated``,
            the ``episode``'s return and length, and ``is_success``.
        """
        assert self._actions is not None
        steps = [self._step(i, self._actions[rows]) for i, rows in enumerate(self.rows)]
        *arrays, told = zip(*steps, strict=True)
        observation, last, reward, terminated, truncated = map(np.concatenate, arrays)
        self._returns += reward
        self._lengths += 1
        ended = terminated | truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for i in np.flatnonzero(ended).tolist():
            infos[i] = self._last_told(told, i) | {
                "terminal_observation": last[i],
                "TimeLimit.truncated": bool(truncated[i] and not terminated[i]),
                "episode": {"r": float(self._returns[i]), "l": int(self._lengths[i])},
            }
        self._returns[ended], self._lengths[ended] = 0.0, 0
        if self.twins > 1:
            groups = reward.reshape(-1, self.twins)
            reward = (groups - groups.mean(axis=1, keepdims=True)).reshape(-1)
        self.latest = observation
        return observation, reward, ended, infos

    def _last_told(self, told: Sequence[dict[str, Any]], i: int) -> dict[str, Any]:
        """What the environment of row i said at the end of its episode."""
        k = next(k for k, rows in enumerate(self.rows) if i < rows.stop)
        own = {key: value[i - self.rows[k].start] for key, value in told[k].items() if key[:1] != "_"}
        return own | ({"is_success": bool(own["success"])} if "success" in own else {})

    def _step(self, i: int, actions: NDArray[Any]) -> tuple[Any, ...]:
        """Step one part: following and last observations, rewards, terminations, truncations, infos."""
        part = self.parts[i]
        last, reward, terminated, truncated, info = part.step(actions)
        self.infos[i] = told = {key: value for key, value in info.items() if not isinstance(value, dict)}
        following, ended = last, np.asarray(terminated | truncated)
        if self.twins > 1 and ended.any():  # or they would never again be in the same episode
            together = ended.reshape(-1, self.twins).any(axis=1).repeat(self.twins)
            truncated, ended = truncated | (together & ~ended), together
        if ended.any():
            first, begun = part.reset(options={"reset_mask": ended.copy()})
            self.infos[i] = _taken_over(told, begun, ended)
            following = np.array(last)
            following[ended] = first[ended]
        return following, last, np.asarray(reward, dtype=np.float64), terminated, truncated, told

    def close(self) -> None:
        """Close the vector environments."""
        for part in self.parts:
            part.close()

    def get_state(self) -> dict[str, Any]:
        """Everything that the next steps depend on, the environments' own state included."""
        return {
            "parts": [self._state_of(part.unwrapped) for part in self.parts],
            "returns": self._returns.copy(),
            "lengths": self._lengths.copy(),
        }

    def _state_of(self, part: Any) -> dict[str, Any]:
        """All of the future of our own environments; of others' where their generators stand."""
        if hasattr(part, "get_state"):
            return dict(part.get_state())
        return {"generators": [env.unwrapped.np_random.bit_generator.state for env in part.envs]}

    def set_state(self, state: dict[str, Any]) -> None:
        """Continue from a state that `get_state` gave."""
        for part, own in zip(self.parts, state["parts"], strict=True):
            inner: Any = part.unwrapped
            if hasattr(inner, "set_state"):
                inner.set_state(own)
            else:
                for env, generator in zip(inner.envs, own["generators"], strict=True):
                    env.unwrapped.np_random.bit_generator.state = generator
        self._returns[:] = state["returns"]
        self._lengths[:] = state["lengths"]
        self._seed = None

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """An attribute of the vector environments, once for each environment asked for."""
        values = [getattr(part, attr_name) for part in self.parts for _ in range(part.num_envs)]
        return [values[i] for i in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Not possible: the environments of a native batch have no attributes of their own."""
        raise NotImplementedError("the environments of a native batch have no attributes of their own")

    def env_method(
        self, method_name: str, *method_args: Any, indices: VecEnvIndices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Not possible: the environments of a native batch have no methods of their own."""
        raise NotImplementedError("the environments of a native batch have no methods of their own")

    def env_is_wrapped(
        self,
        wrapper_class: type[gym.Wrapper],
        indices: VecEnvIndices = None,
    ) -> list[bool]:
        """Whether it is a ``Monitor``, whose work is done; a native batch has no other wrappers."""
        return [issubclass(wrapper_class, Monitor) for _ in self._get_indices(indices)]


def _taken_over(info: dict[str, Any], begun: dict[str, Any], rows: NDArray[np.bool_]) -> dict[str, Any]:
    """An ``info`` with the entries of some rows from another one; what only one of them has stays."""
    result = dict(info)
    for key, value in begun.items():
        if isinstance(value, dict):
            continue
        if key not in info:
            result[key] = value
        else:
            result[key] = np.where(rows.reshape(-1, *[1] * (np.ndim(value) - 1)), value, info[key])
    return result
