"""Schemas of configs: what editors read agrees with what the loader takes."""

import json
import re
from pathlib import Path

import pytest

from fieldagents.schema import KINDS, SchemaError, schema
from fieldmodels.yaml import load_yaml

jsonschema = pytest.importorskip("jsonschema")
CONFIGS = Path(__file__).parents[2] / "configs"
FILES = sorted(CONFIGS.rglob("*.yaml"))


def kind_of(path: Path) -> str | None:
    named = re.match(r"# yaml-language-server: \$schema=(\S+)\n", path.read_text())
    if named is None:
        return None
    assert (path.parent / named[1]).is_file()
    return Path(named[1]).stem


def problems(kind: str, data: object) -> list[str]:
    validator = jsonschema.Draft202012Validator(schema(kind))
    return [f"{'.'.join(map(str, one.path))}: {one.message}" for one in validator.iter_errors(data)]


@pytest.mark.every("kind", KINDS)
def test_the_shipped_schema_is_current(kind):
    """Renew with ``python -m fieldagents.schema``."""
    jsonschema.Draft202012Validator.check_schema(schema(kind))
    assert json.loads((CONFIGS / "schema" / f"{kind}.json").read_text()) == schema(kind)


@pytest.mark.every("path", FILES)
def test_every_shipped_config_fits_the_schema_that_it_names(path):
    kind = kind_of(path) or "train"
    assert problems(kind, load_yaml(path)) == []


def test_a_schema_finds_mistakes_and_explains_keys():
    base = load_yaml(CONFIGS / "heel_strike" / "ppo.yaml")
    assert "num_evns" in problems("train", base | {"num_evns": 3})[0]
    wrong = problems("train", base | {"environment": {"settings": {"stride": 3}}})
    assert any("'stride' was unexpected" in one for one in wrong)
    assert problems("train", base | {"task": "heelstrike"})
    assert problems("train", base | {"seed": -1})
    told = schema("train")["properties"]
    assert "Environment steps" in told["steps"]["description"]
    assert "published seeds" in schema("evaluate")["properties"]["episodes"]["description"]
    with pytest.raises(SchemaError, match="did you mean 'train'"):
        schema("trian")
