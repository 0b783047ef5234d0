"""What is shown of a file: a mesh, and numbers and colours of its triangles; as arrays in a folder.

The folder holds `vertices.npy` (v, 3) float32, metres, y up; `faces.npy` (f, 3) int32; `uv.npy` (f, 3, 2) float32 at the corners where
the head has texture coordinates; for each view NAME its numbers `NAME.npy` (f,) int32 and colours `NAME_colour.npy` (f, 4) float32, linear
RGBA; and `scene.json`, written last: name, kind, head, facts and notes (lines for people), and the views with their legends.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from sacha_core.avatar.avatar import Avatar
from sacha_core.cli.common import HeadSource
from sacha_core.cli.console import kilobytes
from sacha_core.cli.scene_colours import count_legend, linear_colours, linear_count_colours
from sacha_core.cli.sources import named_head, open_avatar
from sacha_core.errors import HeadError
from sacha_core.files import write_aside
from sacha_core.flame.model import HeadModel
from sacha_core.flame.open import open_head
from sacha_core.flame.posing import person_template
from sacha_core.interchange.head_mesh import HeadMesh, read_head_mesh
from sacha_core.regions.labels import label_triangles
from sacha_core.regions.scheme import PAPER, RegionScheme, find_scheme

__all__ = ["Scene", "View", "open_scene", "write_scene"]


@dataclass(frozen=True)
class View:
    """One number a triangle, its colours, and what they mean.

    Args:
        values: (f,) int32.
        colours: (f, 4) linear RGBA.
        legend: lines from top to bottom: `label`, `colour` (linear RGB), and for regions `triangles` and `gaussians`.
    """

    values: Int[np.ndarray, " f"]
    colours: Float[np.ndarray, "f 4"]
    legend: list[dict[str, Any]]


@dataclass(frozen=True)
class Scene:
    """What is shown of a file.

    Args:
        name: what to call it.
        kind: "avatar", "head" or "mesh".
        head: name of the head that it is bound to; empty where that is not known.
        vertices: (v, 3) metres, y up.
        faces: (f, 3) vertex indices.
        uv: (f, 3, 2) texture coordinates at the corners, or None.
        views: by name, "region" and "count".
        facts: lines that say what it is.
        notes: lines that say what is missing and how to give it.
    """

    name: str
    kind: str
    head: str
    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    uv: Float[np.ndarray, "f 3 2"] | None
    views: dict[str, View]
    facts: list[str]
    notes: list[str]


def open_scene(path: Path, source: HeadSource) -> Scene:
    """Read whatever a user names: an avatar, a head model, or a head's mesh.

    Args:
        path: the file, or the folder of a model.
        source: the head that it is bound to, or whose triangles a mesh has, where the file does not say it itself.

    Raises:
        SachaError: the file is damaged, or its head is missing or another one.
        OSError: it cannot be read.
    """
    suffix = path.suffix.lower()
    if suffix in {".npz", ".pkl"}:
        return _scene_of_head(open_head(str(path), masks=source.masks))
    if suffix == ".obj" or (suffix == ".ply" and not _holds_gaussians(path)):
        return _scene_of_mesh(path.stem, read_head_mesh(path), named_head(source))
    opened = open_avatar(path, source)
    return _scene_of_avatar(path, opened.avatar, opened.head)


def write_scene(scene: Scene, folder: Path) -> None:
    """Write the arrays, and last `scene.json`: a folder that has it is whole.

    Raises:
        OSError: the folder cannot be written.
    """
    arrays: dict[str, np.ndarray | None] = {
        "vertices": scene.vertices.astype(np.float32, copy=False),
        "faces": scene.faces.astype(np.int32, copy=False),
        "uv": scene.uv,
    }
    for name, view in scene.views.items():
        arrays |= {name: view.values, f"{name}_colour": view.colours}
    for name, array in arrays.items():
        if array is not None:
            with write_aside(folder / f"{name}.npy") as aside:
                np.save(aside, array, allow_pickle=False)
    told = {name: getattr(scene, name) for name in ("name", "kind", "head", "facts", "notes")}
    told["views"] = {name: view.legend for name, view in scene.views.items()}
    with write_aside(folder / "scene.json") as aside:
        aside.write_text(json.dumps(told, indent=2) + "\n", encoding="utf-8")


def _scene_of_avatar(path: Path, avatar: Avatar, head: HeadModel) -> Scene:
    """Show an avatar on its own person's neutral head."""
    count = np.bincount(avatar.gaussians.binding, minlength=head.n_faces).astype(np.int32)
    vertices = head.v_template if avatar.motion is None else person_template(head, avatar.motion)[0]
    facts = [f"{len(avatar.gaussians):,} Gaussians on {head.n_faces:,} triangles", f"Head: {head.name}"]
    if path.is_file():
        facts.append(kilobytes(path.stat().st_size))
    if avatar.motion is not None:
        facts.append(f"{len(avatar.motion):,} frames at {avatar.motion.frame_rate:g} a second")
    views, notes = _region_view(head, find_scheme(avatar.scheme), count)
    views["count"] = View(count, linear_count_colours(count), count_legend(int(count.max(initial=0))))
    return Scene(path.stem, "avatar", head.name, vertices, head.faces, _corner_uv(head), views, facts, notes)


def _scene_of_head(head: HeadModel) -> Scene:
    """Show a head model, unposed."""
    views, notes = _region_view(head)
    facts = [
        f"{head.n_vertices:,} vertices, {head.n_faces:,} triangles",
        f"{head.shapedirs.shape[2]} identity and {head.exprdirs.shape[2]} expression components, {len(head.parents)} joints",
    ]
    return Scene(head.name, "head", head.name, head.v_template, head.faces, _corner_uv(head), views, facts, notes)


def _scene_of_mesh(name: str, mesh: HeadMesh, head: HeadModel | None) -> Scene:
    """Show a mesh; it has regions where its triangles are those of a head, or the first of them (teeth come last)."""
    facts = [f"{len(mesh.vertices):,} vertices, {len(mesh.faces):,} triangles"]
    if head is None:
        note = "The regions of a mesh are those of the head whose triangles it has: name that head"
        return Scene(name, "mesh", "", mesh.vertices, mesh.faces, None, {}, facts, [note])
    n_faces = len(mesh.faces)
    if n_faces not in {head.n_faces, head.n_faces - head.n_teeth_faces} or not np.array_equal(
        mesh.faces, head.faces[:n_faces]
    ):
        raise HeadError(
            f"mesh {name!r} with {n_faces} triangles does not have those of head {head.name!r} with {head.n_faces}, in its order"
        )
    views, notes = _region_view(head)
    views = {
        key: replace(view, values=view.values[:n_faces], colours=view.colours[:n_faces]) for key, view in views.items()
    }
    uv = _corner_uv(head)
    uv = None if uv is None else uv[:n_faces]
    return Scene(name, "mesh", head.name, mesh.vertices, mesh.faces, uv, views, facts, notes)


def _region_view(
    head: HeadModel, scheme: RegionScheme | None = None, count: Int[np.ndarray, " f"] | None = None
) -> tuple[dict[str, View], list[str]]:
    """Give the view of the regions, or a note why there is none."""
    scheme = scheme or PAPER
    try:
        labels = label_triangles(head, scheme).astype(np.int32)
    except HeadError as missing:
        return {}, [f"No regions: {missing}"]
    colours = linear_colours(np.array(scheme.colours, np.uint8))
    triangles = np.bincount(labels, minlength=len(scheme.regions))
    gaussians = (
        np.bincount(labels, weights=count, minlength=len(scheme.regions))
        if count is not None
        else np.zeros_like(triangles)
    )
    legend = [
        {
            "label": name,
            "colour": colours[i, :3].tolist(),
            "triangles": int(triangles[i]),
            "gaussians": int(gaussians[i]),
        }
        for i, name in enumerate(scheme.regions)
    ]
    return {"region": View(labels, colours[labels], legend)}, []


def _corner_uv(head: HeadModel) -> Float[np.ndarray, "f 3 2"] | None:
    """Give texture coordinates at the corners of triangles, where the head has them."""
    if head.uv is None or head.uv_faces is None:
        return None
    corners: np.ndarray = head.uv[head.uv_faces].astype(np.float32, copy=False)
    return corners


def _holds_gaussians(path: Path) -> bool:
    """Tell a PLY of Gaussians from one of a mesh, by its header: only Gaussians have an opacity."""
    with path.open("rb") as file:
        header, _, _ = file.read(1 << 16).partition(b"end_header")
    return b" opacity" in header
