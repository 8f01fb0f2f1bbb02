"""What a training run is: the typed form of ``configs/<task>/<algorithm>.yaml``."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field, PositiveFloat, PositiveInt

from fieldagents.config import (
    Config,
    EnvironmentConfig,
    Name,
    Problems,
    TaskEnvironment,
    TaskName,
    checked,
    wrong_environment,
)
from fieldagents.evaluation.agents import known_agent
from fieldagents.made import Made, imported, imported_class, wrong_arguments_of
from fieldagents.policies.algorithms import (
    default_of,
    find_algorithm,
    find_policy,
    is_on_policy,
    wrong_arguments,
)
from fieldagents.policies.conditioned import conditions_of
from fieldagents.policies.zoo import get_entry
from fieldagents.seeds import TRAINING_SEEDS, TUNING_SEEDS

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

VALIDATION_SEEDS = TUNING_SEEDS[-1000:]
"""Episode seeds on which a run chooses its best policy: the last thousand of the tuning seeds."""

ENVIRONMENTS_MOST = 1_000
RUNS_MOST = len(TRAINING_SEEDS) // ENVIRONMENTS_MOST


def _wrong_features(features: Mapping[str, Mapping[str, Any]] | None) -> Problems:
    for place, arguments in (features or {}).items():
        try:
            problem = wrong_arguments_of(imported(place), arguments, before=1)
        except ValueError as error:
            problem = str(error)
        if problem:
            yield (), problem


def _is_class(key: str, value: Any) -> bool:
    return key.endswith("_class") and isinstance(value, str)


def _wrong_classes(more: dict[str, Any]) -> Problems:
    for key, value in more.items():
        if _is_class(key, value):
            try:
                imported(value)
            except ValueError as error:
                yield (key,), str(error)


class NetworkConfig(Config):
    """The policy's and the value's networks: equal, separate perceptrons."""

    hidden: tuple[PositiveInt, ...] = (64, 64)
    """Units of each hidden layer; an empty list is a linear policy."""
    activation: Literal["tanh", "relu"] = "tanh"
    log_std_init: float | None = None
    """Logarithm of the first standard deviation of the actions, of policies that take one."""
    more: Annotated[dict[str, Any], checked(_wrong_classes)] = Field(default_factory=dict)
    """Further ``policy_kwargs`` of the library, such as ``{lstm_hidden_size: 64}``; of those that end in
    ``_class``, such as ``features_extractor_class``, the value is ``module:Class``."""

    @property
    def imported(self) -> dict[str, Any]:
        """The further arguments, with classes for their names."""
        return {key: imported(value) if _is_class(key, value) else value for key, value in self.more.items()}


class NormaliseConfig(Config):
    """Running normalisation; the observation's statistics travel with the policy."""

    observation: bool = True
    reward: bool = False
    clip: PositiveFloat = 10.0
    """Normalised values are clipped to plus and minus this."""


class ValidationConfig(Config):
    """Scoring of the deterministic policy during training; the best one is kept."""

    every: PositiveInt = 10
    """Rounds between two scores."""
    by: Literal["metric", "return"] = "metric"
    """What the best policy is chosen by: the task's metrics, the first that differs; or the mean return."""
    episodes: Annotated[int, Field(ge=1, le=len(VALIDATION_SEEDS))] = 32
    until_plateau: bool = False
    """Whether training ends before its last step where it has come to a plateau: over the last third of what
    has been trained, the mean return of the validation's episodes has risen by less than half its 95 %
    interval. After ten scores at the earliest."""


class ImitationConfig(Config):
    """Before anything is learned by reward: the policy learns to act as another agent would (DAgger).

    In the first round the teacher acts, then the policy does, and the teacher says what it would have done;
    each round the policy is fitted to all that was said so far.
    """

    teacher: str
    """Any agent that an evaluation knows; it is given what it may see, a privileged one the hidden truth."""
    rounds: PositiveInt = 10
    steps: PositiveInt = 200
    """Steps of each environment in a round."""
    epochs: PositiveInt = 4
    """Times that a round goes through all data."""
    batch_size: PositiveInt = 512
    learning_rate: PositiveFloat = 1e-3
    critic_updates: Annotated[int, Field(ge=0)] = 5
    """First updates of an on-policy algorithm that move its critic alone, which has learned nothing yet: its
    errors would lead the policy away from what was imitated."""


def _wrong_further(
    also: tuple[EnvironmentConfig, ...], task: str, first: EnvironmentConfig, rows: int, twins: int
) -> Problems:
    for i, one in enumerate(also):
        for at, message in wrong_environment(_filled_up(one, first), task):
            yield (i, *at), message
    if len(also) >= rows:
        yield (), f"{len(also) + 1} environments need as many rows at least: raise num_envs"
    if twins > 1 and rows % (twins * (len(also) + 1)):
        yield (), f"groups of {twins} twins in {len(also) + 1} environments do not divide num_envs, {rows}"


def _no_conditions(
    conditioned: bool, task: str, environment: EnvironmentConfig, also: tuple[EnvironmentConfig, ...]
) -> Problems:
    if conditioned:
        try:
            if environment.reality is None or not conditions_of(task, environment.reality):
                yield (), "no number of the environment's reality is drawn by a sampler"
        except ValueError as error:
            yield (), str(error)
        if also:
            yield (), "works without also"


def _no_algorithm(algorithm: str) -> Problems:
    find_algorithm(algorithm)
    return ()


def _no_policy(policy: str, algorithm: str) -> Problems:
    find_policy(find_algorithm(algorithm), policy)
    return ()


def _wrong_callbacks(callbacks: tuple[Mapping[str, Mapping[str, Any]], ...]) -> Problems:
    from stable_baselines3.common.callbacks import BaseCallback

    for i, one in enumerate(callbacks):
        for place, arguments in one.items():
            try:
                problem = wrong_arguments_of(imported_class(place, BaseCallback), arguments)
            except ValueError as error:
                problem = str(error)
            if problem:
                yield (i,), problem


def _no_beginning(begin: str | None, task: str, environment: EnvironmentConfig, seed: int) -> Problems:
    if begin is not None:
        training = get_entry(task, begin).nearest(environment.settings)
        if seed not in training.seeds:
            yield (), f"{training} has no run of seed {seed}"


def _no_teacher(imitate: ImitationConfig | None, task: str, steps: int) -> Problems:
    if imitate is None:
        if steps == 0:
            yield (), "without steps there must be somebody to imitate"
    elif problem := known_agent(imitate.teacher, task):
        yield ("teacher",), problem


def _wrong_learner(learner: dict[str, Any], algorithm: str, steps: int, num_envs: int) -> Problems:
    kind = find_algorithm(algorithm)
    problems = wrong_arguments(kind, learner) or _sizes_that_do_not_fit(kind, learner, steps, num_envs)
    return (((key,), message) for key, message in problems)


class TrainConfig(Config):
    """A training run, whole."""

    was: ClassVar[Mapping[str, str]] = {"told": "conditioned"}

    name: Name
    """Name of the run; its folder is ``runs/<task>/<name>-<hash of this config>``."""
    task: TaskName
    """Name of the task, as ``fieldgym list`` prints it."""
    algorithm: Annotated[str, checked(_no_algorithm)] = "ppo"
    """Of Stable-Baselines3 or sb3-contrib (``ppo``, ``sac``, ``recurrent_ppo``), or ``module:Class``."""
    policy: Annotated[str, checked(_no_policy, "algorithm")] = Field("MlpPolicy", validate_default=True)
    """The library's name of a policy, or ``module:Class`` of one's own."""
    seed: Annotated[int, Field(ge=0, lt=RUNS_MOST)] = 0
    steps: Annotated[int, Field(ge=0)]
    """Environment steps; training ends with the update that reaches them. 0: imitation alone."""
    num_envs: Annotated[int, Field(ge=1, le=ENVIRONMENTS_MOST)] = 64
    twins: PositiveInt = 1
    """Rows in a group that meets the same episodes and is rewarded by how much each does better than their
    mean; the score of a policy is that of the task. Only where noise does not depend on actions, and
    observations neither, is nothing lost by it."""
    stack: Annotated[int, Field(ge=1, le=100)] = 1
    """Observations that the policy is given at once, the latest last; zeros before an episode's first."""
    features: Annotated[Made | None, checked(_wrong_features)] = None
    """``module:Class`` of a ``torch.nn.Module``, or a mapping from it to keyword arguments that follow the
    observations' space: fixed features that the policy is given, and remembers, in place of the observations,
    the action just taken beside them."""
    round_updates: PositiveInt | None = None
    """Updates in a round, which is a row of the learning curve; 1 on-policy, 100 off-policy unless given."""
    checkpoint_every: PositiveInt = 10
    """Rounds between two checkpoints."""
    environment: TaskEnvironment = EnvironmentConfig()
    also: Annotated[
        tuple[EnvironmentConfig, ...], checked(_wrong_further, "task", "environment", "num_envs", "twins")
    ] = Field(default=(), validate_default=True)
    """Further environments, each with an equal share of the ``num_envs``: one policy is trained, and
    validated, in all of them. Settings that are not named are those of ``environment``."""
    conditioned: Annotated[bool, checked(_no_conditions, "task", "environment", "also")] = False
    """Whether the policy is told, beside each observation, what a diagnosis would say of the numbers that the
    reality draws: of each an estimate and its standard error."""
    learner: Annotated[dict[str, Any], checked(_wrong_learner, "algorithm", "steps", "num_envs")] = Field(
        default_factory=dict, validate_default=True
    )
    """The algorithm's own arguments, by the library's names, with its defaults. ``learning_rate_decay:
    linear`` lets the learning rate fall to zero at the end of training."""
    begin: Annotated[str | None, checked(_no_beginning, "task", "environment", "seed")] = None
    """Entry of the zoo from whose run of the same seed the policy begins; with the same ``network``."""
    imitate: Annotated[ImitationConfig | None, checked(_no_teacher, "task", "steps")] = Field(
        default=None, validate_default=True
    )
    callbacks: Annotated[tuple[Made, ...], checked(_wrong_callbacks)] = ()
    """Callbacks of Stable-Baselines3's interface: ``module:Class``, or a mapping from it to keyword
    arguments. What they keep for themselves is not in the checkpoints."""
    network: NetworkConfig = NetworkConfig()
    normalise: NormaliseConfig = NormaliseConfig()
    validation: ValidationConfig = ValidationConfig()

    @property
    def environments(self) -> tuple[EnvironmentConfig, ...]:
        """All environments, each whole."""
        return (self.environment, *(_filled_up(one, self.environment) for one in self.also))

    @property
    def kind(self) -> type[BaseAlgorithm]:
        """The class of the learner."""
        return find_algorithm(self.algorithm)

    @property
    def policy_kind(self) -> Any:
        """The policy as the learner takes it."""
        return find_policy(self.kind, self.policy)

    @property
    def update_steps(self) -> int:
        """Environment steps between two updates."""
        return int(self.argument("n_steps" if is_on_policy(self.kind) else "train_freq", 1)) * self.num_envs

    @property
    def round_steps(self) -> int:
        """Environment steps of a round: what a row of the learning curve stands for."""
        return self.update_steps * (self.round_updates or (1 if is_on_policy(self.kind) else 100))

    def argument(self, key: str, otherwise: Any = None) -> Any:
        """An argument of the learner, given or the library's default."""
        return self.learner.get(key, default_of(self.kind, key, otherwise))

    @property
    def hash(self) -> str:
        """Eight hexadecimal digits that stand for every value of this config."""
        text = json.dumps(self.model_dump(mode="json"), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:8]

    @property
    def environment_seed(self) -> int:
        """Seed of the first training environment; the others count on from it."""
        return TRAINING_SEEDS.start + ENVIRONMENTS_MOST * self.seed


def _sizes_that_do_not_fit(
    kind: type[BaseAlgorithm], learner: dict[str, Any], steps: int, num_envs: int
) -> list[tuple[str, str]]:
    """Arguments of a learner that contradict the size of the run."""

    def argument(key: str, otherwise: int) -> int:
        return int(learner.get(key, default_of(kind, key, otherwise)))

    n_steps, problems = argument("n_steps", 1), []
    if is_on_policy(kind):
        rows = n_steps * num_envs
        if rows % (batch := argument("batch_size", rows)):
            sizes = f"the {rows} steps of an update (n_steps {n_steps} x num_envs {num_envs})"
            problems.append(("batch_size", f"{batch} does not divide {sizes}"))
    elif steps:
        starts, size = argument("learning_starts", 0), argument("buffer_size", 1_000_000)
        if starts >= steps:
            problems.append(("learning_starts", f"{starts} leaves none of the {steps} steps"))
        if size < (least := (n_steps + 1) * num_envs):
            message = f"{size} is less than {least}, which n_steps and num_envs need"
            problems.append(("buffer_size", message))
    return problems


def _filled_up(one: EnvironmentConfig, first: EnvironmentConfig) -> EnvironmentConfig:
    """An environment with the settings and the wrappers of the first one where it has none of its own."""
    settings = {**first.settings, **one.settings}
    return one.model_copy(update={"settings": settings, "wrappers": one.wrappers or first.wrappers})
