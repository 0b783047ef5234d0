"""A folder of results: of every bench its JSON, its tables and its picture, and a page that joins them."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sacha_core.bench.machine import sentence, speed_sentence
from sacha_core.bench.plot import draw
from sacha_core.bench.registry import BENCHES
from sacha_core.bench.result import Bench
from sacha_core.bench.table import markdown
from sacha_core.errors import FormatError
from sacha_core.files import write_aside

__all__ = ["Record", "page", "read_folder", "read_runs", "section", "write_bench", "write_index", "write_picture"]


@dataclass(frozen=True)
class Record:
    """One bench's run.

    Args:
        name: of the bench.
        title: above its tables.
        preset: its extent.
        seconds: that it took.
        machine: that it ran on, see `machine.describe`.
        bench: what it found.
    """

    name: str
    title: str
    preset: str
    seconds: float
    machine: dict[str, Any]
    bench: Bench

    def to_json(self) -> dict[str, Any]:
        """Give everything as plain values."""
        about = {"bench": self.name, "title": self.title, "preset": self.preset, "bench_seconds": self.seconds}
        return {**about, "machine": self.machine, **self.bench.record()}

    @classmethod
    def from_json(cls, record: dict[str, Any]) -> Record:
        """Make the record that `to_json` gave.

        Raises:
            KeyError, TypeError: it is something else's.
        """
        name, title, preset, seconds = (record[key] for key in ("bench", "title", "preset", "bench_seconds"))
        return cls(name, title, preset, seconds, record["machine"], Bench.from_record(record))


def section(record: Record, picture: str | None = None) -> str:
    """Set one bench's findings in Markdown.

    Args:
        record: of its run.
        picture: where its picture lies, seen from the page; None for none.
    """
    bench = record.bench
    parts = [f"## {record.title}\n"]
    parts += [markdown(table, bench.of(table)) for table in bench.tables if bench.of(table)]
    if picture is not None:
        parts.append(f"![{record.title}]({picture})\n")
    parts += [f"- {note}" for note in (*bench.notes, speed_sentence(record.machine)) if note]
    return "\n".join(parts).rstrip() + "\n"


def page(records: Mapping[str, Record], pictures: str = "") -> str:
    """Set every bench's findings in Markdown, with the machine that they were measured on.

    Args:
        records: by the bench's name.
        pictures: folder of the pictures as seen from the page, with the slash at its end.
    """
    machines = dict.fromkeys(sentence({**r.machine, "load_at_start": None}) for r in records.values())
    presets = ", ".join(dict.fromkeys(r.preset for r in records.values()))
    total = sum(r.seconds for r in records.values())
    loads = [r.machine.get("load_at_start") for r in records.values()]
    known = [load for load in loads if load is not None]
    busy = f" Load average as each began: {min(known)} to {max(known)}." if known else ""
    head = f"Measured on {'; and on '.join(machines)}. Preset `{presets}`, {total / 60:.0f} minutes in all.{busy}\n"
    contents = "\n".join(f"- [{r.title}](#{anchor(r.title)})" for _, r in in_order(records)) + "\n"
    bodies = [section(r, f"{pictures}{name}.png" if r.bench.panels else None) for name, r in in_order(records)]
    return "\n".join([head, contents, *bodies])


def anchor(title: str) -> str:
    """Give the link to a heading, as GitHub makes it."""
    return "".join(letter for letter in title.lower().replace(" ", "-") if letter.isalnum() or letter in "-_")


def in_order(records: Mapping[str, Record]) -> list[tuple[str, Record]]:
    """Give the records in the order of the list of benches."""
    return [(name, records[name]) for name in BENCHES if name in records]


def write_bench(record: Record, folder: Path) -> None:
    """Write JSON, tables and picture of a bench into a folder.

    Raises:
        OSError: a file cannot be written.
    """
    picture = f"{record.name}.png" if record.bench.panels else None
    write_text(folder / f"{record.name}.json", json.dumps(plain(record.to_json()), indent=1, allow_nan=False) + "\n")
    write_text(folder / f"{record.name}.md", f"{sentence(record.machine)}\n\n{section(record, picture)}")
    if picture is not None:
        write_picture(record, folder / picture)


def write_index(records: Mapping[str, Record], folder: Path) -> None:
    """Write the page of all benches into their folder.

    Raises:
        OSError: it cannot be written.
    """
    write_text(folder / "index.md", f"# Benches\n\n{page(records)}")


def write_picture(record: Record, path: Path) -> None:
    """Draw a bench's panels as PNG.

    Raises:
        OSError: the file cannot be written.
    """
    with write_aside(path) as aside:
        aside.write_bytes(draw(record.bench, record.title))


def write_text(path: Path, text: str) -> None:
    """Write a text whole or not at all."""
    with write_aside(path) as aside:
        aside.write_text(text, encoding="utf-8")


def read_record(path: Path) -> Record:
    """Read the JSON of a bench.

    Raises:
        FormatError: the file is not a bench's.
        OSError: it cannot be read.
    """
    try:
        return Record.from_json(json.loads(path.read_text(encoding="utf-8")))
    except (ValueError, KeyError, TypeError) as error:
        raise FormatError(f"{path} is not the JSON of a bench") from error


def read_folder(folder: Path) -> dict[str, Record]:
    """Read the JSON of every bench in a folder.

    Raises:
        FormatError: there is none, or one is damaged.
        OSError: a file cannot be read.
    """
    found = {name: read_record(folder / f"{name}.json") for name in BENCHES if (folder / f"{name}.json").is_file()}
    if not found:
        raise FormatError(f"{folder} has no results of benches; expected a folder that `sacha bench all --out` wrote")
    return found


def read_runs(path: Path) -> dict[str, Record]:
    """Read a folder of results, or the JSON of one bench.

    Raises:
        FormatError: there is none, or one is damaged.
        OSError: a file cannot be read.
    """
    if path.is_dir():
        return read_folder(path)
    record = read_record(path)
    return {record.name: record}


def plain(value: Any) -> Any:
    """Give figures that are not finite as None, which JSON can hold."""
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.generic | np.ndarray):
        return plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value
