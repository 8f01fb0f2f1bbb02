"""Every page that fieldgym writes is opened in a real browser: no error, nothing from outside, readable."""

import importlib
import re
from dataclasses import replace
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from itertools import combinations
from pathlib import Path
from threading import Thread

import numpy as np
import pandas as pd
import platformdirs
import pytest
from matplotlib.figure import Figure

from fieldagents import demo
from fieldagents.config import EnvironmentConfig
from fieldagents.evaluation.config import EvaluateConfig
from fieldagents.evaluation.evaluate import evaluate
from fieldagents.task import get_task
from fieldmodels import html
from fieldmodels.diagnosis import diagnose
from fieldmodels.diagnosis.answer import in_words
from fieldmodels.diagnosis.report import write_results
from fieldmodels.machines.heel_strike.model import HeelStrikeModel
from fieldmodels.machines.heel_strike.parameters import Leg, Noise
from fieldmodels.machines.heel_strike.recording import record_walk
from fieldmodels.reality import Reality
from fieldmodels.recording.datasets import DatasetError, datasets, get_dataset
from fieldmodels.registry import get_model
from fieldmodels.rounding import percent
from fieldmodels.synthesis import synthesise
from papers import ledger as books
from papers.claim import Claim, Ours
from papers.pages import write_page
from papers.run import reproduce
from papers.source import all_sources

REALITIES = {
    "named": {"coulomb_friction": {"torque": 0.2}},
    "consistent": {},
}


def check_page(browser, *, figures: int) -> str:
    """The page has a title, its figures have a size, nothing sticks out; return its text."""
    assert browser.title
    browser.execute_script("document.querySelectorAll('details').forEach(d => d.open = true)")
    shown = browser.execute_script(
        "return [...document.querySelectorAll('figure svg, figure img')]"
        ".filter(e => e.getBoundingClientRect().height > 60).length"
    )
    assert shown >= figures
    for phone in (False, True):
        size = {"width": 390, "height": 844, "deviceScaleFactor": 1, "mobile": False}
        if phone:
            browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        width = browser.execute_script("return [document.documentElement.scrollWidth, window.innerWidth]")
        assert width[0] <= width[1], f"the page scrolls sideways{' on a phone' if phone else ''}"
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    check_seen(browser)
    words = browser.find_element("tag name", "body").text
    for broken in ("nan", "NaN", "undefined", "{{", "None"):
        assert broken not in words.split(), f"the page says {broken!r}"
    return words


def scheme(browser, name: str) -> None:
    """Let the system prefer a light or a dark scheme; "" for its own."""
    features = [{"name": "prefers-color-scheme", "value": name}]
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})


def lightness(browser, selector: str, kind: str) -> float:
    """Mean of red, green and blue of an element's colour, 0 to 255."""
    computed = "getComputedStyle(document.querySelector(arguments[0]))[arguments[1]]"
    red, green, blue = re.findall(r"[\d.]+", browser.execute_script(f"return {computed}", selector, kind))[:3]
    return (float(red) + float(green) + float(blue)) / 3


def check_scheme(browser, *, ground: str = "body", words: str = "p") -> None:
    """Dark words on a light ground, and the reverse where the system is dark."""
    try:
        for name, sign in (("light", 1), ("dark", -1)):
            scheme(browser, name)
            under, over = lightness(browser, ground, "backgroundColor"), lightness(browser, words, "color")
            assert sign * (under - over) > 100, f"{words} on {ground} in a {name} scheme"
    finally:
        scheme(browser, "")


def check_seen(browser) -> None:
    """Figures are described to who does not see them, drawn in the palette alone, and follow the system."""
    pictures, drawn = browser.execute_script(
        "return [[...document.querySelectorAll('figure svg, img, canvas')].map(e => e.alt ||"
        " (e.getAttribute('role') === 'img' && e.getAttribute('aria-label')) || ''),"
        " [...document.querySelectorAll('figure svg [style]')].map(e => e.getAttribute('style')).join()]"
    )
    outside = set(re.findall("#[0-9a-f]{6}", drawn))
    assert all(len(says) > 3 for says in pictures), pictures
    assert not outside, f"colours that are not in the palette: {outside}"
    check_scheme(browser)
    if browser.find_elements("css selector", "figure svg text"):
        check_scheme(browser, ground="figure", words="figure svg text")


# Machado, Oliveira and Fernandes 2009, severity 1, in linear RGB.
EYES = {
    "trichromat": np.eye(3),
    "protanope": [[0.1523, 1.0526, -0.2049], [0.1145, 0.7863, 0.0992], [-0.0039, -0.0481, 1.0520]],
    "deuteranope": [[0.3673, 0.8606, -0.2280], [0.2801, 0.6725, 0.0474], [-0.0118, 0.0429, 0.9689]],
    "tritanope": [[1.2555, -0.0767, -0.1788], [-0.0784, 0.9308, 0.1476], [0.0047, 0.6914, 0.3039]],
}
PALETTE = ("ink", "before", "after", "purple", "green", "amber", "grey")


def cielab(colour: str, eye: str) -> np.ndarray:
    """A colour as an eye sees it, so that distances are differences that are seen."""
    raw = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255
    linear = np.where(raw <= 0.04045, raw / 12.92, ((raw + 0.055) / 1.055) ** 2.4)
    seen = np.clip(np.array(EYES[eye]) @ linear, 0, 1)
    to_xyz = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    x, y, z = np.cbrt(np.maximum(np.array(to_xyz) @ seen / [0.9505, 1.0, 1.089], 1e-4))
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


@pytest.mark.every("eye", EYES)
@pytest.mark.every("dark", [False, True])
def test_every_eye_tells_the_palette_apart(eye: str, dark: bool):
    light, _, night = html.STYLE.partition("prefers-color-scheme: dark")
    found = dict(re.findall(r"--(\w+): (#[0-9a-f]{6})", night if dark else light))
    assert dark or {found[name] for name in PALETTE} < set(html.THEMED)
    for one, other in combinations(PALETTE, 2):
        apart = np.linalg.norm(cielab(found[one], eye) - cielab(found[other], eye))
        assert apart > 20, f"{one} and {other}"


def test_nothing_is_too_wide_for_a_phone(open_page, tmp_path: Path):
    """Long paths break, wide tables scroll in their own frame, and figures are drawn anew, not shrunk."""
    drawn = Figure(figsize=(html.WIDE, 4.0))
    for axes in drawn.subplots(1, 3, sharey=True):
        axes.plot([0, 1], color=html.GREEN)
    header = [f"a column {k}" for k in range(20)]
    body = (
        f"<p>{'a_long_path/' * 20}</p>{html.facts([('where', 'x' * 200)])}"
        f"{html.figure(drawn, 'three panels')}"
        f"{html.table(header, [['1.234 ± 0.012'] * 20], 'words above the table ' * 9)}"
    )
    page = tmp_path / "page.html"
    page.write_text(html.page("Wide", body))
    browser = open_page(page)
    check_page(browser, figures=1)
    size = {"width": 390, "height": 844, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    widths, letters = browser.execute_script(
        "return [[...document.querySelectorAll('p')].map(e => e.getBoundingClientRect().right),"
        " [...document.querySelectorAll('figure .narrow text')].map(e => e.getBoundingClientRect().height)]"
    )
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    assert max(widths) <= 390
    assert min(letters) > 9
    page.write_text(html.page("Wide", f'{body}<p style="min-width: 500px">too wide</p>'))
    browser.get(page.as_uri())
    with pytest.raises(AssertionError, match="sideways on a phone"):
        check_page(browser, figures=1)
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_evaluation_report(open_page, tmp_path: Path):
    config = EvaluateConfig(
        name="pages",
        task="heel_strike",
        environments={"short": EnvironmentConfig(settings={"strides": 20})},
        agents=["ranger", "fixed_tuned", "ekf"],
        baseline="ranger",
        episodes=20,
    )
    evaluate(config, tmp_path)
    words = check_page(open_page(tmp_path / "report.html"), figures=1)
    for agent in config.agents:
        assert agent in words
    assert "better" in words or "worse" in words
    assert len(list(tmp_path.glob("figures/*.png"))) == len(list(tmp_path.glob("figures/*.csv"))) > 1
    first = get_task("heel_strike").metrics[0]
    drawn = pd.read_csv(tmp_path / f"figures/short-{first.name}.csv")
    played = pd.read_parquet(tmp_path / "episodes.parquet").groupby("agent")[first.name].mean()
    means = drawn[drawn.panel == drawn.panel[0]].groupby("y").x.agg(list)  # single episodes, then the mean
    for agent in config.agents:
        assert means[agent][-1] == pytest.approx(played[agent], rel=1e-6)


def test_evaluation_report_of_shares_and_of_values_that_are_missing(open_page, tmp_path: Path):
    config = EvaluateConfig(
        name="pages",
        task="pose_reaching",
        environments={"anywhere": EnvironmentConfig(settings={"starts": "T3"})},
        agents=["path_memory_printed", "path_memory", "graceful"],
        baseline="graceful",
        episodes=20,
    )
    summary = evaluate(config, tmp_path)
    others = [metric for metric in get_task("pose_reaching").metrics[1:] if not metric.common]
    browser = open_page(tmp_path / "report.html")
    for details in browser.find_elements("tag name", "details"):
        details.click()
    words = check_page(browser, figures=1 + len(others))
    for metric in others:
        assert metric.title in words
    (printed,) = [row for row in summary.scenarios["anywhere"] if row.agent == "path_memory_printed"]
    assert printed.means["success"] < 0.2  # so that some of its values are missing
    assert "percentage points" in words


def test_reproduction_report(open_page, tmp_path: Path):
    reproduce("heel_strike/figure-2.12", tmp_path, ["strides=50"])
    words = check_page(open_page(tmp_path / "report.html"), figures=1)
    assert "Fig 2.12" in words


def test_ledger(open_page, tmp_path: Path, monkeypatch):
    """Verdicts come before claims and pictures; a run that fails is on the page."""
    claims = all_sources()["heel_strike"].claims
    chosen = [claims[name] for name in ("ranger", "best-decay", "shallow-minimum")]
    broken = Claim("x", ("Fig 0",), "It runs.", "1", (0, 1), Ours("figure-2.21", "x"))
    monkeypatch.setattr(books, "claims_of", lambda _task: [("heel_strike", c) for c in (*chosen, broken)])
    page = write_page(books.decide(tmp_path, quick=True), tmp_path)
    words = check_page(open_page(page), figures=1)
    for text in (
        "reproduced",
        "refuted",
        "not computable",
        "failed",
        "1 not as expected",
        "ours must be 308 to 358",
    ):
        assert text in words
    assert words.index("verdict") < words.index("Fig 2.12")


@pytest.mark.matrix(keep=("named",))
@pytest.mark.parametrize("verdict", REALITIES)
def test_diagnosis_report(open_page, tmp_path: Path, verdict: str):
    pendulum = get_model("pendulum")
    rng = np.random.default_rng(11)
    records = [
        synthesise(pendulum, REALITIES[verdict], "mixed", duration=25.0, step=0.01, amplitude=1.5, rng=rng)
        for _ in range(2)
    ]
    diagnosis = diagnose(pendulum, records[:1], records[1:])
    assert diagnosis.verdict == verdict
    written = write_results(diagnosis, tmp_path)
    browser = open_page(written["report.html"])
    words = check_page(browser, figures=2)
    assert in_words(diagnosis)[0] in words  # the terminal says the same
    if verdict == "named":
        several = replace(diagnosis, causes=2 * diagnosis.causes)
        assert ("With it" in words, "With them" in in_words(several)[0]) == (True, True)
        strokes = "return [...document.querySelectorAll('figure svg path')].map(e => e.style.strokeWidth)"
        widths = sorted(float(width) for width in browser.execute_script(strokes) if width)
        assert widths[-1] > 3 * widths[len(widths) // 2]  # the measured curve shows beside one on top of it
    for effect in REALITIES[verdict]:
        assert effect.replace("_", " ") in words.lower()
    assert (tmp_path / "figures/answer.png").stat().st_size > 10_000
    run = pd.read_csv(tmp_path / "figures/answer.csv")
    lost = run.angle.std() * len(run) ** 0.5
    fit = 100 * (1 - np.linalg.norm(run.angle - run.angle_after) / lost)
    assert percent(fit) in words


@pytest.mark.nightly
def test_heel_strike_diagnosis_report(open_page, tmp_path: Path):
    """Its derived signals have no value at the shortest horizon."""
    leg, noise = Leg(step=0.01), Noise(process=0.15, floor=0.001)
    bias = Reality(effects={"gyro_bias": {"rate": 0.006}})
    walk = record_walk(120.0, np.random.default_rng(3), noise, bias, leg)
    written = write_results(diagnose(HeelStrikeModel(leg), [walk]), tmp_path)
    assert "gyro bias" in check_page(open_page(written["report.html"]), figures=3)


def test_demo_report_says_that_its_data_are_simulated(open_page, tmp_path: Path, monkeypatch):
    def unreachable(*_args, **_more):
        raise DatasetError("there is no network here")

    monkeypatch.setattr(demo, "open_recording", unreachable)
    report = demo.run_demo(tmp_path, lambda _stage, _part: None, episodes=10)
    words = check_page(open_page(report.page), figures=4)
    names = {path.name for path in (tmp_path / "figures").iterdir()}
    assert {
        "task.png",
        *(f"{name}-error_mm.{kind}" for name in demo.SCENARIOS for kind in ("png", "csv")),
    } <= names
    assert "task.csv" not in names  # a photograph
    assert any("Coulomb" in finding for finding in report.findings)
    assert "simulated by another program" in words
    assert "there is no network here" in words
    assert "coulomb" in words.lower()


def test_the_shipped_recording_is_what_the_exam_s_plant_does(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "docs"))
    made = importlib.import_module("demo_recording")
    for seed, name in enumerate(("train", "test")):
        shipped = np.loadtxt(demo.SHIPPED / f"pendulum_{name}.csv", delimiter=",", skiprows=1)
        again = np.loadtxt(made.recorded(seed).splitlines(), delimiter=",", skiprows=1)
        assert shipped == pytest.approx(again, abs=1e-5)


def test_the_demo_fetches_what_is_real(public_data, tmp_path, monkeypatch):
    class Publisher(SimpleHTTPRequestHandler):
        def __init__(self, *given):
            super().__init__(*given, directory=str(public_data))

        def log_message(self, *_):
            pass

    monkeypatch.delenv("FIELDGYM_DATA")
    monkeypatch.setattr(platformdirs, "user_cache_dir", lambda _name: str(tmp_path))
    server = ThreadingHTTPServer(("127.0.0.1", 0), Publisher)
    Thread(target=server.serve_forever, daemon=True).start()
    for name in (demo.TRAIN, demo.TEST):
        known = get_dataset(name)
        here = replace(known, url=f"http://127.0.0.1:{server.server_port}/{known.file}")
        monkeypatch.setitem(datasets(), name, here)
    assert demo.find_recordings(get_model("pendulum")).real
    server.shutdown()
    assert demo.find_recordings(get_model("pendulum")).real  # from the cache


def test_demo_takes_real_data_where_there_are_some(public_data):
    bench = demo.find_recordings(get_model("pendulum"))
    assert bench.real
    assert "DFKI" in bench.about
    assert len(bench.train) == 3000
