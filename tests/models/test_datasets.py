"""Public recordings are found, checked, and read with their own column names."""

import hashlib
import re
import shutil
import time
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread

import numpy as np
import platformdirs
import pytest

from fieldmodels.recording import RecordingError, RecordingWarning, datasets
from fieldmodels.recording.datasets import (
    DatasetError,
    dataset_names,
    fetch,
    get_dataset,
    open_recording,
    recognise,
)
from fieldmodels.registry import get_model

DDP = "dfki_simple_pendulum/ddp"


CONTENT = b"time,position,velocity,torque\n"


class Publisher(BaseHTTPRequestHandler):
    """Gives a file, another one, none, or an answer that never comes; notes what it was asked for."""

    asked: list[str]

    def do_GET(self):
        self.asked.append(self.path)
        if self.path == "/late":
            time.sleep(2.0)
        content = {"/right": CONTENT, "/wrong": b"<html>moved</html>"}.get(self.path)
        self.send_response(200 if content else 404)
        self.send_header("Content-Length", str(len(content or b"")))
        self.end_headers()
        self.wfile.write(content or b"")

    def log_message(self, *_):
        pass


@pytest.fixture
def published(monkeypatch, tmp_path):
    """Publishes a recording under a path of a server here; no local data, an empty cache."""
    monkeypatch.delenv("FIELDGYM_DATA", raising=False)
    monkeypatch.setattr(platformdirs, "user_cache_dir", lambda _name: str(tmp_path / "cache"))
    monkeypatch.setattr(datasets, "_TIMEOUT", 0.3)
    Publisher.asked = []
    server = ThreadingHTTPServer(("127.0.0.1", 0), Publisher)
    Thread(target=server.serve_forever, daemon=True).start()

    def publish(path, port=server.server_port):
        known = {"size": len(CONTENT), "sha256": hashlib.sha256(CONTENT).hexdigest(), "file": "a/b.csv"}
        one = replace(get_dataset(DDP), url=f"http://127.0.0.1:{port}{path}", **known)
        monkeypatch.setitem(datasets.datasets(), DDP, one)

    yield publish
    server.shutdown()


def test_every_entry_is_whole():
    for name in dataset_names():
        dataset = get_dataset(name)
        assert re.fullmatch(r"[0-9a-f]{64}", dataset.sha256)
        assert dataset.file.startswith(name.split("/")[0])
        assert dataset.licence
        if dataset.url:
            assert re.match(r"https://raw\.githubusercontent\.com/[^/]+/[^/]+/[0-9a-f]{40}/", dataset.url)
        assert ("t" in dataset.columns) != (dataset.windows is not None)


def test_every_local_file_has_its_checksum(public_data):
    present = [n for n in dataset_names() if (public_data / get_dataset(n).file).is_file()]
    assert DDP in present
    for name in present:
        known = recognise(fetch(name))
        assert known is not None
        assert known.sha256 == get_dataset(name).sha256


def test_a_public_recording_opens_by_name(public_data):
    recording = open_recording(DDP, get_model("pendulum"))
    assert len(recording) == 3000
    assert recording.step == pytest.approx(0.002, rel=1e-3)
    assert recording.units == {"torque": "N m", "angle": "rad", "velocity": "rad/s"}
    assert recording["angle"][-1] == pytest.approx(np.pi, abs=0.05)  # the swing-up ends upright


def test_its_content_is_recognised_under_any_name(public_data, tmp_path):
    shutil.copy(fetch(DDP), tmp_path / "mine.csv")
    assert "angle" in open_recording(tmp_path / "mine.csv", get_model("pendulum"))


def test_degrees_and_per_cent_of_the_propeller_arm_are_converted(public_data):
    recording = open_recording("quarter_drone/swept_sine")
    assert recording["angle"][0] == pytest.approx(np.deg2rad(18.11), rel=1e-12)
    assert recording["command"][0] == pytest.approx(-0.1, rel=1e-12)
    assert recording.step == pytest.approx(0.01)


def test_a_model_that_needs_another_signal_says_so(public_data):
    with pytest.raises(RecordingError, match=r"'torque' .*is missing"):
        open_recording("quarter_drone/steps", get_model("pendulum"))


@pytest.mark.every(
    ("name", "note", "episodes"),
    [
        (
            "dfki_simple_pendulum/gravity_compensation",
            r"even step of 0\.00100.* s: the signals were interpolated",
            1,
        ),
        ("quarter_drone/second", r"even step of 0\.010.* s: the rows are even.*; 2 long gaps start", 3),
    ],
)
def test_uneven_real_logs_are_put_on_an_even_grid(public_data, name, note, episodes):
    with pytest.warns(RecordingWarning, match=note):
        recording = open_recording(name)
    assert len(recording.bounds) == episodes


def test_a_table_of_windows_opens_as_episodes_with_what_is_known_of_the_machine(public_data):
    whole = open_recording("drive_ugv/warthog")
    halves = [open_recording(f"drive_ugv/warthog_{half}_steps") for half in ("even", "odd")]
    assert (np.diff(whole.bounds, axis=1) == 40).all()
    assert [len(r.bounds) for r in (whole, *halves)] == [360, 180, 180]
    assert not set(halves[0].episode) & set(halves[1].episode)
    assert whole.known == {"wheel_radius": 0.3, "track": 1.1652}
    assert whole.step == pytest.approx(0.05)
    assert whole["x"][::40] == pytest.approx(0.0, abs=1e-9)  # each window starts at its own origin
    # Straight ahead, an ideal differential drive is as fast as its rims.
    straight = np.abs(whole["left_command"] - whole["right_command"]) < 0.05
    assert straight.any()
    assert whole["speed"][straight] == pytest.approx(0.3 * whole["left_command"][straight], abs=0.01)


def test_a_table_of_windows_says_what_it_lacks(public_data):
    with pytest.raises(DatasetError, match="a table of windows, has no torque"):
        open_recording("drive_ugv/warthog", get_model("pendulum"))
    with pytest.raises(DatasetError, match="takes no column declarations"):
        open_recording("drive_ugv/warthog", columns={"x": "icp_x_0"})


def test_a_damaged_local_file_is_refused(monkeypatch, tmp_path):
    path = tmp_path / get_dataset(DDP).file
    path.parent.mkdir()
    path.write_text("t,angle\n0,1\n")
    monkeypatch.setenv("FIELDGYM_DATA", str(tmp_path))
    with pytest.raises(DatasetError, match=r"damaged or changed: its SHA-256 is not 14748fd189ab"):
        fetch(DDP)


@pytest.mark.every("path", ["/gone", "/late", "/refused"])
def test_out_of_reach_says_where_to_put_it(published, path, tmp_path):
    published(path, **({"port": 9} if path == "/refused" else {}))  # nobody listens at the port "discard"
    with pytest.raises(DatasetError, match=r"could not be fetched.*put the file at \$FIELDGYM_DATA/a/b.csv"):
        fetch(DDP)
    assert not list((tmp_path / "cache").rglob("*.csv"))


def test_what_was_published_in_another_format_is_not_asked_for(published):
    with pytest.raises(DatasetError, match="published in another format"):
        fetch("drive_ugv/warthog")


def test_fetched_once_then_taken_from_the_cache(published, tmp_path):
    published("/right")
    assert fetch(DDP).read_bytes() == CONTENT
    assert fetch(DDP) == tmp_path / "cache" / "a" / "b.csv"
    assert Publisher.asked == ["/right"]
    (tmp_path / "cache" / "a" / "b.csv").write_text("damaged")
    assert fetch(DDP).read_bytes() == CONTENT


def test_a_download_of_other_content_is_refused(published, tmp_path):
    published("/wrong")
    with pytest.raises(DatasetError, match="is not the published file"):
        fetch(DDP)
    assert not list((tmp_path / "cache").rglob("*.csv"))


@pytest.mark.every("source", ["dfki_simple_pendulum/dpd", "quarter_drone"])
def test_a_misspelt_name_is_guessed(source):
    with pytest.raises(DatasetError, match=r"did you mean|known:"):
        open_recording(source)


def test_a_missing_file_is_no_name(tmp_path):
    with pytest.raises(RecordingError, match="no such file"):
        open_recording(tmp_path / "log.csv")
