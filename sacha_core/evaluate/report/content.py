"""What a report says, apart from how it is set."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from sacha_core.evaluate.report.grid import Grid

__all__ = ["Content", "Picture", "Section"]


@dataclass(frozen=True)
class Picture:
    """A figure.

    Args:
        name: of its file, without suffix.
        title: what it shows, in a line.
        caption: how to read it.
        png: the file's bytes.
        svg: the same drawn with lines; None where it is made of pixels.
    """

    name: str
    title: str
    caption: str
    png: bytes
    svg: bytes | None = None


@dataclass(frozen=True)
class Section:
    """One chapter.

    Args:
        title: of the chapter.
        paragraphs: plain text.
        blocks: tables and figures in the order in which they are read.
    """

    title: str
    paragraphs: tuple[str, ...]
    blocks: tuple[Grid | Picture, ...]


@dataclass(frozen=True)
class Content:
    """A whole report.

    Args:
        title: of the report.
        summary: the outcome in a few sentences.
        conditions: what the figures were measured under, label to text.
        terms: words that the report uses, each with its explanation.
        sections: chapters.
        overview: the outcome as a table; None where there is nothing to judge.
    """

    title: str
    summary: tuple[str, ...]
    conditions: Mapping[str, str]
    terms: Mapping[str, str]
    sections: tuple[Section, ...]
    overview: Grid | None = None

    @property
    def pictures(self) -> tuple[Picture, ...]:
        """All figures, in order."""
        return tuple(block for section in self.sections for block in section.blocks if isinstance(block, Picture))
