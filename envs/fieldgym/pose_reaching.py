"""Pose reaching: drive a unicycle to a ball and arrive with the right heading.

Source: A. I. Chaudhry, "Topics in robot locomotion: state estimation and feasible-path generation for
wheeled and legged robots", Cornell University 2015, chapter 5 ("the dissertation"). Figure and section
numbers in this module are that chapter's.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray
from pydantic import ConfigDict
from pydantic.dataclasses import dataclass

from fieldgym.base import (
    BatchTask,
    Flags,
    Floats,
    Outcome,
    RealityLike,
    TaskEnv,
    TaskVectorEnv,
    VectorStep,
)
from fieldgym.info import Info, complete
from fieldgym.settings import read_random_settings
from fieldmodels.machines.pose_reaching.batch import CHANNELS, Robots, Rules, Tick
from fieldmodels.machines.pose_reaching.dubins import dubins_path
from fieldmodels.machines.pose_reaching.kernel import NUMBERS
from fieldmodels.machines.pose_reaching.model import PoseReaching
from fieldmodels.machines.pose_reaching.parameters import GOAL

if TYPE_CHECKING:
    from fieldgym.rendering.canvas import Frame

OBSERVATION_LOW = np.array([-2.5, -1.5, -1, -1, -7, -1, -1], dtype=np.float32)
OBSERVATION_HIGH = np.array([2.5, 1.5, 1, 1, 2, 1, 1], dtype=np.float32)


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class PoseReachingSettings(Rules):
    """What can be set in ``fieldgym/PoseReaching-v0``: what its robots play."""


class _PoseReachingTask(BatchTask):
    """The task on a batch of robots."""

    settings: PoseReachingSettings
    channels = CHANNELS
    options = ("pose",)
    keyed_once = True

    def __init__(self, batch: int, settings: Any, reality: RealityLike, drawing: bool) -> None:
        self.settings, samplers = read_random_settings(settings, PoseReachingSettings)
        truth = self.configure(batch, reality, samplers, PoseReaching(), self.settings.tick)
        self.simulated = self.robots = Robots(
            batch, self.settings, truth.typical, possible=truth.extremes, stock=truth.stock
        )
        self.metadata = {"render_fps": max(1, round(1 / self.settings.tick))}  # films run in real time
        self._tick: Tick | None = None
        self._trails: list[list[Floats]] | None = [[] for _ in range(batch)] if drawing else None
        self._commands = [(0.0, 0.0)] * batch
        self._memory: Sequence[Floats] = ()
        self._chosen: Floats | None = None
        self._steering = False

    @property
    def most_steps(self) -> int:
        """See ``BatchTask.most_steps``."""
        return math.ceil(self.largest("timeout") / self.settings.tick - 1e-9)

    def spaces(self) -> tuple[Box, Box]:
        """Speed and turn rate, and speed to the left; where the ball is."""
        return (
            Box(-1.0, 1.0, (self.settings.action_count,), np.float32),
            Box(OBSERVATION_LOW, OBSERVATION_HIGH, dtype=np.float32),
        )

    def set_settings(self, row: int, settings: Any) -> None:
        """See ``BatchTask.set_settings``."""
        self.robots.set_rules(row, settings)

    def begin(self, rows: list[int]) -> None:
        """Begin new episodes of some robots, each at the next start of its own stream."""
        self._begin_at(rows, None)

    def begin_with(self, rows: list[int], options: Mapping[str, Any]) -> None:
        """Begin new episodes of some robots at given poses."""
        self._begin_at(rows, options["pose"])

    def _begin_at(self, rows: list[int], poses: ArrayLike | None) -> None:
        self.robots.restart(rows, poses)
        self._tick = None
        self._begin_trails(rows)

    @property
    def tick(self) -> Tick:
        """What is seen of every robot as it stands."""
        if self._tick is None:
            self._tick = self._within(self.robots.observe())
        return self._tick

    def observation(self) -> NDArray[Any]:
        """Pose, distance and direction of the ball."""
        return self.tick.observed

    def reset_info(self) -> Info:
        """The info that ``reset`` returns: the same as after each step."""
        return self._info(self.tick)

    def step(self, actions: Floats) -> Outcome:
        """Drive every robot for one tick."""
        tick = self._seen(self.robots.advance(actions), actions)
        return Outcome(tick.observed, tick.reward, tick.success, tick.late, self._info(tick))

    def advance(self, actions: Floats, begin: Flags, generators: Sequence[np.random.Generator]) -> VectorStep:
        """Drive, and begin the next episode of the robots whose last one is over, in one kernel."""
        if self.drawn.random and begin.any():  # the kernel knows all else that an episode begins with
            rows = np.flatnonzero(begin).tolist()
            self.drawn.draw(rows, [generators[i] for i in rows])
            self.set_drawn(rows)
        tick = self._seen(self.robots.advance(actions, restarting=True), actions)
        info = complete(self._info(tick), len(actions))
        return tick.observed, tick.reward, tick.success, tick.late, info

    def _within(self, tick: Tick) -> Tick:
        """What is observed, within the bounds of its space: a sensor may show a place beyond the walls."""
        if self.stock is not None:
            np.clip(tick.observed, OBSERVATION_LOW, OBSERVATION_HIGH, out=tick.observed)
        return tick

    def _seen(self, tick: Tick, actions: Floats) -> Tick:
        self._tick = self._within(tick)
        if self._trails is not None:
            self._extend_trails(tick, actions)
        return tick

    def _info(self, tick: Tick) -> Info:
        return Info(
            NUMBERS,
            tick.numbers,
            {"pose": tick.poses, "privileged.pose": tick.true_poses, **self.drawn.info},
        )

    def state(self) -> dict[str, Any]:
        """Everything that the next steps depend on but the random generators."""
        return dict(self.robots.state())

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Return to a snapshot; what has been driven before it is not drawn any more."""
        self.robots.set_state(state)
        self._tick = None
        self._begin_trails(range(len(self.robots)))

    def show(
        self, memory: Sequence[ArrayLike] | None, chosen: ArrayLike | None, steering: bool = False
    ) -> None:
        """Take over what is drawn beside the task; see ``PoseReachingEnv.show``."""
        self._steering = steering
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
                field=self.robots.field,
                arrival=rules.arrival,
                trail=trail,
                dubins=dubins_path(trail[0], GOAL, rules.limits.radius).sampled(0.02),
                command=self._commands[i],
                limits=rules.limits,
                numbers=dict(zip(NUMBERS, self.tick.numbers[:, i].tolist(), strict=True)),
                memory=self._memory,
                chosen=None if self._chosen is None else self._chosen[i],
                steering=self._steering,
            )
        )

    def _begin_trails(self, rows: Iterable[int]) -> None:
        """Begin the drawn paths of some robots where they are."""
        if self._trails is None:
            return
        for i in rows:
            self._trails[i] = [self.tick.true_poses[i]]
            self._commands[i] = (0.0, 0.0)

    def _extend_trails(self, tick: Tick, actions: Floats) -> None:
        """Keep what the pictures need of a tick."""
        assert self._trails is not None
        begun = tick.numbers[NUMBERS.index("time")] == 0.0
        self._begin_trails(np.flatnonzero(begun).tolist())
        commands = self.robots.commands(actions)
        for i in np.flatnonzero(~begun).tolist():
            self._trails[i].append(tick.true_poses[i])
            speed, sideways, rate = commands[i].tolist()
            self._commands[i] = (math.hypot(speed, sideways), rate)


class PoseReachingEnv(TaskEnv):
    r"""Drive a unicycle to a ball and arrive with the right heading.

    ## Description

    A robot drives forwards on a walled field of 5 x 3 m. It must reach the ball at the origin, the centre,
    facing +y, "up" in the source's figures. It is the unicycle of section 5.1.4 of A. I.
    Chaudhry, "Topics in robot locomotion", Cornell University 2015, chapter 5: dx/dt = *v* cos θ, dy/dt =
    *v* sin θ, dθ/dt = *ω*, with commanded *v* and *ω*. Both hold for one `tick` of 0.1 s, in which the
    robot drives an exact arc. [Physics, agents and results](../pose_reaching.md).

    ## Action Space

    `Box(-1, 1, (2,), float32)`.

    | Num | Action | -1 | 0 | +1 |
    |-----|--------|----|---|----|
    | 0 | speed *v* | 0 | 0.5 m/s | 1 m/s (`max_speed`) |
    | 1 | turn rate *ω* | -4 rad/s, to the right | 0 | 4 rad/s, to the left (`max_rate`) |

    With `drive="omnidirectional"`, as the source's robots are built (section 5.3.1), `Box(-1, 1, (3,),
    float32)`: 0 is the speed forwards from -1 to 1 m/s, 2 the speed *u* to the left, likewise; a velocity
    longer than `max_speed` is shortened to it. d(x, y)/dt = *v* (cos θ, sin θ) + *u* (-sin θ, cos θ).

    ## Observation Space

    `Box(low, high, (7,), float32)`, without noise.

    | Num | Observation | Unit | Min | Max |
    |-----|-------------|------|-----|-----|
    | 0 | x, the ball at 0 | m | -2.5 | 2.5 |
    | 1 | y | m | -1.5 | 1.5 |
    | 2, 3 | cosine and sine of the heading θ, counter-clockwise from +x | 1 | -1 | 1 |
    | 4 | natural logarithm of the distance to the ball, from 1 mm | log m | -7 | 2 |
    | 5, 6 | cosine and sine of the angle from the heading to the ball, left positive | 1 | -1 | 1 |

    ## Rewards

    `success_reward` on arrival, less `time_cost` a second, plus `progress_reward` for each metre towards the
    ball (a potential's difference), less `wall_cost` each time the robot drives into a wall.

    `info` holds after each step, and after `reset`

    | Key | Meaning |
    |-----|---------|
    | `success` | 1 if the robot has just arrived, else 0 |
    | `time`, `path_length` | since the start, up to the instant of arrival [s], [m] |
    | `dubins_length`, `dubins_time` | of the shortest path with turns of 0.3 m [m]; at full speed [s] |
    | `wall_hits` | how often the robot has driven into a wall |
    | `pose` | x, y [m] and heading [rad] as measured |
    | `privileged.pose` | the true pose |

    ## Starting State

    Drawn by `starts`, outside the goal, or given: `reset(options={"pose": (x, y, heading)})`.

    | Starts | Position | Heading |
    |--------|----------|---------|
    | `T1` | right half, 0.6 to 1.6 m from the ball, within the field | to the ball (section 5.3.2) |
    | `T2` | both halves, the same distances | up to 45 deg off the ball |
    | `T3` | anywhere in the field | any |

    ## Episode End

    Terminated when the robot is, at one instant, within 5 cm of the ball and 10 deg of the heading +y
    (`success="loose"`: 10 cm and 15 deg). Instants are at most 10 ms apart, whatever the tick. Truncated
    after `timeout`. A wall does not end an episode.

    ## Arguments

    ```python
    import gymnasium as gym

    gym.make(
        "fieldgym:fieldgym/PoseReaching-v0",
        settings={"starts": "T1", "success": "loose"},
        reality={"actuator_lag": {"time_constant": 0.1}},
        render_mode="rgb_array",
    )
    gym.make_vec("fieldgym/PoseReaching-v0", num_envs=1024)  # one kernel, same bits
    ```

    `reality` takes effects of the machine `pose_reaching`, stock effects, or the path of an `extended.yaml`.
    `render_mode` is `rgb_array` (960 x 540) or `human`; `unwrapped.show(memory=..., chosen=...)` also draws
    an agent's remembered paths and the state that it acts on. [What all environments
    share](../your_library.md).

    ## Matches, deviates, assumed

    - **Matches**: kinematics (5.1.4), field, ball and starts `T1` (5.3.2), arrival facing up (Fig 5.1).
    - **Deviates**: the observation has more than the source's distance, heading and heading offset; *ω* is
      a turn rate. With the omnidirectional drive stock effects act on `speed` and `turn_rate` alone, and
      `dubins_length` stays the unicycle's.
    - **Assumed**: limits of speed and turn rate; what counts as arrival; walls; the robot as a point; `T2`,
      `T3`; tick, timeout, reward.

    ## Version History

    - v0: first version
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 10}  # noqa: RUF012
    batch_task = _PoseReachingTask
    title = "pose reaching"

    def get_keys_to_action(self) -> dict[str, NDArray[np.float32]]:
        """The keys of ``gymnasium.utils.play``: w drives, a and d turn left and right, none stands still.

        With ``drive="omnidirectional"`` also s backwards, q and e to the left and to the right.
        """
        turns = {"": 0.0, "a": 1.0, "d": -1.0}
        if self.action_space.shape == (2,):
            drives: dict[str, tuple[float, ...]] = {"": (-1.0,), "w": (1.0,)}
        else:
            drives = {"": (0.0, 0.0), "w": (1.0, 0.0), "s": (-1.0, 0.0), "q": (0.0, 1.0), "e": (0.0, -1.0)}
        return {
            drive + turn: np.array([ahead, rate, *sideways], np.float32)
            for drive, (ahead, *sideways) in drives.items()
            for turn, rate in turns.items()
        }

    def show(
        self,
        memory: Sequence[ArrayLike] | None = None,
        chosen: ArrayLike | None = None,
        *,
        steering: bool = False,
        joystick: float = 0.0,  # noqa: ARG002 - the speed and the turn rate are drawn
    ) -> None:
        """Draw what an agent remembers, and who steers, until the next call; no arguments: nothing.

        Args:
            memory: Remembered paths, each of shape (points, 2 or more): x [m], y [m], ...
            chosen: The remembered state that the agent acts on, shape (2 or more,): x [m], y [m], ...
            steering: Whether a human operator steers.
            joystick: Where the operator's stick is, -1 to 1, left positive.

        Raises:
            ValueError: If a shape is wrong.
        """
        assert isinstance(self._task, _PoseReachingTask)
        self._task.show(memory, chosen, steering)


class PoseReachingVectorEnv(TaskVectorEnv):
    """Many robots in one kernel; each row is ``PoseReachingEnv`` to the bit."""

    batch_task = _PoseReachingTask

    def show(self, memory: Sequence[ArrayLike] | None = None, chosen: ArrayLike | None = None) -> None:
        """As ``PoseReachingEnv.show``; ``chosen`` of shape (2 or more,) or (num_envs, 2 or more)."""
        assert isinstance(self._task, _PoseReachingTask)
        self._task.show(memory, chosen)
