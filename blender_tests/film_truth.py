"""Hold a filmed dataset against the engine's own geometry; runs in the engine's Python.

Usage: film_truth.py DATASET OUT.json

For each picture, a triangle at a time, which pixels have their centre inside the posed head as the dataset's parameters and cameras put it;
and how many pixels of the mask say otherwise. The parameters go out, too.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from PIL import Image

from sacha_core.flame.open import open_head
from sacha_core.flame.posing import Poser
from sacha_core.interchange.capture import read_capture


def silhouette(camera, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Give (h, w) whether each pixel's centre lies in any triangle, by the signs of its three edges."""
    seen = vertices @ camera.rotation.T + camera.translation
    x = camera.fx * seen[:, 0] / seen[:, 2] + camera.cx
    y = camera.fy * seen[:, 1] / seen[:, 2] + camera.cy
    inside = np.zeros((camera.height, camera.width), bool)
    for corners in faces:
        u, v = x[corners], y[corners]
        left, right = max(int(u.min()), 0), min(int(u.max()) + 1, camera.width)
        top, bottom = max(int(v.min()), 0), min(int(v.max()) + 1, camera.height)
        px, py = np.meshgrid(np.arange(left, right) + 0.5, np.arange(top, bottom) + 0.5)
        sides = [(u[(i + 1) % 3] - u[i]) * (py - v[i]) - (v[(i + 1) % 3] - v[i]) * (px - u[i]) for i in range(3)]
        covered = np.logical_and.reduce([side >= 0 for side in sides]) | np.logical_and.reduce([s <= 0 for s in sides])
        inside[top:bottom, left:right] |= covered
    return inside


def main(dataset: Path, out: Path) -> None:
    """Compare, and write what was found."""
    capture = read_capture(dataset)
    head = open_head(str(capture.head_path))
    poser = Poser(head, capture.motion)
    pictures = []
    for split in ("train", "val", "test"):
        for view in getattr(capture, split):
            truth = silhouette(view.camera, poser(view.timestep), head.faces)
            mask = np.asarray(Image.open(view.mask_path)) > 127
            picture = {"split": split, "timestep": view.timestep, "camera": view.camera_index}
            picture |= {"covered": int(truth.sum()), "wrong": int((truth != mask).sum())}
            outside = capture.image(view)[~mask & (np.asarray(Image.open(view.mask_path)) == 0)]
            pictures.append(picture | {"white_outside": bool((outside == 255).all())})
    motion = capture.motion
    names = ("shape", "expression", "neck", "jaw", "eyes", "rotation", "translation")
    told = {name: getattr(motion, name).tolist() for name in names}
    told |= {"n_offsets": len(motion.static_offset), "frame_rate": motion.frame_rate, "pictures": pictures}
    out.write_text(json.dumps(told))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
