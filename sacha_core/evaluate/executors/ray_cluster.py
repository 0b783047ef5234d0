"""An existing Ray cluster, whose nodes share a file system and have the same software installed."""

from __future__ import annotations

import logging
import signal
import socket
from collections.abc import Iterator, Sequence
from typing import Any

from sacha_core.errors import OptionError
from sacha_core.evaluate.executors.jobs import Job, Outcome, Unsettled, attempt
from sacha_core.evaluate.executors.pace import paced
from sacha_core.progress import Progress, Report

__all__ = ["RayCluster"]

SECONDS_BETWEEN_LOOKS = 0.5
SECONDS_TO_CONNECT = 10.0
RETRIES = 1  # where a node is lost; the job goes on from its files


class RayCluster:
    """Works jobs off on a Ray cluster that is running already.

    Args:
        address: of the cluster, as `ray start --head` says it, or `auto` for the one of this machine.
        threads: how many each job should use; the cluster keeps so many processors for it.

    Raises:
        OptionError: `threads` is below 1.
        ModuleNotFoundError: Ray is not installed.
    """

    def __init__(self, address: str, threads: int | None = None) -> None:
        if threads is not None and threads < 1:
            raise OptionError(f"{threads} threads were asked for, expected 1 or more")
        import ray  # noqa: F401, PLC0415 (told now that it is missing, and not after the plan is made)

        self._address, self._threads = address, threads or 1

    @property
    def threads(self) -> int:
        """How many threads a job should use."""
        return self._threads

    def run(self, jobs: Sequence[Job], report: Report) -> Iterator[Outcome]:
        """Work jobs off; see `Executor.run`.

        Raises:
            OptionError: there is no cluster at the address.
        """
        import ray  # noqa: PLC0415 (slow, and only installed where it is used)

        try:
            require_listener(self._address)
            on_end = signal.getsignal(signal.SIGTERM)  # which Ray replaces by an end without cleaning up
            ray.init(address=self._address, log_to_driver=False, logging_level=logging.ERROR)
            signal.signal(signal.SIGTERM, on_end)
        except (OSError, ValueError, RuntimeError) as error:
            raise OptionError(f"there is no Ray cluster at {self._address}: {' '.join(str(error).split())}") from error
        try:
            yield from self._run(ray, jobs, report)
        finally:
            ray.shutdown()  # which ends this driver's tasks

    def _run(self, ray: Any, jobs: Sequence[Job], report: Report) -> Iterator[Outcome]:
        board = ray.remote(num_cpus=0)(Board).remote()
        work = ray.remote(num_cpus=self._threads, max_retries=RETRIES)(live)
        unsettled, running = Unsettled(jobs), dict[Any, Job]()
        while unsettled:
            while (job := unsettled.take()) is not None:
                running[work.remote(job, board)] = job
            ended, _ = ray.wait(list(running), num_returns=1, timeout=SECONDS_BETWEEN_LOOKS)
            for progress in ray.get(board.taken.remote()):  # after the wait: what ended has said all
                report(progress)
            for reference in ended:
                job = running.pop(reference)
                yield from unsettled.settle(outcome(ray, job, reference))


def require_listener(address: str) -> None:
    """Find out quickly that nobody listens at HOST:PORT, which Ray itself tries for minutes; other addresses are Ray's to judge.

    Raises:
        OSError: nobody does.
    """
    host, _, port = address.rpartition(":")
    if host and port.isdecimal() and "/" not in host:
        socket.create_connection((host, int(port)), SECONDS_TO_CONNECT).close()


def outcome(ray: Any, job: Job, reference: Any) -> Outcome:
    """Give what became of a job, also where its worker was lost."""
    try:
        found: Outcome = ray.get(reference)
    except ray.exceptions.RayError as error:
        return Outcome(job.name, f"its worker was lost: {' '.join(str(error).split())[:300]}")
    return found


class Board:
    """Where jobs write how far they are: the last word on each stage, until it is taken."""

    def __init__(self) -> None:
        self._latest: dict[str, Progress] = {}

    def put(self, progress: Progress) -> None:
        """Write it down."""
        self._latest[progress.stage] = progress

    def taken(self) -> list[Progress]:
        """Give what is new since the last call."""
        found = list(self._latest.values())
        self._latest.clear()
        return found


def live(job: Job, board: Any) -> Outcome:
    """Do a job on a node of the cluster."""
    import ray  # noqa: PLC0415

    def tell(progress: Progress) -> None:
        ray.get(board.put.remote(progress))  # written before the job goes on, and so before it ends

    return attempt(job, paced(tell))
