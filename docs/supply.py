"""What fieldgym is built on: a bill of materials, and everybody's licence (pins with hashes: ``make lock``).

``python docs/supply.py`` reads ``constraints.txt`` and the metadata of what is installed, and writes
``sbom.cdx.json`` (CycloneDX 1.6, which the wheel carries) and ``docs/licences.md``.
"""

import json
import re
from collections import Counter
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement
from wheels import plain

ROOT = Path(__file__).parents[1]
SBOM, PAGE = ROOT / "sbom.cdx.json", ROOT / "docs" / "licences.md"
COPYLEFT = re.compile(r"\bA?L?GPL|Lesser General|Mozilla|MPL", re.IGNORECASE)


def pins() -> dict[str, str]:
    """Name to version of everything in ``constraints.txt``."""
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    every = (Requirement(line) for line in lines if line and not line.startswith("#"))
    return {one.name: str(one.specifier).removeprefix("==") for one in every}


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


KINDS = {
    "Apache": "Apache", "BSD": "BSD", "MIT": "MIT", "PSF|Python": "Python", "MPL": "MPL", "GPL": "LGPL",
}  # fmt: skip
"""What a licence's text holds, to its kind; the first that fits."""


def page(found: dict[str, tuple[str, str]]) -> str:
    """The page of licences."""
    kinds = Counter(
        next((kind for mark, kind in KINDS.items() if re.search(mark, terms)), "other")
        for _, terms in found.values()
    )
    shared = [f"{name} ({terms})" for name, (_, terms) in found.items() if COPYLEFT.search(terms)]
    return "\n".join([
        "# Licences",
        "",
        "![Packages by kind of licence: most are MIT, BSD or Apache](pictures/licences.svg)",
        "",
        "fieldgym is under the MIT licence and ships no code of others. Every package that it runs with,",
        "its version and its licence are in `sbom.cdx.json` (CycloneDX), taken from the packages' metadata",
        "by `python docs/supply.py`.",
        "",
        "| licence | packages |",
        "|---|---|",
        *(f"| {kind} | {count} |" for kind, count in kinds.most_common()),
        "",
        f"Weak copyleft, each used as a library of its own that can be replaced: {'; '.join(shared)}.",
        "",
        "npTDMS, python-can and pymavlink come with extras alone (`labview`, `can`, `ardupilot`).",
        "pymavlink states LGPL 3 as a package, but GPL 3 or later in the file that reads DataFlash logs.",
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


if __name__ == "__main__":
    known = licences()
    SBOM.write_text(sbom(known))
    PAGE.write_text(page(known))
