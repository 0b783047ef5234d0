"""Which variants are held against which, and what `sacha` is meant to reach."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["BYTE_TARGETS", "STEPS", "TARGET_REGIONS", "ByteTarget", "Step", "pairs"]


@dataclass(frozen=True)
class Step:
    """One thing that a variant does and another does not.

    Args:
        name: what is looked at.
        variant: that does it.
        against: that does not.
    """

    name: str
    variant: str
    against: str


@dataclass(frozen=True)
class ByteTarget:
    """How many fewer bytes `variant` needs than `against` for Gaussians that give the same PSNR.

    Args:
        variant: whose target it is.
        against: the variant that it is held against.
        fewer_percent: how many fewer at least.
    """

    variant: str
    against: str
    fewer_percent: float


STEPS = (
    Step("Thresholds by region (RAD over Default)", "rad", "default"),
    Step("Score with perception (PIS over LGS)", "rad-gp-pis", "rad-gp-lgs"),
    Step("Ratios by region (RAP over GP)", "paper", "rad-gp-pis"),
    Step("Pruning by score (GP over none, with RAD)", "rad-gp-pis", "rad"),
    Step("Pruning by score (GP over none, without RAD)", "default-gp-pis", "default"),
    Step("Thresholds by region, given pruning (RAD with GP)", "rad-gp-pis", "default-gp-pis"),
    Step("All of the paper", "paper", "default"),
    Step("The paper's modulators over inverted ones", "paper", "paper-inverted"),
    Step("The paper's modulators over random ones", "paper", "paper-random"),
    Step("Deleting what never shows", "default-seen", "default"),
    Step("sacha over default", "sacha", "default"),
    Step("sacha over default-seen", "sacha", "default-seen"),
    Step("sacha over rad-gp-pis", "sacha", "rad-gp-pis"),
    Step("sacha over paper", "sacha", "paper"),
    Step("sacha over mask (learned)", "sacha", "mask"),
    Step("sacha's modulators over none", "sacha", "sacha-uniform"),
    Step("sacha's modulators over inverted ones", "sacha", "sacha-inverted"),
    Step("sacha's modulators over random ones", "sacha", "sacha-random"),
)
BYTE_TARGETS = (
    ByteTarget("sacha", "default", 45.0),
    ByteTarget("sacha", "default-seen", 15.0),
    ByteTarget("sacha", "rad-gp-pis", 8.0),
)
TARGET_REGIONS = ("mouth", "eyes")


def pairs(variants: tuple[str, ...], baseline: str) -> list[tuple[str, str]]:
    """Give every pair (variant, against) that is looked at and of which there are runs: each against the baseline, then the steps."""
    wanted = [(variant, baseline) for variant in variants if variant != baseline]
    wanted += [(step.variant, step.against) for step in STEPS]
    return [pair for pair in dict.fromkeys(wanted) if set(pair) <= set(variants)]
