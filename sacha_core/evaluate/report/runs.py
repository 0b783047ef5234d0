"""The results of a report, found by capture, variant and seed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sacha_core.errors import OptionError
from sacha_core.evaluate.ablation.result import UNCOMPRESSED, Quality, RunResult
from sacha_core.evaluate.report.variants import in_order

__all__ = ["Runs"]


@dataclass(frozen=True)
class Runs:
    """All runs on one capture.

    Args:
        dataset: name of the capture.
        results: one a variant and seed.
    """

    dataset: str
    results: tuple[RunResult, ...]

    @classmethod
    def by_dataset(cls, results: Sequence[RunResult]) -> list[Runs]:
        """Sort results by capture, in the order in which captures first appear.

        Raises:
            OptionError: two results are of the same capture, variant and seed.
        """
        seen = set()
        for result in results:
            key = (result.dataset, result.variant, result.seed)
            if key in seen:
                raise OptionError(
                    f"two results of {result.variant} with seed {result.seed} on {result.dataset}, expected one"
                )
            seen.add(key)
        names = dict.fromkeys(result.dataset for result in results)
        return [cls(name, tuple(result for result in results if result.dataset == name)) for name in names]

    @property
    def variants(self) -> tuple[str, ...]:
        """Names of the variants that were run, in the order in which they are shown."""
        return in_order(result.variant for result in self.results)

    @property
    def seeds(self) -> tuple[int, ...]:
        """Every seed that some variant was run with."""
        return tuple(sorted({result.seed for result in self.results}))

    @property
    def levels(self) -> tuple[int, ...]:
        """Every level of the codec that some run was coded at, without the uncompressed one."""
        found = {point.level for result in self.results for point in result.points}
        return tuple(sorted(found - {UNCOMPRESSED}))

    def of(self, variant: str) -> dict[int, RunResult]:
        """Give a variant's results by seed."""
        return {result.seed: result for result in self.results if result.variant == variant}

    def quality(self, variant: str, seed: int, level: int, setting: str) -> Quality | None:
        """Give how good a run's pictures are at a level, where it was measured."""
        result = self.of(variant).get(seed)
        point = None if result is None else result.point(level)
        return None if point is None else getattr(point, setting)
