"""Excitation: shake a vehicle with its own arm so that its unknown parameters show.

Source: V. A. Sujan and S. Dubowsky, "An optimal information method for mobile manipulator dynamic
parameter identification", IEEE/ASME Trans. Mechatronics 8(2), 2003. Equation and table numbers in this
module are that paper's.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict
from pydantic.dataclasses import dataclass

from fieldgym.base import BatchTask, Box, Flags, Floats, Outcome, RealityLike, TaskEnv, TaskVectorEnv
from fieldgym.info import Info
from fieldgym.settings import read_random_settings
from fieldmodels.compiled import allocation_free, allocation_free_inlined
from fieldmodels.machines.excitation.model import ExcitationModel
from fieldmodels.machines.excitation.motion import DECISION
from fieldmodels.machines.excitation.parameters import (
    CG,
    DAMPING,
    NAMES,
    PRIOR_MEAN,
    PRIOR_VARIANCE,
    SAMPLES,
    UNKNOWNS,
    Rules,
)
from fieldmodels.machines.excitation.rewards import GROUPS, bits, relative_accuracy, weight_of_each
from fieldmodels.machines.excitation.sensors import mean_draw
from fieldmodels.machines.excitation.shaker import (
    CHANNELS,
    FINEST,
    VARIANTS,
    Shaken,
    Shakers,
    error_percent,
)
from fieldmodels.model import ModelError
from fieldmodels.settings import Setting, code, kernel_rows

if TYPE_CHECKING:
    from fieldgym.rendering.canvas import Frame

REACHED_PERCENT = 20.0
"""Average error that counts as identified [%]: about the source's result, 18.9 (Table I)."""
MEAN_BOUND, LOG_LOW, LOG_HIGH = 5.0, -12.0, 1.0
"""Bounds of the observed means (in standard deviations of the prior) and logarithms of deviations."""

Weight = Annotated[float, Setting("", least=0, most=1e6)]


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class ExcitationSettings(Rules):
    """What can be set in ``fieldgym/Excitation-v0``."""

    decisions: Annotated[int, Setting("Decisions of 0.4 s in an episode.", least=1, most=100_000)] = 25
    reward: Annotated[
        Literal["bits", "relative_error"],
        Setting(
            "Reward for the `bits` that the filter gains, or for halvings of the expected `relative_error`."
        ),
    ] = "bits"
    weights: Annotated[
        tuple[Weight, Weight, Weight, Weight, Weight],
        Setting("Weight in the reward of mass, each inertia, c.g., damping and stiffness (section VI)."),
    ] = (1.0, 1.0, 1.0, 1.0, 1.0)

    def __post_init__(self) -> None:
        """Check the numbers; see ``check_declared``."""
        super().__post_init__()
        if not (weight_of_each(np.array(self.weights)) * VARIANTS[self.variant].unknowns).any():
            raise ModelError(
                f"weights: all that is estimated has no weight in {self.weights}; let one be positive"
            )


DIAGNOSED = "soft"
"""The vehicle of the model ``excitation`` that a diagnosis extends."""


def model_of(settings: ExcitationSettings) -> ExcitationModel:
    """The model of what is set: its nominal vehicle is the preset's."""
    return ExcitationModel(settings.preset)


RELATIVE = code(ExcitationSettings, "reward", "relative_error")
DEVIATION = np.sqrt(PRIOR_VARIANCE)
NUMBERS = (
    "time", "bits", "bits_naive", "error_percent", "error_normalised", "error_percent_naive",
    "error_normalised_naive", "reached_20", "time_to_20",
)  # fmt: skip
"""What ``info`` says of the experiments as they stand."""


def _rules(settings: ExcitationSettings, batch: int) -> NDArray[Any]:
    """Settings as the kernels read them."""
    return kernel_rows(settings, batch, {"weight_of_each": weight_of_each(np.array(settings.weights))})


@allocation_free
def fill_worth(
    information: Floats, covariance: Floats, nominal: Floats, estimated: Flags, rules: NDArray[Any],
    value: Floats,
) -> None:  # fmt: skip
    """What experiments are worth, by the reward of each, shape (batch,)."""
    for i in range(len(information)):
        p = rules[i]
        if p.reward == RELATIVE:
            value[i] = relative_accuracy(covariance[i], nominal[i], p.weight_of_each, estimated)
        else:
            value[i] = bits(information[i], p.weight_of_each)


@allocation_free
def observe(
    mean: Floats, covariance: Floats, command: Floats, phase: Floats, low: Floats, high: Floats,
    elapsed: NDArray[np.int64], rules: NDArray[Any], observed: NDArray[np.float32],
) -> None:  # fmt: skip
    """What is known and where the arm is, shape (batch, 50)."""
    n = mean.shape[1]
    for i in range(len(mean)):
        row = observed[i]
        for k in range(n):
            row[k] = min(max((mean[i, k] - PRIOR_MEAN[k]) / DEVIATION[k], -MEAN_BOUND), MEAN_BOUND)
            known = math.sqrt(covariance[i, k, k]) / DEVIATION[k]
            row[n + k] = min(max(math.log(known), LOG_LOW), LOG_HIGH) if known > 0.0 else LOG_LOW
        for k in range(3):
            place = 2.0 * (command[i, k] - low[i, k]) / (high[i, k] - low[i, k]) - 1.0
            row[2 * n + k] = min(max(place, -1.0), 1.0)
        row[2 * n + 3], row[2 * n + 4] = math.cos(phase[i]), math.sin(phase[i])
        row[2 * n + 5] = max(1.0 - elapsed[i] / rules[i].decisions, 0.0)


@allocation_free_inlined
def sum_of(values: Floats) -> float:
    """Sum from first to last; NumPy's own method takes long to compile."""
    total = 0.0
    for k in range(len(values)):
        total += values[k]
    return total


@allocation_free
def score(
    mean: Floats, naive: Floats, information: Floats, information_naive: Floats, truth: Floats,
    counted: Flags, elapsed: NDArray[np.int64], below_since: NDArray[np.int64],
    keys: NDArray[np.uint64], samples: NDArray[np.int64], numbers: Floats,
) -> None:  # fmt: skip
    """``NUMBERS``, and the mean draw, shape (10, batch); ``below_since`` follows the average error."""
    for i in range(len(mean)):
        own, own_naive = error_percent(mean[i], truth[i], counted), error_percent(naive[i], truth[i], counted)
        if elapsed[i] == 0 or own[0] >= REACHED_PERCENT:
            below_since[i] = -1
        elif below_since[i] < 0:
            below_since[i] = elapsed[i]
        time, reached = elapsed[i] * DECISION, below_since[i] >= 0
        values = (
            time, sum_of(information[i]), sum_of(information_naive[i]), own[0], own[1], own_naive[0],
            own_naive[1], 1.0 if reached else 0.0, below_since[i] * DECISION if reached else time,
            mean_draw(keys[i], samples[i]),
        )  # fmt: skip
        for k in range(len(values)):
            numbers[k, i] = values[k]


def known(shaken: Shaken) -> dict[str, Any]:
    """What ``info`` says of the filter, the arm and the noise: what a model-based agent may read."""
    return {
        "estimate.mean": shaken.mean,
        "estimate.covariance": shaken.covariance,
        "estimate.moments": shaken.moments,
        "estimate.noise": shaken.noise,
        "estimate.samples": shaken.samples,
        "arm.command": shaken.command,
        "arm.phase": shaken.phase,
        "variances": shaken.variances,
    }


class _ExcitationTask(BatchTask):
    """The task on a batch of vehicles."""

    settings: ExcitationSettings
    channels = CHANNELS
    longest = "decisions"

    def __init__(self, batch: int, settings: Any, reality: RealityLike, drawing: bool) -> None:
        self.settings, samplers = read_random_settings(settings, ExcitationSettings)
        truth = self.configure(batch, reality, samplers, model_of(self.settings), FINEST, model_of)
        others = {one.preset for one in self.drawn.extremes()} - {DIAGNOSED}
        if isinstance(reality, str | Path) and self.reality.base and others:
            raise ModelError(
                f"{reality}: its base parameters are of the vehicle {DIAGNOSED!r}, the one diagnosed, but "
                f"the environment's is {min(others)!r}; set preset: {DIAGNOSED}"
            )
        self.simulated = self.shakers = Shakers(
            batch,
            self.settings,
            truth.typical,
            possible=truth.extremes,
            stock=truth.stock,
        )
        self._rules = _rules(self.settings, batch)
        self.elapsed = np.zeros(batch, dtype=np.int64)
        self.below_since = np.full(batch, -1, dtype=np.int64)
        self._shaken: Shaken | None = None
        self._value: Floats | None = None
        self._traces: list[deque[tuple[Floats, Floats]]] | None = None
        if drawing:
            self._traces = [deque(maxlen=self.most_steps) for _ in range(batch)]

    def spaces(self) -> tuple[Box, Box]:
        """Action and observation space of one vehicle."""
        low = np.r_[np.full(UNKNOWNS, -MEAN_BOUND), np.full(UNKNOWNS, LOG_LOW), [-1, -1, -1, -1, -1, 0]]
        high = np.r_[np.full(UNKNOWNS, MEAN_BOUND), np.full(UNKNOWNS, LOG_HIGH), [1, 1, 1, 1, 1, 1]]
        seen = Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)
        return Box(-1.0, 1.0, (3,), np.float32), seen

    def resume(self, rows: list[int], vectors: Floats) -> None:
        """See ``BatchTask.resume``; a snapshot holds the vehicles as they have become."""

    def set_settings(self, row: int, settings: Any) -> None:
        """See ``BatchTask.set_settings``."""
        self.shakers.set_rules(row, settings)
        self._rules[row] = _rules(settings, 1)[0]

    def begin(self, rows: list[int]) -> None:
        """Begin new episodes of some vehicles."""
        self.shakers.begin(rows)
        self.elapsed[rows] = 0
        self.below_since[rows] = -1
        self._shaken = self._value = None
        if self._traces is not None:
            for i in rows:
                self._traces[i].clear()

    @property
    def shaken(self) -> Shaken:
        """Where the experiments stand."""
        if self._shaken is None:
            self._shaken = self.shakers.observe()
        return self._shaken

    def step(self, actions: Floats) -> Outcome:
        """Shake every vehicle for one decision."""
        before = self._worth(self.shaken) if self._value is None else self._value
        low, high = self.shakers.ranges
        commands = low + (high - low) * (actions + 1.0) / 2.0
        shaken = self._shaken = self.shakers.advance(commands, traces=self._traces is not None)
        self._value = self._worth(shaken)
        reward = self._value - before
        self.elapsed += 1
        if self._traces is not None:
            assert shaken.motion is not None
            assert shaken.bodies is not None
            for i, traces in enumerate(self._traces):
                traces.append((shaken.motion[i, 1:, 0], shaken.bodies[i]))
        return Outcome(
            observation=self.observation(),
            reward=reward,
            terminated=np.zeros(len(self.elapsed), dtype=np.bool_),
            truncated=self.elapsed >= self._rules["decisions"],
            info=self.reset_info(),
        )

    def _worth(self, shaken: Shaken) -> Floats:
        """What the experiments are worth as they stand, by the settings' reward, shape (batch,)."""
        shakers = self.shakers
        value = np.empty(len(self.elapsed))
        fill_worth(shaken.bits, shaken.covariance, shakers.nominal, shakers.estimated, self._rules, value)
        return value

    def observation(self) -> NDArray[np.float32]:
        """What is known and where the arm is, shape (batch, 50)."""
        shaken = self.shaken
        observed = np.empty((len(self.elapsed), 2 * UNKNOWNS + 6), dtype=np.float32)
        observe(
            shaken.mean, shaken.covariance, shaken.command, shaken.phase, *self.shakers.ranges, self.elapsed,
            self._rules, observed,
        )  # fmt: skip
        return observed

    def reset_info(self) -> Info:
        """The info, the same after ``reset`` as after a step."""
        shaken, truth = self.shaken, self.shakers.truth
        numbers = np.empty((len(NUMBERS) + 1, len(self.elapsed)))
        score(
            shaken.mean, shaken.mean_naive, shaken.bits, shaken.bits_naive, truth, self.shakers.estimated,
            self.elapsed, self.below_since, *self.shakers.streams, numbers,
        )  # fmt: skip
        others = {
            "noise_draw": numbers[len(NUMBERS)],
            "information": shaken.bits,
            **known(shaken),
            "base": shaken.base,
            "privileged.truth": truth,
            "privileged.error": shaken.mean - truth,
            **self.drawn.info,
        }
        return Info(NUMBERS, numbers[: len(NUMBERS)], others)

    def state(self) -> dict[str, Any]:
        """Everything that the next steps depend on but the random generators."""
        parts = {f"shakers.{key}": value for key, value in self.shakers.state().items()}
        return {**parts, "elapsed": self.elapsed.copy(), "below_since": self.below_since.copy()}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Return to a snapshot."""
        prefix = "shakers."
        self.shakers.set_state({k[len(prefix) :]: v for k, v in state.items() if k.startswith(prefix)})
        self.elapsed[:] = state["elapsed"]
        self.below_since[:] = state["below_since"]
        self._shaken = self._value = None
        for traces in self._traces or ():
            traces.clear()

    def frame(self, i: int, sample: int = -1) -> Frame:
        """Draw one vehicle; ``sample`` of the latest decision, -1 for its end."""
        from fieldgym.rendering.excitation import Scene, draw

        assert self._traces is not None
        shaken, truth, arm = self.shaken, self.shakers.truth[i], self.shakers.arm
        kept = self._traces[i]
        per_decision = len(kept[0][0]) if kept else 1
        base, angles, largest = np.zeros((3, 6)), np.zeros(0), (0.0, 0.0)
        if kept:
            cut = per_decision if sample < 0 else sample + 1
            base = kept[-1][1][:, cut - 1]
            angles = np.concatenate([*(a for a, _ in list(kept)[:-1]), kept[-1][0][:cut]])
            bodies = np.abs([b for _, b in kept]).max(axis=(0, 1, 2))
            largest = float(bodies[:3].max()), float(bodies[3:].max())
        # Decisions before a restored snapshot are not drawn.
        first = self.elapsed[i] - len(kept)
        times = DECISION * (first + np.arange(1, len(angles) + 1) / per_decision)
        spread = 100.0 / np.sqrt(12.0 * PRIOR_VARIANCE)
        estimated = np.flatnonzero(self.shakers.estimated).tolist()
        groups = {title: [k for k in places if k in estimated] for title, places in GROUPS.items()}
        counted = self.shakers.estimated
        return draw(
            Scene(
                time=float(times[-1]) if len(times) else DECISION * int(self.elapsed[i]),
                duration=DECISION * self.drawn.settings[i].decisions,
                base=base,
                largest=largest,
                joint=truth[CG:DAMPING],
                length=2.0 * arm.reach,
                times=times,
                angles=angles,
                command=tuple(shaken.command[i].tolist()),
                names=NAMES,
                groups={title: places for title, places in groups.items() if places},
                bits=shaken.bits[i],
                bits_naive=shaken.bits_naive[i],
                most=self.drawn.settings[i].bits,
                errors=spread * (shaken.mean[i] - truth),
                errors_naive=spread * (shaken.mean_naive[i] - truth),
                percent=(
                    error_percent(shaken.mean[i], truth, counted)[0],
                    error_percent(shaken.mean_naive[i], truth, counted)[0],
                ),
            )
        )


class ExcitationEnv(TaskEnv):
    r"""Shake a vehicle with its own arm to identify its unknown mass, inertia and suspension.

    ## Description

    A vehicle stands on springs and dampers in all six directions. An arm on it swings about its base joint;
    an accelerometer, an inclinometer and a force/torque sensor under the arm measure the vehicle's
    response. 22 parameters are unknown: mass, inertia, centre of gravity, damping, stiffness. They enter
    the equations of motion linearly, *A x = F*, eq (4) of V. A. Sujan and S. Dubowsky, "An optimal
    information method for mobile manipulator dynamic parameter identification", IEEE/ASME Trans.
    Mechatronics 8(2), 2003. A filter estimates them.

    Every 0.4 s the agent chooses the arm's next sinusoid f(t) = a0 + a sin(*w* t). The same motion runs
    three times, the arm turning about x, y and z: 18 equations a sample, 80 samples a decision. [Physics,
    agents and results](../excitation.md).

    ## Action Space

    `Box(-1, 1, (3,), float32)`.

    | Num | Action | -1 | 0 | +1 |
    |-----|--------|----|---|----|
    | 0 | amplitude *a* | 0 | 0.79 rad | 1.57 rad |
    | 1 | frequency *w* | 0.5 rad/s | 6.25 rad/s (`paper`: 1.75) | 12 rad/s (`paper`: 3) |
    | 2 | offset *a0* | -1.57 rad | 0 | 1.57 rad |

    All three pass to the new values within the 0.4 s by a quintic. The acceleration stays within 25 rad/s²
    (`paper`: 5); a steady sinusoid may use nine tenths of it, which cuts the amplitude.

    ## Observation Space

    `Box(low, high, (50,), float32)`

    | Num | Observation | Min | Max |
    |-----|-------------|-----|-----|
    | 0-21 | estimates, less the prior's mean, in standard deviations of the prior | -5 | 5 |
    | 22-43 | natural logarithm of their standard deviations, in those of the prior | -12 | 1 |
    | 44-46 | command in force, scaled as an action | -1 | 1 |
    | 47, 48 | cosine and sine of the arm's phase | -1 | 1 |
    | 49 | remaining share of the decisions | 0 | 1 |

    Parameters are in Table I's order: mass; inertia x, y, z, xz, yz, xy; c.g. x, y, z; damping x, y, z,
    pitch, roll, yaw; stiffness likewise. True values are never observed.

    ## Rewards

    The bits about all parameters that the filter gains in the step, eqs (9)-(15), in the form that depends
    on standard deviations alone.

    With `reward="relative_error"`: log2 of the expected relative error before the step over that after it,
    the mean of standard deviation over nominal value (where not zero). It ranks motions by Table I's error
    where bits do not. `weights` weigh groups of parameters in either.

    `info` holds after each step, and after `reset`

    | Key | Meaning |
    |-----|---------|
    | `bits` | information about all parameters [bits] |
    | `error_percent` | average error in percent of the true value, over those that are not zero (Table I) |
    | `error_normalised` | average error in percent of the prior's range |
    | `bits_naive`, `error_percent_naive`, `error_normalised_naive` | of the published (naive) filter |
    | `reached_20`, `time_to_20` | 1 while the error is below 20 %; since when, or the time so far [s] |
    | `time` | since the start [s] |
    | `noise_draw` | mean of the draws behind the latest sample's noise, in (-1, 1): equal for all agents |
    | `information` | about each parameter [bits], shape (22,) |
    | `estimate.mean`, `.covariance` | of the filter, shapes (22,) and (22, 22) |
    | `estimate.moments`, `.noise`, `.samples` | its sums |
    | `arm.command`, `arm.phase` | in force: *a* [rad], *w* [rad/s], *a0* [rad]; phase [rad] |
    | `base` | measured at the latest sample: dr, dr', dθ, ω of each run, shape (3, 12) |
    | `variances` | of the noise of each measured signal, shape (3, 24) |
    | `privileged.truth`, `privileged.error` | 22 true values, and estimates less these |

    An agent with a model may use `estimate`, `arm`, `base`, `variances`.

    ## Starting State

    The vehicle is at rest. The arm is in the source's constant excitation (24), *a* = 40 deg, *w* = 90
    deg/s, *a0* = 45 deg, at phase 0. The filter has the prior's mean and variance. The vehicle is the
    `preset`, or one near it with `truth_spread`: train with 0.3, since an agent may memorise the schedule
    of one vehicle.

    ## Episode End

    Truncated after `decisions` decisions; never terminated.

    ## Arguments

    ```python
    import gymnasium as gym

    gym.make(
        "fieldgym:fieldgym/Excitation-v0",
        settings={"preset": "soft", "limits": "paper"},
        reality={"payload": {"mass": 0.2}},
        render_mode="rgb_array",
    )
    gym.make_vec("fieldgym/Excitation-v0", num_envs=64)  # one kernel, same bits
    ```

    `reality` takes effects of the machine `excitation`, stock effects, or the path of an `extended.yaml` (of
    the `soft` vehicle); the filters go on assuming eq (4). `render_mode` is `rgb_array` (960 x 540, a frame
    a decision; `step_frames` slices it) or `human`. [What all environments share](../your_library.md).

    ## Matches, deviates, assumed

    - **Matches**: dynamics, unknowns, arm, noise, sampling and information; a constant action of (24) gives
      the source's motion.
    - **Deviates**: the default filter compensates for the noise in *A*; the [published
      one](../parameter_estimation.md), which takes *A* for exact, is scored too.
    - **Assumed**: [what the source leaves open](../excitation.md); limits of the arm and the passage between
      commands.

    ## Version History

    - v0: first version
    """

    batch_task = _ExcitationTask
    title = "excitation"
    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 4}  # noqa: RUF012

    def step_frames(self, frames_per_second: float) -> Iterator[Frame]:
        """Draw the latest decision in slices of time, for films; needs a render mode.

        Args:
            frames_per_second: Pictures for each second of the experiment.
        """
        assert isinstance(self._task, _ExcitationTask)
        count = max(1, round(DECISION * frames_per_second))
        for k in range(1, count):
            yield self._task.frame(0, round(SAMPLES * k / count) - 1)
        yield self._task.frame(0)


class ExcitationVectorEnv(TaskVectorEnv):
    """Many vehicles in one kernel; each row is ``ExcitationEnv`` to the bit."""

    batch_task = _ExcitationTask
