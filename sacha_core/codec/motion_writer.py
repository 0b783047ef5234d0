"""Section `Motion`, written: frames into the groups of bytes that `motion` reads.

Source: own.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from sacha_core.avatar.motion import Motion
from sacha_core.codec.frame_coder import encode_frames
from sacha_core.codec.frame_model import FrameModel, columns_of, parameters_of
from sacha_core.codec.frame_search import FrameTask, choose_groups, search_frames
from sacha_core.codec.levels import Level

__all__ = ["encode_groups", "encode_motion", "frame_task", "pack_motion"]

STEP_OF = (0, 1, 1, 1, 1, 2)  # expression, angle, translation
MM = 1e-3


def frame_task(
    motion: Motion,
    level: Level,
    group_frames: int,
    products: Float[np.ndarray, "p p"] | None = None,
    *,
    live: bool = False,
) -> FrameTask:
    """Tell what shall become of a motion's frames at a level.

    Args:
        motion: the frames.
        level: tells the vertex error aimed at, and steps for where nothing is known of vertices.
        group_frames: frames in every group but the last.
        products: how parameters move vertices, from `displacement.displacement_products`.
        live: whether frames other than these are to come.
    """
    kinds = columns_of(motion.expression.shape[1])
    fixed = np.array([level.expression_step, level.angle_step_rad, level.translation_step])[np.array(STEP_OF)[kinds]]
    return FrameTask(parameters_of(motion), kinds, fixed, products, level.vertex_error_mm * MM, group_frames, live)


def encode_groups(task: FrameTask, model: FrameModel) -> list[bytes]:
    """Code every group of a task."""
    return [encode_frames(group, task.values.size) for group in choose_groups(model, task)]


def pack_motion(model: FrameModel, groups: Sequence[bytes], frame_rate: float, group_frames: int) -> bytes:
    """Write the section."""
    head = struct.pack("<dH", frame_rate, group_frames) + model.pack()
    return b"".join([head, *(packed_length(len(group)) for group in groups), *groups])


def encode_motion(
    motion: Motion, level: Level, group_frames: int, products: Float[np.ndarray, "p p"] | None = None
) -> bytes:
    """Code all frames; arguments as of `frame_task`.

    Raises:
        OverflowError: a value is beyond 2**30 steps.
    """
    task = frame_task(motion, level, group_frames, products)
    model = search_frames(task)
    return pack_motion(model, encode_groups(task, model), motion.frame_rate, group_frames)


def packed_length(n_bytes: int) -> bytes:
    """Write a length in as few bytes as it needs: seven bits each, lowest first, all but the last with the highest bit set."""
    low, rest = n_bytes & 0x7F, n_bytes >> 7
    return bytes([low | 0x80]) + packed_length(rest) if rest else bytes([low])
