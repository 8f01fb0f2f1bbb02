"""The page's server: what a browser asks for, answered by calls of a session."""

from __future__ import annotations

import re
import secrets
import shutil
import socket
import sys
import tempfile
import webbrowser
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import FileResponse, HTMLResponse, JSONResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from fieldagents.app.buckets import buckets
from fieldagents.app.guard import Guard
from fieldagents.app.session import Log, Session
from fieldmodels import html
from fieldmodels.arrays import FloatArray
from fieldmodels.diagnosis import answer
from fieldmodels.recording import RecordingError
from fieldmodels.recording.proposals import Proposal
from fieldmodels.recording.sources import together
from fieldmodels.registry import model_names

STATIC = Path(__file__).parent / "static"
LARGEST = 4 << 30  # bytes of a log that is dropped; a larger one can be opened by its path
WIDEST = 8000  # pixels of a signal


class Page:
    """Answers to a browser.

    Attributes:
        session: What they are about.
        dropped: Folder for dropped logs.
        names: Key of a dropped file or folder to what the user calls it.
    """

    def __init__(self, session: Session, dropped: Path) -> None:
        """Serve a session."""
        self.session, self.dropped = session, dropped
        self.names: dict[str, str] = {}

    def routes(self) -> list[Route | Mount]:
        """All that can be asked for."""
        reading = {
            "state": self.state, "signal": self.signal, "run": self.run, "answer": self.answer,
            "script": self.script,
        }  # fmt: skip
        doing = {
            "open": self.open, "propose": self.propose, "diagnose": self.diagnose, "cancel": self.cancel,
            "simulate": self.simulate,
        }  # fmt: skip
        return [
            Route("/", self.index),
            Route("/api/drop", self.drop, methods=["POST"]),
            *(Route(f"/api/{name}", partial(_answered, call)) for name, call in reading.items()),
            *(Route(f"/api/{n}", partial(_answered, call), methods=["POST"]) for n, call in doing.items()),
            Route("/file/{name:path}", self.file),
            Mount("/static", StaticFiles(directory=STATIC)),
        ]

    async def index(self, _request: Request) -> Response:
        """The page."""
        page = (STATIC / "index.html").read_text(encoding="utf-8")
        return HTMLResponse(page.replace("{{style}}", html.STYLE))

    async def drop(self, request: Request) -> Response:
        """Take in a dropped file, to be opened by the key that is answered.

        Its name is shown, and no path is built from it but a known ending. Of a folder's files, each with its
        place ``inside``, plain names are.
        """
        query = request.query_params
        name, inside = query.get("name", "log")[-200:], query.get("inside", "")
        ending = "" if inside else "".join(re.findall(r"\.[A-Za-z0-9]{1,8}", name[-18:])[-2:]).lower()
        key = query.get("folder") or f"log-{len(self.names) + 1}{ending}"
        if not all(re.fullmatch(r"\w[\w .-]*", part) for part in inside.split("/") if inside):
            return JSONResponse(
                {"error": f"{name}: {inside!r} is no plain name; open the folder by its path"}, 400
            )
        if "folder" in query and key not in self.names:
            return JSONResponse({"error": f"{key} is missing"}, 400)
        path = self.dropped / key / inside
        path.parent.mkdir(parents=True, exist_ok=True)
        self.names[key] = name
        size = 0
        with path.open("wb") as file:
            async for chunk in request.stream():
                size += len(chunk)
                if size > LARGEST:
                    return JSONResponse({"error": "too large to be dropped; open it by its path"}, 400)
                file.write(chunk)
        return JSONResponse({"dropped": key})

    def open(self, _query: Any, body: Any) -> Any:
        """Open a log by its path, or what was dropped at once: files of one run as one log."""
        if "dropped" not in body:
            self.session.open(Path(str(body["path"])).expanduser())
            return self.state({}, {})
        names = {self.dropped / key: self.names[key] for key in body["dropped"]}
        for run in together(list(names)):
            self.session.open("+".join(map(str, run)), " + ".join(names[path] for path in run))
        return self.state({}, {})

    def state(self, _query: Any, _body: Any) -> Any:
        """Everything that the page shows beside curves."""
        session, job = self.session, self.session.job
        return {
            "logs": [self._described(log) for log in session.logs],
            "models": list(model_names()),
            "model": session.model_name,
            "job": {"stage": job.stage, "share": job.share, "error": job.error, "running": job.running},
            "diagnosed": session.diagnosis is not None,
            "files": sorted(session.written),
        }

    def _described(self, log: Log) -> Any:
        names = log.names()
        times = {clock: time for time, clock in (self.session.times(log, name) for name in names)}
        return {
            "name": log.name,
            "columns": {name: log.table.units.get(name, "") for name in names if name not in times},
            "rows": max(map(len, times.values())),
            "span": [min(t[0] for t in times.values()), max(t[-1] for t in times.values())],
            "clock": ", ".join(clock for clock in times if clock),
        }

    def signal(self, query: Any, _body: Any) -> Any:
        """A signal as few points: times, then values, as float64."""
        log = self.session.log(int(query["log"]))
        (time, _), width = self.session.times(log, query["name"]), min(int(query["width"]), WIDEST)
        begin, end = float(query.get("begin", time[0])), float(query.get("end", time[-1]))
        return buckets(time, log.column(query["name"]), begin, end, max(width, 1))

    def propose(self, _query: Any, body: Any) -> Any:
        """What the columns are, with reasons."""
        rate = body.get("rate")
        found: Proposal = self.session.propose(str(body["model"]), float(rate) if rate else None)
        model = self.session.model
        assert model is not None
        columns = [
            {"role": c.role, "spec": str(c.channel), "confidence": c.confidence, "why": list(c.evidence)}
            for c in found.columns
        ]
        found_too = {c.role: c.unit for c in found.columns}  # episodes, other clocks
        roles = {"t": "s", **found_too, **{s.name: s.unit for s in model.signals}}
        return {
            "columns": columns,
            "roles": roles,
            "missing": list(found.missing),
            "constant": list(found.constant),
        }

    def diagnose(self, _query: Any, body: Any) -> Any:
        """Start a diagnosis."""
        self.session.start({str(k): str(v) for k, v in body["columns"].items() if v})
        return self.state({}, {})

    def cancel(self, _query: Any, _body: Any) -> Any:
        """Stop it."""
        self.session.cancel()
        return self.state({}, {})

    def answer(self, _query: Any, _body: Any) -> Any:
        """The answer as HTML, and what can be changed."""
        diagnosis = self.session.diagnosis
        if diagnosis is None:
            raise RecordingError("there is no diagnosis yet")
        picture = self.session.drawn.get("answer")
        numbers = [
            {"name": name, "value": value, "low": low, "high": high, "unit": unit}
            for name, (value, low, high, unit) in self.session.numbers().items()
        ]
        plan = diagnosis.next_measurement
        run = diagnosis.free_run
        return {
            "html": answer.section(diagnosis, picture.fragment() if picture else ""),
            "numbers": numbers if run else [],
            "next": plan.why if plan else "",
            "outputs": list(run.outputs) if run else [],
            "inputs": list(run.inputs) if run else [],
        }

    def run(self, query: Any, _body: Any) -> Any:
        """Rows of a free run as float64: times, measured, before, after; of an input times and values."""
        run, name = self.session.run(), query["name"]
        simulated = [run.simulated[key][name] for key in ("before", "after") if name in run.outputs]
        return np.array([run.measured.time, run.measured[name], *simulated])

    def simulate(self, _query: Any, body: Any) -> Any:
        """The free run with other values: outputs one after the other, and their fits."""
        values = {str(name): float(value) for name, value in body["values"].items()}
        run, fits = self.session.changed(values)
        return {
            "fits": {name: None if np.isnan(fit) else fit for name, fit in fits.items()},
            "outputs": {
                name: [None if not np.isfinite(v) else v for v in run.simulated["after"][name].tolist()]
                for name in run.outputs
            },
            "script": self.session.script(values),
        }

    def script(self, _query: Any, _body: Any) -> Any:
        """The same as a Python script."""
        return {"script": self.session.script()}

    async def file(self, request: Request) -> Response:
        """A file that was written; ``model.py`` is made when it is asked for."""
        name = request.path_params["name"]
        try:
            known = dict(self.session.written)
            if name == "model.py":
                known[name] = await run_in_threadpool(self.session.export)
        except ValueError as error:
            return JSONResponse({"error": str(error)}, 400)
        figures = self.session.folder / "figures"
        if self.session.written and figures.is_dir():
            known |= {f"figures/{path.name}": path for path in figures.iterdir()}
        if name not in known:
            return JSONResponse({"error": f"there is no {name}"}, 404)
        return FileResponse(known[name])


async def _answered(call: Callable[[Any, Any], Any], request: Request) -> Response:
    """Call in a thread; a mistake of the user becomes a message."""
    try:
        body = await request.json() if request.method == "POST" else {}
        result = await run_in_threadpool(call, request.query_params, body)
    except KeyError as error:
        return JSONResponse({"error": f"{error.args[0]} is missing"}, 400)
    except (ValueError, OSError) as error:  # what users are told of is made of these
        return JSONResponse({"error": str(error)}, 400)
    if isinstance(result, np.ndarray):
        return Response(_bytes(result), media_type="application/octet-stream")
    return JSONResponse(result)


def _bytes(rows: FloatArray) -> bytes:
    return np.ascontiguousarray(rows, dtype="<f8").tobytes()


def application(session: Session, dropped: Path, token: str, port: int) -> Guard:
    """The page as an ASGI application, guarded."""
    return Guard(Starlette(routes=Page(session, dropped).routes()), token, port)


def listening(port: int) -> socket.socket:
    """A socket on this machine's own address that sends what it has at once.

    Asyncio turns Nagle's algorithm off only on sockets that name their protocol, which
    ``socket.create_server`` does not; with it each answer waits 40 ms for the browser's acknowledgement.

    Raises:
        RecordingError: If another program listens on the port.
    """
    bound = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    try:
        bound.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.bind(("127.0.0.1", port))
        bound.listen()
    except OSError as error:
        bound.close()
        raise RecordingError(
            f"port {port}: {error.strerror}; name another one, or 0 for a free one"
        ) from None
    return bound


def serve(
    paths: Sequence[Path],
    folder: Path,
    port: int = 0,
    *,
    browser: bool = True,
    say: Callable[[str], None] = print,
) -> None:
    """Serve the page on this machine until it is interrupted.

    Args:
        paths: Logs to begin with.
        folder: Where results are written.
        port: Port; 0 for a free one.
        browser: Whether to open it.
        say: Told the address.

    Raises:
        RecordingError: If a log cannot be opened, or the port is taken.
    """
    import uvicorn

    session = Session(folder)
    for path in paths:
        session.open(path)
    dropped = Path(tempfile.mkdtemp(prefix="fieldgym-"))
    bound = listening(port)
    port, token = bound.getsockname()[1], secrets.token_urlsafe(24)
    address = f"http://127.0.0.1:{port}/?token={token}"
    say(address)
    sys.stdout.flush()
    if browser:
        webbrowser.open(address)
    config = uvicorn.Config(application(session, dropped, token, port), log_level="warning", ws="none")
    try:
        uvicorn.Server(config).run(sockets=[bound])
    finally:
        session.cancel()
        shutil.rmtree(dropped, ignore_errors=True)
