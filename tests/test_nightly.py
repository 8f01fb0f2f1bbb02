"""The night repeats a part exactly if something that it read has changed, or if it did not pass."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

PROJECT = {
    "pyproject.toml": "",
    "constraints.txt": "",
    "src/one.py": "VALUE = 1\n",
    "docs/page.md": "a page\n",
    "tests/conftest.py": "import sys\nfrom pathlib import Path\n\n"
    "sys.path.insert(0, str(Path(__file__).parents[1] / 'src'))\n",
    "tests/test_imports_one.py": "from one import VALUE\n\ndef test_it():\n    assert VALUE == 1\n",
    "tests/test_reads_page.py": "from pathlib import Path\n\ndef test_it():\n"
    "    assert (Path(__file__).parents[1] / 'docs' / 'page.md').read_text()\n",
    "tests/test_starts_another.py": "import subprocess, sys\n\ndef test_it():\n"
    "    subprocess.run([sys.executable, '-c', ''], check=True)\n",
}
IMPORTS, READS, STARTS = (f"tests/test_{name}.py" for name in ("imports_one", "reads_page", "starts_another"))


@pytest.fixture
def night(tmp_path):
    """Runs the night of a small project; gives the parts that were run and passed."""
    for name, text in PROJECT.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    shutil.copy(Path(__file__).with_name("nightly.py"), tmp_path / "tests")
    for words in (
        ["init", "-q"],
        ["add", "."],
        ["-c", "user.name=a", "-c", "user.email=b", "commit", "-qm", "c"],
    ):
        subprocess.run(["git", *words], cwd=tmp_path, check=True)

    def run() -> dict[str, bool]:
        command = [sys.executable, "tests/nightly.py", "--only", "test_", "--workers", "1"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        lines = [line.split() for line in done.stdout.splitlines() if "/" in line.split()[0]]
        ended = {words[2]: words[1] == "passed" for words in lines}
        assert done.returncode == (0 if all(ended.values()) else 1), done.stderr
        return ended

    return run


def test_a_part_is_repeated_if_what_it_read_has_changed(night, tmp_path):
    assert night() == {IMPORTS: True, READS: True, STARTS: True}
    assert night() == {}
    (tmp_path / "docs" / "page.md").write_text("another page\n")
    assert night() == {READS: True, STARTS: True}  # who starts another program may read anything
    (tmp_path / "src" / "one.py").write_text("VALUE = 2\n")
    assert night() == {IMPORTS: False, STARTS: True}
    assert night() == {IMPORTS: False}
