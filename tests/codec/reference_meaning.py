"""What decoded arrays mean, in plain NumPy, written from FORMAT.md alone: "What the arrays mean"."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

import sacha_core.codec
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.avatar.motion import Motion
from sacha_core.flame.model import HeadModel

PAGE = (Path(sacha_core.codec.__file__).parent / "FORMAT.md").read_text(encoding="utf-8")
MEANING = PAGE.split("## What the arrays mean\n")[1].split("\n## ")[0]
CONSTANT = 0.28209479177387814


def rotation_of(quaternion: np.ndarray) -> np.ndarray:
    """The matrix of a quaternion of any length."""
    w, x, y, z = quaternion / np.sqrt(sum(one * one for one in quaternion))
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


def frame_of(p0: np.ndarray, p1: np.ndarray, p2: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
    """Frame of a triangle: rotation, scale, origin."""
    e = p1 - p0
    m = np.cross(e, p2 - p0)
    first, second = e / np.linalg.norm(e), m / np.linalg.norm(m)
    rotation = np.stack([first, second, np.cross(first, second)], axis=1)
    scale = (np.linalg.norm(e) + np.linalg.norm(m) / np.linalg.norm(e)) / 2
    return rotation, float(scale), (p0 + p1 + p2) / 3


def placed(gaussians: Gaussians, posed: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, ...]:
    """Means, standard deviations, the matrices along whose columns they are, and opacities."""
    means, deviations, axes = [], [], []
    for row, face in enumerate(gaussians.binding):
        rotation, k, origin = frame_of(*posed[faces[face]])
        means.append(origin + k * rotation @ gaussians.position[row].astype(float))
        deviations.append(k * np.exp(gaussians.log_scale[row].astype(float)))
        axes.append(rotation @ rotation_of(gaussians.quaternion[row].astype(float)))
    opacities = 1 / (1 + np.exp(-gaussians.opacity_logit.astype(float)))
    return np.array(means), np.array(deviations), np.array(axes), opacities


def functions_of(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> list[np.ndarray]:
    """The functions of degree 1 to 3, computed as the page prints them."""
    values = []
    for row in re.findall(r"^\| [123] \| (.*) \|$", MEANING, flags=re.MULTILINE):
        for printed in row.split(", "):
            product = re.sub(r"(?<=[\w.)]) (?=[\w(])", " * ", printed)
            values.append(eval(product, {"__builtins__": {}}, {"x": x, "y": y, "z": z}))  # noqa: S307 (the page's own text)
    return values


def colours_of(gaussians: Gaussians, means: np.ndarray, camera: np.ndarray) -> np.ndarray:
    """Colours as a camera sees them."""
    away = means - camera
    functions = functions_of(*(away / np.linalg.norm(away, axis=1, keepdims=True)).T)
    total = gaussians.sh_dc.astype(float) * CONSTANT
    for i in range(gaussians.sh_rest.shape[1]):
        total += functions[i][:, None] * gaussians.sh_rest[:, i].astype(float)
    return np.maximum(total + 0.5, 0)


def turn_of(r: np.ndarray) -> np.ndarray:
    """Step 3: the matrix of a rotation vector."""
    x, y, z = r
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.linalg.norm(r + 1e-8)
    return np.eye(3) + np.sin(angle) / angle * k + (1 - np.cos(angle)) / angle**2 * (k @ k)


def posed_vertices(head: HeadModel, motion: Motion, frame: int) -> np.ndarray:
    """Vertices of the posed head."""
    expressed = head.v_template.astype(float)
    for i, coefficient in enumerate(motion.shape):
        expressed += float(coefficient) * head.shapedirs[..., i].astype(float)
    if len(motion.static_offset):
        expressed += motion.static_offset
    for i, coefficient in enumerate(motion.expression[frame]):
        expressed += float(coefficient) * head.exprdirs[..., i].astype(float)
    joints = head.J_regressor.astype(float) @ expressed
    vectors = [motion.rotation[frame], motion.neck[frame], motion.jaw[frame]]
    vectors += [motion.eyes[frame][:3], motion.eyes[frame][3:]]
    turns = [turn_of(vector.astype(float)) for vector in vectors][: len(joints)]
    corrected = expressed.copy()
    if head.posedirs is not None:
        numbers = [number for turn in turns[1:] for number in (turn - np.eye(3)).ravel()]
        for i, number in enumerate(numbers):
            corrected += number * head.posedirs[..., i].astype(float)
    posed = np.zeros_like(corrected)
    for j in range(len(joints)):
        moved, at = corrected, j
        while at >= 0:
            moved = (moved - joints[at]) @ turns[at].T + joints[at]
            at = int(head.parents[at])
        posed += head.weights[:, j, None].astype(float) * moved
    return posed + motion.translation[frame]
