"""The parts put together: where each vertex lies and which part of the head it is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from sacha_core.flame.synthetic.ears import ear_rings
from sacha_core.flame.synthetic.eyes import eyeball, lid_rings
from sacha_core.flame.synthetic.layout import Part, Skin, lay_out_skin
from sacha_core.flame.synthetic.loft import loft
from sacha_core.flame.synthetic.mouth import lip_rings, tooth_row
from sacha_core.flame.synthetic.relief import relief
from sacha_core.flame.synthetic.sizes import Size

__all__ = ["Anatomy", "assemble"]

MIRROR = np.array([-1.0, 1.0, 1.0])


@dataclass(frozen=True)
class Anatomy:
    """The unposed head in full precision, with the names of its parts.

    Args:
        size: resolution.
        skin: topology of the skin, whose vertices come first.
        vertices: (v, 3) metres.
        angle_rad: (v,) around the head on the loft; 0 off the skin.
        height: (v,) height parameter on the loft; 0 off the skin.
        faces: (f, 3), those of the teeth last.
        uv: (u, 2).
        uv_faces: (f, 3).
        parts: vertices by name: `left_eyeball`, `right_eyeball`, `upper_teeth`, `lower_teeth`, `skin`, and every ring of every patch as
            `left_eye/margin`, `mouth/slit`, ... in the order of the patch's `turn_rad`, its closing point as `left_eye/cap`.
        n_teeth_faces: how many of the last triangles are teeth.
    """

    size: Size
    skin: Skin
    vertices: Float[np.ndarray, "v 3"]
    angle_rad: Float[np.ndarray, " v"]
    height: Float[np.ndarray, " v"]
    faces: Int[np.ndarray, "f 3"]
    uv: Float[np.ndarray, "u 2"]
    uv_faces: Int[np.ndarray, "f 3"]
    parts: dict[str, Int[np.ndarray, " m"]]
    n_teeth_faces: int


def assemble(size: Size) -> Anatomy:
    """Build the mean head at a resolution.

    Args:
        size: resolution.

    Returns:
        The head's mesh and the names of its parts.

    Source: own.
    """
    skin = lay_out_skin(size)
    chart = _chart(skin)
    vertices = np.zeros((skin.n_vertices, 3))
    on_grid = np.unique(skin.grid[skin.grid >= 0])
    base = loft(chart[on_grid, 0], chart[on_grid, 1])
    vertices[on_grid] = base + relief(base)
    _place_patches(size, skin, vertices, chart)
    parts = _ring_names(size, skin)
    parts["skin"] = np.arange(skin.n_vertices, dtype=np.int32)

    left = eyeball(size)
    right = Part(left.vertices * MIRROR, left.faces[:, ::-1].copy(), left.uv, left.uv_faces[:, ::-1].copy())
    pieces = {
        "left_eyeball": left,
        "right_eyeball": right,
        "upper_teeth": tooth_row(size, True),
        "lower_teeth": tooth_row(size, False),
    }
    faces, uv_faces = [skin.faces], [skin.uv_faces]
    places, uv = [vertices], [skin.uv * _SKIN_BOX[1] + _SKIN_BOX[0]]
    n, n_uv = skin.n_vertices, len(skin.uv)
    for name, piece in pieces.items():
        parts[name] = n + np.arange(len(piece.vertices), dtype=np.int32)
        places.append(piece.vertices)
        faces.append(piece.faces + n)
        uv.append(piece.uv * _UV_BOXES[name][1] + _UV_BOXES[name][0])
        uv_faces.append(piece.uv_faces + n_uv)
        n, n_uv = n + len(piece.vertices), n_uv + len(piece.uv)
    off_skin = np.zeros((n - skin.n_vertices, 2))
    chart = np.concatenate([chart, off_skin])
    return Anatomy(
        size=size,
        skin=skin,
        vertices=np.concatenate(places),
        angle_rad=chart[:, 0],
        height=chart[:, 1],
        faces=np.concatenate(faces).astype(np.int32),
        uv=np.concatenate(uv),
        uv_faces=np.concatenate(uv_faces).astype(np.int32),
        parts=parts,
        n_teeth_faces=len(pieces["upper_teeth"].faces) + len(pieces["lower_teeth"].faces),
    )


# Origin and extent of each piece in the texture: the skin above, eyeballs and teeth in a strip below.
_SKIN_BOX = (np.array([0.005, 0.255]), np.array([0.99, 0.74]))
_UV_BOXES = {
    "left_eyeball": (np.array([0.125, 0.125]), np.array([0.118, 0.118])),
    "right_eyeball": (np.array([0.375, 0.125]), np.array([0.118, 0.118])),
    "upper_teeth": (np.array([0.505, 0.130]), np.array([0.49, 0.11])),
    "lower_teeth": (np.array([0.505, 0.010]), np.array([0.49, 0.11])),
}


def _chart(skin: Skin) -> Float[np.ndarray, "v 2"]:
    """Angle and height of every vertex of the skin; rings of a patch shrink evenly to its middle."""
    chart = np.zeros((skin.n_vertices, 2))
    rows, columns = np.nonzero(skin.grid >= 0)
    chart[skin.grid[rows, columns]] = np.stack([skin.angle_rad[columns], skin.height[rows]], axis=1)
    chart[0] = 0.0, 0.0
    for patch in skin.patches.values():
        border = chart[patch.rings[0]]
        middle = (border.min(axis=0) + border.max(axis=0)) / 2
        n = len(patch.rings)
        for k in range(1, n):
            chart[patch.rings[k]] = middle + (border - middle) * (1 - k / n)
        chart[patch.cap] = middle
    return chart


def _place_patches(size: Size, skin: Skin, vertices: Float[np.ndarray, "v 3"], chart: Float[np.ndarray, "v 2"]) -> None:
    for name in ("left_eye", "mouth", "left_ear"):
        patch = skin.patches[name]
        loop = patch.rings[0]
        if name == "left_ear":
            rings, cap = ear_rings(size, chart[loop], patch.turn_rad)
        elif name == "mouth":
            rings, cap = lip_rings(size, vertices[loop], chart[loop], patch.turn_rad)
        else:
            rings, cap = lid_rings(size, vertices[loop], chart[loop], patch.turn_rad)
        vertices[patch.rings[1:]] = rings
        vertices[patch.cap] = cap
        if name != "mouth":
            other = skin.patches[name.replace("left", "right")]
            vertices[other.rings[1:]] = rings * MIRROR
            vertices[other.cap] = cap * MIRROR


def _ring_names(size: Size, skin: Skin) -> dict[str, Int[np.ndarray, " m"]]:
    of_patch = {"left_eye": size.eye_rings, "right_eye": size.eye_rings, "mouth": size.mouth_rings}
    of_patch |= {"left_ear": size.ear_rings, "right_ear": size.ear_rings}
    parts = {}
    for patch_name, names in of_patch.items():
        patch = skin.patches[patch_name]
        for name, ring in zip(names, patch.rings[1:], strict=True):
            parts[f"{patch_name}/{name}"] = ring
        parts[f"{patch_name}/cap"] = np.array([patch.cap], np.int32)
    return parts
