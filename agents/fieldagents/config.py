"""What YAML files have in common, and a loader that reports all mistakes at once, each with its line."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar, get_args, get_origin

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    TypeAdapter,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)
from ruamel.yaml import YAML
from ruamel.yaml.nodes import MappingNode, SequenceNode

from fieldagents.made import Made, imported, makers, wrong_arguments_of
from fieldmodels.model import ModelError
from fieldmodels.names import did_you_mean
from fieldmodels.yaml import YamlError, load_yaml, parse_yaml, read_text

Location = tuple[str | int, ...]
Problems = Iterable[tuple[Location, str]]
"""What is wrong, and where below the value at hand."""
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

    def __init__(self, problems: Problems) -> None:
        self.problems = tuple(problems)
        super().__init__("; ".join(message for _, message in self.problems))


def checked(find: Callable[..., Problems], *others: str) -> AfterValidator:
    """A validator of a key by other keys before it; where one of these is wrong, that comes first.

    Args:
        find: Called with the value and those of the others; finds what is wrong, or raises ValueError.
        others: The other keys.
    """

    def validate(value: Any, info: ValidationInfo) -> Any:
        known = set(others) <= set(info.data)
        if known and (problems := tuple(find(value, *(info.data[key] for key in others)))):
            raise ProblemsError(problems)
        return value

    return AfterValidator(validate)


class Config(BaseModel):
    """Base of every config: unknown keys are mistakes, and nothing changes after loading."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, use_attribute_docstrings=True)

    was: ClassVar[Mapping[str, str]] = {}
    """Keys of 0.1 to those that took their place."""

    @model_validator(mode="before")
    @classmethod
    def _renamed(cls, data: Any) -> Any:
        return {cls.was.get(k, k): v for k, v in data.items()} if isinstance(data, dict) else data

    @field_validator("*", mode="before")
    @classmethod
    def _no_truth_for_number(cls, value: Any, info: ValidationInfo) -> Any:
        """Python would take true and false for 1 and 0."""
        kind = cls.model_fields[info.field_name or ""].annotation
        if isinstance(value, bool) and {int, float} & {kind, *get_args(kind)}:
            raise ValueError("must be a number")
        return value


def _mapping_or_path(value: Any) -> Any:
    if value is not None and not isinstance(value, dict | str):
        raise ValueError("must be a mapping of effects, as in {gyro_bias: {rate: 0.004}}, or a path")
    return value


RealityConfig = Annotated[Any, AfterValidator(_mapping_or_path)]


class EnvironmentConfig(Config):
    """A task's environment.

    Attributes:
        settings: Keys of the task's settings; what is not named keeps its default.
        reality: Effects that are on, or the path of an ``extended.yaml`` written by a diagnosis. In both, a
            sampler such as ``{uniform: [0, 0.1]}`` may stand in the place of a value.
        wrappers: Gymnasium wrappers, the first innermost: ``module:Class``, or a mapping from it to keyword
            arguments.
    """

    settings: dict[str, Any] = Field(default_factory=dict)
    reality: RealityConfig = None
    wrappers: tuple[Made, ...] = ()

    @property
    def options(self) -> dict[str, Any]:
        """What ``make`` and ``make_vec`` of a task take."""
        return {
            "settings": self.settings,
            "reality": self.reality,
            "wrappers": makers(self.wrappers),
        }


def wrong_environment(environment: EnvironmentConfig, task: str) -> Problems:
    """Every unknown key, wrong value and unknown effect in a task's environment."""
    from fieldgym import find_task
    from fieldgym.foreign import ForeignTask

    declared = find_task(task)
    problems: list[tuple[Location, str]] = []
    if not isinstance(declared, ForeignTask):
        problems += [(("settings", *at), said) for at, said in wrong_settings(environment.settings, task)]
        reality = wrong_reality(environment.reality, declared.model, declared.channels)
        problems += [(("reality", *at), said) for at, said in reality]
    elif environment.reality is not None:
        said = f"effects belong to a model of this package, and {task} has none: leave the reality out"
        problems.append((("reality",), said))
    for i, one in enumerate(environment.wrappers):
        problems += [(("wrappers", i), said) for said in map(_wrong_wrapper, one, one.values()) if said]
    if not problems and (environment.wrappers or isinstance(declared, ForeignTask)):
        problems += _not_to_be_made(environment, task)
    return problems


def _wrong_wrapper(place: str, arguments: Mapping[str, Any]) -> str:
    try:
        return wrong_arguments_of(imported(place), arguments, before=1)
    except ValueError as error:
        return str(error)


def _not_to_be_made(environment: EnvironmentConfig, task: str) -> Problems:
    """What an environment says when it is made, and each of its wrappers when it is put around."""
    import gymnasium

    from fieldgym import find_task
    from fieldgym.foreign import ForeignError

    options = environment.options
    wrappers = options.pop("wrappers")
    try:
        env = find_task(task).make(**options)
    except ForeignError as error:
        yield ("settings",), str(error)
        return
    try:
        for i, wrap in enumerate(wrappers):
            (place,) = environment.wrappers[i]
            try:
                around = wrap(env)
            except Exception as error:  # of anybody's class
                yield ("wrappers", i), f"{place} cannot be put around {task}: {type(error).__name__}: {error}"
                return
            if not isinstance(around, gymnasium.Env):
                yield ("wrappers", i), f"{place} gives {type(around).__name__}, which is no environment"
                return
            env = around
    finally:
        env.close()


def wrong_settings(settings: dict[str, Any], task: str) -> Problems:
    """Every unknown key and wrong value in a task's settings."""
    from fieldgym import find_task
    from fieldgym.settings import take_samplers

    kind = find_task(task).settings
    fixed, _, wrong = take_samplers(settings, kind)
    yield from (((name,), message) for name, message in wrong)
    yield from invalid(fixed, kind)


def invalid(value: Any, kind: Any) -> Problems:
    """What is wrong with a value of a type that pydantic knows."""
    try:
        TypeAdapter(kind).validate_python(value)
    except ValidationError as error:
        yield from readable(error, kind)


def wrong_reality(reality: Any, model: str, channels: Any = None) -> Problems:
    """Every unknown effect, unknown parameter and value out of bounds in a reality.

    Args:
        reality: The reality.
        model: Name of the model; stock effects around it are known too.
        channels: Which of the model's signals a task commands and measures; None for all.
    """
    from fieldmodels.drivers.named import apply_reality, stock_of
    from fieldmodels.registry import get_model

    chosen = get_model(model)
    known = {effect.name for effect in chosen.effects} | set(stock_of(chosen))
    for at, part in _parts(reality, known):
        try:
            apply_reality(chosen, part, channels)
        except (ModelError, YamlError) as error:
            yield at, str(error)


def _parts(reality: Any, effects: Collection[str]) -> Iterator[tuple[Location, Any]]:
    """A reality's single values, each with its place, so that each mistake is found and placed."""
    if not isinstance(reality, dict):
        yield (), reality
        return
    for name, values in reality.items():
        if isinstance(values, dict) and (name == "parameters" or name in effects):
            yield from (((name, key), {name: {key: value}}) for key, value in values.items())
        else:
            yield (name,), {name: values}


def check_task(name: str, said: Collection[str] | None = ()) -> str:
    """Return the name by which a task is found.

    Args:
        name: Of a task; or of a machine that is to follow a reference, its Python file, or a ``bench.yaml``
            or ``extended.yaml`` that names it; or of any environment that Gymnasium makes.
        said: What the command line says: a Python file is run only if ``task=FILE`` is among it.

    Raises:
        ValueError: If there is no such task.
    """
    from fieldgym import TASKS, find_task
    from fieldgym.foreign import ForeignTask
    from fieldmodels.drivers.named import model_named_in
    from fieldmodels.machine import Machine
    from fieldmodels.model_files import is_model_file
    from fieldmodels.registry import get_model, model_names

    if name in TASKS:
        return name
    for own in TASKS.values():
        if own.env_id == name:
            return own.name
    if isinstance(foreign := find_task(name), ForeignTask):
        foreign.find()
        return name
    if name.endswith((".yaml", ".yml")):
        try:
            name = model_named_in(name)
        except YamlError as error:
            raise ValueError(str(error)) from None
    if is_model_file(name) and f"task={name}" not in (said or ()):
        raise ValueError(f"a Python file is run only if the command line names it: --set task={name}")
    if not is_model_file(name) and name not in model_names():
        machines = [one for one in model_names() if one not in TASKS]
        raise ValueError(f"there is no task {name!r}{did_you_mean(name, [*TASKS, *machines])}")
    if not isinstance(get_model(name), Machine):
        raise ValueError(f"model {name!r} is no Machine; only those can be stepped one by one")
    return name


def _task(name: str, info: ValidationInfo) -> str:
    return check_task(name, info.context)


TaskName = Annotated[str, AfterValidator(_task)]
"""A config's task."""
TaskEnvironment = Annotated[EnvironmentConfig, checked(wrong_environment, "task")]
TaskSettings = Annotated[dict[str, Any], checked(wrong_settings, "task")]
"""An environment, or settings, of the config's task, which must come first."""

C = TypeVar("C", bound=BaseModel)


def shipped_configs() -> Path:
    """Folder of the configs that come with the package."""
    installed = Path(__file__).parent / "configs"
    return installed if installed.is_dir() else Path(__file__).parents[2] / "configs"  # in a checkout


def find_config(path: Path) -> Path:
    """The file of a config: the path itself or, where there is none, the shipped one of that name.

    Args:
        path: A file, or a name such as ``heel_strike/ppo`` or ``configs/heel_strike/ppo.yaml``.
    """
    if path.exists() or path.is_absolute():
        return path
    name = Path(*path.parts[1:]) if path.parts[:1] == ("configs",) else path
    shipped = shipped_configs() / name.parent / f"{name.name.removesuffix('.yaml')}.yaml"
    return shipped if shipped.is_file() else path


def has_key(path: Path, key: str) -> bool:
    """Whether a config has a key, by which its kind is known; False where it cannot be read."""
    try:
        data = load_yaml(find_config(path))
    except YamlError:
        return False  # its loader says what is wrong
    return isinstance(data, dict) and key in data


def load_config(path: Path, kind: type[C], overrides: Sequence[str] = ()) -> C:
    """Load a YAML file and check it whole.

    Args:
        path: The file, or the name of a shipped one; see `find_config`.
        kind: The config class that says which keys there are.
        overrides: ``"a.b=value"`` each; the value is YAML, so ``1e-3``, ``[a, b]`` and ``off`` mean there
            what they mean in the file.

    Raises:
        ConfigError: With every mistake at once, each as ``file:line: key: what, did you mean``.
    """
    path = find_config(path)
    try:
        text = read_text(path)
        data = parse_yaml(text, str(path))
    except YamlError as error:
        raise ConfigError([str(error) + _neighbours(path)]) from None
    if not isinstance(data, dict):
        raise ConfigError([f"{path}: must be a mapping of keys to values, as in 'name: benchmark'"])
    return _checked(data, dict(_places(path, text)), kind, overrides)


def config_of(source: C | Mapping[str, Any] | str | Path, kind: type[C], keys: Mapping[str, Any]) -> C:
    """A config from what a script has: one that is checked, plain data, a file, or a shipped one's name.

    Args:
        source: The config.
        kind: The config class.
        keys: Top-level keys that go before those of the source.

    Raises:
        ConfigError: As `load_config`.
    """
    overrides = [f"{key}={json.dumps(value, default=str)}" for key, value in keys.items()]
    if isinstance(source, str | Path):
        return load_config(Path(source), kind, overrides)
    data = source.model_dump(mode="json") if isinstance(source, BaseModel) else deepcopy(dict(source))
    return _checked(data, {(): "config"}, kind, overrides)


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
        check_task(task, (f"task={task}",))
    except ValueError as error:
        raise ConfigError([str(error)]) from None
    environment = _checked({}, places, EnvironmentConfig, overrides)
    if problems := [_written(at, message, places) for at, message in wrong_environment(environment, task)]:
        raise ConfigError(problems)
    return environment


def _checked(data: dict[str, Any], places: dict[Location, str], kind: type[C], overrides: Sequence[str]) -> C:
    """Apply the overrides and check the whole.

    Raises:
        ConfigError: With every mistake at once.
    """
    problems = [problem for text in overrides if (problem := _override(data, places, text))]
    renamed = getattr(kind, "was", {})
    places |= {(renamed[at[0]], *at[1:]): line for at, line in places.items() if at and at[0] in renamed}
    try:
        config = kind.model_validate(data, context=overrides)
    except ValidationError as error:
        problems += [_written(at, message, places) for at, message in readable(error, kind)]
    if problems:
        raise ConfigError(problems)
    return config


def _places(path: Path, text: str) -> Iterator[tuple[Location, str]]:
    """Every key's location in the data and its ``file:line``."""
    node = YAML(typ="safe", pure=True).compose(text)

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


def _written(at: Location, message: str, places: Mapping[Location, str]) -> str:
    """A mistake with the place of the innermost part of its location that is written down somewhere."""
    inner = at
    while inner not in places:
        inner = inner[:-1]
    return f"{places[inner]}: {'.'.join(map(str, at))}: {message}"


def _override(data: dict[str, Any], places: dict[Location, str], text: str) -> str | None:
    """Set one value in place; return what is wrong with the override, if anything."""
    key, equals, value = text.partition("=")
    parts = tuple(int(part) if part.isdecimal() else part for part in key.strip().split("."))
    if not equals or "" in parts:
        return f"--set {text}: write --set key=value or --set outer.inner=value"
    try:
        parsed = parse_yaml(value, "")
    except YamlError:
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


def readable(error: ValidationError, kind: Any) -> Iterator[tuple[Location, str]]:
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
    inner = [one for one in get_args(kind) if hasattr(get_origin(one) or one, "__pydantic_fields__")]
    return _plain(inner[0]) if inner and get_origin(kind) not in (dict, list, tuple) else kind


def _neighbours(path: Path) -> str:
    """A hint at files of a similar name."""
    import difflib

    if path.exists():
        return ""
    folder = path.parent
    while not folder.is_dir() and folder != folder.parent:
        folder = folder.parent
    known = [str(p) for p in [*folder.glob("*.yaml"), *folder.glob("*/*.yaml")]]
    known += [f"{p.parent.name}/{p.stem}" for p in shipped_configs().glob("*/*.yaml")]
    close = difflib.get_close_matches(str(path), known, n=1, cutoff=0.5)
    return f" (did you mean {close[0]}?)" if close else ""
