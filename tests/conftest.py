"""What all tests share: the real data, and a real browser."""

import os
import shutil
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest

os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
os.environ.setdefault("SDL_AUDIODRIVER", "dummy")
os.environ.setdefault("MPLBACKEND", "Agg")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave all cases of a matrix but those that it keeps to the night."""
    kept: set[tuple[str, str]] = set()
    for item in items:
        for mark in item.iter_markers("matrix"):
            name, case = item.nodeid.partition("[")[0], item.callspec.id  # type: ignore[attr-defined]
            kept |= {(name, one) for one in mark.kwargs["keep"]}
            if case not in mark.kwargs["keep"]:
                item.add_marker("nightly")
    gone = kept - {(item.nodeid.partition("[")[0], item.nodeid.partition("[")[2][:-1]) for item in items}
    if gone and config.args == config.getini("testpaths"):  # of a selection others may be missing
        raise pytest.UsageError(f"matrix(keep=...) names cases that are not there: {sorted(gone)}")


@pytest.fixture(scope="session")
def for_every() -> Callable[[Iterable[Any], Callable[[Any], object]], None]:
    """Check one fact on many cases in one test; all cases that fail are reported together."""

    def run(cases: Iterable[Any], check: Callable[[Any], object]) -> None:
        failures = []
        for case in cases:
            try:
                check(case)
            except (AssertionError, pytest.fail.Exception) as error:
                failures.append(f"{case}: {error}")
        assert not failures, "\n".join(failures)

    return run


@pytest.fixture(scope="session")
def public_data() -> Path:
    """The folder with the public recordings; skips where there is none."""
    folder = Path(os.environ.get("FIELDGYM_DATA") or "missing")
    if not folder.is_dir():
        pytest.skip("no real data: set FIELDGYM_DATA to the folder that holds dfki_simple_pendulum/ ...")
    return folder


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[object]:
    """A headless Chromium, driven by Selenium; skips where none is installed."""
    chromium, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if not chromium or not driver:
        pytest.skip("no browser: install Debian's chromium and chromium-driver")
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    for flag in (
        "--headless=new",
        "--no-sandbox",
        "--disable-gpu",
        "--disable-quic",
        "--no-first-run",
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-sync",
        "--window-size=1280,1600",
        f"--user-data-dir={tmp_path_factory.mktemp('chromium')}",
    ):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    session = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    yield session
    session.quit()


@pytest.fixture
def open_page(browser):
    """Open a local HTML file; fails on a console error or on a request that leaves the machine."""

    def open_(path: Path):
        browser.get_log("browser")
        browser.get(path.resolve().as_uri())
        errors = [entry["message"] for entry in browser.get_log("browser") if entry["level"] == "SEVERE"]
        assert not errors, f"{path}: {errors}"
        outside = browser.execute_script(
            "return performance.getEntriesByType('resource').map(e => e.name)"
            ".filter(n => !n.startsWith('file:') && !n.startsWith('data:') && !n.startsWith('blob:'))"
        )
        assert not outside, f"{path} loads {outside}"
        return browser

    return open_
