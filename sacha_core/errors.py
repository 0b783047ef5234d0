"""Errors that a caller may want to catch; every message says what was wrong, where, and what was expected."""

from __future__ import annotations

__all__ = [
    "DatasetError",
    "FormatError",
    "GeometryError",
    "HeadError",
    "MissingHeadError",
    "MissingMasksError",
    "OptionError",
    "ProgramError",
    "SachaError",
    "TopologyError",
    "VersionError",
]


class SachaError(Exception):
    """Anything wrong with what SACHA was given; the command line prints it as one line and exits with 2."""


class FormatError(SachaError):
    """A file's bytes are not what its format promises.

    Args:
        message: what was wrong and what was expected.
        offset: byte offset of the fault from the start of the file, where one is known.
    """

    def __init__(self, message: str, offset: int | None = None) -> None:
        super().__init__(message if offset is None else f"{message} (at byte {offset})")
        self.reason = message
        self.offset = offset


class VersionError(FormatError):
    """A file is of a version that this program does not read; the message says which it reads."""


class GeometryError(SachaError):
    """A mesh or a transform is degenerate; the message names the first offender."""


class HeadError(SachaError):
    """A head model is missing, of another topology, or not the one that an avatar is bound to."""


class MissingHeadError(HeadError):
    """A head model that is needed is nowhere to be found; the message says which, and where it was looked for."""


class MissingMasksError(HeadError):
    """A head brings no vertex masks, from which its regions are made."""


class TopologyError(HeadError):
    """A mesh, masks or a head have other triangles than what they are to be used with."""


class DatasetError(SachaError):
    """A capture on disk is incomplete or inconsistent; the message names the file."""


class OptionError(SachaError):
    """An option has a value that makes no sense; the message names the option and its range."""


class ProgramError(SachaError):
    """Another program could not be started, failed, or took too long; the message names it and gives the last that it said."""
