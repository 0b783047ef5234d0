"""What is shown of an avatar, a head or a mesh: vertices, triangles, and numbers and colours of the triangles."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float, Int

from sacha_core.avatar.avatar import Avatar
from sacha_core.avatar.motion import Motion
from sacha_core.flame.model import HeadModel
from sacha_core.flame.posing import person_template
from sacha_core.interchange.capture import Capture
from sacha_core.interchange.head_mesh import HeadMesh
from sacha_core.regions.partition import Partition
from sacha_core.regions.scheme import PAPER
from sacha_core.scene.animation import Animation, animation_of
from sacha_core.scene.avatar_views import Shown, avatar_table, avatar_views, measures_of
from sacha_core.scene.cameras import Cameras, cameras_of
from sacha_core.scene.dividing import Divided, divided
from sacha_core.scene.measures import areas_cm2
from sacha_core.scene.missing import missing_views
from sacha_core.scene.palettes import Palettes
from sacha_core.scene.region_table import RegionTable
from sacha_core.scene.rig import Rig, rig_of
from sacha_core.scene.topology import as_the_heads, misfit
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
        views: by name, "region" first where regions are known.
        facts: lines that say what it is.
        notes: lines that say what is missing and how to give it.
        rig: the controls of the head; None where the mesh is of no known head.
        animation: the motion, as values of the controls; None where there is none.
        cameras: those of a capture.
        absent: lines that say which further views there could be, and how to get them.
        palettes: that the views' levels point into.
        regions: the table of regions, or None where they are not known.
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
    absent: list[str] = field(default_factory=list)
    palettes: Palettes | None = None
    regions: RegionTable | None = None


def scene_of_avatar(
    shown: Shown, avatar: Avatar, head: HeadModel, regions: Partition | None = None, compared: Shown | None = None
) -> Scene:
    """Show an avatar on its own person's neutral head.

    Args:
        shown: its name, Gaussians and what else is known of them.
        avatar: it.
        head: that it is bound to.
        regions: of the head; None takes those of the avatar's scheme.
        compared: another avatar of this head: views and table then tell the difference, this one less that one.
    """
    person = avatar.motion or Motion.rest(0, 0)
    rig, vertices = rig_of(head, person), person_template(head, person)[0]
    area = areas_cm2(vertices, head.faces)
    parts = divided(head, avatar.scheme, regions, area)
    before = None if compared is None else measures_of(compared, area, parts.regions)
    views = avatar_views(measures_of(shown, area, parts.regions), before)
    table = None if parts.regions is None else avatar_table(shown, area, parts.regions, compared)
    scene = Scene(
        shown.name,
        "avatar",
        head.name,
        vertices,
        head.faces,
        _corner_uv(head),
        {**parts.views, **views},
        _facts(shown, avatar, head, compared),
        parts.notes,
        rig,
        None if avatar.motion is None else animation_of(avatar.motion, rig),
        absent=missing_views(shown, parts.regions),
    )
    return replace(scene, palettes=parts.palettes, regions=table)


def _facts(shown: Shown, avatar: Avatar, head: HeadModel, compared: Shown | None) -> list[str]:
    n = len(shown.gaussians)
    facts = [f"{n:,} Gaussians on {head.n_faces:,} triangles", f"Head: {head.name}", *_frames(avatar.motion)]
    if compared is not None:
        then = len(compared.gaussians)
        facts.append(f"Compared with {compared.name}: {then:,} Gaussians, {n - then:+,}")
    return facts


def scene_of_head(head: HeadModel, motion: Motion | None = None, regions: Partition | None = None) -> Scene:
    """Show a head model, unposed, or the person of a motion, moving; None for `regions` takes the paper's scheme, here and below."""
    facts = [
        f"{head.n_vertices:,} vertices, {head.n_faces:,} triangles",
        f"{head.shapedirs.shape[2]} identity and {head.exprdirs.shape[2]} expression components, {len(head.parents)} joints",
        *_frames(motion),
    ]
    person = motion or Motion.rest(0, 0)
    vertices, rig = person_template(head, person)[0], rig_of(head, person, identity=motion is None)
    animation = None if motion is None else animation_of(motion, rig)
    scene = Scene(head.name, "head", head.name, vertices, head.faces, _corner_uv(head), {}, facts, [], rig, animation)
    return _with_regions(scene, divided(head, PAPER.name, regions, areas_cm2(vertices, head.faces)))


def scene_of_capture(name: str, capture: Capture, head: HeadModel, regions: Partition | None = None) -> Scene:
    """Show a capture: its person's head, how it moves, and the cameras that saw it."""
    cameras = cameras_of(capture)
    facts = [*_frames(capture.motion), f"{len(cameras.names)} cameras", f"Head: {head.name}"]
    return replace(scene_of_head(head, capture.motion, regions), name=name, facts=facts, cameras=cameras)


def _frames(motion: Motion | None) -> list[str]:
    """Tell how long a motion is."""
    return [] if motion is None else [f"{len(motion):,} frames at {motion.frame_rate:g} a second"]


def scene_of_mesh(
    name: str, mesh: HeadMesh, head: HeadModel | None, motion: Motion | None = None, regions: Partition | None = None
) -> Scene:
    """Show a mesh; it has regions where its triangles are those of a head, or the first of them (teeth come last)."""
    facts = [f"{len(mesh.vertices):,} vertices, {len(mesh.faces):,} triangles"]
    if head is None:
        note = "The regions of a mesh are those of the head whose triangles it has: name that head"
        return Scene(name, "mesh", "", mesh.vertices, mesh.faces, None, {}, facts, [note])
    mesh = as_the_heads(name, mesh, head)
    n_faces = len(mesh.faces)
    uv = _corner_uv(head)
    uv = None if uv is None else uv[:n_faces]
    scene = Scene(name, "mesh", head.name, mesh.vertices, mesh.faces, uv, {}, facts, [])
    scene = _with_regions(scene, divided(head, PAPER.name, regions, areas_cm2(mesh.vertices, mesh.faces)))
    reason = misfit(mesh, head)
    if reason is not None:
        return replace(scene, notes=[*scene.notes, f"No controls: {reason}"])
    person = _as_the_person(mesh, head, motion or Motion.rest(0, 0))
    rig = rig_of(head, person, len(mesh.vertices))
    animation = None if motion is None else animation_of(person, rig)
    return replace(scene, facts=[*facts, *_frames(motion)], rig=rig, animation=animation)


def _with_regions(scene: Scene, parts: Divided) -> Scene:
    """Add the regions of what carries no Gaussians, or the note why there are none."""
    return replace(
        scene, views=parts.views, notes=[*scene.notes, *parts.notes], palettes=parts.palettes, regions=parts.table
    )


def _as_the_person(mesh: HeadMesh, head: HeadModel, motion: Motion) -> Motion:
    """Give a motion to the person whose neutral head a mesh is."""
    offset = np.zeros((head.n_vertices, 3), np.float32)
    offset[: len(mesh.vertices)] = mesh.vertices - head.v_template[: len(mesh.vertices)]
    return replace(motion, shape=np.zeros(0, np.float32), static_offset=offset)


def _corner_uv(head: HeadModel) -> Float[np.ndarray, "f 3 2"] | None:
    """Give texture coordinates at the corners of triangles, where the head has them."""
    if head.uv is None or head.uv_faces is None:
        return None
    corners: np.ndarray = head.uv[head.uv_faces].astype(np.float32, copy=False)
    return corners
