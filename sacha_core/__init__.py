"""SACHA: semantic-aware compression of animatable 3D Gaussian head avatars.

The front door: the names a program needs to open, pose, measure, compress and draw an avatar. Each is loaded when first used,
so that `import sacha_core` costs no more than importing NumPy does; none of them needs torch.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sacha_core.avatar.avatar import Avatar
    from sacha_core.avatar.binding import initial_gaussians
    from sacha_core.avatar.gaussians import Gaussians
    from sacha_core.avatar.motion import Motion
    from sacha_core.codec import Decoder, Encoder, decode, encode, inspect
    from sacha_core.errors import SachaError
    from sacha_core.flame.model import HeadModel
    from sacha_core.flame.open import open_head
    from sacha_core.flame.posing import pose_vertices
    from sacha_core.geometry.triangle import triangle_frames
    from sacha_core.raster.camera import Camera
    from sacha_core.raster.scene import render_avatar
    from sacha_core.regions.labels import label_triangles, region_counts

__version__ = "0.1.0"

__all__ = [
    "Avatar",
    "Camera",
    "Decoder",
    "Encoder",
    "Gaussians",
    "HeadModel",
    "Motion",
    "SachaError",
    "decode",
    "encode",
    "initial_gaussians",
    "inspect",
    "label_triangles",
    "open_head",
    "pose_vertices",
    "region_counts",
    "render_avatar",
    "triangle_frames",
]

_HOMES = {
    "Avatar": "avatar.avatar",
    "Camera": "raster.camera",
    "Decoder": "codec",
    "Encoder": "codec",
    "Gaussians": "avatar.gaussians",
    "HeadModel": "flame.model",
    "Motion": "avatar.motion",
    "SachaError": "errors",
    "decode": "codec",
    "encode": "codec",
    "initial_gaussians": "avatar.binding",
    "inspect": "codec",
    "label_triangles": "regions.labels",
    "open_head": "flame.open",
    "pose_vertices": "flame.posing",
    "region_counts": "regions.labels",
    "render_avatar": "raster.scene",
    "triangle_frames": "geometry.triangle",
}


def __getattr__(name: str) -> Any:
    """Load a name of the front door from where it lives."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """List the front door."""
    return sorted({*globals(), *__all__})
