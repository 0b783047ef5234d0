"""The folder of results and the page made of it."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image

from sacha_core.bench.page import BEGIN, END, update_page
from sacha_core.bench.result import Bench, Column, Panel, Table
from sacha_core.bench.store import Record, read_folder, write_bench, write_index
from sacha_core.errors import FormatError

MACHINE = {
    "processor": "Abacus",
    "cores": 2,
    "caches": {"L1": "48 KiB"},
    "memory_gib": 24,
    "system": "S",
    "python": "3.11",
    "numpy": "2",
}


def found(name: str, *, panels: bool = True) -> Record:
    rows = [{"table": "t", "n": n, "a_ms": 2.0 * n} for n in (1, 10)]
    table = Table("t", "How long it takes.", (Column("n", "Gaussians"), Column("a_ms", "time, ms")), ("n",))
    panel = Panel("p", "t", "n", "a_ms", "Gaussians", "ms")
    bench = Bench(rows, (table,), (panel,) if panels else (), ("Read this.",))
    return Record(name, f"The {name}", "quick", 60.0, MACHINE | {"load_at_start": 0.5}, bench)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    records = {"codec": found("codec"), "raster": found("raster"), "skips": found("skips", panels=False)}
    for record in records.values():
        write_bench(record, tmp_path / "results")
    write_index(records, tmp_path / "results")
    return tmp_path / "results"


def test_a_folder_holds_tables_pictures_and_an_index(folder: Path) -> None:
    assert sorted(path.name for path in folder.iterdir()) == [
        "codec.json", "codec.md", "codec.png", "index.md", "raster.json", "raster.md", "raster.png", "skips.json", "skips.md",
    ]  # fmt: skip
    index = (folder / "index.md").read_text()
    assert (
        index.index("The raster") < index.index("The codec") < index.index("The skips")
    )  # the order of the list of benches
    assert (
        "Measured on Abacus, 2 cores (L1 48 KiB), 24 GiB; S; Python 3.11, numpy 2. Preset `quick`, 3 minutes in all."
        in index
    )
    assert "| 10 | 20.0 |" in index
    assert "- [The raster](#the-raster)\n- [The codec](#the-codec)" in index
    assert "![The codec](codec.png)" in index
    assert "skips.png" not in index
    assert "load average 0.5 at the start" in (folder / "codec.md").read_text()
    assert {name: record.bench.rows for name, record in read_folder(folder).items()} == {
        name: found(name).bench.rows for name in ("raster", "codec", "skips")
    }


def test_the_page_keeps_what_is_written_by_hand(folder: Path, tmp_path: Path) -> None:
    page = tmp_path / "docs" / "performance.md"
    page.parent.mkdir()
    page.write_text(f"# By hand\n\n{BEGIN}\nold results\n{END}\n\nAlso by hand.\n")
    pictures = update_page(page, folder)
    once = page.read_text()
    assert once.startswith(f"# By hand\n\n{BEGIN}\n\nMeasured on Abacus")
    assert once.endswith(f"{END}\n\nAlso by hand.\n")
    assert "old results" not in once
    assert "![The raster](bench/raster.png)" in once
    assert pictures == [page.parent / "bench" / name for name in ("raster.png", "codec.png")]
    for picture in pictures:
        with Image.open(picture) as image:
            assert image.format == "PNG"
    update_page(page, folder)
    assert page.read_text() == once


def test_a_page_is_made_where_there_is_none(folder: Path, tmp_path: Path) -> None:
    update_page(tmp_path / "new.md", folder)
    assert (tmp_path / "new.md").read_text().startswith(f"# Performance\n\n{BEGIN}")


def test_a_page_without_a_place_is_refused_and_stays(folder: Path, tmp_path: Path) -> None:
    page = tmp_path / "performance.md"
    for text in ("# By hand\n", f"{END}\n{BEGIN}\n"):
        page.write_text(text)
        with pytest.raises(FormatError, match="no place for results"):
            update_page(page, folder)
        assert page.read_text() == text


@pytest.mark.parametrize("text", ["", "[]", '{"bench": "raster"}', "{" * 9, '{"rows": 1, "tables": 2}'])
def test_what_is_no_result_is_refused(folder: Path, text: str) -> None:
    (folder / "codec.json").write_text(text)
    with pytest.raises(FormatError, match=r"codec\.json is not the JSON of a bench"):
        read_folder(folder)


def test_an_empty_folder_has_no_results(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="no results of benches"):
        read_folder(tmp_path)
