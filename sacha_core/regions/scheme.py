"""Region schemes: which parts of a head are told apart, and from which vertex masks they are made."""

from __future__ import annotations

from dataclasses import dataclass

from sacha_core.errors import OptionError

__all__ = ["PAPER", "SCHEMES", "WIDE_EYES", "RegionScheme", "find_scheme"]


@dataclass(frozen=True)
class RegionScheme:
    """How a head is divided into regions.

    Args:
        name: by which files and options refer to it.
        regions: name of each region; a region's label is its place here.
        masks: for each region the vertex masks that it unites, by FLAME's official names.
        priority: the regions in order of who wins a vertex that several claim.
        teeth: region of the teeth triangles, which no mask covers.
        colours: sRGB of each region, 0 to 255, for pictures.
    """

    name: str
    regions: tuple[str, ...]
    masks: dict[str, tuple[str, ...]]
    priority: tuple[str, ...]
    teeth: str
    colours: tuple[tuple[int, int, int], ...]

    def label(self, region: str) -> int:
        """Give a region's label.

        Raises:
            OptionError: the scheme has no such region.
        """
        if region not in self.regions:
            raise OptionError(f"scheme {self.name!r} has no region {region!r}; it has {', '.join(self.regions)}")
        return self.regions.index(region)


# Colours after Okabe and Ito's palette, shifted a little so that dichromats tell every two apart; black is a dark grey, to be seen on black
PAPER = RegionScheme(
    name="paper",
    regions=("mouth", "eyes", "nose", "ears", "boundary", "scalp", "neck", "face"),
    masks={
        "mouth": ("lips",),
        "eyes": ("left_eyeball", "right_eyeball", "left_eye_region", "right_eye_region"),
        "nose": ("nose",),
        "ears": ("left_ear", "right_ear"),
        "boundary": ("boundary",),
        "scalp": ("scalp",),
        "neck": ("neck",),
        "face": ("face", "forehead", "eye_region"),
    },
    priority=("eyes", "mouth", "nose", "ears", "boundary", "neck", "face", "scalp"),
    teeth="mouth",
    colours=(
        (205, 85, 0), (0, 114, 178), (244, 236, 110), (0, 150, 108), (64, 64, 64), (230, 159, 0), (204, 121, 167), (86, 180, 233),
    ),
)  # fmt: skip
WIDE_EYES = RegionScheme(
    name="wide-eyes",  # the same, but brows and the surroundings of the eyes count as eyes
    regions=PAPER.regions,
    masks=PAPER.masks | {"eyes": (*PAPER.masks["eyes"], "eye_region"), "face": ("face", "forehead")},
    priority=PAPER.priority,
    teeth=PAPER.teeth,
    colours=PAPER.colours,
)
SCHEMES = {scheme.name: scheme for scheme in (PAPER, WIDE_EYES)}


def find_scheme(name: str) -> RegionScheme:
    """Give the scheme of a name.

    Raises:
        OptionError: there is none; the message lists those that there are.
    """
    if name not in SCHEMES:
        raise OptionError(f"no region scheme {name!r}; there are {', '.join(SCHEMES)}")
    return SCHEMES[name]
