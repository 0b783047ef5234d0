"""What a stranger must know to read a report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from sacha_core.evaluate.report.runs import Runs
from sacha_core.evaluate.report.targets import Outcome

__all__ = ["TERMS", "conditions_of", "remarks_of", "summary_of"]

TERMS: Mapping[str, str] = {
    "Variant": (
        "One set of rules for where an avatar's Gaussians go. All variants of one seed continue from the same half-trained "
        "avatar."
    ),
    "Paired difference": (
        "One variant's figure less another's with the same seed. What the seed does, it does to both, so it cancels. Means of "
        "two variants differ by less than the seeds do; only paired differences are to be trusted."
    ),
    "±": (
        "Standard deviation over the seeds (dividing by one less than their number): of figures in tables of variants, of "
        "differences in tables of pairs. It tells how much one run tells, and is no proof: with three seeds it is itself "
        "uncertain by about half."
    ),
    "(2/3)": "In tables of pairs: two of three paired differences are above 0.",
    "Bytes": (
        "Of the coded Gaussians alone: the motion is the same for all variants, and the head is the receiver's. The encoder's "
        "own dropping of invisible Gaussians is switched off, so that a variant is charged for what it keeps. 1 KB is 1000 "
        "bytes."
    ),
    "BD-rate": (
        "How many percent more bytes one variant needs than another for the same quality, the mean over all qualities that both"
        " reach (Bjøntegaard). Below 0 it needs fewer. Where two curves have no quality in common there is none, and the table "
        "says so."
    ),
    "Novel view": "Images of a camera that training never saw, at moments that it saw.",
    "Novel expression": "Images of moments that training never saw, by all cameras.",
    "PSNR, SSIM": "Likeness to the truth, the higher the better; PSNR in decibels.",
    "FLIP, LPIPS": "Differences that people see, the lower the better. FLIP is NVIDIA's; LPIPS compares features of a trained network.",
    "Hidden share": "Gaussians that no training view shows: those whose blending weight summed over views is below what counts as seen.",
    "Modulator": (
        "By how much a region's thresholds and pruning ratios are scaled (m_R in the paper). Below 1 a region keeps more "
        "Gaussians."
    ),
    "Regions": "Mouth, eyes, nose, ears, boundary, scalp, neck and face: every triangle of the head belongs to one.",
}


PURPOSE = (
    "Avatars of the same head were trained with different rules for where their Gaussians go, coded, and judged on images that training "
    "never saw. Each rule was run with several seeds; two rules are compared seed by seed, since only such paired differences are to be "
    "trusted."
)

NO_TARGETS = "sacha, whose targets this page would judge, was not run."


def summary_of(outcomes: Sequence[Outcome]) -> tuple[str, ...]:
    """Say how many of the targets held, and which did not."""
    count = {
        verdict: sum(outcome.verdict == verdict for outcome in outcomes)
        for verdict in ("held", "not held", "not decided")
    }
    first = (
        f"Of {len(outcomes)} targets (each on one capture and in one setting) {count['held']} held, {count['not held']} did not, "
        f"{count['not decided']} could not be decided from these runs."
    )
    return (PURPOSE, first if outcomes else NO_TARGETS)


def conditions_of(every: Sequence[Runs], given: Mapping[str, str]) -> dict[str, str]:
    """Give the conditions that the results themselves tell, after those that were given."""
    found = dict(given)
    for runs in every:
        iterations = sorted({result.iterations for result in runs.results})
        images = sorted(
            {(point.novel_view.n_images, point.novel_expression.n_images) for r in runs.results for point in r.points}
        )
        looked_at = " or ".join(
            f"{view} of novel views and {expression} of novel expressions" for view, expression in images
        )
        found[f"Capture {runs.dataset}"] = (
            f"{' or '.join(f'{n:,}' for n in iterations)} iterations; seeds {', '.join(map(str, runs.seeds))}; "
            f"{len(runs.results)} runs of {len(runs.variants)} variants; images judged: {looked_at or 'none'}"
        )
    return found


def remarks_of(runs: Runs) -> tuple[str, ...]:
    """Say what is missing or uneven in the runs on a capture, so that nothing is hidden."""
    found = []
    for variant in runs.variants:
        lacking = [str(seed) for seed in runs.seeds if seed not in runs.of(variant)]
        if lacking:
            found.append(f"{variant} has no run with seed {', '.join(lacking)}.")
    uncoded = sorted({r.variant for r in runs.results if {point.level for point in r.points} - {0} != set(runs.levels)})
    if uncoded:
        found.append(f"Not every run was coded at every level: {', '.join(uncoded)}.")
    if len({result.iterations for result in runs.results}) > 1:
        found.append("Runs have different numbers of iterations: they are not to be compared with one another.")
    if len(runs.seeds) < 2:
        found.append("There is one seed only: nothing here has a spread, and differences may be chance.")
    return tuple(found)
