"""All that happens before a picture is drawn, in one call of each thread: the head is posed, and its Gaussians are placed and coloured.

Before they are, they take the step that the last picture asked for: what takes time is to bring them to the processor.
"""

from __future__ import annotations

from sacha_core.animation.kernels.frames import triangle_frames
from sacha_core.animation.kernels.posing import pose_joints, pose_vertices
from sacha_core.parallel.kernels.kernel import kernel
from sacha_core.parallel.kernels.turns import finish_turn, take_turn, wait_for_turns
from sacha_core.train.kernels.adam import step_gaussians
from sacha_core.train.kernels.place import place

PARTS = 4  # each needs all of the one before: joints, blocks of vertices, ranges of triangles, ranges of Gaussians


@kernel
def pose_and_place(
    turns, to_pose, count, joints, vertex_bounds, blend, coefficients, skin, face_bounds, corners, frames, faults,
    bounds, to_step, stepping, sides, fine, placing,
):  # fmt: skip
    """Pose a head unless it is posed; then let its Gaussians step where they have to and, if no triangle is degenerate, place them.

    Args:
        turns: (PARTS, ...) of `turns.new_turns`.
        to_pose: whether the head is not posed yet.
        count: (1,) int64 space.
        joints: what `pose_joints` wants, but its last two.
        vertex_bounds: (a + 1,) bounds of ranges of vertices, jobs of the second part.
        blend: what `pose_vertices` wants after a range: the template, directions and what they move.
        coefficients: what it wants then, and `pose_joints` last: two spaces.
        skin: what it wants after their number.
        face_bounds: (b + 1,) bounds of ranges of triangles, jobs of the third part.
        corners: what `triangle_frames` wants after a range: vertices, faces and limits.
        frames: where it writes.
        faults: (b,) int64 out: the first degenerate triangle of each range, or -1.
        bounds: (c + 1,) bounds of ranges of Gaussians, jobs of the last part.
        to_step: whether Gaussians step first.
        stepping: what `step_gaussians` wants after a range.
        sides: (c, 4) float32 out: the box that each range reaches, see `place`.
        fine: (c,) bool out: whether all its colours can be drawn.
        placing: what `place` wants after a range.

    Returns:
        Whether no triangle is degenerate.
    """
    sound = True
    if to_pose:
        if take_turn(turns[0]) == 0:
            count[0] = pose_joints(*joints, *coefficients)
            finish_turn(turns[0])
        wait_for_turns(turns[0], 1)
        job = take_turn(turns[1])
        while job < len(vertex_bounds) - 1:
            pose_vertices(vertex_bounds[job], vertex_bounds[job + 1], *blend, *coefficients, count[0], *skin)
            finish_turn(turns[1])
            job = take_turn(turns[1])
        wait_for_turns(turns[1], len(vertex_bounds) - 1)
        job = take_turn(turns[2])
        while job < len(face_bounds) - 1:
            faults[job] = triangle_frames(face_bounds[job], face_bounds[job + 1], *corners, *frames)
            finish_turn(turns[2])
            job = take_turn(turns[2])
        wait_for_turns(turns[2], len(face_bounds) - 1)
        for fault in faults:
            sound &= fault < 0
    job = take_turn(turns[3])
    while job < len(bounds) - 1:
        if to_step:
            step_gaussians(bounds[job], bounds[job + 1], *stepping)
        if sound:
            sides[job], fine[job] = place(bounds[job], bounds[job + 1], *placing)
        job = take_turn(turns[3])
    return sound


@kernel
def enclosed(sides):
    """Give the box around some, as `reach` gives them."""
    left, top, right, bottom = sides[0, 0], sides[0, 1], sides[0, 2], sides[0, 3]
    for k in range(1, len(sides)):
        left, top = min(left, sides[k, 0]), min(top, sides[k, 1])
        right, bottom = max(right, sides[k, 2]), max(bottom, sides[k, 3])
    return left, top, right, bottom
