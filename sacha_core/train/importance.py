"""What training views tell of each Gaussian, and the importance score that is made of it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from sacha_core.avatar.binding import sigmoid
from sacha_core.density.scores.rounding import rounded
from sacha_core.density.scores.table import KNOWN_SCORES, Evidence
from sacha_core.density.scores_file import BlendingSums
from sacha_core.progress import Progress, Report, silent
from sacha_core.train.engine import Engine
from sacha_core.train.options import TrainOptions
from sacha_core.train.state import TrainState
from sacha_core.train.views import Target

__all__ = ["PASSES", "SeenWeights", "importance", "look", "spreads"]

# what scores need of the views of one timestep besides blending weights: (n, ...) float64, to be summed over views
PASSES: dict[str, Callable[[Engine, Sequence[Target], int], Float[np.ndarray, "n ..."]]] = {
    "removal": lambda engine, targets, degree: engine.removals(targets, degree),
}


@dataclass(frozen=True)
class SeenWeights:
    """What an importance pass found.

    Args:
        weights: (n, 2) float64 blending weight summed over pixels and views: plain, and weighted by reference sensitivity.
        n_views: number of views.
        more: what the score's further passes summed, by name.
    """

    weights: Float[np.ndarray, "n 2"]
    n_views: int
    more: Mapping[str, Float[np.ndarray, "n ..."]] = field(default_factory=dict)

    def sums(self) -> BlendingSums:
        """Give the blending weights as a scores file keeps them."""
        return BlendingSums(self.weights[:, 0], self.weights[:, 1], self.n_views)


def look(
    engine: Engine,
    steps: Iterable[Sequence[Target]],
    n_views: int,
    degree: int,
    passes: Sequence[str] = (),
    report: Report = silent,
) -> SeenWeights:
    """Sum over views blending weights and what further passes find.

    Args:
        engine: with the state to look at.
        steps: the views, each step some of one timestep.
        n_views: how many there are in all.
        degree: of the spherical harmonics in use.
        passes: names of the further passes.
        report: told about progress.
    """
    sums: dict[str, np.ndarray] = {}
    done = 0
    for targets in steps:
        found = {"weights": engine.weights(targets, degree)}
        found |= {name: PASSES[name](engine, targets, degree) for name in passes}
        sums = {name: sums[name] + value if name in sums else value for name, value in found.items()}
        done += len(targets)
        report(Progress("measure importance", done, n_views))
    return SeenWeights(sums.pop("weights"), n_views, sums)


def importance(
    state: TrainState, options: TrainOptions, seen: SeenWeights, rest_scale: Float[np.ndarray, " f"]
) -> Float[np.ndarray, " n"]:
    """Score every Gaussian, rounded to six digits.

    Args:
        state: of the Gaussians.
        options: of the run.
        seen: what views tell of them.
        rest_scale: (f,) metres a local unit of each triangle of the neutral head.
    """
    scales = spreads(state.values["log_scale"].astype(np.float64))
    if options.importance.volume_space == "world":
        scales *= rest_scale[state.binding, None]
    found = Evidence(
        sums={"weights": seen.weights, **seen.more},
        sensitivity=sigmoid(state.values["sensitivity_logit"].astype(np.float64)),
        scales=scales,
        pixel_factor=options.importance.pixel_factor,
        gaussian_factor=options.importance.gaussian_factor,
        volume_percentile=options.importance.volume_percentile,
        volume_power=options.importance.volume_power,
    )
    return rounded(KNOWN_SCORES[options.pruning.score].of(found))


def spreads(log_scale: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Give standard deviations in local units, infinite where the dtype cannot hold them."""
    with np.errstate(over="ignore"):
        spread: np.ndarray = np.exp(log_scale)
    return spread
