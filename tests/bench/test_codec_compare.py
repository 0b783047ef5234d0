"""Comparing codecs: what equal pictures cost by hand-made curves, and a small run from avatars to tables, curves and pictures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sacha_core.bench.codec_compare import compare_codecs, sheet_paths, subject_names
from sacha_core.bench.codec_rows import EQUAL_DB, equal_rows
from sacha_core.bench.codec_scene import Extent, judge, make_scene
from sacha_core.bench.plot import draw
from sacha_core.bench.preset import Comparison, Preset, Subject
from sacha_core.bench.result import Bench
from sacha_core.bench.scenes import made_avatar
from sacha_core.errors import OptionError
from sacha_core.evaluate.peers import registry
from sacha_core.evaluate.peers.registry import PEERS
from sacha_core.evaluate.rate_distortion import rd_curve
from sacha_core.progress import silent
from sacha_core.raster.rasteriser import Rasteriser

AVATAR, HEAD = made_avatar(300, 1, 3)
FEW = ("sacha", "ply", "xz", "draco")
_found: dict[str, Bench] = {}


def subject(path: str = "made.sacha") -> Subject:
    return Subject(AVATAR, HEAD, Path(path))


@pytest.fixture(scope="module")
def found(tmp_path_factory) -> tuple[Bench, Path]:
    """Compare a few codecs on two avatars, once for all tests."""
    sheet = tmp_path_factory.mktemp("sheet") / "look.png"
    comparison = Comparison((subject("a/made.sacha"), subject("b/model")), FEW, ("sacha",), sheet)
    return compare_codecs(comparison, Preset("tiny", threads=1), silent), sheet


def test_rows_belong_to_tables_and_are_told_apart_by_their_identity(found) -> None:
    bench, _ = found
    shown = {row["table"] for row in bench.rows if not row["table"].startswith("curve ")}
    assert shown == {table.name for table in bench.tables}
    for table in bench.tables:
        rows = bench.of(table)
        assert len({tuple(row.get(key) for key in table.identity) for row in rows}) == len(rows)
    assert [row["codec"] for row in bench.rows if row["table"] == "codecs"] == list(FEW)


def test_every_codec_that_is_there_has_points_and_a_curve_or_no_error(found) -> None:
    bench, _ = found
    points = [row for row in bench.rows if row["table"] == "points"]
    there = [name for name in FEW if PEERS[name].lacking() is None]
    assert not [row for row in points if row.get("failure")]
    for avatar in ("made", "b"):
        assert list(dict.fromkeys(row["codec"] for row in points if row["avatar"] == avatar)) == there
    for row in points:
        assert row["kb"] > 0
        assert ("psnr" in row) == (not PEERS[row["codec"]].lossless)
    sizes = {row["setting"]: row["kb"] for row in points if row["codec"] == "sacha" and row["avatar"] == "made"}
    assert list(sizes.values()) == sorted(sizes.values())


def test_the_comparison_is_drawn_and_set_side_by_side(found) -> None:
    bench, sheet = found
    assert len(bench.panels) == 2
    assert draw(bench, "Codecs").startswith(b"\x89PNG")
    told = sheet_paths(Comparison((subject("a/made.sacha"), subject("b/model")), sheet=sheet))
    assert [path.name for path in told] == ["look-made.png", "look-b.png"]
    assert set(sheet.parent.iterdir()) == set(told)
    assert sheet_paths(Comparison((subject(),), sheet=sheet)) == [sheet]
    assert sheet_paths(Comparison((subject(),))) == []


def test_half_the_bytes_at_every_quality_is_half_at_equal_quality_and_a_rate_of_minus_half() -> None:
    """Oracle: curves that are a factor of two apart."""
    theirs = [(40_000 * 1.1 ** (db - 30), db) for db in range(30, 51, 4)]
    curves = {"sacha": rd_curve([(size / 2, db) for size, db in theirs]), "other": rd_curve(theirs)}
    ours, other, best = equal_rows("a", curves)
    own = {"sacha-rules": curves["sacha"], "sacha-fitted": curves["sacha"]}
    assert equal_rows("a", {**curves, **own})[-1] == best  # ours are none of the others
    for quality in EQUAL_DB:
        assert other[f"kb_{quality}"] == pytest.approx(40 * 1.1 ** (quality - 30), rel=1e-6)
        assert ours[f"kb_{quality}"] == pytest.approx(other[f"kb_{quality}"] / 2)
        assert other[f"fewer_{quality}"] == pytest.approx(50)
        assert best[f"fewer_{quality}"] == pytest.approx(50)
    assert other["bd_rate"] == pytest.approx(-50)


def test_what_is_not_reached_stays_empty() -> None:
    curves = {"sacha": rd_curve([(1e4, 30.0), (2e4, 36.0)]), "other": rd_curve([(3e5, 50.0)])}
    rows = equal_rows("a", curves)
    assert rows[1]["kb_35"] is None
    assert "fewer_35" not in rows[1]
    assert rows[1]["bd_rate"] is None


def test_an_unchanged_avatar_scores_perfectly_and_noise_as_its_variance_says() -> None:
    """Oracle: the same picture; and the squared error of a colour that is a tenth off everywhere."""
    scene = make_scene(AVATAR, HEAD, Extent(2, 4, 2, 0.15))
    brighter = replace(AVATAR.gaussians, sh_dc=AVATAR.gaussians.sh_dc - np.float32(0.1 / 0.28209479))
    scores = judge(scene, {"same": AVATAR.gaussians, "darker": brighter}, Rasteriser(1))
    assert scores["same"].psnr == 120
    assert scores["same"].ssim == pytest.approx(1)
    assert (
        scores["darker"].psnr >= 20
    )  # less than a tenth where the avatar does not cover a pixel whole, or is black already
    assert scores["darker"].psnr < 30
    assert scores["darker"].lowest_psnr <= scores["darker"].psnr


def test_avatars_are_named_as_briefly_as_tells_them_apart() -> None:
    paths = ("x/one.ply", "x/two/model", "y/two/model")
    assert subject_names([subject(path) for path in paths]) == ["x-one", "x-two", "y-two"]
    assert subject_names([subject("x/one.ply")]) == ["one"]
    assert subject_names([subject("x/frame_0026/point_cloud.ply")]) == ["frame_0026"]


def test_a_codec_that_must_be_there_and_is_not_stops_the_run(monkeypatch) -> None:
    absent = replace(PEERS["draco"], lacking=lambda: "needs what is not here")
    monkeypatch.setitem(registry.PEERS, "draco", absent)
    with pytest.raises(OptionError, match="codec draco needs what is not here"):
        compare_codecs(Comparison((subject(),), FEW, ("draco",)), Preset("tiny"), silent)


def test_an_avatar_that_stands_still_cannot_be_compared_on_posed_frames() -> None:
    with pytest.raises(OptionError, match="has no motion; name one with --motion FILE"):
        make_scene(replace(AVATAR, motion=None), HEAD, Extent())
