"""What every YAML file may say, and a loader that reports all mistakes at once, each with its line."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    TypeAdapter,
    ValidationError,
    ValidationInfo,
    field_validator,
)
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from ruamel.yaml.nodes import MappingNode, SequenceNode

from fieldmodels.model import ModelError
from fieldmodels.names import did_you_mean
from fieldmodels.yaml import YamlError, load_yaml

Location = tuple[str | int, ...]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", description="used as a folder name")]


class ConfigError(ValueError):
    """Mistakes in a config file, all of them.

    Attributes:
        problems: One line each: place, key, what is wrong, what would be right.
    """

    def __init__(self, problems: Sequence[str]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(self.problems))


class ProblemsError(ValueError):
    """Raised inside a validator to report several problems below the place that is being validated."""

    def __init__(self, problems: Sequence[tuple[Location, str]]) -> None:
        self.problems = tuple(problems)
        super().__init__("; ".join(message for _, message in self.problems))


class Config(BaseModel):
    """Base of every config: unknown keys are mistakes, and nothing changes after loading."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def _mapping_or_path(value: Any) -> Any:
    if value is not None and not isinstance(value, dict | str):
        raise ValueError("must be a mapping of effects, as in {gyro_bias: {rate: 0.004}}, or a path")
    return value


RealityConfig = Annotated[Any, AfterValidator(_mapping_or_path)]


class EnvironmentConfig(Config):
    """A task's environment.

    Attributes:
        settings: Keys of the task's settings; what is not named keeps its default.
        reality: Effects that are on, or the path of an ``extended.yaml`` written by a diagnosis.
    """

    settings: dict[str, Any] = Field(default_factory=dict)
    reality: RealityConfig = None


def check_environment(task: str, environment: EnvironmentConfig) -> None:
    """Check settings and reality against the task.

    Raises:
        ProblemsError: With every unknown key, wrong value and unknown effect.
    """
    from fieldgym import TASKS

    problems: list[tuple[Location, str]] = []
    kind = TASKS[task].settings
    try:
        TypeAdapter(kind).validate_python(environment.settings)
    except ValidationError as error:
        problems += [(("settings", *at), message) for at, message in _readable(error, kind)]
    try:
        check_reality(TASKS[task].model, environment.reality)
    except ProblemsError as error:
        problems += [(("reality", *at), message) for at, message in error.problems]
    if problems:
        raise ProblemsError(problems)


def check_reality(model: str, reality: Any) -> None:
    """Check a reality against a model.

    Raises:
        ProblemsError: With every unknown effect, unknown parameter and value out of bounds.
    """
    from fieldmodels.reality import read_reality
    from fieldmodels.registry import get_model

    problems: list[tuple[Location, str]] = []
    chosen = get_model(model)
    for at, part in _parts(reality, [effect.name for effect in chosen.effects]):
        try:
            read_reality(part, chosen)
        except (ModelError, YamlError) as error:
            problems.append((at, str(error)))
    if problems:
        raise ProblemsError(problems)


def _parts(reality: Any, effects: Sequence[str]) -> Iterator[tuple[Location, Any]]:
    """A reality's single values, each with its place, so that each mistake is found and placed."""
    if not isinstance(reality, dict):
        yield (), reality
        return
    for name, values in reality.items():
        if isinstance(values, dict) and name in ("parameters", *effects):
            yield from (((name, key), {name: {key: value}}) for key, value in values.items())
        else:
            yield (name,), {name: values}


def check_task(name: str) -> str:
    """Return the task's name.

    Raises:
        ValueError: If there is no such task.
    """
    from fieldgym import TASKS

    if name not in TASKS:
        raise ValueError(f"there is no task {name!r}{did_you_mean(name, TASKS)}")
    return name


class EvaluateConfig(Config):
    """What `fieldgym evaluate` reads: which agents, on which environments, how many episodes.

    Attributes:
        name: Name of the result folder.
        task: Name of the task.
        environments: The scenarios: a name of one's own to settings and reality.
        agents: Names of reference or learned agents, or paths of ``policy.onnx`` files.
        baseline: The agent that all others are compared with; it is in ``agents`` too.
        episodes: Number of episodes of every agent in every scenario, the same published seeds for all.
    """

    name: Name
    task: str
    environments: dict[Name, EnvironmentConfig] = Field(min_length=1)
    agents: list[str] = Field(min_length=1)
    baseline: str
    episodes: int = Field(default=100, ge=2, le=10_000)

    @field_validator("task")
    @classmethod
    def _task_exists(cls, task: str) -> str:
        return check_task(task)

    @field_validator("environments")
    @classmethod
    def _environments_fit(
        cls, environments: dict[str, EnvironmentConfig], info: ValidationInfo
    ) -> dict[str, EnvironmentConfig]:
        problems: list[tuple[Location, str]] = []
        for name, environment in environments.items() if "task" in info.data else ():
            try:
                check_environment(info.data["task"], environment)
            except ProblemsError as error:
                problems += [((name, *at), message) for at, message in error.problems]
        if problems:
            raise ProblemsError(problems)
        return environments

    @field_validator("agents")
    @classmethod
    def _agents_exist(cls, agents: list[str], info: ValidationInfo) -> list[str]:
        from fieldagents.evaluation.entrants import agent_names

        problems: list[tuple[Location, str]] = []
        for i, name in enumerate(agents):
            if name in agents[:i]:
                problems.append(((i,), f"agent {name!r} is listed twice"))
            elif name.endswith(".onnx"):
                if not Path(name).is_file():
                    problems.append(((i,), f"no such file: {name}"))
            elif "task" in info.data and name not in (known := agent_names(info.data["task"])):
                problems.append(((i,), f"there is no agent {name!r}{did_you_mean(name, known)}"))
        if problems:
            raise ProblemsError(problems)
        return agents

    @field_validator("baseline")
    @classmethod
    def _baseline_takes_part(cls, baseline: str, info: ValidationInfo) -> str:
        from fieldagents.evaluation.entrants import agent_names

        agents = info.data.get("agents")
        if agents is not None and baseline not in agents:
            raise ValueError(f"{baseline!r} is not among the agents{did_you_mean(baseline, agents)}")
        if agents is None and "task" in info.data and not baseline.endswith(".onnx"):
            known = agent_names(info.data["task"])
            if baseline not in known:
                raise ValueError(f"there is no agent {baseline!r}{did_you_mean(baseline, known)}")
        return baseline


class RetuneConfig(Config):
    """What `fieldgym diagnose --then-retune` reads: which agent is designed anew, and where it is flown.

    Attributes:
        name: Name of the loop.
        task: Name of the task.
        agent: Name of a designer of the task: the agent that is made for each simulation.
        options: Effort of the design; the designer says which keys there are.
        settings: Keys of the task's settings, for designing and for flying.
        hidden: The reality that the recording came from, where it is known (a simulated robot's): effects
            that are on, or a path. Without it the extended simulation stands for it.
        metric: Metric that the loss is counted in; by default the task's first.
        episodes: Number of episodes of every agent in every simulation, the same published seeds for all.
    """

    name: Name
    task: str
    agent: str
    options: dict[str, Any] = Field(default_factory=dict)
    settings: dict[str, Any] = Field(default_factory=dict)
    hidden: RealityConfig = None
    metric: str | None = None
    episodes: int = Field(default=100, ge=2, le=10_000)

    @property
    def counted(self) -> str:
        """Name of the metric that the loss is counted in."""
        from fieldagents.evaluation.metrics import METRICS

        return self.metric or METRICS[self.task][0].name

    @field_validator("task")
    @classmethod
    def _task_exists(cls, task: str) -> str:
        from fieldagents.retune.designers import TABLES

        if check_task(task) not in TABLES:
            raise ValueError(f"no agent of {task} can be designed anew; tasks: {', '.join(TABLES)}")
        return task

    @field_validator("agent")
    @classmethod
    def _agent_exists(cls, agent: str, info: ValidationInfo) -> str:
        from fieldagents.retune.designers import designers

        if "task" in info.data and agent not in (known := designers(info.data["task"])):
            raise ValueError(
                f"no agent {agent!r} can be designed anew{did_you_mean(agent, known)}; there are "
                f"{', '.join(known)}"
            )
        return agent

    @field_validator("options")
    @classmethod
    def _options_fit(cls, options: dict[str, Any], info: ValidationInfo) -> dict[str, Any]:
        from fieldagents.retune.designers import designers

        if "task" in info.data and "agent" in info.data:
            kind = designers(info.data["task"])[info.data["agent"]].options
            try:
                kind.model_validate(options)
            except ValidationError as error:
                raise ProblemsError(list(_readable(error, kind))) from None
        return options

    @field_validator("settings")
    @classmethod
    def _settings_fit(cls, settings: dict[str, Any], info: ValidationInfo) -> dict[str, Any]:
        if "task" in info.data:
            try:
                check_environment(info.data["task"], EnvironmentConfig(settings=settings))
            except ProblemsError as error:
                raise ProblemsError([(at[1:], message) for at, message in error.problems]) from None
        return settings

    @field_validator("hidden")
    @classmethod
    def _hidden_fits(cls, hidden: Any, info: ValidationInfo) -> Any:
        from fieldgym import TASKS

        if "task" in info.data:
            check_reality(TASKS[info.data["task"]].model, hidden)
        return hidden

    @field_validator("metric")
    @classmethod
    def _metric_counts(cls, metric: str | None, info: ValidationInfo) -> str | None:
        from fieldagents.evaluation.metrics import METRICS

        if metric is None or "task" not in info.data:
            return metric
        known = {one.name: one for one in METRICS[info.data["task"]] if not one.common}
        if metric not in known:
            raise ValueError(f"there is no metric {metric!r}{did_you_mean(metric, known)}")
        if known[metric].may_miss:
            raise ValueError(f"{metric!r} has no value in some episodes; choose a metric that has one in all")
        return metric


class ExcitationConfig(Config):
    """How the input of a model is driven.

    Attributes:
        kind: ``mixed``, ``multisine``, ``prbs``, ``steps``, ``chirp``; or ``swing``, a smooth path.
        amplitude: Peak of the command, in the input's unit; of a swing, of the path.
    """

    kind: Literal["mixed", "multisine", "prbs", "steps", "chirp", "swing"] = "mixed"
    amplitude: float = Field(default=1.0, gt=0)


class WalkConfig(Config):
    """How a walker's noise behaves.

    Attributes:
        collision_kind: Kind of the collision noise.
        regimes: Whether the noise levels switch as in the environment; else they stay nominal.
    """

    collision_kind: Literal["low_pass", "ar1"] = "low_pass"
    regimes: bool = False


DRIVEN = ("excitation", "input", "step", "episodes", "noise")
"""Keys of a recording of a model with a commanded input."""

RECORD_KEYS = {
    "excitation": ("step", "episodes", "noise"),
    "heel_strike": ("walk",),
    "line_following": ("settings",),
    "pose_reaching": ("input", "step", "episodes", "noise"),
    "differential_drive": ("input", "step", "episodes", "noise"),
    "uav_route": ("step", "episodes", "noise"),
}
"""Keys of a recording of the other models, which move by themselves or by random commands of their own."""


class RecordConfig(Config):
    """What `fieldgym record` reads: a model in a (hidden) reality, measured for a while.

    Attributes:
        name: Name of the result folder.
        model: Name of the model; a user's own is named on the command line (``--set model=my_bench.py``).
        reality: Effects that are on (key ``parameters``: other base values), or an ``extended.yaml``.
        excitation: How the input is driven, for a model with a commanded input; tasks' robots move at random.
        input: CSV or Parquet file of commands that are played instead, as `fieldgym diagnose` plans them: `t`
            and a column an input, at `step`, for `duration` at least.
        walk: The noise of a walk, for ``heel_strike``, which nobody drives.
        settings: Line, plant and noise of a walk, for ``line_following``: settings of its environment.
        duration: Length of an episode [s].
        step: Sampling interval [s], for a model with a commanded input; a walker has its own.
        episodes: Number of episodes, for a model with a commanded input; of ``excitation``, in each mode.
        noise: Factor on the sensors' noise; 0 for none (a walker's noise is part of its walk).
        seed: Seed of all randomness.
        format: File format.
    """

    name: Name
    model: str
    reality: RealityConfig = None
    excitation: ExcitationConfig | None = None
    input: Path | None = None
    walk: WalkConfig | None = None
    settings: dict[str, Any] | None = None
    duration: float = Field(gt=0, le=36_000)
    step: float | None = Field(default=None, gt=0, le=1)
    episodes: int = Field(default=1, ge=1, le=1000)
    noise: float = Field(default=1.0, ge=0, le=1000)
    seed: int = Field(default=0, ge=0)
    format: Literal["csv", "parquet"] = "csv"

    @field_validator("model")
    @classmethod
    def _model_exists(cls, model: str, info: ValidationInfo) -> str:
        from fieldmodels.model_files import is_model_file
        from fieldmodels.registry import get_model

        if is_model_file(model) and f"model={model}" not in (info.context or ()):
            raise ValueError(f"a Python file is run only if the command line names it: --set model={model}")
        get_model(model)
        return model

    @field_validator("reality")
    @classmethod
    def _reality_fits(cls, reality: Any, info: ValidationInfo) -> Any:
        if "model" in info.data:
            check_reality(info.data["model"], reality)
        return reality

    @field_validator("excitation", "input", "walk", "settings", "step", "episodes", "noise")
    @classmethod
    def _key_fits_the_model(cls, value: Any, info: ValidationInfo) -> Any:
        model = info.data.get("model")
        if model is not None and info.field_name not in RECORD_KEYS.get(model, DRIVEN):
            raise ValueError(f"model {model!r} does not take this key; leave it out")
        if info.field_name == "settings" and value is not None:
            check_environment("line_following", EnvironmentConfig(settings=value))
        return value


C = TypeVar("C", bound=BaseModel)


def load_config(path: Path, kind: type[C], overrides: Sequence[str] = ()) -> C:
    """Load a YAML file and check it whole.

    Args:
        path: The file.
        kind: The config class that says which keys there are.
        overrides: ``"a.b=value"`` each; the value is YAML, so ``1e-3``, ``[a, b]`` and ``off`` mean there
            what they mean in the file.

    Raises:
        ConfigError: With every mistake at once, each as ``file:line: key: what, did you mean``.
    """
    try:
        data = load_yaml(path)
    except YamlError as error:
        raise ConfigError([str(error) + _neighbours(path)]) from None
    if not isinstance(data, dict):
        raise ConfigError([f"{path}: must be a mapping of keys to values, as in 'name: benchmark'"])
    return _checked(data, dict(_places(path)), kind, overrides)


def environment_of(task: str, overrides: Sequence[str] = ()) -> EnvironmentConfig:
    """A task's environment from the command line alone.

    Args:
        task: Name of the task.
        overrides: ``"settings.a=value"`` or ``"reality.effect.parameter=value"`` each.

    Raises:
        ConfigError: With the mistakes.
    """
    places: dict[Location, str] = {(): "--set"}
    try:
        check_task(task)
    except ValueError as error:
        raise ConfigError([str(error)]) from None
    environment = _checked({}, places, EnvironmentConfig, overrides)
    try:
        check_environment(task, environment)
    except ProblemsError as error:
        raise ConfigError(
            [f"{_place(at, places)}: {'.'.join(map(str, at))}: {message}" for at, message in error.problems]
        ) from None
    return environment


def _checked(data: dict[str, Any], places: dict[Location, str], kind: type[C], overrides: Sequence[str]) -> C:
    """Apply the overrides and check the whole.

    Raises:
        ConfigError: With every mistake at once.
    """
    problems = [problem for text in overrides if (problem := _override(data, places, text))]
    try:
        config = kind.model_validate(data, context=overrides)
    except ValidationError as error:
        for at, message in _readable(error, kind):
            problems.append(f"{_place(at, places)}: {'.'.join(map(str, at))}: {message}")
    if problems:
        raise ConfigError(problems)
    return config


def _places(path: Path) -> Iterator[tuple[Location, str]]:
    """Every key's location in the data and its ``file:line``."""
    node = YAML(typ="safe", pure=True).compose(path.read_text(encoding="utf-8"))

    def walk(node: Any, at: Location) -> Iterator[tuple[Location, str]]:
        if isinstance(node, MappingNode):
            for key, value in node.value:
                here = (*at, str(key.value))
                yield here, f"{path}:{key.start_mark.line + 1}"
                yield from walk(value, here)
        elif isinstance(node, SequenceNode):
            for i, value in enumerate(node.value):
                yield (*at, i), f"{path}:{value.start_mark.line + 1}"
                yield from walk(value, (*at, i))

    yield (), f"{path}:{node.start_mark.line + 1}"
    yield from walk(node, ())


def _place(at: Location, places: Mapping[Location, str]) -> str:
    """Place of the innermost part of a location that is written down somewhere."""
    while at not in places:
        at = at[:-1]
    return places[at]


def _override(data: dict[str, Any], places: dict[Location, str], text: str) -> str | None:
    """Set one value in place; return what is wrong with the override, if anything."""
    key, equals, value = text.partition("=")
    parts = tuple(int(part) if part.isdecimal() else part for part in key.strip().split("."))
    if not equals or "" in parts:
        return f"--set {text}: write --set key=value or --set outer.inner=value"
    try:
        parsed = YAML(typ="safe", pure=True).load(value)
    except YAMLError:
        return f"--set {text}: {value!r} is not a YAML value"
    inner: Any = data
    for i, part in enumerate(parts[:-1]):
        if isinstance(inner, dict) and not isinstance(inner.get(part), dict | list):
            inner[part] = {}
            places[parts[: i + 1]] = f"--set {text}"
        try:
            inner = inner[part]
        except (IndexError, TypeError):
            return f"--set {text}: {part!r} is not an index of a list of {len(inner)}"
    try:
        inner[parts[-1]] = parsed
    except (IndexError, TypeError):
        return f"--set {text}: {parts[-1]!r} is not an index of a list of {len(inner)}"
    for at in [at for at in places if at[: len(parts)] == parts]:
        places[at] = f"--set {text}"
    for i in range(1, len(parts) + 1):
        places.setdefault(parts[:i], f"--set {text}")
    return None


def _readable(error: ValidationError, kind: Any) -> Iterator[tuple[Location, str]]:
    """Location and message of every mistake in a validation error."""
    for item in error.errors(include_url=False):
        at: Location = item["loc"]
        inner = item.get("ctx", {}).get("error")
        if item["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
            yield at, f"unknown key{did_you_mean(str(at[-1]), _keys(kind, at[:-1]))}"
        elif item["type"] in ("missing", "missing_argument"):
            yield at, "this key is missing"
        elif isinstance(inner, ProblemsError):
            yield from (((*at, *below), message) for below, message in inner.problems)
        elif item["type"] == "value_error":
            yield at, str(inner)
        else:
            yield at, f"{item['msg']}, not {item['input']!r}"


def _keys(kind: Any, at: Location) -> list[str]:
    """Keys that are known at a location inside a config class."""
    for part in at:
        kind = _inside(kind, part)
    fields = getattr(_plain(kind), "__pydantic_fields__", None)
    if fields is None and dataclasses.is_dataclass(kind):
        return [field.name for field in dataclasses.fields(kind)]
    return list(fields or ())


def _inside(kind: Any, part: str | int) -> Any:
    """Type of one key or item of a type."""
    kind = _plain(kind)
    fields = getattr(kind, "__pydantic_fields__", {})
    if part in fields:
        return fields[part].annotation
    arguments = get_args(kind)
    return arguments[-1] if arguments else None


def _plain(kind: Any) -> Any:
    """A type without ``Annotated`` and ``None``."""
    if get_origin(kind) is Annotated:
        return _plain(get_args(kind)[0])
    inner = [one for one in get_args(kind) if hasattr(_origin(one), "__pydantic_fields__")]
    return _plain(inner[0]) if inner and get_origin(kind) not in (dict, list, tuple) else kind


def _origin(kind: Any) -> Any:
    return get_origin(kind) or kind


def _neighbours(path: Path) -> str:
    """A hint at files of a similar name."""
    import difflib

    if path.exists():
        return ""
    folder = path.parent
    while not folder.is_dir() and folder != folder.parent:
        folder = folder.parent
    known = {str(p): p for p in [*folder.glob("*.yaml"), *folder.glob("*/*.yaml")]}
    close = difflib.get_close_matches(str(path), known, n=1, cutoff=0.5)
    return f" (did you mean {close[0]}?)" if close else ""
