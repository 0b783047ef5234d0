# SPDX-License-Identifier: GPL-3.0-or-later
"""How avatars are encoded: what an operator was given, else what the scene has, as the engine's options."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, StringProperty

from .. import sources
from .settings import PROFILES

__all__ = ["encode_options", "encode_properties"]

OF_THE_SCENE = "; the scene's where not given"
LEVELS = [
    ("1", "1", "The smallest file"),
    ("2", "2", "Small"),
    ("3", "3", "Good"),
    ("4", "4", "The best"),
    ("archive", "Archive", "Every bit of every number is kept"),
]


def encode_properties() -> dict[str, object]:
    """Give the properties that say how to encode, for an operator's annotations."""
    unsaved = {"options": {"SKIP_SAVE"}}
    return {
        "level": EnumProperty(
            name="Level", description=f"Of quality{OF_THE_SCENE}", items=LEVELS, default="2", **unsaved
        ),
        "target_kb": FloatProperty(
            name="Target Size",
            description="The best file of at most so many kilobytes, instead of a level",
            min=0.0,
            **unsaved,
        ),
        "profile": EnumProperty(
            name="Profile", description=f"How the numbers are coded{OF_THE_SCENE}", items=PROFILES, **unsaved
        ),
        "tune": BoolProperty(name="Tune", description=f"Leave out what others make up for{OF_THE_SCENE}", **unsaved),
        "embed_head": BoolProperty(
            name="Embed Head", description=f"Put the head into the file{OF_THE_SCENE}", **unsaved
        ),
        "motion": StringProperty(
            name="Motion", description=f"Motion to put into the file{OF_THE_SCENE}", subtype="FILE_PATH", **unsaved
        ),
    }


def encode_options(given: bpy.types.Operator, context: bpy.types.Context) -> list[str]:
    """Give the engine's options for encoding, head and motion among them."""
    scene, setup = context.scene.sacha, context.scene.sacha_making

    def is_given(name: str) -> bool:
        return given.properties.is_property_set(name)

    def chosen(name: str) -> str | bool:
        return getattr(given if is_given(name) else setup, name)

    if is_given("target_kb") or (not is_given("level") and setup.size_by == "SIZE"):
        size = ["--target-size", f"{chosen('target_kb'):g}KB"]
    elif is_given("level"):
        size = ["--level", given.level]
    else:
        size = ["--level", "archive" if setup.size_by == "ARCHIVE" else str(scene.level)]
    motion = given.motion if is_given("motion") else scene.motion
    options = [*sources.head_options(context), *size, "--profile", chosen("profile")]
    options += ["--tune"] * chosen("tune") + ["--embed-head"] * chosen("embed_head")
    return options + (["--motion", str(sources.full_path(motion))] if motion else [])
