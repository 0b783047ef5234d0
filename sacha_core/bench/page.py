"""The performance page: text by hand around results by machine."""

from __future__ import annotations

from pathlib import Path

from sacha_core.bench.store import page, read_folder, write_picture, write_text
from sacha_core.errors import FormatError

__all__ = ["BEGIN", "END", "update_page"]

BEGIN = "<!-- results: written by `make bench-page`, edits here are lost -->"
END = "<!-- end of results -->"
PICTURES = "bench"  # folder beside the page


def update_page(target: Path, folder: Path) -> list[Path]:
    """Put the results of a folder between the page's two marks, and draw the pictures beside the page.

    Args:
        target: the page; made where there is none.
        folder: what `sacha bench all` wrote.

    Returns:
        The pictures.

    Raises:
        FormatError: the folder has no results, or the page has not the two marks in their order.
        OSError: a file cannot be read or written.
    """
    records = read_folder(folder)
    text = target.read_text(encoding="utf-8") if target.exists() else f"# Performance\n\n{BEGIN}\n{END}\n"
    before, begin, rest = text.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise FormatError(f"{target} has no place for results; expected a line {BEGIN!r} and below it {END!r}")
    pictures = []
    for name, record in records.items():
        if record.bench.panels:
            pictures.append(target.parent / PICTURES / f"{name}.png")
            write_picture(record, pictures[-1])
    write_text(target, f"{before}{BEGIN}\n\n{page(records, f'{PICTURES}/')}\n{END}{after}")
    return pictures
