"""`sacha train --finetune-level`: the file that it leaves is judged by `sacha evaluate` against the plain file of the same model."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

# What fitting promises is a file nearer to the pictures of the cameras that the model was trained by. In expressions that it never saw,
# by those cameras, models of three seeds gained 1.3 to 1.6 dB. A camera that is held out from two, after a hundred iterations that left
# everything rough, is promised nothing: it saw -0.21, +0.17 and +0.21 dB. So there it is held not to be spoiled, and no more.
GAINED_DB = 1.0
WORSE_DB = 0.3
MORE_BYTES = 1.12  # of the plain file, of which 6 to 10 % are usual on an avatar of 1,300 bytes


def test_finetuned_file_lies_beside_the_model_and_looks_better_by_the_cameras_of_training(
    done, capture: Path, model: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "model"
    shutil.copytree(model, folder)
    outcome = done("train", capture, "-o", folder, "--iterations", 100, "--sh-degree", 1, "--finetune-level", 1)
    told = outcome.report["tuned"]
    assert Path(told["file"]) == folder / "level-1.sacha"
    assert told["bytes"] == (folder / "level-1.sacha").stat().st_size
    assert ", fitted to it in " in outcome.out
    plain = tmp_path / "plain.sacha"
    done("encode", model, "-o", plain, "--level", 1)
    assert told["bytes"] < MORE_BYTES * plain.stat().st_size
    before, after = (done("evaluate", path, capture).report for path in (plain, folder / "level-1.sacha"))
    assert after["novel_expression"]["psnr"] > before["novel_expression"]["psnr"] + GAINED_DB
    assert after["novel_view"]["psnr"] > before["novel_view"]["psnr"] - WORSE_DB


def test_model_alone_says_nothing_of_tuning(done, capture: Path, model: Path, tmp_path: Path) -> None:
    folder = tmp_path / "model"
    shutil.copytree(model, folder)
    assert done("train", capture, "-o", folder, "--iterations", 100, "--sh-degree", 1).report["tuned"] is None
    assert not list(folder.glob("*.sacha"))


@pytest.mark.slow
def test_tuned_file_keeps_to_a_size(done, model: Path, tmp_path: Path) -> None:
    file = tmp_path / "a.sacha"
    report = done("encode", model, "--tune", "--target-size", "3KB", "-o", file).report
    assert 0.9 * 3000 < report["bytes"]["total"] == file.stat().st_size <= 3000
