"""What is shown of an avatar, a head or a mesh: vertices, triangles, and numbers and colours of the triangles."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.motion import Motion
from sacha_core.errors import HeadError
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import person_template
from sacha_core.interchange.capture import Capture
from sacha_core.interchange.head_mesh import HeadMesh
from sacha_core.regions.labels import label_triangles
from sacha_core.regions.scheme import PAPER, RegionScheme, find_scheme
from sacha_core.scene.animation import Animation, animation_of
from sacha_core.scene.cameras import Cameras, cameras_of
from sacha_core.scene.colours import count_legend, linear_colours, linear_count_colours
from sacha_core.scene.rig import Rig, rig_of
from sacha_core.scene.topology import as_the_heads
from sacha_core.scene.view import View

__all__ = ["Scene", "scene_of_avatar", "scene_of_capture", "scene_of_head", "scene_of_mesh"]


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
        rig: the controls of the head; None where the mesh is of no known head.
        animation: the motion, as values of the controls; None where there is none.
        cameras: those of a capture.
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
    rig: Rig | None = None
    animation: Animation | None = None
    cameras: Cameras | None = None


def scene_of_avatar(name: str, avatar: Avatar, head: HeadModel) -> Scene:
    """Show an avatar on its own person's neutral head."""
    count = np.bincount(avatar.gaussians.binding, minlength=head.n_faces).astype(np.int32)
    person = avatar.motion or Motion.rest(0, 0)
    rig = rig_of(head, person)
    facts = [f"{len(avatar.gaussians):,} Gaussians on {head.n_faces:,} triangles", f"Head: {head.name}"]
    facts += _frames(avatar.motion)
    views, notes = _region_view(head, find_scheme(avatar.scheme), count)
    views["count"] = View(count, linear_count_colours(count), count_legend(int(count.max(initial=0))))
    return Scene(
        name,
        "avatar",
        head.name,
        person_template(head, person)[0],
        head.faces,
        _corner_uv(head),
        views,
        facts,
        notes,
        rig,
        None if avatar.motion is None else animation_of(avatar.motion, rig),
    )


def scene_of_head(head: HeadModel, motion: Motion | None = None) -> Scene:
    """Show a head model, unposed, or the person of a motion, moving."""
    views, notes = _region_view(head)
    facts = [
        f"{head.n_vertices:,} vertices, {head.n_faces:,} triangles",
        f"{head.shapedirs.shape[2]} identity and {head.exprdirs.shape[2]} expression components, {len(head.parents)} joints",
        *_frames(motion),
    ]
    person = motion or Motion.rest(0, 0)
    vertices, rig = person_template(head, person)[0], rig_of(head, person)
    animation = None if motion is None else animation_of(motion, rig)
    return Scene(
        head.name, "head", head.name, vertices, head.faces, _corner_uv(head), views, facts, notes, rig, animation
    )


def scene_of_capture(name: str, capture: Capture, head: HeadModel) -> Scene:
    """Show a capture: its person's head, how it moves, and the cameras that saw it."""
    cameras = cameras_of(capture)
    facts = [*_frames(capture.motion), f"{len(cameras.names)} cameras", f"Head: {head.name}"]
    return replace(scene_of_head(head, capture.motion), name=name, facts=facts, cameras=cameras)


def _frames(motion: Motion | None) -> list[str]:
    """Tell how long a motion is."""
    return [] if motion is None else [f"{len(motion):,} frames at {motion.frame_rate:g} a second"]


def scene_of_mesh(name: str, mesh: HeadMesh, head: HeadModel | None, motion: Motion | None = None) -> Scene:
    """Show a mesh; it has regions where its triangles are those of a head, or the first of them (teeth come last)."""
    facts = [f"{len(mesh.vertices):,} vertices, {len(mesh.faces):,} triangles"]
    if head is None:
        note = "The regions of a mesh are those of the head whose triangles it has: name that head"
        return Scene(name, "mesh", "", mesh.vertices, mesh.faces, None, {}, facts, [note])
    mesh = as_the_heads(name, mesh, head)
    n_faces = len(mesh.faces)
    views, notes = _region_view(head)
    views = {
        key: replace(view, values=view.values[:n_faces], colours=view.colours[:n_faces]) for key, view in views.items()
    }
    uv = _corner_uv(head)
    uv = None if uv is None else uv[:n_faces]
    person = _as_the_person(mesh, head, motion or Motion.rest(0, 0))
    rig = rig_of(head, person, len(mesh.vertices))
    animation = None if motion is None else animation_of(person, rig)
    facts += _frames(motion)
    return Scene(name, "mesh", head.name, mesh.vertices, mesh.faces, uv, views, facts, notes, rig, animation)


def _as_the_person(mesh: HeadMesh, head: HeadModel, motion: Motion) -> Motion:
    """Give a motion to the person whose neutral head a mesh is."""
    offset = np.zeros((head.n_vertices, 3), np.float32)
    offset[: len(mesh.vertices)] = mesh.vertices - head.v_template[: len(mesh.vertices)]
    return replace(motion, shape=np.zeros(0, np.float32), static_offset=offset)


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
