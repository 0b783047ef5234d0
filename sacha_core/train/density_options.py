"""What density control can be told: growth, pruning by score, and the score, with the paper's numbers as defaults."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from sacha_core.density.modulators import Modulators
from sacha_core.density.scores.table import KNOWN_SCORES
from sacha_core.density.selection import Guard
from sacha_core.errors import OptionError

__all__ = ["DensityOptions", "ImportanceOptions", "PruningOptions", "Scope", "require"]

Scope = Literal["none", "all", "each", "weighted", "regions"]


@dataclass(frozen=True)
class DensityOptions:
    """Growth, and what densification removes.

    Args:
        threshold: gradient at or above which a Gaussian grows, in normalised device units (tau0).
        threshold_lowest: bound of a region's threshold.
        threshold_highest: bound of a region's threshold.
        by_region: whether regions get thresholds of their own after warm-up.
        threshold_in_warm_up: threshold of all regions until they are measured; None for `threshold`.
        means: which mean sensitivities make the modulators. `visible` and `weighted` cost an importance pass at each calibration.
        modulators: what becomes of the modulators learnt (see `controlled`); all but `learned` are controls.
        region_weights: how much more some regions are worth than measured, by name: what the bounded modulator gives is divided by it.
        largest_clone: longest standard deviation that is cloned and not split, in scene extents.
        largest: longest standard deviation that is kept, in scene extents.
        lowest_opacity: that is kept.
        reset_opacity: ceiling that a reset brings opacities down to.
        gradient: what growth is decided by: the gradient by the place in the image, in normalised device units, or the sum over pixels
            of its absolute values, which CUDA alone offers.
        spread: whether children of a split are spread by world or local size (see `split_children`).
        clone_opacity: `copied` leaves the opacity of a clone and its parent as it was, so that both together are more opaque; `shared`
            gives both 1 - sqrt(1 - o), which lets as much through as the parent did.
        guard_faint: whether the last Gaussian of a triangle stays though it is nearly transparent; in warm-up it always does.

    Source: GaussianAvatars; SACHA (thresholds).
    """

    threshold: float = 3e-4
    threshold_lowest: float = 1.5e-4
    threshold_highest: float = 6e-4
    threshold_in_warm_up: float | None = None
    by_region: bool = True
    means: Literal["plain", "visible", "weighted"] = "plain"
    modulators: Modulators = "learned"
    region_weights: tuple[tuple[str, float], ...] = ()
    largest_clone: float = 0.01
    largest: float = 0.1
    lowest_opacity: float = 0.005
    reset_opacity: float = 0.01
    gradient: Literal["ndc", "absolute"] = "ndc"
    spread: Literal["world", "local"] = "world"
    clone_opacity: Literal["copied", "shared"] = "copied"
    guard_faint: bool = True

    def __post_init__(self) -> None:
        """Refuse numbers that make no sense."""
        require(0 < self.threshold < float("inf"), "density.threshold", self.threshold, "above 0")
        lowest, highest = self.threshold_lowest, self.threshold_highest
        require(0 <= lowest <= highest, "density.threshold_lowest", lowest, "0 to density.threshold_highest")
        early = self.threshold_in_warm_up
        require(early is None or 0 < early < float("inf"), "density.threshold_in_warm_up", early, "above 0")
        for name, weight in self.region_weights:
            require(0 < weight < float("inf"), f"density.region_weights of {name}", weight, "a number above 0")
        for name in ("largest_clone", "largest"):
            require(getattr(self, name) > 0, f"density.{name}", getattr(self, name), "above 0")
        for name in ("lowest_opacity", "reset_opacity"):
            require(0 < getattr(self, name) < 1, f"density.{name}", getattr(self, name), "above 0 and below 1")


@dataclass(frozen=True)
class PruningOptions:
    """Pruning by score.

    Args:
        scope: `regions` by each region's ratio; `each` by the same ratio in every region; `all` by one ratio over all Gaussians;
            `weighted` likewise, with each score divided by a power of the modulator of its region; `none` not at all.
        score: name of the importance score, in the table of `density/scores`.
        power: of the modulator that `weighted` divides by; the ratio's bounds hold for the modulator.
        hidden_first: whether each pruning begins with what never shows; the ratio is then of what remains. With `scope` none, nothing
            else goes.
        hidden_at_end: whether what never shows goes at the end of the run.
        guard: what becomes of a triangle's last Gaussian (see `lowest_of_each_region`).
        ratio: share that goes at each pruning (rho0).
        ratio_lowest: bound of a region's ratio.
        ratio_highest: bound of a region's ratio.

    Source: SACHA; the bounds and the guard are our own.
    """

    scope: Scope = "regions"
    score: str = "pis"
    power: float = 1.0
    hidden_first: bool = False
    hidden_at_end: bool = False
    guard: Guard = "off"
    ratio: float = 0.2
    ratio_lowest: float = 0.1
    ratio_highest: float = 0.4

    def __post_init__(self) -> None:
        """Refuse numbers that make no sense."""
        require(0 < self.ratio < 1, "pruning.ratio", self.ratio, "above 0 and below 1")
        require(0 <= self.ratio_lowest <= self.ratio_highest <= 1, "pruning.ratio_lowest",
                self.ratio_lowest, "0 to pruning.ratio_highest, which is at most 1")  # fmt: skip
        require(self.score in KNOWN_SCORES, "pruning.score", self.score, f"one of {', '.join(KNOWN_SCORES)}")
        require(abs(self.power) < float("inf"), "pruning.power", self.power, "a finite number")


@dataclass(frozen=True)
class ImportanceOptions:
    """How the importance score is made.

    Args:
        views: how many training views, about, weights are summed over: all those of evenly spaced timesteps; None for all.
        pixel_factor: lambda_S.
        gaussian_factor: lambda_a.
        volume_space: whether volumes are compared in local units or in metres of the neutral head.
        volume_percentile: of all volumes, that counts as 1; larger ones do, too (V90).
        volume_power: to which the volume enters; 0 for not at all.
        visible_pixels: blending weight, in pixels a view, above which a Gaussian counts as visible; below, it never shows.
    """

    views: int | None = 1500
    pixel_factor: float = 1.0
    gaussian_factor: float = 1.0
    volume_space: Literal["local", "world"] = "local"
    volume_percentile: float = 90.0
    volume_power: float = 0.1
    visible_pixels: float = 1 / 12

    def __post_init__(self) -> None:
        """Refuse numbers that make no sense."""
        require(self.views is None or self.views >= 1, "importance.views", self.views, "at least 1")
        for name in ("pixel_factor", "gaussian_factor", "volume_power", "visible_pixels"):
            require(0 <= getattr(self, name) < float("inf"), f"importance.{name}", getattr(self, name), "at least 0")
        percentile = self.volume_percentile
        require(0 <= percentile <= 100, "importance.volume_percentile", percentile, "0 to 100")


def require(holds: bool, name: str, value: object, expected: str) -> None:
    """Refuse an option's value, on one line.

    Raises:
        OptionError: `holds` is false.
    """
    if not holds:
        raise OptionError(f"{name} is {value}, expected {expected}")
