"""Gaussians in the world as glTF with the extension KHR_gaussian_splatting, the Khronos Group's way to put splats on the web."""

from __future__ import annotations

import os

import numpy as np
from jaxtyping import Float

from sacha_core.avatar.binding import sigmoid
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.errors import FormatError
from sacha_core.geometry import quaternion
from sacha_core.interchange.glb import Glb

__all__ = ["EXTENSION", "write_gltf_splats"]

EXTENSION = "KHR_gaussian_splatting"
POINTS = 0  # the primitive's mode
SH_0 = 0.28209479177387814  # the harmonic of degree 0


def write_gltf_splats(path: str | os.PathLike[str], gaussians: Gaussians) -> None:
    """Write Gaussians as one point primitive of a binary glTF file.

    Everything is float32 and as drawn: linear standard deviations, opacities from 0 to 1, unit quaternions in glTF's order xyzw, and the
    harmonics' own coefficients, which 3D Gaussian Splatting and the extension sign alike. glTF's axes are the head's: metres, y up, z
    forward. Viewers that do not know the extension draw coloured points.

    Args:
        path: the `.glb` file.
        gaussians: at least one, in metres of the world; their binding is not written.

    Raises:
        FormatError: there is no Gaussian, or one has no size that float32 can hold.
        OSError: the file cannot be written.

    Source: Khronos Group, KHR_gaussian_splatting, the ellipse kernel.
    """
    if not len(gaussians):
        raise FormatError("there are no Gaussians; glTF keeps no empty arrays")
    with np.errstate(over="ignore"):
        scales = np.exp(gaussians.log_scale)
    if not np.isfinite(scales).all():
        row = int(np.argmin(np.isfinite(scales).all(axis=1)))
        raise FormatError(
            f"Gaussian {row} is larger than float32 can hold: log scale {gaussians.log_scale[row].max():g}"
        )
    opacities = sigmoid(gaussians.opacity_logit)
    glb = Glb()
    splat = {
        "ROTATION": quaternion.normalise(gaussians.quaternion)[:, [1, 2, 3, 0]],
        "SCALE": scales,
        "OPACITY": opacities,
        "SH_DEGREE_0_COEF_0": gaussians.sh_dc,
    }
    for degree in range(1, gaussians.sh_degree + 1):
        for order in range(2 * degree + 1):
            splat[f"SH_DEGREE_{degree}_COEF_{order}"] = gaussians.sh_rest[:, degree**2 - 1 + order]
    attributes = {
        "POSITION": glb.add_vertices(_float32(gaussians.position), bounds=True),
        "COLOR_0": glb.add_vertices(_float32(_point_colours(gaussians, opacities))),
    }
    attributes |= {f"{EXTENSION}:{name}": glb.add_vertices(_float32(array)) for name, array in splat.items()}
    facts = {
        "kernel": "ellipse",
        "colorSpace": "srgb_rec709_display",
        "projection": "perspective",
        "sortingMethod": "cameraDistance",
    }
    primitive = {"attributes": attributes, "mode": POINTS, "extensions": {EXTENSION: facts}}
    glb.document |= {
        "extensionsUsed": [EXTENSION],
        "nodes": [{"name": "avatar", "mesh": 0}],
        "meshes": [{"name": "gaussians", "primitives": [primitive]}],
    }
    glb.write(path)


def _point_colours(gaussians: Gaussians, opacities: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 4"]:
    """Give the colours of viewers that draw points: of degree 0 alone, linear as glTF's vertex colours are, with the opacity."""
    srgb = np.clip(gaussians.sh_dc * SH_0 + 0.5, 0, 1)
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)  # IEC 61966-2-1
    return np.concatenate([linear, opacities[:, None]], axis=1)


def _float32(array: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(array, np.float32)
