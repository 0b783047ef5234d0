# SPDX-License-Identifier: GPL-3.0-or-later
"""What the user asks of the budget, kept with the mesh that it is for."""

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

__all__ = ["CLASSES", "attach", "detach"]


class SachaRegionBudget(bpy.types.PropertyGroup):
    """What one region may keep; `name` is the region's."""

    weight: FloatProperty(
        name="Weight",
        description="How many times as much the region is worth as measured: what stays in it, and how finely it is coded",
        default=1.0,
        min=0.01,
        soft_max=10.0,
        max=1000.0,
    )
    lowest_share: FloatProperty(
        name="At Least",
        description="Smallest share of all Gaussians that the region keeps",
        subtype="PERCENTAGE",
        default=0.0,
        min=0.0,
        max=100.0,
    )
    highest_share: FloatProperty(
        name="At Most",
        description="Largest share of all Gaussians that the region keeps",
        subtype="PERCENTAGE",
        default=100.0,
        min=0.0,
        max=100.0,
    )
    locked: BoolProperty(name="Lock", description="Keep as many Gaussians of the region as it has now")


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
        description="Largest size of the file, motion and all; KB are 1000 bytes",
        default=100.0,
        min=0.1,
    )
    keep: FloatProperty(
        name="Keep",
        description="Share of the Gaussians that stays",
        subtype="PERCENTAGE",
        default=60.0,
        min=0.01,
        max=100.0,
    )
    paint: StringProperty(
        name="Painted",
        description="Vertex group or colour attribute that says where it matters: 0 or black counts as measured, 1 or white the most",
    )
    paint_strength: FloatProperty(
        name="Strength",
        description="How many times as much counts what is painted fully",
        default=4.0,
        min=0.01,
        max=1000.0,
    )
    dataset: StringProperty(
        name="Views",
        description="Capture whose images judge the result, region by region; may be empty",
        subtype="DIR_PATH",
    )
    measure: BoolProperty(
        name="Measure Pictures", description="Tell for each region how near the result's pictures come", default=True
    )
    scheme: StringProperty(
        name="Regions", description="Name of the user's own division of the head; empty for the avatar's"
    )
    origin: StringProperty(
        name="Origin",
        description="The avatar that budgets are applied to, whatever the mesh shows now",
        subtype="FILE_PATH",
    )


CLASSES = (SachaRegionBudget, SachaSteering)


def attach() -> None:
    """Give meshes their budget."""
    bpy.types.Mesh.sacha_steering = PointerProperty(type=SachaSteering)


def detach() -> None:
    """Take it away again."""
    del bpy.types.Mesh.sacha_steering
