"""Where image and target differ, by groups of rows: all that a loss has to look at."""

from __future__ import annotations

from sacha_core.parallel.kernels.lanes import LANES, every, inlined
from sacha_core.perception.kernels.pixels import pixels
from sacha_core.perception.kernels.window import RADIUS

GROUP = 4  # rows that go together
REACH = 2  # groups beside a row's own that its windows can touch
NOWHERE = 1 << 30


def strip_spans(height: int) -> int:
    """Give how many groups a strip keeps spans of: the image's, and some without differences at both ends."""
    return -(-height // GROUP) + 4 * REACH


@inlined
def agree(image, image_at, target, target_at, unit, count):
    """Are sixteen pixels the same? False for what is not a number."""
    a, b = pixels(image, image_at, target, target_at, unit, count)
    return every((a >= b) & (a <= b))


@inlined
def around(first, last, place):
    """Give the span of five groups together, `place` in their middle."""
    low, high = first[place], last[place]
    for step in range(1, REACH + 1):
        low = min(low, first[place - step], first[place + step])
        high = max(high, last[place - step], last[place + step])
    return low, high


@inlined
def mark(image, image_at, target, target_at, pitch, unit, height, width, left, right, spans):
    """Find, for each group of rows, the columns between which the images differ, and the windows which see a difference."""
    first, last, low, high = spans[0], spans[1], spans[2], spans[3]
    groups = (height + GROUP - 1) // GROUP
    windows = (right - left + 2 * RADIUS + LANES - 1) // LANES * LANES
    begin, end = max(left - LANES, 0), min(right + LANES, width)
    for place in range(groups + 4 * REACH):
        first[place], last[place] = NOWHERE, -NOWHERE
        low[place], high[place] = NOWHERE, -NOWHERE
    for y in range(height):
        place = y // GROUP + 2 * REACH
        a, b = image_at + y * width, target_at + y * pitch
        x, stop = begin, min(first[place], end)
        while x < stop and agree(image, a + x, target, b + x, unit, width - x):
            x += LANES
        if x < stop:
            first[place] = x
        if first[place] < NOWHERE:
            x, stop = begin + (end - 1 - begin) // LANES * LANES, max(last[place], first[place])
            while x >= stop and agree(image, a + x, target, b + x, unit, width - x):
                x -= LANES
            last[place] = max(last[place], x + LANES)
    for place in range(REACH, groups + 3 * REACH):
        begin, end = around(first, last, place)
        if begin < end:
            begin = max(begin - left, 0) // LANES * LANES
            end = min((end - left + 2 * RADIUS + LANES - 1) // LANES * LANES, windows)
            if begin < end:
                low[place], high[place] = begin, end
