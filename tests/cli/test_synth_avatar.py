"""`sacha synth --avatar` through the shell: what lands on disk, what a second call keeps, what training makes of it, what is refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sacha_core.avatar.binding import initial_gaussians
from sacha_core.avatar.gaussians import Gaussians
from sacha_core.flame.head_file import load_head
from sacha_core.flame.rig import read_rig
from sacha_core.flame.synthetic import synthetic_head
from sacha_core.interchange.capture import read_capture
from sacha_core.interchange.splat_ply import write_bound_ply
from sacha_core.regions.labels import label_triangles, region_counts

SMALL = ("--width", 64, "--height", 94, "--cameras", 0, 8, 11, "--supersample", 1)
FEW = ("--timesteps", 2, "--test-timesteps", 2, "--sequences", "EMO-1")


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give a raw rig: a mesh with three of ARKit's shapes and the masks of its regions."""
    head = synthetic_head("small")
    deltas = np.random.default_rng(0).normal(0, 1e-3, (3, head.n_vertices, 3)).astype(np.float32)
    path = tmp_path_factory.mktemp("rig") / "rig.npz"
    masks = {f"mask_{name}": mask for name, mask in head.masks.items()}
    teeth = np.unique(
        head.faces[head.n_faces - head.n_teeth_faces :]
    )  # a raw rig does not say which triangles these are
    masks["mask_lips"] = np.union1d(masks["mask_lips"], teeth)
    names = np.array(["jawOpen", "eyeBlinkLeft", "eyeBlinkRight"])
    np.savez(path, verts=head.v_template, faces=head.faces, arkit_deltas=deltas, arkit_names=names, **masks)
    return path


@pytest.fixture(scope="module")
def avatar(rig: Path) -> Path:
    """Give a PLY of Gaussians bound to the rig."""
    head = read_rig(rig)
    rng = np.random.default_rng(1)
    path = rig.with_name("some_body (1).ply")
    write_bound_ply(path, opaque(head.n_faces, rng))
    return path


def opaque(n_faces: int, rng: np.random.Generator) -> Gaussians:
    gaussians = initial_gaussians(n_faces, rng, sh_degree=0)
    colours = rng.normal(0, 1, (n_faces, 3)).astype(np.float32)
    return replace(gaussians, opacity_logit=np.full(n_faces, 4, np.float32), sh_dc=colours)


@pytest.fixture(scope="module")
def filmed(done, avatar: Path, rig: Path, tmp_path_factory: pytest.TempPathFactory):
    """Give the folder of a tiny capture, and what was said."""
    folder = tmp_path_factory.mktemp("filmed")
    return folder, done("synth", folder, "--avatar", avatar, "--head", rig, *SMALL, *FEW)


def test_the_capture_and_its_head_lie_on_disk(filmed) -> None:
    folder, outcome = filmed
    assert outcome.report["n_images"] == 12
    assert outcome.report["head"] == "rig"
    assert "mouth 0," not in outcome.out
    assert "regions      mouth " in outcome.out
    union = Path(outcome.report["capture"])
    assert union.name == "UNION2_some-body-1_EMO1FREE_v16_whiteBg"
    capture = read_capture(folder)
    assert (len(capture.train), len(capture.val), len(capture.test)) == (4, 2, 6)
    assert json.loads((union / "head.json").read_text())["file"] == "../head.npz"
    assert capture.head_path is not None
    assert capture.head_path.is_file()
    assert capture.motion.expression.shape == (4, 3)
    assert 0 <= capture.motion.expression.min() <= capture.motion.expression.max() <= 1
    for view in capture.train:
        image, mask = capture.image(view), np.asarray(Image.open(view.mask_path))
        assert (image[mask == 0] == 255).all(), "white where nobody is"
        assert 0.1 < (mask > 127).mean() < 0.7


def test_a_second_call_goes_on_where_the_first_stopped(done, filmed, avatar: Path, rig: Path) -> None:
    folder, _ = filmed
    before = {path: path.read_bytes() for path in folder.rglob("*.png")}
    (folder / "some-body-1_FREE_v16_whiteBg" / "transforms.json").unlink()  # as if it had been interrupted there
    again = done("synth", folder, "--avatar", avatar, "--head", rig, *SMALL, *FEW)
    assert "kept         1 of 2 sequences" in again.out
    assert {path: path.read_bytes() for path in folder.rglob("*.png")} == before
    other = done("synth", folder, "--avatar", avatar, "--head", rig, *SMALL, *FEW, "--seed", 1)
    assert "kept" not in other.out
    done("synth", folder, "--avatar", avatar, "--head", rig, *SMALL, *FEW)  # as the other tests expect it
    assert {path: path.read_bytes() for path in folder.rglob("*.png")} == before


def test_training_finds_the_head_beside_the_capture(
    done, filmed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SACHA_HEADS", str(tmp_path / "empty"))
    report = done("train", filmed[0], "-o", tmp_path / "model", "--iterations", 20, "--sh-degree", 0).report
    assert report["n_gaussians"] > 0


def test_a_model_folder_films_the_person_that_it_was_trained_on(done, model: Path, tmp_path: Path) -> None:
    done("synth", tmp_path, "--avatar", model, *SMALL, *FEW)
    trained = read_capture(tmp_path)
    assert trained.head is not None
    assert trained.head.name == "synthetic-small-0"
    assert trained.motion.expression.shape[1] == 41


def test_a_sacha_file_films_too(done, sacha_file: Path, tmp_path: Path) -> None:
    outcome = done("synth", tmp_path, "--avatar", sacha_file, *SMALL, *FEW, "--sequences", "EXP-2")
    assert outcome.report["n_images"] == 12


def test_refusals(refused, avatar: Path, rig: Path, tmp_path: Path) -> None:
    out = tmp_path / "nothing"
    who = ("--avatar", avatar, "--head", rig)
    weights = tmp_path / "weights.npz"
    np.savez(
        weights, weights=np.zeros((30, 3), np.float32), names=np.array(["jawOpen", "eyeBlinkLeft", "eyeBlinkRight"])
    )
    foreign = tmp_path / "foreign.npz"
    np.savez(foreign, weights=np.ones((30, 1), np.float32), names=np.array(["tongueOut"]))
    garbage = tmp_path / "garbage.ply"
    garbage.write_bytes(bytes(range(256)) * 4)
    for arguments, message in (
        (("--motion", weights), "--motion is for an avatar; expected --avatar AVATAR beside it"),
        (("--masks", weights), "--masks is for an avatar"),
        (("--head", rig), "give --avatar AVATAR for others"),
        (("--avatar", avatar), "name it with --head HEAD"),
        (("--avatar", tmp_path / "missing.ply", "--head", rig), "missing.ply"),
        (("--avatar", garbage, "--head", rig), "garbage.ply"),
        (("--avatar", avatar, "--head", garbage), "garbage.ply"),
        ((*who, "--sequences", "EMO-9"), "no sequence 'EMO-9'"),
        ((*who, "--motion", weights, "--sequences", "a_b"), "'a_b': expected letters"),
        ((*who, "--motion", weights, "--timesteps", 7), "has 30 frames, 6 for each of 5 sequences"),
        ((*who, "--motion", foreign), "no blend shape 'tongueOut'"),
        ((*who, "--motion", garbage), "garbage.ply"),
        ((*who, "--cameras", 1, 2), "expected 8"),
        ((*who, "--supersample", 0), "supersample is 0"),
    ):
        assert message in refused("synth", out, *arguments)
    assert not out.exists(), "nothing is half written"


@pytest.mark.real_data
def test_a_real_avatar(done, real_data: Path, tmp_path: Path) -> None:
    who = (
        "--avatar",
        real_data / "avatar_a_bound.ply",
        "--head",
        real_data / "avatar_a_rig.npz",
        "--masks",
        real_data / "FLAME_masks.npz",
    )
    done("synth", tmp_path / "acted", *who, *SMALL, *FEW)
    acted = read_capture(tmp_path / "acted")
    assert acted.motion.expression.shape == (4, 51)
    assert np.ptp(acted.motion.expression, axis=0).max() > 0.5
    head = load_head(tmp_path / "acted" / "head.npz")
    counts = region_counts(label_triangles(head), np.arange(head.n_faces))
    assert (counts > 0).all(), "the official masks label all eight regions"
    assert counts.sum() == 9976
    for view in acted.train:
        mask = np.asarray(Image.open(view.mask_path)) > 127
        assert not mask[0].any(), "the bun is in the picture"
        assert 0.3 < mask.mean() < 0.7
    done("synth", tmp_path / "driven", *who, *SMALL, *FEW, "--motion", real_data / "motion_arkit_a.npz")
    weights = np.load(real_data / "motion_arkit_a.npz")["weights"]
    driven = read_capture(tmp_path / "driven").motion.expression
    assert all((row == weights).all(axis=1).any() for row in driven), "every moment is one of the motion's"
