"""``import fieldgym as fg``: what it offers, when it imports it, and that it works together."""

import ast
import re
import subprocess
import sys
from pathlib import Path
from pkgutil import resolve_name

import numpy as np
import pytest

import fieldgym as fg

HEAVY = {"numba", "scipy", "pandas", "matplotlib", "torch", "fieldagents", "fieldmodels.diagnosis"}


class Motor(fg.Machine):
    """Speed of a motor."""

    inputs = (fg.Signal("voltage", "V"),)
    states = outputs = (fg.Signal("speed", "rad/s", noise=0.2),)
    gain = fg.number("rad/s/V", 10.0, 0.0, 1e3)
    time_constant = fg.number("s", 0.1, 0.01, 10.0)
    effects = fg.effects.actuator("voltage", ("dead_zone", "lag", "bias"))

    def derivative(self, state, input, p):
        return (p.gain * input.voltage - state.speed) / p.time_constant


def made(seed):
    return fg.synthesise(
        Motor(),
        {"actuator_dead_zone": {"width": 1.0}},
        "mixed",
        duration=20.0,
        amplitude=6.0,
        rng=np.random.default_rng(seed),
    )


@pytest.fixture(scope="module")
def found():
    return fg.Diagnosis(Motor()).fit(made(0))


@pytest.mark.every("name", fg.__all__)
def test_a_public_name_is_there_and_says_what_it_is(name):
    if name == "make_sb3_vec":
        pytest.importorskip("stable_baselines3")
    assert getattr(fg, name).__doc__
    assert name in dir(fg)


def test_type_checkers_see_each_name_where_it_is():
    stub = ast.parse(Path(fg.__file__).with_suffix(".pyi").read_text())
    imported = [
        (f"{node.module}:{one.name}", one.asname)
        for node in stub.body
        if isinstance(node, ast.ImportFrom)
        for one in node.names
    ]
    (listed,) = [ast.literal_eval(node.value) for node in stub.body if isinstance(node, ast.Assign)]
    assert sorted(listed) == sorted(fg.__all__)
    assert {*listed, "tasks"} <= {"tasks", *(name for _, name in imported)}
    for place, name in imported:
        assert resolve_name(place) is getattr(fg, name), name


def test_importing_it_imports_nothing_heavy():
    code = "import sys, fieldgym; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not HEAVY & set(run.stdout.split())


def test_there_is_no_other_name():
    with pytest.raises(AttributeError, match="'fieldgym' has no attribute 'diagnosis'"):
        fg.diagnosis  # noqa: B018


def test_what_there_is_has_names():
    assert "heel_strike" in fg.tasks()
    assert "pendulum" in fg.machines()
    assert "regime_filter" in fg.agents("heel_strike")
    assert "dfki_simple_pendulum/ddp" in fg.datasets()
    assert fg.get_machine("pendulum").name == "pendulum"


def test_a_diagnosis_names_what_was_hidden_and_predicts_other_logs(found, tmp_path):
    assert found.verdict_ == "named"
    assert found.effects_["actuator_dead_zone"]["width"].value == pytest.approx(1.0, rel=0.2)
    assert "dead zone" in found.summary()
    assert "dead zone" in found._repr_html_()
    other = made(1)
    table = found.predict(other)
    error = table["speed"] - table["speed_predicted"]
    assert error.std() < 0.3  # the sensor's noise is 0.2 rad/s
    fg.save(other, tmp_path / "other.csv")
    assert 0.5 < found.score(tmp_path / "other.csv") < 1
    assert fg.Diagnosis(Motor()).fit(other, test=[made(2)]).result_.tested_on


def test_a_score_is_the_share_of_the_squared_error_that_the_report_states():
    log, test = made(0), made(1)
    found = fg.diagnose(log, Motor(), test=test)
    gain = found.result_.gain["speed"]
    stated = 1 - (gain.rmse_after / gain.rmse_before) ** 2
    assert found.score(test) == pytest.approx(stated, abs=0.02)


def test_a_diagnosis_writes_its_report_and_its_machine(found, tmp_path):
    page = found.report(tmp_path / "page.html")
    assert "dead zone" in page.read_text()
    assert [path.name for path in tmp_path.iterdir()] == ["page.html"]
    assert (found.report(tmp_path / "all") / "extended.yaml").is_file()
    names = {"__name__": "model"}
    exec(found.save(tmp_path / "model.py").read_text(), names)
    assert "simulate" in names


def test_what_was_found_is_an_environment(found, tmp_path):
    saved = found.save(tmp_path / "extended.yaml")
    first, second = (fg.make_env(Motor(), reality=one) for one in (found.reality_, str(saved)))
    for env in (first, second):
        env.reset(seed=1)
    action = np.array([0.1], dtype=np.float32)
    for _ in range(20):
        assert np.array_equal(first.step(action)[0], second.step(action)[0])


def test_nothing_is_known_before_a_log():
    diagnosis = fg.Diagnosis("pendulum")
    assert "not fitted" in repr(diagnosis)
    assert "not fitted" in diagnosis._repr_html_()
    with pytest.raises(ValueError, match=r"call fit\(log\) first"):
        diagnosis.verdict_  # noqa: B018


def test_a_log_is_read_as_the_command_line_reads_it(tmp_path):
    log = made(0)
    path = tmp_path / "log.csv"
    fg.save(log, path)
    read = fg.load(path, Motor())
    assert np.array_equal(read["speed"], log["speed"])
    assert set(fg.load(path).signals) == {"voltage", "speed"}
    text = path.read_text()
    path.write_text(text.replace("voltage", "a").replace("speed", "b"))
    with pytest.raises(ValueError, match="accept=True"):
        fg.load(path, Motor())
    with pytest.warns(UserWarning, match="its columns are read as"):
        assert np.array_equal(fg.load(path, Motor(), accept=True)["speed"], log["speed"])


def test_agents_are_compared_by_a_config_or_plain_data(tmp_path):
    config = {
        "name": "comparison",
        "task": "pendulum",
        "environments": {"nominal": {"settings": {"duration": 0.5}}},
        "agents": ["feedback", "still"],
        "baseline": "feedback",
    }
    summary = fg.evaluate(config, tmp_path, episodes=2)
    assert {row.agent for row in summary.scenarios["nominal"]} == {"feedback", "still"}
    assert "episodes" not in config
    with pytest.raises(ValueError, match="unknown key"):
        fg.evaluate(config, tmp_path, episode=2)
    with pytest.raises(ValueError, match=r"\(did you mean heel_strike/ppo\?\)"):
        fg.train("heel_strike/pppo")


def test_a_reality_is_checked():
    assert fg.reality({"coulomb_friction": {"torque": 0.1}}, "pendulum").effects
    with pytest.raises(ValueError, match="did you mean 'coulomb_friction'"):
        fg.reality({"coulomb_frictoin": {"torque": 0.1}}, "pendulum")


def test_the_page_begins_with_every_name():
    page = (Path(__file__).parents[1] / "docs" / "api.md").read_text().split("## Example")[0]
    assert set(re.findall(r"`(\w+)`", page.split("|---|")[1])) - {"fit"} == set(fg.__all__)
