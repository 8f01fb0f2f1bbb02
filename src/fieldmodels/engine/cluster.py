"""Jobs on a Ray cluster."""

from __future__ import annotations

import logging
import secrets
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from fieldmodels.code import whole_code
from fieldmodels.engine.job import Done, Job, perform
from fieldmodels.files import write_bytes

RETRIES = 3
"""How often a job is done again whose machine was lost."""
GRACE = 60.0
TOKEN = ".shared"
Files = dict[str, bytes]


class EngineError(ValueError):
    """Jobs that cannot be run in this way."""


def on_ray(jobs: Sequence[Job], address: str) -> Iterator[Done]:
    """Do jobs on a cluster; those of a machine that is lost are done again on another.

    A job works in its own folder where its machine sees that (shared storage); else what is in the folder
    travels to the machine, and what the job leaves there comes back.

    Args:
        jobs: The jobs.
        address: Of the cluster, as ``ray.init`` takes it; empty: that of ``RAY_ADDRESS``, else a new
            cluster of this machine alone.

    Raises:
        EngineError: Without Ray, or where there is no such cluster.
    """
    try:
        import ray
        from ray.exceptions import RayError
    except ImportError:
        raise EngineError("the engine ray is not installed: pip install 'fieldgym[cluster]'") from None
    mine = not ray.is_initialized()
    if mine:
        try:
            ray.init(
                address=address or None,
                log_to_driver=False,
                include_dashboard=False,
                logging_level=logging.ERROR,
            )
        except (ConnectionError, ValueError, RuntimeError) as error:
            raise EngineError(f"no Ray cluster at {address or 'this machine'}: {error}") from None
    work = ray.remote(num_cpus=1, max_retries=RETRIES, scheduling_strategy="SPREAD")(_work)
    token = secrets.token_hex(8)
    under_way: dict[Any, Job] = {}
    try:
        for job in jobs:
            under_way[work.remote(job, _code(job), *_sent(job, token))] = job
        while under_way:
            (ref,), _ = ray.wait(list(under_way), num_returns=1)
            job = under_way.pop(ref)
            try:
                done, files = ray.get(ref)
            except RayError as error:
                yield Done(job, error=f"{type(error).__name__}: {str(error).strip().splitlines()[0]}")
                continue
            if job.folder is not None:
                _unpack(files, job.folder)
                (job.folder / TOKEN).unlink(missing_ok=True)
            yield replace(done, job=job)
    finally:
        for ref in under_way:
            ray.cancel(ref)
        if under_way:
            ray.wait(list(under_way), num_returns=len(under_way), timeout=GRACE)
        for job in under_way.values():
            if job.folder is not None:
                (job.folder / TOKEN).unlink(missing_ok=True)
        if mine:
            ray.shutdown()


def _work(job: Job, code: str, token: str, files: Files) -> tuple[Done, Files]:
    """Do a job on a machine of the cluster."""
    if _code(job) != code:
        return Done(job, error="this machine has another version of fieldgym: install the driver's"), {}
    if job.folder is None or _read(job.folder / TOKEN) == token.encode():
        return perform(job), {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _unpack(files, folder)
        done = perform(replace(job, folder=folder))
        return done, _pack(folder)


def _code(job: Job) -> str:
    """Hash of our code, and of the package that the job is in: of a checkout, the exam and the papers."""
    return whole_code(job.function.__module__.partition(".")[0])


def _sent(job: Job, token: str) -> tuple[str, Files]:
    """What a job takes along: how a machine knows that it sees the folder itself, else the folder's files."""
    if job.folder is None:
        return token, {}
    files = _pack(job.folder)
    job.folder.mkdir(parents=True, exist_ok=True)
    (job.folder / TOKEN).write_text(token, encoding="utf-8")
    return token, files


def _pack(folder: Path) -> Files:
    return {
        str(p.relative_to(folder)): p.read_bytes()
        for p in folder.rglob("*")
        if p.is_file() and p.name != TOKEN
    }


def _unpack(files: Files, folder: Path) -> None:
    for name, data in files.items():
        write_bytes(folder / name, data)


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError:
        return b""
