"""One sitting of an artist, from opening an avatar to the file that leaves: what the add-on is for, played by its operators alone.

Run by `test_session.py` with a small avatar; by hand with any, in a Blender that has the add-on installed and its engine named:

    blender --python blender_tests/session.py -- AVATAR.sacha FOLDER TARGET_KB [HEAD [MASKS]]
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import bpy
import numpy as np

sys.path.append(str(Path(__file__).parent))

from pictures import look_at, render

__all__ = ["Sitting", "play"]

FRONT = (0.25, -1.0, 0.1)


@dataclass
class Sitting:
    """What is asked for, and what came of it.

    Args:
        source: the avatar.
        folder: where pictures and files go.
        target_kb: largest size of the steered file, in thousands of bytes.
        favoured: the region whose weight is raised.
        weight: to what.
        size: of the pictures, pixels each way.
        score_views: pictures from which it is told what each Gaussian is worth.
        pictures: by the name of the view, (h, w, 4) bytes.
        seconds: by step, how long it took.
        told: figures by name.
    """

    source: Path
    folder: Path
    target_kb: float
    favoured: str = "mouth"
    weight: float = 2.0
    size: int = 160
    score_views: int = 16
    pictures: dict[str, np.ndarray] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    told: dict[str, Any] = field(default_factory=dict)


def play(sitting: Sitting) -> Sitting:
    """Play the sitting from the first step to the last; give it with what came of it."""
    steps = (open_avatar, switch_every_view, apply_neutral, apply_weighted, preview, save_and_reload, encode, decode)
    for step in steps:
        start = time.perf_counter()
        step(sitting)
        sitting.seconds[step.__name__] = time.perf_counter() - start
    return sitting


def shown() -> bpy.types.Object:
    """Give the avatar's mesh."""
    return next(one for one in bpy.data.objects if one.type == "MESH" and one.data.sacha.kind == "avatar")


def open_avatar(sitting: Sitting) -> None:
    """Open it, and look at it."""
    bpy.ops.sacha.open(filepath=str(sitting.source))
    look_at(shown(), sitting.size, FRONT, flat=False)
    sitting.told["facts"] = [fact.name for fact in shown().data.sacha.facts]


def switch_every_view(sitting: Sitting) -> None:
    """Show every view there is, by triangle and by region, and take a picture of each."""
    seen = shown().data.sacha
    for by in ("TRIANGLE", "REGION"):
        seen.by = by
        for view in seen.views:
            seen.view = view.name.upper()
            name = view.name if by == "TRIANGLE" else f"{view.name} by region"
            sitting.pictures[name] = render(sitting.folder / f"{name.replace(' ', '_')}.png")
    seen.by, seen.view = "TRIANGLE", "COUNT"


def apply_neutral(sitting: Sitting) -> None:
    """Cut it down to the size with every region worth what was measured."""
    sitting.told["neutral"] = applied(sitting, "neutral.sacha", "")


def apply_weighted(sitting: Sitting) -> None:
    """Cut the same avatar down to the same size with one region worth more."""
    sitting.told["weighted"] = applied(sitting, "weighted.sacha", f"{sitting.favoured}={sitting.weight:g}")
    sitting.pictures["steered"] = render(sitting.folder / "steered.png")


def applied(sitting: Sitting, name: str, weights: str) -> dict[str, Any]:
    """Apply a budget; give the file's bytes and each region's Gaussians and bytes, as the mesh tells them."""
    shown().data.sacha_steering.views = sitting.score_views
    bpy.ops.sacha.apply_budget(filepath=str(sitting.folder / name), target_kb=sitting.target_kb, weights=weights)
    rows, n_bytes = shown().data.sacha.regions, (sitting.folder / name).stat().st_size
    gaussians, spent = {row.name: row.gaussians for row in rows}, {row.name: row.n_bytes for row in rows}
    return {"n_bytes": n_bytes, "gaussians": gaussians, "spent": spent}


def preview(sitting: Sitting) -> None:
    """Let the engine draw it from the scene's camera, at a level, with its error."""
    bpy.context.scene.camera.data.type = "PERSP"
    bpy.ops.sacha.render_preview(level="FILE", error="DIFFERENCE", against=str(sitting.source))
    for name in ("Preview", "Error"):
        image = bpy.data.images[f"SACHA {name}"]
        width, height = image.size
        pixels = np.empty(width * height * image.channels, np.float32)
        image.pixels.foreach_get(pixels)
        sitting.pictures[name.lower()] = pixels.reshape(height, width, image.channels)
        image.save(filepath=str(sitting.folder / f"{name.lower()}.png"))


def save_and_reload(sitting: Sitting) -> None:
    """Save the .blend, open it again, and look whether everything is there."""
    before = state(sitting)
    path = str(sitting.folder / "sitting.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path, check_existing=False)
    bpy.ops.wm.open_mainfile(filepath=path)
    sitting.told["before reload"], sitting.told["after reload"] = before, state(sitting)


def state(sitting: Sitting) -> dict[str, Any]:
    """Give what a .blend must keep."""
    mesh = shown().data
    return {
        "source": mesh.sacha.source,
        "view": mesh.sacha.view,
        "views": [view.name for view in mesh.sacha.views],
        "gaussians": {row.name: row.gaussians for row in mesh.sacha.regions},
        "weight": round(mesh.sacha_steering.regions[sitting.favoured].weight, 6),
        "keys": len(mesh.shape_keys.key_blocks) if mesh.shape_keys else 0,
    }


def encode(sitting: Sitting) -> None:
    """Write what is shown at the lowest level."""
    bpy.context.scene.sacha.level = 1
    bpy.ops.sacha.encode(filepath=str(sitting.folder / "encoded.sacha"))
    sitting.told["encoded bytes"] = (sitting.folder / "encoded.sacha").stat().st_size


def decode(sitting: Sitting) -> None:
    """Turn that back into splats."""
    target = sitting.folder / "decoded.ply"
    bpy.ops.sacha.decode(source=str(sitting.folder / "encoded.sacha"), filepath=str(target))
    header = target.read_bytes().partition(b"end_header")[0].decode()
    sitting.told["decoded"] = int(header.partition("element vertex ")[2].split()[0])


def main(arguments: list[str]) -> None:
    """Play a sitting with the files named on the command line, and print what came of it."""
    source, folder, target_kb, *heads = arguments
    for name, path in zip(("head", "masks"), heads, strict=False):
        setattr(bpy.context.scene.sacha, name, path)
    sitting = play(Sitting(Path(source), Path(folder), float(target_kb), size=720))
    for name, value in {**sitting.told, "seconds": sitting.seconds}.items():
        print(f"{name}: {value}")  # noqa: T201


if __name__ == "__main__":
    main(sys.argv[sys.argv.index("--") + 1 :])
