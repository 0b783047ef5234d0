"""What a `.sacha` file holds and where its bytes are, without decoding it.

Source: own.
"""

from __future__ import annotations

from dataclasses import dataclass

from sacha_core.codec.container import Section
from sacha_core.codec.decoder import Source, read_header, read_source
from sacha_core.codec.header import LOSSY, PAPER, PROFILES, Header
from sacha_core.codec.motion import read_motion_head
from sacha_core.codec.paper import OWN, coder_of
from sacha_core.codec.paper_tool import tool_name
from sacha_core.codec.sections import need, sections_of
from sacha_core.codec.whole_motion import read_frame_rate
from sacha_core.flame.model import HeadReference

__all__ = ["Inspection", "SectionSize", "inspect"]

MOTION_SECTIONS = ("Static", "Motion")
HEAD_SECTION = "head"


@dataclass(frozen=True)
class SectionSize:
    """Where a section lies.

    Args:
        name: its name in the file.
        offset: of its first byte.
        n_bytes: its length.
    """

    name: str
    offset: int
    n_bytes: int


@dataclass(frozen=True)
class Inspection:
    """What a file holds and where its bytes are.

    Args:
        version: of the format, (major, minor).
        level: 1 (smallest) to 4 (best), and between; 0 in an archive.
        profile: name of the coding profile: "lossy", "archive" or "paper".
        coder: what coded the Gaussians: "own coder", or the name of an external program (paper profile).
        head: the head model that the avatar is bound to.
        needs_head: whether decoding needs that head model.
        scheme: name of the region scheme.
        n_gaussians: Gaussians in the file.
        sh_degree: of their colours.
        n_frames: frames of motion, 0 where there is none.
        frame_rate: frames a second, None where there is no motion.
        n_groups: groups that playback can start at.
        sections: every section in file order.
        gaussian_bytes: all that describes the Gaussians, with the header and the section table.
        motion_bytes: static and dynamic motion parameters.
        head_bytes: the embedded head, 0 where there is none.
        total_bytes: of the file.
    """

    version: tuple[int, int]
    level: float
    profile: str
    coder: str
    head: HeadReference
    needs_head: bool
    scheme: str
    n_gaussians: int
    sh_degree: int
    n_frames: int
    frame_rate: float | None
    n_groups: int
    sections: tuple[SectionSize, ...]
    gaussian_bytes: int
    motion_bytes: int
    head_bytes: int
    total_bytes: int

    @property
    def dynamic_bytes_per_frame(self) -> float:
        """Bytes a frame of the section `Motion`; 0 where there is none."""
        dynamic = sum(section.n_bytes for section in self.sections if section.name == "Motion")
        return dynamic / self.n_frames if self.n_frames else 0.0


def inspect(source: Source) -> Inspection:
    """Tell what a file holds, from its header and section table alone; every checksum is verified.

    Args:
        source: the bytes of a `.sacha` file, or its path.

    Raises:
        FormatError: the file is damaged, cut, of a newer version, or no `.sacha` file at all.
        OSError: the file cannot be read.
    """
    data = read_source(source)
    version, sections = sections_of(data)
    header = read_header(data, sections)
    sizes = tuple(SectionSize(section.name, section.offset, len(section.data)) for section in sections.values())
    motion_bytes = sum(size.n_bytes for size in sizes if size.name in MOTION_SECTIONS)
    head_bytes = sum(size.n_bytes for size in sizes if size.name == HEAD_SECTION)
    frame_rate, n_groups = motion_facts(sections, header)
    return Inspection(
        version=version,
        level=header.level,
        profile=PROFILES[header.profile],
        coder=coder_name(sections, header),
        head=header.head,
        needs_head=header.needs_head,
        scheme=header.scheme,
        n_gaussians=header.n_gaussians,
        sh_degree=header.sh_degree,
        n_frames=header.n_frames,
        frame_rate=frame_rate,
        n_groups=n_groups,
        sections=sizes,
        gaussian_bytes=len(data) - motion_bytes - head_bytes,
        motion_bytes=motion_bytes,
        head_bytes=head_bytes,
        total_bytes=len(data),
    )


def motion_facts(sections: dict[str, Section], header: Header) -> tuple[float | None, int]:
    """Give the frame rate of the motion, None where there is none, and the groups that playback can start at."""
    if not header.has_motion or "Motion" not in sections:
        return None, 0
    reader = sections["Motion"].reader()
    if header.profile == LOSSY:
        motion = read_motion_head(reader, header.n_frames, header.n_expression)
        return motion.frame_rate, len(motion.groups)
    return read_frame_rate(reader), min(header.n_frames, 1)


def coder_name(sections: dict[str, Section], header: Header) -> str:
    """Tell what coded the Gaussians."""
    if header.profile != PAPER or coder_of(sections) == OWN:
        return "own coder"
    return tool_name(need(sections, "Tool").reader())
