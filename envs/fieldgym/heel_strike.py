"""Heel strike: choose the gains of a walking robot's state estimator, stride by stride.

Source: A. I. Chaudhry, "Topics in robot locomotion: state estimation and feasible-path generation for
wheeled and legged robots", Cornell University 2015, chapter 2 ("the dissertation"). Equation numbers in
this module are that chapter's.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray
from pydantic import ConfigDict
from pydantic.dataclasses import dataclass

from fieldgym.base import BatchTask, Flags, Floats, Outcome, RealityLike, TaskEnv, TaskVectorEnv
from fieldgym.info import Info
from fieldgym.settings import read_random_settings
from fieldmodels.compiled import compiled
from fieldmodels.machines.heel_strike.model import HeelStrikeModel
from fieldmodels.machines.heel_strike.parameters import CollisionKind, Leg, PushOff, Regimes
from fieldmodels.machines.heel_strike.strides import CHANNELS, StrideResult, Strides
from fieldmodels.machines.heel_strike.walker import ESTIMATORS, FEATURES, LIBRARY, TRACES, Walk
from fieldmodels.settings import Setting, code, kernel_rows, part_of

if TYPE_CHECKING:
    from fieldgym.rendering.canvas import Frame
    from fieldgym.rendering.heel_strike import Stride

Observation = NDArray[np.float32]

GAIN_NAMES = ("S_MS early", "S_MS late", "S_HR")
GAIN_LOW = np.array([0.001, 0.001, 0.01])
"""Lower ends of the gains' ranges; each ends at 1."""
FEATURE_LOW, FEATURE_HIGH = -28.0, 10.0
"""Bounds of the features: logs of squares in SI units, from 1e-12 to more than any walk reaches."""
TOLERANCE_MM = 3.0
"""How accurately Ranger knew its foot's height on its marathon walk [mm] (section 2.3.2)."""
RANGER_TUNED = {"ar1": (0.8, 3.5), "low_pass": (0.2, 0.59)}
"""Best constant S_HR of Ranger's estimator under the default levels, and its mean strike error [mm]."""
STRIDES_KEPT = 40
FRAMES_PER_SECOND = 25


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class HeelStrikeSettings(Regimes):
    """What can be set in ``fieldgym/HeelStrike-v0``: its noise, and how an episode is scored."""

    collision_kind: CollisionKind = "ar1"
    push_off: PushOff = Leg.push_off
    strides: Annotated[int, Setting("Strides in an episode.", least=1, most=1_000_000)] = 200
    decay: Annotated[
        float,
        Setting("S_FD, the inverse of the gyro filter's decay time.", "1/s", above=0, below=1000),
    ] = 1000 / 3
    score: Annotated[
        Literal["angle", "angle_and_floor"],
        Setting(
            "`angle` scores the error before the reset; `angle_and_floor` adds the floor's height "
            "(section 2.4.5)."
        ),
    ] = "angle"
    reward_scale: Annotated[
        float | None,
        Setting(
            "Error that costs a reward of one; None is the tuned Ranger's mean error.",
            "mm",
            above=0,
        ),
    ] = None
    reward_limit: Annotated[
        float,
        Setting("Largest loss of one stride, in units of `reward_scale`.", above=0, finite=False),
    ] = 10.0
    tuned_reset: Annotated[
        float | None,
        Setting(
            "S_HR of the tuned Ranger estimator; None is the best.",
            least=0,
            most=1,
        ),
    ] = None
    bank: Annotated[
        bool,
        Setting(
            "Also score the bank of Kalman filters; several times slower.",
            fixed="it adds an entry to the info",
        ),
    ] = False
    filterpy: Annotated[
        bool,
        Setting(
            "Also run the Kalman filters by filterpy: hundreds of times slower; needs `fieldgym[filters]`.",
            fixed="it adds an entry to the info",
        ),
    ] = False

    @property
    def leg(self) -> Leg:
        """The leg as the model takes it."""
        return part_of(self, Leg)

    @property
    def walk(self) -> Walk:
        """Leg, noise and estimators as `fieldmodels` takes them."""
        return Walk(self.leg, part_of(self, Regimes), tuned_reset=self.ranger_reset)

    @property
    def ranger_reset(self) -> float:
        """S_HR of the tuned Ranger estimator."""
        return RANGER_TUNED[self.collision_kind][0] if self.tuned_reset is None else self.tuned_reset

    @property
    def scale_mm(self) -> float:
        """Error that costs a reward of one [mm]."""
        return self.reward_scale or RANGER_TUNED[self.collision_kind][1]


FLOOR_ADDED = code(HeelStrikeSettings, "score", "angle_and_floor")
SettingsLike = HeelStrikeSettings | Mapping[str, Any] | None


def _rules(settings: HeelStrikeSettings, batch: int) -> NDArray[Any]:
    """Settings as the kernels read them."""
    return kernel_rows(settings, batch, {"scale_mm": settings.scale_mm})


@compiled
def gains_of(actions: Floats, rules: NDArray[Any]) -> Floats:
    """S_MS early, S_MS late, S_HR and S_FD that actions mean, shape (batch, 4)."""
    gains = np.empty((len(actions), 4))
    for i in range(len(actions)):
        for k in range(3):
            gains[i, k] = GAIN_LOW[k] * (1.0 / GAIN_LOW[k]) ** ((actions[i, k] + 1.0) / 2.0)
        gains[i, 3] = rules[i].decay
    return gains


@compiled
def observe(walkers: NDArray[Any]) -> NDArray[np.float32]:
    """The reference filter's features within bounds, shape (batch, 6)."""
    observed = np.empty((len(walkers), len(FEATURES)), dtype=np.float32)
    for i in range(len(walkers)):
        for k in range(len(FEATURES)):
            observed[i, k] = min(max(walkers[i].features[k], FEATURE_LOW), FEATURE_HIGH)
    return observed


@compiled
def step_reward(
    signed: Floats, columns: NDArray[np.int64], floors: Floats, duration: Floats, fallen: Flags,
    elapsed: NDArray[np.int64], rules: NDArray[Any],
) -> tuple[Floats, Flags, Flags, Floats]:  # fmt: skip
    """Reward the stride that every walker has just made.

    Args:
        signed: Signed errors of the estimators [mm], shape (batch, estimators).
        columns: Those that are told of, the agent's first.
        floors: Height error of the floor [mm], shape (batch,).
        duration: Time of the stride [s], shape (batch,).
        fallen: True where the leg did not come to a strike, shape (batch,).
        elapsed: Strides of each episode, shape (batch,); one is added.
        rules: Settings of each walker.

    Returns:
        Reward, terminated, truncated, shape (batch,), and the numbers of ``info``: the agent's error, its
        cost, the duration, the others' errors; shape (numbers, batch).
    """
    batch = len(signed)
    reward, numbers = np.empty(batch), np.empty((len(columns) + 2, batch))
    ended, truncated = np.empty(batch, dtype=np.bool_), np.empty(batch, dtype=np.bool_)
    for i in range(batch):
        p = rules[i]
        elapsed[i] += 1
        added = floors[i] if p.score == FLOOR_ADDED else 0.0
        for k in range(len(columns)):
            numbers[k + 2 if k else 0, i] = abs(signed[i, columns[k]] + added)
        error = numbers[0, i]
        numbers[1, i] = 1.0 if error > TOLERANCE_MM else 0.0
        numbers[2, i] = duration[i]
        reward[i] = -min(error / p.scale_mm, p.reward_limit)
        ended[i] = fallen[i]
        truncated[i] = elapsed[i] >= p.strides and not fallen[i]
    return reward, ended, truncated, numbers


class _HeelStrikeTask(BatchTask):
    """The task on a batch of walkers: what the scalar and the vector environment share."""

    settings: HeelStrikeSettings
    channels = CHANNELS
    longest = "strides"

    def __init__(self, batch: int, settings: SettingsLike, reality: RealityLike, drawing: bool) -> None:
        self.settings, samplers = read_random_settings(settings, HeelStrikeSettings)
        model = HeelStrikeModel(self.settings.leg)
        truth = self.configure(batch, reality, samplers, model, model.leg.step)
        walk = self.settings.walk
        self.simulated = self.strides = Strides(
            batch,
            walk.leg,
            walk.regimes,
            truth.typical,
            bank=self.settings.bank,
            tuned_reset=walk.tuned_reset,
            stock=truth.stock,
            filterpy=self.settings.filterpy,
        )
        for extreme in (*truth.extremes, truth.typical):
            self.strides.set_reality([0], extreme[None])
        self.elapsed = np.zeros(batch, dtype=np.int64)
        self._rules = _rules(self.settings, batch)
        bank = None if self.settings.bank else -1
        estimators = ESTIMATORS[:bank] + (LIBRARY[:bank] if self.settings.filterpy else ())
        scored = tuple(f"error_mm_{name}" for name in estimators[1:])
        self._names = ("error_mm", "cost", "duration", *scored)
        self._columns = np.array([(*ESTIMATORS, *LIBRARY).index(name) for name in estimators])
        self._tracing = drawing
        self.kept: list[deque[Stride]] = [deque(maxlen=STRIDES_KEPT) for _ in range(batch)]

    def spaces(self) -> tuple[Box, Box]:
        """Three gains; the features of the reference filter."""
        action = Box(-1.0, 1.0, (len(GAIN_NAMES),), np.float32)
        return action, Box(FEATURE_LOW, FEATURE_HIGH, (len(FEATURES),), np.float32)

    def set_settings(self, row: int, settings: Any) -> None:
        """See ``BatchTask.set_settings``."""
        self.strides.set_walk(row, settings.walk)
        self._rules[row] = _rules(settings, 1)[0]

    def begin(self, rows: list[int]) -> None:
        """Begin new episodes of some walkers."""
        self.elapsed[rows] = 0
        for i in rows:
            self.kept[i].clear()

    def observation(self) -> Observation:
        """The reference filter's features within the bounds of the space, shape (batch, 6)."""
        return observe(self.strides.walkers)

    def reset_info(self) -> dict[str, Any]:
        """The info that ``reset`` returns."""
        levels = self.strides.levels
        return {
            "privileged.levels": levels,
            "privileged.previous_levels": levels.copy(),
            **self.drawn.info,
        }

    def gains(self, actions: NDArray[Any]) -> Floats:
        """Turn actions into S_MS early, S_MS late, S_HR and S_FD, shape (batch, 4)."""
        return gains_of(actions, self._rules)

    def step(self, actions: NDArray[Any]) -> Outcome:
        """Take every walker through one stride."""
        gains = self.gains(actions)
        result = self.strides.advance(gains, traces=self._tracing)
        reward, fallen, truncated, numbers = step_reward(
            result.signed_mm, self._columns, result.floor_mm, result.duration, result.fallen, self.elapsed,
            self._rules,
        )  # fmt: skip
        if result.traces is not None:
            self._draw_later(result, gains, numbers)
        levels, next_levels, signed = result.levels, result.next_levels, result.signed_mm[:, 0].copy()
        others = {
            "gains": gains,
            "privileged.levels": next_levels,
            "privileged.previous_levels": levels,
            "privileged.signed_error_mm": signed,
            "privileged.floor_mm": result.floor_mm,
            **self.drawn.info,
        }
        return Outcome(self.observation(), reward, fallen, truncated, Info(self._names, numbers, others))

    def state(self) -> dict[str, Any]:
        """Everything that the next steps depend on but the random generators."""
        state: dict[str, Any] = {"walkers": self.strides.state(), "elapsed": self.elapsed.copy()}
        if self.strides.library is not None:
            state["library"] = self.strides.library.state()
        return state

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Return to a snapshot."""
        self.strides.set_state(state["walkers"], state.get("library"))
        self.elapsed[:] = state["elapsed"]
        for strides in self.kept:
            strides.clear()

    def _draw_later(self, result: StrideResult, gains: Floats, numbers: Floats) -> None:
        """Keep what a picture of this stride needs."""
        from fieldgym.rendering.heel_strike import Stride

        assert result.traces is not None
        column = {name: i for i, name in enumerate(TRACES)}
        for i, strides in enumerate(self.kept):
            trace = result.traces[i, : result.samples[i]]
            strides.append(
                Stride(
                    time=trace[:, column["time"]] - trace[0, column["time"]] + self.strides.leg.step,
                    angle=trace[:, column["theta"]],
                    estimate=trace[:, column["theta_agent"]],
                    error_mm=float(numbers[0, i]),
                    ranger_mm=float(numbers[self._names.index("error_mm_ranger"), i]),
                    gains=tuple(
                        (name, float(gain), float(low), 1.0)
                        for name, gain, low in zip(GAIN_NAMES, gains[i], GAIN_LOW, strict=False)
                    ),
                    regimes=tuple(
                        (name, bool(level))
                        for name, level in zip(("torque", "floor", "impact"), result.levels[i], strict=True)
                    ),
                )
            )

    def frame(self, i: int, sample: int = -1) -> Frame:
        """Draw one walker."""
        from fieldgym.rendering.heel_strike import draw

        return draw(
            list(self.kept[i]),
            int(self.elapsed[i]),
            self.drawn.settings[i].strides,
            self.strides.leg.step_length,
            sample,
        )


class HeelStrikeEnv(TaskEnv):
    r"""Choose the gains of a walking robot's state estimator, stride by stride, under hidden noise.

    ## Description

    A pendulum stands in for the stance leg of the walking robot Ranger; its heel strikes the ground twice a
    period. The robot estimates the leg's angle from a noisy gyro, a model, and the geometry at each strike,
    eq (2.14) of A. I. Chaudhry, "Topics in robot locomotion", Cornell University 2015, chapter 2. The
    estimator's gains are

    - *S_MS*, model or sensor: 0 uses the model's acceleration alone, 1 the filtered gyro alone;
    - *S_HR*, heel-strike reset: the share of the geometry's angle that replaces the estimate at a strike;
    - *S_FD*, the gyro filter's decay, fixed at 2/(3 dt) = 333 / s, which is best for every *S_MS*.

    Three noise amplitudes are hidden: of the process torque, the floor's unevenness, and the gyro after a
    collision. Each switches between low and high, at a strike with probability 1/`dwell`. The agent must
    infer them, since the best gains depend on them. One step is one stride of about 1 s. [Physics, agents
    and results](../heel_strike.md).

    ## Action Space

    `Box(-1, 1, (3,), float32)`: the gains of the coming stride, `low ** ((1 - action) / 2)`.
    `(1, 1, 0)` is Ranger's own estimator but for its filter.

    | Num | Action | -1 | 0 | +1 |
    |-----|--------|----|---|----|
    | 0 | *S_MS* in the first 0.25 s (`envelope`), while the collision lasts | 0.001 | 0.0316 | 1 |
    | 1 | *S_MS* in the rest of the stride | 0.001 | 0.0316 | 1 |
    | 2 | *S_HR* of the reset at the strike that has just happened | 0.01 | 0.1 | 1 |

    ## Observation Space

    `Box(-28, 10, (6,), float32)`: natural logarithms of squares, from an extended Kalman filter (angle,
    speed, process torque, collision noise) that assumes the geometric mean of each pair of noise levels. It
    does not depend on the actions. *Smoothed* is 0.7 of the last value and 0.3 of the new one.

    | Num | Observation | Unit inside the logarithm |
    |-----|-------------|------|
    | 0, 1 | squared innovation of the geometry's angle at the latest strike; smoothed | rad² |
    | 2, 3 | mean squared torque estimate after the collision; smoothed | rad²/s⁴ |
    | 4, 5 | mean squared estimate of the collision noise while it lasts; smoothed | rad²/s² |

    ## Rewards

    `-min(error / scale, reward_limit)`. `error` is the absolute error of the estimated foot height before
    the reset of the closing strike: |θ̂ - θ| times the step length of 0.35 m. `scale` is the mean error of
    Ranger's tuned estimator, 3.5 mm (`ar1`) or 0.59 mm (`low_pass`).

    `info` holds after each step

    | Key | Meaning |
    |-----|---------|
    | `error_mm` | the agent's error [mm] |
    | `error_mm_ranger` | of Ranger's estimator as published, eq (2.2), (2.3) [mm] |
    | `error_mm_ranger_tuned` | of Ranger's with the best constant *S_HR* [mm] |
    | `error_mm_ekf`, `error_mm_imm` | of the Kalman filter; of a bank of eight that knows the levels [mm] |
    | `error_mm_ekf_filterpy`, `error_mm_imm_filterpy` | by filterpy [mm] |
    | `cost` | 1 if the error exceeds 3 mm, Ranger's accuracy (section 2.3.2), else 0 |
    | `gains` | *S_MS* early, *S_MS* late, *S_HR*, *S_FD* [1/s] of the stride |
    | `duration` | of the stride [s] |
    | `privileged.levels`, `.previous_levels` | process, floor, collision (1 high): coming, last stride |
    | `privileged.signed_error_mm`, `.floor_mm` | signed error; floor height error |

    `reset` returns the levels alone.

    ## Starting State

    The leg hangs straight down at 1 rad/s, which all estimators know; each noise level is low or high with
    equal chance.

    ## Episode End

    Truncated after `strides` strides. Terminated if no strike comes within 2.5 s.

    ## Arguments

    ```python
    import gymnasium as gym

    gym.make(
        "fieldgym:fieldgym/HeelStrike-v0",
        settings={"collision_kind": "low_pass"},
        reality={"gyro_bias": {"rate": 0.004}},
        render_mode="rgb_array",
    )
    gym.make_vec("fieldgym/HeelStrike-v0", num_envs=64)  # one kernel, same bits
    ```

    `reality` takes effects of the machine `heel_strike`, stock effects, or the path of an `extended.yaml`;
    the estimators go on assuming the nominal leg. `render_mode` is `rgb_array` (960 x 540, a frame a
    stride; `step_frames` slices it) or `human`. [What all environments share](../your_library.md).

    ## Matches, deviates, assumed

    - **Matches**: the pendulum (2.11), the estimators (2.2), (2.3), (2.14) and the noises.
    - **Deviates**: noise amplitudes are hidden and switch, *S_MS* may differ within a stride (with equal
      levels and *S_MS* the task is the source's); mean errors are absolute.
    - **Assumed**: push-off, levels, dwell.

    ## Version History

    - v0: first version
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 4}  # noqa: RUF012
    batch_task = _HeelStrikeTask
    title = "heel strike"
    window_fps = FRAMES_PER_SECOND

    def step_frames(self, frames_per_second: float) -> Iterator[Frame]:
        """Draw the latest stride in slices of time, for films; needs a render mode.

        Args:
            frames_per_second: Pictures for each second of the walk.
        """
        assert isinstance(self._task, _HeelStrikeTask)
        if not self._task.kept[0]:
            return
        time = self._task.kept[0][-1].time
        for moment in np.arange(1 / frames_per_second, time[-1], 1 / frames_per_second):
            yield self._task.frame(0, int(np.searchsorted(time, moment)))
        yield self._task.frame(0)

    def _window_frames(self) -> Iterator[Frame]:
        """The latest stride at the speed at which it was made."""
        assert isinstance(self._task, _HeelStrikeTask)
        if not self._task.kept[0]:
            yield self._task.frame(0)
        yield from self.step_frames(FRAMES_PER_SECOND)


class HeelStrikeVectorEnv(TaskVectorEnv):
    """Many walkers in one kernel; each row is ``HeelStrikeEnv`` to the bit."""

    batch_task = _HeelStrikeTask
