# SPDX-License-Identifier: GPL-3.0-or-later
"""What is set up for files and trainings, kept with the scene in the .blend."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

__all__ = ["CLASSES", "VARIANTS", "attach", "detach"]

# What an artist chooses among; the engine knows more, for experiments.
VARIANTS = [
    ("sacha", "SACHA", "Each region of the head gets its share of the Gaussians by what is seen there"),
    ("paper", "Paper", "The published method, step by step"),
    ("default", "Default", "The published baseline: no regions"),
    ("ga", "GaussianAvatars", "GaussianAvatars' own rules"),
]
PROFILES = [
    ("sacha", "SACHA", "The smallest files"),
    ("paper", "Paper", "As the SACHA paper codes, at the rate points 1 to 4 of MPEG's JEE6.2, to compare with"),
]
DEVICES = [
    ("auto", "Automatic", "A CUDA device where there is one that can be used, else the CPU"),
    ("cpu", "CPU", "The CPU"),
    ("cuda", "CUDA", "A CUDA device"),
]
RENDERERS = [
    ("CYCLES", "Cycles", "Light, materials and hair as in a final render"),
    ("BLENDER_WORKBENCH", "Workbench", "Quick: colours and textures without light"),
]


class SachaMaking(bpy.types.PropertyGroup):
    """What is set up for files and trainings."""

    size_by: EnumProperty(
        name="Size by",
        description="What decides how large an encoded file is",
        items=[
            ("LEVEL", "Level", "A level of quality, from 1 (smallest) to 4 (best)"),
            ("SIZE", "Target Size", "The best file that is not larger than a number of kilobytes"),
            ("ARCHIVE", "Archive", "Every bit of every number is kept"),
        ],
    )
    target_kb: FloatProperty(
        name="Target Size",
        description="Largest size of the file, in kilobytes of 1000 bytes",
        default=100.0,
        min=1.0,
        soft_max=10_000.0,
    )
    profile: EnumProperty(name="Profile", description="How the numbers are coded", items=PROFILES)
    tune: BoolProperty(
        name="Tune",
        description="Leave out Gaussians that others, fitted anew, make up for; takes minutes: an eighth to half fewer bytes",
    )
    embed_head: BoolProperty(
        name="Embed Head", description="Put the head into the file too, so that it opens anywhere; the file gets larger"
    )

    dataset: StringProperty(
        name="Dataset",
        description="Folder of a multi-view capture in GaussianAvatars' layout",
        subtype="DIR_PATH",
    )
    model: StringProperty(name="Model", description="Folder that the trained avatar goes to", subtype="DIR_PATH")
    variant: EnumProperty(name="Variant", description="How Gaussians are grown and pruned", items=VARIANTS)
    iterations: IntProperty(
        name="Iterations",
        description="Length of the training; the paper's has 360,000",
        default=6000,
        min=1,
        soft_max=360_000,
    )
    shrink: IntProperty(
        name="Shrink Images",
        description="Train on images so many times smaller than the stored ones",
        default=1,
        min=1,
        max=8,
    )
    seed: IntProperty(name="Seed", description="Of everything random: the same seed gives the same avatar", min=0)
    device: EnumProperty(name="Device", description="Where to compute", items=DEVICES)
    finetune: BoolProperty(
        name="Write File",
        description="After training, fit fewer Gaussians to the capture at the scene's level, and write level-N.sacha",
    )

    film_folder: StringProperty(
        name="Dataset", description="Folder that the filmed dataset goes to", subtype="DIR_PATH"
    )
    film_cameras: PointerProperty(
        name="Cameras",
        description="The collection of cameras that film; where empty, all cameras of the scene",
        type=bpy.types.Collection,
    )
    renderer: EnumProperty(name="Renderer", description="What draws the pictures", items=RENDERERS)
    samples: IntProperty(name="Samples", description="Of Cycles, for each pixel", default=64, min=1, soft_max=1024)
    width: IntProperty(name="Width", description="Of the pictures", default=550, min=16, max=8192, subtype="PIXEL")
    height: IntProperty(name="Height", description="Of the pictures", default=802, min=16, max=8192, subtype="PIXEL")
    frame_step: IntProperty(name="Frame Step", description="Film every so manieth frame of the scene", default=1, min=1)
    only_selected: BoolProperty(
        name="Only Selected",
        description="Film the selected objects and the head, and leave everything else out of the picture",
    )


CLASSES = (SachaMaking,)


def attach() -> None:
    """Give scenes their settings."""
    bpy.types.Scene.sacha_making = PointerProperty(type=SachaMaking)


def detach() -> None:
    """Take them away again."""
    del bpy.types.Scene.sacha_making
