"""What fieldgym is built on: pins with hashes, a bill of materials, and everybody's licence.

``python docs/supply.py`` reads ``constraints.txt`` and the metadata of what is installed, asks the package
index for the hashes of Python 3.11 to 3.14 by ``pip install --dry-run --report`` (from pip 24 on without
fetching them), and writes ``requirements.lock``, ``sbom.cdx.json`` (CycloneDX 1.6, which the wheel carries)
and ``docs/licences.md``. ``--offline`` keeps the lock file.
"""

import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Mapping
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement
from wheels import PLATFORMS, PYTHONS, plain

ROOT = Path(__file__).parents[1]
LOCK, SBOM, PAGE = ROOT / "requirements.lock", ROOT / "sbom.cdx.json", ROOT / "docs" / "licences.md"
COPYLEFT = re.compile(r"\bA?L?GPL|Lesser General|Mozilla|MPL", re.IGNORECASE)


def pins(python: str | None = None) -> dict[str, str]:
    """Name to version of everything in ``constraints.txt``, or of what a Python has of it."""
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    every = [Requirement(line) for line in lines if line and not line.startswith("#")]
    return {
        one.name: str(one.specifier).removeprefix("==")
        for one in every
        if python is None or one.marker is None or one.marker.evaluate({"python_version": python})
    }


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
            "purl": f"pkg:pypi/{plain(name)}@{version}",
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


def offered(python: str, pinned: list[str]) -> dict[str, str]:
    """Plain name to the hash of what pip would take for a Python on Linux: a wheel, or else the sources."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        command = [sys.executable, "-m", "pip", "install", "--dry-run", "--ignore-installed", "--no-deps"]
        command += ["--quiet", "--report", str(report), "--target", folder]
        command += ["--python-version", f"{python}.99"]  # "3.11" would be 3.11.0, too old for some
        for platform in PLATFORMS["Linux (x86-64)"]:
            command += ["--platform", platform]
        subprocess.run([*command, *pinned], check=True)
        found = json.loads(report.read_text())["install"]
    hashes = [one["download_info"]["archive_info"]["hashes"]["sha256"] for one in found]
    return {plain(one["metadata"]["name"]): digest for one, digest in zip(found, hashes, strict=True)}


def lock() -> str:
    """The pins with the hashes of what pip would install, on each Python."""
    hashes: dict[str, dict[str, None]] = {}
    for python in PYTHONS:
        pinned = [f"{name}=={version}" for name, version in pins(python).items()]
        for name, digest in offered(python, pinned).items():
            hashes.setdefault(name, {})[digest] = None
    return locked(hashes)


def locked(hashes: Mapping[str, Iterable[str]]) -> str:
    """The lock file of these hashes; raises ValueError where a pin has none."""
    lines = [
        "# Made by `python docs/supply.py`, for Linux (x86-64): pip install --require-hashes -r <this file>"
    ]
    for line in (ROOT / "constraints.txt").read_text().splitlines():
        if line and not line.startswith("#"):
            found = hashes.get(plain(Requirement(line).name))
            if not found:
                raise ValueError(f"no hash for {line}")
            given = (f"--hash=sha256:{one}" for one in sorted(found))
            lines.append(" ".join([line.replace(";", " ;"), *given]))
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    if "--offline" not in sys.argv:
        LOCK.write_text(lock())
    known = licences()
    SBOM.write_text(sbom(known))
    PAGE.write_text(page(known))
