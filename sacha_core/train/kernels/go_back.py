"""All that gradients go through on their way from a picture's entries to the parameters of the pose, in one call of each thread."""

from __future__ import annotations

from sacha_core.parallel.kernels.kernel import kernel
from sacha_core.parallel.kernels.lanes import LANES, inlined
from sacha_core.parallel.kernels.packed import unpacked
from sacha_core.parallel.kernels.turns import finish_turn, take_turn, wait_for_turns
from sacha_core.raster.kernels.project_backward import project_backward
from sacha_core.train.kernels.pose_backward import pose_backward, vertices_backward
from sacha_core.train.kernels.take_view import take_view

PARTS = 4  # each needs all of the one before: blocks that ranges share, ranges of chunks, blocks of vertices, the pose


@inlined
def sum_up(penalties, sound, found):
    """Write the sums of both penalties, and 1 where all is sound, else 0."""
    found[0], found[1], found[2] = 0.0, 0.0, 1.0
    for chunk in range(len(penalties)):
        found[0] += penalties[chunk, 0]
        found[1] += penalties[chunk, 1]
    for fine in sound:
        if not fine:
            found[2] = 0.0


@kernel
def go_back(turns, n, scratch, projecting, colours, notes, own, totals, last, fixed, with_mesh, largest):
    """Take a view's gradients; with the last view, settle them, and go on to the pose where it is wanted.

    Args:
        turns: (PARTS, ...) of `turns.new_turns`.
        n: how many Gaussians there are.
        scratch: of this thread, that `project_backward` works in.
        projecting: what it wants after that.
        colours: what `take_view` wants after that, as are the next three.
        notes: see there.
        own: see there.
        totals: see there.
        last: whether no other view follows.
        fixed: packed, for this thread: (g + 1,) bounds of ranges of chunks, jobs of the second part; (chunks + 1,) first Gaussian of each
            chunk; (g + 1,) bool out, whether all gradients of a range are sound and, last, whether those of the pose are; the penalties
            that `settle` leaves; (3,) float64 out, with the last view, what `sum_up` gives; what `settle` wants after the chunks before
            and after the gradients in the world; and of the head: the number of blocks of vertices, jobs of the third part, what
            `vertices_backward` wants after them, a space that it works in, the sums of each block that it leaves, what `pose_backward`
            wants after those, and float64, where it leaves the gradients by the pose.
        with_mesh: whether gradients go on to the pose; only with the last view.
        largest: that a gradient may be.
    """
    groups, rows_of, sound, penalties, found, (before, after), (blocks, skin, space, sums, joints, slopes) = unpacked(
        fixed
    )
    settling = before + totals + after
    if take_turn(turns[0]) == 0:
        for group in range(1, len(groups) - 1):
            row = rows_of[groups[group]]
            block = row // LANES * LANES
            if block < row < n:
                project_backward(block, min(block + LANES, n), scratch, *projecting)
        finish_turn(turns[0])
    wait_for_turns(turns[0], 1)
    job = take_turn(turns[1])
    while job < len(groups) - 1:
        sound[job] = take_view(
            groups[job], groups[job + 1], rows_of, n, scratch, projecting, colours, notes, own, totals, last, settling
        )
        finish_turn(turns[1])
        job = take_turn(turns[1])
    if with_mesh:
        wait_for_turns(turns[1], len(groups) - 1)
        job = take_turn(turns[2])
        while job < blocks:
            vertices_backward(job, job + 1, *skin, space, *sums)
            finish_turn(turns[2])
            job = take_turn(turns[2])
    if take_turn(turns[3]) == 0:
        wait_for_turns(turns[1], len(groups) - 1)
        if with_mesh:
            wait_for_turns(turns[2], blocks)
            pose_backward(*sums, *joints)
            fine = True
            for slope in slopes:
                fine &= abs(slope) <= largest
            sound[len(groups) - 1] = fine
        if last:
            sum_up(penalties, sound, found)
