# SPDX-License-Identifier: GPL-3.0-or-later
"""What the user asks of the budget, and what came of it, kept with the mesh that it is for."""

from __future__ import annotations

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from ..active import NO_AVATAR, avatar_of
from ..seeing.shown import edited

__all__ = ["CLASSES", "attach", "detach", "list_regions", "origin_of", "steerable"]


class SachaRegionBudget(bpy.types.PropertyGroup):
    """What one region may keep; `name` is the region's."""

    weight: FloatProperty(
        name="Weight",
        description="How many times as much the region is worth as measured: who stays in it, and how finely it is coded",
        default=1.0,
        min=0.01,
        soft_max=10.0,
        max=1000.0,
    )
    lowest_share: FloatProperty(
        name="At Least",
        description="Smallest share of all Gaussians that stay, in percent",
        subtype="PERCENTAGE",
        default=0.0,
        min=0.0,
        max=100.0,
    )
    highest_share: FloatProperty(
        name="At Most",
        description="Largest share of all Gaussians that stay, in percent",
        subtype="PERCENTAGE",
        default=100.0,
        min=0.0,
        max=100.0,
    )
    locked: BoolProperty(name="Lock", description="Keep as many Gaussians of the region as it has now")


class SachaRegionOutcome(bpy.types.PropertyGroup):
    """What one region had before the last Apply and has since; `name` is the region's."""

    before: IntProperty(min=0)
    after: IntProperty(min=0)
    known_before: BoolProperty()
    known_after: BoolProperty()
    psnr_before_db: FloatProperty()
    psnr_after_db: FloatProperty()


class SachaSteering(bpy.types.PropertyGroup):
    """What the user asks of the budget, and what came of it."""

    regions: CollectionProperty(type=SachaRegionBudget)
    active: IntProperty(name="Region", description="The region whose shares are shown below the list")
    limit: EnumProperty(
        name="Limit",
        description="What the budget is",
        items=[
            (
                "SIZE",
                "File Size",
                "The best file of at most this size: as many Gaussians as are worth their bits in it",
            ),
            ("SHARE", "Share Kept", "This share of the Gaussians, at the level of the scene's settings"),
        ],
    )
    target_kb: FloatProperty(
        name="Size (KB)",
        description="Largest size of the file, motion and all; a KB is 1000 bytes",
        default=100.0,
        min=0.1,
        soft_max=10_000.0,
    )
    keep: FloatProperty(
        name="Keep",
        description="Share of the Gaussians that stays, in percent",
        subtype="PERCENTAGE",
        default=60.0,
        min=0.01,
        max=100.0,
    )
    paint_by: EnumProperty(
        name="Painted",
        description="Where it is said which triangles matter more",
        items=[
            ("NOTHING", "Nothing", "Regions alone decide"),
            ("GROUP", "Vertex Group", "Weights of a vertex group: 0 counts as measured, 1 counts the most"),
            ("COLOUR", "Colour Attribute", "How light a colour is: black counts as measured, white counts the most"),
        ],
    )
    paint: StringProperty(name="Name", description="Name of the vertex group or colour attribute")
    paint_strength: FloatProperty(
        name="Strength",
        description="How many times as much counts what is painted fully; below 1 it counts less",
        default=4.0,
        min=0.01,
        soft_max=16.0,
        max=1000.0,
    )
    measure: BoolProperty(
        name="Measure Pictures", description="Tell for each region how near the pictures come", default=True
    )
    dataset: StringProperty(
        name="Capture",
        description="Capture whose held-out images the result is held against; where empty, the avatar's own pictures",
        subtype="DIR_PATH",
    )
    views: IntProperty(
        name="Scoring Views",
        description="From how many pictures it is measured what each Gaussian is worth, where nobody has yet",
        default=120,
        min=1,
        soft_max=500,
    )
    custom: BoolProperty(name="Own Regions", description="The regions are the user's, not those of the avatar")
    origin: StringProperty(
        name="Origin", description="The avatar that budgets are applied to, whatever is shown now", subtype="FILE_PATH"
    )
    result: StringProperty(name="Result", description="The file that the last Apply wrote", subtype="FILE_PATH")
    outcome: CollectionProperty(type=SachaRegionOutcome)
    bytes_before: IntProperty(name="Bytes Before", min=0)
    bytes_after: IntProperty(name="Bytes After", min=0)


CLASSES = (SachaRegionBudget, SachaRegionOutcome, SachaSteering)


def attach() -> None:
    """Give meshes their budget."""
    bpy.types.Mesh.sacha_steering = PointerProperty(type=SachaSteering)


def detach() -> None:
    """Take it away again."""
    del bpy.types.Mesh.sacha_steering


def steerable(context: bpy.types.Context) -> bpy.types.Mesh:
    """Give the active mesh, if it shows an avatar and has the triangles that were opened.

    Raises:
        ValueError: it is none; the message says what to do.
    """
    avatar = avatar_of(context.object)
    if avatar is None:
        raise ValueError(NO_AVATAR)
    mesh = avatar.data
    if mesh.is_editmode:
        raise ValueError(f"{mesh.name} is in Edit Mode: leave it, and do this again")
    if complaint := edited(mesh):
        raise ValueError(f"{complaint}; open the file anew instead")
    return mesh


def list_regions(mesh: bpy.types.Mesh) -> None:
    """Give each region that the mesh shows a row of the budget; rows that there are keep what the user set."""
    rows = mesh.sacha_steering.regions
    wanted = [region.name for region in mesh.sacha.regions]
    for place in reversed(range(len(rows))):
        if rows[place].name not in wanted:
            rows.remove(place)
    for place, name in enumerate(wanted):
        if name not in rows:
            rows.add().name = name
        rows.move(rows.find(name), place)


def origin_of(mesh: bpy.types.Mesh) -> str:
    """Give the avatar that budgets are applied to: what was opened first, while the mesh shows what came of it."""
    asked, shown = mesh.sacha_steering, mesh.sacha
    return asked.origin if asked.origin and shown.source == asked.result else shown.source
