"""What training changes: parameters, the optimiser's moments, and the statistics that growth is decided by."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, Int

from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.parallel.buffers import together
from sacha_core.train.faults import Faults

__all__ = [
    "ATTRIBUTES", "FITTED_MOTION", "MASK_LOGIT", "ROWS", "Arrays", "TrainState", "initial_state", "lay_together", "rearrange",
]  # fmt: skip

ATTRIBUTES = (
    "position", "log_scale", "quaternion", "opacity_logit", "sensitivity_logit", "sh_dc", "sh_rest",
)  # fmt: skip
MASK_LOGIT = "mask_logit"  # (n,), of runs that learn masks
ROWS = (*ATTRIBUTES, MASK_LOGIT)  # what has a row a Gaussian
FITTED_MOTION = ("rotation", "neck", "jaw", "eyes", "translation", "expression")

Arrays = dict[str, Float[np.ndarray, "..."]]


@dataclass
class TrainState:
    """All that one iteration hands to the next. Gaussians are sorted by triangle.

    Args:
        iteration: iterations done.
        values: attributes of n Gaussians, and motion parameters of t timesteps, by name; float32.
        first: Adam's first moments, likewise.
        second: Adam's second moments, likewise.
        steps: Adam steps taken by the Gaussians and by the motion.
        binding: (n,) triangle of each Gaussian, ascending.
        gradient_sum: (n,) lengths of image gradients since the last densification.
        gradient_count: (n,) iterations since then in which the Gaussian was in view.
        thresholds: (r,) of growth, by region.
        ratios: (r,) of pruning, by region.
        faults: steps that were not taken.
    """

    iteration: int
    values: Arrays
    first: Arrays
    second: Arrays
    steps: dict[str, int]
    binding: Int[np.ndarray, " n"]
    gradient_sum: Float[np.ndarray, " n"]
    gradient_count: Int[np.ndarray, " n"]
    thresholds: Float[np.ndarray, " r"]
    ratios: Float[np.ndarray, " r"]
    faults: Faults = field(default_factory=Faults)

    def __len__(self) -> int:
        """Give the number of Gaussians."""
        return len(self.binding)

    def gaussians(self) -> Gaussians:
        """Give copies of the canonical Gaussians."""
        return Gaussians(
            **{name: self.values[name].copy() for name in ATTRIBUTES},
            binding=self.binding.copy(),
        )

    def motion(self, original: Motion) -> Motion:
        """Give `original` with the fitted parameters in place of its own."""
        fitted = {name: self.values[name].copy() for name in FITTED_MOTION}
        return Motion(original.shape, original.static_offset, **fitted, frame_rate=original.frame_rate)


def initial_state(
    gaussians: Gaussians,
    motion: Motion,
    n_regions: int,
    threshold: float,
    ratio: float,
    mask_logit: float | None = None,
) -> TrainState:
    """Give the state before the first iteration.

    Args:
        gaussians: sorted by triangle; sensitivities start at 0.1 where they have none.
        motion: whose parameters are fitted.
        n_regions: of the region scheme.
        threshold: of growth, until regions are measured.
        ratio: of pruning, likewise.
        mask_logit: of every Gaussian's mask; None where none are learnt.
    """
    n = len(gaussians)
    sensitivity = gaussians.sensitivity_logit
    values: Arrays = {name: getattr(gaussians, name) for name in ATTRIBUTES if name != "sensitivity_logit"}
    values["sensitivity_logit"] = np.full(n, np.log(0.1 / 0.9), np.float32) if sensitivity is None else sensitivity
    if mask_logit is not None:
        values[MASK_LOGIT] = np.full(n, mask_logit, np.float32)
    values |= {name: getattr(motion, name) for name in FITTED_MOTION}
    values = {name: np.array(value, np.float32, order="C") for name, value in values.items()}
    state = TrainState(
        iteration=0,
        values=values,
        first={name: np.zeros_like(value) for name, value in values.items()},
        second={name: np.zeros_like(value) for name, value in values.items()},
        steps={"gaussians": 0, "motion": 0},
        binding=gaussians.binding.astype(np.int32),
        gradient_sum=np.zeros(n, np.float32),
        gradient_count=np.zeros(n, np.int32),
        thresholds=np.full(n_regions, threshold),
        ratios=np.full(n_regions, ratio),
    )
    lay_together(state)
    return state


def lay_together(state: TrainState) -> None:
    """Move what has a row a Gaussian to large pages, unless it lies there: every step goes through all of it."""
    kinds = state.values, state.first, state.second
    homes = {id(kind[name].base) for kind in kinds for name in ROWS if name in kind}
    if len(homes) == 1 and state.values["position"].base is not None:
        return
    moved = together({(k, name): kind[name] for k, kind in enumerate(kinds) for name in ROWS if name in kind})
    for (k, name), array in moved.items():
        kinds[k][name] = array


def rearrange(
    state: TrainState,
    rows: Int[np.ndarray, " m"],
    fresh: Bool[np.ndarray, " m"] | None = None,
    replaced: Arrays | None = None,
) -> None:
    """Make row `rows[i]` the new row i, then sort by triangle: the one place where Gaussians come and go.

    Attributes, both moments and the statistics move together. Motion parameters are known by name, so a run with as many timesteps as
    Gaussians is safe.

    Args:
        state: changed.
        rows: (m,) old row of each new one; repeated for children, absent for the removed.
        fresh: (m,) rows that start with moments of 0.
        replaced: new values of some attributes, (m, ...).
    """
    order = np.argsort(state.binding[rows], kind="stable")
    rows = rows[order]
    anew = np.flatnonzero(np.zeros(0, bool) if fresh is None else fresh[order])
    for name in (name for name in ROWS if name in state.values):
        given = None if replaced is None else replaced.get(name)
        state.values[name] = state.values[name].take(rows, axis=0) if given is None else given.take(order, axis=0)
        for moments in (state.first, state.second):
            moments[name] = moments[name].take(rows, axis=0)
            moments[name][anew] = 0
    lay_together(state)
    state.binding = state.binding[rows]
    state.gradient_sum = state.gradient_sum[rows]
    state.gradient_count = state.gradient_count[rows]
