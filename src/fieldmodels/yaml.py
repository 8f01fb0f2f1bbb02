"""YAML as this project reads and writes it: version 1.2, loaded safely, written atomically."""

from __future__ import annotations

import io
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from ruamel.yaml.events import (
    AliasEvent,
    CollectionEndEvent,
    CollectionStartEvent,
    NodeEvent,
)

from fieldmodels.files import write_text

MOST_BYTES, MOST_NODES, DEEPEST = 4 << 20, 100_000, 50
"""Largest file, most values and deepest nesting that are read."""


class YamlError(ValueError):
    """A file that is not valid YAML, with its place."""


def load_yaml(path: Path) -> Any:
    """Load plain data (no Python objects) from a YAML 1.2 file.

    Raises:
        YamlError: If the file is missing, is not text, is not valid YAML, or is larger than any config; names
            file and line.
    """
    return parse_yaml(read_text(path), str(path))


def read_text(path: Path) -> str:
    """The text of a file of a person's size, whatever the path names.

    Raises:
        YamlError: If there is no such text.
    """
    try:
        with path.open("rb") as file:
            data = file.read(MOST_BYTES + 1)
    except FileNotFoundError:
        raise YamlError(f"{path}: no such file") from None
    except OSError as error:
        raise YamlError(f"{path}: cannot be read: {error.strerror}") from None
    if len(data) > MOST_BYTES:
        raise YamlError(f"{path}: more than {MOST_BYTES >> 20} MB, which no file written by hand has")
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        raise YamlError(f"{path}: not a text file") from None


def parse_yaml(text: str, source: str) -> Any:
    """Plain data of a YAML text.

    Args:
        text: The text.
        source: What messages start with.

    Raises:
        YamlError: If it is not valid YAML, or its aliases or its depth would make it larger than any config.
    """
    yaml = YAML(typ="safe", pure=True)
    try:
        _check_size(yaml.parse(text), source)
        return yaml.load(text)
    except YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"{source}:{mark.line + 1}" if mark else source
        raise YamlError(f"{where}: {getattr(error, 'problem', None) or error}") from None
    except (ValueError, OverflowError) as error:  # of a number or a date: 5,000 digits, a 13th month
        if isinstance(error, YamlError):
            raise
        raise YamlError(f"{source}: a value cannot be read: {error}") from None


def _check_size(events: Iterable[Any], source: str) -> None:
    """Refuse aliases that multiply and nesting that exhausts, before anything is built."""
    sizes: dict[str, int] = {}
    open_nodes: list[tuple[str | None, int]] = []
    count = 0
    for event in events:
        where = f"{source}:{event.start_mark.line + 1}"
        if isinstance(event, AliasEvent):
            if event.anchor not in sizes:
                raise YamlError(f"{where}: alias *{event.anchor} is unknown, or within what it stands for")
            count += sizes[event.anchor]
        elif isinstance(event, NodeEvent):
            count += 1
            if isinstance(event, CollectionStartEvent):
                open_nodes.append((event.anchor, count - 1))
            elif event.anchor:
                sizes[event.anchor] = 1
        elif isinstance(event, CollectionEndEvent):
            anchor, before = open_nodes.pop()
            if anchor:
                sizes[anchor] = count - before
        if len(open_nodes) > DEEPEST:
            raise YamlError(f"{where}: nested deeper than {DEEPEST} levels")
        if count > MOST_NODES:
            raise YamlError(f"{where}: more than {MOST_NODES:,} values, aliases written out")


def save_yaml(data: Any, path: str | Path) -> None:
    """Write plain data as YAML; the file appears whole or not at all."""
    stream = io.StringIO()
    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = False
    yaml.width = 1_000_000  # a key that is broken over two lines is none
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    yaml.dump(data, stream)
    write_text(Path(path), stream.getvalue())
