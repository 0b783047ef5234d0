"""All that one view's gradients go through, chunk by chunk: what a chunk needs stays in the cache from one part to the next."""

from __future__ import annotations

from sacha_core.parallel.kernels.kernel import kernel
from sacha_core.parallel.kernels.lanes import LANES, inlined
from sacha_core.raster.kernels.harmonics import harmonic_gradients
from sacha_core.raster.kernels.project_backward import project_backward
from sacha_core.train.kernels.settle import note_view, settle


@kernel
def accumulate(start, stop, anew, own, totals):
    """Add the gradients `start` to `stop` of one view to the sums over views, or begin the sums with them."""
    for i in range(start, stop):
        totals[i] = own[i] if anew else totals[i] + own[i]


@inlined
def whole_blocks(start, stop, n):
    """Give the bounds of the blocks of sixteen that lie in a range alone; the last of all does, too, though it may have fewer."""
    return (start + LANES - 1) // LANES * LANES, stop if stop == n else stop // LANES * LANES


@kernel
def take_view(first, last, rows_of, n, scratch, projecting, colours, notes, own, totals, last_view, settling):
    """Add a view's gradients of the chunks `first` to `last`, and settle them with the last view.

    Those blocks of sixteen Gaussians that belong to two ranges of chunks must have come back through the projection before (`go_back`).

    Args:
        first: chunk.
        last: end of the range of chunks.
        rows_of: (chunks + 1,) first Gaussian of each chunk.
        n: how many Gaussians there are.
        scratch: that `project_backward` works in.
        projecting: what it wants after that.
        colours: what `harmonic_gradients` wants after the rows.
        notes: what `note_view` wants after the rows; its first tells whether this is the first view.
        own: flat gradients by the splats, those by the opacities the last but one.
        totals: likewise, sums over views; `own` itself where there is but one.
        last_view: whether no other follows.
        settling: what `settle` wants after the chunks.

    Returns:
        Whether all gradients are sound.
    """
    good = True
    block, end = whole_blocks(rows_of[first], rows_of[last], n)
    for chunk in range(first, last):
        start, stop = rows_of[chunk], rows_of[chunk + 1]
        upper = min((stop + LANES - 1) // LANES * LANES, end)
        if block < upper:
            project_backward(block, upper, scratch, *projecting)
            block = upper
        harmonic_gradients(start, stop, *colours)
        note_view(start, stop, *notes)
        if not (notes[0] and last_view):
            n = len(own[3])
            for k in range(len(own)):
                width = len(own[k]) // max(n, 1)
                accumulate(width * start, width * stop, notes[0], own[k], totals[k])
        if last_view:
            good &= settle(chunk, chunk + 1, *settling)
    return good
