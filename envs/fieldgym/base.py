"""What every environment over a batch kernel has in common: a scalar and a native vector form of one task.

A task writes its `BatchTask`, the task on a batch of robots, and derives its two environments from `TaskEnv`
and `TaskVectorEnv`; the scalar one is the batch of one.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from copy import copy
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import InvalidAction, ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from fieldgym.info import InfoLike, complete, merged, row
from fieldgym.randomisation import EpisodeParameters
from fieldgym.stock import ConfiguredModel, configure_model
from fieldmodels.compiled import allocation_free
from fieldmodels.drivers.stepped import Channels, Stepped
from fieldmodels.model import Model
from fieldmodels.reality import Reality
from fieldmodels.sampling import Sampler

if TYPE_CHECKING:
    from fieldgym.rendering.canvas import Frame, Window

RealityLike = Reality | Mapping[str, Any] | str | Path | None
Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Box = gym.spaces.Box
VectorStep = tuple[NDArray[Any], Floats, Flags, Flags, dict[str, Any]]
FLOAT32 = np.dtype(np.float32)
NO_OPTIONS: Mapping[str, Any] = MappingProxyType({})


class Outcome(NamedTuple):
    """One step of a batch: arrays of shape (batch, ...) that nothing is written to later."""

    observation: NDArray[Any]
    reward: Floats
    terminated: Flags
    truncated: Flags
    info: InfoLike


class BatchTask(ABC):
    """A task on a batch.

    Attributes:
        settings: The task's settings.
        reality: What the simulation truly is.
        drawn: What of both is drawn for each episode.
        metadata: What an environment's metadata hold of these settings, beside what all have.
        channels: Which of its model's signals it commands and measures: where stock effects can act.
        stock: The stock effects that the reality puts there; None if it names none.
        options: Names of the options that ``reset`` takes.
        keyed_once: True if one key serves all episodes of a row's generator, not one each.
        longest: The setting that is the most steps of an episode.
        simulated: What simulates the rows, by default told their keys, parameters and threads.
    """

    settings: Any
    reality: Reality
    drawn: EpisodeParameters
    metadata: Mapping[str, Any] = NO_OPTIONS
    channels: ClassVar[Channels] = Channels()
    stock: Stepped | None = None
    options: ClassVar[tuple[str, ...]] = ()
    keyed_once: ClassVar[bool] = False
    longest: ClassVar[str] = ""
    simulated: Any

    @abstractmethod
    def __init__(self, batch: int, settings: Any, reality: RealityLike, drawing: bool) -> None:
        """Make a batch; ``drawing`` says whether pictures will be asked for."""

    def configure(
        self,
        batch: int,
        reality: RealityLike,
        samplers: Mapping[str, Sampler],
        model: Model,
        step: float,
        model_of: Callable[[Any], Model] | None = None,
    ) -> ConfiguredModel:
        """Take over a reality and what is drawn; see `configure_model` and `EpisodeParameters`."""
        truth = configure_model(reality, model, self.channels, batch, step)
        self.reality, self.stock = truth.reality, truth.stock
        around = model_of and (lambda own: truth.around(model_of(own)))
        self.drawn = EpisodeParameters(batch, truth.model, self.reality, self.settings, samplers, around)
        return truth

    @abstractmethod
    def spaces(self) -> tuple[Box, Box]:
        """Action and observation space of one environment."""

    def use_threads(self, threads: int) -> None:
        """Let rows advance on threads, side by side and equal to the bit, where that is faster."""
        if hasattr(self.simulated, "threads"):  # most kernels take less than a thread's start
            self.simulated.threads = threads

    @property
    def most_steps(self) -> int:
        """Most steps that an episode can have, whatever is drawn."""
        return int(self.largest(self.longest))

    def largest(self, setting: str) -> float:
        """Largest value that a setting, or a property of the settings, can have in an episode."""
        return float(max(getattr(one, setting) for one in self.drawn.extremes()))

    def restart(
        self,
        rows: list[int],
        generators: Sequence[np.random.Generator],
        fresh: Collection[int] = (),
        options: Mapping[str, Any] = NO_OPTIONS,
    ) -> None:
        """Begin new episodes of some rows.

        Args:
            rows: Their numbers.
            generators: The generator of each of them.
            fresh: Those that have just been given a new generator.
            options: Of ``reset``, see ``begin_with``.
        """
        for i, generator in zip(rows, generators, strict=True):
            if not self.keyed_once or i in fresh:
                self.draw_key(i, generator)
        self.redraw(rows, generators)
        if options:
            self.begin_with(rows, options)
        else:
            self.begin(rows)

    def redraw(self, rows: list[int], generators: Sequence[np.random.Generator]) -> None:
        """Draw what is random of some rows' next episodes, and put it in force."""
        if self.drawn.random:
            self.drawn.draw(rows, generators)
            self.set_drawn(rows)

    def set_drawn(self, rows: list[int]) -> None:
        """Put in force what has been drawn for some rows."""
        if self.drawn.parameters_random:
            vectors = self.drawn.vectors[rows]
            if self.stock is not None:
                self.stock.set_parameters(rows, vectors)
                vectors = vectors[:, : self.stock.own]
            self.set_reality(rows, vectors)
        if self.drawn.settings_random:
            for i in rows:
                self.set_settings(i, self.drawn.settings[i])

    def set_reality(self, rows: list[int], vectors: Floats) -> None:
        """Give some rows other true parameters, shape (len(rows), n), before their next episode."""
        self.simulated.set_reality(rows, vectors)

    def resume(self, rows: list[int], vectors: Floats) -> None:
        """Put in force what time had made of the parameters of some rows, shape (len(rows), n)."""
        self.set_reality(rows, vectors)

    def set_settings(self, row: int, settings: Any) -> None:
        """Give one row other settings before its next episode; only those that may be drawn differ."""
        raise NotImplementedError

    def draw_key(self, row: int, generator: np.random.Generator) -> None:
        """Draw the key of a row's noise, and all else that the task draws from its generator."""
        self.simulated.seed(row, generator)

    @abstractmethod
    def begin(self, rows: list[int]) -> None:
        """Begin new episodes of some rows, whose keys have been drawn."""

    def begin_with(self, rows: list[int], options: Mapping[str, Any]) -> None:
        """As ``begin``, with options of ``reset`` whose names are among ``options``."""
        raise NotImplementedError

    @abstractmethod
    def observation(self) -> NDArray[Any]:
        """Observations of the batch, shape (batch, ...)."""

    @abstractmethod
    def reset_info(self) -> InfoLike:
        """The info that ``reset`` returns."""

    @abstractmethod
    def step(self, actions: NDArray[Any]) -> Outcome:
        """Take every row one step on; actions have been checked, shape (batch, ...), float64."""

    def advance(
        self, actions: NDArray[Any], begin: Flags, generators: Sequence[np.random.Generator]
    ) -> VectorStep:
        """Take every row one step on, or into its next episode: its action is ignored, its reward 0.

        Args:
            actions: As for ``step``.
            begin: Rows that begin an episode, shape (batch,).
            generators: The generator of every row.

        Returns:
            What ``step`` of a vector environment returns.
        """
        observation, reward, terminated, truncated, info = self.step(actions)
        if not begin.any():
            return observation, reward, terminated, truncated, complete(info, len(begin))
        rows = np.flatnonzero(begin).tolist()
        self.restart(rows, [generators[i] for i in rows])
        return (
            self.observation(),
            np.where(begin, 0.0, reward),
            terminated & ~begin,
            truncated & ~begin,
            merged(info, self.reset_info(), begin),
        )

    @abstractmethod
    def state(self) -> dict[str, Any]:
        """Everything that the next steps depend on but the random generators."""

    @abstractmethod
    def set_state(self, state: Mapping[str, Any]) -> None:
        """Return to a snapshot that has the entries of ``state``, and as many rows.

        Raises:
            ValueError: If an entry does not fit.
        """

    def snapshot(self) -> dict[str, Any]:
        """The state, what has been drawn, and what stock effects remember."""
        return {**self.state(), **self.drawn.state(), **(self.stock.state() if self.stock else {})}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Return to an environment's snapshot, whose entries have been checked."""
        rows = list(range(len(state["generators"])))
        if self.drawn.random:
            self.drawn.set_state(state)
            self.set_drawn(rows)
        if self.stock is not None:
            self.stock.set_state(state)
            if self.stock.moves:
                self.resume(rows, self.stock.current)
        self.set_state({key: state[key] for key in self.state()})

    @abstractmethod
    def frame(self, i: int) -> Frame:
        """Draw one environment."""


@allocation_free
def clip(actions: NDArray[Any], low: Floats, high: Floats, copy: Floats) -> bool:
    """Copy actions within bounds; shape (batch, numbers), the bounds (numbers,).

    Returns:
        Whether all actions are finite numbers.
    """
    for i in range(len(actions)):
        for j in range(len(low)):
            value = float(actions[i, j])
            if not math.isfinite(value):
                return False
            copy[i, j] = min(max(value, low[j]), high[j])
    return True


class OfTask:
    """What a task's scalar and vector environment share.

    It ends its episodes itself, and says in its ``spec`` after how many steps at most: the registry's entry
    has no ``max_episode_steps``, since that depends on the settings, and ``gymnasium.make`` would put a time
    limit of its own around the environment.

    It pickles as what it was made from and the state in which it stands, and goes on identically elsewhere;
    what only pictures remember, such as the way so far, begins anew there.

    Attributes:
        batch_task: The task on a batch.
    """

    batch_task: ClassVar[type[BatchTask]]
    metadata: dict[str, Any]
    render_mode: str | None
    _generators: list[np.random.Generator]
    _task: BatchTask
    _ready: bool
    _spec: EnvSpec | None = None
    _window: Window | None = None

    def _begin(
        self, rows: int, settings: Any, reality: RealityLike, render_mode: str | None
    ) -> tuple[Box, Box]:
        """Make the task for so many rows; return its action and observation space."""
        check_render_mode(render_mode, self.metadata)
        self.render_mode = render_mode
        self._rows, self._given = rows, settings
        self._task = self._make_task(reality)
        self.settings, self.reality = self._task.settings, self._task.reality
        self.metadata = {**self.metadata, **self._task.metadata}
        self._ready, self._finished = False, np.zeros(rows, dtype=np.bool_)
        action, observation = self._task.spaces()
        self._checked = ActionCheck(rows, action)
        return action, observation

    def _make_task(self, reality: RealityLike) -> BatchTask:
        return type(self).batch_task(self._rows, self._given, reality, self.render_mode is not None)

    def __getstate__(self) -> dict[str, Any]:
        kept = {key: value for key, value in vars(self).items() if key not in ("_task", "_window")}
        return kept | {"stands": self.get_state() if self._ready else None}

    def __setstate__(self, kept: Mapping[str, Any]) -> None:
        vars(self).update(kept)
        stands = vars(self).pop("stands")
        self._task = self._make_task(self.reality)
        if stands is not None:
            self._task.restore(stands)

    def get_state(self) -> dict[str, Any]:
        """Snapshot of all that the future depends on: arrays and plain numbers, no pickle needed."""
        return {
            **self._task.snapshot(),
            "generators": [generator.bit_generator.state for generator in self._generators],
            "finished": self._finished.copy(),
        }

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Return to a snapshot; what follows is equal to the bit.

        Raises:
            ValueError: If it is no snapshot, or one of another number of environments.
        """
        check_state(state, self.get_state())
        self._task.restore(state)
        for generator, own in zip(self._generators, state["generators"], strict=True):
            generator.bit_generator.state = own
        self._finished = np.array(state["finished"], dtype=np.bool_)
        self._ready = True

    @property
    def spec(self) -> EnvSpec | None:
        """What the environment was made from, with the ``max_episode_steps`` of its settings."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = None if spec is None else copy(spec)
        if self._spec is not None:
            self._spec.max_episode_steps = self._task.most_steps


class ActionCheck:
    """Actions within the bounds of their space, as the tasks take them."""

    def __init__(self, batch: int, space: Box) -> None:
        """Take the bounds of one environment's action space, of shape (numbers,)."""
        self._shape = (batch, *space.shape)
        self._low, self._high = space.low.astype(np.float64), space.high.astype(np.float64)

    def __call__(self, actions: Any) -> Floats:
        """Clip a batch of actions.

        Returns:
            Actions, shape (batch, numbers), float64.

        Raises:
            InvalidAction: If they have the wrong shape or are not finite numbers.
        """
        values = actions
        if type(values) is not np.ndarray or values.dtype is not FLOAT32:
            try:
                values = np.asarray(actions, dtype=np.float64)
            except (TypeError, ValueError):
                raise InvalidAction(f"actions must be finite numbers, not {actions!r:.80}") from None
        if values.shape != self._shape:
            batch, *own = self._shape
            if values.shape[:1] != (batch,):
                raise InvalidAction(f"actions of shape {self._shape} are needed, not {values.shape}")
            raise InvalidAction(f"an action of shape {tuple(own)} is needed, not {values.shape[1:]}")
        checked = np.empty(values.shape)
        if not clip(values, self._low, self._high, checked):
            raise InvalidAction(f"actions must be finite numbers, not {actions}")
        return checked


def check_state(state: Mapping[str, Any], own: Mapping[str, Any]) -> None:
    """Make sure that a mapping is a snapshot like an environment's own.

    Raises:
        ValueError: If it is not one, or one of another number of environments.
    """
    if not set(own) <= set(state):
        raise ValueError("not a snapshot of this environment; get_state makes one")
    if set(state) - set(own):
        extra = ", ".join(sorted(set(state) - set(own)))
        raise ValueError(f"the snapshot is of an environment with other effects or samplers: it has {extra}")
    count = len(state["generators"])
    if count != len(own["generators"]):
        raise ValueError(f"the state is one of {count} environments; make it with that num_envs")


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


def reset_mask(mask: Any, count: int) -> Flags:
    """Rows that a reset begins, shape (count,); all of them without a mask.

    Raises:
        ValueError: If it is not such an array, or names no row.
    """
    if mask is None:
        return np.ones(count, dtype=np.bool_)
    if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (count,) or not mask.any():
        raise ValueError(
            f"reset_mask must be a bool array of shape ({count},) that names a row, not {mask!r}"
        )
    return mask


def checked_options(options: Mapping[str, Any] | None, known: Sequence[str]) -> Mapping[str, Any]:
    """Options of a reset.

    Raises:
        ValueError: If there is one that the environment does not have.
    """
    unknown = sorted(set(options or ()) - set(known))
    if unknown:
        has = f"the option {', '.join(map(repr, known))} only" if known else "no options"
        raise ValueError(f"reset of this environment has {has}, not {', '.join(map(repr, unknown))}")
    return options or NO_OPTIONS


def check_render_mode(mode: str | None, metadata: Mapping[str, Any]) -> None:
    """Raise ValueError for a render mode that an environment does not have."""
    if mode is not None and mode not in metadata["render_modes"]:
        raise ValueError(f"render_mode {mode!r} is not one of {metadata['render_modes']} or None")


class TaskEnv(OfTask, gym.Env[NDArray[Any], NDArray[Any]]):
    """A task's scalar environment: a batch of one.

    Attributes:
        title: Title of the window.
        window_fps: Most frames a second in a window; 0 for as many as ``metadata`` says.
    """

    title: str
    window_fps: ClassVar[float] = 0.0

    def __init__(
        self, settings: Any = None, reality: RealityLike = None, render_mode: str | None = None
    ) -> None:
        self.action_space, self.observation_space = self._begin(1, settings, reality, render_mode)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[Any], dict[str, Any]]:
        """Begin an episode; see ``gymnasium.Env.reset``.

        Args:
            seed: Seeds the environment's generator; None goes on with it.
            options: Those that the task's page names.

        Raises:
            ValueError: If the task has no such option, or its value is not possible.
        """
        chosen = checked_options(options, self._task.options)
        super().reset(seed=seed, options=options)
        fresh = (0,) if seed is not None or not self._ready else ()
        self._task.restart([0], [self.np_random], fresh, chosen)
        self._ready, self._finished[0] = True, False
        self._render_window()
        return self._task.observation()[0], row(self._task.reset_info())

    def step(self, action: NDArray[Any]) -> tuple[NDArray[Any], float, bool, bool, dict[str, Any]]:
        """Take one step; see ``gymnasium.Env.step``.

        After the end of an episode this warns, as Gymnasium's own environments do, and what it returns has no
        meaning.

        Raises:
            InvalidAction: If the action has the wrong shape or is not finite.
            ResetNeeded: Before the first ``reset``.
        """
        if not self._ready:
            raise ResetNeeded("call reset before step")
        if self._finished[0]:
            gym.logger.warn("the episode is over: call reset before the next step, whose result is undefined")
        observation, reward, ended, cut, info = self._task.step(self._checked(np.asarray(action)[None]))
        if self.render_mode == "human":
            self._render_window()
        terminated, truncated = ended.item(), cut.item()
        self._finished[0] = terminated or truncated
        return observation[0], reward.item(), terminated, truncated, row(info)

    def render(self) -> Frame | None:
        """The picture for ``rgb_array``, shape (540, 960, 3), uint8, else None."""
        if self.render_mode is None:
            gym.logger.warn("render needs a render_mode: gymnasium.make(..., render_mode='rgb_array')")
        if self.render_mode != "rgb_array":
            return None
        return self._task.frame(0)

    @property
    def _generators(self) -> list[np.random.Generator]:  # type: ignore[override]
        return [self.np_random]

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


class TaskVectorEnv(OfTask, VectorEnv[NDArray[Any], NDArray[np.float32], NDArray[Any]]):
    """A task's native vector environment; each row is the scalar environment to the bit.

    An entry of ``info`` has shape (num_envs, ...); ``info["_key"]`` says in which rows it is valid.
    What a step returns is never written to again.

    Args:
        num_envs: Number of rows.
        settings: As the scalar environment takes them.
        reality: Likewise.
        render_mode: None or ``rgb_array``: ``render`` then returns one frame for each row.
        threads: Used where steps are long: HeelStrike, Excitation, UavRoute.
        autoreset_mode: When a row whose episode is over begins the next one, as Gymnasium's own vector
            environments do it (https://farama.org/Vector-Autoreset-Mode). ``NEXT_STEP``: the next step
            ignores the row's action and returns its first observation and a reward of 0. ``SAME_STEP``: the
            step that ends the episode returns the first observation of the next one, and in
            ``info["final_obs"]`` and ``info["final_info"]`` what was last seen and told. ``DISABLED``: by
            ``reset`` with a ``reset_mask``, before the next step.

    Raises:
        ValueError: For a mode that there is not, or less than one thread.
    """

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
        threads: int = 1,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    ) -> None:
        if threads < 1:
            raise ValueError(f"threads={threads}: one is the least")
        self.num_envs = num_envs
        self._threads = threads
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.single_action_space, self.single_observation_space = self._begin(
            num_envs, settings, reality, render_mode
        )
        self.metadata["autoreset_mode"] = self.autoreset_mode
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._generators = [seeding.np_random()[0] for _ in range(num_envs)]

    def _make_task(self, reality: RealityLike) -> BatchTask:
        task = super()._make_task(reality)
        task.use_threads(self._threads)
        return task

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[NDArray[Any], dict[str, Any]]:
        """Begin an episode in every row.

        Args:
            seed: Row i is seeded with ``seed + i``, or with ``seed[i]``; None continues its generator.
            options: Those that the task's page names, and ``reset_mask`` as in Gymnasium's own vector
                environments: the rows that begin, shape (num_envs,), bool. The others stay as they are.

        Raises:
            ValueError: If there is not one seed for each environment, the task has no such option, or its
                value is not possible.
            ResetNeeded: With a ``reset_mask`` that leaves rows out before all have begun.
        """
        options = dict(options or {})
        begun = reset_mask(options.pop("reset_mask", None), self.num_envs)
        chosen = checked_options(options, self._task.options)
        seeds = row_seeds(seed, self.num_envs)
        if not (self._ready or begun.all()):
            raise ResetNeeded("call reset for all rows before resetting some of them")
        super().reset(seed=seeds[0], options=options)
        rows = np.flatnonzero(begun).tolist()
        fresh = [i for i in rows if seeds[i] is not None or not self._ready]
        for i in rows:
            if seeds[i] is not None:
                self._generators[i] = seeding.np_random(seeds[i])[0]
        self._task.restart(rows, [self._generators[i] for i in rows], set(fresh), chosen)
        self._ready = True
        self._finished = self._finished & ~begun
        return self._task.observation(), merged({}, self._task.reset_info(), begun)

    def step(self, actions: NDArray[np.float32]) -> VectorStep:
        """Take one step in every row; see ``autoreset_mode`` for those whose episode is over.

        Raises:
            InvalidAction: If the actions have the wrong shape or are not finite.
            ResetNeeded: Before the first ``reset``; and with ``AutoresetMode.DISABLED`` where a row's episode
                is over.
        """
        if not self._ready:
            raise ResetNeeded("call reset before step")
        checked = self._checked(actions)
        if self.autoreset_mode is AutoresetMode.NEXT_STEP:
            stepped = self._task.advance(checked, self._finished, self._generators)
            self._finished = stepped[2] | stepped[3]
            return stepped
        if self._finished.any():
            over = np.flatnonzero(self._finished).tolist()
            raise ResetNeeded(f"the episodes of rows {over} are over: reset(options={{'reset_mask': ...}})")
        observation, reward, terminated, truncated, info = self._task.step(checked)
        ended = terminated | truncated
        if self.autoreset_mode is AutoresetMode.DISABLED or not ended.any():
            self._finished = ended if self.autoreset_mode is AutoresetMode.DISABLED else self._finished
            return observation, reward, terminated, truncated, complete(info, self.num_envs)
        rows = np.flatnonzero(ended).tolist()
        self._task.restart(rows, [self._generators[i] for i in rows])
        final = np.full(self.num_envs, None, dtype=object)
        for i in rows:
            final[i] = observation[i]
        return (
            self._task.observation(),
            reward,
            terminated,
            truncated,
            {
                "final_obs": final,
                "_final_obs": ended,
                "final_info": merged({}, info, ended),
                "_final_info": ended,
                **merged(info, self._task.reset_info(), ended),
            },
        )

    def render(self) -> tuple[Frame, ...] | None:
        """One picture for each row, shape (540, 960, 3), uint8; None without ``rgb_array``."""
        if self.render_mode is None:
            gym.logger.warn("render needs a render_mode: gymnasium.make_vec(..., render_mode='rgb_array')")
            return None
        return tuple(self._task.frame(i) for i in range(self.num_envs))
