"""YAML as this project reads and writes it: version 1.2, loaded safely, written atomically."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from fieldmodels.files import write_text


class YamlError(ValueError):
    """A file that is not valid YAML, with its place."""


def load_yaml(path: Path) -> Any:
    """Load plain data (no Python objects) from a YAML 1.2 file.

    Raises:
        YamlError: If the file is missing, is not text, or is not valid YAML; names file and line.
    """
    try:
        return YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise YamlError(f"{path}: no such file") from None
    except UnicodeDecodeError:
        raise YamlError(f"{path}: not a text file") from None
    except YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"{path}:{mark.line + 1}" if mark else str(path)
        raise YamlError(f"{where}: {getattr(error, 'problem', None) or error}") from None


def save_yaml(data: Any, path: Path) -> None:
    """Write plain data as YAML; the file appears whole or not at all."""
    stream = io.StringIO()
    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = False
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    yaml.dump(data, stream)
    write_text(path, stream.getvalue())
