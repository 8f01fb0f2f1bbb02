"""What fieldgym is built on is written down: hashes, bill of materials, licences, checksums of policies."""

import json
import re
from pathlib import Path

import pytest

from fieldagents.policies.zoo import ZooError, list_zoo

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def pins():
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    return {plain(line.split("==")[0]): line.split("==")[1] for line in lines if re.match(r"[\w.-]+==", line)}


def plain(name):
    return re.sub(r"[-_.]+", "-", name).lower()


def test_locked_versions_are_the_pinned_ones_each_with_a_hash(pins):
    lines = (ROOT / "requirements.lock").read_text().splitlines()[1:]
    locked = dict(re.fullmatch(r"(\S+)==(\S+) --hash=sha256:[0-9a-f]{64}", line).groups() for line in lines)
    assert len(locked) > 0.9 * len(pins)
    for name, version in locked.items():
        assert pins.get(plain(name), version) == version.partition("+")[0], name  # torch's "+cpu"


def test_the_bill_of_materials_is_of_the_pins(pins):
    bill = json.loads((ROOT / "sbom.cdx.json").read_text())
    assert (bill["bomFormat"], bill["specVersion"]) == ("CycloneDX", "1.6")
    found = {plain(one["name"]): one for one in bill["components"]}
    assert {"numpy", "pygame", "torch"} <= set(found)
    for name, one in found.items():
        assert pins.get(name, one["version"]) == one["version"].partition("+")[0]
        assert one["purl"] == f"pkg:pypi/{name}@{one['version']}"


def test_the_licence_page_names_what_is_copyleft():
    page = (ROOT / "docs" / "licences.md").read_text()
    shared = next(line for line in page.splitlines() if line.startswith("Weak copyleft"))
    assert "pygame" in shared
    assert "LGPL" in shared


def test_a_policy_that_was_changed_is_refused(tmp_path):
    import shutil

    training = list_zoo()[0].trainings[0]
    folder = tmp_path / training.task / training.name / training.folder.name
    shutil.copytree(training.folder, folder)
    name = training.card["runs"][0]["policy"]
    (folder / name).write_bytes((folder / name).read_bytes() + b" ")
    ((entry,),) = [list_zoo(folder=tmp_path)]
    with pytest.raises(ZooError, match="checksum"):
        entry.agents()
