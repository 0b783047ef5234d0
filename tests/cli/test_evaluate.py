"""`sacha evaluate`'s columns: what is asked for is shown and reported, and nothing else."""

from __future__ import annotations

from pathlib import Path

import pytest

from sacha_core.evaluate import lpips
from sacha_core.regions.scheme import PAPER


@pytest.fixture
def without_weights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TORCH_HOME", str(tmp_path))
    monkeypatch.delenv(lpips.FOLDER, raising=False)


def test_every_metric_and_every_region(done, capture: Path, model: Path, without_weights) -> None:
    outcome = done(
        *("evaluate", model, capture, "--images", 2, "--regions", "--metrics", "psnr", "ssim", "flip", "lpips")
    )
    for title in ("PSNR", "SSIM", "FLIP", "LPIPS VGG", "LPIPS Alex", *PAPER.regions):
        assert title in outcome.out
    for setting in ("novel_view", "novel_expression"):
        found = outcome.report[setting]
        assert 0 < found["flip"] < 1
        assert list(found["regions"]) == list(PAPER.regions)
        assert sum(region["pixels"] for region in found["regions"].values()) > 500
        assert found["regions"]["face"]["psnr"] > 5
        assert 0 < found["regions"]["face"]["flip"] < 1
        assert "lpips_vgg" not in found
    assert set(outcome.report["not_measured"]) == {"lpips_vgg", "lpips_alex"}
    assert outcome.report["not_measured"]["lpips_vgg"] in outcome.out


def test_only_what_is_asked_for(done, capture: Path, model: Path) -> None:
    outcome = done("evaluate", model, capture, "--images", 1, "--metrics", "psnr")
    assert "PSNR" in outcome.out
    assert not {"SSIM", "FLIP", "LPIPS", "mouth"} & set(outcome.out.split())
    assert outcome.report["novel_view"]["ssim"] is None
    assert outcome.report["novel_view"]["regions"] == {}
    assert outcome.report["not_measured"] == {}


def test_what_was_not_measured_is_a_dash_in_table_one(done, capture: Path, model: Path) -> None:
    outcome = done("evaluate", model, capture, "--images", 1, "--metrics", "psnr", "--table-one")
    mine = next(line for line in outcome.out.splitlines() if line.lstrip().startswith("yours, as a model"))
    assert mine.split()[-2:] == ["-", "-"]
    assert outcome.report["table_one"]["ssim"] is None
    assert outcome.report["table_one"]["lpips"] is None
