"""What fieldgym is built on is written down: hashes, bill of materials, licences, checksums of policies."""

import json
import os
import re
import shutil
import subprocess
import sys
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread

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
    training = list_zoo()[0].trainings[0]
    folder = tmp_path / training.task / training.name / training.folder.name
    shutil.copytree(training.folder, folder)
    name = training.card["runs"][0]["policy"]
    (folder / name).write_bytes((folder / name).read_bytes() + b" ")
    ((entry,),) = [list_zoo(folder=tmp_path)]
    with pytest.raises(ZooError, match="checksum"):
        entry.agents()


class WeaknessServer(BaseHTTPRequestHandler):
    """Answers as osv.dev does; made up: `weak` are the packages that it knows something against."""

    asked, weak = {}, ()

    def do_POST(self):
        query = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        name = query["package"]["name"]
        self.asked[plain(name)] = query["version"]
        found = {"id": "MADE-UP-1", "summary": "made up", "details": "", "affected": [], "aliases": []}
        answer = json.dumps({"vulns": [found]} if plain(name) in self.weak else {}).encode()
        self.send_response(200)
        self.send_header("Content-Length", str(len(answer)))
        self.end_headers()
        self.wfile.write(answer)

    def log_message(self, *_):
        pass


@pytest.mark.slow  # installs pip-audit, in an environment of its own
def test_the_audit_asks_for_every_pin_and_fails_where_something_is_known(tmp_path, pins, monkeypatch):
    subprocess.run([sys.executable, "-m", "venv", tmp_path], check=True)
    server = ThreadingHTTPServer(("127.0.0.1", 0), WeaknessServer)
    Thread(target=server.serve_forever, daemon=True).start()
    where = {
        "PIP_AUDIT_VULNERABILITY_SERVICE": "osv",
        "PIP_AUDIT_OSV_URL": f"http://127.0.0.1:{server.server_port}/v1/query",
    }

    def audit():
        command = ["make", "audit", "--old-file=.venv/.ready", f"BIN={tmp_path / 'bin'}"]
        environment = {**os.environ, **where}
        return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)

    try:
        done = audit()
        assert done.returncode == 0, done.stderr
        asked = dict(WeaknessServer.asked)
        assert len(asked) > 0.9 * len(pins)
        assert asked == {name: pins[name].partition(";")[0].strip() for name in asked}
        monkeypatch.setattr(WeaknessServer, "weak", ("torch",))
        done = audit()
        assert done.returncode != 0
        assert re.search(r"torch\s+2\S+\s+MADE-UP-1", done.stdout)
    finally:
        server.shutdown()
