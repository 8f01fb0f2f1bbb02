"""Line following: steer a walking robot along a taped line, stride by stride, from what its camera sees.

Source: A. I. Chaudhry, "Topics in robot locomotion: state estimation and feasible-path generation for
wheeled and legged robots", Cornell University 2015, chapter 3 ("the dissertation").
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray
from pydantic import ConfigDict
from pydantic.dataclasses import dataclass

from fieldgym.base import BatchTask, Flags, Floats, Outcome, RealityLike, TaskEnv, TaskVectorEnv
from fieldgym.info import Info
from fieldgym.settings import read_random_settings
from fieldmodels.compiled import compiled
from fieldmodels.drivers.stepped import Channels
from fieldmodels.machines.line_following.body import Friction, Hardware, MotorTorque
from fieldmodels.machines.line_following.model import LineFollowing
from fieldmodels.machines.line_following.parameters import (
    Exposure,
    Gait,
    Lighting,
    Noise,
    RgbThresholds,
    Threshold,
    TurnLimit,
    WalkRules,
)
from fieldmodels.machines.line_following.plant import MEMORY
from fieldmodels.machines.line_following.tracks import Track, bend_at, read_track
from fieldmodels.machines.line_following.walks import CHANNELS, Scene, Walks
from fieldmodels.settings import Setting, kernel_rows, part_of

if TYPE_CHECKING:
    from fieldgym.rendering.canvas import Frame

WIDTH_SCALE = 0.3
"""The line's place that is 1 in an observation [m]."""
OBSERVED = 10.0
"""Bound of an observation; no line in view reaches it."""
SETTLED = 15
"""Strides after which the distance from the line counts in the scores."""
NEAR = 0.1
"""Distance that costs all of a stride's reward, and within which a robot counts as on its line [m]."""
EFFORT_SCALE = 0.1
"""Change of the turn that costs ``effort_weight`` [rad]."""
TRAIL = 400


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class LineFollowingSettings(WalkRules, Noise, Lighting):
    """What can be set in ``fieldgym/LineFollowing-v1`` and ``fieldgym/LineFollowingPixels-v1``."""

    track: Annotated[
        str,
        Setting(
            "`straight`, `s`, `oval`, `figure_eight`, `winding_7` (random turns by its number), or the "
            "path of a CSV file with columns `x` and `y` [m].",
            fixed="all rows share its points",
        ),
    ] = "oval"
    strides: Annotated[int, Setting("Strides in an episode.", least=1, most=100_000)] = 100
    limit: TurnLimit = Gait.limit
    threshold: Threshold = Exposure.threshold
    rgb_thresholds: RgbThresholds = Exposure.rgb_thresholds
    friction: Friction = Hardware.friction
    motor: MotorTorque = Hardware.motor
    lost_offset: Annotated[float, Setting("Distance at which the episode ends.", "m", above=0)] = 1.0
    lost_strides: Annotated[
        int, Setting("Strides without the line after which the episode ends.", least=1, most=100_000)
    ] = 5
    effort_weight: Annotated[float, Setting("Weight of changing the turn in the reward.", least=0)] = 0.1
    reward_limit: Annotated[
        float,
        Setting("Largest loss of a stride; each stride that a failed episode lacks costs it.", above=0),
    ] = 1.0

    def scene(self, images: bool, track: Track | None = None) -> Scene:
        """What the walks walk on and see with; ``images`` asks for images whatever ``sight`` says.

        Args:
            images: Whether images are rendered in any case.
            track: The line; None reads it.

        Raises:
            ModelError: If there is no such track.
        """
        return part_of(
            self,
            Scene,
            track=read_track(self.track) if track is None else track,
            gait=part_of(self, Gait),
            noise=part_of(self, Noise),
            exposure=part_of(self, Exposure),
            lighting=part_of(self, Lighting),
            hardware=part_of(self, Hardware),
            sight="image" if images else self.sight,
        )


START, OVERSHOOT, DISTANCE, NEAR_STRIDES = range(4)
"""Tallies of an episode: offset at its start [m], farthest beyond the line [m], summed distance [m], strides
near the line."""
NUMBERS = (
    "offset", "effort", "lost", "failed", "command", "start_offset", "mean_offset", "near", "overshoot",
)  # fmt: skip
"""What ``info`` says of a stride."""
PRIVILEGED = tuple(
    f"privileged.{name}" for name in ("offset", "heading", "curvature", "curvature_ahead", "bias")
)
"""The hidden truth in ``info``: place against the line, what the line does ahead, the walk's bias."""


@compiled
def step_reward(
    walks: NDArray[Any], elapsed: NDArray[np.int64], tallies: Floats, rules: NDArray[Any]
) -> tuple[Floats, Flags, Flags, Floats]:
    """Reward the stride that every walk has just made, and keep the scores of its episode.

    Args:
        walks: The walks, dtype ``WALK``.
        elapsed: Strides of each episode, shape (batch,); one is added.
        tallies: Of each episode, shape (batch, 4); updated.
        rules: Settings of each walk.

    Returns:
        Reward, whether the episode failed, whether it has come to its last stride, shape (batch,), and
        ``NUMBERS``, shape (len(NUMBERS), batch). Strides that a failed episode lacks count as lost.
    """
    batch = len(walks)
    reward, numbers = np.empty(batch), np.empty((9, batch))
    failed, truncated = np.empty(batch, dtype=np.bool_), np.empty(batch, dtype=np.bool_)
    for i in range(batch):
        walk, p, tally = walks[i], rules[i], tallies[i]
        elapsed[i] += 1
        distance = abs(walk.offset)
        change = abs(walk.commands[0] - walk.commands[1])
        failed[i] = distance > p.lost_offset or walk.lost_strides >= p.lost_strides
        truncated[i] = elapsed[i] >= p.strides and not failed[i]
        left = p.strides - elapsed[i] if failed[i] else 0
        reward[i] = max(1.0 - distance / NEAR, -p.reward_limit) - p.effort_weight * change / EFFORT_SCALE
        reward[i] -= p.reward_limit * left

        first = min(SETTLED, p.strides - 1)
        if elapsed[i] > first:
            tally[DISTANCE] += distance
            tally[NEAR_STRIDES] += distance <= NEAR
        taken = max(elapsed[i] - first, 0)
        total = p.strides - first if left > 0 else taken
        mean, near = distance, 1.0 if distance <= NEAR else 0.0
        if total > 0:
            mean = (tally[DISTANCE] + (total - taken) * p.lost_offset) / total
            near = tally[NEAR_STRIDES] / total
        tally[OVERSHOOT] = max(tally[OVERSHOOT], -np.sign(tally[START]) * walk.offset)
        for k, value in enumerate((
            distance, change, float(walk.lost[0]), 1.0 if failed[i] else 0.0, walk.commands[0],
            abs(tally[START]), mean, near, tally[OVERSHOOT],
        )):  # fmt: skip
            numbers[k, i] = value
    return reward, failed, truncated, numbers


@compiled
def observe(walks: NDArray[Any], bands: int, rules: NDArray[Any]) -> NDArray[np.float32]:
    """The line's last places, the last commands, the lost flags; shape (batch, 4 + 5 bands)."""
    observed = np.empty((len(walks), 4 + 5 * bands), dtype=np.float32)
    for i in range(len(walks)):
        walk, row = walks[i], observed[i]
        for k in range(MEMORY):
            row[k] = min(max(walk.lines[0, k] / WIDTH_SCALE, -OBSERVED), OBSERVED)
            row[MEMORY + k] = min(max(walk.commands[k] / rules[i].limit, -OBSERVED), OBSERVED)
            if bands == 2:
                row[9 + k] = min(max(walk.lines[1, k] / WIDTH_SCALE, -OBSERVED), OBSERVED)
        row[8] = walk.lost[0]
        if bands == 2:
            row[13] = walk.lost[1]
    return observed


@compiled
def hidden(walks: NDArray[Any], bends: Floats, spacing: float, closed: bool, stride: float) -> Floats:
    """``PRIVILEGED``, shape (5, batch); the arguments but ``walks`` as of ``tracks.bend_at``."""
    numbers = np.empty((5, len(walks)))
    for i in range(len(walks)):
        walk = walks[i]
        numbers[0, i], numbers[1, i], numbers[4, i] = walk.offset, walk.misalignment, walk.bias
        numbers[2, i] = bend_at(bends, spacing, closed, walk.arc)
        numbers[3, i] = bend_at(bends, spacing, closed, walk.arc + stride)
    return numbers


class _LineFollowingTask(BatchTask):
    """The task on a batch of walks."""

    settings: LineFollowingSettings
    channels = CHANNELS
    longest = "strides"
    pixels = False

    def __init__(self, batch: int, settings: Any, reality: RealityLike, drawing: bool) -> None:
        self.settings, samplers = read_random_settings(settings, LineFollowingSettings)
        scene = self.settings.scene(self.pixels)
        model = LineFollowing(scene.gait, scene.camera)
        truth = self.configure(batch, reality, samplers, model, scene.gait.stride_time)
        self._track = scene.track
        self._bends = scene.track.bends, scene.track.spacing, scene.track.closed
        self._look_ahead, self._stride = scene.camera.look_ahead, scene.gait.stride
        self.simulated = self.walks = Walks(batch, scene, truth.typical, truth.stock)
        self._rules = kernel_rows(self.settings, batch)
        self.elapsed = np.zeros(batch, dtype=np.int64)
        self._tallies = np.zeros((batch, 4))
        self._drawing = drawing
        self._trails: list[deque[tuple[float, float, float, float, float]]] = [
            deque(maxlen=TRAIL) for _ in range(batch)
        ]
        self._operator: dict[str, Any] = {}

    def spaces(self) -> tuple[Box, Box]:
        """One turn; what the camera board sent, or the image."""
        action = Box(-1.0, 1.0, (1,), np.float32)
        if self.pixels:
            camera = self.walks.scenes[0].camera
            channels = 3 if self.settings.colour else 1
            return action, Box(0, 255, (camera.rows, camera.width, channels), np.uint8)
        return action, Box(-OBSERVED, OBSERVED, (4 + 5 * self.settings.bands,), np.float32)

    def set_settings(self, row: int, settings: Any) -> None:
        """See ``BatchTask.set_settings``."""
        self.walks.set_scene(row, settings.scene(self.pixels, self._track))
        self._rules[row] = kernel_rows(settings, 1)[0]

    def begin(self, rows: list[int]) -> None:
        """Begin new episodes of some walks."""
        self.walks.begin(rows)
        self.elapsed[rows] = 0
        self._tallies[rows] = 0.0
        self._tallies[rows, START] = self.walks.walks["offset"][rows]
        if self._drawing:
            for i in rows:
                self._trails[i].clear()
                self._trail(i)

    def observation(self) -> NDArray[Any]:
        """The line's last places, the last commands, the lost flags; or the image."""
        if self.pixels:
            assert self.walks.images is not None
            images = self.walks.images
            return images.copy() if self.settings.colour else images[..., None].copy()
        return observe(self.walks.walks, self.settings.bands, self._rules)

    def reset_info(self) -> Info:
        """The hidden truth at the start."""
        return self._told((), np.zeros((0, len(self.elapsed))))

    def step(self, actions: NDArray[Any]) -> Outcome:
        """Take every walk through one stride."""
        self.walks.advance(actions[:, 0] * self._rules["limit"])
        reward, failed, truncated, numbers = step_reward(
            self.walks.walks, self.elapsed, self._tallies, self._rules
        )
        if self._drawing:
            for i in range(len(self.elapsed)):
                self._trail(i)
        return Outcome(
            observation=self.observation(),
            reward=reward,
            terminated=failed,
            truncated=truncated,
            info=self._told(NUMBERS, numbers),
        )

    def _told(self, names: tuple[str, ...], numbers: Floats) -> Info:
        """Some numbers, and the hidden truth."""
        truth = hidden(self.walks.walks, *self._bends, self._stride)
        return Info(names + PRIVILEGED, np.concatenate([numbers, truth]), self.drawn.info)

    def state(self) -> dict[str, Any]:
        """Everything that the next steps depend on but the random generators."""
        return {
            "walks": self.walks.state().view(np.uint8).reshape(len(self.elapsed), -1).copy(),
            "elapsed": self.elapsed.copy(),
            "tallies": self._tallies.T.copy(),
        }

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Return to a snapshot."""
        kind, count = self.walks.walks.dtype, len(self.elapsed)
        walks, tallies = np.ascontiguousarray(state["walks"]), np.asarray(state["tallies"])
        if walks.dtype != np.uint8 or walks.shape != (count, kind.itemsize) or tallies.shape != (4, count):
            raise ValueError("not a snapshot of this environment; get_state makes one")
        self.walks.set_state(walks.view(kind).reshape(-1))
        self.elapsed[:] = state["elapsed"]
        self._tallies[:] = tallies.T
        for i, trail in enumerate(self._trails):
            trail.clear()
            self._trail(i)

    def show(self, **operator: Any) -> None:
        """Show who steers; see ``LineFollowingEnv.show``."""
        self._operator = operator

    def _trail(self, i: int) -> None:
        """Remember where a walk is, for its picture."""
        one = self.walks.walks[i]
        self._trails[i].append(
            (
                float(one["x"]),
                float(one["y"]),
                float(one["heading"]),
                float(one["offset"]),
                float(one["commands"][0]),
            )
        )

    def frame(self, i: int) -> Frame:
        """Draw one walk."""
        from fieldgym.rendering.line_following import Picture, draw

        scene, one, own = self.walks.scenes[i], self.walks.walks[i], self.drawn.settings[i]
        return draw(
            Picture(
                track=scene.track.points,
                closed=scene.track.closed,
                trail=np.array(self._trails[i]),
                image=self.walks.image(i),
                band=(scene.camera.first_row, scene.camera.last_row),
                column=scene.camera.width / 2.0 - float(one["lines"][0, 0]) / scene.camera.metres_per_pixel,
                lost=bool(one["lost"][0]),
                threshold=scene.exposure.threshold,
                limit=own.limit,
                stride=int(self.elapsed[i]),
                strides=own.strides,
                look_ahead=self._look_ahead,
                dark=own.dark_corner,
                operator=self._operator,
            )
        )


class _PixelTask(_LineFollowingTask):
    """The task on a batch of walks, observed as images."""

    channels = Channels(commands=CHANNELS.commands, without="it observes images, not the line's place")
    pixels = True


class LineFollowingEnv(TaskEnv):
    r"""Steer a walking robot along a taped line, stride by stride, from one number that its camera sends.

    ## Description

    The biped Ranger follows black tape by itself (A. I. Chaudhry, "Topics in robot locomotion", Cornell
    University 2015, chapter 3). A camera on its front looks at the floor about a metre ahead; its firmware
    finds the tape's pixels in the middle third of the rows and sends their mean column, or a flag if there
    are too few.

    One step is one stride of 0.70 m: the camera looks as the outer legs touch down; the body goes 0.35 m
    straight on, then 0.35 m along the same heading over the inner feet, which turn it, so that a turn shows
    in the next stride only. Each episode has a hidden steering bias. [Physics, agents and
    results](../line_following.md).

    ## Action Space

    `Box(-1, 1, (1,), float32)`: the turn of the coming stride in units of `limit`, 0.15 rad, left positive.

    ## Observation Space

    `Box(-10, 10, (9,), float32)`

    | Num | Observation | Unit |
    |-----|-------------|------|
    | 0-3 | where the camera saw the line, newest first, left positive | 0.3 m |
    | 4-7 | commanded turns, newest first | `limit` |
    | 8 | 1 if the line is lost; then entry 0 is where it was seen last | - |

    `bands=2` adds the third of the view above the middle one, 1.26 to 2.2 m ahead: entries 9-12 are the
    line's places in it, 13 its lost flag.

    ## Rewards

    `max(1 - |d| / 0.1 m, -reward_limit) - effort_weight |change of turn| / 0.1 rad`, with `d` the distance
    from the line after the stride. Where an episode fails, each stride that it lacks costs `reward_limit`.

    `info` holds after each step

    | Key | Meaning |
    |-----|---------|
    | `offset`, `effort` | distance from the line [m]; change of the commanded turn [rad] |
    | `lost` | 1 if the line is not seen |
    | `failed` | 1 if the episode ends off the line |
    | `command` | the commanded turn [rad] |
    | `start_offset`, `mean_offset` | at the start; mean since stride 15, missing strides as 1 m [m] |
    | `near` | share of the strides since stride 15 within 0.10 m |
    | `overshoot` | farthest beyond the line so far, seen from the start [m] |
    | `privileged.offset`, `.heading` | against the line, signed [m, rad] |
    | `privileged.curvature`, `.curvature_ahead` | of the line here and a stride ahead [1/m] |
    | `privileged.bias` | steering bias [rad] |

    ## Starting State

    Up to `offset` (0.2 m) from the line and `misalignment` (0.1 rad) askew, at the beginning of an open
    track or anywhere on a closed one.

    ## Episode End

    Truncated after `strides` (100). Terminated where the robot is more than `lost_offset` (1 m) from the
    line, or has not seen it for `lost_strides` (5).

    ## Arguments

    ```python
    import gymnasium as gym

    gym.make(
        "fieldgym:fieldgym/LineFollowing-v1",
        settings={"track": "s", "plant": "pymunk", "friction": 0.2},
        reality={"steering_bias": {"turn": 0.01}},
        render_mode="rgb_array",
    )
    gym.make_vec("fieldgym/LineFollowing-v1", num_envs=64)  # one kernel, same bits
    ```

    `reality` takes effects of the machine `line_following`, stock effects, or the path of an
    `extended.yaml`. `render_mode` is `rgb_array` (960 x 540, a frame a stride) or `human`. [What all
    environments share](../your_library.md).

    ## Matches, deviates, assumed

    - **Matches**: turning while the inner legs stand, and the wait of a command given during their swing
      (3.1.1); camera, threshold, centroid, flag (3.3.2, 3.4.2, 3.5.1); tape and floor (Fig 3.13); turns of
      9 m, dark corner, shadow (3.6).
    - **Deviates**: images are grey unless `colour` is set; the body does not pitch.
    - **Assumed**: [what the source leaves open](../line_following.md); optics.

    ## Version History

    - v1: `reward_limit` is 1 by default, not 3
    - v0: first version
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 4}  # noqa: RUF012
    batch_task = _LineFollowingTask
    title = "line following"

    def get_keys_to_action(self) -> dict[str, NDArray[np.float32]]:
        """The keys of ``gymnasium.utils.play``: a and d turn left and right, none goes straight on."""
        return {key: np.array([turn], np.float32) for key, turn in (("", 0.0), ("a", 1.0), ("d", -1.0))}

    def show(self, **operator: Any) -> None:
        """Show in the picture who steers, as the operator's switch and joystick of section 3.5.2.

        Args:
            operator: ``steering`` (True where the operator steers) and ``joystick`` (-1 to 1, left positive).
        """
        assert isinstance(self._task, _LineFollowingTask)
        self._task.show(**operator)


class LineFollowingVectorEnv(TaskVectorEnv):
    """Many walks in one kernel; each row is ``LineFollowingEnv`` to the bit."""

    batch_task = _LineFollowingTask


class LineFollowingPixelsEnv(LineFollowingEnv):
    r"""Steer a walking robot along a taped line, stride by stride, from its camera's image.

    ## Description

    `fieldgym/LineFollowing-v1` observed as the camera sees it. The centroid of one band mixes offset,
    heading and curvature; the image holds all three. [Physics, agents and results](../line_following.md).

    ## Action Space

    `Box(-1, 1, (1,), float32)`: the turn of the coming stride in units of `limit`, 0.15 rad, left positive.

    ## Observation Space

    `Box(0, 255, (120, 160, 1), uint8)`: the grey image, with exposure, light, shadow and noise; with
    `colour` `Box(0, 255, (120, 160, 3), uint8)`. The body sways: the camera's heading has the noise that
    the centroid has in the other environment. One image a row is kept: 58 kB.

    ## Rewards

    As `fieldgym/LineFollowing-v1`, with the same `info`.

    ## Starting State

    As `fieldgym/LineFollowing-v1`: equal seeds give the same walk and the same noise.

    ## Episode End

    As `fieldgym/LineFollowing-v1`; the line is lost where the firmware does not find it in the image.

    ## Arguments

    ```python
    import gymnasium as gym

    gym.make("fieldgym:fieldgym/LineFollowingPixels-v1", settings={"light": 0.5}, render_mode="rgb_array")
    gym.make_vec("fieldgym/LineFollowingPixels-v1", num_envs=16)
    ```

    ## Matches, deviates, assumed

    As `fieldgym/LineFollowing-v1`. The source sends no images to the robot, only the centroid.

    ## Version History

    - v1: `reward_limit` is 1 by default
    - v0: first version
    """

    batch_task = _PixelTask


class LineFollowingPixelsVectorEnv(TaskVectorEnv):
    """Many walks observed as images; each row is ``LineFollowingPixelsEnv`` to the bit."""

    batch_task = _PixelTask
