"""The page of `fieldgym open`: whom it refuses, what it does in a browser, what its script does."""

import csv
import http.client
import json
import re
import sys
import threading
import time
import urllib.error
import urllib.request
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
import pytest
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import WebDriverWait

sys.path.insert(0, str(Path(__file__).parents[1] / "logs"))
from expected import made

from fieldagents.app.buckets import buckets
from fieldagents.app.server import application, listening
from fieldagents.app.session import CancelledError, Job, Session
from fieldmodels.recording import RecordingError
from fieldmodels.recording.sources import together
from fieldmodels.registry import get_model
from fieldmodels.synthesis import synthesise

uvicorn = pytest.importorskip("uvicorn")
TOKEN = "a-token-of-the-tests"


class Served:
    """A page that is served for a test."""

    def __init__(self, folder: Path) -> None:
        self.session = Session(folder / "results")
        (folder / "dropped").mkdir()
        self.dropped = folder / "dropped"
        bound = listening(0)
        self.port = bound.getsockname()[1]
        self.address = f"http://127.0.0.1:{self.port}"
        app = application(self.session, self.dropped, TOKEN, self.port)
        self.server = uvicorn.Server(uvicorn.Config(app, log_level="error", ws="none"))
        self.thread = threading.Thread(target=self.server.run, kwargs={"sockets": [bound]}, daemon=True)
        self.thread.start()

    def ask(self, path: str, data: bytes | None = None, **headers: str) -> tuple[int, str]:
        """Status and text; by default as the page itself asks."""
        usual = {"Cookie": f"fieldgym-{self.port}={TOKEN}", "Origin": self.address, **headers}
        given = {name.replace("_", "-"): value for name, value in usual.items() if value}
        request = urllib.request.Request(self.address + path, data, given)
        try:
            with urllib.request.urlopen(request, timeout=600) as response:
                return response.status, response.read().decode("utf-8", "replace")
        except urllib.error.HTTPError as error:
            return error.code, error.read().decode("utf-8", "replace")


@pytest.fixture
def served(tmp_path: Path):
    page = Served(tmp_path)
    yield page
    page.session.cancel()
    page.server.should_exit = True
    page.thread.join(10)


def write_log(path: Path, seed: int = 11, seconds: float = 25.0) -> Path:
    """A pendulum with dry friction, as a German logger with a reversed torque writes it."""
    rng, hidden = np.random.default_rng(seed), {"coulomb_friction": {"torque": 0.2}}
    r = synthesise(
        get_model("pendulum"), hidden, "mixed", duration=seconds, step=0.01, amplitude=1.5, rng=rng
    )
    rows = np.column_stack([1000 * r.time, -r["torque"], np.degrees(r["angle"]), r["velocity"]])
    with path.open("w", encoding="latin-1", newline="") as file:
        writer = csv.writer(file, delimiter=";")
        writer.writerow(["Zeit [ms]", "Moment [N m]", "Winkel [deg]", "Geschwindigkeit [rad/s]"])
        writer.writerows([[f"{x:.6f}".replace(".", ",") for x in row] for row in rows])
    return path


@pytest.mark.every(
    ("path", "headers"),
    [
        ("/", {"Cookie": ""}),
        ("/?token=another", {"Cookie": ""}),
        ("/api/state", {"Cookie": ""}),
        (f"/api/state?token={TOKEN}", {"Cookie": ""}),
        ("/api/state", {"Host": "evil.example"}),
        ("/api/state", {"Host": "127.0.0.1"}),
        ("/api/state", {"Origin": "http://evil.example"}),
        ("/api/state", {"Origin": "null"}),
        ("/static/app.js", {"Cookie": ""}),
        ("/api/state", {"Upgrade": "websocket", "Connection": "Upgrade", "Origin": "http://evil.example"}),
    ],
)
def test_who_is_refused(served: Served, path: str, headers: dict[str, str]):
    assert served.ask("/api/state")[0] == 200
    status, text = served.ask(path, **headers)
    assert status == 403
    assert text.startswith("refused")


def test_a_column_that_never_changes_is_told_of(served: Served):
    log = served.dropped / "still.csv"
    log.write_text("t,torque_cmd,angle\n" + "".join(f"{i / 100},2.0,{(i % 50) / 50}\n" for i in range(300)))
    assert served.ask("/api/open", json.dumps({"path": str(log)}).encode())[0] == 200
    status, text = served.ask("/api/propose", json.dumps({"model": "pendulum"}).encode())
    assert status == 200, text
    found = json.loads(text)
    assert (found["missing"], found["constant"]) == (["torque"], ["torque_cmd"])


def test_the_runs_in_a_log_are_shown_among_its_columns(served: Served):
    """By another name than the one that is found without being told."""
    rows = "".join(f"{i % 200 / 100},{i // 200},{i % 7},{i % 50 / 50}\n" for i in range(1000))
    (served.dropped / "set.csv").write_text(f"timestamp,episode_index,torque_cmd,angle\n{rows}")
    served.session.open(served.dropped / "set.csv")
    _, text = served.ask("/api/propose", json.dumps({"model": "pendulum"}).encode())
    found = json.loads(text)
    assert "episode" in found["roles"]
    assert {c["role"]: c["spec"] for c in found["columns"]}["episode"] == "episode_index"


def test_a_change_needs_an_origin(served: Served):
    body = json.dumps({"path": str(served.dropped / "none.csv")}).encode()
    assert served.ask("/api/open", body, Origin="")[0] == 403
    status, text = served.ask("/api/open", body)
    assert status == 400
    assert "no such file" in json.loads(text)["error"]


def test_no_path_is_built_from_the_name_of_a_dropped_log(served: Served, tmp_path: Path):
    log = write_log(tmp_path / "log.csv", seconds=2.0).read_bytes()
    for name in ("../../evil.csv", "/etc/passwd", "a\\b.csv", "..", "log.csv.%2e%2e%2f", "x" * 5000):
        status, _ = served.ask(f"/api/drop?name={urllib.request.quote(name)}", log)
        assert status in (200, 400)
    for place in ("../evil.csv", "a/../../evil.csv", "/etc/passwd", ".ssh/key", "a\\b.csv", "a//b.csv"):
        status, text = served.ask(f"/api/drop?name=set&inside={urllib.request.quote(place)}", log)
        assert (status, "no plain name" in text) == (400, True)
    assert served.ask("/api/drop?name=set&inside=a.csv&folder=..", log)[0] == 400
    inside = sorted(path.name for path in served.dropped.iterdir())
    assert len(inside) == 6
    assert all(re.fullmatch(r"log-\d(\.[a-z0-9]+){0,2}", name) for name in inside)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["dropped", "log.csv"]
    for path in ("/file/../log.csv", "/file/%2e%2e/log.csv", "/static/../session.py", "/file//etc/passwd"):
        assert served.ask(path)[0] == 404


def split_log(folder: Path, number: int, seconds: float = 2.0) -> list[Path]:
    """A run of which two loggers hold a part each, as of one clock."""
    whole = write_log(folder / "whole.csv", number, seconds).read_text("latin-1")
    cells = [line.split(";") for line in whole.splitlines()]
    parts = {f"drive_{number}.csv": (0, 1), f"encoder_{number}.csv": (0, 2, 3)}
    for name, columns in parts.items():
        (folder / name).write_text("\n".join(";".join(row[j] for j in columns) for row in cells) + "\n")
    return [folder / name for name in parts]


def test_files_of_one_run_are_one_log_wherever_they_come_from(tmp_path: Path):
    """Other columns, other loggers of the same run; the same ones, other runs; and what goes with neither."""
    (drive, encoder), (drive2, encoder2) = split_log(tmp_path, 1), split_log(tmp_path, 2)
    assert together([drive, encoder]) == [(drive, encoder)]
    assert together([drive, drive2]) == [(drive,), (drive2,)]
    assert together([drive, drive2, encoder, encoder2]) == [(drive, encoder), (drive2, encoder2)]
    assert together([drive, drive2, encoder]) == [(drive,), (drive2,), (encoder,)]
    later = tmp_path / "later.csv"
    later.write_text("t,u\n" + "".join(f"{1e6 + 0.01 * k},{k % 7}\n" for k in range(200)))
    assert together([drive, later]) == [(drive,), (later,)]  # no times in common
    assert together([]) == []


def test_a_database_of_a_bus_goes_with_every_trace(tmp_path: Path):
    """Two traces and a DBC, dropped at once, in whatever order."""
    for library in ("can", "cantools", "asammdf"):
        pytest.importorskip(library)
    told = made("can_trace", tmp_path)
    trace, dbc = map(Path, told.source.split("+"))
    second = trace.with_name("second.log")
    second.write_bytes(trace.read_bytes())
    assert together([dbc, trace]) == [(dbc, trace)]
    assert together([trace, dbc, second]) == [(trace, dbc), (second, dbc)]


def test_several_files_are_dropped_at_once(served: Served, browser, tmp_path: Path):
    """Two loggers of two runs become two logs; a folder's files are what they are beside each other."""
    files = [str(path) for number in (1, 2) for path in split_log(tmp_path, number)]
    (tmp_path / "set/meta").mkdir(parents=True)
    (tmp_path / "set/data/chunk-000").mkdir(parents=True)
    (tmp_path / "set/.cache").write_text("not for readers")
    (tmp_path / "set/meta/info.json").write_text(json.dumps({"features": {"action": {"names": ["lift"]}}}))
    lists = pa.table({"timestamp": np.arange(9.0), "action": [[float(k)] for k in range(9)]})
    pa.parquet.write_table(lists, tmp_path / "set/data/chunk-000/file-000.parquet")
    find = lambda name: browser.find_element(By.ID, name)  # noqa: E731
    browser.get(f"{served.address}/?token={TOKEN}")
    for paths, count in ((files, 2), ([str(tmp_path / "set")], 3)):
        for kind in ("dragEnter", "dragOver", "drop"):
            data = {"items": [], "files": paths, "dragOperationsMask": 1}
            at = {"x": find("drop").rect["x"] + 20, "y": find("drop").rect["y"] + 20}
            browser.execute_cdp_cmd("Input.dispatchDragEvent", {"type": kind, "data": data, **at})
        _until(browser, lambda _b, n=count: len(served.session.logs) == n or find("trouble").text, 20.0)
        assert not find("trouble").text
    _until(browser, lambda b: len(b.find_elements(By.CSS_SELECTOR, "#logs li")) == 3, 20.0)
    shown = [one.text.partition(":")[0] for one in browser.find_elements(By.CSS_SELECTOR, "#logs li")]
    assert shown == ["drive_1.csv + encoder_1.csv", "drive_2.csv + encoder_2.csv", "set"]
    assert "action[lift]" in served.session.logs[2].table.header


def test_signals_are_shown_over_seconds_by_whatever_clock_a_log_has(tmp_path: Path):
    """Milliseconds of another language, two loggers with a rate each, runs in a row, no clock at all."""
    session = Session(tmp_path / "results")
    time, why = session.times(session.open(write_log(tmp_path / "german.csv", seconds=2.0)), "Winkel [deg]")
    np.testing.assert_allclose(time, 0.01 * np.arange(200), atol=1e-9)
    assert why == "Zeit [ms]"
    fast, slow = np.arange(1000), np.arange(100)
    rng = np.random.default_rng(3)
    shared = np.cumsum(rng.standard_normal(1000))
    a, b = tmp_path / "a.csv", tmp_path / "b.csv"
    pa.csv.write_csv(pa.table({"time [ms]": 5e6 + fast, "u": shared, "force": -shared}), a)
    pa.csv.write_csv(pa.table({"stamp [s]": 70 + 0.01 * slow, "seen": shared[::10]}), b)
    both = session.open(f"{a}+{b}")
    np.testing.assert_allclose(session.times(both, "force")[0], 1e-3 * fast, atol=1e-9)
    times, why = session.times(both, "seen")
    np.testing.assert_allclose(times, 0.01 * slow, atol=2e-3)
    assert why == "stamp [s]"
    runs, none = tmp_path / "runs.csv", tmp_path / "none.csv"
    pa.csv.write_csv(pa.table({"t": np.r_[0.01 * slow, 0.01 * slow], "u": np.arange(200.0)}), runs)
    pa.csv.write_csv(pa.table({"u": shared, "v": -shared}), none)
    for path, name, count in ((runs, "u", 200), (none, "v", 1000)):
        time, why = session.times(session.open(path), name)
        np.testing.assert_array_equal(time, np.arange(count))
        assert not why
    assert "read_log(name)" in session.script()


def test_few_points_draw_what_all_samples_draw():
    rng = np.random.default_rng(2)
    time = np.arange(100_000) * 0.01
    values = np.sin(time) + 0.1 * rng.standard_normal(len(time))
    values[54_321], values[70_000] = 9.0, np.nan
    points = buckets(time, values, 100.0, 900.0, 500)
    assert points.shape == (2, 1000)
    inside = values[9_999:90_002]
    assert np.nanmax(points[1]) == 9.0
    assert np.nanmin(points[1]) == np.nanmin(inside)
    assert np.all(np.diff(points[0]) >= 0)
    few = buckets(time, values, 543.0, 544.0, 500)
    np.testing.assert_array_equal(few[1], values[54_299:54_402])


def test_a_stopped_diagnosis_ends_at_its_next_step():
    job = Job()
    job.report("fitting", 0.2)
    job.stop.set()
    with pytest.raises(CancelledError):
        job.report("fitting", 0.3)


def _until(browser, condition, seconds: float = 240.0):
    return WebDriverWait(browser, seconds, 0.2).until(condition)


def press(browser, *keys: str) -> None:
    """Press keys, wherever the page's focus is."""
    ActionChains(browser).send_keys(*keys).perform()


def tab_to(browser, selector: str):
    """Go to an element by the tabulator alone, as one without a mouse does; it must be seen to have focus."""
    for _ in range(80):
        press(browser, Keys.TAB)
        here = browser.switch_to.active_element
        if browser.execute_script("return arguments[0].matches(arguments[1])", here, selector):
            ring = "return getComputedStyle(arguments[0]).outlineStyle !== 'none'"
            assert browser.execute_script(ring, here), f"{selector} does not show that it has the focus"
            return here
    raise AssertionError(f"the tabulator does not reach {selector}")


def sideways(browser) -> int:
    """Pixels by which a page is wider than its window."""
    return browser.execute_script("return document.documentElement.scrollWidth - window.innerWidth")


def test_the_page_and_its_curves_follow_the_scheme_of_the_system(served: Served, browser, tmp_path: Path):
    served.session.open(write_log(tmp_path / "log.csv", seconds=2.0))
    drawn = lambda b: b.find_element(By.TAG_NAME, "body").get_attribute("data-drawn")  # noqa: E731
    browser.get(f"{served.address}/?token={TOKEN}")
    _until(browser, drawn)
    grounds, curves = {}, {}
    try:
        for scheme in ("light", "dark"):
            before = drawn(browser)
            features = [{"name": "prefers-color-scheme", "value": scheme}]
            browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
            _until(browser, lambda b, old=before, new=scheme: new == "light" or drawn(b) != old)
            ground = browser.execute_script("return getComputedStyle(document.body).backgroundColor")
            grounds[scheme] = max(map(int, re.findall(r"\d+", ground)))
            # The most frequent opaque blue of the first signal: that of its curve.
            curves[scheme] = browser.execute_script(
                "const c = document.querySelector('#signals canvas'), n = {};"
                "const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;"
                "for (let i = 0; i < d.length; i += 4) if (d[i + 3] === 255 && d[i + 2] > d[i] + 60) {"
                "  const k = [d[i], d[i + 1], d[i + 2]]; n[k] = (n[k] || 0) + 1; }"
                "return Object.keys(n).sort((a, b) => n[b] - n[a])[0].split(',').map(Number)"
            )
    finally:
        features = [{"name": "prefers-color-scheme", "value": ""}]
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
    assert grounds["light"] > 200 > 80 > grounds["dark"]
    assert sum(curves["dark"]) > sum(curves["light"]) + 150


def test_from_a_log_to_an_export_by_keyboard_on_a_phone(served: Served, browser, tmp_path: Path):
    """Nothing but keys; the answer, a slider, the export; and the script that is shown does the same."""
    log = write_log(tmp_path / "bench.csv")
    browser.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": 390, "height": 844, "deviceScaleFactor": 1, "mobile": False},
    )
    try:
        browser.get(f"{served.address}/?token={TOKEN}")
        assert "token" not in browser.current_url
        find = lambda name: browser.find_element(By.ID, name)  # noqa: E731
        tab_to(browser, "#path")
        press(browser, str(log), Keys.ENTER)
        _until(browser, lambda b: b.find_element(By.TAG_NAME, "body").get_attribute("data-drawn"))
        assert len(browser.find_elements(By.CSS_SELECTOR, "#signals canvas")) == 3
        assert find("logs").text == "bench.csv: 2500 rows of 3 signals, 24.99 s by Zeit [ms]"
        assert find("against").text == "Each log over seconds from its start."
        tab_to(browser, "[data-zoom=in]")
        press(browser, Keys.ENTER)
        tab_to(browser, "#model")
        press(browser, "pend")
        tab_to(browser, "#rate")
        press(browser, Keys.ENTER)
        _until(browser, lambda _b: find("columns").is_displayed())
        assert find("column-angle").get_attribute("value") == "Winkel [deg]:deg"
        assert find("column-t").get_attribute("value") == "Zeit [ms]:ms"
        # The sign is proposed from the data; what is typed counts.
        assert find("column-torque").get_attribute("value") == "-Moment [N m]:N m"
        tab_to(browser, "#column-torque")
        press(browser, Keys.HOME, Keys.DELETE, "-1*")
        tab_to(browser, "#diagnose")
        press(browser, Keys.SPACE)
        _until(browser, lambda _b: find("try").is_displayed() or find("trouble").text)
        assert not find("trouble").text
        assert "lacks Coulomb friction" in find("answer").text
        assert "bench.csv: a free run" in find("answer").text
        why = browser.find_element(By.CSS_SELECTOR, "#columns tbody td:last-child")
        assert why.rect["x"] + why.rect["width"] <= 390  # the evidence is in sight
        tab_to(browser, "[name='coulomb_friction.torque']")
        before = browser.find_element(By.CSS_SELECTOR, "#runs h3").text
        press(browser, *3 * [Keys.ARROW_LEFT])
        _until(browser, lambda b: b.find_element(By.CSS_SELECTOR, "#runs h3").text != before)
        assert "fit" in browser.find_element(By.CSS_SELECTOR, "#runs h3").text
        tab_to(browser, "#files a")
        assert sideways(browser) <= 0
        browser.execute_script("document.querySelector('#signals').style.minWidth = '500px'")
        assert sideways(browser) > 0  # what is too wide would be noticed
        log_of_page = [entry for entry in browser.get_log("browser") if served.address in entry["message"]]
        errors = [entry for entry in log_of_page if entry["level"] == "SEVERE"]
        assert not errors
    finally:
        browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    status, model = served.ask("/file/model.py")
    assert status == 200
    assert "def simulate(" in model
    assert served.ask("/file/figures/answer.png")[0] == 200
    script = json.loads(served.ask("/api/script")[1])["script"]
    own = json.loads((tmp_path / "results" / "diagnosis.json").read_text())
    scope: dict[str, object] = {}
    exec(script.replace(str(tmp_path / "results"), str(tmp_path / "again")), scope)
    again = json.loads((tmp_path / "again" / "diagnosis.json").read_text())
    assert again["causes"] == own["causes"]
    assert own["causes"][0]["parameters"]["torque"]["value"] == pytest.approx(0.2, rel=0.1)


def test_an_answer_does_not_wait_for_an_acknowledgement(served: Served):
    """On a kept connection the second of two packets would wait 40 ms for the browser's delayed one."""
    connection = http.client.HTTPConnection("127.0.0.1", served.port)
    waits = []
    for _ in range(30):
        began = time.perf_counter()
        connection.request("GET", "/api/state", headers={"Cookie": f"fieldgym-{served.port}={TOKEN}"})
        answer = connection.getresponse()
        assert answer.status == 200
        answer.read()
        waits.append(time.perf_counter() - began)
    connection.close()
    assert np.quantile(waits, 0.25) < 0.03


def test_a_port_that_is_taken_is_said(served: Served):
    with pytest.raises(RecordingError, match=f"port {served.port}.*name another one"):
        listening(served.port)


def write_large_log(path: Path) -> None:
    """A quarter of an hour of the pendulum at 1 kHz beside 17 channels that have nothing to do with it."""
    rng, hidden = np.random.default_rng(0), {"coulomb_friction": {"torque": 0.2}}
    r = synthesise(
        get_model("pendulum"), hidden, "mixed", duration=900.0, step=1e-3, amplitude=1.5, refine=2, rng=rng
    )
    columns = {"t": np.round(r.time, 3), **{name: r[name] for name in ("torque", "angle", "velocity")}}
    columns |= {f"x{k}": rng.standard_normal(len(r)).astype(np.float32) for k in range(17)}
    pa.csv.write_csv(pa.table(columns), path)


@pytest.mark.nightly
def test_a_large_log_is_dropped_seen_and_diagnosed(served: Served, browser, tmp_path: Path):
    """200 MB of text, dropped on the page: its views are quick once it is read, and it leads to an answer."""
    path = tmp_path / "large.csv"
    write_large_log(path)
    assert path.stat().st_size > 190e6
    find = lambda name: browser.find_element(By.ID, name)  # noqa: E731
    drawn = lambda: browser.find_element(By.TAG_NAME, "body").get_attribute("data-drawn")  # noqa: E731
    browser.get(f"{served.address}/?token={TOKEN}")
    where, began = find("drop").rect, time.process_time()
    for kind in ("dragEnter", "dragOver", "drop"):
        data = {"items": [], "files": [str(path)], "dragOperationsMask": 1}
        at = {"x": where["x"] + 20, "y": where["y"] + 20}
        browser.execute_cdp_cmd("Input.dispatchDragEvent", {"type": kind, "data": data, **at})
    _until(browser, lambda _b: drawn() or find("trouble").text)
    opened = time.process_time() - began  # the page's server is a thread of this process
    assert find("logs").text == "large.csv: 900000 rows of 20 signals, 900.0 s by t"
    assert len(browser.find_elements(By.CSS_SELECTOR, "#signals canvas")) == 20
    began, before = time.process_time(), drawn()
    browser.find_element(By.CSS_SELECTOR, "[data-zoom=in]").click()
    _until(browser, lambda _b: drawn() != before)
    zoomed = time.process_time() - began
    assert zoomed < 0.2 * opened
    browser.find_element(By.CSS_SELECTOR, "#model option[value=pendulum]").click()
    browser.find_element(By.CSS_SELECTOR, "#choose button").click()
    _until(browser, lambda _b: find("columns").is_displayed() or find("trouble").text)
    assert find("column-angle").get_attribute("value") == "angle:rad"
    find("diagnose").click()
    _until(browser, lambda _b: find("try").is_displayed() or find("trouble").text, 900.0)
    assert "lacks Coulomb friction" in find("answer").text
