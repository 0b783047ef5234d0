"""Everything that training can be told, with the paper's numbers as defaults."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, fields, is_dataclass
from typing import Any, Literal, get_args, get_origin, get_type_hints

from sacha_core.density.modulators import Modulators
from sacha_core.density.scores.table import KNOWN_SCORES
from sacha_core.density.selection import Guard
from sacha_core.errors import OptionError

__all__ = [
    "DensityOptions", "ImportanceOptions", "LearningRates", "LossOptions", "PruningOptions", "Schedule", "TrainOptions", "from_record",
]  # fmt: skip

WHOLE = 360_000  # iterations of the paper's run


@dataclass(frozen=True)
class LossOptions:
    """Weights of the losses, and where the two penalties begin.

    Source: GaussianAvatars, CVPR 2024, section 3.4; sensitivity: SACHA.
    """

    l1: float = 0.8
    ssim: float = 0.2
    sensitivity: float = 0.01
    position: float = 0.01
    position_limit: float = 1.0  # local units
    scale: float = 1.0
    scale_limit: float = 0.6  # local units


@dataclass(frozen=True)
class LearningRates:
    """Adam's rates; the position's is times the scene's extent, and falls log-linearly from the first to the last.

    Source: GaussianAvatars, CVPR 2024, public code; sensitivity: SACHA.
    """

    position: float = 0.005
    position_last: float = 0.00005
    log_scale: float = 0.017
    quaternion: float = 0.001
    opacity_logit: float = 0.05
    sh_dc: float = 0.0025
    sh_rest: float = 0.0025 / 20
    sensitivity_logit: float = 1e-4
    pose: float = 1e-5
    translation: float = 1e-6
    expression: float = 1e-3


@dataclass(frozen=True)
class Schedule:
    """What happens after how many iterations.

    Args:
        iterations: length of the run.
        position_decay: iterations over which the position's rate falls.
        sh_every: the degree of spherical harmonics grows by one every so many.
        densify_from: densification comes after these.
        densify_every: and every so many.
        densify_until: and before these.
        warm_up: regions matter from here on.
        calibrations: when regions are measured; pruning by score, if any, follows at once.
        opacity_resets: when opacities are brought down.
        size_prune_from: from here on, densification also removes the far too large.
    """

    iterations: int = WHOLE
    position_decay: int = WHOLE
    sh_every: int = 1000
    densify_from: int = 10_000
    densify_every: int = 2000
    densify_until: int = WHOLE
    warm_up: int = 110_000
    calibrations: tuple[int, ...] = (110_000, 160_000, 210_000, 260_000, 310_000)
    opacity_resets: tuple[int, ...] = (10_000, 60_000, 120_000, 180_000, 240_000, 300_000)
    size_prune_from: int = 60_000

    def densifies(self, iteration: int) -> bool:
        """Tell whether Gaussians are cloned, split and removed after this iteration."""
        inside = self.densify_from < iteration < self.densify_until
        return inside and iteration % self.densify_every == 0


@dataclass(frozen=True)
class DensityOptions:
    """Growth, and what densification removes.

    Args:
        threshold: gradient at or above which a Gaussian grows, in normalised device units (tau0).
        threshold_lowest: bound of a region's threshold.
        threshold_highest: bound of a region's threshold.
        by_region: whether regions get thresholds of their own after warm-up.
        means: which mean sensitivities make the modulators. `visible` and `weighted` cost an importance pass at each calibration.
        modulators: what becomes of the modulators learnt (see `controlled`); all but `learned` are controls.
        region_weights: how much more some regions are worth than measured, by name: the modulator is divided by it, once.
        largest_clone: longest standard deviation that is cloned and not split, in scene extents.
        largest: longest standard deviation that is kept, in scene extents.
        lowest_opacity: that is kept.
        reset_opacity: ceiling that a reset brings opacities down to.
        gradient: what growth is decided by: the gradient by the place in the image, in normalised device units, or the sum over pixels
            of its absolute values, which CUDA alone offers.
        spread: whether children of a split are spread by world or local size (see `split_children`).
        guard_faint: whether the last Gaussian of a triangle stays though it is nearly transparent; in warm-up it always does.

    Source: GaussianAvatars; SACHA (thresholds).
    """

    threshold: float = 3e-4
    threshold_lowest: float = 1.5e-4
    threshold_highest: float = 6e-4
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
    guard_faint: bool = True


@dataclass(frozen=True)
class PruningOptions:
    """Pruning by score.

    Args:
        scope: `regions` by each region's ratio; `all` by one ratio over all Gaussians; `weighted` likewise, with each score divided by a
            power of the modulator of its region; `none` not at all.
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

    scope: Literal["none", "all", "weighted", "regions"] = "regions"
    score: str = "pis"
    power: float = 1.0
    hidden_first: bool = False
    hidden_at_end: bool = False
    guard: Guard = "off"
    ratio: float = 0.2
    ratio_lowest: float = 0.1
    ratio_highest: float = 0.4


@dataclass(frozen=True)
class ImportanceOptions:
    """How the importance score is made.

    Args:
        views: how many training views, about, weights are summed over: all those of evenly spaced timesteps.
        pixel_factor: lambda_S.
        gaussian_factor: lambda_a.
        volume_space: whether volumes are compared in local units or in metres of the neutral head.
        visible_pixels: blending weight, in pixels a view, above which a Gaussian counts as visible; below, it never shows.
    """

    views: int = 1500
    pixel_factor: float = 1.0
    gaussian_factor: float = 1.0
    volume_space: Literal["local", "world"] = "local"
    visible_pixels: float = 1 / 12


@dataclass(frozen=True)
class TrainOptions:
    """One training run.

    Args:
        variant: name that these options go by.
        seed: of everything random.
        width: of the images trained on, pixels; None for the stored width.
        height: likewise.
        sh_degree: highest degree of spherical harmonics, 0 to 3.
        fine_tune: whether pose, translation and expression of training timesteps are fitted, too.
        sensitivity_pad: what the reference sensitivity map takes to lie beyond the border (see `sensitivity_map`).
        scheme: name of the region scheme.
        device: where to compute; `auto` takes CUDA where torch sees a GPU and gsplat is installed, and the CPU elsewhere. A run that is
            resumed stays where it was, unless told otherwise.
        cameras_per_step: how many views of one timestep a step learns from at once, at most.
        threads: how many work; None for as many as there are cores. The result does not depend on it.
        checkpoint_every: iterations between checkpoints; there is always one at the end of warm-up and one at the end.
        image_cache_bytes: of decoded images that are kept.
        schedule: when what happens.
        losses: their weights.
        rates: learning rates.
        density: growth.
        pruning: by score.
        importance: the score.
    """

    variant: str = "paper"
    seed: int = 0
    width: int | None = None
    height: int | None = None
    sh_degree: int = 3
    fine_tune: bool = True
    sensitivity_pad: Literal["replicate", "zero"] = "replicate"
    scheme: str = "paper"
    device: Literal["auto", "cpu", "cuda"] = "auto"
    cameras_per_step: int = 1
    threads: int | None = None
    checkpoint_every: int = 5000
    image_cache_bytes: int = 4 << 30
    schedule: Schedule = field(default_factory=Schedule)
    losses: LossOptions = field(default_factory=LossOptions)
    rates: LearningRates = field(default_factory=LearningRates)
    density: DensityOptions = field(default_factory=DensityOptions)
    pruning: PruningOptions = field(default_factory=PruningOptions)
    importance: ImportanceOptions = field(default_factory=ImportanceOptions)

    def __post_init__(self) -> None:
        """Refuse numbers that make no sense."""
        schedule = self.schedule
        _require(schedule.iterations >= 1, "schedule.iterations", schedule.iterations, "at least 1")
        for name in ("position_decay", "sh_every", "densify_every"):
            _require(getattr(schedule, name) >= 1, f"schedule.{name}", getattr(schedule, name), "at least 1")
        _require(0 <= self.sh_degree <= 3, "sh_degree", self.sh_degree, "0 to 3")
        _require(self.seed >= 0, "seed", self.seed, "at least 0")
        _require(self.threads is None or self.threads >= 1, "threads", self.threads, "at least 1")
        for name in ("checkpoint_every", "cameras_per_step"):
            _require(getattr(self, name) >= 1, name, getattr(self, name), "at least 1")
        _require(self.device in {"auto", "cpu", "cuda"}, "device", self.device, "auto, cpu or cuda")
        for name in ("width", "height"):
            size = getattr(self, name)
            _require(size is None or size >= 16, name, size, "at least 16 pixels")
        earliest = min(schedule.calibrations, default=schedule.warm_up)
        _require(earliest >= schedule.warm_up, "schedule.calibrations", schedule.calibrations,
                 f"none before schedule.warm_up, {schedule.warm_up}")  # fmt: skip
        _require(0 < self.pruning.ratio < 1, "pruning.ratio", self.pruning.ratio, "above 0 and below 1")
        _require(0 <= self.pruning.ratio_lowest <= self.pruning.ratio_highest <= 1, "pruning.ratio_lowest",
                 self.pruning.ratio_lowest, "0 to pruning.ratio_highest, which is at most 1")  # fmt: skip
        _require(
            self.pruning.score in KNOWN_SCORES, "pruning.score", self.pruning.score, f"one of {', '.join(KNOWN_SCORES)}"
        )
        _require(abs(self.pruning.power) < float("inf"), "pruning.power", self.pruning.power, "a finite number")
        _require(0 < self.density.threshold < float("inf"), "density.threshold", self.density.threshold, "above 0")
        for name, weight in self.density.region_weights:
            _require(0 < weight < float("inf"), f"density.region_weights of {name}", weight, "a number above 0")
        _require(self.importance.views >= 1, "importance.views", self.importance.views, "at least 1")

    def record(self) -> dict[str, Any]:
        """Give the options as plain values, for a JSON file."""
        return asdict(self)


def _require(holds: bool, name: str, value: object, expected: str) -> None:
    if not holds:
        raise OptionError(f"{name} is {value}, expected {expected}")


def from_record(record: dict[str, Any]) -> TrainOptions:
    """Build options from what `TrainOptions.record` gave, perhaps before some option came: it then has its default, which does as was done.

    Raises:
        OptionError: naming a field that is unknown or out of range.
    """
    options: TrainOptions = _build(TrainOptions, record, "options")
    return options


def _build(kind: type[Any], record: Any, where: str) -> Any:
    names = {f.name for f in fields(kind)}
    if not isinstance(record, dict) or not record.keys() <= names:
        raise OptionError(f"{where} does not have only the fields {', '.join(sorted(names))}")
    hints = get_type_hints(kind)
    values = {}
    for name, value in record.items():
        nested = hints[name]
        if is_dataclass(nested):
            values[name] = _build(nested, value, f"{where}.{name}")  # type: ignore[arg-type]
        else:
            if get_origin(nested) is Literal:
                known = get_args(nested)
                _require(value in known, f"{where}.{name}", value, f"one of {', '.join(map(str, known))}")
            values[name] = _tuples(value)
    return kind(**values)


def _tuples(value: Any) -> Any:
    """Give JSON's lists as the tuples that they were."""
    return tuple(_tuples(one) for one in value) if isinstance(value, list) else value
