"""The synthetic head as a head model."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int

from sacha_core.errors import OptionError
from sacha_core.flame.model import HeadModel
from sacha_core.flame.synthetic.anatomy import Anatomy, assemble
from sacha_core.flame.synthetic.correctives import pose_directions
from sacha_core.flame.synthetic.expressions import EXPRESSIONS, expression_directions
from sacha_core.flame.synthetic.identity import identity_directions
from sacha_core.flame.synthetic.masks import region_masks
from sacha_core.flame.synthetic.sizes import size_named
from sacha_core.flame.synthetic.skinning import PARENTS, joint_regressor, skinning_weights

__all__ = ["head_parts", "synthetic_head"]

# Lengths are multiples of 2^-20 m, about a micrometre, and weights of 2^-20: the last bits in which machines' libraries differ are gone
# before the digest is taken.
LENGTH_STEP = 2.0**-20
WEIGHT_STEP = 2.0**-20
PERSON_SPREAD = 1.2  # standard deviations to which the identity of a seed's head is drawn, evenly


def synthetic_head(size: str = "full", seed: int = 0) -> HeadModel:
    """Make a head model out of nothing but code: FLAME's shape and joints, no data.

    Seed 0 is the mean head; another seed is another person, the same mesh and components about another template.

    Args:
        size: `full`, about FLAME's count of triangles, or `small`, a few hundred for tests.
        seed: which person, from 0.

    Returns:
        The head, named `synthetic-SIZE-SEED`; the same bytes on every machine.

    Raises:
        OptionError: there is no such size, or the seed is out of range.

    Source: own.
    """
    anatomy = _anatomy(size)
    shapedirs = _rounded(identity_directions(anatomy))
    template = _rounded(
        anatomy.vertices.astype(np.float64) + shapedirs.astype(np.float64) @ _person(seed, shapedirs.shape[2])
    )
    return HeadModel(
        name=f"synthetic-{size}-{seed}",
        v_template=template,
        faces=anatomy.faces,
        shapedirs=shapedirs,
        exprdirs=_rounded(expression_directions(anatomy)),
        J_regressor=_shares(joint_regressor(anatomy)),
        weights=_shares(skinning_weights(anatomy)),
        parents=PARENTS.copy(),
        posedirs=_rounded(pose_directions(anatomy)),
        uv=_rounded(anatomy.uv),
        uv_faces=anatomy.uv_faces,
        masks=region_masks(anatomy),
        n_teeth_faces=anatomy.n_teeth_faces,
        expression_names=EXPRESSIONS,
    )


def head_parts(size: str = "full") -> dict[str, Int[np.ndarray, " m"]]:
    """Name the finer parts of the synthetic head, below the regions: lid margins, rings of the lips, rows of teeth.

    Args:
        size: as for `synthetic_head`.

    Returns:
        Vertex indices by name: `skin`, `left_eyeball`, `right_eyeball` (front pole first), `upper_teeth`, `lower_teeth`, and rings from
        outside inwards such as `left_eye/margin`, `mouth/outline`, `mouth/slit`, `left_ear/rim`; rings run in order around their patch.

    Raises:
        OptionError: there is no such size.
    """
    return {name: ids.copy() for name, ids in _anatomy(size).parts.items()}


@lru_cache(maxsize=4)
def _anatomy(size: str) -> Anatomy:
    return assemble(size_named(size))


def _person(seed: int, n: int) -> Float[np.ndarray, " s"]:
    if not 0 <= seed < 2**64:
        raise OptionError(f"the seed of a synthetic head is {seed}; it must be from 0 to 2^64 - 1")
    if seed == 0:
        return np.zeros(n)
    # Raw words of Philox are the same in every version of numpy, which its distributions are not.
    words = np.random.Philox(key=seed).random_raw(n)
    return ((words >> np.uint64(11)).astype(np.float64) * 2.0**-52 - 1) * PERSON_SPREAD


def _rounded(lengths: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    return (np.round(lengths / LENGTH_STEP) * LENGTH_STEP + 0.0).astype(np.float32)


def _shares(weights: Float[np.ndarray, "n m"]) -> Float[np.ndarray, "n m"]:
    """Round weights to multiples of `WEIGHT_STEP` whose rows still sum to exactly 1: the largest of a row takes what is over."""
    steps = np.round(weights / WEIGHT_STEP)
    rows = np.arange(len(steps))
    steps[rows, np.argmax(steps, axis=1)] += 1 / WEIGHT_STEP - steps.sum(axis=1)
    return (steps * WEIGHT_STEP).astype(np.float32)
