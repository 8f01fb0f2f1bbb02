"""A user's own simulator in a Python file: the page's works, and each mistake has a message of its own."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from fieldagents.cli import app
from fieldagents.logs import Logs
from fieldmodels import contract
from fieldmodels.contract import ContractError, ModelWarning, at_rest, check_declarations, check_simulation
from fieldmodels.effects import actuators, changes, forces, sensors
from fieldmodels.model import ModelError
from fieldmodels.model_files import is_model_file, load_model_file
from fieldmodels.registry import get_model, model_names

DOCS = Path(__file__).parents[2] / "docs"
OWN = (DOCS / "bring_your_own_bench.md").read_text().split("## Your own simulator")[1]
CHAMBER, LAG = ((DOCS / name).read_text() for name in ("chamber.py", "lag.py"))
MOTOR, AXIS = (block.split("```")[0] for block in OWN.split("```python\n")[1:])


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def written(folder: Path, text: str) -> Path:
    folder.mkdir(exist_ok=True)
    path = folder / "motor.py"
    path.write_text(text)
    return path


def changed(old: str, new: str, text: str = LAG) -> str:
    assert old in text
    return text.replace(old, new)


def tried(path: Path) -> None:
    """Load a model and simulate it on random voltages with a random speed."""
    model = load_model_file(str(path))
    recording = at_rest(model, 0.01, 5.0, np.random.default_rng(0))
    recording.signals["speed"][:] = np.cumsum(np.random.default_rng(1).normal(size=len(recording)))
    check_simulation(model, recording, "motor.py")


@pytest.mark.filterwarnings("error::fieldmodels.contract.ModelWarning")
def test_the_page_s_machine_fits_in_a_dozen_lines_and_finds_what_is_hidden(tmp_path, monkeypatch):
    assert len([line for line in MOTOR.splitlines() if line.strip()]) <= 10
    monkeypatch.chdir(tmp_path)
    written(tmp_path, MOTOR)
    (tmp_path / "motor.yaml").write_text(OWN.split("```yaml\n")[1].split("```")[0])
    for line in OWN.split("```\n\n```\n")[1].split("```")[0].splitlines():
        result = CliRunner().invoke(app, line.removeprefix("fieldgym ").split())
        assert result.exit_code == 0, result.output
    found = json.loads(Path("results/motor/diagnosis.json").read_text())
    assert found["verdict"] == "named"
    assert [cause["effect"] for cause in found["causes"]] == ["actuator_dead_zone"]
    assert found["causes"][0]["parameters"]["width"]["value"] == pytest.approx(1.0, abs=0.02)
    extended = ["record", "motor.yaml", "--set", "machine=motor.py", "--set"]
    assert CliRunner().invoke(app, [*extended, "reality=results/motor/extended.yaml"]).exit_code == 0


def dry_axis(seed: int, friction: float, step: float = 0.01, finer: int = 100) -> dict[str, np.ndarray]:
    """Two kilograms on a dry guide, by small steps; it stays where friction holds it."""
    rng, dt = np.random.default_rng(seed), step / finer
    force = np.repeat(rng.uniform(-12.0, 12.0, 150), 20)
    position, speed, shown = 0.0, 0.0, []
    for pull in force:
        shown.append(position)
        for _ in range(finer):
            free = speed + dt * (pull - 4.0 * speed) / 2.0
            speed = np.sign(free) * max(abs(free) - dt * friction / 2.0, 0.0)
            position += dt * speed
    return {
        "t": step * np.arange(len(force)), "force": force,
        "position": np.array(shown) + 1e-4 * rng.normal(size=len(force)),
    }  # fmt: skip


@pytest.mark.nightly
@pytest.mark.filterwarnings("error::fieldmodels.contract.ModelWarning")
def test_the_page_s_machine_of_two_states_finds_the_friction_of_an_axis(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("axis.py").write_text(AXIS)
    for seed in (1, 2):
        columns = dry_axis(seed, 1.5)
        rows = zip(*columns.values(), strict=True)
        lines = [",".join(columns), *(",".join(f"{cell:.7g}" for cell in row) for row in rows)]
        Path(f"{seed}.csv").write_text("\n".join(lines))
    clock, read = [0.0], Logs.read

    def slowly(logs, source):
        clock[0] += 40.0
        return read(logs, source)

    monkeypatch.setattr(Logs, "read", slowly)
    monkeypatch.setattr("fieldagents.cli.perf_counter", lambda: clock[0])
    result = CliRunner().invoke(
        app, ["diagnose", "1.csv", "--machine", "axis.py", "--test", "2.csv", "--out", "out", "--json"]
    )
    assert result.exit_code == 0, result.output
    found = json.loads(Path("out/diagnosis.json").read_text())
    assert [cause["effect"] for cause in found["causes"]] == ["coulomb_friction"]
    (value,) = found["causes"][0]["parameters"].values()
    assert (value["unit"], value["value"]) == ("N", pytest.approx(1.5, rel=0.05))
    assert found["seconds"] == 80.0  # reading the logs is in it


def warm_chamber(seed: int) -> dict[str, np.ndarray]:
    """Five and a half hours of a chamber whose wall stores heat, by steps of a second; 700 W are its most."""
    rng = np.random.default_rng(seed)
    heat = np.repeat(rng.choice([0.0, 200.0, 400.0, 600.0, 800.0, 1000.0], 66), 60)
    air, wall, shown = 21.0, 21.0, []
    for watts in heat:
        shown.append(air)
        for _ in range(5):
            through = 14.0 * (air - wall)
            air += (min(watts, 700.0) - 8.0 * (air - 21.0) - through) / 9e3
            wall += through / 4e4
    noisy = np.array(shown) + 0.05 * rng.normal(size=len(heat))
    return {
        "t [s]": 5.0 * np.arange(len(heat)),
        "heat": heat,
        "ambient": np.full(len(heat), 21.0),
        "air": noisy,
    }


@pytest.mark.nightly
@pytest.mark.parametrize("window", [(), ("--window", "record")])
@pytest.mark.filterwarnings("error::fieldmodels.contract.ModelWarning")
def test_the_page_s_wall_is_found_with_its_size(tmp_path, monkeypatch, window):
    monkeypatch.chdir(tmp_path)
    Path("chamber.py").write_text(CHAMBER)
    for seed in (1, 2):
        columns = warm_chamber(seed)
        rows = zip(*columns.values(), strict=True)
        lines = [",".join(columns), *(",".join(f"{cell:.7g}" for cell in row) for row in rows)]
        Path(f"{seed}.csv").write_text("\n".join(lines))
    logs = ["diagnose", "1.csv", "--machine", "chamber.py", "--test", "2.csv", "--out", "out"]
    result = CliRunner().invoke(app, [*logs, "--json", *window])
    assert result.exit_code == 0, result.output
    found = json.loads(Path("out/diagnosis.json").read_text())
    sizes = {cause["effect"]: cause["parameters"] for cause in found["causes"]}
    assert sizes.keys() == {"wall", "actuator_saturation"}
    assert sizes["actuator_saturation"]["limit"]["value"] == pytest.approx(700.0, rel=0.02)
    assert sizes["wall"]["conductance"]["value"] == pytest.approx(14.0, rel=0.1)
    assert sizes["wall"]["capacity"]["value"] == pytest.approx(4e4, rel=0.02 if window else 0.2)


def test_the_page_names_every_stock_effect():
    table = OWN.split("| declared as")[1].split("\n\n")[0]
    for place in (actuators, forces, sensors, changes):
        assert [kind for kind in place.LIBRARY if f"`{kind}`" not in table] == []


UNCOMPILED = changed(
    "return (p.gain * input.voltage", "return next(x for x in [1.0]) * (p.gain * input.voltage", MOTOR
)


def test_what_numba_cannot_compile_gives_the_same_numbers_with_a_warning(tmp_path, rng):
    plain = load_model_file(str(written(tmp_path / "a", MOTOR)))
    slow = str(written(tmp_path / "b", UNCOMPILED))
    recording = at_rest(plain, 0.01, 5.0, rng)
    windows = plain.windows(recording, 0.1)
    windows = windows.select(np.arange(3)).with_states(rng.normal(size=(3, 1)))
    effects = {
        "actuator_lag": {"time_constant": 0.013},
        "coulomb_friction": {"rate": 3.0},
        "sensor_delay": {"delay": 0.013},
        "speed_curve": {"value_2": 5.0, "low": -20.0, "high": 20.0},
    }
    for values in ({}, effects):
        vector = plain.vector({}, values)
        with pytest.warns(
            ModelWarning, match=r"Numba cannot compile it.*Motor\.derivative, line 13: it holds a generator"
        ):
            got = load_model_file(slow).simulate(vector, windows)
        np.testing.assert_allclose(got, plain.simulate(vector, windows), rtol=1e-12)


def test_a_file_runs_only_if_the_command_line_names_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    written(tmp_path, "raise SystemExit('it ran')")
    (tmp_path / "motor.yaml").write_text("{name: motor, model: motor.py, reality: {a: {b: 1}}, duration: 9}")
    result = CliRunner().invoke(app, ["record", "motor.yaml"])
    assert result.exit_code == 2
    assert "a Python file is run only if the command line names it: --set machine=motor.py" in result.stderr
    assert "it ran" not in result.stderr
    result = CliRunner().invoke(app, ["record", "motor.yaml", "--set", "machine=motor.py"])
    assert result.exit_code == 2
    assert "motor.py:1: SystemExit: it ran" in result.stderr


def test_shipped_models_keep_the_contract_s_declarations():
    for name in model_names():
        assert not is_model_file(name)
        check_declarations(get_model(name))


SECOND = LAG + "\n\nclass Other(Lag):\n    name = 'other'\n"
BROKEN_FILES = {
    "a syntax error": ("import numpy as np\ndef broken(:\n", r"motor\.py:2: SyntaxError"),
    "a failing import": ("import os\nimport nothing_of_that_name\n", r"motor\.py:2: ModuleNotFoundError"),
    "no model": ("x = 1\n", "defines no model; write a class that inherits from"),
    "several models": (SECOND, r"defines 2 models; say which: .*motor\.py:Lag or .*motor\.py:Other"),
    "a method missing": (
        changed("def initial_states", "def initial_state"),
        r"motor\.py:8: Lag does not implement initial_states",
    ),
    "arguments wanted": (
        changed('name = "lag"', 'name = "lag"\n    def __init__(self, gain): ...'),
        r"missing 1 required positional argument",
    ),
    "impossible bounds": (
        changed('"rad/s/V", 10.0, 0.0', '"rad/s/V", 10.0, 20.0'),
        r"parameter 'gain': nominal 10.0 is outside",
    ),
    "no horizons": (changed("horizons = (0.1, 0.2, 0.4)", ""), "horizons: missing"),
    "horizons that fall": (changed("(0.1, 0.2, 0.4)", "(0.4, 0.2)"), "horizons: must increase"),
    "a comma missing": (
        changed('states = (Signal("speed", "rad/s"),)', 'states = (Signal("speed", "rad/s"))'),
        r"states: must be a tuple of Signal, not Signal; one alone needs a comma",
    ),
    "no name": (changed('name = "lag"', ""), "name: missing"),
    "a signal twice": (changed('"voltage", "V"', '"speed", "V"'), "signal 'speed' is declared 2 times"),
    "cause and place swapped": (changed('"force",\n', '"forces",\n'), "where must be force or actuator"),
    "a start out of bounds": (changed("(0.2, 1.0)", "(0.2, 11.0)"), "start 11 of 'width' is outside"),
}


@pytest.mark.every("mistake", BROKEN_FILES)
def test_a_file_that_cannot_be_used_is_refused(tmp_path, mistake):
    text, message = BROKEN_FILES[mistake]
    with pytest.raises(ModelError, match=message):
        load_model_file(str(written(tmp_path, text)))


def test_one_of_several_models_is_chosen_by_its_class(tmp_path):
    path = written(tmp_path, SECOND)
    assert load_model_file(f"{path}:Other").name == "other"
    with pytest.raises(ModelError, match=r"has no model 'Othr' \(did you mean 'Other'\?\)"):
        load_model_file(f"{path}:Othr")
    with pytest.raises(ModelError, match=r"no such file \(did you mean '.*motor\.py'\?\)"):
        load_model_file(str(tmp_path / "moter.py"))


NOT_CONTRACTED = {
    "states of a wrong shape": (
        changed('recording["speed"][starts][:, None]', 'recording["speed"][starts]'),
        r"initial_states returned shape \(\d+,\), not \(starts, states\)",
    ),
    "states that are not finite": (
        changed('recording["speed"][starts]', 'np.log(0 * recording["speed"][starts])'),
        "initial_states: state 'speed' is",
    ),
    "outputs of a wrong shape": (
        changed("return result\n", "return result[..., 0]\n"),
        r"simulate returned shape .* not \(vectors, windows, samples, outputs\)",
    ),
    "an error inside": (
        changed('windows.recording["voltage"]', 'windows.recording["volts"]'),
        r"motor\.py:\d+: KeyError: 'volts' \(in simulate\)",
    ),
    "noise in the simulation": (
        changed("return result\n", "return result + np.random.normal(size=result.shape)\n"),
        "two equal calls give different outputs",
    ),
    "one vector for the whole batch": (
        changed("np.atleast_2d(parameters).T", "(0 * parameters + parameters[:1]).T"),
        "a vector gives other outputs in a batch than alone",
    ),
    "windows that hang together": (
        changed("return result\n", "return result - result[:, :1]\n"),
        "a window gives other outputs among others than alone",
    ),
    "a look at the answer": (
        changed("speed = target +", 'speed = windows.recording["speed"][row] + target +'),
        "outputs depend on the measured outputs",
    ),
    "states that are overwritten": (
        changed(
            "speed = np.tile(windows.states[:, 0], (len(gain), 1))",
            "speed = np.tile(windows.states[:, 0], (len(gain), 1)); windows.states[:] = 0.0",
        ),
        r"simulate changes windows\.states; work on a copy",
    ),
    "a command that does nothing": (
        changed("target = gain * arriving", "target = gain * 0"),
        "input 'voltage' does not change any output",
    ),
    "a gain that is 0 where it should be 1": (
        changed('Parameter("width", "V", 0.0', 'Parameter("width", "1", 0.0').replace(
            "arriving = np.sign(voltage) * np.maximum(np.abs(voltage) - width, 0.0)",
            "arriving = width * voltage",
        ),
        "is an effect's neutral value wrong",
    ),
    "an effect that is never off": (
        changed("gain * arriving - load", "gain * arriving - load - 5.0 * (width > 0)"),
        "effect 'dead_zone' jumps at its neutral values",
    ),
    "an unstable simulation": (changed("return result\n", "return result + np.inf\n"), "no value is finite"),
}  # fmt: skip


@pytest.mark.every("mistake", NOT_CONTRACTED)
def test_a_model_that_breaks_the_contract_is_refused(tmp_path, mistake):
    text, message = NOT_CONTRACTED[mistake]
    with pytest.raises(ContractError if "error" not in mistake else ModelError, match=message):
        tried(written(tmp_path, text))


def test_an_effect_without_effect_is_warned_of(tmp_path):
    with pytest.warns(ModelWarning, match="constant_load changes nothing on these data"):
        tried(written(tmp_path, changed("gain * arriving - load", "gain * arriving")))


def test_a_stock_effect_without_effect_is_not_warned_of(tmp_path, recwarn):
    """A stop or a limit far from the data is as it should be, and the user has not written it."""
    path = written(tmp_path, changed('sensor("speed")', 'sensor("speed", ("clipping",))', MOTOR))
    model = load_model_file(str(path))
    check_simulation(model, at_rest(model, 0.01, 1e-3, np.random.default_rng(0)), "motor.py")
    assert not [one for one in recwarn if issubclass(one.category, ModelWarning)]


HOT_PLATE = """
from fieldmodels.effects import actuator
from fieldmodels.machine import Machine, number
from fieldmodels.model import Signal


class HotPlate(Machine):
    inputs = (Signal("power", "W"),)
    states = outputs = (Signal("temperature", "degC", noise=0.1),)
    heating = number("K/J", 0.02, 1e-4, 10.0)
    cooling = number("1/s", 0.05, 0.0, 10.0)
    effects = actuator("power", ("lag",))

    def derivative(self, state, input, p):
        return p.heating * input.power - p.cooling * (state.temperature - 20.0)
"""


@pytest.mark.matrix(keep=("0.4",))
@pytest.mark.parametrize("step", [0.1, 0.4])
def test_a_slow_machine_needs_no_horizons(tmp_path, rng, step):
    """They follow the data; where they are stated, and too short, the remedy is said."""
    power = np.repeat(rng.uniform(0.0, 60.0, 60), 20)
    warm, rows = 20.0, ["t,power,temperature"]
    for k, heat in enumerate(power):
        rows.append(f"{k * step:.1f},{heat:.3f},{warm + 0.1 * rng.normal():.3f}")
        warm += step * (0.02 * heat - 0.05 * (warm - 20.0))
    (tmp_path / "log.csv").write_text("\n".join(rows))
    path = written(tmp_path, HOT_PLATE)
    asked = ["diagnose", str(tmp_path / "log.csv"), "--machine", str(path), "--dry-run", "--json"]
    found = CliRunner().invoke(app, asked)
    assert found.exit_code == 0, found.output
    said = re.search(r"([\d.]+) windows of ([\d.]+) s", found.stdout)
    assert said is not None
    assert float(said[2]) >= 16 * step

    written(tmp_path, changed("    heating", "    horizons = (0.1, 0.2)\n    heating", HOT_PLATE))
    found = CliRunner().invoke(app, asked)
    assert found.exit_code == 2
    assert f"horizons = ({8 * step:.2g}, {16 * step:.2g})" in found.stderr.replace("\n", " ")


STIFF = """
from fieldmodels.machine import Machine, number
from fieldmodels.model import Signal


class Stiff(Machine):
    inputs = (Signal("voltage", "V"),)
    states = outputs = (Signal("speed", "rad/s", noise=0.2),)
    slow = number("1/s", 3.0, 0.1, 1e3)
    effects = ()

    def derivative(self, state, input, p):
        return input.voltage - p.slow * state.speed * (1.0 + FACTOR * state.speed**2)
"""


@pytest.mark.nightly
def test_a_generated_simulation_may_differ_by_its_steps_alone(tmp_path, monkeypatch):
    """Steps follow from some windows: those of one alone are others, which its error bounds; else say so."""
    model = load_model_file(str(written(tmp_path, STIFF.replace("FACTOR", "0.1"))))
    recording = at_rest(model, 0.01, 5.0, np.random.default_rng(0))
    recording.signals["speed"][:] = np.linspace(5.0, 0.0, len(recording))
    check_simulation(model, recording, "motor.py")
    monkeypatch.setattr(contract, "STEPS_APART", 0.0)
    with pytest.raises(ContractError, match=r"give the model `pace\(self, p\)`"):
        check_simulation(model, recording, "motor.py")


def test_list_shows_a_model_of_one_s_own(tmp_path):
    path = written(tmp_path, MOTOR)
    (model,) = json.loads(CliRunner().invoke(app, ["list", str(path), "--json"]).stdout)["machines"]
    assert [p["name"] for p in model["parameters"]] == ["gain", "time_constant"]
    assert [s["name"] for s in (*model["inputs"], *model["outputs"])] == ["voltage", "speed"]
    assert "coulomb_friction" in {e["name"] for e in model["effects"]}
    shown = CliRunner().invoke(app, ["list", str(path)]).stdout
    assert all(name in shown for name in ("voltage", "time_constant", "coulomb_friction"))
    (tmp_path / "bench.yaml").write_text("model: rig\n")
    (rig,) = json.loads(CliRunner().invoke(app, ["list", f"{tmp_path}/bench.yaml", "--json"]).stdout)[
        "models"
    ]
    assert rig["name"] == "rig"
    (tmp_path / "bench.yaml").write_text(f"model: {path}\n")  # a file that somebody else may have written
    refused = CliRunner().invoke(app, ["list", f"{tmp_path}/bench.yaml"])
    assert refused.exit_code == 2
    assert "run only if you name it yourself" in refused.stderr.replace("\n", " ")


def test_the_command_line_tries_a_model_before_it_is_fitted(tmp_path):
    path = written(tmp_path, changed("return result\n", "return result[..., 0]\n"))
    log = tmp_path / "log.csv"
    log.write_text("t,voltage,speed\n" + "".join(f"{i / 100},{i % 7},{i % 5}\n" for i in range(400)))
    result = CliRunner().invoke(app, ["diagnose", str(log), "--machine", str(path)])
    assert result.exit_code == 2
    assert "motor.py: simulate returned shape" in result.stderr


@pytest.mark.nightly
def test_what_is_odd_about_a_log_is_said_in_the_terminal_and_in_the_report(tmp_path):
    (tmp_path / "rig.yaml").write_text("{name: rig, model: rig, duration: 12, excitation: {amplitude: 5}}")
    assert (
        CliRunner().invoke(app, ["record", str(tmp_path / "rig.yaml"), "--out", str(tmp_path)]).exit_code == 0
    )
    header, *rows = (tmp_path / "rig.csv").read_text().splitlines()
    del rows[300]
    (tmp_path / "rig.csv").write_text("\n".join([header, *rows]))
    asked = ["diagnose", str(tmp_path / "rig.csv"), "--machine", "rig", "--out", str(tmp_path)]
    result = CliRunner().invoke(app, [*asked, "--column", "position=position:mm"])
    assert result.exit_code == 0, result.output
    said = (
        "put on an even step of 0.01 s",
        "'position' looks as if it were in km: it changes 0.001 times as fast",
    )
    found = json.loads((tmp_path / "diagnosis.json").read_text())
    for words in said:
        assert words in result.stderr
        assert words in (tmp_path / "report.html").read_text().replace("&#x27;", "'").replace("&#39;", "'")
        assert any(words in note for note in found["data"]["notes"])
