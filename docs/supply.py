"""What fieldgym is built on: pins with hashes, a bill of materials, and everybody's licence.

``python docs/supply.py`` reads ``constraints.txt`` and the metadata of what is installed, asks the package
index for hashes by ``pip install --dry-run --report``, and writes ``requirements.lock``, ``sbom.cdx.json``
(CycloneDX 1.6, which the wheel carries) and ``docs/licences.md``. ``--offline`` keeps the lock file.
"""

import json
import re
import subprocess
import sys
import tempfile
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

ROOT = Path(__file__).parents[1]
LOCK, SBOM, PAGE = ROOT / "requirements.lock", ROOT / "sbom.cdx.json", ROOT / "docs" / "licences.md"
COPYLEFT = re.compile(r"\bA?L?GPL|Lesser General|Mozilla|MPL", re.IGNORECASE)


def plain(name: str) -> str:
    """A name as the index writes it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def pins() -> dict[str, str]:
    """Name to version of everything in ``constraints.txt``."""
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pinned = (line.partition(";")[0] for line in lines if "==" in line and not line.startswith("#"))
    return dict(line.split("==") for line in pinned)


def licence(found: Distribution) -> str:
    """A package's licence as its metadata say it, in one line."""
    data = found.metadata
    kinds = [c.split(" :: ")[-1] for c in data.get_all("Classifier") or [] if c.startswith("License ::")]
    text = data.get("License-Expression") or ", ".join(kinds) or data.get("License") or "not stated"
    return " ".join(text.split())[:80]


def licences() -> dict[str, tuple[str, str]]:
    """Name to version and licence of every pin that is installed."""
    result = {}
    for name, version in pins().items():
        try:
            found = distribution(name)
        except PackageNotFoundError:
            continue
        result[name] = version, licence(found)
    return result


def page(found: dict[str, tuple[str, str]]) -> str:
    """The page of licences."""
    rows = [f"| {name} | {one[0]} | {one[1].replace('|', '/')} |" for name, one in found.items()]
    shared = [f"{name} ({terms})" for name, (_, terms) in found.items() if COPYLEFT.search(terms)]
    return "\n".join([
        "# Licences",
        "",
        "![Packages by kind of licence: most are MIT, BSD or Apache](pictures/licences.svg)",
        "",
        "fieldgym is under the MIT licence and ships no code of others. What it runs with, from the",
        "packages' own metadata (`python docs/supply.py`):",
        "",
        f"Weak copyleft, each used as a library of its own that can be replaced: {'; '.join(shared)}.",
        "",
        "| package | version | licence |",
        "|---|---|---|",
        *rows,
        "",
    ])  # fmt: skip


def sbom(found: dict[str, tuple[str, str]]) -> str:
    """The bill of materials, CycloneDX 1.6."""
    components = [
        {
            "type": "library",
            "name": name,
            "version": version,
            "purl": f"pkg:pypi/{re.sub(r'[-_.]+', '-', name).lower()}@{version}",
            "licenses": [{"license": {"name": terms}}],
        }
        for name, (version, terms) in found.items()
    ]
    subject = {"type": "library", "name": "fieldgym", "licenses": [{"license": {"id": "MIT"}}]}
    bill = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {"component": subject},
        "components": components,
    }
    return json.dumps(bill, indent=1) + "\n"


def lock() -> str:
    """The pins with the hashes of what pip would install here, for ``pip install --require-hashes``.

    Raises:
        ValueError: If a pin needs a package that is not pinned, with which no installation by hashes ends.
    """
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        command = [sys.executable, "-m", "pip", "install", "--dry-run", "--ignore-installed"]
        more = ["--quiet", "--report", str(report), "-r", str(ROOT / "constraints.txt")]
        subprocess.run([*command, *more], check=True)
        return locked(json.loads(report.read_text()))


def locked(report: dict) -> str:
    """The lock file of pip's report."""
    lines = [
        "# Made by `python docs/supply.py`, for this platform: pip install --require-hashes -r <this file>"
    ]
    known = {plain(name) for name in pins()}
    found = {one["metadata"]["name"]: one["metadata"]["version"] for one in report["install"]}
    if missing := [f"{name}=={version}" for name, version in found.items() if plain(name) not in known]:
        raise ValueError(f"constraints.txt lacks {', '.join(missing)}")
    for one in sorted(report["install"], key=lambda one: one["metadata"]["name"].lower()):
        digest = one["download_info"]["archive_info"]["hashes"]["sha256"]
        lines.append(f"{one['metadata']['name']}=={one['metadata']['version']} --hash=sha256:{digest}")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    if "--offline" not in sys.argv:
        LOCK.write_text(lock())
    known = licences()
    SBOM.write_text(sbom(known))
    PAGE.write_text(page(known))
