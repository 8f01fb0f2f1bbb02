"""What fieldgym is built on is written down: hashes, bill of materials, licences, checksums of policies."""

import ast
import importlib
import importlib.util
import io
import json
import os
import re
import shutil
import subprocess
import sys
import time
import tomllib
import zipfile
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.metadata import distributions
from pathlib import Path
from threading import Thread

import numba
import pytest
from packaging.requirements import Requirement

from fieldagents.policies.zoo import ZooError, list_zoo

ROOT = Path(__file__).parents[2]
DECLARED = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


@pytest.fixture(scope="module")
def pins():
    lines = (ROOT / "constraints.txt").read_text().splitlines()[1:]
    return {plain(one.name): str(one.specifier)[2:] for one in map(Requirement, lines)}


def plain(name):
    return re.sub(r"[-_.]+", "-", name).lower()


def test_what_is_pinned_and_locked_has_one_version_and_hashes(pins):
    entries = re.split(r"\n(?=\S)", (ROOT / "requirements.lock").read_text().strip())
    entries = [entry for entry in entries if not entry.startswith("#")]
    locked = {plain(one.name): one for one in (Requirement(entry.partition(" \\")[0]) for entry in entries)}
    assert all(re.search(r"--hash=sha256:[0-9a-f]{64}", entry) for entry in entries)
    assert len(set(pins) - set(locked)) < 5  # build tools
    assert {name: str(one.specifier) for name, one in locked.items() if name in pins} == {
        name: f"=={pins[name]}" for name in locked if name in pins
    }
    assert locked["pygame"].marker.evaluate({"python_full_version": "3.13.1"})
    assert not locked["pygame"].marker.evaluate({"python_full_version": "3.14.0"})


PLATFORMS = [
    {"sys_platform": "linux", "platform_system": "Linux", "platform_machine": "x86_64", "extra": ""},
    {"sys_platform": "darwin", "platform_system": "Darwin", "platform_machine": "arm64", "extra": ""},
    {"sys_platform": "win32", "platform_system": "Windows", "platform_machine": "AMD64", "extra": ""},
]


def test_what_a_pin_needs_is_pinned(pins):
    """An installation by pins takes the same versions everywhere.

    What a package needs on one platform alone, or one build of it (torch's with CUDA), it pins itself, and so
    does ``requirements.lock``.
    """
    installed = {plain(one.metadata["Name"]): one for one in distributions()}
    asked = [
        Requirement(text) for name in pins if name in installed for text in installed[name].requires or []
    ]
    needed = {
        plain(one.name)
        for one in asked
        if one.marker is None or all(one.marker.evaluate(platform) for platform in PLATFORMS)
    }
    assert len(needed) > 50
    assert needed - set(pins) == set()


@pytest.mark.nightly  # installs uv, in an environment of its own; asks the package index
def test_the_lock_is_complete_on_every_python_and_platform(tmp_path):
    """No dependency lacks its hashes, and each has a file that fits."""
    subprocess.run([sys.executable, "-m", "venv", tmp_path], check=True)
    subprocess.run([tmp_path / "bin" / "pip", "install", "--quiet", "uv"], check=True)
    command = [
        tmp_path / "bin" / "uv",
        "pip",
        "install",
        "--dry-run",
        "--require-hashes",
        "--target",
        tmp_path / "t",
    ]
    command += ["--requirements", ROOT / "requirements.lock"]
    environment = {**os.environ, "MACOSX_DEPLOYMENT_TARGET": "14.0"}  # of onnxruntime's wheels
    for python in ("3.11.9", "3.12", "3.13", "3.14"):
        for platform in ("x86_64-manylinux_2_28", "aarch64-apple-darwin", "x86_64-pc-windows-msvc"):
            more = ["--python-version", python, "--python-platform", platform]
            done = subprocess.run(
                [*command, *more], env=environment, capture_output=True, text=True, check=False
            )
            assert done.returncode == 0, f"{python} {platform}: {done.stderr}"
            assert "numpy==" in done.stderr


class Index(BaseHTTPRequestHandler):
    """A package index with one build of torch; `answers` says how it behaves."""

    wheel, answers = ("", b""), True

    def do_GET(self):
        if not self.answers:
            time.sleep(600.0)  # longer than anybody waits
        name, content = self.wheel
        body = content if self.path.endswith(".whl") else f'<a href="/{name}">{name}</a>'.encode()
        self.send_response(200)
        self.send_header("Content-Type", "application/octet-stream" if body is content else "text/html")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_):
        pass


def index(version, **behaviour):
    """A running index whose torch has a version."""
    about = f"torch-{version}.dist-info"
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as wheel:
        wheel.writestr(f"{about}/METADATA", f"Metadata-Version: 2.1\nName: torch\nVersion: {version}\n")
        wheel.writestr(f"{about}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
        wheel.writestr(f"{about}/RECORD", "")
    wheel = (f"torch-{version}-py3-none-any.whl", content.getvalue())
    handler = type("One", (Index,), {"wheel": wheel, **behaviour})
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    Thread(target=server.serve_forever, daemon=True).start()
    return server


def test_torch_is_the_cpu_build_where_its_index_answers_and_pypi_s_where_not(tmp_path, pins):
    """By the real make and pip; the indices are ours."""
    pin = pins["torch"]
    pypi, cpu, hangs = index(pin), index(f"{pin}+cpu"), index(f"{pin}+cpu", answers=False)
    subprocess.run([sys.executable, "-m", "venv", tmp_path], check=True)

    def installed(port):
        address = "http://127.0.0.1:{}"
        command = ["make", tmp_path / ".torch", f"VENV={tmp_path}", f"TORCH_INDEX={address.format(port)}"]
        kept = {name: os.environ[name] for name in ("PATH", "LANG") if name in os.environ}
        pip = {"PIP_INDEX_URL": address.format(pypi.server_port), "PIP_CONFIG_FILE": os.devnull}
        environment = {**kept, "HOME": str(tmp_path), **pip}
        done = subprocess.run(  # it ends, though one index never answers
            command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False, timeout=120
        )
        assert done.returncode == 0, done.stderr
        (found,) = (tmp_path / "lib").glob("python*/site-packages/torch-*.dist-info")
        shutil.rmtree(found)
        (tmp_path / ".torch").unlink()
        return found.name.removesuffix(".dist-info"), done.stdout

    try:
        version, said = installed(cpu.server_port)
        assert version == f"torch-{pin}+cpu"
        assert "the CPU build of http" in said
        for port in (hangs.server_port, 9):  # nobody listens at the port "discard"
            version, said = installed(port)
            assert version == f"torch-{pin}"
            assert "as pip finds it, since" in said
            assert said.splitlines()[-1] == f"installed: torch {pin}"
    finally:
        for server in (pypi, cpu, hangs):
            server.shutdown()


def test_what_the_kernels_take_of_numba_s_private_parts_is_there():
    """Numba promises nothing of ``numba.core``; hence the bound above in pyproject."""
    named = [
        (module, name.name)
        for path in sorted((ROOT / "src").rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ImportFrom)
        and (module := node.module or "").startswith(("numba.", "llvmlite"))
        for name in node.names
    ]
    assert len(named) > 10
    for module, name in named:
        there = importlib.import_module(module)
        ok = hasattr(there, name) or importlib.util.find_spec(f"{module}.{name}")
        assert ok, f"Numba {numba.__version__} has no {module}.{name}, which our kernels are compiled with."
    (bound,) = [one for one in map(Requirement, DECLARED["dependencies"]) if one.name == "numba"]
    assert numba.__version__ in bound.specifier, (
        f"Numba {numba.__version__} is outside {bound.specifier}: try the tests with it, then move the bound."
    )
    major, minor = (int(part) for part in numba.__version__.split(".")[:2])
    assert f"{major}.{minor + 1}.0" not in bound.specifier, (
        "The next Numba is not yet tried and must be refused."
    )


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


@pytest.mark.nightly  # installs pip-audit, in an environment of its own
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
        assert asked == {name: pins[name] for name in asked}
        monkeypatch.setattr(WeaknessServer, "weak", ("torch",))
        done = audit()
        assert done.returncode != 0
        assert re.search(r"torch\s+2\S+\s+MADE-UP-1", done.stdout)
    finally:
        server.shutdown()


ALONE = """
import gymnasium, fieldgym
from importlib.util import find_spec
env = gymnasium.make("fieldgym/PoseReaching-v0", disable_env_checker=True)
env.reset(seed=1)
assert env.step(env.action_space.sample())[1] < 100.0
assert [name for name in ("exam", "papers", "torch", "pytest") if find_spec(name)] == []
"""


@pytest.mark.nightly  # asks the package index
def test_wheel_and_sdist_work_in_an_empty_environment(tmp_path):
    def run(*command):
        done = subprocess.run(command, cwd=tmp_path, env=clean, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
        return done.stdout

    clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    run(sys.executable, "-m", "build", "--outdir", tmp_path / "dist", ROOT)  # the wheel from the sdist
    files = sorted((tmp_path / "dist").iterdir())
    assert [one.name.partition("-")[2] for one in files] == ["0.1.0-py3-none-any.whl", "0.1.0.tar.gz"]
    for file in files:
        place = tmp_path / file.suffix
        run(sys.executable, "-m", "venv", place)
        run(place / "bin" / "pip", "install", "--quiet", "--constraint", ROOT / "constraints.txt", file)
        run(place / "bin" / "python", "-c", ALONE)
        assert "heel_strike" in run(place / "bin" / "fieldgym", "list")
