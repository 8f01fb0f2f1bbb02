"""The code that a result can reach, by what modules say that they import."""

import sys

from fieldmodels.code import files_reached


def test_a_module_that_cannot_be_imported_is_reached_too(tmp_path, monkeypatch):
    """It may stand on an extra that is not installed."""
    package = tmp_path / "reached_lab"
    (package / "inside").mkdir(parents=True)
    texts = {
        "__init__.py": "",
        "begin.py": "from reached_lab.lacks import Filter\nimport reached_lab.inside.deep\n",
        "lacks.py": "raise ImportError('an extra')\nclass Filter: pass\n",
        "inside/__init__.py": "",
        "inside/deep.py": "from reached_lab import VALUE\n",
        "beside.py": "",
    }
    for name, text in texts.items():
        (package / name).write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    found = {path.relative_to(package).as_posix() for path in files_reached(["reached_lab.begin"])}
    assert found == {"__init__.py", "begin.py", "lacks.py", "inside/deep.py"}
    assert not [name for name in sys.modules if name.startswith("reached_lab.")]
