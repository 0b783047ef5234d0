"""Section `Header`: what the file holds, before any of it is decoded.

Source: own.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, replace

from sacha_core.avatar.motion import Motion
from sacha_core.codec.reading import ByteReader, pack_text
from sacha_core.flame.model import HeadReference

__all__ = ["ARCHIVE", "LOSSY", "PAPER", "PROFILES", "Header"]

LAYOUT = "BhBBIIIIIII"  # profile, level in hundredths, SH degree, flags, then seven counts as in Header
LOSSY, ARCHIVE, PAPER = 0, 1, 2  # profiles
PROFILES = ("lossy", "archive", "paper")
HUNDREDTHS = 100
MAX_LEVEL = 1000  # hundredths
# what a file may decode to is bounded by its size, so that a few bytes cannot ask for hours or gigabytes
FREE_ATTRIBUTES, ATTRIBUTES_PER_BYTE = 1 << 16, 64
FREE_ADAPTIVE, ADAPTIVE_PER_BYTE = 1 << 15, 4
FREE_FRAMES, FRAMES_PER_BYTE = 1 << 15, 32  # numbers of frames, most of which may cost a hundredth of a bit
HAS_MOTION, NEEDS_HEAD, HAS_SENSITIVITY = 1, 2, 4  # flags


@dataclass(frozen=True)
class Header:
    """What the file holds.

    Args:
        level: 1 (smallest) to 4 (best) and between: what the encoder chose; 0 in an archive. The decoder does not need it.
        n_gaussians: Gaussians in the file.
        sh_degree: 0 to 3.
        head: the head model that they are bound to.
        scheme: name of the region scheme.
        n_frames: frames of motion; 0 with `has_motion` false where there is none.
        n_expression: expression weights a frame.
        n_shape: identity coefficients.
        n_offsets: vertices with a personal offset, 0 or as many as the head has.
        has_motion: whether there is a motion.
        needs_head: whether decoding needs the head model, for the order and sizes of its triangles.
        profile: `LOSSY`, `ARCHIVE` or `PAPER`: how everything is coded.
        has_sensitivity: whether the Gaussians have sensitivity logits; only in an archive.
    """

    level: float
    n_gaussians: int
    sh_degree: int
    head: HeadReference
    scheme: str
    n_frames: int = 0
    n_expression: int = 0
    n_shape: int = 0
    n_offsets: int = 0
    has_motion: bool = False
    needs_head: bool = False
    profile: int = LOSSY
    has_sensitivity: bool = False

    @property
    def n_harmonics(self) -> int:
        """SH coefficients of degree 1 and up."""
        return (self.sh_degree + 1) ** 2 - 1

    @property
    def n_attributes(self) -> int:
        """How many numbers the Gaussians have."""
        return self.n_gaussians * (14 + 3 * self.n_harmonics)

    @property
    def n_adaptive(self) -> int:
        """How many adaptive integers there are, which take longer to decode: counts and what is said of a motion once."""
        static = self.n_shape + 3 * self.n_offsets
        bindings = self.n_gaussians if self.profile == ARCHIVE else self.head.n_faces
        return bindings + static + self.n_expression + 18

    @property
    def n_frame_numbers(self) -> int:
        """How many numbers the frames of the motion have."""
        return self.n_frames * (self.n_expression + 18)

    def missing_bytes(self, file_bytes: int) -> int:
        """How many bytes a file of this size lacks to answer for what it says; 0 or less where it does."""
        attributes = self.n_attributes - FREE_ATTRIBUTES - ATTRIBUTES_PER_BYTE * file_bytes
        adaptive = self.n_adaptive - FREE_ADAPTIVE - ADAPTIVE_PER_BYTE * file_bytes
        frames = self.n_frame_numbers - FREE_FRAMES - FRAMES_PER_BYTE * file_bytes
        return max(
            -(-attributes // ATTRIBUTES_PER_BYTE), -(-adaptive // ADAPTIVE_PER_BYTE), -(-frames // FRAMES_PER_BYTE)
        )

    def telling(self, motion: Motion) -> Header:
        """Give the header of a file that has this motion too."""
        return replace(
            self,
            n_frames=len(motion),
            n_expression=motion.expression.shape[1],
            n_shape=len(motion.shape),
            n_offsets=len(motion.static_offset),
            has_motion=True,
        )

    def pack(self) -> bytes:
        """Write the section."""
        fixed = struct.pack(
            "<" + LAYOUT,
            self.profile,
            round(self.level * HUNDREDTHS),
            self.sh_degree,
            HAS_MOTION * self.has_motion | NEEDS_HEAD * self.needs_head | HAS_SENSITIVITY * self.has_sensitivity,
            self.n_gaussians,
            self.head.n_vertices,
            self.head.n_faces,
            self.n_frames,
            self.n_expression,
            self.n_shape,
            self.n_offsets,
        )
        return fixed + bytes.fromhex(self.head.sha256) + pack_text(self.head.name) + pack_text(self.scheme)

    @classmethod
    def unpack(cls, reader: ByteReader, file_bytes: int) -> Header:
        """Read the section.

        Args:
            reader: over the section.
            file_bytes: size of the whole file, which bounds what the header may claim.

        Raises:
            FormatError: an unknown profile, counts that contradict each other, or more numbers than the file may hold.
        """
        profile, level, sh_degree, flags, *counts = reader.unpack(LAYOUT)
        digest = reader.take(32).hex()
        name, scheme = reader.text(), reader.text()
        n_gaussians, n_vertices, n_faces, n_frames, n_expression, n_shape, n_offsets = counts
        reader.check_end()
        if profile >= len(PROFILES) or abs(level) > MAX_LEVEL:
            raise reader.error(
                f"profile {profile} at level {level / HUNDREDTHS:g}; this decoder knows profiles 0 to {len(PROFILES) - 1}, "
                f"levels up to +-{MAX_LEVEL // HUNDREDTHS}"
            )
        if sh_degree > 3:
            raise reader.error(f"spherical harmonics of degree {sh_degree}, at most 3")
        allowed = (HAS_MOTION | NEEDS_HEAD, HAS_MOTION | HAS_SENSITIVITY, HAS_MOTION)[profile]
        if flags & ~allowed or (not flags & HAS_MOTION and any(counts[3:])):
            raise reader.error(f"flags {flags} with {n_frames} frames, {n_shape} shape and {n_offsets} offset rows")
        if n_offsets not in (0, n_vertices):
            raise reader.error(f"{n_offsets} vertex offsets for a head of {n_vertices} vertices")
        head = HeadReference(name, digest, n_vertices, n_faces)
        motion = (n_frames, n_expression, n_shape, n_offsets, bool(flags & HAS_MOTION))
        told = (bool(flags & NEEDS_HEAD), profile, bool(flags & HAS_SENSITIVITY))
        header = cls(level / HUNDREDTHS, n_gaussians, sh_degree, head, scheme, *motion, *told)
        if header.missing_bytes(file_bytes) > 0:
            raise reader.error(
                f"{n_gaussians} Gaussians, {n_faces} triangles and {n_frames} frames claimed, more than {file_bytes} bytes may hold"
            )
        return header
