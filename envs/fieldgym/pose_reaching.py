"""Pose reaching: drive a unicycle to a ball and arrive with the right heading.

Source: A. I. Chaudhry, "Topics in robot locomotion: state estimation and feasible-path generation for
wheeled and legged robots", Cornell University 2015, chapter 5 ("the dissertation"). Figure and section
numbers in this module are that chapter's.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import gymnasium as gym
import numpy as np
from gymnasium.error import InvalidAction, ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass

from fieldgym.base import check_render_mode, row_seeds
from fieldgym.settings import read_settings
from fieldmodels.machines.pose_reaching.batch import Robots, Rules, Score, Tick
from fieldmodels.machines.pose_reaching.dubins import dubins_path
from fieldmodels.machines.pose_reaching.kernel import NUMBERS
from fieldmodels.machines.pose_reaching.model import PoseReaching
from fieldmodels.machines.pose_reaching.parameters import GOAL, LOOSE, STRICT, Limits
from fieldmodels.model import ModelError
from fieldmodels.reality import Reality, read_reality

if TYPE_CHECKING:
    from fieldgym.rendering.canvas import Frame, Window

Observation = NDArray[np.float32]
Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

OBSERVATION_LOW = np.array([-2.5, -1.5, -1, -1, -7, -1, -1], dtype=np.float32)
OBSERVATION_HIGH = np.array([2.5, 1.5, 1, 1, 2, 1, 1], dtype=np.float32)
ARRIVALS = {"strict": STRICT, "loose": LOOSE}


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class PoseReachingSettings:
    """What can be set in ``fieldgym/PoseReaching-v0``.

    Attributes:
        starts: Where episodes begin: ``T1`` on the right half, 0.6 to 1.6 m from the ball, facing it (as
            the source's training paths); ``T2`` on both sides, up to 45 deg off; ``T3`` anywhere in the
            field, with any heading.
        success: ``strict``: within 5 cm of the ball and 10 deg of the heading; ``loose``: 10 cm and 15 deg.
        tick: Time for which a command holds [s].
        timeout: Longest episode [s].
        max_speed: Largest speed [m/s].
        max_rate: Largest turn rate [rad/s].
        walls: ``stop`` holds the robot where it meets a wall until it has turned away; ``slide`` takes only
            the component of its motion that leads into the wall.
        time_cost: Cost of a second.
        success_reward: Reward of arriving.
        progress_reward: Reward of a metre by which the distance to the ball has become shorter; the sum
            over an episode depends on its first and last pose only.
        wall_cost: Cost of driving into a wall.
    """

    starts: Literal["T1", "T2", "T3"] = "T3"
    success: Literal["strict", "loose"] = "strict"
    tick: Annotated[float, Field(ge=0.001, le=1)] = 0.1
    timeout: Annotated[float, Field(gt=0, le=3600)] = 15.0
    max_speed: Annotated[float, Field(gt=0, le=10)] = 1.0
    max_rate: Annotated[float, Field(gt=0, le=30)] = 4.0
    walls: Literal["stop", "slide"] = "stop"
    time_cost: Annotated[float, Field(ge=0, le=1000)] = 1.0
    success_reward: Annotated[float, Field(ge=0, le=1000)] = 10.0
    progress_reward: Annotated[float, Field(ge=0, le=1000)] = 1.0
    wall_cost: Annotated[float, Field(ge=0, le=1000)] = 0.0

    @property
    def rules(self) -> Rules:
        """The rules as the model on the ground floor takes them."""
        return Rules(
            starts=self.starts,
            arrival=ARRIVALS[self.success],
            tick=self.tick,
            timeout=self.timeout,
            walls=self.walls,
            limits=Limits(max_speed=self.max_speed, max_rate=self.max_rate),
            score=Score(
                time=self.time_cost,
                success=self.success_reward,
                progress=self.progress_reward,
                wall=self.wall_cost,
            ),
        )


SettingsLike = PoseReachingSettings | Mapping[str, Any] | None
RealityLike = Reality | Mapping[str, Any] | str | Path | None


class _Play:
    """What the scalar and the vector environment share: the batch of robots, and their pictures."""

    def __init__(self, batch: int, settings: SettingsLike, reality: RealityLike, tracing: bool) -> None:
        self.settings = read_settings(settings, PoseReachingSettings)
        model = PoseReaching()
        self.reality = read_reality(reality, model)
        self.robots = Robots(batch, self.settings.rules, self.reality.vector(model))
        self.ready = False
        self._trails: list[list[Floats]] | None = [[] for _ in range(batch)] if tracing else None
        self._commands = [(0.0, 0.0)] * batch
        self._numbers = np.zeros((len(NUMBERS), batch))
        self._memory: Sequence[Floats] = ()
        self._chosen: Floats | None = None

    def seed(self, i: int, generator: np.random.Generator) -> None:
        """Give one robot a stream of its own."""
        self.robots.seed(i, generator)

    def restart(self, which: Iterable[int], options: Mapping[str, Any] | None) -> Tick:
        """Begin new episodes of some robots."""
        unknown = set(options or {}) - {"pose"}
        if unknown:
            raise ValueError(f"reset has the option 'pose' only, not {sorted(unknown)}")
        rows = list(which)
        self.robots.restart(rows, (options or {}).get("pose"))
        self.ready = True
        tick = self.robots.observe()
        if self._trails is not None:
            self._begin(rows, tick)
        return tick

    def step(self, actions: NDArray[Any], restarting: bool) -> Tick:
        """Take every robot through one tick."""
        if not self.ready:
            raise ResetNeeded("call reset before step")
        batch = len(self.robots)
        try:
            values = np.ascontiguousarray(actions, dtype=np.float32)
        except (TypeError, ValueError):
            raise InvalidAction(f"actions must be finite numbers, not {actions!r:.80}") from None
        if values.shape != (batch, 2):
            if values.shape[:1] != (batch,):
                raise InvalidAction(f"actions of shape ({batch}, 2) are needed, not {values.shape}")
            raise InvalidAction(f"an action of shape (2,) is needed, not {values.shape[1:]}")
        try:
            tick = self.robots.advance(values, restarting)
        except ModelError as error:
            raise InvalidAction(str(error)) from None
        if self._trails is not None:
            self._extend(tick, values)
        return tick

    def info(self, tick: Tick) -> dict[str, Any]:
        """Everything that is told beside the observation, each entry of shape (batch, ...)."""
        entries: dict[str, Any] = dict(zip(NUMBERS, tick.numbers, strict=True))
        entries["pose"] = tick.poses
        entries["privileged"] = {"pose": tick.true_poses}
        return entries

    def single_info(self, tick: Tick) -> dict[str, Any]:
        """The same of the only robot: plain numbers, and arrays without the first axis."""
        entries: dict[str, Any] = dict(zip(NUMBERS, tick.numbers[:, 0].tolist(), strict=True))
        entries["pose"] = tick.poses[0]
        entries["privileged"] = {"pose": tick.true_poses[0]}
        return entries

    def state(self) -> dict[str, Any]:
        """Everything that the next steps depend on."""
        return dict(self.robots.state())

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Return to a snapshot."""
        if "robots" not in state:
            raise ValueError("not a snapshot of this environment; get_state makes one")
        if len(state["robots"]) != len(self.robots):
            raise ValueError(
                f"the state is one of {len(state['robots'])} environments; make it with that num_envs"
            )
        self.robots.set_state(state)
        self.ready = True
        if self._trails is not None:
            self._begin(range(len(self.robots)), self.robots.observe())

    def show(self, memory: Sequence[ArrayLike] | None, chosen: ArrayLike | None) -> None:
        """Take over what is drawn beside the task; see ``PoseReachingEnv.show``."""
        batch = len(self.robots)
        paths = [np.asarray(path, dtype=np.float64) for path in (() if memory is None else memory)]
        for path in paths:
            if path.ndim != 2 or path.shape[1] < 2:
                raise ValueError(f"memory holds paths of shape (points, 2 or more), not {path.shape}")
        states = None if chosen is None else np.asarray(chosen, dtype=np.float64)
        if states is not None and (
            states.ndim not in (1, 2) or states.shape[-1] < 2 or states.shape[:-1] not in ((), (batch,))
        ):
            raise ValueError(f"chosen has shape (2 or more,) or ({batch}, 2 or more), not {states.shape}")
        self._memory = paths
        self._chosen = None if states is None else np.broadcast_to(states, (batch, states.shape[-1]))

    def frame(self, i: int) -> Frame:
        """Draw one robot."""
        from fieldgym.rendering.pose_reaching import Scene, draw

        assert self._trails is not None
        rules, trail = self.robots.rules, np.array(self._trails[i])
        return draw(
            Scene(
                field=rules.field,
                arrival=rules.arrival,
                trail=trail,
                dubins=dubins_path(trail[0], GOAL, rules.limits.radius).sampled(0.02),
                command=self._commands[i],
                limits=rules.limits,
                numbers=dict(zip(NUMBERS, self._numbers[:, i].tolist(), strict=True)),
                memory=self._memory,
                chosen=None if self._chosen is None else self._chosen[i],
            )
        )

    def _begin(self, which: Iterable[int], tick: Tick) -> None:
        """Begin the drawn paths of some robots."""
        assert self._trails is not None
        self._numbers = tick.numbers
        for i in which:
            self._trails[i] = [tick.true_poses[i]]
            self._commands[i] = (0.0, 0.0)

    def _extend(self, tick: Tick, actions: Observation) -> None:
        """Keep what the pictures need of a tick."""
        assert self._trails is not None
        begun = tick.numbers[NUMBERS.index("time")] == 0.0
        self._begin(np.flatnonzero(begun).tolist(), tick)
        limits = self.robots.rules.limits
        for i in np.flatnonzero(~begun).tolist():
            self._trails[i].append(tick.true_poses[i])
            speed, rate = np.clip(actions[i], -1.0, 1.0).tolist()
            self._commands[i] = (0.5 * limits.max_speed * (1.0 + speed), limits.max_rate * rate)


class PoseReachingEnv(gym.Env[Observation, NDArray[np.float32]]):
    r"""Drive a unicycle to a ball and arrive with the right heading.

    ## Description

    A robot drives forwards on a walled field of 5 x 3 m, as a small robot of the RoboCup league. The ball
    lies at the center, the origin; the robot must reach it facing +y, "up" in the source's figures. It is
    the unicycle of section 5.1.4 of A. I. Chaudhry, "Topics in robot locomotion", Cornell University 2015,
    chapter 5:

    - dx/dt = *v* cos θ, dy/dt = *v* sin θ, dθ/dt = *ω*, with commanded *v* and *ω*.

    The source drives it by recalling the commands of remembered paths; here anything may drive it. Speed
    and turn rate hold for one `tick` of 0.1 s; between ticks the robot drives exact arcs.

    ## Action Space

    `Box(-1, 1, (2,), float32)`. Values outside are clipped; others than finite numbers are refused
    (`InvalidAction`).

    | Num | Action | -1 | 0 | +1 |
    |-----|--------|----|---|----|
    | 0 | speed *v* | 0 | 0.5 m/s | 1 m/s (`max_speed`) |
    | 1 | turn rate *ω* | -4 rad/s, to the right | 0 | 4 rad/s, to the left (`max_rate`) |

    ## Observation Space

    `Box(low, high, (7,), float32)`, without noise.

    | Num | Observation | Unit | Min | Max |
    |-----|-------------|------|-----|-----|
    | 0 | x, the ball at 0 | m | -2.5 | 2.5 |
    | 1 | y | m | -1.5 | 1.5 |
    | 2 | cosine of the heading θ, counter-clockwise from +x | 1 | -1 | 1 |
    | 3 | sine of the heading | 1 | -1 | 1 |
    | 4 | natural logarithm of the distance to the ball, from 1 mm | log m | -7 | 2 |
    | 5 | cosine of the angle from the heading to the ball | 1 | -1 | 1 |
    | 6 | sine of the same, positive where the ball is to the left | 1 | -1 | 1 |

    ## Rewards

    `success_reward` on arrival, less `time_cost` a second, plus `progress_reward` for each metre by which
    the distance to the ball has become shorter, less `wall_cost` each time the robot drives into a wall.
    Progress is a potential's difference: its sum over an episode depends on the first and last pose only,
    so among paths that arrive the quickest is still the best.

    `info` holds after each step, and after `reset`

    | Key | Meaning |
    |-----|---------|
    | `success` | 1 if the robot has just arrived, else 0 |
    | `time` | since the start of the episode [s]; ends with the instant of arrival |
    | `path_length` | driven since then [m] |
    | `dubins_length` | of the shortest path from start to goal pose with turns of 0.3 m, without walls [m] |
    | `dubins_time` | the time that it takes at `max_speed` [s] |
    | `wall_hits` | how often the robot has driven into a wall |
    | `pose` | x, y [m] and heading [rad], what the observation is made of |
    | `privileged` | `pose`: the same as it is, which differs where a `reality` has a faulty sensor |

    ## Starting State

    Drawn by `starts`; one in the goal itself is drawn anew. Starts depend on the seed alone.

    | Starts | Position | Heading |
    |--------|----------|---------|
    | `T1` | right half, 0.6 to 1.6 m from the ball, within the field | to the ball (section 5.3.2) |
    | `T2` | both halves, the same distances | up to 45 deg off the ball |
    | `T3` | anywhere in the field | any |

    `reset(options={"pose": (x, y, heading)})` starts there instead.

    ## Episode End

    Terminated when the robot arrives: at one instant within 5 cm of the ball and 10 deg of the heading +y
    (`success="loose"`: 10 cm and 15 deg). Instants are at most 10 ms apart, whatever the tick; the
    episode's last pose is the one at that instant. Truncated after `timeout`. A wall does not end an
    episode.

    ## Arguments

    ```python
    import gymnasium as gym
    import fieldgym  # registers the environments

    gym.make(
        "fieldgym/PoseReaching-v0",
        settings={"starts": "T1", "success": "loose"},
        reality={"actuator_lag": {"time_constant": 0.1}},
        render_mode="rgb_array",
    )
    gym.make_vec("fieldgym/PoseReaching-v0", num_envs=1024)  # native: one kernel, same bits
    ```

    - `settings`: a `PoseReachingSettings` or a mapping of some of its fields; unknown keys are refused.
    - `reality`: what the simulation truly is: effects of the model `pose_reaching`, the path of an
      `extended.yaml` that a diagnosis wrote, or None for the nominal simulation.
    - `render_mode`: `rgb_array` (960 x 540) or `human`. `show(memory=..., chosen=...)` of the unwrapped
      environment has an agent's remembered paths, and the state it acts on, drawn beside the task.

    `get_state` and `set_state` save and restore everything, to the bit.

    ## Matches, deviates, assumed

    - **Matches** the source: kinematics (section 5.1.4); a field of 5 x 3 m with the ball at its center
      (section 5.3.2); arrival facing up, ψ_f of 90 deg (Fig 5.1); the starts `T1`, on the right side and
      facing the ball (section 5.3.2).
    - **Deviates**: the source gives its method distance, heading and heading offset, in coordinates at the
      ball; here the observation has more than one needs. Its command *ω* is called a velocity rotation
      and then behaves like a direction; here it is a turn rate.
    - **Assumed**: limits of speed and turn rate; when the robot has arrived (the source shows pictures, no
      numbers); walls at the field's edges; the robot as a point; starts `T2`, `T3`; tick, timeout, reward.

    ## Version History

    - v0: first version
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 10}  # noqa: RUF012

    def __init__(
        self,
        settings: SettingsLike = None,
        reality: RealityLike = None,
        render_mode: str | None = None,
    ) -> None:
        check_render_mode(render_mode, self.metadata)
        self.render_mode = render_mode
        self._play = _Play(1, settings, reality, tracing=render_mode is not None)
        self.settings = self._play.settings
        self.reality = self._play.reality
        self.metadata = {**self.metadata, "render_fps": max(1, round(1 / self.settings.tick))}
        self.action_space, self.observation_space = _spaces()
        self._window: Window | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode; see ``gymnasium.Env.reset``.

        Args:
            seed: Seeds the robot's stream of starts; None goes on with it.
            options: ``{"pose": (x, y, heading)}`` starts there [m, m, rad] instead of at a drawn start.

        Raises:
            ValueError: If there is another option, or the pose is not one in the field.
        """
        super().reset(seed=seed, options=options)
        if seed is not None or not self._play.robots.seeded[0]:
            self._play.seed(0, self.np_random)
        tick = self._play.restart([0], options)
        self._show_window()
        return tick.observed[0], self._play.single_info(tick)

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Drive for one tick; see ``gymnasium.Env.step``.

        Raises:
            InvalidAction: If the action has the wrong shape or is not finite.
            ResetNeeded: Before the first ``reset``.
        """
        tick = self._play.step(np.asarray(action)[None], restarting=False)
        self._show_window()
        return (
            tick.observed[0],
            float(tick.reward[0]),
            bool(tick.success[0]),
            bool(tick.late[0]),
            self._play.single_info(tick),
        )

    def show(self, memory: Sequence[ArrayLike] | None = None, chosen: ArrayLike | None = None) -> None:
        """Draw what an agent remembers beside the task, until the next call; no arguments: nothing.

        Args:
            memory: Remembered paths, each of shape (points, 2 or more): x [m], y [m], ...
            chosen: The remembered state that the agent acts on, shape (2 or more,): x [m], y [m], ...

        Raises:
            ValueError: If a shape is wrong.
        """
        self._play.show(memory, chosen)

    def render(self) -> Frame | None:
        """The picture for ``rgb_array``, shape (540, 960, 3), uint8, else None."""
        if self.render_mode is None:
            gym.logger.warn("render needs a render_mode: gymnasium.make(..., render_mode='rgb_array')")
        if self.render_mode != "rgb_array":
            return None
        return self._play.frame(0)

    def get_state(self) -> dict[str, Any]:
        """Snapshot of all that the future depends on: arrays and plain numbers, no pickle needed."""
        return self._play.state()

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Return to a snapshot; what follows is equal to the bit.

        Raises:
            ValueError: If it is no snapshot, or one of another number of environments.
        """
        self._play.set_state(state)

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()
            self._window = None

    def _show_window(self) -> None:
        if self.render_mode != "human":
            return
        from fieldgym.rendering.canvas import Window

        if self._window is None:
            self._window = Window("fieldgym: pose reaching")
        self._window.show(self._play.frame(0), self.metadata["render_fps"])


class PoseReachingVectorEnv(VectorEnv[Observation, NDArray[np.float32], NDArray[Any]]):
    """Many robots in one kernel; each row is ``PoseReachingEnv`` to the bit.

    A finished episode restarts in the next step (``AutoresetMode.NEXT_STEP``, as in Gymnasium's own vector
    environments): that step ignores the row's action and returns its first observation and a reward of 0.
    An entry of ``info`` has shape (num_envs, ...) and holds for every row: its mask ``info["_key"]`` is
    always True. What a step returns is never written to again.

    Args:
        num_envs: Number of robots.
        settings: See ``PoseReachingEnv``.
        reality: See ``PoseReachingEnv``.
        render_mode: None or ``rgb_array``: ``render`` then returns one frame for each robot.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": ["rgb_array"],
        "render_fps": 10,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        settings: SettingsLike = None,
        reality: RealityLike = None,
        render_mode: str | None = None,
    ) -> None:
        check_render_mode(render_mode, self.metadata)
        self.num_envs = num_envs
        self.render_mode = render_mode
        self._play = _Play(num_envs, settings, reality, tracing=render_mode is not None)
        self.settings = self._play.settings
        self.reality = self._play.reality
        self.metadata = {**self.metadata, "render_fps": max(1, round(1 / self.settings.tick))}
        self.single_action_space, self.single_observation_space = _spaces()
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        every_row = np.ones(num_envs, dtype=np.bool_)
        every_row.flags.writeable = False
        self._masks = {f"_{key}": every_row for key in (*NUMBERS, "pose", "privileged")}

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode in every row.

        Args:
            seed: Row i is seeded with ``seed + i``, or with ``seed[i]``; None goes on with its stream.
            options: ``{"pose": (x, y, heading)}`` starts there [m, m, rad] instead of at drawn starts; one
                pose, or one for each row.

        Raises:
            ValueError: If there is not one seed for each environment, there is another option, or a pose
                is not one in the field.
        """
        seeds = row_seeds(seed, self.num_envs)
        super().reset(seed=seeds[0], options=options)
        for i, own in enumerate(seeds):
            if own is not None or not self._play.robots.seeded[i]:
                self._play.seed(i, seeding.np_random(own)[0])
        tick = self._play.restart(range(self.num_envs), options)
        return tick.observed, self._info(tick)

    def step(self, actions: NDArray[np.float32]) -> tuple[Observation, Floats, Flags, Flags, dict[str, Any]]:
        """Drive for one tick in every row, or begin the next episode where the last one is over.

        Raises:
            InvalidAction: If the actions have the wrong shape or are not finite.
            ResetNeeded: Before the first ``reset``.
        """
        tick = self._play.step(actions, restarting=True)
        return tick.observed, tick.reward, tick.success, tick.late, self._info(tick)

    def _info(self, tick: Tick) -> dict[str, Any]:
        """Gymnasium's form of a batch's info; every entry is meant in every row, also after a restart."""
        info = self._play.info(tick)
        info["privileged"]["_pose"] = self._masks["_pose"]
        return info | self._masks

    def show(self, memory: Sequence[ArrayLike] | None = None, chosen: ArrayLike | None = None) -> None:
        """As ``PoseReachingEnv.show``; ``chosen`` of shape (2 or more,) or (num_envs, 2 or more)."""
        self._play.show(memory, chosen)

    def render(self) -> tuple[Frame, ...] | None:
        """One picture for each robot, shape (540, 960, 3), uint8; None without ``rgb_array``."""
        if self.render_mode is None:
            gym.logger.warn("render needs a render_mode: gymnasium.make_vec(..., render_mode='rgb_array')")
            return None
        return tuple(self._play.frame(i) for i in range(self.num_envs))

    def get_state(self) -> dict[str, Any]:
        """Snapshot of all that the future depends on: arrays and plain numbers, no pickle needed."""
        return self._play.state()

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Return to a snapshot; what follows is equal to the bit.

        Raises:
            ValueError: If it is no snapshot, or one of another number of environments.
        """
        self._play.set_state(state)


def _spaces() -> tuple[gym.spaces.Box[Any], gym.spaces.Box[Any]]:
    """Action and observation space of one robot."""
    return (
        gym.spaces.Box(-1.0, 1.0, (2,), np.float32),
        gym.spaces.Box(OBSERVATION_LOW, OBSERVATION_HIGH, dtype=np.float32),
    )
