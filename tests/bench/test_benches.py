"""Every bench once, on as little as possible: its rows are what its tables, its picture and comparison take them for."""

from __future__ import annotations

import json
import sys

import pytest

from sacha_core.bench.compare import compare_runs
from sacha_core.bench.plot import draw
from sacha_core.bench.preset import Preset
from sacha_core.bench.registry import BENCHES, load
from sacha_core.bench.result import Bench
from sacha_core.bench.store import Record, plain, section
from sacha_core.errors import OptionError
from sacha_core.progress import silent

RASTER_KEYS = {"n", "height", "width", "channels", "threads", "forward_ms", "backward_ms", "total_ms", "max_error"}
PIXEL = 2e-5  # float32 rounding of some tens of blended terms, as in the tests of the rasteriser
MEASURED = ("raster", "posing", "codec", "motion", "train", "playback")
_found: dict[str, Bench] = {}


def found(name: str) -> Bench:
    """Run a bench once for all tests."""
    if name not in _found:
        _found[name] = load(name).measure(Preset("tiny", threads=2), silent)
    return _found[name]


@pytest.mark.parametrize("name", BENCHES)
def test_every_bench_has_a_title_and_says_what_it_measures(name: str) -> None:
    assert load(name).TITLE
    assert BENCHES[name].summary.endswith(".")


def test_a_bench_without_its_package_says_what_to_install(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "sacha_core.bench.raster", None)
    with pytest.raises(ModuleNotFoundError, match="raster"):  # not for want of a package
        load("raster")
    monkeypatch.delitem(sys.modules, "sacha_core.bench.raster")
    monkeypatch.delitem(sys.modules, "sacha_core.bench.exact", raising=False)
    monkeypatch.delitem(sys.modules, "sacha_core.bench.picture_error", raising=False)
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(OptionError, match=r"bench raster needs the package torch: pip install 'sacha\[bench\]'"):
        load("raster")


@pytest.mark.parametrize("name", MEASURED)
def test_rows_belong_to_tables_and_are_told_apart_by_their_identity(name: str) -> None:
    bench = found(name)
    assert {row["table"] for row in (*bench.rows, *bench.more)} == {table.name for table in bench.tables}
    for table in bench.tables:
        rows = bench.of(table)
        identities = {tuple(row.get(key) for key in table.identity) for row in rows}
        assert len(identities) == len(rows)
        for column in table.columns:
            assert any(column.key in row for row in rows), (table.name, column.key)


@pytest.mark.parametrize("name", MEASURED)
def test_times_are_positive_and_lie_between_their_quartiles(name: str) -> None:
    for row in found(name).rows:
        for key in [key for key in row if f"{key.removesuffix('_ms')}_q1_ms" in row]:
            stem = key.removesuffix("_ms")
            assert 0 < row[f"{stem}_min_ms"] <= row[f"{stem}_q1_ms"] <= row[key] <= row[f"{stem}_q3_ms"]


@pytest.mark.parametrize("name", MEASURED)
def test_findings_are_written_drawn_and_agree_with_themselves(name: str) -> None:
    bench = found(name)
    record = Record(name, load(name).TITLE, "tiny", 1.0, {}, bench)
    again = Record.from_json(json.loads(json.dumps(plain(record.to_json()), allow_nan=False)))
    text = section(again)
    assert all(table.caption in text for table in bench.tables)
    assert bool(bench.panels) == BENCHES[name].drawn
    assert draw(again.bench, record.title).startswith(b"\x89PNG")
    speeds, *rows = compare_runs({name: record}, {name: record})
    assert speeds["table"] == "speeds"
    assert rows
    assert all(row["table"] == "times" and row["ratio"] == 1 for row in rows)


def test_every_row_of_the_raster_bench_has_scene_time_and_error() -> None:
    rows = found("raster").rows
    assert all(row.keys() >= RASTER_KEYS for row in rows)
    assert max(row["max_error"] for row in rows if row["table"] in {"sizes", "gaussians", "peers"}) < PIXEL


def test_what_leaves_out_nothing_that_shows_changes_nothing() -> None:
    """Crops and the missing channel are the same bits; less of the harmonics is not."""
    changes = {row["option"]: row["change"] for row in found("raster").rows if row["table"] == "options"}
    same = ("whole picture", "cropped to the avatar", "a region of 128 x 128", "no sensitivity channel")
    assert [changes[name] for name in same] == [0, 0, 0, 0]
    assert 0 < changes["colours kept within 0.5°"] < changes["SH degree 0"]


def test_posing_errors_are_those_of_the_number_format() -> None:
    errors = {
        (row["method"], row["dtype"]): row["max_error_mm"] for row in found("posing").rows if row["table"] == "methods"
    }
    assert errors["NumPy", "float64"] == 0
    assert errors["compiled", "float64"] < 1e-10
    assert 1e-7 < errors["compiled", "float32"] < 1e-3


def test_better_levels_cost_more_bytes_and_show_a_better_picture() -> None:
    levels = [row for row in found("codec").rows if row["table"] == "levels"]
    assert [row["level"] for row in levels] == [1, 2, 3, 4]
    for key in ("total_kb", "gaussians_kb", "motion_kb", "psnr"):
        values = [row[key] for row in levels]
        assert values == sorted(values), key


def test_ratios_are_of_the_times_beside_them_and_stages_make_up_the_iteration() -> None:
    rows = found("train").rows
    for row in (row for row in rows if row["table"] == "iteration"):
        assert row["raster_ratio"] == pytest.approx(row["iteration_ms"] / row["raster_ms"])
        assert row["cropped_ratio"] == pytest.approx(row["iteration_ms"] / row["cropped_ms"])
    for threads in (1, 2):
        stages = {
            row["stage"]: row["stage_ms"] for row in rows if row["table"] == "stages" and row["threads"] == threads
        }
        whole = stages.pop("the whole iteration")
        assert {"Adam, pose, place and colour", "loss", "gradients"} <= stages.keys()
        assert min(stages.values()) > 0
        assert sum(stages.values()) == pytest.approx(whole)


def test_a_budget_names_what_came_of_it() -> None:
    (row,) = (row for row in found("train").rows if row["table"] == "budget")
    assert row["iterations"] == 20
    assert row["train_s"] > 0
    assert 5 < row["view_psnr"] < 60
    assert 5 < row["expression_psnr"] < 60


def test_playing_shows_what_the_plain_way_shows_and_keeping_colours_nearly() -> None:
    rows = {row["case"]: row for row in found("playback").rows if row["table"] == "playing"}
    for name, row in rows.items():
        exact = "kept" not in name and "degree" not in name
        assert row["rare_error"] < (PIXEL if exact else 0.2), name
    assert rows["nothing moves"]["frame_busy_ms"] < rows["usual"]["frame_busy_ms"] / 5
    assert rows["camera moves, colours kept within 2°"]["rare_error"] > 10 * rows["camera moves"]["rare_error"]
    assert rows["SH degree 0"]["rare_error"] > 10 * rows["usual"]["rare_error"]


def test_stages_of_playing_are_parts_of_the_frame() -> None:
    shares = [row["share_ratio"] for row in found("playback").rows if row["table"] == "stages"]
    assert min(shares) > 0
    assert sum(shares) < 1
