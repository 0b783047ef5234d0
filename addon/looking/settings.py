# SPDX-License-Identifier: GPL-3.0-or-later
"""What a preview shows and how, kept with the scene in the .blend."""

from __future__ import annotations

import bpy
from bpy.props import CollectionProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from ..seeing.shown import SachaLegendLine

__all__ = ["CLASSES", "ERRORS", "LEVELS", "attach", "detach"]

LEVELS = [
    ("FILE", "As It Is", "The avatar as it was opened"),
    ("1", "Level 1", "What the smallest file leaves of it"),
    ("2", "Level 2", "What the usual file leaves of it"),
    ("3", "Level 3", "What a file of high quality leaves of it"),
    ("4", "Level 4", "What the best file leaves of it"),
]
ERRORS = [
    ("NONE", "None", "Draw the picture alone"),
    ("DIFFERENCE", "Difference", "Paint how far the worst channel of each pixel is from the uncompressed avatar's"),
    ("FLIP", "Visible (FLIP)", "Paint how visible the difference is when one flips between both pictures"),
]


class SachaLooking(bpy.types.PropertyGroup):
    """What a preview shows and how."""

    level: EnumProperty(
        name="Decoded At", description="What is drawn: the avatar, or what a file leaves of it", items=LEVELS
    )
    error: EnumProperty(
        name="Error", description="What is painted into the image SACHA Error", items=ERRORS, default="DIFFERENCE"
    )
    brightest: FloatProperty(
        name="Brightest At",
        description="The difference that is painted brightest; 1 is that between black and white",
        default=0.1,
        min=0.001,
        max=1.0,
    )
    brightest_flip: FloatProperty(
        name="Brightest At",
        description="The visible error (FLIP) that is painted brightest; 1 is black for white",
        default=0.4,
        min=0.001,
        max=1.0,
    )
    against: StringProperty(
        name="Compare With",
        description="The uncompressed avatar (model folder, .ply, archive); where empty, the avatar that was opened",
        subtype="FILE_PATH",
    )
    texture_size: IntProperty(
        name="Texture Size", description="Width and height of a heat map, pixels", default=2048, min=16, max=16384
    )
    told: StringProperty(name="Last Preview", description="What the last preview measured")
    legend: CollectionProperty(
        type=SachaLegendLine, description="What the colours of the last picture of an error mean"
    )


CLASSES = (SachaLooking,)


def attach() -> None:
    """Give scenes their settings."""
    bpy.types.Scene.sacha_looking = PointerProperty(type=SachaLooking)


def detach() -> None:
    """Take them away again."""
    del bpy.types.Scene.sacha_looking
