"""What a training run is: the typed form of ``configs/<task>/<algorithm>.yaml``."""

from __future__ import annotations

import hashlib
import json
from typing import Annotated, Literal

from pydantic import Field, PositiveFloat, PositiveInt, ValidationInfo, field_validator

from fieldagents.config import Config, EnvironmentConfig, Name, ProblemsError, check_environment, check_task
from fieldagents.evaluation.seeds import TRAINING_SEEDS, TUNING_SEEDS

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


class NetworkConfig(Config):
    """The policy's and the value's networks: two equal, separate perceptrons."""

    hidden: tuple[PositiveInt, ...] = (64, 64)
    """Units of each hidden layer; an empty list is a linear policy."""
    activation: Literal["tanh", "relu"] = "tanh"
    log_std_init: float = 0.0
    """Logarithm of the first standard deviation of the actions (continuous actions only)."""


class NormaliseConfig(Config):
    """Running normalisation; the observation's statistics travel with the policy."""

    observation: bool = True
    reward: bool = False
    clip: PositiveFloat = 10.0
    """Normalised values are clipped to plus and minus this."""


class ValidationConfig(Config):
    """Scoring of the deterministic policy during training; the best one is kept."""

    every: PositiveInt = 10
    """Updates between two scores."""
    episodes: Annotated[int, Field(ge=1, le=len(VALIDATION_SEEDS))] = 32


class TrainConfig(Config):
    """A training run, whole."""

    name: Name
    """Name of the run; its folder is ``runs/<task>/<name>-<hash of this config>``."""
    task: str
    """Name of the task, as ``fieldgym list`` prints it."""
    algorithm: Literal["ppo"] = "ppo"
    seed: Annotated[int, Field(ge=0, lt=RUNS_MOST)] = 0
    steps: PositiveInt
    """Environment steps; training ends with the update that reaches them."""
    num_envs: Annotated[int, Field(ge=1, le=ENVIRONMENTS_MOST)] = 64
    checkpoint_every: PositiveInt = 10
    """Updates between two checkpoints."""
    environment: EnvironmentConfig = EnvironmentConfig()
    ppo: PpoConfig = Field(default=PpoConfig(), validate_default=True)
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

    @field_validator("ppo")
    @classmethod
    def _batch_fits(cls, ppo: PpoConfig, info: ValidationInfo) -> PpoConfig:
        rollout = ppo.n_steps * info.data.get("num_envs", ppo.batch_size)
        if rollout % ppo.batch_size:
            message = (
                f"{ppo.batch_size} does not divide the {rollout} steps of an update"
                f" (ppo.n_steps {ppo.n_steps} x num_envs {info.data['num_envs']})"
            )
            raise ProblemsError([(("batch_size",), message)])
        return ppo

    @property
    def hash(self) -> str:
        """Eight hexadecimal digits that stand for every value of this config."""
        text = json.dumps(self.model_dump(mode="json"), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:8]

    @property
    def environment_seed(self) -> int:
        """Seed of the first training environment; the others count on from it."""
        return TRAINING_SEEDS.start + ENVIRONMENTS_MOST * self.seed
