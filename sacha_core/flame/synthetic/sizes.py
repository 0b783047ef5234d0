"""How finely the synthetic head is meshed: the same shapes at every size, sampled by more or fewer triangles."""

from __future__ import annotations

from dataclasses import dataclass

from sacha_core.errors import OptionError

__all__ = ["SIZES", "Block", "Size", "size_named"]


@dataclass(frozen=True)
class Block:
    """Grid cells taken out of the skin so that a patch of rings can take their place.

    Args:
        rows: first and last row line.
        columns: first and last column line, counted from the middle of the face towards the subject's left.
    """

    rows: tuple[int, int]
    columns: tuple[int, int]


@dataclass(frozen=True)
class Size:
    """Mesh resolution of one size.

    Args:
        n_columns: columns around the head, even.
        rows: height parameter of each row line from under the crown to the bottom of the neck, in units of loft knots.
        eye: block of the left eye; the right one mirrors it.
        mouth: block of the mouth, symmetric.
        ear: block of the left ear.
        eye_rings: which rings of the eye patch are built, as positions along its section.
        mouth_rings: the same of the mouth patch.
        ear_rings: the same of the ear patch.
        eyeball_segments: longitudes of an eyeball.
        eyeball_polar_deg: polar angles of its rings from the optical axis, 90 among them.
        teeth: teeth in a row.
        columns_per_tooth: mesh columns along one tooth.
        tooth_section: which points of the cross-section of a row of teeth are built.
    """

    n_columns: int
    rows: tuple[float, ...]
    eye: Block
    mouth: Block
    ear: Block
    eye_rings: tuple[str, ...]
    mouth_rings: tuple[str, ...]
    ear_rings: tuple[str, ...]
    eyeball_segments: int
    eyeball_polar_deg: tuple[float, ...]
    teeth: int
    columns_per_tooth: int
    tooth_section: tuple[str, ...]

    @property
    def height(self) -> tuple[float, ...]:
        """Height parameter of every row, the pole of the crown first."""
        return (0.0, *self.rows)


def _rows(*per_section: int) -> tuple[float, ...]:
    """Divide each stretch between two sections of the loft into so many rows."""
    return tuple(k + (i + 1) / n for k, n in enumerate(per_section) for i in range(n))


SIZES = {
    # About FLAME's count of triangles.
    "full": Size(
        n_columns=60,
        rows=_rows(3, 2, 2, 3, 5, 5, 6, 5, 4, 3, 3, 2, 1, 2, 2, 2),
        eye=Block((12, 20), (5, 14)),
        mouth=Block((28, 34), (-11, 11)),
        ear=Block((11, 25), (19, 22)),
        eye_rings=("orbit", "fold", "crease", "lid", "margin", "margin_in", "socket"),
        mouth_rings=("around", "outline", "lip_out", "lip", "lip_in", "slit", "wet", "vestibule", "wall", "throat"),
        ear_rings=("root", "behind", "rim_behind", "rim", "rim_front", "scapha", "antihelix", "concha_edge", "concha"),
        eyeball_segments=24,
        eyeball_polar_deg=(9.0, 18.0, 26.0, 33.0, 43.0, 57.0, 73.0, 90.0, 115.0, 145.0),
        teeth=10,
        columns_per_tooth=3,
        tooth_section=("root", "front", "edge", "edge_behind", "root_behind"),
    ),
    # For tests: every part is there, none is smooth.
    "small": Size(
        n_columns=12,
        rows=(1.0, 2.6, 4.2, 5.1, 6.0, 7.2, 8.0, 9.0, 10.6, 12.6, 14.4, 16.0),
        eye=Block((3, 5), (1, 3)),
        mouth=Block((6, 8), (-2, 2)),
        ear=Block((3, 6), (4, 5)),
        eye_rings=("crease", "lid", "margin"),
        mouth_rings=("outline", "lip", "slit", "vestibule"),
        ear_rings=("root", "rim"),
        eyeball_segments=6,
        eyeball_polar_deg=(28.0, 60.0, 90.0),
        teeth=4,
        columns_per_tooth=1,
        tooth_section=("root", "edge", "root_behind"),
    ),
}


def size_named(name: str) -> Size:
    """Look a size up.

    Raises:
        OptionError: there is none of that name.
    """
    if name not in SIZES:
        raise OptionError(f"the synthetic head has no size {name!r}; it comes as {', '.join(SIZES)}")
    return SIZES[name]
