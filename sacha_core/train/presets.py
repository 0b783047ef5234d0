"""Options by name: the variants that are compared, and the paper's schedule scaled to shorter runs."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from sacha_core.density.modulators import Modulators
from sacha_core.errors import OptionError
from sacha_core.train.options import WHOLE, Schedule, TrainOptions

__all__ = ["VARIANTS", "growing_to_the_last_prune", "preset", "scaled", "variant"]

VARIANTS = (
    "ga", "default", "default-seen", "rad", "rad-gp-lgs", "rad-gp-pis", "default-gp-pis", "paper", "sacha",
    "paper-inverted", "paper-random", "sacha-inverted", "sacha-random",
)  # fmt: skip
CONTROLS: dict[str, Modulators] = {"inverted": "inverted", "random": "random"}

SCOPES: dict[str, Literal["none", "all", "weighted", "regions"]] = {
    "rad-gp-lgs": "all",
    "rad-gp-pis": "all",
    "default-gp-pis": "all",
    "paper": "regions",
    "sacha": "weighted",
}
SHORT = 20_000  # iterations below which a run is short
SHORT_DENSIFICATIONS = (
    48  # over a whole short run, of which about 40 come after the first and before the last iterations
)
CHECKPOINTS = 8  # at least so many in any run
RECOVERY = 500  # iterations that a short run keeps after its last pruning
# tau0 does not transfer: gradients of a fit still rough are larger, and 3e-4 lets nearly every Gaussian grow
SHORT_THRESHOLD = 4.5e-4
SHORT_VIEWS = 120  # for the importance score; 60 or 360 rank alike
SHORT_RATIO = 0.16  # a prune takes longer to heal than a short run has between two: rho0 of 0.2 costs 0.15 dB more on training views


def preset(name: str = "paper") -> TrainOptions:
    """Give the paper's run of 360,000 iterations, with a variant's rules.

    Raises:
        OptionError: no variant has that name.
    """
    return variant(TrainOptions(), name)


def scaled(iterations: int, name: str = "sacha", options: TrainOptions | None = None) -> TrainOptions:
    """Give the same method in fewer iterations: every event at the same fraction of the run, and what does not scale set anew.

    A sensitivity must be able to move as far, so its rate grows as the run shrinks. Below 20,000 iterations, besides: the threshold is that
    which about 40 densifications need, and a pruning takes less; opacity is reset when densification starts and once more in warm-up, as
    later resets cost more than a short run can win back; at least 500 iterations follow the last pruning.

    Args:
        iterations: length of the run.
        name: of the variant.
        options: whose seed, size and other settings to keep; the paper's by default.

    Raises:
        OptionError: no variant has that name, or `iterations` is not positive.

    Source: own measurements on runs of 3,000 to 6,000 iterations.
    """
    if iterations < 1:
        raise OptionError(f"iterations is {iterations}, expected at least 1")
    base = TrainOptions() if options is None else options
    chosen = replace(
        base,
        schedule=_scaled_schedule(iterations),
        rates=replace(base.rates, sensitivity_logit=1e-4 * WHOLE / iterations),
        checkpoint_every=max(1, min(base.checkpoint_every, iterations // CHECKPOINTS)),
    )
    return variant(_short(chosen) if iterations < SHORT else chosen, name)


def _scaled_schedule(iterations: int) -> Schedule:
    """Give the paper's schedule at the same fractions of a run, with the exceptions of a short one."""

    def at(moment: int) -> int:
        return max(1, round(moment * iterations / WHOLE))

    whole, short = Schedule(), iterations < SHORT
    warm_up, last = at(whole.warm_up), at(whole.calibrations[-1])
    if short:
        last = min(last, max(warm_up, iterations - RECOVERY))
    steps = len(whole.calibrations) - 1
    return Schedule(
        iterations=iterations,
        position_decay=iterations,
        sh_every=max(1, iterations // 12) if short else whole.sh_every,
        densify_from=at(whole.densify_from),
        densify_every=max(1, iterations // SHORT_DENSIFICATIONS) if short else at(whole.densify_every),
        densify_until=iterations,
        warm_up=warm_up,
        calibrations=tuple(sorted({warm_up + round((last - warm_up) * step / steps) for step in range(steps + 1)})),
        opacity_resets=tuple(sorted({at(moment) for moment in whole.opacity_resets[: 2 if short else None]})),
        size_prune_from=at(whole.size_prune_from),
    )


def _short(options: TrainOptions) -> TrainOptions:
    """Give the options with the thresholds, ratios and views of a short run."""
    density, pruning = options.density, options.pruning
    steeper, gentler = SHORT_THRESHOLD / density.threshold, SHORT_RATIO / pruning.ratio
    return replace(
        options,
        density=replace(
            density,
            threshold=SHORT_THRESHOLD,
            threshold_lowest=density.threshold_lowest * steeper,
            threshold_highest=density.threshold_highest * steeper,
        ),
        pruning=replace(
            pruning,
            ratio=SHORT_RATIO,
            ratio_lowest=pruning.ratio_lowest * gentler,
            ratio_highest=pruning.ratio_highest * gentler,
        ),
        importance=replace(options.importance, views=SHORT_VIEWS),
    )


def variant(options: TrainOptions, name: str) -> TrainOptions:
    """Give the options with a variant's rules of density control.

    `ga` is GaussianAvatars with its own threshold; `default` the paper's baseline without regions; `rad` adds thresholds by region; `-gp-`
    prunes by score over all Gaussians; `paper` prunes each region by its quota, under GaussianAvatars' guard. `sacha` is the shipped one:
    no guard, growth stops at the last pruning, and regions compete for what stays by scores over their modulators, since quotas take from
    regions where nothing is superfluous and leave hidden Gaussians where much is.

    Controls, without which nothing is known: `default-seen` is `default` without what never shows, which goes at the very end;
    `-inverted` has one over each modulator, `-random` that of another region.

    Raises:
        OptionError: no variant has that name.
    """
    if name not in VARIANTS:
        raise OptionError(f"variant {name!r} is unknown; expected one of {', '.join(VARIANTS)}")
    rules, _, control = name.rpartition("-") if name.endswith(tuple(CONTROLS)) else (name, "", "")
    by_region = rules not in {"ga", "default", "default-seen", "default-gp-pis"}
    pruning = replace(
        options.pruning,
        scope=SCOPES.get(rules, "none"),
        score="lgs" if rules.endswith("lgs") else "pis",
        guard="after" if rules == "paper" else "off",
        hidden_at_end=rules == "default-seen",
    )
    density = replace(
        options.density,
        by_region=by_region,
        guard_faint=rules != "sacha",
        modulators=CONTROLS.get(control, "learned"),
    )
    if rules == "ga":
        density = replace(density, threshold=density.threshold * 2 / 3)  # 2e-4 where the paper has 3e-4
    chosen = replace(options, variant=name, density=density, pruning=pruning)
    return growing_to_the_last_prune(chosen) if rules == "sacha" else chosen


def growing_to_the_last_prune(options: TrainOptions) -> TrainOptions:
    """Give the options with growth stopped at the last pruning: what grows later is judged by nobody."""
    schedule = options.schedule
    until = min(schedule.densify_until, schedule.last_pruning or schedule.iterations)
    return replace(options, schedule=replace(schedule, densify_until=until))
