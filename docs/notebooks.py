"""Runs the notebooks of the docs: ``python docs/notebooks.py`` keeps what they show.

Each runs in an empty folder of its own, as a reader's would. Its pictures are also those of other pages:
``pictures/<notebook>-<number>.png``.
"""

import base64
import sys
import tempfile
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient

FOLDER = Path(__file__).with_name("notebooks")
PICTURES = Path(__file__).with_name("pictures")
PATHS = tuple(sorted(FOLDER.glob("*.ipynb")))


def executed(path: Path, folder: Path) -> Any:
    """A notebook with what its cells show when it runs in a folder.

    Raises:
        CellExecutionError: If a cell fails.
    """
    notebook = nbformat.read(path, as_version=4)
    place = {"metadata": {"path": str(folder)}}
    return NotebookClient(notebook, timeout=600, resources=place, record_timing=False).execute()


def shown(notebook: Any) -> str:
    """All text that a notebook's cells have shown."""
    outputs = [one for cell in notebook.cells for one in cell.get("outputs", ())]
    texts = [one.get("text") or one.get("data", {}).get("text/plain", "") for one in outputs]
    return "\n".join(texts)


def save_pictures(path: Path, notebook: Any) -> None:
    """Save what a notebook has drawn, for other pages."""
    outputs = [one for cell in notebook.cells for one in cell.get("outputs", ())]
    drawn = [one["data"]["image/png"] for one in outputs if "image/png" in one.get("data", {})]
    PICTURES.mkdir(exist_ok=True)
    for number, image in enumerate(drawn, 1):
        (PICTURES / f"{path.stem}-{number}.png").write_bytes(base64.b64decode(image))


def main() -> None:
    """Run those that are named, or all."""
    for path in PATHS:
        if len(sys.argv) > 1 and path.stem not in sys.argv[1:]:
            continue
        with tempfile.TemporaryDirectory() as folder:
            notebook = executed(path, Path(folder))
        notebook.metadata.pop("language_info", None)
        for cell in notebook.cells:
            cell.get("outputs", [])[:] = [o for o in cell.get("outputs", ()) if o.get("name") != "stderr"]
        nbformat.write(notebook, path)
        save_pictures(path, notebook)
        print(f"{path.name}: {path.stat().st_size // 1000} kB")


if __name__ == "__main__":
    main()
