"""`sacha bench`: a bench made for the test, run, written, compared, put on a page; and requests that make no sense."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace

import pytest

from sacha_core.bench import registry
from sacha_core.bench.registry import Place
from sacha_core.bench.result import Bench, Column, Panel, Table
from sacha_core.errors import OptionError

TABLE = Table("t", "How long it takes.", (Column("n", "Gaussians"), Column("a_ms", "time, ms")), ("n",))
PANEL = Panel("p", "t", "n", "a_ms", "Gaussians", "ms")


@pytest.fixture
def benches(monkeypatch) -> dict[str, SimpleNamespace]:
    """Three benches: one that measures, one that looks whether something holds, one that needs what is not there."""

    def drawing(preset, report):
        factor = {"quick": 1.0, "full": 10.0}[preset.extent]
        rows = [{"table": "t", "n": n, "a_ms": factor * n, "threads": preset.threads} for n in (1, 10)]
        return Bench(rows, (TABLE,), (PANEL,), ("Note.",))

    def device(preset, report):
        raise OptionError("no device\nwas found")

    made = {
        "raster": SimpleNamespace(TITLE="Drawing", measure=drawing),
        "stability": SimpleNamespace(TITLE="Cases", measure=cases()),
        "cuda": SimpleNamespace(TITLE="Device", measure=device),
    }
    places = {name: Place(name, f"Summary of {name}.", drawn=name == "raster") for name in made}
    monkeypatch.setattr(registry, "BENCHES", places)
    monkeypatch.setattr(registry, "load", made.__getitem__)
    return made


def cases(*broken: str):
    def measure(preset, report):
        return Bench([{"table": "t", "n": 1}], (TABLE,), broken=broken)

    return measure


def test_a_bench_prints_its_tables_and_writes_report_and_picture(call, benches, tmp_path: Path) -> None:
    done = call("bench", "raster", "--quick", "--threads", 2, "--plot", tmp_path / "p.png")
    assert done.status == 0, done.err
    assert (
        "How long it takes.\n\nGaussians  time, ms\n---------  --------\n        1      1.00\n       10      10.0\n\n- Note."
        in done.out
    )
    assert done.report["command"] == "bench"
    assert done.report["rows"] == [{"table": "t", "n": n, "a_ms": float(n), "threads": 2} for n in (1, 10)]
    assert done.report["machine"]["cores"] >= 1
    assert (tmp_path / "p.png").read_bytes().startswith(b"\x89PNG")
    assert call("bench", "raster").report["rows"][1]["a_ms"] == 100.0  # without --quick more


def test_all_go_into_a_folder_but_what_cannot_run_here(call, benches, tmp_path: Path) -> None:
    done = call("bench", "all", "--quick", "--out", tmp_path / "out")
    assert done.status == 0, done.err
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {
        "raster.json", "raster.md", "raster.png", "stability.json", "stability.md", "cuda.json", "cuda.md", "index.md",
    }  # fmt: skip
    assert done.report["left_out"] == {"cuda": "no device was found"}
    assert "cuda       not run: no device was found\n" in done.out
    assert "## Summary of cuda\n\n- Not run: no device was found.\n" in (tmp_path / "out" / "index.md").read_text()


def test_what_is_timed_runs_once_more(call, benches, tmp_path: Path) -> None:
    done = call("bench", "all", "--quick", "--repeat", "--out", tmp_path / "out")
    assert done.status == 0, done.err
    assert [line.split()[0] for line in done.out.splitlines() if line.endswith(" again")] == ["raster"]
    rows = json.loads((tmp_path / "out" / "raster.json").read_text())["rows"]
    assert all(row["a_again_ms"] == row["a_ms"] for row in rows)
    assert "nineteen of twenty times within a factor of 1.00" in (tmp_path / "out" / "index.md").read_text()


def test_what_does_not_hold_is_named_and_ends_with_status_1(call, benches, tmp_path: Path) -> None:
    benches["stability"].measure = cases("poison: NaN mean")
    for arguments in (("stability",), ("all", "--out", tmp_path / "out")):
        done = call("bench", *arguments)
        assert done.status == 1
        assert "stability: poison: NaN mean does not hold" in done.err
        assert done.report["broken"]
    assert (tmp_path / "out" / "index.md").exists()


def test_two_runs_are_compared(call, benches, tmp_path: Path) -> None:
    for name in "ab":
        assert call("bench", "all", "--quick", "--out", tmp_path / name).status == 0
    done = call("bench", "compare", tmp_path / "a", tmp_path / "b" / "raster.json")
    assert done.status == 0, done.err
    assert "2 times compared, 0 other figures differ." in done.out
    assert [row["ratio"] for row in done.report["rows"] if row["table"] == "times"] == [1.0, 1.0]


def test_results_are_put_on_a_page(call, benches, tmp_path: Path) -> None:
    assert call("bench", "all", "--quick", "--out", tmp_path / "a").status == 0
    done = call("bench", "page", tmp_path / "a", "--out", tmp_path / "performance.md")
    assert done.status == 0, done.err
    assert "## Drawing" in (tmp_path / "performance.md").read_text()
    assert json.loads(json.dumps(done.report["pictures"])) == [str(tmp_path / "bench" / "raster.png")]


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("nothing",), "there is no bench 'nothing'; expected one of raster, "),
        (("raster", "here"), "bench raster has no use for here"),
        (("raster", "--out", "x"), "bench raster has no use for --out"),
        (("raster", "--dataset", "x"), "bench raster has no use for --dataset"),
        (("raster", "--avatar", "x"), "bench raster has no use for --avatar"),
        (("all", "--plot", "p.png"), "bench all has no use for --plot"),
        (("raster", "--repeat"), "bench raster has no use for --repeat"),
        (("page", "a", "--quick"), "bench page has no use for --quick"),
        (("raster", "--threads", "0"), "--threads is 0, expected 1 or more"),
        (("compare", "a"), "bench compare takes 2 folders, not 1"),
        (("page",), "bench page takes 1 folder, not 0"),
        (("compare", "missing", "missing"), "missing: no such file or directory"),
        (("train", "--dataset", "missing"), "missing"),
        (("codec", "--avatar", "missing.sacha"), "missing.sacha"),
        (("codec", "missing.sacha"), "missing.sacha"),
        (("codec", "--motion", "m.npz"), "--motion belongs to a comparison: name avatars after `bench codec`"),
        (("codec", "--require", "draco"), "--require belongs to a comparison"),
        (("codec", "--frames", "out"), "--frames belongs to a comparison"),
        (("codec", "a.ply", "--codecs", "sacha, hvec"), "there is no codec 'hvec'; expected one of sacha, "),
        (("codec", "a.ply", "--codecs", " ,"), "--codecs ' ,' names none; expected names such as sacha,hevc,draco"),
        (("codec", "a.ply", "--sheet", "."), ".: is a directory"),
        (("codec", "a.ply", "--require", "hvec"), "there is no codec 'hvec'"),
        (("codec", "a.ply", "--frames", "missing"), "missing: no such file or directory"),
        (("codec", "missing.ply"), "missing.ply: no such file or directory"),
        (("codec", "."), "point_cloud.ply"),
        (("codec", __file__), "not a .sacha file"),
        (("raster", "--sheet", "s.png"), "bench raster has no use for --sheet"),
    ],
)
def test_requests_that_make_no_sense_get_one_line(call, tmp_path: Path, monkeypatch, arguments, expected: str) -> None:
    monkeypatch.chdir(tmp_path)
    done = call("bench", *arguments)
    assert done.status == 2
    assert done.err.count("\n") == 1
    assert expected in done.err
    assert not list(tmp_path.iterdir())


def test_a_bench_that_cannot_run_says_so_on_one_line(call, benches) -> None:
    done = call("bench", "cuda")
    assert (done.status, done.err) == (2, "sacha bench: no device was found\n")


def test_a_picture_that_cannot_be_written_is_refused_before_the_work(call, benches, tmp_path: Path) -> None:
    for arguments, expected in (
        (("stability", "--plot", tmp_path / "p.png"), "bench stability has no use for --plot"),
        (("raster", "--plot", tmp_path), f"{tmp_path}: is a directory"),
    ):
        benches["raster"].measure = benches["stability"].measure = None
        done = call("bench", *arguments)
        assert done.status == 2
        assert expected in done.err
