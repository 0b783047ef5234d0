"""The whole demo in miniature: what its report promises, held against the files beside it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sacha_core.avatar.gaussians import PLY_BYTES_PER_GAUSSIAN

ROUNDING = 1e-3  # decibels: the report rounds to three decimals

MINIATURE = ("--head", "synthetic:small", "--width", 68, "--height", 100, "--timesteps", 2, "--iterations", 72)


@pytest.fixture(scope="module")
def finished(tmp_path_factory, done):
    """Run the demo once."""
    out = tmp_path_factory.mktemp("demo")
    outcome = done("demo", "--out", out, *MINIATURE)
    return out, outcome, json.loads((out / "report.json").read_text())


def test_what_makes_no_sense_is_said_before_anything_is_filmed(refused, tmp_path: Path) -> None:
    assert "iterations" in refused("demo", "--out", tmp_path / "demo", *MINIATURE, "--iterations", 0)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_report_has_every_variant_level_and_split(finished):
    _, _, report = finished
    assert set(report["variants"]) == {"default", "sacha"}
    for variant in report["variants"].values():
        assert variant["raw_bytes"] == PLY_BYTES_PER_GAUSSIAN * variant["n_gaussians"]
        assert sum(variant["per_region"].values()) == variant["n_gaussians"]
        assert sum(variant["visible_per_region"].values()) == variant["n_visible"]
        assert 0 < variant["n_visible"] <= variant["n_gaussians"]
        assert set(variant["levels"]) == {"1", "2", "3", "4"}
        for part in (variant, *variant["levels"].values()):
            for split in ("novel_view", "novel_expression"):
                assert np.isfinite(part[split]["psnr"])
                assert 0 < part[split]["ssim"] <= 1


@pytest.mark.slow
def test_bytes_are_those_on_disk_and_grow_with_the_level(finished):
    _, _, report = finished
    for variant in report["variants"].values():
        sizes = [variant["levels"][level]["bytes"] for level in "1234"]
        files = [Path(variant["levels"][level]["file"]).stat().st_size for level in "1234"]
        assert sizes == files, "no head is embedded, so all of a file is Gaussians and motion"
        assert sizes == sorted(sizes)


@pytest.mark.slow
def test_figures_are_what_evaluate_finds_on_the_files(finished, done):
    """The command `evaluate` reads back from disk what the demo judged in memory."""
    out, _, report = finished
    ours = report["variants"]["sacha"]
    for avatar, judged in ((out / "sacha", ours), (out / "sacha-1.sacha", ours["levels"]["1"])):
        outcome = done("evaluate", avatar, out / "capture")
        for split in ("novel_view", "novel_expression"):
            assert outcome.report[split]["psnr"] == pytest.approx(judged[split]["psnr"], abs=ROUNDING)


@pytest.mark.slow
def test_picture_and_table_are_there(finished):
    out, outcome, _ = finished
    picture = np.asarray(Image.open(out / "overview.png"))
    assert picture.shape[1] > 8 * 30, "eight panels stand side by side"
    assert np.ptp(picture) > 200
    for text in ("default, uncompressed", "level 4", "boundary", str(out / "report.json")):
        assert text in outcome.out


@pytest.mark.slow
def test_second_call_keeps_what_is_there(finished, done):
    out, _, report = finished
    model = out / "sacha" / "checkpoint.npz"
    before = model.read_bytes()
    outcome = done("demo", "--out", out, *MINIATURE)
    again = json.loads((out / "report.json").read_text())
    assert "kept" in outcome.out
    assert model.read_bytes() == before
    assert again["variants"] == report["variants"]
