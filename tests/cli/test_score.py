"""`sacha score` and `sacha prune`: counts that theorems give, files that the other commands take, and one line for each mistake."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sacha_core.density.events import Calibration
from sacha_core.density.scores.table import KNOWN_SCORES
from sacha_core.density.scores_file import read_scores
from sacha_core.interchange.gaussian_avatars import read_model, write_model
from sacha_core.interchange.splat_ply import read_bound_ply, write_bound_ply

HEAD = ("--head", "synthetic:small")
SMALL = ("--width", 48, "--height", 70, "--views", 16)
REGIONS = ["mouth", "eyes", "nose", "ears", "boundary", "scalp", "neck", "face"]


@pytest.fixture(scope="module")
def imported(model: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give the model's Gaussians as a PLY that has learned no sensitivity."""
    path = tmp_path_factory.mktemp("imported") / "a.ply"
    write_bound_ply(path, replace(read_model(model)[0], sensitivity_logit=None))
    return path


@pytest.fixture(scope="module")
def scored(done, imported: Path):
    """Give the scores file that lies beside the PLY, and what the command said."""
    outcome = done("score", imported, *HEAD, *SMALL)
    return imported.with_name("a.scores.npz"), outcome


def test_score_writes_every_gaussian_with_one_calibration(scored, imported: Path) -> None:
    path, outcome = scored
    scores = read_scores(path)
    gaussians = read_bound_ply(imported)
    assert np.array_equal(scores.gaussians.position, gaussians.position)
    assert [type(event) for event in scores.events] == [Calibration]
    assert outcome.report["sensitivity"] == "estimated"
    assert [row["region"] for row in outcome.report["regions"]] == REGIONS
    assert sum(row["count"] for row in outcome.report["regions"]) == len(gaussians) == outcome.report["n_gaussians"]
    assert sum(row["visible"] for row in outcome.report["regions"]) == outcome.report["n_visible"]
    assert outcome.report["n_views"] == 16
    assert "none was learned" in outcome.out
    for row, modulator in zip(outcome.report["regions"], scores.events[0].modulator, strict=True):
        assert row["modulator"] == modulator


@pytest.mark.parametrize("kind", KNOWN_SCORES)
def test_every_known_score_can_be_asked_for(done, imported: Path, tmp_path: Path, kind: str) -> None:
    path = tmp_path / "k.scores.npz"
    assert done("score", imported, *HEAD, *SMALL, "--score", kind, "-o", path).report["score"] == kind
    assert read_scores(path).score.max() > 0


def test_score_takes_a_capture_and_keeps_what_was_learned(done, model: Path, capture: Path, tmp_path: Path) -> None:
    path = tmp_path / "m.scores.npz"
    outcome = done("score", model, "--dataset", capture, "-o", path)
    assert outcome.report["sensitivity"] == "learned"
    assert outcome.report["views_from"] == "capture"
    learned = read_model(model)[0].sensitivity_logit
    assert np.array_equal(read_scores(path).gaussians.sensitivity_logit, learned)


def test_prune_keeps_exactly_what_was_asked_for_and_the_rest_takes_it(
    done, scored, imported: Path, tmp_path: Path
) -> None:
    path, _ = scored
    n = len(read_scores(path).score)
    budgets = {
        ("--keep", 0.6): n - int(np.floor(0.4 * n + 1e-9)),
        ("--target-count", 100): 100,
        ("--ratio", 0.25): n - n // 4,
    }
    for budget, kept in budgets.items():
        outcome = done("prune", imported, *HEAD, *budget, "-o", tmp_path / "b.ply")  # finds the scores beside it
        smaller = read_bound_ply(tmp_path / "b.ply")
        assert len(smaller) == kept == outcome.report["n_gaussians"]
        assert smaller.sensitivity_logit is None  # estimates are not passed off as learned
    done("encode", "--ply", tmp_path / "b.ply", *HEAD, "-o", tmp_path / "b.sacha")


def test_prune_makes_a_model_folder_with_motion_and_head(done, model: Path, capture: Path, tmp_path: Path) -> None:
    out = tmp_path / "smaller"
    for _ in range(2):  # again over its own
        outcome = done("prune", model, "--keep", 0.5, "-o", out)  # finds the scores that training left
        assert outcome.report["scores"].endswith("model/avatar.scores.npz")
    gaussians, motion = read_model(out)
    assert motion is not None
    assert len(motion) == len(read_model(model)[1])
    assert gaussians.sensitivity_logit is not None
    done("evaluate", out, capture, "--images", 1)


def test_weights_move_the_budget_to_a_region(done, scored, imported: Path, tmp_path: Path) -> None:
    rows = {}
    for name, weights in {"plain": (), "mouth": ("--weights", "mouth=50", "eyes=1")}.items():
        outcome = done("prune", imported, *HEAD, "--keep", 0.4, *weights, "-o", tmp_path / "b.ply")
        rows[name] = {row["region"]: row["after"] for row in outcome.report["regions"]}
    assert rows["mouth"]["mouth"] > rows["plain"]["mouth"]
    assert sum(rows["mouth"].values()) == sum(rows["plain"].values())


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((), "expected one of --keep, --ratio and --target-count, or --target-size, got none"),
        (("--keep", 0.5, "--ratio", 0.5), "got --keep and --ratio"),
        (("--keep", 0), "--keep is 0"),
        (("--keep", "nan"), "--keep is nan"),
        (("--ratio", 1), "--ratio is 1"),
        (("--target-count", 10**9), "--target-count is 1000000000"),
        (("--keep", 0.5, "--weights", "mouth"), "expected REGION=FACTOR"),
        (("--keep", 0.5, "--weights", "mouth=-1"), "expected REGION=FACTOR"),
        (("--keep", 0.5, "--weights", "tail=2"), "no region 'tail'"),
        (("--keep", 0.5, "--weights", "mouth=2", "mouth=3"), "mouth twice"),
        (("--keep", 0.5, "--bounds", 2, 1), "modulators are bounded"),
    ],
)
def test_budgets_that_make_no_sense_are_refused(
    refused, scored, imported: Path, tmp_path: Path, arguments, said
) -> None:
    assert said in refused("prune", imported, *HEAD, *arguments, "-o", tmp_path / "x.ply")
    assert not list(tmp_path.iterdir())


def test_prune_refuses_what_does_not_belong_together(
    refused, scored, imported: Path, model: Path, tmp_path: Path
) -> None:
    scores, _ = scored
    alone = tmp_path / "alone.ply"
    shutil.copy(imported, alone)
    out = ("--keep", 0.5, "-o", tmp_path / "x")
    assert "sacha score" in refused("prune", alone, *HEAD, *out)
    assert "triangles" in refused("prune", imported, "--head", "synthetic", "--scores", scores, *out)
    assert "not a scores file" in refused("prune", alone, *HEAD, "--scores", model / "checkpoint.npz", *out)
    assert "the avatar itself" in refused("prune", imported, *HEAD, "--keep", 0.5, "-o", imported)
    write_model(tmp_path / "x", 77, read_bound_ply(imported))
    assert "another model, of 77" in refused("prune", imported, *HEAD, *out)
    assert "name it with --head" in refused("prune", imported, *out)


def test_score_refuses_what_it_cannot_measure(refused, imported: Path, capture: Path, tmp_path: Path) -> None:
    assert "name it with --head" in refused("score", imported)
    assert "no such file" in refused("score", tmp_path / "none.ply", *HEAD)
    assert "--views is 0" in refused("score", imported, *HEAD, "--views", 0)
    assert "expected the name of a scores file" in refused("score", imported, *HEAD, "-o", tmp_path / "x.txt")
    assert "not a folder" in refused("score", imported, *HEAD, "--dataset", imported)
    assert "transforms_train.json" in refused("score", imported, *HEAD, "--dataset", tmp_path)
    assert "tracked with" in refused("score", imported, "--head", "synthetic", "--dataset", capture)
    assert "not a directory" in refused("score", imported, *HEAD, *SMALL, "-o", imported / "x.npz")
    broken = read_bound_ply(imported)
    broken.position[3] = np.nan
    write_bound_ply(tmp_path / "nan.ply", broken)
    assert "position of Gaussian 3 is not finite" in refused("score", tmp_path / "nan.ply", *HEAD)
    assert [path.name for path in tmp_path.iterdir()] == ["nan.ply"]
