"""The parts of a comparison of two pictures, which threads take in turn: strips of each colour, bands of the sensitivity."""

from __future__ import annotations

from sacha_core.parallel.kernels.kernel import kernel
from sacha_core.parallel.kernels.turns import take_turn
from sacha_core.perception.kernels.entropy import entropy_band
from sacha_core.perception.kernels.structural import compare_strip


@kernel
def compare_parts(
    counter, colours, edges, image, target, target_at, target_plane, pitch, unit, height, width, ssim_weight, l1_weight,
    marks, entropy_weight, gradient, space, spans, lost, l1, nats, empty,
):  # fmt: skip
    """Do the parts that are left, strips first; most arguments are those of `compare_strip` and `entropy_band`.

    Args:
        counter: (1,) int64, the first part that nobody has taken.
        colours: channels that have a target.
        edges: (strips + 1,) columns at which strips begin and end.
        image: flat, its channels one after the other.
        target: flat; the image may be a part of it.
        target_at: from a channel's beginning to where that part begins.
        target_plane: from channel to channel.
        pitch: from row to row.
        unit: of a value of `target`.
        height: of the image.
        width: of the image.
        ssim_weight: float32.
        l1_weight: float32.
        marks: flat uint8, laid out as a channel of `target`: for the channel after the colours.
        entropy_weight: float32.
        gradient: flat, out.
        space: (STRIP_SPACE,) of this thread.
        spans: (4, strip_spans(height)) of this thread.
        lost: (colours * strips, h) out.
        l1: (colours * strips, h) out.
        nats: (h,) out.
        empty: (bands,) int64 out: pixels of each band where nothing is marked or given; no band where there are no marks.
    """
    strips, bands, plane = len(edges) - 1, len(empty), height * width
    part = take_turn(counter)
    while part < colours * strips + bands:
        if (
            part < colours * strips
        ):  # a strip takes as long in one colour as in another, so that threads finish together
            strip, channel = part // colours, part % colours
            sums = channel * strips + strip
            compare_strip(
                image, channel * plane, target, target_at + channel * target_plane, pitch, unit, height, width,
                edges[strip], edges[strip + 1], ssim_weight, l1_weight, gradient, space, spans, lost[sums], l1[sums],
            )  # fmt: skip
        else:
            band = part - colours * strips
            top, bottom = height * band // bands, height * (band + 1) // bands
            empty[band] = entropy_band(
                image, colours * plane, marks, target_at, pitch, top, bottom, width, entropy_weight, gradient, nats
            )
        part = take_turn(counter)
