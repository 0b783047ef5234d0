# SPDX-License-Identifier: GPL-3.0-or-later
"""A motion as keyframes of a head's controls, written in bulk."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from . import controls
from .scene_folder import Part

__all__ = ["animate"]

FIRST_FRAME = 1  # where Blender's scenes begin
LINEAR = 1  # BezTriple's number for linear interpolation, which `foreach_set` wants
RATE_ERROR = 1e-3  # frames a second; Blender keeps a rate as a whole number over a float32
LAYERED = "slots" in bpy.types.Action.bl_rna.properties  # from Blender 4.4 on an action moves several data blocks


@dataclass(frozen=True)
class Channel:
    """One property that moves: where it is, what it does, and what it is at rest."""

    path: str
    index: int
    values: np.ndarray
    rest: float
    group: str


def animate(context: bpy.types.Context, shown: bpy.types.Object, animation: Part, rig: Part) -> list[str]:
    """Give a head a motion, at the motion's own pace, in place of the one that it had.

    A scene in which nothing else moves takes over the motion's frame rate and length. In any other the motion's frames lie at their times.

    Args:
        context: of the scene.
        shown: a head that was opened here.
        animation: the motion.
        rig: the controls that the motion was made for: the head's own, or the same ones for other extremes.

    Returns:
        Notes for the user.

    Raises:
        ValueError: the head has lost a control, or the motion goes beyond what its shape keys hold.
    """
    armature = controls.armature_of(shown)
    if armature is None or shown.data.shape_keys is None:
        raise ValueError(f"{shown.name} has lost its controls: open its file again")
    moved = (
        (armature, _joint_channels(animation, rig)),
        (shown.data.shape_keys, _expression_channels(shown, animation, rig)),
    )
    _forget_motion(shown, armature)
    rate, n_frames = animation.values["frame_rate"], len(animation.arrays["values"])
    free = not any(action.users for action in bpy.data.actions)
    if free:
        _take_over(context.scene, rate, n_frames)
    scene_rate = context.scene.render.fps / context.scene.render.fps_base
    own = shown.data.sacha_rig
    same = abs(scene_rate - rate) <= RATE_ERROR
    own.n_frames, own.first_frame, own.frame_step = n_frames, FIRST_FRAME, 1.0 if same else scene_rate / rate
    at = own.first_frame + own.frame_step * np.arange(n_frames)
    _write(shown.name, moved, at)
    if free:
        context.scene.frame_set(FIRST_FRAME)
    if same:
        return []
    has = f"The motion of {shown.name} has {rate:g} frames a second, the scene {scene_rate:g}"
    return [f"{has}: it keeps its pace, so its frames lie between the scene's"]


def _take_over(scene: bpy.types.Scene, rate: float, n_frames: int) -> None:
    scene.render.fps = max(1, round(rate))
    scene.render.fps_base = scene.render.fps / rate
    scene.frame_start, scene.frame_end = FIRST_FRAME, FIRST_FRAME + n_frames - 1


def _joint_channels(animation: Part, rig: Part) -> list[Channel]:
    """Give what turns the joints and carries the root. A bone's own axes are the engine's."""
    quaternions, names = animation.arrays["quaternions"], rig.values["joint_names"]
    channels = [
        Channel(f'pose.bones["{name}"].rotation_quaternion', part, quaternions[:, joint, part], float(part == 0), name)
        for joint, name in enumerate(names)
        for part in range(4)
        if (quaternions[:, joint, 1:] != 0).any()
    ]
    translation = animation.arrays["translation"]
    path = f'pose.bones["{names[0]}"].location'
    return [*channels, *(Channel(path, axis, translation[:, axis], 0.0, names[0]) for axis in range(3))]


def _expression_channels(shown: bpy.types.Object, animation: Part, rig: Part) -> list[Channel]:
    """Give what the expressions do, in the values of the head's own shape keys."""
    blocks, kept = shown.data.shape_keys.key_blocks, shown.data.sacha_rig
    own, first = kept.expressions[kept.n_identity :], rig.values["n_identity"]
    scales, values_of = rig.arrays["scales"][first:].tolist(), animation.arrays["values"].T[first:]
    if len(own) != len(scales):
        raise ValueError(f"{shown.name} has {len(own)} expressions, the motion moves {len(scales)}")
    channels = []
    columns = zip(own, scales, values_of, strict=True)
    for expression, scale, column in columns:
        block = blocks.get(expression.name)
        if block is None:
            raise ValueError(f"{shown.name} has lost its shape key {expression.name!r}: open its file again")
        values = column * np.float32(scale / expression.scale)
        block.slider_min = min(block.slider_min, float(values.min()))
        block.slider_max = max(block.slider_max, float(values.max()))
        if values.min() < block.slider_min or values.max() > block.slider_max:
            largest = f"{np.abs(values).max():.3g}"
            raise ValueError(
                f"The motion brings {block.name!r} to {largest}, further than its shape key goes: open the head with it"
            )
        path = f'key_blocks["{bpy.utils.escape_identifier(block.name)}"].value'
        channels.append(Channel(path, 0, values, 0.0, "Expressions"))
    return channels


def _forget_motion(shown: bpy.types.Object, armature: bpy.types.Object) -> None:
    """Take an earlier motion away; what it moved and the next one leaves alone would stay where it was."""
    for block in (armature, shown.data.shape_keys):
        if block.animation_data is not None and block.animation_data.action is not None:
            action = block.animation_data.action
            block.animation_data.action = None
            if not action.users:
                bpy.data.actions.remove(action)
    controls.rest(shown)
    for bone in armature.pose.bones:
        bone.rotation_mode = "QUATERNION"


def _write(name: str, moved: tuple[tuple[bpy.types.ID, list[Channel]], ...], at: np.ndarray) -> None:
    """Write the channels of several data blocks: into one action where Blender has layers, else into one for each."""
    action = None
    for block, channels in moved:
        moving = [channel for channel in channels if (channel.values != channel.rest).any()]
        if not moving:
            continue
        animation = block.animation_data_create()
        if action is None or not LAYERED:
            action = bpy.data.actions.new(f"{name} motion")
        if LAYERED:
            slot = action.slots.new(id_type=block.id_type, name=block.name)
            strip = action.layers[0].strips[0] if action.layers else action.layers.new(name).strips.new(type="KEYFRAME")
            curves = strip.channelbag(slot, ensure=True)
            animation.action, animation.action_slot = action, slot
        else:
            curves = action
            animation.action = action
        _write_curves(curves, moving, at)


def _write_curves(
    curves: bpy.types.bpy_struct, channels: list[Channel], at: np.ndarray
) -> None:  # an action, or a bag of channels
    for channel in channels:
        still = (channel.values == channel.values[0]).all()
        count = 1 if still else len(at)
        curve = curves.fcurves.new(channel.path, index=channel.index)
        curve.group = curves.groups.get(channel.group) or curves.groups.new(channel.group)
        curve.keyframe_points.add(count)
        points = np.stack([at[:count], channel.values[:count]], axis=1).astype(np.float32)
        curve.keyframe_points.foreach_set("co", points.ravel())
        curve.keyframe_points.foreach_set("interpolation", np.full(count, LINEAR, np.int32))
        curve.update()
