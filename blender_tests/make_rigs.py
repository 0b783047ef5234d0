"""Make heads whose controls are hard, and write down where the engine's own posing puts their vertices; runs in the engine's Python.

Usage: make_rigs.py FOLDER

`truth.npz`: `posed` (t, v, 3) of `hard.sacha`, frame by frame; parameters `dial_*` of `hard.npz`, what they make of nobody
(`dialled` (n, v, 3)) and of the person of `dial_shape` (`shaped`);
`arkit` (k, v, 3), the rig's shapes each at 1; `seen` (m, v, 2) pixels of the capture's last frame in each camera.
"""

from __future__ import annotations

import pickle
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh

import sacha_core
from sacha_core.flame.head_file import save_head
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import Poser, person_template
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.interchange.capture import write_head_reference
from sacha_core.interchange.capture_writer import CaptureWriter
from sacha_core.interchange.gaussian_avatars import write_flame_param, write_model
from sacha_core.raster.camera import Camera

SEED = 7
N_EXPRESSIONS = 70  # three parts to each sum of a joint
N_FRAMES, FRAME_RATE = 7, 30.0
N_DIALS = 6
BEYOND = 17.0  # a coefficient larger than any shape key's value
N_SHAPES = 5
SIZE = (64, 48)  # of the capture's pictures


def hard_head(rng: np.random.Generator) -> HeadModel:
    """Give a head whose joints all move with expressions, and whose every pose entry corrects every vertex."""
    head = synthetic_head("small")
    regressor = rng.random(head.J_regressor.shape) ** 30
    return replace(
        head,
        name="hard",
        exprdirs=rng.normal(0, 5e-4, (head.n_vertices, 3, N_EXPRESSIONS)).astype(np.float32),
        expression_names=(),
        J_regressor=(regressor / regressor.sum(axis=1, keepdims=True)).astype(np.float32),
        posedirs=rng.normal(0, 1e-3, (head.n_vertices, 3, 36)).astype(np.float32),
        uv=None,
        uv_faces=None,
    )


def moving(head: HeadModel, n_frames: int, rng: np.random.Generator) -> sacha_core.Motion:
    """Give a motion of everything at once."""
    rest = sacha_core.Motion.rest(head.shapedirs.shape[2], head.exprdirs.shape[2], n_frames, FRAME_RATE)
    turns = {
        name: rng.normal(0, 0.5, getattr(rest, name).shape).astype(np.float32)
        for name in ("rotation", "neck", "jaw", "eyes", "translation")
    }
    expression = rng.normal(0, 1.5, rest.expression.shape).astype(np.float32)
    return replace(rest, shape=rng.normal(0, 1, rest.shape.shape).astype(np.float32), expression=expression, **turns)


def posed(head: HeadModel, motion: sacha_core.Motion) -> np.ndarray:
    """Give every frame in double precision."""
    poser = Poser(head, motion, np.float64)
    return np.stack([poser(frame) for frame in range(len(motion))])


def write_capture(folder: Path, head: HeadModel, head_file: Path, motion: sacha_core.Motion) -> list[Camera]:
    """Write a capture by cameras with principal points far from the middle."""
    width, height = SIZE
    cameras = []
    for turn, (cx, cy) in zip((-0.6, 0.0, 0.7), ((30.0, 20.0), (41.5, 30.25), (25.0, 27.0)), strict=True):
        eye = np.array([np.sin(turn), 0.1 + 0.2 * turn, np.cos(turn)])
        camera = Camera.look_at(eye, np.array([0.0, 0.02, 0.0]), width, height, 130.0)
        cameras.append(replace(camera, cx=cx, cy=cy))
    writer = CaptureWriter(folder, "anna", head.reference, head_file, validation_camera=1)
    sequences = []
    for name, frames in (("EMO-1", slice(0, 2)), ("EMO-2", slice(2, 3))):
        sequence = writer.sequence(name, motion.frames(frames), range(len(cameras)))
        for timestep in range(frames.stop - frames.start):
            for index, camera in enumerate(cameras):
                white, inside = np.full((height, width, 3), 255, np.uint8), np.zeros((height, width), np.uint8)
                sequence.add(timestep, index, camera, white, inside)
        sequence.finish()
        sequences.append(sequence)
    writer.finish(train=sequences[:1], test=sequences[1:])
    return cameras


def seen(camera: Camera, points: np.ndarray) -> np.ndarray:
    """Project points to pixels."""
    x, y, z = (points @ camera.rotation.T + camera.translation).T
    return np.stack([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy], axis=1)


def write_pickle(path: Path, head: HeadModel) -> None:
    """Write a head as FLAME's authors would: 300 identity directions and then expressions."""
    identity = np.zeros((head.n_vertices, 3, 300))
    content = {
        "v_template": head.v_template.astype(np.float64),
        "f": head.faces.astype(np.uint32),
        "shapedirs": np.concatenate([identity, head.exprdirs], axis=2),
        "posedirs": head.posedirs.astype(np.float64),
        "J_regressor": head.J_regressor.astype(np.float64),
        "weights": head.weights.astype(np.float64),
        "kintree_table": np.stack([head.parents, np.arange(5)]).astype(np.int64),
    }
    path.write_bytes(pickle.dumps(content, protocol=2))


def main(folder: Path) -> None:
    """Write everything into `folder`."""
    rng = np.random.default_rng(SEED)
    head = hard_head(rng)
    save_head(head, folder / "hard.npz")
    motion = moving(head, N_FRAMES, rng)
    motion.expression[4, 3] = BEYOND
    gaussians = sacha_core.initial_gaussians(head.n_faces, rng, sh_degree=0)
    avatar = sacha_core.Avatar(gaussians, head.reference, motion)
    (folder / "hard.sacha").write_bytes(sacha_core.encode(avatar, level=2, head=head))
    decoded = sacha_core.decode(folder / "hard.sacha", head=head).motion
    write_model(folder / "model", 30, gaussians, motion)
    write_head_reference(folder / "model", head.reference)
    write_pickle(folder / "flame.pkl", head)
    # One vertex for each corner of each triangle: what an exporter does where every edge is a seam.
    split = trimesh.Trimesh(corners(head), np.arange(head.faces.size).reshape(-1, 3), process=False)
    split.export(folder / "split.glb")

    dials = moving(head, N_DIALS, rng)
    deltas = rng.normal(0, 2e-3, (N_SHAPES, head.n_vertices, 3)).astype(np.float32)
    names = np.array(["jawOpen", "eyeBlinkLeft", "mouthSmile_L", "browInnerUp", "cheekPuff"])
    np.savez(folder / "arkit.npz", verts=head.v_template, faces=head.faces, arkit_deltas=deltas, arkit_names=names)
    captured = moving(head, 3, rng)
    write_flame_param(folder / "other.npz", captured)
    cameras = write_capture(
        folder / "capture", head, folder / "hard.npz", replace(captured, translation=0 * captured.translation)
    )
    last = posed(head, replace(captured, translation=0 * captured.translation))[-1]
    np.savez(
        folder / "truth.npz",
        posed=posed(head, decoded),
        model_posed=posed(head, motion),
        **{
            f"dial_{name}": getattr(dials, name)
            for name in ("shape", "expression", "rotation", "neck", "jaw", "eyes", "translation")
        },
        dialled=posed(head, replace(dials, shape=np.zeros_like(dials.shape))),
        shaped=posed(head, dials),
        somebody=person_template(head, dials)[0],
        arkit=head.v_template + deltas,
        other=posed(head, replace(captured, shape=decoded.shape)),
        last=last,
        seen=np.stack([seen(camera, last) for camera in cameras]),
        faces=head.faces,
        template=head.v_template,
    )


def corners(head: HeadModel) -> np.ndarray:
    """Give the place of each corner of each triangle."""
    return head.v_template[head.faces].reshape(-1, 3)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
