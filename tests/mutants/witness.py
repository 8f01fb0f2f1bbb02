"""A pytest plugin that writes down how each test ended: by an assertion, or by the program breaking."""

import json
import os
from pathlib import Path

import pytest

REPORT = Path(os.environ["MUTANT_REPORT"])
TREE = Path(os.environ["MUTANT_TREE"])


def pytest_sessionstart() -> None:
    """Refuse to test another tree than the one that holds the error."""
    import fieldagents
    import fieldgym
    import fieldmodels

    for package in (fieldmodels, fieldgym, fieldagents):
        if TREE not in Path(package.__file__ or "").parents:
            pytest.exit(f"{package.__name__} comes from {package.__file__}, not from {TREE}", returncode=70)


def asserted(error: BaseException) -> bool:
    """Whether a test said no, rather than the program falling over."""
    if isinstance(error, BaseExceptionGroup):
        return all(asserted(one) for one in error.exceptions)
    return isinstance(error, AssertionError | pytest.fail.Exception)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    """Append one line for each test that ran."""
    report = yield
    if report.outcome != "passed" or report.when == "call":
        error = call.excinfo.value if call.excinfo else None
        line = {
            "test": item.nodeid,
            "outcome": "expected" if hasattr(report, "wasxfail") else report.outcome,
            "asserted": error is not None and asserted(error),
            "error": "" if error is None else f"{type(error).__name__}: {error}".splitlines()[0][:200],
            "seconds": round(report.duration, 2),
        }
        with REPORT.open("a") as stream:
            stream.write(json.dumps(line) + "\n")
    return report
