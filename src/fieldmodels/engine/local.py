"""Jobs in processes of this machine, of one thread each."""

from __future__ import annotations

import os
import signal
import threading
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection, wait

from fieldmodels.engine.job import Done, Job, Report, perform

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
GRACE = 60.0
"""What a job has to come to a place where it can stop [s]."""


def in_processes(jobs: Sequence[Job], workers: int, report: Report) -> Iterator[Done]:
    """Do jobs in some processes; one that kills its process has failed, and the others go on.

    Args:
        jobs: The jobs.
        workers: How many processes.
        report: Shown what is being done, and the part of that job that is done.
    """
    waiting = deque(jobs)
    crew: list[_Worker] = []
    with _single_threads():
        try:
            while waiting or any(worker.job for worker in crew):
                while waiting and sum(worker.job is not None for worker in crew) < workers:
                    idle = next((worker for worker in crew if worker.job is None), None)
                    if idle is None:
                        crew.append(idle := _Worker())
                    idle.give(waiting.popleft())
                by_pipe = {worker.pipe: worker for worker in crew if worker.job}
                for pipe in wait(list(by_pipe)):
                    worker = by_pipe[pipe]  # type: ignore[index]
                    job = worker.job
                    assert job is not None
                    try:
                        message = worker.pipe.recv()
                    except (EOFError, OSError):
                        crew.remove(worker)
                        yield Done(job, error=f"its process died ({worker.end()})")
                        continue
                    if isinstance(message, Done):
                        worker.job = None
                        yield replace(message, job=job)
                    else:
                        report(*message)
        finally:
            for worker in crew:
                worker.ask_to_end()
            for worker in crew:
                worker.end()


class _Worker:
    """A process that does one job at a time."""

    def __init__(self) -> None:
        context = get_context("spawn")
        self.pipe, theirs = context.Pipe()
        self.job: Job | None = None
        self._process = context.Process(target=_serve, args=(theirs,), daemon=True)
        self._process.start()
        theirs.close()  # so that the process's death ends the pipe

    def give(self, job: Job) -> None:
        self.job = job
        self.pipe.send(job)

    def ask_to_end(self) -> None:
        """Tell it to end: at once if it is idle, else where its job can stop."""
        if self._process.is_alive():
            self._process.terminate()

    def end(self) -> str:
        """Wait for its end; returns how it ended."""
        self._process.join(GRACE)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self.pipe.close()
        code = self._process.exitcode or 0
        return signal.Signals(-code).name if code < 0 else f"exit code {code}"


def _serve(pipe: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of a terminal: the parent ends its children
    threading.Thread(target=_end_with_parent, daemon=True).start()
    while True:
        try:
            job: Job = pipe.recv()
        except EOFError:
            return
        try:
            pipe.send(perform(job, lambda stage, part: pipe.send((stage, part))))
        except KeyboardInterrupt:  # asked to end, it has kept a checkpoint
            return


def _end_with_parent() -> None:
    parent = parent_process()
    assert parent is not None
    wait([parent.sentinel])
    os.kill(os.getpid(), signal.SIGTERM)
    threading.Event().wait(GRACE)
    os._exit(1)


@contextmanager
def _single_threads() -> Iterator[None]:
    """Processes that are started here have one thread each."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
