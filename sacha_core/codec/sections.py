"""What a reader does with the sections of a file, whatever its profile."""

from __future__ import annotations

from sacha_core.codec.container import Section, parse_sections
from sacha_core.errors import FormatError

__all__ = ["KNOWN", "need", "sections_of"]

KNOWN = (
    "Header", "Static", "Counts", "Hidden", "Opacity", "Scale", "Rotation", "Position", "Colour", "Harmonic", "Motion", "Binding",
    "Sensitiv", "Geometry", "Tool",
)  # fmt: skip


def sections_of(data: bytes) -> tuple[tuple[int, int], dict[str, Section]]:
    """Split a file; refuse sections that must be understood and are not known.

    Raises:
        FormatError: the container is damaged, or the file needs a newer decoder.
    """
    version, sections = parse_sections(data)
    for name, section in sections.items():
        if name[0].isupper() and name not in KNOWN:
            raise FormatError(
                f"section {name!r} must be understood to decode this file; a newer decoder is needed", section.offset
            )
    return version, sections


def need(sections: dict[str, Section], name: str) -> Section:
    """Give a section that has to be there.

    Raises:
        FormatError: it is not.
    """
    if name not in sections:
        raise FormatError(f"section {name!r} is missing")
    return sections[name]
