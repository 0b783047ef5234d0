"""Where the features of an unposed head are, found from its official masks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from sacha_core.errors import HeadError
from sacha_core.flame.model import HeadModel

__all__ = ["Landmarks", "find_landmarks"]

NEEDED_MASKS = (
    "left_eyeball",
    "right_eyeball",
    "left_eye_region",
    "right_eye_region",
    "left_ear",
    "right_ear",
    "forehead",
    "lips",
    "nose",
    "scalp",
    "neck",
    "boundary",
)


@dataclass(frozen=True)
class Landmarks:
    """Features of one person's unposed head, metres.

    Args:
        eyes: (2, 3) centres of the eyeballs, left and then right.
        eye_radii: (2,) of the eyeballs.
        mouth: (3,) middle of the lips.
        nose: (3,) tip of the nose.
        spacing: distance between the eyes' centres, by which patterns on the skin are scaled.
        ears: (2, 3, 3) for each ear its lowest, middle and highest coordinates.
        lid_rims: for each eye the vertices along the edge of its lids.
        mouth_inside: (v,) vertices behind the lips.
        lid_inside: (v,) vertices of the lids' inner side.
        teeth: (v,) vertices of teeth.
    """

    eyes: Float[np.ndarray, "2 3"]
    eye_radii: Float[np.ndarray, " 2"]
    mouth: Float[np.ndarray, "3"]
    nose: Float[np.ndarray, "3"]
    spacing: float
    ears: Float[np.ndarray, "2 3 3"]
    lid_rims: tuple[Int[np.ndarray, " a"], Int[np.ndarray, " b"]]
    mouth_inside: Bool[np.ndarray, " v"]
    lid_inside: Bool[np.ndarray, " v"]
    teeth: Bool[np.ndarray, " v"]


def find_landmarks(head: HeadModel, vertices: Float[np.ndarray, "v 3"]) -> Landmarks:
    """Find the features of a person.

    Args:
        head: whose masks name them.
        vertices: (v, 3) unposed, metres.

    Raises:
        HeadError: the head lacks a mask that is needed.
    """
    missing = [name for name in NEEDED_MASKS if len(head.masks.get(name, ())) == 0]
    if missing:
        raise HeadError(f"head {head.name!r} has no mask {', '.join(missing)}: its appearance cannot be made up")
    balls = [vertices[head.masks[name]] for name in ("left_eyeball", "right_eyeball")]
    eyes = np.stack([(ball.min(axis=0) + ball.max(axis=0)) / 2 for ball in balls])
    radii = np.array([np.linalg.norm(ball - eye, axis=1).max() for ball, eye in zip(balls, eyes, strict=True)])
    nose = vertices[head.masks["nose"]]
    lips = vertices[head.masks["lips"]]
    spacing = float(np.linalg.norm(eyes[0] - eyes[1]))
    labelled = np.zeros(head.n_vertices, bool)
    for ids in head.masks.values():
        labelled[ids] = True
    teeth = np.zeros(head.n_vertices, bool)
    if head.n_teeth_faces:
        teeth[head.faces[-head.n_teeth_faces :]] = True
    mouth = lips.mean(axis=0)
    to_eyes = np.linalg.norm(vertices[:, None] - eyes, axis=2).min(axis=1)
    lid_inside = ~labelled & ~teeth & (to_eyes < 0.5 * spacing)
    return Landmarks(
        eyes,
        radii,
        mouth,
        nose[np.argmax(nose[:, 2])],
        spacing,
        np.stack([np.quantile(vertices[head.masks[name]], (0, 0.5, 1), axis=0) for name in ("left_ear", "right_ear")]),
        (
            lid_rim(head, head.masks["left_eye_region"], lid_inside),
            lid_rim(head, head.masks["right_eye_region"], lid_inside),
        ),
        ~labelled & ~teeth & (np.linalg.norm(vertices - mouth, axis=1) < np.minimum(to_eyes, 1.2 * spacing)),
        lid_inside,
        teeth,
    )


def lid_rim(head: HeadModel, region: Int[np.ndarray, " m"], inside: Bool[np.ndarray, " v"]) -> Int[np.ndarray, " b"]:
    """Give the vertices of an eye's region that border on the lids' inner side."""
    outside = np.zeros(head.n_vertices, bool)
    outside[region] = True
    bordering = head.faces[inside[head.faces].any(axis=1)]
    rim: np.ndarray = np.unique(bordering[outside[bordering]])
    return rim
