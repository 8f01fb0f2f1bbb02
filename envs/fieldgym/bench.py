"""Any machine as an environment: a rig, a pendulum, or a user's own, that is to follow a reference."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from pydantic import ConfigDict
from pydantic.dataclasses import dataclass

from fieldgym.base import (
    BatchTask,
    Flags,
    Floats,
    OfTask,
    Outcome,
    RealityLike,
    TaskEnv,
    TaskVectorEnv,
)
from fieldgym.randomisation import EpisodeParameters
from fieldgym.settings import SettingsError, read_random_settings
from fieldmodels.drivers.batch import BatchDriver
from fieldmodels.drivers.named import apply_reality, model_named_in, without_followed
from fieldmodels.machine import Machine
from fieldmodels.model import check_instance
from fieldmodels.model_files import is_model_file
from fieldmodels.names import did_you_mean
from fieldmodels.registry import get_model
from fieldmodels.settings import Setting

if TYPE_CHECKING:
    from fieldgym.rendering.canvas import Frame

WAVES = 3
"""Sines that make up a reference."""
ONE = "all rows share it"
WORST = 1.0
"""Most that a step costs for its error."""


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class BenchSettings:
    """What the machine has to do, and how it is driven; each field says its unit and bounds."""

    step: Annotated[float, Setting("Time that a command is held.", "s", above=0, fixed=ONE)] = 0.01
    duration: Annotated[float, Setting("Length of an episode.", "s", above=0, fixed=ONE)] = 10.0
    track: Annotated[str, Setting("Output that follows the reference; empty for the first.", fixed=ONE)] = ""
    reach: Annotated[
        float, Setting("Largest reference; 0 for the machine's typical size.", least=0, fixed=ONE)
    ] = 0.0
    fastest: Annotated[float, Setting("Highest frequency in the reference.", "Hz", above=0)] = 0.5
    command: Annotated[
        float, Setting("Largest command; 0 for the machine's typical one.", least=0, fixed=ONE)
    ] = 0.0
    effort: Annotated[float, Setting("Cost of a step at the largest command.", least=0, fixed=ONE)] = 0.0
    start: Annotated[
        float, Setting("Spread of the tracked output at the start, as a share of `reach`.", least=0)
    ] = 0.0
    noise: Annotated[float, Setting("Factor on the sensors' noise.", least=0)] = 1.0
    escape: Annotated[float, Setting("Times `reach` at which the episode ends.", above=1, fixed=ONE)] = 10.0


class BenchTask(BatchTask):
    """A batch of one machine.

    Attributes:
        machine: The machine, in its reality.
    """

    def __init__(
        self, batch: int, settings: Any, reality: RealityLike, drawing: bool, nominal: Machine
    ) -> None:
        """Make a batch of a machine; see ``BatchTask``."""
        del drawing
        self.settings, samplers = read_random_settings(settings, BenchSettings)
        machine, self.reality = without_followed(*apply_reality(nominal, reality))
        assert isinstance(machine, Machine)
        self.machine = machine
        self.drawn = EpisodeParameters(batch, machine, self.reality, self.settings, samplers)
        outputs = [s.name for s in machine.outputs]
        track = self.settings.track or outputs[0]
        if track not in outputs:
            raise SettingsError(f"track: no output {track!r}{did_you_mean(track, outputs)}")
        self.tracked = outputs.index(track)
        largest, typical = machine.typical(track)
        self.command = self.settings.command or largest
        self.reach = self.settings.reach or typical
        self.steps: int = max(1, round(self.settings.duration / self.settings.step))
        self.simulated = self.driver = BatchDriver(
            machine, self.drawn.vectors, self.settings.step, self.command
        )
        self.elapsed = np.zeros(batch, dtype=np.int64)
        self._keys = np.zeros(batch, dtype=np.uint64)
        self._noise = np.zeros((batch, self.steps + 1, len(outputs)))
        self._reference = np.zeros((batch, self.steps + 2))
        self._deviations = np.array([s.noise for s in machine.outputs])

    @property
    def most_steps(self) -> int:
        """See ``BatchTask.most_steps``."""
        return self.steps

    def spaces(self) -> tuple[Box, Box]:
        """Commands as shares of the largest; measured outputs, the reference now and a step ahead."""
        count = len(self.machine.outputs) + 2
        inputs = max(len(self.machine.inputs), 1)
        return Box(-1.0, 1.0, (inputs,), np.float32), Box(-np.inf, np.inf, (count,), np.float32)

    def set_reality(self, rows: list[int], vectors: Floats) -> None:
        """See ``BatchTask.set_reality``."""
        self.driver.set_parameters(rows, vectors)

    def set_settings(self, row: int, settings: BenchSettings) -> None:
        """See ``BatchTask.set_settings``; ``begin`` reads those of each row where they were drawn."""

    def draw_key(self, row: int, generator: np.random.Generator) -> None:
        """Draw what keys an episode's start, noise and reference."""
        self._keys[row] = generator.integers(2**63)

    def begin(self, rows: list[int]) -> None:
        """Begin new episodes of some machines."""
        states = np.zeros((len(rows), len(self.machine.states)))
        names = [s.name for s in self.machine.states]
        track = self.machine.outputs[self.tracked].name
        for k, row in enumerate(rows):
            own, rng = self.drawn.settings[row], np.random.default_rng(int(self._keys[row]))
            first = own.start * self.reach * rng.uniform(-1.0, 1.0)
            if track in names:
                states[k, names.index(track)] = first
            self._noise[row] = own.noise * self._deviations * rng.standard_normal(self._noise.shape[1:])
            self._reference[row] = self._wave(own.fastest, rng)
        self.driver.begin(rows, states)
        self.elapsed[rows] = 0

    def _wave(self, fastest: float, rng: np.random.Generator) -> Floats:
        """A reference from zero: sines up to the highest frequency [Hz], shape (steps + 2,)."""
        time = np.arange(self.steps + 2) * self.settings.step
        frequencies = fastest * rng.uniform(0.2, 1.0, WAVES)
        phases = rng.uniform(0.0, 2 * np.pi, WAVES)
        waves = np.sin(2 * np.pi * np.outer(time, frequencies) + phases).sum(axis=1) / WAVES
        return np.asarray(self.reach * waves * np.minimum(time * fastest, 1.0))

    def measured(self) -> Floats:
        """What the sensors measure, shape (batch, outputs)."""
        noise: Floats = self._noise[np.arange(len(self.elapsed)), np.minimum(self.elapsed, self.steps)]
        return self.driver.measured() + noise

    def observation(self) -> NDArray[np.float32]:
        """Measured outputs, the reference now and a step ahead, shape (batch, outputs + 2)."""
        rows, at = np.arange(len(self.elapsed)), np.minimum(self.elapsed, self.steps)
        ahead = np.column_stack([self._reference[rows, at], self._reference[rows, at + 1]])
        return np.column_stack([self.measured(), ahead]).astype(np.float32)

    def reset_info(self) -> dict[str, Any]:
        """The info that ``reset`` returns."""
        return {"privileged.states": self.driver.states.copy(), **self.drawn.info}

    def step(self, actions: NDArray[Any]) -> Outcome:
        """Hold the commands for a step, shape (batch, inputs), as shares of the largest."""
        self.driver.advance(actions * self.command)
        self.elapsed += 1
        rows, at = np.arange(len(self.elapsed)), np.minimum(self.elapsed, self.steps)
        sensed = self.driver.before[:, self.tracked]
        error = sensed - self._reference[rows, at]
        escaped: Flags = ~(np.abs(sensed) <= self.settings.escape * self.reach)
        cost = np.minimum((np.nan_to_num(error, nan=np.inf) / self.reach) ** 2, WORST)
        # Who escapes pays the worst for what is left of the episode, so that nobody gains by it.
        cost = np.where(escaped, WORST * (1 + np.maximum(self.steps - self.elapsed, 0)), cost)
        cost += self.settings.effort * np.mean(actions**2, axis=1)
        return Outcome(
            observation=self.observation(),
            reward=-cost,
            terminated=escaped,
            truncated=(self.elapsed >= self.steps) & ~escaped,
            info={
                "error": error,
                "cost": cost,
                "distance": np.abs(error) / self.reach,
                "command": actions * self.command,
                "effort": np.mean(np.abs(actions), axis=1),
                "escaped": escaped.astype(np.float64),
                "privileged.states": self.driver.states.copy(),
                **self.drawn.info,
            },
        )

    def state(self) -> dict[str, Any]:
        """Everything that the next steps depend on but the random generators."""
        return {
            "machines": self.driver.state(),
            "elapsed": self.elapsed.copy(),
            "noise": self._noise.copy(),
            "reference": self._reference.copy(),
            "keys": self._keys.copy(),
        }

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Return to a snapshot."""
        self.driver.set_state(state["machines"])
        self.elapsed[:] = state["elapsed"]
        self._noise[:] = state["noise"]
        self._reference[:] = state["reference"]
        self._keys[:] = state["keys"]

    def frame(self, i: int) -> Frame:
        """Draw the reference and how far the tracked output is from it."""
        from fieldgym.rendering.bench import draw

        signal = self.machine.outputs[self.tracked]
        return draw(
            f"{self.machine.name}: {signal.name} [{signal.unit}]",
            self._reference[i],
            int(self.elapsed[i]),
            float(self.driver.before[i, self.tracked]),
            self.reach,
        )


class OfMachine(OfTask):
    """An environment of a machine.

    Attributes:
        machine: The machine, or its name for ``fieldmodels.registry.get_model``.
    """

    machine: Machine | str

    def __getstate__(self) -> dict[str, Any]:
        kept = super().__getstate__()
        if isinstance(self.machine, str) and is_model_file(self.machine):
            kept["machine"] = type(get_model(self.machine)).file
        return kept

    def _make_task(self, reality: RealityLike) -> BenchTask:
        found = get_model(self.machine)
        if not isinstance(found, Machine):
            raise SettingsError(f"model {found.name!r} is no Machine; only those can be stepped one by one")
        self.title = found.name
        return BenchTask(self._rows, self._given, reality, False, found)


class BenchEnv(OfMachine, TaskEnv):
    """A machine as an environment, see `as_env`."""

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 30}  # noqa: RUF012

    def __init__(self, machine: Machine | str, *options: Any) -> None:
        """Take a machine, and what a `TaskEnv` takes."""
        self.machine = machine
        super().__init__(*options)


class BenchVectorEnv(OfMachine, TaskVectorEnv):
    """Many of a machine as a vector environment, see `as_env`."""

    def __init__(self, machine: Machine | str, *options: Any, **more: Any) -> None:
        """Take a machine, and what a `TaskVectorEnv` takes."""
        self.machine = machine
        super().__init__(*options, **more)


def as_env(
    machine: Machine | str,
    settings: BenchSettings | Mapping[str, Any] | None = None,
    reality: RealityLike = None,
    render_mode: str | None = None,
    num_envs: int | None = None,
    autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
) -> TaskEnv | TaskVectorEnv:
    """Make an environment of any machine: its first output (or ``track``) is to follow a reference.

    The simulation is that of the machine's model, effects included: what a diagnosis has found can be trained
    in. Observation: what the sensors measure, the reference now and a step ahead. Action: each command as a
    share of the largest. Reward: minus the squared error by ``reach``, at most 1 a step.

    Args:
        machine: A machine, or its name for ``fieldmodels.registry.get_model``.
        settings: See ``BenchSettings``.
        reality: What the simulation truly is: effects, or an ``extended.yaml``.
        render_mode: As for ``gymnasium.make``.
        num_envs: Number of rows of a vector environment; by default a scalar environment.
        autoreset_mode: Of a vector environment, see `TaskVectorEnv`.

    Returns:
        The scalar environment, or with ``num_envs`` the vector environment.

    Raises:
        SettingsError: For settings that cannot be.
        ModelError: For a reality that the machine does not have, a model that is no ``Machine``, or a class.
    """
    check_instance(machine)
    if num_envs is None:
        return BenchEnv(machine, settings, reality, render_mode)
    return BenchVectorEnv(machine, num_envs, settings, reality, render_mode, autoreset_mode=autoreset_mode)


def make_bench(
    config: str | Path = "",
    machine: str = "",
    settings: BenchSettings | Mapping[str, Any] | None = None,
    reality: RealityLike = None,
    render_mode: str | None = None,
    num_envs: int | None = None,
    autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
) -> TaskEnv | TaskVectorEnv:
    """A bench as a task, ``fieldgym/Bench-v0``: a machine, nominal or as a diagnosis has found it.

    Args:
        config: ``extended.yaml`` of a diagnosis; empty for the nominal machine, or for that of ``reality``.
        machine: Name or Python file of the machine; by default ``config`` names it.
        settings: See ``BenchSettings``.
        reality: See ``as_env``; by default what ``config`` holds.
        render_mode: As for ``gymnasium.make``.
        num_envs: As for ``gymnasium.make_vec``.
        autoreset_mode: Likewise.

    Raises:
        SettingsError: As ``as_env``; also if neither a machine nor a file is given.
        ModelError: As ``as_env``; also if the file names no model.
    """
    if not (config or machine):
        raise SettingsError('which bench? give machine="pendulum", or config="extended.yaml" of a diagnosis')
    learned = reality if reality is not None else config or None
    chosen = machine or model_named_in(config)
    return as_env(chosen, settings, learned, render_mode, num_envs, autoreset_mode)
