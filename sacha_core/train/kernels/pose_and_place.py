"""All that happens before a picture is drawn, in one call of each thread: the head is posed, and its Gaussians are placed and coloured.

Before they are, they take the step that the last picture asked for: what takes time is to bring them to the processor.
"""

from __future__ import annotations

from sacha_core.animation.kernels.frames import triangle_frames
from sacha_core.animation.kernels.posing import pose_joints, pose_vertices
from sacha_core.parallel.kernels.kernel import kernel
from sacha_core.parallel.kernels.packed import unpacked
from sacha_core.parallel.kernels.turns import finish_turn, take_turn, wait_for_turns
from sacha_core.train.kernels.adam import step_gaussians
from sacha_core.train.kernels.place import place

PARTS = 4  # each needs all of the one before: parameters and joints, blocks of vertices, ranges of triangles, ranges of Gaussians


@kernel
def take_parameters(timestep, motion, expression, vectors, translation):
    """Copy the parameters of a timestep to where a head's pose is taken from, as far as the head has what they move.

    Args:
        timestep: row.
        motion: rotation (t, 3), neck (t, 3), jaw (t, 3), eyes (t, 6), translation (t, 3) and expression (t, e).
        expression: (k,) out, zero where there are fewer.
        vectors: (j, 3) out: root, neck, jaw and both eyes.
        translation: (3,) out.
    """
    rotation, neck, jaw, eyes, place, weights = motion
    for j in range(min(len(vectors), 5)):
        for c in range(3):
            if j < 3:
                vectors[j, c] = (rotation if j == 0 else neck if j == 1 else jaw)[timestep, c]
            else:
                vectors[j, c] = eyes[timestep, 3 * (j - 3) + c]
    for c in range(3):
        translation[c] = place[timestep, c]
    for e in range(len(expression)):
        expression[e] = weights[timestep, e] if e < weights.shape[1] else 0


@kernel
def pose_and_place(
    turns, to_pose, timestep, fixed, factors, centre, degree, to_colour, view, to_step,
    by_rest, by_plain, step_degree, harmonics, plain, paces,
):  # fmt: skip
    """Pose a head unless it is posed; then let its Gaussians step where they have to and, if no triangle is degenerate, place them.

    Args:
        turns: (PARTS, ...) of `turns.new_turns`.
        to_pose: whether the head is not posed yet.
        timestep: whose pose it takes.
        fixed: packed, of the head: what `take_parameters` wants after a timestep; what `pose_joints` wants, but its last two; what
            `pose_vertices` wants after a range (the template, directions and what they move), then (two spaces, which `pose_joints`
            wants last), and after the number that that gives; what `triangle_frames` wants after a range (vertices, faces and limits),
            and where it writes. And of its Gaussians: (1,) int64 space; bounds of the ranges of vertices, of triangles and of Gaussians
            that are jobs of the last three parts; what these leave: of each range the first degenerate triangle, or -1, the box that
            its Gaussians reach, and whether all their colours can be drawn; what `carry_splats` wants before and after the factors of
            opacities; what `harmonic_colours` wants before and after centre and degree; and means, scales and opacities.
        factors: of opacities, or none.
        centre: (3,) of the camera.
        degree: of the harmonics in use.
        to_colour: whether Gaussians are coloured at all.
        view: parameters of the camera.
        to_step: whether Gaussians step first.
        by_rest: what `step_gaussians` wants after a range, as are the others.
        by_plain: see there.
        step_degree: see there.
        harmonics: see there.
        plain: see there.
        paces: see there.

    Returns:
        Whether no triangle is degenerate.
    """
    posing, placing = unpacked(fixed)
    parameters, joints, blend, coefficients, skin, corners, frames = posing
    count, (vertex_bounds, face_bounds, bounds), (faults, sides, fine), (own, rest), (before, after), reaching = placing
    carrying, colouring = own + (factors,) + rest, before + (centre, degree) + after  # noqa: RUF005 (Numba wants it so)
    sound = True
    if to_pose:
        if take_turn(turns[0]) == 0:
            take_parameters(timestep, *parameters)
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
            step_gaussians(bounds[job], bounds[job + 1], by_rest, by_plain, step_degree, harmonics, plain, paces)
        if sound:
            sides[job], fine[job] = place(
                bounds[job], bounds[job + 1], to_pose, carrying, colouring, to_colour, *reaching, view
            )
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
