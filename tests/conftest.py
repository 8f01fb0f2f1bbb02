"""What all tests share: the real data, and a real browser."""

import os
import shutil
from collections import ChainMap
from collections.abc import Iterator
from itertools import product
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


def cases_of(item: pytest.Item | pytest.Function) -> list[dict[str, Any]]:
    """Arguments of every case of a test that is marked ``every``, as ``parametrize`` would give them."""
    given = []
    for mark in item.iter_markers("every"):
        names, rows = mark.args
        names = names.split(", ") if isinstance(names, str) else names
        given.append([dict(zip(names, row if len(names) > 1 else [row], strict=True)) for row in rows])
    return [dict(ChainMap(*case)) for case in product(*given)] if given else []


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Keep a place for what ``every`` gives."""
    names = {name for case in cases_of(metafunc.definition)[:1] for name in case}
    if names:
        metafunc.parametrize(sorted(names), [[None] * len(names)], ids=["every"])


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Check all cases of ``every`` in one test, with the same draws; failures are reported together."""
    cases, errors = cases_of(pyfuncitem), []
    names = pyfuncitem._fixtureinfo.argnames
    draws = [one.bit_generator for one in pyfuncitem.funcargs.values() if hasattr(one, "bit_generator")]
    begun = [one.state for one in draws]
    for number, case in enumerate(cases):
        given = {name: case.get(name, pyfuncitem.funcargs[name]) for name in names}
        for one, state in zip(draws, begun, strict=True):
            one.state = state
        if "tmp_path" in given:
            given["tmp_path"] /= str(number)
            given["tmp_path"].mkdir()
        try:
            pyfuncitem.obj(**given)
        except (Exception, pytest.fail.Exception) as error:
            error.add_note(f"in the case {case}")
            errors.append(error)
        if "monkeypatch" in given:
            given["monkeypatch"].undo()
        if errors and pyfuncitem.config.getoption("maxfail"):
            break
    if errors:
        raise BaseExceptionGroup(f"{len(errors)} of {len(cases)} cases", errors)
    return True if cases else None


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
