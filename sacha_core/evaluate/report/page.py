"""A report as one HTML file that needs nothing beside it."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Mapping
from html import escape

from sacha_core.evaluate.report.content import Content, Picture
from sacha_core.evaluate.report.grid import Grid
from sacha_core.evaluate.report.style import STYLE

__all__ = ["html_report"]

TONES = {"held": "held", "not held": "missed", "not decided": "open"}


def html_report(content: Content) -> str:
    """Set a report as one HTML file: style and figures inside, no scripts, nothing fetched."""
    return "\n".join(_parts(content)) + "\n"


def _parts(content: Content) -> Iterator[str]:
    yield '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">'
    yield '<meta name="viewport" content="width=device-width, initial-scale=1">'
    yield f"<title>{escape(content.title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<main>"
    yield f"<header><h1>{escape(content.title)}</h1>"
    yield from (f'<p class="summary">{escape(line)}</p>' for line in content.summary)
    links = [("conditions", "Conditions")]
    links += [(_anchor(k), section.title) for k, section in enumerate(content.sections)]
    links += [("words", "Words")]
    linked = [f'<a href="#{anchor}">{escape(title)}</a>' for anchor, title in links]
    yield f"<nav>{' · '.join(linked)}</nav>"
    if content.overview is not None:
        yield _table(content.overview)
    yield "</header>"
    yield _list("conditions", "Conditions", content.conditions)
    for k, section in enumerate(content.sections):
        yield f'<section id="{_anchor(k)}"><h2>{escape(section.title)}</h2>'
        yield from (f"<p>{escape(line)}</p>" for line in section.paragraphs)
        for block in section.blocks:
            yield _figure(block) if isinstance(block, Picture) else _table(block)
        yield "</section>"
    yield _list("words", "Words", content.terms)
    yield "</main>\n</body>\n</html>"


def _anchor(place: int) -> str:
    return f"part-{place + 1}"


def _figure(picture: Picture) -> str:
    kind, drawn = ("png", picture.png) if picture.svg is None else ("svg+xml", picture.svg)
    width = "" if picture.svg is None else ' class="lines"'
    source = f"data:image/{kind};base64,{base64.b64encode(drawn).decode('ascii')}"
    return (
        f'<figure id="{escape(picture.name)}"><h3>{escape(picture.title)}</h3>'
        f'<img{width} src="{source}" alt="{escape(picture.title)}"><figcaption>{escape(picture.caption)}</figcaption></figure>'
    )


def _table(grid: Grid) -> str:
    head = "".join(f'<th scope="col">{escape(cell)}</th>' for cell in grid.header)
    rows = "".join(f"<tr>{''.join(_cell(cell, place) for place, cell in enumerate(row))}</tr>\n" for row in grid.rows)
    table = f'<div class="wide"><table><thead><tr>{head}</tr></thead>\n<tbody>{rows}</tbody></table></div>'
    note = f'<p class="note">{escape(grid.note)}</p>'
    if grid.folded:
        return f"<details><summary>{escape(grid.title)}</summary>{note}{table}</details>"
    return f'<div class="table"><h3>{escape(grid.title)}</h3>{note}{table}</div>'


def _cell(text: str, place: int) -> str:
    first, _, rest = text.partition("\n")
    if place == 0:
        return f'<th scope="row">{escape(first)}{_second(rest)}</th>'
    tone = TONES.get(first.partition(":")[0])
    shown = escape(first) if tone is None else f'<span class="{tone}">{escape(first)}</span>'
    words = "" if tone or any(letter.isdigit() for letter in first) else ' class="words"'
    return f"<td{words}>{shown}{_second(rest)}</td>"


def _second(text: str) -> str:
    """Set a cell's second line."""
    return f"<small>{escape(text)}</small>" if text else ""


def _list(anchor: str, title: str, entries: Mapping[str, str]) -> str:
    lines = "".join(f"<dt>{escape(label)}</dt><dd>{escape(text)}</dd>\n" for label, text in entries.items())
    return f'<section id="{anchor}"><h2>{title}</h2><dl>{lines}</dl></section>'
