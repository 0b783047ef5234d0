"""Everything that training can be told, with the paper's numbers as defaults."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, fields, is_dataclass, replace
from typing import Any, Literal, get_args, get_origin, get_type_hints

from sacha_core.errors import OptionError
from sacha_core.train.density_options import DensityOptions, ImportanceOptions, PruningOptions, require

__all__ = [
    "DensityOptions", "ImportanceOptions", "LearningRates", "LossOptions", "PruningOptions", "Schedule", "TrainOptions", "from_record",
]  # fmt: skip

WHOLE = 360_000  # iterations of the paper's run


@dataclass(frozen=True)
class LossOptions:
    """Weights of the losses, and where the two penalties begin.

    Args:
        l1: of the mean absolute difference of the pictures.
        ssim: of 1 - SSIM.
        sensitivity: of the cross-entropy of the sensitivity drawn and that of the reference.
        position: of what Gaussians in view stray beyond `position_limit`.
        position_limit: distance from the middle of the triangle, local units.
        mask: of the mean of masks that are learnt; 0 to learn none.
        scale: of what Gaussians in view swell beyond `scale_limit`.
        scale_limit: standard deviation, local units.

    Source: GaussianAvatars, CVPR 2024, section 3.4; sensitivity: SACHA.
    """

    l1: float = 0.8
    ssim: float = 0.2
    sensitivity: float = 0.01
    position: float = 0.01
    position_limit: float = 1.0  # local units
    mask: float = 0.0
    scale: float = 1.0
    scale_limit: float = 0.6  # local units


@dataclass(frozen=True)
class LearningRates:
    """Adam's rates; the position's is times the scene's extent, and falls log-linearly from the first to the last.

    Args:
        position: at first, scene extents.
        position_last: at last.
        log_scale: of its logarithm.
        quaternion: of rotations.
        opacity_logit: of opacities.
        sh_dc: of colours.
        sh_rest: of harmonics of degree 1 and up.
        sensitivity_logit: of sensitivities.
        mask_logit: of masks.
        pose: of the head's joints.
        translation: of the head.
        expression: of expressions.

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
    mask_logit: float = 0.01
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
        calibrations: when regions are measured.
        prunings: when Gaussians are pruned by score; None for at once after each calibration.
        settling: iterations after an opacity reset in which nothing is pruned by score, as scores want settled opacities; None for a
            thirty-sixth of the run, which are 10,000 of the paper's.
        opacity_resets: when opacities are brought down.
        size_prune_from: from here on, densification also removes the far too large.
        mask_every: once growth has ended, what masks hide goes every so many iterations; before, at each densification.
        sensitivity_until: the loss of sensitivity counts up to here; None for to the end.
    """

    iterations: int = WHOLE
    position_decay: int = WHOLE
    sh_every: int = 1000
    densify_from: int = 10_000
    densify_every: int = 2000
    densify_until: int = WHOLE
    warm_up: int = 110_000
    calibrations: tuple[int, ...] = (110_000, 160_000, 210_000, 260_000, 310_000)
    prunings: tuple[int, ...] | None = None
    settling: int | None = None
    opacity_resets: tuple[int, ...] = (10_000, 60_000, 120_000, 180_000, 240_000, 300_000)
    size_prune_from: int = 60_000
    mask_every: int = 1000
    sensitivity_until: int | None = None

    def prunes(self, iteration: int) -> bool:
        """Tell whether Gaussians are pruned by score after this iteration, if at all."""
        due = iteration in (self.calibrations if self.prunings is None else self.prunings)
        settling = self.iterations * 10_000 // WHOLE if self.settling is None else self.settling
        return due and not any(0 < iteration - reset < settling for reset in self.opacity_resets)

    @property
    def last_pruning(self) -> int | None:
        """Iteration after which Gaussians are pruned by score for the last time, if at all; None for never."""
        moments = self.calibrations if self.prunings is None else self.prunings
        return max((moment for moment in moments if self.prunes(moment)), default=None)

    def prunes_masked(self, iteration: int) -> bool:
        """Tell whether what masks hide goes after this iteration, if masks are learnt."""
        return self.densifies(iteration) or (iteration >= self.densify_until and iteration % self.mask_every == 0)

    def until_warm_up(self) -> Schedule:
        """Give the schedule without what comes at the end of warm-up or later."""
        resets = tuple(moment for moment in self.opacity_resets if moment < self.warm_up)
        until = min(self.densify_until, self.warm_up)
        return replace(self, calibrations=(), prunings=None, settling=None, opacity_resets=resets, densify_until=until)

    def densifies(self, iteration: int) -> bool:
        """Tell whether Gaussians are cloned, split and removed after this iteration."""
        inside = self.densify_from < iteration < self.densify_until
        return inside and iteration % self.densify_every == 0


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
        require(schedule.iterations >= 1, "schedule.iterations", schedule.iterations, "at least 1")
        for name in ("position_decay", "sh_every", "densify_every", "mask_every"):
            require(getattr(schedule, name) >= 1, f"schedule.{name}", getattr(schedule, name), "at least 1")
        require(0 <= self.sh_degree <= 3, "sh_degree", self.sh_degree, "0 to 3")
        require(self.seed >= 0, "seed", self.seed, "at least 0")
        require(self.threads is None or self.threads >= 1, "threads", self.threads, "at least 1")
        for name in ("checkpoint_every", "cameras_per_step"):
            require(getattr(self, name) >= 1, name, getattr(self, name), "at least 1")
        require(self.device in {"auto", "cpu", "cuda"}, "device", self.device, "auto, cpu or cuda")
        for name in ("width", "height"):
            size = getattr(self, name)
            require(size is None or size >= 16, name, size, "at least 16 pixels")
        for name in ("calibrations", "prunings"):
            moments = getattr(schedule, name)
            good = moments is None or min(moments, default=schedule.warm_up) >= schedule.warm_up
            require(good, f"schedule.{name}", moments, f"none before schedule.warm_up, {schedule.warm_up}")
        for name in ("settling", "sensitivity_until"):
            moment = getattr(schedule, name)
            require(moment is None or moment >= 0, f"schedule.{name}", moment, "at least 0")

    def record(self) -> dict[str, Any]:
        """Give the options as plain values, for a JSON file."""
        return asdict(self)


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
                require(value in known, f"{where}.{name}", value, f"one of {', '.join(map(str, known))}")
            values[name] = _tuples(value)
    return kind(**values)


def _tuples(value: Any) -> Any:
    """Give JSON's lists as the tuples that they were."""
    return tuple(_tuples(one) for one in value) if isinstance(value, list) else value
