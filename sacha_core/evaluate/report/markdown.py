"""A report as Markdown, with its figures beside it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from sacha_core.evaluate.report.content import Content, Picture
from sacha_core.evaluate.report.grid import Grid

__all__ = ["markdown_report"]

BREAK = {"\n": "<br>", "\r": " "}
SPECIAL = "\\`*_{}[]<>#|&"  # what Markdown or the HTML in it would take for its own


def markdown_report(content: Content, figures: Mapping[str, str]) -> str:
    """Set a report in Markdown.

    Args:
        content: what it says.
        figures: path of each figure by name, relative to the report.
    """
    return "\n\n".join(_parts(content, figures)) + "\n"


def _parts(content: Content, figures: Mapping[str, str]) -> Iterator[str]:
    yield f"# {escaped(content.title)}"
    yield from (escaped(line) for line in content.summary)
    if content.overview is not None:
        yield _table(content.overview)
    yield "## Conditions"
    yield "\n".join(f"- **{escaped(label)}**: {escaped(text)}" for label, text in content.conditions.items())
    for section in content.sections:
        yield f"## {escaped(section.title)}"
        yield from (escaped(line) for line in section.paragraphs)
        for block in section.blocks:
            yield _figure(block, figures[block.name]) if isinstance(block, Picture) else _table(block)
    yield "## Words"
    yield "\n".join(f"- **{escaped(term)}**: {escaped(text)}" for term, text in content.terms.items())


def escaped(text: str) -> str:
    """Give text that Markdown shows as it is."""
    return "".join("\\" + letter if letter in SPECIAL else BREAK.get(letter, letter) for letter in text)


def _figure(picture: Picture, path: str) -> str:
    return f"### {escaped(picture.title)}\n\n![{escaped(picture.title)}](<{path}>)\n\n{escaped(picture.caption)}"


def _table(grid: Grid) -> str:
    rule = ["---" if column == 0 else "---:" for column in range(len(grid.header))]
    lines = [[escaped(cell) for cell in grid.header], rule, *([escaped(cell) for cell in row] for row in grid.rows)]
    body = "\n".join("| " + " | ".join(line) + " |" for line in lines)
    return f"### {escaped(grid.title)}\n\n{escaped(grid.note)}\n\n{body}"
