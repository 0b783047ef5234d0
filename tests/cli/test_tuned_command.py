"""`sacha train --finetune-level`: the file that it leaves is judged by `sacha evaluate` against the plain file of the same model."""

from __future__ import annotations

import shutil
from pathlib import Path

WORSE_DB = 0.5  # by a held-out camera, after a hundred iterations that left everything rough; what fitting gains is held in tests/rate


def test_finetuned_file_lies_beside_the_model_and_looks_no_worse(
    done, capture: Path, model: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "model"
    shutil.copytree(model, folder)
    outcome = done("train", capture, "-o", folder, "--iterations", 100, "--sh-degree", 1, "--finetune-level", 1)
    told = outcome.report["tuned"]
    assert Path(told["file"]) == folder / "level-1.sacha"
    assert told["bytes"] == (folder / "level-1.sacha").stat().st_size
    assert "fitted through its quantiser" in outcome.out
    plain = tmp_path / "plain.sacha"
    done("encode", model, "-o", plain, "--level", 1)
    found = [done("evaluate", path, capture).report["novel_view"]["psnr"] for path in (plain, folder / "level-1.sacha")]
    assert found[1] > found[0] - WORSE_DB


def test_model_alone_says_nothing_of_tuning(done, capture: Path, model: Path, tmp_path: Path) -> None:
    folder = tmp_path / "model"
    shutil.copytree(model, folder)
    assert done("train", capture, "-o", folder, "--iterations", 100, "--sh-degree", 1).report["tuned"] is None
    assert not list(folder.glob("*.sacha"))
