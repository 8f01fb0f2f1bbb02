"""Config files: every mistake at once, each with its line and a remedy."""

from pathlib import Path

import pytest
from pydantic import Field

from fieldagents.config import Config, ConfigError, Name, find_config, load_config, shipped_configs


class Inner(Config):
    depth: int = Field(ge=0)
    rate: float = 1.0


class Outer(Config):
    name: Name
    count: int
    inner: Inner
    named: dict[str, Inner] = Field(default_factory=dict)
    listed: list[Inner] = Field(default_factory=list)
    maybe: Inner | None = None


GOOD = "name: a\ncount: 3\ninner:\n  depth: 1\n  rate: 3e-4\n"


def write(folder: Path, text: str) -> Path:
    path = folder / "config.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def problems(path: Path, *overrides: str) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        load_config(path, Outer, overrides)
    return [problem.removeprefix(f"{path.parent}/") for problem in caught.value.problems]


def test_good_file_loads_with_yaml_1_2_numbers(tmp_path):
    config = load_config(write(tmp_path, GOOD), Outer)
    assert config == Outer(name="a", count=3, inner=Inner(depth=1, rate=3e-4))


def test_overrides_are_typed_and_reach_nested_keys_and_lists(tmp_path):
    path = write(tmp_path, GOOD + "listed:\n  - depth: 1\n")
    config = load_config(
        path,
        Outer,
        ["inner.rate=1e-2", "listed.0.depth=7", "named.x.depth=2", "maybe={depth: 5, rate: 2}", "name=off"],
    )
    assert config.inner.rate == 0.01
    assert config.listed[0].depth == 7
    assert config.named["x"].depth == 2
    assert config.maybe == Inner(depth=5, rate=2.0)
    assert config.name == "off"


def test_all_mistakes_are_reported_at_once_with_their_lines(tmp_path):
    path = write(
        tmp_path,
        "name: a/b\n"  # 1: not a folder name
        "coutn: 3\n"  # 2: misspelt (and so 'count' is missing)
        "inner:\n"
        "  depth: -1\n"  # 4: out of bounds
        "  rte: 2\n"  # 5: misspelt
        "listed:\n"
        "  - depth: 1\n"
        "  - depth: many\n"  # 8: not a number
        "named:\n"
        "  x: {deep: 1}\n",  # 10: misspelt and missing
    )
    found = problems(path)
    places = {line.split(": ")[0] + " " + line.split(": ")[1] for line in found}
    assert places == {
        "config.yaml:1 name",
        "config.yaml:1 count",
        "config.yaml:2 coutn",
        "config.yaml:4 inner.depth",
        "config.yaml:5 inner.rte",
        "config.yaml:8 listed.1.depth",
        "config.yaml:10 named.x.deep",
        "config.yaml:10 named.x.depth",
    }
    assert any("coutn: unknown key (did you mean 'count'?)" in line for line in found)
    assert any("inner.rte: unknown key (did you mean 'rate'?)" in line for line in found)
    assert any(
        "inner.depth" in line and "greater than or equal to 0" in line and "-1" in line for line in found
    )


@pytest.mark.every(
    ("override", "message"),
    [
        ("count=abc", "--set count=abc: count: Input should be a valid integer"),
        ("count=true", "--set count=true: count: must be a number"),
        ("inner.rate=no", "--set inner.rate=no: inner.rate: Input should be a valid number"),
        ("inner.rate=false", "--set inner.rate=false: inner.rate: must be a number"),
        ("inner.rat=1", "--set inner.rat=1: inner.rat: unknown key (did you mean 'rate'?)"),
        ("listed.3=1", "--set listed.3=1: 3 is not an index of a list of 0"),
        ("count", "--set count: write --set key=value"),
        ("=3", "--set =3: write --set key=value"),
        ("inner.depth=[", "--set inner.depth=[: '[' is not a YAML value"),
        ("count.x=1", "--set count.x=1: count: Input should be a valid integer"),
    ],
)
def test_wrong_overrides_name_themselves(tmp_path, override, message):
    assert any(
        line.startswith(message) for line in problems(write(tmp_path, GOOD + "listed: []\n"), override)
    )


def test_wrong_overrides_are_reported_together(tmp_path):
    assert len(problems(write(tmp_path, GOOD), "count=abc", "=1", "inner.rate=no")) == 3


@pytest.mark.every(
    ("text", "message"),
    [
        ("", "must be a mapping"),
        ("- a\n- b\n", "must be a mapping"),
        ("name: a\nname: b\n", ":2: found duplicate key"),
        ("name: [a\ncount: 1\n", "config.yaml:"),
        ("name: a\n\tcount: 1\n", "config.yaml:2"),
        ("name: !!python/object/apply:os.system [ls]\n", "config.yaml:1"),
    ],
)
def test_files_that_are_not_configs(tmp_path, text, message):
    (problem,) = problems(write(tmp_path, text))
    assert message in problem


def test_a_missing_file_suggests_its_neighbour(tmp_path):
    write(tmp_path, GOOD)
    (problem,) = problems(tmp_path / "confg.yaml")
    assert "no such file" in problem
    assert f"did you mean {tmp_path}/config.yaml?" in problem


def test_a_binary_file_is_not_a_config(tmp_path):
    path = tmp_path / "config.yaml"
    path.write_bytes(b"\x89PNG\r\n\x1a\n\x00\xff")
    (problem,) = problems(path)
    assert "not a text file" in problem


def test_a_shipped_config_is_found_by_its_name_from_anywhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    own = Path("heel_strike/ppo.yaml")
    shipped = shipped_configs() / own
    assert shipped.is_file()
    for name in ("heel_strike/ppo", "heel_strike/ppo.yaml", "configs/heel_strike/ppo.yaml"):
        assert find_config(Path(name)) == shipped
    assert find_config(Path("heel_strike/nothing")) == Path("heel_strike/nothing")
    assert find_config(tmp_path / own) == tmp_path / own
    own.parent.mkdir()
    own.write_text("name: mine\n")
    assert find_config(own) == own  # a file of one's own comes first
