"""The pages say what the programs do."""

import importlib
import importlib.util
import re
import runpy
import sys
from pathlib import Path
from pkgutil import resolve_name

import gymnasium
import numpy as np
import pytest
import typer.main
from PIL import Image
from ruamel.yaml import YAML
from typer.testing import CliRunner

from fieldagents.cli import app
from fieldagents.config import EnvironmentConfig, load_config, wrong_environment
from fieldagents.policies import zoo
from fieldgym.info import part
from fieldmodels.effects import actuators, changes, sensors

DOCS = Path(__file__).parents[2] / "docs"


def options() -> set[tuple[str, str]]:
    """Every command with each of its options, as typed."""
    group = typer.main.get_command(app)
    return {
        (name, option)
        for name, command in group.commands.items()
        for parameter in command.params
        for option in parameter.opts
        if option.startswith("--") and option not in ("--help", "--json", "--model")  # --machine in 0.1
    }


def test_cli_page_lists_every_command_and_option():
    text = (DOCS / "cli.md").read_text()
    listing = text.split("```")[1].splitlines()
    for command, option in options():
        (line,) = [line for line in listing if line.startswith(f"fieldgym {command} ")]
        assert option in line, f"{command} {option}"


def test_cli_page_shows_options_that_exist():
    text = (DOCS / "cli.md").read_text()
    known = {option for _, option in options()} | {"--help", "--json"}
    assert set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", text)) <= known


@pytest.mark.every("page", sorted(p.relative_to(DOCS).as_posix() for p in DOCS.rglob("*.md")))
def test_a_page_has_a_picture_that_says_what_it_shows(page):
    found = re.findall(r"!\[(.*?)\]\((\S+?)\)", (DOCS / page).read_text())
    assert found
    for says, path in found:
        assert len(says) > 10, path
        assert (DOCS / page).parent.joinpath(path).stat().st_size > 1000


def test_a_link_into_a_page_finds_its_place():
    def places(text: str) -> set[str]:
        titles = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
        slugs = {re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", title).strip().lower()) for title in titles}
        return slugs | set(re.findall(r'id="([^"]+)"', text)) | set(re.findall(r"\{#([\w-]+)", text))

    texts = {path: path.read_text() for path in DOCS.rglob("*.md")}
    links = [
        (path, (path.parent / page).resolve() if page else path, place)
        for path, text in texts.items()
        for page, place in re.findall(r"\]\(([\w/.]*)#([\w-]+)\)", text)
    ]
    assert len(links) > 20
    assert [(path.name, place) for path, page, place in links if place not in places(texts[page])] == []


def test_pictures_show_the_numbers_of_their_pages(monkeypatch):
    """A number of a table that changes moves something in the picture."""
    monkeypatch.syspath_prepend(str(DOCS))
    pictures = importlib.import_module("pictures")

    def drawn(text: str) -> list[float]:
        figure = pictures.faults(text)
        return [bar.get_width() for axes in figure.axes for bar in axes.patches]

    text = (DOCS / "faults.md").read_text()
    row = next(line for line in text.splitlines() if line.startswith("| junk |"))
    assert drawn(text.replace(row, "| junk | 0 | 3 | 2 | 0 | 0 | 0 | 0 | 0 |")) != drawn(text)
    for draw in pictures.PAGES:
        assert draw((DOCS / f"{draw.__name__}.md").read_text()).axes


def test_the_mistake_that_the_cli_page_shows_is_what_one_gets():
    block = next(part for part in (DOCS / "cli.md").read_text().split("```") if "$ fieldgym evaluate" in part)
    command, *shown = block.strip().splitlines()
    arguments = command.removeprefix("$ fieldgym ").split()
    arguments[1] = str(DOCS.parent / arguments[1])
    result = CliRunner().invoke(app, arguments)
    assert result.stderr.strip().splitlines() == shown


README = (DOCS.parent / "README.md").read_text()


def test_the_readme_is_short_and_begins_with_how_to_install_and_make():
    first = "\n".join(README.splitlines()[:10])
    assert len(README.split()) <= 900
    assert "pip install" in first
    assert "make('fieldgym:fieldgym/" in first
    films = re.findall(r'<img src="(docs/environments/\w+\.webp)"', README)
    assert len(set(films)) == 6
    assert all(Image.open(DOCS.parent / film).n_frames > 1 for film in films)
    for place in re.findall(r"\]\((docs/[^)#]+|[A-Z]+\.md)", README):
        assert (DOCS.parent / place).exists(), place


def test_python_in_the_readme_runs(public_data, monkeypatch):
    monkeypatch.setenv("FIELDGYM_DATA", str(public_data))
    code = "\n".join(re.findall(r"```python\n(.*?)```", README, re.DOTALL))
    names = {"__name__": "example"}
    exec(compile(code, "README.md", "exec"), names)
    assert names["envs"].num_envs == 64
    assert next(iter(names["found"].effects_)) == "coulomb_friction"
    assert set(re.findall(r"(?:from|import) (field\w+)", code)) == {"fieldgym"}


def test_results_in_the_readme_are_those_of_the_leaderboard():
    board = (DOCS / "leaderboard.md").read_text()
    rows = re.findall(r"^\| \[(\w+)\]\(docs/leaderboard.md#\w+\)(.*)$", README, re.MULTILINE)
    assert [task for task, _ in rows] == re.findall(r"^## (\w+)$", board, re.MULTILINE)
    for task, row in rows:
        section = board.split(f"\n## {task}\n")[1].split("\n## ")[0]
        for value, agent, mark in re.findall(r"\| ([\d.][^|`]*) `(\w+)`(†?)", row):
            (line,) = [line for line in section.splitlines() if re.match(rf"\| \[?`{agent}`", line)]
            assert value in line, f"{task}: {agent}"
            assert ("settings" in line.split("|")[2]) == bool(mark), f"{task}: {agent}"


def test_the_leaderboard_says_of_each_learned_agent_what_its_card_says():
    board = (DOCS / "leaderboard.md").read_text()
    sections = {part.split("\n")[0]: part for part in board.split("\n## ")[1:]}
    shown = [
        (task, re.match(r"\| `(\w+)`", line)[1], line)
        for task, section in sections.items()
        for line in section.splitlines()
        if line.endswith(" runs) |")
    ]
    assert len(shown) > 10
    for task, agent, row in shown:
        assert (DOCS.parent / "configs" / task / f"{agent}.yaml").exists()
        cards = [training.card for training in zoo.get_entry(task, agent).trainings]
        took = [run.get("processor_seconds") for card in cards for run in card["runs"]]
        assert ("by the clock" in row) == (None in took), f"{task}/{agent}: make leaderboard"
        if None not in took:
            assert f" {np.mean(took):.0f} s (" in row, f"{task}/{agent}: make leaderboard"
        for run in (run for card in cards for run in card["runs"] if run["steps"]):
            assert f"{run['steps']:,} steps" in row, f"{task}/{agent}: make leaderboard"


def test_an_agent_of_one_s_own_runs_as_the_page_says(tmp_path, monkeypatch, capsys):
    (code,) = re.findall(r"```python\n(.*?)```", (DOCS / "evaluation.md").read_text(), re.DOTALL)
    (tmp_path / "middle.py").write_text(code)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    runpy.run_path("middle.py", run_name="__main__")
    assert re.match(r"\{'fixed_tuned': 3\.\d+, 'middle:Middle': 3\.\d+\}", capsys.readouterr().out)


@pytest.mark.nightly
def test_the_example_on_the_page_of_python_prints_what_it_says(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (code,) = re.findall(r"```python\n(.*?)```", (DOCS / "api.md").read_text(), re.DOTALL)
    exec(compile(code, "api.md", "exec"), {"__name__": "example"})
    promised = re.findall(r"^print.*# (.*?)(?:, in percent)?$", code, re.MULTILINE)
    assert capsys.readouterr().out.splitlines() == promised
    assert (tmp_path / "model.py").exists()


def test_the_first_config_of_ones_own_bench_records(tmp_path):
    block = (DOCS / "bring_your_own_bench.md").read_text().split("```yaml\n")[1]
    (tmp_path / "record.yaml").write_text(block.split("```")[0])
    result = CliRunner().invoke(app, ["record", str(tmp_path / "record.yaml"), "--out", str(tmp_path)])
    assert result.exit_code == 0, result.output
    assert len((tmp_path / "stiff_bench.csv").read_text().splitlines()) == 3001


@pytest.mark.every(
    ("page", "kind"),
    [("evaluation", "fieldagents.evaluation.config:EvaluateConfig"),
     ("training", "fieldagents.learned.config:TrainConfig")],
)  # fmt: skip
def test_the_config_on_a_page_loads(page, kind, tmp_path):
    block = (DOCS / f"{page}.md").read_text().split("```yaml\n")[1].split("```")[0]
    (tmp_path / "own.yaml").write_text(block)
    assert load_config(tmp_path / "own.yaml", resolve_name(kind)).name


TRAINED = [
    path
    for path in sorted((DOCS.parent / "configs").glob("*/*.yaml"))
    if path.stem.startswith(("pathwise", "ppo", "sac", "student"))
]


@pytest.mark.every("path", TRAINED)
def test_shipped_training_configs_load(path):
    from fieldagents.learned.config import TrainConfig

    config = load_config(path, TrainConfig)
    assert config.task == path.parent.name
    kinds = tuple(kind.__name__.lower() for kind in config.kind.__mro__[:-1])
    assert path.stem.startswith((*kinds, "student"))


def test_the_page_of_realities_names_every_stock_effect():
    page = (DOCS / "realities.md").read_text()
    for signal, library in (("u", actuators), ("y", sensors), ("p", changes)):
        for kind in library.LIBRARY:
            assert f"`{signal}_{kind}`" in page or kind == "backlash", kind


def test_the_reality_on_the_page_of_realities_can_be_flown():
    (block,) = re.findall(r"```yaml\n(.*?)```", (DOCS / "realities.md").read_text(), re.DOTALL)
    reality = YAML(typ="safe", pure=True).load(block)["reality"]
    assert not list(wrong_environment(EnvironmentConfig(reality=reality), "line_following"))
    _, info = gymnasium.make("fieldgym/LineFollowing-v1", reality=reality).reset(seed=0)
    assert part(info, "privileged.reality")


def test_a_library_trains_within_fifteen_lines():
    """`make ecosystem` runs them; here, that each section is there, short, and says how it is loaded."""
    spec = importlib.util.spec_from_file_location("ecosystem", DOCS.parent / "tests" / "ecosystem.py")
    ecosystem = importlib.util.module_from_spec(spec)
    sys.modules["ecosystem"] = ecosystem  # dataclasses look it up
    spec.loader.exec_module(ecosystem)
    found = ecosystem.sections((DOCS / "your_library.md").read_text())
    assert len(found) == 8
    for one in found:
        assert 0 < one.lines <= 15, one.name
        assert "act = " in one.load or one.name == ecosystem.EXCUSED
        assert len(one.load.splitlines()) <= 9
        compile(one.load, one.name, "exec")
        assert one.packages[0].startswith("fieldgym")
