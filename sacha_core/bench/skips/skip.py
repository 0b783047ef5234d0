"""What one thing that is left out saves: the work with and without it, and how far the two results lie apart."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Num

from sacha_core.bench.clock import interleave
from sacha_core.bench.result import Row

__all__ = ["Bytes", "Process", "Skip", "Work", "apart"]

KB = 1000


class Skip(Protocol):
    """Something that is left out."""

    def row(self, rounds: int, budget_s: float) -> Row:
        """Measure it, with so many rounds unless time runs out."""


@dataclass(frozen=True)
class Work:
    """Work of this process.

    Args:
        name: what is left out.
        leaving_out: does what is left.
        plain: does all of it.
        error: gives the largest difference between the two results.
        proof: the test that shows it: file::function.
        warm_up: calls of each that are not timed.
    """

    name: str
    leaving_out: Callable[[], object]
    plain: Callable[[], object]
    error: Callable[[], float]
    proof: str
    warm_up: int = 1

    def row(self, rounds: int, budget_s: float) -> Row:
        """Measure."""
        times = interleave(
            {"with": self.leaving_out, "without": self.plain}, rounds, budget_s, self.warm_up, min(rounds, 3)
        )
        found: Row = {key: value for name, taken in times.items() for key, value in taken.row(name).items()}
        saving = times["without"].median_ms / times["with"].median_ms
        return {"skip": self.name, **found, "saving_ratio": saving, "error": self.error(), "proof": self.proof}


@dataclass(frozen=True)
class Process:
    """Two lines of Python, each in a process of its own; nothing is computed, so that there is no error.

    Args:
        name: what is left out.
        leaving_out: runs without it.
        plain: runs with it.
        proof: the test that shows it: file::function.
    """

    name: str
    leaving_out: str
    plain: str
    proof: str

    def row(self, rounds: int, budget_s: float) -> Row:
        """Measure; processor time is that of other processes, and left out."""
        work = Work(
            self.name, lambda: run(self.leaving_out), lambda: run(self.plain), lambda: 0.0, self.proof, warm_up=0
        )
        return {key: value for key, value in work.row(rounds, budget_s).items() if not key.endswith("busy_ms")}


@dataclass(frozen=True)
class Bytes:
    """Bytes of a file.

    Args:
        name: what is left out.
        leaving_out: of the file in which the attributes have their default.
        plain: of the file in which they have not.
        error: largest difference between what went in and what comes back, of these attributes.
        proof: the test that shows it: file::function.
    """

    name: str
    leaving_out: int
    plain: int
    error: float
    proof: str

    def row(self, rounds: int, budget_s: float) -> Row:  # noqa: ARG002  (there is nothing to time)
        """Give the sizes."""
        sizes = {"with_kb": self.leaving_out / KB, "without_kb": self.plain / KB}
        saving = self.plain / self.leaving_out
        return {"skip": self.name, **sizes, "saving_ratio": saving, "error": self.error, "proof": self.proof}


def run(line: str) -> None:
    """Run a line of Python in a fresh interpreter."""
    subprocess.run([sys.executable, "-c", line], check=True, capture_output=True)  # noqa: S603  (our own code)


def apart(a: Num[np.ndarray, "..."], b: Num[np.ndarray, "..."] | float) -> float:
    """Give the largest difference, in float64."""
    return float(np.abs(a.astype(np.float64) - b).max(initial=0))
