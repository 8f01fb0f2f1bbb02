"""The listed errors can still be put in, their tests exist, and the runner tells how a test ends."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

import run
from page import PAGE, page
from table import ROOT, Mutant, MutantError, read_mutants

MUTANTS = read_mutants()


def test_every_error_can_be_put_in_and_names_its_tests():
    problems = []
    for mutant in MUTANTS:
        for check in (mutant.applied, mutant.check_tests):
            try:
                check(ROOT)
            except MutantError as error:
                problems.append(str(error))
    assert not problems, "\n".join(problems)


def test_the_list_is_long_and_without_repetition():
    assert len(MUTANTS) >= 100
    assert len({mutant.key for mutant in MUTANTS}) == len(MUTANTS)
    assert len({(mutant.file, mutant.old, mutant.new) for mutant in MUTANTS}) == len(MUTANTS)
    assert not any(
        "golden" in test for mutant in MUTANTS for test in mutant.tests
    )  # stored outputs prove nothing


def test_the_page_lists_every_error():
    published = (ROOT / PAGE).read_text()
    missing = [m.error for m in MUTANTS if f"| {m.error} | `{m.file.split('/', 1)[1]}` |" not in published]
    assert not missing, f"make mutants; {PAGE} lacks {missing}"
    assert f"{len(MUTANTS)} of {len(MUTANTS)} are killed" in published


def test_a_text_that_is_gone_or_stands_twice_disarms_no_mutant(tmp_path):
    (tmp_path / "a.py").write_text("x = 1\ny = 1\n")
    mutant = Mutant("area", "a.py", "x = 1", "x = 2", "wrong", ("a.py",))
    assert mutant.applied(tmp_path) == "x = 2\ny = 1\n"
    for old in ("z = 1", "= 1"):
        with pytest.raises(MutantError, match=r"wrong: .* times"):
            Mutant("area", "a.py", old, "= 3", "wrong", ("a.py",)).applied(tmp_path)
    with pytest.raises(MutantError, match="does not exist"):
        Mutant("area", "b.py", "x", "y", "wrong", ("a.py",)).applied(tmp_path)
    for test in ("b.py", "a.py::test_gone"):
        with pytest.raises(MutantError, match="no test"):
            Mutant("area", "a.py", "x = 1", "x = 2", "wrong", (test,)).check_tests(tmp_path)


PROJECT = {
    "src/fieldmodels/__init__.py": "",
    "src/fieldmodels/double.py": "def double(x):\n    return 2 * x\n\ndef unused():\n    return 1\n",
    "envs/fieldgym/__init__.py": "",
    "agents/fieldagents/__init__.py": "",
    "tests/test_double.py": (
        "from fieldmodels.double import double\n\n"
        "def test_named():\n    assert double('a') == 'aa'\n\n"
        "def test_number():\n    assert double(3) == 6\n"
    ),
}
TEST = "tests/test_double.py"


@pytest.fixture
def worker(tmp_path, monkeypatch):
    """A worker on a project of one function."""
    for name, text in PROJECT.items():
        path = tmp_path / "project" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    monkeypatch.setattr(run, "ROOT", tmp_path / "project")
    monkeypatch.setattr(run, "WORK", tmp_path / "work")
    (tmp_path / "warm").mkdir()
    return run.Worker(0)


@pytest.mark.matrix(keep=("equal",))
@pytest.mark.parametrize(
    ("old", "new", "status", "test"),
    [
        ("2 * x", "3 * x", "killed", f"{TEST}::test_named"),
        ("2 * x", "x + x if x == 3 else 2 * x", "survived", ""),
        ("return 1", "return 0", "survived", ""),
        ("2 * x", "2 * y", "broken", f"{TEST}::test_named"),
        ("2 * x", "2 *", "broken", ""),
        (
            "2 * x",
            "x * 1.5",
            "killed",
            f"{TEST}::test_number",
        ),  # the first test falls over, the second says no
    ],
    ids=["killed", "equal", "unused", "falls over", "no import", "says no after one that fell over"],
)
def test_how_an_error_ends(worker, tmp_path, old, new, status, test):
    mutant = Mutant("area", "src/fieldmodels/double.py", old, new, "wrong", (TEST,))
    before = (worker.root / mutant.file).read_text()
    result = worker.judge(mutant, tmp_path / "warm")
    assert (result.status, result.test) == (status, test)
    assert (worker.root / mutant.file).read_text() == before


@pytest.mark.nightly
def test_tests_that_fail_or_are_skipped_without_an_error_are_told(worker, tmp_path):
    assert run.without_error([worker], [TEST], tmp_path / "warm") == {}
    (worker.root / TEST).write_text(
        "import pytest\n\ndef test_idle():\n    pytest.skip()\n\ndef test_wrong():\n    assert 1 == 2\n"
    )
    useless = run.without_error([worker], [TEST], tmp_path / "warm")
    assert sorted(useless) == [f"{TEST}::test_idle", f"{TEST}::test_wrong"]
    (worker.root / TEST).write_text("def test_idle(:\n")
    with pytest.raises(SystemExit, match="read"):
        run.without_error([worker], [TEST], tmp_path / "warm")


def test_a_page_wants_every_result():
    mutant = MUTANTS[0]
    with pytest.raises(SystemExit, match="without results"):
        page([mutant], {})
    text = page([mutant], {mutant.key: run.Result("killed", "tests/a.py::test_b", "no", 60.0)})
    assert "**1 of 1 are killed.**" in text
    assert "`test_b` |" in text
