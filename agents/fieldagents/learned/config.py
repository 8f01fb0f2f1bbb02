"""What a training run is: the typed form of ``configs/<task>/<algorithm>.yaml``."""

from __future__ import annotations

import hashlib
import json
import re
from typing import Annotated, Literal

from pydantic import Field, PositiveFloat, PositiveInt, ValidationInfo, field_validator

from fieldagents.config import (
    Config,
    EnvironmentConfig,
    Location,
    Name,
    ProblemsError,
    check_environment,
    check_task,
)
from fieldagents.seeds import TRAINING_SEEDS, TUNING_SEEDS

Fraction = Annotated[float, Field(ge=0.0, le=1.0)]

VALIDATION_SEEDS = TUNING_SEEDS[-1000:]
"""Episode seeds on which a run chooses its best policy: the last thousand of the tuning seeds."""

ENVIRONMENTS_MOST = 1_000
RUNS_MOST = len(TRAINING_SEEDS) // ENVIRONMENTS_MOST


class PpoConfig(Config):
    """Proximal policy optimisation, by the names of Stable-Baselines3."""

    n_steps: PositiveInt = 128
    """Steps of each environment between two updates."""
    batch_size: PositiveInt = 1024
    n_epochs: PositiveInt = 10
    learning_rate: PositiveFloat = 3e-4
    learning_rate_decay: Literal["constant", "linear"] = "constant"
    """``linear``: falls to zero at the end of training."""
    gamma: Fraction = 0.99
    gae_lambda: Fraction = 0.95
    clip_range: PositiveFloat = 0.2
    ent_coef: Annotated[float, Field(ge=0.0)] = 0.0
    vf_coef: PositiveFloat = 0.5
    max_grad_norm: PositiveFloat = 0.5
    target_kl: PositiveFloat | None = None


class SacConfig(Config):
    """Soft actor-critic, by the names of Stable-Baselines3."""

    buffer_size: PositiveInt = 1_000_000
    """Steps that the replay buffer keeps, of all environments together."""
    learning_starts: Annotated[int, Field(ge=0)] = 1_000
    """Steps of all environments together, with random actions, before the first update."""
    train_freq: PositiveInt = 1
    """Steps of each environment between two updates."""
    gradient_steps: Annotated[int, Field(ge=-1)] = 1
    """Gradient steps of an update; -1: as many as steps were made since the last one."""
    batch_size: PositiveInt = 256
    learning_rate: PositiveFloat = 3e-4
    learning_rate_decay: Literal["constant", "linear"] = "constant"
    """``linear``: falls to zero at the end of training."""
    gamma: Fraction = 0.99
    tau: Annotated[float, Field(gt=0.0, le=1.0)] = 0.005
    """Share of the new weights in the target networks at each gradient step."""
    n_steps: PositiveInt = 1
    """Rewards that are summed before the value takes over."""
    ent_coef: float | str = "auto"
    """Weight of the entropy; ``auto``: learned, beginning at 1; ``auto_0.1``: learned, beginning at 0.1."""
    target_entropy: float | str = "auto"
    """What the learned weight aims at; ``auto``: minus the number of actions."""
    target_update_interval: PositiveInt = 1
    log_interval: PositiveInt = 100
    """Updates in a round: the learning curve has a row for each round."""

    @field_validator("gradient_steps")
    @classmethod
    def _steps_are_taken(cls, gradient_steps: int) -> int:
        if gradient_steps == 0:
            raise ValueError("nothing is learned without gradient steps: at least 1, or -1, not 0")
        return gradient_steps

    @field_validator("ent_coef", "target_entropy")
    @classmethod
    def _auto_or_number(cls, value: float | str, info: ValidationInfo) -> float | str:
        if info.field_name == "target_entropy":
            if isinstance(value, str) and value != "auto":
                raise ValueError(f"a number or auto, not {value!r}")
        elif isinstance(value, str) and not re.fullmatch(r"auto(_\d*\.?\d+)?", value):
            raise ValueError(f"a number, auto or auto_0.1, not {value!r}")
        elif isinstance(value, float) and value < 0:
            raise ValueError(f"must not be negative, it is {value}")
        return value


class NetworkConfig(Config):
    """The policy's and the value's networks: equal, separate perceptrons."""

    hidden: tuple[PositiveInt, ...] = (64, 64)
    """Units of each hidden layer; an empty list is a linear policy."""
    activation: Literal["tanh", "relu"] = "tanh"
    log_std_init: float = 0.0
    """Logarithm of the first standard deviation of the actions (PPO with continuous actions only)."""


class NormaliseConfig(Config):
    """Running normalisation; the observation's statistics travel with the policy."""

    observation: bool = True
    reward: bool = False
    clip: PositiveFloat = 10.0
    """Normalised values are clipped to plus and minus this."""


class ValidationConfig(Config):
    """Scoring of the deterministic policy during training; the best one is kept."""

    every: PositiveInt = 10
    """Rounds between two scores: updates of PPO, ``log_interval`` updates of SAC."""
    episodes: Annotated[int, Field(ge=1, le=len(VALIDATION_SEEDS))] = 32


class TrainConfig(Config):
    """A training run, whole."""

    name: Name
    """Name of the run; its folder is ``runs/<task>/<name>-<hash of this config>``."""
    task: str
    """Name of the task, as ``fieldgym list`` prints it."""
    algorithm: Literal["ppo", "sac"] = "ppo"
    """Its keys are in the section of its name; the other's section must be left out."""
    seed: Annotated[int, Field(ge=0, lt=RUNS_MOST)] = 0
    steps: PositiveInt
    """Environment steps; training ends with the update that reaches them."""
    num_envs: Annotated[int, Field(ge=1, le=ENVIRONMENTS_MOST)] = 64
    checkpoint_every: PositiveInt = 10
    """Rounds between two checkpoints: updates of PPO, ``log_interval`` updates of SAC."""
    environment: EnvironmentConfig = EnvironmentConfig()
    ppo: PpoConfig | None = Field(default=None, validate_default=True)
    sac: SacConfig | None = Field(default=None, validate_default=True)
    network: NetworkConfig = NetworkConfig()
    normalise: NormaliseConfig = NormaliseConfig()
    validation: ValidationConfig = ValidationConfig()

    @field_validator("task")
    @classmethod
    def _task_exists(cls, task: str) -> str:
        return check_task(task)

    @field_validator("environment")
    @classmethod
    def _environment_fits(cls, environment: EnvironmentConfig, info: ValidationInfo) -> EnvironmentConfig:
        if "task" in info.data:
            check_environment(info.data["task"], environment)
        return environment

    @field_validator("ppo", "sac")
    @classmethod
    def _section_is_the_algorithms(
        cls, section: PpoConfig | SacConfig | None, info: ValidationInfo
    ) -> PpoConfig | SacConfig | None:
        algorithm = info.data.get("algorithm", info.field_name)
        if algorithm == info.field_name:
            return section or (PpoConfig() if algorithm == "ppo" else SacConfig())
        if section is not None:
            raise ValueError(
                f"the algorithm is {algorithm}: leave this section out, its keys are in {algorithm!r}"
            )
        return None

    @field_validator("ppo")
    @classmethod
    def _batch_fits(cls, ppo: PpoConfig | None, info: ValidationInfo) -> PpoConfig | None:
        if ppo is None:
            return None
        rollout = ppo.n_steps * info.data.get("num_envs", ppo.batch_size)
        if rollout % ppo.batch_size:
            message = (
                f"{ppo.batch_size} does not divide the {rollout} steps of an update"
                f" (ppo.n_steps {ppo.n_steps} x num_envs {info.data['num_envs']})"
            )
            raise ProblemsError([(("batch_size",), message)])
        return ppo

    @field_validator("sac")
    @classmethod
    def _buffer_fits(cls, sac: SacConfig | None, info: ValidationInfo) -> SacConfig | None:
        if sac is None:
            return None
        problems: list[tuple[Location, str]] = []
        steps = info.data.get("steps", sac.learning_starts + 1)
        if sac.learning_starts >= steps:
            problems.append((("learning_starts",), f"{sac.learning_starts} leaves none of the {steps} steps"))
        least = (sac.n_steps + 1) * info.data.get("num_envs", 1)
        if sac.buffer_size < least:
            message = f"{sac.buffer_size} is less than {least}, which n_steps and num_envs need"
            problems.append((("buffer_size",), message))
        if problems:
            raise ProblemsError(problems)
        return sac

    @field_validator("network")
    @classmethod
    def _network_fits(cls, network: NetworkConfig, info: ValidationInfo) -> NetworkConfig:
        if info.data.get("algorithm") == "sac" and network.log_std_init:
            message = "soft actor-critic computes the deviation by its network; leave this key out"
            raise ProblemsError([(("log_std_init",), message)])
        return network

    @property
    def learner(self) -> PpoConfig | SacConfig:
        """The section of the algorithm."""
        section = self.ppo if self.algorithm == "ppo" else self.sac
        assert section is not None
        return section

    @property
    def round_steps(self) -> int:
        """Environment steps of a round: what a row of the learning curve stands for."""
        if isinstance(self.learner, PpoConfig):
            return self.learner.n_steps * self.num_envs
        return self.learner.log_interval * self.learner.train_freq * self.num_envs

    @property
    def hash(self) -> str:
        """Eight hexadecimal digits that stand for every value of this config."""
        text = json.dumps(self.model_dump(mode="json"), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:8]

    @property
    def environment_seed(self) -> int:
        """Seed of the first training environment; the others count on from it."""
        return TRAINING_SEEDS.start + ENVIRONMENTS_MOST * self.seed
