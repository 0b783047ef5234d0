"""What `sacha prune` is told of the budget: texts of the command line into numbers by region and triangle."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from sacha_core.errors import OptionError

if TYPE_CHECKING:
    import numpy as np
    from jaxtyping import Float

    from sacha_core.cli.prune import Options
    from sacha_core.density.budget import Budget
    from sacha_core.flame.model import HeadModel
    from sacha_core.regions.partition import Partition
    from sacha_core.regions.scheme import RegionScheme

__all__ = ["budget_of", "parsed_locks", "parsed_shares", "parsed_weights", "partition_of"]

Told = TypeVar("Told")


def partition_of(head: HeadModel, scheme: Path | None, name: str) -> Partition:
    """Give the head's regions: those of a scheme file, else of a known scheme.

    Raises:
        OptionError: no scheme has that name.
        HeadError: the head lacks masks, or the file is another head's.
        FormatError: the file is damaged.
        OSError: it cannot be read.
    """
    from sacha_core.regions.partition import partition_by
    from sacha_core.regions.scheme import SCHEMES, find_scheme
    from sacha_core.regions.scheme_file import read_scheme_file

    if scheme is not None:
        return read_scheme_file(scheme, head)
    if name not in SCHEMES:
        raise OptionError(
            f"the scores are of regions of somebody's own, {name!r}; name the file of these with --scheme"
        )
    return partition_by(head, find_scheme(name))


def budget_of(options: Options, n: int, partition: Partition, head: HeadModel) -> Budget:
    """Give the budget that was asked for; it keeps all where a size alone decides.

    Raises:
        OptionError: a number is out of range, or no number.
        HeadError: what was painted was painted on another head.
        FormatError: the file of what was painted is damaged.
        OSError: it cannot be read.
    """
    from sacha_core.density.budget import Budget

    return Budget(
        kept_share(options, n),
        parsed_weights(options.weights, partition),
        *options.bounds,
        scope=options.scope,
        power=options.power,
        shares=parsed_shares(options.shares, partition),
        locks=parsed_locks(options.lock, partition),
        importance=importance_of(options, head),
    )


def kept_share(options: Options, n: int) -> float:
    """Give the share that stays, by whichever option says it.

    Raises:
        OptionError: the number is out of range.
    """
    if options.ratio is not None and not 0 <= options.ratio < 1:
        raise OptionError(f"--ratio is {options.ratio:g}, expected 0 or more and below 1")
    if options.keep is not None and not 0 < options.keep <= 1:
        raise OptionError(f"--keep is {options.keep:g}, expected above 0 and at most 1")
    if options.target_count is not None and not 1 <= options.target_count <= n:
        raise OptionError(f"--target-count is {options.target_count}, expected 1 to {n}, which the scores file holds")
    if options.ratio is not None:
        return 1 - options.ratio
    if options.target_count is not None:
        return options.target_count / n
    return 1.0 if options.keep is None else options.keep


def importance_of(options: Options, head: HeadModel) -> Float[np.ndarray, " f"] | None:
    """Read what was painted.

    Raises:
        OptionError: a strength is out of range, or nothing was painted that it could act on.
        HeadError, FormatError, OSError: as `budget_of`.
    """
    from sacha_core.density.painting import painted_importance, read_painting

    strength = options.importance_strength
    if strength is not None and options.importance is None:
        raise OptionError("--importance-strength says how strongly --importance acts; expected that too")
    if strength is not None and not 0 < strength < float("inf"):
        raise OptionError(f"--importance-strength is {strength:g}, expected above 0")
    if options.importance is None:
        return None
    return painted_importance(read_painting(options.importance), head, strength)


def parsed_weights(texts: Sequence[str], scheme: RegionScheme | Partition) -> dict[int, float]:
    """Give the weights by region label.

    Raises:
        OptionError: naming the first that is not REGION=FACTOR.
    """

    def factor(text: str) -> float:
        value = float(text)
        if not 0 < value < float("inf"):
            raise ValueError
        return value

    return by_region("--weights", texts, scheme, factor, "REGION=FACTOR with a factor above 0, such as mouth=2")


def parsed_shares(texts: Sequence[str], scheme: RegionScheme | Partition) -> dict[int, tuple[float, float]]:
    """Give the least and largest shares by region label.

    Raises:
        OptionError: naming the first that is not REGION=LOWEST:HIGHEST.
    """

    def bounds(text: str) -> tuple[float, float]:
        low, mark, high = text.partition(":")
        lowest, highest = float(low or 0), float(high or 1)
        if not (mark and 0 <= lowest <= highest <= 1):
            raise ValueError
        return lowest, highest

    expected = "REGION=LOWEST:HIGHEST with shares from 0 to 1, such as mouth=0.1:0.3"
    return by_region("--shares", texts, scheme, bounds, expected)


def parsed_locks(texts: Sequence[str], scheme: RegionScheme | Partition) -> dict[int, int | None]:
    """Give the numbers that regions are locked to by label; None for all that there are.

    Raises:
        OptionError: naming the first that is neither REGION nor REGION=COUNT.
    """

    def count(text: str) -> int | None:
        if text and not text.isdecimal():
            raise ValueError
        return int(text) if text else None

    return by_region("--lock", texts, scheme, count, "REGION or REGION=COUNT, such as eyes or eyes=500")


def by_region(
    option: str,
    texts: Sequence[str],
    scheme: RegionScheme | Partition,
    parse: Callable[[str], Told],
    expected: str,
) -> dict[int, Told]:
    """Give what was told of each region, by its label.

    Raises:
        OptionError: a text is not as expected, names no region, or one twice.
    """
    told: dict[int, Told] = {}
    for text in texts:
        name, _, rest = text.partition("=")
        try:
            value = parse(rest)
        except ValueError:
            raise OptionError(f"{option} {text}: expected {expected}") from None
        label = scheme.label(name)
        if label in told:
            raise OptionError(f"{option} gives {name} twice")
        told[label] = value
    return told
