"""Make what the Blender tests open, and write down what the engine's own functions say of it; runs in the engine's Python.

Usage: make_material.py FOLDER

`truth.npz`: `vertices` of the avatar's person, `faces`, `labels`, `count`, `region_srgb` (r, 3) uint8, `count_linear` (f, 4),
`mesh_vertices` of the OBJ and PLY.
`seen.npz`: for each view of scored.sacha against other.sacha its numbers (NAME) and the sRGB bytes of every triangle, by its own number
(NAME_triangle) and by its region's (NAME_region).
`told.json`: the regions in order, the number of Gaussians of each, and the head's name.
"""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh

import sacha_core
from sacha_core.cli.common import HeadSource
from sacha_core.cli.scene import Extras, open_scene
from sacha_core.density.events import Calibration
from sacha_core.density.scores_file import Scores, write_scores
from sacha_core.flame.head_file import save_head
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import person_template
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.interchange.splat_ply import write_bound_ply
from sacha_core.regions.scheme import PAPER
from sacha_core.scene.palettes import palette_bytes

SEED = 20
N_FRAMES = 3
LARGEST_COUNT = 40
CALIBRATED = {"modulator": (0.5, 2.0), "threshold": (1e-4, 4e-4), "ratio": (0.1, 0.6)}
KEPT = 0.7  # of the avatar, in the one that it is compared with
STRANGERS_SIZE = np.float32(1.01)  # another head than the one its avatar could be opened with by name


def make_avatar(head: HeadModel, rng: np.random.Generator) -> sacha_core.Avatar:
    """Give an avatar whose triangles carry from none to many Gaussians, of a person who is not the mean."""
    count = (LARGEST_COUNT * rng.random(head.n_faces) ** 4).astype(int)
    gaussians = sacha_core.initial_gaussians(head.n_faces, rng, sh_degree=0)
    gaussians = gaussians.select(np.repeat(np.arange(head.n_faces), count))
    return sacha_core.Avatar(fill(gaussians, rng), head.reference, moving(head, N_FRAMES, rng))


def fill(gaussians: sacha_core.Gaussians, rng: np.random.Generator) -> sacha_core.Gaussians:
    """Give Gaussians of every size, colour and opacity."""
    spread = {
        "position": (0.0, 0.5),
        "log_scale": (-1.5, 0.5),
        "quaternion": (0.0, 1.0),
        "opacity_logit": (2.0, 1.0),
        "sh_dc": (0.0, 1.0),
    }
    return replace(
        gaussians,
        **{name: rng.normal(*law, getattr(gaussians, name).shape).astype(np.float32) for name, law in spread.items()},
    )


def moving(head: HeadModel, n_frames: int, rng: np.random.Generator) -> sacha_core.Motion:
    """Give a motion of a person who is not the mean."""
    motion = sacha_core.Motion.rest(head.shapedirs.shape[2], head.exprdirs.shape[2], n_frames)
    shape = rng.normal(0, 1, motion.shape.shape).astype(np.float32)
    expression = rng.normal(0, 0.5, motion.expression.shape).astype(np.float32)
    return replace(motion, shape=shape, expression=expression)


def write_meshes(folder: Path, head: HeadModel, vertices: np.ndarray) -> None:
    """Write the head's mesh as other programs would: an OBJ with texture seams, and a PLY without teeth."""
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices]
    lines += [f"vt {u:.9g} {v:.9g}" for u, v in head.uv]
    lines += [
        "f " + " ".join(f"{vertex + 1}/{texture + 1}" for vertex, texture in zip(face, textures, strict=True))
        for face, textures in zip(head.faces, head.uv_faces, strict=True)
    ]
    (folder / "head.obj").write_text("\n".join(lines) + "\n")
    skin = head.faces[: head.n_faces - head.n_teeth_faces]
    trimesh.Trimesh(vertices, skin, process=False).export(folder / "head.ply")


def write_seen(folder: Path, head: HeadModel, avatar: sacha_core.Avatar, rng: np.random.Generator) -> None:
    """Write an avatar with scores, another one to compare it with, and what the engine says that is to be seen."""
    n = len(avatar.gaussians)
    scored = replace(avatar.gaussians, sensitivity_logit=rng.normal(-1, 1, n).astype(np.float32))
    numbers = {name: tuple(rng.uniform(*ends, len(PAPER.regions)).tolist()) for name, ends in CALIBRATED.items()}
    none, whole = (None,) * len(PAPER.regions), (0,) * len(PAPER.regions)
    event = Calibration(1, whole, whole, none, none, none, None, None, None, **numbers, used="visible")
    write_scores(folder / "scored.scores.npz", Scores(scored, rng.random(n), head.n_faces, PAPER.name, (event,)))
    (folder / "scored.sacha").write_bytes((folder / "avatar.sacha").read_bytes())
    other = replace(avatar, gaussians=avatar.gaussians.select(np.flatnonzero(rng.random(n) < KEPT)))
    (folder / "other.sacha").write_bytes(sacha_core.encode(other, level=2, head=head))

    scene = open_scene(folder / "scored.sacha", HeadSource(), Extras(compare=folder / "other.sacha"))
    seen = {}
    for name, view in scene.views.items():
        palette = np.array(PAPER.colours, np.uint8) if view.palette == "region" else palette_bytes(view.palette)
        by_region = np.array([number.level for number in view.by_region])
        seen |= {
            name: view.values,
            f"{name}_triangle": palette[view.levels],
            f"{name}_region": palette[by_region[scene.views["region"].values]],
        }
    np.savez(folder / "seen.npz", **seen)


def main(folder: Path) -> None:
    """Write everything into `folder`."""
    rng = np.random.default_rng(SEED)
    head = synthetic_head("small")
    avatar = make_avatar(head, rng)
    save_head(head, folder / "head.npz")
    write_bound_ply(folder / "avatar.ply", avatar.gaussians)
    (folder / "avatar.sacha").write_bytes(sacha_core.encode(avatar, level=2, head=head))
    stranger = replace(head, name="a stranger", v_template=STRANGERS_SIZE * head.v_template)
    save_head(stranger, folder / "stranger.npz")
    strangers = replace(avatar, head=stranger.reference)
    (folder / "stranger.sacha").write_bytes(sacha_core.encode(strangers, level=2, head=stranger))
    mesh_vertices = (head.v_template + rng.normal(0, 1e-4, head.v_template.shape)).astype(np.float32)
    write_meshes(folder, head, mesh_vertices)

    decoded = sacha_core.decode(folder / "avatar.sacha", head=head)
    labels = sacha_core.label_triangles(head)
    count = np.bincount(decoded.gaussians.binding, minlength=head.n_faces)
    np.savez(
        folder / "truth.npz",
        vertices=person_template(head, decoded.motion)[0],
        faces=head.faces,
        labels=labels,
        count=count,
        ply_count=np.bincount(avatar.gaussians.binding, minlength=head.n_faces),
        region_srgb=np.array(PAPER.colours, np.uint8),
        mesh_vertices=mesh_vertices,
        template=head.v_template,
        uv=head.uv[head.uv_faces],
        expression=decoded.motion.expression,
        shape=decoded.motion.shape,
        n_skin=head.n_faces - head.n_teeth_faces,
    )
    write_seen(folder, head, avatar, rng)
    gaussians = sacha_core.region_counts(labels, decoded.gaussians.binding)
    told = {"regions": PAPER.regions, "gaussians": gaussians.tolist(), "head": head.name}
    (folder / "told.json").write_text(json.dumps(told))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
