"""The parts of a comparison of two pictures, which threads take in turn: strips of each colour, bands of the sensitivity."""

from __future__ import annotations

from sacha_core.parallel.kernels.kernel import kernel
from sacha_core.parallel.kernels.turns import take_turn
from sacha_core.perception.kernels.entropy import entropy_band
from sacha_core.perception.kernels.structural import compare_strip


@kernel
def compare_parts(
    counter, colours, edges, image, target, target_plane, pitch, unit, height, width, ssim_weight, l1_weight,
    marked, marks, marks_pitch, entropy_weight, gradient, space, spans, lost, l1, nats, empty,
):  # fmt: skip
    """Do the parts that are left, strips first; most arguments are those of `compare_strip` and `entropy_band`.

    Args:
        counter: (1,) int64, the first part that nobody has taken.
        colours: channels that have a target.
        edges: (strips + 1,) columns at which strips begin and end.
        image: flat, its channels one after the other.
        target: flat.
        target_plane: from channel to channel.
        pitch: from row to row.
        unit: of a value of `target`.
        height: of the image.
        width: of the image.
        ssim_weight: float32.
        l1_weight: float32.
        marked: whether the channel after the colours is to be compared with `marks`.
        marks: flat uint8.
        marks_pitch: from row to row.
        entropy_weight: float32.
        gradient: flat, out.
        space: (STRIP_SPACE,) of this thread.
        spans: (4, strip_spans(height)) of this thread.
        lost: (colours * strips, h) out.
        l1: (colours * strips, h) out.
        nats: (h,) out.
        empty: (strips,) int64 out: pixels of each band where nothing is marked or given.
    """
    strips, plane = len(edges) - 1, height * width
    part = take_turn(counter)
    while part < (colours + marked) * strips:
        channel, strip = part // strips, part % strips
        if channel < colours:
            compare_strip(
                image, channel * plane, target, channel * target_plane, pitch, unit, height, width,
                edges[strip], edges[strip + 1], ssim_weight, l1_weight, gradient, space, spans, lost[part], l1[part],
            )  # fmt: skip
        else:
            top, bottom = height * strip // strips, height * (strip + 1) // strips
            empty[strip] = entropy_band(
                image, channel * plane, marks, 0, marks_pitch, top, bottom, width, entropy_weight, gradient, nats
            )
        part = take_turn(counter)
