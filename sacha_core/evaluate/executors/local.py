"""Processes of this machine, one for each job."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import time
from collections.abc import Iterator, Sequence
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from threading import Thread

from sacha_core.errors import OptionError
from sacha_core.evaluate.executors.jobs import Job, Outcome, Unsettled, attempt
from sacha_core.evaluate.executors.pace import paced
from sacha_core.parallel.pool import available_threads
from sacha_core.progress import Progress, Report

__all__ = ["LocalProcesses"]

PATIENCE_S = 10.0  # for a process to clean up after itself when it is told to end
ORPHANED = 3  # exit status that nobody sees


class LocalProcesses:
    """Works jobs off in processes of this machine. They are started afresh, so that no job inherits another's threads or memory.

    Args:
        processes: how many at once; None for one on each core.
        threads: how many each job should use; None to share out the cores.

    Raises:
        OptionError: either is below 1.
    """

    def __init__(self, processes: int | None = None, threads: int | None = None) -> None:
        for name, value in (("processes", processes), ("threads", threads)):
            if value is not None and value < 1:
                raise OptionError(f"{value} {name} were asked for, expected 1 or more")
        cores = available_threads()
        self.processes = processes if processes is not None else max(1, cores // (threads or 1))
        self._threads = threads if threads is not None else max(1, cores // self.processes)

    @property
    def threads(self) -> int:
        """How many threads a job should use."""
        return self._threads

    def run(self, jobs: Sequence[Job], report: Report) -> Iterator[Outcome]:
        """Work jobs off; see `Executor.run`."""
        unsettled, running = Unsettled(jobs), dict[Connection, tuple[Job, SpawnProcess]]()
        try:
            while unsettled:
                while len(running) < self.processes and (job := unsettled.take()) is not None:
                    connection, process = begin(job)
                    running[connection] = (job, process)
                ready = wait(list(running))
                for connection in [known for known in running if known in ready]:
                    told = heard(connection)
                    if isinstance(told, Progress):
                        report(told)
                        continue
                    job, process = running.pop(connection)
                    connection.close()
                    process.join()
                    yield from unsettled.settle(told or Outcome(job.name, died(process.exitcode)))
        finally:
            end([process for _, process in running.values()])


def begin(job: Job) -> tuple[Connection, SpawnProcess]:
    """Start a job in a process of its own."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=live, args=(job, theirs), name=job.name, daemon=True)
    process.start()
    theirs.close()
    return ours, process


def heard(connection: Connection) -> Progress | Outcome | None:
    """Give what a process says; None where it has ended without an outcome."""
    try:
        told: Progress | Outcome = connection.recv()
    except (EOFError, ConnectionError):
        return None
    return told


def died(exit_code: int | None) -> str:
    """Say how a process ended that had no time to say anything itself."""
    if exit_code is not None and exit_code < 0:
        return f"its process was ended by signal {signal.Signals(-exit_code).name}; was there enough memory?"
    return f"its process ended with exit status {exit_code}"


def end(processes: Sequence[SpawnProcess]) -> None:
    """End processes: first with time to remove what is half written, then without."""
    for process in processes:
        process.terminate()
    until = time.monotonic() + PATIENCE_S
    for process in processes:
        process.join(max(0.0, until - time.monotonic()))
        if process.is_alive():
            process.kill()
            process.join()


def live(job: Job, connection: Connection) -> None:
    """Do a job in a process of its own, and tell its parent how it goes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # who waits ends us, also on Ctrl-C
    signal.signal(signal.SIGTERM, _unwind)
    Thread(target=_end_with_parent, daemon=True).start()
    with contextlib.suppress(KeyboardInterrupt, BrokenPipeError):
        connection.send(attempt(job, paced(connection.send)))


def _unwind(*_: object) -> None:
    """On SIGTERM unwind, so that half-written files are removed."""
    raise KeyboardInterrupt


def _end_with_parent() -> None:
    """End this process as soon as its parent is gone: a job that nobody waits for must not go on writing files."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(ORPHANED)
