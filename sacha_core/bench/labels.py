"""Writing beside points without writing over anything."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.transforms import Bbox

__all__ = ["Spot", "place_labels"]

SIZE = 8  # points
POINT = 4.0  # half width of a marker, pixels
GAP = 4.0
STEPS = 16  # how many heights are tried on each side


@dataclass(frozen=True)
class Spot:
    """A point, in the axes' own numbers.

    Args:
        x: where it lies.
        y: likewise.
        left: end of its bar, `x` where it has none.
        right: likewise.
        text: what to write beside it; nothing where this is empty, but no other label covers the point.
        colour: in which colour.
    """

    x: float
    y: float
    left: float
    right: float
    text: str
    colour: str


def place_labels(axes: Axes, spots: list[Spot]) -> None:
    """Write a text beside each point: as near as there is room inside the axes, with a thin line to the point where it is not next to it.

    Args:
        axes: laid out already.
        spots: in the order in which they get a place.
    """
    from matplotlib.transforms import Bbox  # noqa: PLC0415 (slow to import)

    def pixels(x: float, y: float) -> tuple[float, float]:
        at_x, at_y = axes.transData.transform((x, y))
        return float(at_x), float(at_y)

    marks = []
    for spot in spots:
        (left, y), (right, _) = pixels(spot.left, spot.y), pixels(spot.right, spot.y)
        marks.append(Bbox.from_extents(left - POINT, y - POINT, right + POINT, y + POINT))
    taken, room = list(marks), axes.get_window_extent()
    for spot, mark in [(spot, mark) for spot, mark in zip(spots, marks, strict=True) if spot.text]:
        note = axes.annotate(
            spot.text, (spot.x, spot.y), fontsize=SIZE, color=spot.colour, va="center", annotation_clip=False
        )
        size = note.get_window_extent()
        x, y = pixels(spot.x, spot.y)
        box = _nearest_free(x, mark, size.width, size.height, taken, room)
        taken.append(box)
        middle = (box.y0 + box.y1) / 2
        note.set_position(((box.x0 - x) * 72 / axes.figure.dpi, (middle - y) * 72 / axes.figure.dpi))
        note.anncoords = "offset points"
        if abs(middle - y) > box.height / 2:
            end = axes.transData.inverted().transform((box.x0 if box.x0 > x else box.x1, middle))
            axes.plot([spot.x, end[0]], [spot.y, end[1]], color=spot.colour, linewidth=0.5, scalex=False, scaley=False)


def _nearest_free(x: float, mark: Bbox, width: float, height: float, taken: list[Bbox], room: Bbox) -> Bbox:
    """Give the box nearest to a mark that overlaps nothing: to its right or left or across x, at its height or further and further away."""
    from matplotlib.transforms import Bbox  # noqa: PLC0415

    first = None
    lefts = (mark.x1 + GAP, mark.x0 - GAP - width, x - width / 2)
    for step, left in product(sorted(range(-STEPS, STEPS + 1), key=abs), lefts):
        low = (mark.y0 + mark.y1 - height) / 2 + step * height * 0.6
        box = Bbox.from_extents(left, low, left + width, low + height)
        first = first or box
        inside = room.x0 <= box.x0 and box.x1 <= room.x1 and room.y0 <= box.y0 and box.y1 <= room.y1
        if inside and not any(box.overlaps(other) for other in taken):
            return box
    assert first is not None
    return first
