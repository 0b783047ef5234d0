"""Options by name: the variants that are compared, and the paper's schedule scaled to shorter runs."""

from __future__ import annotations

from dataclasses import replace

from sacha_core.density.modulators import Modulators
from sacha_core.errors import OptionError
from sacha_core.train.density_options import Scope
from sacha_core.train.options import WHOLE, Schedule, TrainOptions

__all__ = ["VARIANTS", "growing_to_the_last_prune", "preset", "scaled", "variant"]

VARIANTS = (
    "ga", "default", "default-seen", "rad", "rad-gp-lgs", "rad-gp-pis", "default-gp-pis", "paper", "mask", "sacha",
    "paper-inverted", "paper-random", "sacha-inverted", "sacha-random", "sacha-uniform",
)  # fmt: skip
CONTROLS: dict[str, Modulators] = {"inverted": "inverted", "random": "random", "uniform": "uniform"}

SCOPES: dict[str, Scope] = {
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
MASK_WEIGHT = 5e-4  # Compact-3DGS, whose runs are of 30,000 iterations
MASK_RUN = 30_000
CHECKPOINTS = 8  # at least so many in any run
RECOVERY = 500  # iterations that a short run keeps after its last pruning
# tau0 does not transfer: gradients of a fit still rough are larger, and 3e-4 lets nearly every Gaussian grow
SHORT_THRESHOLD = 4.5e-4
SHORT_VIEWS = 120  # for the importance score; 60 or 360 rank alike
# `sacha` ends growth and pruning here of the paper's run: what is left has longer to recover, and fewer latecomers are judged by nobody.
# In runs of 3,000 iterations, 7,023 Gaussians at 34.68 / 33.18 dB (novel view / expression), where the paper's 310,000 leave 9,996
LAST_PRUNING = 200_000
SHORT_RATIO = 0.24  # of `sacha`, whose score tells better what is superfluous


def preset(name: str = "paper") -> TrainOptions:
    """Give the paper's run of 360,000 iterations, with a variant's rules.

    Raises:
        OptionError: no variant has that name.
    """
    return variant(TrainOptions(), name)


def scaled(iterations: int, name: str = "sacha", options: TrainOptions | None = None) -> TrainOptions:
    """Give the same method in fewer iterations: every event at the same fraction of the run, and what does not scale set anew.

    A sensitivity must be able to move as far, so its rate grows as the run shrinks. Below 20,000 iterations, besides: the threshold is that
    which about 40 densifications need; opacity is reset when densification starts and once more in warm-up, as
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
    return Schedule(
        iterations=iterations,
        position_decay=iterations,
        sh_every=max(1, iterations // 12) if short else whole.sh_every,
        densify_from=at(whole.densify_from),
        densify_every=max(1, iterations // SHORT_DENSIFICATIONS) if short else at(whole.densify_every),
        densify_until=iterations,
        warm_up=warm_up,
        calibrations=_evenly(warm_up, last, len(whole.calibrations)),
        opacity_resets=tuple(sorted({at(moment) for moment in whole.opacity_resets[: 2 if short else None]})),
        size_prune_from=at(whole.size_prune_from),
        mask_every=max(1, min(whole.mask_every, round(whole.mask_every * iterations / MASK_RUN))),
    )


def _short(options: TrainOptions) -> TrainOptions:
    """Give the options with the thresholds and views of a short run."""
    density = options.density
    steeper = SHORT_THRESHOLD / density.threshold
    return replace(
        options,
        density=replace(
            density,
            threshold=SHORT_THRESHOLD,
            threshold_lowest=density.threshold_lowest * steeper,
            threshold_highest=density.threshold_highest * steeper,
        ),
        importance=replace(options.importance, views=SHORT_VIEWS),
    )


def variant(options: TrainOptions, name: str) -> TrainOptions:
    """Give the options with a variant's rules of density control.

    `ga` is GaussianAvatars with its own threshold; `default` the paper's baseline without regions; `rad` adds thresholds by region; `-gp-`
    prunes by score over all Gaussians; `paper` prunes each region by its quota, under GaussianAvatars' guard. `sacha` is the shipped one:
    no guard, scores by what removing would change, growth and pruning end early, and regions compete for what stays by scores over their
    modulators, since quotas take from regions where nothing is superfluous and leave hidden Gaussians where much is.

    `ga` keeps what all runs share: sensitivities are learnt beside, whose loss reaches the geometry with a weight of 0.01, and the rate of
    positions falls until the end of the run, where GaussianAvatars' own falls over 600,000 iterations whatever the run's length. Without
    either: `--set losses.sensitivity=0 schedule.position_decay=600000`, the latter scaled.

    `mask` is `default` with masks that learn which Gaussians the pictures can do without, as in Compact-3DGS.

    Controls, without which nothing is known: `default-seen` is `default` without what never shows, which goes at the very end;
    `-inverted` has one over each modulator, `-random` that of another region, `-uniform` 1 everywhere.

    Raises:
        OptionError: no variant has that name.
    """
    if name not in VARIANTS:
        raise OptionError(f"variant {name!r} is unknown; expected one of {', '.join(VARIANTS)}")
    rules, _, control = name.rpartition("-") if name.endswith(tuple(CONTROLS)) else (name, "", "")
    by_region = rules not in {"ga", "default", "default-seen", "default-gp-pis", "mask"}
    is_sacha = rules == "sacha"
    pruning = replace(
        options.pruning,
        scope=SCOPES.get(rules, "none"),
        score="removal" if is_sacha else "lgs" if rules.endswith("lgs") else "pis",
        guard="after" if rules == "paper" else "off",
        hidden_at_end=rules == "default-seen",
    )
    density = replace(
        options.density,
        by_region=by_region,
        guard_faint=not is_sacha,
        modulators=CONTROLS.get(control, "learned"),
    )
    if rules == "ga":
        density = replace(density, threshold=density.threshold * 2 / 3)  # 2e-4 where the paper has 3e-4
    losses = replace(options.losses, mask=MASK_WEIGHT) if rules == "mask" else options.losses
    chosen = replace(options, variant=name, density=density, pruning=pruning, losses=losses)
    return _ending_early(chosen) if is_sacha else chosen


def _ending_early(options: TrainOptions) -> TrainOptions:
    """Give the options with calibrations and prunings at even distances from the end of warm-up on, ending early, and growth with them."""
    schedule, pruning = options.schedule, options.pruning
    if schedule.iterations < SHORT:
        more = SHORT_RATIO / pruning.ratio
        lowest, highest = pruning.ratio_lowest * more, pruning.ratio_highest * more
        pruning = replace(pruning, ratio=SHORT_RATIO, ratio_lowest=lowest, ratio_highest=highest)
    last = max(schedule.warm_up, round(LAST_PRUNING * schedule.iterations / WHOLE))
    schedule = replace(schedule, calibrations=_evenly(schedule.warm_up, last, len(Schedule().calibrations)))
    ended = growing_to_the_last_prune(replace(options, schedule=schedule, pruning=pruning))
    resets = tuple(moment for moment in ended.schedule.opacity_resets if moment < ended.schedule.densify_until)
    return replace(ended, schedule=replace(ended.schedule, opacity_resets=resets))


def _evenly(first: int, last: int, count: int) -> tuple[int, ...]:
    """Give iterations from the first to the last, at even distances."""
    steps = count - 1
    return tuple(sorted({first + round((last - first) * step / steps) for step in range(count)}))


def growing_to_the_last_prune(options: TrainOptions) -> TrainOptions:
    """Give the options with growth stopped at the last pruning: what grows later is judged by nobody."""
    schedule = options.schedule
    until = min(schedule.densify_until, schedule.last_pruning or schedule.iterations)
    return replace(options, schedule=replace(schedule, densify_until=until))
