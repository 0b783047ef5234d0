"""`sacha prune` straight into a file: sizes, shares and locks kept to, more for what matters, and one line for each mistake."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sacha_core.codec import decode, inspect
from sacha_core.density.scores_file import read_scores
from sacha_core.flame.head_file import save_head
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.interchange.gaussian_avatars import read_model
from sacha_core.interchange.splat_ply import read_bound_ply, write_bound_ply
from sacha_core.regions.labels import label_triangles
from sacha_core.regions.partition import Partition
from sacha_core.regions.scheme import PAPER
from sacha_core.regions.scheme_file import write_scheme_file

HEAD = ("--head", "synthetic:small")
FEW = ("--views", 16, "--make-scores")
TARGET = 2_500  # bytes, so few that every region has to give
LABELS = label_triangles(synthetic_head("small"))
MOUTH, EYES = PAPER.label("mouth"), PAPER.label("eyes")


@pytest.fixture(scope="module")
def avatar(model: Path, done, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give the model's Gaussians as a PLY that was scored once."""
    path = tmp_path_factory.mktemp("steered") / "a.ply"
    write_bound_ply(path, replace(read_model(model)[0], sensitivity_logit=None))
    done("prune", path, *HEAD, *FEW, "--keep", 0.9, "-o", path.with_name("once.ply"))
    return path


def counts(path: Path) -> np.ndarray:
    """Count the Gaussians of a file by region."""
    found = decode(path, head=synthetic_head("small")).gaussians
    return np.bincount(LABELS[found.binding], minlength=len(PAPER.regions))


def test_scores_are_made_once_and_anew_where_the_avatar_has_changed(done, avatar: Path, tmp_path: Path) -> None:
    scores = avatar.with_name("a.scores.npz")
    gaussians = read_bound_ply(avatar)
    assert np.array_equal(read_scores(scores).gaussians.position, gaussians.position)
    made = scores.stat().st_mtime_ns
    done("prune", avatar, *HEAD, *FEW, "--keep", 0.5, "-o", tmp_path / "b.ply")
    assert scores.stat().st_mtime_ns == made
    other = tmp_path / "a.ply"
    write_bound_ply(other, gaussians.select(np.arange(0, len(gaussians), 2)))
    (tmp_path / "a.scores.npz").write_bytes(scores.read_bytes())
    report = done("prune", other, *HEAD, *FEW, "--keep", 0.5, "-o", tmp_path / "b.ply").report
    assert report["n_before"] == (len(gaussians) + 1) // 2


def test_a_size_is_met_and_a_region_keeps_more_where_it_weighs_more(done, avatar: Path, tmp_path: Path) -> None:
    whole = np.bincount(LABELS[read_bound_ply(avatar).binding], minlength=8)
    kept, region, weights = [], 0, tuple[str, ...]()
    for name in ("neutral", "weighted"):
        path = tmp_path / f"{name}.sacha"
        outcome = done("prune", avatar, *HEAD, "--target-size", TARGET, *weights, "-o", path)
        assert 0.9 * TARGET < path.stat().st_size == outcome.report["n_bytes"] <= TARGET
        kept.append(counts(path))
        assert [row["after"] for row in outcome.report["regions"]] == kept[-1].tolist()
        assert sum(kept[-1]) == outcome.report["n_gaussians"] == inspect(path).n_gaussians
        assert outcome.report["n_bytes_before"] == avatar.stat().st_size
        region = int(np.argmax(whole - kept[0]))  # the one that gives most: a mouth this small gives none
        weights = ("--weights", f"{PAPER.regions[region]}=2")
    assert kept[1][region] > kept[0][region]


def test_shares_locks_and_a_fixed_share_hold_in_the_file(done, avatar: Path, tmp_path: Path) -> None:
    path, before = tmp_path / "b.sacha", np.bincount(LABELS[read_bound_ply(avatar).binding], minlength=8)
    limits = ("--shares", "mouth=0.05:0.06", "neck=:0.02", "--lock", "eyes", "nose=3")
    done("prune", avatar, *HEAD, "--keep", 0.6, "--level", 1, *limits, "-o", path)
    after, total = counts(path), sum(before) - int(np.floor(0.4 * sum(before) + 1e-9))
    assert sum(after) == total
    assert 0.05 * total <= after[MOUTH] <= 0.06 * total
    assert after[PAPER.label("neck")] <= 0.02 * total
    assert after[EYES] == before[EYES]
    assert after[PAPER.label("nose")] == 3


def test_an_archive_keeps_every_bit_of_what_stays(done, avatar: Path, tmp_path: Path) -> None:
    for ending in ("sacha", "ply"):
        level = ("--level", "archive") if ending == "sacha" else ()
        done("prune", avatar, *HEAD, "--keep", 0.3, *level, "-o", tmp_path / f"b.{ending}")
    kept, archived = read_bound_ply(tmp_path / "b.ply"), decode(tmp_path / "b.sacha").gaussians
    assert np.array_equal(kept.position, archived.position)
    assert np.array_equal(kept.binding, archived.binding)
    assert np.array_equal(kept.sh_rest, archived.sh_rest)


def test_a_ply_stays_of_its_degree(done, avatar: Path, tmp_path: Path) -> None:
    flat = tmp_path / "flat.ply"
    gaussians = read_bound_ply(avatar)
    write_bound_ply(flat, replace(gaussians, sh_rest=gaussians.sh_rest[:, :0]), 0)
    done("prune", flat, *HEAD, *FEW, "--keep", 0.5, "-o", tmp_path / "b.ply")
    assert read_bound_ply(tmp_path / "b.ply").sh_degree == 0


def test_painted_triangles_and_regions_of_ones_own_keep_more(done, avatar: Path, tmp_path: Path) -> None:
    left = np.arange(len(LABELS)) % 2  # two regions that no mask makes
    scheme = tmp_path / "two.scheme.npz"
    write_scheme_file(scheme, Partition("two", ("even", "odd"), ((0, 0, 0), (255, 255, 255)), left.astype(np.uint8)))
    np.save(tmp_path / "odd.npy", left.astype(np.float32))
    painted = ("--importance", tmp_path / "odd.npy", "--importance-strength", 8)
    kept = {}
    for name, given in {"plain": (), "weight": ("--weights", "odd=8"), "painted": painted}.items():
        arguments = ("prune", avatar, *HEAD, "--keep", 0.5, "--scheme", scheme, *given, "-o", tmp_path / f"{name}.ply")
        rows = done(*arguments).report["regions"]
        assert [row["region"] for row in rows] == ["even", "odd"]
        kept[name] = rows[1]["after"]
    assert kept["plain"] < kept["weight"] == kept["painted"]


def test_a_head_without_masks_is_steered_by_regions_of_ones_own(done, refused, avatar: Path, tmp_path: Path) -> None:
    head = tmp_path / "bare.npz"
    save_head(replace(synthetic_head("small"), masks={}), head)
    scheme, path = tmp_path / "two.scheme.npz", tmp_path / "a.ply"
    shutil.copy(avatar, path)
    front = (np.arange(len(LABELS)) < 200).astype(np.uint8)
    write_scheme_file(scheme, Partition("two", ("rest", "front"), ((0, 0, 0), (255, 255, 255)), front))
    given = ("prune", path, "--head", head, "--keep", 0.5, "-o", tmp_path / "b.ply")
    assert "no vertex mask" in refused(*given, *FEW)
    assert "no vertex mask" in refused("score", path, "--head", head, "--views", 16)
    rows = done(*given, *FEW, "--scheme", scheme).report["regions"]
    assert [row["region"] for row in rows] == ["rest", "front"]
    assert read_scores(tmp_path / "a.scores.npz").scheme == "two"
    assert "name the file of these with --scheme" in refused(*given)
    scored = done("score", path, "--head", head, "--views", 16, "--scheme", scheme, "-o", tmp_path / "s.npz").report
    assert [row["region"] for row in scored["regions"]] == ["rest", "front"]


def test_an_earlier_result_is_set_beside_with_decibels_of_both(done, avatar: Path, tmp_path: Path) -> None:
    first, second = tmp_path / "first.sacha", tmp_path / "second.sacha"
    done("prune", avatar, *HEAD, "--keep", 0.3, "--level", 1, "-o", first)
    shown = ("--measure", "--before", first, "--scene", tmp_path / "scene")
    outcome = done("prune", avatar, *HEAD, "--keep", 0.9, "--level", 3, *shown, "-o", second)
    rows = outcome.report["regions"]
    assert [row["shown_before"] for row in rows] == counts(first).tolist()
    assert all(row["psnr_db"] > row["psnr_before_db"] for row in rows if row["after"] > row["shown_before"])
    assert outcome.report["n_bytes_before"] == first.stat().st_size
    assert (tmp_path / "scene" / "scene.json").is_file()


def test_what_cannot_be_measured_is_not_written(refused, model: Path, capture: Path, tmp_path: Path) -> None:
    broken = tmp_path / "capture"
    shutil.copytree(capture, broken)
    for image in broken.rglob("*.png"):
        image.write_bytes(b"no picture")
    judged = ("--measure", "--dataset", broken)
    refused("prune", model, "--keep", 0.5, "--level", 1, *judged, "-o", tmp_path / "b.sacha")
    assert [path.name for path in tmp_path.iterdir()] == ["capture"]


def test_held_out_images_judge_what_a_capture_trained(done, model: Path, capture: Path, tmp_path: Path) -> None:
    judged = ("--measure", "--dataset", capture)
    outcome = done("prune", model, "--keep", 0.2, "--level", 1, *judged, "-o", tmp_path / "b.sacha")
    known = [row for row in outcome.report["regions"] if row["psnr_db"] is not None]
    assert known
    assert np.mean([row["psnr_db"] - row["psnr_before_db"] for row in known]) < 0


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--target-size", "10"), "out of reach"),
        (("--target-size", "much"), "a size of 'much'"),
        (("--target-size", "5KB", "--level", 2), "expected one of them"),
        (("--keep", 0.5, "--shares", "mouth=0.5"), "expected REGION=LOWEST:HIGHEST"),
        (("--keep", 0.5, "--shares", "mouth=0.5:0.1"), "expected REGION=LOWEST:HIGHEST"),
        (("--keep", 0.5, "--shares", "mouth=0.9:1"), "and a share of 0.9 of"),
        (("--keep", 0.01, "--lock", "face", "scalp"), "smallest shares and locks ask for"),
        (("--keep", 0.5, "--lock", "eyes=-3"), "expected REGION or REGION=COUNT"),
        (("--keep", 0.5, "--lock", "tail"), "no region 'tail'"),
        (("--keep", 0.5, "--scope", "regions", "--lock", "eyes"), "expected another scope"),
        (("--keep", 0.5, "--importance-strength", 2), "expected that too"),
        (("--keep", 0.5, "--importance", "AVATAR"), "not a .npy file"),
        (("--keep", 0.5, "--scheme", "AVATAR"), "not an .npz archive"),
        (("--keep", 0.5, "--scheme", "SCORES"), "not a scheme file"),
        (("--keep", 0.5, "--dataset", "FOLDER"), "expected one of these with it"),
        (("--keep", 0.5, "--views", 0), "--views is 0"),
        (("--keep", 0.5, "--measure", "--dataset", "FOLDER"), "transforms_train.json"),
    ],
)
def test_what_makes_no_sense_is_refused_and_nothing_is_written(
    refused, avatar: Path, tmp_path: Path, arguments, said
) -> None:
    files = {"AVATAR": avatar, "SCORES": avatar.with_name("a.scores.npz"), "FOLDER": avatar.parent}
    given = [files.get(argument, argument) for argument in arguments]
    assert said in refused("prune", avatar, *HEAD, *given, "-o", tmp_path / "x.sacha")
    assert not list(tmp_path.iterdir())


def test_only_files_have_a_level_and_a_size(refused, avatar: Path, tmp_path: Path) -> None:
    for given in (("--level", 2), ("--embed-head",)):
        assert "is of .sacha files" in refused("prune", avatar, *HEAD, "--keep", 0.5, *given, "-o", tmp_path / "x.ply")
    assert "is of .sacha files" in refused("prune", avatar, *HEAD, "--target-size", "5KB", "-o", tmp_path / "x.ply")
    before = tmp_path / "b.sacha"
    before.write_bytes(b"")
    beside = ("--before", before, "-o", before)
    assert "what it shall be set beside" in refused("prune", avatar, *HEAD, "--keep", 0.5, *beside)
